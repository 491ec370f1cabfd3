//! `[robot] frame` and `tool`: in which of the controller's frames poses are written, and with which of its tools they run.
//! Reference: `docs/programs.md`, "Frames and tools".

use nalgebra::Isometry3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::quantity::{Place, RotationVector};
use super::robot::{Fault, pose};
use crate::robot::dialect::{Dialect, Naming};
use crate::robot::frame::{FrameSource, Held, ProgramFrame, ToolSource};

/// `[robot] frame`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "a frame is a number, a name, or a table: { number or name, origin_mm, rotation_rad, register }"
)]
pub enum FrameSetting {
    /// KUKA, FANUC: this frame of the controller is the scan's base frame.
    Number(u32),
    /// Universal Robots, ABB: the same by its name.
    Name(String),
    /// Wherever it stands.
    Placed(PlacedFrame),
}

/// A frame that is not the scan's base frame; without number and name the program sets it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlacedFrame {
    /// On KUKA's and FANUC's controllers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub number: Option<u32>,
    /// On those of Universal Robots and ABB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its origin in the scan's base frame.
    #[serde(default)]
    pub origin_mm: Place,
    /// Rotation vector of the same transform.
    #[serde(default)]
    pub rotation_rad: RotationVector,
    /// FANUC: the position register by which the program sets it; what is in it is lost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub register: Option<u32>,
}

/// `[robot] tool`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "a tool is a number, a name, or a table: { number, register }")]
pub enum ToolSetting {
    /// KUKA, FANUC: what is set under this number.
    Number(u32),
    /// Universal Robots, ABB: what is set under this name.
    Name(String),
    /// FANUC: set by the program from `[tool]`.
    Register(RegisterTool),
}

/// A tool that a FANUC program sets.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterTool {
    /// Of the tool.
    pub number: u32,
    /// The position register by which the program sets it; what is in it is lost.
    pub register: u32,
}

/// Greatest number of a frame or tool of any controller, and of a position register.
const MOST_NUMBER: u32 = 64;
const MOST_REGISTER: u32 = 200;

impl FrameSetting {
    /// As the dialects take it.
    pub(super) fn frame(&self, base_from_robot: &Isometry3<f64>) -> ProgramFrame {
        let (source, base_from_frame) = match self {
            Self::Number(number) => (FrameSource::Held(Held::Number(*number)), Isometry3::identity()),
            Self::Name(name) => (FrameSource::Held(Held::Name(name.clone())), Isometry3::identity()),
            Self::Placed(placed) => (placed.source(), pose(placed.origin_mm, placed.rotation_rad)),
        };
        ProgramFrame {
            source,
            robot_from_frame: base_from_robot.inv_mul(&base_from_frame),
            frame_from_base: base_from_frame.inverse(),
        }
    }

    fn parts(&self) -> (Option<u32>, Option<&str>, Option<u32>) {
        match self {
            Self::Number(number) => (Some(*number), None, None),
            Self::Name(name) => (None, Some(name), None),
            Self::Placed(placed) => (placed.number, placed.name.as_deref(), placed.register),
        }
    }

    /// What cannot be written in one of `dialects`.
    pub(super) fn fault(&self, dialects: &[Dialect]) -> Option<Fault> {
        let (number, name, register) = self.parts();
        let wrong = of_numbers(number, register, name).or_else(|| {
            let both = number.is_some() && name.is_some();
            both.then(|| "a frame has a number or a name, whichever the controller uses".to_owned())
        });
        let unfit = || {
            unknown_to(dialects, "frames", number, name, |dialect| {
                (dialect.sets_by_register() && number.is_none()).then_some(
                    "takes a frame by value only with the number of a user frame and of a spare position register",
                )
            })
        };
        wrong.or_else(unfit).map(|why| ("frame", why))
    }
}

impl PlacedFrame {
    fn source(&self) -> FrameSource {
        match (self.number, &self.name, self.register) {
            (Some(number), _, None) => FrameSource::Held(Held::Number(number)),
            (None, Some(name), None) => FrameSource::Held(Held::Name(name.clone())),
            (number, _, register) => FrameSource::Program { number, register },
        }
    }
}

impl ToolSetting {
    /// As the dialects take it.
    pub(super) fn source(&self) -> ToolSource {
        match self {
            Self::Number(number) => ToolSource::Held(Held::Number(*number)),
            Self::Name(name) => ToolSource::Held(Held::Name(name.clone())),
            Self::Register(RegisterTool { number, register }) => {
                ToolSource::Register { number: *number, register: *register }
            }
        }
    }

    /// What cannot be written in one of `dialects`; `is_given`: the job has a `[tool]`.
    pub(super) fn fault(&self, dialects: &[Dialect], is_given: bool) -> Option<Fault> {
        let (number, name, register) = match self {
            Self::Number(number) => (Some(*number), None, None),
            Self::Name(name) => (None, Some(name.as_str()), None),
            Self::Register(tool) => (Some(tool.number), None, Some(tool.register)),
        };
        let unfit = || {
            unknown_to(dialects, "tools", number, name, |dialect| {
                (!dialect.sets_by_register() && register.is_some())
                    .then_some("has no position registers: leave the register out")
            })
        };
        let empty = (register.is_some() && !is_given)
            .then(|| "a program sets a tool only where the job has a [tool]".to_owned());
        of_numbers(number, register, name).or_else(unfit).or(empty).map(|why| ("tool", why))
    }
}

/// The first of `dialects` whose controller knows no such thing, and why: by the wrong kind of name, or by `more`.
fn unknown_to(
    dialects: &[Dialect],
    things: &str,
    number: Option<u32>,
    name: Option<&str>,
    more: impl Fn(Dialect) -> Option<&'static str>,
) -> Option<String> {
    dialects.iter().find_map(|&dialect| {
        let why = match dialect.naming()? {
            Naming::Name if number.is_some() => format!("has {things} by name, not by number"),
            Naming::Number if name.is_some() => format!("has {things} by number, not by name"),
            Naming::Name | Naming::Number => more(dialect)?.to_owned(),
        };
        Some(format!("{} {why}", dialect.maker()?.name()))
    })
}

fn of_numbers(number: Option<u32>, register: Option<u32>, name: Option<&str>) -> Option<String> {
    if let Some(number) = number.filter(|number| *number > MOST_NUMBER) {
        return Some(format!("{number} is not a valid frame or tool number: 0 to {MOST_NUMBER}"));
    }
    if let Some(register) = register.filter(|register| !(1..=MOST_REGISTER).contains(register)) {
        return Some(format!("{register} is not a valid position register: 1 to {MOST_REGISTER}"));
    }
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let is_name = |name: &str| {
        name.len() <= 32 && name.starts_with(|c: char| c.is_ascii_alphabetic()) && name.chars().all(allowed)
    };
    let name = name.filter(|name| !is_name(name))?;
    Some(format!(
        "{name:?} is not a valid name on a controller: at most 32 letters, digits and underscores, a letter \
         first"
    ))
}
