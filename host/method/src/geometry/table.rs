//! Planes of a cloud, and whether one is a table that the rest stands on.
//!
//! Lengths are millimetres, or whatever the unit of a file is that is not known yet.

use crate::geometry::cloud::Picture;
use crate::geometry::columns::Columns;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rayon::prelude::*;
use wide::f32x8;

/// The largest planes through points, by three of them at a time (Fischler and Bolles 1981, *Random sample consensus*): unit
/// normal and level, until fewer than `least_share` of all are left. Points know better than normals, which a thin noisy voxel
/// has hardly any of.
pub fn planes(points: &[Point3<f32>], half_mm: f32, least_share: f32) -> Vec<(Vector3<f32>, f32)> {
    let mut left = sample(points);
    let least = (least_share * left.len() as f32) as usize;
    let mut found = Vec::new();
    while found.len() < PLANES && left.len() > least.max(3) {
        let Some(best) = consensus(&left, half_mm) else { break };
        left.retain(|p| (best.0.dot(p) - best.1).abs() > half_mm);
        found.push(best);
    }
    found
}

/// The first of them; none of fewer than three points.
pub(crate) fn largest_plane(points: &[Point3<f32>], half_mm: f32) -> Option<(Vector3<f32>, f32)> {
    (points.len() > 2).then(|| consensus(&sample(points), half_mm))?
}

fn sample(points: &[Point3<f32>]) -> Vec<Vector3<f32>> {
    points.iter().step_by(points.len() / CONSENSUS + 1).map(|p| p.coords).collect()
}

/// The plane through three of the points that most of them are near to.
fn consensus(points: &[Vector3<f32>], half_mm: f32) -> Option<(Vector3<f32>, f32)> {
    let columns = Columns::new(points);
    // Steps of a low-discrepancy sequence: the same triples in every run, and none of them neighbours.
    let index = |k: usize, way: f64| ((k as f64 * way).fract() * points.len() as f64) as usize;
    let triple = |k: usize| {
        let [a, b, c] = TRIPLE_STEPS.map(|way| points[index(k + 1, way)]);
        let normal = (b - a).cross(&(c - a)).try_normalize(half_mm * half_mm)?;
        let level_mm = normal.dot(&a);
        let near =
            |first: usize| (columns.along(first, &normal) - level_mm).abs().simd_lt(f32x8::splat(half_mm));
        let count = |first| (near(first).to_bitmask() & columns.present(first)).count_ones();
        let near: u32 = columns.eights().map(count).sum();
        Some((near, (normal, level_mm)))
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
pub(crate) const WAYS: usize = 16;

/// Whether the plane at `level_mm` along `up` reaches farther than what stands on it, whichever way one looks along it: a
/// table, and not the plate of a T joint that was cut out. Half its thickness is `half_mm`.
pub(crate) fn surrounds(points: &[Point3<f32>], up: &Vector3<f32>, level_mm: f32, half_mm: f32) -> bool {
    const MARGIN_MM: f32 = 10.0;
    ahead_mm(points, up, level_mm, half_mm, MOST_FLYING).iter().all(|ahead| *ahead > MARGIN_MM)
}

/// The ways along a plane that faces `up`.
pub fn ways(up: &Vector3<f32>) -> [Vector3<f32>; WAYS] {
    let [a, b] = axes(up);
    std::array::from_fn(|k| {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / WAYS as f32).sin_cos();
        a * cos + b * sin
    })
}

/// Two unit vectors along the plane that faces `up`.
pub fn axes(up: &Vector3<f32>) -> [Vector3<f32>; 2] {
    let mut aside = Vector3::zeros();
    aside[up.iamin()] = 1.0;
    let a = up.cross(&aside).normalize();
    [a, up.cross(&a)]
}

/// Share of what stands over a table that may be stray, as far out as the picture reaches: 0.1 to 0.3 % in single simulated views.
const MOST_FLYING: f32 = 0.005;

/// How far points reach one way, but for the outermost half percent, mm; none without points.
pub fn reach_mm(points: &[Point3<f32>], way: &Vector3<f32>) -> Option<f32> {
    outermost(points.iter().map(|p| way.dot(&p.coords)).collect(), MOST_FLYING)
}

/// How wide points lie along a plane that faces `up`, the way they are narrowest, mm; none without points.
pub fn width_mm(points: &[Point3<f32>], up: &Vector3<f32>) -> Option<f32> {
    let across = ways(up).into_iter().take(WAYS / 2);
    across.filter_map(|way| Some(reach_mm(points, &way)? + reach_mm(points, &-way)?)).reduce(f32::min)
}

/// The greatest of some lengths, but for a share of them.
fn outermost(mut along_mm: Vec<f32>, share: f32) -> Option<f32> {
    let beyond = (share * along_mm.len() as f32) as usize;
    (beyond < along_mm.len()).then(|| *along_mm.select_nth_unstable_by(beyond, |a, b| b.total_cmp(a)).1)
}

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
    ways(up).map(|way| {
        let reach = plane.iter().map(|p| way.dot(p)).fold(f32::MIN, f32::max);
        let standing = outermost(standing.iter().map(|p| way.dot(p)).collect(), share);
        standing.map_or(f32::INFINITY, |standing| reach - standing)
    })
}

