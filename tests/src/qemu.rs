//! The firmware in an emulator: built, started one machine at a time, and ended with the test.

mod client;
pub mod operator;
mod panel;

pub use client::Client;
pub use panel::Panel;
pub use weldpath::pendant::emulator::{Broken, Clock, Inputs, Seen, Wire};

use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use weldpath::pendant::emulator::{Emulator, Error};
use weldpath::pendant::serial;
use weldpath::pendant::serial::Line;

/// How long anything may take that has no reason to take long.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// The built program of the firmware's package; none, with the reason printed, where it cannot be built or run.
///
/// # Panics
/// With `WELDPATH_REQUIRE_QEMU` set, as `tests/all.sh` does, instead of none.
pub fn firmware(program: &str) -> Option<PathBuf> {
    static FOLDER: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    match FOLDER.get_or_init(build) {
        Ok(folder) => Some(folder.join(program)),
        Err(reason) => {
            assert!(std::env::var_os("WELDPATH_REQUIRE_QEMU").is_none(), "{reason}");
            println!("skipped: {reason}");
            None
        }
    }
}

fn build() -> Result<PathBuf, String> {
    let emulator = Command::new("qemu-system-arm").arg("--version").stdout(Stdio::null()).status();
    emulator.map_err(|_| "no emulator; run: apt-get install qemu-system-arm".to_string())?;
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../firmware/build.sh");
    let built =
        Command::new(script).args(["build", "--release", "--quiet"]).output().map_err(|e| e.to_string())?;
    if !built.status.success() {
        return Err(String::from_utf8_lossy(&built.stderr).into_owned());
    }
    let said = String::from_utf8_lossy(&built.stdout);
    said.lines().last().map(PathBuf::from).ok_or_else(|| "firmware/build.sh named no folder".into())
}

static ALONE: Mutex<()> = Mutex::new(());

/// Held by whoever runs an emulator: hosts have 200 ms to say something, and continuous integration few processors.
pub fn alone() -> MutexGuard<'static, ()> {
    // A test that failed while it held the lock has ended its machine.
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A running emulator; dropping it ends it.
pub struct Machine {
    emulator: Emulator,
    _alone: MutexGuard<'static, ()>,
}

impl Machine {
    /// The machine with the program loaded, but stopped before its first instruction.
    pub fn load(program: &Path, wire: Wire, clock: Clock) -> Result<Self, Error> {
        let _alone = alone();
        Ok(Self { emulator: Emulator::load(program, wire, clock)?, _alone })
    }

    /// The machine running, with its panel: everything released.
    pub fn boot(program: &Path, wire: Wire) -> Result<(Self, Panel), Error> {
        let mut machine = Self::load(program, wire, Clock::Host)?;
        let panel = Panel::new(machine.emulator.panel(false)?);
        machine.tell("cont")?;
        Ok((machine, panel))
    }

    /// The same with a robot port, whose socket comes with it.
    pub fn boot_with_port(program: &Path, wire: Wire) -> Result<(Self, Panel, PathBuf), Error> {
        let mut machine = Self::load(program, wire, Clock::Host)?;
        let panel = Panel::new(machine.emulator.panel(true)?);
        machine.tell("cont")?;
        let robot = machine.emulator.robot();
        Ok((machine, panel, robot))
    }

    /// The link's end.
    pub fn open_link(&self) -> io::Result<Line> {
        serial::open(self.emulator.address(), 115_200).map_err(io::Error::other)
    }

    /// Where the link is, as `--port` takes it.
    pub fn address(&self) -> String {
        self.emulator.address().to_string()
    }

    /// One command to the emulator: `cont`, `stop`, `system_reset`, `quit`.
    pub fn tell(&mut self, command: &str) -> io::Result<()> {
        self.emulator.tell(command)
    }

    /// Leaves the emulator without a processor for so long; its clock goes on.
    pub fn starve(&self, time: Duration) -> io::Result<()> {
        let signal = |name: &str| {
            let command = format!("kill -{name} {}", self.emulator.process_id());
            let sent = Command::new("sh").args(["-c", &command]).status()?;
            sent.success().then_some(()).ok_or_else(|| io::Error::other(command))
        };
        signal("STOP")?;
        sleep(time);
        signal("CONT")
    }

    /// Waits until the program has ended the emulator itself; what it wrote to its console.
    pub fn run_to_end(mut self) -> io::Result<Vec<u8>> {
        self.tell("cont")?;
        let begin = Instant::now();
        while self.emulator.is_running() {
            if begin.elapsed() > 6 * PATIENCE {
                return Err(io::Error::other(format!("no end after {} s", 6 * PATIENCE.as_secs())));
            }
            sleep(Duration::from_millis(5));
        }
        self.console()
    }

    /// What has come out of the semihosting console: defmt's frames.
    pub fn console(&self) -> io::Result<Vec<u8>> {
        self.emulator.console()
    }
}
