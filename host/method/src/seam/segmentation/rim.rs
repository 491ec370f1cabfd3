//! How surfaces end where no other goes on.

use super::growth::{Cloud, NONE};
use super::{Border, Merged};
use crate::geometry::depth_map::{DepthMap, Depths};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Radius of the neighbourhood in which a surface ends, voxels.
const AROUND_VOXELS: f32 = 4.0;
/// How far the points about one at the end of a surface lie off it on one side, in radii: at the very end .42, in the middle 0.
const ONE_SIDED: f32 = 0.28;
/// A place beyond the end, and how near a point there is the surface going on, voxels.
const BEYOND_VOXELS: f32 = 2.5;
const THERE_VOXELS: f32 = 1.6;
/// Where the camera is asked what it saw beyond: past what flies between two surfaces, voxels.
const ASKED_VOXELS: f32 = 4.0;
/// Nearer or farther by so much is another surface, voxels.
const APART_VOXELS: f32 = 3.0;
/// Edge of the cells of a picture, voxels.
const CELL_VOXELS: f32 = 1.5;

/// What each view saw in each direction, and from where.
pub(super) struct Sights {
    maps: Vec<(Point3<f32>, DepthMap)>,
}

impl Sights {
    /// Of views from known places.
    pub(super) fn of(merged: &Merged, voxel_mm: f32) -> Self {
        let cameras = if merged.cameras_unknown { &[][..] } else { &merged.cameras_mm };
        let mut about = vec![Vec::new(); cameras.len()];
        for (p, view) in merged.points_mm.iter().zip(&merged.view) {
            if let Some(camera) = cameras.get(usize::from(*view)) {
                about[usize::from(*view)].push(Point3::from(p - camera));
            }
        }
        let map = |(camera, about): (&Point3<f32>, Vec<Point3<f32>>)| {
            (*camera, DepthMap::new(&about, CELL_VOXELS * voxel_mm))
        };
        Self { maps: cameras.par_iter().zip(about).map(map).collect() }
    }

    pub(super) fn of_view(&self, view: u16) -> Option<&(Point3<f32>, DepthMap)> {
        self.maps.get(usize::from(view))
    }
}

/// How the surface of a point ends there, if it does.
pub(super) fn border(
    slot: usize,
    cloud: &Cloud,
    of: &[u32],
    sight: Option<&(Point3<f32>, DepthMap)>,
) -> Option<Border> {
    if of[slot] == NONE {
        return None;
    }
    let (place, normal, v) = (cloud.index.point(slot), cloud.normals[slot], cloud.voxel_mm);
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    cloud.index.within(&place, AROUND_VOXELS * v, |next, _| {
        if of[next] == of[slot] {
            (sum, count) = (sum + (cloud.index.point(next) - place), count + 1.0);
        }
    });
    let back = sum / count;
    let back = back - normal * normal.dot(&back);
    let out = -back.try_normalize(ONE_SIDED * AROUND_VOXELS * v)?;
    if cloud.index.nearest(&(place + out * (BEYOND_VOXELS * v)), THERE_VOXELS * v, |_| true).is_some() {
        return None;
    }
    let Some((camera, map)) = sight else { return Some(Border::Unseen) };
    let beyond = place + out * (ASKED_VOXELS * v) - camera;
    Some(match map.about(&Point3::from(beyond)) {
        Some(Depths { own_mm, nearest_mm, .. }) if nearest_mm < own_mm - APART_VOXELS * v => Border::Hidden,
        Some(Depths { own_mm, farthest_mm, .. }) if farthest_mm > own_mm + APART_VOXELS * v => Border::Edge,
        _ => Border::Unseen,
    })
}
