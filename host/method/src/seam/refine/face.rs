//! Robust surface fits beside a seam: height off a face as a low polynomial (ours).

use crate::geometry::statistics::{DEVIATION_OF_MEDIAN, median};
use nalgebra::{Matrix4, Vector4};
use wide::f64x2;

/// A fitted face at one station: `h = offset + slope u + bend u² + ...` with the terms along the seam taken out.
#[derive(Debug, Clone, Copy)]
pub struct FaceFit {
    /// Height of the face at the seam, mm.
    pub offset: f64,
    /// Change of height per mm away from the seam.
    pub slope: f64,
    /// Coefficient of `u²`, 1/mm.
    pub bend: f64,
    /// How well the points fit.
    pub quality: FitQuality,
}

/// How well points fit, and where they are.
#[derive(Debug, Clone, Copy)]
pub struct FitQuality {
    /// Robust standard deviation of the points, mm.
    pub sigma: f64,
    /// Nearest and farthest support along the seam relative to the station, mm.
    pub support: (f64, f64),
    /// Variance of the slope for unit `sigma`, were the points independent, 1/mm²; 0 of a slope that was not fitted.
    pub slope_variance: f64,
}

/// A point of a fit: distance along the seam from the station, distance from the seam, height, prior weight.
#[derive(Debug, Clone, Copy)]
pub struct FacePoint {
    /// Along the seam from the station, mm.
    pub d: f64,
    /// From the seam along the face, mm.
    pub u: f64,
    /// Off the face, mm.
    pub h: f64,
    /// Prior weight.
    pub w: f64,
}

/// Least noise that is assumed, mm: keeps exact data from making every point an outlier.
pub(super) const LEAST_SIGMA_MM: f64 = 0.005;
/// Standard deviations from which a point no longer counts in a fit: Tukey's bisquare is efficient to 95 % at 4.685; a
/// little less bears more outliers. Chosen on the simulated scans.
pub(super) const OUTLIER_DEVIATIONS: f64 = 4.0;
/// Rounds of weighing and fitting of a face, and of its curvature.
const FIT_ROUNDS: usize = 5;
const BEND_ROUNDS: usize = 3;
/// Fewer points make no fit, nor less than this share of their number in weight; fewer show no curvature.
const LEAST_POINTS: usize = 25;
const LEAST_WEIGHT_SHARE: f64 = 0.2;
const LEAST_BEND_POINTS: usize = 60;
/// Half lengths of a window that the points must span for a term in `d²`.
const FULL_HALVES: f64 = 1.2;

/// Four terms of a fit at a sample, in pairs.
#[derive(Clone, Copy)]
struct Terms([f64x2; 2]);

impl Terms {
    fn new(terms: [f64; 4]) -> Self {
        let [a, b, c, d] = terms;
        Self([f64x2::new([a, b]), f64x2::new([c, d])])
    }

    fn dot(&self, x: &Terms) -> f64 {
        let [even, odd] = (self.0[0] * x.0[0] + self.0[1] * x.0[1]).to_array();
        even + odd
    }
}

/// Weighted normal equations of four terms; the matrix column by column.
#[derive(Default)]
struct Equations {
    columns: [[f64x2; 2]; 4],
    pull: [f64x2; 2],
}

impl Equations {
    fn add(&mut self, row: &Terms, weight: f64, height: f64) {
        let [[a, b], [c, d]] = row.0.map(f64x2::to_array);
        let put = |to: &mut [f64x2; 2], factor: f64| (0..2).for_each(|k| to[k] += row.0[k] * factor);
        self.columns.iter_mut().zip([a, b, c, d]).for_each(|(column, term)| put(column, weight * term));
        put(&mut self.pull, weight * height);
    }

    fn matrix(&self) -> Matrix4<f64> {
        Matrix4::from_fn(|row, column| self.columns[column][row / 2].to_array()[row % 2])
    }

    fn pull(&self) -> Vector4<f64> {
        Vector4::from_fn(|row, _| self.pull[row / 2].to_array()[row % 2])
    }
}

