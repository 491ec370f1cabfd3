//! The best rigid motion of a path onto the true seams: tells an error of shape from one of registration.

use super::path_set::PathSet;
use super::projection;
use super::truth::{Target, Truth};
use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};

/// A path set moved as one body: what remains of its error is one of shape.
#[derive(Debug, Clone)]
pub struct Aligned {
    /// The moved paths.
    pub paths: PathSet,
    /// How far their centroid moved, mm.
    pub moved_mm: f64,
    /// How far they turned, degrees.
    pub turned_deg: f64,
}

const ITERATIONS: usize = 10;
/// Points farther from every seam take no part, mm.
const NEAR_MM: f64 = 8.0;
/// Directions with a singular value below this share of the largest stay as they are.
const RELATIVE_CUTOFF: f64 = 1e-3;

/// Moves `paths` onto the seams of `truth`, by least squares of the lateral distances.
pub fn align(paths: &PathSet, truth: &Truth, target: Target) -> Aligned {
    let centre = mean(&paths.points_mm);
    let (mut points, mut turn) = (paths.points_mm.clone(), Rotation3::identity());
    for _ in 0..ITERATIONS {
        let Some(step) = increment(&points, &centre, truth, target) else { break };
        let small = Rotation3::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
        let shift = step.fixed_rows::<3>(3);
        points.iter_mut().for_each(|p| *p = small * (*p - centre) + centre + shift);
        turn = small * turn;
    }
    let moved_mm = (mean(&points) - centre).norm();
    let turned = |frame: &Matrix3<f64>| turn.matrix() * frame;
    let frames = paths.frames.as_ref().map(|frames| frames.iter().map(turned).collect());
    let paths = PathSet { points_mm: points, frames, seams: paths.seams.clone() };
    Aligned { paths, moved_mm, turned_deg: turn.angle().to_degrees() }
}

fn mean(points: &[Vector3<f64>]) -> Vector3<f64> {
    points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64
}

/// Rotation vector about `centre` and translation that take the lateral distances away; none without enough points.
fn increment(
    points: &[Vector3<f64>],
    centre: &Vector3<f64>,
    truth: &Truth,
    target: Target,
) -> Option<Vector6<f64>> {
    let lines: Vec<&[[f64; 3]]> = truth.seams.iter().map(|seam| seam.line(target)).collect();
    let mut members: Vec<Vec<&Vector3<f64>>> = vec![Vec::new(); lines.len()];
    for point in points {
        let distances = lines.iter().map(|line| projection::nearest_station(point, line).1);
        let nearest = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((k, _)) = nearest.filter(|(_, distance)| *distance < NEAR_MM) {
            members[k].push(point);
        }
    }
    let (mut normal, mut right, mut any) = (Matrix6::zeros(), Vector6::zeros(), false);
    for (k, on_seam) in members.iter().enumerate().filter(|(_, m)| m.len() >= 3) {
        for point in on_seam {
            let foot = projection::foot(&truth.seams[k], lines[k], point);
            for axis in [0, 2] {
                let across: Vector3<f64> = foot.frame.column(axis).into();
                let lever = (*point - centre).cross(&across);
                let row = Vector6::new(lever.x, lever.y, lever.z, across.x, across.y, across.z);
                normal += row * row.transpose();
                right += row * (foot.point - *point).dot(&across);
            }
            any = true;
        }
    }
    any.then(|| solved(normal, &right))
}

/// Least-norm solution of the normal equations, small directions left alone.
fn solved(normal: Matrix6<f64>, right: &Vector6<f64>) -> Vector6<f64> {
    let eigen = normal.symmetric_eigen();
    let floor = eigen.eigenvalues.max() * RELATIVE_CUTOFF * RELATIVE_CUTOFF;
    let direction = |i: usize| eigen.eigenvectors.column(i).into_owned();
    let kept = (0..6).filter(|&i| eigen.eigenvalues[i] > floor);
    kept.map(|i| direction(i) * (direction(i).dot(right) / eigen.eigenvalues[i])).sum()
}
