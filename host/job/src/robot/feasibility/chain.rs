//! The axes of an arm and capsules around its links: what is drawn, and what is held against the work. Both follow from its
//! forward kinematics and its [`Body`], so that one way serves every arm.
//!
//! Millimetres, the robot's base frame, all joints at zero. The flange stands at `R1 R2 ... R6 T`: each `R` turns about one
//! axis by the angle of its joint, `T` is the flange at zero (product of exponentials, Brockett 1984).

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use super::arm::{Arm, Joints};
use super::body::Body;

/// Axes whose directions have a sine below this between them are parallel.
const PARALLEL: f64 = 1e-6;
/// Places that are nearer to each other are one, mm.
const SAME_MM: f64 = 1e-3;
/// What a joint turns about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointAxis {
    /// A place on it.
    pub at_mm: Point3<f64>,
    /// A positive angle turns about this by the right-hand rule.
    pub direction: Unit<Vector3<f64>>,
}

impl JointAxis {
    /// Of a turn by a right angle.
    fn of(quarter: &Isometry3<f64>) -> Self {
        let shift_mm = quarter.translation.vector;
        let direction = Unit::new_normalize(quarter.rotation.scaled_axis());
        // The place that stays where it is.
        let at_mm = Point3::from(0.5 * (shift_mm + direction.cross(&shift_mm)));
        Self { at_mm, direction }
    }

    fn nearest(&self, place_mm: &Point3<f64>) -> Point3<f64> {
        self.at_mm + self.direction.into_inner() * (place_mm - self.at_mm).dot(&self.direction)
    }

    /// Where this axis is nearest to another; nearest to `start_mm` if they are parallel.
    fn nearest_to(&self, other: &Self, start_mm: &Point3<f64>) -> Point3<f64> {
        let across = self.direction.cross(&other.direction);
        if across.norm() < PARALLEL {
            return self.nearest(start_mm);
        }
        let apart_mm = other.at_mm - self.at_mm;
        let along_mm = apart_mm.cross(&other.direction).dot(&across) / across.norm_squared();
        self.at_mm + self.direction.into_inner() * along_mm
    }
}

/// All places within a radius of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// The joint that carries it, from 1; 0 stands still.
    pub link: usize,
    /// Ends of the line.
    pub ends_mm: [Point3<f64>; 2],
    /// Of its surface.
    pub radius_mm: f64,
}

/// An arm with all joints at zero.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkChain {
    /// One per joint.
    pub axes: [JointAxis; 6],
    /// From the base to the flange.
    pub capsules: Vec<Capsule>,
    /// Where the flange is.
    pub base_from_flange: Isometry3<f64>,
    /// Centres of shoulder, elbow and wrist, each carried by the joint before it: 1, 2 and 4.
    corners_mm: [Point3<f64>; 3],
}

impl LinkChain {
    /// Of an arm.
    pub fn of(arm: &Arm) -> Self {
        let base_from_flange = arm.forward(&[0.0; 6]);
        let axes = std::array::from_fn(|joint| {
            let mut joints_rad = [0.0; 6];
            joints_rad[joint] = FRAC_PI_2;
            JointAxis::of(&(arm.forward(&joints_rad) * base_from_flange.inverse()))
        });
        let lines_mm = lines_mm(&axes, arm.body.mounting_mm, &base_from_flange);
        let corner = |line: usize| lines_mm[line].last().copied().unwrap_or_else(Point3::origin);
        let corners_mm = [corner(1), corner(2), corner(4)];
        let capsules = capsules(&arm.body, &axes, &lines_mm);
        Self { axes, capsules, base_from_flange, corners_mm }
    }

    /// What the first 0 to 6 joints do to what they carry.
    pub(super) fn carried(&self, joints_rad: &Joints) -> [Isometry3<f64>; 7] {
        let mut carried = [Isometry3::identity(); 7];
        for (k, (axis, &angle)) in self.axes.iter().zip(joints_rad).enumerate() {
            let turn = UnitQuaternion::from_axis_angle(&axis.direction, angle);
            let shift = axis.at_mm.coords - turn * axis.at_mm.coords;
            carried[k + 1] = carried[k] * Isometry3::from_parts(Translation3::from(shift), turn);
        }
        carried
    }

    /// Whether joint 1 faces the wrist, and whether the elbow is above the line from shoulder to wrist; robot's frame.
    pub(super) fn stance(&self, carried: &[Isometry3<f64>; 7], ahead: &Vector3<f64>) -> (bool, bool) {
        let [shoulder, elbow, wrist] = self.corners_mm(carried);
        let ahead = carried[1].rotation * ahead;
        let in_plane = |to: Point3<f64>| ((to - shoulder).dot(&ahead), (to - shoulder).z);
        let ((elbow_x, elbow_z), (wrist_x, wrist_z)) = (in_plane(elbow), in_plane(wrist));
        let front = wrist.coords.dot(&ahead) >= 0.0;
        (front, wrist_x * (wrist_x * elbow_z - wrist_z * elbow_x) >= 0.0)
    }

    /// Where the elbow is, in the robot's frame.
    #[cfg(test)]
    pub(super) fn elbow_mm(&self, joints_rad: &Joints) -> Point3<f64> {
        self.corners_mm(&self.carried(joints_rad))[1]
    }

