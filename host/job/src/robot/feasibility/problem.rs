//! What stands against running a program, seam by seam, in words.

use nalgebra::{Translation3, Vector2};

use super::links::{Obstacle, Touch, deepest};
use super::{Check, FeasibilitySetup, Oddity, PlacedArm, branch};
use weldpath_method::weld::program::Waypoint;

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ProblemKind {
    /// No joint angles bring the flange there.
    OutOfReach,
    /// A joint would leave its range.
    Limit,
    /// The joints would have to jump to another branch amid the program.
    Jump,
    /// A joint would turn faster than it can at the feed.
    Speed,
    /// The torch is inside what was scanned.
    Collision,
    /// A link is inside something, or the torch inside a link or the floor.
    LinkCollision,
    /// Something is touched on the way by joints from home to the first waypoint.
    FromHome,
    /// Something is touched on the way by joints from the last waypoint to home.
    ToHome,
    /// The arm stands as nobody would have it stand, and no other way of standing is free.
    OddPosture,
    /// The arm is near a singularity.
    Singular,
    /// The torch comes nearer to what was scanned than it should.
    Close,
}

impl ProblemKind {
    /// Whether the program cannot be run as it is.
    pub(crate) fn is_fatal(self) -> bool {
        !matches!(self, Self::Singular | Self::Close | Self::OddPosture)
    }

    /// Name in `summary.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::OutOfReach => "out-of-reach",
            Self::Limit => "joint-limit",
            Self::Jump => "jump",
            Self::Speed => "joint-speed",
            Self::Collision => "collision",
            Self::LinkCollision => "link-collision",
            Self::FromHome => "from-home",
            Self::ToHome => "to-home",
            Self::OddPosture => "odd-posture",
            Self::Singular => "singularity",
            Self::Close => "clearance",
        }
    }
}

/// One thing that is wrong on a run of waypoints.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    /// What.
    pub kind: ProblemKind,
    /// The seam whose waypoints these are; for air moves the seam they lead to, or come from at the end.
    pub seam: Option<usize>,
    /// First waypoint, counted from 0 in `path.json`.
    pub first: usize,
    /// Last waypoint.
    pub last: usize,
    /// From where to where along the seam, mm; none if nothing is welded between them.
    pub along_mm: Option<[f64; 2]>,
    /// How bad at the worst: mm from the origin of the robot's base, degrees, share of the speed, dexterity, or mm of clearance.
    pub worst: f64,
    /// What touches what, where it is worst.
    pub touch: Option<Touch>,
    /// What is odd about how the arm stands.
    pub odd: Option<Oddity>,
    /// By how much the part would have to be farther from the arm's base for all of it to be in reach, mm; negative if nearer.
    pub shift_mm: Option<f64>,
}

/// Below this [`super::arm::Arm::dexterity`] an arm counts as near a singularity: a wrist bent by less than about 5 degrees.
const SINGULAR: f64 = 0.012;
/// Runs of one kind with at most this many good waypoints between them are one run.
const MERGED: usize = 5;

