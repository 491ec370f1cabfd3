//! Points beside a seam in the seam's own coordinates: along it, and out along and off each face (ours).

use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::geometry::grid::rows::bounds;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// One station of a seam that is being refined; single precision about the cloud's origin.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// On the seam, mm.
    pub position: Point3<f32>,
    /// Unit tangent.
    pub tangent: Vector3<f32>,
    /// Unit normals of the faces, each normal to the tangent.
    pub faces: [Vector3<f32>; 2],
}

/// Shorter tangents have no direction.
const LEAST_TANGENT: f32 = 1e-6;

impl Frame {
    /// Makes tangent and face normals unit and square to each other.
    pub fn new(position: Point3<f32>, tangent: Vector3<f32>, faces: [Vector3<f32>; 2]) -> Option<Self> {
        Self::about(position, tangent.try_normalize(LEAST_TANGENT)?, faces)
    }

    /// The same about a unit tangent.
    fn about(position: Point3<f32>, tangent: Vector3<f32>, faces: [Vector3<f32>; 2]) -> Option<Self> {
        let square = |n: Vector3<f32>| (n - tangent * n.dot(&tangent)).try_normalize(1e-3);
        Some(Self { position, tangent, faces: [square(faces[0])?, square(faces[1])?] })
    }

    /// The same place, seen by a weld that runs the other way.
    pub fn reversed(&self) -> Self {
        Self { tangent: -self.tangent, ..*self }
    }

    /// In-face direction from the seam into each face.
    pub fn into_faces(&self) -> [Vector3<f32>; 2] {
        [0, 1].map(|k| {
            let along = self.tangent.cross(&self.faces[k]);
            if along.dot(&self.faces[1 - k]) < 0.0 { -along } else { along }
        })
    }

    /// Bisector of the faces, out of the work.
    pub fn bisector(&self) -> Vector3<f32> {
        (self.faces[0] + self.faces[1]).try_normalize(1e-6).unwrap_or(self.faces[0])
    }
}

/// A raw point beside the seam.
#[derive(Debug, Clone, Copy)]
pub struct Beside {
    /// Along the seam from its first station, mm.
    pub s: f32,
    /// Which face it is nearer to.
    pub face: u8,
    /// Distance from the seam along that face, mm.
    pub u: f32,
    /// Height off that face, out of the work, mm.
    pub h: f32,
    /// View that saw it.
    pub view: u16,
    /// Cosine of the angle between its ray and the face's normal.
    pub incidence_cos: f32,
}

/// Indices, ascending, of the points of `raw` that are nearer than `reach_mm` to a station.
pub fn near_path(raw: &Grid, frames: &[Frame], reach_mm: f32) -> Vec<u32> {
    let stations: Vec<_> = frames.iter().map(|f| f.position).collect();
    let grid = Grid::new(&stations, reach_mm);
    let (low, high) = bounds(&stations);
    let is_near = |slot: usize, within_mm: f32| {
        let p = raw.point(slot);
        let inside = (0..3).all(|k| p[k] > low[k] - within_mm && p[k] < high[k] + within_mm);
        inside && grid.is_near(&p, within_mm)
    };
    // Where the first point of a cell is farther or nearer than the reach by this, all of it is.
    let cell_mm = 1.001 * 3f32.sqrt() * raw.cell_mm();
    let of_cell = |slots: Range<usize>| {
        let several = slots.len() > FEW;
        let all = several && reach_mm > cell_mm && is_near(slots.start, reach_mm - cell_mm);
        let none = several && !all && !is_near(slots.start, reach_mm + cell_mm);
        let near = (if none { 0..0 } else { slots }).filter(move |&slot| all || is_near(slot, reach_mm));
        near.map(|slot| raw.index(slot) as u32)
    };
    let mut near: Vec<u32> = raw.cells().with_max_len(1024).flat_map_iter(of_cell).collect();
    near.par_sort_unstable();
    near
}

