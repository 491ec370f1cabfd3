//! The messages between host and pendant: the protocol, defined here and nowhere else. docs/protocol.md is its prose.
//!
//! A frame is 0x00, COBS of (postcard message, CRC-32), 0x00: see [`frame`]. Every field is an integer with its unit
//! in its name. Tags are the order of the variants: within one [`VERSION`] nothing is reordered, inserted or retyped,
//! and the golden bytes of a version are never edited. `Hello` and `HelloRefused` keep their layout in all versions.

pub mod frame;
pub mod pose;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::interlock::{ArcPhase, Cause, Fault, State};
pub use frame::Unreadable;
pub use pose::{Q15_ONE, Waypoint, WirePose};

/// Protocol version; `Hello` carries it and a mismatch is refused with both numbers.
pub const VERSION: u16 = 1;
/// CRC-32 of the golden messages of [`VERSION`] in their order: it differs if two builds lay out a message differently.
pub const SCHEMA: u32 = 0x5446_5D23;

/// Waypoints in a chunk at most.
pub const MAX_CHUNK: usize = 8;
/// Points in a patch at most.
pub const MAX_PATCH: usize = 64;
/// Samples in a message at most.
pub const MAX_SAMPLES: usize = 8;
/// Chunks that the selective-ack map reaches beyond the next missing one.
pub const SACK_CHUNKS: u32 = 16;

/// Host to pendant. `session` is what `HelloAck` gave; a Hello ignores it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FromHost {
    /// The session the message belongs to; any other is refused.
    pub session: u32,
    /// What it says.
    pub message: HostMessage,
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
    /// Keeps the session alive; answered by `Pong`.
    Ping {
        /// Echoed.
        token: u32,
    },
    /// Ends the repetition of a `FaultReport`.
    FaultSeen {
        /// Number of the report.
        number: u16,
    },
}

/// Opening of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hello {
    /// [`VERSION`] of the host.
    pub version: u16,
    /// [`SCHEMA`] of the host.
    pub schema: u32,
    /// Fresh and random for every session the host opens.
    pub nonce: u32,
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
    pub waypoints: Vec<Waypoint, MAX_CHUNK>,
}

/// Executed at most once per request number, answered by [`Answer`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[allow(clippy::large_enum_variant, reason = "no allocator to box with; one command is alive at a time")]
pub enum Command {
    /// Asks for [`Limits`].
    GetLimits,
    /// Sets the tool centre point.
    SetTool {
        /// `flange_from_torch`.
        tool: WirePose,
    },
    /// Where gestures start from and how they are read.
    SetJog(Jog),
    /// A hand frame, answered by a camera pose. Only while nothing moves.
    HandFrame(HandFrame),
    /// Asks for the edge score of a patch's first point. Only while nothing moves.
    Score(Patch),
    /// Opens a path.
    Begin(Begin),
    /// Closes a path: all waypoints are there and their digest is this.
    Commit {
        /// Path id.
        path: u16,
        /// Digest over all waypoints ([`path_digest`]).
        digest: u32,
    },
    /// Drops the path. Not while moving.
    Abort {
        /// Path id.
        path: u16,
    },
    /// Arms the arc for the next Start or Resume, or disarms it.
    ArcArm {
        /// Whether the arc may be struck.
        armed: bool,
    },
    /// Starts the path from its first waypoint, where the torch has to be.
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
    /// Silence after which motion is held, ms.
    pub silence_ms: u16,
}

/// Interaction box and start pose of gesture-guided scanning (paper II-B).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Jog {
    /// `base_from_camera` where the camera is.
    pub start: WirePose,
    /// Centre of the interaction box, sensor frame, µm.
    pub box_center_um: [i32; 3],
    /// Edges of the interaction box, µm.
    pub box_size_um: [u32; 3],
    /// Whether the right hand steers instead of the left.
    pub steer_right: bool,
}

/// What the hand sensor saw at one instant, sensor frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HandFrame {
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
    #[serde(with = "fixed")]
    pub direction_q15: [i16; 3],
    /// Out of the palm, unit vector.
    #[serde(with = "fixed")]
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
pub struct Patch {
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
    #[serde(with = "fixed")]
    pub um: [i16; 3],
}

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
}

/// Session opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HelloAck {
    /// [`VERSION`] of the pendant.
    pub version: u16,
    /// Nonce of the Hello it answers.
    pub nonce: u32,
    /// Differs after every start of the pendant.
    pub boot: u32,
    /// Capacities.
    pub limits: Limits,
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
    Pose(CameraPose),
    /// To Score.
    EdgeScore(EdgeScore),
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
    /// The E-stop is pressed, or its fault waits for the local reset.
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
}

