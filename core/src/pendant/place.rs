//! Where the torch is, and whether it is where a path begins or goes on.
//!
//! With a robot port the robot says it. Without one it is unknown after power-on and after every E-stop, until the
//! operator, who has looked, confirms at the pendant that the torch is where it is to begin or to go on; from then on it
//! is where it was commanded to be.

use super::ring::turn_mrad;
use super::robot::Monitor;
use super::{Pendant, Slots};
use crate::interlock::State;
use crate::wire::{Refusal, WirePose};

impl<const RING: usize, S: Slots> Pendant<RING, S> {
    /// Where the torch is, if anybody knows.
    pub fn torch(&self) -> Option<WirePose> {
        if self.robot.is_some() { self.robot_torch() } else { self.known.then_some(self.pose) }
    }

    /// Where a robot at the port says that it is.
    pub(super) fn robot_torch(&self) -> Option<WirePose> {
        self.robot.as_ref().and_then(Monitor::torch)
    }

    /// Where a Start or a Resume would begin.
    fn entry(&self) -> Option<WirePose> {
        match self.state() {
            State::Held => Some(self.pose),
            State::Ready | State::Loading if self.loaded => self.ring.get(0).map(|slot| slot.waypoint.pose),
            _ => None,
        }
    }

    /// Refuses unless the torch is within the limits of where it has to be.
    pub(super) fn check_place(&self) -> Result<(), Refusal> {
        let entry = self.entry().ok_or(Refusal::PoseUnknown)?;
        self.check_near(&entry)
    }

    /// Refuses unless the torch, or the camera in its place, is within the limits of `wanted`; a robot's own word of how
    /// far it is from where it was to be counts, too.
    pub(super) fn check_near(&self, wanted: &WirePose) -> Result<(), Refusal> {
        let here = self.torch().ok_or(Refusal::PoseUnknown)?;
        let error_um = self.robot.as_ref().map_or(0, Monitor::error_um);
        let distance_um = (here.distance_um(wanted) as u32).max(error_um);
        let turn_mrad = turn_mrad(&here, wanted) as u32;
        if distance_um <= self.limits.near_um && turn_mrad <= self.limits.near_mrad {
            Ok(())
        } else {
            Err(Refusal::Away { distance_um, turn_mrad })
        }
    }

    /// The operator's button: its edge counts, while nothing moves and there is a place to confirm.
    pub(super) fn read_confirmation(&mut self, pressed: bool) {
        let edge = pressed && !self.confirm_pressed;
        self.confirm_pressed = pressed;
        if self.interlock.fault().is_some_and(crate::interlock::Fault::is_local) {
            self.known = false;
        } else if let Some(entry) = self.entry().filter(|_| edge && self.stands()) {
            self.pose = entry;
            self.known = true;
            self.report.hurry();
        }
    }
}
