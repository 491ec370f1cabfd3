//! Changes that make an infeasible program feasible: each one is tried on the whole program before it is told.

use rayon::prelude::*;

use super::problem::{self, Problem, ProblemKind};
use super::{Checker, Depth};
use weldpath_method::weld::program::Waypoint;
use weldpath_method::weld::recipe::Recipe;

/// A change of how one seam is welded, in all of its passes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// This much more turn about the torch axis, degrees.
    Turn(f64),
    /// The other travel direction.
    Reverse,
    /// The other travel direction, with the torch then turned about its own axis, degrees.
    ReverseAndTurn(f64),
    /// This much more work angle, degrees.
    WorkAngle(f64),
}

/// The whole program, with these changes of the seams that are named by [`weldpath_method::seam::Seam::id`].
pub type Rewelded<'a> = dyn Fn(&[(usize, Change)]) -> Vec<Waypoint> + Sync + 'a;

/// A change that was tried on the whole program.
#[derive(Debug, Clone, PartialEq)]
pub struct Suggestion {
    /// Which seam to change.
    pub seam: usize,
    /// How.
    pub change: Change,
    /// Whether the whole program is feasible with this and the suggestions before it.
    pub solves_all: bool,
}

impl Change {
    /// Whether the line is welded from its other end.
    pub(crate) fn reverses(self) -> bool {
        matches!(self, Self::Reverse | Self::ReverseAndTurn(_))
    }

    /// What a pass of the seam is then welded by.
    pub fn on(self, recipe: Recipe) -> Recipe {
        match self {
            Self::Turn(deg) | Self::ReverseAndTurn(deg) => {
                Recipe { turn_rad: recipe.turn_rad + deg.to_radians(), ..recipe }
            }
            Self::WorkAngle(deg) => {
                Recipe { work_angle_rad: recipe.work_angle_rad + deg.to_radians(), ..recipe }
            }
            Self::Reverse => recipe,
        }
    }

    fn words(&self) -> String {
        match self {
            Self::Turn(deg) => format!("turn the torch about its axis by {deg:.0} degrees"),
            Self::Reverse => "weld it in the other direction".into(),
            Self::ReverseAndTurn(deg) => {
                format!(
                    "weld it in the other direction and turn the torch about its axis by {deg:.0} degrees"
                )
            }
            Self::WorkAngle(deg) => format!("change the work angle by {deg:.0} degrees"),
        }
    }
}

impl Suggestion {
    /// A sentence.
    pub fn words(&self) -> String {
        let outcome = if self.solves_all {
            "tried: the whole program is then feasible"
        } else {
            "tried: this seam is then feasible, others are not yet"
        };
        format!("seam {}: {} ({outcome})", self.seam, self.change.words())
    }
}

/// From the smallest change to the largest.
fn changes(torch_only: bool, straight: bool) -> Vec<Change> {
    let both = |deg: f64| [deg, -deg];
    let tilts = [5.0, 10.0, 15.0, 20.0].into_iter().flat_map(both).map(Change::WorkAngle);
    let turns = || (1..12).map(|k| 15.0 * f64::from(k)).flat_map(both).chain([180.0]);
    match (torch_only, straight) {
        // A straight torch is the same whichever way it is turned.
        (true, true) => tilts.collect(),
        _ => std::iter::once(Change::Reverse)
            .chain(turns().map(Change::Turn))
            .chain(tilts)
            .chain(turns().map(Change::ReverseAndTurn))
            .collect(),
    }
}

/// For each seam with a fatal problem the first change that leaves it without one and makes no other seam worse.
pub(super) fn tried(checker: &Checker<'_>, program: &Rewelded, problems: &[Problem]) -> Vec<Suggestion> {
    let mut current: Vec<(usize, Change)> = Vec::new();
    let mut standing: Vec<Problem> = fatal(problems.to_vec());
    let mut seams: Vec<usize> = standing.iter().filter_map(|problem| problem.seam).collect();
    seams.sort_unstable();
    seams.dedup();
    for seam in seams {
        let own: Vec<&Problem> = standing.iter().filter(|p| p.seam == Some(seam)).collect();
        if own.is_empty() {
            continue;
        }
        let torch_only = own.iter().all(|p| p.kind == ProblemKind::Collision);
        let straight = checker.setup.torch.neck_deg == 0.0;
        let others = standing.len() - own.len();
        let outcome = changes(torch_only, straight).into_par_iter().find_map_first(|change| {
            let waypoints = program(&[current.as_slice(), &[(seam, change)]].concat());
            let own = problem::block(&waypoints, seam);
            let of = |waypoints: &[Waypoint], depth| {
                fatal(checker.problems(waypoints, &checker.checked(waypoints, depth)))
            };
            if !of(&waypoints[own], Depth::Fatal).is_empty() {
                return None;
            }
            // The torch of the other seams is where it was; their joints may not be.
            let mut left = of(&waypoints, Depth::Joints);
            left.extend(
                standing.iter().filter(|p| p.kind == ProblemKind::Collision && p.seam != Some(seam)).cloned(),
            );
            let solves = left.iter().all(|p| p.seam != Some(seam)) && left.len() <= others;
            solves.then_some((change, left))
        });
        if let Some((change, left)) = outcome {
            current.push((seam, change));
            standing = left;
        }
    }
    let all = standing.is_empty();
    let last = current.len().saturating_sub(1);
    let told = |(k, (seam, change))| Suggestion { seam, change, solves_all: all && k == last };
    current.into_iter().enumerate().map(told).collect()
}

fn fatal(mut problems: Vec<Problem>) -> Vec<Problem> {
    problems.retain(|problem| problem.kind.is_fatal());
    problems
}
