//! The firmware in an emulator: built, started, and ended with the test.

mod client;
mod panel;

pub use client::{Client, Twin};
pub use panel::{Panel, Seen};

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

/// How long anything may take that has no reason to take long.
pub const PATIENCE: Duration = Duration::from_secs(20);

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

/// What carries the link's bytes between the test and the emulated serial port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    /// A pseudo-terminal, as a USB serial adapter would be.
    Pty,
    /// A Unix socket.
    Socket,
}

/// How the emulator's clock runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// With the host's.
    Host,
    /// 1024 ns an instruction: the same count in every run.
    Instructions,
}

/// A running emulator; dropping it ends it.
pub struct Machine {
    child: Child,
    folder: PathBuf,
    control: Option<BufReader<UnixStream>>,
    /// What [`Machine::open_link`] opens.
    pub link_path: PathBuf,
    wire: Wire,
    /// One machine at a time: hosts have 200 ms to say something, and continuous integration few processors.
    _alone: MutexGuard<'static, ()>,
}

static ALONE: Mutex<()> = Mutex::new(());

impl Machine {
    /// The machine with the program loaded and everything connected, but stopped before its first instruction.
    pub fn load(program: &Path, wire: Wire, clock: Clock) -> io::Result<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        // A test that failed while it held the lock has ended its machine.
        let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let folder = std::env::temp_dir().join(format!("weldpath-qemu-{}-{number}", std::process::id()));
        fs::create_dir(&folder)?;
        let child = command(program, &folder, wire, clock)?.spawn()?;
        let mut machine = Self { child, link_path: folder.join("link"), folder, control: None, wire, _alone };
        machine.connect().map_err(|error| {
            let said = fs::read_to_string(machine.folder.join("stderr")).unwrap_or_default();
            io::Error::other(format!("{error}; the emulator said: {said}"))
        })?;
        Ok(machine)
    }

    /// Opens the control socket, which appears some time after the start, or never.
    fn connect(&mut self) -> io::Result<()> {
        let begin = Instant::now();
        let stream = loop {
            match UnixStream::connect(self.folder.join("control")) {
                Ok(stream) => break stream,
                Err(error) if begin.elapsed() > PATIENCE => return Err(error),
                Err(_) => sleep(Duration::from_millis(5)),
            }
            if let Some(status) = self.child.try_wait()? {
                return Err(io::Error::other(format!("the emulator ended: {status}")));
            }
        };
        stream.set_read_timeout(Some(PATIENCE))?;
        self.control = Some(BufReader::new(stream));
        self.reply()?;
        self.tell("qmp_capabilities")?;
        if self.wire == Wire::Pty {
            self.link_path = self.pty()?;
        }
        Ok(())
    }

    /// The machine running, with its panel: emergency stop released, enabling switch released.
    pub fn boot(program: &Path, wire: Wire) -> io::Result<(Self, Panel)> {
        let mut machine = Self::load(program, wire, Clock::Host)?;
        let mut panel = machine.panel()?;
        // Before the first tick, which would take an unknown panel for a pressed emergency stop.
        panel.set_inputs(false, false, false)?;
        machine.tell("cont")?;
        Ok((machine, panel))
    }

    /// The panel's end of its serial port.
    pub fn panel(&self) -> io::Result<Panel> {
        Panel::new(UnixStream::connect(self.folder.join("panel"))?)
    }

    /// The link's end, with a read timeout of 50 ms.
    pub fn open_link(&self) -> io::Result<Box<dyn Port>> {
        let timeout = Duration::from_millis(50);
        match self.wire {
            Wire::Pty => {
                let port = serialport::new(self.link_path.to_string_lossy(), 115_200).timeout(timeout);
                Ok(Box::new(port.open_native()?))
            }
            Wire::Socket => {
                let stream = UnixStream::connect(&self.link_path)?;
                stream.set_read_timeout(Some(timeout))?;
                Ok(Box::new(stream))
            }
        }
    }

    /// One command without arguments to the emulator: `cont`, `stop`, `system_reset`, `quit`.
    pub fn tell(&mut self, command: &str) -> io::Result<Value> {
        let control = self.control.as_mut().ok_or(io::ErrorKind::NotConnected)?;
        writeln!(control.get_mut(), "{{\"execute\":\"{command}\"}}")?;
        loop {
            let reply = self.reply()?;
            if let Some(value) = reply.get("return") {
                return Ok(value.clone());
            }
            if let Some(error) = reply.get("error") {
                return Err(io::Error::other(error.to_string()));
            }
        }
    }

    /// Waits until the program has ended the emulator itself; what it wrote to its console.
    pub fn run_to_end(mut self) -> io::Result<Vec<u8>> {
        self.tell("cont")?;
        let begin = Instant::now();
        while self.child.try_wait()?.is_none() {
            if begin.elapsed() > 6 * PATIENCE {
                return Err(io::Error::other("the program does not end"));
            }
            sleep(Duration::from_millis(5));
        }
        self.console()
    }

    /// What has come out of the semihosting console: defmt's frames.
    pub fn console(&self) -> io::Result<Vec<u8>> {
        fs::read(self.folder.join("console"))
    }

    fn reply(&mut self) -> io::Result<Value> {
        let mut line = String::new();
        self.control.as_mut().ok_or(io::ErrorKind::NotConnected)?.read_line(&mut line)?;
        serde_json::from_str(&line).map_err(io::Error::other)
    }

    fn pty(&mut self) -> io::Result<PathBuf> {
        let devices = self.tell("query-chardev")?;
        let link = devices.as_array().into_iter().flatten().find(|device| device["label"] == "link");
        let name = link.and_then(|device| device["filename"].as_str()?.strip_prefix("pty:"));
        name.map(PathBuf::from).ok_or_else(|| io::Error::other("the emulator named no pseudo-terminal"))
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            let _ = self.child.kill();
        }
        let _ = self.child.wait();
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Either kind of serial line.
pub trait Port: Read + Write + Send {}
impl<T: Read + Write + Send> Port for T {}

