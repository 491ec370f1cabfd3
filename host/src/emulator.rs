//! The pendant's firmware in QEMU, for anybody without the hardware: its serial line, and its panel.

mod panel;

pub use panel::{Lamps, Panel};

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::serial::Address;

/// How long the emulator may take to open its sockets.
const PATIENCE: Duration = Duration::from_secs(10);
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

/// A running emulator; dropping it ends it.
pub struct Emulator {
    child: Child,
    folder: tempfile::TempDir,
    address: Address,
}

impl Emulator {
    /// Boots the program; its panel has emergency stop and enabling switch released.
    pub fn boot(program: &Path) -> Result<(Self, Panel), Error> {
        let folder = tempfile::Builder::new().prefix("weldpath-pendant-").tempdir()?;
        let child = command(program, folder.path())?.spawn().map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => Error::NoEmulator,
            _ => Error::Failed(error),
        })?;
        let mut emulator = Self { child, folder, address: Address::Device(PathBuf::new()) };
        let panel = emulator.start().map_err(|error| {
            let said = fs::read_to_string(emulator.folder.path().join("stderr")).unwrap_or_default();
            io::Error::other(format!("{error}; it said: {said}"))
        })?;
        Ok((emulator, panel))
    }

    /// Where a host finds the pendant.
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// A folder of its own, which goes with it.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Whether it still runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Everything connected before the first instruction: a panel that is not heard counts as a pressed stop.
    fn start(&mut self) -> io::Result<Panel> {
        let mut control = Control(BufReader::new(self.connect("control")?));
        control.0.get_ref().set_read_timeout(Some(PATIENCE))?;
        control.reply()?;
        control.ask("qmp_capabilities")?;
        let devices = control.ask("query-chardev")?;
        let link = devices.as_array().into_iter().flatten().find(|device| device["label"] == "link");
        let name = link.and_then(|device| device["filename"].as_str()?.strip_prefix("pty:"));
        let name = name.ok_or_else(|| io::Error::other("it named no pseudo-terminal"))?;
        self.address = Address::Device(name.into());
        let panel = Panel::new(self.connect("panel")?)?;
        control.ask("cont")?;
        Ok(panel)
    }

    fn connect(&mut self, name: &str) -> io::Result<UnixStream> {
        let begin = Instant::now();
        loop {
            match UnixStream::connect(self.folder.path().join(name)) {
                Ok(stream) => return Ok(stream),
                Err(error) if begin.elapsed() > PATIENCE => return Err(error),
                Err(_) => sleep(Duration::from_millis(10)),
            }
            if let Some(status) = self.child.try_wait()? {
                return Err(io::Error::other(format!("it ended: {status}")));
            }
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        if self.is_running() {
            // It may have ended in this moment.
            let _ = self.child.kill();
        }
        let _ = self.child.wait();
    }
}

/// The emulator's control socket (QMP).
struct Control(BufReader<UnixStream>);

impl Control {
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

fn command(program: &Path, folder: &Path) -> io::Result<Command> {
    let socket = |id: &str| format!("socket,id={id},path={},server=on,wait=off", folder.join(id).display());
    // Where the system can, the emulator does not outlive a host that is killed.
    let mut command = match Command::new("setpriv").arg("--version").stdout(Stdio::null()).status() {
        Ok(_) => {
            let mut command = Command::new("setpriv");
            command.args(["--pdeathsig", "KILL", "qemu-system-arm"]);
            Command::new("qemu-system-arm").arg("--version").stdout(Stdio::null()).status()?;
            command
        }
        Err(_) => Command::new("qemu-system-arm"),
    };
    command.args(["-M", "mps2-an386", "-nodefaults", "-display", "none", "-monitor", "none", "-S"]);
    command.args(["-chardev", "pty,id=link", "-serial", "chardev:link"]);
    command.args(["-chardev", &socket("panel"), "-serial", "chardev:panel"]);
    command.args(["-chardev", &socket("control"), "-qmp", "chardev:control"]);
    command.args(["-semihosting-config", "enable=on,target=native"]);
    command.arg("-kernel").arg(program).stdin(Stdio::null());
    command.stdout(File::create(folder.join("console"))?).stderr(File::create(folder.join("stderr"))?);
    Ok(command)
}
