//! What is known of robot, hand-eye transform and camera before a scan is looked at.

use crate::model::camera::{self, CameraErrors};
use nalgebra::{SMatrix, SVector};

/// Unknowns that all views share: hand-eye motion (turn, shift) and five errors of the camera.
pub(super) const SHARED: usize = 11;

/// Places of the depth scale and the optical axis among them.
pub(super) const DEPTH_SCALE: usize = 6;
pub(super) const AXIS: [usize; 2] = [8, 9];

/// One standard deviation of a hand-eye transform that is exact, mm and rad; and share of a camera's usual errors.
const EXACT_MM: f64 = 1e-4;
const EXACT_RAD: f64 = 1e-7;
const EXACT_SHARE: f64 = 1e-4;
/// One standard deviation of a pose that nobody stated, where the first is exact, mm and degrees: those of registration.
const GUESSED_MM: f64 = 1.5;
const GUESSED_RAD: f64 = 0.008;

/// One standard deviation, each axis, of what nobody measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellAccuracy {
    /// Position that the robot reports, mm.
    pub robot_mm: f64,
    /// Its orientation, degrees.
    pub robot_deg: f64,
    /// Position of the camera on the flange, mm.
    pub hand_eye_mm: f64,
    /// Its orientation, degrees.
    pub hand_eye_deg: f64,
}

/// An arm of everyday quality, and a hand-eye calibration by hand with a board.
impl Default for CellAccuracy {
    fn default() -> Self {
        Self { robot_mm: 0.3, robot_deg: 0.05, hand_eye_mm: 3.0, hand_eye_deg: 1.0 }
    }
}

impl CellAccuracy {
    /// One standard deviation of a camera's pose, mm and rad, each axis.
    pub(crate) fn camera(&self) -> [f64; 2] {
        let rad = self.robot_deg.hypot(self.hand_eye_deg).to_radians();
        [self.robot_mm.hypot(self.hand_eye_mm), rad]
    }
}

/// What holds the model in the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Anchor {
    /// Poses and hand-eye transform are as accurate as this.
    Cell(CellAccuracy),
    /// The first view that fits is where it is reported, exactly.
    First,
}

impl Default for Anchor {
    fn default() -> Self {
        Self::Cell(CellAccuracy::default())
    }
}

/// As the adjustment takes it.
#[derive(Debug, Clone)]
pub(super) struct Prior {
    /// One standard deviation of a position that the robot reports, each axis, mm.
    pub(super) robot_mm: f64,
    /// The same of its orientation, rad.
    pub(super) robot_rad: f64,
    /// Whether the first view's pose is exact.
    pub(super) first_exact: bool,
    /// Information of what all views share.
    pub(super) shared: SMatrix<f64, SHARED, SHARED>,
    /// What of it is taken out already: the prior is about nothing at all.
    pub(super) taken_out: SVector<f64, SHARED>,
}

impl Prior {
    /// Of what holds the model, with the information of a calibration, if there is one, and with errors of the camera that are
    /// taken out of the points already.
    pub(super) fn new(
        anchor: Anchor,
        calibrated: Option<SMatrix<f64, SHARED, SHARED>>,
        taken_out: Option<CameraErrors>,
    ) -> Self {
        let (robot_mm, robot_rad, [turn, shift], first_exact) = match anchor {
            Anchor::Cell(cell) => {
                let hand_eye = [cell.hand_eye_deg.to_radians(), cell.hand_eye_mm];
                (cell.robot_mm, cell.robot_deg.to_radians(), hand_eye, false)
            }
            Anchor::First => (GUESSED_MM, GUESSED_RAD, [EXACT_RAD, EXACT_MM], true),
        };
        let shared = calibrated.unwrap_or_else(|| information(turn, shift, 1.0));
        let mut pulled = SVector::<f64, SHARED>::zeros();
        if let Some(errors) = taken_out {
            pulled.fixed_rows_mut::<5>(6).copy_from(&errors.vector());
        }
        Self { robot_mm, robot_rad, first_exact, shared, taken_out: pulled }
    }

    /// The same with a camera whose depth scale is right: surfaces do not tell it, as larger work farther from cameras that
    /// are farther apart looks the same.
    pub(super) fn with_exact_scale(&self) -> Self {
        self.with_exact(&[DEPTH_SCALE])
    }

    /// The same with its optical axis, too, which a turn of the camera does as well but for little: where all views look down on
    /// the work at about one angle, whatever bends the faces near their ends passes for it.
    pub(super) fn with_exact_scale_and_axis(&self) -> Self {
        self.with_exact(&[DEPTH_SCALE, AXIS[0], AXIS[1]])
    }

    fn with_exact(&self, places: &[usize]) -> Self {
        let (mut shared, exact) = (self.shared, information(1.0, 1.0, EXACT_SHARE));
        for &place in places {
            shared.row_mut(place).fill(0.0);
            shared.column_mut(place).fill(0.0);
            shared[(place, place)] = exact[(place, place)];
        }
        Self { shared, ..self.clone() }
    }

    /// The same with a camera that has no errors.
    pub(super) fn with_exact_camera(&self) -> Self {
        let mut shared = self.shared;
        shared.fixed_view_mut::<5, 6>(6, 0).fill(0.0);
        shared.fixed_view_mut::<6, 5>(0, 6).fill(0.0);
        let exact = information(1.0, 1.0, EXACT_SHARE);
        shared.fixed_view_mut::<5, 5>(6, 6).copy_from(&exact.fixed_view::<5, 5>(6, 6));
        Self { shared, taken_out: SVector::zeros(), ..self.clone() }
    }
}

/// Standard deviations of what all views share.
pub(super) fn usual(turn_rad: f64, shift_mm: f64, camera_share: f64) -> SVector<f64, SHARED> {
    let mut sigma = SVector::<f64, SHARED>::zeros();
    sigma.fixed_rows_mut::<3>(0).fill(turn_rad);
    sigma.fixed_rows_mut::<3>(3).fill(shift_mm);
    sigma.fixed_rows_mut::<5>(6).copy_from(&(camera::usual() * camera_share));
    sigma
}

fn information(turn_rad: f64, shift_mm: f64, camera_share: f64) -> SMatrix<f64, SHARED, SHARED> {
    SMatrix::from_diagonal(&usual(turn_rad, shift_mm, camera_share).map(|s| s.powi(-2)))
}
