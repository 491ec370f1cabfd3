//! The flat faces of a model (ours), and how far they wave.
//!
//! A camera's error is alike over some millimetres of its picture, so that a fit to a part of a face is wrong by more than the noise
//! about it says. How much more is told by the model's own large faces: parts of them, as large as what a seam is fitted to, lie off
//! and lean against the whole.

use super::input::SurfaceModel;
use super::trace::support;
use crate::geometry::plane::Moments;
use crate::geometry::statistics::{MEDIAN_OF_SQUARE, median};
use crate::geometry::table;
use crate::model::normals::CORRELATED_POINTS;
use nalgebra::{Point3, Vector3};
use std::sync::OnceLock;

/// Cosine of the angle within which a point faces as its face does, and height over it within which it lies on it, voxels: thin
/// noisy voxels scatter by half of either.
const FACING: f32 = 0.9;
const HEIGHT_VOXELS: f32 = 1.2;
/// Patches that tell a plane by their places.
const LEAST_PATCHES: usize = 6;
/// A face is refitted whenever it has grown by this share.
const GROWN: f32 = 1.3;
/// Fewer points are no face: a strip as long as the shortest joint that is told, three voxels wide.
const LEAST_POINTS: usize = 40;
/// Points that are looked at or passed over together.
const NEIGHBOURS: usize = 64;
/// Edge of the parts, voxels: as far as the points of a face are used beside a seam.
const PART_VOXELS: f32 = 12.0;
/// Points of a part, of the hundred and more of a whole one; parts of a face, and parts in all, below which nothing is told.
const PART_POINTS: f32 = 60.0;
const FACE_PARTS: usize = 6;
const LEAST_PARTS: usize = 12;
/// The median of the sum of two squared normal numbers of unit variance, as a lean about two axes is.
const MEDIAN_OF_TWO: f32 = 1.386;

/// A flat face.
#[derive(Debug)]
pub(crate) struct Face {
    /// Out of the material.
    pub(super) normal: Vector3<f32>,
    pub(super) level_mm: f32,
    /// Those of the model, filtered, and their numbers.
    pub(super) points: Vec<Point3<f32>>,
    members: Vec<usize>,
    /// The boxes around each [`NEIGHBOURS`] of them, which lie near each other: low corner and high one.
    boxes_mm: Vec<[Point3<f32>; 2]>,
    /// The box around all.
    corners_mm: [Point3<f32>; 2],
}

impl Face {
    /// Of the points at these slots of a model's index.
    fn new(slots: &[usize], facing: &Vector3<f32>, model: &SurfaceModel) -> Self {
        let points: Vec<Point3<f32>> = slots.iter().map(|&slot| model.index.point(slot)).collect();
        let (normal, level_mm) = fitted(points.iter().map(|p| p.coords), facing);
        let boxes_mm: Vec<_> = points.chunks(NEIGHBOURS).map(box_around).collect();
        let corners_mm =
            boxes_mm.iter().fold(boxes_mm[0], |[low, high], b| [low.inf(&b[0]), high.sup(&b[1])]);
        let members = slots.iter().map(|&slot| model.index.index(slot)).collect();
        Self { normal, level_mm, points, members, boxes_mm, corners_mm }
    }

    /// Its points, and some more of its own, that may be within a distance of another face.
    pub(super) fn near<'a>(
        &'a self,
        other: &'a Self,
        reach_mm: f32,
    ) -> impl Iterator<Item = &'a Point3<f32>> {
        let chunks = self.points.chunks(NEIGHBOURS).zip(&self.boxes_mm);
        chunks
            .filter(move |(_, own)| apart_mm(own, &other.corners_mm) < reach_mm)
            .flat_map(|(points, _)| points)
    }

    /// The numbers of its points in the model.
    pub(super) fn members(&self) -> &[usize] {
        &self.members
    }

    /// Of a point over it, mm.
    pub(super) fn height_mm(&self, p: &Point3<f32>) -> f32 {
        self.normal.dot(&p.coords) - self.level_mm
    }

    /// How far the boxes around two faces are apart along the axis along which they are farthest apart, mm; negative where they overlap.
    pub(super) fn apart_mm(&self, other: &Self) -> f32 {
        apart_mm(&self.corners_mm, &other.corners_mm)
    }
}

