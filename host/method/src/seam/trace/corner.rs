//! Two faces fitted to the surroundings of one point, and the corner in which they meet (ours).
//!
//! The paper's edge points lie 0.65 to 0.9 mm out of a 90 degree corner. Here the points around a candidate are split into two
//! planes by a few rounds of assignment and fit; the candidate is moved onto the line in which they intersect.

use super::InsideCorner;
use crate::geometry::grid::Grid;
use crate::geometry::grid::lanes::LANES;
use crate::geometry::plane::Moments;
use crate::seam::input::{RawScan, SurfaceModel};
use crate::seam::score::edges::Scores;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::ops::Range;
use wide::f32x8;

/// When a fit is a corner. The defaults were chosen on the simulated scans.
#[derive(Debug, Clone, Copy)]
pub struct CornerConfig {
    /// Radius of the surroundings, voxels.
    pub radius_voxels: f32,
    /// Distance from a plane within which a point belongs to it, voxels.
    pub tolerance_voxels: f32,
    /// Least and largest angle between the faces, measured through the air, degrees.
    pub angle_deg: (f32, f32),
    /// Farthest that either face may begin from the line, voxels.
    pub reach_voxels: f32,
    /// Least share of the points that lie on the two faces.
    pub least_share: f32,
    /// Farthest that the candidate may be from the line, voxels.
    pub move_voxels: f32,
    /// Whether a third face is tried where the first two make no corner. One view does not see both sides of a rib: what
    /// looks a third way there is noise where one thing hides another.
    pub third_face: bool,
    /// Whether points that face one way may be of two layers. Where no camera tells what hides what, a model's hidden faces lie
    /// in layers, too.
    pub layers: bool,
}

impl Default for CornerConfig {
    fn default() -> Self {
        Self {
            radius_voxels: 6.25,
            tolerance_voxels: 0.5,
            angle_deg: (25.0, 155.0),
            reach_voxels: 2.5,
            least_share: 0.45,
            move_voxels: 3.3,
            third_face: true,
            layers: true,
        }
    }
}

impl CornerConfig {
    /// The same for a scan: what its cameras do not tell is not looked for.
    pub(crate) fn for_scan(&self, scan: &RawScan) -> Self {
        let third_face = self.third_face && scan.merged.cameras_mm.len() > 1;
        Self { third_face, layers: self.layers && scan.cameras_known, ..*self }
    }
}

// All chosen on the simulated scans.

/// Cells in which the surroundings are looked up, in their radius.
const CELL_RADII: f32 = 0.5;
/// Fewer points show no two faces; so many of their normals, evenly, are tried as seeds of a face.
const LEAST_POINTS: usize = 20;
const SEEDS: usize = 24;
/// Cosines of normals that agree with a seed, of those that may seed the second face, and how many must agree with that.
const AGREE: f32 = 0.93;
const DIFFER: f32 = 0.94;
const LEAST_AGREEING: u32 = 6;
/// Cosine below which a third face looks another way than the second: 72 degrees or more, so the end or the other side of
/// a rib and not what noise or a bend makes of the second.
const TURNED: f32 = 0.3;
/// Rounds of assignment and fit.
const ROUNDS: usize = 4;
/// Cosine between a point's normal and its face's: while only the seeds are known, and once there are planes.
const ASSIGNED: f32 = 0.9;
const ON_FACE: f32 = 0.7;
/// Fewer points make no face; faces that meet at a lesser sine make no line.
const LEAST_ON_FACE: f32 = 8.0;
const LEAST_SINE: f32 = 0.3;
/// Shares of each face, and of both together, in front of the other at an inside corner.
const LEAST_IN_FRONT: f32 = 0.35;
const BOTH_IN_FRONT: f32 = 1.2;
/// Largest share of the points of a layer that may lie next to it, where there is another.
const MOST_BETWEEN: f32 = 0.25;
/// Where a face begins, its points are off the other by more than this many tolerances.
const CLEAR: f32 = 1.1;

