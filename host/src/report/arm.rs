//! The robot's arm as the page draws it: its links at nominal radius, which nothing is checked against, and its joints along the
//! program, as the feasibility check follows them.

use nalgebra::{Isometry3, Point3};
use serde::Serialize;

use super::content::{rounded, rounded_turn};
use crate::robot::feasibility::PlacedArm;
use crate::robot::feasibility::arm::Joints;
use crate::robot::feasibility::chain::{Axis, Chain};
use crate::weld::program::Waypoint;

/// A pose: x, y, z in mm and the quaternion w, x, y, z.
type Pose = [f64; 7];

/// `arm` of the page's content. Places and poses are in the robot's frame with all joints at zero, but for the first.
#[derive(Serialize)]
pub(super) struct ArmDrawing {
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
    pub(super) fn new(arm: &PlacedArm, waypoints: &[Waypoint], shown: &[usize]) -> Self {
        let Chain { axes, links_mm, base_from_flange, radii_mm } = Chain::of(&arm.arm);
        let mut motion = arm.motion(waypoints);
        let joints_rad = shown.iter().enumerate().map(|(k, &i)| {
            let mut joints_rad = std::mem::take(&mut motion[i]);
            // Over waypoints that the page has not the poses between would not divide the move evenly.
            if k > 0 && shown[k - 1] + 1 != i {
                joints_rad.drain(..joints_rad.len() - 1);
            }
            joints_rad.into_iter().map(|joints| joints.map(|angles| angles.map(rounded_angle))).collect()
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

fn place(p: Point3<f64>) -> [f64; 3] {
    rounded(p.into())
}

fn pose(pose: &Isometry3<f64>) -> Pose {
    let ([x, y, z], [qw, qx, qy, qz]) =
        (rounded(pose.translation.vector.into()), rounded_turn(&pose.rotation));
    [x, y, z, qw, qx, qy, qz]
}

fn axis(axis: Axis) -> [f64; 6] {
    let ([x, y, z], d) = (place(axis.at_mm), axis.direction);
    [x, y, z, d.x, d.y, d.z]
}

/// To 1e-6 rad: a micrometre at the reach of an arm.
fn rounded_angle(rad: f64) -> f64 {
    (rad * 1e6).round() / 1e6
}
