//! Where the pendant is: `--port`, or `--sim` where a simulated one will do.

use std::path::PathBuf;

use weldpath::pendant::emulator;
use weldpath::pendant::emulator::Emulator;
use weldpath::pendant::link;
use weldpath::pendant::link::{Link, refusal_words};
use weldpath::pendant::serial;
use weldpath::pendant::serial::Address;
use weldpath_core::wire::{Answer, Command, WirePose};

use super::{Exit, Failure, whole};

/// A pendant's port.
#[derive(Debug, clap::Args)]
pub(super) struct Port {
    /// Serial port or pseudo-terminal (/dev/ttyACM0), host:port, or unix:/path/of/socket
    #[arg(long, value_name = "PORT")]
    pub(super) port: Address,
    /// Speed of a real serial port
    #[arg(long, value_name = "N", default_value_t = 115_200, value_parser = whole::<u32>)]
    pub(super) baud: u32,
}

/// A pendant's port, or a simulated pendant.
#[derive(Debug, clap::Args)]
pub(super) struct PortOrSim {
    /// Serial port or pseudo-terminal (/dev/ttyACM0), host:port, or unix:/path/of/socket
    #[arg(long, value_name = "PORT")]
    port: Option<Address>,
    /// Speed of a real serial port
    #[arg(long, value_name = "N", default_value_t = 115_200, value_parser = whole::<u32>)]
    baud: u32,
    /// Run the pendant's firmware in QEMU for this command
    #[arg(long, conflicts_with = "port")]
    sim: bool,
    /// The firmware for --sim [default: the newest in firmware/target]
    #[arg(long, value_name = "FILE", requires = "sim")]
    elf: Option<PathBuf>,
}

impl Port {
    pub(super) fn open(&self) -> Result<Link, Failure> {
        open(&self.port, self.baud)
    }

    /// A session that goes on with the path of a host that was lost.
    pub(super) fn attach(&self, former: link::Former) -> Result<Link, Failure> {
        let line = serial::open(&self.port, self.baud)
            .map_err(|error| Failure::new(Exit::Pendant, &error).hint(error.hint()))?;
        Link::attach(line, former).map_err(lost)
    }
}

impl PortOrSim {
    /// The link, and the emulator at its other end with its panel, if there is one.
    pub(super) fn open(&self) -> Result<(Link, Option<Simulated>), Failure> {
        let simulated = if self.sim { Some(boot(self.elf.as_deref(), false)?) } else { None };
        let emulator = simulated.as_ref().map(|(emulator, _)| emulator);
        let address = self.port.as_ref().or(emulator.map(Emulator::address)).ok_or_else(|| {
            Failure::new(Exit::Usage, "no pendant named")
                .hint("add --port PORT, or --sim for a simulated one")
        })?;
        Ok((open(address, self.baud)?, simulated))
    }
}

/// An emulator and its panel.
pub(super) type Simulated = (Emulator, emulator::Panel);

/// Starts the firmware in the emulator; `port`: with a robot port.
pub(super) fn boot(elf: Option<&std::path::Path>, port: bool) -> Result<Simulated, Failure> {
    emulator::firmware(elf)
        .and_then(|program| Emulator::boot(&program, port))
        .map_err(|error| Failure::new(Exit::Pendant, &error).hint(error.hint()))
}

fn open(address: &Address, baud: u32) -> Result<Link, Failure> {
    let line = serial::open(address, baud)
        .map_err(|error| Failure::new(Exit::Pendant, &error).hint(error.hint()))?;
    Link::open(line).map_err(lost)
}

/// Says where torch or camera is on the flange.
pub(super) fn set_tool(link: &Link, tool: WirePose) -> Result<(), Failure> {
    match link.ask(Command::SetTool { tool }).map_err(lost)? {
        Answer::Refused(why) => {
            let why = format!("the pendant refused the tool: {}", refusal_words(why));
            Err(Failure::new(Exit::Unfinished, why))
        }
        _ => Ok(()),
    }
}

/// No session, or none any more.
pub(super) fn lost(error: link::Error) -> Failure {
    Failure::new(Exit::Pendant, &error).hint(error.hint())
}