/// A fitted plane about a candidate, which is the origin.
struct Face {
    normal: Vector3<f32>,
    offset: f32,
    count: usize,
}

/// The candidates that pass the gate, moved onto the line in which their faces meet.
pub fn corners(model: &SurfaceModel, scores: &Scores, config: &CornerConfig) -> Vec<InsideCorner> {
    corners_at(model, &scores.candidates(), config)
}

/// The same of these points of the model.
pub(crate) fn corners_at(
    model: &SurfaceModel,
    candidates: &[usize],
    config: &CornerConfig,
) -> Vec<InsideCorner> {
    let radius_mm = config.radius_voxels * model.voxel_mm();
    let cloud = &model.voxels.cloud;
    let grid = Grid::new(&cloud.points_mm, CELL_RADII * radius_mm);
    let normals = grid.by_slot(&cloud.normals);
    candidates
        .par_iter()
        .map_init(Vec::new, |near, &k| {
            let at = cloud.points_mm[k];
            near.clear();
            grid.within(&at, radius_mm, |slot, _| {
                near.push(Near { offset: grid.point(slot) - at, normal: normals[slot] });
            });
            fit(near, &at, model.voxel_mm(), config)
        })
        .flatten()
        .collect()
}

/// A neighbour of a candidate: its offset from it, mm, and its normal.
#[derive(Debug, Clone, Copy)]
struct Near {
    /// From the candidate, mm.
    offset: Vector3<f32>,
    /// Unit, toward the camera.
    normal: Vector3<f32>,
}

/// The corner near the candidate at `at`, if there is one.
///
/// Its first face is the largest. The second is the next, or, if these make no corner, the next that looks another way:
/// on a plate beside a thin rib both sides of the rib are near, and its end.
fn fit(points: &[Near], at: &Point3<f32>, voxel_mm: f32, config: &CornerConfig) -> Option<InsideCorner> {
    let seeds = Seeds::among(points)?;
    let (_, first) = seeds.best(|_| true)?;
    let differs = |n: &Vector3<f32>| n.dot(&first).abs() <= DIFFER;
    let agreed = |(count, n): (u32, Vector3<f32>)| (count >= LEAST_AGREEING).then_some(n);
    let second = seeds.best(differs).and_then(agreed)?;
    let corner = |other| between([first, other], points, at, voxel_mm, config);
    corner(second).or_else(|| {
        let turned = |n: &Vector3<f32>| differs(n) && n.dot(&second) < TURNED;
        let third = config.third_face.then(|| seeds.best(turned)).flatten().and_then(agreed)?;
        corner(third)
    })
}

/// The corner between the faces that begin with these normals.
fn between(
    mut normals: [Vector3<f32>; 2],
    points: &[Near],
    at: &Point3<f32>,
    voxel_mm: f32,
    config: &CornerConfig,
) -> Option<InsideCorner> {
    let tolerance = config.tolerance_voxels * voxel_mm;
    let mut faces: Option<[Face; 2]> = None;
    for _ in 0..ROUNDS {
        let fitted = round(points, &normals, faces.as_ref(), tolerance, config.layers)?;
        normals = [fitted[0].normal, fitted[1].normal];
        faces = Some(fitted);
    }
    let [a, b] = faces?;
    let line = Line::of(&a, &b);
    let opening_deg = 180.0 - line.cosine.clamp(-1.0, 1.0).acos().to_degrees();
    if !(config.angle_deg.0..=config.angle_deg.1).contains(&opening_deg) {
        return None;
    }
    let in_front = [in_front(points, &a, &b, tolerance), in_front(points, &b, &a, tolerance)];
    let concave = in_front[0].min(in_front[1]) > LEAST_IN_FRONT && in_front[0] + in_front[1] > BOTH_IN_FRONT;
    if !concave || line.foot.norm() > config.move_voxels * voxel_mm {
        return None;
    }
    let share = (a.count + b.count) as f32 / points.len() as f32;
    let begins = [line.begins(points, &a, &b, tolerance), line.begins(points, &b, &a, tolerance)];
    if share < config.least_share || begins[0].max(begins[1]) > config.reach_voxels * voxel_mm {
        return None;
    }
    let faces = [a.normal, b.normal];
    Some(InsideCorner { position: at + line.foot, direction: line.direction, faces, share })
}

