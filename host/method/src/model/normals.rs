//! Normals per view, facing the camera that saw them (paper II-D, eq. (9)).
//!
//! Points are gathered in cells of a few spacings; each cell's plane is fitted to it and its 26 neighbours.
//! Departure from the paper: one normal per cell, not per raw point, because a third of a millimetre of noise at half
//! a millimetre of spacing leaves a raw point's normal meaningless.

pub(crate) mod cells;
pub mod pointwise;

use crate::geometry::cloud::{PointCloud, View};
use crate::geometry::grid::Grid;
use crate::geometry::grid::rows::bounds;
use crate::geometry::plane::Scatter;
use crate::geometry::statistics::{lower_quartile, median};
use cells::{Cells, Sums};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// How cells are made and which are trusted.
#[derive(Debug, Clone, Copy)]
pub struct NormalsConfig {
    /// Edge of a cell in mean spacings.
    pub cell_spacings: f32,
    /// Smallest cell, mm.
    pub min_cell_mm: f32,
    /// Cells with fewer points are dropped: mostly flying pixels.
    pub min_points: u32,
    /// Fits with fewer points are dropped.
    pub min_fit_points: u32,
    /// A larger window is taken while the variance about the plane grows by no more than this factor.
    pub max_growth: f32,
    /// Cells are doubled, at most thrice, until this share of the points has a fit. A lidar's points are far denser along its
    /// rings than across them, so that cells of a few spacings hold little but pieces of line.
    pub min_fitted: f32,
    /// Surfaces seen at a more grazing angle are dropped: jitter along the surface shows as depth there.
    pub min_incidence_cos: f32,
}

/// The camera's noise is correlated between neighbouring pixels: this many count as one (measured on the simulated scans).
pub(crate) const CORRELATED_POINTS: f32 = 5.5;

impl Default for NormalsConfig {
    fn default() -> Self {
        Self {
            cell_spacings: 3.0,
            min_cell_mm: 1.0,
            min_points: 2,
            min_fit_points: 9,
            max_growth: 1.4,
            min_fitted: 0.6,
            min_incidence_cos: 0.2,
        }
    }
}

/// A view reduced to one flat patch per cell, in the view's own frame.
#[derive(Debug, Clone, Default)]
pub struct Patches {
    /// CellPatch centres and unit normals facing the camera.
    pub cloud: PointCloud,
    /// Variance of the points about the patch's plane, mm²: noise, and bend where the surface is not flat.
    pub variance_mm2: Vec<f32>,
    /// Variance of the normal's tilt about each tangent, rad².
    pub tilt_variance: Vec<f32>,
    /// Points in the patch's own cell.
    pub count: Vec<f32>,
    /// Edge of a cell, mm.
    pub cell_mm: f32,
    /// Mean spacing of the view's points, mm.
    pub spacing_mm: f32,
    /// Standard deviation of the points about the patches, mm: lower quartile.
    pub noise_mm: f32,
}

/// The points of one cell, reduced to a patch.
struct CellPatch {
    position: Point3<f32>,
    normal: Vector3<f32>,
    variance_mm2: f32,
    tilt_variance: f32,
    count: f32,
}

impl CellPatch {
    /// None where the surface is seen at too grazing an angle.
    fn facing_camera(fit: &Scatter, position: Point3<f32>, count: f32, min_cos: f32) -> Option<Self> {
        let normal = fit.normal();
        let along = normal.dot(&position.coords);
        let grazing = (along / position.coords.norm()).abs() < min_cos;
        (!grazing).then(|| Self {
            position,
            normal: if along > 0.0 { -normal } else { normal },
            variance_mm2: fit.variance_mm2,
            tilt_variance: CORRELATED_POINTS * fit.variance_mm2 / (fit.points * fit.middle_mm2),
            count,
        })
    }
}

impl Patches {
    /// Column by column.
    fn of(found: Vec<CellPatch>) -> Self {
        let column = |of: fn(&CellPatch) -> f32| found.par_iter().map(of).collect();
        Self {
            cloud: PointCloud {
                points_mm: found.par_iter().map(|p| p.position).collect(),
                normals: found.par_iter().map(|p| p.normal).collect(),
                ..PointCloud::default()
            },
            variance_mm2: column(|p| p.variance_mm2),
            tilt_variance: column(|p| p.tilt_variance),
            count: column(|p| p.count),
            ..Self::default()
        }
    }
}

/// Patches of every view.
pub fn of_views(views: &[View], config: &NormalsConfig) -> Vec<Patches> {
    views.par_iter().map(|view| estimate(view, config)).collect()
}

/// Patches of one view.
pub fn estimate(view: &View, config: &NormalsConfig) -> Patches {
    let spacing_mm = mean_spacing_mm(&view.points_mm);
    let mut cell_mm = (config.cell_spacings * spacing_mm).max(config.min_cell_mm);
    let most_mm = COARSEST * cell_mm;
    loop {
        let (patches, fitted) = in_cells(view, spacing_mm, cell_mm, config);
        if fitted as f32 >= config.min_fitted * view.points_mm.len() as f32 || cell_mm >= most_mm {
            return patches;
        }
        cell_mm *= 2.0;
    }
}

