//! Where the pendant is: `--port`, or `--sim` where a simulated one will do.

use std::path::PathBuf;

use weldpath::pendant::emulator;
use weldpath::pendant::emulator::Emulator;
use weldpath::pendant::link;
use weldpath::pendant::link::Link;
use weldpath::pendant::serial;
use weldpath::pendant::serial::Address;

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
}

impl PortOrSim {
    /// The link, and the emulator at its other end, if there is one.
    pub(super) fn open(&self) -> Result<(Link, Option<Emulator>), Failure> {
        let emulator = if self.sim { Some(boot(self.elf.as_deref())?.0) } else { None };
        let simulated = emulator.as_ref().map(Emulator::address);
        let address = self.port.as_ref().or(simulated).ok_or_else(|| {
            Failure::new(Exit::Usage, "no pendant named")
                .hint("add --port PORT, or --sim for a simulated one")
        })?;
        Ok((open(address, self.baud)?, emulator))
    }
}

/// Starts the firmware in the emulator.
pub(super) fn boot(elf: Option<&std::path::Path>) -> Result<(Emulator, emulator::Panel), Failure> {
    emulator::firmware(elf)
        .and_then(|program| Emulator::boot(&program))
        .map_err(|error| Failure::new(Exit::Pendant, &error).hint(error.hint()))
}

fn open(address: &Address, baud: u32) -> Result<Link, Failure> {
    let line = serial::open(address, baud)
        .map_err(|error| Failure::new(Exit::Pendant, &error).hint(error.hint()))?;
    Link::open(line).map_err(lost)
}

/// No session, or none any more.
pub(super) fn lost(error: link::Error) -> Failure {
    Failure::new(Exit::Pendant, &error).hint(error.hint())
}
