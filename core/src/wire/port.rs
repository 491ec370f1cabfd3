//! The robot port: set-points out, one a tick, and what the robot does in. docs/robot-port.md is its prose.
//!
//! Frames as on the host's line ([`super::frame`]); poses are of the robot's flange, `base_from_flange`, so that the far
//! end need not know the tool. Payloads have a fixed layout of 32-bit little-endian words: they are written and read in
//! every tick. Each end counts its frames under a nonce of its own and gives back both of the other's: a frame is as old
//! as what it gives back, and one that was recorded gives back another nonce.

use super::{WirePose, frame};
use serde::{Deserialize, Serialize};

/// Version of the port's frames; each begins with it, and any other is not listened to.
pub const VERSION: u8 = 2;

/// Pendant to robot, every tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WireSetPoint {
    /// Answers that were missing, wrapping.
    pub lost: u16,
    /// The pendant's nonce: another in every session with a host.
    pub session: u32,
    /// Pendant's clock, ticks, wrapping: one more with every frame.
    pub tick: u32,
    /// Nonce of the robot's end in the newest answer that is not late; 0 without one.
    pub robot: u32,
    /// Sequence of that answer.
    pub heard: u32,
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Actual {
    /// State of the drives.
    pub drives: Drives,
    /// Set-point frames that were missing, wrapping.
    pub lost: u16,
    /// Nonce of the robot's end: another after every start of it, and not 0.
    pub robot: u32,
    /// Counts up by one with every frame, wrapping.
    pub sequence: u32,
    /// Session in the newest set-point frame received.
    pub session: u32,
    /// Tick in it.
    pub heard: u32,
    /// Where the flange is.
    pub pose: WirePose,
    /// How far that is from where it was to be, µm.
    pub error_um: u32,
}

const HAS_POSE: u8 = 1;
const MOTION: u8 = 1 << 1;
const ARC: u8 = 1 << 2;

impl WireSetPoint {
    fn words(&self) -> [u32; SET_POINT / 4] {
        let flag = |set: bool, flag: u8| if set { flag } else { 0 };
        let flags = flag(self.pose.is_some(), HAS_POSE) | flag(self.motion, MOTION) | flag(self.arc, ARC);
        let [x, y, z, wi, jk] = pose_words(&self.pose.unwrap_or(NO_POSE));
        [head(flags, self.lost), self.session, self.tick, self.robot, self.heard, x, y, z, wi, jk]
    }

    /// Out of a payload whose checksum matched; none of another version or length, or with unknown flags.
    pub fn from_bytes(payload: &[u8]) -> Option<Self> {
        let [first, session, tick, robot, heard, x, y, z, wi, jk] = words(payload)?;
        let (flags, lost) = split_head(first)?;
        let pose = (flags & HAS_POSE != 0).then(|| pose([x, y, z, wi, jk]));
        let (motion, arc) = (flags & MOTION != 0, flags & ARC != 0);
        let known = flags & !(HAS_POSE | MOTION | ARC) == 0;
        known.then_some(Self { lost, session, tick, robot, heard, pose, motion, arc })
    }

    /// Writes the frame.
    #[inline(never)]
    pub fn write(&self, out: &mut [u8; SET_POINT_FRAME]) {
        frame::enclose(self.words(), out);
    }
}

impl Actual {
    fn words(&self) -> [u32; ACTUAL / 4] {
        let drives = match self.drives {
            Drives::Off => 0,
            Drives::Following => 1,
            Drives::Stopped => 2,
        };
        let [x, y, z, wi, jk] = pose_words(&self.pose);
        [
            head(drives, self.lost),
            self.robot,
            self.sequence,
            self.session,
            self.heard,
            x,
            y,
            z,
            wi,
            jk,
            self.error_um,
        ]
    }

    /// Out of a payload whose checksum matched; none of another version or length, or with unknown drives.
    #[inline(never)]
    pub fn from_bytes(payload: &[u8]) -> Option<Self> {
        let [first, robot, sequence, session, heard, x, y, z, wi, jk, error_um] = words(payload)?;
        let (drives, lost) = split_head(first)?;
        let drives = match drives {
            0 => Drives::Off,
            1 => Drives::Following,
            2 => Drives::Stopped,
            _ => return None,
        };
        let pose = pose([x, y, z, wi, jk]);
        Some(Self { drives, lost, robot, sequence, session, heard, pose, error_um })
    }

    /// Writes the frame.
    pub fn write(&self, out: &mut [u8; ACTUAL_FRAME]) {
        frame::enclose(self.words(), out);
    }
}

const NO_POSE: WirePose = WirePose { position_um: [0; 3], orientation_q15: [0; 4] };

fn head(byte: u8, lost: u16) -> u32 {
    let [low, high] = lost.to_le_bytes();
    u32::from_le_bytes([VERSION, byte, low, high])
}

/// The second byte and what was lost, if the version is this one.
fn split_head(word: u32) -> Option<(u8, u16)> {
    let [version, byte, low, high] = word.to_le_bytes();
    (version == VERSION).then_some((byte, u16::from_le_bytes([low, high])))
}

fn pose_words(pose: &WirePose) -> [u32; 5] {
    let ([x, y, z], [w, i, j, k]) = (pose.position_um, pose.orientation_q15);
    let pair = |low: i16, high: i16| u32::from(low as u16) | u32::from(high as u16) << 16;
    [x as u32, y as u32, z as u32, pair(w, i), pair(j, k)]
}

fn pose([x, y, z, wi, jk]: [u32; 5]) -> WirePose {
    let (low, high) = (|word: u32| word as i16, |word: u32| (word >> 16) as i16);
    let position_um = [x as i32, y as i32, z as i32];
    WirePose { position_um, orientation_q15: [low(wi), high(wi), low(jk), high(jk)] }
}

/// None of another length.
fn words<const WORDS: usize>(payload: &[u8]) -> Option<[u32; WORDS]> {
    let (words, []) = payload.as_chunks::<4>() else { return None };
    let words: &[[u8; 4]; WORDS] = words.try_into().ok()?;
    Some(words.map(u32::from_le_bytes))
}

/// Bytes of a set-point, without CRC.
pub const SET_POINT: usize = 40;
/// Bytes of an answer, without CRC.
pub const ACTUAL: usize = 44;
/// Bytes of a frame to the robot, delimiters included.
pub const SET_POINT_FRAME: usize = frame::encoded_bytes(SET_POINT);
/// Bytes of a frame from the robot, delimiters included.
pub const ACTUAL_FRAME: usize = frame::encoded_bytes(ACTUAL);

/// Deframer of the pendant.
pub type ActualDeframer = frame::Deframer<{ frame::stuffed_bytes(ACTUAL) }>;
/// Deframer of the robot's end.
pub type SetPointDeframer = frame::Deframer<{ frame::stuffed_bytes(SET_POINT) }>;