/// Where two faces meet.
struct Line {
    /// The point of both planes nearest to the candidate, from it, mm.
    foot: Vector3<f32>,
    direction: Vector3<f32>,
    /// Between the normals.
    cosine: f32,
}

impl Line {
    fn of(a: &Face, b: &Face) -> Self {
        let along = a.normal.cross(&b.normal);
        let sine = along.norm();
        let cosine = a.normal.dot(&b.normal);
        let (wa, wb) =
            ((a.offset - cosine * b.offset) / (sine * sine), (b.offset - cosine * a.offset) / (sine * sine));
        Self { foot: a.normal * wa + b.normal * wb, direction: along / sine, cosine }
    }

    /// Distance from the line at which a face begins, mm.
    fn begins(&self, points: &[Near], face: &Face, other: &Face, tolerance: f32) -> f32 {
        let mut nearest = f32::MAX;
        for p in points {
            let on = (p.offset.dot(&face.normal) - face.offset).abs() < tolerance;
            let clear = (p.offset.dot(&other.normal) - other.offset).abs() > CLEAR * tolerance;
            if on && clear {
                let d = p.offset - self.foot;
                nearest = nearest.min((d - self.direction * d.dot(&self.direction)).norm());
            }
        }
        nearest
    }
}

/// The normals about a candidate, some of which are tried as seeds of a face.
struct Seeds<'a> {
    points: &'a [Near],
    normals: Vec<[f32x8; 3]>,
}

impl<'a> Seeds<'a> {
    fn among(points: &'a [Near]) -> Option<Self> {
        (points.len() >= LEAST_POINTS).then(|| Self { points, normals: in_lanes(points) })
    }

    /// Of the normals that may be one, the one that most others agree with, and how many.
    fn best(&self, may_be: impl Fn(&Vector3<f32>) -> bool) -> Option<(u32, Vector3<f32>)> {
        let step = (self.points.len() / SEEDS).max(1);
        let tried = self.points.iter().step_by(step).map(|p| p.normal).filter(|n| may_be(n));
        tried.map(|n| (self.support(&n), n)).max_by_key(|(count, _)| *count)
    }

    fn support(&self, n: &Vector3<f32>) -> u32 {
        let agree = |[x, y, z]: &[f32x8; 3]| {
            (*x * n.x + *y * n.y + *z * n.z).simd_gt(f32x8::splat(AGREE)).to_bitmask().count_ones()
        };
        self.normals.iter().map(agree).sum()
    }
}

/// The points' normals, eight at a time; 0 beyond the last.
fn in_lanes(points: &[Near]) -> Vec<[f32x8; 3]> {
    let eight = |near: &[Near]| {
        [0, 1, 2].map(|axis| {
            let mut lanes = [0.0; LANES];
            lanes.iter_mut().zip(near).for_each(|(lane, p)| *lane = p.normal[axis]);
            f32x8::new(lanes)
        })
    };
    points.chunks(LANES).map(eight).collect()
}

