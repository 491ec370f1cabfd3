//! Voxel grid (paper II-D, text after eq. (10)): even density after the views are merged.
//!
//! Exact centroids. Voxels with few points are dropped, which removes flying pixels and outliers.

use crate::cloud::{Merged, PointCloud};
use crate::grid::Grid;
use crate::normals::{Cells, Patches, median};
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

/// Thins a cloud to one point per voxel of `edge_mm` that holds at least `least` points.
pub fn voxel_grid(merged: &Merged, edge_mm: f32, least: u32) -> Voxels {
    let grid = Grid::new(&merged.points_mm, edge_mm);
    let cells = Cells::new(&grid);
    let near = cells.widen(&grid, &cells.sums(&grid), 1);
    let kept: Vec<usize> = (0..cells.len()).filter(|&k| cells.moments[k].count >= least as f32).collect();
    let slots: Vec<_> = grid.occupied().collect();
    let points: Vec<(Point3<f32>, Vector3<f32>, Vector3<f32>)> = kept
        .par_iter()
        .map(|&k| {
            let (cell, run) = &slots[k];
            let own = &cells.moments[k];
            let place = grid.centre(*cell) + own.sum / own.count;
            let toward = toward_camera(merged, &grid, run.clone(), &place);
            let normal = if merged.normals.is_empty() {
                facing(near[k].plane().normal, &toward)
            } else {
                mean_direction(run.clone().map(|s| merged.normals[grid.index(s)]))
            };
            (place, normal, toward)
        })
        .collect();
    let mut voxels = Voxels { edge_mm: grid.cell_mm(), ..Voxels::default() };
    voxels.cloud.origin_mm = merged.origin_mm;
    for (&k, (place, normal, toward)) in kept.iter().zip(points) {
        voxels.cloud.points_mm.push(place);
        voxels.cloud.normals.push(normal);
        voxels.toward_camera.push(toward);
        voxels.count.push(cells.moments[k].count);
    }
    voxels
}

fn facing(normal: Vector3<f32>, toward: &Vector3<f32>) -> Vector3<f32> {
    if normal.dot(toward) < 0.0 { -normal } else { normal }
}

fn mean_direction(directions: impl Iterator<Item = Vector3<f32>>) -> Vector3<f32> {
    directions.sum::<Vector3<f32>>().try_normalize(1e-6).unwrap_or_else(Vector3::z)
}

/// Mean direction from a voxel to the cameras of its points.
fn toward_camera(
    merged: &Merged,
    grid: &Grid,
    run: std::ops::Range<usize>,
    place: &Point3<f32>,
) -> Vector3<f32> {
    mean_direction(run.map(|slot| {
        let camera = merged.cameras_mm[usize::from(merged.view[grid.index(slot)])];
        (camera - place).normalize()
    }))
}
