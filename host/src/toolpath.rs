//! From an ordered seam to torch poses (paper II-F), and from those to a complete program.
//!
//! [`resampling`] and [`standoff`] are path modifiers, `SeamPath -> SeamPath`; [`program`] adds what a robot needs
//! around the seams: approach, air moves, retract, feeds, weld flags.

pub mod air;
pub mod program;
pub mod resampling;
pub mod standoff;
pub mod torch;

use nalgebra::{Point3, UnitQuaternion, Vector3};

/// One pose of the torch on its seam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Distance along the seam, mm.
    pub s_mm: f64,
    /// Tip of the wire, mm, base frame.
    pub position_mm: Point3<f64>,
    /// Columns `(o, m, n)`: `n` out of the work, `m` along the travel, `o = m × n`.
    pub base_from_torch: UnitQuaternion<f64>,
}

impl PathPoint {
    /// `n`, the torch axis out of the work, base frame.
    pub fn out_of_work(&self) -> Vector3<f64> {
        self.base_from_torch * Vector3::z()
    }
}

/// The torch path of one seam, as long as the seam; a closed path ends where it began.
#[derive(Debug, Clone)]
pub struct SeamPath {
    /// [`crate::seam::Seam::id`].
    pub seam: usize,
    /// In weld order.
    pub points: Vec<PathPoint>,
}

impl SeamPath {
    /// Length of the polyline, mm.
    pub fn length_mm(&self) -> f64 {
        self.points.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm()).sum()
    }
}
