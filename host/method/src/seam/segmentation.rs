//! The surfaces of a model, and what their borders are (ours): a picture of what was seen, for whoever looks at it. No seam is found
//! or left out by it; the corners that make no seam are named.
//!
//! Flat faces are those of `surfaces`. What is left is grown from point to point, and is a cylinder where one fits.
//! What lies between two surfaces and is too narrow to be one, as what a camera makes of a sharp corner, is of the nearer of both.

mod cylinder;
mod growth;
mod rim;

use super::implied;
use super::input::SurfaceModel;
use super::surfaces::{Face, Surfaces};
use super::trace::chain::{self, TraceConfig, Traced};
use super::trace::{Chain, InsideCorner};
use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::geometry::statistics::rms;
use cylinder::Cylinder;
use growth::{Cloud, NONE};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use rim::Sights;
use serde::{Deserialize, Serialize};

/// Points this near are next to each other, voxels: nearer than every second point of a row.
const NEXT_VOXELS: f32 = 2.0;
/// How far from a border its surfaces are looked at, voxels: twice as far as normals are blurred.
const REACH_VOXELS: f32 = 6.0;
/// Surfaces that meet at less go on as each other: a flat face takes in what turns away from it by 26 degrees.
const CORNER_DEG: f32 = 30.0;
/// Height from surface to surface that is a step, voxels: more than the noise of both.
const STEP_VOXELS: f32 = 1.2;
/// Standard deviations of waves that are neither a corner nor a step.
const WAVES: f32 = 3.0;
/// A point so far off its surface may be of another, voxels: half a step.
const OFF_VOXELS: f32 = 0.5 * STEP_VOXELS;
/// A cylinder fits as well as flat faces do: its deviation is at most so many times theirs, or this, voxels.
const AS_FLAT: f32 = 2.0;
const LEAST_DEVIATION_VOXELS: f32 = 0.15;
/// Less edge intensity than this is of no end of a surface: at the very end of a flat one it is .42.
const EVEN: f32 = 0.2;
/// A surface is a part of one beside it, if so much of it lies within two standard deviations of that, and faces as that does: of normal
/// scatter .95 does.
const PART_SHARE: f32 = 0.8;
const PART_DEVIATIONS: f32 = 2.0;
const PART_FACING: f32 = 0.9;

/// What surfaces a model shows.
#[derive(Debug, Clone)]
pub struct Segmentation {
    shapes: Vec<Fitted>,
    /// Of each slot of the model's index, the surface that its point is of.
    of: Vec<u32>,
    borders: Vec<Option<Border>>,
    /// Where two surfaces meet in an inside corner or in a low step.
    corners: Vec<InsideCorner>,
}

/// A surface that goes on without a corner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SeenSurface {
    /// What it is.
    pub shape: SurfaceShape,
    /// How far its points scatter about the shape: one standard deviation, mm.
    pub deviation_mm: f32,
}

/// What a surface is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum SurfaceShape {
    /// A plane.
    Plane,
    /// A part of a cylinder.
    Cylinder {
        /// mm.
        radius_mm: f32,
    },
    /// Something else.
    Freeform,
}

/// What a point of the model is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Place {
    /// Number of the surface that it is of, from 0.
    pub surface: Option<u16>,
    /// What border it is at.
    pub border: Option<Border>,
}

/// How a surface ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Border {
    /// In an inside corner with another.
    Inside,
    /// In an outside corner with another.
    Outside,
    /// It goes on as another without a corner.
    Tangent,
    /// In a low step to another that is parallel to it.
    Step,
    /// At an edge: what is farther away was seen beside it.
    Edge,
    /// Something nearer hides where it goes on.
    Hidden,
    /// Nothing was measured beside it: the picture ends there, or the camera lost it.
    Unseen,
}

impl Border {
    /// All, in the order of their numbers.
    pub const ALL: [Self; 7] =
        [Self::Inside, Self::Outside, Self::Tangent, Self::Step, Self::Edge, Self::Hidden, Self::Unseen];
}

impl Segmentation {
    /// Of a model.
    pub fn of(model: &SurfaceModel) -> Self {
        Self::with(model, &Surfaces::default())
    }

