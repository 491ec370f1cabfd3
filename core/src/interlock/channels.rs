//! Inputs with two channels, and outputs that have to keep toggling: what a single broken wire or a stuck pin must not
//! get past. Pure functions of levels and ticks; the board reads and drives the pins.

/// Ticks for which the channels of one switch may differ while its contacts change over: 0.5 s of 2 ms ticks, the
/// discrepancy time that makers of emergency stops and enabling switches state at most.
pub const DISCREPANCY_TICKS: u16 = 250;

/// A switch with two contacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TwoChannel {
    differing: u16,
    broken: bool,
}

/// What two contacts say together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Agreed {
    /// Both say so.
    pub both: bool,
    /// At least one says so.
    pub either: bool,
    /// They have differed for too long, and were not seen to agree on `false` since.
    pub broken: bool,
}

impl TwoChannel {
    /// Both open, nothing broken.
    pub const fn new() -> Self {
        Self { differing: 0, broken: false }
    }

    /// One tick with these levels. An emergency stop counts if *either* is pressed, an enabling switch if *both* are.
    pub fn tick(&mut self, [a, b]: [bool; 2]) -> Agreed {
        self.differing = if a == b { 0 } else { self.differing.saturating_add(1) };
        if self.differing > DISCREPANCY_TICKS {
            self.broken = true;
        } else if !a && !b {
            self.broken = false;
        }
        Agreed { both: a && b, either: a || b, broken: self.broken }
    }
}

/// Ticks that a read-back may lag behind its output.
const READBACK_TICKS: u8 = 5;

/// An output behind a charge pump: energised only while the pin keeps changing, so that a tick that hangs, or a pin that
/// is stuck high or low, lets it drop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pump {
    level: bool,
    wrong: u8,
}

impl Pump {
    /// At rest.
    pub const fn new() -> Self {
        Self { level: false, wrong: 0 }
    }

    /// One tick: the level of the pin.
    pub fn tick(&mut self, wanted: bool) -> bool {
        self.level = wanted && !self.level;
        self.level
    }

    /// One tick: whether what the pump's far side reads back has contradicted for too long what was wanted.
    pub fn reads_wrong(&mut self, wanted: bool, readback: bool) -> bool {
        self.wrong = if wanted == readback { 0 } else { self.wrong.saturating_add(1) };
        self.wrong > READBACK_TICKS
    }
}

/// The far side of a [`Pump`], for boards that have none: drops if its input has not changed for some ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PumpModel {
    last: bool,
    charge: u8,
}

/// Ticks that a pump's charge lasts without a change of the pin: 8 ms of 2 ms ticks.
pub const PUMP_TICKS: u8 = 4;

impl PumpModel {
    /// Empty.
    pub const fn new() -> Self {
        Self { last: false, charge: 0 }
    }

    /// One tick of the pump's own clock with this level at its input; whether its output is energised.
    pub fn tick(&mut self, level: bool) -> bool {
        self.charge = if level == self.last { self.charge.saturating_sub(1) } else { PUMP_TICKS };
        self.last = level;
        self.charge > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_contact_stops_and_only_both_enable() {
        for (levels, both, either) in
            [([false, false], false, false), ([true, false], false, true), ([true, true], true, true)]
        {
            let agreed = TwoChannel::new().tick(levels);
            assert_eq!((agreed.both, agreed.either, agreed.broken), (both, either, false));
        }
    }

    #[test]
    fn contacts_that_differ_beyond_the_discrepancy_time_are_broken_until_both_are_open() {
        let mut switch = TwoChannel::new();
        for tick in 1..=DISCREPANCY_TICKS {
            assert!(!switch.tick([true, false]).broken, "tick {tick}");
        }
        assert!(switch.tick([true, false]).broken);
        assert!(switch.tick([true, true]).broken, "agreeing on pressed is not enough");
        assert!(!switch.tick([false, false]).broken);
        for _ in 0..2 * DISCREPANCY_TICKS {
            assert!(!switch.tick([true, true]).broken);
        }
    }

    #[test]
    fn a_pump_that_is_driven_holds_and_one_whose_pin_stands_still_drops_within_8_ms() {
        for stuck in [false, true] {
            let (mut pump, mut model, mut energised) = (Pump::new(), PumpModel::new(), false);
            for tick in 0..100 {
                let wrong = pump.reads_wrong(true, energised);
                energised = model.tick(pump.tick(true));
                assert!(energised && !wrong, "tick {tick}");
            }
            let fell = (1..10).find(|_| !model.tick(stuck));
            assert!(fell.is_some_and(|tick| tick <= u32::from(PUMP_TICKS) + 1), "{fell:?}");
        }
    }

    #[test]
    fn an_output_that_does_not_follow_is_told_after_some_ticks() {
        let mut pump = Pump::new();
        let told = (1..20).find(|_| pump.reads_wrong(false, true));
        assert_eq!(told, Some(u32::from(READBACK_TICKS) + 1), "stuck on");
        assert!(!pump.reads_wrong(false, false), "and no longer once it does");
    }
}
