//! `weldpath pendant --sim`: the firmware in QEMU, with a panel that keys operate.

use std::io::{self, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::sync::mpsc::RecvTimeoutError;
use std::thread;
use std::time::Duration;

use weldpath::pendant::emulator::Panel;

use super::keys::{CTRL_C, Keys};
use super::{Exit, Failure, port, print};

/// Run the pendant's firmware in QEMU, to stream to and to scan with
///
/// Prints its port for --port, and the panel's socket. Keys, here or written to the panel's socket: e emergency stop,
/// g grip or release the enabling switch, r reset button, m manual mode, c confirm where the torch is, q quit (here only). The lamps are printed
/// when they change, and written to whoever is connected to the panel.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Simulate it; a real pendant is simply plugged in
    #[arg(long, required = true)]
    sim: bool,
    /// A robot port is fitted: print its socket, too; without a robot there nothing starts
    #[arg(long)]
    robot_port: bool,
    /// The firmware [default: the newest in firmware/target]
    #[arg(long, value_name = "FILE")]
    elf: Option<PathBuf>,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let (mut emulator, panel) = port::boot(args.elf.as_deref(), args.robot_port)?;
    let shown = panel.watch();
    let socket = emulator.folder().join("operator");
    let failed = |error: std::io::Error| Failure::new(Exit::Pendant, format!("the panel's socket: {error}"));
    serve(UnixListener::bind(&socket).map_err(failed)?, panel.clone());
    print(&format!(
        "port {}\npanel {}\nkeys: e emergency stop, g grip/release enabling switch, r reset button, m manual, c confirm, q quit\n{}",
        emulator.address(),
        socket.display(),
        if args.robot_port { format!("robot unix:{}\n", emulator.robot().display()) } else { String::new() }
    ))?;
    let parent = std::os::unix::process::parent_id();
    let mut keys = Keys::new();
    loop {
        match keys.next() {
            Some(b'q' | CTRL_C) => return Ok(()),
            Some(key) => {
                if let Some(said) = panel.key(key).map_err(failed)? {
                    print(&format!("{said}\n"))?;
                }
            }
            // Its parent has gone: nobody would ever end it.
            None if std::os::unix::process::parent_id() != parent => return Ok(()),
            None => match shown.recv_timeout(Duration::from_millis(50)) {
                Ok(seen) => print(&format!("{seen}\n"))?,
                Err(RecvTimeoutError::Timeout) if emulator.is_running() => {}
                Err(_) => return Err(Failure::new(Exit::Pendant, "the emulator ended")),
            },
        }
    }
}

/// Keys in, lamps out, for everyone who connects.
fn serve(listener: UnixListener, panel: Panel) {
    thread::spawn(move || {
        for operator in listener.incoming().flatten() {
            let panel = panel.clone();
            thread::spawn(move || attend(operator, &panel));
        }
    });
}

fn attend(operator: UnixStream, panel: &Panel) {
    // Who does not read what is shown loses it; keys are heard all the same.
    let Ok(mut screen) = operator.set_write_timeout(Some(UNREAD)).and_then(|()| operator.try_clone()) else {
        return;
    };
    let (shown, mut echo) = (panel.watch(), operator.try_clone());
    thread::spawn(move || shown.into_iter().try_for_each(|seen| show(&mut screen, &seen)));
    for key in BufReader::new(operator).bytes().map_while(Result::ok) {
        let (Ok(Some(said)), Ok(echo)) = (panel.key(key), &mut echo) else { continue };
        if show(echo, &said).is_err() {
            return;
        }
    }
}

/// So long something may wait to be read.
const UNREAD: Duration = Duration::from_millis(10);

fn show(screen: &mut UnixStream, what: &dyn std::fmt::Display) -> io::Result<()> {
    match screen.write_all(format!("{what}\n").as_bytes()) {
        Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(()),
        shown => shown,
    }
}
