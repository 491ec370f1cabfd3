//! Voxel grid (paper II-D, text after eq. (10)): even density after the views are merged.
//!
//! Exact centroids. Voxels with few points are dropped, which removes flying pixels and outliers.

use crate::cloud::{Merged, PointCloud};
use crate::normals::cells::Cells;
use crate::normals::{Patches, median};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// How the voxel grid is laid: the larger of two lengths.
#[derive(Debug, Clone, Copy)]
pub struct Config {
    /// Edge of a voxel in mean spacings of a view; the paper's "multiple of the average distance".
    pub spacings: f32,
    /// Edge of a voxel that resolves the plate edges and bevels of arc welding, mm, if that is more.
    pub feature_mm: f32,
    /// The same on small work, as a share of its extent.
    pub share_of_extent: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { spacings: 1.3, feature_mm: 1.2, share_of_extent: 1.0 / 120.0 }
    }
}

/// Sizes that follow from the data.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Edge of a voxel, mm.
    pub edge_mm: f32,
    /// Points that a voxel must hold.
    pub least: u32,
    /// Mean spacing of a view's points, mm.
    pub spacing_mm: f32,
    /// Noise of the points, mm.
    pub noise_mm: f32,
    /// Which of the lengths decided `edge_mm`.
    pub how: &'static str,
}

impl Scale {
    /// Derives the sizes from the views' patches and the extent of the cloud.
    pub fn of(merged: &Merged, patches: &[Patches], config: &Config) -> Self {
        let middle = |f: fn(&Patches) -> f32| median(&mut patches.iter().map(f).collect::<Vec<_>>());
        let (spacing_mm, noise_mm) = (middle(|p| p.spacing_mm), middle(|p| p.noise_mm));
        let small_mm = config.share_of_extent * extent_mm(merged);
        let sizes = [
            (config.spacings * spacing_mm, "1.3 x mean spacing"),
            if small_mm < config.feature_mm {
                (small_mm, "extent / 120")
            } else {
                (config.feature_mm, "what resolves plate edges and bevels")
            },
        ];
        let (edge_mm, how) = sizes.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((1.0, "fixed"));
        let edge_mm = edge_mm.max(1e-3);
        // A voxel of a surface that one view saw holds about this many points.
        let usual = (edge_mm / spacing_mm.max(1e-6)).powi(2) * (merged.cameras_mm.len() as f32).sqrt();
        let least = if usual > 4.5 {
            3
        } else if usual > 3.0 {
            2
        } else {
            1
        };
        Self { edge_mm, least, spacing_mm, noise_mm, how }
    }

    /// The same cloud in voxels `factor` times as large.
    pub fn coarser(&self, factor: f32) -> Self {
        Self { edge_mm: self.edge_mm * factor, ..*self }
    }

    /// Widths of the bilateral filter for these voxels.
    pub fn bilateral(&self) -> crate::denoising::Config {
        crate::denoising::Config {
            radius_mm: 3.0 * self.edge_mm,
            distance_mm: 1.5 * self.edge_mm,
            height_mm: (1.7 * self.noise_mm).max(0.05 * self.edge_mm),
        }
    }
}

/// Diagonal of the box that holds the middle four fifths of the points on each axis, mm: free of outliers.
fn extent_mm(merged: &Merged) -> f32 {
    let step = (merged.points_mm.len() / 20_000).max(1);
    let span = |axis: usize| {
        let mut v: Vec<f32> = merged.points_mm.iter().step_by(step).map(|p| p[axis]).collect();
        v.sort_unstable_by(f32::total_cmp);
        let cut = v.len() / 10;
        v.get(v.len().saturating_sub(1 + cut)).unwrap_or(&0.0) - v.get(cut).unwrap_or(&0.0)
    };
    Vector3::new(span(0), span(1), span(2)).norm()
}

/// A thinned cloud.
#[derive(Debug, Clone, Default)]
pub struct Voxels {
    /// One point per voxel, with the normal of its surroundings.
    pub cloud: PointCloud,
    /// Points in each voxel.
    pub count: Vec<f32>,
    /// Direction from each point to the cameras that saw it.
    pub toward_camera: Vec<Vector3<f32>>,
    /// Edge of a voxel, mm.
    pub edge_mm: f32,
}

/// Centroids of the occupied voxels of finite `points`, in the order of the voxels along x, then y, then z: where
/// [`voxel_grid`] puts its points.
///
/// Voxels have an edge of `edge_mm`, or more where their table would outgrow the points.
pub fn centroids(points: &[Point3<f32>], edge_mm: f32) -> Vec<Point3<f32>> {
    Cells::new(points, edge_mm).centroids()
}

