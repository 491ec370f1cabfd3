//! Bilateral filter (paper II-D, eq. (10)).
//!
//! Moves each point along its normal by a mean of its neighbours' heights, weighted by their distance and by the height
//! itself, so that the other side of an edge counts little. It still rounds corners: the default takes the edge
//! intensities from the filtered cloud, fits the two faces of a corner in the unfiltered voxels, and refines seams in the raw
//! points; the paper's way takes everything from the filtered cloud. The paper calls the widths variances; here they are standard deviations.

use crate::geometry::cloud::PointCloud;
use crate::geometry::grid::Grid;
use crate::geometry::grid::lanes::exp;
use crate::geometry::grid::sweep::Eight;
use nalgebra::Point3;
use wide::f32x8;

/// Sizes of the filter, mm.
#[derive(Debug, Clone, Copy)]
pub struct BilateralConfig {
    /// Radius of the neighbourhood.
    pub radius_mm: f32,
    /// Standard deviation of the weight by distance.
    pub distance_mm: f32,
    /// Standard deviation of the weight by height.
    pub height_mm: f32,
}

/// The filtered cloud, eq. (10): same points in the same order, moved along their normals.
pub fn bilateral(cloud: &PointCloud, config: &BilateralConfig) -> PointCloud {
    let grid = Grid::new(&cloud.points_mm, config.radius_mm);
    let limit = f32x8::splat(config.radius_mm * config.radius_mm);
    let (near, level) = (0.5 / config.distance_mm.powi(2), 0.5 / config.height_mm.powi(2));
    let normals = grid.by_slot(&cloud.normals);
    let moved: Vec<Point3<f32>> = grid.sweep(config.radius_mm, [], |slot, around| {
        let (p, normal) = (grid.point(slot), normals[slot]);
        let (mut sums, mut weights) = (f32x8::ZERO, f32x8::ZERO);
        for Eight { offset: [x, y, z], d2, .. } in around.from(p) {
            let height = x * normal.x + y * normal.y + z * normal.z;
            // The product of both Gaussians is one exponential.
            let weight = exp(-(d2 * near + height * height * level)) & d2.simd_lt(limit);
            sums += weight * height;
            weights += weight;
        }
        p + normal * (sums.reduce_add() / weights.reduce_add().max(f32::MIN_POSITIVE))
    });
    PointCloud {
        origin_mm: cloud.origin_mm,
        points_mm: grid.by_point(&moved),
        normals: cloud.normals.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    const CONFIG: BilateralConfig = BilateralConfig { radius_mm: 3.0, distance_mm: 1.5, height_mm: 0.6 };

    /// A 40 x 40 sheet at 1 mm spacing, heights from a fixed sequence of +-0.3 mm; `step` lifts its right half.
    fn sheet(step: f32) -> PointCloud {
        let height = |i: usize| if (i * 2_654_435_761) >> 7 & 1 == 0 { 0.3 } else { -0.3 };
        let points_mm = (0..1600)
            .map(|i| {
                let (x, y) = ((i % 40) as f32, (i / 40) as f32);
                Point3::new(x, y, height(i) + if x >= 20.0 { step } else { 0.0 })
            })
            .collect();
        PointCloud { points_mm, normals: vec![Vector3::z(); 1600], ..PointCloud::default() }
    }

    #[test]
    fn noise_on_a_plane_shrinks_and_points_move_along_normals_only() {
        let raw = sheet(0.0);
        let out = bilateral(&raw, &CONFIG);
        let rms = |c: &PointCloud| (c.points_mm.iter().map(|p| p.z * p.z).sum::<f32>() / 1600.0).sqrt();
        assert!(rms(&out) < 0.5 * rms(&raw), "{} {}", rms(&out), rms(&raw));
        assert!(out.points_mm.iter().zip(&raw.points_mm).all(|(a, b)| (a.x, a.y) == (b.x, b.y)));
    }

    #[test]
    fn a_high_step_stays_a_step() {
        let out = bilateral(&sheet(5.0), &CONFIG);
        let worst = out.points_mm.iter().map(|p| (p.z - if p.x >= 20.0 { 5.0 } else { 0.0 }).abs());
        assert!(worst.fold(0.0, f32::max) < 0.31);
    }
}
