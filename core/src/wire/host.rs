//! What a host says: hello, commands, waypoints.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::{MAX_CHUNK, MAX_PATCH, Unreadable, WirePose, WireWaypoint, frame};

/// Host to pendant. `session` is what `HelloAck` gave; a Hello ignores it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FromHost {
    /// The session the message belongs to; any other is refused.
    pub session: u32,
    /// What it says.
    pub message: HostMessage,
}

impl FromHost {
    /// Out of a payload whose checksum matched. Compiled here, for speed: for size, each layer of the decoder would have
    /// a copy of the message on the stack.
    #[inline(never)]
    pub fn decode(payload: &[u8]) -> Result<Self, Unreadable> {
        frame::decode(payload)
    }
}

/// What a host says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[allow(clippy::large_enum_variant, reason = "no allocator to box with; one message is alive at a time")]
pub enum HostMessage {
    /// Opens a session. Layout fixed for all versions.
    Hello(Hello),
    /// A command to be executed at most once.
    Control {
        /// Counts up by one from 1 (wrapping): the same number again asks for the cached reply.
        request: u16,
        /// What to do.
        command: Command,
    },
    /// Waypoints `first..first + len` of a path; placing them twice changes nothing.
    Chunk(Chunk),
    /// The only sign of life; answered by `Pong`.
    Ping(Ping),
    /// Ends the repetition of a `FaultReport`.
    FaultSeen {
        /// Number of the report.
        number: u16,
    },
    /// Goes on with the path of a host that was lost.
    Attach(Attach),
}

/// Opening of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hello {
    /// [`super::VERSION`] of the host.
    pub version: u16,
    /// [`super::SCHEMA`] of the host.
    pub schema: u32,
    /// Fresh and random for every session the host opens.
    pub nonce: u32,
}

/// A sign of life. It counts if `count` is ahead of all that came before, and from the time that `echo` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ping {
    /// Counts up by one from 1 within a session (wrapping).
    pub count: u32,
    /// The newest tick of the pendant that the host has heard of: HelloAck, Pong or Telemetry.
    pub echo: u32,
    /// Given back by the Pong.
    pub token: u32,
}

/// Opens a session that goes on with the path of a former one: while that is Held and its host silent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Attach {
    /// As for any session, with a fresh nonce.
    pub hello: Hello,
    /// Nonce of the session whose host was lost.
    pub former: u32,
    /// Path id.
    pub path: u16,
    /// Digest that the path was committed with.
    pub digest: u32,
}

/// Consecutive waypoints.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Chunk {
    /// Path id of `Begin`.
    pub path: u16,
    /// Index of the first waypoint: a multiple of the path's chunk length.
    pub first: u32,
    /// As many as the path's chunk length; the last chunk of a path may be shorter.
    pub waypoints: Vec<WireWaypoint, MAX_CHUNK>,
}

/// Executed at most once per request number, answered by [`super::Answer`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[allow(clippy::large_enum_variant, reason = "no allocator to box with; one command is alive at a time")]
pub enum Command {
    /// Asks for [`super::Limits`].
    GetLimits,
    /// Sets the tool centre point.
    SetTool {
        /// `flange_from_torch`.
        tool: WirePose,
    },
    /// Where gestures start from and how they are read.
    SetJog(WireJog),
    /// A hand frame, answered by a camera pose. Only in Idle, enabled, with the key in manual.
    HandFrame(WireHandFrame),
    /// Asks for the edge score of a patch's first point. Only while nothing moves.
    Score(WirePatch),
    /// Opens a path.
    Begin(Begin),
    /// Closes a path: all waypoints are there and their digest is this.
    Commit {
        /// Path id.
        path: u16,
        /// Digest over all waypoints ([`super::path_digest`]).
        digest: u32,
    },
    /// Drops the path. Not while moving.
    Abort {
        /// Path id.
        path: u16,
    },
    /// Arms the arc for the next Start or Resume, or disarms it. Only while enabled; letting the switch go disarms.
    ArcArm {
        /// Whether the arc may be struck.
        armed: bool,
    },
    /// Starts the path from its first waypoint, where the torch has to be known to be.
    Start {
        /// Path id.
        path: u16,
    },
    /// Decelerates to a halt on the path, arc off; Resume is possible.
    Hold,
    /// As Hold, but Resume is not possible.
    Stop,
    /// Goes on from Held.
    Resume {
        /// Path id.
        path: u16,
        /// State counter of the telemetry that showed Held: an older one is refused.
        changes: u16,
        /// How far to go back along the path first, arc off, µm.
        back_um: u32,
    },
    /// Clears a session, silence or path fault, and drops the path.
    Reset,
    /// Sends every `every`-th executed set-point; 0 ends it.
    Subscribe {
        /// Ticks per sample.
        every: u16,
    },
}

