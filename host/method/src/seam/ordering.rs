//! What only all seams together tell (ours): which are branches, and in which order they are welded.

use super::{Joint, Seam};
use nalgebra::Point3;

/// Other seams that end where this one ends, from which on it is a branch.
const LEAST_OTHERS: usize = 2;

/// Open seams of which an end meets the ends of two others are branches.
pub(super) fn mark_branches(seams: &mut [Seam], near_mm: f64) {
    let ends: Vec<Vec<Point3<f64>>> = seams
        .iter()
        .map(|s| match (s.closed, s.stations.first(), s.stations.last()) {
            (false, Some(a), Some(b)) => vec![a.position_mm, b.position_mm],
            _ => Vec::new(),
        })
        .collect();
    let meets = |k: usize, end: &Point3<f64>| {
        let near = |other: &Vec<Point3<f64>>| other.iter().any(|e| (e - end).norm() < near_mm);
        (0..ends.len()).filter(|&j| j != k && near(&ends[j])).count()
    };
    for (k, mine) in ends.iter().enumerate() {
        if let Some(others) = mine.iter().map(|e| meets(k, e)).max().filter(|&n| n >= LEAST_OTHERS) {
            let was = std::mem::replace(&mut seams[k].joint, Joint::Branch);
            seams[k].reason =
                format!("{}; meets {others} others in a junction ({})", seams[k].reason, was.name());
        }
    }
}

/// Longest first, then always the seam that begins or ends nearest to where the torch is; numbers them.
pub(super) fn order(seams: &mut Vec<Seam>) {
    let mut left = std::mem::take(seams);
    left.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
    let mut torch: Option<Point3<f64>> = None;
    while !left.is_empty() {
        let ends = |s: &Seam| {
            let first = s.stations.first().map_or(Point3::origin(), |x| x.position_mm);
            let last = s.stations.last().map_or(first, |x| x.position_mm);
            (first, if s.closed { first } else { last })
        };
        let away = |s: &Seam| torch.map_or(0.0, |t| (ends(s).0 - t).norm().min((ends(s).1 - t).norm()));
        let next = (0..left.len()).min_by(|&a, &b| away(&left[a]).total_cmp(&away(&left[b]))).unwrap_or(0);
        let mut seam = left.remove(next);
        let (first, last) = ends(&seam);
        if torch.is_some_and(|t| (last - t).norm() < (first - t).norm()) {
            seam.stations.reverse();
            seam.stations.iter_mut().for_each(|s| s.tangent = -s.tangent);
        }
        torch = Some(ends(&seam).1);
        seam.id = seams.len() + 1;
        seams.push(seam);
    }
}
