//! Closed-form inverse kinematics of arms with three parallel axes and an offset wrist: Universal Robots (not in the paper).
//!
//! Standard Denavit-Hartenberg: `A = Rz(q) Tz(d) Tx(a) Rx(alpha)` with `alpha = (90, 0, 0, 90, -90, 0)` degrees. Millimetres
//! and radians, robot base to flange. The frames are those of the controller: with a TCP of zero it reports this flange.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::arm::Joints;

/// Below this sine of joint 5 the axes of joints 4 and 6 are parallel and only their sum or difference is known.
const PARALLEL: f64 = 1e-9;
/// By so much a cosine may exceed 1 from rounding alone.
const ROUNDING: f64 = 1e-9;

/// The lengths that are not zero, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetWrist {
    /// Height of the shoulder.
    pub d1_mm: f64,
    /// Upper arm; negative by the vendor's convention.
    pub a2_mm: f64,
    /// Forearm; negative by the vendor's convention.
    pub a3_mm: f64,
    /// Offset of the wrist from the plane of the arm.
    pub d4_mm: f64,
    /// From joint 4 to joint 5.
    pub d5_mm: f64,
    /// From joint 5 to the flange.
    pub d6_mm: f64,
}

impl OffsetWrist {
    /// `(a, d, alpha)` of each joint.
    fn rows(&self) -> [(f64, f64, f64); 6] {
        use std::f64::consts::FRAC_PI_2;
        [
            (0.0, self.d1_mm, FRAC_PI_2),
            (self.a2_mm, 0.0, 0.0),
            (self.a3_mm, 0.0, 0.0),
            (0.0, self.d4_mm, FRAC_PI_2),
            (0.0, self.d5_mm, -FRAC_PI_2),
            (0.0, self.d6_mm, 0.0),
        ]
    }

    fn link(&self, joint: usize, angle_rad: f64) -> Isometry3<f64> {
        let (a, d, alpha) = self.rows()[joint];
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad);
        let twist = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), alpha);
        Isometry3::from_parts(Translation3::from(turn * Vector3::new(a, 0.0, d)), turn * twist)
    }

    /// The flange in the robot's base frame.
    pub fn forward(&self, joints_rad: &Joints) -> Isometry3<f64> {
        (0..6).fold(Isometry3::identity(), |base, j| base * self.link(j, joints_rad[j]))
    }

    /// Up to eight sets of joint angles that bring the flange there: shoulder left or right, wrist up or down, elbow up or
    /// down. Empty if it is out of reach.
    pub fn inverse(&self, base_from_flange: &Isometry3<f64>) -> Vec<Joints> {
        let mut found = Vec::with_capacity(8);
        for q1 in self.shoulders(base_from_flange) {
            for q5 in self.wrists(base_from_flange, q1) {
                let q6 = last_joint(base_from_flange, q1, q5);
                let wrist = self.link(4, q5) * self.link(5, q6);
                let first_from_fourth = self.link(0, q1).inv_mul(base_from_flange) * wrist.inverse();
                for (q2, q3) in self.elbows(&first_from_fourth) {
                    let third = self.link(1, q2) * self.link(2, q3);
                    let x = third.inv_mul(&first_from_fourth).rotation * Vector3::x();
                    found.push([q1, q2, q3, x.y.atan2(x.x), q5, q6]);
                }
            }
        }
        found
    }

    /// Joint 1: the wrist's centre lies `d4` beside the plane of the arm.
    fn shoulders(&self, base_from_flange: &Isometry3<f64>) -> impl Iterator<Item = f64> + use<> {
        let centre = base_from_flange * Point3::new(0.0, 0.0, -self.d6_mm);
        let toward = centre.y.atan2(centre.x) + std::f64::consts::FRAC_PI_2;
        both_signs(self.d4_mm / centre.coords.xy().norm()).map(move |beside| toward + beside)
    }

    /// Joint 5: how far the flange stands beside the plane of the arm.
    fn wrists(&self, base_from_flange: &Isometry3<f64>, q1: f64) -> impl Iterator<Item = f64> + use<> {
        let at = base_from_flange.translation.vector;
        let (sin, cos) = q1.sin_cos();
        both_signs((at.x * sin - at.y * cos - self.d4_mm) / self.d6_mm)
    }

    /// Joints 2 and 3: two links in a plane.
    fn elbows(&self, first_from_fourth: &Isometry3<f64>) -> impl Iterator<Item = (f64, f64)> + use<> {
        let (a2, a3) = (self.a2_mm, self.a3_mm);
        let p = first_from_fourth * Point3::new(0.0, -self.d4_mm, 0.0);
        let cosine = (p.x * p.x + p.y * p.y - a2 * a2 - a3 * a3) / (2.0 * a2 * a3);
        both_signs(cosine).map(move |q3| {
            let (sin, cos) = q3.sin_cos();
            (p.y.atan2(p.x) - (a3 * sin).atan2(a2 + a3 * cos), q3)
        })
    }
}