/// Largest share of all points behind a table, and least on it that stands.
const MOST_BEHIND: f32 = 0.01;
const LEAST_STANDING: f32 = 0.005;
/// Lower than this it may be the table's own noise, half thicknesses.
pub(crate) const STANDS: f32 = 3.0;

/// Whether hardly anything lies behind the plane at `level_mm` along `up`, and something before it.
pub fn stands_on(points: &[Point3<f32>], up: &Vector3<f32>, level_mm: f32, half_mm: f32) -> bool {
    let heights = || points.iter().map(|p| (p.coords.dot(up) - level_mm) / half_mm);
    let total = points.len() as f32;
    heights().filter(|h| *h < -STANDS).count() as f32 <= MOST_BEHIND * total
        && heights().filter(|h| *h > STANDS).count() as f32 > LEAST_STANDING * total
}

/// Whether the plane at `level_mm` along `up` is a table on which the rest stands, and not one that the rest is sunk into: along no
/// line does what stands reach its border, or that of the picture, at both ends. A groove from border to border does.
pub(crate) fn carries(points: &[Point3<f32>], up: &Vector3<f32>, level_mm: f32, half_mm: f32) -> bool {
    let ahead = ahead_mm(points, up, level_mm, half_mm, 0.0).map(|ahead| ahead > 2.0 * half_mm);
    (0..WAYS / 2).all(|k| ahead[k] || ahead[k + WAYS / 2])
}

/// Where what is on a plane ends in the picture that one camera took of it. What hides some of it is neither.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Rim {
    /// Length at the sides of the picture, in cells.
    cut: usize,
    /// Length within the picture, where nothing is seen beyond it as far as a side.
    ends: usize,
}

impl Rim {
    /// Of all pictures together.
    pub(crate) fn of_all(rims: impl Iterator<Item = Self>) -> Self {
        rims.fold(Self::default(), |sum, rim| Self { cut: sum.cut + rim.cut, ends: sum.ends + rim.ends })
    }

    /// Whether the pictures end before the plane does: the border of a table is far away, that of a plate is seen.
    pub(crate) const fn is_far(self) -> bool {
        self.cut > self.ends
    }
}

