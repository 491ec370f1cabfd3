//! Orientation of surfaces where no camera is known (ours; the paper's clouds come with their camera): which of their two sides
//! looks into free space, seen from round the part.
//!
//! The cloud is looked at from far away in many directions. What such a look sees of a surface it sees from its air side; the
//! inside of a plate is hidden by the plate. What was scanned on a table says nothing from below, where nothing was scanned:
//! a plane with nothing behind it, on which the rest stands, is looked at from the side of the rest alone. None of this
//! knows an axis or a unit: only the voxels.

mod looks;
mod shadows;
mod sides;
mod table;

use crate::geometry::grid::Grid;
use crate::geometry::grid::sweep::Eight;
use crate::model::downsampling::Voxels;
use nalgebra::{Matrix3, Vector3};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use wide::f32x8;

use looks::{ALL, Directions, Looks};
use shadows::Shadows;
use sides::Sides;
use table::{Table, table};

/// Neighbours within so many voxels have a say on a side.
const REACH_VOXELS: f32 = 2.5;
/// Given sides are right, or all wrong, if this share of what is seen says so.
const AGREES: f32 = 0.85;
/// Of right ones a fiftieth seems wrong: at edges, and on faces that are seen by chance from behind.
const ALL_AGREE: f32 = 0.98;

/// What was found of the sides.
#[derive(Debug, Clone, Default)]
pub struct Orientation {
    /// The normals, out of the material.
    pub normals: Vec<Vector3<f32>>,
    /// Which of them nothing was known of.
    pub unknown: Vec<bool>,
    /// Whether the cloud looks nearly alike from both sides: it is taken as seen from above, +z, or as what protrudes.
    pub assumed: bool,
    /// Share of the given sides that what is seen bears out; none if none were given.
    pub borne_out: Option<f32>,
}

impl Orientation {
    /// What the user should know.
    pub fn words(&self) -> Option<String> {
        let share = self.borne_out.filter(|share| *share <= ALL_AGREE)?;
        Some(if share > AGREES {
            format!(
                "{:.0} % of the normals in the file point into the material: these were flipped",
                100.0 * (1.0 - share)
            )
        } else if share < 1.0 - AGREES {
            "the normals in the file point into the material: they were flipped".into()
        } else {
            format!(
                "the normals in the file point to both sides ({:.0} % to the air): their sides were determined by visibility from \
                 around the part",
                100.0 * share
            )
        })
    }
}

/// The sides of a thinned cloud; `given` says whether its normals came with sides, which then are only checked.
pub fn seen(voxels: &Voxels, given: bool) -> Orientation {
    let normals = &voxels.cloud.normals;
    let looks = Looks::at(voxels);
    let faced = looks.faced(normals);
    let (from, from_above, table) = from(voxels, &looks);
    let of_table = |p| table.is_some_and(|table| table.is_of(p, voxels.edge_mm));
    let of_table: Vec<bool> = voxels.cloud.points_mm.iter().map(of_table).collect();
    let shadows = table.map_or_else(Shadows::default, |table| {
        Shadows::on(&table.places(voxels), voxels, &of_table, &looks, from)
    });
    let (at_one, unsure) = Sides::new(voxels, &looks, &faced, from, &of_table, shadows).at_one();
    let votes = smoothed(voxels, &votes(&looks.counts(&faced, at_one)));
    let judged = votes.iter().filter(|vote| vote.abs() > 0.5);
    let (agree, all) = judged.fold((0u32, 0u32), |(yes, all), vote| (yes + u32::from(*vote > 0.0), all + 1));
    let share = agree as f32 / all.max(1) as f32;
    let keeps = given && share > AGREES;
    let turns = given && share < 1.0 - AGREES;
    let (mut sides, unknown): (Vec<Vector3<f32>>, Vec<bool>) = match keeps || turns {
        true => (corrected(normals, &votes, turns), vec![false; normals.len()]),
        false => spread(voxels, &votes),
    };
    sides.iter_mut().for_each(|n| *n = n.try_normalize(1e-6).unwrap_or_else(Vector3::z));
    let assumed = (from_above || unsure) && !keeps && !turns;
    Orientation { normals: sides, unknown, assumed, borne_out: given.then_some(share) }
}

