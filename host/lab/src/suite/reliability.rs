//! How far a stated confidence can be trusted: of seams stated so sure, how many are right.

use serde::Serialize;

/// A seam is right if its error is at most so many times the stated one.
const STATED_TIMES: f64 = 2.0;
/// And if at most this share of it lies on no weld.
const FALSE_SHARE: f64 = 0.5;
/// Least confidences of the rows, the highest first.
const LEAST: [f64; 5] = [0.9, 0.8, 0.6, 0.4, 0.0];

/// A seam of a plan against the truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StatedSeam {
    /// As stated.
    pub confidence: f64,
    /// Its stated error, mm.
    pub stated_mm: f64,
    /// Root mean square distance across the weld, mm; none where no point is near one.
    pub error_mm: Option<f64>,
    /// Whether most of it lies on a weld.
    pub on_weld: bool,
}

impl StatedSeam {
    /// From what is stated of a seam, the share of its path that lies on no weld, and the error of the rest.
    pub fn new(confidence: f64, stated_mm: f64, false_share: f64, error_mm: Option<f64>) -> Self {
        Self { confidence, stated_mm, error_mm, on_weld: false_share <= FALSE_SHARE }
    }

    /// Whether it is a weldable seam within its stated error.
    pub fn is_right(&self) -> bool {
        self.on_weld && self.error_mm.is_some_and(|mm| mm <= STATED_TIMES * self.stated_mm)
    }
}

/// Seams whose confidence lies in a range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reliability {
    /// The range begins here and ends at that of the row before, or at 1.
    pub least_confidence: f64,
    /// How many there are.
    pub seams: usize,
    /// How many of them lie on a weld.
    pub on_weld: usize,
    /// How many of those are no farther off than twice their stated error.
    pub right: usize,
    /// Mean of their confidences.
    pub mean_confidence: f64,
}

/// Rows by confidence, the surest first; ranges without a seam are left out.
pub fn reliability(scores: &[StatedSeam]) -> Vec<Reliability> {
    let row = |least: usize| {
        let below = if least == 0 { f64::INFINITY } else { LEAST[least - 1] };
        let within: Vec<&StatedSeam> =
            scores.iter().filter(|score| (LEAST[least]..below).contains(&score.confidence)).collect();
        let count = |is: fn(&StatedSeam) -> bool| within.iter().filter(|score| is(score)).count();
        Reliability {
            least_confidence: LEAST[least],
            seams: within.len(),
            on_weld: count(|score| score.on_weld),
            right: count(StatedSeam::is_right),
            mean_confidence: within.iter().map(|score| score.confidence).sum::<f64>() / within.len() as f64,
        }
    };
    (0..LEAST.len()).map(row).filter(|row| row.seams > 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(confidence: f64, false_share: f64, across_mm: f64) -> StatedSeam {
        StatedSeam::new(confidence, 0.1, false_share, Some(across_mm))
    }

    #[test]
    fn a_seam_is_right_on_a_weld_within_twice_what_is_stated() {
        assert!(score(1.0, 0.0, 0.2).is_right());
        assert!(!score(1.0, 0.0, 0.21).is_right());
        assert!(!score(1.0, 0.6, 0.1).is_right());
        assert!(!StatedSeam::new(1.0, 0.1, 0.0, None).is_right());
    }

    #[test]
    fn rows_count_seams_by_what_is_stated_of_them() {
        let scores =
            [score(1.0, 0.0, 0.1), score(0.9, 0.9, 0.1), score(0.89, 0.0, 0.3), score(0.1, 0.0, 0.1)];
        let rows = reliability(&scores);
        let counts: Vec<_> =
            rows.iter().map(|row| (row.least_confidence, row.seams, row.on_weld, row.right)).collect();
        assert_eq!(counts, [(0.9, 2, 1, 1), (0.8, 1, 1, 0), (0.0, 1, 1, 1)]);
        assert!((rows[0].mean_confidence - 0.95).abs() < 1e-12);
        assert!(reliability(&[]).is_empty());
    }
}
