//! The ends of a path (ours): extend or shorten, lead-in and lead-out, dwell, reverse.

use nalgebra::{UnitQuaternion, Vector3};

use super::resampling::arc_lengths_mm;
use super::{PathPoint, Process, SeamPath, at};

/// Adds `start_mm` before the start and `end_mm` beyond the end, welded; negative lengths shorten. An open path goes on
/// straight, a closed one on its own line, so that it overlaps itself. What is shortened away altogether has no points.
pub fn extend(path: &SeamPath, start_mm: f64, end_mm: f64) -> SeamPath {
    if path.points.len() < 2 || start_mm == 0.0 && end_mm == 0.0 {
        return path.clone();
    }
    let measured = path.points.iter().zip(arc_lengths_mm(&path.points));
    let path = &path.with(measured.map(|(point, s_mm)| PathPoint { s_mm, ..*point }).collect());
    let [first, .., last] = path.points.as_slice() else { return path.clone() };
    let (from_mm, to_mm) = (first.s_mm - start_mm, last.s_mm + end_mm);
    if from_mm >= to_mm {
        return path.with(Vec::new());
    }
    let whole =
        if path.is_closed() { rounds(path, from_mm, to_mm) } else { straight_on(path, from_mm, to_mm) };
    path.with(cut(&whole, from_mm, to_mm))
}

/// Unit vectors along the travel at the start and at the end; none for a path that goes nowhere.
pub fn directions(path: &SeamPath) -> Option<[Vector3<f64>; 2]> {
    let [first, next, ..] = path.points.as_slice() else { return None };
    let [.., previous, last] = path.points.as_slice() else { return None };
    let ahead = |a: &PathPoint, b: &PathPoint| (b.position_mm - a.position_mm).try_normalize(1e-9);
    Some([ahead(first, next)?, ahead(previous, last)?])
}

/// Adds `in_mm` before the start and `out_mm` beyond the end, along `directions`, with the arc off. The directions are
/// those of the line: a weave goes another way at its ends.
pub(crate) fn lead(path: &SeamPath, directions: &[Vector3<f64>; 2], in_mm: f64, out_mm: f64) -> SeamPath {
    let ([first, ..], [.., last]) = (path.points.as_slice(), path.points.as_slice()) else {
        return path.clone();
    };
    let before = along(first, &directions[0], -in_mm);
    let beyond = along(last, &directions[1], out_mm);
    let cold =
        |point: PathPoint| PathPoint { process: Process { weld: false, ..Process::default() }, ..point };
    let mut points: Vec<PathPoint> = Vec::with_capacity(path.points.len() + 2);
    points.extend((in_mm > 0.0).then(|| cold(before)));
    points.extend(&path.points);
    points.extend((out_mm > 0.0).then(|| cold(beyond)));
    path.with(points)
}

/// Stands still with the arc on: `start_s` where an arc is struck, `end_s` where it is put out (the crater), on every
/// stretch that is welded. 0 leaves the point as it is.
pub fn dwell(mut path: SeamPath, start_s: f64, end_s: f64) -> SeamPath {
    let welds: Vec<bool> = path.points.iter().map(|point| point.process.weld).collect();
    let weld = |k: Option<usize>| k.and_then(|k| welds.get(k)).copied().unwrap_or(false);
    for (k, point) in path.points.iter_mut().enumerate().filter(|(k, _)| welds[*k]) {
        if start_s > 0.0 && !weld(k.checked_sub(1)) {
            point.process.dwell_s = Some(start_s);
        }
        if end_s > 0.0 && !weld(Some(k + 1)) {
            point.process.dwell_s = Some(end_s);
        }
    }
    path
}

/// The same path from its end to its start: the travel turns round, the torch axis stays.
pub fn reverse(path: &SeamPath) -> SeamPath {
    let [first, .., last] = path.points.as_slice() else { return path.clone() };
    let half_round = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    let sum_mm = first.s_mm + last.s_mm;
    let turned = path.points.iter().rev().map(|point| PathPoint {
        s_mm: sum_mm - point.s_mm,
        base_from_torch: point.base_from_torch * half_round,
        ..*point
    });
    path.with(turned.collect())
}

