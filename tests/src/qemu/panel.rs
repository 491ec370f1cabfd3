//! The panel with everything that it has shown since the machine was started.

use std::io;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use weldpath::pendant::emulator;
use weldpath::pendant::emulator::{Inputs, Seen};

use super::PATIENCE;

/// The panel. Everything seen is kept in order.
pub struct Panel {
    panel: emulator::Panel,
    shown: Receiver<Seen>,
}

impl Panel {
    pub(super) fn new(panel: emulator::Panel) -> Self {
        Self { shown: panel.watch(), panel }
    }

    /// Sets the three switches; the key switch stays in automatic.
    pub fn set(&self, inputs: Inputs) -> io::Result<()> {
        self.panel.set(inputs)
    }

    /// Presses the reset button and lets it go at once.
    pub fn reset(&self, others: Inputs) -> io::Result<()> {
        self.set(Inputs { reset: true, ..others })?;
        self.set(Inputs { reset: false, ..others })
    }

    /// Presses the button that confirms where the torch is.
    pub fn confirm(&self) -> io::Result<()> {
        self.panel.confirm()
    }

    /// Turns the key switch.
    pub fn manual(&self, manual: bool) -> io::Result<()> {
        self.panel.manual(manual)
    }

    /// Breaks or mends a contact.
    pub fn break_contact(&self, what: emulator::Broken, broken: bool) -> io::Result<()> {
        self.panel.break_contact(what, broken)
    }

    /// A byte as it is: `?` report the stack's use, `!` panic, `$` hang, `%` overflow the stack.
    pub fn send(&self, byte: u8) -> io::Result<()> {
        self.panel.send(byte)
    }

    /// The first thing not yet looked at that `wanted` accepts; the error says what was there instead.
    pub fn wait_for(&self, wanted: impl Fn(&Seen) -> bool) -> io::Result<Seen> {
        self.wait_for_within(PATIENCE, wanted)
    }

    /// The same, with less patience.
    pub fn wait_for_within(&self, time: Duration, wanted: impl Fn(&Seen) -> bool) -> io::Result<Seen> {
        let end = Instant::now() + time;
        let mut passed = Vec::new();
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let seen = self.shown.recv_timeout(left).map_err(|error| {
                io::Error::other(format!("the panel: {error} after {time:?}; saw {passed:?}"))
            })?;
            if wanted(&seen) {
                return Ok(seen);
            }
            passed.push(seen);
        }
    }
}
