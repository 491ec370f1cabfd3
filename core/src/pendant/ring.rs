//! The waypoints received: placed exactly once by their index, checked before they are stored, planned as they join.
//!
//! Indices count from the start of the path; `tail..next` are there without a gap and may be followed, further chunks
//! beyond a gap are kept and shown in the selective-ack map. Lengths are micrometres, speeds micrometres per second.

use core::borrow::BorrowMut;
use core::num::NonZeroU32;

use crate::math;
use crate::wire::{
    self, Ack, Begin, Chunk, ChunkRefusal, Limits, Q15_ONE, SACK_CHUNKS, WirePose, WireWaypoint,
};

/// A turn of 1 rad counts as this much path, so that a torch turning on the spot takes its time.
pub(super) const TURN_LEVER_UM: f32 = 10_000.0;

/// Sixteenths of a micrometre in which path lengths are summed: the sum wraps after 268 m, differences do not care.
const SUM_PER_UM: f32 = 16.0;

/// Where the waypoints are kept: in the pendant itself, or lent to it by a microcontroller, whose stack cannot hold them.
pub trait Slots: BorrowMut<[Slot]> {}
impl<S: BorrowMut<[Slot]>> Slots for S {}

/// A waypoint with what the drive needs to know of it.
#[derive(Debug, Clone, Copy)]
pub struct Slot {
    pub(super) waypoint: WireWaypoint,
    /// Length of the segment that ends here.
    pub(super) approach_um: f32,
    /// Square of the speed at which the torch may pass here, with all that was received in view.
    pub(super) pass_speed2: f32,
    /// The same by feed and corner alone.
    cap_speed2: f32,
    /// Fastest speed on the segment that ends here, so that it turns no faster than the torch may.
    pub(super) fastest_um_s: f32,
    /// Path length up to here, 1/16 µm, wrapping.
    sum: u32,
}

impl Slot {
    /// No waypoint. All zeros, so that a static array of them takes no flash.
    pub const EMPTY: Self = Self {
        waypoint: WireWaypoint {
            pose: WirePose { position_um: [0; 3], orientation_q15: [0; 4] },
            feed_um_s: 0,
            weld: false,
        },
        approach_um: 0.0,
        pass_speed2: 0.0,
        cap_speed2: 0.0,
        fastest_um_s: 0.0,
        sum: 0,
    };
}

/// What the plan of speeds may demand of the machine.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dynamics {
    /// Acceleration along the path.
    pub(super) accel_um_s2: f32,
    /// Change of the velocity vector at a waypoint.
    pub(super) corner_um_s: f32,
    /// Change of the angular velocity at a waypoint.
    pub(super) corner_rad_s: f32,
}

/// What became of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Placed {
    /// Stored.
    New,
    /// Was there already.
    Duplicate,
}

/// A refused chunk: which waypoint of it, and why.
pub(super) type Refusal = (u8, ChunkRefusal);

/// The path being loaded or followed.
#[derive(Debug, Clone)]
pub(super) struct Ring<const N: usize, S> {
    slots: S,
    begin: Begin,
    tail: u32,
    next: u32,
    sack: u16,
    digest: u32,
    sealed: bool,
}

impl<const N: usize, S: Slots> Ring<N, S> {
    /// Capacity as an index difference.
    pub(super) const CAPACITY: u32 = {
        assert!(
            N >= 4 * wire::MAX_CHUNK && N <= 1 << 24,
            "the ring holds some chunks and its length fits an index"
        );
        N as u32
    };
    /// Waypoints kept behind the torch of a streamed path, to go back to.
    const KEPT: u32 = Self::CAPACITY / 4;

    /// Empty. `slots` holds `N`; fewer would lose what does not fit.
    pub(super) fn new(slots: S) -> Self {
        let begin = Begin {
            path: 0,
            total: 0,
            chunk: 1,
            streamed: false,
            reach_um: 0,
            max_step_um: 0,
            min_half_turn_cos_q15: 0,
            arc: false,
            times: wire::ProcessTimes::default(),
        };
        Self { slots, begin, tail: 0, next: 0, sack: 0, digest: 0, sealed: false }
    }

    /// Forgets the path and opens another.
    pub(super) fn open(&mut self, begin: &Begin) {
        self.begin = *begin;
        self.tail = 0;
        self.next = 0;
        self.sack = 0;
        self.digest = wire::empty_digest(begin.total);
        self.sealed = false;
    }