fn apart_mm([low, high]: &[Point3<f32>; 2], [other_low, other_high]: &[Point3<f32>; 2]) -> f32 {
    let apart = |k: usize| (other_low[k] - high[k]).max(low[k] - other_high[k]);
    apart(0).max(apart(1)).max(apart(2))
}

fn box_around(points: &[Point3<f32>]) -> [Point3<f32>; 2] {
    points.iter().fold([points[0]; 2], |[low, high], p| [low.inf(p), high.sup(p)])
}

/// How far parts of faces are off and lean, beyond what the noise about them explains: one standard deviation, of the height where a
/// part ends, mm, and of the lean about each axis, rad.
#[derive(Debug, Clone, Copy, Default)]
pub struct Waves {
    pub(super) height_mm: f32,
    pub(super) lean_rad: f32,
}

/// The faces of a model: sought where they are first asked for.
#[derive(Debug, Default)]
pub(crate) struct Surfaces {
    faces: OnceLock<Vec<Face>>,
    waves: OnceLock<Waves>,
}

impl Surfaces {
    pub(super) fn faces(&self, model: &SurfaceModel) -> &[Face] {
        self.faces.get_or_init(|| grown(model))
    }

    pub(super) fn waves(&self, model: &SurfaceModel) -> Waves {
        *self.waves.get_or_init(|| waves(self.faces(model), model))
    }
}

/// The points of a cell of the model that face one way.
struct Patch {
    cell: [usize; 3],
    /// The normal of the first.
    first: Vector3<f32>,
    /// Sums over its points.
    normal: Vector3<f32>,
    place: Vector3<f32>,
    count: u32,
}

impl Patch {
    fn mean(&self) -> Vector3<f32> {
        self.place / self.count as f32
    }
}

/// Which patch or face something is of: none.
const NONE: u32 = u32::MAX;

/// The patches of a model, and of each slot of its index the one that its point is of.
fn patches(model: &SurfaceModel) -> (Vec<Patch>, Vec<u32>) {
    let (index, normals) = (model.index, &model.cloud.normals);
    let (mut patches, mut of): (Vec<Patch>, _) = (Vec::new(), vec![NONE; index.len()]);
    for (cell, slots) in index.occupied() {
        let first = patches.len();
        for slot in slots {
            let (normal, place) = (normals[index.index(slot)], index.point(slot).coords);
            let is_own = |patch: &Patch| patch.first.dot(&normal) > FACING;
            let own = patches[first..].iter().position(is_own).map_or(patches.len(), |k| first + k);
            if own == patches.len() {
                patches.push(Patch {
                    cell: cell.at,
                    first: normal,
                    normal: Vector3::zeros(),
                    place: Vector3::zeros(),
                    count: 0,
                });
            }
            let patch = &mut patches[own];
            (patch.normal, patch.place, patch.count) =
                (patch.normal + normal, patch.place + place, patch.count + 1);
            of[slot] = own as u32;
        }
    }
    patches
        .iter_mut()
        .for_each(|patch| patch.normal = patch.normal.try_normalize(1e-6).unwrap_or_else(Vector3::z));
    (patches, of)
}

