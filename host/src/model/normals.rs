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
use cells::{Cells, Sums};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use wide::f64x2;

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
    /// Cells are doubled, at most thrice, until this share of the points has a fit. A lidar's points are far denser along its
    /// rings than across them, so that cells of a few spacings hold little but pieces of line.
    pub min_fitted: f32,
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
            min_fitted: 0.6,
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

/// The points of one cell, reduced to a patch.
struct Patch {
    position: Point3<f32>,
    normal: Vector3<f32>,
    variance_mm2: f32,
    tilt_variance: f32,
    count: f32,
}

impl Patch {
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
    fn of(found: Vec<Patch>) -> Self {
        let column = |of: fn(&Patch) -> f32| found.par_iter().map(of).collect();
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
pub fn of_views(views: &[View], config: &Config) -> Vec<Patches> {
    views.par_iter().map(|view| estimate(view, config)).collect()
}

/// Patches of one view, eq. (9).
pub fn estimate(view: &View, config: &Config) -> Patches {
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
fn in_cells(view: &View, spacing_mm: f32, cell_mm: f32, config: &Config) -> (Patches, f64) {
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
    let quarter = sizes.len() / 4;
    let quiet_mm2 =
        if sizes.is_empty() { 0.0 } else { *sizes.select_nth_unstable_by(quarter, f32::total_cmp).1 };
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
                    best[i] = Scatter { points: candidate.points / overlap, ..candidate };
                }
            }
            if grows == [false; 2] {
                break;
            }
        }
        // The cell's own mean, not its foot on a larger plane: that would move curved surfaces inward.
        [0, 1].map(|i| {
            let (at, count) = (cells.centroid(two[i]), cells.moments[two[i]].count);
            Patch::facing_camera(&best[i], at, count, config.min_incidence_cos)
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

/// A fitted plane relative to the centre of its moments.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plane {
    pub(crate) mean: Vector3<f32>,
    pub(crate) normal: Vector3<f32>,
    /// Variance about the plane.
    pub(crate) variance_mm2: f32,
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

    pub(crate) fn plane(&self) -> Plane {
        let n = self.count.max(1.0);
        let mean = self.sum / n;
        let c = |k: usize, a: usize, b: usize| f64::from(self.second[k] / n - mean[a] * mean[b]);
        Plane::new(mean, [c(0, 0, 0), c(1, 0, 1), c(2, 0, 2), c(3, 1, 1), c(4, 1, 2), c(5, 2, 2)], n)
    }
}

impl Plane {
    /// From the scatter (xx xy xz yy yz zz) of so many points about their mean.
    fn new(mean: Vector3<f32>, scatter: [f64; 6], points: f32) -> Self {
        let fit = Scatter::new(scatter, points);
        Self { mean, normal: fit.normal(), variance_mm2: fit.variance_mm2 }
    }
}

/// How points scatter about their mean; the normal, which few need, is found when it is asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scatter {
    /// xx xy xz yy yz zz
    matrix: [f64; 6],
    least: f64,
    /// Variance about the fitted plane.
    pub(crate) variance_mm2: f32,
    /// Variance along the narrower direction in the plane.
    pub(crate) middle_mm2: f32,
    pub(crate) points: f32,
}

impl Scatter {
    pub(crate) fn new(matrix: [f64; 6], points: f32) -> Self {
        let [fit, _] = Self::of_two([matrix; 2], [points; 2]);
        fit
    }

    /// Of two matrices, for little more than the price of one.
    pub(crate) fn of_two(matrices: [[f64; 6]; 2], points: [f32; 2]) -> [Self; 2] {
        let [left, right] = matrices;
        let [least, middle] = lesser_eigenvalues(std::array::from_fn(|k| f64x2::new([left[k], right[k]])));
        let (least, middle) = (least.to_array(), middle.to_array());
        [0, 1].map(|k| Self {
            matrix: matrices[k],
            least: least[k],
            variance_mm2: least[k].max(1e-9) as f32,
            middle_mm2: middle[k].max(1e-6) as f32,
            points: points[k],
        })
    }

    /// Unit normal of the fitted plane.
    pub(crate) fn normal(&self) -> Vector3<f32> {
        eigenvector(&self.matrix, self.least).cast()
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
pub fn smallest_eigen(matrix: [f64; 6]) -> Eigen {
    let [least, middle] = lesser_eigenvalues(matrix.map(f64x2::splat)).map(|of| of.to_array()[0]);
    Eigen { vector: eigenvector(&matrix, least), least, middle }
}

/// The least and the middle eigenvalue of each of two matrices.
///
/// The characteristic polynomial of the matrix less its mean, scaled, is `x³ - 3x - det` (Smith 1961); its other two roots
/// solve a quadratic.
fn lesser_eigenvalues([a, b, c, d, e, f]: [f64x2; 6]) -> [f64x2; 2] {
    let [two, three, zero] = [2.0, 3.0, 0.0].map(f64x2::splat);
    let mean = (a + d + f) / three;
    let (p, q, r) = (a - mean, d - mean, f - mean);
    let spread = (p * p + q * q + r * r + two * (b * b + c * c + e * e)) / 6.0;
    let scale = spread.sqrt();
    let per = 1.0 / scale;
    let (p, q, r, s, t, u) = (p * per, q * per, r * per, b * per, c * per, e * per);
    let det = p * (q * r - u * u) - s * (s * r - u * t) + t * (s * u - q * t);
    let root = least_root(det.fast_max(-two).fast_min(two));
    let middle = root + (12.0 - three * root * root).fast_max(zero).sqrt();
    // A multiple of 1 has no direction, and what was scaled by its spread is no number.
    let even = scale.simd_le(1e-12 * mean.abs()) | scale.simd_eq(zero);
    [mean + scale * root, mean - 0.5 * scale * middle].map(|value| even.select(mean, value))
}

/// Unit eigenvector of an eigenvalue: the longest cross product of two rows of the matrix less it; z for a multiple of 1.
fn eigenvector([a, b, c, d, e, f]: &[f64; 6], value: f64) -> Vector3<f64> {
    let rows =
        [Vector3::new(a - value, *b, *c), Vector3::new(*b, d - value, *e), Vector3::new(*c, *e, f - value)];
    let crosses = [rows[0].cross(&rows[1]), rows[0].cross(&rows[2]), rows[1].cross(&rows[2])];
    let longest = crosses.into_iter().max_by(|x, y| x.norm_squared().total_cmp(&y.norm_squared()));
    longest.and_then(|v| v.try_normalize(0.0)).unwrap_or_else(Vector3::z)
}

/// Least root of `x³ - 3x - det`, for `det` between -2 and 2: two steps of Newton's from a start that is right to 1.5e-4.
///
/// With `s² = 2 - det` the root is `-1 - s g(s)`, where `g` is smooth also at the double root, `s = 0`, and a cubic fits it.
/// The error of the start is proportional to `s`, as is the slope, so that the steps converge there, too.
fn least_root(det: f64x2) -> f64x2 {
    let splat = f64x2::splat;
    let s = (2.0 - det).sqrt();
    let g = 0.577_263_773 + s * (-0.054_589_266 + s * (0.010_810_3 - s * 0.001_424_887));
    let slope = |x: f64x2| (3.0 * (x * x - 1.0)).fast_max(splat(f64::MIN_POSITIVE));
    let step = |x: f64x2| x - (x * (x * x - 3.0) - det) / slope(x);
    let start = -1.0 - s * g;
    s.simd_lt(splat(1e-7)).select(start, step(step(start)))
}
