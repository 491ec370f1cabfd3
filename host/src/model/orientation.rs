//! Orientation of surfaces where no camera is known (ours; the paper's clouds come with their camera): which of their two sides
//! looks into free space, seen from round the part.
//!
//! The cloud is looked at from far away in many directions. What such a look sees of a surface it sees from its air side; the
//! inside of a plate is hidden by the plate. What was scanned on a table says nothing from below, where nothing was scanned:
//! a plane with nothing behind it, on which the rest stands, is looked at from the side of the rest alone. None of this
//! knows an axis or a unit: only the voxels.

use crate::geometry::grid::Grid;
use crate::model::downsampling::Voxels;
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Directions all round.
const LOOKS: usize = 96;
/// Sine of the least height of a look over a table.
const LEAST_HEIGHT: f32 = 0.12;
/// Edge of a pixel and depth by which what is seen in it may differ, voxels.
const PIXEL_VOXELS: f32 = 1.5;
const DEPTH_VOXELS: f32 = 1.2;
/// Cosine of the steepest angle at which a surface is seen.
const LEAST_COSINE: f32 = 0.2;
/// Neighbours within so many voxels have a say on a side.
const REACH_VOXELS: f32 = 2.5;
/// Share of the pixels along one axis of a look at most: stray points are off the picture.
const MOST_PIXELS: f32 = 2048.0;
/// Given sides are right, or all wrong, if this share of what is seen says so.
const AGREES: f32 = 0.85;

/// What was found of the sides.
#[derive(Debug, Clone, Default)]
pub struct Orientation {
    /// The normals, out of the material.
    pub normals: Vec<Vector3<f32>>,
    /// Which of them nothing was known of.
    pub unknown: Vec<bool>,
    /// Whether the cloud looks alike from over and from below, and is taken as seen from above, +z.
    pub assumed: bool,
    /// Share of the given sides that what is seen bears out; none if none were given.
    pub borne_out: Option<f32>,
}

impl Orientation {
    /// What the user should know.
    pub fn words(&self) -> Option<String> {
        let share = self.borne_out.filter(|share| *share <= AGREES)?;
        Some(if share < 1.0 - AGREES {
            "the normals in the file point into the material: they were turned over".into()
        } else {
            format!(
                "the normals in the file face either side ({:.0} % face the air): their sides were found from what is seen from \
                 round the part",
                100.0 * share
            )
        })
    }
}

/// The sides of a thinned cloud; `given` says whether its normals came with sides, which then are only checked.
pub fn seen(voxels: &Voxels, given: bool) -> Orientation {
    let normals = &voxels.cloud.normals;
    let looks = Looks::at(voxels);
    let (from, from_above) = from(voxels, &looks);
    let votes = smoothed(voxels, &votes(&looks.counts(normals, from)));
    let judged = votes.iter().filter(|vote| vote.abs() > 0.5);
    let (agree, all) = judged.fold((0u32, 0u32), |(yes, all), vote| (yes + u32::from(*vote > 0.0), all + 1));
    let share = agree as f32 / all.max(1) as f32;
    let keeps = given && share > AGREES;
    let turns = given && share < 1.0 - AGREES;
    let (mut sides, unknown): (Vec<Vector3<f32>>, Vec<bool>) = match (keeps, turns) {
        (true, _) => (normals.clone(), vec![false; normals.len()]),
        (_, true) => (normals.iter().map(|n| -n).collect(), vec![false; normals.len()]),
        _ => spread(voxels, &votes),
    };
    sides.iter_mut().for_each(|n| *n = n.try_normalize(1e-6).unwrap_or_else(Vector3::z));
    let assumed = from_above && !keeps && !turns;
    Orientation { normals: sides, unknown, assumed, borne_out: given.then_some(share) }
}

/// Votes from here on are sure. A plate of which one side was scanned is seen from both: its side carries over from what
/// is next to it, most alike first (Hoppe et al. 1992, *Surface reconstruction from unorganized points*).
const SURE: f32 = 0.4;

