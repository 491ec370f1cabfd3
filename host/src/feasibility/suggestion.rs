//! Changes that make an infeasible program feasible: each one is tried on the whole program before it is told.

use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::problem::{self, Kind, Problem};
use super::{Checker, Depth};
use crate::toolpath::program::Waypoint;
use crate::toolpath::{PathPoint, SeamPath};

/// A change of one seam's path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// The torch turned about its own axis `n`, degrees.
    Turn(f64),
    /// The other travel direction.
    Reverse,
    /// The other travel direction, with the torch then turned about its own axis, degrees.
    ReverseAndTurn(f64),
    /// The torch tilted about the travel direction `m`, degrees.
    WorkAngle(f64),
}

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
    /// The path with the change; the tip stays on the seam.
    pub fn applied(&self, path: &SeamPath) -> SeamPath {
        match *self {
            Self::Turn(deg) => {
                turned(path, &UnitQuaternion::from_axis_angle(&Vector3::z_axis(), deg.to_radians()))
            }
            Self::WorkAngle(deg) => {
                turned(path, &UnitQuaternion::from_axis_angle(&Vector3::y_axis(), deg.to_radians()))
            }
            Self::Reverse => reversed(path),
            Self::ReverseAndTurn(deg) => Self::Turn(deg).applied(&reversed(path)),
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

fn turned(path: &SeamPath, by: &UnitQuaternion<f64>) -> SeamPath {
    let point = |point: &PathPoint| PathPoint { base_from_torch: point.base_from_torch * by, ..*point };
    SeamPath { seam: path.seam, points: path.points.iter().map(point).collect() }
}

fn reversed(path: &SeamPath) -> SeamPath {
    let length_mm = path.points.last().map_or(0.0, |last| last.s_mm);
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    let mut back = turned(path, &half_turn);
    back.points.reverse();
    back.points.iter_mut().for_each(|point| point.s_mm = length_mm - point.s_mm);
    back
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
pub(super) fn tried(
    checker: &Checker<'_>,
    paths: &[SeamPath],
    program: &(dyn Fn(&[SeamPath]) -> Vec<Waypoint> + Sync),
    problems: &[Problem],
) -> Vec<Suggestion> {
    let mut current = paths.to_vec();
    let mut standing: Vec<Problem> = fatal(problems.to_vec());
    let mut suggestions = Vec::new();
    for k in 0..paths.len() {
        let seam = paths[k].seam;
        let own: Vec<&Problem> = standing.iter().filter(|p| p.seam == Some(seam)).collect();
        if own.is_empty() {
            continue;
        }
        let torch_only = own.iter().all(|p| p.kind == Kind::Collision);
        let straight = checker.setup.torch.neck_deg == 0.0;
        let others = standing.len() - own.len();
        let outcome = changes(torch_only, straight).into_par_iter().find_map_first(|change| {
            let mut paths = current.clone();
            paths[k] = change.applied(&paths[k]);
            let waypoints = program(&paths);
            let own = problem::block(&waypoints, seam);
            let of = |waypoints: &[Waypoint], depth| {
                fatal(checker.problems(waypoints, &checker.checks(waypoints, depth)))
            };
            if !of(&waypoints[own], Depth::Fatal).is_empty() {
                return None;
            }
            // The torch of the other seams is where it was; their joints may not be.
            let mut left = of(&waypoints, Depth::Joints);
            left.extend(
                standing.iter().filter(|p| p.kind == Kind::Collision && p.seam != Some(seam)).cloned(),
            );
            let solves = left.iter().all(|p| p.seam != Some(seam)) && left.len() <= others;
            solves.then_some((change, paths, left))
        });
        if let Some((change, paths, left)) = outcome {
            suggestions.push(Suggestion { seam, change, solves_all: false });
            (current, standing) = (paths, left);
        }
    }
    if let (true, Some(last)) = (standing.is_empty(), suggestions.last_mut()) {
        last.solves_all = true;
    }
    suggestions
}

fn fatal(mut problems: Vec<Problem>) -> Vec<Problem> {
    problems.retain(|problem| problem.kind.is_fatal());
    problems
}
