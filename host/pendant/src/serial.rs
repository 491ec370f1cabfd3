//! The line to a pendant: a serial port, a pseudo-terminal, a TCP or a Unix socket, all as two halves.
//!
//! The only file that names the serial-port library. A read returns within [`READ_TIMEOUT`], whether bytes came or
//! not; a write that cannot go on for [`WRITE_TIMEOUT`] fails, so that a pendant that does not read cannot hold its host.

use std::fmt;
use std::io::{Read, Write};
use std::net::TcpStream;
#[cfg(unix)]
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

/// How long a read waits for a byte.
pub const READ_TIMEOUT: Duration = Duration::from_millis(50);
/// How long a write waits for room.
pub const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// Where a pendant is.
///
/// ```
/// use weldpath_pendant::serial::Address;
///
/// assert_eq!("localhost:4000".parse(), Ok(Address::Tcp("localhost:4000".into())));
/// assert_eq!("/dev/ttyACM0".parse(), Ok(Address::Device("/dev/ttyACM0".into())));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// A serial port or pseudo-terminal: `/dev/ttyACM0`, `COM3`.
    Device(PathBuf),
    /// `tcp:host:port`.
    Tcp(String),
    /// `unix:/path/of/socket`.
    Unix(PathBuf),
}

/// Both directions of a line; each half may live in a thread of its own.
pub struct Line {
    /// From the pendant.
    pub reader: Box<dyn Read + Send>,
    /// To the pendant.
    pub writer: Box<dyn Write + Send>,
}

/// Why a line cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("cannot open {address}: {source}")]
pub struct Error {
    address: Address,
    source: std::io::Error,
}

