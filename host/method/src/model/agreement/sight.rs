//! What one view says of a place: a surface there, a surface behind it, or nothing.

use crate::geometry::depth_map::{DepthMap, Depths};
use crate::model::normals::Patches;
use nalgebra::Point3;

/// Nearer or farther by so much is another surface, mm: three standard deviations of a reported camera position.
pub(super) const APART_MM: f32 = 6.0;
/// Cells of a direction hold some patches, so that none of a closed surface is empty: its edge in mean patch edges.
const CELL_PATCHES: f32 = 2.0;

/// What a view says of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sight {
    /// A surface at the place.
    At,
    /// Surfaces behind it in every direction near to it: nothing is there.
    Through,
    /// A surface before it, or nothing measured.
    Unknown,
}

/// What a view saw in each direction.
pub(super) fn depth_map(patches: &Patches) -> DepthMap {
    DepthMap::new(&patches.cloud.points_mm, CELL_PATCHES * patches.cell_mm)
}

/// What a view says of a place, from what it saw.
pub(super) fn sight(map: &DepthMap, place: &Point3<f32>) -> Sight {
    match map.about(place) {
        Some(Depths { own_mm, nearest_mm, .. }) if nearest_mm > own_mm + APART_MM => Sight::Through,
        Some(Depths { own_mm, farthest_mm, .. }) if farthest_mm > own_mm - APART_MM => Sight::At,
        _ => Sight::Unknown,
    }
}
