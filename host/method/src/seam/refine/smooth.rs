//! Smoothing curves: penalised least squares on a uniform grid, stiffness by cross-validation (ours).
//!
//! Minimises the weighted squared misfit plus `stiffness` times the integral of the squared second derivative, in
//! discrete form (Whittaker 1923). Neighbouring stations share points, so whole blocks are left out in the validation;
//! leaving out single stations would choose curves that follow the noise.

use crate::geometry::statistics::median;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

// All chosen on the simulated scans.

/// Stiffness candidates, mm³ per unit weight, softest first; the last is a straight line in practice.
const STIFFNESS: [f64; 8] = [1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e9, 1e11];
/// Blocks that are left out in turn.
const FOLDS: usize = 4;
/// A stiffer curve is taken when its validation error is within this factor of the best.
const CLOSE: f64 = 1.06;
/// Squared misses of more than this many medians are outliers: beyond three times the usual miss.
const CAP_MEDIANS: f64 = 9.0;
/// Fewest blocks that a curve is parted into.
const LEAST_BLOCKS: usize = 6;
/// Standard errors by which a straight line, and any other curve, may be worse than the best to be taken.
const STRAIGHT_ERRORS: f64 = 2.0;
const CURVED_ERRORS: f64 = 1.0;
/// Least weight, which keeps stations without points from making the equations singular.
const LEAST_WEIGHT: f64 = 1e-12;

/// Shapes that no penalty shrinks, richest first: harmonics of a loop, as a tube on a flat or round face is a low one, and
/// degrees of an open curve, as a short arc is nearly a parabola.
const HARMONICS: [usize; 4] = [6, 4, 2, 1];
const DEGREES: [usize; 2] = [3, 2];
/// Degree below a spline for the rest: what that is shrunk by no longer pulls the ends of a long arc inward.
const MIXED_DEGREE: usize = 5;
/// Stiffness candidates of that spline, mm³ per unit weight.
const MIXED_STIFFNESS: [f64; 3] = [1e3, 1e4, 1e5];
/// From here on a spline is stiffer than any of these shapes.
const STRAIGHT: f64 = 1e8;

/// What a curve is made of, from soft to stiff.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Curve {
    /// Penalised by a stiffness, mm³ per unit weight.
    Spline(f64),
    /// So many harmonics of a closed curve's length, or a polynomial of this degree along an open one.
    Shape(usize),
    /// The same, and a spline for what they leave over, which is then too small to be shrunk much.
    Both(usize, f64),
}

impl Curve {
    /// Standard errors by which it may be worse than the best to be taken. Most seams are straight, and the best of a dozen
    /// softer curves looks better than a straight line by chance.
    fn deviations(self) -> f64 {
        if matches!(self, Self::Spline(stiffness) if stiffness > STRAIGHT) {
            STRAIGHT_ERRORS
        } else {
            CURVED_ERRORS
        }
    }

    /// Effective number of free parameters per coordinate over a length.
    pub(crate) fn freedom(self, closed: bool, length_mm: f64, step_mm: f64) -> f64 {
        match self {
            // A smoothing spline bends over lengths of about the fourth root of its stiffness per weight.
            Self::Spline(stiffness) => {
                2.0 + length_mm / (std::f64::consts::PI * (stiffness * step_mm).powf(0.25))
            }
            Self::Shape(most) => terms(closed, most) as f64,
            Self::Both(_, stiffness) => Self::Spline(stiffness).freedom(closed, length_mm, step_mm),
        }
    }
}

/// Samples of a vector-valued curve at equal steps; weight 0 where there is none.
pub struct Samples<'a, const D: usize> {
    /// Values.
    pub values: &'a [[f64; D]],
    /// Weights, not negative.
    pub weights: &'a [f64],
    /// Step, mm.
    pub step_mm: f64,
    /// Whether the last is followed by the first.
    pub closed: bool,
}

