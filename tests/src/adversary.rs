//! A seeded adversary: a serial line in virtual time that damages, drops, doubles and reorders what it carries.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// SplitMix64: the same numbers from the same seed on every machine and in every version.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// From a seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Below `end`, which is not 0.
    pub fn below(&mut self, end: u64) -> u64 {
        ((u128::from(self.bits()) * u128::from(end)) >> 64) as u64
    }

    /// In `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Of mean 0 and standard deviation 1, never beyond 6: a sum of twelve.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }

    /// True with probability `p`.
    pub fn chance(&mut self, p: f64) -> bool {
        p > 0.0 && self.unit() < p
    }

    /// How many events of probability `p` fail before the next one happens.
    fn gap(&mut self, p: f64) -> usize {
        if p <= 0.0 { usize::MAX } else { ((1.0 - self.unit()).ln() / (1.0 - p).ln()) as usize }
    }
}

/// Probabilities of faults.
#[derive(Debug, Clone, Copy, Default)]
pub struct Faults {
    /// A byte becomes another.
    pub byte_error: f64,
    /// A byte vanishes.
    pub byte_drop: f64,
    /// A frame vanishes.
    pub frame_drop: f64,
    /// A frame arrives twice, the second time up to half a second later.
    pub frame_double: f64,
    /// A frame arrives up to 30 ms late, behind its followers.
    pub frame_late: f64,
}

/// One direction of a line.
#[derive(Debug)]
pub struct Line {
    faults: Faults,
    random: Random,
    byte_ns: u64,
    free_ns: u64,
    sent: u64,
    cut: bool,
    under_way: BinaryHeap<Reverse<(u64, u64, Vec<u8>)>>,
}

/// Time from the last bit sent to the last bit received.
const DELAY_US: u64 = 500;

impl Line {
    /// A line of `baud` bits per second, ten bits a byte.
    pub fn new(faults: Faults, baud: u64, seed: u64) -> Self {
        Self {
            faults,
            random: Random::new(seed),
            byte_ns: 10_000_000_000 / baud,
            free_ns: 0,
            sent: 0,
            cut: false,
            under_way: BinaryHeap::new(),
        }
    }

    /// Frames sent so far.
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// Whether the line could begin to send before `now_us + 1 ms`.
    pub fn has_room(&self, now_us: u64) -> bool {
        self.free_ns < (now_us + 1000) * 1000
    }

    /// Unplugs or plugs the line; what is under way is lost.
    pub fn cut(&mut self, cut: bool) {
        self.cut = cut;
        self.under_way.clear();
    }

    /// Sends a frame.
    pub fn send(&mut self, now_us: u64, frame: &[u8]) {
        self.sent += 1;
        self.free_ns = self.free_ns.max(now_us * 1000) + self.byte_ns * frame.len() as u64;
        if self.cut || self.random.chance(self.faults.frame_drop) {
            return;
        }
        let mut arrival_us = self.free_ns / 1000 + DELAY_US;
        if self.random.chance(self.faults.frame_double) {
            let later_us = arrival_us + self.random.below(500_000);
            self.arrive(later_us, frame);
        }
        if self.random.chance(self.faults.frame_late) {
            arrival_us += self.random.below(30_000);
        }
        self.arrive(arrival_us, frame);
    }

    fn arrive(&mut self, at_us: u64, frame: &[u8]) {
        let bytes = self.damaged(frame);
        let order = self.sent * 2 + self.under_way.len() as u64 % 2;
        self.under_way.push(Reverse((at_us, order, bytes)));
    }

    fn damaged(&mut self, frame: &[u8]) -> Vec<u8> {
        let mut bytes = frame.to_vec();
        let mut at = self.random.gap(self.faults.byte_error);
        while let Some(byte) = bytes.get_mut(at) {
            *byte ^= 1 + self.random.below(255) as u8;
            at = at.saturating_add(1 + self.random.gap(self.faults.byte_error));
        }
        let mut at = self.random.gap(self.faults.byte_drop);
        while at < bytes.len() {
            bytes.remove(at);
            at = at.saturating_add(self.random.gap(self.faults.byte_drop));
        }
        bytes
    }

    /// Bytes that have arrived by now.
    pub fn arrived(&mut self, now_us: u64) -> Option<Vec<u8>> {
        let due = self.under_way.peek().is_some_and(|Reverse((at_us, ..))| *at_us <= now_us);
        if due { self.under_way.pop().map(|Reverse((.., bytes))| bytes) } else { None }
    }
}
