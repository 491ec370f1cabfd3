//! The operator's side of the emulated panel: switches to set, lamps to watch, and a power source whose current
//! follows the arc output. Its bytes are described in the firmware's board for the emulator.

use std::fmt;
use std::io::{self, BufReader, Read, Write};
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
/// How long the reset button is pressed.
const PRESSED: Duration = Duration::from_millis(100);

/// What the lamps show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lamps {
    /// Everything off: the first instruction, or a fatal error.
    AllOff,
    /// The firmware started.
    Boot,
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

impl fmt::Display for Lamps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lamp = |on: bool| if on { "ON" } else { "off" };
        match *self {
            Self::AllOff => write!(f, "all outputs off"),
            Self::Boot => write!(f, "firmware started"),
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

/// Switches and lamps.
#[derive(Clone)]
pub struct Panel {
    switches: Arc<Mutex<Switches>>,
    watchers: Arc<Mutex<Vec<Sender<Lamps>>>>,
}

struct Switches {
    stream: UnixStream,
    inputs: u8,
}

impl Switches {
    fn set(&mut self, bit: u8, on: bool) -> io::Result<()> {
        self.inputs = if on { self.inputs | bit } else { self.inputs & !bit };
        self.stream.write_all(&[0x40 | self.inputs])
    }
}

/// What is behind a lock is whole even if its holder panicked: single values.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Panel {
    pub(super) fn new(stream: UnixStream) -> io::Result<Self> {
        let bytes = BufReader::new(stream.try_clone()?).bytes().map_while(Result::ok);
        let mut switches = Switches { stream, inputs: 0 };
        switches.set(0, false)?;
        let panel = Self { switches: Arc::new(Mutex::new(switches)), watchers: Arc::default() };
        let watched = panel.clone();
        thread::spawn(move || watched.watch(bytes));
        Ok(panel)
    }

    /// The lamps from now on.
    pub fn lamps(&self) -> Receiver<Lamps> {
        let (watcher, lamps) = channel();
        lock(&self.watchers).push(watcher);
        lamps
    }

    /// Presses or releases the emergency stop.
    pub fn e_stop(&self, pressed: bool) -> io::Result<()> {
        lock(&self.switches).set(E_STOP, pressed)
    }

    /// Grips or releases the enabling switch.
    pub fn enable(&self, held: bool) -> io::Result<()> {
        lock(&self.switches).set(ENABLE, held)
    }

    /// Presses the reset button and lets it go.
    pub fn reset(&self) -> io::Result<()> {
        lock(&self.switches).set(RESET, true)?;
        thread::sleep(PRESSED);
        lock(&self.switches).set(RESET, false)
    }

    /// What an operator does with one key: `e` emergency stop, `g` grip of the enabling switch, `m` manual mode (each
    /// the other way round than before), `r` reset button. What it is now; none for other keys.
    pub fn key(&self, key: u8) -> io::Result<Option<String>> {
        let (bit, name, words) = match key {
            b'e' => (E_STOP, "emergency stop", ["released", "PRESSED"]),
            b'g' => (ENABLE, "enabling switch", ["released", "held"]),
            b'm' => (MANUAL, "mode", ["automatic", "manual"]),
            b'r' => return self.reset().map(|()| Some("reset button pressed".into())),
            _ => return Ok(None),
        };
        let mut switches = lock(&self.switches);
        let on = switches.inputs & bit == 0;
        switches.set(bit, on)?;
        Ok(Some(format!("{name}: {}", words[usize::from(on)])))
    }

    fn watch(&self, mut bytes: impl Iterator<Item = u8>) {
        while let Some(lamps) = decode(&mut bytes) {
            if let Lamps::Outputs { arc, .. } = lamps {
                // The power source: its current follows the arc output. A panel that has gone needs none.
                let _ = lock(&self.switches).set(ESTABLISHED, arc);
            }
            lock(&self.watchers).retain(|watcher| watcher.send(lamps).is_ok());
        }
    }
}

/// The next code from the firmware; none at the end.
fn decode(bytes: &mut impl Iterator<Item = u8>) -> Option<Lamps> {
    loop {
        let code = bytes.next()?;
        let mut clock = || bytes.take(5).fold(0, |tick, group| tick << 7 | u32::from(group & 0x7f));
        match code {
            0xe0 => return Some(Lamps::AllOff),
            0x80..=0x8f => {
                let is = |bit: u8| code & 1 << bit != 0;
                let tick = clock();
                return Some(Lamps::Outputs { arc: is(0), gas: is(1), motion: is(2), wire: is(3), tick });
            }
            0xa0..=0xa3 => {
                clock();
                return Some(Lamps::Boot);
            }
            // Another report, or a code cut short by a reset.
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_switches_say_their_levels_and_the_power_source_follows_the_arc() {
        let (host, mut firmware) = UnixStream::pair().unwrap();
        firmware.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let panel = Panel::new(host).unwrap();
        let lamps = panel.lamps();
        let mut said = || {
            let mut byte = [0];
            firmware.read_exact(&mut byte).unwrap();
            byte[0]
        };
        assert_eq!(said(), 0x40);
        assert_eq!(panel.key(b'g').unwrap().unwrap(), "enabling switch: held");
        assert_eq!(said(), 0x42);
        assert_eq!(panel.key(b'e').unwrap().unwrap(), "emergency stop: PRESSED");
        assert_eq!(said(), 0x43);
        assert_eq!(panel.key(b'x').unwrap(), None);
        firmware.write_all(&[0x85, 0, 0, 0, 1, 2]).unwrap();
        let expected = Lamps::Outputs { arc: true, gas: false, motion: true, wire: false, tick: 130 };
        assert_eq!(lamps.recv_timeout(Duration::from_secs(5)).unwrap(), expected);
        let mut byte = [0];
        firmware.read_exact(&mut byte).unwrap();
        assert_eq!(byte[0], 0x4b, "current while the arc is on");
    }
}
