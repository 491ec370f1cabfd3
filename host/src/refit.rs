//! A saved program on a part that has moved (ours): the saved model is laid over a new scan, and the program moves with it.
//!
//! Point-to-plane ICP as in [`crate::reconstruction`], but of one rigid cloud onto another, from a pose that nobody
//! reported: so first from many poses about the old one with few points, then finely from the best of them. Only the
//! model about the welds counts, as the table need not have moved. Directions in which surfaces are common (the faces
//! of plates) are sampled no more often than rare ones. Where a surface ends, its edge counts as a surface of its own that
//! faces out of it in its plane: a straight groove in flat plates is held along its length by nothing else. Along motions
//! that surfaces hardly hinder, the part is followed step by step: what faces along the motion decides, and where that
//! leaves several places, the smallest motion is taken with a warning, or none.

use nalgebra::{Isometry3, Matrix6, Point3, SymmetricEigen, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

use crate::cloud::{Merged, PointCloud, View};
use crate::grid::Grid;
use crate::toolpath::program::Waypoint;
use crate::{downsampling, normals, orientation, reconstruction};

/// Motion about the middle of the part that is looked for, mm; tests hold 36 mm with 20 degrees, on a fillet 47 with 15.
pub const RANGE_MM: f64 = 50.0;
/// The same for its rotation about any axis, degrees.
pub const RANGE_DEG: f64 = 20.0;

/// The model counts this far from the welds, mm: both plates' edges of common parts.
const ABOUT_WELDS_MM: f64 = 40.0;
/// Points of the model in the search, and in the fine alignment.
const COARSE_POINTS: usize = 200;
const FINE_POINTS: usize = 6000;
/// Largest distances of a pair, mm, one round after another.
const COARSE_GATES_MM: [f32; 4] = [60.0, 40.0, 20.0, 10.0];
const FINE_GATES_MM: [f32; 3] = [8.0, 4.0, 2.5];
const ITERATIONS: usize = 8;
/// How near a point of the model has to come to the new cloud to count as found, mm.
const FOUND_MM: f32 = 1.5;
/// Least share of the model that has to be found.
const LEAST_FOUND: f64 = 0.7;
/// Least agreement of two normals that may be the same surface.
const MIN_NORMAL_DOT: f32 = 0.7;
/// Share of information, of a motion that every pair sees in full, below which a motion is examined step by step.
const HARDLY_SEEN: f64 = 0.05;
/// Candidates of the search that are aligned finely.
const FINALISTS: usize = 4;
/// Share of the model found from which the search stops, and a difference in it that tells nothing.
const GOOD: f64 = 0.9;
const NEARLY: f64 = 0.03;

/// How the part has moved.
#[derive(Debug, Clone)]
pub struct Refit {
    /// From where the part was to where it is, base frame, mm.
    pub new_from_old: Isometry3<f64>,
    /// Share of the model about the welds that lies on the new scan, 0..1.
    pub found: f64,
    /// Root mean square distance of that share from the new surface, mm.
    pub rms_mm: f64,
    /// How far the middle of the part went, mm.
    pub moved_mm: f64,
    /// How far it turned, degrees.
    pub turned_deg: f64,
    /// Whether the scan leaves a direction unknown, along which the smallest motion was taken.
    pub unknown: bool,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Why the program cannot be moved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// Nothing to go by.
    #[error("the saved {what}; plan it again, and keep the whole folder")]
    Saved {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The part is not where it is looked for.
    #[error(
        "the part was not found in the new scan: at best {:.0} % of the saved model about its welds lies on it, and \
         {:.0} % are needed. It is looked for within {RANGE_MM:.0} mm and {RANGE_DEG:.0} degrees of where it was",
        100.0 * found, 100.0 * LEAST_FOUND
    )]
    NotFound {
        /// The best share.
        found: f64,
    },
    /// Several places fit, and none of them is where it was.
    #[error(
        "the new scan does not show how far the part went in one direction: to {motion}, places {spread_mm:.0} mm apart \
         fit alike. Scan the ends of the part too"
    )]
    Ambiguous {
        /// The motion, in words.
        motion: String,
        /// Distance between places of a weld point, mm.
        spread_mm: f64,
    },
}

