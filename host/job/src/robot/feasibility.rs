//! Whether an arm can run a program (not in the paper): reach, joint limits, singularities, joint speeds, and torch and links
//! against the scanned points, the floor and each other. A whole program is feasible if one continuous motion of the joints
//! runs it.
//!
//! Millimetres and radians; the scan's base frame unless a name says otherwise. No replacement for the controller's own
//! simulation: links have nominal sizes, and external axes and what was not scanned are not looked at.

pub mod arm;
pub mod body;
mod branch;
pub mod catalogue;
pub mod chain;
pub mod links;
mod moves;
pub mod offset_wrist;
pub mod problem;
pub mod spherical_wrist;
pub mod suggestion;
pub mod torch;

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion};
use rayon::prelude::*;

use super::posture::{PlannedPosture, ProgramEnd};
use arm::{Arm, Joints};
use branch::Way;
use links::{Links, Touch};
use moves::Station;
use problem::{Problem, ProblemKind};
use suggestion::{Rewelded, Suggestion};
use torch::Torch;
use weldpath_method::geometry::surface::Surface;
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
    /// Below which no link may go.
    pub floor: Floor,
    /// Where the program begins; none begins at the first waypoint, from wherever the arm stands.
    pub home_rad: Option<Joints>,
    /// What follows the last waypoint.
    pub end: ProgramEnd,
}

/// The floor under an arm, in the scan's base frame, whose z points up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Floor {
    /// What the arm is mounted on, or the lowest scanned place if that is lower.
    #[default]
    Mounting,
    /// At this height, mm.
    At(f64),
    /// None, as the job says.
    None,
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
    /// The deepest touch of a link on the move.
    pub touch: Option<Touch>,
    /// How the arm stands there that nobody would have it stand.
    pub odd: Option<Oddity>,
}

/// Why nobody would have an arm stand so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Oddity {
    /// The elbow hangs below the line from shoulder to wrist.
    ElbowBelow,
    /// It reaches backwards over itself.
    ReachesBack,
    /// The wrist is bent by less than 10 degrees.
    WristStraight,
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
    /// The joints along the move to each waypoint, at poses that divide it evenly, the last of them at the waypoint; none
    /// where the arm reaches none. Empty without an arm.
    pub motion: Vec<Vec<Option<Joints>>>,
    /// Height of the floor that the links were held against, mm.
    pub floor_mm: Option<f64>,
    /// For the robot's program, where every waypoint is reached and it is known how the controller counts the joints.
    pub posture: Option<PlannedPosture>,
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
pub(crate) fn assess(program: &Rewelded, work: &Surface, setup: &FeasibilitySetup) -> Report {
    judged(&program(&[]), work, setup, |checker, problems| suggestion::tried(checker, program, problems))
}

/// Checks a program that cannot be made anew: no change is tried.
pub(crate) fn assess_as_it_is(waypoints: &[Waypoint], work: &Surface, setup: &FeasibilitySetup) -> Report {
    judged(waypoints, work, setup, |_, _| Vec::new())
}