/// Cells grow to so many times their first edge where too few points are near enough to others.
const COARSEST: f32 = 8.0;

/// Least variance across the points of a fit, in squared cells: a window full of points has 0.75, a piece of line its noise.
const MIN_BREADTH: f32 = 0.1;

/// Patches in cells of the given edge, and how many points have enough neighbours on all sides for a fit.
fn in_cells(view: &View, spacing_mm: f32, cell_mm: f32, config: &NormalsConfig) -> (Patches, f64) {
    let cells = Cells::new(&view.points_mm, cell_mm);
    let cell_mm = cells.cell_mm();
    // Windows of 3 and 5 cells; one of 9 where it may be taken. The larger ones are tapered.
    let near = cells.widen(&cells.sums());
    let wide = cells.widen(&near);
    let pairs: Vec<_> = near.par_chunks(2).map(|two| Sums::scatter([&two[0], &two[two.len() - 1]])).collect();
    let narrow = &pairs.as_flattened()[..cells.len()];
    let mut sizes: Vec<f32> = narrow.par_iter().map(|p| p.variance_mm2).collect();
    let noise_mm2 = median(&mut sizes);
    // Noise grows with distance: the work is nearer than most of what is in view.
    let quiet_mm2 = lower_quartile(&mut sizes);
    let enough = |k: usize| {
        cells.moments[k].count >= config.min_points as f32 && narrow[k].points >= config.min_fit_points as f32
    };
    let broad = |&k: &usize| enough(k) && narrow[k].middle_mm2 > MIN_BREADTH * cell_mm.powi(2);
    // Whole numbers, whose sum does not depend on their order.
    let fitted: f64 =
        (0..cells.len()).into_par_iter().filter(broad).map(|k| f64::from(cells.moments[k].count)).sum();
    let patches_of = |two: &[usize]| {
        let two = [two[0], two[two.len() - 1]];
        let mut best = two.map(|k| narrow[k]);
        let mut grows = [true; 2];
        for (widest, overlap) in [(false, 27.0 / 4.0), (true, 27.0 * 27.0 / 16.0)] {
            let window = |i: usize| match (grows[i], widest) {
                (false, _) => Sums::default(),
                (true, false) => wide[two[i]],
                (true, true) => cells.window(two[i], &wide, 2),
            };
            let candidates = Sums::scatter([&window(0), &window(1)]);
            for (i, candidate) in candidates.into_iter().enumerate() {
                grows[i] &= candidate.variance_mm2 <= config.max_growth * best[i].variance_mm2.max(noise_mm2);
                if grows[i] {
                    best[i] = candidate;
                    best[i].points /= overlap;
                }
            }
            if grows == [false; 2] {
                break;
            }
        }
        // The cell's own mean, not its foot on a larger plane: that would move curved surfaces inward.
        [0, 1].map(|i| {
            let (at, count) = (cells.centroid(two[i]), cells.moments[two[i]].count);
            CellPatch::facing_camera(&best[i], at, count, config.min_incidence_cos)
        })
    };
    let trusted: Vec<usize> = (0..cells.len()).into_par_iter().filter(|&k| enough(k)).collect();
    let found = trusted
        .par_chunks(2)
        .flat_map_iter(|two| patches_of(two).into_iter().take(two.len()).flatten())
        .collect();
    let patches = Patches { cell_mm, spacing_mm, noise_mm: quiet_mm2.sqrt(), ..Patches::of(found) };
    (patches, fitted)
}

/// Mean distance from a point to its nearest distinct neighbour, mm, from an even sample of the cloud; the paper's
/// "average distance".
pub fn mean_spacing_mm(points: &[Point3<f32>]) -> f32 {
    const SAMPLE: usize = 2000;
    if points.len() < 2 {
        return 1.0;
    }
    let (low, high) = bounds(points);
    let extent = Vector3::from(high) - Vector3::from(low);
    // Were the points spread over the largest face of their box, this would be the spacing.
    let face = (extent.x * extent.y).max(extent.y * extent.z).max(extent.x * extent.z);
    let guess = (face / points.len() as f32).sqrt().max(extent.max() / points.len() as f32).max(1e-6);
    let grid = Grid::new(points, 2.0 * guess);
    let step = points.len().div_ceil(SAMPLE);
    let mut distances: Vec<f32> = (0..grid.len())
        .into_par_iter()
        .step_by(step)
        .filter_map(|slot| {
            let q = grid.point(slot);
            let distinct = |other: usize| (grid.point(other) - q).norm_squared() > 1e-8 * guess * guess;
            grid.nearest(&q, 20.0 * guess, distinct).map(|(_, d2)| d2.sqrt())
        })
        .collect();
    if distances.is_empty() {
        return guess;
    }
    // Far outliers would pull the mean.
    distances.sort_by(f32::total_cmp);
    distances.truncate((distances.len() * 19).div_ceil(20));
    distances.iter().sum::<f32>() / distances.len() as f32
}
