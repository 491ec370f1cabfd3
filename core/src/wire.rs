//! The messages between host and pendant: the protocol, defined here and nowhere else. docs/protocol.md is its prose.
//!
//! A frame is 0x00, COBS of (postcard message, CRC-32), 0x00: see [`frame`]. Every field is an integer with its unit
//! in its name. Tags are the order of the variants: within one [`VERSION`] nothing is reordered, inserted or retyped,
//! and the golden bytes of a version are never edited. `Hello` and `HelloRefused` keep their layout in all versions.

pub mod frame;
mod host;
mod pendant;
pub mod port;
pub mod pose;

pub use frame::Unreadable;
pub use host::{
    Attach, Begin, Chunk, Command, FromHost, Hand, Hello, HostMessage, Offset, Ping, ProcessTimes,
    WireHandFrame, WireJog, WirePatch,
};
pub use pendant::{
    Ack, Answer, AttachRefusal, ChunkRefusal, ChunkRefused, Counters, Field, Firmware, FromPendant, HelloAck,
    HelloRefusal, HelloRefused, JogLimits, Limits, PendantMessage, Refusal, Robot, Sample, Telemetry,
    WireCameraPose, WireEdgeScore,
};
pub use pose::{Q15_ONE, WirePose, WireWaypoint};

/// Protocol version; `Hello` carries it and a mismatch is refused with both numbers.
pub const VERSION: u16 = 4;
/// CRC-32 of the golden messages of [`VERSION`] in their order: it differs if two builds lay out a message differently.
pub const SCHEMA: u32 = 0x6336_22ED;

/// Waypoints in a chunk at most.
pub const MAX_CHUNK: usize = 8;
/// Points in a patch at most.
pub const MAX_PATCH: usize = 64;
/// Samples in a message at most.
pub const MAX_SAMPLES: usize = 8;
/// Chunks that the selective-ack map reaches beyond the next missing one.
pub const SACK_CHUNKS: u32 = 16;

/// Session id out of both nonces: for a fixed one of them, no two of the other give the same id.
pub fn session_id(boot: u32, host: u32) -> u32 {
    frame::checksum(&[&boot.to_le_bytes(), &host.to_le_bytes()])
}

/// Digest of an empty path of `total` waypoints.
pub fn empty_digest(total: u32) -> u32 {
    frame::checksum(&[&total.to_le_bytes()])
}

/// Digest of a path with one more waypoint: CRC-32 of (digest so far, [`WireWaypoint::to_bytes`]).
pub fn extend_digest(digest: u32, waypoint: &WireWaypoint) -> u32 {
    frame::checksum(&[&digest.to_le_bytes(), &waypoint.to_bytes()])
}

/// Digest of a whole path; `None` if it is too long for an index.
pub fn path_digest(path: &[WireWaypoint]) -> Option<u32> {
    let total = u32::try_from(path.len()).ok()?;
    Some(path.iter().fold(empty_digest(total), extend_digest))
}

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
pub type HostDeframer = frame::Deframer<{ frame::stuffed_bytes(MAX_FROM_HOST) }>;
/// Deframer of the host.
pub type PendantDeframer = frame::Deframer<{ frame::stuffed_bytes(MAX_FROM_PENDANT) }>;

const _: () = assert!(MAX_HOST_FRAME <= 512, "a frame of the host fits the receive buffer");
const _: () = assert!(MAX_PENDANT_FRAME <= 512, "a frame of the pendant fits the transmit buffer");

/// Short integers as two little-endian bytes each: a varint of a Q15 number would mostly be three. Where people read it,
/// they are numbers.
pub(crate) mod fixed {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer, const N: usize>(words: &[i16; N], to: S) -> Result<S::Ok, S::Error>
    where
        [[u8; 2]; N]: Serialize,
        [i16; N]: Serialize,
    {
        if to.is_human_readable() {
            return words.serialize(to);
        }
        words.map(i16::to_le_bytes).serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>, const N: usize>(
        from: D,
    ) -> Result<[i16; N], D::Error>
    where
        [[u8; 2]; N]: Deserialize<'de>,
        [i16; N]: Deserialize<'de>,
    {
        if from.is_human_readable() {
            return <[i16; N]>::deserialize(from);
        }
        <[[u8; 2]; N]>::deserialize(from).map(|words| words.map(i16::from_le_bytes))
    }
}