/// The normals turned as sure votes say, and from these on to the others; and which nothing reached.
fn spread(voxels: &Voxels, votes: &[f32]) -> (Vec<Vector3<f32>>, Vec<bool>) {
    let points = &voxels.cloud.points_mm;
    let reach_mm = SPREAD_VOXELS * voxels.edge_mm;
    let grid = Grid::new(points, reach_mm);
    let mut unknown: Vec<bool> = votes.iter().map(|vote| vote.abs() < SURE).collect();
    let turn = |(n, vote): (&Vector3<f32>, &f32)| if *vote < 0.0 { -n } else { *n };
    let mut normals: Vec<Vector3<f32>> = voxels.cloud.normals.iter().zip(votes).map(turn).collect();
    // By likeness, whose bits are ordered as it is, then by place: the order does not depend on chance.
    let mut queue: BinaryHeap<(u32, Reverse<(usize, usize)>)> = BinaryHeap::new();
    let steps = |from: usize, unknown: &[bool], normals: &[Vector3<f32>], queue: &mut BinaryHeap<_>| {
        grid.within(&points[from], reach_mm, |slot, _| {
            let to = grid.index(slot);
            if unknown[to] {
                let alike = normals[from].dot(&normals[to]).abs();
                queue.push((alike.to_bits(), Reverse((to, from))));
            }
        });
    };
    (0..points.len()).filter(|&i| !unknown[i]).for_each(|i| steps(i, &unknown, &normals, &mut queue));
    while let Some((_, Reverse((to, from)))) = queue.pop() {
        if std::mem::replace(&mut unknown[to], false) {
            if normals[to].dot(&normals[from]) < 0.0 {
                normals[to] = -normals[to];
            }
            steps(to, &unknown, &normals, &mut queue);
        }
    }
    (normals, unknown)
}

/// Neighbours farther apart than this are not the same surface, voxels.
const SPREAD_VOXELS: f32 = 2.0;

/// What is seen of a cloud from directions all round.
struct Looks {
    /// Unit directions, evenly spread (Fibonacci's spiral).
    directions: Vec<Vector3<f32>>,
    /// Which of them see each voxel, a bit for each.
    seen: Vec<Directions>,
}

/// Some of the directions: a bit for each.
type Directions = u128;
const _: () = assert!(LOOKS <= Directions::BITS as usize);

impl Looks {
    fn at(voxels: &Voxels) -> Self {
        /// Looks that are held at a time: a byte for each and voxel.
        const AT_A_TIME: usize = 8;
        let golden = std::f32::consts::PI * (3.0 - 5f32.sqrt());
        let direction = |k: usize| {
            let z = 1.0 - (2.0 * k as f32 + 1.0) / LOOKS as f32;
            let (sin, cos) = (golden * k as f32).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            Vector3::new(r * cos, r * sin, z)
        };
        let directions: Vec<Vector3<f32>> = (0..LOOKS).map(direction).collect();
        let (points, normals) = (&voxels.cloud.points_mm, &voxels.cloud.normals);
        let mut seen: Vec<Directions> = vec![0; points.len()];
        for (chunk, some) in directions.chunks(AT_A_TIME).enumerate() {
            let shown: Vec<Vec<bool>> =
                some.par_iter().map(|look| visible(points, normals, voxels.edge_mm, look)).collect();
            seen.par_iter_mut().enumerate().for_each(|(i, seen)| {
                for (k, shown) in (AT_A_TIME * chunk..).zip(&shown) {
                    *seen |= Directions::from(shown[i]) << k;
                }
            });
        }
        Self { directions, seen }
    }

    /// Those over a plane that faces `up`.
    fn half(&self, up: &Vector3<f32>) -> Directions {
        let over = self.directions.iter().map(|d| Directions::from(d.dot(up) > LEAST_HEIGHT));
        over.enumerate().map(|(k, over)| over << k).sum()
    }

    /// Share of the voxels that some of these directions see.
    fn share(&self, from: Directions) -> f32 {
        self.seen.iter().filter(|seen| **seen & from != 0).count() as f32 / self.seen.len().max(1) as f32
    }

    /// How many of these directions see each voxel from the side of its normal, and from the other.
    fn counts(&self, normals: &[Vector3<f32>], from: Directions) -> Vec<[u16; 2]> {
        let count = |(seen, normal): (&Directions, &Vector3<f32>)| {
            let mut sides = [0; 2];
            let mut left = seen & from;
            while left != 0 {
                let look = &self.directions[left.trailing_zeros() as usize];
                sides[usize::from(normal.dot(look) < 0.0)] += 1;
                left &= left - 1;
            }
            sides
        };
        self.seen.par_iter().zip(normals).map(count).collect()
    }
}

