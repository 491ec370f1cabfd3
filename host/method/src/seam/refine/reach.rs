//! How far a face extends from the seam before it bends away or ends (ours).

use super::beside::Beside;
use super::face::{LEAST_SIGMA_MM, OUTLIER_DEVIATIONS, bisquare};
use crate::geometry::statistics::{median, robust_deviation};
use nalgebra::{Matrix3, Vector3};

// All chosen on the simulated scans.

/// Fewer points of the inner part show no face.
const LEAST_POINTS: usize = 100;
/// Fewer points of a strip that is left out do not show that it is not of the face.
const LEAST_LEFT_OUT: usize = 20;
/// Width of a strip along the seam, in inner parts.
const STRIP: f32 = 0.077;
/// How many times wider strips may be made.
const MOST_WIDENED: usize = 5;
/// Gaps between strips that hold points from which on they are those between rows, and the share of their second differences that
/// change sign.
const LEAST_GAPS: usize = 3;
const BY_TURNS: f64 = 0.7;
/// Deviation of a second difference over that of its values, of a median over that of a mean; how much more than that
/// neighbouring strips may differ; and the part of what counts as off within which they may in any case: three deviations stay
/// within it.
const TURN_DEVIATION: f64 = 2.449;
const MEDIAN_DEVIATION: f64 = 1.253;
const CHANCE: f64 = 2.0;
const UNSEEN: f64 = 1.0 / 3.0;
/// Strips of the inner part, from its end, that are looked at, too.
const STRIPS_BEFORE: usize = 2;
/// Share of the usual points below which a strip misses some.
const MISSING: f32 = 0.35;
/// How far the median of a strip may be off the face: standard deviations of the points, at least this, mm, and for each
/// mm beyond the inner part this much more, mm.
const OFF_DEVIATIONS: f64 = 0.6;
const OFF_MM: f64 = 0.015;
const DRIFT: f64 = 0.02;
/// Strips before the one in which a face ends that are left out: where it misses points, and where it bends away.
const BEFORE_GAP: f32 = 1.0;
const BEFORE_LIP: f32 = 2.5;
/// Least reach, in inner parts.
const LEAST_REACH: f32 = 0.6;
/// Rounds of weighing and fitting of the parabola.
const ROUNDS: usize = 4;
/// Points that share one error, and deviations of a curvature from which on it is significant.
const SHARED_ERROR: f64 = 8.0;
const SIGNIFICANT: f64 = 6.0;

/// Scales of [`reach`], mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    /// Points nearer to the seam are left out.
    pub(super) from_mm: f32,
    /// Part next to the seam that is taken for the face without question.
    pub(super) inner_mm: f32,
    /// Farthest that is ever used.
    pub(super) most_mm: f32,
    /// Where the face would begin, were it not rounded beside the root. If that is nearer than `from_mm`, the part next to the
    /// seam is not taken without question: all of it has to be one flat face, and what is left out must not be of it.
    pub(super) begins_mm: f32,
    /// Whether a face that ends within its inner part is the side of a plate, whose top begins there, square to it.
    pub(super) is_side: bool,
}

/// How far a face extends from the seam before it bends away or ends, mm.
///
/// A robust parabola over the inner part is continued outward; the face ends at the first strip whose median departs
/// from it, or in which points are missing. A lip inside the window would cost half a millimetre: of the side of a plate that
/// ends within the inner part, what may be over its edge is left out of the parabola.
pub(super) fn reach(points: &[Beside], scale: &Reach) -> f32 {
    let within = |until_mm: f32| {
        let inner = points.iter().filter(move |p| p.u > scale.from_mm && p.u < until_mm);
        inner.map(|p| (f64::from(p.u), f64::from(p.h))).collect::<Vec<_>>()
    };
    let whole = within(scale.inner_mm);
    if whole.len() < LEAST_POINTS {
        return scale.inner_mm.min(scale.most_mm);
    }
    let strip = strip_mm(points, scale);
    let mut heights = by_strip(points, strip, (scale.most_mm / strip) as usize + 1);
    let first = (scale.from_mm / strip) as usize + 1;
    let whole_strips = first..((scale.inner_mm / strip) as usize).clamp(first, heights.len());
    let mut counts: Vec<f32> = heights[whole_strips.clone()].iter().map(|h| h.len() as f32).collect();
    let usual = median(&mut counts);
    let last = whole_strips.clone().rfind(|k| heights[*k].len() as f32 >= MISSING * usual);
    // A face that bends leaves its tangent plane there and does not end.
    let ended = last.filter(|last| scale.is_side && last + 1 < whole_strips.end).and_then(|last| {
        let ends_mm = (last + 1) as f32 * strip;
        let inner_mm = (ends_mm - BEFORE_LIP * strip).max(LEAST_REACH * ends_mm);
        Some((inner_mm, Parabola::fitted(&within(inner_mm))?)).filter(|(_, face)| face.is_flat())
    });
    let whole = || Some((scale.inner_mm, Parabola::fitted(&whole)?));
    let Some((inner_mm, face)) = ended.or_else(whole) else { return scale.inner_mm };
    let last_inner = (inner_mm / strip) as usize;
    let gate = (OFF_DEVIATIONS * face.sigma).max(OFF_MM);
    let off = |k: usize, heights: &mut [f32]| {
        let middle = f64::from((k as f32 + 0.5) * strip);
        let drift = DRIFT * (middle - f64::from(inner_mm)).max(0.0);
        (f64::from(median(heights)) - face.height(middle)).abs() > gate + drift
    };
    let is_doubted = scale.begins_mm < scale.from_mm;
    let nearest = (scale.begins_mm / strip) as usize + 1;
    if is_doubted
        && !(face.is_flat()
            && heights[nearest].len() >= LEAST_LEFT_OUT
            && off(nearest, &mut heights[nearest]))
    {
        return 0.0;
    }
    let looked_at = if is_doubted { first } else { last_inner.saturating_sub(STRIPS_BEFORE).max(first) };
    for (k, strip_heights) in heights.iter_mut().enumerate().skip(looked_at) {
        let begin = k as f32 * strip;
        if (strip_heights.len() as f32) < MISSING * usual {
            return (begin - BEFORE_GAP * strip).max(LEAST_REACH * inner_mm);
        }
        if off(k, strip_heights) {
            return (begin - BEFORE_LIP * strip).max(LEAST_REACH * inner_mm);
        }
    }
    scale.most_mm
}

