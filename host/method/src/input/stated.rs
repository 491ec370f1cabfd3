//! Whose frame the coordinates are in, as the user says it: for clouds that cannot tell, and held against those that can.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{CloudFrame, Error, Scan};

/// Whose frame the coordinates of a cloud are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum StatedFrame {
    /// The frame of the camera that took it, with the camera at the origin.
    Camera,
    /// The robot's base.
    Base,
}

impl StatedFrame {
    const fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Base => "base",
        }
    }
}

/// Takes a frame as stated where the input leaves it open.
///
/// # Errors
/// If the input says otherwise.
pub(super) fn hold(stated: Option<StatedFrame>, scan: &mut Scan, path: &Path) -> Result<(), Error> {
    let problem = match (stated, scan.frame) {
        (None, _) | (Some(StatedFrame::Base), CloudFrame::Base) => return Ok(()),
        (Some(StatedFrame::Camera), CloudFrame::Camera) => return Ok(()),
        (Some(StatedFrame::Base), CloudFrame::Unknown) => {
            scan.frame = CloudFrame::Base;
            scan.notes.push("frame: the robot's base (as given)".into());
            return Ok(());
        }
        (Some(StatedFrame::Base), CloudFrame::Camera) => {
            "the coordinates are in the camera's frame, and no pose gives its position"
        }
        (Some(StatedFrame::Camera), CloudFrame::Base) => {
            "its poses put the views into the robot's base frame"
        }
        (Some(StatedFrame::Camera), CloudFrame::Unknown) => {
            "no single camera at the origin took it: it is a mesh, or has several views or a camera elsewhere"
        }
    };
    let given = stated.map_or("", StatedFrame::name);
    let help = "Leave `frame` out; it is for one cloud whose file does not say whose coordinates it holds";
    Err(Error::malformed(path, format!("--frame {given}"), problem, help))
}
