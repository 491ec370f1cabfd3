//! The scalar functions of core; the only file that names libm or micromath.
//!
//! Host and microcontroller call these and no others, so both compute the same bits: libm's f32 square root, `acos`
//! and `atan2` are plain Rust on both, and nothing here depends on the platform's C library.
//!
//! libm's `sinf` and `cosf` work in double precision, which a Cortex-M4F does in software (about 1200 instructions);
//! [`sin_cos`] is a single-precision polynomial (about 50) with an error of at most 1e-7.

use core::f32::consts::{FRAC_2_PI, LOG2_E};

use crate::{Direction, Vector};

#[cfg(all(feature = "fpu", not(target_arch = "arm")))]
compile_error!("weldpath-core's feature `fpu` is for Cortex-M processors with single-precision hardware");

/// Square root, correctly rounded: the board's own with feature `fpu`, which has the same bits.
#[inline]
pub fn sqrt(x: f32) -> f32 {
    #[cfg(feature = "fpu")]
    return weldpath_fpu::sqrt(x);
    #[cfg(not(feature = "fpu"))]
    libm::sqrtf(x)
}

/// A scalar in which poses are interpolated: single precision on host and microcontroller alike, double on the host.
pub trait Real: nalgebra::RealField + Copy {
    /// Square root, correctly rounded.
    fn root(self) -> Self;
    /// Angle of the point `(x, self)`, radians in [-pi, pi].
    fn angle_over(self, x: Self) -> Self;
    /// Sine and cosine of |angle| <= pi/4, radians.
    fn sin_cos_eighth(self) -> (Self, Self);
}

impl Real for f32 {
    #[inline]
    fn root(self) -> Self {
        sqrt(self)
    }
    #[inline]
    fn angle_over(self, x: Self) -> Self {
        atan2(self, x)
    }
    #[inline]
    fn sin_cos_eighth(self) -> (Self, Self) {
        sin_cos_eighth(self)
    }
}

impl Real for f64 {
    fn root(self) -> Self {
        libm::sqrt(self)
    }
    fn angle_over(self, x: Self) -> Self {
        libm::atan2(self, x)
    }
    fn sin_cos_eighth(self) -> (Self, Self) {
        libm::sincos(self)
    }
}

/// Arc cosine, radians; NaN outside [-1, 1].
pub fn acos(x: f32) -> f32 {
    libm::acosf(x)
}

/// Angle of the point `(x, y)`, radians in [-pi, pi].
pub fn atan2(y: f32, x: f32) -> f32 {
    libm::atan2f(y, x)
}

/// `e` to the power `-x` for `x >= 0`: relative error at most 2e-7 (coefficients of Cephes' expf), 0 beyond 87.
///
/// A third of libm's instructions, which an edge score pays once per neighbour. Without meaning for `x < 0`.
#[inline]
pub fn exp_of_negative(x: f32) -> f32 {
    if x > 87.0 {
        return 0.0;
    }
    let k = (x * LOG2_E + 0.5) as i32;
    let r = (k as f32 * 0.693_359_4 - x) - k as f32 * 2.121_944_4e-4;
    let high =
        1.666_666_6e-1 + r * (4.166_579_6e-2 + r * (8.333_452e-3 + r * (1.398_2e-3 + r * 1.987_569_1e-4)));
    let mantissa = 1.0 + r + r * r * (0.5 + r * high);
    // k is 0 to 126, and a NaN's k is 0.
    mantissa * f32::from_bits((127_i32.wrapping_sub(k) as u32) << 23)
}

/// Sine and cosine of an angle in radians: error at most 1e-7 for |angle| <= 100, growing with the angle beyond.
pub fn sin_cos(angle_rad: f32) -> (f32, f32) {
    // Cody and Waite: pi/2 in three parts, so that the subtraction does not round.
    let turns = angle_rad * FRAC_2_PI;
    let quadrant = (turns + if turns < 0.0 { -0.5 } else { 0.5 }) as i32;
    let k = quadrant as f32;
    let rest = ((angle_rad - k * 1.570_312_5) - k * 4.837_513e-4) - k * 7.549_79e-8;
    let (s, c) = sin_cos_eighth(rest);
    match quadrant & 3 {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    }
}