/// One cloud of all views, thinned, as the planner does it.
pub fn cloud(views: &[View]) -> PointCloud {
    let patches = normals::of_views(views, &normals::Config::default());
    let registration = reconstruction::register(views, &patches, &reconstruction::Config::default());
    let merged = Merged::new(views, &registration.base_from_camera);
    let scale = downsampling::Scale::of(&merged, &patches, &downsampling::Config::default());
    let mut voxels = downsampling::voxel_grid(&merged, scale.edge_mm, scale.least);
    if views.iter().any(|view| !view.camera_known && view.normals.is_empty()) {
        orientation::propagate(&mut voxels);
    }
    voxels.cloud
}

/// Finds where the part of `program` and `model` is in the cloud `new`.
///
/// # Errors
/// If the saved files hold nothing to go by, or the part is not found.
pub fn refit(program: &[Waypoint], model: &PointCloud, new: &PointCloud) -> Result<Refit, Error> {
    let welds: Vec<Point3<f64>> = program.iter().filter(|w| w.weld).map(|w| w.position_mm).collect();
    if welds.is_empty() {
        return Err(Error::Saved { what: "program has no weld" });
    }
    let part = Part::new(model, &welds);
    if part.surface.len() < 50 {
        return Err(Error::Saved { what: "model has no surface about the welds of its program" });
    }
    let target = Target::new(&with_edges(new), 0.0);
    let many = sample(&part.surface, FINE_POINTS);
    let mut all = sample(&part.edges, FINE_POINTS / 3);
    all.extend(&many);
    let finals = candidates(&part, new).into_iter().map(|start| {
        let pose = align(&all, &target, &start, &part.centre, &FINE_GATES_MM);
        (share(&many, &target, &pose, FOUND_MM), pose)
    });
    let near: Vec<_> = finals.filter(|(_, pose)| is_near(pose, &part.centre)).collect();
    let Some(mut pose) = smallest(&near, &part.welds) else { return Err(Error::NotFound { found: 0.0 }) };
    let found = share(&many, &target, &pose, FOUND_MM);
    if found < LEAST_FOUND {
        return Err(Error::NotFound { found });
    }
    let (mut warnings, mut known) = (Vec::new(), true);
    for axis in hardly_seen(&part, &target, &pose) {
        let settled = settle(&part, &target, &pose, &axis)?;
        pose = settled.pose;
        known &= settled.known;
        // Edges that do not decide would drag the part along the motion.
        if known {
            pose = align(&all, &target, &pose, &part.centre, &FINE_GATES_MM[1..]);
        }
        warnings.extend(settled.warning);
    }
    let fine = Target::new(new, 0.0);
    let found = share(&many, &fine, &pose, FOUND_MM);
    if found < LEAST_FOUND || !is_near(&pose, &part.centre) {
        return Err(Error::NotFound { found });
    }
    let fit = describe(found, pose, &part, rms_mm(&many, &fine, &pose), warnings);
    Ok(Refit { unknown: !known, ..fit })
}