/// Reads until `bytes` is full or [`PATIENCE`] is over.
pub fn read_all(port: &mut dyn Port, bytes: &mut [u8]) -> io::Result<()> {
    let begin = Instant::now();
    let mut filled = 0;
    while filled < bytes.len() {
        match port.read(&mut bytes[filled..]) {
            Ok(n) => filled += n,
            Err(e) if matches!(e.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => {}
            Err(e) => return Err(e),
        }
        if begin.elapsed() > PATIENCE {
            return Err(io::Error::new(
                io::ErrorKind::TimedOut,
                format!("{filled} of {} bytes came", bytes.len()),
            ));
        }
    }
    Ok(())
}

fn command(program: &Path, folder: &Path, wire: Wire, clock: Clock) -> io::Result<Command> {
    let socket = |id: &str| format!("socket,id={id},path={},server=on,wait=off", folder.join(id).display());
    let link = if wire == Wire::Pty { "pty,id=link".into() } else { socket("link") };
    // The emulator must not outlive a killed test.
    let mut command = Command::new("setpriv");
    command.args(["--pdeathsig", "KILL", "qemu-system-arm"]);
    command.args(["-M", "mps2-an386", "-nodefaults", "-display", "none", "-monitor", "none", "-S"]);
    command.args(["-chardev", &link, "-serial", "chardev:link"]);
    command.args(["-chardev", &socket("panel"), "-serial", "chardev:panel"]);
    command.args(["-chardev", &socket("control"), "-qmp", "chardev:control"]);
    command.args(["-semihosting-config", "enable=on,target=native"]);
    if clock == Clock::Instructions {
        command.args(["-icount", "shift=10"]);
    }
    command.arg("-kernel").arg(program).stdin(Stdio::null());
    command.stdout(File::create(folder.join("console"))?).stderr(File::create(folder.join("stderr"))?);
    Ok(command)
}