/// Joint 6; where it is not determined, 0.
fn last_joint(base_from_flange: &Isometry3<f64>, q1: f64, q5: f64) -> f64 {
    let (sin1, cos1) = q1.sin_cos();
    let sin5 = q5.sin();
    if sin5.abs() < PARALLEL {
        return 0.0;
    }
    let x = base_from_flange.rotation * Vector3::x();
    let y = base_from_flange.rotation * Vector3::y();
    let side = sin5.signum();
    (side * (y.y * cos1 - y.x * sin1)).atan2(side * (x.x * sin1 - x.y * cos1))
}

/// The angles with this cosine; none if it is no cosine.
fn both_signs(cosine: f64) -> impl Iterator<Item = f64> + use<> {
    let angle = (cosine.abs() <= 1.0 + ROUNDING).then(|| cosine.clamp(-1.0, 1.0).acos());
    angle.into_iter().flat_map(|angle| [angle, -angle])
}

#[cfg(test)]
mod tests {
    use super::super::arm::{Kinematics, by_name};
    use super::super::catalogue::NAMES;
    use super::*;
    use proptest::prelude::*;

    fn arms() -> Vec<(&'static str, OffsetWrist)> {
        let arm = |name: &&'static str| match by_name(name)?.kinematics {
            Kinematics::OffsetWrist(arm) => Some((*name, arm)),
            Kinematics::SphericalWrist(_) => None,
        };
        NAMES.iter().filter_map(arm).collect()
    }

    fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
        ((a.translation.vector - b.translation.vector).norm(), a.rotation.angle_to(&b.rotation))
    }

    /// Poses that the Python package `ur-analytic-ik` 0.1.0 (C++, by others) computes, metres.
    #[test]
    fn forward_kinematics_agree_with_an_independent_implementation() {
        let q = [[0.3, -1.2, 1.7, -0.4, 0.9, -2.1], [-2.4, -0.6, -1.1, 2.2, -1.3, 0.5]];
        let rotations = [
            [
                [-0.332842, 0.758026, -0.560904],
                [0.310988, -0.473302, -0.824179],
                [-0.890226, -0.448755, -0.078202],
            ],
            [
                [0.588748, 0.081205, -0.804227],
                [-0.607442, 0.700854, -0.373921],
                [0.533282, 0.708667, 0.461954],
            ],
        ];
        for (name, positions) in [
            ("ur3e", [[-0.267846, -0.279958, 0.184509], [-0.064794, 0.151779, 0.468436]]),
            ("ur5e", [[-0.482903, -0.353718, 0.263595], [0.016005, 0.231563, 0.749920]]),
            ("ur10e", [[-0.693758, -0.472732, 0.349379], [0.064851, 0.337854, 1.042105]]),
            ("ur3", [[-0.267727, -0.253710, 0.185425], [-0.043904, 0.141855, 0.463880]]),
            ("ur5", [[-0.480860, -0.316551, 0.196608], [0.048011, 0.221855, 0.673068]]),
            ("ur10", [[-0.683900, -0.443152, 0.301000], [0.092299, 0.340319, 0.981447]]),
        ] {
            let arms = arms();
            let (_, arm) = arms.iter().find(|(n, _)| *n == name).unwrap();
            for k in 0..2 {
                let pose = arm.forward(&q[k]);
                let at = pose.translation.vector / 1000.0;
                assert!((at - Vector3::from(positions[k])).amax() < 2e-6, "{name}: {at}");
                let turn = pose.rotation.to_rotation_matrix();
                for (row, truth) in rotations[k].iter().enumerate() {
                    let off = (0..3).map(|column| (turn[(row, column)] - truth[column]).abs());
                    assert!(off.fold(0.0, f64::max) < 2e-6, "{name} row {row}");
                }
            }
        }
    }

    #[test]
    fn a_flange_beyond_the_reach_or_inside_the_shoulder_has_no_solution() {
        for (_, arm) in arms() {
            let far = Isometry3::translation(5000.0, 0.0, 0.0);
            let on_the_axis = Isometry3::translation(0.0, 0.0, 400.0 + arm.d6_mm);
            assert!(arm.inverse(&far).is_empty() && arm.inverse(&on_the_axis).is_empty());
        }
    }

    proptest! {
        #[test]
        fn every_solution_reaches_the_pose_and_one_is_the_original(
            joints in prop::array::uniform6(-3.1..3.1f64)
        ) {
            for (name, arm) in arms() {
                let pose = arm.forward(&joints);
                let solutions = arm.inverse(&pose);
                prop_assert!(solutions.len() <= 8);
                for solution in &solutions {
                    let (mm, rad) = apart(&arm.forward(solution), &pose);
                    prop_assert!(mm < 1e-5 && rad < 1e-6, "{name}: {mm} mm, {rad} rad from {joints:?}");
                }
                // Near a singularity the angles themselves are ill determined; the poses above are not.
                let clear = joints[4].sin().abs() > 0.05 && joints[2].sin().abs() > 0.05;
                let wrapped = |a: f64, b: f64| (a - b + 9.0 * std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                    - std::f64::consts::PI;
                let same = |s: &Joints| s.iter().zip(&joints).all(|(a, b)| wrapped(*a, *b).abs() < 1e-5);
                prop_assert!(!clear || solutions.iter().any(same), "{name}: {joints:?} is not among {solutions:?}");
            }
        }
    }
}
