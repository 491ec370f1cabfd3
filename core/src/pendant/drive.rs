//! Motion along the received path: where the torch is, how fast, and where it will be a tick later.
//!
//! Lengths are micrometres, speeds micrometres per second. The speed of a tick is chosen so that after it the torch
//! can still stop, or slow down, before whatever asks for it: with `r` to go to a waypoint that may be passed at `w`,
//! `v² + 2 a v dt <= w² + 2 a r`. It then never leaves the planned speeds and never brakes harder than `a`.

use super::SetPoint;
use super::path::Path;
use super::ring::{Slot, Slots};
use crate::interlock::Motion;
use crate::math;
use crate::path::interpolation::Segment;
use crate::wire::WirePose;

/// 1.0 of a share of a segment.
pub const ALPHA_ONE: u32 = 1 << 24;

/// Nearer than this to a stop is there.
const ARRIVED_UM: f32 = 0.5;
/// Waypoints passed in a tick at most: a bound for the loop, more than the shortest step and the fastest feed make.
const MAX_PASSED: u8 = 16;

/// What the machine allows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Machine {
    pub(super) tick_s: f32,
    pub(super) accel_um_s2: f32,
    pub(super) emergency_um_s2: f32,
    pub(super) retrace_um_s: f32,
}

/// The torch on its path, at first at the start.
#[derive(Debug, Clone, Default)]
pub(super) struct Drive {
    pub(super) started: bool,
    /// A crater that was cut short is welded over.
    pub(super) rewelds: bool,
    pub(super) segment: u32,
    pub(super) speed_um_s: f32,
    along_um: f32,
    /// To go back before going on.
    pub(super) back_um: f32,
    interpolated: Option<(u32, Segment)>,
}

impl Drive {
    pub(super) fn is_moving(&self) -> bool {
        self.speed_um_s > 0.0
    }
}

impl<const RING: usize, S: Slots> Path<RING, S> {
    /// How far one could go back.
    pub(super) fn kept_um(&self) -> f32 {
        self.ring.kept_um(self.drive.segment) + self.drive.along_um
    }

    fn here(&self) -> Option<&Slot> {
        self.ring.get(self.drive.segment)
    }

    fn end(&self) -> Option<&Slot> {
        self.ring.get(self.drive.segment.checked_add(1)?)
    }

    /// Whether the segment is to be welded now: not on the way back.
    pub(super) fn wants_weld(&self) -> bool {
        self.drive.back_um <= 0.0 && self.here().is_some_and(|slot| slot.waypoint.weld)
    }

    /// Whether the segment is to be welded faster than this.
    pub(super) fn welds_faster(&self, feed_um_s: u32) -> bool {
        self.here().is_some_and(|slot| slot.waypoint.weld && slot.waypoint.feed_um_s > feed_um_s)
    }

    /// Standing where a run of equally welded segments ends.
    pub(super) fn is_at_run_end(&self) -> bool {
        if self.drive.is_moving() || self.drive.back_um > 0.0 {
            return false;
        }
        let (Some(from), Some(to)) = (self.here(), self.end()) else { return false };
        let changes = from.waypoint.weld != to.waypoint.weld || self.ends();
        changes && self.drive.along_um >= to.approach_um
    }

    /// Standing at the end of the whole path.
    pub(super) fn is_at_end(&self) -> bool {
        self.ends() && self.is_at_run_end()
    }

    fn ends(&self) -> bool {
        self.drive.segment.saturating_add(2) == self.ring.begin().total
    }

    /// The path received so far ends within the stopping distance, and it is not the committed end.
    pub(super) fn is_starved(&self, machine: &Machine) -> bool {
        if self.ring.is_sealed() {
            return false;
        }
        let Drive { segment, speed_um_s, along_um, .. } = self.drive;
        let ahead_um = self.ring.next().checked_sub(1).and_then(|last| self.ring.length_um(segment, last));
        let stop_um = speed_um_s * (speed_um_s / (2.0 * machine.accel_um_s2) + machine.tick_s);
        ahead_um.unwrap_or(0.0) - along_um <= stop_um
    }

    /// One tick; `runs` unless something holds it.
    pub(super) fn follow(
        &mut self,
        runs: bool,
        motion: Motion,
        feed_limit_um_s: f32,
        machine: &Machine,
    ) -> Option<SetPoint> {
        self.advance(motion, feed_limit_um_s, machine);
        // A hold ends the way back; gas that still flows after the arc only delays it.
        if !runs && !self.drive.is_moving() {
            self.drive.back_um = 0.0;
        }
        self.ring.release(self.drive.segment);
        let alpha_q24 = self.alpha_q24();
        Some(SetPoint { segment: self.drive.segment, alpha_q24, pose: self.pose(alpha_q24)? })
    }

