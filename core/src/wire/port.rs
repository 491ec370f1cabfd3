//! The robot port: set-points out, one a tick, and what the robot does in. docs/robot-port.md is its prose.
//!
//! Frames as on the host's line ([`super::frame`]); poses are of the robot's flange, `base_from_flange`, so that the far
//! end need not know the tool. Both directions carry a sequence number: what is missing is seen at either end.

use serde::{Deserialize, Serialize};

use super::{WirePose, frame};

/// Version of the port's frames; each begins with it, and any other is not listened to.
pub const VERSION: u8 = 1;

/// Pendant to robot, every tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct WireSetPoint {
    /// [`VERSION`].
    pub version: u8,
    /// Counts up by one with every frame, wrapping.
    pub sequence: u16,
    /// Pendant's clock, ticks, wrapping.
    pub tick: u32,
    /// Where the flange has to be at the end of the tick; none while nothing is commanded.
    pub pose: Option<WirePose>,
    /// Whether motion is enabled; if not, the robot stands or comes to a stop by itself.
    pub motion: bool,
    /// Whether the arc is on.
    pub arc: bool,
}

/// State of the robot's drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Drives {
    /// Without power, braked, or in a mode that does not take set-points.
    #[default]
    Off,
    /// Follows set-points.
    Following,
    /// A protective stop, or a limit reached: does not follow.
    Stopped,
}

/// Robot to pendant: an answer to every set-point frame, or to the newest where several came at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Actual {
    /// [`VERSION`].
    pub version: u8,
    /// Counts up by one with every frame, wrapping.
    pub sequence: u16,
    /// Sequence of the newest set-point frame received.
    pub heard: u16,
    /// Set-point frames that were missing, wrapping.
    pub lost: u16,
    /// Where the flange is.
    pub pose: WirePose,
    /// How far that is from where it was to be, µm.
    pub error_um: u32,
    /// State of the drives.
    pub drives: Drives,
}

// Both ways run in every tick and are compiled here, for speed: a firmware that calls them may be compiled for size.

impl WireSetPoint {
    /// Writes the frame to the start of `out` and returns its length.
    #[inline(never)]
    pub fn encode(&self, out: &mut [u8; MAX_SET_POINT_FRAME]) -> Result<usize, frame::Full> {
        frame::encode(self, out)
    }
}

impl Actual {
    /// Out of a payload whose checksum matched.
    #[inline(never)]
    pub fn decode(payload: &[u8]) -> Result<Self, frame::Unreadable> {
        frame::decode(payload)
    }
}

const POSE_BYTES: usize = 3 * 5 + 4 * 2;
/// Longest set-point, without CRC.
pub const MAX_SET_POINT: usize = 1 + 3 + 5 + 1 + POSE_BYTES + 1 + 1;
/// Longest answer, without CRC.
pub const MAX_ACTUAL: usize = 1 + 3 + 3 + 3 + POSE_BYTES + 5 + 1;
/// Longest frame to the robot, delimiters included.
pub const MAX_SET_POINT_FRAME: usize = frame::encoded_bytes(MAX_SET_POINT);
/// Longest frame from the robot, delimiters included.
pub const MAX_ACTUAL_FRAME: usize = frame::encoded_bytes(MAX_ACTUAL);

/// Deframer of the pendant.
pub type ActualDeframer = frame::Deframer<{ frame::stuffed_bytes(MAX_ACTUAL) }>;
/// Deframer of the robot's end.
pub type SetPointDeframer = frame::Deframer<{ frame::stuffed_bytes(MAX_SET_POINT) }>;
