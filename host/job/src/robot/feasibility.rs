//! Whether an arm can run a program (not in the paper): reach, joint limits, singularities, joint speeds, and the torch
//! against the scanned points. A whole program is feasible if one continuous motion of the joints runs it.
//!
//! Millimetres and radians; the scan's base frame unless a name says otherwise. No replacement for the controller's own
//! simulation: links, cables, external axes and what was not scanned are not looked at.

pub mod arm;
mod branch;
pub mod catalogue;
pub mod chain;
mod moves;
pub mod offset_wrist;
pub mod problem;
pub mod spherical_wrist;
pub mod suggestion;
pub mod torch;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use rayon::prelude::*;

use arm::{Arm, Joints};
use moves::Station;
use problem::Problem;
use suggestion::{Rewelded, Suggestion};
use torch::{Obstacles, Torch};
use weldpath_method::geometry::cloud::PointCloud;
use weldpath_method::weld::program::Waypoint;

/// The arm and where it stands.
#[derive(Debug, Clone)]
pub struct PlacedArm {
    /// Which arm.
    pub arm: Arm,
    /// Its base in the scan's base frame, mm; the identity where the scan was taken with it.
    pub base_from_robot: Isometry3<f64>,
    /// Tip of the wire in the flange's frame, mm; z out of the torch, into the work.
    pub flange_from_tcp: Isometry3<f64>,
}

/// What is checked.
#[derive(Debug, Clone)]
pub struct FeasibilitySetup {
    /// Without it only the torch is checked.
    pub robot: Option<PlacedArm>,
    /// The torch.
    pub torch: Torch,
    /// Least distance that the torch shall keep from the scanned points, mm.
    pub clearance_mm: f64,
}

/// The joints at one waypoint and on the move to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointCheck {
    /// At the waypoint; continuous along the program.
    pub joints_rad: Joints,
    /// Least distance of a joint to its limit, rad; negative beyond it.
    pub margin_rad: f64,
    /// [`Arm::dexterity`], the least on the move.
    pub dexterity: f64,
    /// Largest step of a joint between neighbouring poses of the move, rad.
    pub step_rad: f64,
    /// Largest speed of a joint on the move at its feed, as a share of what the joint can do.
    pub speed_share: f64,
}

/// One waypoint and the move to it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Check {
    /// None if a pose of the move is out of reach, or no robot was given.
    pub joints: Option<JointCheck>,
    /// Least distance of the torch from the scanned points on the move, mm; none if it is above [`torch::SIGHT_MM`].
    pub clearance_mm: Option<f64>,
}

/// What became of the check.
#[derive(Debug, Clone)]
pub struct Report {
    /// Name of the arm, if one was given.
    pub robot: Option<String>,
    /// One per waypoint of the program.
    pub checks: Vec<Check>,
    /// In the order of the waypoints.
    pub problems: Vec<Problem>,
    /// At most one per seam; each was tried.
    pub suggestions: Vec<Suggestion>,
}

impl Report {
    /// Whether nothing stands against running the program.
    pub(crate) fn is_feasible(&self) -> bool {
        !self.problems.iter().any(|problem| problem.kind.is_fatal())
    }

    /// Problems and suggestions in words.
    pub fn warnings(&self) -> Vec<String> {
        let arm = self.robot.as_deref().unwrap_or_default();
        let problems = self.problems.iter().map(|problem| problem.words(arm));
        problems.chain(self.suggestions.iter().map(Suggestion::words)).collect()
    }
}

/// Checks the program that `program` makes without changes, and tries changes where it fails.
pub(crate) fn assess(program: &Rewelded, model: &PointCloud, setup: &FeasibilitySetup) -> Report {
    let checker = Checker { setup, obstacles: Obstacles::new(model) };
    let waypoints = program(&[]);
    let checks = checker.checks(&waypoints, Depth::Full);
    let problems = checker.problems(&waypoints, &checks);
    let suggestions = suggestion::tried(&checker, program, &problems);
    let robot = setup.robot.as_ref().map(|robot| robot.arm.name.clone());
    Report { robot, checks, problems, suggestions }
}

/// Where the torch alone would touch what was scanned; nothing else is looked at, and nothing is tried.
pub(crate) fn collisions(waypoints: &[Waypoint], model: &PointCloud, torch: Torch) -> Vec<Problem> {
    let setup = FeasibilitySetup { robot: None, torch, clearance_mm: 0.0 };
    let checker = Checker { setup: &setup, obstacles: Obstacles::new(model) };
    checker.problems(waypoints, &checker.checks(waypoints, Depth::Fatal))
}

/// How much is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Depth {
    /// Everything.
    Full,
    /// Without the dexterity.
    Fatal,
    /// Without dexterity and clearance.
    Joints,
}

/// The setup with the scan sorted for it.
struct Checker<'a> {
    setup: &'a FeasibilitySetup,
    obstacles: Obstacles,
}

