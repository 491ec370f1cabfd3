//! A session with a pendant over a [`Line`]: core's sender in a thread of its own, questions and events for the rest.
//!
//! One thread reads, one drives [`weldpath_core::sender`] and writes, so that neither end can stop the other by not
//! reading. Dropping the [`Link`] ends both; the pendant then hears nothing more and holds within its silence limit.

pub mod program;
pub mod rest;
pub mod saved;
mod words;

use std::collections::HashMap;
use std::fmt;
use std::hash::{BuildHasher, RandomState};
use std::io::{self, ErrorKind, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender as Channel, channel};
use std::thread;
use std::time::{Duration, Instant};

use weldpath_core::interlock::Fault;
use weldpath_core::sender::{self, Notice, Sender};
use weldpath_core::wire::frame::{self, Received};
use weldpath_core::wire::{
    Ack, Answer, AttachRefusal, Begin, ChunkRefused, Command, FromPendant, HelloAck, HelloRefusal,
    MAX_HOST_FRAME, PendantDeframer, Refusal, Sample, Telemetry, WireWaypoint,
};

use crate::serial::Line;
pub use weldpath_core::sender::Former;
pub(crate) use words::attach_words;
pub use words::{cause_words, fault_words, refusal_words, state_words};

/// How long a Hello is repeated: an emulator's pseudo-terminal loses its first second.
pub const HELLO_PATIENCE: Duration = Duration::from_secs(2);
/// A pendant speaks 20 times a second; after this long without a word it is gone.
pub const SILENCE: Duration = Duration::from_secs(2);
/// A command is answered, and a path gets on, within this time, or the other end is no pendant in order.
pub const REPLY_PATIENCE: Duration = Duration::from_secs(5);
/// How often the sender is asked what is due when nothing happens.
const TURN: Duration = Duration::from_millis(5);

/// Why there is no session, or none any more.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Nobody answered.
    #[error("no pendant answers (Hello was repeated for {patience} s){noise}", patience = HELLO_PATIENCE.as_secs(), noise = .0)]
    NoAnswer(Noise),
    /// It speaks, and does not answer.
    #[error("the pendant has not answered a command for {} s, although it is still sending", REPLY_PATIENCE.as_secs())]
    NoReply,
    /// Another host has the pendant.
    #[error("the pendant is busy: another host's session is alive, or the torch still moves")]
    Busy,
    /// The protocol versions differ.
    #[error("protocol versions differ: this weldpath speaks {host}, the pendant {pendant}")]
    Version {
        /// This host's.
        host: u16,
        /// The pendant's.
        pendant: u16,
    },
    /// Same version, other layout of messages.
    #[error("same protocol version, but schema {host:08x} here and {pendant:08x} at the pendant")]
    Schema {
        /// This host's.
        host: u32,
        /// The pendant's.
        pendant: u32,
    },
    /// There is no path to go on with.
    #[error("nothing to continue with: {}", attach_words(*.0))]
    Attach(AttachRefusal),
    /// The pendant ended the session.
    #[error("the pendant ended the session: it was reset, or heard nothing for too long")]
    SessionLost,
    /// The pendant stopped talking.
    #[error("the pendant has been silent for {} s", SILENCE.as_secs())]
    Silent,
    /// The line failed.
    #[error("the line to the pendant failed: {0}")]
    Line(String),
}

impl Error {
    /// What to try.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::NoAnswer(noise) if noise.frames > 0 => "install firmware and weldpath of the same release",
            Self::NoAnswer(noise) if noise.bytes > 0 => {
                "another device may be at this port, or the pendant has another --baud"
            }
            Self::NoReply => "release the enabling switch; then start the pendant and the command again",
            Self::NoAnswer(_) | Self::Silent => {
                "check cable, port and --baud, and that the pendant has power"
            }
            Self::Busy => "end the other program, or wait until the torch has stopped",
            Self::Attach(_) => "`weldpath stream --from-mm` or --from-waypoint loads the rest anew",
            Self::Version { .. } | Self::Schema { .. } => "install firmware and weldpath of the same release",
            Self::SessionLost | Self::Line(_) => "nothing moves until a new session; start the command again",
        }
    }
}

/// What came over a line on which nobody speaks this protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Noise {
    /// Bytes.
    pub bytes: usize,
    /// Frames with a right checksum that are no messages of this version.
    pub frames: usize,
    first: [u8; 8],
}