    fn advance(&mut self, motion: Motion, feed_limit_um_s: f32, machine: &Machine) {
        if self.drive.back_um > 0.0 {
            return self.go_back(motion, feed_limit_um_s, machine);
        }
        if motion == Motion::Pass && self.is_at_run_end() {
            self.pass();
            return;
        }
        let (Some(from), Some(to)) = (self.here(), self.end()) else {
            self.drive.speed_um_s = 0.0;
            return;
        };
        let feed = (from.waypoint.feed_um_s as f32).min(feed_limit_um_s).min(to.fastest_um_s);
        let allowed = machine.speed_before(to.pass_speed2, to.approach_um - self.drive.along_um);
        self.drive.speed_um_s = machine.next_speed(self.drive.speed_um_s, motion, feed).min(allowed);
        self.go_on(self.drive.speed_um_s * machine.tick_s);
    }

    /// On to the next segment, if it is there.
    fn pass(&mut self) {
        if self.drive.segment.checked_add(2).is_some_and(|index| self.ring.get(index).is_some()) {
            self.drive.segment += 1;
            self.drive.along_um = 0.0;
        }
    }

    fn go_on(&mut self, step_um: f32) {
        self.drive.along_um += step_um;
        for _ in 0..MAX_PASSED {
            let Some(&Slot { approach_um, pass_speed2, .. }) = self.end() else { return };
            let over_um = self.drive.along_um - approach_um;
            if pass_speed2 <= 0.0 {
                if over_um > -ARRIVED_UM {
                    self.drive.along_um = approach_um;
                    self.drive.speed_um_s = 0.0;
                }
                return;
            }
            if over_um < 0.0 {
                return;
            }
            self.drive.segment += 1;
            self.drive.along_um = over_um;
        }
    }

    /// One tick of the way back, at a speed that needs no plan for corners.
    fn go_back(&mut self, motion: Motion, feed_limit_um_s: f32, machine: &Machine) {
        let drive = &mut self.drive;
        let feed = machine.retrace_um_s.min(feed_limit_um_s);
        let allowed = machine.speed_before(0.0, drive.back_um);
        drive.speed_um_s = machine.next_speed(drive.speed_um_s, motion, feed).min(allowed);
        let step_um = drive.speed_um_s * machine.tick_s;
        drive.back_um -= step_um;
        drive.along_um -= step_um;
        for _ in 0..MAX_PASSED {
            let Some(start) = self.ring.get(drive.segment) else { break };
            if drive.along_um >= 0.0 || drive.segment == 0 {
                break;
            }
            drive.segment -= 1;
            drive.along_um += start.approach_um;
        }
        drive.along_um = drive.along_um.max(0.0);
        if drive.back_um < ARRIVED_UM {
            drive.back_um = 0.0;
            drive.speed_um_s = 0.0;
        }
    }

    /// Share of the segment, 2^24 = 1.
    pub(super) fn alpha_q24(&self) -> u32 {
        let length_um = self.end().map_or(0.0, |end| end.approach_um);
        if length_um > 0.0 {
            ((self.drive.along_um / length_um * ALPHA_ONE as f32) as u32).min(ALPHA_ONE)
        } else {
            0
        }
    }

    /// The pose the torch has to have now; the segment's constants are computed once.
    fn pose(&mut self, alpha_q24: u32) -> Option<WirePose> {
        let segment = match &self.drive.interpolated {
            Some((index, segment)) if *index == self.drive.segment => segment,
            _ => {
                let (from, to) =
                    (self.here()?.waypoint.pose.to_pose()?, self.end()?.waypoint.pose.to_pose()?);
                &self.drive.interpolated.insert((self.drive.segment, Segment::new(&from, &to))).1
            }
        };
        WirePose::from_pose(&segment.at(share(alpha_q24)))
    }
}

impl Machine {
    /// Fastest speed of this tick with `rest_um` to go to where the square of the speed may be `speed2`.
    fn speed_before(&self, speed2: f32, rest_um: f32) -> f32 {
        let change = self.accel_um_s2 * self.tick_s;
        let root = math::sqrt(change * change + speed2 + 2.0 * self.accel_um_s2 * rest_um.max(0.0));
        (root - change).max(0.0)
    }

    fn next_speed(&self, speed: f32, motion: Motion, feed: f32) -> f32 {
        let change = self.accel_um_s2 * self.tick_s;
        match motion {
            Motion::Run | Motion::Pass => feed.max(speed - change).min(speed + change),
            Motion::Halt => (speed - change).max(0.0),
            Motion::EmergencyStop => (speed - self.emergency_um_s2 * self.tick_s).max(0.0),
        }
    }
}

fn share(alpha_q24: u32) -> f32 {
    alpha_q24 as f32 / ALPHA_ONE as f32
}

/// The pose at `alpha_q24` of the segment between two poses, as the pendant computes it: for those who compare.
///
/// `None` if an orientation is no unit quaternion.
pub fn set_point(from: &WirePose, to: &WirePose, alpha_q24: u32) -> Option<WirePose> {
    WirePose::from_pose(&Segment::new(&from.to_pose()?, &to.to_pose()?).at(share(alpha_q24)))
}
