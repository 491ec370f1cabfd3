//! What one view says of a place: a surface there, a surface behind it, or nothing.

use crate::model::normals::Patches;
use nalgebra::{Point3, Unit, Vector3};

/// Nearer or farther by so much is another surface, mm: three standard deviations of a reported camera position.
pub(super) const APART_MM: f32 = 6.0;
/// Cells of a direction hold some patches, so that none of a closed surface is empty: its edge in mean patch edges.
const CELL_PATCHES: f32 = 2.0;
/// Most cells along an edge of the map.
const MOST_CELLS: usize = 1000;

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

/// Nearest and farthest patch of a view in each direction, mm along its axis.
pub(super) struct DepthMap {
    axes: [Vector3<f32>; 3],
    least: [f32; 2],
    cell: f32,
    size: [usize; 2],
    depths_mm: Vec<[f32; 2]>,
}

const EMPTY: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

impl DepthMap {
    pub(super) fn new(patches: &Patches) -> Self {
        let points = &patches.cloud.points_mm;
        let toward: Vector3<f32> = points.iter().map(|p| p.coords).sum();
        let axis = Unit::try_new(toward, 1e-6).unwrap_or(Vector3::z_axis()).into_inner();
        let mut least = Vector3::zeros();
        least[axis.iamin()] = 1.0;
        let right = axis.cross(&least).normalize();
        let axes = [right, axis.cross(&right), axis];
        let mut map = Self { axes, least: [0.0; 2], cell: 1.0, size: [1; 2], depths_mm: vec![EMPTY] };
        let seen: Vec<[f32; 3]> = points.iter().filter_map(|p| map.direction(p)).collect();
        if seen.is_empty() {
            return map;
        }
        let depth_mm = seen.iter().map(|[.., depth]| depth).sum::<f32>() / seen.len() as f32;
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for d in &seen {
            for a in 0..2 {
                (low[a], high[a]) = (low[a].min(d[a]), high[a].max(d[a]));
            }
        }
        let widest = (high[0] - low[0]).max(high[1] - low[1]);
        map.least = low;
        map.cell = (CELL_PATCHES * patches.cell_mm / depth_mm).max(widest / MOST_CELLS as f32).max(1e-6);
        map.size = [0, 1].map(|a| ((high[a] - low[a]) / map.cell) as usize + 1);
        map.depths_mm = vec![EMPTY; map.size[0] * map.size[1]];
        for d in seen {
            if let Some([i, j]) = map.cell_of(&d) {
                let known = &mut map.depths_mm[i * map.size[1] + j];
                *known = [known[0].min(d[2]), known[1].max(d[2])];
            }
        }
        map
    }

    /// Tangents and depth of a place; none behind the camera.
    fn direction(&self, p: &Point3<f32>) -> Option<[f32; 3]> {
        let [u, v, depth] = self.axes.map(|axis| axis.dot(&p.coords));
        (depth > 1.0).then(|| [u / depth, v / depth, depth])
    }

    fn cell_of(&self, d: &[f32; 3]) -> Option<[usize; 2]> {
        let [i, j] = [0, 1].map(|a| ((d[a] - self.least[a]) / self.cell).floor());
        let inside = i >= 0.0 && j >= 0.0 && (i as usize) < self.size[0] && (j as usize) < self.size[1];
        inside.then_some([i as usize, j as usize])
    }

    pub(super) fn sight(&self, place: &Point3<f32>) -> Sight {
        let Some(d) = self.direction(place) else { return Sight::Unknown };
        let Some([i, j]) = self.cell_of(&d) else { return Sight::Unknown };
        if self.depths_mm[i * self.size[1] + j] == EMPTY {
            return Sight::Unknown;
        }
        let (rows, columns) =
            (i.saturating_sub(1)..(i + 2).min(self.size[0]), j.saturating_sub(1)..(j + 2).min(self.size[1]));
        let around = rows.flat_map(|i| columns.clone().map(move |j| i * self.size[1] + j));
        let [mut nearest, mut farthest] = EMPTY;
        for cell in around {
            let [near, far] = self.depths_mm[cell];
            (nearest, farthest) = (nearest.min(near), farthest.max(far));
        }
        if nearest > d[2] + APART_MM {
            Sight::Through
        } else if farthest > d[2] - APART_MM {
            Sight::At
        } else {
            Sight::Unknown
        }
    }
}
