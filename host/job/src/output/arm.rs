//! The robot's arm as the page draws it: its links, its joints along the program, and where a link touches, all as the
//! feasibility check has them.

use nalgebra::{Isometry3, Point3};
use serde::Serialize;

use crate::robot::feasibility::arm::Joints;
use crate::robot::feasibility::chain::{Capsule, JointAxis, LinkChain};
use crate::robot::feasibility::{PlacedArm, Report};

/// A pose: x, y, z in mm and the quaternion w, x, y, z.
type Pose = [f64; 7];

/// `arm` of the page's content. Places and poses are in the robot's frame with all joints at zero, but for the first.
#[derive(Serialize)]
pub struct ArmDrawing {
    name: String,
    base_from_robot: Pose,
    /// A place on the axis of each joint, mm, and its direction.
    axes: [[f64; 6]; 6],
    /// Of what stands still, then of what each joint carries: ends and radius of each capsule.
    links_mm: [Vec<[f64; 7]>; 7],
    robot_from_tcp: Pose,
    /// For each waypoint of the page the joints along the move to it, rad; none where the arm reaches none.
    joints_rad: Vec<Vec<Option<Joints>>>,
    /// For each waypoint of the page the link that touches something on the move to it, 7 for the torch.
    touching: Vec<Option<usize>>,
}

impl ArmDrawing {
    /// Along the waypoints of a report, of which the page has those that are `shown`.
    pub fn new(arm: &PlacedArm, report: &Report, shown: &[usize]) -> Self {
        let LinkChain { axes, capsules, base_from_flange, .. } = LinkChain::of(&arm.arm);
        let joints_rad = shown.iter().enumerate().map(|(k, &i)| {
            let mut joints_rad = report.motion.get(i).cloned().unwrap_or_default();
            // Over waypoints that the page has not the poses between would not divide the move evenly.
            if k > 0 && shown[k - 1] + 1 != i {
                joints_rad.drain(..joints_rad.len().saturating_sub(1));
            }
            joints_rad.into_iter().map(|joints| joints.map(|angles| rounded(angles, PER_RAD))).collect()
        });
        Self {
            name: arm.arm.name.clone(),
            base_from_robot: pose(&arm.base_from_robot),
            axes: axes.map(axis),
            links_mm: std::array::from_fn(|link| {
                capsules.iter().filter(|capsule| capsule.link == link).map(bar).collect()
            }),
            robot_from_tcp: pose(&(base_from_flange * arm.flange_from_tcp)),
            joints_rad: joints_rad.collect(),
            touching: shown.iter().map(|&i| Some(report.checks.get(i)?.joints?.touch?.link.index)).collect(),
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

fn bar(capsule: &Capsule) -> [f64; 7] {
    let [[ax, ay, az], [bx, by, bz]] = capsule.ends_mm.map(place);
    [ax, ay, az, bx, by, bz, capsule.radius_mm]
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
