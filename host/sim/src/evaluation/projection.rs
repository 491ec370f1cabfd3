//! The place on a true seam that belongs to a path point, and the true torch frame there.

use super::truth::TruthSeam;
use nalgebra::{Matrix3, Vector3};

/// Foot of a path point on the seam's polyline.
pub(super) struct Foot {
    pub(super) point: Vector3<f64>,
    /// Columns `(o, m, n)`.
    pub(super) frame: Matrix3<f64>,
}

/// Index of the nearest station and its distance, mm.
pub(super) fn nearest_station(point: &Vector3<f64>, line: &[[f64; 3]]) -> (usize, f64) {
    let mut best = (0, f64::INFINITY);
    for (i, station) in line.iter().enumerate() {
        let squared = (Vector3::from(*station) - point).norm_squared();
        if squared < best.1 {
            best = (i, squared);
        }
    }
    (best.0, best.1.sqrt())
}

/// Foot of `point` on the two segments beside its nearest station.
pub(super) fn foot(seam: &TruthSeam, line: &[[f64; 3]], point: &Vector3<f64>) -> Foot {
    let (i, _) = nearest_station(point, line);
    let last = line.len() - 1;
    let before = if i > 0 {
        i - 1
    } else if seam.closed {
        last
    } else {
        0
    };
    let after = if i < last {
        i + 1
    } else if seam.closed {
        0
    } else {
        last
    };
    let (first, second) = (Segment::of(line, before, i, point), Segment::of(line, i, after, point));
    let nearer = if second.distance < first.distance { second } else { first };
    Foot { point: nearer.foot, frame: frame(seam, &nearer) }
}

struct Segment {
    ends: [usize; 2],
    /// 0 at the first end, 1 at the second.
    place: f64,
    foot: Vector3<f64>,
    distance: f64,
}

impl Segment {
    fn of(line: &[[f64; 3]], a: usize, b: usize, point: &Vector3<f64>) -> Self {
        let (start, end) = (Vector3::from(line[a]), Vector3::from(line[b]));
        let along = end - start;
        let length_squared = along.norm_squared();
        let place =
            if length_squared > 0.0 { (point - start).dot(&along) / length_squared.max(1e-12) } else { 0.0 };
        let place = place.clamp(0.0, 1.0);
        let foot = start + along * place;
        Self { ends: [a, b], place, foot, distance: (point - foot).norm() }
    }
}

/// The frame between two stations: `n` interpolated, `m` made normal to it.
fn frame(seam: &TruthSeam, segment: &Segment) -> Matrix3<f64> {
    let between = |list: &[[f64; 3]]| {
        let [a, b] = segment.ends.map(|i| Vector3::from(list[i]));
        a * (1.0 - segment.place) + b * segment.place
    };
    let n = between(&seam.n).normalize();
    let t = between(&seam.t);
    let m = (t - n * n.dot(&t)).normalize();
    Matrix3::from_columns(&[m.cross(&n), m, n])
}
