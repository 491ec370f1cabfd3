//! Uniform spacing along a torch path (ours; the paper's eqs. (18)-(19) then fill in between).
//!
//! Positions are interpolated linearly, rotations by slerp, the shortest way round. Both ends stay exactly where they
//! were, and so does every corner: a corner splits the path into runs, and the spacing is uniform within each run.

use nalgebra::UnitQuaternion;

use super::{PathPoint, SAME_PLACE_MM, SeamPath, between};

/// A turn at one point sharper than this is a corner. A 2 mm chord turns that much only below a radius of 4 mm, where
/// keeping every point is right as well.
const CORNER_DEG: f64 = 30.0;

/// How densely a path is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sampling {
    /// The spacing nearest to this that divides each run evenly, mm; at most 1.5 times as much.
    SpacingMm(f64),
    /// This many points on each seam, ends and corners included; more only if there are more corners than that.
    Points(usize),
}

/// The same path, sampled uniformly between its corners. Fewer than two points come back as they are.
pub(crate) fn resample(path: &SeamPath, sampling: Sampling) -> SeamPath {
    let points = without_repeats(&path.points);
    if points.len() < 2 {
        return SeamPath { seam: path.seam, points };
    }
    let s_mm = arc_lengths_mm(&points);
    let runs = runs_between_corners(&points);
    let lengths_mm: Vec<f64> = runs.iter().map(|&(a, b)| s_mm[b] - s_mm[a]).collect();
    let intervals = intervals(&lengths_mm, sampling);
    let mut sampled = Vec::with_capacity(intervals.iter().sum::<usize>() + 1);
    for (&(a, b), &count) in runs.iter().zip(&intervals) {
        let run = Run { points: &points[a..=b], s_mm: &s_mm[a..=b] };
        sampled.extend((0..count).map(|k| run.at(k as f64 / count as f64)));
    }
    sampled.extend(points.last().map(|&end| PathPoint { s_mm: s_mm[s_mm.len() - 1], ..end }));
    keep_signs(&mut sampled);
    SeamPath { seam: path.seam, points: sampled }
}

pub(super) fn without_repeats(points: &[PathPoint]) -> Vec<PathPoint> {
    let mut kept: Vec<PathPoint> = Vec::with_capacity(points.len());
    for point in points {
        let repeats = kept.last().is_some_and(|last| {
            (point.position_mm - last.position_mm).norm() < SAME_PLACE_MM
                && point.base_from_torch.angle_to(&last.base_from_torch) < 1e-9
        });
        if !repeats {
            kept.push(*point);
        }
    }
    kept
}

/// Distance along the polyline of every point, mm, from the first point's own `s_mm`.
pub(super) fn arc_lengths_mm(points: &[PathPoint]) -> Vec<f64> {
    let mut s = points[0].s_mm;
    let steps = points.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm());
    std::iter::once(s)
        .chain(steps.map(|step| {
            s += step;
            s
        }))
        .collect()
}

/// Index pairs (first, last) of the stretches between corners; neighbours share their corner.
pub(super) fn runs_between_corners(points: &[PathPoint]) -> Vec<(usize, usize)> {
    let inner = (1..points.len() - 1).filter(|&i| is_corner(points, i));
    let breaks: Vec<usize> = std::iter::once(0).chain(inner).chain([points.len() - 1]).collect();
    breaks.windows(2).map(|w| (w[0], w[1])).collect()
}

/// Whether the path turns sharply at inner point `i`, or the torch turns there in place.
fn is_corner(points: &[PathPoint], i: usize) -> bool {
    let before = points[i].position_mm - points[i - 1].position_mm;
    let after = points[i + 1].position_mm - points[i].position_mm;
    before.norm() < SAME_PLACE_MM
        || after.norm() < SAME_PLACE_MM
        || before.angle(&after) > CORNER_DEG.to_radians()
}

