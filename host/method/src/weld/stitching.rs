//! Stitches and tacks (ours): only stretches of a path are welded, the torch is lifted over the rest.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{PathPoint, Process, SeamPath, at};

/// Which stretches of a seam are welded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// All of it.
    #[default]
    Continuous,
    /// Stretches of `length_mm`, one every `pitch_mm`.
    Stitches,
    /// `count` stretches of `length_mm`, evenly spaced.
    Tacks,
}

/// Which stretches are welded, and how long they are.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stitching {
    /// Which.
    pub pattern: Pattern,
    /// Length of each, mm.
    pub length_mm: f64,
    /// Of [`Pattern::Stitches`], from the centre of one to the centre of the next, nearest to this, mm.
    pub pitch_mm: f64,
    /// How many [`Pattern::Tacks`].
    pub count: usize,
}

/// Welds stretches of the same length. On an open path the first begins at its start and the last ends at its end, as
/// an intermittent weld should; a single one lies in the middle. On a closed path they are spaced evenly all round. A
/// path no longer than a stitch is welded whole.
pub fn stitch(path: &SeamPath, stitching: &Stitching) -> SeamPath {
    let ([first, .., last], Pattern::Stitches | Pattern::Tacks) = (path.points.as_slice(), stitching.pattern)
    else {
        return path.clone();
    };
    let stretches = stretches(first.s_mm, last.s_mm, path.is_closed(), stitching);
    let breaks = stretches.iter().flatten().copied();
    let mut points = with_points_at(&path.points, breaks);
    for point in &mut points {
        let inside = |[a, b]: &[f64; 2]| point.s_mm >= a - SAME_MM && point.s_mm <= b + SAME_MM;
        point.process.weld &= stretches.iter().any(inside);
    }
    path.with(points)
}

/// Lengths nearer than this are one, mm.
const SAME_MM: f64 = 1e-6;

/// From where to where each stitch goes, mm, in the order of the path; they never touch.
fn stretches(from_mm: f64, to_mm: f64, closed: bool, stitching: &Stitching) -> Vec<[f64; 2]> {
    let Stitching { pattern, length_mm, pitch_mm: asked_mm, count } = *stitching;
    let whole_mm = to_mm - from_mm;
    let room_mm = if closed { whole_mm } else { whole_mm - length_mm };
    let gaps = match pattern {
        Pattern::Continuous => return vec![[from_mm, to_mm]],
        Pattern::Stitches => (room_mm / asked_mm).round(),
        Pattern::Tacks => count as f64 - if closed { 0.0 } else { 1.0 },
    };
    let gaps = gaps.max(if closed { 1.0 } else { 0.0 });
    let pitch_mm = room_mm / gaps.max(1.0);
    let touching = pattern == Pattern::Stitches && asked_mm <= length_mm;
    if touching || length_mm >= whole_mm || gaps > 0.0 && pitch_mm <= length_mm {
        return vec![[from_mm, to_mm]];
    }
    let start_mm = match (closed, gaps > 0.0) {
        (true, _) => from_mm + 0.5 * (pitch_mm - length_mm),
        (false, true) => from_mm,
        (false, false) => from_mm + 0.5 * room_mm,
    };
    let count = gaps as usize + usize::from(!closed);
    (0..count).map(|k| start_mm + k as f64 * pitch_mm).map(|a| [a, a + length_mm]).collect()
}