/// The most promising poses of a search with few points, which stops where it finds the part.
fn candidates(part: &Part, new: &PointCloud) -> Vec<Isometry3<f64>> {
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
fn smallest(poses: &[(f64, Isometry3<f64>)], welds: &[Point3<f64>]) -> Option<Isometry3<f64>> {
    let best = poses.iter().map(|(quality, _)| *quality).fold(0.0, f64::max);
    let alike = poses.iter().filter(|(quality, _)| *quality >= best - NEARLY).map(|(_, pose)| *pose);
    let still = Isometry3::identity();
    alike.min_by(|a, b| apart_mm(a, &still, welds).total_cmp(&apart_mm(b, &still, welds)))
}

/// Largest distance of a weld point between two poses, mm.
fn apart_mm(a: &Isometry3<f64>, b: &Isometry3<f64>, welds: &[Point3<f64>]) -> f64 {
    welds.iter().map(|p| (a * p - b * p).norm()).fold(0.0, f64::max)
}

/// Motions, as [`step`] has them, that the surfaces hardly hinder, the freest last.
fn hardly_seen(part: &Part, target: &Target, pose: &Isometry3<f64>) -> Vec<Vector6<f64>> {
    let (some, middle) = (strided(&part.surface, TRAIL_POINTS), pose * part.centre);
    let size_mm = size_mm(&some, &part.centre);
    let Some((_, information)) = step(&some, target, pose, &middle, size_mm, 2.5, None) else {
        return vec![];
    };
    let eigen = SymmetricEigen::new(information);
    let axes = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
    let mut free: Vec<_> = axes.filter(|(seen, _)| **seen < HARDLY_SEEN).collect();
    free.sort_by(|a, b| b.0.total_cmp(a.0));
    free.into_iter().map(|(_, axis)| axis.into_owned()).collect()
}

/// Stride of a weld point along a motion that is examined, mm.
const STRIDE_MM: f64 = 1.5;
const TRAIL_POINTS: usize = 1000;
/// Least part of a patch's normal along a motion for which it counts as facing along it.
const FACING: f64 = 0.5;
/// Fewer patches than this do not decide where the part is, nor patches of which less than this share fits.
const LEAST_FACING: usize = 40;
const LEAST_FIT: f64 = 0.35;
/// Places whose fit is this share of the best one's are possible too.
const RIVAL: f64 = 0.8;
/// Possible places this near to each other are one, mm at a weld point.
const ONE_PLACE_MM: f64 = 5.0;
/// The same for a patch that faces along the motion, mm.
const END_MM: f64 = 3.0;

/// Where along a motion the part is.
struct Settled {
    pose: Isometry3<f64>,
    known: bool,
    warning: Option<String>,
}

/// Decides how far the part went along `axis`, of the places before and after `pose`.
fn settle(
    part: &Part,
    target: &Target,
    pose: &Isometry3<f64>,
    axis: &Vector6<f64>,
) -> Result<Settled, Error> {
    let some = strided(&part.surface, TRAIL_POINTS);
    let ends = facing(part, pose, axis);
    let mut poses = trail(&some, part, target, pose, axis);
    poses.extend(trail(&some, part, target, pose, &-axis));
    poses.push(*pose);
    let fits: Vec<f64> = poses.par_iter().map(|pose| fit(&ends, target, pose)).collect();
    let peak = fits.iter().copied().fold(0.0, f64::max);
    let decisive = ends.len() >= LEAST_FACING && peak >= LEAST_FIT;
    let qualities: Vec<f64> = match decisive {
        true => fits.iter().map(|fit| fit / peak).collect(),
        false => poses.par_iter().map(|pose| share(&some, target, pose, FOUND_MM)).collect(),
    };
    let best = qualities.iter().copied().fold(0.0, f64::max);
    let least = if decisive { RIVAL } else { best - NEARLY };
    let rated = qualities.iter().copied().zip(poses.iter().copied());
    let rivals: Vec<(f64, Isometry3<f64>)> = rated.filter(|(quality, _)| *quality >= least).collect();
    let top = rivals.iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(*pose, |rival| rival.1);
    let rival_poses = || rivals.iter().map(|rival| &rival.1);
    let from_top_mm = rival_poses().map(|rival| apart_mm(rival, &top, &part.welds)).fold(0.0, f64::max);
    let motion = in_words(axis);
    if from_top_mm <= ONE_PLACE_MM {
        let warning = || {
            format!(
                "only the ends of the part show how far it went to {motion}: check where the welds begin and end"
            )
        };
        return Ok(Settled { pose: top, known: true, warning: decisive.then(warning) });
    }
    let still = Isometry3::identity();
    let moved_mm = |pose: &Isometry3<f64>| apart_mm(pose, &still, &part.welds);
    let pose = *rival_poses().min_by(|a, b| moved_mm(a).total_cmp(&moved_mm(b))).unwrap_or(&top);
    let spread_mm = rival_poses().map(|rival| apart_mm(rival, &pose, &part.welds)).fold(0.0, f64::max);
    let least_mm = poses.iter().map(moved_mm).fold(f64::INFINITY, f64::min);
    if moved_mm(&pose) > least_mm + ONE_PLACE_MM {
        return Err(Error::Ambiguous { motion, spread_mm });
    }
    let warning = format!(
        "UNKNOWN: the scan does not show how far the part went to {motion}: weld points may be {spread_mm:.0} mm off along \
         it. The smallest motion was taken; check where the welds begin and end before the program is run"
    );
    Ok(Settled { pose, known: false, warning: Some(warning) })
}

fn in_words(axis: &Vector6<f64>) -> String {
    let (turn, shift) = (axis.fixed_rows::<3>(0), axis.fixed_rows::<3>(3));
    let (what, v) = if turn.norm() > shift.norm() { ("turn about", turn) } else { ("move along", shift) };
    let v = v.normalize();
    format!("{what} ({:.2}, {:.2}, {:.2})", v.x, v.y, v.z)
}

/// Poses along a motion, one stride after another, held against the surfaces in all other directions.
fn trail(
    some: &[Patch],
    part: &Part,
    target: &Target,
    pose: &Isometry3<f64>,
    axis: &Vector6<f64>,
) -> Vec<Isometry3<f64>> {
    let size_mm = size_mm(some, &part.centre);
    let moved = |pose: &Isometry3<f64>, by: &Vector6<f64>| {
        let turn = by.fixed_rows::<3>(0) / size_mm;
        about(&(pose * part.centre), &turn, &by.fixed_rows::<3>(3).into_owned()) * pose
    };
    let held = |pose: Isometry3<f64>| {
        let step = step(some, target, &pose, &(pose * part.centre), size_mm, 4.0, Some(axis));
        step.map_or(pose, |(step, _)| moved(&pose, &step))
    };
    let next = |pose: &Isometry3<f64>| Some(held(held(moved(pose, &(axis * STRIDE_MM)))));
    // Twice the range and its slack: the pose to start from may lie at one end of it.
    let most = (4.0 * SLACK * RANGE_MM / STRIDE_MM) as usize;
    let poses = std::iter::successors(next(pose), next).take(most);
    poses.take_while(|pose| is_near(pose, &part.centre)).collect()
}

/// Surfaces and edges that face along a motion.
fn facing(part: &Part, pose: &Isometry3<f64>, axis: &Vector6<f64>) -> Vec<Patch> {
    let (middle, size_mm) = (pose * part.centre, size_mm(&part.surface, &part.centre));
    let faces = |(p, n): &&Patch| {
        let (arm, normal) = (pose * p - middle, pose.rotation * n);
        let turn = arm.cross(&normal) / size_mm;
        (turn.dot(&axis.fixed_rows::<3>(0)) + normal.dot(&axis.fixed_rows::<3>(3))).abs() > FACING
    };
    let all: Vec<Patch> = part.surface.iter().chain(&part.edges).filter(faces).copied().collect();
    strided(&all, TRAIL_POINTS)
}

/// How well the patches lie on the target: 1 all, 0 none within [`END_MM`].
fn fit(patches: &[Patch], target: &Target, pose: &Isometry3<f64>) -> f64 {
    let one = |(p, n): &Patch| {
        let place = pose * p;
        let hit = target.nearest(&place, &(pose.rotation * n), 2.0 * END_MM as f32);
        hit.map_or(0.0, |(q, normal)| (1.0 - (normal.dot(&(place - q)) / END_MM).powi(2)).max(0.0))
    };
    patches.iter().map(one).sum::<f64>() / patches.len().max(1) as f64
}

/// At most about `count` of the patches, evenly.
fn strided(patches: &[Patch], count: usize) -> Vec<Patch> {
    patches.iter().step_by(patches.len().div_ceil(count).max(1)).copied().collect()
}

/// The program where the part is now.
pub fn moved(program: &[Waypoint], new_from_old: &Isometry3<f64>) -> Vec<Waypoint> {
    let moved = |waypoint: &Waypoint| Waypoint {
        position_mm: new_from_old * waypoint.position_mm,
        base_from_torch: new_from_old.rotation * waypoint.base_from_torch,
        ..*waypoint
    };
    program.iter().map(moved).collect()
}

/// Farther than this beyond the range a round or repeated part is likely to be mistaken for itself.
const SLACK: f64 = 1.5;

fn is_near(pose: &Isometry3<f64>, centre: &Point3<f64>) -> bool {
    let moved_mm = (pose * centre - centre).norm();
    moved_mm < SLACK * RANGE_MM && pose.rotation.angle().to_degrees() < SLACK * RANGE_DEG
}

fn describe(found: f64, pose: Isometry3<f64>, part: &Part, rms_mm: f64, mut warnings: Vec<String>) -> Refit {
    let moved_mm = (pose * part.centre - part.centre).norm();
    let turned_deg = pose.rotation.angle().to_degrees();
    if moved_mm > RANGE_MM || turned_deg > RANGE_DEG {
        warnings.push(format!(
            "the part moved by {moved_mm:.0} mm and {turned_deg:.0} degrees, more than {RANGE_MM:.0} mm and \
             {RANGE_DEG:.0} degrees: look at the result before it is run"
        ));
    }
    Refit { new_from_old: pose, found, rms_mm, moved_mm, turned_deg, unknown: false, warnings }
}

/// A place on a surface and its normal, or on an edge and the way out of the surface there; base frame.
type Patch = (Point3<f64>, Vector3<f64>);

/// The model about the welds.
struct Part {
    surface: Vec<Patch>,
    edges: Vec<Patch>,
    centre: Point3<f64>,
    welds: Vec<Point3<f64>>,
}

impl Part {
    fn new(model: &PointCloud, welds: &[Point3<f64>]) -> Self {
        let local: Vec<Point3<f32>> =
            welds.iter().map(|p| Point3::from((p - model.origin_mm).cast())).collect();
        let grid = Grid::new(&local, ABOUT_WELDS_MM as f32);
        let near = |p: &Point3<f32>| grid.nearest(p, ABOUT_WELDS_MM as f32, |_| true).is_some();
        let whole = with_edges(model);
        let (mut surface, mut edges) = (Vec::new(), Vec::new());
        for k in (0..whole.len()).filter(|&k| near(&whole.points_mm[k])) {
            let patch = (whole.in_base_mm(k), whole.normals[k].cast());
            if k < model.len() { surface.push(patch) } else { edges.push(patch) }
        }
        let welds = welds.iter().step_by(welds.len().div_ceil(200).max(1)).copied().collect();
        let sum: Vector3<f64> = surface.iter().map(|(p, _)| p.coords).sum();
        Self { centre: Point3::from(sum / surface.len().max(1) as f64), surface, edges, welds }
    }
}

/// So many patches, taken in turn from every direction that they face.
fn sample(patches: &[Patch], count: usize) -> Vec<Patch> {
    let bin = |n: &Vector3<f64>| n.iter().fold(0, |bin, v| 7 * bin + ((v * 3.0).round() + 3.0) as usize);
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); 343];
    for (k, (_, n)) in patches.iter().enumerate() {
        members[bin(n).min(342)].push(k);
    }
    members.retain(|m| !m.is_empty());
    members.sort_by_key(Vec::len);
    let (mut left, mut chosen) = (count, Vec::with_capacity(count));
    for (k, m) in members.iter().enumerate() {
        let share = (left / (members.len() - k)).min(m.len());
        left -= share;
        chosen.extend((0..share).map(|s| patches[m[s * m.len() / share]]));
    }
    chosen
}

