//! Statistics of plain numbers: median, deviation from it, quartile, percentile, root mean square.

use nalgebra::RealField;

/// Standard deviation of normal noise over the median of its absolute values: `1 / Φ⁻¹(3/4)`. The median does not mind
/// outliers, so that this times it is a deviation that up to half of the values may spoil.
pub(crate) const DEVIATION_OF_MEDIAN: f64 = 1.4826;

/// The median of a squared normal number of unit variance.
pub(crate) const MEDIAN_OF_SQUARE: f64 = 0.455;

/// The middle value, of an even number the upper one; 0 of none. Reorders its argument.
pub fn median<T: PartialOrd + Copy + Default>(values: &mut [T]) -> T {
    ranked(values, values.len() / 2)
}

/// The value that a quarter of the values lie below; 0 of none. Reorders its argument.
pub(crate) fn lower_quartile<T: PartialOrd + Copy + Default>(values: &mut [T]) -> T {
    ranked(values, values.len() / 4)
}

/// The value with so many below it.
fn ranked<T: PartialOrd + Copy + Default>(values: &mut [T], rank: usize) -> T {
    if values.is_empty() {
        return T::default();
    }
    *values.select_nth_unstable_by(rank, |a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal)).1
}

/// Standard deviation of normal noise with outliers, from the absolute deviations; 0 of none. Reorders its argument.
pub(crate) fn robust_deviation<T: RealField + Copy + Default>(absolute: &mut [T]) -> T {
    nalgebra::convert::<f64, T>(DEVIATION_OF_MEDIAN) * median(absolute)
}

/// Root mean square; none of nothing.
pub fn rms(values: &[f64]) -> Option<f64> {
    let sum: f64 = values.iter().map(|v| v * v).sum();
    (!values.is_empty()).then(|| (sum / values.len() as f64).sqrt())
}

/// Percentile with linear interpolation between neighbours; none of nothing.
pub fn percentile(values: &[f64], percent: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let place = last as f64 * percent / 100.0;
    let (below, above) = (place.floor() as usize, (place.ceil() as usize).min(last));
    Some(sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_percentile_lies_between_its_neighbours() {
        assert_eq!(percentile(&[4.0, 1.0, 3.0, 2.0], 50.0), Some(2.5));
        assert_eq!(percentile(&[4.0, 1.0, 3.0, 2.0], 100.0), Some(4.0));
        assert_eq!(percentile(&[7.0], 95.0), Some(7.0));
        assert_eq!(percentile(&[], 95.0), None);
    }

    #[test]
    fn the_median_of_an_even_number_is_the_upper_and_of_none_zero() {
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), 3.0);
        assert_eq!(lower_quartile(&mut [4, 1, 3, 2]), 2);
        assert_eq!(median::<f32>(&mut []), 0.0);
    }

    #[test]
    fn a_tenth_of_outliers_hardly_moves_the_deviation() {
        // Absolute values of a normal variable at even quantiles, from Φ⁻¹ by bisection of an erf series.
        let below = |x: f64| {
            let term = |k: i32| {
                let factorial: f64 = (1..=k).map(f64::from).product();
                (-0.5f64).powi(k) * x.powi(2 * k + 1) / (factorial * f64::from(2 * k + 1))
            };
            2.0 * (0..60).map(term).sum::<f64>() / (std::f64::consts::TAU).sqrt()
        };
        let quantile = |share: f64| {
            let (mut low, mut high) = (0.0, 4.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if below(middle) < share { low = middle } else { high = middle }
            }
            low
        };
        let mut clean: Vec<f64> = (0..999).map(|k| quantile((f64::from(k) + 0.5) / 999.0)).collect();
        assert!((robust_deviation(&mut clean) - 1.0).abs() < 1e-3);
        clean.extend([50.0; 99]);
        assert!((robust_deviation(&mut clean) - 1.0).abs() < 0.15);
        assert_eq!(
            nalgebra::convert::<f64, f32>(DEVIATION_OF_MEDIAN),
            1.4826_f32,
            "single precision as written"
        );
    }
}
