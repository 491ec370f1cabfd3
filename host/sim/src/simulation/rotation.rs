//! Sine, cosine and rotation vectors in plain arithmetic, so that a seed gives the same bytes on every machine
//! (the platform's `sin` may differ in the last bit).

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Sine and cosine of an angle of at most a few turns, by Taylor series on an eighth of a turn; error below 1e-15.
pub(super) fn sin_cos(angle_rad: f64) -> (f64, f64) {
    let quarter = (angle_rad / FRAC_PI_2).round();
    let x = angle_rad - quarter * FRAC_PI_2;
    let (mut sin, mut cos, mut term) = (0.0, 0.0, 1.0);
    for k in 0..20 {
        let sign = if k % 4 < 2 { 1.0 } else { -1.0 };
        if k % 2 == 0 {
            cos += sign * term
        } else {
            sin += sign * term
        }
        term *= x / f64::from(k + 1);
    }
    match (quarter as i64).rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Sine and cosine of degrees.
pub(super) fn sin_cos_deg(angle_deg: f64) -> (f64, f64) {
    sin_cos(angle_deg * (PI / 180.0))
}

/// Rotation by `angle_deg` about the unit vector `axis`.
pub(super) fn about(axis: Vector3<f64>, angle_deg: f64) -> UnitQuaternion<f64> {
    let (sin, cos) = sin_cos_deg(0.5 * angle_deg);
    UnitQuaternion::new_normalize(nalgebra::Quaternion::from_parts(cos, axis * sin))
}

/// Rotation whose columns are `x`, `y`, `z`, orthonormal and right-handed.
pub(super) fn from_columns(x: Vector3<f64>, y: Vector3<f64>, z: Vector3<f64>) -> UnitQuaternion<f64> {
    let matrix = Matrix3::from_columns(&[x, y, z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
}

/// A pose as a UR controller reports it: position, rotation vector; here in millimetres and radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UrPose {
    /// Translation, mm.
    pub position_mm: Vector3<f64>,
    /// Axis times angle, rad, at most π long.
    pub rotation_rad: Vector3<f64>,
}

impl UrPose {
    /// The pose, rounded to nanometres and nanoradians: what the robot reports.
    pub(super) fn reported(pose: &Isometry3<f64>) -> Self {
        let q = pose.rotation.quaternion();
        let q = if q.w < 0.0 { -*q } else { *q };
        let half_sin = q.imag().norm();
        // atan2 may differ in the last bit between machines; the rounding below takes that away.
        let angle_rad = 2.0 * half_sin.atan2(q.w);
        let scale = if half_sin > 1e-12 { angle_rad / half_sin } else { 2.0 };
        Self {
            position_mm: pose.translation.vector.map(|x| round_to(x, 1e-6)),
            rotation_rad: (q.imag() * scale).map(|x| round_to(x, 1e-9)),
        }
    }

    /// The rigid motion that this pose states.
    pub fn isometry(&self) -> Isometry3<f64> {
        let angle_rad = self.rotation_rad.norm();
        let (sin, cos) = sin_cos(0.5 * angle_rad);
        let scale = if angle_rad > 1e-12 { sin / angle_rad } else { 0.5 };
        let q = nalgebra::Quaternion::from_parts(cos, self.rotation_rad * scale);
        Isometry3::from_parts(Translation3::from(self.position_mm), UnitQuaternion::new_normalize(q))
    }
}

/// `x` to the nearest multiple of `step`, so that its decimal form is short.
pub(super) fn round_to(x: f64, step: f64) -> f64 {
    let per_unit = (1.0 / step).round();
    (x * per_unit).round() / per_unit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_agree_with_the_platform() {
        for i in -4000..4000 {
            let x = f64::from(i) * 0.0025;
            let (sin, cos) = sin_cos(x);
            assert!((sin - x.sin()).abs() < 2e-15 && (cos - x.cos()).abs() < 2e-15, "{x}");
        }
    }

    #[test]
    fn a_reported_pose_states_the_motion_it_came_from() {
        for i in 0..50 {
            let axis = Vector3::new(0.3, f64::from(i) * 0.1 - 2.0, 0.7).normalize();
            let pose =
                Isometry3::from_parts(Translation3::new(123.4, -5.0, 900.0), about(axis, f64::from(i) * 7.0));
            let back = UrPose::reported(&pose).isometry();
            assert!((back.translation.vector - pose.translation.vector).norm() < 1e-5);
            assert!(back.rotation.angle_to(&pose.rotation) < 1e-8);
        }
    }
}