/// The flat faces of a model, grown from patch to patch, the fullest first.
fn grown(model: &SurfaceModel) -> Vec<Face> {
    let (patches, of) = patches(model);
    let most_mm = HEIGHT_VOXELS * model.voxel_mm();
    let mut by_cell: Vec<([usize; 3], usize)> = (0..patches.len()).map(|k| (patches[k].cell, k)).collect();
    by_cell.sort_unstable();
    let mut fullest: Vec<usize> = (0..patches.len()).collect();
    fullest.sort_by_key(|&k| std::cmp::Reverse(patches[k].count));
    let mut face_of = vec![NONE; patches.len()];
    let mut planes = Vec::new();
    for seed in fullest {
        if face_of[seed] != NONE {
            continue;
        }
        let face = planes.len() as u32;
        let mut plane = (patches[seed].normal, patches[seed].normal.dot(&patches[seed].mean()));
        let (mut members, mut next, mut refit) = (vec![seed], 0, LEAST_PATCHES);
        face_of[seed] = face;
        while next < members.len() {
            for &k in near(&by_cell, patches[members[next]].cell) {
                let (normal, level_mm) = plane;
                let is_on = patches[k].normal.dot(&normal) > FACING
                    && (normal.dot(&patches[k].mean()) - level_mm).abs() < most_mm;
                if face_of[k] == NONE && is_on {
                    face_of[k] = face;
                    members.push(k);
                }
            }
            next += 1;
            if members.len() >= refit {
                refit = (members.len() as f32 * GROWN) as usize;
                plane = fitted(members.iter().map(|&k| patches[k].mean()), &plane.0);
            }
        }
        let rows: Vec<_> = members.iter().map(|&k| (patches[k].mean().into(), patches[k].normal)).collect();
        // Strips of a tube would meet all along it.
        planes.push((!support::curves(&plane.0, &rows)).then_some(plane));
    }
    let mut members = vec![Vec::new(); planes.len()];
    for (slot, patch) in of.into_iter().enumerate() {
        let face = face_of[patch as usize] as usize;
        if let Some((normal, level_mm)) = planes[face]
            && (normal.dot(&model.index.point(slot).coords) - level_mm).abs() < 2.0 * most_mm
        {
            members[face].push(slot);
        }
    }
    let found = members.into_iter().zip(planes).filter(|(slots, _)| slots.len() >= LEAST_POINTS);
    found.filter_map(|(slots, plane)| Some(Face::new(&slots, &plane?.0, model))).collect()
}

/// What is in a cell and in those about it, of what is sorted by cell.
pub(super) fn near<T>(by_cell: &[([usize; 3], T)], cell: [usize; 3]) -> impl Iterator<Item = &T> {
    around(cell).into_iter().flat_map(|[low, high]| {
        let from = by_cell.partition_point(|(cell, _)| *cell < low);
        by_cell[from..].iter().take_while(move |(cell, _)| *cell <= high).map(|(_, of)| of)
    })
}

/// A cell and those about it: from which to which, in order.
fn around([x, y, z]: [usize; 3]) -> [[[usize; 3]; 2]; 9] {
    std::array::from_fn(|k| {
        // Cells before the first are none.
        let [x, y] = [(x + k % 3).wrapping_sub(1), (y + k / 3).wrapping_sub(1)];
        [[x, y, z.saturating_sub(1)], [x, y, z + 1]]
    })
}

/// Normal, facing as before, and level of the plane of some places.
fn fitted(mut places: impl Iterator<Item = Vector3<f32>>, facing: &Vector3<f32>) -> (Vector3<f32>, f32) {
    let from = places.next().unwrap_or_default();
    let mut moments = Moments::default();
    moments.add(Vector3::zeros());
    places.for_each(|place| moments.add(place - from));
    let plane = moments.plane();
    let normal = if plane.normal.dot(facing) < 0.0 { -plane.normal } else { plane.normal };
    (normal, normal.dot(&(from + plane.mean)))
}

fn waves(faces: &[Face], model: &SurfaceModel) -> Waves {
    let parts: Vec<Part> = faces.iter().flat_map(|face| parts(face, model)).collect();
    if parts.len() < LEAST_PARTS {
        return Waves::default();
    }
    let of = |value: fn(&Part) -> f32| median(&mut parts.iter().map(value).collect::<Vec<_>>());
    let beyond = |found: f32, expected: f32| (found - expected).max(0.0).sqrt();
    Waves {
        height_mm: beyond(of(|part| part.height_mm2) / MEDIAN_OF_SQUARE as f32, of(|part| part.noise_mm2)),
        lean_rad: beyond(of(|part| part.lean2) / MEDIAN_OF_TWO, of(|part| part.noise_rad2)),
    }
}

/// A part of a face against the whole.
struct Part {
    /// Squared height over the face where it ends.
    height_mm2: f32,
    /// Squared angle between both.
    lean2: f32,
    /// What of them the noise of its points explains.
    noise_mm2: f32,
    noise_rad2: f32,
}