/// Assigns points to the nearer face and fits both; by normals until there are planes.
fn round(
    points: &[Near],
    normals: &[Vector3<f32>; 2],
    faces: Option<&[Face; 2]>,
    tolerance: f32,
    layers: bool,
) -> Option<[Face; 2]> {
    let mut moments = [Moments::default(); 2];
    for p in points {
        let agree = [p.normal.dot(&normals[0]), p.normal.dot(&normals[1])];
        let (mine, belongs) = match faces {
            None => {
                let mine = usize::from(agree[1] > agree[0]);
                (mine, agree[mine] > ASSIGNED)
            }
            Some(f) => {
                let miss = [0, 1].map(|k| (p.offset.dot(&f[k].normal) - f[k].offset).abs());
                let mine = usize::from(miss[1] < miss[0]);
                (mine, miss[mine] < tolerance && agree[mine] > ON_FACE)
            }
        };
        if belongs {
            moments[mine].add(p.offset);
        }
    }
    let mut face = |k: usize| {
        let mut plane = moments[k].plane();
        if layers && faces.is_none() && plane.variance_mm2 > tolerance * tolerance {
            let own = points.iter().filter(|p| p.normal.dot(&normals[k]) > ASSIGNED);
            if let Some(layer) = fuller_layer(own.map(|p| p.offset), &normals[k], tolerance) {
                moments[k] = layer;
                plane = layer.plane();
            }
        }
        let normal = if plane.normal.dot(&normals[k]) < 0.0 { -plane.normal } else { plane.normal };
        (moments[k].count >= LEAST_ON_FACE).then(|| Face {
            normal,
            offset: plane.mean.dot(&normal),
            count: moments[k].count as usize,
        })
    };
    let faces = [face(0)?, face(1)?];
    (faces[0].normal.cross(&faces[1].normal).norm() > LEAST_SINE).then_some(faces)
}

/// The points of one face where those that face along a normal lie in two layers, as on a plate and on what it lies on: those of the
/// fuller one. A face that bends has points at every height.
fn fuller_layer(
    points: impl Iterator<Item = Vector3<f32>>,
    normal: &Vector3<f32>,
    tolerance: f32,
) -> Option<Moments> {
    let mut sorted: Vec<(f32, Vector3<f32>)> = points.map(|p| (normal.dot(&p), p)).collect();
    sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let layer = fullest(&sorted, tolerance);
    let (low, high) =
        (sorted.get(layer.start)?.0 - 2.0 * tolerance, sorted[layer.end - 1].0 + 2.0 * tolerance);
    let below = sorted.partition_point(|p| p.0 < low);
    let above = sorted.partition_point(|p| p.0 <= high);
    let other = fullest(&sorted[..below], tolerance).len().max(fullest(&sorted[above..], tolerance).len());
    let beside = (layer.start - below).max(above - layer.end) as f32;
    let mut moments = Moments::default();
    sorted[layer.clone()].iter().for_each(|(_, p)| moments.add(*p));
    (other as f32 >= LEAST_ON_FACE && beside <= MOST_BETWEEN * layer.len() as f32).then_some(moments)
}

/// Where most of some points are within the tolerance of one height, by which they are sorted.
fn fullest(sorted: &[(f32, Vector3<f32>)], tolerance: f32) -> Range<usize> {
    let (mut to, mut fullest) = (0, 0..0);
    for (from, (height, _)) in sorted.iter().enumerate() {
        to += sorted[to..].iter().take_while(|p| p.0 < height + 2.0 * tolerance).count();
        if to - from > fullest.len() {
            fullest = from..to;
        }
    }
    fullest
}

/// Share of a face that lies in front of the other: 1 at an inside corner, 0 at an outside one, a half where the face
/// goes on behind the other, as in a model that shows hidden surfaces.
fn in_front(points: &[Near], face: &Face, other: &Face, tolerance: f32) -> f32 {
    let (mut front, mut clear) = (0.0f32, 0.0f32);
    for p in points.iter().filter(|p| (p.offset.dot(&face.normal) - face.offset).abs() < tolerance) {
        let height = p.offset.dot(&other.normal) - other.offset;
        if height.abs() > tolerance {
            clear += 1.0;
            front += f32::from(u8::from(height > 0.0));
        }
    }
    front / clear.max(1.0)
}
