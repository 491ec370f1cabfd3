//! The operator's side of the emulated panel (see `firmware/src/board/mps2_an386/panel.rs` for its bytes).

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Instant;

use super::PATIENCE;

/// What the panel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seen {
    /// Everything off, sent by the first instruction or a fatal handler.
    AllOff,
    /// The firmware started: 0 power, 1 panic, 2 fault, 3 watchdog.
    Boot(u8),
    /// Bytes of stack ever used, in answer to `?`.
    Stack(u32),
    /// The outputs changed, in this tick.
    Outputs {
        /// Arc power.
        arc: bool,
        /// Shielding gas.
        gas: bool,
        /// Motion enable.
        motion: bool,
        /// Wire feed.
        wire: bool,
        /// 500 a second since the start.
        tick: u32,
    },
}

/// The panel: switches to set, lamps to watch. Everything seen is kept in order.
pub struct Panel {
    switches: UnixStream,
    lamps: Receiver<Seen>,
}

impl Panel {
    pub(super) fn new(stream: UnixStream) -> io::Result<Self> {
        let (sender, lamps) = channel();
        let mut bytes = io::BufReader::new(stream.try_clone()?).bytes().map_while(Result::ok);
        thread::spawn(move || {
            while let Some(seen) = decode(&mut bytes) {
                if sender.send(seen).is_err() {
                    return;
                }
            }
        });
        Ok(Self { switches: stream, lamps })
    }

    /// Sets the three inputs.
    pub fn set_inputs(&mut self, estop: bool, enable: bool, reset: bool) -> io::Result<()> {
        self.send(0x40 | u8::from(estop) | u8::from(enable) << 1 | u8::from(reset) << 2)
    }

    /// A byte as it is: `?` report the stack's use, `!` panic, `$` hang, `%` overflow the stack.
    pub fn send(&mut self, byte: u8) -> io::Result<()> {
        self.switches.write_all(&[byte])
    }

    /// The first thing seen from now on that `wanted` accepts.
    pub fn wait_for(&self, wanted: impl Fn(&Seen) -> bool) -> io::Result<Seen> {
        let end = Instant::now() + PATIENCE;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let seen =
                self.lamps.recv_timeout(left).map_err(|e| io::Error::other(format!("the panel: {e}")))?;
            if wanted(&seen) {
                return Ok(seen);
            }
        }
    }
}

/// The next code from the firmware; none at the end.
fn decode(bytes: &mut impl Iterator<Item = u8>) -> Option<Seen> {
    loop {
        let code = bytes.next()?;
        let clock = |bytes: &mut dyn Iterator<Item = u8>| {
            bytes.take(5).fold(0, |tick, group| tick << 7 | u32::from(group & 0x7f))
        };
        match code {
            0xe0 => return Some(Seen::AllOff),
            0x80..=0x8f => {
                let is = |bit: u8| code & 1 << bit != 0;
                let tick = clock(bytes);
                return Some(Seen::Outputs { arc: is(0), gas: is(1), motion: is(2), wire: is(3), tick });
            }
            0xa0..=0xa3 => {
                clock(bytes);
                return Some(Seen::Boot(code & 3));
            }
            0xb0 => return Some(Seen::Stack(clock(bytes))),
            // A code cut short by a reset.
            _ => {}
        }
    }
}
