//! The paper's own measures, read literally.

use super::truth::{Target, TruthSeam};
use nalgebra::Vector3;
use std::collections::HashMap;

/// Points to which both paths are resampled.
const SAMPLES: usize = 300;

/// The paper's RMSE of `m_i - g_i`, mm: path and seam resampled to 300 points by arc length and paired by index, in
/// the better direction, for closed seams also from the best start. None for a path without points.
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

/// The paper's fitness S: of the source points within `overlap_mm` of a target, the share nearer than `near_mm`.
/// None if nothing overlaps.
pub fn fitness(
    source_mm: &[Vector3<f64>],
    target_mm: &[Vector3<f64>],
    near_mm: f64,
    overlap_mm: f64,
) -> Option<f64> {
    // Clamped so that a neighbour's index cannot overflow, whatever the coordinates.
    let cell = |p: &Vector3<f64>| p.map(|x| (x / overlap_mm).floor().clamp(-1e15, 1e15) as i64);
    let mut grid: HashMap<Vector3<i64>, Vec<Vector3<f64>>> = HashMap::new();
    for point in target_mm {
        grid.entry(cell(point)).or_default().push(*point);
    }
    let nearest = |p: &Vector3<f64>| {
        let home = cell(p);
        let around = (0..27).map(|k| home + Vector3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
        let candidates = around.filter_map(|c| grid.get(&c)).flatten();
        candidates.map(|q| (q - p).norm()).fold(f64::INFINITY, f64::min)
    };
    let overlapping: Vec<f64> = source_mm.iter().map(nearest).filter(|d| *d < overlap_mm).collect();
    let near = overlapping.iter().filter(|d| **d < near_mm).count();
    (!overlapping.is_empty()).then(|| near as f64 / overlapping.len() as f64)
}
