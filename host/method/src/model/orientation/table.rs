//! The plane on which the work stands, sought where nobody knows a side.

use super::looks::{Directions, Looks};
use crate::geometry::table::{STANDS, WAYS, carries, fitted, planes, stands_on, ways};
use crate::model::downsampling::Voxels;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::collections::HashSet;

/// Least share of all points in a table.
const TABLE_SHARE: f32 = 0.15;
/// Cosine within which the normal of a thin noisy voxel on a plane is about that of the plane.
const ABOUT_ALONG: f32 = 0.7;
/// Half its thickness, voxels.
const FLAT_VOXELS: f32 = 1.5;
/// Least share of it that is seen from over it: the underside of a plate is hidden by the plate.
const OPEN: f32 = 0.5;

/// Height above it, half thicknesses, of what is far from it; the share of what stands that may be nearer; and how many times as
/// many looks must see what stands from over the table as from below.
const FAR: f32 = 6.0;
const MOST_LOW: f32 = 0.01;
const BETTER: f32 = 1.5;

/// Places of a table.
pub(super) struct Places {
    /// Where it was scanned, and where it was not.
    pub(super) scanned: Vec<Point3<f32>>,
    pub(super) bare: Vec<Point3<f32>>,
    /// Of how many voxels each is.
    pub(super) voxels: i64,
}

/// A large plane with nothing behind it, on which the rest stands, and which is seen from there.
#[derive(Clone, Copy)]
pub(super) struct Table {
    /// The way it faces.
    pub(super) up: Vector3<f32>,
    level_mm: f32,
    /// Of all points.
    share: f32,
    /// Whether the rest stands on it, wherever the picture ends: blocks stand on tables, and hardly a pocket of their shape is
    /// sunk into a plate that is seen from its other side.
    pub(super) carries: bool,
    /// Whether it lies behind the rest, which is far from it: the walls of a pocket reach to its plane, and of one without walls its
    /// bottom is seen nearly as well.
    pub(super) is_behind: bool,
}

/// The largest table among the planes of a cloud.
pub(super) fn table(voxels: &Voxels, looks: &Looks) -> Option<Table> {
    let half_mm = FLAT_VOXELS * voxels.edge_mm;
    let planes = planes(&voxels.cloud.points_mm, half_mm, TABLE_SHARE);
    let sides: Vec<_> =
        planes.into_iter().flat_map(|(n, level_mm)| [(n, level_mm), (-n, -level_mm)]).collect();
    let tables: Vec<Table> =
        sides.par_iter().filter_map(|(up, level_mm)| table_at(voxels, up, *level_mm, looks)).collect();
    tables.into_iter().max_by(|a, b| a.share.total_cmp(&b.share))
}

/// Edge of a place of a table that is scanned or not, voxels, and the most such places along the scan.
const PLACE_VOXELS: f32 = 4.0;
const PLACES: f32 = 500.0;

impl Table {
    fn height_mm(&self, p: &Point3<f32>) -> f32 {
        self.up.dot(&p.coords) - self.level_mm
    }

    /// Whether a voxel is of it.
    pub(super) fn is_of(&self, p: &Point3<f32>, edge_mm: f32) -> bool {
        self.height_mm(p).abs() < 2.0 * FLAT_VOXELS * edge_mm
    }

    /// Its places where it was scanned and where it was not, amid what was scanned of it and of what stands on it. Beyond that it
    /// may end: work can hang beside a table.
    pub(super) fn places(&self, voxels: &Voxels) -> Places {
        let points = &voxels.cloud.points_mm;
        let ways = ways(&self.up);
        let near_mm = FAR * FLAT_VOXELS * voxels.edge_mm;
        let near: Vec<&Point3<f32>> = points.iter().filter(|p| self.height_mm(p).abs() < near_mm).collect();
        let reach_mm = ways.map(|way| near.iter().map(|p| way.dot(&p.coords)).fold(f32::MIN, f32::max));
        // A quarter of the way round from one to the other, and half of it to where they begin.
        let axes = [0, WAYS / 4].map(|k| (ways[k], -reach_mm[k + WAYS / 2], reach_mm[k]));
        let widest_mm = axes.map(|(_, low, high)| high - low).into_iter().fold(0.0, f32::max);
        let edge_mm = (PLACE_VOXELS * voxels.edge_mm).max(widest_mm / PLACES);
        let place =
            |p: &Point3<f32>| axes.map(|(axis, low, _)| ((axis.dot(&p.coords) - low) / edge_mm) as i32);
        let scanned: HashSet<[i32; 2]> =
            points.iter().filter(|p| self.is_of(p, voxels.edge_mm)).map(place).collect();
        let [columns, rows] = axes.map(|(_, low, high)| ((high - low) / edge_mm) as i32);
        let all = (0..columns).flat_map(|i| (0..rows).map(move |j| [i, j]));
        let at = |[i, j]: [i32; 2]| {
            let along =
                axes.iter().zip([i, j]).map(|((axis, low, _), k)| axis * (low + edge_mm * (k as f32 + 0.5)));
            Point3::from(along.sum::<Vector3<f32>>() + self.up * self.level_mm)
        };
        let is_amid =
            |p: &Point3<f32>| ways.iter().zip(&reach_mm).all(|(way, reach)| way.dot(&p.coords) < *reach);
        let (scanned, bare): (Vec<_>, Vec<_>) = all.partition(|place| scanned.contains(place));
        let bare = bare.into_iter().map(at).filter(is_amid).collect();
        let scanned = scanned.into_iter().map(at).collect();
        Places { scanned, bare, voxels: (edge_mm / voxels.edge_mm).powi(2) as i64 }
    }
}

/// The table that is about here and faces about this way.
fn table_at(voxels: &Voxels, up: &Vector3<f32>, level_mm: f32, looks: &Looks) -> Option<Table> {
    let (points, normals) = (&voxels.cloud.points_mm, &voxels.cloud.normals);
    let total = points.len() as f32;
    let half_mm = FLAT_VOXELS * voxels.edge_mm;
    let (up, level_mm) = fitted(points, *up, level_mm, half_mm);
    let height = |p: &Point3<f32>| p.coords.dot(&up) - level_mm;
    let is_on =
        |(p, n): (&Point3<f32>, &Vector3<f32>)| height(p).abs() < half_mm && n.dot(&up).abs() > ABOUT_ALONG;
    let on: Vec<bool> = points.iter().zip(normals).map(is_on).collect();
    let count = on.iter().filter(|on| **on).count() as f32;
    if count < TABLE_SHARE * total || !stands_on(points, &up, level_mm, half_mm) {
        return None;
    }
    let over = looks.half(&up);
    // From below, nothing hides it in any case; from above, a third of all looks must see it.
    let is_open = |i: usize| 3 * (looks.seen[i] & over).count_ones() > over.count_ones();
    let open = (0..points.len()).filter(|&i| on[i] && is_open(i)).count();
    let carries = carries(points, &up, level_mm, half_mm);
    let standing: Vec<usize> = (0..points.len()).filter(|&i| height(&points[i]) > STANDS * half_mm).collect();
    let low = standing.iter().filter(|&&i| height(&points[i]) < FAR * half_mm).count();
    let sees = |from: Directions| {
        let looks = standing.iter().map(|&i| (looks.seen[i] & from).count_ones());
        looks.sum::<u32>() as f32 / from.count_ones() as f32
    };
    let is_behind =
        low as f32 <= MOST_LOW * standing.len() as f32 && sees(over) > BETTER * sees(looks.half(&-up));
    (open as f32 > OPEN * count).then_some(Table { up, level_mm, share: count / total, carries, is_behind })
}
