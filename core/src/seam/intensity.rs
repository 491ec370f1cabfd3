//! Edge intensity (paper II-E, eq. (12)).
//!
//! Read as docs/method says: the sum runs over the neighbours and the point itself and is divided by their true
//! number; `r` is the radius that the neighbourhood really has.

use crate::{Vector, math};

/// Edge intensity, eq. (12): 0 amid a flat patch, larger toward an edge. Dimensionless.
///
/// `offsets_mm` are the neighbours relative to the point, the point itself left out; `radius_mm` is positive.
///
/// ```
/// use weldpath_core::{Vector, seam::intensity};
///
/// // Neighbours all round a point, and on one side of it only, as at the rim of a plate.
/// let [right, left] = [Vector::new(2.0, 0.0, 0.0), Vector::new(-2.0, 0.0, 0.0)];
/// assert_eq!(intensity(&[right, left], 2.0), 0.0);
/// assert_eq!(intensity(&[right], 2.0), 0.5);
/// ```
pub fn intensity(offsets_mm: &[Vector], radius_mm: f32) -> f32 {
    math::norm(&asymmetry(offsets_mm, radius_mm))
}

/// Displacement of the neighbourhood's centroid from the point, in radii: the vector whose length is the intensity.
///
/// It points into the open angle of a corner: toward the camera where the corner is concave. Zero for no neighbours.
pub fn asymmetry(offsets_mm: &[Vector], radius_mm: f32) -> Vector {
    asymmetry_of(offsets_mm.iter().copied(), radius_mm)
}

/// The same without a buffer.
pub(super) fn asymmetry_of(offsets_mm: impl Iterator<Item = Vector>, radius_mm: f32) -> Vector {
    let (sum_mm, count) = offsets_mm
        .fold((Vector::zeros(), 1.0_f32), |(sum_mm, count), offset_mm| (sum_mm + offset_mm, count + 1.0));
    sum_mm * (1.0 / (count * radius_mm))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc() -> [Vector; 12] {
        core::array::from_fn(|k| {
            let (s, c) = libm::sincosf(k as f32 * core::f32::consts::TAU / 12.0);
            Vector::new(2.0 * c, 2.0 * s, 0.0)
        })
    }

    #[test]
    fn the_centre_of_a_flat_disc_has_no_intensity() {
        assert!(intensity(&disc(), 2.0) < 1e-6);
    }

    #[test]
    fn a_straight_boundary_has_the_intensity_of_a_half_disc() {
        // A dense half disc's centroid is 4/(3 pi) radii from its centre.
        let mut offsets = heapless::Vec::<Vector, 2000>::new();
        for x in -25..=25 {
            for y in 0..=25 {
                let p = Vector::new(x as f32, y as f32 + 0.5, 0.0) / 25.0;
                if p.norm_squared() <= 1.0 {
                    offsets.push(p).expect("capacity");
                }
            }
        }
        assert!((intensity(&offsets, 1.0) - 0.4244).abs() < 0.01);
    }

    #[test]
    fn intensity_is_free_of_scale() {
        let offsets = [Vector::new(1.0, 0.5, 0.2), Vector::new(0.1, 0.9, -0.4), Vector::new(0.3, 0.3, 0.3)];
        let scaled = offsets.map(|o| o * 1000.0);
        assert!((intensity(&offsets, 2.0) - intensity(&scaled, 2000.0)).abs() < 1e-6);
    }

    #[test]
    fn no_neighbours_make_no_intensity() {
        assert_eq!(intensity(&[], 1.0), 0.0);
    }
}
