//! How the arm stands along a program, as its controller counts joints, for the programs that say so.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Along a whole program: one continuous motion of the joints, on one branch within each weld.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedPosture {
    /// Whose controller counts the joints so. None: an arm of the job's own, whose joints count as its controller's.
    pub counted_by: Option<Maker>,
    /// At each waypoint.
    pub stances: Vec<Stance>,
    /// Where the program begins, degrees; none begins at the first waypoint, from wherever the arm stands.
    pub home_deg: Option<[f64; 6]>,
    /// What follows the last waypoint.
    pub end: ProgramEnd,
}

/// The arm at one waypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stance {
    /// As the controller counts them, whole turns included.
    pub joints_deg: [f64; 6],
    /// Joint 1 faces the wrist and not away from it.
    pub front: bool,
    /// The elbow is above the line from the shoulder to the wrist.
    pub elbow_up: bool,
}

/// What follows the last waypoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "EndSetting")]
pub enum ProgramEnd {
    /// The arm stays there.
    #[default]
    Stay,
    /// It goes home by joints.
    Home,
}

/// Who made an arm and its controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Maker {
    /// Universal Robots.
    UniversalRobots,
    /// ABB.
    Abb,
    /// KUKA.
    Kuka,
    /// FANUC.
    Fanuc,
}

impl Maker {
    /// As people write it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::UniversalRobots => "Universal Robots",
            Self::Abb => "ABB",
            Self::Kuka => "KUKA",
            Self::Fanuc => "FANUC",
        }
    }
}
