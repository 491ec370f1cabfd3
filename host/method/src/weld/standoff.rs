//! Stand-off (paper II-F, text before eq. (18)): the tip is held `d` off the seam along the torch axis, `p + d n`.

use super::SeamPath;

/// Moves every point out of the work along its own `n` by `standoff_mm`; negative moves into the work.
pub fn standoff(mut path: SeamPath, standoff_mm: f64) -> SeamPath {
    for point in &mut path.points {
        point.position_mm += point.out_of_work() * standoff_mm;
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::{PathPoint, Process};
    use nalgebra::{Point3, UnitQuaternion, Vector3};

    #[test]
    fn standoff_moves_the_tip_out_of_the_work_and_back() {
        let tilt = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        let position_mm = Point3::new(1.0, 2.0, 3.0);
        let process = Process::default();
        let point = PathPoint { s_mm: 3.0, position_mm, base_from_torch: tilt, process };
        let off = standoff(SeamPath { seam: 1, points: vec![point] }, 12.0);
        assert!((off.points[0].position_mm - Point3::new(13.0, 2.0, 3.0)).norm() < 1e-12);
        assert_eq!(off.points[0].s_mm, 3.0);
        let back = standoff(off, -12.0);
        assert!((back.points[0].position_mm - point.position_mm).norm() < 1e-12);
    }
}
