//! Robust surface fits beside a seam: height off a face as a low polynomial (ours).

use crate::seam::refine::beside::Beside;
use nalgebra::{Matrix3, Matrix4, Vector4};
use wide::f64x2;

/// A fitted face at one station: `h = offset + slope u + bend u² + ...` with the terms along the seam taken out.
#[derive(Debug, Clone, Copy, Default)]
pub struct Fit {
    /// Height of the face at the seam, mm.
    pub offset: f64,
    /// Change of height per mm away from the seam.
    pub slope: f64,
    /// Coefficient of `u²`, 1/mm.
    pub bend: f64,
    /// Robust standard deviation of the points, mm.
    pub sigma: f64,
    /// Sum of the weights.
    pub weight: f64,
    /// Nearest and farthest support along the seam relative to the station, mm.
    pub support: (f64, f64),
    /// Variance of `offset` for unit `sigma`, were the points independent.
    pub offset_variance: f64,
    /// Variance of `slope` for unit `sigma`, were the points independent.
    pub slope_variance: f64,
}

/// A point of a fit: distance along the seam from the station, distance from the seam, height, prior weight.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
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
const LEAST_SIGMA_MM: f64 = 0.005;

/// Four terms of a fit at a sample, in pairs.
#[derive(Clone, Copy)]
struct Row([f64x2; 2]);

impl Row {
    fn new(terms: [f64; 4]) -> Self {
        let [a, b, c, d] = terms;
        Self([f64x2::new([a, b]), f64x2::new([c, d])])
    }

    fn dot(&self, x: &Row) -> f64 {
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
    fn add(&mut self, row: &Row, weight: f64, height: f64) {
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
        samples: &[Sample],
        row: impl Fn(&Sample) -> Row,
        height: impl Fn(&Sample) -> f64,
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
            let solved = Row::new(x.into());
            for (s, miss) in samples.iter().zip(&mut *misses) {
                *miss = (height(s) - row(s).dot(&solved)).abs();
            }
            sorted.clear();
            sorted.extend(misses.iter().map(|miss| miss.to_bits()));
            let sigma =
                (1.4826 * f64::from_bits(crate::geometry::statistics::median(sorted))).max(LEAST_SIGMA_MM);
            limit = 4.0 * sigma;
            solution = Some(Solution { x, inverse, weight, sigma });
        }
        solution
    }
}

/// Weighted bisquare fit of `h - bend u²` over `1, u, d` and, where the window is full, `d²`.
pub fn fit(samples: &[Sample], bend: f64, half_mm: f64, scratch: &mut Scratch) -> Option<Fit> {
    let least = 25;
    if samples.len() < least {
        return None;
    }
    let (low, high) = samples.iter().fold((f64::MAX, f64::MIN), |(l, h), s| (l.min(s.d), h.max(s.d)));
    let quadratic = high - low > 1.2 * half_mm;
    let height = |s: &Sample| s.h - bend * s.u * s.u;
    let row = |s: &Sample| Row::new([1.0, s.u, s.d, if quadratic { s.d * s.d } else { 0.0 }]);
    let Solution { x, inverse, weight, sigma } = scratch.solve(samples, row, height, quadratic, 5)?;
    (weight > 0.2 * least as f64).then_some(Fit {
        offset: x[0],
        slope: x[1],
        bend,
        sigma,
        weight,
        support: (low, high),
        offset_variance: inverse[(0, 0)],
        slope_variance: inverse[(1, 1)],
    })
}

fn bisquare(miss: f64) -> f64 {
    let rest = 1.0 - miss * miss;
    if rest > 0.0 { rest * rest } else { 0.0 }
}

/// Coefficient of `u²` of one station, by a robust fit over `1, u, d, u²`.
pub fn bend(samples: &[Sample], scratch: &mut Scratch) -> Option<f64> {
    if samples.len() < 60 {
        return None;
    }
    let row = |s: &Sample| Row::new([1.0, s.u, s.d, s.u * s.u]);
    scratch.solve(samples, row, |s| s.h, true, 3).map(|solution| solution.x[3])
}

