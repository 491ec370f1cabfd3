//! Normals per view, facing the camera that saw them (paper II-D, eq. (9)).
//!
//! Points are gathered in cells of a few spacings; each cell's plane is fitted to it and its 26 neighbours.
//! Departure from the paper: one normal per cell, not per raw point, because a third of a millimetre of noise at half
//! a millimetre of spacing leaves a raw point's normal meaningless.

pub mod pointwise;

use crate::cloud::{PointCloud, View};
use crate::grid::{Cell, Grid};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// How cells are made and which are trusted.
#[derive(Debug, Clone, Copy)]
pub struct Config {
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
    /// Surfaces seen at a more grazing angle are dropped: jitter along the surface shows as depth there.
    pub min_incidence_cos: f32,
}

/// The camera's noise is correlated between neighbouring pixels: this many count as one (measured on the simulated scans).
pub(crate) const CORRELATED_POINTS: f32 = 5.5;

impl Default for Config {
    fn default() -> Self {
        Self {
            cell_spacings: 3.0,
            min_cell_mm: 1.0,
            min_points: 2,
            min_fit_points: 9,
            max_growth: 1.4,
            min_incidence_cos: 0.2,
        }
    }
}

/// A view reduced to one flat patch per cell, in the view's own frame.
#[derive(Debug, Clone, Default)]
pub struct Patches {
    /// Patch centres and unit normals facing the camera.
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

/// Patches of every view.
pub fn of_views(views: &[View], config: &Config) -> Vec<Patches> {
    views.par_iter().map(|view| estimate(view, config)).collect()
}

/// Patches of one view, eq. (9).
pub fn estimate(view: &View, config: &Config) -> Patches {
    let spacing_mm = mean_spacing_mm(&view.points_mm);
    let cell_mm = (config.cell_spacings * spacing_mm).max(config.min_cell_mm);
    let grid = Grid::new(&view.points_mm, cell_mm);
    let cells = Cells::new(&grid);
    // Windows of 3, 5 and 9 cells, the larger ones tapered.
    let near = cells.widen(&grid, 1);
    let wide = near.widen(&grid, 1);
    let far = wide.widen(&grid, 2);
    let narrow: Vec<Plane> = near.moments.par_iter().map(Moments::plane).collect();
    let mut sizes: Vec<f32> = narrow.iter().map(|p| p.variance_mm2).collect();
    let noise_mm2 = median(&mut sizes);
    // Noise grows with distance: the work is nearer than most of what is in view.
    let quarter = sizes.len() / 4;
    let quiet_mm2 =
        if sizes.is_empty() { 0.0 } else { *sizes.select_nth_unstable_by(quarter, f32::total_cmp).1 };
    let mut patches =
        Patches { cell_mm: grid.cell_mm(), spacing_mm, noise_mm: quiet_mm2.sqrt(), ..Patches::default() };
    for (k, own) in cells.moments.iter().enumerate() {
        let window = &near.moments[k];
        if own.count < config.min_points as f32 || window.count < config.min_fit_points as f32 {
            continue;
        }
        let mut plane = narrow[k];
        for (larger, overlap) in [(&wide.moments[k], 27.0 / 4.0), (&far.moments[k], 27.0 * 27.0 / 16.0)] {
            let candidate = larger.plane();
            if candidate.variance_mm2 > config.max_growth * plane.variance_mm2.max(noise_mm2) {
                break;
            }
            plane = Plane { points: candidate.points / overlap, ..candidate };
        }
        let mean = own.sum / own.count;
        // The cell's own mean, not its foot on a larger plane: that would move curved surfaces inward.
        let position = grid.centre(cells.cells[k]) + mean;
        let incidence_cos = (plane.normal.dot(&position.coords) / position.coords.norm()).abs();
        if incidence_cos < config.min_incidence_cos {
            continue;
        }
        let facing = if plane.normal.dot(&position.coords) > 0.0 { -plane.normal } else { plane.normal };
        patches.cloud.points_mm.push(position);
        patches.cloud.normals.push(facing);
        patches.variance_mm2.push(plane.variance_mm2);
        patches
            .tilt_variance
            .push(CORRELATED_POINTS * plane.variance_mm2 / (plane.points * plane.middle_mm2));
        patches.count.push(own.count);
    }
    patches
}

/// Mean distance from a point to its nearest distinct neighbour, mm, from an even sample of the cloud; the paper's "average distance".
pub fn mean_spacing_mm(points: &[Point3<f32>]) -> f32 {
    const SAMPLE: usize = 2000;
    if points.len() < 2 {
        return 1.0;
    }
    let (low, high) =
        points.iter().fold((Vector3::repeat(f32::MAX), Vector3::repeat(f32::MIN)), |(l, h), p| {
            (l.inf(&p.coords), h.sup(&p.coords))
        });
    let extent = high - low;
    // Were the points spread over the largest face of their box, this would be the spacing.
    let face = (extent.x * extent.y).max(extent.y * extent.z).max(extent.x * extent.z);
    let guess = (face / points.len() as f32).sqrt().max(extent.max() / points.len() as f32).max(1e-6);
    let grid = Grid::new(points, 2.0 * guess);
    let step = points.len().div_ceil(SAMPLE);
    let mut distances: Vec<f32> = (0..grid.len())
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

/// The middle value; 0 for none. Reorders its argument.
pub(crate) fn median<T: PartialOrd + Copy + Default>(values: &mut [T]) -> T {
    if values.is_empty() {
        return T::default();
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, |a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal)).1
}

/// Count, sum and second moments of points relative to a centre.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moments {
    pub(crate) count: f32,
    pub(crate) sum: Vector3<f32>,
    /// xx xy xz yy yz zz
    pub(crate) second: [f32; 6],
}

