//! Where the torch is, and whether it is where a path begins or goes on.
//!
//! With a robot port the robot says it. Without one it is unknown after power-on and after every E-stop, until the
//! operator, who has looked, confirms at the pendant that the torch is where it is to begin or to go on; from then on it
//! is where it was commanded to be.

use core::mem;

use super::ring::turn_mrad;
use super::robot::{Monitor, Robot};
use super::{Pendant, Slots};
use crate::interlock::{Fault, State};
use crate::wire::{Limits, Refusal, WirePose};

/// What the pendant knows of it by itself.
#[derive(Debug, Clone)]
pub(super) struct Place {
    /// Where it was last to be.
    pub(super) commanded: WirePose,
    /// The operator has seen it there.
    confirmed: bool,
    /// The operator's button at the last tick; one that is held from power-on on does not count.
    pressed: bool,
}

impl Place {
    pub(super) const UNKNOWN: Self = Self { commanded: WirePose::IDENTITY, confirmed: false, pressed: true };
}

impl Robot {
    /// Where the torch is, if anybody knows.
    pub(super) fn torch(&self) -> Option<WirePose> {
        let place = &self.place;
        self.port.as_ref().map_or(place.confirmed.then_some(place.commanded), Monitor::torch)
    }

    /// Refuses unless the torch, or the camera in its place, is within the limits of `wanted`; a robot's own word of how
    /// far it is from where it was to be counts, too.
    pub(super) fn check_near(&self, wanted: &WirePose, limits: &Limits) -> Result<(), Refusal> {
        let here = self.torch().ok_or(Refusal::PoseUnknown)?;
        let error_um = self.port.as_ref().map_or(0, Monitor::error_um);
        let distance_um = (here.distance_um(wanted) as u32).max(error_um);
        let turn_mrad = turn_mrad(&here, wanted) as u32;
        if distance_um <= limits.near_um && turn_mrad <= limits.near_mrad {
            Ok(())
        } else {
            Err(Refusal::Away { distance_um, turn_mrad })
        }
    }
}

impl<const RING: usize, S: Slots> Pendant<RING, S> {
    /// Where the torch is, if anybody knows.
    pub fn torch(&self) -> Option<WirePose> {
        self.robot.torch()
    }

    /// Where a Start or a Resume would begin.
    fn entry(&self) -> Option<WirePose> {
        match self.state() {
            State::Held => Some(self.robot.place.commanded),
            State::Ready | State::Loading => self.path.first(),
            _ => None,
        }
    }

    /// Refuses unless the torch is within the limits of where it has to be.
    pub(super) fn check_place(&self) -> Result<(), Refusal> {
        let entry = self.entry().ok_or(Refusal::PoseUnknown)?;
        self.robot.check_near(&entry, &self.limits)
    }

    /// The operator's button: its edge counts, while nothing moves and there is a place to confirm.
    pub(super) fn read_confirmation(&mut self, pressed: bool) {
        let edge = !mem::replace(&mut self.robot.place.pressed, pressed) && pressed;
        if self.interlock.fault().is_some_and(Fault::is_local) {
            self.robot.place.confirmed = false;
        } else if let Some(entry) = self.entry().filter(|_| edge && self.stands()) {
            self.robot.place = Place { commanded: entry, confirmed: true, pressed };
            self.report.hurry();
        }
    }
}
