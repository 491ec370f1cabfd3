//! How far the surfaces of two views differ beyond the noise of their patches (ours).
//!
//! A camera's error is alike over a stretch of its picture: a matcher's waves, steps of depth, a bent lens. Patches beside each other
//! err together, and a thousand of them tell no more than a few. How many they are worth is told by the pairs themselves: the mean of
//! those within some millimetres of one face should vary as the sum of their weights says. Where it varies more, the weights
//! promise too much, and the reported poses would give way to waves.

use super::system::PatchPair;
use crate::geometry::statistics::{MEDIAN_OF_SQUARE, median};
use std::collections::HashMap;

/// Edges of the places over which pairs are averaged, mm: up to the longest wave that a part shows several of.
const EDGES_MM: [f32; 3] = [10.0, 20.0, 40.0];
/// Pairs of a place, and places, below which nothing is told.
const LEAST_PAIRS: usize = 4;
const LEAST_PLACES: usize = 20;
/// Every pair of patches is found from both sides, and both are taken as information.
const SIDES: f64 = 2.0;

/// The variance of the means of pairs over that which their weights promise; at least 1.
pub(super) fn excess<'a>(ties: impl Iterator<Item = &'a [PatchPair]> + Clone) -> f64 {
    let over = |edge_mm: f32| {
        let mut squares: Vec<f32> = ties.clone().flat_map(|pairs| squares(pairs, edge_mm)).collect();
        let enough = squares.len() >= LEAST_PLACES;
        enough.then(|| SIDES * f64::from(median(&mut squares)) / MEDIAN_OF_SQUARE)
    };
    EDGES_MM.into_iter().filter_map(over).fold(1.0, f64::max)
}

/// Of each place, the squared mean residual in multiples of its promised variance.
fn squares(pairs: &[PatchPair], edge_mm: f32) -> Vec<f32> {
    // Which face, by its normal to about 30 degrees, and where on it.
    let place = |pair: &PatchPair| {
        let cell = (pair.arm / edge_mm).map(|x| x.floor() as i32);
        let face = (pair.normal * 2.0).map(|x| x.round() as i32);
        (<[i32; 3]>::from(cell), <[i32; 3]>::from(face))
    };
    let mut sums: HashMap<_, (usize, f32, f32)> = HashMap::new();
    for pair in pairs {
        let (count, weight, sum) = sums.entry(place(pair)).or_default();
        (*count, *weight, *sum) = (*count + 1, *weight + pair.weight, *sum + pair.weight * pair.residual_mm);
    }
    let told = sums.into_values().filter(|(count, ..)| *count >= LEAST_PAIRS);
    told.map(|(_, weight, sum)| sum * sum / weight.max(1e-12)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    /// Pairs 2 mm apart on a face of 200 mm whose height has unit noise and waves, with weights that know of the noise alone.
    fn pairs(wave_mm: f32) -> Vec<PatchPair> {
        let noise = |k: u32| {
            let unit = |k: u32| f64::from(k.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24);
            ((0..12).map(|j| unit(12 * k + j + 1)).sum::<f64>() - 6.0) as f32
        };
        let pair = |k: u32| {
            let (x, y) = ((k % 100) as f32 * 2.0, (k / 100) as f32 * 2.0);
            let wave = (x * 0.2).sin() * (y * 0.17).cos() * 2.0;
            PatchPair {
                arm: Vector3::new(x, y, 0.5),
                normal: Vector3::z(),
                residual_mm: noise(k) + wave_mm * wave,
                own_normal: Vector3::z(),
                own_residual_mm: 0.0,
                // Both sides of a pair promise half of its information.
                weight: 0.5,
            }
        };
        (0..10_000).map(pair).collect()
    }

    #[test]
    fn noise_is_worth_what_it_promises_and_waves_are_worth_less() {
        let plain = excess([pairs(0.0).as_slice()].into_iter());
        assert!(plain < 1.5, "{plain}");
        let waved = excess([pairs(1.0).as_slice()].into_iter());
        // A mean of 25 pairs varies by 1/25 and the wave, whose variance is 1 and of which 10 mm leave some six tenths.
        assert!((12.0..26.0).contains(&waved), "{waved}");
        assert_eq!(excess([&pairs(1.0)[..40]].into_iter()), 1.0, "too few to tell");
    }
}
