//! Histograms for the page: equal bins, with marks such as a threshold.

use serde::{Deserialize, Serialize};

/// Counts of values between two bounds; what lies beyond is counted in the outermost bins.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Histogram {
    low: f64,
    high: f64,
    counts: Vec<u32>,
    median: Option<f64>,
}

/// Bins of every histogram.
const BINS: usize = 60;

impl Histogram {
    /// Of finite `values` between `low` and `high`.
    pub(super) fn between(low: f64, high: f64, values: impl Iterator<Item = f32>) -> Self {
        let mut values: Vec<f32> = values.filter(|v| v.is_finite()).collect();
        let mut counts = vec![0; BINS];
        for v in &values {
            // Below the first bin the conversion saturates at 0.
            let bin = ((f64::from(*v) - low) / (high - low) * BINS as f64) as usize;
            counts[bin.min(BINS - 1)] += 1;
        }
        let middle = values.len() / 2;
        let median =
            (!values.is_empty()).then(|| f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1));
        Self { low, high, counts, median }
    }

    /// From 0 to a little beyond the 98th percentile.
    pub(super) fn of_lengths(mut lengths: Vec<f32>) -> Self {
        lengths.retain(|v| v.is_finite());
        if lengths.is_empty() {
            return Self::default();
        }
        let near_last = (lengths.len() - 1) * 98 / 100;
        let high = 1.25 * f64::from(*lengths.select_nth_unstable_by(near_last, f32::total_cmp).1);
        Self::between(0.0, high.max(1e-6), lengths.into_iter())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_counted_once_and_the_median_is_in_the_middle() {
        let values = [-5.0, 0.1, 0.2, 0.3, 99.0, f32::NAN];
        let h = Histogram::between(0.0, 1.0, values.into_iter());
        assert_eq!(h.counts.iter().sum::<u32>(), 5);
        assert_eq!((h.counts[0], h.counts[BINS - 1]), (1, 1));
        assert!((h.median.unwrap() - 0.2).abs() < 1e-6);
    }

    #[test]
    fn lengths_without_values_make_an_empty_histogram() {
        assert!(Histogram::of_lengths(vec![f32::INFINITY]).counts.is_empty());
        assert!(Histogram::of_lengths(vec![0.0; 3]).high > 0.0);
    }
}
