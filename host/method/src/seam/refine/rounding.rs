//! How far a camera or a fillet lifts the faces beside a root, which is not there (ours).
//!
//! A matching window, light from one face on the other, and a radius all lift the points near the root off their face, more
//! the nearer they are; a face fitted to them misses the root. Along the whole seam the lift is found as `c exp(-u / length)`
//! over the distance `u` from the root, beside a line (a parabola where the face is curved) of each view: views may disagree
//! on where a face is and see different parts of it, and must not pass for a lift. What the exponential leaves next to the
//! root is left out of the fits. A lift has to be there in all parts of the seam: what differs along it is the work's own shape.

use super::beside::Beside;
use crate::geometry::statistics::{median, robust_deviation};
use std::collections::BTreeMap;

/// Width of a strip along the seam, in voxels: a voxel holds some points, and a lift is a few voxels wide.
const STRIP_VOXELS: f32 = 0.4;
/// Parts of the seam that are looked at each by itself.
const PARTS: usize = 4;
/// Fewer points of one view make no median; fewer strips no curve.
const LEAST_POINTS: usize = 20;
const LEAST_STRIPS: usize = 8;
/// Variance of a median over that of a mean, and points that share one error (noise is correlated over a pixel or two).
const MEDIAN_VARIANCE: f64 = 1.57;
const SHARED_ERROR: f64 = 8.0;
/// Were all points independent, strips would scatter by so much less, squared.
const LEAST_SCALE: f64 = 1.0 / SHARED_ERROR;
/// What no number of points makes better, mm: depth comes in steps, faces are not flat.
const FLOOR_MM: f64 = 0.01;
/// Lengths that are tried: from a strip to this share of the face that is used, of which a longer one is no more than a slope.
const LENGTHS: usize = 14;
const LONGEST: f64 = 0.5;
/// Share of a narrow face that the rounding of its other edge does not reach, and the longest length there.
const NARROW_SHARE: f32 = 0.7;
const NARROW_LONGEST: f64 = 0.3;
/// Standard deviations from which on a lift or a curvature is there.
const SIGNIFICANT: f64 = 6.0;
/// What the lift of a part of the seam may differ by: this share of it, and so many standard deviations.
const SHARE_APART: f64 = 0.5;
const PARTS_APART: f64 = 2.0;
/// Share of a lift that its shape, of which an exponential is an idealisation, leaves unknown.
const UNKNOWN_SHARE: f64 = 0.3;
/// Share of a face that may be left out beside the root.
const MOST_LEFT_OUT: f32 = 0.4;

/// What lifts one face beside the root.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Rounding {
    /// Lift at the root, mm.
    lift_mm: f64,
    /// Distance in which it falls by e, mm.
    length_mm: f64,
    /// Nearer points fit no curve, mm.
    pub(super) until_mm: f32,
    /// Standard deviation of what is not known of it, as an error of the face's height at the root, mm.
    pub(super) unknown_mm: f64,
}

/// The part of a face that is looked at, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    /// Points nearer to the root are left out.
    pub(super) from_mm: f32,
    /// Where the face ends.
    pub(super) reach_mm: f32,
    /// Edge of a voxel.
    pub(super) voxel_mm: f32,
}

/// A strip of one view: distance from the root, median height, its variance.
#[derive(Debug, Clone, Copy)]
struct Strip {
    u: f64,
    h: f64,
    variance: f64,
}