/// A fitted plane relative to the moments' centre.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub(crate) mean: Vector3<f32>,
    pub(crate) normal: Vector3<f32>,
    /// Variance about the plane.
    pub(crate) variance_mm2: f32,
    /// Variance along the narrower direction in the plane.
    pub(crate) middle_mm2: f32,
    pub(crate) points: f32,
}

impl Moments {
    pub(crate) fn add(&mut self, d: Vector3<f32>) {
        self.count += 1.0;
        self.sum += d;
        let s = &mut self.second;
        s[0] += d.x * d.x;
        s[1] += d.x * d.y;
        s[2] += d.x * d.z;
        s[3] += d.y * d.y;
        s[4] += d.y * d.z;
        s[5] += d.z * d.z;
    }

    /// Adds moments that were taken about a centre `shift` away from ours.
    fn absorb(&mut self, other: &Self, shift: Vector3<f32>) {
        let (n, m, t) = (other.count, other.sum, shift);
        self.count += n;
        self.sum += m + t * n;
        let o = &other.second;
        let s = &mut self.second;
        s[0] += o[0] + 2.0 * t.x * m.x + n * t.x * t.x;
        s[1] += o[1] + t.x * m.y + t.y * m.x + n * t.x * t.y;
        s[2] += o[2] + t.x * m.z + t.z * m.x + n * t.x * t.z;
        s[3] += o[3] + 2.0 * t.y * m.y + n * t.y * t.y;
        s[4] += o[4] + t.y * m.z + t.z * m.y + n * t.y * t.z;
        s[5] += o[5] + 2.0 * t.z * m.z + n * t.z * t.z;
    }

    pub(crate) fn plane(&self) -> Plane {
        let n = self.count.max(1.0);
        let mean = self.sum / n;
        let c = |k: usize, a: usize, b: usize| f64::from(self.second[k] / n - mean[a] * mean[b]);
        let eigen = smallest_eigen([c(0, 0, 0), c(1, 0, 1), c(2, 0, 2), c(3, 1, 1), c(4, 1, 2), c(5, 2, 2)]);
        Plane {
            mean,
            normal: eigen.vector.cast(),
            variance_mm2: eigen.least.max(1e-9) as f32,
            middle_mm2: eigen.middle.max(1e-6) as f32,
            points: n,
        }
    }
}

/// Moments of the occupied cells of a grid, each about its cell's centre.
pub(crate) struct Cells {
    pub(crate) cells: Vec<Cell>,
    pub(crate) moments: Vec<Moments>,
    /// Position in `moments` plus one, per entry of the grid; 0 where empty.
    at: Vec<u32>,
}

