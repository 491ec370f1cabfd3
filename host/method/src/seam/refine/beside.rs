//! Points beside a seam in the seam's own coordinates: along it, and out along and off each face (ours).

use super::frame::Frame;
use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::geometry::grid::rows::bounds;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

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
pub(crate) fn near_path(raw: &Grid, frames: &[Frame], reach_mm: f32) -> Vec<u32> {
    let stations: Vec<_> = frames.iter().map(|f| f.position).collect();
    let grid = Grid::new(&stations, reach_mm);
    let (low, high) = bounds(&stations);
    let is_near = |slot: usize, within_mm: f32| {
        let p = raw.point(slot);
        let inside = (0..3).all(|k| p[k] > low[k] - within_mm && p[k] < high[k] + within_mm);
        inside && grid.is_near(&p, within_mm)
    };
    // Where the first point of a cell is farther or nearer than the reach by this, all of it is.
    let cell_mm = ROUNDED_UP * 3f32.sqrt() * raw.cell_mm();
    let of_cell = |slots: Range<usize>| {
        let several = slots.len() > FEW;
        let all = several && reach_mm > cell_mm && is_near(slots.start, reach_mm - cell_mm);
        let none = several && !all && !is_near(slots.start, reach_mm + cell_mm);
        let near = (if none { 0..0 } else { slots }).filter(move |&slot| all || is_near(slot, reach_mm));
        near.map(|slot| raw.index(slot) as u32)
    };
    let mut near: Vec<u32> = raw.cells().with_max_len(CELLS).flat_map_iter(of_cell).collect();
    near.par_sort_unstable();
    near
}

/// Points of a cell that are better looked at one by one.
const FEW: usize = 8;
/// Cells that one thread works on at most.
const CELLS: usize = 1024;
/// A little more than 1: what a diagonal may lose by rounding.
const ROUNDED_UP: f32 = 1.001;

/// Neighbouring points that one thread works on at least.
const SHARE: usize = 1024;
/// The station nearest to a point that is this many reaches from it may be beside the foot that is within one.
const STATION_REACHES: f32 = 1.5;

/// Seam coordinates of raw points nearer than `reach_mm` to the path; those beyond the ends of an open one by more than a
/// step are left out.
pub fn beside(merged: &Merged, near: &[u32], line: StationLine, reach_mm: f32) -> Vec<Beside> {
    let stations: Vec<_> = line.frames.iter().map(|f| f.position).collect();
    let grid = Grid::new(&stations, reach_mm);
    near.par_iter()
        .with_min_len(SHARE)
        .filter_map(|&k| {
            let p = merged.points_mm[k as usize];
            let (slot, _) = grid.nearest(&p, STATION_REACHES * reach_mm, |_| true)?;
            let Foot { s, offset, frame } = line.foot(&p, grid.index(slot), reach_mm)?;
            let into = frame.faces_inward();
            let h = frame.faces.map(|normal| offset.dot(&normal));
            let face = usize::from(h[1].abs() < h[0].abs());
            let view = merged.view[k as usize];
            let incidence_cos =
                merged.toward_camera(k as usize).map_or(1.0, |ray| ray.dot(&frame.faces[face]));
            Some(Beside { s, face: face as u8, u: offset.dot(&into[face]), h: h[face], view, incidence_cos })
        })
        .collect()
}

/// Stations at equal steps, borrowed from a path or a refined seam.
#[derive(Clone, Copy)]
pub struct StationLine<'a> {
    /// The stations.
    pub frames: &'a [Frame],
    /// Distance of stations, mm.
    pub step_mm: f32,
    /// Whether the last is followed by the first.
    pub closed: bool,
}

/// Where the perpendicular from a point meets a line of stations.
pub struct Foot {
    /// Along the line from its first station, mm.
    pub s: f32,
    /// The point from there, in the cross-section, mm.
    pub offset: Vector3<f32>,
    /// The frame there, interpolated between the nearest station and the one beyond it.
    pub frame: Frame,
}

impl StationLine<'_> {
    /// The foot of a point nearer than `reach_mm`, about its nearest station.
    pub fn foot(&self, p: &Point3<f32>, nearest: usize, reach_mm: f32) -> Option<Foot> {
        let near = &self.frames[nearest];
        let ahead = (p - near.position).dot(&near.tangent);
        let far = &self.frames[self.beyond(nearest, ahead)];
        let gap = (far.position - near.position).norm();
        let sign = if ahead >= 0.0 { 1.0 } else { -1.0 };
        let mut share = if gap > 0.0 { (ahead.abs() / gap).min(1.0) } else { 0.0 };
        if gap > 0.0 {
            // The chord is only near the seam: once more with the tangent there.
            let tangent = Frame::mixed_tangent(near, far, share)?;
            let position = Frame::mixed_position(near, far, share);
            share = (share + (p - position).dot(&tangent) * sign / gap).clamp(0.0, 1.0);
        }
        let position = Frame::mixed_position(near, far, share);
        let tangent = Frame::mixed_tangent(near, far, share)?;
        let off = (p - position).dot(&tangent);
        let offset = p - position - tangent * off;
        if off.abs() > self.step_mm || offset.norm_squared() > reach_mm * reach_mm {
            return None;
        }
        let frame = Frame::about(position, tangent, Frame::mixed_faces(near, far, share))?;
        let beyond = if gap > 0.0 { 0.0 } else { ahead };
        Some(Foot { s: nearest as f32 * self.step_mm + sign * share * self.step_mm + beyond, offset, frame })
    }

    /// The station on the other side of a point that is `ahead` of its nearest one, or behind it.
    fn beyond(&self, nearest: usize, ahead: f32) -> usize {
        let n = self.frames.len();
        match (ahead >= 0.0, self.closed) {
            (true, true) => (nearest + 1) % n,
            (false, true) => (nearest + n - 1) % n,
            (true, false) => (nearest + 1).min(n - 1),
            (false, false) => nearest.saturating_sub(1),
        }
    }
}