impl<const D: usize> Samples<'_, D> {
    /// The smooth curve at every step.
    pub fn smooth(&self, curve: Curve) -> Vec<[f64; D]> {
        self.solve(self.weights, curve)
    }

    /// The stiffest curve that predicts left-out blocks of `block_mm` about as well as the best.
    pub(crate) fn stiffest(&self, block_mm: f64) -> Curve {
        let n = self.values.len();
        let fitting = ((block_mm / self.step_mm).ceil() as usize).min(n / LEAST_BLOCKS).max(1);
        let curves = self.candidates();
        let misses: Vec<Vec<Miss>> = curves.par_iter().map(|&c| self.misses(c, fitting)).collect();
        // Large misses are outliers, not evidence; one bound for all, or soft curves would hide theirs.
        let middle = |m: &Vec<Miss>| median(&mut m.iter().map(|x| x.squared).collect::<Vec<_>>());
        let cap = CAP_MEDIANS * misses.iter().map(middle).fold(f64::INFINITY, f64::min);
        let errors: Vec<Vec<f64>> =
            misses.iter().map(|m| block_errors(m, cap, n.div_ceil(fitting))).collect();
        let total = |e: &Vec<f64>| e.iter().sum::<f64>();
        let best = errors.iter().min_by(|a, b| total(a).total_cmp(&total(b)));
        let close = |best: &Vec<f64>| {
            let candidates = curves.iter().zip(&errors);
            candidates.rev().position(|(curve, e)| no_worse(e, best, curve.deviations()))
        };
        let pick = best.and_then(close).map_or(0, |from_end| curves.len() - 1 - from_end);
        curves[pick]
    }

    /// Curves to choose from, softest first.
    fn candidates(&self) -> Vec<Curve> {
        let splines = |straight: bool| {
            STIFFNESS.into_iter().filter(move |s| (*s > STRAIGHT) == straight).map(Curve::Spline)
        };
        let (shapes, base) =
            if self.closed { (&HARMONICS[..], HARMONICS[1]) } else { (&DEGREES[..], MIXED_DEGREE) };
        let mixed = MIXED_STIFFNESS.map(|s| Curve::Both(base, s));
        let shaped = mixed.into_iter().chain(shapes.iter().map(|&most| Curve::Shape(most)));
        if self.closed {
            splines(false).chain(splines(true)).chain(shaped).collect()
        } else {
            splines(false).chain(shaped).chain(splines(true)).collect()
        }
    }

    /// Squared miss and weight of samples, predicted by a curve that saw neither their block nor half a block beside it.
    fn misses(&self, curve: Curve, per_block: usize) -> Vec<Miss> {
        let n = self.values.len();
        let blocks = n.div_ceil(per_block);
        let guard = per_block.div_ceil(2);
        let mut misses = Vec::with_capacity(n);
        for fold in 0..FOLDS {
            // The end blocks of an open curve can only be extrapolated, which validates nothing.
            let judged = |k: usize| {
                let block = k / per_block;
                block % FOLDS == fold && (self.closed || (block > 0 && block + 1 < blocks))
            };
            let hidden = |k: usize| {
                let beside = |d: isize| match k as isize + d {
                    j if self.closed => judged(j.rem_euclid(n as isize) as usize),
                    j => (0..n as isize).contains(&j) && judged(j as usize),
                };
                judged(k) || beside(guard as isize) || beside(-(guard as isize))
            };
            let kept: Vec<f64> =
                self.weights.iter().enumerate().map(|(k, &w)| if hidden(k) { 0.0 } else { w }).collect();
            let curve = self.solve(&kept, curve);
            for k in (0..n).filter(|&k| judged(k) && self.weights[k] > 0.0) {
                let miss: f64 = (0..D).map(|d| (curve[k][d] - self.values[k][d]).powi(2)).sum();
                misses.push(Miss { squared: miss, weight: self.weights[k], block: k / per_block });
            }
        }
        misses
    }

    fn solve(&self, weights: &[f64], curve: Curve) -> Vec<[f64; D]> {
        let n = self.values.len();
        let stiffness = match curve {
            Curve::Shape(most) => return shape(self.values, weights, self.closed, most),
            Curve::Both(most, stiffness) => {
                let base = shape(self.values, weights, self.closed, most);
                let minus = |(y, b): (&[f64; D], &[f64; D])| std::array::from_fn(|d| y[d] - b[d]);
                let left: Vec<[f64; D]> = self.values.iter().zip(&base).map(minus).collect();
                let rest = Samples { values: &left, ..*self }.solve(weights, Curve::Spline(stiffness));
                let plus = |(r, b): (&[f64; D], &[f64; D])| std::array::from_fn(|d| r[d] + b[d]);
                return rest.iter().zip(&base).map(plus).collect();
            }
            Curve::Spline(stiffness) => stiffness,
        };
        if !self.closed {
            return whittaker(self.values, weights, stiffness / self.step_mm.powi(3));
        }
        // A loop is laid out with enough of itself on both sides.
        let pad = (n / 2).max(1);
        let at = |k: usize| (k + n * pad - pad) % n;
        let values: Vec<[f64; D]> = (0..n + 2 * pad).map(|k| self.values[at(k)]).collect();
        let around: Vec<f64> = (0..n + 2 * pad).map(|k| weights[at(k)]).collect();
        whittaker(&values, &around, stiffness / self.step_mm.powi(3))[pad..pad + n].to_vec()
    }
}

