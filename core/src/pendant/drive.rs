//! Motion along the received path: where the torch is, how fast, and where it will be a tick later.
//!
//! Lengths are micrometres, speeds micrometres per second. The speed of a tick is chosen so that after it the torch
//! can still stop, or slow down, before whatever asks for it: with `r` to go to a waypoint that may be passed at `w`,
//! `v² + 2 a v dt <= w² + 2 a r`. It then never leaves the planned speeds and never brakes harder than `a`.

use super::ring::{Ring, Slot, Slots};
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

/// The torch on its path.
#[derive(Debug, Clone)]
pub(super) struct Drive {
    segment: u32,
    along_um: f32,
    speed_um_s: f32,
    back_um: f32,
    interpolated: Option<(u32, Segment)>,
}

impl Drive {
    pub(super) const fn new() -> Self {
        Self { segment: 0, along_um: 0.0, speed_um_s: 0.0, back_um: 0.0, interpolated: None }
    }

    pub(super) fn segment(&self) -> u32 {
        self.segment
    }

    pub(super) fn speed_um_s(&self) -> f32 {
        self.speed_um_s
    }

    pub(super) fn is_moving(&self) -> bool {
        self.speed_um_s > 0.0
    }

    /// Stands at once, without a way to stop in.
    pub(super) fn stand(&mut self) {
        self.speed_um_s = 0.0;
    }

    /// How far one could go back.
    pub(super) fn kept_um<const N: usize, S: Slots>(&self, ring: &Ring<N, S>) -> f32 {
        ring.kept_um(self.segment) + self.along_um
    }

    /// Go back this far before going on.
    pub(super) fn retrace(&mut self, back_um: f32) {
        self.back_um = back_um;
    }

    /// Whether the segment is to be welded now: not on the way back.
    pub(super) fn wants_weld<const N: usize, S: Slots>(&self, ring: &Ring<N, S>) -> bool {
        self.back_um <= 0.0 && ring.get(self.segment).is_some_and(|slot| slot.waypoint.weld)
    }

    /// Standing where a run of equally welded segments ends.
    pub(super) fn is_at_run_end<const N: usize, S: Slots>(&self, ring: &Ring<N, S>) -> bool {
        if self.is_moving() || self.back_um > 0.0 {
            return false;
        }
        let (Some(from), Some(to)) = (ring.get(self.segment), self.end(ring)) else { return false };
        let changes = from.waypoint.weld != to.waypoint.weld || self.ends_path(ring);
        changes && self.along_um >= to.approach_um
    }

    /// Standing at the end of the whole path.
    pub(super) fn is_at_path_end<const N: usize, S: Slots>(&self, ring: &Ring<N, S>) -> bool {
        self.ends_path(ring) && self.is_at_run_end(ring)
    }

    fn ends_path<const N: usize, S: Slots>(&self, ring: &Ring<N, S>) -> bool {
        self.segment.saturating_add(2) == ring.begin().total
    }

