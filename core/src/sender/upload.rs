//! A path on its way: which chunks are there, which are under way, and which is the next to send.

use heapless::Vec;

use super::rto::Rto;
use crate::wire::{Ack, Begin, Chunk, MAX_CHUNK, SACK_CHUNKS, WireWaypoint};

/// Chunks remembered as under way: more than the window, a power of two.
const FLIGHTS: usize = 32;
/// So many later chunks there before a gap counts as lost rather than late.
const REORDERED: u32 = 3;

const _: () = assert!(FLIGHTS > SACK_CHUNKS as usize + 1, "every chunk in the window has its flight");

#[derive(Debug, Clone, Copy, Default)]
struct Flight {
    sent_us: u64,
    sends: u8,
}

/// Which step of a load is next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    Begin,
    Chunks,
    Commit,
    Loaded,
}

/// A load. Chunk numbers are waypoint indices divided by the chunk length.
#[derive(Debug, Clone)]
pub(super) struct Upload {
    pub(super) begin: Begin,
    pub(super) digest: u32,
    pub(super) step: Step,
    ack: Ack,
    unsent: u32,
    flights: [Flight; FLIGHTS],
}

impl Upload {
    pub(super) fn new(begin: &Begin, digest: u32) -> Self {
        Self {
            begin: *begin,
            digest,
            step: Step::Begin,
            ack: Ack { path: begin.path, next: 0, sack: 0, limit: 0 },
            unsent: 0,
            flights: [Flight::default(); FLIGHTS],
        }
    }

    /// The path is open: until the first ack says more, as much may be sent as the ring holds.
    pub(super) fn opened(&mut self, ring: u32) {
        self.step = Step::Chunks;
        self.ack.limit = self.begin.total.min(ring);
    }

    pub(super) fn ack(&self) -> &Ack {
        &self.ack
    }

    fn grid(&self) -> u32 {
        u32::from(self.begin.chunk.max(1))
    }

    /// Acks may overtake each other: nothing that was once there is forgotten. Chunks sent once measure the round
    /// trip, for it takes a slow line longer to carry them than a ping.
    pub(super) fn acked(&mut self, ack: &Ack, now_us: u64, rto: &mut Rto) {
        if ack.path != self.begin.path || ack.next < self.ack.next || ack.next > self.begin.total {
            return;
        }
        let missing = self.missing();
        let chunks = (ack.next - self.ack.next).div_ceil(self.grid());
        let known = self.ack.sack.checked_shr(chunks).unwrap_or(0);
        let limit = self.ack.limit.max(ack.limit).min(self.begin.total);
        self.ack = Ack { sack: ack.sack | known, limit, ..*ack };
        if self.step == Step::Chunks && self.ack.next == self.begin.total {
            self.step = Step::Commit;
        }
        let arrived = missing.filter(|&chunk| self.is_there(chunk));
        let flights = arrived.filter_map(|chunk| self.flights.get(chunk as usize % FLIGHTS));
        for flight in flights.filter(|flight| flight.sends == 1) {
            rto.measured(u32::try_from(now_us.saturating_sub(flight.sent_us)).unwrap_or(u32::MAX));
        }
    }

    /// Chunks under way, as the acks so far show.
    fn missing(&self) -> impl Iterator<Item = u32> + use<> {
        let (base, unsent, sack) = (self.base(), self.unsent, self.ack.sack);
        let there =
            move |chunk: u32| chunk > base && sack.checked_shr(chunk - base - 1).unwrap_or(0) & 1 == 1;
        (base..unsent).filter(move |&chunk| !there(chunk))
    }

    fn base(&self) -> u32 {
        self.ack.next / self.grid()
    }

    fn is_there(&self, chunk: u32) -> bool {
        match chunk.checked_sub(self.base()) {
            None => true,
            Some(0) => false,
            Some(ahead) => self.ack.sack.checked_shr(ahead - 1).unwrap_or(0) & 1 == 1,
        }
    }

    /// Chunks beyond this one that are there.
    fn overtaken_by(&self, chunk: u32) -> u32 {
        let ahead = chunk.saturating_sub(self.base());
        self.ack.sack.checked_shr(ahead).unwrap_or(0).count_ones()
    }

    /// The chunk to send now, and whether it was sent before.
    pub(super) fn due(&mut self, now_us: u64, rto: &Rto, window: u32) -> Option<(u32, bool)> {
        if self.step != Step::Chunks {
            return None;
        }
        let chunk = match self.missing().find(|&chunk| self.is_lost(chunk, now_us, rto)) {
            Some(lost) => lost,
            None if self.may_send_new(window) => self.unsent,
            None => return None,
        };
        let again = chunk < self.unsent;
        self.unsent = self.unsent.max(chunk + 1);
        let flight = self.flights.get_mut(chunk as usize % FLIGHTS)?;
        let sends = if again { flight.sends.saturating_add(1) } else { 1 };
        *flight = Flight { sent_us: now_us, sends };
        Some((chunk, again))
    }

    fn may_send_new(&self, window: u32) -> bool {
        let first = self.unsent.saturating_mul(self.grid());
        let end = first.saturating_add(self.grid()).min(self.begin.total);
        let shown = self.unsent.saturating_sub(self.base()) <= SACK_CHUNKS;
        let waiting = self.missing().count() as u32;
        first < self.begin.total && end <= self.ack.limit && shown && waiting < window
    }

    fn is_lost(&self, chunk: u32, now_us: u64, rto: &Rto) -> bool {
        let Some(flight) = self.flights.get(chunk as usize % FLIGHTS) else { return false };
        let age_us = now_us.saturating_sub(flight.sent_us);
        let round_trip_us = u64::from(rto.round_trip_us());
        let overtaken = self.overtaken_by(chunk) >= REORDERED && age_us > round_trip_us + round_trip_us / 2;
        overtaken || age_us >= rto.timeout_us(flight.sends)
    }

    /// The waypoints of a chunk.
    pub(super) fn chunk(&self, number: u32, path: &[WireWaypoint]) -> Option<Chunk> {
        let first = number.checked_mul(self.grid())?;
        let from = usize::try_from(first).ok()?;
        let to = from.checked_add(self.grid() as usize)?.min(path.len());
        let waypoints = Vec::<WireWaypoint, MAX_CHUNK>::from_slice(path.get(from..to)?).ok()?;
        Some(Chunk { path: self.begin.path, first, waypoints })
    }
}