/// A sample predicted without it.
struct Miss {
    squared: f64,
    weight: f64,
    block: usize,
}

fn block_errors(misses: &[Miss], cap: f64, blocks: usize) -> Vec<f64> {
    let mut errors = vec![0.0; blocks];
    for m in misses {
        errors[m.block] += m.squared.min(cap) * m.weight;
    }
    errors
}

/// Whether errors exceed the best ones by no more than so many standard errors of their difference: a few blocks cannot
/// tell more, and the stiffer curve is the likelier one.
fn no_worse(errors: &[f64], best: &[f64], deviations: f64) -> bool {
    let n = errors.len() as f64;
    let differences = || errors.iter().zip(best).map(|(e, b)| e - b);
    let mean = differences().sum::<f64>() / n;
    let variance = differences().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let total: f64 = best.iter().sum::<f64>() / n;
    mean <= (deviations * (variance / n).sqrt()).max((CLOSE - 1.0) * total)
}

/// Number of coefficients of a shape.
fn terms(closed: bool, most: usize) -> usize {
    if closed { 1 + 2 * most } else { 1 + most }
}

/// Weighted least squares by a shape; the values themselves where that has no solution.
fn shape<const D: usize>(values: &[[f64; D]], weights: &[f64], closed: bool, most: usize) -> Vec<[f64; D]> {
    let terms = terms(closed, most);
    let row = |k: usize| {
        let share = k as f64 / values.len() as f64;
        let angle = std::f64::consts::TAU * share;
        DVector::from_fn(terms, |t, _| match t {
            t if !closed => (2.0 * share - 1.0).powi(t as i32),
            0 => 1.0,
            t if t % 2 == 1 => (angle * t.div_ceil(2) as f64).cos(),
            t => (angle * (t / 2) as f64).sin(),
        })
    };
    let rows: Vec<DVector<f64>> = (0..values.len()).map(row).collect();
    let (mut a, mut b) = (DMatrix::zeros(terms, terms), DMatrix::zeros(terms, D));
    for ((r, y), &w) in rows.iter().zip(values).zip(weights) {
        a.ger(w, r, r, 1.0);
        b.ger(w, r, &DVector::from_column_slice(y), 1.0);
    }
    let Some(factor) = a.cholesky() else { return values.to_vec() };
    let x = factor.solve(&b);
    rows.iter().map(|r| std::array::from_fn(|d| r.dot(&x.column(d)))).collect()
}

/// Solves `(W + penalty DᵀD) f = W y`, D the second differences: five diagonals, so linear in the number of samples.
fn whittaker<const D: usize>(values: &[[f64; D]], weights: &[f64], penalty: f64) -> Vec<[f64; D]> {
    let n = values.len();
    if n < 3 {
        return values.to_vec();
    }
    let mut bands = vec![[0.0f64; 3]; n];
    for (k, band) in bands.iter_mut().enumerate() {
        band[0] = weights[k].max(LEAST_WEIGHT);
    }
    for k in 0..n - 2 {
        for (i, a) in [1.0, -2.0, 1.0].into_iter().enumerate() {
            for (j, b) in [1.0, -2.0, 1.0].into_iter().enumerate().skip(i) {
                bands[k + i][j - i] += penalty * a * b;
            }
        }
    }
    let mut f: Vec<[f64; D]> =
        values.iter().zip(weights).map(|(y, &w)| y.map(|v| v * w.max(LEAST_WEIGHT))).collect();
    solved(&mut bands, &mut f);
    f
}

