//! Rotations: from a basis, along an arc, and to and from a rotation vector (Rodrigues).
//!
//! nalgebra's own versions call the platform's `sin`, `acos` and square root; these call [`crate::math`], so that host
//! and microcontroller hold the same bits. Angles are radians.

use nalgebra::{Quaternion, UnitQuaternion};

use crate::math::{self, Real};
use crate::{Orientation, Vector};

/// The shortest turn from one orientation to another, at constant rate.
///
/// Held as the unit quaternion halfway and the unit quaternion across it: `middle cos x + across sin x` is the
/// spherical interpolation for `x` from minus to plus half the angle between the two. That needs one `atan2` and two
/// roots per arc and one short polynomial per point, is unit by construction, and is as accurate at a thousandth of a
/// degree as at 180, where `sin((1 - alpha) t) / sin t` needs a case of its own.
#[derive(Debug, Clone, Copy)]
pub struct Arc<T = f32> {
    middle: Quaternion<T>,
    across: Quaternion<T>,
    /// A quarter of the angle of rotation: at most pi/4.
    quarter_rad: T,
}

impl<T: Real> Arc<T> {
    /// The arc from `from` to `to`, the short way round.
    pub fn between(from: &UnitQuaternion<T>, to: &UnitQuaternion<T>) -> Self {
        let (a, b) = (from.into_inner(), same_hemisphere(to, from).into_inner());
        let (sum, difference) = (a + b, b - a);
        let (along, apart) = (length(&sum), length(&difference));
        let still = Quaternion::new(T::zero(), T::zero(), T::zero(), T::zero());
        let across = if apart > T::zero() { difference / apart } else { still };
        Self { middle: sum / along, across, quarter_rad: apart.angle_over(along) }
    }

    /// Angle of the whole turn, 0 to pi.
    pub fn angle_rad(&self) -> T {
        let half = self.quarter_rad + self.quarter_rad;
        half + half
    }

    /// The orientation after the share `alpha` (clamped to 0..1) of the turn, eq. (19).
    ///
    /// Departure: the paper turns rotation vectors, whose formula holds for unit vectors only and fails near half a turn,
    /// where the torch points down. These are unit quaternions, the short way round: within 1e-6 rad of the exact turn
    /// in single precision.
    pub fn slerp(&self, alpha: T) -> UnitQuaternion<T> {
        let alpha = alpha.clamp(T::zero(), T::one());
        let (s, c) = ((alpha + alpha - T::one()) * self.quarter_rad).sin_cos_eighth();
        UnitQuaternion::new_unchecked(self.middle * c + self.across * s)
    }
}

/// `orientation` with the sign of its quaternion nearest to `reference`: the same rotation.
pub fn same_hemisphere<T: Real>(
    orientation: &UnitQuaternion<T>,
    reference: &UnitQuaternion<T>,
) -> UnitQuaternion<T> {
    if dot(orientation, reference) < T::zero() {
        UnitQuaternion::new_unchecked(-orientation.into_inner())
    } else {
        *orientation
    }
}

/// The rotation whose columns are the right-handed orthonormal `x`, `y`, `z` (Shepperd's method: the largest of four
/// is divided by, so no case loses accuracy).
pub fn from_basis(x: &Vector, y: &Vector, z: &Vector) -> Orientation {
    let (xx, yy, zz) = (x.x, y.y, z.z);
    let (w, i, j, k) = if xx + yy + zz > 0.0 {
        (1.0 + xx + yy + zz, y.z - z.y, z.x - x.z, x.y - y.x)
    } else if xx >= yy && xx >= zz {
        (y.z - z.y, 1.0 + xx - yy - zz, y.x + x.y, z.x + x.z)
    } else if yy >= zz {
        (z.x - x.z, y.x + x.y, 1.0 - xx + yy - zz, z.y + y.z)
    } else {
        (x.y - y.x, z.x + x.z, z.y + y.z, 1.0 - xx - yy + zz)
    };
    unit(w, i, j, k).unwrap_or_else(Orientation::identity)
}

/// The rotation of the quaternion `w + xi + yj + zk` made unit; none if it is zero or not finite.
///
/// ```
/// use weldpath_core::rotation::unit;
///
/// assert!((unit(2.0, 0.0, 0.0, 0.0).unwrap().w - 1.0).abs() < 1e-6);
/// assert!(unit(0.0, 0.0, 0.0, 0.0).is_none(), "no direction, no rotation");
/// ```
pub fn unit(w: f32, x: f32, y: f32, z: f32) -> Option<Orientation> {
    let q = Quaternion::new(w, x, y, z);
    let length = length(&q);
    (length > f32::MIN_POSITIVE && length.is_finite()).then(|| Orientation::new_unchecked(q / length))
}