impl Rounding {
    /// Of the points of a face, none higher than `most_mm`. A narrow one is rounded near its other edge, too: it tells of its
    /// near part only, and nothing of curvature.
    pub(super) fn of(points: &[Beside], extent: &Extent, most_mm: f32, narrow: bool) -> Self {
        let Extent { from_mm, voxel_mm, .. } = *extent;
        let (share, longest) = if narrow { (NARROW_SHARE, NARROW_LONGEST) } else { (1.0, LONGEST) };
        let reach_mm = from_mm + share * (extent.reach_mm - from_mm);
        let width_mm = STRIP_VOXELS * voxel_mm;
        let views = strips(points, from_mm, reach_mm, width_mm, 1).pop().unwrap_or_default();
        let longest = longest * f64::from(reach_mm - from_mm);
        let shortest = f64::from(STRIP_VOXELS * voxel_mm);
        let none = Self::default();
        if views.is_empty() || longest < 2.0 * shortest {
            return none;
        }
        let ratio = (longest / shortest).powf(1.0 / (LENGTHS - 1) as f64);
        let lengths = (0..LENGTHS).map(|k| shortest * ratio.powi(k as i32));
        let seen = |fit: &Fit| (fit.lift_mm * (-f64::from(from_mm) / fit.length_mm).exp()).abs();
        let best = |terms: usize| {
            let fits = lengths.clone().filter_map(|length_mm| Fit::of(&views, length_mm, terms));
            let possible = fits.filter(|fit| seen(fit) < f64::from(most_mm));
            possible.min_by(|a, b| a.squares.total_cmp(&b.squares))
        };
        let flat = best(2);
        let bent = best(3).filter(|bent| {
            let better = |flat: &Fit| flat.squares - bent.squares > SIGNIFICANT.powi(2) * bent.scale();
            !narrow && flat.as_ref().is_none_or(better)
        });
        let fit = bent.or(flat);
        let parts = strips(points, from_mm, reach_mm, width_mm, PARTS);
        // What would fall off over still more is the face's own curvature.
        fit.filter(|fit| fit.length_mm < 0.99 * longest && fit.is_everywhere(&parts))
            .and_then(|fit| fit.rounding(&views, from_mm, reach_mm))
            .unwrap_or(none)
    }

    /// Whether nothing lifts the face.
    pub(super) fn is_none(&self) -> bool {
        self.lift_mm == 0.0
    }

    /// Height that is to be taken off a point, mm.
    pub(super) fn lift(&self, u: f32) -> f32 {
        if self.is_none() { 0.0 } else { (self.lift_mm * (-f64::from(u) / self.length_mm).exp()) as f32 }
    }
}

/// Strips of each view in one part of the seam.
type Part = Vec<Vec<Strip>>;

/// Strips of each part of the seam and each view that has enough of them there.
fn strips(points: &[Beside], from_mm: f32, reach_mm: f32, width_mm: f32, parts: usize) -> Vec<Part> {
    let count = ((reach_mm - from_mm).max(0.0) / width_mm) as usize + 1;
    let views = points.iter().map(|p| usize::from(p.view) + 1).max().unwrap_or(0);
    let along = |s: f32, (low, high): (f32, f32)| (s.min(low), s.max(high));
    let (low, high) = points.iter().fold((f32::MAX, f32::MIN), |range, p| along(p.s, range));
    let part_mm = ((high - low) / parts as f32).max(f32::MIN_POSITIVE);
    let mut heights: Vec<Vec<f32>> = vec![Vec::new(); parts * views * count];
    for p in points.iter().filter(|p| p.u > from_mm && p.u < reach_mm) {
        let part = (((p.s - low) / part_mm) as usize).min(parts - 1);
        let strip = ((p.u - from_mm) / width_mm) as usize;
        heights[(part * views + usize::from(p.view)) * count + strip].push(p.h);
    }
    let strip = |(k, heights): (usize, &mut Vec<f32>)| {
        let u = f64::from(from_mm + (k as f32 + 0.5) * width_mm);
        (heights.len() >= LEAST_POINTS).then(|| Strip::of(u, heights))
    };
    let of_view = |heights: &mut [Vec<f32>]| heights.iter_mut().enumerate().filter_map(strip).collect();
    let of_part = |heights: &mut [Vec<f32>]| {
        heights
            .chunks_mut(count)
            .map(of_view)
            .filter(|strips: &Vec<Strip>| strips.len() >= LEAST_STRIPS)
            .collect()
    };
    heights.chunks_mut((views * count).max(1)).map(of_part).collect()
}

impl Strip {
    fn of(u: f64, heights: &mut [f32]) -> Self {
        let h = median(heights);
        let mut misses: Vec<f64> = heights.iter().map(|other| f64::from((other - h).abs())).collect();
        let deviation = robust_deviation(&mut misses);
        let variance = MEDIAN_VARIANCE * SHARED_ERROR * deviation * deviation / heights.len() as f64;
        Self { u, h: f64::from(h), variance: variance + FLOOR_MM * FLOOR_MM }
    }
}

