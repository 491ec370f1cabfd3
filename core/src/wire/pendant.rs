//! What a pendant says: answers, acknowledgements, state.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::{MAX_SAMPLES, Unreadable, WirePose};
use crate::interlock::{ArcPhase, Cause, Fault, State};

/// Pendant to host. `session` is 0 if the message belongs to none.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FromPendant {
    /// The session it belongs to.
    pub session: u32,
    /// What it says.
    pub message: PendantMessage,
}

/// What a pendant says. All but `Reply` may be lost: values are absolute, and a later message makes up for it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[allow(clippy::large_enum_variant, reason = "no allocator to box with; one message is alive at a time")]
pub enum PendantMessage {
    /// The session is open; the frame's header carries it.
    HelloAck(HelloAck),
    /// No session. Layout fixed for all versions.
    HelloRefused(HelloRefused),
    /// The answer to a control message.
    Reply {
        /// Its number.
        request: u16,
        /// What came of it.
        answer: Answer,
    },
    /// Where the load stands; answers every chunk.
    Ack(Ack),
    /// A chunk was refused and nothing of it stored.
    ChunkRefused(ChunkRefused),
    /// Answers `Ping`.
    Pong {
        /// As in the Ping.
        token: u32,
        /// Ticks since the pendant started, wrapping: for the echo of the next Ping.
        tick: u32,
    },
    /// Repeated until `FaultSeen`.
    FaultReport {
        /// Counts faults since the pendant started.
        number: u16,
        /// What happened.
        fault: Fault,
    },
    /// State, 20 times a second and when it changes.
    Telemetry(Telemetry),
    /// Executed set-points.
    Samples(Vec<Sample, MAX_SAMPLES>),
    /// The frame's session is not alive: say Hello. The header carries the refused session.
    NoSession {
        /// Boot nonce of the pendant: another one than before means that it was reset.
        boot: u32,
    },
    /// A frame with a right checksum that is no message of this version.
    Unread(Unreadable),
    /// No path to go on with.
    AttachRefused {
        /// Nonce of the Attach it answers.
        nonce: u32,
        /// Why.
        why: AttachRefusal,
    },
}

/// Why a host cannot go on with a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AttachRefusal {
    /// The former host is alive, or was less than the silence limit ago, or the torch still moves.
    Busy,
    /// The pendant does not hold: there is nothing to go on with.
    State(State),
    /// The pendant was reset, or another host had it since.
    Session,
    /// Another path is loaded, or its digest is another, or not all of it had come.
    Path,
}

/// Session opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HelloAck {
    /// [`super::VERSION`] of the pendant.
    pub version: u16,
    /// Nonce of the Hello it answers.
    pub nonce: u32,
    /// Differs after every start of the pendant.
    pub boot: u32,
    /// Ticks since the pendant started, wrapping: for the echo of the first Ping.
    pub tick: u32,
    /// Number of the last request of the session; the next one has the number after it.
    pub request: u16,
    /// What the pendant runs.
    pub firmware: Firmware,
    /// Capacities.
    pub limits: Limits,
}

/// What a pendant runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Firmware {
    /// Release: major, minor, patch.
    pub version: [u8; 3],
    /// First 32 bits of the commit that it was built from; 0 if nobody knows.
    pub build: u32,
}

/// What the pendant can hold and do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits {
    /// Waypoints in the ring.
    pub ring: u32,
    /// Farthest waypoint from the base, µm.
    pub reach_um: u32,
    /// Longest step, µm.
    pub max_step_um: u32,
    /// Cosine of half the largest turn of a step, Q15.
    pub min_half_turn_cos_q15: i16,
    /// Shortest step, µm, counting a turn of 1 rad as 10 mm.
    pub min_step_um: u32,
    /// Fastest feed, µm/s.
    pub max_feed_um_s: u32,
    /// Fastest feed in manual mode, µm/s.
    pub manual_feed_um_s: u32,
    /// Acceleration along the path, µm/s².
    pub accel_um_s2: u32,
    /// Period of set-points, µs.
    pub tick_us: u32,
    /// Age of the newest fresh Ping at which motion is held, ms.
    pub silence_ms: u16,
    /// Fastest turn of the torch, mrad/s.
    pub max_turn_mrad_s: u32,
    /// Change of the velocity at a waypoint, µm/s: corners are passed slowly enough for it.
    pub corner_um_s: u32,
    /// Change of the angular velocity at a waypoint, mrad/s.
    pub corner_mrad_s: u32,
    /// Speed of the way back before a Resume, µm/s.
    pub retrace_um_s: u32,
    /// Start and Resume: the torch has to be this near, µm ...
    pub near_um: u32,
    /// ... and turned by no more than this, mrad.
    pub near_mrad: u32,
    /// Whether a robot port is fitted.
    pub port: bool,
    /// Of hand-guided motion.
    pub jog: JogLimits,
}