/// The square parts of a face, of its points before the filter.
fn parts(face: &Face, model: &SurfaceModel) -> Vec<Part> {
    let edge_mm = PART_VOXELS * model.voxel_mm();
    let [a, b] = table::axes(&face.normal);
    // In the axes of the face: along it twice, then its height.
    let local = |&k: &usize| {
        let p = model.voxels.cloud.points_mm[k].coords;
        Vector3::new(p.dot(&a), p.dot(&b), p.dot(&face.normal) - face.level_mm)
    };
    let local: Vec<Vector3<f32>> = face.members.iter().map(local).collect();
    let low = local.iter().fold(local[0], |low, p| low.inf(p));
    let high = local.iter().fold(local[0], |high, p| high.sup(p));
    let wide = ((high.x - low.x) / edge_mm) as usize + 1;
    let long = ((high.y - low.y) / edge_mm) as usize + 1;
    // A narrow strip that runs aslant has hardly a part.
    if wide * long > local.len() {
        return Vec::new();
    }
    let mut moments = vec![Moments::default(); wide * long];
    for p in local {
        let at = [p.x - low.x, p.y - low.y].map(|x| (x / edge_mm) as usize);
        let corner = Vector3::new(low.x + at[0] as f32 * edge_mm, low.y + at[1] as f32 * edge_mm, 0.0);
        moments[at[1] * wide + at[0]].add(p - corner);
    }
    moments.retain(|moments| moments.count >= PART_POINTS);
    if moments.len() < FACE_PARTS {
        return Vec::new();
    }
    let part = |moments: Moments| {
        let plane = moments.plane();
        let [lean_x, lean_y] = [plane.normal.x, plane.normal.y].map(|x| -x / plane.normal.z);
        let half_mm = 0.5 * edge_mm;
        let height_mm = plane.mean.z + lean_x * (edge_mm - plane.mean.x) + lean_y * (half_mm - plane.mean.y);
        let mean_mm2 = CORRELATED_POINTS * plane.variance_mm2 / moments.count;
        let noise_rad2 = mean_mm2 * 12.0 / (edge_mm * edge_mm);
        Part {
            height_mm2: height_mm * height_mm,
            lean2: lean_x * lean_x + lean_y * lean_y,
            noise_mm2: mean_mm2 + noise_rad2 * half_mm * half_mm,
            noise_rad2,
        }
    };
    moments.into_iter().map(part).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::cloud::PointCloud;
    use crate::geometry::grid::Grid;
    use crate::model::downsampling::Voxels;

    /// The faces of points 1 mm apart with their normals, and how far they wave.
    pub(in crate::seam) fn surfaces(rows: Vec<(Point3<f32>, Vector3<f32>)>) -> (Vec<Face>, Waves) {
        let (points_mm, normals) = rows.into_iter().unzip();
        let cloud = PointCloud { points_mm, normals, ..PointCloud::default() };
        let voxels = Voxels { edge_mm: 1.0, cloud: cloud.clone(), ..Voxels::default() };
        let index = Grid::new(&cloud.points_mm, 4.0);
        let model = SurfaceModel { voxels: &voxels, cloud: &cloud, index: &index, asymmetries: &[] };
        let faces = grown(&model);
        let waves = waves(&faces, &model);
        (faces, waves)
    }

    /// A square of 150 mm whose height is this.
    fn square(height_mm: impl Fn(f32, f32) -> f32) -> Vec<(Point3<f32>, Vector3<f32>)> {
        let place = |k: usize| ((k % 150) as f32, (k / 150) as f32);
        (0..150 * 150).map(place).map(|(x, y)| (Point3::new(x, y, height_mm(x, y)), Vector3::z())).collect()
    }

    #[test]
    fn waves_are_told_from_noise_and_as_large_as_they_are() {
        let noise = |x: f32, y: f32| 0.2 * ((x * 12.9898 + y * 78.233).sin() * 43_758.547).fract();
        let (faces, plain) = surfaces(square(noise));
        assert_eq!(faces.len(), 1);
        assert!(plain.height_mm < 0.03 && plain.lean_rad < 0.004, "{plain:?}");
        // 0.4 mm high, 60 mm long each way: slopes of 0.4 x 2 pi / 60 / 2 as root mean square about each axis, less what a part of
        // 12 mm averages.
        let wave = |x: f32, y: f32| 0.4 * (x * 0.105).sin() * (y * 0.105).sin();
        let (_, waved) = surfaces(square(|x, y| noise(x, y) + wave(x, y)));
        assert!((0.012..0.03).contains(&waved.lean_rad), "{waved:?}");
        assert!((0.1..0.35).contains(&waved.height_mm), "{waved:?}");
    }
}
