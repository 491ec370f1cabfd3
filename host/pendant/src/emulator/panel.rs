//! The operator's side of the emulated panel: switches to set, lamps to watch, and a power source whose current
//! follows the arc output. Its bytes are described in the firmware's board for the emulator.

use std::fmt;
use std::io::{self, BufReader, Read, Write};
use std::iter::Peekable;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

const E_STOP: u8 = 1;
const ENABLE: u8 = 1 << 1;
const RESET: u8 = 1 << 2;
const ESTABLISHED: u8 = 1 << 3;
const MANUAL: u8 = 1 << 4;
/// Bits of the second byte.
const CONFIRM: u8 = 1;
const E_STOP_2: u8 = 1 << 1;
const ENABLE_2: u8 = 1 << 2;
const READBACK: u8 = 1 << 3;
const PORT: u8 = 1 << 4;
/// How long the reset button is pressed.
const PRESSED: Duration = Duration::from_millis(100);

/// What the panel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seen {
    /// Everything off, sent by the first instruction or a fatal handler.
    AllOff,
    /// The firmware started: 0 power, 1 panic, 2 fault, 3 watchdog.
    Boot(u8),
    /// Bytes of stack ever used.
    Stack(u32),
    /// The charge pumps of arc and motion have dropped: their pins stood still.
    PumpsDropped {
        /// Emulated time since the last tick began, µs.
        after_us: u32,
    },
    /// The outputs changed.
    Outputs {
        /// Arc power.
        arc: bool,
        /// Shielding gas.
        gas: bool,
        /// Motion.
        motion: bool,
        /// Wire feed.
        wire: bool,
        /// Ticks of 2 ms since the start.
        tick: u32,
    },
}

impl fmt::Display for Seen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lamp = |on: bool| if on { "ON" } else { "off" };
        match *self {
            Self::AllOff => write!(f, "all outputs off"),
            Self::Boot(0) => write!(f, "firmware started"),
            Self::Boot(cause) => {
                let after =
                    ["a panic", "a fault", "a hang"].get(usize::from(cause) - 1).unwrap_or(&"a reset");
                write!(f, "firmware started after {after}")
            }
            Self::PumpsDropped { after_us } => write!(f, "charge pumps dropped after {after_us} us"),
            Self::Stack(bytes) => write!(f, "{bytes} bytes of stack used"),
            Self::Outputs { arc, gas, motion, wire, tick } => write!(
                f,
                "arc {} wire {} gas {} motion {} (tick {tick})",
                lamp(arc),
                lamp(wire),
                lamp(gas),
                lamp(motion)
            ),
        }
    }
}

/// The switches that an operator sets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Emergency stop pressed.
    pub e_stop: bool,
    /// Enabling switch held.
    pub enable: bool,
    /// Reset button pressed.
    pub reset: bool,
}

/// What a test may break.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Broken {
    /// Second contact of the emergency stop.
    EStop,
    /// Second contact of the enabling switch.
    Enable,
    /// Read-back of the outputs.
    Readback,
}

/// Switches and lamps.
#[derive(Clone)]
pub struct Panel {
    switches: Arc<Mutex<Switches>>,
    watchers: Arc<Mutex<Vec<Sender<Seen>>>>,
}

struct Switches {
    stream: UnixStream,
    inputs: u8,
    more: u8,
}

impl Switches {
    fn set(&mut self, bit: u8, on: bool) -> io::Result<()> {
        self.inputs = if on { self.inputs | bit } else { self.inputs & !bit };
        self.say()
    }

    fn set_more(&mut self, bit: u8, on: bool) -> io::Result<()> {
        self.more = if on { self.more | bit } else { self.more & !bit };
        self.stream.write_all(&[0x60 | self.more])
    }

    fn say(&mut self) -> io::Result<()> {
        self.stream.write_all(&[0x40 | self.inputs])
    }
}