/// A lift of one length, fitted to the strips of all views.
struct Fit {
    lift_mm: f64,
    length_mm: f64,
    /// Variance of the lift.
    variance: f64,
    /// Weighted squares that are left, and strips beyond those that the terms take.
    squares: f64,
    freedom: f64,
    /// Terms of each view's own curve.
    terms: usize,
}

impl Fit {
    fn of(views: &[Vec<Strip>], length_mm: f64, terms: usize) -> Option<Self> {
        let (mut fall, mut cross, mut squares, mut freedom) = (0.0, 0.0, 0.0, -1.0);
        for strips in views {
            let [falls, heights] = own_curve_off(strips, length_mm, terms);
            fall += dot(&falls, &falls);
            cross += dot(&falls, &heights);
            squares += dot(&heights, &heights);
            freedom += (strips.len() - terms) as f64;
        }
        let lift_mm = cross / fall;
        let squares = squares - lift_mm * cross;
        lift_mm.is_finite().then_some(Self {
            lift_mm,
            length_mm,
            variance: 1.0 / fall,
            squares,
            freedom,
            terms,
        })
    }

    /// Whether all parts of the seam show about the same lift.
    fn is_everywhere(&self, parts: &[Part]) -> bool {
        let own = parts.iter().filter_map(|views| Self::of(views, self.length_mm, self.terms));
        own.into_iter().all(|part| {
            let scatter = (part.variance * part.scale()).sqrt();
            (part.lift_mm - self.lift_mm).abs() < SHARE_APART * self.lift_mm.abs() + PARTS_APART * scatter
        })
    }

    /// What the strips scatter more than they should, squared; how many points share an error is only guessed.
    fn scale(&self) -> f64 {
        (self.squares / self.freedom.max(1.0)).max(LEAST_SCALE)
    }

    fn rounding(&self, views: &[Vec<Strip>], from_mm: f32, reach_mm: f32) -> Option<Rounding> {
        let deviation = (self.variance * self.scale()).sqrt();
        if self.lift_mm.abs() < SIGNIFICANT * deviation {
            return None;
        }
        // A line through the lift from the first strip to the last is what a face's fit would make of it at the root.
        let (from, to) = (f64::from(from_mm), f64::from(reach_mm));
        let at_root = line_at_root(self.length_mm, from, to);
        let unknown_mm = at_root * deviation.hypot(UNKNOWN_SHARE * self.lift_mm);
        let until_mm = self.unfit_until(views, from_mm, from_mm + MOST_LEFT_OUT * (reach_mm - from_mm));
        Some(Rounding { lift_mm: self.lift_mm, length_mm: self.length_mm, until_mm, unknown_mm })
    }

    /// Distance from the root up to which strips, one after another, are off the curves.
    fn unfit_until(&self, views: &[Vec<Strip>], from_mm: f32, most_mm: f32) -> f32 {
        let mut by_place: BTreeMap<u64, (f64, f64, f64)> = BTreeMap::new();
        for strips in views {
            let [falls, heights] = own_curve_off(strips, self.length_mm, self.terms);
            for ((strip, fall), height) in strips.iter().zip(falls).zip(heights) {
                let (sum, weight, _) = by_place.entry(strip.u.to_bits()).or_insert((0.0, 0.0, strip.u));
                *sum += (height - self.lift_mm * fall) / strip.variance.sqrt();
                *weight += 1.0 / strip.variance;
            }
        }
        let gate = 0.5 * SIGNIFICANT * self.scale().sqrt();
        let mut until_mm = from_mm;
        let half = by_place.values().next().map_or(0.0, |first| first.2 as f32 - from_mm);
        for (sum, weight, u) in by_place.values() {
            if sum.abs() < gate * weight.sqrt() || *u as f32 + half > most_mm {
                break;
            }
            until_mm = *u as f32 + half;
        }
        until_mm
    }
}