/// Scales of [`reach`], mm.
#[derive(Debug, Clone, Copy)]
pub struct Reach {
    /// Points nearer to the seam are left out.
    pub from_mm: f32,
    /// Part next to the seam that is taken for the face without question.
    pub inner_mm: f32,
    /// Farthest that is ever used.
    pub most_mm: f32,
}

/// How far a face extends from the seam before it bends away or ends, mm.
///
/// A robust parabola over the inner part is continued outward; the face ends at the first strip whose median departs
/// from it, or in which points are missing. A lip inside the window would cost half a millimetre.
pub fn reach(points: &[Beside], scale: &Reach) -> f32 {
    let inner: Vec<Sample> = points
        .iter()
        .filter(|p| p.u > scale.from_mm && p.u < scale.inner_mm)
        .map(|p| Sample { d: 0.0, u: f64::from(p.u), h: f64::from(p.h), w: 1.0 })
        .collect();
    if inner.len() < 100 {
        return scale.inner_mm.min(scale.most_mm);
    }
    let Some((curve, sigma)) = parabola(&inner) else { return scale.inner_mm };
    let strip = 0.077 * scale.inner_mm;
    let strips = (scale.most_mm / strip) as usize + 1;
    let mut heights: Vec<Vec<f32>> = vec![Vec::new(); strips];
    for p in points.iter().filter(|p| p.u > 0.0) {
        if let Some(strip) = heights.get_mut((p.u / strip) as usize) {
            strip.push(p.h);
        }
    }
    let first = (scale.from_mm / strip) as usize + 1;
    let last_inner = (scale.inner_mm / strip) as usize;
    let mut counts: Vec<f32> =
        heights[first..last_inner.min(strips)].iter().map(|h| h.len() as f32).collect();
    let usual = crate::geometry::statistics::median(&mut counts);
    let gate = (0.6 * sigma).max(0.015);
    for (k, strip_heights) in heights.iter_mut().enumerate().skip(last_inner - 2) {
        let begin = k as f32 * strip;
        if (strip_heights.len() as f32) < 0.35 * usual {
            return (begin - strip).max(0.6 * scale.inner_mm);
        }
        let middle = f64::from(begin + 0.5 * strip);
        let expected = curve[0] + curve[1] * middle + curve[2] * middle * middle;
        let drift = 0.02 * (middle - f64::from(scale.inner_mm)).max(0.0);
        if (f64::from(crate::geometry::statistics::median(strip_heights)) - expected).abs() > gate + drift {
            return (begin - 2.5 * strip).max(0.6 * scale.inner_mm);
        }
    }
    scale.most_mm
}

/// Robust `1, u, u²` with the curvature dropped where it is not significant; and the noise.
fn parabola(samples: &[Sample]) -> Option<([f64; 3], f64)> {
    let solve = |curved: bool| {
        let row = |s: &Sample| nalgebra::Vector3::new(1.0, s.u, if curved { s.u * s.u } else { 0.0 });
        let (mut x, mut limit, mut inverse, mut sigma) =
            (nalgebra::Vector3::zeros(), f64::INFINITY, Matrix3::zeros(), 0.0);
        for round in 0..4 {
            let (mut a, mut b) = (Matrix3::zeros(), nalgebra::Vector3::zeros());
            for s in samples {
                let r = row(s);
                let w = if round == 0 { 1.0 } else { bisquare((s.h - r.dot(&x)) / limit) };
                a.ger(w, &r, &r, 1.0);
                b.axpy(w * s.h, &r, 1.0);
            }
            if !curved {
                a[(2, 2)] = 1.0;
            }
            inverse = a.try_inverse()?;
            x = inverse * b;
            let mut misses: Vec<f64> = samples.iter().map(|s| (s.h - row(s).dot(&x)).abs()).collect();
            sigma = (1.4826 * crate::geometry::statistics::median(&mut misses)).max(LEAST_SIGMA_MM);
            limit = 4.0 * sigma;
        }
        Some((x, (inverse[(2, 2)] * 8.0).sqrt() * sigma, sigma))
    };
    let (x, deviation, sigma) = solve(true)?;
    if x[2].abs() >= 6.0 * deviation {
        return Some(([x[0], x[1], x[2]], sigma));
    }
    let (x, _, sigma) = solve(false)?;
    Some(([x[0], x[1], 0.0], sigma))
}