/// Number of intervals of each run: at least one.
fn intervals(lengths_mm: &[f64], sampling: Sampling) -> Vec<usize> {
    match sampling {
        Sampling::SpacingMm(spacing_mm) => {
            lengths_mm.iter().map(|length| (length / spacing_mm).round().max(1.0) as usize).collect()
        }
        Sampling::Points(points) => share(lengths_mm, points.saturating_sub(1)),
    }
}

/// Shares `total` intervals among the runs so that the longest interval is as short as it can be.
fn share(lengths_mm: &[f64], total: usize) -> Vec<usize> {
    let mut counts = vec![1; lengths_mm.len()];
    for _ in lengths_mm.len()..total {
        let interval_mm = |&i: &usize| lengths_mm[i] / counts[i] as f64;
        let longest = (0..counts.len()).max_by(|a, b| interval_mm(a).total_cmp(&interval_mm(b)));
        if let Some(i) = longest {
            counts[i] += 1;
        }
    }
    counts
}

/// A stretch without a corner: at least two points.
struct Run<'a> {
    points: &'a [PathPoint],
    s_mm: &'a [f64],
}

impl Run<'_> {
    /// The pose at `share` (0..1) of the run's length.
    fn at(&self, share: f64) -> PathPoint {
        let last = self.points.len() - 1;
        let s_mm = self.s_mm[0] + share * (self.s_mm[last] - self.s_mm[0]);
        let i = self.s_mm.partition_point(|&s| s <= s_mm).clamp(1, last);
        let step_mm = self.s_mm[i] - self.s_mm[i - 1];
        let alpha = if step_mm > 0.0 { (s_mm - self.s_mm[i - 1]) / step_mm } else { share };
        PathPoint { s_mm, ..between(&self.points[i - 1], &self.points[i], alpha) }
    }
}