/// Where the points near the face's tangent plane end, wherever among them the face is: a lip or an edge, and not a lift, mm.
pub(super) fn ends(points: &[Beside], scale: &Reach) -> f32 {
    let strip = strip_mm(points, scale);
    let strips = by_strip(points, strip, (scale.most_mm / strip) as usize + 1);
    let first = (scale.from_mm / strip) as usize + 1;
    let inner = first..((scale.inner_mm / strip) as usize).min(strips.len());
    let mut counts: Vec<f32> = strips[inner].iter().map(|h| h.len() as f32).collect();
    let least = MISSING * median(&mut counts);
    // The last strip is cut short.
    let missing =
        strips.iter().enumerate().skip(first).rev().skip(1).rev().find(|(_, h)| (h.len() as f32) < least);
    missing.map_or(scale.most_mm, |(k, _)| k as f32 * strip)
}

/// Width of strips along the seam, mm. Rows of a picture that run along the seam leave narrow strips empty; and of a row
/// between two of them each gets the points whose noise put them there, all too high in one and too low in the next. There
/// strips are as wide as it takes until neighbours agree.
fn strip_mm(points: &[Beside], scale: &Reach) -> f32 {
    let narrowest = STRIP * scale.inner_mm;
    let widths = (1..=MOST_WIDENED).map(|k| k as f32 * narrowest);
    widths.clone().find(|strip| agrees(points, scale, *strip)).unwrap_or(narrowest)
}

/// Whether the strips of the inner part hold points, up to the last that does, and differ from their neighbours no more than
/// their points' noise lets them, or too little to be taken for an end.
fn agrees(points: &[Beside], scale: &Reach, strip: f32) -> bool {
    let first = (scale.from_mm / strip) as usize + 1;
    let mut inner = by_strip(points, strip, (scale.inner_mm / strip) as usize);
    let mut inner = inner.split_off(first.min(inner.len()));
    let mut counts: Vec<f32> = inner.iter().map(|h| h.len() as f32).collect();
    let usual = median(&mut counts);
    let is_missing = |h: &Vec<f32>| (h.len() as f32) < (MISSING * usual).max(1.0);
    // What follows the last that holds points is no hole: there the face has ended.
    inner.truncate(inner.iter().rposition(|h| !is_missing(h)).map_or(0, |last| last + 1));
    // A gap or two are of the work: rows leave one after another.
    let gaps = inner.windows(2).filter(|pair| is_missing(&pair[1]) && !is_missing(&pair[0])).count();
    if gaps >= LEAST_GAPS {
        return false;
    }
    inner.retain(|h| !is_missing(h));
    let heights: Vec<f64> = inner.iter_mut().map(|h| f64::from(median(h))).collect();
    let turns: Vec<f64> = heights.windows(3).map(|h| h[0] - 2.0 * h[1] + h[2]).collect();
    // A lip turns one way: rows make strips high and low by turns.
    let back = turns.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count();
    if turns.is_empty() || (back as f64) < BY_TURNS * (turns.len() - 1) as f64 {
        return true;
    }
    let mut turns: Vec<f64> = turns.iter().map(|turn| turn.abs()).collect();
    let rough_mm = robust_deviation(&mut turns) / TURN_DEVIATION;
    let mut noise = inner
        .iter()
        .zip(&heights)
        .map(|(h, middle)| {
            let mut misses: Vec<f64> = h.iter().map(|h| (f64::from(*h) - middle).abs()).collect();
            robust_deviation(&mut misses)
        })
        .collect::<Vec<_>>();
    let sigma_mm = median(&mut noise);
    let chance_mm = MEDIAN_DEVIATION * sigma_mm / f64::from(usual).sqrt();
    rough_mm < CHANCE * chance_mm || rough_mm < UNSEEN * (OFF_DEVIATIONS * sigma_mm).max(OFF_MM)
}