/// How hands move the camera, and where to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct JogLimits {
    /// Scaling: farthest the camera goes in one hand frame, µm (`l` of Alg. 1).
    pub step_um: u32,
    /// Fastest motion of the camera by the pendant's clock, µm/s.
    pub speed_um_s: u32,
    /// Fastest turn of the camera by the pendant's clock, mrad/s.
    pub turn_mrad_s: u32,
    /// Least x y z of the camera, base frame, µm.
    pub least_um: [i32; 3],
    /// Greatest x y z of the camera, base frame, µm.
    pub most_um: [i32; 3],
    /// A hand of less confidence counts as none.
    pub confidence_permille: u16,
}

/// Session refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HelloRefused {
    /// Nonce of the Hello it answers.
    pub nonce: u32,
    /// Why.
    pub why: HelloRefusal,
}

/// Why there is no session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum HelloRefusal {
    /// The protocol versions differ.
    Version {
        /// As the Hello said.
        host: u16,
        /// The pendant's.
        pendant: u16,
    },
    /// Same version, but the messages are laid out differently.
    Schema {
        /// As the Hello said.
        host: u32,
        /// The pendant's.
        pendant: u32,
    },
    /// Another session is alive, or was less than the silence limit ago, or the torch still moves.
    Busy,
}

/// Outcome of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Answer {
    /// Executed.
    Done,
    /// Not executed, and nothing changed.
    Refused(Refusal),
    /// To GetLimits.
    Limits(Limits),
    /// To HandFrame.
    Pose(WireCameraPose),
    /// To Score.
    EdgeScore(WireEdgeScore),
}

/// Why a command was not executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// Not in this state.
    State(State),
    /// The torch moves.
    Moving,
    /// Names another path than the loaded one, or an id that is not new.
    Path,
    /// The enabling switch is not held, or was not seen released before.
    NotEnabled,
    /// The E-stop is pressed, or a fault waits for the local reset.
    EStop,
    /// The path does not fit: stream it.
    TooLong {
        /// Waypoints that fit.
        capacity: u32,
    },
    /// Waypoints are missing.
    Incomplete {
        /// The first missing one.
        next: u32,
    },
    /// The digest of the waypoints received is another.
    Digest {
        /// What was received.
        computed: u32,
    },
    /// The state has changed since.
    Stale {
        /// State counter now.
        changes: u16,
    },
    /// The cause of this hold does not allow to go on.
    NotResumable(Cause),
    /// A number is out of its range or beyond the pendant's limits.
    Value(Field),
    /// The torch is not where the path begins or goes on.
    Away {
        /// How far, µm.
        distance_um: u32,
        /// How far turned, mrad.
        turn_mrad: u32,
    },
    /// Nobody knows where the torch is: it has to be confirmed at the pendant.
    PoseUnknown,
    /// A robot port is fitted, and the robot is silent or its drives do not follow.
    Robot,
    /// A welded segment is faster than manual mode allows, and the arc is armed.
    TooFast {
        /// Waypoint where it begins.
        at: u32,
    },
    /// The arc is barred on this path.
    ArcBarred,
    /// The key switch is not in manual.
    NotManual,
    /// A robot port is fitted, and this session has set no tool: nobody knows where the torch is on the flange.
    NoTool,
}

/// Which number a refusal means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Field {
    /// Number of waypoints or of points.
    Count,
    /// Chunk length.
    Chunk,
    /// Reach.
    Reach,
    /// Step.
    Step,
    /// Turn.
    Turn,
    /// Orientation: no unit quaternion.
    Orientation,
    /// Box or radius: zero.
    Size,
    /// The way back is longer than the path kept.
    Back,
    /// A time of the arc sequence.
    Time,
    /// Outside the workspace of hand-guided motion.
    Workspace,
    /// A tool that is longer than any.
    Tool,
}

/// A camera pose out of a hand frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WireCameraPose {
    /// `base_from_camera`, where the hand wants it.
    pub pose: WirePose,
    /// `base_from_camera` where the robot at the port really has it; none without a port.
    pub actual: Option<WirePose>,
    /// Region of Alg. 1, 0 = centre.
    pub region: u8,
    /// Whether the gesture asks for a view.
    pub capture: bool,
    /// Whether the clutch is open: the camera stays.
    pub clutch: bool,
    /// The pendant's clock, by which the camera moved, ms since its start, wrapping.
    pub time_ms: u32,
}

/// Edge score of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WireEdgeScore {
    /// Neighbours used.
    pub neighbours: u8,
    /// Intensity, eq. (12), parts per million.
    pub intensity_ppm: u32,
    /// Tr³/Det, thousandths; `u32::MAX` if it is larger or unbounded.
    pub ratio_milli: u32,
    /// Whether the threshold of eq. (16) calls it an edge.
    pub edge: bool,
}