    pub(super) fn begin(&self) -> &Begin {
        &self.begin
    }

    pub(super) fn next(&self) -> u32 {
        self.next
    }

    pub(super) fn digest(&self) -> u32 {
        self.digest
    }

    pub(super) fn is_complete(&self) -> bool {
        self.next == self.begin.total
    }

    pub(super) fn is_sealed(&self) -> bool {
        self.sealed
    }

    pub(super) fn seal(&mut self) {
        self.sealed = true;
    }

    /// Half of the ring is full, or nothing is missing.
    pub(super) fn is_prefilled(&self) -> bool {
        self.begin.streamed
            && (self.next.saturating_sub(self.tail) >= Self::CAPACITY / 2 || self.is_complete())
    }

    /// Where the load stands.
    pub(super) fn ack(&self) -> Ack {
        Ack { path: self.begin.path, next: self.next, sack: self.sack, limit: self.limit() }
    }

    /// A waypoint that may be followed.
    pub(super) fn get(&self, index: u32) -> Option<&Slot> {
        if index < self.tail || index >= self.next {
            None
        } else {
            self.slots.borrow().get(index as usize % N)
        }
    }

    /// Path length between two waypoints, `from` not after `to`.
    pub(super) fn length_um(&self, from: u32, to: u32) -> Option<f32> {
        let (from, to) = (self.get(from)?, self.get(to)?);
        Some(to.sum.wrapping_sub(from.sum) as f32 / SUM_PER_UM)
    }

    /// Path length from the first waypoint kept.
    pub(super) fn kept_um(&self, to: u32) -> f32 {
        self.length_um(self.tail, to).unwrap_or(0.0)
    }

    /// Frees what lies far behind the torch, which is on `segment`. A stored path is kept whole.
    pub(super) fn release(&mut self, segment: u32) {
        if self.begin.streamed {
            self.tail = self.tail.max(segment.saturating_sub(Self::KEPT));
        }
    }

    /// Places a chunk: all of it or nothing.
    pub(super) fn place(&mut self, chunk: &Chunk, limits: &Limits) -> Result<Placed, Refusal> {
        let len = self.check_grid(chunk)?;
        if self.is_stored(chunk.first) {
            return Ok(Placed::Duplicate);
        }
        self.check_credit(chunk.first, len)?;
        self.check_waypoints(chunk, limits)?;
        for (index, waypoint) in (chunk.first..).zip(&chunk.waypoints) {
            if let Some(slot) = self.slots.borrow_mut().get_mut(index as usize % N) {
                *slot = Slot { waypoint: *waypoint, ..Slot::EMPTY };
            }
        }
        match (chunk.first - self.next) / self.grid() {
            0 => self.join(len, limits),
            ahead => self.sack |= 1u16.checked_shl(ahead - 1).unwrap_or(0),
        }
        Ok(Placed::New)
    }

    /// Chunk length: not 0, which the compiler sees, so that no division can panic.
    fn grid(&self) -> NonZeroU32 {
        NonZeroU32::new(u32::from(self.begin.chunk)).unwrap_or(NonZeroU32::MIN)
    }

    /// The chunk has the length that belongs to its index.
    fn check_grid(&self, chunk: &Chunk) -> Result<u32, Refusal> {
        let len = chunk.waypoints.len() as u32;
        let grid = self.grid().get();
        let rest = self.begin.total.saturating_sub(chunk.first);
        let fits = chunk.first.is_multiple_of(grid) && len > 0 && len == rest.min(grid);
        if fits { Ok(len) } else { Err((0, ChunkRefusal::Index)) }
    }

    fn check_credit(&self, first: u32, len: u32) -> Result<(), Refusal> {
        let limit = self.limit();
        if first.checked_add(len).is_some_and(|end| end <= limit) {
            Ok(())
        } else {
            Err((0, ChunkRefusal::Credit { limit }))
        }
    }

    /// Exclusive: room in the ring, and within the reach of the selective-ack map.
    fn limit(&self) -> u32 {
        let room = self.tail.saturating_add(Self::CAPACITY);
        let shown = self.next.saturating_add((SACK_CHUNKS + 1) * u32::from(self.begin.chunk));
        room.min(shown).min(self.begin.total)
    }

