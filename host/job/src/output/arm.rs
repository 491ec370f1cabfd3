//! The robot's arm as the page draws it: its links at nominal radius, which nothing is checked against, and its joints along the
//! program, as the feasibility check follows them.

use nalgebra::{Isometry3, Point3};
use serde::Serialize;

use crate::robot::feasibility::PlacedArm;
use crate::robot::feasibility::arm::Joints;
use crate::robot::feasibility::chain::{JointAxis, LinkChain};
use weldpath_method::weld::program::Waypoint;

/// A pose: x, y, z in mm and the quaternion w, x, y, z.
type Pose = [f64; 7];

/// `arm` of the page's content. Places and poses are in the robot's frame with all joints at zero, but for the first.
#[derive(Serialize)]
pub struct ArmDrawing {
    name: String,
    base_from_robot: Pose,
    /// A place on the axis of each joint, mm, and its direction.
    axes: [[f64; 6]; 6],
    /// What stands still, then what each joint carries.
    links_mm: [Vec<[f64; 3]>; 7],
    radii_mm: [f64; 2],
    robot_from_tcp: Pose,
    /// For each waypoint of the page the joints along the move to it, rad; none where the arm reaches none.
    joints_rad: Vec<Vec<Option<Joints>>>,
}

impl ArmDrawing {
    /// Along the waypoints, of which the page has those that are `shown`.
    pub fn new(arm: &PlacedArm, waypoints: &[Waypoint], shown: &[usize]) -> Self {
        let LinkChain { axes, links_mm, base_from_flange, radii_mm } = LinkChain::of(&arm.arm);
        let mut motion = arm.motion(waypoints);
        let joints_rad = shown.iter().enumerate().map(|(k, &i)| {
            let mut joints_rad = std::mem::take(&mut motion[i]);
            // Over waypoints that the page has not the poses between would not divide the move evenly.
            if k > 0 && shown[k - 1] + 1 != i {
                joints_rad.drain(..joints_rad.len() - 1);
            }
            joints_rad.into_iter().map(|joints| joints.map(|angles| rounded(angles, PER_RAD))).collect()
        });
        Self {
            name: arm.arm.name.clone(),
            base_from_robot: pose(&arm.base_from_robot),
            axes: axes.map(axis),
            links_mm: links_mm.map(|link| link.into_iter().map(place).collect()),
            radii_mm: radii_mm.map(f64::round),
            robot_from_tcp: pose(&(base_from_flange * arm.flange_from_tcp)),
            joints_rad: joints_rad.collect(),
        }
    }
}

/// Steps of what is written: a micrometre; 1e-6 rad, which is a micrometre at the reach of an arm, and the same of a quaternion.
const PER_MM: f64 = 1e3;
const PER_RAD: f64 = 1e6;

fn rounded<const N: usize>(values: [f64; N], steps: f64) -> [f64; N] {
    values.map(|v| (v * steps).round() / steps + 0.0)
}

fn place(p: Point3<f64>) -> [f64; 3] {
    rounded(p.into(), PER_MM)
}

fn pose(pose: &Isometry3<f64>) -> Pose {
    let q = pose.rotation;
    let [x, y, z] = place(pose.translation.vector.into());
    let [qw, qx, qy, qz] = rounded([q.w, q.i, q.j, q.k], PER_RAD);
    [x, y, z, qw, qx, qy, qz]
}

fn axis(axis: JointAxis) -> [f64; 6] {
    let ([x, y, z], d) = (place(axis.at_mm), axis.direction);
    [x, y, z, d.x, d.y, d.z]
}
