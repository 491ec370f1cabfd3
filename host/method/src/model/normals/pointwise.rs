//! The paper's normals as printed: a plane through every point's own neighbours within a radius.
//!
//! The default fits planes to cells instead (see [`super::estimate`]); the paper's way runs these.

use crate::geometry::grid::Grid;
use crate::geometry::grid::sweep::{Around, Eight};
use crate::geometry::plane::Scatter;
use nalgebra::Vector3;
use wide::f32x8;

/// Unit normal at each slot of a grid, its sign arbitrary; z where the neighbours make no plane.
pub fn within(grid: &Grid, radius_mm: f32) -> Vec<Vector3<f32>> {
    let limit = f32x8::splat(radius_mm * radius_mm);
    grid.sweep(radius_mm, [], |slot, around: &Around<0>| {
        // Relative to the point itself, so that nothing cancels.
        let mut moments = [f32x8::ZERO; 10];
        for Eight { offset: [x, y, z], d2, .. } in around.from(grid.point(slot)) {
            let inside = d2.simd_lt(limit);
            let [u, v, w] = [x & inside, y & inside, z & inside];
            let terms = [inside & f32x8::ONE, u, v, w, u * x, u * y, u * z, v * y, v * z, w * z];
            for k in 0..moments.len() {
                moments[k] += terms[k];
            }
        }
        let [n, x, y, z, xx, xy, xz, yy, yz, zz] = moments.map(|sums| f64::from(sums.reduce_add()));
        let [x, y, z] = [x / n, y / n, z / n];
        let covariance =
            [xx / n - x * x, xy / n - x * y, xz / n - x * z, yy / n - y * y, yz / n - y * z, zz / n - z * z];
        Scatter::new(covariance, n as f32).normal()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn a_tilted_plane_has_its_own_normal_everywhere() {
        let normal = Vector3::new(0.3, -0.4, 0.866).normalize();
        let at = |i: usize| {
            let (x, y) = ((i % 40) as f32 - 20.0, (i / 40) as f32 - 20.0);
            Point3::new(x, y, -(normal.x * x + normal.y * y) / normal.z)
        };
        let points: Vec<_> = (0..1600).map(at).collect();
        for found in within(&Grid::new(&points, 3.0), 3.0) {
            assert!(found.dot(&normal).abs() > 1.0 - 1e-6, "{found}");
        }
    }

    #[test]
    fn a_lone_point_and_a_line_have_unit_normals() {
        let points = [Point3::origin(), Point3::new(50.0, 0.0, 0.0), Point3::new(51.0, 0.0, 0.0)];
        let normals = within(&Grid::new(&points, 3.0), 3.0);
        assert!(normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-6 && n.x.abs() < 1e-3), "{normals:?}");
    }
}
