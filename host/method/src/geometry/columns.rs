//! Vectors as columns of their coordinates, which are worked on eight at a time.

use crate::geometry::grid::lanes::{LANES, eight};
use nalgebra::Vector3;
use std::ops::Index;
use wide::f32x8;

/// Vectors as columns of their coordinates; the last one is repeated up to whole eights.
pub(crate) struct Columns {
    axes: [Vec<f32>; 3],
    len: usize,
}

impl Columns {
    pub(crate) fn new<T: Index<usize, Output = f32>>(vectors: &[T]) -> Self {
        let len = vectors.len();
        let repeated = len.next_multiple_of(LANES) - len;
        let filled = || vectors.iter().chain(vectors.last().into_iter().cycle().take(repeated));
        Self { axes: [0, 1, 2].map(|axis| filled().map(|v| v[axis]).collect()), len }
    }

    /// Where each eight of them begins.
    pub(crate) fn eights(&self) -> impl Iterator<Item = usize> + use<> {
        (0..self.len).step_by(LANES)
    }

    /// Which of eight of them from `first` on are there, a bit for each: the others repeat the last one.
    pub(crate) fn present(&self, first: usize) -> u32 {
        (1 << (self.len - first).min(LANES)) - 1
    }

    /// The component along `way` of eight of them, from `first` on.
    #[inline(always)]
    pub(crate) fn along(&self, first: usize, way: &Vector3<f32>) -> f32x8 {
        let [x, y, z] = &self.axes;
        eight(x, first) * way.x + eight(y, first) * way.y + eight(z, first) * way.z
    }

    /// The components along `way` of about so many of them, evenly taken.
    pub(crate) fn some_along(&self, count: usize, way: &Vector3<f32>) -> Vec<f32> {
        let along = |i: usize| self.axes.iter().zip(way.iter()).map(|(axis, way)| axis[i] * way).sum();
        (0..self.len).step_by((self.len / count).max(1)).map(along).collect()
    }
}