/// All problems, by waypoint and kind.
pub(super) fn found(waypoints: &[Waypoint], checks: &[Check], setup: &FeasibilitySetup) -> Vec<Problem> {
    let owners = owners(waypoints);
    let mut problems: Vec<Problem> = Vec::new();
    for (i, check) in checks.iter().enumerate() {
        let touch = check.joints.and_then(|joints| joints.touch);
        let odd = check.joints.and_then(|joints| joints.odd);
        for (kind, worst) in faults(&waypoints[i], check, setup) {
            let touch = touch.filter(|_| kind == ProblemKind::LinkCollision);
            let odd = odd.filter(|_| kind == ProblemKind::OddPosture);
            let same = |p: &&mut Problem| p.kind == kind && p.seam == owners[i] && i <= p.last + 1 + MERGED;
            match problems.iter_mut().rev().find(same) {
                Some(known) => {
                    known.last = i;
                    known.worst =
                        if kind.more_is_worse() { known.worst.max(worst) } else { known.worst.min(worst) };
                    known.touch = deepest(known.touch.into_iter().chain(touch));
                }
                None => {
                    let seam = owners[i];
                    problems.push(Problem {
                        kind,
                        seam,
                        first: i,
                        last: i,
                        along_mm: None,
                        worst,
                        touch,
                        odd,
                        shift_mm: None,
                    })
                }
            }
        }
    }
    let collisions: Vec<Problem> =
        problems.iter().filter(|p| p.kind == ProblemKind::Collision).cloned().collect();
    // Of a program that the arm cannot run nobody asks how it stands.
    if problems.iter().any(|p| p.kind.is_fatal() && p.kind != ProblemKind::Collision) {
        problems.retain(|p| p.kind != ProblemKind::OddPosture);
    }
    problems
        .retain(|p| p.kind != ProblemKind::Close || !collisions.iter().any(|collision| p.adjoins(collision)));
    let along = along_mm(waypoints);
    for problem in &mut problems {
        let welded = || along[problem.first..=problem.last].iter().copied().flatten();
        let least = welded().reduce(f64::min);
        problem.along_mm = least.zip(welded().reduce(f64::max)).map(|(from, to)| [from, to]);
    }
    problems
}

/// How far along its seam each welded waypoint is, mm: of each pass from its own start, across what a stitch leaves out.
fn along_mm(waypoints: &[Waypoint]) -> Vec<Option<f64>> {
    let mut before: Option<(&Waypoint, f64)> = None;
    let mut all = Vec::with_capacity(waypoints.len());
    for here in waypoints {
        // A pass ends where the torch goes through the air.
        before = before.filter(|(last, _)| here.seam.is_some() && last.seam == here.seam);
        if here.weld {
            let step_mm = |(last, mm): (&Waypoint, f64)| mm + (here.position_mm - last.position_mm).norm();
            before = Some((here, before.map_or(0.0, step_mm)));
        }
        all.push(before.filter(|_| here.weld).map(|(_, mm)| mm));
    }
    all
}

/// So far a part may be moved to bring it into reach, mm; and how exactly that is told.
const MOST_SHIFT_MM: i32 = 3000;
const SHIFT_STEP_MM: i32 = 10;

/// Says of what is out of reach how far the part would have to be moved: of what is told, and not of each trial.
pub(super) fn tell_shifts(problems: &mut [Problem], waypoints: &[Waypoint], robot: &PlacedArm) {
    for problem in problems.iter_mut().filter(|problem| problem.kind == ProblemKind::OutOfReach) {
        problem.shift_mm = shift_mm(robot, &waypoints[problem.first..=problem.last]);
    }
}

/// The least way, level and straight from the arm's base (or toward it), that brings all waypoints into reach.
fn shift_mm(robot: &PlacedArm, waypoints: &[Waypoint]) -> Option<f64> {
    let flanges: Vec<_> = waypoints.iter().map(|waypoint| robot.flange_at(waypoint)).collect();
    // Toward the tips, as a person would move the part: the flanges may lean aside.
    let tips = waypoints.iter().map(|waypoint| robot.base_from_robot.inverse() * waypoint.position_mm);
    let away = tips.map(|tip| tip.coords.xy()).sum::<Vector2<f64>>().try_normalize(1e-9)?;
    // What was out of reach a step before mostly is so again: it is asked first.
    let mut hardest = 0;
    let is_reached = |mm: &i32| {
        let by = Translation3::from((away * f64::from(*mm)).push(0.0));
        let is_missed = |k: &usize| robot.arm.inverse(&(by * flanges[*k])).is_empty();
        let missed = std::iter::once(hardest).chain(0..flanges.len()).find(is_missed);
        hardest = missed.unwrap_or(hardest);
        missed.is_none()
    };
    let steps = (SHIFT_STEP_MM..=MOST_SHIFT_MM).step_by(SHIFT_STEP_MM as usize);
    steps.flat_map(|mm| [-mm, mm]).find(is_reached).map(f64::from)
}

/// The seam of each waypoint, air moves included.
fn owners(waypoints: &[Waypoint]) -> Vec<Option<usize>> {
    let mut owners: Vec<Option<usize>> = waypoints.iter().map(|waypoint| waypoint.seam).collect();
    let mut next = owners.iter().rev().copied().flatten().next();
    for owner in owners.iter_mut().rev() {
        next = owner.or(next);
        *owner = next;
    }
    owners
}

