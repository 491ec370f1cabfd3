//! Eight numbers at once: what `wide` lacks for the kernels over neighbourhoods.

use wide::f32x8;

/// Numbers that are worked on at once.
pub(crate) const LANES: usize = 8;

/// Eight numbers of a column from `first` on; zeros where it has fewer.
#[inline(always)]
pub fn eight(column: &[f32], first: usize) -> f32x8 {
    column[first..].first_chunk::<LANES>().map_or(f32x8::ZERO, |eight| f32x8::new(*eight))
}

/// `e^x` for `x <= 0`, to 2e-7 of itself; 1.6e-38 below -87.
///
/// Cephes' `expf`: reduction by ln 2 in two parts, degree 6. The one of `wide` also minds infinities, at twice the cost.
#[inline(always)]
pub fn exp(x: f32x8) -> f32x8 {
    /// Adding this rounds to a whole number, which then stands in the low bits.
    const ROUND: f32 = 12_582_912.0;
    const LN2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    let x = x.fast_max(f32x8::splat(-87.0));
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let f = (x - n * LN2[0]) - n * LN2[1];
    let mut p = f32x8::splat(1.987_569_2e-4);
    for c in [1.398_2e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5] {
        p = p * f + c;
    }
    let power: wide::i32x8 = bytemuck::cast(p * (f * f) + f + 1.0);
    let shifted: wide::i32x8 = bytemuck::cast(shifted);
    bytemuck::cast(power + (shifted << 23))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_that_of_double_precision() {
        for k in 0..80_000 {
            let x = -1e-3 * k as f32;
            let truth = f64::from(x).exp();
            let error = (f64::from(exp(f32x8::splat(x)).to_array()[k % LANES]) - truth) / truth;
            assert!(error.abs() < 2e-7, "{x}: {error:e}");
        }
        assert!(exp(f32x8::splat(-1e30)).to_array()[0] < 2e-38);
    }
}