    /// Of a model of which these are the flat faces.
    pub(crate) fn with(model: &SurfaceModel, surfaces: &Surfaces) -> Self {
        let (index, voxel_mm) = (model.index, model.voxel_mm());
        let faces = surfaces.faces(model);
        let mut of = vec![NONE; index.len()];
        for (face, k) in faces.iter().zip(0..) {
            face.members().iter().for_each(|&point| of[point] = k);
        }
        let normals = index.by_slot(&model.cloud.normals);
        let cloud = Cloud { index, normals: &normals, voxel_mm };
        let mut of = index.by_slot(&of);
        let mut shapes: Vec<Fitted> =
            faces.iter().map(|face| Fitted::plane(face, &model.voxels.cloud.points_mm)).collect();
        let squares = faces
            .iter()
            .zip(&shapes)
            .map(|(face, shape)| face.members().len() as f32 * shape.deviation_mm * shape.deviation_mm);
        let members: usize = faces.iter().map(|face| face.members().len()).sum();
        let flat_mm = (squares.sum::<f32>() / members.max(1) as f32).sqrt();
        let most_mm = (AS_FLAT * flat_mm).max(LEAST_DEVIATION_VOXELS * voxel_mm);
        for slots in cloud.regions(&mut of, shapes.len() as u32) {
            shapes.push(Fitted::round(&slots, &cloud, most_mm));
        }
        of = settled(&of, &shapes, &cloud);
        let mut known = of.clone();
        cloud.spread(&mut of);
        let beside = cloud.beside(&of, &cloud.mixed(&of));
        let numbers = one_each(&mut shapes, &known, &pairs(&beside, &of), &cloud, most_mm);
        [&mut of, &mut known].into_iter().for_each(|labels| {
            labels.iter_mut().filter(|of| **of != NONE).for_each(|of| *of = numbers[*of as usize]);
        });
        let corner_rad = CORNER_DEG.to_radians().max(WAVES * surfaces.waves(model).lean_rad);
        let step_mm = (STEP_VOXELS * voxel_mm).max(WAVES * flat_mm);
        let is_wide = &wide(&known, shapes.len(), &cloud);
        let meeting =
            Meeting { cloud: &cloud, shapes: &shapes, of: &of, known: &known, is_wide, corner_rad, step_mm };
        let met: Vec<_> = beside.into_par_iter().map(|(slot, next)| (slot, meeting.at(slot, next))).collect();
        let corners = met.iter().filter_map(|(_, met)| met.as_ref()?.1).collect();
        let mut borders = vec![None; index.len()];
        met.into_iter().for_each(|(slot, met)| borders[slot] = met.map(|(border, _)| border));
        Self { shapes, of, borders, corners }
    }

    /// The surfaces, flat ones first.
    pub fn surfaces(&self) -> Vec<SeenSurface> {
        self.shapes.iter().map(Fitted::surface).collect()
    }

    /// What each point of the model is; `model` is that of which this is, `merged` what it was made of, and `intensity` the edge
    /// intensity of its points, as far as it is known.
    pub fn places(&self, model: &SurfaceModel, merged: &Merged, intensity: &[f32]) -> Vec<Place> {
        let (index, voxel_mm) = (model.index, model.voxel_mm());
        let normals = &index.by_slot(&model.cloud.normals);
        let cloud = Cloud { index, normals, voxel_mm };
        let sights = Sights::of(merged, voxel_mm);
        let rim = |slot: usize| {
            let point = index.index(slot);
            let is_within =
                intensity.get(point).is_some_and(|intensity| (f32::MIN_POSITIVE..EVEN).contains(intensity));
            let view = model.voxels.view.get(point).copied().unwrap_or_default();
            if is_within { None } else { rim::border(slot, &cloud, &self.of, sights.of_view(view)) }
        };
        let place = |slot: usize| Place {
            surface: u16::try_from(self.of[slot]).ok().filter(|_| self.of[slot] != NONE),
            border: self.borders[slot].or_else(|| rim(slot)),
        };
        index.by_point(&(0..index.len()).into_par_iter().map(place).collect::<Vec<_>>())
    }

