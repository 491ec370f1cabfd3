//! The scalar functions of core; the only file that names libm or micromath.
//!
//! Host and microcontroller call these and no others, so both compute the same bits.

/// Square root, correctly rounded.
pub fn sqrt(x: f32) -> f32 {
    libm::sqrtf(x)
}
