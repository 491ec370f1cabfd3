//! From an ordered seam to torch poses (paper II-F), and from those to a complete program.

use nalgebra::{Point3, UnitQuaternion};

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

/// The torch path of one seam, as long as the seam; a closed path ends where it began.
#[derive(Debug, Clone)]
pub struct SeamPath {
    /// [`crate::seam::Seam::id`].
    pub seam: usize,
    /// In weld order.
    pub points: Vec<PathPoint>,
}