/// The rotation about the axis `rotation_vector` by its length in radians (Rodrigues, as in Alg. 1).
pub fn from_rotation_vector(rotation_vector: &Vector) -> Orientation {
    let angle_rad = math::norm(rotation_vector);
    if angle_rad <= f32::MIN_POSITIVE {
        return Orientation::identity();
    }
    let (s, c) = math::sin_cos(0.5 * angle_rad);
    let v = rotation_vector * (s / angle_rad);
    unit(c, v.x, v.y, v.z).unwrap_or_else(Orientation::identity)
}

fn dot<T: Real>(a: &UnitQuaternion<T>, b: &UnitQuaternion<T>) -> T {
    a.w * b.w + a.i * b.i + a.j * b.j + a.k * b.k
}

fn length<T: Real>(q: &Quaternion<T>) -> T {
    (q.w * q.w + q.i * q.i + q.j * q.j + q.k * q.k).root()
}

#[cfg(test)]
pub(crate) mod tests {
    extern crate std;
    use super::*;
    use nalgebra::UnitQuaternion;

    /// A fixed sequence of orientations spread over all of them.
    pub(crate) fn orientations() -> impl Iterator<Item = Orientation> {
        let mut state = 7_u32;
        let mut draw = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        core::iter::repeat_with(move || unit(draw(), draw(), draw(), draw())).flatten()
    }

    pub(crate) fn wide(q: &Orientation) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(q.into_inner().cast::<f64>())
    }

    /// Angle between two rotations, by the log map: arccos cannot see below 3e-4 rad.
    fn apart_rad(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
        2.0 * (a.inverse() * b).imag().norm().min(1.0).asin()
    }

    #[test]
    fn the_arc_is_the_spherical_interpolation_of_double_precision() {
        let all: std::vec::Vec<_> = orientations().take(2000).collect();
        for pair in all.windows(2) {
            let near = from_rotation_vector(&Vector::new(1e-4, -2e-4, 3e-3)) * pair[0];
            for to in [pair[1], near, pair[0]] {
                let arc = Arc::between(&pair[0], &to);
                let (a, b) = (wide(&pair[0]), wide(&to));
                for alpha in [0.0_f32, 0.1, 0.25, 0.5, 0.73, 1.0] {
                    let got = arc.slerp(alpha);
                    let want = a.try_slerp(&b, f64::from(alpha), 1e-12).unwrap_or(a);
                    assert!(apart_rad(&wide(&got), &want) < 1e-6);
                    assert!((f64::from(length(&got)) - 1.0).abs() < 5e-7, "unit");
                    let double = Arc::between(&a, &b).slerp(f64::from(alpha));
                    assert!(apart_rad(&double, &want) < 1e-11 && (length(&double) - 1.0).abs() < 1e-14);
                }
            }
        }
    }

    #[test]
    fn the_arc_takes_the_short_way_and_half_turns_have_an_answer() {
        let a = Orientation::identity();
        let b = Orientation::new_unchecked(-from_rotation_vector(&Vector::new(0.0, 0.0, 0.5)).into_inner());
        assert!((Arc::between(&a, &b).angle_rad() - 0.5).abs() < 1e-6);
        let opposite = unit(0.0, 0.0, 0.0, 1.0).unwrap();
        let half = Arc::between(&a, &opposite);
        assert!((half.angle_rad() - core::f32::consts::PI).abs() < 1e-6);
        assert!((Arc::between(&a, &half.slerp(0.5)).angle_rad() - core::f32::consts::FRAC_PI_2).abs() < 1e-6);
        assert_eq!(Arc::between(&a, &a).angle_rad(), 0.0);
    }

    #[test]
    fn a_basis_and_its_rotation_are_the_same() {
        for q in orientations().take(2000) {
            let (x, y, z) = (q * Vector::x(), q * Vector::y(), q * Vector::z());
            assert!(Arc::between(&q, &from_basis(&x, &y, &z)).angle_rad() < 2e-6);
        }
    }

    #[test]
    fn a_rotation_vector_turns_as_that_of_nalgebra_does() {
        for q in orientations().take(2000) {
            assert!(Arc::between(&q, &from_rotation_vector(&q.scaled_axis())).angle_rad() < 2e-6);
        }
        for tiny in [0.0, 1e-30, 1e-12, 1e-7] {
            let v = from_rotation_vector(&Vector::new(tiny, 0.0, 0.0)).scaled_axis();
            assert!((v.x - tiny).abs() < 1e-12, "{tiny}");
        }
    }
}
