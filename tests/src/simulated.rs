//! `weldpath pendant --sim` as its users run it, its operator, and a line to it that damages bytes.

use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::MutexGuard;
use std::thread;
use std::time::{Duration, Instant};

use weldpath::pendant::serial;

use crate::adversary::Random;
use crate::command::{PATIENCE, Running, weldpath};
use crate::qemu::alone;

/// By then the pendant has seen its switches, and the host the pendant, on a busy machine as well.
const SEEN: Duration = Duration::from_millis(300);

/// A simulated pendant, ended with the test.
pub struct Simulated {
    command: Running,
    /// What `--port` takes.
    pub port: String,
    panel_path: String,
    panel: UnixStream,
    gripped: bool,
    _alone: MutexGuard<'static, ()>,
}

impl Simulated {
    /// Starts it.
    ///
    /// # Panics
    /// If it does not say its port and its panel.
    pub fn start(program: &Path) -> Self {
        let _alone = alone();
        let mut command = Running::start(weldpath().args(["pendant", "--sim", "--elf"]).arg(program));
        let mut after = |word: &str| command.wait_for(&[word]).replacen(word, "", 1);
        let (port, panel_path) = (after("port "), after("panel "));
        let panel = operator_at(&panel_path);
        Self { command, port, panel_path, panel, gripped: false, _alone }
    }

    /// One more operator at its panel.
    pub fn operator(&self) -> UnixStream {
        operator_at(&self.panel_path)
    }

    /// A socket to its port that alters every byte, both ways, with this probability. For one host.
    pub fn damaged(&self, folder: &Path, probability: f64) -> io::Result<String> {
        let path = folder.join("damaged");
        let listener = UnixListener::bind(&path)?;
        let line =
            serial::open(&self.port.parse().map_err(io::Error::other)?, 115_200).map_err(io::Error::other)?;
        thread::spawn(move || -> io::Result<()> {
            let (host, _) = listener.accept()?;
            let (mut from_host, mut to_host) = (host.try_clone()?, host);
            let (mut from_pendant, mut to_pendant) = (line.reader, line.writer);
            thread::spawn(move || relay(&mut from_pendant, &mut to_host, Random::new(1), probability));
            relay(&mut from_host, &mut to_pendant, Random::new(2), probability)
        });
        Ok(format!("unix:{}", path.display()))
    }

    fn key(&mut self, key: u8) {
        self.panel.write_all(&[key]).expect("the panel listens");
    }

    /// Does what `stream` asks of its operator until it says one of the parts; that line.
    ///
    /// # Panics
    /// If it does not within twice [`PATIENCE`].
    pub fn operate(&mut self, host: &mut Running, parts: &[&str]) -> String {
        const STOPPED: &str = "waiting: ";
        const SWITCH: &str = "waiting for the enabling switch";
        // Of a busy machine: the host itself was silent for too long, or waypoints came too late.
        const HELD: &str = "r resumes";
        // As busy: the pendant had not seen the grip when it was asked, or it held again meanwhile. What is refused while it runs
        // or comes to a stop needs nothing.
        const NOT_GRIPPED: &str = "refused: the enabling switch";
        const CHANGED: &str = "refused: the pendant's state has changed";
        const CONFIRM: &str = "press confirm at the pendant";
        const HANDS: &str = "waiting for the key switch in manual";
        let all: Vec<&str> = parts
            .iter()
            .copied()
            .chain([STOPPED, SWITCH, HELD, NOT_GRIPPED, CHANGED, CONFIRM, HANDS])
            .collect();
        let begin = Instant::now();
        loop {
            let line = host.wait_for(&all);
            assert!(begin.elapsed() < 2 * PATIENCE, "{parts:?} do not come, last {line:?}");
            if parts.iter().any(|part| line.contains(part)) {
                return line;
            } else if line.contains(STOPPED) {
                self.key(b'r');
            } else if line.contains(SWITCH) {
                self.grip();
            } else if line.contains(CONFIRM) {
                self.key(b'c');
            } else if line.contains(HANDS) {
                self.key(b'm');
                self.grip();
            } else {
                if !line.contains(CHANGED) {
                    self.grip();
                }
                // Its host has to hear of it before it resumes.
                thread::sleep(SEEN);
                host.press(b"r");
            }
        }
    }

    /// Released, then held.
    fn grip(&mut self) {
        if self.gripped {
            self.key(b'g');
            // A switch that is back before the pendant looked was never released.
            thread::sleep(SEEN);
        }
        self.key(b'g');
        self.gripped = true;
    }

    /// `q` lets it clean up.
    ///
    /// # Panics
    /// If it does not end well.
    pub fn quit(mut self) {
        self.command.press(b"q");
        let ended = self.command.end();
        assert_eq!(ended.code, Some(0), "{}", ended.said);
    }
}

fn operator_at(panel: &str) -> UnixStream {
    UnixStream::connect(panel).expect("the panel's socket is there")
}

fn relay(from: &mut dyn Read, to: &mut dyn Write, mut random: Random, probability: f64) -> io::Result<()> {
    let mut buffer = [0; 512];
    loop {
        let count = match from.read(&mut buffer) {
            Ok(0) => return Ok(()),
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => 0,
            other => other?,
        };
        for byte in &mut buffer[..count] {
            if random.chance(probability) {
                *byte ^= 1 << random.below(8);
            }
        }
        to.write_all(&buffer[..count])?;
    }
}