/// Solves five symmetric diagonals for the right sides `f`, by LDLᵀ in place: `band[0]` becomes the pivot, `band[1..]` the
/// multipliers below it.
fn solved<const D: usize>(bands: &mut [[f64; 3]], f: &mut [[f64; D]]) {
    let n = f.len();
    for k in 0..n {
        let pivot = bands[k][0];
        for i in 1..3.min(n - k) {
            let multiplier = bands[k][i] / pivot;
            for j in i..3.min(n - k) {
                let carry = bands[k][j];
                bands[k + i][j - i] -= multiplier * carry;
            }
            let row = f[k];
            for (below, v) in f[k + i].iter_mut().zip(row) {
                *below -= multiplier * v;
            }
        }
    }
    for k in (0..n).rev() {
        let mut row = f[k];
        for i in 1..3.min(n - k) {
            for (v, later) in row.iter_mut().zip(f[k + i]) {
                *v -= bands[k][i] * later;
            }
        }
        f[k] = row.map(|v| v / bands[k][0]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: usize) -> f64 {
        // A fixed sequence without structure: the finaliser of SplitMix64.
        let mut z = (k as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    #[test]
    fn a_straight_line_is_kept_at_any_stiffness() {
        let values: Vec<[f64; 1]> = (0..60).map(|k| [0.3 * k as f64 - 4.0]).collect();
        let samples = Samples { values: &values, weights: &[1.0; 60], step_mm: 2.0, closed: false };
        for s in STIFFNESS {
            let miss = samples
                .smooth(Curve::Spline(s))
                .iter()
                .zip(&values)
                .map(|(a, b)| (a[0] - b[0]).abs())
                .fold(0.0, f64::max);
            assert!(miss < 1e-4, "{s}: {miss}");
        }
    }

    #[test]
    fn noise_about_a_line_is_smoothed_stiffly_and_a_circle_stays_as_large() {
        let n = 120;
        let weights = vec![1.0; n];
        let line: Vec<[f64; 1]> = (0..n).map(|k| [0.2 * noise(k)]).collect();
        let stiff = Samples { values: &line, weights: &weights, step_mm: 2.0, closed: false }.stiffest(10.0);
        let radius = n as f64 * 2.0 / std::f64::consts::TAU;
        let circle: Vec<[f64; 2]> = (0..n)
            .map(|k| {
                let a = k as f64 / n as f64 * std::f64::consts::TAU;
                [radius * a.cos() + 0.05 * noise(k), radius * a.sin() + 0.05 * noise(k + 500)]
            })
            .collect();
        let samples = Samples { values: &circle, weights: &weights, step_mm: 2.0, closed: true };
        let round = samples.stiffest(10.0);
        assert!(matches!(stiff, Curve::Spline(s) if s >= 1e7), "{stiff:?}");
        assert!(matches!(round, Curve::Shape(_)), "{round:?}");
        let shrink: f64 =
            samples.smooth(round).iter().map(|p| radius - p[0].hypot(p[1])).sum::<f64>() / n as f64;
        assert!(shrink.abs() < 0.02, "{shrink}");
    }

    #[test]
    fn a_short_arc_keeps_its_sagitta_to_its_ends() {
        let n = 25;
        let arc: Vec<[f64; 2]> = (0..n)
            .map(|k| {
                let (sin, cos) = (2.0 * k as f64 / 40.0).sin_cos();
                [40.0 * sin + 0.1 * noise(k), 40.0 * cos + 0.1 * noise(k + 99)]
            })
            .collect();
        let samples = Samples { values: &arc, weights: &vec![1.0; n], step_mm: 2.0, closed: false };
        let curve = samples.smooth(samples.stiffest(20.0));
        let worst = curve.iter().map(|p| (p[0].hypot(p[1]) - 40.0).abs()).fold(0.0, f64::max);
        assert!(worst < 0.15, "{worst} mm off the arc");
    }

    #[test]
    fn missing_samples_are_bridged() {
        let values: Vec<[f64; 1]> =
            (0..40).map(|k| [if (10..20).contains(&k) { 99.0 } else { k as f64 }]).collect();
        let weights: Vec<f64> = (0..40).map(|k| if (10..20).contains(&k) { 0.0 } else { 1.0 }).collect();
        let curve = Samples { values: &values, weights: &weights, step_mm: 1.0, closed: false }
            .smooth(Curve::Spline(1e2));
        assert!((curve[15][0] - 15.0).abs() < 1e-3);
    }
}
