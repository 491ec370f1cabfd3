//! Edge scores of a whole cloud (paper II-E): core's kernels over a spatial index, eight neighbours at a time.
//!
//! Beyond the paper: the gate on the intensity itself, derived from the cloud, without which the scale-free ratio takes
//! flat noise for edges; and the sign of the asymmetry, which tells an inside corner from an outside one. A test holds
//! every step to core's functions; a neighbourhood here has no capacity, and no least number of points, which [`super::paper`] adds.

use crate::geometry::grid::Grid;
use crate::geometry::grid::lanes::exp;
use crate::geometry::grid::sweep::{Around, Eight};
use crate::geometry::statistics::median;
use crate::seam::input::SurfaceModel;
use nalgebra::{Point3, Vector3};
use weldpath_core::seam::Tensor;
use weldpath_core::seam::gradient::MIN_SHARE;
use wide::f32x8;

/// The gate, in medians of the intensity. Chosen on the simulated scans.
const GATE_MEDIANS: f32 = 1.8;
/// Bounds of the gate: flat surfaces stay below the first, the points of any corner of less than 130 degrees exceed the second.
const FLAT: f32 = 0.10;
const CORNER: f32 = 0.13;
/// Least concavity of a candidate, as a share of the gate. Chosen on the simulated scans.
const CONCAVE: f32 = 0.5;
/// Variance of the distances, as a share of their squared mean, below which it is rounding.
const LEAST_VARIANCE: f32 = 1e-6;

/// How the gate follows from the cloud, in words.
pub(crate) fn gate_in_words() -> String {
    format!("{GATE_MEDIANS} x median intensity, between {FLAT:.2} and {CORNER:.2}")
}

/// Scores of the points of a cloud, in its order.
#[derive(Debug, Clone, Default)]
pub struct Scores {
    /// Eq. (12).
    pub intensity: Vec<f32>,
    /// Part of the asymmetry along the normal: positive at an inside corner.
    pub concavity: Vec<f32>,
    /// Intensity above which a point may be an edge.
    pub gate: f32,
}

impl Scores {
    /// Points that may lie at an inside corner.
    pub fn candidates(&self) -> Vec<usize> {
        (0..self.intensity.len())
            .filter(|&k| self.intensity[k] > self.gate && self.concavity[k] > CONCAVE * self.gate)
            .collect()
    }
}

/// Scores every point of the denoised model by its [`asymmetries`].
pub fn score(model: &SurfaceModel) -> Scores {
    let SurfaceModel { voxels, index, asymmetries, .. } = model;
    debug_assert_eq!(voxels.cloud.len(), asymmetries.len());
    let mut scores =
        Scores { intensity: vec![0.0; index.len()], concavity: vec![0.0; index.len()], gate: 0.0 };
    for (slot, shift) in asymmetries.iter().enumerate() {
        let k = index.index(slot);
        scores.intensity[k] = shift.norm();
        scores.concavity[k] = shift.dot(&voxels.toward_camera[k]);
    }
    let median = median(&mut scores.intensity.clone());
    scores.gate = (GATE_MEDIANS * median).clamp(FLAT, CORNER);
    scores
}

/// Displacement of each slot's neighbourhood's centroid from it, in radii: its length is the edge intensity.
pub fn asymmetries(grid: &Grid, radius_mm: f32) -> Vec<Vector3<f32>> {
    let limit = f32x8::splat(radius_mm * radius_mm);
    grid.sweep(radius_mm, [], |slot, around: &Around<0>| {
        let [mut count, mut x, mut y, mut z] = [f32x8::ZERO; 4];
        for Eight { offset, d2, .. } in around.from(grid.point(slot)) {
            let inside = d2.simd_lt(limit);
            count += inside & f32x8::ONE;
            x += inside & offset[0];
            y += inside & offset[1];
            z += inside & offset[2];
        }
        // The point itself is among those around, and counts as the paper's `i = 0`.
        Vector3::new(x.reduce_add(), y.reduce_add(), z.reduce_add())
            * (1.0 / (count.reduce_add() * radius_mm))
    })
}

/// Gradient of the intensity at each slot.
pub fn gradients(grid: &Grid, radius_mm: f32, intensity: &[f32]) -> Vec<Vector3<f32>> {
    let limit = f32x8::splat(radius_mm * radius_mm);
    grid.sweep(radius_mm, [intensity], |slot, around| {
        let mut largest = [f32x8::ZERO; 3];
        for Eight { offset, d2, columns: [there] } in around.from(grid.point(slot)) {
            let (inside, distance) = (d2.simd_lt(limit), d2.sqrt());
            let rise = (there - intensity[slot]) * distance;
            for axis in 0..3 {
                // Not a number at the point itself, hence never larger.
                let slope = rise / offset[axis];
                let counts = offset[axis].abs().simd_ge(distance * MIN_SHARE) & inside;
                let larger = counts & slope.abs().simd_gt(largest[axis].abs());
                largest[axis] = larger.bitselect(slope, largest[axis]);
            }
        }
        let of_lanes = |a: f32, b: f32| if b.abs() > a.abs() { b } else { a };
        let of_axis = |axis: usize| largest[axis].to_array().into_iter().fold(0.0, of_lanes);
        Vector3::new(of_axis(0), of_axis(1), of_axis(2))
    })
}

