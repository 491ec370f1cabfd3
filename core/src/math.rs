//! The scalar functions of core; the only file that names libm or micromath.
//!
//! Host and microcontroller call these and no others, so both compute the same bits.

/// Square root, correctly rounded.
pub fn sqrt(x: f32) -> f32 {
    libm::sqrtf(x)
}

/// `e` to the power `x`.
pub fn exp(x: f32) -> f32 {
    libm::expf(x)
}

/// Magnitude.
pub fn abs(x: f32) -> f32 {
    f32::abs(x)
}

/// Euclidean length.
pub fn norm(v: &crate::Vector) -> f32 {
    sqrt(v.norm_squared())
}