    /// Centres of shoulder, elbow and wrist.
    fn corners_mm(&self, carried: &[Isometry3<f64>; 7]) -> [Point3<f64>; 3] {
        let [shoulder, elbow, wrist] = self.corners_mm;
        [carried[1] * shoulder, carried[2] * elbow, carried[4] * wrist]
    }
}

/// Around the lines through the links, upper arm and forearm where they stand beside them.
fn capsules(body: &Body, axes: &[JointAxis; 6], lines_mm: &[Vec<Point3<f64>>; 7]) -> Vec<Capsule> {
    let beside = |link: usize| {
        let [upper_mm, fore_mm] = body.beside_mm;
        axes[1].direction.into_inner() * [0.0, 0.0, upper_mm, fore_mm, 0.0, 0.0, 0.0][link]
    };
    let mut capsules = Vec::new();
    for (link, line_mm) in lines_mm.iter().enumerate() {
        let shift = beside(link);
        let mut places: Vec<Point3<f64>> = line_mm.iter().map(|place| place + shift).collect();
        // The joint between what stands side by side is a bar along its axis.
        if let Some(last) = line_mm.last().filter(|_| link < 6 && beside(link + 1) != shift) {
            places.push(last + beside(link + 1));
        }
        if let [one] = places[..] {
            places.push(one);
        }
        let capsule = |ends: &[Point3<f64>]| Capsule {
            link,
            ends_mm: [ends[0], ends[1]],
            radius_mm: body.radii_mm[link],
        };
        capsules.extend(places.windows(2).map(capsule));
    }
    capsules
}

/// Along each axis to the place where it is nearest to the next one, and from there to that one.
fn lines_mm(
    axes: &[JointAxis; 6],
    mounting_mm: f64,
    base_from_flange: &Isometry3<f64>,
) -> [Vec<Point3<f64>>; 7] {
    let flange_mm = Point3::from(base_from_flange.translation.vector);
    let mut reached_mm = Point3::new(0.0, 0.0, mounting_mm);
    std::array::from_fn(|link| {
        let before = link.checked_sub(1).map(|joint| axes[joint]);
        let next = axes.get(link);
        let leaves_mm = match (before, next) {
            (Some(own), Some(next)) => own.nearest_to(next, &reached_mm),
            (Some(own), None) => own.nearest(&flange_mm),
            (None, _) => reached_mm,
        };
        let ends_mm = next.map_or(flange_mm, |next| next.nearest(&leaves_mm));
        let mut line_mm = vec![std::mem::replace(&mut reached_mm, ends_mm), leaves_mm, ends_mm];
        line_mm.dedup_by(|b, a| (*b - *a).norm() < SAME_MM);
        line_mm
    })
}

#[cfg(test)]
mod tests {
    use super::super::arm::by_name;
    use super::super::catalogue::NAMES;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_axes_carry_the_flange_where_the_forward_kinematics_do(joints in prop::array::uniform6(-3.1..3.1f64)) {
            for name in NAMES {
                let arm = by_name(name).unwrap();
                let chain = LinkChain::of(&arm);
                let (drawn, truth) = (chain.carried(&joints)[6] * chain.base_from_flange, arm.forward(&joints));
                let off_mm = (drawn.translation.vector - truth.translation.vector).norm();
                prop_assert!(off_mm < 1e-6 && drawn.rotation.angle_to(&truth.rotation) < 1e-9, "{name}: {off_mm} mm");
            }
        }

        #[test]
        fn each_link_ends_where_the_next_begins_however_the_joints_stand(joints in prop::array::uniform6(-3.1..3.1f64)) {
            for name in NAMES {
                let chain = LinkChain::of(&by_name(name).unwrap());
                let carried = chain.carried(&joints);
                let of = |link: usize| chain.capsules.iter().filter(move |capsule| capsule.link == link);
                for link in 0..6 {
                    let end = carried[link] * of(link).next_back().unwrap().ends_mm[1];
                    let begin = carried[link + 1] * of(link + 1).next().unwrap().ends_mm[0];
                    prop_assert!((end - begin).norm() < 2.0 * SAME_MM, "{name}, link {link}");
                }
            }
        }
    }

    #[test]
    fn the_links_are_as_long_as_the_parameters_say() {
        let lengths = |name: &str| -> Vec<f64> {
            let chain = LinkChain::of(&by_name(name).unwrap());
            let length = |capsule: &Capsule| (capsule.ends_mm[1] - capsule.ends_mm[0]).norm();
            (0..7).map(|link| chain.capsules.iter().filter(|c| c.link == link).map(length).sum()).collect()
        };
        // d1 and the bar to the upper arm, a2 and the bar to the forearm, a3 and the rest of d4, d5, d6; and c1, a1 with
        // c2, ..., c4.
        for (name, truth) in [
            ("ur10e", [0.0, 180.7 + 176.2, 612.7 + 136.9, 571.55 + 39.3, 174.15, 119.85, 116.55]),
            ("abb-irb1600-10-145", [0.0, 486.5 + 150.0, 700.0, 0.0, 600.0, 0.0, 65.0]),
        ] {
            let found = lengths(name);
            assert!(found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-2), "{name}: {found:?}");
        }
    }
}
