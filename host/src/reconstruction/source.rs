//! One view's patches, thinned to those that are matched.

use crate::grid::Grid;
use crate::normals::{Patches, median};
use nalgebra::Vector3;

/// Patches are matched only where the surface is flat to this many noise deviations.
const MAX_BEND: f32 = 2.0;

/// One view's patches, ready to be matched.
pub(super) struct Source {
    pub(super) grid: Grid,
    /// Normal per slot of the grid.
    pub(super) normals: Vec<Vector3<f32>>,
    /// Variance of a patch's height, mm², per slot.
    pub(super) variance_mm2: Vec<f32>,
    /// Variance of a normal's tilt, rad², per slot.
    pub(super) tilt_variance: Vec<f32>,
    /// Slots that are matched, and the weight that makes up for the ones left out.
    pub(super) sample: Vec<(u32, f32)>,
}

impl Source {
    pub(super) fn new(patches: &Patches, sample: usize) -> Self {
        let mut variance = patches.variance_mm2.clone();
        let noise = median(&mut variance).max(1e-6);
        let flat: Vec<usize> = (0..patches.cloud.len())
            .filter(|&k| patches.variance_mm2[k] < MAX_BEND * MAX_BEND * noise)
            .collect();
        let points: Vec<_> = flat.iter().map(|&k| patches.cloud.points_mm[k]).collect();
        let grid = Grid::new(&points, 2.0 * patches.cell_mm);
        let at = |slot: usize| flat[grid.index(slot)];
        let normals: Vec<_> = (0..grid.len()).map(|s| patches.cloud.normals[at(s)]).collect();
        let variance_mm2 = (0..grid.len())
            .map(|s| 5.5 * patches.variance_mm2[at(s)].max(0.25 * noise) / patches.count[at(s)])
            .collect();
        let tilt_variance = (0..grid.len()).map(|s| patches.tilt_variance[at(s)]).collect();
        let sample = spread_over_normals(&normals, sample);
        Self { grid, normals, variance_mm2, tilt_variance, sample }
    }
}

/// A sample in which rare directions are kept whole and common ones thinned, each with the weight that makes up for it.
pub(crate) fn spread_over_normals(normals: &[Vector3<f32>], sample: usize) -> Vec<(u32, f32)> {
    let bin = |n: &Vector3<f32>| {
        let c = |v: f32| ((v * 3.0).round() as i32 + 3) as usize;
        (c(n.x) * 7 + c(n.y)) * 7 + c(n.z)
    };
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); 343];
    for (slot, n) in normals.iter().enumerate() {
        members[bin(n)].push(slot as u32);
    }
    members.retain(|m| !m.is_empty());
    // Fill the smallest bins first; what they leave over is shared by the larger.
    members.sort_by_key(Vec::len);
    let (mut left, mut out) = (sample, Vec::with_capacity(sample));
    for (k, m) in members.iter().enumerate() {
        let share = (left / (members.len() - k)).min(m.len());
        left -= share;
        let step = m.len() as f64 / share.max(1) as f64;
        out.extend((0..share).map(|s| (m[(s as f64 * step) as usize], step.sqrt() as f32)));
    }
    out
}