/// Where a load stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ack {
    /// Path id.
    pub path: u16,
    /// All waypoints below this index are there.
    pub next: u32,
    /// Bit i: the chunk i + 1 behind the one that begins at `next` is there.
    pub sack: u16,
    /// Waypoints below this index may be sent.
    pub limit: u32,
}

/// A refused chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ChunkRefused {
    /// Path id of the chunk.
    pub path: u16,
    /// First index of the chunk.
    pub first: u32,
    /// Which waypoint of the chunk.
    pub at: u8,
    /// What is wrong with it.
    pub why: ChunkRefusal,
}

/// What is wrong with a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ChunkRefusal {
    /// No such path is open.
    Path,
    /// Index or length does not fit the grid of chunks.
    Index,
    /// Beyond the credit limit.
    Credit {
        /// The limit.
        limit: u32,
    },
    /// Farther from the base than declared.
    Reach,
    /// No unit quaternion.
    Orientation,
    /// Feed 0, or faster than the pendant's limit.
    Feed,
    /// Too far from its neighbour.
    StepTooLong,
    /// Too near its neighbour.
    StepTooShort,
    /// Turned too far from its neighbour.
    Turn,
    /// To be welded, on a path on which the arc is barred.
    ArcBarred,
}

/// The pendant's state; absolute values, so that any single message suffices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Telemetry {
    /// Ticks since the pendant started, wrapping.
    pub tick: u32,
    /// State of the interlock.
    pub state: State,
    /// Counts changes of state, wrapping.
    pub changes: u16,
    /// Why it holds, if it does.
    pub cause: Option<Cause>,
    /// The latched fault, if any.
    pub fault: Option<Fault>,
    /// Phase of the arc sequence.
    pub arc: ArcPhase,
    /// [`Self::E_STOP`] and its neighbours.
    pub pins: u16,
    /// The path of this session that was followed to its end last.
    pub finished: Option<u16>,
    /// Load, if a path is open.
    pub load: Option<Ack>,
    /// Segment being executed.
    pub segment: u32,
    /// How far along it, 2^24 = its end.
    pub alpha_q24: u32,
    /// Speed along the path, µm/s.
    pub speed_um_s: u32,
    /// Torch pose commanded last.
    pub pose: WirePose,
    /// What the receiver counted.
    pub counters: Counters,
    /// The robot, if a port is fitted and it was heard in time.
    pub robot: Option<Robot>,
    /// `flange_from_torch` as this session, or the one that it went on with, has set it.
    pub tool: Option<WirePose>,
}

/// What a robot says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Robot {
    /// Where the torch really is, `base_from_torch`.
    pub pose: WirePose,
    /// Following error, µm.
    pub error_um: u32,
    /// State of its drives.
    pub drives: super::port::Drives,
    /// Set-points that it missed and frames of its that the pendant missed, wrapping.
    pub lost: u16,
}

impl Telemetry {
    /// E-stop is pressed.
    pub const E_STOP: u16 = 1;
    /// The enabling switch is held.
    pub const ENABLE: u16 = 1 << 1;
    /// It was freshly pressed and is still held.
    pub const ENABLED: u16 = 1 << 2;
    /// The arc may be struck.
    pub const ARMED: u16 = 1 << 3;
    /// The power source reports current.
    pub const ESTABLISHED: u16 = 1 << 4;
    /// Manual mode.
    pub const MANUAL: u16 = 1 << 5;
    /// Arc power is on.
    pub const ARC: u16 = 1 << 6;
    /// Gas flows.
    pub const GAS: u16 = 1 << 7;
    /// It is known where the torch is.
    pub const POSE_KNOWN: u16 = 1 << 8;
    /// The button that confirms where the torch is.
    pub const CONFIRM: u16 = 1 << 9;
    /// Motion of the robot is enabled.
    pub const MOTION: u16 = 1 << 10;
    /// The board found its inputs or outputs broken.
    pub const DEFECT: u16 = 1 << 11;
}

/// Counters of the receiver since the start, wrapping.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Broken frames.
    pub framing: u16,
    /// Checksum errors.
    pub crc: u16,
    /// Frames longer than any message.
    pub oversize: u16,
    /// Right checksum, no message.
    pub unread: u16,
    /// Bytes the board lost.
    pub overrun: u16,
    /// Chunks received twice.
    pub duplicate: u16,
    /// Pings that were not fresh: repeated, late, or with a wrong echo.
    pub stale: u16,
}

/// An executed set-point: the pose that [`crate::pendant`] interpolated at `alpha_q24` of `segment`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sample {
    /// Tick of execution.
    pub tick: u32,
    /// Segment.
    pub segment: u32,
    /// How far along it, 2^24 = its end.
    pub alpha_q24: u32,
    /// Pose commanded.
    pub pose: WirePose,
    /// Whether the arc output was on.
    pub arc: bool,
}