/// Whence a cloud was scanned, and whether that is from above, +z, only because what is seen does not tell.
///
/// From over the table, or from the half of all directions that sees nearly everything. A sheet without thickness is seen as
/// well from behind: then from above, if above is over it. Else from all round.
fn from(voxels: &Voxels, looks: &Looks) -> (Directions, bool) {
    let axes = common_axes(&voxels.cloud.normals);
    let shown = |up: &Vector3<f32>| looks.share(looks.half(up));
    if let Some(table) =
        table(voxels, &axes, looks).filter(|table| table.surrounds || shown(&-table.up) <= WHOLE)
    {
        return (looks.half(&table.up), false);
    }
    let whole =
        |axis: Vector3<f32>| [axis, -axis].map(|up| (shown(&up), up)).map(|(s, up)| (s > WHOLE, s, up));
    let axes: Vec<_> = axes.into_iter().map(whole).collect();
    let above = axes.iter().filter(|[one, other]| one.0 && other.0).flatten().map(|(.., up)| *up);
    if let Some(up) = above.max_by(|a, b| a.z.total_cmp(&b.z)) {
        let assumed = up.z > LEAST_UP;
        return (if assumed { looks.half(&up) } else { Directions::MAX }, assumed);
    }
    let best = axes.iter().flatten().filter(|(whole, ..)| *whole).max_by(|a, b| a.1.total_cmp(&b.1));
    (best.map_or(Directions::MAX, |(.., up)| looks.half(up)), false)
}

/// Share of the voxels that half of the directions must see to be those whence the cloud was scanned.
const WHOLE: f32 = 0.97;
/// Sine of the least slope of a sheet of which above is over one side: 17 degrees.
const LEAST_UP: f32 = 0.3;

/// From -1, seen from behind only, to 1; 0 where it is not seen.
fn votes(counts: &[[u16; 2]]) -> Vec<f32> {
    let vote = |[front, back]: &[u16; 2]| {
        let (front, back) = (f32::from(*front), f32::from(*back));
        if front + back > 0.0 { (front - back) / (front + back) } else { 0.0 }
    };
    counts.iter().map(vote).collect()
}

/// Which voxels a look from far away in this direction sees.
fn visible(points: &[Point3<f32>], normals: &[Vector3<f32>], edge_mm: f32, look: &Vector3<f32>) -> Vec<bool> {
    let mut aside = Vector3::zeros();
    aside[look.iamin()] = 1.0;
    let right = look.cross(&aside).normalize();
    let up = look.cross(&right);
    let pixel_mm = PIXEL_VOXELS * edge_mm;
    let spans = [middle_span(points, &right), middle_span(points, &up)];
    let sizes = spans.map(|[low, high]| ((high - low) / pixel_mm + 1.0).min(MOST_PIXELS) as usize + 1);
    let pixel = |p: &Point3<f32>| {
        let at = [p.coords.dot(&right) - spans[0][0], p.coords.dot(&up) - spans[1][0]].map(|c| c / pixel_mm);
        let inside = (0..2).all(|k| at[k] >= 0.0 && at[k] < sizes[k] as f32);
        inside.then(|| at[1] as usize * sizes[0] + at[0] as usize)
    };
    let mut nearest = vec![f32::MIN; sizes[0] * sizes[1]];
    let pixels: Vec<Option<usize>> = points.iter().map(pixel).collect();
    for (p, pixel) in points.iter().zip(&pixels) {
        if let Some(pixel) = *pixel {
            nearest[pixel] = nearest[pixel].max(p.coords.dot(look));
        }
    }
    let sees = |((p, n), pixel): ((&Point3<f32>, &Vector3<f32>), &Option<usize>)| {
        let Some(pixel) = *pixel else { return false };
        let cosine = n.dot(look).abs();
        let slope = (1.0 - cosine * cosine).max(0.0).sqrt() / cosine.max(LEAST_COSINE);
        cosine > LEAST_COSINE
            && nearest[pixel] - p.coords.dot(look) < DEPTH_VOXELS * edge_mm + pixel_mm * slope
    };
    points.iter().zip(normals).zip(&pixels).map(sees).collect()
}