    /// Where surfaces meet in inside corners and low steps, strung together: those of which `is_asked` and that `config` takes for one
    /// line.
    pub(crate) fn lines(
        &self,
        model: &SurfaceModel,
        config: &TraceConfig,
        is_asked: impl Fn(&InsideCorner) -> bool,
    ) -> Vec<Chain> {
        let asked: Vec<InsideCorner> = self.corners.iter().copied().filter(is_asked).collect();
        let Traced { chains, short } = chain::trace(&asked, model.index, model.voxel_mm(), config);
        chains.into_iter().chain(short).collect()
    }
}

/// The surface of each point, once those that lie off their own have gone to one near by that they lie on: a flat face takes in all of a
/// cell, and with it the rim of a sheet on it.
fn settled(of: &[u32], shapes: &[Fitted], cloud: &Cloud) -> Vec<u32> {
    let best = |slot: usize| {
        let (place, seen, own) = (cloud.index.point(slot), cloud.normals[slot], of[slot]);
        let off_mm = |of: u32| shapes[of as usize].off_mm(&place).abs();
        if own == NONE || off_mm(own) < OFF_VOXELS * cloud.voxel_mm {
            return own;
        }
        let mut best = (0.5 * off_mm(own), own);
        cloud.index.within(&place, REACH_VOXELS * cloud.voxel_mm, |next, _| {
            let other = of[next];
            let is_one = |shape: &Fitted| {
                !matches!(shape.form, Form::Freeform)
                    && shape.normal_at(&place, &seen).dot(&seen) > PART_FACING
            };
            if other != NONE && other != own && off_mm(other) < best.0 && is_one(&shapes[other as usize]) {
                best = (off_mm(other), other);
            }
        });
        best.1
    };
    (0..of.len()).into_par_iter().map(best).collect()
}

/// Which surfaces are wider than what a camera makes of a corner or an edge.
fn wide(of: &[u32], count: usize, cloud: &Cloud) -> Vec<bool> {
    let slots = by_surface(of, count);
    slots.iter().map(|slots| !slots.is_empty() && cloud.is_wide(slots)).collect()
}

