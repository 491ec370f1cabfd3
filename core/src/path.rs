//! Torch poses along a seam (paper II-F).

pub mod interpolation;
pub mod torch;

use crate::{Orientation, Point};

/// Where the torch tip is and how it points.
///
/// The columns of the rotation are `(o, m, n)`: `n` out of the work along the torch axis, `m` along the travel,
/// `o = m × n`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorchPose {
    /// Tip of the wire, mm, base frame.
    pub position_mm: Point,
    /// `base_from_torch`.
    pub orientation: Orientation,
}