/// From where to where all but one in 500 of the points reach along an axis, and a little more.
fn middle_span(points: &[Point3<f32>], axis: &Vector3<f32>) -> [f32; 2] {
    let step = (points.len() / 20_000).max(1);
    let mut along: Vec<f32> = points.iter().step_by(step).map(|p| p.coords.dot(axis)).collect();
    along.sort_unstable_by(f32::total_cmp);
    let cut = along.len() / 500;
    let (low, high) = (along[cut], along[along.len() - 1 - cut]);
    let margin = 0.05 * (high - low) + 1.0;
    [low - margin, high + margin]
}

/// Each vote with those of its neighbours that lie in about the same surface.
fn smoothed(voxels: &Voxels, votes: &[f32]) -> Vec<f32> {
    let (points, normals) = (&voxels.cloud.points_mm, &voxels.cloud.normals);
    let reach_mm = REACH_VOXELS * voxels.edge_mm;
    let grid = Grid::new(points, reach_mm);
    let vote = |i: usize| {
        let (mut sum, mut weight) = (0.0, 0.0);
        grid.within(&points[i], reach_mm, |slot, _| {
            let k = grid.index(slot);
            let alike = normals[i].dot(&normals[k]);
            sum += votes[k] * alike * alike.abs();
            weight += alike * alike;
        });
        sum / f32::max(weight, 1e-6)
    };
    (0..points.len()).into_par_iter().map(vote).collect()
}

/// The most common axes of normals, whichever way they face, the most common first.
fn common_axes(normals: &[Vector3<f32>]) -> Vec<Vector3<f32>> {
    const CELLS: f32 = 5.0;
    let side = 2 * CELLS as usize + 1;
    let mut bins = vec![(0usize, Matrix3::zeros()); side * side * side];
    for n in normals {
        // One of the two ways for a bin: where the largest component is positive.
        let n = if n[n.iamax()] < 0.0 { -n } else { *n };
        let cell = n.map(|c| ((c * CELLS).round() + CELLS).clamp(0.0, 2.0 * CELLS) as usize);
        let bin = &mut bins[(cell.x * side + cell.y) * side + cell.z];
        *bin = (bin.0 + 1, bin.1 + n * n.transpose());
    }
    bins.sort_by_key(|b| std::cmp::Reverse(b.0));
    let main = |sum: &Matrix3<f32>| {
        let eigen = sum.symmetric_eigen();
        eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned()
    };
    // Where the bins' borders are must not matter: each is moved to the middle of what is about it.
    let centred = |axis: Vector3<f32>| {
        let about = normals.iter().filter(|n| n.dot(&axis).abs() > ONE_AXIS);
        main(&about.map(|n| n * n.transpose()).sum())
    };
    let mut axes: Vec<Vector3<f32>> = Vec::new();
    for (_, sum) in bins.iter().take(BINS).filter(|bin| bin.0 > 0) {
        let axis = centred(centred(main(sum)));
        if axes.len() < AXES && axes.iter().all(|other| other.dot(&axis).abs() < ONE_AXIS) {
            axes.push(axis);
        }
    }
    axes
}

/// Axes that are tried, bins that they come from, and cosine from which on two are one: 11 degrees.
const AXES: usize = 6;
const BINS: usize = 24;
const ONE_AXIS: f32 = 0.98;

/// Least share of all points in a table, largest behind it, and least on it that stands.
const TABLE_SHARE: f32 = 0.15;
const MOST_BEHIND: f32 = 0.01;
const LEAST_STANDING: f32 = 0.005;
/// Half its thickness, voxels.
const FLAT_VOXELS: f32 = 1.5;
/// Least share of it that is seen from over it: the underside of a plate is hidden by the plate.
const OPEN: f32 = 0.5;

/// A large plane with nothing behind it, on which the rest stands, and which is seen from there.
struct Table {
    /// The way it faces.
    up: Vector3<f32>,
    /// Of all points.
    share: f32,
    /// Whether it reaches farther than what stands on it, whichever way one looks along it.
    surrounds: bool,
}