/// Thins a cloud to one point per voxel of `edge_mm` that holds at least `least` points.
pub fn voxel_grid(merged: &Merged, edge_mm: f32, least: u32) -> Voxels {
    let cells = Cells::new(&merged.points_mm, edge_mm);
    let sums = cells.sums();
    let places = cells.centroids();
    let toward = toward_cameras(merged, &cells, &places);
    let given = given_normals(merged, &cells);
    let kept: Vec<usize> = (0..cells.len()).filter(|&k| cells.moments[k].count >= least as f32).collect();
    let normal = |&k: &usize| match given.get(k) {
        Some(&given) => given,
        None => facing(cells.window(k, &sums, 1).scatter().normal(), &toward[k]),
    };
    let of_kept = |all: &[Vector3<f32>]| kept.iter().map(|&k| all[k]).collect();
    Voxels {
        cloud: PointCloud {
            origin_mm: merged.origin_mm,
            points_mm: kept.iter().map(|&k| places[k]).collect(),
            normals: kept.par_iter().map(normal).collect(),
        },
        count: kept.iter().map(|&k| cells.moments[k].count).collect(),
        toward_camera: of_kept(&toward),
        edge_mm: cells.cell_mm(),
    }
}

fn facing(normal: Vector3<f32>, toward: &Vector3<f32>) -> Vector3<f32> {
    if normal.dot(toward) < 0.0 { -normal } else { normal }
}

fn direction(sum: &Vector3<f32>) -> Vector3<f32> {
    sum.try_normalize(1e-6).unwrap_or_else(Vector3::z)
}

/// Mean of the given normals of each voxel's points; empty if none are given.
fn given_normals(merged: &Merged, cells: &Cells) -> Vec<Vector3<f32>> {
    if merged.normals.is_empty() {
        return Vec::new();
    }
    let mut sums = vec![Vector3::zeros(); cells.len()];
    cells.of_point.iter().zip(&merged.normals).for_each(|(&k, normal)| sums[k as usize] += normal);
    sums.iter().map(direction).collect()
}

/// Mean direction from each voxel to the cameras of its points.
///
/// Points come view by view, so a voxel's are counted until one of another view comes: a direction a view, not a point.
fn toward_cameras(merged: &Merged, cells: &Cells, places: &[Point3<f32>]) -> Vec<Vector3<f32>> {
    let toward = |k: usize, view: u16, count: f32| {
        (merged.cameras_mm[usize::from(view)] - places[k]).normalize() * count
    };
    // Sum of directions, and the latest view and its points.
    let mut seen = vec![(Vector3::zeros(), 0u16, 0f32); cells.len()];
    let share = cells.len().div_ceil(rayon::current_num_threads()).max(1);
    // A thread takes a range of voxels and passes over all points.
    seen.par_chunks_mut(share).enumerate().for_each(|(range, own)| {
        let first = range * share;
        for (&k, &view) in cells.of_point.iter().zip(&merged.view) {
            let k = k as usize;
            let Some((sum, of, count)) = own.get_mut(k.wrapping_sub(first)) else { continue };
            if *of == view {
                *count += 1.0;
            } else {
                if *count > 0.0 {
                    *sum += toward(k, *of, *count);
                }
                (*of, *count) = (view, 1.0);
            }
        }
    });
    let last = |(k, (sum, view, count)): (usize, (Vector3<f32>, u16, f32))| {
        direction(&(sum + toward(k, view, count)))
    };
    seen.into_par_iter().enumerate().map(last).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_centroid_is_the_mean_of_its_voxel_and_no_other() {
        // Voxels are laid from the lowest corner, which is the first point.
        let near = |x: f32, y: f32| [[0.0, 0.0], [0.5, 0.25], [0.25, 0.5]].map(|[u, v]| [x + u, y + v, 7.0]);
        let voxels = [near(0.0, 0.0), near(2.0, 0.0), near(1.0, 3.0)];
        let points: Vec<Point3<f32>> = voxels.into_iter().rev().flatten().map(Point3::from).collect();
        let expected = [[0.25, 0.25, 7.0], [2.25, 0.25, 7.0], [1.25, 3.25, 7.0]].map(Point3::from);
        let found = centroids(&points, 1.0);
        assert_eq!(found.len(), 3);
        assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).norm() < 1e-6), "{found:?}");
        assert!(centroids(&[], 1.0).is_empty());
    }
}