/// The points, and poses at these lengths unless there is a point already.
fn with_points_at(points: &[PathPoint], lengths_mm: impl Iterator<Item = f64>) -> Vec<PathPoint> {
    let mut all = points.to_vec();
    for s_mm in lengths_mm {
        let there = all.iter().any(|point| (point.s_mm - s_mm).abs() < SAME_MM);
        let next = all.partition_point(|point| point.s_mm <= s_mm);
        if let (false, true, Some(pose)) = (there, next > 0 && next < all.len(), at(&all, s_mm)) {
            all.insert(next, PathPoint { process: Process { dwell_s: None, ..pose.process }, ..pose });
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, UnitQuaternion};
    use std::f64::consts::TAU;

    fn line(length_mm: f64) -> SeamPath {
        let count = (length_mm / 2.0) as i32;
        let at = |i: i32| PathPoint {
            s_mm: length_mm * f64::from(i) / f64::from(count),
            position_mm: Point3::new(length_mm * f64::from(i) / f64::from(count), 0.0, 0.0),
            base_from_torch: UnitQuaternion::identity(),
            process: Process::default(),
        };
        SeamPath { seam: 1, points: (0..=count).map(at).collect() }
    }

    fn stitches(length_mm: f64, pitch_mm: f64) -> Stitching {
        Stitching { pattern: Pattern::Stitches, length_mm, pitch_mm, count: 0 }
    }

    fn tacks(length_mm: f64, count: usize) -> Stitching {
        Stitching { pattern: Pattern::Tacks, length_mm, pitch_mm: 0.0, count }
    }

    /// From where to where the arc burns.
    fn welded(path: &SeamPath) -> Vec<[f64; 2]> {
        path.points
            .split(|p| !p.process.weld)
            .filter_map(|run| Some([run.first()?.position_mm.x, run.last()?.position_mm.x]))
            .collect()
    }

    #[test]
    fn stitches_have_their_length_and_both_ends_are_welded() {
        // 203 mm hold four gaps of 45.75 mm, the nearest to 45.
        let runs = welded(&stitch(&line(203.0), &stitches(20.0, 45.0)));
        assert_eq!(runs.len(), 5);
        for (k, [a, b]) in runs.iter().enumerate() {
            assert!((b - a - 20.0).abs() < 1e-9, "stitch {k}");
            assert!((a - 45.75 * k as f64).abs() < 1e-9, "stitch {k}");
        }
    }

    #[test]
    fn tacks_are_as_many_as_asked_for() {
        for count in [1, 2, 3, 7] {
            let runs = welded(&stitch(&line(120.0), &tacks(6.0, count)));
            assert_eq!(runs.len(), count);
            let total: f64 = runs.iter().map(|[a, b]| b - a).sum();
            assert!((total - 6.0 * count as f64).abs() < 1e-9);
        }
        assert_eq!(welded(&stitch(&line(120.0), &tacks(6.0, 1))), [[57.0, 63.0]]);
    }

    #[test]
    fn stitches_that_would_touch_are_one_weld() {
        for stitching in [stitches(50.0, 50.0), stitches(150.0, 200.0), tacks(30.0, 9)] {
            assert_eq!(welded(&stitch(&line(120.0), &stitching)), [[0.0, 120.0]]);
        }
    }

    #[test]
    fn a_ring_is_stitched_evenly_all_round() {
        let at = |i: u32| {
            let angle = TAU * f64::from(i) / 180.0;
            PathPoint {
                s_mm: 20.0 * angle,
                position_mm: Point3::new(20.0 * angle.cos(), 20.0 * angle.sin(), 0.0),
                base_from_torch: UnitQuaternion::identity(),
                process: Process::default(),
            }
        };
        let ring = SeamPath { seam: 1, points: (0..=180).map(at).collect() };
        let stitched = stitch(&ring, &tacks(10.0, 4));
        let middles: Vec<f64> = stitched
            .points
            .split(|p| !p.process.weld)
            .filter_map(|run| Some(0.5 * (run.first()?.s_mm + run.last()?.s_mm) / 20.0))
            .collect();
        assert_eq!(middles.len(), 4);
        for (k, middle) in middles.iter().enumerate() {
            assert!((middle - TAU * (k as f64 + 0.5) / 4.0).abs() < 1e-9, "{middle}");
        }
    }

    #[test]
    fn stitching_twice_changes_nothing_more() {
        let once = stitch(&line(203.0), &stitches(20.0, 45.0));
        assert_eq!(stitch(&once, &stitches(20.0, 45.0)).points, once.points);
    }
}