/// Sine and cosine of |angle| <= pi/4, radians: error at most 1e-7 (minimax coefficients of Cephes' sinf and cosf).
pub fn sin_cos_eighth(angle_rad: f32) -> (f32, f32) {
    let z = angle_rad * angle_rad;
    let s = angle_rad + angle_rad * z * (-1.666_665_5e-1 + z * (8.332_161e-3 + z * -1.951_529_6e-4));
    let c = 1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    (s, c)
}

/// Sine and cosine to 1.2e-3 for |angle| <= pi, by micromath: for the gesture's hand angles only, whose sensor is
/// worse than that, and never for a path or a score.
pub fn sin_cos_coarse(angle_rad: f32) -> (f32, f32) {
    use micromath::F32Ext;
    (F32Ext::sin(angle_rad), F32Ext::cos(angle_rad))
}

/// Euclidean length.
pub fn norm(v: &Vector) -> f32 {
    sqrt(v.dot(v))
}

/// The unit vector along `v`; none if `v` is not longer than `least` or is not finite.
pub fn direction(v: &Vector, least: f32) -> Option<Direction> {
    let length = norm(v);
    (length > least && length.is_finite()).then(|| Direction::new_unchecked(v / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest differences of sine and cosine from f64 over `steps` angles in [-limit, limit].
    fn worst(sin_cos: fn(f32) -> (f32, f32), limit: f32, steps: i32) -> f64 {
        (-steps..=steps)
            .map(|i| {
                let x = limit * i as f32 / steps as f32;
                let (s, c) = sin_cos(x);
                let (es, ec) = f64::from(x).sin_cos();
                (f64::from(s) - es).abs().max((f64::from(c) - ec).abs())
            })
            .fold(0.0, f64::max)
    }

    extern crate std;

    #[test]
    fn the_sine_polynomial_is_within_1e_7_of_double_precision() {
        assert!(worst(sin_cos_eighth, core::f32::consts::FRAC_PI_4, 1_000_000) <= 1e-7);
        assert!(worst(sin_cos, 7.0, 1_000_000) <= 1e-7);
        assert!(worst(sin_cos, 100.0, 1_000_000) <= 1e-7);
    }

    #[test]
    fn micromath_is_within_its_stated_bound_and_not_much_better() {
        let error = worst(sin_cos_coarse, core::f32::consts::PI, 1_000_000);
        assert!((1e-4..=1.2e-3).contains(&error), "{error}");
    }

    #[test]
    fn extreme_angles_do_not_panic() {
        for x in [f32::MAX, f32::MIN, f32::INFINITY, f32::NAN, f32::MIN_POSITIVE] {
            let _ = (sin_cos(x), sin_cos_coarse(x));
        }
        assert_eq!([0.0, 1e30, f32::INFINITY].map(exp_of_negative), [1.0, 0.0, 0.0]);
        assert!(exp_of_negative(f32::NAN).is_nan());
        let _ = [-1.0, f32::MIN, f32::NEG_INFINITY].map(exp_of_negative);
    }

    #[test]
    fn roots_and_inverse_functions_agree_with_double_precision() {
        for i in 0..=200_000 {
            let x = i as f32 / 200_000.0;
            let wide = f64::from(x);
            assert_eq!(sqrt(x * 50.0), (x * 50.0).sqrt(), "correctly rounded, so equal to any other that is");
            assert!((f64::from(acos(x * 2.0 - 1.0)) - f64::from(x * 2.0 - 1.0).acos()).abs() < 3e-7);
            assert!((f64::from(atan2(x, 0.5)) - wide.atan2(0.5)).abs() < 3e-7);
            let power = 87.0 * x;
            let expected = (-f64::from(power)).exp();
            assert!((f64::from(exp_of_negative(power)) / expected - 1.0).abs() < 2e-7, "{power}");
        }
    }

    #[test]
    fn a_vector_without_length_has_no_direction() {
        assert!(direction(&Vector::zeros(), 1e-6).is_none());
        assert!(direction(&Vector::repeat(f32::MAX), 1e-6).is_none());
        assert!(direction(&Vector::repeat(f32::NAN), 1e-6).is_none());
        let d = direction(&Vector::new(0.0, 3.0, 4.0), 1e-6).unwrap();
        assert_eq!(d.into_inner(), Vector::new(0.0, 0.6, 0.8));
    }
}
