//! The paper's own measure of a path, read literally.

use super::truth::{Target, TruthSeam};
use nalgebra::Vector3;

/// Points to which both paths are resampled.
const SAMPLES: usize = 300;

/// RMSE of `m_i - g_i`, eq. (22), mm: path and seam resampled to 300 points by arc length and paired by index, in
/// the better direction, for closed seams also from the best start. The paper does not say how its paths come to equal
/// numbers of points. None for a path without points.
pub fn paper_rmse(path_mm: &[Vector3<f64>], seam: &TruthSeam, target: Target) -> Option<f64> {
    let mut line: Vec<Vector3<f64>> = seam.line(target).iter().map(|p| Vector3::from(*p)).collect();
    if seam.closed {
        line.extend(line.first().copied());
    }
    let (path, truth) = (resampled(path_mm)?, resampled(&line)?);
    let reversed: Vec<Vector3<f64>> = truth.iter().rev().copied().collect();
    let starts = if seam.closed { SAMPLES } else { 1 };
    let mut best = f64::INFINITY;
    for other in [&truth, &reversed] {
        for start in (0..starts).step_by(3) {
            let other = other.iter().cycle().skip((SAMPLES - start) % SAMPLES);
            let sum: f64 = path.iter().zip(other).map(|(a, b)| (a - b).norm_squared()).sum();
            best = best.min((sum / SAMPLES as f64).sqrt());
        }
    }
    Some(best)
}

/// `SAMPLES` points at equal steps of arc length.
fn resampled(line: &[Vector3<f64>]) -> Option<Vec<Vector3<f64>>> {
    let last = *line.last()?;
    let mut lengths = vec![0.0];
    for pair in line.windows(2) {
        lengths.push(lengths[lengths.len() - 1] + (pair[1] - pair[0]).norm());
    }
    let total = lengths[lengths.len() - 1];
    let at = |k: usize| {
        let s = total * k as f64 / (SAMPLES - 1) as f64;
        let after = lengths.partition_point(|l| *l <= s);
        match (line.get(after), after.checked_sub(1)) {
            (Some(next), Some(i)) => {
                line[i] + (next - line[i]) * ((s - lengths[i]) / (lengths[after] - lengths[i]))
            }
            _ => last,
        }
    };
    Some((0..SAMPLES).map(at).collect())
}
