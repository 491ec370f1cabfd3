//! The pendant's firmware in QEMU, for anybody without the hardware: its serial line, and its panel.

mod panel;

pub use panel::{Broken, Inputs, Panel, Seen};

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::serial::Address;

/// How long the emulator may take to open its sockets.
const PATIENCE: Duration = Duration::from_secs(20);
/// Below a checkout: where `firmware/build.sh` puts the programs, one folder per compiler.
const TARGETS: &str = "firmware/target";
const PROGRAM: &str = "thumbv7em-none-eabihf/release/weldpath-firmware";

/// Why there is no simulated pendant.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// No program to run.
    #[error("the pendant's firmware is not built: no {TARGETS}/*/{PROGRAM} here or above")]
    NoFirmware,
    /// The named program is not there.
    #[error("cannot read the firmware {path}: {source}")]
    Unreadable {
        /// As given.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The emulator is not installed.
    #[error("qemu-system-arm is not installed")]
    NoEmulator,
    /// It started and failed.
    #[error("the emulator failed: {0}")]
    Failed(#[from] io::Error),
}

impl Error {
    /// What to do.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::NoFirmware | Self::Unreadable { .. } => {
                "in the checkout, run `firmware/build.sh build --release`, or name the program with --elf"
            }
            Self::NoEmulator => "on Debian: apt-get install qemu-system-arm",
            Self::Failed(_) => {
                "start it once more; if it fails again, try the program with qemu-system-arm itself"
            }
        }
    }
}

/// The newest firmware built here: in the current folder, in one above it, or beside this program.
pub fn firmware(named: Option<&Path>) -> Result<PathBuf, Error> {
    if let Some(path) = named {
        let unreadable = |source| Error::Unreadable { path: path.into(), source };
        return File::open(path).map(|_| path.into()).map_err(unreadable);
    }
    let places = [std::env::current_dir(), std::env::current_exe()];
    let folders: Vec<PathBuf> = places
        .into_iter()
        .flatten()
        .flat_map(|p| p.ancestors().map(Path::to_path_buf).collect::<Vec<_>>())
        .collect();
    let built =
        folders.iter().filter_map(|folder| fs::read_dir(folder.join(TARGETS)).ok()).flatten().flatten();
    let programs = built.map(|compiler| compiler.path().join(PROGRAM));
    let dated = programs.filter_map(|path| Some((fs::metadata(&path).ok()?.modified().ok()?, path)));
    dated.max().map(|(_, path)| path).ok_or(Error::NoFirmware)
}

/// What carries the link's bytes.
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
pub struct Emulator {
    child: Child,
    folder: tempfile::TempDir,
    address: Address,
    control: Control,
}

impl Emulator {
    /// Boots the program on a pseudo-terminal; its panel has emergency stop and enabling switch released. `port`: a robot
    /// port is fitted, behind the socket [`Self::robot`].
    pub fn boot(program: &Path, port: bool) -> Result<(Self, Panel), Error> {
        let mut emulator = Self::load(program, Wire::Pty, Clock::Host)?;
        let panel = emulator.panel(port)?;
        emulator.tell("cont")?;
        Ok((emulator, panel))
    }

    /// The machine with the program loaded and the link ready, stopped before its first instruction.
    pub fn load(program: &Path, wire: Wire, clock: Clock) -> Result<Self, Error> {
        let folder = tempfile::Builder::new().prefix("weldpath-pendant-").tempdir()?;
        let mut child = command(program, folder.path(), wire, clock)?.spawn().map_err(started)?;
        let connected = connect(&mut child, &folder.path().join("control")).and_then(Control::new);
        let connected = connected.and_then(|mut control| Ok((control.link(folder.path(), wire)?, control)));
        match connected {
            Ok((address, control)) => Ok(Self { child, folder, address, control }),
            Err(error) => {
                end(&mut child);
                let said = fs::read_to_string(folder.path().join("stderr")).unwrap_or_default();
                Err(io::Error::other(format!("{error}; it said: {said}")).into())
            }
        }
    }

    /// Its panel, which says now that everything is released. There is one. `port`: a robot port is fitted.
    pub fn panel(&mut self, port: bool) -> io::Result<Panel> {
        Panel::new(connect(&mut self.child, &self.folder.path().join("panel"))?, port)
    }

    /// The socket of the robot port.
    pub fn robot(&self) -> PathBuf {
        self.folder.path().join("robot")
    }

