//! Point-to-plane ICP of patches onto the new cloud.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use super::part::Patch;
use super::target::Target;
use weldpath_method::geometry::point_to_plane::row_at_size;

/// Most steps at one largest distance of a pair.
const ITERATIONS: usize = 8;

/// A turn about `centre`, then a shift.
pub(super) fn about(
    centre: &Point3<f64>,
    turn_rad: &Vector3<f64>,
    shift_mm: &Vector3<f64>,
) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(*turn_rad);
    let shift = centre.coords - turn * centre.coords + shift_mm;
    Isometry3::from_parts(Translation3::from(shift), turn)
}

/// Point-to-plane ICP from `start`.
pub(super) fn align(
    part: &[Patch],
    target: &Target,
    start: &Isometry3<f64>,
    centre: &Point3<f64>,
    gates_mm: &[f32],
) -> Isometry3<f64> {
    let size_mm = size_mm(part, centre);
    let mut pose = *start;
    for &gate_mm in gates_mm {
        for _ in 0..ITERATIONS {
            let middle = pose * centre;
            let Some((step, _)) = step(part, target, &pose, &middle, size_mm, gate_mm, None) else { break };
            let turn = step.fixed_rows::<3>(0) / size_mm;
            pose = about(&middle, &turn, &step.fixed_rows::<3>(3).into_owned()) * pose;
            if step.norm() < 1e-3 {
                break;
            }
        }
    }
    pose
}

/// Root mean square distance from the middle of the part: turns rotations into lengths.
pub(super) fn size_mm(part: &[Patch], centre: &Point3<f64>) -> f64 {
    let spread =
        part.iter().map(|(p, _)| (p - centre).norm_squared()).sum::<f64>() / part.len().max(1) as f64;
    spread.sqrt().max(1e-3)
}

/// One linear step but not along `held`, rotations in mm at the size of the part, and what the pairs see of each motion: 1 is seen in full.
pub(super) fn step(
    part: &[Patch],
    target: &Target,
    pose: &Isometry3<f64>,
    middle: &Point3<f64>,
    size_mm: f64,
    gate_mm: f32,
    held: Option<&Vector6<f64>>,
) -> Option<(Vector6<f64>, Matrix6<f64>)> {
    let (mut a, mut b, mut weight) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    // A third of the gate is what Geman-McClure still believes.
    let scale_mm = f64::from(gate_mm) / 3.0;
    for (p, n) in part {
        let place = pose * p;
        let Some((q, normal)) = target.nearest(&place, &(pose.rotation * n), gate_mm) else { continue };
        let residual = normal.dot(&(place - q));
        let w = (1.0 + (residual / scale_mm).powi(2)).powi(-2);
        let row = row_at_size(&(place - middle), &normal, size_mm);
        a.ger(w, &row, &row, 1.0);
        b.axpy(-w * residual, &row, 1.0);
        weight += w;
    }
    if weight < 6.0 {
        return None;
    }
    let information = a / weight;
    // What is not seen is not moved.
    let stiff = held.map_or(Matrix6::zeros(), |axis| axis * axis.transpose() * 1e3);
    let damped = information + Matrix6::identity() * 1e-4 + stiff;
    damped.cholesky().map(|factor| (factor.solve(&(b / weight)), information))
}