impl Error {
    /// What to try.
    pub fn hint(&self) -> &'static str {
        match (&self.address, self.source.kind()) {
            (_, std::io::ErrorKind::PermissionDenied) => {
                "you may not open it; on Linux serial ports belong to the group dialout or uucp: join it, or ask its owner"
            }
            (Address::Device(_), _) => {
                "is the pendant plugged in, and no other program using it? `ls /dev/tty*` lists ports; \
                 without one: `weldpath pendant --sim`"
            }
            _ => "is something listening there? `weldpath pendant --sim` starts a simulated pendant",
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Device(path) => write!(f, "{}", path.display()),
            Self::Tcp(place) => write!(f, "tcp:{place}"),
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

impl FromStr for Address {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let is_port = |text: &str| text.parse::<u16>().is_ok();
        match text.split_once(':') {
            _ if text.is_empty() => Err("empty; write /dev/ttyACM0, host:port or unix:/path".into()),
            Some((scheme, place)) if scheme != "unix" && place.starts_with("//") => {
                Err(format!("write {} without {scheme}://, as host:port", place[2..].trim_end_matches('/')))
            }
            Some(("unix", path)) if !path.is_empty() => Ok(Self::Unix(path.into())),
            Some(("tcp", place)) if place.rsplit_once(':').is_some_and(|(_, port)| is_port(port)) => {
                Ok(Self::Tcp(place.into()))
            }
            Some(("unix" | "tcp", _)) => Err("write unix:/path/of/socket or tcp:host:port".into()),
            Some((host, port)) if !host.is_empty() && !text.contains('/') && is_port(port) => {
                Ok(Self::Tcp(text.into()))
            }
            _ => Ok(Self::Device(text.into())),
        }
    }
}

/// The serial ports of this machine, with what is plugged in where USB tells.
///
/// # Errors
/// What the system says, or that this build has no serial ports.
#[cfg(feature = "serial")]
pub fn ports() -> std::io::Result<Vec<String>> {
    let described = |port: serialport::SerialPortInfo| match port.port_type {
        serialport::SerialPortType::UsbPort(usb) => {
            format!("{} ({})", port.port_name, usb.product.as_deref().unwrap_or("USB"))
        }
        _ => port.port_name,
    };
    Ok(serialport::available_ports()?.into_iter().map(described).collect())
}

/// The serial ports of this machine: none that this build could open.
///
/// # Errors
/// Always: that this build has no serial ports.
#[cfg(not(feature = "serial"))]
pub fn ports() -> std::io::Result<Vec<String>> {
    Err(std::io::Error::new(std::io::ErrorKind::Unsupported, "this build has no serial ports"))
}

/// Opens the line; `baud` counts for a real serial port only.
pub fn open(address: &Address, baud: u32) -> Result<Line, Error> {
    let opened = match address {
        Address::Device(path) => device(&path.to_string_lossy(), baud),
        Address::Tcp(place) => tcp(place),
        #[cfg(unix)]
        Address::Unix(path) => unix(path),
        #[cfg(not(unix))]
        Address::Unix(_) => Err(std::io::ErrorKind::Unsupported.into()),
    };
    opened.map_err(|source| Error { address: address.clone(), source })
}

#[cfg(feature = "serial")]
fn device(path: &str, baud: u32) -> std::io::Result<Line> {
    let mut writer = serialport::new(path, baud).timeout(WRITE_TIMEOUT).open()?;
    let mut reader = writer.try_clone()?;
    reader.set_timeout(READ_TIMEOUT)?;
    // What lies in the buffers was meant for whoever had the port before; a pseudo-terminal may not know how.
    let _ = writer.clear(serialport::ClearBuffer::Input);
    writer.set_timeout(WRITE_TIMEOUT)?;
    Ok(Line { reader: Box::new(reader), writer: Box::new(writer) })
}

#[cfg(not(feature = "serial"))]
fn device(_: &str, _: u32) -> std::io::Result<Line> {
    let why = "this build has no serial ports: build it with the feature `serial`";
    Err(std::io::Error::new(std::io::ErrorKind::Unsupported, why))
}

fn tcp(place: &str) -> std::io::Result<Line> {
    let writer = TcpStream::connect(place)?;
    // Else a frame waits for the acknowledgement of the one before: 40 ms.
    writer.set_nodelay(true)?;
    writer.set_write_timeout(Some(WRITE_TIMEOUT))?;
    let reader = writer.try_clone()?;
    reader.set_read_timeout(Some(READ_TIMEOUT))?;
    Ok(Line { reader: Box::new(reader), writer: Box::new(writer) })
}

#[cfg(unix)]
fn unix(path: &std::path::Path) -> std::io::Result<Line> {
    let writer = UnixStream::connect(path)?;
    writer.set_write_timeout(Some(WRITE_TIMEOUT))?;
    let reader = writer.try_clone()?;
    reader.set_read_timeout(Some(READ_TIMEOUT))?;
    Ok(Line { reader: Box::new(reader), writer: Box::new(writer) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_says_by_its_form_what_it_is() {
        let tcp = |place: &str| Address::Tcp(place.into());
        for (text, address) in [
            ("/dev/ttyACM0", Address::Device("/dev/ttyACM0".into())),
            ("COM3", Address::Device("COM3".into())),
            ("/dev/serial/by-id/usb-a:1", Address::Device("/dev/serial/by-id/usb-a:1".into())),
            ("localhost:4000", tcp("localhost:4000")),
            ("tcp:[::1]:4000", tcp("[::1]:4000")),
            ("unix:/run/pendant", Address::Unix("/run/pendant".into())),
        ] {
            assert_eq!(text.parse(), Ok(address), "{text}");
        }
        for wrong in ["", "unix:", "tcp:host", "tcp:host:70000"] {
            assert!(wrong.parse::<Address>().is_err(), "{wrong}");
        }
        for (text, how) in [
            ("tcp://192.168.0.9:4000", "write 192.168.0.9:4000 without tcp://"),
            ("socket://pendant:4000/", "write pendant:4000 without socket://"),
            ("http://pendant", "as host:port"),
        ] {
            assert!(text.parse::<Address>().unwrap_err().contains(how), "{text}");
        }
        assert_eq!("unix:///run/pendant".parse(), Ok(Address::Unix("///run/pendant".into())));
    }

    #[test]
    fn a_line_that_is_not_there_is_named_with_a_way_out() {
        for address in [Address::Device("/dev/no-such-port".into()), Address::Unix("/no/such/socket".into())]
        {
            let error = open(&address, 115_200).err().expect("nothing is there");
            assert!(error.to_string().contains(&address.to_string()), "{error}");
            assert!(error.hint().contains("pendant --sim"));
        }
    }
}
