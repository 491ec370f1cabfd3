//! `feasibility.csv`: the joints and clearances at every waypoint; and what `summary.json` says of them.

use std::fmt::Write;

use serde::Serialize;

use crate::robot::feasibility::{Check, Report};
use weldpath_method::weld::program::Waypoint;

/// `feasibility` in `summary.json`.
#[derive(Debug, Serialize)]
pub struct FeasibilitySummary {
    robot: Option<String>,
    feasible: bool,
    least_limit_margin_deg: Option<f64>,
    least_dexterity: Option<f64>,
    largest_joint_speed_share: Option<f64>,
    least_clearance_mm: Option<f64>,
    floor_mm: Option<f64>,
    problems: Vec<Row>,
    suggestions: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Row {
    kind: &'static str,
    fatal: bool,
    seam: Option<usize>,
    first_waypoint: usize,
    last_waypoint: usize,
    worst: f64,
}

impl FeasibilitySummary {
    /// Of a report.
    pub fn new(report: &Report) -> Self {
        let joints = || report.checks.iter().filter_map(|check| check.joints);
        let row = |p: &crate::robot::feasibility::problem::Problem| Row {
            kind: p.kind.name(),
            fatal: p.kind.is_fatal(),
            seam: p.seam,
            first_waypoint: p.first,
            last_waypoint: p.last,
            worst: p.worst,
        };
        Self {
            robot: report.robot.clone(),
            feasible: report.is_feasible(),
            least_limit_margin_deg: joints().map(|j| j.margin_rad.to_degrees()).reduce(f64::min),
            least_dexterity: joints().map(|j| j.dexterity).reduce(f64::min),
            largest_joint_speed_share: joints().map(|j| j.speed_share).reduce(f64::max),
            least_clearance_mm: report.checks.iter().filter_map(|check| check.clearance_mm).reduce(f64::min),
            floor_mm: report.floor_mm,
            problems: report.problems.iter().map(row).collect(),
            suggestions: report.suggestions.iter().map(|suggestion| suggestion.words()).collect(),
        }
    }
}

/// The header of the file.
const HEADER: &str = "waypoint,seam,kind,reachable,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,limit_margin_deg,\
                      dexterity,joint_step_deg,joint_speed_share,clearance_mm\n";

/// One row per waypoint of `path.json`; what does not apply is empty.
pub fn csv(waypoints: &[Waypoint], report: &Report) -> String {
    let mut text = HEADER.to_owned();
    for (i, (waypoint, check)) in waypoints.iter().zip(&report.checks).enumerate() {
        let seam = waypoint.seam.map_or(String::new(), |seam| seam.to_string());
        let kind = serde_json::json!(waypoint.kind);
        let kind = kind.as_str().unwrap_or_default();
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{i},{seam},{kind},{}", numbers(check, report.robot.is_some()));
    }
    text
}

fn numbers(check: &Check, robot: bool) -> String {
    let clearance = check.clearance_mm.map_or(String::new(), |mm| format!("{mm:.2}"));
    match (&check.joints, robot) {
        (Some(joints), _) => {
            let angles = joints.joints_rad.map(|q| format!("{:.3}", q.to_degrees())).join(",");
            format!(
                "true,{angles},{:.2},{:.4},{:.3},{:.4},{clearance}",
                joints.margin_rad.to_degrees(),
                joints.dexterity,
                joints.step_rad.to_degrees(),
                joints.speed_share
            )
        }
        (None, true) => format!("false,,,,,,,,,,,{clearance}"),
        (None, false) => format!(",,,,,,,,,,,{clearance}"),
    }
}
