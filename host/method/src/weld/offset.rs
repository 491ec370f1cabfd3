//! Passes of a multi-pass weld (ours): the seam's line moved in the plane of its section.

use super::SeamPath;

/// Moves every point by `across_mm` to the right of the travel and by `out_mm` out of the work along the bisector of
/// the faces. The torch keeps its orientation; `s_mm` stays that of the seam.
pub fn offset(mut path: SeamPath, across_mm: f64, out_mm: f64) -> SeamPath {
    for point in &mut path.points {
        point.position_mm += point.right_of_travel() * across_mm + point.out_of_work() * out_mm;
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::{PathPoint, Process};
    use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
    use std::f64::consts::{FRAC_PI_4, TAU};

    /// A pipe of 20 mm radius on a plate, counter-clockwise, torch at 45 degrees.
    fn pipe() -> SeamPath {
        let at = |i: u32| {
            let angle = TAU * f64::from(i) / 90.0;
            let radial = Vector3::new(angle.cos(), angle.sin(), 0.0);
            let m = Vector3::new(-angle.sin(), angle.cos(), 0.0);
            let n = radial * FRAC_PI_4.cos() + Vector3::z() * FRAC_PI_4.sin();
            let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[m.cross(&n), m, n]));
            let base_from_torch = UnitQuaternion::from_rotation_matrix(&axes);
            let position_mm = Point3::from(radial * 20.0);
            PathPoint { s_mm: 20.0 * angle, position_mm, base_from_torch, process: Process::default() }
        };
        SeamPath { seam: 1, points: (0..=90).map(at).collect() }
    }

    #[test]
    fn a_pass_lies_on_the_circle_that_its_offsets_say() {
        // Right of a counter-clockwise travel is outward, and here down by as much.
        let half = 0.5f64.sqrt();
        for (across, out) in [(3.0, 0.0), (0.0, 3.0), (-2.0, 5.0)] {
            for point in offset(pipe(), across, out).points {
                let radius = point.position_mm.x.hypot(point.position_mm.y);
                assert!((radius - 20.0 - half * (across + out)).abs() < 1e-9);
                assert!((point.position_mm.z - half * (out - across)).abs() < 1e-9);
            }
        }
    }
}