impl Noise {
    /// More bytes.
    pub fn hear(&mut self, bytes: &[u8]) {
        for (place, byte) in self.first.iter_mut().skip(self.bytes).zip(bytes) {
            *place = *byte;
        }
        self.bytes += bytes.len();
    }
}

impl fmt::Display for Noise {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.bytes, self.frames) {
            (0, _) => Ok(()),
            (_, 0) => {
                write!(to, "; {} bytes came that are no frames, first", self.bytes)?;
                self.first.iter().take(self.bytes).try_for_each(|byte| write!(to, " {byte:02x}"))
            }
            (_, frames) => {
                let version = weldpath_core::wire::VERSION;
                write!(to, "; {frames} frames came that are no messages of protocol version {version}")
            }
        }
    }
}

/// What a pendant let its host know.
#[derive(Debug, Clone)]
pub enum Event {
    /// State.
    Telemetry(Telemetry),
    /// Where the load stands.
    Progress(Ack),
    /// All of the path is there and its digest is right.
    Loaded,
    /// The path was refused.
    LoadRefused(Refusal),
    /// One of its waypoints was refused.
    ChunkRefused(ChunkRefused),
    /// Executed set-points.
    Samples(Vec<Sample>),
    /// A fault.
    Fault(Fault),
}

#[allow(clippy::large_enum_variant, reason = "few are alive at a time")]
enum Input {
    Bytes(Vec<u8>),
    Failed(String),
    Ask(Command, Channel<Answer>),
    Load(Begin, Vec<WireWaypoint>),
    Close,
}

enum Told {
    /// What came while nobody answered.
    Heard(Noise),
    Connected(HelloAck),
    Busy,
    Event(Event),
    Lost(Error),
}

/// An open session.
pub struct Link {
    inputs: Channel<Input>,
    told: Receiver<Told>,
    stop: Arc<AtomicBool>,
    ack: HelloAck,
    nonce: u32,
}

impl Link {
    /// Opens a session on the line, repeating Hello for [`HELLO_PATIENCE`].
    ///
    /// ```no_run
    /// use weldpath_pendant::{link::Link, serial};
    ///
    /// let line = serial::open(&"/dev/ttyACM0".parse()?, 115_200)?;
    /// let link = Link::open(line)?;
    /// println!("{:?}", link.pendant());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn open(line: Line) -> Result<Self, Error> {
        Self::start(line, None)
    }

    /// As [`Self::open`], going on with the path of a host that was lost.
    pub fn attach(line: Line, former: Former) -> Result<Self, Error> {
        Self::start(line, Some(former))
    }

    /// The session's nonce, by which a later host goes on with its path.
    pub fn nonce(&self) -> u32 {
        self.nonce
    }

    fn start(line: Line, former: Option<Former>) -> Result<Self, Error> {
        // Randomly seeded by the standard library, anew for each.
        let nonce = RandomState::new().hash_one(0) as u32;
        let mut sender = Sender::new(&sender::Config::default());
        match former {
            Some(former) => sender.attach(nonce, former),
            None => sender.open(nonce),
        }
        let (inputs, received) = channel();
        let (tell, told) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let Line { reader, writer } = line;
        let (to_driver, stopped) = (inputs.clone(), Arc::clone(&stop));
        thread::spawn(move || read(reader, &to_driver, &stopped));
        thread::spawn(move || Driver::new(sender, writer, tell).run(&received));
        // From here on dropping ends the threads, whatever comes of the Hello.
        let mut opening = Opening { inputs: Some(inputs), stop: Arc::clone(&stop) };
        let ack = connected(&told)?;
        let inputs = opening.inputs.take().ok_or(Error::NoAnswer(Noise::default()))?;
        Ok(Self { inputs, told, stop, ack, nonce })
    }

    /// Version, boot nonce and limits of the pendant.
    pub fn pendant(&self) -> &HelloAck {
        &self.ack
    }

    /// Has a command executed once and waits for its answer.
    pub fn ask(&self, command: Command) -> Result<Answer, Error> {
        let (answer, answered) = channel();
        // The driver tells why it ends before it lets go of the questions.
        let gone = || {
            let lost = |told| if let Told::Lost(error) = told { Some(error) } else { None };
            self.told.try_iter().find_map(lost).unwrap_or(Error::SessionLost)
        };
        self.inputs.send(Input::Ask(command, answer)).map_err(|_| gone())?;
        answered.recv_timeout(REPLY_PATIENCE).map_err(|error| match error {
            RecvTimeoutError::Timeout => Error::NoReply,
            RecvTimeoutError::Disconnected => gone(),
        })
    }

    /// Sends a path; [`Event::Loaded`] or a refusal follows.
    pub fn load(&self, begin: Begin, path: Vec<WireWaypoint>) -> Result<(), Error> {
        self.inputs.send(Input::Load(begin, path)).map_err(|_| Error::SessionLost)
    }

    /// The next event; none if there was none for so long.
    pub fn next(&self, patience: Duration) -> Result<Option<Event>, Error> {
        match self.told.recv_timeout(patience) {
            Ok(Told::Event(event)) => Ok(Some(event)),
            Ok(Told::Lost(error)) => Err(error),
            Ok(Told::Connected(_) | Told::Busy | Told::Heard(_)) | Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Error::SessionLost),
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        close(&self.inputs, &self.stop);
    }
}