    /// Whether the chunk that begins at `first` is there.
    fn is_stored(&self, first: u32) -> bool {
        match first.checked_sub(self.next) {
            None => true,
            Some(ahead) => match ahead / self.grid() {
                0 => false,
                chunks => self.sack.checked_shr(chunks - 1).unwrap_or(0) & 1 == 1,
            },
        }
    }

    fn check_waypoints(&self, chunk: &Chunk, limits: &Limits) -> Result<(), Refusal> {
        let before = chunk.first.checked_sub(1).filter(|_| self.is_before_stored(chunk.first));
        let mut previous = before.and_then(|index| self.raw(index));
        for (at, waypoint) in (0u8..).zip(&chunk.waypoints) {
            self.check_alone(waypoint, limits).map_err(|why| (at, why))?;
            if let Some(previous) = previous {
                self.check_step(&previous.pose, &waypoint.pose, limits).map_err(|why| (at, why))?;
            }
            previous = Some(waypoint);
        }
        let behind = chunk.first.saturating_add(chunk.waypoints.len() as u32);
        let following =
            (behind < self.begin.total && self.is_stored(behind)).then(|| self.raw(behind)).flatten();
        if let (Some(last), Some(following)) = (previous, following) {
            let at = chunk.waypoints.len().saturating_sub(1) as u8;
            self.check_step(&last.pose, &following.pose, limits).map_err(|why| (at, why))?;
        }
        Ok(())
    }

    fn is_before_stored(&self, first: u32) -> bool {
        first == self.next
            || first.checked_sub(u32::from(self.begin.chunk)).is_some_and(|chunk| self.is_stored(chunk))
    }

    fn raw(&self, index: u32) -> Option<&WireWaypoint> {
        self.slots.borrow().get(index as usize % N).map(|slot| &slot.waypoint)
    }

    fn check_alone(&self, waypoint: &WireWaypoint, limits: &Limits) -> Result<(), ChunkRefusal> {
        let [x, y, z] = waypoint.pose.position_um.map(i128::from);
        let reach = i128::from(self.begin.reach_um);
        if x * x + y * y + z * z > reach * reach {
            return Err(ChunkRefusal::Reach);
        }
        if !waypoint.pose.is_unit() {
            return Err(ChunkRefusal::Orientation);
        }
        if waypoint.weld && !self.begin.arc {
            return Err(ChunkRefusal::ArcBarred);
        }
        if waypoint.feed_um_s == 0 || waypoint.feed_um_s > limits.max_feed_um_s {
            return Err(ChunkRefusal::Feed);
        }
        Ok(())
    }

    fn check_step(&self, from: &WirePose, to: &WirePose, limits: &Limits) -> Result<(), ChunkRefusal> {
        if from.distance_um(to) > self.begin.max_step_um as f32 {
            return Err(ChunkRefusal::StepTooLong);
        }
        if from.dot_q30(to).abs() < i64::from(self.begin.min_half_turn_cos_q15) * i64::from(Q15_ONE) {
            return Err(ChunkRefusal::Turn);
        }
        if measure_um(from, to) < limits.min_step_um as f32 {
            return Err(ChunkRefusal::StepTooShort);
        }
        Ok(())
    }

    /// The chunk at `next` is there, and with it those that waited behind it.
    fn join(&mut self, len: u32, limits: &Limits) {
        let mut len = len;
        loop {
            for index in self.next..self.next.saturating_add(len) {
                self.link(index, limits);
            }
            self.next = self.next.saturating_add(len).min(self.begin.total);
            let waiting = self.sack & 1 == 1;
            self.sack >>= 1;
            if !waiting {
                return;
            }
            len = u32::from(self.begin.chunk).min(self.begin.total.saturating_sub(self.next));
        }
    }

    /// The waypoint follows on the path received so far.
    fn link(&mut self, index: u32, limits: &Limits) {
        let Some(&Slot { waypoint, .. }) = self.slots.borrow().get(index as usize % N) else { return };
        self.digest = wire::extend_digest(self.digest, &waypoint);
        let Some(previous) =
            index.checked_sub(1).and_then(|before| self.slots.borrow().get(before as usize % N))
        else {
            return;
        };
        let approach_um = measure_um(&previous.waypoint.pose, &waypoint.pose);
        let sum = previous.sum.wrapping_add((approach_um * SUM_PER_UM) as u32);
        let turn_rad = turn_rad(&previous.waypoint.pose, &waypoint.pose);
        let turn_rad_s = limits.max_turn_mrad_s as f32 * 1e-3;
        let fastest_um_s = if turn_rad > 0.0 { turn_rad_s / turn_rad * approach_um } else { f32::MAX };
        if let Some(slot) = self.slots.borrow_mut().get_mut(index as usize % N) {
            *slot = Slot { approach_um, sum, fastest_um_s, ..*slot };
        }
    }