/// Opening of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Begin {
    /// Chosen by the host; ahead of every id the session has used (16-bit serial number).
    pub path: u16,
    /// Waypoints of the whole path, 2 at least.
    pub total: u32,
    /// Waypoints per chunk, 1 to [`MAX_CHUNK`].
    pub chunk: u8,
    /// Whether execution may begin before all is loaded; needed if the path is longer than the ring.
    pub streamed: bool,
    /// No waypoint is farther from the base, µm.
    pub reach_um: u32,
    /// No two neighbours are farther apart, µm.
    pub max_step_um: u32,
    /// No two neighbours turn farther: cosine of half the angle, Q15.
    pub min_half_turn_cos_q15: i16,
    /// Whether the arc may be armed on this path; if not, a welded segment is refused, too.
    pub arc: bool,
    /// Times of the arc sequence on this path.
    pub times: ProcessTimes,
}

/// Times of the arc sequence, ms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ProcessTimes {
    /// Gas before the strike, at most 10 000.
    pub pre_flow_ms: u16,
    /// Longest wait for an established arc, 10 to 5000.
    pub strike_ms: u16,
    /// Crater fill, at most 5000.
    pub crater_fill_ms: u16,
    /// Burn-back, at most 1000.
    pub burn_back_ms: u16,
    /// Gas after the arc, at most 30 000.
    pub post_flow_ms: u16,
}

impl Default for ProcessTimes {
    fn default() -> Self {
        Self { pre_flow_ms: 200, strike_ms: 1000, crater_fill_ms: 300, burn_back_ms: 60, post_flow_ms: 500 }
    }
}

/// Interaction box and start pose of gesture-guided scanning (paper II-B).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WireJog {
    /// `base_from_camera` where the camera is.
    pub start: WirePose,
    /// Centre of the interaction box, sensor frame, µm.
    pub box_center_um: [i32; 3],
    /// Edges of the interaction box, µm.
    pub box_size_um: [u32; 3],
    /// Whether the right hand steers instead of the left.
    pub steer_right: bool,
    /// `base_from_sensor`: how the hand sensor is turned on the robot's base, w x y z.
    #[serde(with = "super::fixed")]
    pub base_from_sensor_q15: [i16; 4],
}

/// What the hand sensor saw at one instant, sensor frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WireHandFrame {
    /// Sensor time, ms.
    pub time_ms: u32,
    /// Left hand, if seen.
    pub left: Option<Hand>,
    /// Right hand, if seen.
    pub right: Option<Hand>,
}

/// One hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hand {
    /// Centre of the palm, µm.
    pub palm_um: [i32; 3],
    /// From the palm to the fingers, unit vector.
    #[serde(with = "super::fixed")]
    pub direction_q15: [i16; 3],
    /// Out of the palm, unit vector.
    #[serde(with = "super::fixed")]
    pub normal_q15: [i16; 3],
    /// 0 open to 1000 fist.
    pub grab_permille: u16,
    /// 0 open to 1000 thumb on finger.
    pub pinch_permille: u16,
    /// The sensor's confidence, 0 to 1000.
    pub confidence_permille: u16,
    /// Bit 0 thumb to bit 4 little finger.
    pub extended: u8,
}

/// A point with its bounded neighbourhood (paper II-E), for an edge score.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WirePatch {
    /// Ball radius of eq. (11), µm.
    pub radius_um: u32,
    /// Threshold of eq. (16), thousandths.
    pub threshold_milli: u32,
    /// The point itself first, all relative to it.
    pub points: Vec<Offset, MAX_PATCH>,
}

/// A displacement of at most 32 mm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Offset {
    /// x y z, µm.
    #[serde(with = "super::fixed")]
    pub um: [i16; 3],
}