/// Given sides, or all of them turned, but for those that are surely seen from the other: programs that orient normals
/// toward one place, or upward, are right for most of a plate and wrong for one side of each web on it.
fn corrected(normals: &[Vector3<f32>], votes: &[f32], turns: bool) -> Vec<Vector3<f32>> {
    let side = |(n, vote): (&Vector3<f32>, &f32)| {
        let (given, vote) = if turns { (-n, -vote) } else { (*n, *vote) };
        if vote < -SURE { -given } else { given }
    };
    normals.iter().zip(votes).map(side).collect()
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
    let step = |from: usize, to: usize, normals: &[Vector3<f32>]| {
        (normals[from].dot(&normals[to]).abs().to_bits(), Reverse((to, from)))
    };
    for to in (0..points.len()).filter(|&i| unknown[i]) {
        grid.within(&points[to], reach_mm, |slot, _| {
            let from = grid.index(slot);
            if !unknown[from] {
                queue.push(step(from, to, &normals));
            }
        });
    }
    while let Some((_, Reverse((to, from)))) = queue.pop() {
        if std::mem::replace(&mut unknown[to], false) {
            if normals[to].dot(&normals[from]) < 0.0 {
                normals[to] = -normals[to];
            }
            grid.within(&points[to], reach_mm, |slot, _| {
                let next = grid.index(slot);
                if unknown[next] {
                    queue.push(step(to, next, &normals));
                }
            });
        }
    }
    (normals, unknown)
}

/// Neighbours farther apart than this are not the same surface, voxels.
const SPREAD_VOXELS: f32 = 2.0;