/// The largest table that faces along one of these axes.
fn table(voxels: &Voxels, axes: &[Vector3<f32>], looks: &Looks) -> Option<Table> {
    let planes: Vec<_> = axes.iter().flat_map(|axis| [*axis, -axis]).collect();
    let tables: Vec<Table> = planes.par_iter().filter_map(|up| table_along(voxels, up, looks)).collect();
    tables.into_iter().max_by(|a, b| a.share.total_cmp(&b.share))
}

/// Whether the plane at `level_mm` along `up` reaches farther than what stands on it, whichever way one looks along it: a
/// table, and not the plate of a T joint that was cut out. Half its thickness is `half_mm`.
pub fn surrounds(points: &[Point3<f32>], up: &Vector3<f32>, level_mm: f32, half_mm: f32) -> bool {
    const WAYS: usize = 16;
    const MARGIN_MM: f32 = 10.0;
    // Lower than this it may be the table's own noise, half thicknesses.
    const STANDS: f32 = 3.0;
    let mut aside = Vector3::zeros();
    aside[up.iamin()] = 1.0;
    let a = up.cross(&aside).normalize();
    let b = up.cross(&a);
    let way = |k: usize| {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / WAYS as f32).sin_cos();
        a * cos + b * sin
    };
    let ways: Vec<Vector3<f32>> = (0..WAYS).map(way).collect();
    let mut reach = [[f32::MIN; WAYS]; 2];
    for p in points {
        let height = p.coords.dot(up) - level_mm;
        let stands = height > STANDS * half_mm;
        if stands || height.abs() < half_mm {
            for (way, reach) in ways.iter().zip(&mut reach[usize::from(stands)]) {
                *reach = reach.max(way.dot(&p.coords));
            }
        }
    }
    (0..WAYS).all(|k| reach[0][k] > reach[1][k] + MARGIN_MM)
}

/// The table that faces about this way.
fn table_along(voxels: &Voxels, up: &Vector3<f32>, looks: &Looks) -> Option<Table> {
    let (points, normals) = (&voxels.cloud.points_mm, &voxels.cloud.normals);
    let total = points.len() as f32;
    let half_mm = FLAT_VOXELS * voxels.edge_mm;
    let mut up = *up;
    let mut level_mm = lowest_level(points, normals, &up, half_mm)?;
    for _ in 0..3 {
        let on: Vec<&Point3<f32>> =
            points.iter().filter(|p| (p.coords.dot(&up) - level_mm).abs() < 2.0 * half_mm).collect();
        let mean = on.iter().map(|p| p.coords).sum::<Vector3<f32>>() / on.len().max(1) as f32;
        let scatter: Matrix3<f32> =
            on.iter().map(|p| (p.coords - mean) * (p.coords - mean).transpose()).sum();
        let eigen = scatter.symmetric_eigen();
        let axis = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        up = if axis.dot(&up) < 0.0 { -axis } else { axis };
        level_mm = up.dot(&mean);
    }
    let height = |p: &Point3<f32>| p.coords.dot(&up) - level_mm;
    let is_on = |(p, n): (&Point3<f32>, &Vector3<f32>)| height(p).abs() < half_mm && n.dot(&up).abs() > 0.9;
    let on: Vec<bool> = points.iter().zip(normals).map(is_on).collect();
    let count = on.iter().filter(|on| **on).count() as f32;
    let share_of =
        |holds: &dyn Fn(f32) -> bool| points.iter().filter(|p| holds(height(p))).count() as f32 / total;
    let stands =
        share_of(&|h| h < -3.0 * half_mm) <= MOST_BEHIND && share_of(&|h| h > 3.0 * half_mm) > LEAST_STANDING;
    if count < TABLE_SHARE * total || !stands {
        return None;
    }
    let over = looks.half(&up);
    // From below, nothing hides it in any case; from above, a third of all looks must see it.
    let is_open = |i: usize| 3 * (looks.seen[i] & over).count_ones() > over.count_ones();
    let open = (0..points.len()).filter(|&i| on[i] && is_open(i)).count();
    let surrounds = surrounds(points, &up, level_mm, half_mm);
    (open as f32 > OPEN * count).then_some(Table { up, share: count / total, surrounds })
}

