//! One view's patches, thinned to those that are matched.

use crate::geometry::grid::Grid;
use crate::geometry::statistics::median;
use crate::model::normals::{CORRELATED_POINTS, Patches};
use nalgebra::{Point3, Vector3};

/// Patches are matched only where the surface is flat to this many noise deviations.
const MAX_BEND: f32 = 2.0;

/// One view's patches, ready to be matched.
pub(super) struct SourceView {
    pub(super) grid: Grid,
    /// Per slot of the grid.
    pub(super) surfaces: Vec<PatchSurface>,
    /// Those that are matched.
    pub(super) sample: Vec<MatchedPatch>,
}

/// What a pair needs to know of a patch beside its place: read together, at random places.
#[derive(Debug, Clone, Copy)]
pub(super) struct PatchSurface {
    pub(super) normal: Vector3<f32>,
    /// Variance of the patch's height, mm².
    pub(super) variance_mm2: f32,
    /// Variance of the normal's tilt, rad².
    pub(super) tilt_variance: f32,
}

/// A patch that is matched, and the weight that makes up for the ones left out.
#[derive(Debug, Clone, Copy)]
pub(super) struct MatchedPatch {
    pub(super) point: Point3<f32>,
    pub(super) normal: Vector3<f32>,
    pub(super) variance_mm2: f32,
    pub(super) weight: f32,
}

impl SourceView {
    pub(super) fn new(patches: &Patches, sample: usize) -> Self {
        let mut variance = patches.variance_mm2.clone();
        let noise = median(&mut variance).max(1e-6);
        let flat: Vec<usize> = (0..patches.cloud.len())
            .filter(|&k| patches.variance_mm2[k] < MAX_BEND * MAX_BEND * noise)
            .collect();
        let points: Vec<_> = flat.iter().map(|&k| patches.cloud.points_mm[k]).collect();
        let grid = Grid::new(&points, 2.0 * patches.cell_mm);
        let surface = |slot: usize| {
            let k = flat[grid.index(slot)];
            PatchSurface {
                normal: patches.cloud.normals[k],
                variance_mm2: CORRELATED_POINTS * patches.variance_mm2[k].max(0.25 * noise)
                    / patches.count[k],
                tilt_variance: patches.tilt_variance[k],
            }
        };
        let surfaces: Vec<PatchSurface> = (0..grid.len()).map(surface).collect();
        let normals = surfaces.iter().map(|surface| surface.normal);
        let sample = spread_over_normals(normals, sample).into_iter().map(|(slot, weight)| {
            let PatchSurface { normal, variance_mm2, .. } = surfaces[slot as usize];
            MatchedPatch { point: grid.point(slot as usize), normal, variance_mm2, weight }
        });
        let sample = sample.collect();
        Self { grid, surfaces, sample }
    }
}

/// A sample in which rare directions are kept whole and common ones thinned, each with the weight that makes up for it.
pub fn spread_over_normals(
    normals: impl IntoIterator<Item = Vector3<f32>>,
    sample: usize,
) -> Vec<(u32, f32)> {
    let bin = |n: &Vector3<f32>| {
        let c = |v: f32| ((v * 3.0).round() as i32 + 3) as usize;
        (c(n.x) * 7 + c(n.y)) * 7 + c(n.z)
    };
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); 343];
    for (slot, normal) in normals.into_iter().enumerate() {
        members[bin(&normal)].push(slot as u32);
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
