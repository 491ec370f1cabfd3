//! Torch poses along a seam (paper II-F).

pub mod interpolation;
pub mod torch;

use heapless::Vec;

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

/// A path of at most `N` poses, in the order of the weld.
#[derive(Debug, Clone, Default)]
pub struct PathBuffer<const N: usize> {
    poses: Vec<TorchPose, N>,
}

impl<const N: usize> PathBuffer<N> {
    /// An empty path.
    pub const fn new() -> Self {
        Self { poses: Vec::new() }
    }

    /// Appends a pose, or hands it back when the buffer is full.
    pub fn push(&mut self, pose: TorchPose) -> Result<(), TorchPose> {
        self.poses.push(pose)
    }

    /// The poses so far.
    pub fn as_slice(&self) -> &[TorchPose] {
        &self.poses
    }

    /// How many more fit.
    pub fn free(&self) -> usize {
        N.saturating_sub(self.poses.len())
    }

    /// Forgets every pose.
    pub fn clear(&mut self) {
        self.poses.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_buffer_hands_the_pose_back() {
        let pose = TorchPose { position_mm: Point::new(1.0, 2.0, 3.0), orientation: Orientation::identity() };
        let mut path = PathBuffer::<2>::new();
        assert_eq!((path.push(pose), path.push(pose), path.free()), (Ok(()), Ok(()), 0));
        assert_eq!(path.push(pose), Err(pose));
        assert_eq!(path.as_slice().len(), 2);
        path.clear();
        assert_eq!(path.free(), 2);
    }
}