/// Ends the threads if no session comes of it.
struct Opening {
    inputs: Option<Channel<Input>>,
    stop: Arc<AtomicBool>,
}

impl Drop for Opening {
    fn drop(&mut self) {
        if let Some(inputs) = &self.inputs {
            close(inputs, &self.stop);
        }
    }
}

fn close(inputs: &Channel<Input>, stop: &AtomicBool) {
    stop.store(true, Ordering::Relaxed);
    // A driver that has ended already needs no telling.
    let _ = inputs.send(Input::Close);
}

fn connected(told: &Receiver<Told>) -> Result<HelloAck, Error> {
    let (mut refused, mut noise) = (None, Noise::default());
    let end = Instant::now() + HELLO_PATIENCE;
    loop {
        match told.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(Told::Connected(ack)) => return Ok(ack),
            Ok(Told::Busy) => refused = Some(Error::Busy),
            Ok(Told::Event(_)) => {}
            Ok(Told::Heard(heard)) => noise = heard,
            Ok(Told::Lost(error)) => return Err(error),
            Err(_) => return Err(refused.unwrap_or(Error::NoAnswer(noise))),
        }
    }
}

fn read(mut reader: Box<dyn Read + Send>, inputs: &Channel<Input>, stop: &AtomicBool) {
    let mut buffer = [0; 1024];
    while !stop.load(Ordering::Relaxed) {
        let input = match reader.read(&mut buffer) {
            Ok(0) => Input::Failed("closed at the other end".into()),
            Ok(count) => Input::Bytes(buffer[..count].to_vec()),
            Err(error) if is_passing(&error) => continue,
            Err(error) => Input::Failed(error.to_string()),
        };
        let last = matches!(input, Input::Failed(_));
        if inputs.send(input).is_err() || last {
            return;
        }
    }
}

/// Whether a read that failed so may be tried again.
pub fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Drives the sender: whatever happens goes through one queue.
struct Driver {
    sender: Sender,
    writer: Box<dyn Write + Send>,
    bytes: Box<PendantDeframer>,
    noise: Noise,
    begin: Instant,
    heard: Option<Instant>,
    path: Vec<WireWaypoint>,
    waiting: HashMap<u16, Channel<Answer>>,
    tell: Channel<Told>,
}

impl Driver {
    fn new(sender: Sender, writer: Box<dyn Write + Send>, tell: Channel<Told>) -> Self {
        Self {
            sender,
            writer,
            bytes: Box::new(PendantDeframer::new()),
            noise: Noise::default(),
            begin: Instant::now(),
            heard: None,
            path: Vec::new(),
            waiting: HashMap::new(),
            tell,
        }
    }

    fn run(mut self, inputs: &Receiver<Input>) {
        let ended = loop {
            let waited = inputs.recv_timeout(TURN);
            let more = std::iter::from_fn(|| inputs.try_recv().ok());
            let outcome = waited.ok().into_iter().chain(more).try_for_each(|input| self.take(input));
            if let Err(ended) = outcome.and_then(|()| self.speak()).and_then(|()| self.listen_for_silence()) {
                break ended;
            }
        };
        if let Some(error) = ended {
            // Nobody may be listening any more.
            let _ = self.tell.send(Told::Lost(error));
        }
    }

