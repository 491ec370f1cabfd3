//! The axes of an arm and lines through its links, to draw it. Both follow from its forward kinematics alone, so that one way
//! serves every arm.
//!
//! Millimetres, the robot's base frame, all joints at zero. The flange stands at `R1 R2 ... R6 T`: each `R` turns about one
//! axis by the angle of its joint, `T` is the flange at zero (product of exponentials, Brockett 1984).

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use super::arm::Arm;

/// Axes whose directions have a sine below this between them are parallel.
const PARALLEL: f64 = 1e-6;
/// Places that are nearer to each other are one, mm.
const SAME_MM: f64 = 1e-3;
/// Nominal radius of a link as a share of upper arm and forearm together, about that of common arms ...
const RADIUS_SHARE: f64 = 0.05;
/// ... and of the links of the wrist, as a share of that.
const WRIST_SHARE: f64 = 0.7;

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

/// An arm with all joints at zero.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkChain {
    /// One per joint.
    pub axes: [JointAxis; 6],
    /// Lines from axis to axis through what each joint carries; first through what stands still, from the base.
    pub links_mm: [Vec<Point3<f64>>; 7],
    /// Where the flange is.
    pub base_from_flange: Isometry3<f64>,
    /// Nominal radii of the links: of the arm, and of the wrist, which are the last three.
    pub radii_mm: [f64; 2],
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
        let links_mm = links_mm(&axes, &base_from_flange);
        let long_mm: f64 = links_mm[2..4].iter().map(|link| length_mm(link)).sum();
        let radius_mm = RADIUS_SHARE * long_mm;
        Self { axes, links_mm, base_from_flange, radii_mm: [radius_mm, WRIST_SHARE * radius_mm] }
    }
}

/// Along each axis to the place where it is nearest to the next one, and from there to that one.
fn links_mm(axes: &[JointAxis; 6], base_from_flange: &Isometry3<f64>) -> [Vec<Point3<f64>>; 7] {
    let flange_mm = Point3::from(base_from_flange.translation.vector);
    let mut reached_mm = Point3::origin();
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

fn length_mm(line_mm: &[Point3<f64>]) -> f64 {
    line_mm.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
}

#[cfg(test)]
mod tests {
    use super::super::arm::{Joints, by_name};
    use super::super::catalogue::NAMES;
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};
    use proptest::prelude::*;

    /// What joints up to this one do to what they carry.
    fn carried(chain: &LinkChain, joints_rad: &[f64]) -> Isometry3<f64> {
        let turn = |(axis, &angle): (&JointAxis, &f64)| {
            let about = Translation3::from(axis.at_mm.coords);
            about * UnitQuaternion::from_axis_angle(&axis.direction, angle) * about.inverse()
        };
        chain.axes.iter().zip(joints_rad).map(turn).fold(Isometry3::identity(), |base, turn| base * turn)
    }

    proptest! {
        #[test]
        fn the_axes_carry_the_flange_where_the_forward_kinematics_do(joints in prop::array::uniform6(-3.1..3.1f64)) {
            for name in NAMES {
                let arm = by_name(name).unwrap();
                let chain = LinkChain::of(&arm);
                let (drawn, truth) = (carried(&chain, &joints) * chain.base_from_flange, arm.forward(&joints));
                let off_mm = (drawn.translation.vector - truth.translation.vector).norm();
                prop_assert!(off_mm < 1e-6 && drawn.rotation.angle_to(&truth.rotation) < 1e-9, "{name}: {off_mm} mm");
            }
        }

        #[test]
        fn each_link_ends_where_the_next_begins_however_the_joints_stand(joints in prop::array::uniform6(-3.1..3.1f64)) {
            for name in NAMES {
                let chain = LinkChain::of(&by_name(name).unwrap());
                let end = |link: usize, place: Point3<f64>| carried(&chain, &joints[..link]) * place;
                for link in 0..6 {
                    let (this, next) = (&chain.links_mm[link], &chain.links_mm[link + 1]);
                    let apart = end(link, *this.last().unwrap()) - end(link + 1, next[0]);
                    prop_assert!(apart.norm() < 2.0 * SAME_MM, "{name}, link {link}: {apart}");
                }
            }
        }
    }

    #[test]
    fn the_links_are_as_long_as_the_parameters_say() {
        let lengths = |name: &str| -> Vec<f64> {
            LinkChain::of(&by_name(name).unwrap()).links_mm.iter().map(|link| length_mm(link)).collect()
        };
        // d1, then a2, a3, d4, d5, d6; and c1, a1 with c2, ..., c4.
        for (name, truth) in [
            ("ur10e", [0.0, 180.7, 612.7, 571.55, 174.15, 119.85, 116.55]),
            ("abb-irb1600-10-145", [0.0, 486.5 + 150.0, 700.0, 0.0, 600.0, 0.0, 65.0]),
        ] {
            let found = lengths(name);
            assert!(found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-2), "{name}: {found:?}");
        }
        let _: Joints = [0.0; 6];
    }
}