/// The waypoints of one seam, with the air moves that lead to it.
pub(super) fn block(waypoints: &[Waypoint], seam: usize) -> std::ops::Range<usize> {
    let owners = owners(waypoints);
    let first = owners.iter().position(|owner| *owner == Some(seam)).unwrap_or(0);
    let last = owners.iter().rposition(|owner| *owner == Some(seam));
    first..last.map_or(first, |last| last + 1)
}

fn faults(waypoint: &Waypoint, check: &Check, setup: &FeasibilitySetup) -> Vec<(ProblemKind, f64)> {
    let mut faults = Vec::new();
    match (&setup.robot, &check.joints) {
        (Some(robot), None) => {
            let from_base = robot.base_from_robot.inverse() * waypoint.position_mm;
            faults.push((ProblemKind::OutOfReach, from_base.coords.norm()));
        }
        (Some(_), Some(joints)) => {
            let jumps = joints.step_rad > branch::JUMP_RAD;
            let rules = [
                (ProblemKind::Limit, joints.margin_rad < 0.0, joints.margin_rad.to_degrees()),
                (ProblemKind::Jump, jumps, joints.step_rad.to_degrees()),
                (ProblemKind::Speed, !jumps && joints.speed_share > 1.0, joints.speed_share),
                (ProblemKind::Singular, joints.dexterity < SINGULAR, joints.dexterity),
            ];
            let touch = joints.touch.map(|touch| (ProblemKind::LinkCollision, -touch.depth_mm));
            // A straight wrist is told as a singularity where it is one.
            let odd = joints.odd.map(|_| (ProblemKind::OddPosture, 0.0));
            faults.extend(touch.into_iter().chain(odd));
            faults.extend(rules.into_iter().filter(|rule| rule.1).map(|(kind, _, worst)| (kind, worst)));
        }
        (None, _) => {}
    }
    match check.clearance_mm {
        Some(clearance_mm) if clearance_mm < 0.0 => faults.push((ProblemKind::Collision, clearance_mm)),
        Some(clearance_mm) if clearance_mm < setup.clearance_mm => {
            faults.push((ProblemKind::Close, clearance_mm))
        }
        _ => {}
    }
    faults
}

impl ProblemKind {
    fn more_is_worse(self) -> bool {
        matches!(self, Self::OutOfReach | Self::Jump | Self::Speed)
    }
}

impl Touch {
    fn words(self, arm: &str) -> String {
        let Self { link, obstacle, depth_mm } = self;
        let what = match obstacle {
            Obstacle::Floor => "below the floor".to_owned(),
            Obstacle::Work => "inside what was scanned".to_owned(),
            Obstacle::Torch => "inside the torch".to_owned(),
            Obstacle::Link(other) => format!("inside its {}", other.name),
        };
        format!("the {} of {arm} is up to {depth_mm:.1} mm {what}", link.name)
    }
}

impl Oddity {
    fn words(self) -> &'static str {
        match self {
            Self::ElbowBelow => "hangs its elbow below the line from shoulder to wrist",
            Self::ReachesBack => "reaches backwards over itself",
            Self::WristStraight => "has its wrist nearly straight",
        }
    }
}

impl Problem {
    /// Whether two runs overlap or nearly touch.
    fn adjoins(&self, other: &Self) -> bool {
        self.first <= other.last + 1 + MERGED && other.first <= self.last + 1 + MERGED
    }