/// Points of a cell that are better looked at one by one.
const FEW: usize = 8;

/// Seam coordinates of raw points nearer than `reach_mm` to the seam; those beyond the ends of an open seam by more than a
/// step are left out.
pub fn beside(
    merged: &Merged,
    near: &[u32],
    frames: &[Frame],
    closed: bool,
    step_mm: f32,
    reach_mm: f32,
) -> Vec<Beside> {
    let stations: Vec<_> = frames.iter().map(|f| f.position).collect();
    let grid = Grid::new(&stations, reach_mm);
    near.par_iter()
        .with_min_len(1024)
        .filter_map(|&k| {
            let p = merged.points_mm[k as usize];
            let (slot, _) = grid.nearest(&p, 1.5 * reach_mm, |_| true)?;
            let (s, d, foot) = foot(&p, frames, grid.index(slot), closed, step_mm, reach_mm)?;
            let into = foot.into_faces();
            let h = foot.faces.map(|normal| d.dot(&normal));
            let face = usize::from(h[1].abs() < h[0].abs());
            let view = merged.view[k as usize];
            let ray = (merged.cameras_mm[usize::from(view)] - p).normalize();
            let incidence_cos = ray.dot(&foot.faces[face]);
            Some(Beside { s, face: face as u8, u: d.dot(&into[face]), h: h[face], view, incidence_cos })
        })
        .collect()
}

/// Where a point nearer than `reach_mm` lies along the seam, its offset in the cross-section there, and the frame of that,
/// interpolated between the nearest station and the one beyond it.
pub(in crate::seam) fn foot(
    p: &Point3<f32>,
    frames: &[Frame],
    nearest: usize,
    closed: bool,
    step_mm: f32,
    reach_mm: f32,
) -> Option<(f32, Vector3<f32>, Frame)> {
    let n = frames.len();
    let near = &frames[nearest];
    let ahead = (p - near.position).dot(&near.tangent);
    let other = match (ahead >= 0.0, closed) {
        (true, true) => (nearest + 1) % n,
        (false, true) => (nearest + n - 1) % n,
        (true, false) => (nearest + 1).min(n - 1),
        (false, false) => nearest.saturating_sub(1),
    };
    let far = &frames[other];
    let gap = (far.position - near.position).norm();
    let sign = if ahead >= 0.0 { 1.0 } else { -1.0 };
    let mut share = if gap > 0.0 { (ahead.abs() / gap).min(1.0) } else { 0.0 };
    if gap > 0.0 {
        // The chord is only near the seam: once more with the tangent there.
        let (position, tangent) = (mixed_position(near, far, share), mixed_tangent(near, far, share)?);
        share = (share + (p - position).dot(&tangent) * sign / gap).clamp(0.0, 1.0);
    }
    let (position, tangent) = (mixed_position(near, far, share), mixed_tangent(near, far, share)?);
    let off = (p - position).dot(&tangent);
    let d = p - position - tangent * off;
    if off.abs() > step_mm || d.norm_squared() > reach_mm * reach_mm {
        return None;
    }
    let faces = [0, 1].map(|k| blend(&near.faces[k], &far.faces[k], share));
    let foot = Frame::about(position, tangent, faces)?;
    let s = nearest as f32 * step_mm + sign * share * step_mm + if gap > 0.0 { 0.0 } else { ahead };
    Some((s, d, foot))
}

fn blend(a: &Vector3<f32>, b: &Vector3<f32>, share: f32) -> Vector3<f32> {
    a * (1.0 - share) + b * share
}

fn mixed_position(a: &Frame, b: &Frame, share: f32) -> Point3<f32> {
    a.position + (b.position - a.position) * share
}

fn mixed_tangent(a: &Frame, b: &Frame, share: f32) -> Option<Vector3<f32>> {
    blend(&a.tangent, &b.tangent, share).try_normalize(LEAST_TANGENT)
}
