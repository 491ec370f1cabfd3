//! How far a seam may be off, and what of it comes from where.

use serde::{Deserialize, Serialize};

/// Parts of a seam's expected error: standard deviations across it, both axes together, mm. The squares sum to the square of
/// [`tip_error_mm`](super::Seam::tip_error_mm).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorParts {
    /// Scatter of the points, and what the method itself leaves.
    pub noise_mm: f64,
    /// Views that are not put together as they were taken.
    pub registration_mm: f64,
    /// Hand-eye transform, camera and robot: what moves all views alike. Not a number where nothing is known of the frame.
    pub calibration_mm: f64,
    /// Corners that the camera rounds or fills, or that have a radius.
    pub corner_mm: f64,
    /// Places that the robot's tip touched: how well they hold the plan.
    pub touch_mm: f64,
}

/// What the scatter of a seam's own points tells of its error: by this it is judged whether a seam is there. What is stated of a seam
/// that is offered also has what its points cannot tell.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FitError {
    /// Of the position across it, within the scan, mm.
    pub position_mm: f64,
    /// Of the torch, degrees.
    pub torch_deg: f64,
}

impl ErrorParts {
    /// Of what was made of one exact cloud or mesh.
    pub(super) fn of_noise(noise_mm: f64) -> Self {
        Self { noise_mm, registration_mm: 0.0, calibration_mm: f64::NAN, corner_mm: 0.0, touch_mm: 0.0 }
    }

    /// The same where touches hold the plan instead of the cell: `relative_mm` is the error within the scan.
    pub(crate) fn held_by_touch(self, relative_mm: f64, touch_mm: f64) -> Self {
        let scan_mm2 = relative_mm.powi(2) - self.noise_mm.powi(2) - self.corner_mm.powi(2);
        Self { registration_mm: scan_mm2.max(0.0).sqrt(), calibration_mm: 0.0, touch_mm, ..self }
    }
}