/// What a fit works in, kept from one to the next.
#[derive(Debug, Default)]
pub struct Scratch {
    misses: Vec<f64>,
    /// Their bits, which are ordered as numbers are that are 0 or more.
    sorted: Vec<u64>,
}

/// A robust solution of four terms: their coefficients, the inverse of the last equations, their weight, and the noise.
struct Solution {
    x: Vector4<f64>,
    inverse: Matrix4<f64>,
    weight: f64,
    sigma: f64,
}

impl Scratch {
    /// Weighted bisquare fit of `height` over the terms of `row`; where the fourth is always 0, it is not `curved`.
    fn solve(
        &mut self,
        samples: &[FacePoint],
        row: impl Fn(&FacePoint) -> Terms,
        height: impl Fn(&FacePoint) -> f64,
        curved: bool,
        rounds: usize,
    ) -> Option<Solution> {
        let Self { misses, sorted } = self;
        misses.clear();
        misses.resize(samples.len(), 0.0);
        let (mut limit, mut solution) = (f64::INFINITY, None);
        for _ in 0..rounds {
            let (mut equations, mut weight) = (Equations::default(), 0.0);
            for (s, miss) in samples.iter().zip(&*misses) {
                let w = s.w * bisquare(miss / limit);
                if w > 0.0 {
                    equations.add(&row(s), w, height(s));
                    weight += w;
                }
            }
            let mut matrix = equations.matrix();
            if !curved {
                matrix[(3, 3)] = 1.0;
            }
            let inverse = matrix.try_inverse()?;
            let x = inverse * equations.pull();
            let solved = Terms::new(x.into());
            for (s, miss) in samples.iter().zip(&mut *misses) {
                *miss = (height(s) - row(s).dot(&solved)).abs();
            }
            sorted.clear();
            sorted.extend(misses.iter().map(|miss| miss.to_bits()));
            let sigma = (DEVIATION_OF_MEDIAN * f64::from_bits(median(sorted))).max(LEAST_SIGMA_MM);
            limit = OUTLIER_DEVIATIONS * sigma;
            solution = Some(Solution { x, inverse, weight, sigma });
        }
        solution
    }
}

/// Weighted bisquare fit of `h - bend u²` over `1, u, d` and, where the window is full, `d²`.
pub fn fit(samples: &[FacePoint], bend: f64, half_mm: f64, scratch: &mut Scratch) -> Option<FaceFit> {
    if samples.len() < LEAST_POINTS {
        return None;
    }
    let (low, high) = samples.iter().fold((f64::MAX, f64::MIN), |(l, h), s| (l.min(s.d), h.max(s.d)));
    let quadratic = high - low > FULL_HALVES * half_mm;
    let height = |s: &FacePoint| s.h - bend * s.u * s.u;
    let row = |s: &FacePoint| Terms::new([1.0, s.u, s.d, if quadratic { s.d * s.d } else { 0.0 }]);
    let Solution { x, inverse, weight, sigma } =
        scratch.solve(samples, row, height, quadratic, FIT_ROUNDS)?;
    let quality = FitQuality { sigma, support: (low, high), slope_variance: inverse[(1, 1)] };
    let fit = FaceFit { offset: x[0], slope: x[1], bend, quality };
    (weight > LEAST_WEIGHT_SHARE * LEAST_POINTS as f64).then_some(fit)
}

/// Tukey's weight of a miss, in the distance from which on it is 0.
pub(super) fn bisquare(miss: f64) -> f64 {
    let rest = 1.0 - miss * miss;
    if rest > 0.0 { rest * rest } else { 0.0 }
}

/// Coefficient of `u²` of one station, by a robust fit over `1, u, d, u²`.
pub fn bend(samples: &[FacePoint], scratch: &mut Scratch) -> Option<f64> {
    if samples.len() < LEAST_BEND_POINTS {
        return None;
    }
    let row = |s: &FacePoint| Terms::new([1.0, s.u, s.d, s.u * s.u]);
    scratch.solve(samples, row, |s| s.h, true, BEND_ROUNDS).map(|solution| solution.x[3])
}
