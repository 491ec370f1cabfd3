//! Registration as the paper prints it (II-C): every view from its kinematic pose onto the views before it, by plain least
//! squares of the distances along the normals.
//!
//! Only the paper's way runs this; [`super::register`] solves all views together. What the paper leaves open: the target
//! of a view is the union of those before it, thinned to one point a voxel, and pairs come from gates that grow narrower.

use super::{ReconstructionConfig, Registration, fitness, pair};
use crate::geometry::cloud::{Merged, PointCloud, View};
use crate::geometry::grid::Grid;
use crate::model::downsampling::centroids;
use crate::model::normals::{Patches, pointwise};
use nalgebra::{DMatrix, Isometry3, Point3};
use rayon::prelude::*;

/// Radius of the neighbourhoods of the target's normals, voxels: the paper gives none; 28 points of an even surface.
const NORMAL_VOXELS: f32 = 3.0;
/// Points farther than this from every other, in distances that count as aligned, overlap nothing: as in [`super::icp`].
const OVERLAP: f32 = 4.0;

/// Poses of the views, one after the other; at least one view. What remains uncertain is not known, and said to be none.
pub fn register(views: &[View], patches: &[Patches], config: &ReconstructionConfig) -> Registration {
    let edge_mm = patches.iter().map(|patches| patches.cell_mm).fold(0.0, f32::max);
    let mut poses: Vec<Isometry3<f64>> = Vec::new();
    let (mut shares, mut overlap) = (Vec::new(), Vec::new());
    let mut residual_mm = 0.0;
    for (k, view) in views.iter().enumerate() {
        let guess = view.base_from_camera;
        let target = union(&views[..k], &poses, edge_mm);
        if view.points_mm.is_empty() || target.is_empty() {
            poses.push(guess);
            shares.push(vec![1.0]);
            overlap.push(1.0);
            continue;
        }
        let points_mm = centroids(&view.points_mm, edge_mm);
        let source = PointCloud { points_mm, ..PointCloud::default() };
        let steps = pair::PairConfig { gates_mm: config.gates_mm.clone(), ..pair::PairConfig::default() };
        let found = pair::align(&source, &target, &guess, &steps);
        let near = Near::new(&source, &target, config.fitness_mm);
        let [before, after] = [guess, found.target_from_source].map(|pose| near.nearest_mm2(&pose));
        shares.push([&before, &after].map(|d2| fitness(d2, config.fitness_mm)).to_vec());
        overlap.push(after.len() as f64 / source.len() as f64);
        residual_mm = found.rms_mm;
        poses.push(found.target_from_source);
    }
    let size = 6 * (views.len() - 1);
    Registration {
        centre_mm: Merged::new(views, &poses).origin_mm,
        base_from_camera: poses,
        fitness: shares,
        overlap,
        covariance: DMatrix::zeros(size, size),
        evidence: None,
        base_covariance: None,
        residual_mm,
    }
}

/// The views so far, thinned, with normals.
fn union(views: &[View], poses: &[Isometry3<f64>], edge_mm: f32) -> PointCloud {
    let merged = Merged::new(views, poses);
    let points_mm = centroids(&merged.points_mm, edge_mm);
    let radius_mm = NORMAL_VOXELS * edge_mm;
    let grid = Grid::new(&points_mm, radius_mm);
    let normals = grid.by_point(&pointwise::within(&grid, radius_mm));
    PointCloud { origin_mm: merged.origin_mm, points_mm, normals }
}

/// A source and the target that it is to lie on.
struct Near<'a> {
    source: &'a PointCloud,
    grid: Grid,
    origin_mm: Point3<f64>,
    reach_mm: f32,
}

impl<'a> Near<'a> {
    fn new(source: &'a PointCloud, target: &PointCloud, near_mm: f32) -> Self {
        let reach_mm = OVERLAP * near_mm;
        Self { source, grid: Grid::new(&target.points_mm, reach_mm), origin_mm: target.origin_mm, reach_mm }
    }

    /// Squared distance from each source point that overlaps the target to the nearest point there, mm².
    fn nearest_mm2(&self, pose: &Isometry3<f64>) -> Vec<f32> {
        let at = |p: &Point3<f32>| Point3::from((pose * p.cast::<f64>() - self.origin_mm).cast::<f32>());
        let nearest = |p| self.grid.nearest(&at(p), self.reach_mm, |_| true).map(|(_, d2)| d2);
        self.source.points_mm.par_iter().filter_map(nearest).collect()
    }
}
