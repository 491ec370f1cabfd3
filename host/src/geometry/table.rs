//! Planes of a cloud, and whether one is a table that the rest stands on.
//!
//! Lengths are millimetres, or whatever the unit of a file is that is not known yet.

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

/// The largest planes through points, by three of them at a time (Fischler and Bolles 1981, *Random sample consensus*): unit
/// normal and level, until fewer than `least_share` of all are left. Points know better than normals, which a thin noisy voxel
/// has hardly any of.
pub fn planes(points: &[Point3<f32>], half_mm: f32, least_share: f32) -> Vec<(Vector3<f32>, f32)> {
    let step = points.len() / CONSENSUS + 1;
    let mut left: Vec<Vector3<f32>> = points.iter().step_by(step).map(|p| p.coords).collect();
    let least = (least_share * left.len() as f32) as usize;
    let mut found = Vec::new();
    while found.len() < PLANES && left.len() > least.max(3) {
        let Some(best) = consensus(&left, half_mm) else { break };
        left.retain(|p| (best.0.dot(p) - best.1).abs() > half_mm);
        found.push(best);
    }
    found
}

/// The plane through three of the points that most of them are near to.
fn consensus(points: &[Vector3<f32>], half_mm: f32) -> Option<(Vector3<f32>, f32)> {
    // Steps of a low-discrepancy sequence: the same triples in every run, and none of them neighbours.
    let index = |k: usize, way: f64| ((k as f64 * way).fract() * points.len() as f64) as usize;
    let triple = |k: usize| {
        let [a, b, c] = TRIPLE_STEPS.map(|way| points[index(k + 1, way)]);
        let normal = (b - a).cross(&(c - a)).try_normalize(half_mm * half_mm)?;
        let near = points.iter().filter(|p| normal.dot(&(*p - a)).abs() < half_mm).count();
        Some((near, (normal, normal.dot(&a))))
    };
    let all: Vec<_> = (0..TRIPLES).into_par_iter().filter_map(triple).collect();
    all.into_iter().max_by_key(|(near, _)| *near).map(|(_, plane)| plane)
}

/// Points among which planes are sought, triples of them that are tried, and planes: of one that holds .15 of the points, seven of the
/// triples are wholly on it.
const CONSENSUS: usize = 4000;
const TRIPLES: usize = 2000;
const PLANES: usize = 6;
/// Powers of the plastic number's inverse: a sequence that fills a cube evenly (Roberts 2018).
const TRIPLE_STEPS: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];

/// The plane fitted to what is near to one: unit normal, facing the same way, and level.
pub fn fitted(
    points: &[Point3<f32>],
    normal: Vector3<f32>,
    level_mm: f32,
    half_mm: f32,
) -> (Vector3<f32>, f32) {
    const ROUNDS: usize = 3;
    let (mut up, mut level_mm) = (normal, level_mm);
    for _ in 0..ROUNDS {
        let on = points.iter().filter(|p| (p.coords.dot(&up) - level_mm).abs() < 2.0 * half_mm);
        let on: Vec<Vector3<f32>> = on.map(|p| p.coords).collect();
        let mean = on.iter().sum::<Vector3<f32>>() / on.len().max(1) as f32;
        let scatter: Matrix3<f32> = on.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
        let eigen = scatter.symmetric_eigen();
        let axis = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        up = if axis.dot(&up) < 0.0 { -axis } else { axis };
        level_mm = up.dot(&mean);
    }
    (up, level_mm)
}

/// Ways in which one looks along a plane.
pub const WAYS: usize = 16;

/// Whether the plane at `level_mm` along `up` reaches farther than what stands on it, whichever way one looks along it: a
/// table, and not the plate of a T joint that was cut out. Half its thickness is `half_mm`.
pub fn surrounds(points: &[Point3<f32>], up: &Vector3<f32>, level_mm: f32, half_mm: f32) -> bool {
    const MARGIN_MM: f32 = 10.0;
    ahead_mm(points, up, level_mm, half_mm, MOST_FLYING).iter().all(|ahead| *ahead > MARGIN_MM)
}

/// The ways along a plane that faces `up`.
pub fn ways(up: &Vector3<f32>) -> [Vector3<f32>; WAYS] {
    let mut aside = Vector3::zeros();
    aside[up.iamin()] = 1.0;
    let a = up.cross(&aside).normalize();
    let b = up.cross(&a);
    std::array::from_fn(|k| {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / WAYS as f32).sin_cos();
        a * cos + b * sin
    })
}

/// Share of what stands over a table that may be stray, as far out as the picture reaches: 0.1 to 0.3 % in single simulated views.
const MOST_FLYING: f32 = 0.005;

/// By how much the plane at `level_mm` along `up` reaches farther than what stands on it, but for its outermost `share`, in ways
/// all round, mm.
fn ahead_mm(
    points: &[Point3<f32>],
    up: &Vector3<f32>,
    level_mm: f32,
    half_mm: f32,
    share: f32,
) -> [f32; WAYS] {
    let height = |p: &Point3<f32>| p.coords.dot(up) - level_mm;
    let of = |is_such: &dyn Fn(f32) -> bool| -> Vec<Vector3<f32>> {
        points.iter().filter(|p| is_such(height(p))).map(|p| p.coords).collect()
    };
    let plane = of(&|height| height.abs() < half_mm);
    let standing = of(&|height| height > STANDS * half_mm);
    let outermost = (share * standing.len() as f32) as usize;
    ways(up).map(|way| {
        let reach = plane.iter().map(|p| way.dot(p)).fold(f32::MIN, f32::max);
        let mut along: Vec<f32> = standing.iter().map(|p| way.dot(p)).collect();
        if along.is_empty() {
            return f32::INFINITY;
        }
        reach - *along.select_nth_unstable_by(outermost, |a, b| b.total_cmp(a)).1
    })
}

/// Largest share of all points behind a table, and least on it that stands.
const MOST_BEHIND: f32 = 0.01;
const LEAST_STANDING: f32 = 0.005;
/// Lower than this it may be the table's own noise, half thicknesses.
pub const STANDS: f32 = 3.0;

/// Whether hardly anything lies behind the plane at `level_mm` along `up`, and something before it.
pub fn stands_on(points: &[Point3<f32>], up: &Vector3<f32>, level_mm: f32, half_mm: f32) -> bool {
    let heights = || points.iter().map(|p| (p.coords.dot(up) - level_mm) / half_mm);
    let total = points.len() as f32;
    heights().filter(|h| *h < -STANDS).count() as f32 <= MOST_BEHIND * total
        && heights().filter(|h| *h > STANDS).count() as f32 > LEAST_STANDING * total
}

/// Whether the plane at `level_mm` along `up` is a table on which the rest stands, and not one that the rest is sunk into: along no
/// line does what stands reach its border, or that of the picture, at both ends. A groove from border to border does.
pub fn carries(points: &[Point3<f32>], up: &Vector3<f32>, level_mm: f32, half_mm: f32) -> bool {
    let ahead = ahead_mm(points, up, level_mm, half_mm, 0.0).map(|ahead| ahead > 2.0 * half_mm);
    (0..WAYS / 2).all(|k| ahead[k] || ahead[k + WAYS / 2])
}
