//! What the pendant says of its own accord: faults until they are seen, telemetry, samples.
//!
//! All of it may be lost: nothing is kept for a line that is busy but the newest samples.

use heapless::{Deque, Vec};

use crate::interlock::Fault;
use crate::wire::{Counters, MAX_SAMPLES, PendantMessage, Sample};

/// Samples kept for a busy line.
const KEPT_SAMPLES: usize = 2 * MAX_SAMPLES;

/// Periods, ticks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Periods {
    pub(super) telemetry: u16,
    pub(super) fault: u16,
}

/// What is due when.
#[derive(Debug, Clone, Default)]
pub(super) struct Report {
    periods: Periods,
    telemetry_in: u16,
    fault_in: u16,
    faults: u16,
    unseen: Option<Fault>,
    every: u16,
    sample_in: u16,
    samples: Deque<Sample, KEPT_SAMPLES>,
    /// Changes of state: what an order to go on has to know of.
    pub(super) changes: u16,
    pub(super) counters: Counters,
}

impl Report {
    pub(super) fn new(periods: Periods) -> Self {
        Self { periods, ..Self::default() }
    }

    /// One tick.
    pub(super) fn tick(&mut self) {
        self.telemetry_in = self.telemetry_in.saturating_sub(1);
        self.fault_in = self.fault_in.saturating_sub(1);
    }

    /// Something changed: telemetry at once.
    pub(super) fn hurry(&mut self) {
        self.telemetry_in = 0;
    }

    /// Another state, or another session of it.
    pub(super) fn changed(&mut self) {
        self.changes = self.changes.wrapping_add(1);
        self.hurry();
    }

    pub(super) fn fault(&mut self, fault: Fault) {
        self.faults = self.faults.wrapping_add(1);
        self.unseen = Some(fault);
        self.fault_in = 0;
    }

    pub(super) fn fault_seen(&mut self, number: u16) {
        if number == self.faults {
            self.unseen = None;
        }
    }

    /// Every how many ticks a set-point is kept; 0 for none.
    pub(super) fn subscribe(&mut self, every: u16) {
        self.every = every;
        self.sample_in = 0;
        self.samples.clear();
    }

    pub(super) fn executed(&mut self, sample: impl FnOnce() -> Sample) {
        if self.every == 0 {
            return;
        }
        self.sample_in = self.sample_in.saturating_sub(1);
        if self.sample_in > 0 {
            return;
        }
        self.sample_in = self.every;
        if self.samples.is_full() {
            self.samples.pop_front();
        }
        // A place was made.
        let _ = self.samples.push_back(sample());
    }

    pub(super) fn due_fault(&mut self) -> Option<PendantMessage> {
        let fault = self.unseen.filter(|_| self.fault_in == 0)?;
        self.fault_in = self.periods.fault;
        Some(PendantMessage::FaultReport { number: self.faults, fault })
    }

    pub(super) fn due_telemetry(&mut self) -> bool {
        let due = self.telemetry_in == 0;
        if due {
            self.telemetry_in = self.periods.telemetry;
        }
        due
    }

    /// A full message of samples, or what is there once nothing more comes.
    pub(super) fn due_samples(&mut self, last: bool) -> Option<PendantMessage> {
        if self.samples.is_empty() || (self.samples.len() < MAX_SAMPLES && !last) {
            return None;
        }
        let mut samples = Vec::new();
        while !samples.is_full() {
            let Some(sample) = self.samples.pop_front() else { break };
            let _ = samples.push(sample);
        }
        Some(PendantMessage::Samples(samples))
    }
}