    /// What the words say in numbers.
    pub(crate) fn values(&self) -> Vec<(&'static str, f64)> {
        let worst = self.worst;
        let waypoints = [("first_waypoint", self.first as f64), ("last_waypoint", self.last as f64)];
        let measured = match self.kind {
            ProblemKind::OutOfReach => Some(("distance_mm", worst)),
            ProblemKind::Limit => Some(("over_deg", -worst)),
            ProblemKind::Jump => Some(("jump_deg", worst)),
            ProblemKind::Speed => Some(("speed_share", worst)),
            ProblemKind::Collision
            | ProblemKind::LinkCollision
            | ProblemKind::FromHome
            | ProblemKind::ToHome => Some(("inside_mm", -worst)),
            ProblemKind::Singular => Some(("dexterity", worst)),
            ProblemKind::Close => Some(("clearance_mm", worst)),
            ProblemKind::OddPosture => None,
        };
        let shift = self.shift_mm.map(|mm| ("shift_mm", mm));
        waypoints.into_iter().chain(measured).chain(shift).collect()
    }

    fn shift_words(&self) -> String {
        match self.shift_mm {
            Some(mm) if mm < 0.0 => format!("too far: it would have to be {:.0} mm nearer", -mm),
            Some(mm) => format!("too near: it would have to be {mm:.0} mm farther away"),
            None => "nor at any other distance".into(),
        }
    }

    /// The seam, from where to where along it, and the waypoints.
    fn place(&self) -> String {
        let waypoints = match self.first == self.last {
            true => format!("waypoint {}", self.first),
            false => format!("waypoints {} to {}", self.first, self.last),
        };
        match (self.seam, self.along_mm) {
            (Some(seam), Some([from, to])) if to - from < 1.0 => {
                format!("seam {seam}, {from:.0} mm along it ({waypoints})")
            }
            (Some(seam), Some([from, to])) => {
                format!("seam {seam}, {from:.0} to {to:.0} mm along it ({waypoints})")
            }
            (Some(seam), None) => format!("seam {seam}, on the way to it or from it ({waypoints})"),
            (None, _) => waypoints,
        }
    }

    /// A sentence that names the place and what to do.
    pub fn words(&self, arm: &str) -> String {
        let place = self.place();
        let worst = self.worst;
        let what = match self.kind {
            ProblemKind::OutOfReach => format!(
                "no posture of {arm} brings the torch there, {} (the tip is up to {worst:.0} mm from the robot's base): move the \
                 part or the robot, or check [robot] and [tool] in the job file",
                self.shift_words()
            ),
            ProblemKind::Limit => format!(
                "a joint of {arm} would leave its range by {:.0} degrees: turn the torch about its axis, or move the part",
                -worst
            ),
            ProblemKind::Jump => format!(
                "the joints of {arm} would have to jump by {worst:.0} degrees: no single posture runs the program; turn the \
                 torch about its axis, or weld the seams in separate programs"
            ),
            ProblemKind::Speed => format!(
                "a joint of {arm} would have to turn at {:.0} % of its greatest speed, the arm passes a singularity: turn \
                 the torch about its axis, or lower the feed",
                100.0 * worst
            ),
            ProblemKind::Collision => format!(
                "the torch is up to {:.1} mm inside what was scanned: change the work angle, use a smaller nozzle or a \
                 longer stick-out, or check [torch_body] in the job file",
                -worst
            ),
            ProblemKind::LinkCollision => format!(
                "{}: move the part or the robot, turn the torch about its axis, or check [robot] floor_z_mm and base_mm in \
                 the job file",
                self.touch.map(|touch| touch.words(arm)).unwrap_or_default()
            ),
            ProblemKind::FromHome | ProblemKind::ToHome => format!(
                "on the way by joints {} {}: choose another [robot] home_deg",
                if self.kind == ProblemKind::FromHome {
                    "from home to the first waypoint"
                } else {
                    "back home"
                },
                self.touch.map(|touch| touch.words(arm)).unwrap_or_default()
            ),
            ProblemKind::OddPosture => format!(
                "{arm} {}, because no other posture is free along the whole program: check it in the controller's simulation, or \
                 move the part or the robot",
                self.odd.map(Oddity::words).unwrap_or_default()
            ),
            ProblemKind::Singular => format!(
                "{arm} is near a singularity (dexterity {worst:.3}): the joints turn fast and the tip may deviate; turn the \
                 torch about its axis"
            ),
            ProblemKind::Close => {
                format!("the torch comes as near as {worst:.1} mm to what was scanned: watch it in a dry run")
            }
        };
        format!("{place}: {what}")
    }
}