/// Structure tensor at each slot, smoothed over the neighbourhood.
pub fn tensors(grid: &Grid, radius_mm: f32, gradients: &[Vector3<f32>]) -> Vec<Tensor> {
    let limit = f32x8::splat(radius_mm * radius_mm);
    let columns = [0, 1, 2].map(|axis| gradients.iter().map(|g| g[axis]).collect::<Vec<f32>>());
    grid.sweep(radius_mm, columns.each_ref().map(Vec::as_slice), |slot, around| {
        let at = grid.point(slot);
        let per_mm2 = falloff_per_mm2(at, around, limit);
        let mut sums = [f32x8::ZERO; 6];
        for Eight { d2, columns: [x, y, z], .. } in around.from(at) {
            let weight = exp(-(d2 * per_mm2)) & d2.simd_lt(limit);
            let (u, v) = (weight * x, weight * y);
            let terms = [u * x, u * y, u * z, v * y, v * z, weight * z * z];
            for k in 0..sums.len() {
                sums[k] += terms[k];
            }
        }
        Tensor::new(sums.map(f32x8::reduce_add))
    })
}

/// `1 / (2 σ²)` of the Gaussian, σ the standard deviation of the neighbours' distances; 0 where they do not vary.
#[inline(always)]
fn falloff_per_mm2<const C: usize>(at: Point3<f32>, around: &Around<C>, limit: f32x8) -> f32 {
    let [mut count, mut distances, mut squares] = [f32x8::ZERO; 3];
    for Eight { d2, .. } in around.from(at) {
        let inside = d2.simd_lt(limit);
        let d2 = d2 & inside;
        count += inside & f32x8::ONE;
        squares += d2;
        distances += d2.sqrt();
    }
    // Without the point itself, whose distance is 0.
    let others = (count.reduce_add() - 1.0).max(1.0);
    let mean = distances.reduce_add() / others;
    let variance = squares.reduce_add() / others - mean * mean;
    if variance > LEAST_VARIANCE * mean * mean { 0.5 / variance } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weldpath_core::seam::{RatioThreshold, gradient, intensity};

    const RADIUS_MM: f32 = 2.1;

    /// An uneven sheet with a step in it, spacing about 0.7 mm.
    fn cloud() -> Vec<Point3<f32>> {
        let jitter = |i: usize, k: usize| ((i * 7919 + k * 104_729) % 1009) as f32 / 1009.0;
        let at = |i: usize| {
            let (x, y) =
                (0.7 * (i % 50) as f32 + 0.3 * jitter(i, 1), 0.7 * (i / 50) as f32 + 0.3 * jitter(i, 2));
            Point3::new(x, y, 0.2 * jitter(i, 3) + if x > 17.0 { 4.0 } else { 0.0 })
        };
        (0..2500).map(at).chain([Point3::new(90.0, 0.0, 0.0)]).collect()
    }

    /// Slot, offset and squared distance of the neighbours of a slot.
    fn near(grid: &Grid, slot: usize) -> Vec<(usize, Vector3<f32>, f32)> {
        let mut found = Vec::new();
        grid.within(&grid.point(slot), RADIUS_MM, |other, d2| {
            if other != slot {
                found.push((other, grid.point(other) - grid.point(slot), d2));
            }
        });
        found
    }

    #[test]
    fn every_step_is_that_of_core() {
        let grid = Grid::new(&cloud(), RADIUS_MM);
        let close = |a: f32, b: f32| (a - b).abs() <= 1e-5 * b.abs().max(1.0);
        let intensities: Vec<f32> = asymmetries(&grid, RADIUS_MM).iter().map(Vector3::norm).collect();
        let gradients = gradients(&grid, RADIUS_MM, &intensities);
        let tensors = tensors(&grid, RADIUS_MM, &gradients);
        for slot in 0..grid.len() {
            let near = near(&grid, slot);
            let offsets: Vec<_> = near.iter().map(|n| n.1).collect();
            assert!(close(intensities[slot], intensity(offsets, RADIUS_MM)), "intensity of {slot}");
            let rises = near.iter().map(|n| (n.1, intensities[n.0] - intensities[slot]));
            let expected = gradient(rises);
            assert!((0..3).all(|k| close(gradients[slot][k], expected[k])), "gradient of {slot}");
            let around = near.iter().map(|n| (n.2, &gradients[n.0]));
            let (found, expected) =
                (tensors[slot].ratio(), Tensor::smoothed(&gradients[slot], around).ratio());
            // From 0, for a flat tensor, to 1, for an isotropic one; the lone point has none.
            let share = |ratio: f32| RatioThreshold::FLOOR / ratio.max(1.0);
            assert!(close(share(found), share(expected)), "ratio of {slot}: {found} {expected}");
        }
    }
}
