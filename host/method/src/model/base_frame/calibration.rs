//! What one scan tells the next of the cell: hand-eye transform and camera, and how exact they are.

use super::prior::{self, CellAccuracy, SHARED};
use crate::geometry::cloud::View;
use crate::model::camera::CameraErrors;
use nalgebra::{Isometry3, SMatrix};

/// Hand-eye motion and errors of the camera, with their covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// To be multiplied to the stated `flange_from_camera` from the right; mm.
    pub camera_from_corrected: Isometry3<f64>,
    /// Errors of the camera.
    pub camera: CameraErrors,
    /// Of turn, rad, and shift, mm, of the hand-eye motion in the camera's frame, and of depth scale, focal length, optical
    /// axis (two) and k1.
    pub covariance: SMatrix<f64, SHARED, SHARED>,
}

impl Calibration {
    /// Nothing known but what is usual.
    pub fn unknown(cell: CellAccuracy) -> Self {
        let sigma = prior::usual(cell.hand_eye_deg.to_radians(), cell.hand_eye_mm, 1.0);
        Self {
            camera_from_corrected: Isometry3::identity(),
            camera: CameraErrors::default(),
            covariance: SMatrix::from_diagonal(&sigma.map(|s| s * s)),
        }
    }

    /// Standard deviations, in the order of the covariance.
    pub fn sigma(&self) -> [f64; SHARED] {
        self.covariance.diagonal().map(|v| v.max(0.0).sqrt()).into()
    }

    /// Inverse of the covariance; none where it is none.
    pub(super) fn information(&self) -> Option<SMatrix<f64, SHARED, SHARED>> {
        Some(self.covariance.cholesky()?.inverse())
    }

    /// This, and after it what a scan told from which this was taken out.
    pub fn then(&self, further: &Self) -> Self {
        Self {
            camera_from_corrected: self.camera_from_corrected * further.camera_from_corrected,
            camera: self.camera + further.camera,
            covariance: further.covariance,
        }
    }

    /// The view as a calibrated cell would have seen it; as it is where its camera is unknown.
    pub(crate) fn taken_out_of(&self, view: &View) -> View {
        if !view.camera_known {
            return view.clone();
        }
        let base_from_camera = view.base_from_camera * self.camera_from_corrected;
        View { base_from_camera, ..self.camera.taken_out_of(view) }
    }
}