/// Heights of the points in strips along the seam.
fn by_strip(points: &[Beside], strip: f32, count: usize) -> Vec<Vec<f32>> {
    let mut heights: Vec<Vec<f32>> = vec![Vec::new(); count];
    for p in points.iter().filter(|p| p.u > 0.0) {
        if let Some(strip) = heights.get_mut((p.u / strip) as usize) {
            strip.push(p.h);
        }
    }
    heights
}

/// Height at the root of the line through points `(u, h)`, mm; none of too few.
pub(super) fn at_root_mm(points: &[(f64, f64)]) -> Option<f64> {
    let (line, _) = (points.len() >= LEAST_POINTS).then(|| Parabola::bisquare(points, false))??;
    Some(line.height(0.0))
}

/// Height of a face over the distance from the seam, and the noise of its points.
struct Parabola {
    /// Coefficients of `1, u, u²`.
    terms: Vector3<f64>,
    sigma: f64,
}

impl Parabola {
    /// Robust `1, u, u²` through points `(u, h)`, with the curvature dropped where it is not significant.
    fn fitted(points: &[(f64, f64)]) -> Option<Self> {
        let (curved, deviation) = Self::bisquare(points, true)?;
        if curved.terms[2].abs() >= SIGNIFICANT * deviation {
            return Some(curved);
        }
        let (mut straight, _) = Self::bisquare(points, false)?;
        straight.terms[2] = 0.0;
        Some(straight)
    }

    /// The fit, and the standard deviation of its curvature.
    fn bisquare(points: &[(f64, f64)], curved: bool) -> Option<(Self, f64)> {
        let row = |u: f64| Vector3::new(1.0, u, if curved { u * u } else { 0.0 });
        let (mut x, mut limit, mut inverse, mut sigma) =
            (Vector3::zeros(), f64::INFINITY, Matrix3::zeros(), 0.0);
        for round in 0..ROUNDS {
            let (mut a, mut b) = (Matrix3::zeros(), Vector3::zeros());
            for (u, h) in points {
                let r = row(*u);
                let w = if round == 0 { 1.0 } else { bisquare((h - r.dot(&x)) / limit) };
                a.ger(w, &r, &r, 1.0);
                b.axpy(w * h, &r, 1.0);
            }
            if !curved {
                a[(2, 2)] = 1.0;
            }
            inverse = a.try_inverse()?;
            x = inverse * b;
            let mut misses: Vec<f64> = points.iter().map(|(u, h)| (h - row(*u).dot(&x)).abs()).collect();
            sigma = robust_deviation(&mut misses).max(LEAST_SIGMA_MM);
            limit = OUTLIER_DEVIATIONS * sigma;
        }
        Some((Self { terms: x, sigma }, (inverse[(2, 2)] * SHARED_ERROR).sqrt() * sigma))
    }

    fn is_flat(&self) -> bool {
        self.terms[2] == 0.0
    }

    fn height(&self, u: f64) -> f64 {
        self.terms[0] + self.terms[1] * u + self.terms[2] * u * u
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: Reach = Reach { from_mm: 1.0, inner_mm: 6.5, most_mm: 14.0, begins_mm: 1.0, is_side: false };

    /// Points of a face of `length_mm`, in rows along the seam that are `pitch_mm` apart, seen at 45 degrees to it with noise
    /// along the line of sight; it is lifted beyond `lip_mm`.
    fn face(pitch_mm: f32, length_mm: f32, lip_mm: f32) -> Vec<Beside> {
        let noise = |k: u32| {
            let x = (f64::from(k) * 12.9898).sin() * 43_758.547;
            (x - x.floor()) as f32 - 0.5
        };
        let point = |k: u32| {
            let depth = noise(4 * k) + noise(4 * k + 1) + noise(4 * k + 2);
            let row = ((noise(4 * k + 3) + 0.5) * length_mm / pitch_mm).floor() * pitch_mm;
            let (u, lift) = (row + 0.7 * depth, if row > lip_mm { 1.0 } else { 0.0 });
            Beside { s: 0.01 * k as f32, face: 0, u, h: 0.7 * depth + lift, view: 0, incidence_cos: 0.7 }
        };
        (0..8000).map(point).collect()
    }

    #[test]
    fn a_face_whose_rows_run_along_the_seam_does_not_end_between_two_of_them() {
        for pitch_mm in [0.1, 0.8, 1.06, 1.3] {
            assert_eq!(reach(&face(pitch_mm, 16.0, 99.0), &SCALE), SCALE.most_mm, "{pitch_mm}");
        }
    }

    #[test]
    fn it_ends_where_it_ends_or_is_lifted_all_the_same() {
        for pitch_mm in [0.1, 1.06] {
            for mm in [reach(&face(pitch_mm, 10.0, 99.0), &SCALE), reach(&face(pitch_mm, 16.0, 10.0), &SCALE)]
            {
                assert!((7.0..=10.5).contains(&mm), "{pitch_mm}: {mm}");
            }
        }
    }
}