impl Cells {
    pub(crate) fn new(grid: &Grid) -> Self {
        let mut cells = Self { cells: Vec::new(), moments: Vec::new(), at: vec![0; grid.entries()] };
        for (cell, slots) in grid.occupied() {
            let centre = grid.centre(cell);
            let mut moments = Moments::default();
            for slot in slots {
                moments.add(grid.point(slot) - centre);
            }
            cells.cells.push(cell);
            cells.moments.push(moments);
            cells.at[cell.entry] = cells.moments.len() as u32;
        }
        cells
    }

    /// Adds to each cell the moments of its 26 neighbours `stride` cells away.
    pub(crate) fn len(&self) -> usize {
        self.moments.len()
    }

    pub(crate) fn widen(&self, grid: &Grid, stride: usize) -> Self {
        let moments = self.cells.par_iter().map(|&cell| self.window(cell, grid, stride)).collect();
        Self { cells: self.cells.clone(), moments, at: self.at.clone() }
    }

    fn window(&self, cell: Cell, grid: &Grid, stride: usize) -> Moments {
        let limit = grid.cells();
        let steps = |k: usize| {
            let low = cell.at[k].checked_sub(stride);
            let high = Some(cell.at[k] + stride).filter(|&at| at < limit[k]);
            [low, Some(cell.at[k]), high].into_iter().flatten()
        };
        let mut window = Moments::default();
        for z in steps(2) {
            for y in steps(1) {
                for x in steps(0) {
                    let found = grid.entry([x, y, z]).map_or(0, |entry| self.at[entry]);
                    if found > 0 {
                        let step =
                            [0, 1, 2].map(|k| ([x, y, z][k] as f32 - cell.at[k] as f32) * grid.cell_mm());
                        window.absorb(&self.moments[found as usize - 1], step.into());
                    }
                }
            }
        }
        window
    }
}

/// The least and middle eigenvalue of a symmetric matrix, and the unit eigenvector of the least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eigen {
    /// Unit eigenvector of `least`.
    pub vector: Vector3<f64>,
    /// Smallest eigenvalue.
    pub least: f64,
    /// Middle eigenvalue.
    pub middle: f64,
}

/// Eigen-decomposition of a symmetric matrix (xx xy xz yy yz zz) as far as a plane fit needs it.
///
/// Closed form (Smith 1961): eigenvalues as trigonometric roots of the characteristic polynomial, the vector as the
/// longest cross product of two rows of the matrix less its eigenvalue.
pub fn smallest_eigen([a, b, c, d, e, f]: [f64; 6]) -> Eigen {
    const THIRD_TURN: f64 = std::f64::consts::TAU / 3.0;
    let mean = (a + d + f) / 3.0;
    let off = b * b + c * c + e * e;
    let spread = ((a - mean).powi(2) + (d - mean).powi(2) + (f - mean).powi(2) + 2.0 * off) / 6.0;
    let scale = spread.sqrt();
    if scale <= 1e-12 * mean.abs() || scale == 0.0 {
        return Eigen { vector: Vector3::z(), least: mean, middle: mean };
    }
    let (p, q, r) = ((a - mean) / scale, (d - mean) / scale, (f - mean) / scale);
    let (s, t, u) = (b / scale, c / scale, e / scale);
    let half_det = 0.5 * (p * (q * r - u * u) - s * (s * r - u * t) + t * (s * u - q * t));
    let angle = half_det.clamp(-1.0, 1.0).acos() / 3.0;
    let least = mean + 2.0 * scale * (angle + THIRD_TURN).cos();
    let middle = mean + 2.0 * scale * (angle - THIRD_TURN).cos();
    let rows = [Vector3::new(a - least, b, c), Vector3::new(b, d - least, e), Vector3::new(c, e, f - least)];
    let crosses = [rows[0].cross(&rows[1]), rows[0].cross(&rows[2]), rows[1].cross(&rows[2])];
    let longest = crosses.into_iter().max_by(|x, y| x.norm_squared().total_cmp(&y.norm_squared()));
    let vector = longest.and_then(|v| v.try_normalize(0.0)).unwrap_or_else(Vector3::z);
    Eigen { vector, least, middle }
}
