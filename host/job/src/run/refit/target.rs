//! The new cloud, asked for what lies near, and how well patches lie on it.

use nalgebra::{Isometry3, Point3, Vector3};

use super::part::Patch;
use super::{FOUND_MM, MIN_NORMAL_DOT};
use weldpath_method::geometry::cloud::PointCloud;
use weldpath_method::geometry::grid::Grid;
use weldpath_method::geometry::statistics::rms;

/// Farther off a surface than this a patch does not fit it at all, mm.
const END_MM: f64 = 3.0;

/// The new cloud, ready to be asked for what is near.
pub(super) struct Target {
    origin: Point3<f64>,
    grid: Grid,
    normals: Vec<Vector3<f32>>,
}

impl Target {
    /// Thinned to one point per cell of `cell_mm`; 0 keeps all.
    pub(super) fn new(cloud: &PointCloud, cell_mm: f32) -> Self {
        let kept: Vec<usize> = match cell_mm > 0.0 {
            true => {
                let cells = Grid::new(&cloud.points_mm, cell_mm);
                cells.occupied().map(|(_, run)| cells.index(run.start)).collect()
            }
            false => (0..cloud.len()).collect(),
        };
        let points: Vec<_> = kept.iter().map(|&k| cloud.points_mm[k]).collect();
        let grid = Grid::new(&points, cell_mm.max(2.5));
        let normals = (0..grid.len()).map(|slot| cloud.normals[kept[grid.index(slot)]]).collect();
        Self { origin: cloud.origin_mm, grid, normals }
    }

    /// Nearest point with about this normal, and its own normal.
    pub(super) fn nearest(&self, p: &Point3<f64>, n: &Vector3<f64>, gate_mm: f32) -> Option<Patch> {
        let local = Point3::from((p - self.origin).cast::<f32>());
        let facing: Vector3<f32> = n.cast();
        let same_side = |slot: usize| self.normals[slot].dot(&facing) > MIN_NORMAL_DOT;
        let (slot, _) = self.grid.nearest(&local, gate_mm, same_side)?;
        Some((self.origin + self.grid.point(slot).coords.cast::<f64>(), self.normals[slot].cast()))
    }
}

/// Share of the part that lies within `within_mm` of the target.
pub(super) fn share(part: &[Patch], target: &Target, pose: &Isometry3<f64>, within_mm: f32) -> f64 {
    let near = |(p, n): &&Patch| {
        let place = pose * p;
        let reach_mm = (2.0 * within_mm).max(target.grid.cell_mm());
        let hit = target.nearest(&place, &(pose.rotation * n), reach_mm);
        hit.is_some_and(|(q, normal)| normal.dot(&(place - q)).abs() < f64::from(within_mm))
    };
    part.iter().filter(near).count() as f64 / part.len().max(1) as f64
}

/// How well the patches lie on the target: 1 all, 0 none within [`END_MM`].
pub(super) fn fit(patches: &[Patch], target: &Target, pose: &Isometry3<f64>) -> f64 {
    let one = |(p, n): &Patch| {
        let place = pose * p;
        let hit = target.nearest(&place, &(pose.rotation * n), 2.0 * END_MM as f32);
        hit.map_or(0.0, |(q, normal)| (1.0 - (normal.dot(&(place - q)) / END_MM).powi(2)).max(0.0))
    };
    patches.iter().map(one).sum::<f64>() / patches.len().max(1) as f64
}

pub(super) fn rms_mm(part: &[Patch], target: &Target, pose: &Isometry3<f64>) -> f64 {
    let residual = |(p, n): &Patch| {
        let place = pose * p;
        let (q, normal) = target.nearest(&place, &(pose.rotation * n), FOUND_MM)?;
        Some(normal.dot(&(place - q)))
    };
    let residuals: Vec<f64> = part.iter().filter_map(residual).collect();
    rms(&residuals).unwrap_or(0.0)
}
