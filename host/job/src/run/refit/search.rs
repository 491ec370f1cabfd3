//! Where the part may be: poses from which it is looked for, and the most promising ones.

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::alignment::{about, align};
use super::part::{Part, sample};
use super::target::{Target, share};
use super::{FOUND_MM, NEARLY};
use weldpath_method::geometry::cloud::PointCloud;

/// Points of the model in the search.
const COARSE_POINTS: usize = 200;
/// Largest distances of a pair, mm, one round after another.
const COARSE_GATES_MM: [f32; 4] = [60.0, 40.0, 20.0, 10.0];
/// Candidates of the search that are aligned finely.
const FINALISTS: usize = 4;
/// Share of the model found from which the search stops.
const GOOD: f64 = 0.9;

/// The most promising poses of a search with few points, which stops where it finds the part.
pub(super) fn candidates(part: &Part, new: &PointCloud) -> Vec<Isometry3<f64>> {
    let target = Target::new(new, 6.0);
    let few = sample(&part.surface, COARSE_POINTS);
    let starts = starts(&part.centre);
    let (mut found, mut begin): (Vec<(f64, Isometry3<f64>)>, usize) = (Vec::new(), 0);
    for end in [1, 13, starts.len()] {
        let search = |start: &Isometry3<f64>| {
            let pose = align(&few, &target, start, &part.centre, &COARSE_GATES_MM);
            (share(&few, &target, &pose, 2.0 * FOUND_MM), pose)
        };
        found.par_extend(starts[begin..end].par_iter().map(search));
        begin = end;
        if found.iter().any(|(share, _)| *share >= GOOD) {
            break;
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().take(FINALISTS).map(|(_, pose)| pose).collect()
}

/// Of the poses that are nearly as good as the best, the one that moves the welds least.
pub(super) fn smallest(poses: &[(f64, Isometry3<f64>)], welds: &[Point3<f64>]) -> Option<Isometry3<f64>> {
    let best = poses.iter().map(|(quality, _)| *quality).fold(0.0, f64::max);
    let alike = poses.iter().filter(|(quality, _)| *quality >= best - NEARLY).map(|(_, pose)| *pose);
    let still = Isometry3::identity();
    alike.min_by(|a, b| apart_mm(a, &still, welds).total_cmp(&apart_mm(b, &still, welds)))
}

/// Largest distance of a weld point between two poses, mm.
pub(super) fn apart_mm(a: &Isometry3<f64>, b: &Isometry3<f64>, welds: &[Point3<f64>]) -> f64 {
    welds.iter().map(|p| (a * p - b * p).norm()).fold(0.0, f64::max)
}

/// Poses from which the search begins, those first that are one motion: turns about the middle of the part by none or 14
/// degrees about x, y or z, where it was and 30 mm to every side.
fn starts(centre: &Point3<f64>) -> Vec<Isometry3<f64>> {
    let mut six = vec![Vector3::zeros()];
    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
        six.extend([axis, -axis]);
    }
    let mut pairs: Vec<(usize, usize)> =
        (0..7).flat_map(|turn| (0..7).map(move |side| (turn, side))).collect();
    pairs.sort_by_key(|&(turn, side)| usize::from(turn > 0) + usize::from(side > 0));
    let start =
        |(turn, side): (usize, usize)| about(centre, &(six[turn] * 14f64.to_radians()), &(six[side] * 30.0));
    pairs.into_iter().map(start).collect()
}
