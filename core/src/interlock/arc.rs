//! The arc's sequence: gas, strike, weld, crater fill, burn-back, gas. Times are ticks of the set-point clock.
//!
//! The sequence only asks for power; whether power flows is decided in one place, [`super::Interlock::outputs`].

use serde::{Deserialize, Serialize};

/// Where the arc sequence stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ArcPhase {
    /// Nothing flows.
    #[default]
    Off,
    /// Gas before the arc.
    PreFlow,
    /// Power and wire, waiting for the arc to be established.
    Striking,
    /// Welding.
    On,
    /// Power and wire at the end of the seam, standing still.
    CraterFill,
    /// Power without wire, so that the wire does not freeze into the pool.
    BurnBack,
    /// Gas over the cooling pool.
    PostFlow,
}

impl ArcPhase {
    /// Whether the phase wants arc power.
    pub const fn wants_power(self) -> bool {
        matches!(self, Self::Striking | Self::On | Self::CraterFill | Self::BurnBack)
    }

    /// Whether the phase wants wire.
    pub const fn wants_wire(self) -> bool {
        matches!(self, Self::Striking | Self::On | Self::CraterFill)
    }

    /// Whether the phase wants shielding gas.
    pub const fn wants_gas(self) -> bool {
        !matches!(self, Self::Off)
    }
}

/// How long the phases last, ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ArcTimes {
    pre_flow: u16,
    strike: u16,
    lost: u16,
    crater_fill: u16,
    burn_back: u16,
    post_flow: u16,
    current_off: u16,
}

/// How long the phases last, ms; rounded up to ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArcTimesMs {
    /// Gas before the strike, at most 10 s.
    pub pre_flow: u16,
    /// Longest wait for an established arc, 10 ms to 5 s.
    pub strike: u16,
    /// Longest interruption of an established arc, 2 ms to 1 s.
    pub lost: u16,
    /// Crater fill, at most 5 s.
    pub crater_fill: u16,
    /// Burn-back, at most 1 s.
    pub burn_back: u16,
    /// Gas after the arc, at most 30 s.
    pub post_flow: u16,
    /// How long current may flow after the arc was put out, 2 ms to 1 s: a source's choke runs empty and its relay
    /// falls off. Longer is a fault.
    pub current_off: u16,
}

impl Default for ArcTimesMs {
    fn default() -> Self {
        Self {
            pre_flow: 200,
            strike: 1000,
            lost: 100,
            crater_fill: 300,
            burn_back: 60,
            post_flow: 500,
            current_off: 150,
        }
    }
}

impl ArcTimes {
    /// `None` if a time is out of its bounds or a tick lasts 0.
    pub fn new(ms: &ArcTimesMs, tick_us: u32) -> Option<Self> {
        let bounds = [
            (ms.pre_flow, 0, 10_000),
            (ms.strike, 10, 5_000),
            (ms.lost, 2, 1_000),
            (ms.crater_fill, 0, 5_000),
            (ms.burn_back, 0, 1_000),
            (ms.post_flow, 0, 30_000),
            (ms.current_off, 2, 1_000),
        ];
        let within = bounds.into_iter().all(|(time, least, most)| (least..=most).contains(&time));
        let ticks = |time: u16| u16::try_from((u32::from(time) * 1000).div_ceil(tick_us.max(1))).ok();
        if !within || tick_us == 0 {
            return None;
        }
        Some(Self {
            pre_flow: ticks(ms.pre_flow)?,
            strike: ticks(ms.strike)?,
            lost: ticks(ms.lost)?,
            crater_fill: ticks(ms.crater_fill)?,
            burn_back: ticks(ms.burn_back)?,
            post_flow: ticks(ms.post_flow)?,
            current_off: ticks(ms.current_off)?,
        })
    }

    /// Ticks for which current may flow after the arc was put out.
    pub(super) const fn current_off(&self) -> u16 {
        self.current_off
    }
}

/// What a tick of the sequence found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sequence {
    /// Nothing to report.
    Going,
    /// No arc within the strike time.
    StrikeTimeout,
    /// The arc was interrupted for too long.
    Lost,
}

/// The sequence's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(super) struct Arc {
    pub(super) phase: ArcPhase,
    ticks: u16,
    dark: u16,
}

impl Arc {
    fn enter(&mut self, phase: ArcPhase) {
        *self = Self { phase, ticks: 0, dark: 0 };
    }

    fn count(&mut self) {
        if !matches!(self.phase, ArcPhase::Off | ArcPhase::On) {
            self.ticks = self.ticks.saturating_add(1);
        }
    }

    /// Power ends at once; gas goes on over the hot pool.
    pub(super) fn cut(&mut self) {
        if self.phase.wants_power() {
            self.enter(ArcPhase::PostFlow);
        } else if self.phase == ArcPhase::PreFlow {
            self.enter(ArcPhase::Off);
        }
    }

    /// One tick outside Running: only the gas that follows an arc runs on.
    pub(super) fn rest(&mut self, times: &ArcTimes) {
        self.cut();
        self.count();
        if self.phase == ArcPhase::PostFlow && self.ticks >= times.post_flow {
            self.enter(ArcPhase::Off);
        }
    }

    /// One tick in Running. `wanted`: the segment is to be welded; `ends`: the torch stands at its end.
    pub(super) fn run(&mut self, times: &ArcTimes, wanted: bool, ends: bool, established: bool) -> Sequence {
        self.count();
        let dark = self.phase == ArcPhase::On && !established;
        self.dark = if dark { self.dark.saturating_add(1) } else { 0 };
        let over = |time: u16| self.ticks >= time;
        match self.phase {
            ArcPhase::Off if wanted && !ends => self.enter(ArcPhase::PreFlow),
            ArcPhase::PreFlow if over(times.pre_flow) => self.enter(ArcPhase::Striking),
            ArcPhase::Striking if established => self.enter(ArcPhase::On),
            ArcPhase::Striking if over(times.strike) => return Sequence::StrikeTimeout,
            ArcPhase::On if ends || !wanted => self.enter(ArcPhase::CraterFill),
            ArcPhase::On if self.dark >= times.lost => return Sequence::Lost,
            ArcPhase::CraterFill if over(times.crater_fill) => self.enter(ArcPhase::BurnBack),
            ArcPhase::BurnBack if over(times.burn_back) => self.enter(ArcPhase::PostFlow),
            ArcPhase::PostFlow if over(times.post_flow) => self.enter(ArcPhase::Off),
            _ => {}
        }
        Sequence::Going
    }
}