/// Whence a cloud was scanned, whether that is from above, +z, only because what is seen does not tell, and its table.
///
/// From over the table, or from the half of all directions that sees nearly everything. A sheet without thickness is seen as
/// well from behind: then from above, if above is over it. Else from all round.
fn from(voxels: &Voxels, looks: &Looks) -> (Directions, bool, Option<Table>) {
    let axes = common_axes(&voxels.cloud.normals);
    let shown = |up: &Vector3<f32>| looks.share(looks.half(up));
    let table = table(voxels, looks);
    if let Some(table) = table.filter(|table| table.carries || table.is_behind || shown(&-table.up) <= WHOLE)
    {
        return (looks.half(&table.up), false, Some(table));
    }
    let whole =
        |axis: Vector3<f32>| [axis, -axis].map(|up| (shown(&up), up)).map(|(s, up)| (s > WHOLE, s, up));
    let axes: Vec<_> = axes.into_iter().map(whole).collect();
    let above = axes.iter().filter(|[one, other]| one.0 && other.0).flatten().map(|(.., up)| *up);
    if let Some(up) = above.max_by(|a, b| a.z.total_cmp(&b.z)) {
        if up.z <= LEAST_UP {
            return (ALL, false, None);
        }
        return (looks.half(&up), true, table.filter(|table| table.up.dot(&up) > ONE_AXIS));
    }
    let best = axes.iter().flatten().filter(|(whole, ..)| *whole).max_by(|a, b| a.1.total_cmp(&b.1));
    (best.map_or(ALL, |(.., up)| looks.half(up)), false, None)
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

/// Each vote with those of its neighbours that lie in about the same surface.
fn smoothed(voxels: &Voxels, votes: &[f32]) -> Vec<f32> {
    let sums = sums(voxels, REACH_VOXELS, votes, |alike, vote| [vote * alike * alike.abs(), alike * alike]);
    sums.into_iter().map(|[sum, weight]| sum / f32::max(weight, 1e-6)).collect()
}

/// Sums over the neighbours of each voxel, itself included, of what `terms` makes of the cosines between their normals and its own and
/// of their `values`.
fn sums(
    voxels: &Voxels,
    reach_voxels: f32,
    values: &[f32],
    terms: impl Fn(f32x8, f32x8) -> [f32x8; 2] + Sync,
) -> Vec<[f32; 2]> {
    let reach_mm = reach_voxels * voxels.edge_mm;
    let grid = Grid::new(&voxels.cloud.points_mm, reach_mm);
    let (normals, values) = (grid.by_slot(&voxels.cloud.normals), grid.by_slot(values));
    let [x, y, z] = [0, 1, 2].map(|axis| normals.iter().map(|n| n[axis]).collect::<Vec<f32>>());
    let limit = f32x8::splat(reach_mm * reach_mm);
    let sums = grid.sweep(reach_mm, [&x, &y, &z, &values], |slot, around| {
        let (own, mut sums) = (normals[slot], [f32x8::ZERO; 2]);
        for Eight { d2, columns: [x, y, z, value], .. } in around.from(grid.point(slot)) {
            let inside = d2.simd_lt(limit);
            for (sum, term) in sums.iter_mut().zip(terms(x * own.x + y * own.y + z * own.z, value)) {
                *sum += inside & term;
            }
        }
        sums.map(f32x8::reduce_add)
    });
    grid.by_point(&sums)
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, UnitQuaternion};

    /// Points 1 mm apart with their true normals, turned: as voxels whose normals face either side, and the true ones.
    fn cloud(
        rows: &[(Point3<f32>, Vector3<f32>)],
        turn: &UnitQuaternion<f32>,
    ) -> (Voxels, Vec<Vector3<f32>>) {
        let mut voxels = Voxels { edge_mm: 1.0, ..Voxels::default() };
        voxels.cloud.points_mm = rows.iter().map(|(p, _)| turn * p).collect();
        let truth: Vec<_> = rows.iter().map(|(_, n)| turn * n).collect();
        let either = |(k, n): (usize, &Vector3<f32>)| if k * 7 % 5 < 2 { -n } else { *n };
        voxels.cloud.normals = truth.iter().enumerate().map(either).collect();
        (voxels, truth)
    }

    fn wrong(sides: &Orientation, truth: &[Vector3<f32>]) -> usize {
        sides.normals.iter().zip(truth).filter(|(a, b)| a.dot(b) < 0.0).count()
    }

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
        cloud(&rows, turn)
    }

    #[test]
    fn the_air_side_is_found_in_any_frame_and_the_table_faces_the_work() {
        for turn in [UnitQuaternion::identity(), UnitQuaternion::from_euler_angles(2.5, -0.7, 1.9)] {
            let (voxels, truth) = web(100, &turn);
            let sides = seen(&voxels, false);
            let wrong = wrong(&sides, &truth);
            assert!(wrong * 500 < truth.len(), "{wrong} of {}", truth.len());
            let table = table(&voxels, &Looks::at(&voxels));
            assert!(table.unwrap().up.dot(&(turn * Vector3::z())) > 0.999);
            assert_eq!(sides.borne_out, None);
        }
    }

    /// A wall 60 mm high and 160 mm long that leans back by 15 degrees, seen from the front only, and the table behind it, from
    /// where its shadow ends; points 1 mm apart, and the true normals; turned.
    fn wall(turn: &UnitQuaternion<f32>) -> (Voxels, Vec<Vector3<f32>>) {
        let (sin, cos) = 15f32.to_radians().sin_cos();
        let mut rows: Vec<(Point3<f32>, Vector3<f32>)> = Vec::new();
        for i in -80..=80 {
            let x = i as f32;
            let front = |k: i32| Point3::new(x, k as f32 * sin, k as f32 * cos);
            rows.extend((0..=60).map(|k| (front(k), Vector3::new(0.0, -cos, sin))));
        }
        for i in -120..=120 {
            rows.extend((90..=240).map(|j| (Point3::new(i as f32, j as f32, 0.0), Vector3::z())));
        }
        cloud(&rows, turn)
    }

    #[test]
    fn a_wall_of_which_one_side_was_seen_faces_away_from_its_shadow_in_any_frame() {
        for turn in [UnitQuaternion::identity(), UnitQuaternion::from_euler_angles(2.5, -0.7, 1.9)] {
            let (voxels, truth) = wall(&turn);
            let sides = seen(&voxels, false);
            let wrong = wrong(&sides, &truth);
            assert!(wrong * 200 < truth.len(), "{wrong} of {}", truth.len());
            assert!(!sides.assumed);
        }
    }

    /// An upright plate 300 mm wide and 120 mm high, seen from the front, 40 and 50 degrees above, 80 mm over a table that the
    /// picture cuts off beside it, with the shadow of the plate; points 1 mm apart.
    fn hanging(has_table: bool, turn: &UnitQuaternion<f32>) -> (Voxels, Vec<Vector3<f32>>) {
        let mut rows: Vec<(Point3<f32>, Vector3<f32>)> = Vec::new();
        for i in -150..=150 {
            let x = i as f32;
            rows.extend((80..=200).map(|k| (Point3::new(x, 0.0, k as f32), -Vector3::y())));
            let table = (-400..=500).filter(|j| has_table && !(95..=168).contains(j));
            rows.extend(table.map(|j| (Point3::new(x, j as f32, 0.0), Vector3::z())));
        }
        cloud(&rows, turn)
    }

    #[test]
    fn what_hangs_over_a_table_has_the_side_that_its_shadow_tells_and_without_a_table_it_is_assumed() {
        for turn in [UnitQuaternion::identity(), UnitQuaternion::from_euler_angles(2.5, -0.7, 1.9)] {
            let (voxels, truth) = hanging(true, &turn);
            let sides = seen(&voxels, false);
            let wrong = wrong(&sides, &truth);
            assert!(wrong * 200 < truth.len(), "{wrong} of {}", truth.len());
            assert!(!sides.assumed);
            assert!(seen(&hanging(false, &turn).0, false).assumed);
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

    #[test]
    fn given_sides_that_are_right_but_for_one_side_of_a_web_are_turned_over_there() {
        // As a program leaves them that turns all normals toward +z, and those of upright faces by chance of noise one way.
        let (mut voxels, truth) = web(100, &UnitQuaternion::identity());
        let is_spoilt = |n: &Vector3<f32>| n.x < -0.9;
        let spoilt = truth.iter().filter(|n| is_spoilt(n)).count();
        for inward in [1.0, -1.0] {
            let given = truth.iter().map(|n| if is_spoilt(n) { n * -inward } else { n * inward });
            voxels.cloud.normals = given.collect();
            let sides = seen(&voxels, true);
            // Its rim, of which no look is sure, stays as it was given.
            let wrong = wrong(&sides, &truth);
            assert!(wrong * 10 < spoilt, "{wrong} of {spoilt}");
            assert!(sides.words().is_some());
        }
    }
}
