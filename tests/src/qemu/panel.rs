//! The operator's side of the emulated panel (see `firmware/src/board/mps2_an386/panel.rs` for its bytes).

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

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

/// The panel: switches to set, lamps to watch, and a power source whose current follows the arc output. Everything
/// seen is kept in order.
pub struct Panel {
    switches: Arc<Mutex<Switches>>,
    lamps: Receiver<Seen>,
}

struct Switches {
    stream: UnixStream,
    inputs: u8,
}

const ESTABLISHED: u8 = 1 << 3;

impl Switches {
    fn send(&mut self) -> io::Result<()> {
        self.stream.write_all(&[0x40 | self.inputs])
    }
}

impl Panel {
    pub(super) fn new(stream: UnixStream) -> io::Result<Self> {
        let (sender, lamps) = channel();
        let mut bytes = io::BufReader::new(stream.try_clone()?).bytes().map_while(Result::ok);
        let switches = Arc::new(Mutex::new(Switches { stream, inputs: 0 }));
        let power_source = Arc::clone(&switches);
        thread::spawn(move || {
            while let Some(seen) = decode(&mut bytes) {
                if let Seen::Outputs { arc, .. } = seen {
                    let mut switches = power_source.lock().expect("no panic while held");
                    let current = if arc { ESTABLISHED } else { 0 };
                    if switches.inputs & ESTABLISHED != current {
                        switches.inputs = switches.inputs & !ESTABLISHED | current;
                        let _ = switches.send();
                    }
                }
                if sender.send(seen).is_err() {
                    return;
                }
            }
        });
        Ok(Self { switches, lamps })
    }

    /// Sets the three inputs; the key switch stays in automatic.
    pub fn set_inputs(&mut self, estop: bool, enable: bool, reset: bool) -> io::Result<()> {
        let mut switches = self.switches.lock().expect("no panic while held");
        switches.inputs =
            switches.inputs & ESTABLISHED | u8::from(estop) | u8::from(enable) << 1 | u8::from(reset) << 2;
        switches.send()
    }

    /// A byte as it is: `?` report the stack's use, `!` panic, `$` hang, `%` overflow the stack.
    pub fn send(&mut self, byte: u8) -> io::Result<()> {
        self.switches.lock().expect("no panic while held").stream.write_all(&[byte])
    }

    /// The first thing seen from now on that `wanted` accepts.
    pub fn wait_for(&self, wanted: impl Fn(&Seen) -> bool) -> io::Result<Seen> {
        self.wait_for_within(PATIENCE, wanted)
    }

    /// The same, with less patience.
    pub fn wait_for_within(&self, time: Duration, wanted: impl Fn(&Seen) -> bool) -> io::Result<Seen> {
        let end = Instant::now() + time;
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
