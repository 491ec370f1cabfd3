//! An arm at the robot port: follows set-points with lag, limits and noise, and says where it is. No vendor's robot.
//!
//! The binary `arm` runs it in a process of its own behind a socket; a bridge to a robot takes its place.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use weldpath_core::wire::frame::Received;
use weldpath_core::wire::port::{
    ACTUAL_FRAME, Actual, Drives, SET_POINT_FRAME, SetPointDeframer, WireSetPoint,
};
use weldpath_core::wire::{Q15_ONE, WirePose};

use crate::adversary::Random;

/// What an arm can do.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Time constant of its following, s.
    pub lag_s: f64,
    /// Fastest motion of the flange, mm/s.
    pub speed_mm_s: f64,
    /// Fastest turn, rad/s.
    pub turn_rad_s: f64,
    /// Standard deviation, roughly, of what its encoders say, mm.
    pub noise_mm: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { lag_s: 0.012, speed_mm_s: 500.0, turn_rad_s: 6.0, noise_mm: 0.01 }
    }
}

/// Answers for which a frame may have been on its way: in the emulator each stands for ten frames.
const FRESH_ANSWERS: u32 = 50;

/// The arm.
pub struct Arm {
    limits: Limits,
    base_from_flange: Isometry3<f64>,
    target: Option<Isometry3<f64>>,
    bytes: SetPointDeframer,
    /// Session and tick of the newest frame.
    heard: Option<(u32, u32)>,
    nonce: u32,
    sent: u32,
    lost: u16,
    random: Random,
    /// State that it reports.
    pub drives: Drives,
    /// It does not move, and says that all is well.
    pub jammed: bool,
    /// Farthest jump of a set-point from the one before it, or from where the arm stood, mm.
    pub farthest_jump_mm: f64,
    /// Set-point frames with the arc on.
    pub arc_frames: u64,
    /// Set-point frames.
    pub frames: u64,
}

impl Arm {
    /// Standing there, its drives ready.
    pub fn at(pose: &WirePose, limits: Limits, seed: u64) -> Self {
        Self {
            limits,
            base_from_flange: isometry(pose),
            target: None,
            bytes: SetPointDeframer::new(),
            heard: None,
            nonce: seed as u32 | 1,
            sent: 0,
            lost: 0,
            random: Random::new(seed),
            drives: Drives::Following,
            jammed: false,
            farthest_jump_mm: 0.0,
            arc_frames: 0,
            frames: 0,
        }
    }

    /// It goes no faster from now on, mm/s.
    pub fn limit(&mut self, speed_mm_s: f64) {
        self.limits.speed_mm_s = speed_mm_s;
    }

    /// Where it really is.
    pub fn pose(&self) -> WirePose {
        wire(&self.base_from_flange)
    }

    /// Somebody moves it by hand, or a program of its own does.
    pub fn put(&mut self, pose: &WirePose) {
        self.base_from_flange = isometry(pose);
        self.target = None;
    }

    /// Bytes from the pendant; the answer to the newest frame in them.
    pub fn take(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        let mut newest = false;
        for &byte in bytes {
            let Some(Received::Payload(payload)) = self.bytes.push(byte) else { continue };
            let Some(frame) = WireSetPoint::from_bytes(payload) else { continue };
            newest |= self.follow(&frame);
        }
        newest.then(|| self.answer())
    }