    fn end<'r, const N: usize, S: Slots>(&self, ring: &'r Ring<N, S>) -> Option<&'r Slot> {
        ring.get(self.segment.checked_add(1)?)
    }

    /// The path received so far ends within the stopping distance, and it is not the committed end.
    pub(super) fn is_starved<const N: usize, S: Slots>(&self, ring: &Ring<N, S>, machine: &Machine) -> bool {
        if ring.is_sealed() {
            return false;
        }
        let ahead_um = ring.next().checked_sub(1).and_then(|last| ring.length_um(self.segment, last));
        let stop_um = self.speed_um_s * (self.speed_um_s / (2.0 * machine.accel_um_s2) + machine.tick_s);
        ahead_um.unwrap_or(0.0) - self.along_um <= stop_um
    }

    /// One tick.
    pub(super) fn advance<const N: usize, S: Slots>(
        &mut self,
        ring: &Ring<N, S>,
        motion: Motion,
        feed_limit_um_s: f32,
        machine: &Machine,
    ) {
        if self.back_um > 0.0 {
            return self.go_back(ring, motion, feed_limit_um_s, machine);
        }
        if motion == Motion::Pass && self.is_at_run_end(ring) {
            self.pass(ring);
            return;
        }
        let (Some(from), Some(to)) = (ring.get(self.segment), self.end(ring)) else {
            self.speed_um_s = 0.0;
            return;
        };
        let feed = (from.waypoint.feed_um_s as f32).min(feed_limit_um_s).min(to.fastest_um_s);
        let allowed = machine.speed_before(to.pass_speed2, to.approach_um - self.along_um);
        self.speed_um_s = machine.next_speed(self.speed_um_s, motion, feed).min(allowed);
        self.go_on(ring, self.speed_um_s * machine.tick_s);
    }

    /// On to the next segment, if it is there.
    fn pass<const N: usize, S: Slots>(&mut self, ring: &Ring<N, S>) {
        if self.segment.checked_add(2).is_some_and(|index| ring.get(index).is_some()) {
            self.segment += 1;
            self.along_um = 0.0;
        }
    }

    fn go_on<const N: usize, S: Slots>(&mut self, ring: &Ring<N, S>, step_um: f32) {
        self.along_um += step_um;
        for _ in 0..MAX_PASSED {
            let Some(end) = self.end(ring) else { return };
            let over_um = self.along_um - end.approach_um;
            if end.pass_speed2 <= 0.0 {
                if over_um > -ARRIVED_UM {
                    self.along_um = end.approach_um;
                    self.speed_um_s = 0.0;
                }
                return;
            }
            if over_um < 0.0 {
                return;
            }
            self.segment += 1;
            self.along_um = over_um;
        }
    }

    /// One tick of the way back, at a speed that needs no plan for corners.
    fn go_back<const N: usize, S: Slots>(
        &mut self,
        ring: &Ring<N, S>,
        motion: Motion,
        feed_limit_um_s: f32,
        machine: &Machine,
    ) {
        let feed = machine.retrace_um_s.min(feed_limit_um_s);
        let allowed = machine.speed_before(0.0, self.back_um);
        self.speed_um_s = machine.next_speed(self.speed_um_s, motion, feed).min(allowed);
        let step_um = self.speed_um_s * machine.tick_s;
        self.back_um -= step_um;
        self.along_um -= step_um;
        for _ in 0..MAX_PASSED {
            let Some(start) = ring.get(self.segment) else { break };
            if self.along_um >= 0.0 || self.segment == 0 {
                break;
            }
            self.segment -= 1;
            self.along_um += start.approach_um;
        }
        self.along_um = self.along_um.max(0.0);
        if self.back_um < ARRIVED_UM {
            self.back_um = 0.0;
            self.speed_um_s = 0.0;
        }
    }

    /// Share of the segment, 2^24 = 1.
    pub(super) fn alpha_q24<const N: usize, S: Slots>(&self, ring: &Ring<N, S>) -> u32 {
        let length_um = self.end(ring).map_or(0.0, |end| end.approach_um);
        if length_um > 0.0 {
            ((self.along_um / length_um * ALPHA_ONE as f32) as u32).min(ALPHA_ONE)
        } else {
            0
        }
    }

    /// The pose the torch has to have now; the segment's constants are computed once.
    pub(super) fn pose<const N: usize, S: Slots>(
        &mut self,
        ring: &Ring<N, S>,
        alpha_q24: u32,
    ) -> Option<WirePose> {
        let segment = match &self.interpolated {
            Some((index, segment)) if *index == self.segment => segment,
            _ => {
                let (from, to) = (ring.get(self.segment)?, self.end(ring)?);
                let segment = Segment::new(&from.waypoint.pose.to_pose()?, &to.waypoint.pose.to_pose()?);
                &self.interpolated.insert((self.segment, segment)).1
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