    /// One command without arguments: `cont`, `stop`, `system_reset`, `quit`.
    pub fn tell(&mut self, command: &str) -> io::Result<()> {
        self.control.ask(command).map(drop)
    }

    /// Where a host finds the pendant.
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// A folder of its own, which goes with it.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Of its process.
    pub fn process_id(&self) -> u32 {
        self.child.id()
    }

    /// What has come out of the semihosting console: defmt's frames.
    pub fn console(&self) -> io::Result<Vec<u8>> {
        fs::read(self.folder.path().join("console"))
    }

    /// Whether it still runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

fn end(child: &mut Child) {
    // It may have ended already.
    let _ = child.kill();
    let _ = child.wait();
}

fn started(error: io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::NotFound => Error::NoEmulator,
        _ => Error::Failed(error),
    }
}

/// Opens one of its sockets, which appears some time after the start, or never.
fn connect(child: &mut Child, socket: &Path) -> io::Result<UnixStream> {
    let begin = Instant::now();
    loop {
        match UnixStream::connect(socket) {
            Ok(stream) => return Ok(stream),
            Err(error) if begin.elapsed() > PATIENCE => return Err(error),
            Err(_) => sleep(Duration::from_millis(10)),
        }
        if let Some(status) = child.try_wait()? {
            return Err(io::Error::other(format!("it ended: {status}")));
        }
    }
}

/// The emulator's control socket (QMP).
struct Control(BufReader<UnixStream>);

impl Control {
    fn new(stream: UnixStream) -> io::Result<Self> {
        stream.set_read_timeout(Some(PATIENCE))?;
        let mut control = Self(BufReader::new(stream));
        // It greets first.
        control.reply()?;
        control.ask("qmp_capabilities")?;
        Ok(control)
    }

    /// Where the link's other end is.
    fn link(&mut self, folder: &Path, wire: Wire) -> io::Result<Address> {
        if wire == Wire::Socket {
            return Ok(Address::Unix(folder.join("link")));
        }
        let devices = self.ask("query-chardev")?;
        let link = devices.as_array().into_iter().flatten().find(|device| device["label"] == "link");
        let name = link.and_then(|device| device["filename"].as_str()?.strip_prefix("pty:"));
        let name = name.ok_or_else(|| io::Error::other("it named no pseudo-terminal"))?;
        Ok(Address::Device(name.into()))
    }

    fn ask(&mut self, command: &str) -> io::Result<serde_json::Value> {
        writeln!(self.0.get_mut(), "{{\"execute\":\"{command}\"}}")?;
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

    fn reply(&mut self) -> io::Result<serde_json::Value> {
        let mut line = String::new();
        self.0.read_line(&mut line)?;
        serde_json::from_str(&line).map_err(io::Error::other)
    }
}

fn command(program: &Path, folder: &Path, wire: Wire, clock: Clock) -> Result<Command, Error> {
    let socket = |id: &str| format!("socket,id={id},path={},server=on,wait=off", folder.join(id).display());
    let link = if wire == Wire::Pty { "pty,id=link".into() } else { socket("link") };
    // Where the system can, the emulator does not outlive a host that is killed.
    let mut command = match Command::new("setpriv").arg("--version").stdout(Stdio::null()).status() {
        Ok(_) => {
            let mut command = Command::new("setpriv");
            command.args(["--pdeathsig", "KILL", "qemu-system-arm"]);
            let emulator = Command::new("qemu-system-arm").arg("--version").stdout(Stdio::null()).status();
            emulator.map_err(started)?;
            command
        }
        Err(_) => Command::new("qemu-system-arm"),
    };
    command.args(["-M", "mps2-an386", "-nodefaults", "-display", "none", "-monitor", "none", "-S"]);
    command.args(["-chardev", &link, "-serial", "chardev:link"]);
    command.args(["-chardev", &socket("panel"), "-serial", "chardev:panel"]);
    command.args(["-chardev", &socket("robot"), "-serial", "chardev:robot"]);
    command.args(["-chardev", &socket("control"), "-qmp", "chardev:control"]);
    command.args(["-semihosting-config", "enable=on,target=native"]);
    if clock == Clock::Instructions {
        command.args(["-icount", "shift=10"]);
    }
    command.arg("-kernel").arg(program).stdin(Stdio::null());
    command.stdout(File::create(folder.join("console"))?).stderr(File::create(folder.join("stderr"))?);
    Ok(command)
}