/// Where what is on a plane ends in the picture that one camera took of it.
pub(crate) fn rim(
    points: &[Point3<f32>],
    cloud_from_camera: &Isometry3<f32>,
    picture: Option<Picture>,
    is_on: impl Fn(&Point3<f32>) -> bool,
) -> Rim {
    let camera_from_cloud = cloud_from_camera.inverse();
    let ray = |p: &Point3<f32>| {
        let p = camera_from_cloud * p;
        (p.z > 0.0).then(|| [p.x / p.z, p.y / p.z])
    };
    let rays: Vec<([f32; 2], bool)> = points.iter().filter_map(|p| Some((ray(p)?, is_on(p)))).collect();
    let Some(&(first, _)) = rays.first() else { return Rim::default() };
    let (low, high) = rays.iter().fold((first, first), |(low, high), (ray, _)| {
        ([0, 1].map(|k| low[k].min(ray[k])), [0, 1].map(|k| high[k].max(ray[k])))
    });
    let (low, high) = picture.map_or((low, high), |picture| picture.around(low, high));
    let sides = [high[0] - low[0], high[1] - low[1]];
    let cell = (sides[0] * sides[1] * POINTS_TO_CELL / points.len() as f32).sqrt();
    let cell = cell.max(sides[0].max(sides[1]) / MOST_CELLS);
    let [wide, high] = sides.map(|side| (side / cell) as usize + 1);
    let mut cells = vec![(0u32, 0u32); wide * high];
    for (ray, on) in rays {
        let [x, y] = [0, 1].map(|k| ((ray[k] - low[k]) / cell) as usize);
        let (seen, of_plane) = &mut cells[y * wide + x];
        *seen += 1;
        *of_plane += u32::from(on);
    }
    let at = |x: usize, y: usize| (x < wide && y < high).then(|| cells[y * wide + x]);
    let is_side = |places: &mut dyn Iterator<Item = (usize, usize)>| {
        let seen: Vec<bool> = places.map(|(x, y)| at(x, y).is_some_and(|(seen, _)| seen > 0)).collect();
        2 * seen.iter().filter(|seen| **seen).count() > seen.len()
    };
    let is_side = [
        is_side(&mut (0..high).map(|y| (0, y))),
        is_side(&mut (0..high).map(|y| (wide - 1, y))),
        is_side(&mut (0..wide).map(|x| (x, 0))),
        is_side(&mut (0..wide).map(|x| (x, high - 1))),
    ];
    let open = open(&cells.iter().map(|(seen, _)| *seen == 0).collect::<Vec<_>>(), wide);
    let mut rim = Rim::default();
    for (x, y) in (0..high).flat_map(|y| (0..wide).map(move |x| (x, y))) {
        if at(x, y).is_none_or(|(seen, of_plane)| 2 * of_plane <= seen) {
            continue;
        }
        let beyond = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
        for ((x, y), is_side) in beyond.into_iter().zip(is_side) {
            match at(x, y) {
                None if is_side => rim.cut += 1,
                None => rim.ends += 1,
                Some((0, _)) => rim.ends += usize::from(open[y * wide + x]),
                Some(_) => {}
            }
        }
    }
    rim
}

/// Of the empty cells of a picture so many cells wide, those from which empty ones lead to a side. Where the plane ends, nothing is seen
/// from there on; the others are holes in it: what something hides from one eye or both, and what a camera loses.
fn open(empty: &[bool], wide: usize) -> Vec<bool> {
    let mut open = vec![false; empty.len()];
    let is_side = |k: &usize| {
        k.is_multiple_of(wide) || (k + 1).is_multiple_of(wide) || *k < wide || k + wide >= empty.len()
    };
    let mut next: Vec<usize> = (0..empty.len()).filter(|k| empty[*k] && is_side(k)).collect();
    while let Some(k) = next.pop() {
        if !std::mem::replace(&mut open[k], true) {
            let beside = [(k % wide > 0).then(|| k - 1), (k % wide + 1 < wide).then_some(k + 1)];
            let over = [k.checked_sub(wide), (k + wide < empty.len()).then_some(k + wide)];
            next.extend(beside.into_iter().chain(over).flatten().filter(|&k| empty[k] && !open[k]));
        }
    }
    open
}

