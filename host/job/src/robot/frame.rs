//! The frame of a program's poses, and its tool, as the controller knows them.

use nalgebra::Isometry3;

use weldpath_method::weld::program::Waypoint;

/// A frame or tool that a person has set on the controller.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Held {
    /// KUKA, FANUC.
    Number(u32),
    /// A feature of Universal Robots, a wobjdata or tooldata of ABB.
    Name(String),
}

/// Where a controller has a frame from.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum FrameSource {
    /// It is the robot's own base.
    #[default]
    RobotBase,
    /// A person has set it.
    Held(Held),
    /// The program sets it: FANUC's as this user frame, by way of this position register.
    Program {
        /// Of the user frame.
        number: Option<u32>,
        /// Of the position register, which the program overwrites.
        register: Option<u32>,
    },
}

/// In which frame a program's poses are.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ProgramFrame {
    /// Where the controller has it from.
    pub source: FrameSource,
    /// The frame in the robot's own base, mm.
    pub robot_from_frame: Isometry3<f64>,
    /// The scan's base frame in it, mm.
    pub frame_from_base: Isometry3<f64>,
}

impl ProgramFrame {
    /// The program, of the scan's base frame, in this one.
    pub fn of(&self, waypoints: &[Waypoint]) -> Vec<Waypoint> {
        let by = self.frame_from_base;
        // A turn by nothing would change the last digit.
        let moved = |point: &Waypoint| match by == Isometry3::identity() {
            true => *point,
            false => Waypoint {
                position_mm: by * point.position_mm,
                base_from_torch: by.rotation * point.base_from_torch,
                ..*point
            },
        };
        waypoints.iter().map(moved).collect()
    }

    /// The robot's own base in its place.
    pub fn robot_base(&self) -> Self {
        let frame_from_base = self.robot_from_frame * self.frame_from_base;
        Self { source: FrameSource::RobotBase, robot_from_frame: Isometry3::identity(), frame_from_base }
    }

    /// Whether it is the robot's own base, and the scan's base frame, too.
    pub(super) fn is_all_one(&self) -> bool {
        self.source == FrameSource::RobotBase && self.frame_from_base == Isometry3::identity()
    }

    /// The name under which a person has set it.
    pub(super) fn name(&self) -> Option<&str> {
        match &self.source {
            FrameSource::Held(Held::Name(name)) => Some(name),
            _ => None,
        }
    }

    /// The number of a frame that a person has set.
    pub(super) fn number(&self) -> Option<u32> {
        match self.source {
            FrameSource::Held(Held::Number(number)) => Some(number),
            _ => None,
        }
    }

    /// The position register by which the program sets it.
    pub(super) fn register(&self) -> Option<u32> {
        match self.source {
            FrameSource::Program { register, .. } => register,
            _ => None,
        }
    }

    /// What the head says of it, with the pose that a person has to find on the controller.
    pub(super) fn remark(&self, pose: &str) -> Option<String> {
        match &self.source {
            FrameSource::RobotBase if self.is_all_one() => None,
            FrameSource::RobotBase => {
                Some("Poses are in the robot's own base frame, not in the scan's.".into())
            }
            FrameSource::Held(held) => Some(format!(
                "Poses are in frame {held} of the controller. Compare before the first run: it has to stand at {pose} in \
                 the robot's own base. The program cannot check that."
            )),
            FrameSource::Program { .. } => Some(format!(
                "Poses are in a frame that the program sets, at {pose} in the robot's own base."
            )),
        }
    }
}

impl std::fmt::Display for Held {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Name(name) => f.write_str(name),
        }
    }
}

/// Which of the controller's tools a program runs with.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum ToolSource {
    /// By value where the job has a tool and the dialect can say it, else what is set.
    #[default]
    Usual,
    /// What a person has set under this name or number.
    Held(Held),
    /// FANUC: the program sets this number of tool by way of this position register, which it overwrites.
    Register {
        /// Of the tool.
        number: u32,
        /// Of the register.
        register: u32,
    },
}

impl ToolSource {
    /// Whether the controller's own is used, whatever the job says of the tool.
    pub(super) fn is_held(&self) -> bool {
        matches!(self, Self::Held(_))
    }

    /// Its name on the controller.
    pub(super) fn name(&self) -> Option<&str> {
        match self {
            Self::Held(Held::Name(name)) => Some(name),
            _ => None,
        }
    }

    /// The position register by which the program sets it.
    pub(super) fn register(&self) -> Option<u32> {
        match self {
            Self::Register { register, .. } => Some(*register),
            _ => None,
        }
    }

    /// Its number on the controller.
    pub fn number(&self) -> Option<u32> {
        match self {
            Self::Held(Held::Number(number)) | Self::Register { number, .. } => Some(*number),
            _ => None,
        }
    }
}
