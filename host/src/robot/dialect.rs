//! Programs for robot controllers, one module per dialect. What each needs edited before it runs, and what has not
//! been tried: `docs/programs.md`.

pub mod fanuc;
pub mod krl;
pub mod moves;
pub mod rapid;
pub mod ros;
pub mod urscript;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::moves::TooLong;
use crate::files::File;
use crate::weld::program::Waypoint;

/// Whose program is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Robot {
    /// Universal Robots: URScript, path.script.
    #[default]
    Ur,
    /// ABB: RAPID, NAME.mod.
    Abb,
    /// KUKA: KRL, NAME.src and NAME.dat.
    Kuka,
    /// FANUC: TP listing, NAME.ls.
    Fanuc,
    /// ROS: geometry_msgs/PoseArray, poses.yaml and poses.json.
    Ros,
}

/// Everything the programs need beside the waypoints.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Of programs, and of the files of dialects in which the two are one.
    pub name: String,
    /// Number of the tool on controllers that number them; used where `tool` is none, and by FANUC always.
    pub tool_number: u32,
    /// Number of the weld data on controllers that keep it themselves.
    pub weld_schedule: u32,
    /// Tool, and how the arc is switched.
    pub controller: urscript::Settings,
}

/// The files of the program for `robot`.
pub fn files(robot: Robot, waypoints: &[Waypoint], settings: &Settings) -> Result<Vec<File>, TooLong> {
    Ok(match robot {
        Robot::Ur => vec![File::new("path.script", urscript::write(waypoints, &settings.controller))],
        Robot::Abb => rapid::write(waypoints, settings)?,
        Robot::Kuka => krl::write(waypoints, settings)?,
        Robot::Fanuc => fanuc::write(waypoints, settings)?,
        Robot::Ros => ros::write(waypoints),
    })
}

/// Name of part `index`, counted from 0, of a divided program.
pub(super) fn part_name(name: &str, index: usize) -> String {
    format!("{name}_{}", index + 1)
}