impl Checker<'_> {
    /// One check per waypoint, of everything that `depth` asks for.
    fn checks(&self, waypoints: &[Waypoint], depth: Depth) -> Vec<Check> {
        let stations = moves::stations(waypoints);
        let mut checks = vec![Check::default(); waypoints.len()];
        if depth != Depth::Joints {
            let clearances: Vec<Option<f64>> =
                stations.par_iter().map(|station| self.clearance_mm(station)).collect();
            for (station, clearance_mm) in stations.iter().zip(clearances) {
                let check = &mut checks[station.waypoint];
                check.clearance_mm =
                    [check.clearance_mm, clearance_mm].into_iter().flatten().reduce(f64::min);
            }
        }
        let fully = depth == Depth::Full;
        if let Some(robot) = &self.setup.robot {
            for (check, joints) in
                checks.iter_mut().zip(robot.joint_checks(&stations, waypoints.len(), fully))
            {
                check.joints = joints;
            }
        }
        checks
    }

    fn problems(&self, waypoints: &[Waypoint], checks: &[Check]) -> Vec<Problem> {
        problem::found(waypoints, checks, self.setup)
    }

    fn clearance_mm(&self, station: &Station) -> Option<f64> {
        self.obstacles.clearance_mm(&self.setup.torch, &station.tip_mm, &station.base_from_torch)
    }
}

/// `Rot(m, 180°)`: a tool's z points into the work, the torch's n out of it.
fn torch_from_tool() -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 1.0, 0.0))
}

impl PlacedArm {
    /// The flange in the robot's own base frame when the tip is at a station.
    fn robot_from_flange(&self, station: &Station) -> Isometry3<f64> {
        let turn = station.base_from_torch * torch_from_tool();
        let base_from_tcp = Isometry3::from_parts(station.tip_mm.into(), turn);
        self.base_from_robot.inv_mul(&base_from_tcp) * self.flange_from_tcp.inverse()
    }

    /// The joints along the move to each waypoint, at poses that divide it evenly, the last of them at the waypoint; none
    /// where the arm reaches none.
    pub fn motion(&self, waypoints: &[Waypoint]) -> Vec<Vec<Option<Joints>>> {
        let stations = moves::stations(waypoints);
        let way = self.follow(&stations);
        let mut moves = vec![Vec::new(); waypoints.len()];
        for (station, joints_rad) in stations.iter().zip(way.joints_rad) {
            moves[station.waypoint].push(joints_rad);
        }
        moves
    }

    fn follow(&self, stations: &[Station]) -> branch::Way {
        let poses: Vec<_> = stations.iter().map(|station| self.robot_from_flange(station)).collect();
        branch::follow(&self.arm, &poses)
    }

    fn joint_checks(&self, stations: &[Station], waypoints: usize, fully: bool) -> Vec<Option<JointCheck>> {
        let way = self.follow(stations);
        let indices: Vec<usize> = (0..stations.len()).collect();
        let single: Vec<Option<JointCheck>> = indices
            .par_iter()
            .map(|&i| {
                let joints = way.joints_rad[i]?;
                let before = i.checked_sub(1).and_then(|k| way.joints_rad[k]);
                Some(self.joint_check(joints, before, stations[i].time_s, way.step_rad[i], fully))
            })
            .collect();
        let mut merged: Vec<Option<Option<JointCheck>>> = vec![None; waypoints];
        for (station, now) in stations.iter().zip(single) {
            let slot = &mut merged[station.waypoint];
            *slot = Some(match slot.take() {
                None => now,
                Some(before) => before.zip(now).map(|(before, now)| before.worse(&now)),
            });
        }
        merged.into_iter().map(Option::flatten).collect()
    }

    fn joint_check(
        &self,
        joints: Joints,
        before: Option<Joints>,
        time_s: f64,
        step_rad: f64,
        fully: bool,
    ) -> JointCheck {
        let limits = &self.arm.limits;
        let margin_rad = (0..6).map(|j| limits.margin_rad(j, joints[j])).fold(f64::INFINITY, f64::min);
        let share = |before: Joints| {
            let speed = |j: usize| (joints[j] - before[j]).abs() / time_s / limits.speed_rad_s[j];
            (0..6).map(speed).fold(0.0, f64::max)
        };
        let speed_share = before.filter(|_| time_s > 0.0).map_or(0.0, share);
        let dexterity = if fully { self.arm.dexterity(&joints) } else { 1.0 };
        JointCheck { joints_rad: joints, margin_rad, dexterity, step_rad, speed_share }
    }
}

impl JointCheck {
    /// The worse of each number, and the joints of the later pose.
    fn worse(&self, later: &Self) -> Self {
        Self {
            joints_rad: later.joints_rad,
            margin_rad: self.margin_rad.min(later.margin_rad),
            dexterity: self.dexterity.min(later.dexterity),
            step_rad: self.step_rad.max(later.step_rad),
            speed_share: self.speed_share.max(later.speed_share),
        }
    }
}

#[cfg(test)]
mod tests;