/// Which surfaces have points next to each other: each pair once each way round, in order.
fn pairs(beside: &[(usize, usize)], of: &[u32]) -> Vec<(u32, u32)> {
    let both = beside.iter().flat_map(|&(slot, next)| [(of[slot], of[next]), (of[next], of[slot])]);
    let mut pairs: Vec<_> = both.collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// The slots of each of so many surfaces.
fn by_surface(of: &[u32], count: usize) -> Vec<Vec<usize>> {
    let mut slots = vec![Vec::new(); count];
    let known = of.iter().enumerate().filter(|(_, of)| **of != NONE);
    known.for_each(|(slot, of)| slots[*of as usize].push(slot));
    slots
}

/// Takes surfaces that are parts of another beside them to that, and gives the new number of each old one. `beside` are pairs of neighbours,
/// both ways round and in order.
fn one_each(
    shapes: &mut Vec<Fitted>,
    of: &[u32],
    beside: &[(u32, u32)],
    cloud: &Cloud,
    most_mm: f32,
) -> Vec<u32> {
    let slots = by_surface(of, shapes.len());
    let mut largest: Vec<usize> = (0..shapes.len()).collect();
    largest.sort_by_key(|&k| std::cmp::Reverse(slots[k].len()));
    let mut whole: Vec<usize> = (0..shapes.len()).collect();
    for large in largest {
        if whole[large] != large {
            continue;
        }
        let (mut parts, mut next, mut asked) = (vec![large], 0, vec![false; shapes.len()]);
        while next < parts.len() {
            let one = parts[next];
            let from = beside.partition_point(|(a, _)| (*a as usize) < one);
            let others = beside[from..].iter().take_while(|(a, _)| *a as usize == one);
            for part in others.map(|(_, b)| *b as usize) {
                let is_new = !std::mem::replace(&mut asked[part], true);
                let is_smaller = whole[part] == part && slots[part].len() < slots[large].len();
                if is_new && is_smaller && shapes[large].holds(&slots[part], cloud, most_mm) {
                    whole[part] = large;
                    parts.push(part);
                }
            }
            next += 1;
        }
    }
    let left: Vec<usize> = (0..shapes.len()).filter(|&k| whole[k] == k).collect();
    let old = std::mem::take(shapes).into_iter().enumerate();
    shapes.extend(old.filter(|(k, _)| whole[*k] == *k).map(|(_, shape)| shape));
    whole.iter().map(|whole| left.binary_search(whole).map_or(NONE, |k| k as u32)).collect()
}

/// A surface as it is fitted.
#[derive(Debug, Clone)]
struct Fitted {
    form: Form,
    deviation_mm: f32,
}

#[derive(Debug, Clone)]
enum Form {
    /// Its normal and its level.
    Plane(Vector3<f32>, f32),
    Cylinder(Cylinder),
    Freeform,
}

impl Fitted {
    fn plane(face: &Face, points_mm: &[Point3<f32>]) -> Self {
        let off_mm = |&k: &usize| f64::from(face.height_mm(&points_mm[k]));
        let off_mm: Vec<f64> = face.members().iter().map(off_mm).collect();
        let deviation_mm = rms(&off_mm).unwrap_or_default() as f32;
        Self { form: Form::Plane(face.normal, face.level_mm), deviation_mm }
    }

    /// A cylinder, if one fits.
    fn round(slots: &[usize], cloud: &Cloud, most_mm: f32) -> Self {
        let rows = slots.iter().map(|&slot| (cloud.index.point(slot), cloud.normals[slot]));
        match Cylinder::of(&rows.collect::<Vec<_>>()) {
            Some((cylinder, deviation_mm)) if deviation_mm < most_mm => {
                Self { form: Form::Cylinder(cylinder), deviation_mm }
            }
            _ => Self { form: Form::Freeform, deviation_mm: 0.0 },
        }
    }

    fn surface(&self) -> SeenSurface {
        let shape = match &self.form {
            Form::Plane(..) => SurfaceShape::Plane,
            Form::Cylinder(cylinder) => SurfaceShape::Cylinder { radius_mm: cylinder.radius_mm },
            Form::Freeform => SurfaceShape::Freeform,
        };
        SeenSurface { shape, deviation_mm: self.deviation_mm }
    }

    /// Whether some points are of it.
    fn holds(&self, slots: &[usize], cloud: &Cloud, most_mm: f32) -> bool {
        let is_on = |&&slot: &&usize| {
            let (place, seen) = (cloud.index.point(slot), cloud.normals[slot]);
            self.off_mm(&place).abs() < PART_DEVIATIONS * most_mm
                && self.normal_at(&place, &seen).dot(&seen) > PART_FACING
        };
        !matches!(self.form, Form::Freeform)
            && slots.iter().filter(is_on).count() as f32 > PART_SHARE * slots.len() as f32
    }

    /// How far a point lies off the shape, mm.
    fn off_mm(&self, p: &Point3<f32>) -> f32 {
        match &self.form {
            Form::Plane(normal, level_mm) => normal.dot(&p.coords) - level_mm,
            Form::Cylinder(cylinder) => cylinder.off_mm(p),
            Form::Freeform => 0.0,
        }
    }

    /// Its normal at a place, and how high it is over that along it, mm, as its points near by show it.
    fn level_mm(&self, place: &Point3<f32>, near: &Near) -> (Vector3<f32>, f32) {
        let normal = self.normal_at(place, &near.normal);
        let level_mm = match &self.form {
            Form::Plane(..) => near.off_mm - self.off_mm(place),
            Form::Cylinder(cylinder) => (near.off_mm - self.off_mm(place)) * cylinder.side(place, &normal),
            Form::Freeform => (near.place - place.coords).dot(&normal),
        };
        (normal, level_mm)
    }

    /// Its normal at a place, about as one that was seen near it.
    fn normal_at(&self, place: &Point3<f32>, seen: &Vector3<f32>) -> Vector3<f32> {
        match &self.form {
            Form::Plane(normal, _) => *normal,
            Form::Cylinder(cylinder) => cylinder.normal_at(place, seen),
            Form::Freeform => *seen,
        }
    }
}

/// What is needed to tell how surfaces meet; all by slot.
struct Meeting<'a> {
    cloud: &'a Cloud<'a>,
    shapes: &'a [Fitted],
    /// The surface of each, also of those that lie too near to another to be sure.
    of: &'a [u32],
    /// The surface of those that are sure.
    known: &'a [u32],
    /// Whether each surface is wider than what a camera makes of a corner or an edge.
    is_wide: &'a [bool],
    /// Surfaces that meet at less are one that goes on.
    corner_rad: f32,
    /// Height from surface to surface that is a step.
    step_mm: f32,
}

