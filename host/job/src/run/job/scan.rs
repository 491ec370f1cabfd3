//! `[scan]`: how exact the robot's poses and the hand-eye transform are, which nobody but the user can know.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::calibration::CalibrationSettings;
use super::quantity::{HandEyeDeg, HandEyeMm, RobotDeg, RobotMm};
use weldpath_method::pipeline::{Anchor, CellAccuracy};

/// `[scan]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ScanSettings {
    /// What holds the model in the robot's base frame.
    pub anchor: AnchorName,
    /// One standard deviation of a position that the robot reports, each axis.
    pub robot_mm: RobotMm,
    /// The same of its orientation.
    pub robot_deg: RobotDeg,
    /// One standard deviation of the camera's position on the flange, each axis.
    pub hand_eye_mm: HandEyeMm,
    /// The same of its orientation.
    pub hand_eye_deg: HandEyeDeg,
    /// What `weldpath calibrate` found, in place of the two above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationSettings>,
}

/// What holds the model in the robot's base frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum AnchorName {
    /// All reported poses, weighted by the robot's accuracy, and the hand-eye transform as far as the views support it.
    #[default]
    Robot,
    /// The first view that fits; its pose is taken as exact.
    First,
}

impl ScanSettings {
    /// As the pipeline takes it.
    pub fn anchor(&self) -> Anchor {
        match self.anchor {
            AnchorName::First => Anchor::First,
            AnchorName::Robot => Anchor::Cell(self.cell()),
        }
    }

    /// How exact the cell is stated to be.
    pub fn cell(&self) -> CellAccuracy {
        CellAccuracy {
            robot_mm: self.robot_mm.get(),
            robot_deg: self.robot_deg.get(),
            hand_eye_mm: self.hand_eye_mm.get(),
            hand_eye_deg: self.hand_eye_deg.get(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_those_of_the_pipeline() {
        assert_eq!(ScanSettings::default().anchor(), Anchor::default());
    }
}