/// What is left of a path from `from_mm` on. Where it begins the torch stands as at the start of the whole.
pub fn rest(path: &SeamPath, from_mm: f64) -> SeamPath {
    let Some(next) = path.points.iter().position(|point| point.s_mm > from_mm) else {
        return path.with(Vec::new());
    };
    if next == 0 {
        return path.clone();
    }
    let struck = path.points.iter().find(|point| point.process.weld).and_then(|point| point.process.dwell_s);
    let begin = at(&path.points, from_mm).map(|point| {
        let weld = path.points[next - 1].process.weld && path.points[next].process.weld;
        let dwell_s = struck.filter(|_| weld);
        PathPoint { process: Process { weld, dwell_s, ..Process::default() }, ..point }
    });
    path.with(begin.into_iter().chain(path.points[next..].iter().copied()).collect())
}

/// The pose moved along a direction; its `s_mm` goes with it.
fn along(point: &PathPoint, direction: &Vector3<f64>, by_mm: f64) -> PathPoint {
    let position_mm = point.position_mm + direction * by_mm;
    PathPoint { s_mm: point.s_mm + by_mm, position_mm, ..*point }
}

/// An open path with what is missing at its ends.
fn straight_on(path: &SeamPath, from_mm: f64, to_mm: f64) -> Vec<PathPoint> {
    let Some([start, end]) = directions(path) else { return path.points.clone() };
    let (first, last) = (path.points[0], path.points[path.points.len() - 1]);
    let mut whole = path.points.clone();
    if from_mm < first.s_mm {
        whole.insert(0, along(&first, &start, from_mm - first.s_mm));
    }
    if to_mm > last.s_mm {
        whole.push(along(&last, &end, to_mm - last.s_mm));
    }
    whole
}

/// A closed path run through as often as it takes.
fn rounds(path: &SeamPath, from_mm: f64, to_mm: f64) -> Vec<PathPoint> {
    let last = path.points.len() - 1;
    let (first_mm, last_mm) = (path.points[0].s_mm, path.points[last].s_mm);
    let round_mm = (last_mm - first_mm).max(1e-3);
    // A closed seam is welded a few rounds at most: the bound keeps a typing error from filling the memory.
    let earliest = ((from_mm - first_mm) / round_mm).floor().clamp(-8.0, 0.0) as i32;
    let latest = ((to_mm - last_mm) / round_mm).ceil().clamp(0.0, 8.0) as i32;
    let shifted = |round: i32| {
        let kept = if round < latest { &path.points[..last] } else { &path.points[..] };
        kept.iter().map(move |point| PathPoint { s_mm: point.s_mm + f64::from(round) * round_mm, ..*point })
    };
    (earliest..=latest).flat_map(shifted).collect()
}