    /// Plans the speeds again after `known` grew to `next`: backwards from standstill at the last waypoint received,
    /// until nothing changes. The torch is on `segment`; what it has passed stays.
    pub(super) fn replan(&mut self, known: u32, segment: u32, dynamics: &Dynamics) {
        for index in known.saturating_sub(1).max(1)..self.next.saturating_sub(1) {
            let cap_speed2 = self.cap_speed2(index, dynamics);
            if let (Some(slot), Some(cap)) = (self.slots.borrow_mut().get_mut(index as usize % N), cap_speed2)
            {
                slot.cap_speed2 = cap;
            }
        }
        let Some(last) = self.next.checked_sub(1).and_then(|last| self.get(last)) else { return };
        let (mut after_speed2, mut length_um) = (0.0, last.approach_um);
        for index in (segment.saturating_add(1)..self.next.saturating_sub(1)).rev() {
            let Some(slot) = self.slots.borrow_mut().get_mut(index as usize % N) else { return };
            let speed2 = slot.cap_speed2.min(after_speed2 + 2.0 * dynamics.accel_um_s2 * length_um);
            if speed2 == slot.pass_speed2 && index < known.saturating_sub(1) {
                return;
            }
            slot.pass_speed2 = speed2;
            (after_speed2, length_um) = (speed2, slot.approach_um);
        }
    }

    /// The torch stops where the weld begins or ends, keeps to both feeds, and turns corners slowly.
    fn cap_speed2(&self, index: u32, dynamics: &Dynamics) -> Option<f32> {
        let (before, here) = (self.get(index.checked_sub(1)?)?, self.get(index)?);
        let after = self.get(index.checked_add(1)?)?;
        if before.waypoint.weld != here.waypoint.weld {
            return Some(0.0);
        }
        let feed = before.waypoint.feed_um_s.min(here.waypoint.feed_um_s) as f32;
        let feed = feed.min(here.fastest_um_s).min(after.fastest_um_s);
        let [into, out] = [(before, here), (here, after)]
            .map(|(a, b)| (a.waypoint.pose.offset_um(&b.waypoint.pose), b.approach_um));
        let turn2: f32 = into.0.iter().zip(out.0).map(|(a, b)| square(b / out.1 - a / into.1)).sum();
        let corner2 = if turn2 > 0.0 { square(dynamics.corner_um_s) / turn2 } else { f32::MAX };
        let turns = [(before, here), (here, after)]
            .map(|(a, b)| turn(&a.waypoint.pose, &b.waypoint.pose).map(|rad| rad / b.approach_um));
        let change2: f32 = turns[0].iter().zip(turns[1]).map(|(a, b)| square(b - a)).sum();
        let twist2 = if change2 > 0.0 { square(dynamics.corner_rad_s) / change2 } else { f32::MAX };
        Some(square(feed).min(corner2).min(twist2))
    }

    /// The first segment from this one on that is to be welded faster than `feed_um_s`, as far as it was received.
    pub(super) fn faster_weld(&self, segment: u32, feed_um_s: u32) -> Option<u32> {
        let too_fast = |slot: &Slot| slot.waypoint.weld && slot.waypoint.feed_um_s > feed_um_s;
        (segment..self.next).find(|&index| self.get(index).is_some_and(too_fast))
    }
}

fn square(x: f32) -> f32 {
    x * x
}

/// Length of a step: of the way, or of the turn if that is more.
fn measure_um(from: &WirePose, to: &WirePose) -> f32 {
    from.distance_um(to).max(TURN_LEVER_UM * turn_rad(from, to))
}

/// Rotation vector of a step, base frame, rad: twice the vector part of its quaternion, exact for small turns.
fn turn(from: &WirePose, to: &WirePose) -> [f32; 3] {
    let [a, b] = [from, to].map(|pose| pose.orientation_q15.map(f32::from));
    let ([aw, ax, ay, az], [bw, bx, by, bz]) = (a, b);
    let sign = if from.dot_q30(to) < 0 { -2.0 } else { 2.0 };
    let vector = [
        aw * bx - ax * bw + az * by - ay * bz,
        aw * by - ay * bw + ax * bz - az * bx,
        aw * bz - az * bw + ay * bx - ax * by,
    ];
    vector.map(|part| part * (sign / (f32::from(Q15_ONE) * f32::from(Q15_ONE))))
}

