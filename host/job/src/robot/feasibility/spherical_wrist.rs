//! Arms with an ortho-parallel base and a spherical wrist (ABB, KUKA, FANUC and most others) by the crate `rs-opw-kinematics`.
//!
//! Parameters as in Brandstötter, Angerer, Hofbaur (2014). Millimetres and radians here, metres there.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rs_opw_kinematics::glam::{DQuat, DVec3};
use rs_opw_kinematics::kinematic_traits::Kinematics;
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;
use rs_opw_kinematics::pose::Pose;

use super::arm::Joints;

/// OPW parameters: lengths in mm, offsets of the joint angles in degrees, the sense of each joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Opw {
    /// From axis 1 to axis 2, along x.
    pub a1_mm: f64,
    /// From axis 3 to the forearm's axis, against x.
    pub a2_mm: f64,
    /// Sideways offset of the arm, along y.
    pub b_mm: f64,
    /// Height of axis 2.
    pub c1_mm: f64,
    /// From axis 2 to axis 3.
    pub c2_mm: f64,
    /// From axis 3 to the wrist's centre.
    pub c3_mm: f64,
    /// From the wrist's centre to the flange.
    pub c4_mm: f64,
    /// Joint angle where the model's is zero.
    pub offsets_deg: [f64; 6],
    /// 1 or -1.
    pub signs: [i8; 6],
}

/// One such arm.
#[derive(Clone)]
pub struct SphericalWrist {
    opw: Box<Opw>,
    solver: Box<OPWKinematics>,
}

impl std::fmt::Debug for SphericalWrist {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.opw.fmt(f)
    }
}

impl SphericalWrist {
    /// Lengths and offsets must be finite, signs 1 or -1.
    pub fn new(opw: Opw) -> Self {
        let parameters = Parameters {
            a1: opw.a1_mm / 1000.0,
            a2: opw.a2_mm / 1000.0,
            b: opw.b_mm / 1000.0,
            c1: opw.c1_mm / 1000.0,
            c2: opw.c2_mm / 1000.0,
            c3: opw.c3_mm / 1000.0,
            c4: opw.c4_mm / 1000.0,
            offsets: opw.offsets_deg.map(f64::to_radians),
            sign_corrections: opw.signs,
            dof: 6,
        };
        Self { opw: Box::new(opw), solver: Box::new(OPWKinematics::new(parameters)) }
    }

    /// The flange in the robot's base frame.
    pub fn forward(&self, joints_rad: &Joints) -> Isometry3<f64> {
        let pose = self.solver.forward(joints_rad);
        let (at, q) = (pose.translation, pose.rotation);
        let rotation = UnitQuaternion::from_quaternion(Quaternion::new(q.w, q.x, q.y, q.z));
        Isometry3::from_parts(Translation3::from(Vector3::new(at.x, at.y, at.z) * 1000.0), rotation)
    }

    /// Where the arm reaches ahead with joint 1 at zero.
    pub(super) fn ahead(&self) -> Vector3<f64> {
        let (sin, cos) = (-self.opw.offsets_deg[0].to_radians()).sin_cos();
        Vector3::new(cos, sin, 0.0)
    }

    /// Sine of the bend of the wrist.
    pub(super) fn wrist_bend(&self, joints_rad: &Joints) -> f64 {
        let Opw { offsets_deg, signs, .. } = &*self.opw;
        (joints_rad[4] * f64::from(signs[4]) - offsets_deg[4].to_radians()).sin().abs()
    }

    /// Up to eight sets of joint angles that bring the flange there; empty if it is out of reach.
    pub fn inverse(&self, base_from_flange: &Isometry3<f64>) -> Vec<Joints> {
        let at = base_from_flange.translation.vector / 1000.0;
        let q = base_from_flange.rotation;
        let rotation = DQuat::from_xyzw(q.i, q.j, q.k, q.w);
        match Pose::try_from_parts(DVec3::new(at.x, at.y, at.z), rotation) {
            Ok(pose) => self.solver.inverse(&pose),
            Err(_) => Vec::new(),
        }
    }
}