/// Height of the lowest layer with a table's share of points that face along an axis.
fn lowest_level(
    points: &[Point3<f32>],
    normals: &[Vector3<f32>],
    up: &Vector3<f32>,
    half_mm: f32,
) -> Option<f32> {
    let facing = points.iter().zip(normals).filter(|(_, n)| n.dot(up).abs() > 0.9);
    let mut heights: Vec<f32> = facing.map(|(p, _)| p.coords.dot(up)).collect();
    heights.sort_unstable_by(f32::total_cmp);
    let least = (0.5 * TABLE_SHARE * points.len() as f32) as usize + 1;
    let layer = |first: usize| {
        let end = heights.partition_point(|h| *h < heights[first] + 2.0 * half_mm);
        (end - first >= least).then(|| heights[first..end].iter().sum::<f32>() / (end - first) as f32)
    };
    (0..heights.len()).find_map(layer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    /// What is seen from above of a table 200 mm wide with a web 8 mm thick, 40 high and 100 long on it, points 1 mm apart, and
    /// the true normals; turned.
    fn web(table_mm: i32, turn: &UnitQuaternion<f32>) -> (Voxels, Vec<Vector3<f32>>) {
        let mut rows: Vec<(Point3<f32>, Vector3<f32>)> = Vec::new();
        for i in -table_mm..=table_mm {
            for j in -table_mm..=table_mm {
                if i.abs() > 4 || j.abs() > 50 {
                    rows.push((Point3::new(i as f32, j as f32, 0.0), Vector3::z()));
                }
            }
        }
        for j in -50..=50 {
            for k in 0..=40 {
                let (y, z) = (j as f32, k as f32);
                rows.extend([1.0, -1.0].map(|s| (Point3::new(4.0 * s, y, z), Vector3::x() * s)));
            }
            rows.extend((-3..=3).map(|i| (Point3::new(i as f32, j as f32, 40.0), Vector3::z())));
        }
        for (i, k) in (-3..=3).flat_map(|i| (1..40).map(move |k| (i, k))) {
            let at = |s: f32| (Point3::new(i as f32, 50.0 * s, k as f32), Vector3::y() * s);
            rows.extend([1.0, -1.0].map(at));
        }
        let mut voxels = Voxels { edge_mm: 1.0, ..Voxels::default() };
        voxels.cloud.points_mm = rows.iter().map(|(p, _)| turn * p).collect();
        let truth: Vec<_> = rows.iter().map(|(_, n)| turn * n).collect();
        let either = |(k, n): (usize, &Vector3<f32>)| if k * 7 % 5 < 2 { -n } else { *n };
        voxels.cloud.normals = truth.iter().enumerate().map(either).collect();
        (voxels, truth)
    }

    #[test]
    fn the_air_side_is_found_in_any_frame_and_the_table_faces_the_work() {
        for turn in [UnitQuaternion::identity(), UnitQuaternion::from_euler_angles(2.5, -0.7, 1.9)] {
            let (voxels, truth) = web(100, &turn);
            let sides = seen(&voxels, false);
            let wrong = sides.normals.iter().zip(&truth).filter(|(a, b)| a.dot(b) < 0.0).count();
            assert!(wrong * 500 < truth.len(), "{wrong} of {}", truth.len());
            let table = table(&voxels, &common_axes(&voxels.cloud.normals), &Looks::at(&voxels));
            assert!(table.unwrap().up.dot(&(turn * Vector3::z())) > 0.999);
            assert_eq!(sides.borne_out, None);
        }
    }

    #[test]
    fn given_sides_are_kept_if_they_are_borne_out_turned_if_all_are_wrong_and_found_anew_if_mixed() {
        let (mut voxels, truth) = web(100, &UnitQuaternion::from_euler_angles(0.3, 1.2, -2.2));
        let right =
            |sides: &Orientation| sides.normals.iter().zip(&truth).filter(|(a, b)| a.dot(b) > 0.0).count();
        let mixed = seen(&voxels, true);
        assert!(right(&mixed) * 500 > truth.len() * 499);
        assert!((0.4..0.8).contains(&mixed.borne_out.unwrap()));
        voxels.cloud.normals.clone_from(&truth);
        assert_eq!(right(&seen(&voxels, true)), truth.len());
        voxels.cloud.normals.iter_mut().for_each(|n| *n = -*n);
        assert_eq!(right(&seen(&voxels, true)), truth.len());
    }
}