/// The lift and the heights of a view's strips in standard deviations, with what a line or a parabola makes of them taken off.
fn own_curve_off(strips: &[Strip], length_mm: f64, terms: usize) -> [Vec<f64>; 2] {
    let weighted = |of: &dyn Fn(&Strip) -> f64| -> Vec<f64> {
        strips.iter().map(|s| of(s) / s.variance.sqrt()).collect()
    };
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for power in 0..terms as i32 {
        let mut term = weighted(&|s| s.u.powi(power));
        basis.iter().for_each(|known| take_off(&mut term, known));
        let length = dot(&term, &term).sqrt().max(f64::MIN_POSITIVE);
        term.iter_mut().for_each(|value| *value /= length);
        basis.push(term);
    }
    [weighted(&|s| (-s.u / length_mm).exp()), weighted(&|s| s.h)].map(|mut values| {
        basis.iter().for_each(|known| take_off(&mut values, known));
        values
    })
}

fn take_off(values: &mut [f64], unit: &[f64]) {
    let along = dot(values, unit);
    values.iter_mut().zip(unit).for_each(|(value, known)| *value -= along * known);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Height at 0 of the line fitted to `exp(-u / length)` over `from..to`.
fn line_at_root(length: f64, from: f64, to: f64) -> f64 {
    let (width, fall) = (to - from, |u: f64| length * (-u / length).exp());
    let (mean, middle) = ((fall(from) - fall(to)) / width, 0.5 * (from + to));
    // Integral of (u - middle) exp(-u / length).
    let moment = |u: f64| -(u - middle + length) * fall(u);
    let slope = 12.0 * (moment(to) - moment(from)) / width.powi(3);
    mean - slope * middle
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEEN: Extent = Extent { from_mm: 1.5, reach_mm: 20.0, voxel_mm: 1.7 };

    /// Points of two views that disagree, on a face with the given lift.
    fn face(lift: impl Fn(f32) -> f32) -> Vec<Beside> {
        let noise = |k: u32| {
            let x = (f64::from(k) * 12.9898).sin() * 43_758.547;
            (x - x.floor()) as f32 - 0.5
        };
        let point = |k: u32| {
            let view = (k % 2) as u16;
            let u = 20.0 * (noise(3 * k) + 0.5);
            let off = if view == 0 { 0.1 } else { -0.05 + 0.004 * u };
            let h = off + lift(u) + noise(3 * k + 1) + noise(3 * k + 2);
            Beside { s: k as f32, face: 0, u, h, view, incidence_cos: 1.0 }
        };
        (0..200_000).map(point).filter(|p| p.view == 0 || p.u > 3.0).collect()
    }

    #[test]
    fn a_face_without_points_is_lifted_by_nothing() {
        assert!(Rounding::of(&[], &SEEN, 3.0, false).is_none());
        let none = Extent { reach_mm: 0.5, ..SEEN };
        assert!(Rounding::of(&face(|_| 0.0), &none, 3.0, true).is_none());
    }

    #[test]
    fn a_face_that_nothing_lifts_is_left_as_it_is() {
        let found = Rounding::of(&face(|_| 0.0), &SEEN, 3.0, false);
        assert_eq!(found, Rounding::default());
        // Nor a curved one.
        let found = Rounding::of(&face(|u| 0.004 * u * u), &SEEN, 3.0, false);
        assert!(found.is_none());
    }

    #[test]
    fn a_lift_that_falls_off_is_taken_off() {
        for (lift_mm, length_mm) in [(1.0, 4.0), (-0.7, 2.5), (0.3, 3.0)] {
            let of = |u: f32| lift_mm * (-u / length_mm).exp();
            let found = Rounding::of(&face(of), &SEEN, 3.0, false);
            for u in [2.0, 4.0, 8.0] {
                let left = (found.lift(u) - of(u)).abs();
                assert!(left < 0.05, "{lift_mm} {length_mm} {u}: {left} of {}", of(u));
            }
        }
    }

    #[test]
    fn what_is_no_exponential_is_left_out_or_small() {
        // As a window of 3 mm each way rounds a right-angled corner.
        let of = |u: f32| 0.25 * (3.0 - u).max(0.0).powi(2) / 3.0;
        let found = Rounding::of(&face(of), &Extent { from_mm: 1.0, ..SEEN }, 3.0, false);
        for k in 0..40 {
            let u = found.until_mm + 0.1 * k as f32;
            assert!((found.lift(u) - of(u)).abs() < 0.06, "{u}: {} of {}", found.lift(u), of(u));
        }
        assert!(found.unknown_mm > 0.0);
    }
}