/// The points between two lengths, and the poses at these.
fn cut(points: &[PathPoint], from_mm: f64, to_mm: f64) -> Vec<PathPoint> {
    let inside = points.iter().filter(|point| point.s_mm > from_mm && point.s_mm < to_mm);
    let mut kept: Vec<PathPoint> = at(points, from_mm).into_iter().collect();
    kept.extend(inside);
    kept.extend(at(points, to_mm));
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use std::f64::consts::TAU;

    fn line() -> SeamPath {
        let at = |i: i32| PathPoint {
            s_mm: 2.0 * f64::from(i),
            position_mm: Point3::new(5.0, 2.0 * f64::from(i), 1.0),
            base_from_torch: UnitQuaternion::identity(),
            process: Process::default(),
        };
        SeamPath { seam: 1, points: (0..=10).map(at).collect() }
    }

    fn ahead() -> [Vector3<f64>; 2] {
        directions(&line()).unwrap()
    }

    fn circle() -> SeamPath {
        let at = |i: u32| {
            let angle = TAU * f64::from(i) / 360.0;
            PathPoint {
                s_mm: 20.0 * angle,
                position_mm: Point3::new(20.0 * angle.cos(), 20.0 * angle.sin(), 0.0),
                base_from_torch: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle),
                process: Process::default(),
            }
        };
        SeamPath { seam: 1, points: (0..=360).map(at).collect() }
    }

    fn ends_mm(path: &SeamPath) -> [Point3<f64>; 2] {
        [path.points[0].position_mm, path.points[path.points.len() - 1].position_mm]
    }

    #[test]
    fn an_extended_line_is_longer_by_what_was_asked_and_still_a_line() {
        let longer = extend(&line(), 3.0, 4.5);
        assert!((longer.length_mm() - 27.5).abs() < 1e-12);
        assert_eq!(ends_mm(&longer), [Point3::new(5.0, -3.0, 1.0), Point3::new(5.0, 24.5, 1.0)]);
        assert_eq!(longer.points[0].s_mm, -3.0, "lengths stay those of the seam");
    }

    #[test]
    fn shortening_undoes_extending_and_takes_no_more_than_there_is() {
        let back = extend(&extend(&line(), 3.0, 4.5), -3.0, -4.5);
        assert!((back.length_mm() - 20.0).abs() < 1e-9);
        assert!(extend(&line(), -12.0, -8.0).points.is_empty());
        assert_eq!(extend(&line(), 0.0, 0.0).points, line().points);
    }

    #[test]
    fn a_closed_path_overlaps_itself_on_its_own_circle() {
        let over = extend(&circle(), 5.0, 10.0);
        assert!((over.length_mm() - TAU * 20.0 - 15.0).abs() < 0.01);
        assert!(over.points.iter().all(|p| (p.position_mm.coords.norm() - 20.0).abs() < 1e-3));
        let angle = |p: Point3<f64>| p.y.atan2(p.x);
        let [first, last] = ends_mm(&over);
        assert!((angle(first) + 0.25).abs() < 1e-4 && (angle(last) - 0.5).abs() < 1e-4);
        let steps = over.points.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm());
        assert!(steps.into_iter().all(|step| step > 1e-9 && step < 0.36), "no place twice, no jump");
    }

    #[test]
    fn leads_are_straight_and_cold() {
        let led = lead(&line(), &ahead(), 6.0, 2.0);
        assert_eq!(ends_mm(&led), [Point3::new(5.0, -6.0, 1.0), Point3::new(5.0, 22.0, 1.0)]);
        let welds: Vec<bool> = led.points.iter().map(|p| p.process.weld).collect();
        assert!(!welds[0] && !welds[12] && welds[1..12].iter().all(|weld| *weld));
        assert_eq!(lead(&line(), &ahead(), 0.0, 0.0).points, line().points);
    }

    #[test]
    fn directions_are_those_of_the_travel_at_both_ends() {
        assert_eq!(ahead(), [Vector3::y(); 2]);
        let [start, end] =
            directions(&SeamPath { seam: 1, points: circle().points[..=90].to_vec() }).unwrap();
        assert!((start - Vector3::y()).norm() < 0.01 && (end + Vector3::x()).norm() < 0.01);
        assert_eq!(directions(&SeamPath { seam: 1, points: vec![line().points[0]; 2] }), None);
    }

    #[test]
    fn the_torch_stands_at_both_ends_of_every_welded_stretch_and_nowhere_else() {
        let mut path = lead(&line(), &ahead(), 6.0, 0.0);
        path.points[5].process.weld = false;
        let once = dwell(path, 0.4, 0.7);
        let dwells: Vec<_> =
            once.points.iter().enumerate().filter_map(|(k, p)| Some((k, p.process.dwell_s?))).collect();
        assert_eq!(dwells, [(1, 0.4), (4, 0.7), (6, 0.4), (11, 0.7)]);
        assert_eq!(dwell(once.clone(), 0.4, 0.7).points, once.points, "once is enough");
    }

    #[test]
    fn reversing_turns_the_travel_round_and_keeps_the_torch_axis() {
        let back = reverse(&circle());
        for (a, b) in circle().points.iter().zip(back.points.iter().rev()) {
            assert_eq!(a.position_mm, b.position_mm);
            assert!((a.out_of_work() - b.out_of_work()).norm() < 1e-9);
            assert!((a.along_travel() + b.along_travel()).norm() < 1e-9);
        }
        assert!(back.points.windows(2).all(|w| w[1].s_mm > w[0].s_mm));
        let twice = reverse(&back);
        for (a, b) in circle().points.iter().zip(&twice.points) {
            assert!(a.base_from_torch.angle_to(&b.base_from_torch) < 1e-7 && (a.s_mm - b.s_mm).abs() < 1e-9);
        }
    }
}
