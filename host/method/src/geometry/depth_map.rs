//! What one camera saw in each direction: the nearest and the farthest, coarsely.

use nalgebra::{Point3, Unit, Vector3};

/// Most cells along an edge of the map.
const MOST_CELLS: usize = 1000;

/// Nearest and farthest point of a view in each direction, mm along its axis.
pub(crate) struct DepthMap {
    axes: [Vector3<f32>; 3],
    least: [f32; 2],
    cell: f32,
    size: [usize; 2],
    depths_mm: Vec<[f32; 2]>,
}

const EMPTY: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// What was seen about the direction of a place, mm along the axis of the view.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Depths {
    /// Of the place itself.
    pub(crate) own_mm: f32,
    pub(crate) nearest_mm: f32,
    pub(crate) farthest_mm: f32,
}

impl DepthMap {
    /// Of points about the camera, in cells that are so wide at their mean depth.
    pub(crate) fn new(points: &[Point3<f32>], cell_mm: f32) -> Self {
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
        map.cell = (cell_mm / depth_mm).max(widest / MOST_CELLS as f32).max(1e-6);
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

    /// What was seen in the direction of a place and in those next to it; none where it was nothing.
    pub(crate) fn about(&self, place: &Point3<f32>) -> Option<Depths> {
        let d = self.direction(place)?;
        let [i, j] = self.cell_of(&d)?;
        if self.depths_mm[i * self.size[1] + j] == EMPTY {
            return None;
        }
        let (rows, columns) =
            (i.saturating_sub(1)..(i + 2).min(self.size[0]), j.saturating_sub(1)..(j + 2).min(self.size[1]));
        let around = rows.flat_map(|i| columns.clone().map(move |j| self.depths_mm[i * self.size[1] + j]));
        let [nearest_mm, farthest_mm] =
            around.fold(EMPTY, |[near, far], cell| [near.min(cell[0]), far.max(cell[1])]);
        Some(Depths { own_mm: d[2], nearest_mm, farthest_mm })
    }
}