    /// One frame; false if it is not newer than the last, or a recorded one would move the arm.
    pub fn follow(&mut self, frame: &WireSetPoint) -> bool {
        let last = self.heard.filter(|(session, _)| *session == frame.session);
        let gap = last.map_or(1, |(_, tick)| frame.tick.wrapping_sub(tick));
        let age = self.sent.wrapping_sub(frame.heard);
        let fresh = frame.robot == self.nonce && age <= FRESH_ANSWERS;
        if gap == 0 || gap > u32::MAX / 2 || frame.motion && !fresh {
            return false;
        }
        let ticks = gap.min(500);
        self.lost = self.lost.wrapping_add((gap - 1) as u16);
        self.heard = Some((frame.session, frame.tick));
        self.frames += 1;
        self.arc_frames += u64::from(frame.arc);
        let wanted = frame.pose.as_ref().map(isometry);
        if let Some(wanted) = &wanted {
            let from = self.target.as_ref().unwrap_or(&self.base_from_flange);
            let jump_mm = (wanted.translation.vector - from.translation.vector).norm();
            self.farthest_jump_mm = self.farthest_jump_mm.max(jump_mm);
        }
        self.target = wanted;
        if frame.motion && self.drives == Drives::Following && !self.jammed {
            (0..ticks).for_each(|_| self.step());
        }
        true
    }

    /// One set-point period of motion.
    fn step(&mut self) {
        const TICK_S: f64 = 0.002;
        let Some(target) = &self.target else { return };
        let share = 1.0 - (-TICK_S / self.limits.lag_s).exp();
        let here = self.base_from_flange;
        let way = (target.translation.vector - here.translation.vector) * share;
        let most_mm = self.limits.speed_mm_s * TICK_S;
        let way = if way.norm() > most_mm { way * (most_mm / way.norm()) } else { way };
        let angle = here.rotation.angle_to(&target.rotation);
        let turn = (angle * share).min(self.limits.turn_rad_s * TICK_S);
        let rotation =
            if angle > 1e-9 { here.rotation.slerp(&target.rotation, turn / angle) } else { here.rotation };
        self.base_from_flange =
            Isometry3::from_parts(Translation3::from(here.translation.vector + way), rotation);
    }

    /// What it says after the last frame.
    pub fn answer(&mut self) -> Vec<u8> {
        frame_of(&self.actual()).to_vec()
    }

    /// The same before encoding.
    pub fn actual(&mut self) -> Actual {
        self.sent = self.sent.wrapping_add(1);
        let mut noise = || self.limits.noise_mm * (self.random.unit() + self.random.unit() - 1.0) * 2.4;
        let shaken = Vector3::new(noise(), noise(), noise());
        let seen = Isometry3::from_parts(
            Translation3::from(self.base_from_flange.translation.vector + shaken),
            self.base_from_flange.rotation,
        );
        let error_mm = self.target.map_or(0.0, |at| (at.translation.vector - seen.translation.vector).norm());
        Actual {
            robot: self.nonce,
            sequence: self.sent,
            session: self.heard.map_or(0, |(session, _)| session),
            heard: self.heard.map_or(0, |(_, tick)| tick),
            lost: self.lost,
            pose: wire(&seen),
            error_um: (error_mm * 1000.0) as u32,
            drives: self.drives,
        }
    }
}

/// A set-point as it travels.
pub fn told(frame: &WireSetPoint) -> [u8; SET_POINT_FRAME] {
    let mut out = [0; SET_POINT_FRAME];
    frame.write(&mut out);
    out
}

/// An answer as it travels.
pub fn frame_of(actual: &Actual) -> [u8; ACTUAL_FRAME] {
    let mut out = [0; ACTUAL_FRAME];
    actual.write(&mut out);
    out
}

/// In mm.
fn isometry(pose: &WirePose) -> Isometry3<f64> {
    let [x, y, z] = pose.position_um.map(|um| f64::from(um) * 1e-3);
    let [w, i, j, k] = pose.orientation_q15.map(f64::from);
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    Isometry3::from_parts(Translation3::new(x, y, z), rotation)
}

fn wire(pose: &Isometry3<f64>) -> WirePose {
    let position_um = [0, 1, 2].map(|axis| (pose.translation.vector[axis] * 1000.0).round() as i32);
    let q = pose.rotation.quaternion();
    let orientation_q15 = [q.w, q.i, q.j, q.k].map(|c| (c * f64::from(Q15_ONE)).round() as i16);
    WirePose { position_um, orientation_q15 }
}
