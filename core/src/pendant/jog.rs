//! Hands move the camera: only in Idle, enabled, with the key in manual, and by the pendant's own clock.

use super::drive::Machine;
use super::ring::turn_mrad;
use super::robot::{Monitor, Robot};
use super::{Pendant, Slots};
use crate::interlock::State;
use crate::math;
use crate::path::TorchPose;
use crate::rotation::Arc;
use crate::wire::{JogLimits, Refusal, WirePose};

/// Of speed times the time of a stop: a stop from full speed goes half of that. A fifth less, so that a robot that is slow is
/// waited for, and not taken out of the hands for being off.
const LEAD: f32 = 0.4;

/// What hand-guided motion knows from tick to tick.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Jogging {
    /// Whether hands have moved the camera since the switch was gripped.
    pub(super) begun: bool,
    /// Where the camera is to be, for a robot at the port.
    target: Option<WirePose>,
    /// Where it is commanded to be.
    pub(super) commanded: Option<WirePose>,
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

    /// One tick; all of it is dropped at disable.
    pub(super) fn advance_jog(&mut self) {
        if self.may_jog().is_err() || !self.host.is_heard(self.ticks) {
            self.robot.jogging = Jogging::default();
        } else {
            self.robot.advance_jog(&self.limits.jog, &self.machine);
        }
    }
}

impl Robot {
    /// Where hands move the camera from: where it is commanded to be, and at first where the robot is. Without a robot
    /// the camera is where it is told to be, and whoever reads the gestures knows it.
    pub(super) fn jog_from(&self) -> Option<WirePose> {
        self.jogging.commanded.or(self.port.as_ref().and_then(Monitor::torch))
    }

    /// The camera pose that a hand frame made. The camera may not leave the workspace, nor may the flange that bears it.
    pub(super) fn jog_to(&mut self, target: &WirePose, limits: &JogLimits) {
        let Some(from) = self.jog_from() else { return };
        let out_um = |camera| self.flange(camera).map_or(f32::INFINITY, |flange| outside_um(&flange, limits));
        let farther_out = out_um(target) > out_um(&from);
        self.jogging.target = Some(if farther_out { from } else { *target });
    }

    /// The commanded pose follows its target within the limits, no farther ahead of the robot than it needs to stop.
    fn advance_jog(&mut self, limits: &JogLimits, machine: &Machine) {
        let torch = self.port.as_ref().and_then(Monitor::torch);
        let (Some(target), Some(torch)) = (self.jogging.target, torch) else { return };
        let from = self.jogging.commanded.unwrap_or(torch);
        let step_mm = limits.speed_um_s as f32 * 1e-3 * machine.tick_s;
        let turn_rad = limits.turn_mrad_s as f32 * 1e-3 * machine.tick_s;
        // Not farther ahead than it goes while it stops from the fastest motion that hands can make.
        let stop_s = limits.speed_um_s as f32 / machine.accel_um_s2;
        let leads =
            |ahead: f32, before: f32, speed: u32| ahead > LEAD * stop_s * speed as f32 && ahead > before;
        let runs_ahead = |next: &WirePose| {
            leads(torch.distance_um(next), torch.distance_um(&from), limits.speed_um_s)
                || leads(turn_mrad(&torch, next), turn_mrad(&torch, &from), limits.turn_mrad_s)
        };
        let next = toward(&from, &target, step_mm, turn_rad);
        self.jogging.commanded = next.filter(|next| !runs_ahead(next)).or(Some(from));
    }
}

/// How far a position is outside the workspace, summed over the axes, µm. Not inlined: flash.
#[inline(never)]
fn outside_um(pose: &WirePose, limits: &JogLimits) -> f32 {
    let bounds = limits.least_um.into_iter().zip(limits.most_um);
    let beyond = |(um, (least, most)): (i32, (i32, i32))| um.abs_diff(um.min(most).max(least));
    pose.position_um.into_iter().zip(bounds).map(beyond).map(|um| um as f32).sum()
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
