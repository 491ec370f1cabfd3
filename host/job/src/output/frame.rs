//! Whose frame the poses and positions of a run are in: a label that every file of it carries.

use serde::{Deserialize, Serialize};

/// Whose frame the poses and positions of a run are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathFrame {
    /// The robot's base.
    Base,
    /// That of the camera that took the cloud: nothing says where the robot is.
    Camera,
    /// Nothing says whose.
    #[default]
    Unknown,
}

impl PathFrame {
    /// The name used in every file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Camera => "camera",
            Self::Unknown => "unknown",
        }
    }
}
