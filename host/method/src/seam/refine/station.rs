//! What one station of a seam measured: where two fitted faces meet in its cross-section (ours).

use super::face::{FaceFit, FitQuality};
use super::frame::{CrossAxes, Frame};
use nalgebra::{Matrix2, Vector2};

/// Newton steps to where two curved faces meet: each doubles the digits, and flat faces need one.
const STEPS: usize = 3;
/// Shorter normals have no direction.
const LEAST_NORMAL: f64 = 1e-9;

/// What one station measured.
pub(super) struct MeasuredStation {
    /// Correction across the seam, in the axes of the cross-section, mm.
    pub(super) across: Vector2<f64>,
    /// Face normals in the cross-section.
    pub(super) normals: [Vector2<f64>; 2],
    /// How well each face was fitted.
    pub(super) quality: [FitQuality; 2],
    /// Points of each face next to the seam and level with the station.
    pub(super) present: [usize; 2],
    /// Share of each view in the points of each face.
    pub(super) view_share: [Vec<f32>; 2],
}

/// Where two faces meet in the cross-section, and their normals there.
pub(super) struct Meeting {
    pub(super) across: Vector2<f64>,
    pub(super) normals: [Vector2<f64>; 2],
}

impl Meeting {
    /// Of two fits, which are heights off the faces of a frame.
    pub(super) fn of(frame: &Frame, fits: &[FaceFit; 2]) -> Option<Self> {
        let axes: CrossAxes = frame.cross_section();
        let into = frame.faces_inward().map(|v| axes.flat(&v));
        let off = frame.faces.map(|v| axes.flat(&v));
        let mut x = Vector2::zeros();
        let mut rows = [Vector2::zeros(); 2];
        for _ in 0..STEPS {
            let mut miss = Vector2::zeros();
            for k in 0..2 {
                let u = x.dot(&into[k]);
                let f = &fits[k];
                miss[k] = x.dot(&off[k]) - (f.offset + f.slope * u + f.bend * u * u);
                rows[k] = off[k] - into[k] * (f.slope + 2.0 * f.bend * u);
            }
            x -= Matrix2::from_rows(&[rows[0].transpose(), rows[1].transpose()]).try_inverse()? * miss;
        }
        let normals = [rows[0].try_normalize(LEAST_NORMAL)?, rows[1].try_normalize(LEAST_NORMAL)?];
        Some(Self { across: x, normals })
    }
}