impl Meeting<'_> {
    /// How the surface of a point ends at another that was the nearest beside it, and where that is, if it may be a joint.
    fn at(&self, slot: usize, next: usize) -> Option<(Border, Option<InsideCorner>)> {
        let own = self.of[slot];
        // Both may have become one.
        let is_other = |next: usize| self.of[next] != NONE && self.of[next] != own;
        let next = if is_other(next) { next } else { self.cloud.nearest(slot, is_other)? };
        let other = self.of[next];
        let place = nalgebra::center(&self.cloud.index.point(slot), &self.cloud.index.point(next));
        let [mut near, mut beyond] = [Near::default(); 2];
        self.cloud.index.within(&place, REACH_VOXELS * self.cloud.voxel_mm, |next, _| {
            let of = self.known[next];
            let side = if of == own { &mut near } else { &mut beyond };
            if of == own || of == other {
                side.add(self.cloud.index.point(next), &self.cloud.normals[next], &self.shapes[of as usize]);
            }
        });
        let [a, b] = [near.mean()?, beyond.mean()?];
        let [(a_face, a_mm), (b_face, b_mm)] =
            [(own, &a), (other, &b)].map(|(of, near)| self.shapes[of as usize].level_mm(&place, near));
        let faces = [a_face, b_face];
        let is_wide = [own, other].iter().all(|of| self.is_wide[*of as usize]);
        let apart = b.place - a.place;
        if faces[0].dot(&faces[1]) < self.corner_rad.cos() {
            let is_inside = apart.dot(&(faces[0] - faces[1])) > 0.0;
            if !is_inside {
                return Some((Border::Outside, None));
            }
            let far_mm = implied::gap_mm(self.cloud.voxel_mm);
            let corner = inside_corner(&place, [a_mm, b_mm], faces).filter(|_| is_wide);
            return Some((Border::Inside, corner.filter(|c| (c.position - place).norm() < far_mm)));
        }
        let up = (faces[0] + faces[1]).normalize();
        let rise_mm = b_mm - a_mm;
        if rise_mm.abs() < self.step_mm {
            return Some((Border::Tangent, None));
        }
        // At the foot: on the lower surface, below this point of the upper one.
        let out = (up * apart.dot(&up) - apart) * rise_mm.signum();
        let foot = |out: Vector3<f32>| InsideCorner {
            position: place + up * a_mm.min(b_mm),
            direction: up.cross(&out),
            faces: [up, out],
            share: 1.0,
        };
        Some((Border::Step, out.try_normalize(1e-3).filter(|_| is_wide).map(foot)))
    }
}

/// The nearest place on the line in which two surfaces meet, given how high they are over one nearby along their normals, mm.
fn inside_corner(place: &Point3<f32>, level_mm: [f32; 2], faces: [Vector3<f32>; 2]) -> Option<InsideCorner> {
    let alike = faces[0].dot(&faces[1]);
    let direction = faces[0].cross(&faces[1]).try_normalize(1e-3)?;
    let share = [0, 1].map(|k| (level_mm[k] - alike * level_mm[1 - k]) / (1.0 - alike * alike));
    Some(InsideCorner {
        position: place + faces[0] * share[0] + faces[1] * share[1],
        direction,
        faces,
        share: 1.0,
    })
}

/// The points of a surface near a place: their sums, or their means.
#[derive(Clone, Copy, Default)]
struct Near {
    count: f32,
    place: Vector3<f32>,
    normal: Vector3<f32>,
    /// Off the shape.
    off_mm: f32,
}

impl Near {
    fn add(&mut self, point: Point3<f32>, normal: &Vector3<f32>, shape: &Fitted) {
        self.count += 1.0;
        self.place += point.coords;
        self.normal += normal;
        self.off_mm += shape.off_mm(&point);
    }

    /// Their means, if there are points.
    fn mean(&self) -> Option<Self> {
        let normal = self.normal.try_normalize(1e-3)?;
        Some(Self { place: self.place / self.count, normal, off_mm: self.off_mm / self.count, ..*self })
    }
}

#[cfg(test)]
mod tests;
