//! The linear system of point-to-plane registration (paper II-C): its row, for all who register or carry pose errors on.

use nalgebra::{Vector3, Vector6};

/// One row of `A`, eq. (7), by the small angles of eq. (4) in the motion of eq. (5): rotation part, then translation.
///
/// The distance that a point moves along `normal` is the row times the motion, a rotation vector in rad and a shift in mm
/// about a centre from which the point is at `arm_mm`.
pub fn row(arm_mm: &Vector3<f64>, normal: &Vector3<f64>) -> Vector6<f64> {
    let turn = arm_mm.cross(normal);
    Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z)
}

/// The same with rotations as lengths at `size_mm` from the centre, so that all six motions compare.
pub fn row_at_size(arm_mm: &Vector3<f64>, normal: &Vector3<f64>, size_mm: f64) -> Vector6<f64> {
    let mut row = row(arm_mm, normal);
    row.fixed_rows_mut::<3>(0).apply(|turn| *turn /= size_mm);
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Point3};

    #[test]
    fn a_row_times_a_small_motion_is_what_the_point_moves_along_the_normal() {
        let (arm, normal) = (Vector3::new(30.0, -20.0, 50.0), Vector3::new(0.36, 0.48, 0.8));
        let (shift, turn) = (Vector3::new(0.02, -0.01, 0.03), Vector3::new(1e-5, -2e-5, 3e-5));
        let motion = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        let moved = Isometry3::new(shift, turn) * Point3::from(arm) - Point3::from(arm);
        assert!((row(&arm, &normal).dot(&motion) - moved.dot(&normal)).abs() < 1e-7);
        let sized = row_at_size(&arm, &normal, 40.0);
        assert!((40.0 * sized[0] - row(&arm, &normal)[0]).abs() < 1e-12);
    }
}
