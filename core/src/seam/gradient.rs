//! Gradient of the edge intensity (paper II-E, eq. (13)).
//!
//! Departure: the paper's `max` of the signed values is never negative and blows up where a coordinate difference
//! vanishes. Here each component is the value largest by magnitude, with its sign, among the neighbours whose
//! coordinate difference is at least a tenth of their distance.

use crate::{Vector, math};

/// Least share of the distance that a coordinate difference may have.
pub const MIN_SHARE: f32 = 0.1;

/// Gradient of the intensity, eq. (13), per axis. Dimensionless.
///
/// `neighbours` yields the offset of each neighbour, mm, and its intensity less that of the point.
pub fn gradient(neighbours: impl IntoIterator<Item = (Vector, f32)>) -> Vector {
    let mut steepest = Steepest::default();
    for (offset_mm, difference) in neighbours {
        steepest.add(&offset_mm, math::norm(&offset_mm), difference);
    }
    steepest.0
}

/// The components largest by magnitude so far.
#[derive(Default)]
pub(super) struct Steepest(pub(super) Vector);

impl Steepest {
    /// A neighbour: its offset and the length of that, and its intensity less that of the point.
    #[inline]
    pub(super) fn add(&mut self, offset_mm: &Vector, distance_mm: f32, difference: f32) {
        let rise = difference * distance_mm;
        for (largest, &delta_mm) in self.0.iter_mut().zip(offset_mm.iter()) {
            // `rise / delta` against the largest so far, without a division for the ones that lose.
            if delta_mm.abs() >= MIN_SHARE * distance_mm && rise.abs() > (*largest * delta_mm).abs() {
                *largest = rise / delta_mm;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_component_largest_by_magnitude_keeps_its_sign() {
        let offsets = [Vector::new(1.0, 0.0, 0.0), Vector::new(-1.0, 0.0, 0.0)];
        let g = gradient(offsets.into_iter().zip([0.1, 0.3]));
        assert_eq!(g, Vector::new(-0.3, 0.0, 0.0));
    }

    #[test]
    fn a_vanishing_coordinate_difference_is_skipped() {
        let offset = Vector::new(1.0, 1e-20, 0.0);
        assert_eq!(gradient([(offset, 0.5)]), Vector::new(0.5, 0.0, 0.0));
    }

    #[test]
    fn equal_intensities_have_no_gradient() {
        let offsets = [Vector::new(1.0, 2.0, 3.0), Vector::new(-3.0, 1.0, 0.5)];
        assert_eq!(gradient(offsets.into_iter().zip([0.0, 0.0])), Vector::zeros());
    }
}