/// Chooses of `q` and `-q`, the same rotation, the one nearer to its predecessor: readers interpolate components.
pub(super) fn keep_signs(points: &mut [PathPoint]) {
    for i in 1..points.len() {
        let previous = points[i - 1].base_from_torch;
        let q = &mut points[i].base_from_torch;
        if previous.coords.dot(&q.coords) < 0.0 {
            *q = UnitQuaternion::new_unchecked(-q.into_inner());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::Process;
    use nalgebra::{Point3, Vector3};
    use std::f64::consts::{FRAC_PI_2, TAU};

    fn path(positions: &[[f64; 3]]) -> SeamPath {
        let at = |p: &[f64; 3]| PathPoint {
            s_mm: 0.0,
            position_mm: Point3::from(*p),
            base_from_torch: UnitQuaternion::identity(),
            process: Process::default(),
        };
        SeamPath { seam: 1, points: positions.iter().map(at).collect() }
    }

    fn circle(radius_mm: f64, points: usize) -> SeamPath {
        let mut path = path(&[]);
        for i in 0..=points {
            let angle = TAU * i as f64 / points as f64;
            let base_from_torch = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            let position_mm = Point3::new(radius_mm * angle.cos(), radius_mm * angle.sin(), 0.0);
            let process = Process::default();
            path.points.push(PathPoint { s_mm: 0.0, position_mm, base_from_torch, process });
        }
        path
    }

    fn steps_mm(path: &SeamPath) -> Vec<f64> {
        path.points.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm()).collect()
    }

    #[test]
    fn a_straight_path_gets_even_steps_and_keeps_both_ends() {
        let sampled =
            resample(&path(&[[0.0; 3], [3.0, 0.0, 0.0], [21.0, 0.0, 0.0]]), Sampling::SpacingMm(2.0));
        assert_eq!(sampled.points.len(), 12); // 21 / 2 rounds to 11 intervals
        assert!(steps_mm(&sampled).iter().all(|step| (step - 21.0 / 11.0).abs() < 1e-9));
        assert_eq!(sampled.points[11].position_mm, Point3::new(21.0, 0.0, 0.0));
        assert!((sampled.points[11].s_mm - 21.0).abs() < 1e-9);
    }

    #[test]
    fn a_sharp_corner_is_a_point_of_the_result() {
        let corner = [10.3, 0.0, 0.0];
        for sampling in [Sampling::SpacingMm(2.0), Sampling::SpacingMm(7.0), Sampling::Points(6)] {
            let sampled = resample(&path(&[[0.0; 3], corner, [10.3, 5.1, 0.0]]), sampling);
            assert!(sampled.points.iter().any(|p| (p.position_mm - Point3::from(corner)).norm() < 1e-12));
            assert!((sampled.length_mm() - 15.4).abs() < 1e-9, "{sampling:?} cuts the corner");
        }
    }

    #[test]
    fn points_are_as_many_as_asked_for_with_corners_or_without() {
        for n in [2, 3, 50, 301] {
            let straight = resample(&path(&[[0.0; 3], [9.0, 0.0, 0.0]]), Sampling::Points(n));
            assert_eq!(straight.points.len(), n);
        }
        let bent = path(&[[0.0; 3], [9.0, 0.0, 0.0], [9.0, 1.0, 0.0]]);
        assert_eq!(resample(&bent, Sampling::Points(20)).points.len(), 20);
        assert_eq!(resample(&bent, Sampling::Points(2)).points.len(), 3, "the corner stays");
    }

    #[test]
    fn a_closed_loop_stays_closed_and_on_its_circle() {
        let sampled = resample(&circle(20.0, 720), Sampling::SpacingMm(2.0));
        let (first, last) = (sampled.points[0], sampled.points[sampled.points.len() - 1]);
        assert!((first.position_mm - last.position_mm).norm() < 1e-9);
        assert!(sampled.points.iter().all(|p| (p.position_mm.coords.norm() - 20.0).abs() < 1e-3));
        let steps = steps_mm(&sampled);
        assert!(steps.iter().all(|step| (step - steps[0]).abs() < 1e-3));
    }

    #[test]
    fn rotations_go_the_shortest_way_with_continuous_signs() {
        let mut source = circle(20.0, 36);
        for point in source.points.iter_mut().step_by(2) {
            point.base_from_torch = UnitQuaternion::new_unchecked(-point.base_from_torch.into_inner());
        }
        let sampled = resample(&source, Sampling::SpacingMm(1.0));
        for w in sampled.points.windows(2) {
            assert!(w[0].base_from_torch.coords.dot(&w[1].base_from_torch.coords) > 0.99);
        }
    }

    #[test]
    fn a_turn_in_place_keeps_both_orientations() {
        let mut source = path(&[[0.0; 3], [10.0, 0.0, 0.0], [10.0, 0.0, 0.0], [20.0, 0.0, 0.0]]);
        let turned = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
        source.points[2].base_from_torch = turned;
        source.points[3].base_from_torch = turned;
        let sampled = resample(&source, Sampling::SpacingMm(5.0));
        assert_eq!(sampled.points.len(), 6);
        assert!(sampled.points[2].base_from_torch.angle() < 1e-9);
        assert!((sampled.points[3].base_from_torch.angle() - FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn resampling_twice_changes_nothing_more() {
        let once = resample(&circle(20.0, 720), Sampling::SpacingMm(2.0));
        let twice = resample(&once, Sampling::SpacingMm(2.0));
        assert_eq!(once.points.len(), twice.points.len());
        for (a, b) in once.points.iter().zip(&twice.points) {
            assert!((a.position_mm - b.position_mm).norm() < 1e-3, "beyond the sagitta of the source");
        }
    }

    #[test]
    fn one_point_or_none_comes_back_as_it_is() {
        assert!(resample(&path(&[]), Sampling::SpacingMm(2.0)).points.is_empty());
        assert_eq!(resample(&path(&[[1.0; 3], [1.0; 3]]), Sampling::Points(9)).points.len(), 1);
    }
}