/// Neighbours of an edge are looked for within this, mm.
const EDGE_REACH_MM: f32 = 4.0;
/// Least distance of their centroid, in reaches, at an edge: a half disc has 0.42, a whole one 0.
const EDGE: f32 = 0.3;

/// Where beyond an edge there is looked for what lies behind it, mm: the middle and radius of a ball.
const BEYOND_MM: f32 = 14.0;
const BEYOND_RADIUS_MM: f32 = 10.0;
/// What lies beyond an edge nearer to its plane than this, mm, is more of the same surface.
const SAME_PLANE_MM: f32 = 1.5;

/// Whether a surface ends at an edge because something else was seen behind it: neither the rim of a picture, beyond which
/// nothing was seen, nor a hole or a shadow, beyond which the surface goes on.
fn is_end(grid: &Grid, p: &Point3<f32>, n: &Vector3<f32>, out: &Vector3<f32>) -> bool {
    let (mut other, mut same) = (false, false);
    grid.within(&(p + out * BEYOND_MM), BEYOND_RADIUS_MM, |slot, _| {
        let on_plane = n.dot(&(grid.point(slot) - p)).abs() < SAME_PLANE_MM;
        same |= on_plane;
        other |= !on_plane;
    });
    other && !same
}

/// The cloud and, behind its points, its edges once more, with the direction out of the surface as their normal.
fn with_edges(cloud: &PointCloud) -> PointCloud {
    let grid = Grid::new(&cloud.points_mm, EDGE_REACH_MM);
    let edge = |k: usize| {
        let (p, n) = (cloud.points_mm[k], cloud.normals[k]);
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        grid.within(&p, EDGE_REACH_MM, |slot, _| {
            if cloud.normals[grid.index(slot)].dot(&n) > MIN_NORMAL_DOT {
                sum += grid.point(slot) - p;
                count += 1.0;
            }
        });
        let centroid = sum / f32::max(count, 1.0);
        let out = -(centroid - n * n.dot(&centroid));
        if count <= 4.0 || out.norm() <= EDGE * EDGE_REACH_MM {
            return None;
        }
        let out = out.normalize();
        is_end(&grid, &p, &n, &out).then_some((p, out))
    };
    let edges: Vec<_> = (0..cloud.len()).into_par_iter().filter_map(edge).collect();
    let mut all = cloud.clone();
    for (p, out) in edges {
        all.points_mm.push(p);
        all.normals.push(out);
    }
    all
}

