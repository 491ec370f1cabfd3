//! A saved program on a part that has moved (ours): the saved model is laid over a new scan, and the program moves with it.
//!
//! Point-to-plane ICP as in [`crate::reconstruction`], but of one rigid cloud onto another, from a pose that nobody
//! reported: so first from many poses about the old one with few points, then finely from the best of them. Only the
//! model about the welds counts, as the table need not have moved. Directions in which surfaces are common (the faces
//! of plates) are sampled no more often than rare ones. Where a surface ends, its edge counts as a surface of its own that
//! faces out of it in its plane: a straight groove in flat plates is held along its length by nothing else.

use nalgebra::{Isometry3, Matrix6, Point3, SymmetricEigen, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

use crate::cloud::{Merged, PointCloud, View};
use crate::grid::Grid;
use crate::toolpath::program::Waypoint;
use crate::{downsampling, normals, orientation, reconstruction};

/// Motion about the middle of the part that is found, mm in any direction; held by tests on a fillet and a lap joint.
pub const RANGE_MM: f64 = 50.0;
/// The same for its rotation about any axis, degrees.
pub const RANGE_DEG: f64 = 20.0;

/// The model counts this far from the welds, mm: both plates' edges of common parts.
const ABOUT_WELDS_MM: f64 = 40.0;
/// Points of the model in the search, and in the fine alignment.
const COARSE_POINTS: usize = 400;
const FINE_POINTS: usize = 6000;
/// Largest distances of a pair, mm, one round after another.
const COARSE_GATES_MM: [f32; 4] = [60.0, 40.0, 20.0, 10.0];
const FINE_GATES_MM: [f32; 3] = [8.0, 4.0, 2.5];
const ITERATIONS: usize = 12;
/// How near a point of the model has to come to the new cloud to count as found, mm.
const FOUND_MM: f32 = 1.5;
/// Least share of the model that has to be found.
const LEAST_FOUND: f64 = 0.7;
/// Least agreement of two normals that may be the same surface.
const MIN_NORMAL_DOT: f32 = 0.7;
/// Share of information, of a motion that every pair sees in full, below which a motion counts as unseen.
const UNSEEN: f64 = 0.01;
/// Candidates of the search that are aligned finely.
const FINALISTS: usize = 4;

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
    let coarse = Target::new(new, 4.0);
    let few = sample(&part.surface, COARSE_POINTS);
    let mut candidates: Vec<(f64, Isometry3<f64>)> = starts(&part.centre)
        .par_iter()
        .map(|start| {
            let pose = align(&few, &coarse, start, &part.centre, &COARSE_GATES_MM);
            (share(&few, &coarse, &pose, 2.0 * FOUND_MM), pose)
        })
        .collect();
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
    let fine = Target::new(new, 0.0);
    let with_edges = Target::new(&with_edges(new), 0.0);
    let many = sample(&part.surface, FINE_POINTS);
    let mut all = sample(&part.edges, FINE_POINTS / 3);
    all.extend(&many);
    let finals = candidates.iter().take(FINALISTS).map(|(_, start)| {
        let pose = align(&all, &with_edges, start, &part.centre, &FINE_GATES_MM);
        (share(&all, &with_edges, &pose, FOUND_MM), pose)
    });
    let best = finals.filter(|(_, pose)| is_near(pose, &part.centre)).max_by(|a, b| a.0.total_cmp(&b.0));
    let best = best.map(|(_, pose)| pose);
    let found = best.map_or(0.0, |pose| share(&many, &fine, &pose, FOUND_MM));
    match best {
        Some(pose) if found >= LEAST_FOUND => {
            let gate_mm = FINE_GATES_MM[FINE_GATES_MM.len() - 1];
            let middle = pose * part.centre;
            let seen = step(&many, &fine, &pose, &middle, size_mm(&many, &part.centre), gate_mm);
            let information = seen.map_or(Matrix6::zeros(), |(_, information)| information);
            Ok(describe(found, pose, &information, &part, rms_mm(&many, &fine, &pose)))
        }
        _ => Err(Error::NotFound { found }),
    }
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

fn describe(found: f64, pose: Isometry3<f64>, information: &Matrix6<f64>, part: &Part, rms_mm: f64) -> Refit {
    let moved_mm = (pose * part.centre - part.centre).norm();
    let turned_deg = pose.rotation.angle().to_degrees();
    let mut warnings = Vec::new();
    if moved_mm > RANGE_MM || turned_deg > RANGE_DEG {
        warnings.push(format!(
            "the part moved by {moved_mm:.0} mm and {turned_deg:.0} degrees, more than {RANGE_MM:.0} mm and \
             {RANGE_DEG:.0} degrees: look at the result before it is run"
        ));
    }
    let eigen = SymmetricEigen::new(*information);
    for (seen, axis) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *seen < UNSEEN {
            let (turn, shift) = (axis.fixed_rows::<3>(0), axis.fixed_rows::<3>(3));
            let (what, v) =
                if turn.norm() > shift.norm() { ("turn about", turn) } else { ("move along", shift) };
            warnings.push(format!(
                "no surface about the welds hinders the part to {what} ({:.2}, {:.2}, {:.2}), at most its edges do: check \
                 where the welds begin and end",
                v.x, v.y, v.z
            ));
        }
    }
    Refit { new_from_old: pose, found, rms_mm, moved_mm, turned_deg, warnings }
}

/// A place on a surface and its normal, or on an edge and the way out of the surface there; base frame.
type Patch = (Point3<f64>, Vector3<f64>);

/// The model about the welds.
struct Part {
    surface: Vec<Patch>,
    edges: Vec<Patch>,
    centre: Point3<f64>,
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
        let sum: Vector3<f64> = surface.iter().map(|(p, _)| p.coords).sum();
        Self { centre: Point3::from(sum / surface.len().max(1) as f64), surface, edges }
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
        (count > 4.0 && out.norm() > EDGE * EDGE_REACH_MM).then(|| (p, out.normalize()))
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

/// Poses from which the search begins: turns about the middle of the part by none or 14 degrees about every axis, where
/// it was and 30 mm to every side.
fn starts(centre: &Point3<f64>) -> Vec<Isometry3<f64>> {
    let turns = (0..27).map(|k| {
        let axis = Vector3::new(f64::from(k % 3) - 1.0, f64::from(k / 3 % 3) - 1.0, f64::from(k / 9) - 1.0);
        axis.try_normalize(0.5).map_or(Vector3::zeros(), |axis| axis * 14f64.to_radians())
    });
    let sides = [
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
    ];
    turns.flat_map(|turn| sides.map(|side| about(centre, &turn, &(Vector3::from(side) * 30.0)))).collect()
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
            let Some((step, _)) = step(part, target, &pose, &middle, size_mm, gate_mm) else { break };
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

/// One linear step, rotations in mm at the size of the part, and what the pairs see of each motion: 1 is seen in full.
fn step(
    part: &[Patch],
    target: &Target,
    pose: &Isometry3<f64>,
    middle: &Point3<f64>,
    size_mm: f64,
    gate_mm: f32,
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
    let damped = information + Matrix6::identity() * 1e-4;
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
