//! A six-joint arm: forward and inverse kinematics, limits, and how near to a singularity it stands.

use nalgebra::{Isometry3, Matrix6, Vector3};

use crate::robot::posture::Maker;

use super::body::Body;
use super::catalogue;
use super::offset_wrist::OffsetWrist;
use super::spherical_wrist::SphericalWrist;

/// Angles of the six joints, rad.
pub type Joints = [f64; 6];

/// How the joints move the flange.
#[derive(Debug, Clone)]
pub enum Kinematics {
    /// Universal Robots.
    OffsetWrist(OffsetWrist),
    /// ABB, KUKA, FANUC and most others.
    SphericalWrist(SphericalWrist),
}

/// What the joints may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Least and greatest angle, rad.
    pub range_rad: [[f64; 2]; 6],
    /// Greatest speed, rad/s.
    pub speed_rad_s: [f64; 6],
}

impl Limits {
    /// From degrees and degrees per second.
    pub fn degrees(range_deg: [[f64; 2]; 6], speed_deg_s: [f64; 6]) -> Self {
        Self {
            range_rad: range_deg.map(|range| range.map(f64::to_radians)),
            speed_rad_s: speed_deg_s.map(f64::to_radians),
        }
    }

    /// Distance of joint `j` to its nearer limit, rad; negative beyond it.
    pub(crate) fn margin_rad(&self, j: usize, angle_rad: f64) -> f64 {
        let [least, greatest] = self.range_rad[j];
        (angle_rad - least).min(greatest - angle_rad)
    }

    /// Of the angles that differ by whole turns the one farthest from its limits.
    pub fn centred(&self, j: usize, angle_rad: f64) -> f64 {
        let [least, greatest] = self.range_rad[j];
        let turns = ((0.5 * (least + greatest) - angle_rad) / std::f64::consts::TAU).round();
        angle_rad + turns * std::f64::consts::TAU
    }
}

/// An arm as the feasibility check knows it.
#[derive(Debug, Clone)]
pub struct Arm {
    /// As the user wrote it.
    pub name: String,
    /// How the joints move the flange.
    pub kinematics: Kinematics,
    /// What the joints may do.
    pub limits: Limits,
    /// How thick it is.
    pub body: Body,
    /// How its controller counts the joints; none where nobody says.
    pub counting: Option<Counting>,
}

/// How a controller counts the joints that are counted here as [`super::catalogue`] says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counting {
    /// Whose controller; none for an arm of the job's own.
    pub maker: Option<Maker>,
    /// Whether its joint 3 counts from the horizontal, so that it is ours less joint 2.
    pub third_from_level: bool,
}

impl Counting {
    /// Degrees, as the controller shows them.
    pub fn shown_deg(self, joints_rad: &Joints) -> Joints {
        let mut joints_deg = joints_rad.map(f64::to_degrees);
        if self.third_from_level {
            joints_deg[2] -= joints_deg[1];
        }
        joints_deg
    }

    /// The joints that the controller shows as these degrees.
    pub fn from_shown_rad(self, shown_deg: &Joints) -> Joints {
        let mut joints_deg = *shown_deg;
        if self.third_from_level {
            joints_deg[2] += joints_deg[1];
        }
        joints_deg.map(f64::to_radians)
    }
}

/// The arm of this name, in any case; see [`catalogue::NAMES`].
///
/// ```
/// use weldpath_job::robot::feasibility::arm::by_name;
///
/// let arm = by_name("UR10e").unwrap();
/// let joints_rad = [0.1, -1.2, 1.4, -0.5, 1.3, 0.2];
/// let base_from_flange = arm.forward(&joints_rad);
/// // An angle and the same one a turn on are one place of the arm.
/// let same = |found: &[f64; 6]| found.iter().zip(joints_rad).all(|(a, b)| (a - b).cos() > 1.0 - 1e-12);
/// assert!(arm.inverse(&base_from_flange).iter().any(same));
/// ```
pub fn by_name(name: &str) -> Option<Arm> {
    let known = catalogue::NAMES.iter().find(|known| known.eq_ignore_ascii_case(name))?;
    catalogue::named(known)
}

/// Step of the numerical derivative, rad.
const STEP_RAD: f64 = 1e-5;
/// Length that a turn by 1 rad is compared with, mm: about the lever of a torch from the wrist.
const LEVER_MM: f64 = 300.0;

impl Arm {
    /// The flange in the robot's base frame, mm.
    pub fn forward(&self, joints_rad: &Joints) -> Isometry3<f64> {
        match &self.kinematics {
            Kinematics::OffsetWrist(arm) => arm.forward(joints_rad),
            Kinematics::SphericalWrist(arm) => arm.forward(joints_rad),
        }
    }

    /// All sets of joint angles that bring the flange there, whatever the limits.
    pub fn inverse(&self, base_from_flange: &Isometry3<f64>) -> Vec<Joints> {
        match &self.kinematics {
            Kinematics::OffsetWrist(arm) => arm.inverse(base_from_flange),
            Kinematics::SphericalWrist(arm) => arm.inverse(base_from_flange),
        }
    }

    /// Where the arm reaches ahead with joint 1 at zero: across its axis, length 1.
    pub(super) fn ahead(&self) -> Vector3<f64> {
        match &self.kinematics {
            Kinematics::OffsetWrist(_) => -Vector3::x(),
            Kinematics::SphericalWrist(arm) => arm.ahead(),
        }
    }

