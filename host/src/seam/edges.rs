//! Edge scores of a whole cloud (paper II-E), by core's kernels over a spatial index.
//!
//! Beyond the paper: the gate on the intensity itself, derived from the cloud, without which the scale-free ratio takes
//! flat noise for edges; and the sign of the asymmetry, which tells an inside corner from an outside one.

use crate::cloud::PointCloud;
use crate::downsampling::Voxels;
use crate::grid::Grid;
use nalgebra::Vector3;
use rayon::prelude::*;
use weldpath_core::seam::intensity::asymmetry;

/// Capacity of a neighbourhood: a ball of four voxels about a corner of three faces holds no more.
const CAPACITY: usize = 192;

/// Bounds of the gate: flat surfaces stay below the first, the points of any corner of less than 130 degrees exceed the second.
const FLAT: f32 = 0.10;
const CORNER: f32 = 0.13;

/// Scores of the points of a cloud, in its order.
#[derive(Debug, Clone, Default)]
pub struct Scores {
    /// Eq. (12).
    pub intensity: Vec<f32>,
    /// Part of the asymmetry along the normal: positive at an inside corner.
    pub concavity: Vec<f32>,
    /// Intensity above which a point may be an edge.
    pub gate: f32,
}

/// Scores every point of the denoised `model` within balls of `radius_mm`; `grid` indexes the model's points.
pub fn score(voxels: &Voxels, model: &PointCloud, grid: &Grid, radius_mm: f32) -> Scores {
    debug_assert_eq!(voxels.cloud.len(), model.len());
    let both: Vec<(f32, f32)> = (0..grid.len())
        .into_par_iter()
        .map(|slot| {
            let at = grid.point(slot);
            let mut offsets = heapless::Vec::<Vector3<f32>, CAPACITY>::new();
            grid.within(&at, radius_mm, |other, _| {
                if other != slot {
                    let _ = offsets.push(grid.point(other) - at);
                }
            });
            let shift = asymmetry(&offsets, radius_mm);
            let k = grid.index(slot);
            (shift.norm(), shift.dot(&voxels.toward_camera[k]))
        })
        .collect();
    let mut scores = Scores { intensity: vec![0.0; grid.len()], concavity: vec![0.0; grid.len()], gate: 0.0 };
    for (slot, (i, c)) in both.into_iter().enumerate() {
        scores.intensity[grid.index(slot)] = i;
        scores.concavity[grid.index(slot)] = c;
    }
    let median = crate::normals::median(&mut scores.intensity.clone());
    scores.gate = (1.8 * median).clamp(FLAT, CORNER);
    scores
}