/// What is behind a lock is whole even if its holder panicked: single values.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Panel {
    /// `port`: the strap that says that a robot port is fitted; it has to be told before the switches.
    pub(super) fn new(stream: UnixStream, port: bool) -> io::Result<Self> {
        let bytes = BufReader::new(stream.try_clone()?).bytes().map_while(Result::ok);
        let mut switches = Switches { stream, inputs: 0, more: 0 };
        switches.set_more(PORT, port)?;
        switches.set(0, false)?;
        let panel = Self { switches: Arc::new(Mutex::new(switches)), watchers: Arc::default() };
        let watched = panel.clone();
        thread::spawn(move || watched.follow(bytes));
        Ok(panel)
    }

    /// What it shows from now on.
    pub fn watch(&self) -> Receiver<Seen> {
        let (watcher, seen) = channel();
        lock(&self.watchers).push(watcher);
        seen
    }

    /// Sets the three switches.
    pub fn set(&self, inputs: Inputs) -> io::Result<()> {
        let mut switches = lock(&self.switches);
        let Inputs { e_stop, enable, reset } = inputs;
        for (bit, on) in [(E_STOP, e_stop), (ENABLE, enable), (RESET, reset)] {
            switches.inputs = if on { switches.inputs | bit } else { switches.inputs & !bit };
        }
        switches.say()
    }

    /// A byte for the firmware's own: `?` report the stack's use, `!` panic, `$` hang, `%` overflow the stack.
    pub fn send(&self, byte: u8) -> io::Result<()> {
        lock(&self.switches).stream.write_all(&[byte])
    }

    /// Presses the button that confirms where the torch is, and lets it go.
    pub fn confirm(&self) -> io::Result<()> {
        lock(&self.switches).set_more(CONFIRM, true)?;
        thread::sleep(PRESSED);
        lock(&self.switches).set_more(CONFIRM, false)
    }

    /// Turns the key switch.
    pub fn manual(&self, manual: bool) -> io::Result<()> {
        lock(&self.switches).set(MANUAL, manual)
    }

    /// Breaks, or mends, the second contact of the emergency stop or of the enabling switch, or the outputs' read-back.
    pub fn break_contact(&self, what: Broken, broken: bool) -> io::Result<()> {
        let bit = match what {
            Broken::EStop => E_STOP_2,
            Broken::Enable => ENABLE_2,
            Broken::Readback => READBACK,
        };
        lock(&self.switches).set_more(bit, broken)
    }

    /// Presses the reset button and lets it go.
    pub fn reset(&self) -> io::Result<()> {
        lock(&self.switches).set(RESET, true)?;
        thread::sleep(PRESSED);
        lock(&self.switches).set(RESET, false)
    }

    /// What an operator does with one key: `e` emergency stop, `g` grip of the enabling switch, `m` manual mode (each
    /// the other way round than before), `r` reset button, `c` the torch is where it has to be. What it is now; none for other keys.
    pub fn key(&self, key: u8) -> io::Result<Option<String>> {
        let (bit, name, words) = match key {
            b'e' => (E_STOP, "emergency stop", ["released", "PRESSED"]),
            b'g' => (ENABLE, "enabling switch", ["released", "held"]),
            b'm' => (MANUAL, "mode", ["automatic", "manual"]),
            b'c' => return self.confirm().map(|()| Some("confirm button pressed".into())),
            b'r' => return self.reset().map(|()| Some("reset button pressed".into())),
            _ => return Ok(None),
        };
        let mut switches = lock(&self.switches);
        let on = switches.inputs & bit == 0;
        switches.set(bit, on)?;
        Ok(Some(format!("{name}: {}", words[usize::from(on)])))
    }

    fn follow(&self, bytes: impl Iterator<Item = u8>) {
        let mut bytes = bytes.peekable();
        while let Some(seen) = decode(&mut bytes) {
            // A panel whose firmware has gone needs no answer.
            let _ = match seen {
                // The power source: its current follows the arc output.
                Seen::Outputs { arc, .. } => lock(&self.switches).set(ESTABLISHED, arc),
                // Contacts are there when the firmware starts; these have to be told.
                Seen::Boot(_) => lock(&self.switches).set(ESTABLISHED, false),
                Seen::PumpsDropped { .. } => lock(&self.switches).set(ESTABLISHED, false),
                Seen::AllOff | Seen::Stack(_) => Ok(()),
            };
            lock(&self.watchers).retain(|watcher| watcher.send(seen).is_ok());
        }
    }
}

/// The next code from the firmware; none at the end. One that a reset has cut short is left out.
fn decode(bytes: &mut Peekable<impl Iterator<Item = u8>>) -> Option<Seen> {
    loop {
        let code = bytes.next()?;
        let seen = match code {
            0xe0 => Some(Seen::AllOff),
            0x80..=0x8f => {
                let is = |bit: u8| code & 1 << bit != 0;
                let outputs =
                    |tick| Seen::Outputs { arc: is(0), gas: is(1), motion: is(2), wire: is(3), tick };
                number(bytes).map(outputs)
            }
            0xa0..=0xa3 => number(bytes).map(|_| Seen::Boot(code & 3)),
            0xb0 => number(bytes).map(Seen::Stack),
            0xb1 => number(bytes).map(|after_us| Seen::PumpsDropped { after_us }),
            _ => None,
        };
        if seen.is_some() {
            return seen;
        }
    }
}

/// Five groups of seven bits, highest first; none if a code comes before the last.
fn number(bytes: &mut Peekable<impl Iterator<Item = u8>>) -> Option<u32> {
    (0..5).try_fold(0_u32, |number, _| Some(number << 7 | u32::from(bytes.next_if(|&byte| byte < 0x80)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_switches_say_their_levels_and_the_power_source_follows_the_arc() {
        let (host, mut firmware) = UnixStream::pair().unwrap();
        firmware.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let panel = Panel::new(host, false).unwrap();
        let seen = panel.watch();
        let mut said = || {
            let mut byte = [0];
            firmware.read_exact(&mut byte).unwrap();
            byte[0]
        };
        assert_eq!((said(), said()), (0x60, 0x40));
        assert_eq!(panel.key(b'g').unwrap().unwrap(), "enabling switch: held");
        assert_eq!(said(), 0x42);
        assert_eq!(panel.key(b'e').unwrap().unwrap(), "emergency stop: PRESSED");
        assert_eq!(said(), 0x43);
        assert_eq!(panel.key(b'x').unwrap(), None);
        firmware.write_all(&[0x85, 0, 0, 0, 1, 2]).unwrap();
        let expected = Seen::Outputs { arc: true, gas: false, motion: true, wire: false, tick: 130 };
        assert_eq!(seen.recv_timeout(Duration::from_secs(5)).unwrap(), expected);
        let mut byte = [0];
        firmware.read_exact(&mut byte).unwrap();
        assert_eq!(byte[0], 0x4b, "current while the arc is on");
    }

    #[test]
    fn a_code_that_a_reset_cuts_short_does_not_swallow_the_next() {
        let mut bytes =
            [0x85, 0, 0, 0xe0, 0xe0, 0xa2, 0, 0, 0, 0, 0, 0xb0, 0, 0, 0, 1, 0].into_iter().peekable();
        let seen: Vec<Seen> = std::iter::from_fn(|| decode(&mut bytes)).collect();
        assert_eq!(seen, [Seen::AllOff, Seen::AllOff, Seen::Boot(2), Seen::Stack(128)]);
    }
}
