//! Torch angles (ours; the words are those of AWS A3.0 and ISO 857): work angle, travel angle, turn about the axis.
//!
//! The tip stays where it is and the torch turns about it. Zero is the torch of the paper: along the bisector of the
//! two faces, square to the travel. The work angle comes first, then the travel angle in the plane that the leaning
//! axis and the weld make, then the turn; so each is what one would measure at the torch.

use nalgebra::{UnitQuaternion, Vector3};

use super::SeamPath;

/// Leans the torch by `angle_rad` about the travel: positive to the right of it (toward o), negative to the left.
pub(crate) fn work_angle(path: SeamPath, angle_rad: f64) -> SeamPath {
    turned(path, Vector3::y() * angle_rad)
}

/// Leans the torch by `angle_rad` in the plane of its axis and the travel. Positive pushes (forehand): the torch leans
/// back and the wire points ahead, along the travel. Negative drags (backhand).
pub(crate) fn travel_angle(path: SeamPath, angle_rad: f64) -> SeamPath {
    turned(path, Vector3::x() * angle_rad)
}

/// Turns the torch by `angle_rad` about its own axis: positive is counter-clockwise for one who looks into the work.
/// The weld is the same; cables and wrist are not.
pub fn turn(path: SeamPath, angle_rad: f64) -> SeamPath {
    turned(path, Vector3::z() * angle_rad)
}

/// Every torch turned about an axis of its own frame.
fn turned(mut path: SeamPath, rotation_rad: Vector3<f64>) -> SeamPath {
    let turn = UnitQuaternion::from_scaled_axis(rotation_rad);
    for point in &mut path.points {
        point.base_from_torch *= turn;
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::{PathPoint, Process};
    use nalgebra::{Matrix3, Point3, Rotation3};

    /// Along +x on a level table: n is up, so right of the travel is -y.
    fn along_x() -> SeamPath {
        let axes = Matrix3::from_columns(&[-Vector3::y(), Vector3::x(), Vector3::z()]);
        let base_from_torch = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let at = |x| PathPoint {
            s_mm: x,
            position_mm: Point3::new(x, 0.0, 0.0),
            base_from_torch,
            process: Process::default(),
        };
        SeamPath { seam: 1, points: vec![at(0.0), at(10.0)] }
    }

    fn axis(path: &SeamPath) -> Vector3<f64> {
        path.points[1].out_of_work()
    }

    #[test]
    fn a_positive_work_angle_leans_the_torch_to_the_right_of_the_travel() {
        let leaning = work_angle(along_x(), 0.3);
        assert!((axis(&leaning) - Vector3::new(0.0, -0.3f64.sin(), 0.3f64.cos())).norm() < 1e-12);
        assert_eq!(leaning.points[1].position_mm, along_x().points[1].position_mm);
        assert!((leaning.points[1].along_travel() - Vector3::x()).norm() < 1e-12, "the travel is the same");
    }

    #[test]
    fn pushing_points_the_wire_ahead_and_dragging_behind() {
        for (angle, ahead) in [(0.2f64, 1.0), (-0.2, -1.0)] {
            let wire = -axis(&travel_angle(along_x(), angle));
            assert!((wire.x - ahead * 0.2f64.sin()).abs() < 1e-12, "the wire points out of the torch");
            assert!((wire.z + 0.2f64.cos()).abs() < 1e-12 && wire.y.abs() < 1e-12);
        }
    }

    #[test]
    fn a_turn_about_the_axis_keeps_the_axis() {
        let turned = turn(along_x(), 0.7);
        assert!((axis(&turned) - Vector3::z()).norm() < 1e-12);
        let m = turned.points[0].along_travel();
        assert!(
            (m - Vector3::new(0.7f64.cos(), 0.7f64.sin(), 0.0)).norm() < 1e-12,
            "counter-clockwise from above"
        );
    }

    #[test]
    fn the_travel_angle_is_measured_in_the_plane_of_axis_and_weld() {
        let both = travel_angle(work_angle(along_x(), 0.5), 0.3);
        let n = axis(&both);
        assert!(
            (n.dot(&Vector3::x()) + 0.3f64.sin()).abs() < 1e-12,
            "the angle to the weld is that of the travel"
        );
        let across = n - Vector3::x() * n.x;
        assert!((across.y / across.z + 0.5f64.tan()).abs() < 1e-12, "the lean across is the work angle");
    }

    #[test]
    fn every_angle_is_undone_by_its_opposite() {
        for modifier in [work_angle, travel_angle, turn] {
            let back = modifier(modifier(along_x(), 0.4), -0.4);
            assert!(back.points[0].base_from_torch.angle_to(&along_x().points[0].base_from_torch) < 1e-9);
        }
    }
}
