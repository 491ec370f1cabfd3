//! Hands move the camera: only in Idle, enabled, with the key in manual, and by the pendant's own clock.

use super::{Pendant, Slots};
use crate::interlock::State;
use crate::math;
use crate::path::TorchPose;
use crate::rotation::Arc;
use crate::wire::{Refusal, WirePose};

/// What hand-guided motion knows from tick to tick.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Jogging {
    /// Whether hands have moved the camera since the switch was gripped.
    begun: bool,
    /// Where the camera is to be, for a robot at the port.
    target: Option<WirePose>,
    /// Where it is commanded to be.
    commanded: Option<WirePose>,
}

impl<const RING: usize, S: Slots> Pendant<RING, S> {
    /// Whether hands may move the camera now.
    pub(super) fn may_jog(&self) -> Result<(), Refusal> {
        match self.state() {
            State::Running | State::Holding => Err(Refusal::Moving),
            State::Disabled => Err(Refusal::NotEnabled),
            State::Idle if !self.panel.manual => Err(Refusal::NotManual),
            State::Idle if !self.interlock.is_enabled() => Err(Refusal::NotEnabled),
            State::Idle => Ok(()),
            state => Err(Refusal::State(state)),
        }
    }

    /// Whether this is the first hand frame since hands may move the camera.
    pub(super) fn begin_jogging(&mut self) -> bool {
        !core::mem::replace(&mut self.jogging.begun, true)
    }

    /// The camera pose that a hand frame made. Without a robot the camera is where it is told to be.
    pub(super) fn jog_to(&mut self, target: &WirePose) {
        if self.robot.is_some() && self.may_jog().is_ok() {
            self.jogging.target = Some(*target);
        }
    }

    /// One tick: the commanded pose follows its target within the limits; all of it is dropped at disable.
    pub(super) fn advance_jog(&mut self) {
        if self.may_jog().is_err() || !self.is_heard() {
            self.jogging = Jogging::default();
            return;
        }
        let (Some(target), Some(robot)) = (self.jogging.target, &self.robot) else { return };
        let from = self.jogging.commanded.or_else(|| robot.torch());
        let limits = &self.limits.jog;
        let step_mm = limits.speed_um_s as f32 * 1e-3 * self.machine.tick_s;
        let turn_rad = limits.turn_mrad_s as f32 * 1e-3 * self.machine.tick_s;
        self.jogging.commanded = from.and_then(|from| toward(&from, &target, step_mm, turn_rad));
    }

    /// Whether hands have moved the camera since the switch was gripped: only they give it a target.
    pub(super) fn jogs(&self) -> bool {
        self.jogging.begun
    }

    /// Where hands have the camera commanded to be.
    pub(super) fn jogged(&self) -> Option<WirePose> {
        self.jogging.commanded
    }
}

/// A step from a pose toward another.
fn toward(from: &WirePose, to: &WirePose, step_mm: f32, turn_rad: f32) -> Option<WirePose> {
    let (from, to) = (from.to_pose()?, to.to_pose()?);
    let way = to.position_mm - from.position_mm;
    let (way_mm, arc) = (math::norm(&way), Arc::between(&from.orientation, &to.orientation));
    let share = |whole: f32, part: f32| if whole > part { part / whole } else { 1.0 };
    WirePose::from_pose(&TorchPose {
        position_mm: from.position_mm + way * share(way_mm, step_mm),
        orientation: arc.slerp(share(arc.angle_rad(), turn_rad)),
    })
}