    /// The error ends the session; none says that its owner did.
    fn take(&mut self, input: Input) -> Result<(), Option<Error>> {
        match input {
            Input::Bytes(bytes) => {
                self.noise.hear(&bytes);
                bytes.into_iter().try_for_each(|byte| self.byte(byte))?;
                if self.heard.is_none() {
                    // Nobody may be listening any more.
                    let _ = self.tell.send(Told::Heard(self.noise));
                }
                Ok(())
            }
            Input::Failed(why) => Err(Some(Error::Line(why))),
            Input::Close => Err(None),
            Input::Ask(command, answer) => {
                // A command that is refused for want of room drops its channel, which its owner notices.
                if let Ok(ticket) = self.sender.request(command) {
                    self.waiting.insert(ticket, answer);
                }
                Ok(())
            }
            Input::Load(begin, path) => {
                self.path = path;
                let begun = self.sender.load(begin, &self.path);
                begun.then_some(()).ok_or(Some(Error::SessionLost))
            }
        }
    }

    fn byte(&mut self, byte: u8) -> Result<(), Option<Error>> {
        let Some(Received::Payload(payload)) = self.bytes.push(byte) else { return Ok(()) };
        let Ok(message) = frame::decode::<FromPendant>(payload) else {
            self.noise.frames += 1;
            return Ok(());
        };
        self.heard = Some(Instant::now());
        let before = self.sender.progress().copied();
        let notice = self.sender.receive(message, self.now_us());
        if let Some(ack) = self.sender.progress().copied().filter(|ack| before != Some(*ack)) {
            self.tell(Event::Progress(ack));
        }
        self.notice(notice)
    }

    fn notice(&mut self, notice: Notice) -> Result<(), Option<Error>> {
        match notice {
            Notice::Nothing | Notice::Loading | Notice::Unread(_) => {}
            Notice::Connected(ack) => drop(self.tell.send(Told::Connected(ack))),
            Notice::AttachRefused(AttachRefusal::Busy) => drop(self.tell.send(Told::Busy)),
            Notice::AttachRefused(why) => return Err(Some(Error::Attach(why))),
            Notice::Refused(HelloRefusal::Busy) => drop(self.tell.send(Told::Busy)),
            Notice::Refused(HelloRefusal::Version { host, pendant }) => {
                return Err(Some(Error::Version { host, pendant }));
            }
            Notice::Refused(HelloRefusal::Schema { host, pendant }) => {
                return Err(Some(Error::Schema { host, pendant }));
            }
            Notice::SessionLost { .. } => return Err(Some(Error::SessionLost)),
            Notice::Answered { ticket, answer } => {
                if let Some(waiting) = self.waiting.remove(&ticket) {
                    let _ = waiting.send(answer);
                }
            }
            Notice::Loaded => self.tell(Event::Loaded),
            Notice::LoadRefused(why) => self.tell(Event::LoadRefused(why)),
            Notice::ChunkRefused(refused) => self.tell(Event::ChunkRefused(refused)),
            Notice::Telemetry(telemetry) => self.tell(Event::Telemetry(telemetry)),
            Notice::Samples(samples) => self.tell(Event::Samples(samples.to_vec())),
            Notice::Fault(fault) => self.tell(Event::Fault(fault)),
        }
        Ok(())
    }

    fn tell(&self, event: Event) {
        // An owner that has gone away closes the session by another message.
        let _ = self.tell.send(Told::Event(event));
    }

    fn speak(&mut self) -> Result<(), Option<Error>> {
        while let Some(message) = self.sender.poll(self.now_us(), &self.path) {
            let mut bytes = [0; MAX_HOST_FRAME];
            let Ok(length) = frame::encode(&message, &mut bytes) else { continue };
            match self.writer.write_all(&bytes[..length]) {
                // A frame cut short is a frame lost: it is sent again when it matters.
                Err(error) if !is_passing(&error) => return Err(Some(Error::Line(error.to_string()))),
                _ => {}
            }
        }
        Ok(())
    }

    fn listen_for_silence(&self) -> Result<(), Option<Error>> {
        match self.heard {
            Some(heard) if heard.elapsed() > SILENCE => Err(Some(Error::Silent)),
            _ => Ok(()),
        }
    }

    fn now_us(&self) -> u64 {
        self.begin.elapsed().as_micros() as u64
    }
}