impl Picture {
    /// The least and largest slopes that a picture shows whose outermost points have these. What ends far from a side of the sensor
    /// ends within the picture; nearer to it, a camera may have no readings.
    fn around(&self, low: [f32; 2], high: [f32; 2]) -> ([f32; 2], [f32; 2]) {
        let wide = [0, 1].map(|k| BLIND * (self.high[k] - self.low[k]));
        let low = [0, 1].map(|k| if low[k] - self.low[k] < wide[k] { low[k] } else { self.low[k] });
        let high = [0, 1].map(|k| if self.high[k] - high[k] < wide[k] { high[k] } else { self.high[k] });
        (low, high)
    }
}

/// Widest strip at a side of a sensor without readings, as a share of the picture: the disparities that a stereo camera searches.
const BLIND: f32 = 0.15;
/// Points to a cell of the picture, in the mean: fewer leave holes that pass for borders; and the most cells along it.
const POINTS_TO_CELL: f32 = 10.0;
const MOST_CELLS: f32 = 64.0;

#[cfg(test)]
mod tests {
    use super::*;

    impl Picture {
        fn times(self, by: f32) -> Self {
            Self { low: self.low.map(|slope| by * slope), high: self.high.map(|slope| by * slope) }
        }
    }

    /// A camera 400 mm over a floor of so many mm a side, of which it sees 400 x 300 mm, and a post on it; in the corners of its
    /// picture something below.
    fn leaves(side_mm: f32, picture: Option<Picture>) -> bool {
        const STEP_MM: f32 = 4.0;
        let across = |mm: f32| (0..(mm / STEP_MM) as i32).map(move |k| STEP_MM * (k as f32 + 0.5) - 0.5 * mm);
        let all = across(400.0).flat_map(|x| across(300.0).map(move |y| (x, y)));
        let is_post = |x: f32, y: f32| (30.0..60.0).contains(&x) && y.abs() < 40.0;
        let is_below = |x: f32, y: f32| x.abs() > 190.0 && y.abs() > 140.0;
        let at = |(x, y): (f32, f32)| {
            // On the same ray at a height of 80 mm.
            if is_post(x, y) {
                Point3::new(0.8 * x, 0.8 * y, 80.0)
            } else if is_below(x, y) {
                Point3::new(1.2 * x, 1.2 * y, -80.0)
            } else {
                Point3::new(x, y, 0.0)
            }
        };
        let is_there = |(x, y): &(f32, f32)| x.abs().max(y.abs()) < 0.5 * side_mm || is_below(*x, *y);
        let points: Vec<Point3<f32>> = all.filter(is_there).map(at).collect();
        let down = Isometry3::rotation(Vector3::x() * std::f32::consts::PI);
        let camera = Isometry3::translation(0.0, 0.0, 400.0) * down;
        rim(&points, &camera, picture, |p| p.z.abs() < 1.0).is_far()
    }

    #[test]
    fn a_table_leaves_the_picture_and_a_plate_does_not() {
        assert!(leaves(1000.0, None), "it ends nowhere in it");
        assert!(leaves(330.0, None), "it ends on two sides, which are the shorter ones");
        assert!(!leaves(250.0, None), "it ends within it all round");
        let picture = |wider: f32| Some(Picture { low: [-0.5, -0.375], high: [0.5, 0.375] }.times(wider));
        assert!(leaves(1000.0, picture(1.0)) && leaves(330.0, picture(1.0)));
        assert!(leaves(1000.0, picture(1.1)), "a camera may see nothing at the sides of its sensor");
        assert!(!leaves(1000.0, picture(2.0)), "what fills all that was seen ends in a larger picture");
        let holes: Vec<bool> =
            "##.## #..## ##### #.#.# #####".split(' ').flat_map(str::bytes).map(|b| b == b'.').collect();
        let found = open(&holes, 5).iter().filter(|open| **open).count();
        assert_eq!(found, 3, "of six empty cells those in the middle of the first row and below it lead out");
        assert!(!rim(&[], &Isometry3::identity(), None, |_| true).is_far(), "nothing is seen");
    }
}