/// The new cloud, ready to be asked for what is near.
struct Target {
    origin: Point3<f64>,
    grid: Grid,
    normals: Vec<Vector3<f32>>,
}

impl Target {
    /// Thinned to one point per cell of `cell_mm`; 0 keeps all.
    fn new(cloud: &PointCloud, cell_mm: f32) -> Self {
        let kept: Vec<usize> = match cell_mm > 0.0 {
            true => {
                let cells = Grid::new(&cloud.points_mm, cell_mm);
                cells.occupied().map(|(_, run)| cells.index(run.start)).collect()
            }
            false => (0..cloud.len()).collect(),
        };
        let points: Vec<_> = kept.iter().map(|&k| cloud.points_mm[k]).collect();
        let grid = Grid::new(&points, cell_mm.max(2.5));
        let normals = (0..grid.len()).map(|slot| cloud.normals[kept[grid.index(slot)]]).collect();
        Self { origin: cloud.origin_mm, grid, normals }
    }

    /// Nearest point with about this normal, and its own normal.
    fn nearest(&self, p: &Point3<f64>, n: &Vector3<f64>, gate_mm: f32) -> Option<Patch> {
        let local = Point3::from((p - self.origin).cast::<f32>());
        let facing: Vector3<f32> = n.cast();
        let same_side = |slot: usize| self.normals[slot].dot(&facing) > MIN_NORMAL_DOT;
        let (slot, _) = self.grid.nearest(&local, gate_mm, same_side)?;
        Some((self.origin + self.grid.point(slot).coords.cast::<f64>(), self.normals[slot].cast()))
    }
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

/// A turn about `centre`, then a shift.
fn about(centre: &Point3<f64>, turn_rad: &Vector3<f64>, shift_mm: &Vector3<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(*turn_rad);
    let shift = centre.coords - turn * centre.coords + shift_mm;
    Isometry3::from_parts(Translation3::from(shift), turn)
}

/// Point-to-plane ICP from `start`.
fn align(
    part: &[Patch],
    target: &Target,
    start: &Isometry3<f64>,
    centre: &Point3<f64>,
    gates_mm: &[f32],
) -> Isometry3<f64> {
    let size_mm = size_mm(part, centre);
    let mut pose = *start;
    for &gate_mm in gates_mm {
        for _ in 0..ITERATIONS {
            let middle = pose * centre;
            let Some((step, _)) = step(part, target, &pose, &middle, size_mm, gate_mm, None) else { break };
            let turn = step.fixed_rows::<3>(0) / size_mm;
            pose = about(&middle, &turn, &step.fixed_rows::<3>(3).into_owned()) * pose;
            if step.norm() < 1e-3 {
                break;
            }
        }
    }
    pose
}

/// Root mean square distance from the middle of the part: turns rotations into lengths.
fn size_mm(part: &[Patch], centre: &Point3<f64>) -> f64 {
    let spread =
        part.iter().map(|(p, _)| (p - centre).norm_squared()).sum::<f64>() / part.len().max(1) as f64;
    spread.sqrt().max(1e-3)
}

/// One linear step but not along `held`, rotations in mm at the size of the part, and what the pairs see of each motion: 1 is seen in full.
fn step(
    part: &[Patch],
    target: &Target,
    pose: &Isometry3<f64>,
    middle: &Point3<f64>,
    size_mm: f64,
    gate_mm: f32,
    held: Option<&Vector6<f64>>,
) -> Option<(Vector6<f64>, Matrix6<f64>)> {
    let (mut a, mut b, mut weight) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    // A third of the gate is what Geman-McClure still believes.
    let scale_mm = f64::from(gate_mm) / 3.0;
    for (p, n) in part {
        let place = pose * p;
        let Some((q, normal)) = target.nearest(&place, &(pose.rotation * n), gate_mm) else { continue };
        let residual = normal.dot(&(place - q));
        let w = (1.0 + (residual / scale_mm).powi(2)).powi(-2);
        let turn = (place - middle).cross(&normal) / size_mm;
        let row = Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z);
        a.ger(w, &row, &row, 1.0);
        b.axpy(-w * residual, &row, 1.0);
        weight += w;
    }
    if weight < 6.0 {
        return None;
    }
    let information = a / weight;
    // What is not seen is not moved.
    let stiff = held.map_or(Matrix6::zeros(), |axis| axis * axis.transpose() * 1e3);
    let damped = information + Matrix6::identity() * 1e-4 + stiff;
    damped.cholesky().map(|factor| (factor.solve(&(b / weight)), information))
}

/// Share of the part that lies within `within_mm` of the target.
fn share(part: &[Patch], target: &Target, pose: &Isometry3<f64>, within_mm: f32) -> f64 {
    let near = |(p, n): &&Patch| {
        let place = pose * p;
        let reach_mm = (2.0 * within_mm).max(target.grid.cell_mm());
        let hit = target.nearest(&place, &(pose.rotation * n), reach_mm);
        hit.is_some_and(|(q, normal)| normal.dot(&(place - q)).abs() < f64::from(within_mm))
    };
    part.iter().filter(near).count() as f64 / part.len().max(1) as f64
}

fn rms_mm(part: &[Patch], target: &Target, pose: &Isometry3<f64>) -> f64 {
    let residual = |(p, n): &Patch| {
        let place = pose * p;
        let (q, normal) = target.nearest(&place, &(pose.rotation * n), FOUND_MM)?;
        Some(normal.dot(&(place - q)))
    };
    let squares: Vec<f64> = part.iter().filter_map(residual).map(|r| r * r).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}
