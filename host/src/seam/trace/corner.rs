//! Two faces fitted to the surroundings of one point, and the corner in which they meet (ours).
//!
//! The paper's edge points lie 0.65 to 0.9 mm out of a 90 degree corner. Here the points around a candidate are split into two
//! planes by a few rounds of assignment and fit; the candidate is moved onto the line in which they intersect.

use crate::geometry::grid::Grid;
use crate::geometry::grid::lanes::LANES;
use crate::geometry::plane::Moments;
use nalgebra::{Point3, Vector3};
use wide::f32x8;

/// When a fit is a corner.
#[derive(Debug, Clone, Copy)]
pub struct Config {
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
}

impl Default for Config {
    fn default() -> Self {
        Self {
            radius_voxels: 6.25,
            tolerance_voxels: 0.5,
            angle_deg: (25.0, 155.0),
            reach_voxels: 2.5,
            least_share: 0.45,
            move_voxels: 3.3,
        }
    }
}

/// Two faces that meet in a line, concave as the camera sees them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Foot of the candidate on the line, mm.
    pub position: Point3<f32>,
    /// Unit direction of the line; its sign means nothing.
    pub direction: Vector3<f32>,
    /// Unit normals of the faces, toward the camera.
    pub faces: [Vector3<f32>; 2],
    /// Share of the surrounding points that lie on the faces.
    pub share: f32,
}

struct Face {
    normal: Vector3<f32>,
    offset: f32,
    count: usize,
}

/// The corner near a candidate, if there is one. `tolerance_mm` and `voxel_mm` set the scale.
pub fn fit(points: &[Near], voxel_mm: f32, config: &Config) -> Option<(Corner, Vector3<f32>)> {
    let tolerance = config.tolerance_voxels * voxel_mm;
    let mut normals = seeds(points)?;
    let mut faces: Option<[Face; 2]> = None;
    for _ in 0..4 {
        let fitted = round(points, &normals, faces.as_ref(), tolerance)?;
        normals = [fitted[0].normal, fitted[1].normal];
        faces = Some(fitted);
    }
    let [a, b] = faces?;
    let along = a.normal.cross(&b.normal);
    let sine = along.norm();
    let direction = along / sine;
    let cosine = a.normal.dot(&b.normal);
    let opening_deg = 180.0 - cosine.clamp(-1.0, 1.0).acos().to_degrees();
    if !(config.angle_deg.0..=config.angle_deg.1).contains(&opening_deg) {
        return None;
    }
    // The point of both planes nearest to the candidate, which is the origin here.
    let (wa, wb) =
        ((a.offset - cosine * b.offset) / (sine * sine), (b.offset - cosine * a.offset) / (sine * sine));
    let foot = a.normal * wa + b.normal * wb;
    let in_front = [in_front(points, &a, &b, tolerance), in_front(points, &b, &a, tolerance)];
    let concave = in_front[0].min(in_front[1]) > 0.35 && in_front[0] + in_front[1] > 1.2;
    if !concave || foot.norm() > config.move_voxels * voxel_mm {
        return None;
    }
    let share = (a.count + b.count) as f32 / points.len() as f32;
    let begins = [
        nearest_to_line(points, &a, &b, &foot, &direction, tolerance),
        nearest_to_line(points, &b, &a, &foot, &direction, tolerance),
    ];
    if share < config.least_share || begins[0].max(begins[1]) > config.reach_voxels * voxel_mm {
        return None;
    }
    Some((Corner { position: Point3::origin(), direction, faces: [a.normal, b.normal], share }, foot))
}

/// A neighbour of a candidate: its offset from it, mm, and its normal.
#[derive(Debug, Clone, Copy)]
pub struct Near {
    /// From the candidate, mm.
    pub offset: Vector3<f32>,
    /// Unit, toward the camera.
    pub normal: Vector3<f32>,
}

/// Gathers the surroundings of a place.
pub fn surroundings(
    grid: &Grid,
    normals: &[Vector3<f32>],
    at: &Point3<f32>,
    radius_mm: f32,
    near: &mut Vec<Near>,
) {
    near.clear();
    grid.within(at, radius_mm, |slot, _| {
        near.push(Near { offset: grid.point(slot) - at, normal: normals[slot] });
    });
}

/// The normal that most others agree with, and the one of those that differ from it that most agree with.
fn seeds(points: &[Near]) -> Option<[Vector3<f32>; 2]> {
    const AGREE: f32 = 0.93;
    const DIFFER: f32 = 0.94;
    if points.len() < 20 {
        return None;
    }
    let step = (points.len() / 24).max(1);
    let normals = in_lanes(points);
    let agree = |n: &Vector3<f32>, [x, y, z]: &[f32x8; 3]| {
        (*x * n.x + *y * n.y + *z * n.z).simd_gt(f32x8::splat(AGREE)).to_bitmask().count_ones()
    };
    let support = |n: &Vector3<f32>| normals.iter().map(|eight| agree(n, eight)).sum::<u32>();
    let best = |differs: &dyn Fn(&Vector3<f32>) -> bool| {
        let tried = points.iter().step_by(step).map(|p| p.normal).filter(|n| differs(n));
        tried.map(|n| (support(&n), n)).max_by_key(|(count, _)| *count)
    };
    let (_, first) = best(&|_| true)?;
    let (count, second) = best(&|n| n.dot(&first).abs() <= DIFFER)?;
    (count >= 6).then_some([first, second])
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
) -> Option<[Face; 2]> {
    let mut moments = [Moments::default(); 2];
    for p in points {
        let agree = [p.normal.dot(&normals[0]), p.normal.dot(&normals[1])];
        let (mine, belongs) = match faces {
            None => {
                let mine = usize::from(agree[1] > agree[0]);
                (mine, agree[mine] > 0.9)
            }
            Some(f) => {
                let miss = [0, 1].map(|k| (p.offset.dot(&f[k].normal) - f[k].offset).abs());
                let mine = usize::from(miss[1] < miss[0]);
                (mine, miss[mine] < tolerance && agree[mine] > 0.7)
            }
        };
        if belongs {
            moments[mine].add(p.offset);
        }
    }
    let face = |k: usize| {
        let plane = moments[k].plane();
        let normal = if plane.normal.dot(&normals[k]) < 0.0 { -plane.normal } else { plane.normal };
        (moments[k].count >= 8.0).then(|| Face {
            normal,
            offset: plane.mean.dot(&normal),
            count: moments[k].count as usize,
        })
    };
    let faces = [face(0)?, face(1)?];
    (faces[0].normal.cross(&faces[1].normal).norm() > 0.3).then_some(faces)
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

/// Distance from the line at which a face begins.
fn nearest_to_line(
    points: &[Near],
    face: &Face,
    other: &Face,
    foot: &Vector3<f32>,
    direction: &Vector3<f32>,
    tolerance: f32,
) -> f32 {
    let mut nearest = f32::MAX;
    for p in points {
        let on = (p.offset.dot(&face.normal) - face.offset).abs() < tolerance;
        let clear = (p.offset.dot(&other.normal) - other.offset).abs() > 1.1 * tolerance;
        if on && clear {
            let d = p.offset - foot;
            nearest = nearest.min((d - direction * d.dot(direction)).norm());
        }
    }
    nearest
}