/// Angle between two poses, mrad. Not inlined, for many ask and flash is short.
#[inline(never)]
pub(super) fn turn_mrad(from: &WirePose, to: &WirePose) -> f32 {
    1000.0 * turn_rad(from, to)
}

/// Angle of a step by its chord: exact for small ones, a tenth too small at half a turn.
fn turn_rad(from: &WirePose, to: &WirePose) -> f32 {
    let sign = if from.dot_q30(to) < 0 { -1 } else { 1 };
    let pairs = from.orientation_q15.into_iter().zip(to.orientation_q15);
    let chord2: f32 = pairs.map(|(a, b)| square((i32::from(a) - sign * i32::from(b)) as f32)).sum();
    2.0 * math::sqrt(chord2) / f32::from(Q15_ONE)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::pendant::Config;

    fn chunk(first: u32, place: impl Fn(u32) -> [i32; 3]) -> Chunk {
        let waypoints = (first..first + 4).map(|index| WireWaypoint {
            pose: WirePose { position_um: place(index), ..WirePose::IDENTITY },
            feed_um_s: 200_000,
            weld: false,
        });
        Chunk { path: 1, first, waypoints: waypoints.collect() }
    }

    /// A ring with so many chunks of a path, planned after each of them.
    fn planned(chunks: u32, place: impl Fn(u32) -> [i32; 3]) -> Ring<64, [Slot; 64]> {
        let config = Config::default();
        let (limits, dynamics) = (config.limits(64), config.dynamics());
        let mut ring = Ring::new([Slot::EMPTY; 64]);
        ring.open(&Begin {
            path: 1,
            total: 64,
            chunk: 4,
            streamed: true,
            reach_um: 1_000_000,
            max_step_um: 10_000,
            min_half_turn_cos_q15: 30_000,
            arc: true,
            times: wire::ProcessTimes::default(),
        });
        for number in 0..chunks {
            let known = ring.next();
            assert_eq!(ring.place(&chunk(4 * number, &place), &limits), Ok(Placed::New));
            ring.replan(known, 0, &dynamics);
        }
        ring
    }

    #[test]
    fn the_plan_stops_at_the_last_waypoint_received_and_brakes_within_bounds() {
        for chunks in 1..=16 {
            let ring = planned(chunks, |index| [index as i32 * 1_000, 0, 0]);
            let speeds2: std::vec::Vec<f32> =
                (1..ring.next()).filter_map(|index| ring.get(index)).map(|slot| slot.pass_speed2).collect();
            assert_eq!(speeds2.last(), Some(&0.0));
            for pair in speeds2.windows(2) {
                assert!(
                    pair[0] - pair[1] <= 2.0 * 500_000.0 * 1_000.0 * 1.0001,
                    "{chunks} chunks: {speeds2:?}"
                );
            }
            let fastest = speeds2.iter().copied().fold(0.0, f32::max).sqrt();
            let reachable = (2.0 * 500_000.0 * 1_000.0 * (speeds2.len() - 1) as f32).sqrt().min(200_000.0);
            assert!((fastest - reachable).abs() < 1.0, "{fastest}, could be {reachable}");
        }
    }

    #[test]
    fn a_corner_is_passed_slowly_enough_for_its_change_of_velocity() {
        let ring = planned(8, |index| {
            let along = index.min(16) as i32 * 1_000;
            [along, index.saturating_sub(16) as i32 * 1_000, 0]
        });
        let speed = ring.get(16).map(|slot| slot.pass_speed2.sqrt()).expect("received");
        assert!(
            (speed * 2.0_f32.sqrt() - 5_000.0).abs() < 1.0,
            "a right angle changes v by its root-two fold: {speed}"
        );
    }

    #[test]
    fn waypoints_that_were_not_received_are_not_there() {
        let ring = planned(2, |index| [index as i32 * 1_000, 0, 0]);
        assert!(ring.get(7).is_some() && ring.get(8).is_none() && ring.get(u32::MAX).is_none());
    }
}
