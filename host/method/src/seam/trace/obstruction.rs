//! What stands in the air of a corner (ours): a seam does not go on through a plate that crosses it.

use crate::geometry::grid::Grid;
use nalgebra::{Point3, Vector3};

// All chosen on the simulated scans.

/// Where the air of a corner is looked at: this far from the line along the bisector, voxels.
const HEIGHT_VOXELS: f32 = 6.0;
/// Farthest from there that a point stands in the way, voxels, and as a share of the distance to the faces.
const REACH_VOXELS: f32 = 2.2;
const REACH_SHARE: f32 = 0.6;
/// Share of a wall's points across that reach, one a voxel, which makes a wall; less is noise.
const WALL_SHARE: f32 = 0.2;
/// Fewer points are no wall, however small the reach.
const LEAST_POINTS: f32 = 3.0;
/// Shorter sums of the two normals have no direction: the faces look at each other.
const LEAST_BISECTOR: f32 = 1e-3;

/// Whether points of the model stand in the air between the faces anywhere from one place of a seam to the next.
pub fn blocked(
    model: &Grid,
    voxel_mm: f32,
    from: &Point3<f32>,
    to: &Point3<f32>,
    faces: &[Vector3<f32>; 2],
) -> bool {
    let Some(bisector) = (faces[0] + faces[1]).try_normalize(LEAST_BISECTOR) else { return false };
    let height = HEIGHT_VOXELS * voxel_mm;
    let clear = height * bisector.dot(&faces[0]).min(bisector.dot(&faces[1]));
    let reach = (REACH_VOXELS * voxel_mm).min(REACH_SHARE * clear);
    let least = WALL_SHARE * std::f32::consts::PI * (reach / voxel_mm).powi(2);
    let way = to - from;
    let steps = (way.norm() / voxel_mm).ceil().max(1.0) as usize;
    (0..=steps).any(|k| {
        let at = from + way * (k as f32 / steps as f32) + bisector * height;
        let mut count = 0.0;
        model.within(&at, reach, |_, _| count += 1.0);
        count >= least.max(LEAST_POINTS)
    })
}