/// A camera pose out of a hand frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CameraPose {
    /// `base_from_camera`.
    pub pose: WirePose,
    /// Region of Alg. 1, 0 = centre.
    pub region: u8,
    /// Whether the gesture asks for a view.
    pub capture: bool,
    /// Whether the clutch is open: the camera stays.
    pub clutch: bool,
}

/// Edge score of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EdgeScore {
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
    pub pins: u8,
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
}

impl Telemetry {
    /// E-stop is pressed.
    pub const E_STOP: u8 = 1;
    /// The enabling switch is held.
    pub const ENABLE: u8 = 1 << 1;
    /// It was freshly pressed and is still held.
    pub const ENABLED: u8 = 1 << 2;
    /// The arc may be struck.
    pub const ARMED: u8 = 1 << 3;
    /// The power source reports current.
    pub const ESTABLISHED: u8 = 1 << 4;
    /// Manual mode.
    pub const MANUAL: u8 = 1 << 5;
    /// Arc power is on.
    pub const ARC: u8 = 1 << 6;
    /// Gas flows.
    pub const GAS: u8 = 1 << 7;
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

/// Session id out of both nonces: for a fixed one of them, no two of the other give the same id.
pub fn session_id(boot: u32, host: u32) -> u32 {
    let mut digest = CRC.digest();
    digest.update(&boot.to_le_bytes());
    digest.update(&host.to_le_bytes());
    digest.finalize()
}

/// Digest of an empty path of `total` waypoints.
pub fn empty_digest(total: u32) -> u32 {
    CRC.checksum(&total.to_le_bytes())
}

/// Digest of a path with one more waypoint: CRC-32 of (digest so far, [`Waypoint::to_bytes`]).
pub fn extend_digest(digest: u32, waypoint: &Waypoint) -> u32 {
    let mut next = CRC.digest();
    next.update(&digest.to_le_bytes());
    next.update(&waypoint.to_bytes());
    next.finalize()
}

/// Digest of a whole path; `None` if it is too long for an index.
pub fn path_digest(path: &[Waypoint]) -> Option<u32> {
    let total = u32::try_from(path.len()).ok()?;
    Some(path.iter().fold(empty_digest(total), extend_digest))
}

static CRC: crc::Crc<u32> = frame::CRC32;

// Largest encodings, from postcard's varints: 3 bytes for 16 bits, 5 for 32.
const HEADER_BYTES: usize = 5 + 1;
const POSE_BYTES: usize = 3 * 5 + 4 * 2;
const WAYPOINT_BYTES: usize = POSE_BYTES + 5 + 1;
const CHUNK_BYTES: usize = HEADER_BYTES + 3 + 5 + 1 + MAX_CHUNK * WAYPOINT_BYTES;
const SCORE_BYTES: usize = HEADER_BYTES + 3 + 1 + 5 + 5 + 1 + MAX_PATCH * 6;
const SAMPLES_BYTES: usize = HEADER_BYTES + 1 + MAX_SAMPLES * (3 * 5 + POSE_BYTES + 1);
/// Longest payload from the host, without CRC.
pub const MAX_FROM_HOST: usize = if CHUNK_BYTES > SCORE_BYTES { CHUNK_BYTES } else { SCORE_BYTES };
/// Longest payload from the pendant, without CRC.
pub const MAX_FROM_PENDANT: usize = SAMPLES_BYTES;
/// Longest frame from the host, delimiters included.
pub const MAX_HOST_FRAME: usize = frame::encoded_bytes(MAX_FROM_HOST);
/// Longest frame from the pendant, delimiters included.
pub const MAX_PENDANT_FRAME: usize = frame::encoded_bytes(MAX_FROM_PENDANT);

/// Deframer of the pendant.
pub type HostDeframer = frame::Deframer<{ MAX_FROM_HOST + frame::CRC_BYTES }>;
/// Deframer of the host.
pub type PendantDeframer = frame::Deframer<{ MAX_FROM_PENDANT + frame::CRC_BYTES }>;

const _: () = assert!(MAX_HOST_FRAME <= 512, "a frame of the host fits the receive buffer");
const _: () = assert!(MAX_PENDANT_FRAME <= 512, "a frame of the pendant fits the transmit buffer");

/// Short integers as two little-endian bytes each: a varint of a Q15 number would mostly be three.
pub(crate) mod fixed {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer, const N: usize>(words: &[i16; N], to: S) -> Result<S::Ok, S::Error>
    where
        [[u8; 2]; N]: Serialize,
    {
        words.map(i16::to_le_bytes).serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>, const N: usize>(
        from: D,
    ) -> Result<[i16; N], D::Error>
    where
        [[u8; 2]; N]: Deserialize<'de>,
    {
        <[[u8; 2]; N]>::deserialize(from).map(|words| words.map(i16::from_le_bytes))
    }
}