fn judged(
    waypoints: &[Waypoint],
    work: &Surface,
    setup: &FeasibilitySetup,
    suggest: impl FnOnce(&Checker<'_>, &[Problem]) -> Vec<Suggestion>,
) -> Report {
    let checker = Checker::new(setup, work);
    let stations = moves::stations(waypoints);
    let way = checker.links.as_ref().map(|links| links.follow(&stations));
    let checks = checker.checks(&stations, waypoints.len(), way.as_ref(), Depth::Full);
    let mut problems = checker.problems(waypoints, &checks);
    problems.extend(checker.ways_of_home(waypoints, &checks));
    if let Some(robot) = &setup.robot {
        problem::tell_shifts(&mut problems, waypoints, robot);
    }
    let suggestions = suggest(&checker, &problems);
    let links = checker.links.as_ref();
    Report {
        robot: links.map(|links| links.robot.arm.name.clone()),
        floor_mm: links.and_then(|links| links.floor_mm),
        posture: links.and_then(|links| links.posture(&checks)),
        motion: way.map(|way| motion(&stations, way, waypoints.len())).unwrap_or_default(),
        checks,
        problems,
        suggestions,
    }
}

/// Where the torch alone would touch what was scanned; nothing else is looked at, and nothing is tried.
pub(crate) fn collisions(waypoints: &[Waypoint], work: &Surface, torch: Torch) -> Vec<Problem> {
    let setup = FeasibilitySetup { robot: None, torch, clearance_mm: 0.0 };
    let checker = Checker::new(&setup, work);
    checker.problems(waypoints, &checker.checked(waypoints, Depth::Fatal))
}

fn motion(stations: &[Station], way: Way, waypoints: usize) -> Vec<Vec<Option<Joints>>> {
    let mut moves = vec![Vec::new(); waypoints];
    for (station, joints_rad) in stations.iter().zip(way.joints_rad) {
        moves[station.waypoint].push(joints_rad);
    }
    moves
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
    work: &'a Surface,
    links: Option<Links<'a>>,
}

impl<'a> Checker<'a> {
    fn new(setup: &'a FeasibilitySetup, work: &'a Surface) -> Self {
        let links = setup.robot.as_ref().map(|robot| Links::new(robot, &setup.torch, work));
        Self { setup, work, links }
    }

    /// One check per waypoint, of everything that `depth` asks for.
    fn checked(&self, waypoints: &[Waypoint], depth: Depth) -> Vec<Check> {
        let stations = moves::stations(waypoints);
        let way = self.links.as_ref().map(|links| links.follow(&stations));
        self.checks(&stations, waypoints.len(), way.as_ref(), depth)
    }

    fn checks(&self, stations: &[Station], waypoints: usize, way: Option<&Way>, depth: Depth) -> Vec<Check> {
        let mut checks = vec![Check::default(); waypoints];
        if depth != Depth::Joints {
            let clearances: Vec<Option<f64>> =
                stations.par_iter().map(|station| self.clearance_mm(station)).collect();
            for (station, clearance_mm) in stations.iter().zip(clearances) {
                let check = &mut checks[station.waypoint];
                check.clearance_mm =
                    [check.clearance_mm, clearance_mm].into_iter().flatten().reduce(f64::min);
            }
        }
        if let (Some(links), Some(way)) = (&self.links, way) {
            let joints = links.joint_checks(stations, way, waypoints, depth == Depth::Full);
            for (check, joints) in checks.iter_mut().zip(joints) {
                check.joints = joints;
            }
        }
        checks
    }

    fn problems(&self, waypoints: &[Waypoint], checks: &[Check]) -> Vec<Problem> {
        problem::found(waypoints, checks, self.setup)
    }

    fn clearance_mm(&self, station: &Station) -> Option<f64> {
        self.setup.torch.clearance_mm(self.work, &station.tip_mm, &station.base_from_torch)
    }

    /// What stands in the way from home to the first waypoint, and from the last to home.
    fn ways_of_home(&self, waypoints: &[Waypoint], checks: &[Check]) -> Vec<Problem> {
        let Some((links, home_rad)) = self.links.as_ref().and_then(|l| Some((l, l.robot.home_rad?))) else {
            return Vec::new();
        };
        let last = waypoints.len().saturating_sub(1);
        let returns = links.robot.end == ProgramEnd::Home;
        let ends =
            std::iter::once((0, ProblemKind::FromHome)).chain(returns.then_some((last, ProblemKind::ToHome)));
        let problem = |(waypoint, kind): (usize, ProblemKind)| {
            let joints_rad = checks.get(waypoint)?.joints?.joints_rad;
            let touch = self.touch_between(links, &home_rad, &joints_rad)?;
            let seam = waypoints[waypoint].seam;
            let worst = -touch.depth_mm;
            Some(Problem {
                kind,
                seam,
                first: waypoint,
                last: waypoint,
                along_mm: None,
                worst,
                touch: Some(touch),
                odd: None,
                shift_mm: None,
            })
        };
        ends.filter_map(problem).collect()
    }

    /// The deepest touch of links and torch while all joints turn evenly.
    fn touch_between(&self, links: &Links, from: &Joints, to: &Joints) -> Option<Touch> {
        let steps = links.steps_between(from, to);
        let touches = (0..=steps).into_par_iter().filter_map(|k| {
            let joints_rad = links::between(from, to, k as f64 / steps as f64);
            let torch = self.clearance_mm(&links.station(&joints_rad)).filter(|mm| *mm < 0.0);
            let torch = torch.map(|mm| Touch {
                link: links::TORCH_LINK,
                obstacle: links::Obstacle::Work,
                depth_mm: -mm,
            });
            links::deepest(links.touch(&joints_rad).into_iter().chain(torch))
        });
        links::deepest(touches.collect::<Vec<_>>())
    }
}

/// `Rot(m, 180°)`: a tool's z points into the work, the torch's n out of it.
fn torch_from_tool() -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 1.0, 0.0))
}

impl PlacedArm {
    /// The flange in the robot's own base frame when the tip is at a station.
    fn robot_from_flange(&self, station: &Station) -> Isometry3<f64> {
        self.flange_with(station.tip_mm, station.base_from_torch)
    }

    /// The same at a waypoint.
    fn flange_at(&self, waypoint: &Waypoint) -> Isometry3<f64> {
        self.flange_with(waypoint.position_mm, waypoint.base_from_torch)
    }

    fn flange_with(&self, tip_mm: Point3<f64>, base_from_torch: UnitQuaternion<f64>) -> Isometry3<f64> {
        let base_from_tcp = Isometry3::from_parts(tip_mm.into(), base_from_torch * torch_from_tool());
        self.base_from_robot.inv_mul(&base_from_tcp) * self.flange_from_tcp.inverse()
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
            touch: links::deepest(self.touch.into_iter().chain(later.touch)),
            odd: self.odd.or(later.odd),
        }
    }
}

#[cfg(test)]
mod tests;