    /// Sine of the bend of the wrist: 0 where the axes of joints 4 and 6 are parallel.
    pub(super) fn wrist_bend(&self, joints_rad: &Joints) -> f64 {
        match &self.kinematics {
            Kinematics::OffsetWrist(_) => joints_rad[4].sin().abs(),
            Kinematics::SphericalWrist(arm) => arm.wrist_bend(joints_rad),
        }
    }

    /// How far from a singularity the arm stands: the least over the greatest singular value of the Jacobian (turns count
    /// 300 mm per rad). 0 where a direction is lost; 0.1 to 0.3 amid the workspace.
    pub fn dexterity(&self, joints_rad: &Joints) -> f64 {
        let values = self.jacobian(joints_rad).singular_values();
        let (least, greatest) = (values.min(), values.max());
        if greatest > 0.0 { least / greatest } else { 0.0 }
    }

    /// Motion of the flange per rad of each joint: mm, and rad times the lever.
    fn jacobian(&self, joints_rad: &Joints) -> Matrix6<f64> {
        let mut jacobian = Matrix6::zeros();
        for j in 0..6 {
            let moved = |step: f64| {
                let mut joints = *joints_rad;
                joints[j] += step;
                self.forward(&joints)
            };
            let (back, ahead) = (moved(-STEP_RAD), moved(STEP_RAD));
            let shift: Vector3<f64> = ahead.translation.vector - back.translation.vector;
            let turn = (ahead.rotation * back.rotation.inverse()).scaled_axis() * LEVER_MM;
            jacobian.fixed_view_mut::<3, 1>(0, j).copy_from(&(shift / (2.0 * STEP_RAD)));
            jacobian.fixed_view_mut::<3, 1>(3, j).copy_from(&(turn / (2.0 * STEP_RAD)));
        }
        jacobian
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn arm(name: &str) -> Arm {
        by_name(name).unwrap()
    }

    #[test]
    fn every_name_of_the_catalogue_is_an_arm_whose_limits_are_in_order() {
        for name in catalogue::NAMES {
            let arm = arm(name);
            assert!(arm.limits.range_rad.iter().all(|[least, greatest]| least < greatest), "{name}");
            assert!(arm.limits.speed_rad_s.iter().all(|&speed| speed > 1.0), "{name}");
        }
        assert!(by_name("UR5E").is_some() && by_name("ur6").is_none());
    }

    /// Poses from the joints and axes of the ROS-Industrial URDFs, multiplied out by hand for one set of angles.
    #[test]
    fn spherical_wrists_stand_where_their_urdf_puts_them() {
        let joints = [0.4, -0.5, 0.6, 0.7, -0.8, 0.9];
        for (name, at_mm, x, z) in [
            (
                "abb-irb1600-10-145",
                [435.408, 151.475, 1071.872],
                [0.082652, 0.988323, 0.128012],
                [0.868918, -0.134368, 0.476369],
            ),
            (
                "abb-irb2600-12-165",
                [642.071, 228.815, 1134.857],
                [0.082652, 0.988323, 0.128012],
                [0.868918, -0.134368, 0.476369],
            ),
            (
                "kuka-kr10-r1420",
                [1307.442, -512.638, 734.569],
                [0.082652, -0.988323, 0.128012],
                [0.868918, 0.134368, 0.476369],
            ),
            (
                "fanuc-m10ia",
                [68.567, -21.185, 1224.845],
                [-0.013324, 0.947745, 0.318752],
                [0.921415, -0.112173, 0.372038],
            ),
        ] {
            let pose = arm(name).forward(&joints);
            assert!((pose.translation.vector - Vector3::from(at_mm)).amax() < 2e-3, "{name}: {pose}");
            assert!((pose.rotation * Vector3::x() - Vector3::from(x)).amax() < 2e-6, "{name}: {pose}");
            assert!((pose.rotation * Vector3::z() - Vector3::from(z)).amax() < 2e-6, "{name}: {pose}");
        }
    }

    #[test]
    fn a_straight_wrist_is_singular_and_a_bent_one_is_not() {
        for name in catalogue::NAMES {
            let elbow = if name.starts_with("fanuc") { -1.5 } else { 1.5 };
            let straight = arm(name).dexterity(&[0.3, -0.9, elbow, 0.4, 1e-6, 0.2]);
            let bent = arm(name).dexterity(&[0.3, -0.9, elbow, 0.4, 1.2, 0.2]);
            assert!(straight < 1e-4 && bent > 0.03, "{name}: {straight} {bent}");
        }
    }

    #[test]
    fn margins_count_to_the_nearer_limit_and_centring_turns_whole_turns() {
        let limits = Limits::degrees([[-100.0, 500.0]; 6], [90.0; 6]);
        assert!((limits.margin_rad(0, 50f64.to_radians()) - 150f64.to_radians()).abs() < 1e-12);
        assert!(limits.margin_rad(0, -101f64.to_radians()) < 0.0);
        assert!((limits.centred(0, -90f64.to_radians()) - 270f64.to_radians()).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn every_arm_reaches_what_it_reached(
            joints in prop::array::uniform6(-1.2..1.2f64)
        ) {
            for name in catalogue::NAMES {
                let arm = arm(name);
                let pose = arm.forward(&joints);
                let solutions = arm.inverse(&pose);
                prop_assert!(!solutions.is_empty(), "{name}: {joints:?}");
                for solution in solutions {
                    let back = arm.forward(&solution);
                    let off_mm = (back.translation.vector - pose.translation.vector).norm();
                    prop_assert!(off_mm < 1e-3 && back.rotation.angle_to(&pose.rotation) < 1e-5, "{name}: {solution:?}");
                }
            }
        }
    }
}
