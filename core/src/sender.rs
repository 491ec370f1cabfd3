//! The host end of the link: messages and microseconds in, messages out. No I/O, no clock, no allocation.
//!
//! The shell gives every message of the pendant to [`Sender::receive`] and sends what [`Sender::poll`] returns until
//! that is none. Commands go one at a time and again until answered; waypoints go in a window and again where the
//! selective-ack map shows a gap; pings keep the session alive and measure the round trip. After a loss of the
//! session nothing is sent until [`Sender::open`] with a new nonce.

mod rto;
mod upload;

use heapless::{Deque, Vec};

use crate::interlock::Fault;
use crate::wire::{
    self, Ack, Answer, Attach, AttachRefusal, Begin, ChunkRefused, Command, FromHost, FromPendant, Hello,
    HelloAck, HelloRefusal, HostMessage, Limits, MAX_SAMPLES, PendantMessage, Ping, Refusal, Sample,
    Telemetry, Unreadable, WireWaypoint,
};
use rto::Rto;
use upload::{Step, Upload};

/// Period of pings, µs.
const PING_US: u64 = 25_000;
/// The same on a line whose round trip is longer than that.
const SLOW_PING_US: u64 = 50_000;
/// Wait after Busy, µs.
const BUSY_US: u64 = 100_000;
/// Commands that may wait.
const QUEUE: usize = 8;

/// How a path is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Config {
    /// Waypoints per chunk, 1 to [`wire::MAX_CHUNK`]: 4 bears one wrong byte in a thousand better than 8.
    pub chunk: u8,
    /// Chunks under way at once, at most 17.
    pub window: u8,
}

impl Default for Config {
    fn default() -> Self {
        Self { chunk: 4, window: 8 }
    }
}

/// What the shell should know.
#[derive(Debug, Clone, PartialEq, Eq)]
#[must_use = "a lost session or a fault has to reach the operator"]
#[allow(clippy::large_enum_variant, reason = "no allocator to box with; one notice is alive at a time")]
pub enum Notice {
    /// Nothing new.
    Nothing,
    /// The session is open.
    Connected(HelloAck),
    /// No session; after Busy it is tried again, else not.
    Refused(HelloRefusal),
    /// There is no path to go on with; after Busy it is tried again, else not.
    AttachRefused(AttachRefusal),
    /// The pendant does not know the session (any more): open another.
    SessionLost {
        /// Boot nonce of the pendant.
        boot: u32,
    },
    /// A command was answered.
    Answered {
        /// As [`Sender::request`] returned.
        ticket: u16,
        /// What came of it.
        answer: Answer,
    },
    /// The path is open and being sent.
    Loading,
    /// All of the path is there and its digest is right.
    Loaded,
    /// The path was refused.
    LoadRefused(Refusal),
    /// A chunk was refused: the path is not acceptable.
    ChunkRefused(ChunkRefused),
    /// State.
    Telemetry(Telemetry),
    /// Executed set-points.
    Samples(Vec<Sample, MAX_SAMPLES>),
    /// A fault; repeated until it is seen, which the sender says by itself.
    Fault(Fault),
    /// The pendant could not read a message.
    Unread(Unreadable),
}

/// What went over the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Statistics {
    /// Waypoints sent for the first time.
    pub waypoints: u64,
    /// Waypoints sent again.
    pub resent: u64,
}

/// The path of a session whose host was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Former {
    /// Nonce of that session.
    pub nonce: u32,
    /// Path id.
    pub path: u16,
    /// Digest that the path was committed with.
    pub digest: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Link {
    Closed,
    Opening { due_us: u64, sends: u8 },
    Open { session: u32, limits: Limits },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Origin {
    Caller(u16),
    Upload,
}

#[derive(Debug, Clone)]
struct Outstanding {
    request: u16,
    command: Command,
    origin: Origin,
    sent_us: u64,
    sends: u8,
}

/// The host end.
#[derive(Debug, Clone)]
pub struct Sender {
    config: Config,
    nonce: u32,
    former: Option<Former>,
    link: Link,
    rto: Rto,
    chunk_rto: Rto,
    ping_due_us: u64,
    ping: Option<u32>,
    pings: u32,
    pendant_tick: u32,
    queue: Deque<(u16, Command), QUEUE>,
    tickets: u16,
    requests: u16,
    outstanding: Option<Outstanding>,
    upload: Option<Upload>,
    fault_seen: Option<u16>,
    heard_tick: Option<u32>,
    statistics: Statistics,
}

impl Sender {
    /// Closed. Numbers out of range are brought into it.
    pub fn new(config: &Config) -> Self {
        let chunk = config.chunk.clamp(1, wire::MAX_CHUNK as u8);
        let window = config.window.clamp(1, wire::SACK_CHUNKS as u8 + 1);
        Self {
            config: Config { chunk, window },
            nonce: 0,
            former: None,
            link: Link::Closed,
            rto: Rto::default(),
            chunk_rto: Rto::default(),
            ping_due_us: 0,
            ping: None,
            pings: 0,
            pendant_tick: 0,
            queue: Deque::new(),
            tickets: 0,
            requests: 0,
            outstanding: None,
            upload: None,
            fault_seen: None,
            heard_tick: None,
            statistics: Statistics::default(),
        }
    }

    /// Opens a session, dropping whatever there was. `nonce` has to be fresh and random.
    pub fn open(&mut self, nonce: u32) {
        self.close();
        self.nonce = nonce;
        self.former = None;
        self.link = Link::Opening { due_us: 0, sends: 0 };
    }

    /// As [`Self::open`], going on with the path of a host that was lost.
    pub fn attach(&mut self, nonce: u32, former: Former) {
        self.open(nonce);
        self.former = Some(former);
    }

    /// Forgets the session and all that waits.
    fn close(&mut self) {
        self.link = Link::Closed;
        self.queue.clear();
        self.outstanding = None;
        self.upload = None;
        self.fault_seen = None;
        self.heard_tick = None;
        self.ping = None;
        self.pings = 0;
        self.requests = 0;
    }

    /// The pendant's limits while a session is open.
    pub fn limits(&self) -> Option<&Limits> {
        match &self.link {
            Link::Open { limits, .. } => Some(limits),
            _ => None,
        }
    }

    /// Whether a command or a load still waits for its answer.
    pub fn is_busy(&self) -> bool {
        self.outstanding.is_some() || !self.queue.is_empty()
    }

    /// Where the load stands.
    pub fn progress(&self) -> Option<&Ack> {
        self.upload.as_ref().map(Upload::ack)
    }

    /// What went over the line.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Has a command executed once; the ticket names it in [`Notice::Answered`]. Hold and Stop overtake what waits.
    /// The command comes back if the queue is full or no session is open.
    #[allow(clippy::result_large_err, reason = "a full queue hands the item back, and there is no allocator")]
    pub fn request(&mut self, command: Command) -> Result<u16, Command> {
        if self.limits().is_none() {
            return Err(command);
        }
        let ticket = self.tickets;
        let urgent = matches!(command, Command::Hold | Command::Stop);
        let entry = (ticket, command);
        let queued = if urgent { self.queue.push_front(entry) } else { self.queue.push_back(entry) };
        queued.map_err(|(_, command)| command)?;
        self.tickets = self.tickets.wrapping_add(1);
        Ok(ticket)
    }

    /// Sends a path: Begin, chunks, Commit. [`Self::poll`] is then given the same waypoints. The chunk length is set
    /// here. False if a load is under way, no session is open, or `total` is not the length of the path.
    pub fn load(&mut self, begin: Begin, path: &[WireWaypoint]) -> bool {
        let begin = Begin { chunk: self.config.chunk, ..begin };
        let under_way = self.upload.as_ref().is_some_and(|upload| upload.step != Step::Loaded);
        let Some(digest) = wire::path_digest(path).filter(|_| path.len() as u64 == u64::from(begin.total))
        else {
            return false;
        };
        if under_way || self.limits().is_none() {
            return false;
        }
        self.upload = Some(Upload::new(&begin, digest));
        true
    }

    /// Ends the sending of waypoints; the pendant keeps what it has until Abort or Reset.
    pub fn cancel_load(&mut self) {
        self.upload = None;
    }

    /// Takes a message of the pendant.
    pub fn receive(&mut self, frame: FromPendant, now_us: u64) -> Notice {
        match (&frame.message, self.link) {
            (PendantMessage::HelloAck(ack), Link::Opening { .. }) if ack.nonce == self.nonce => {
                return self.connected(frame.session, *ack, now_us);
            }
            (PendantMessage::HelloRefused(refused), Link::Opening { sends, .. })
                if refused.nonce == self.nonce =>
            {
                return self.refused(refused.why, sends, now_us);
            }
            (PendantMessage::AttachRefused { nonce, why }, Link::Opening { sends, .. })
                if *nonce == self.nonce =>
            {
                return self.attach_refused(*why, sends, now_us);
            }
            (_, Link::Open { session, .. }) if session == frame.session => {}
            _ => return Notice::Nothing,
        }
        match frame.message {
            PendantMessage::Reply { request, answer } => self.answered(request, answer),
            PendantMessage::Ack(ack) => self.acked(&ack, now_us),
            PendantMessage::ChunkRefused(refused) => self.chunk_refused(refused),
            PendantMessage::Pong { token, tick } => {
                self.heard_of(tick);
                // Of the last ping, and once: a doubled Pong would measure its own detour.
                if self.ping.take_if(|sent| *sent == token).is_some() {
                    self.rto.measured((now_us as u32).wrapping_sub(token));
                }
                Notice::Nothing
            }
            PendantMessage::FaultReport { number, fault } => {
                self.fault_seen = Some(number);
                Notice::Fault(fault)
            }
            PendantMessage::Telemetry(telemetry) => self.telemetry(telemetry, now_us),
            PendantMessage::Samples(samples) => Notice::Samples(samples),
            PendantMessage::NoSession { boot } => {
                self.close();
                Notice::SessionLost { boot }
            }
            PendantMessage::Unread(why) => Notice::Unread(why),
            PendantMessage::HelloAck(_)
            | PendantMessage::HelloRefused(_)
            | PendantMessage::AttachRefused { .. } => Notice::Nothing,
        }
    }

    fn connected(&mut self, session: u32, ack: HelloAck, now_us: u64) -> Notice {
        let own = (wire::VERSION, wire::session_id(ack.boot, self.nonce));
        if ack.version != own.0 {
            return self.refused(HelloRefusal::Version { host: own.0, pendant: ack.version }, 0, now_us);
        }
        if session != own.1 {
            // Of no session that both nonces make: somebody else's frame, or a pendant that is none.
            return Notice::Nothing;
        }
        self.link = Link::Open { session, limits: ack.limits };
        self.ping_due_us = now_us;
        self.pendant_tick = ack.tick;
        self.requests = ack.request;
        Notice::Connected(ack)
    }

    /// The pendant's time comes back to it with the next ping; late messages bring older ones.
    fn heard_of(&mut self, tick: u32) {
        if tick.wrapping_sub(self.pendant_tick) as i32 > 0 {
            self.pendant_tick = tick;
        }
    }

    fn attach_refused(&mut self, why: AttachRefusal, sends: u8, now_us: u64) -> Notice {
        self.link = match why {
            AttachRefusal::Busy => Link::Opening { due_us: now_us + BUSY_US, sends },
            AttachRefusal::State(_) | AttachRefusal::Session | AttachRefusal::Path => Link::Closed,
        };
        Notice::AttachRefused(why)
    }

    fn refused(&mut self, why: HelloRefusal, sends: u8, now_us: u64) -> Notice {
        self.link = match why {
            HelloRefusal::Busy => Link::Opening { due_us: now_us + BUSY_US, sends },
            HelloRefusal::Version { .. } | HelloRefusal::Schema { .. } => Link::Closed,
        };
        Notice::Refused(why)
    }

    fn answered(&mut self, request: u16, answer: Answer) -> Notice {
        let Some(done) = self.outstanding.take_if(|outstanding| outstanding.request == request) else {
            return Notice::Nothing;
        };
        match done.origin {
            Origin::Caller(ticket) => Notice::Answered { ticket, answer },
            Origin::Upload => self.load_answered(&done.command, answer),
        }
    }

    fn load_answered(&mut self, command: &Command, answer: Answer) -> Notice {
        let ring = self.limits().map_or(0, |limits| limits.ring);
        let Some(upload) = &mut self.upload else { return Notice::Nothing };
        match (command, answer) {
            (_, Answer::Refused(why)) => {
                self.upload = None;
                Notice::LoadRefused(why)
            }
            (Command::Begin(begin), _) if begin.path == upload.begin.path => {
                upload.opened(ring);
                Notice::Loading
            }
            (Command::Commit { path, .. }, _) if *path == upload.begin.path => {
                upload.step = Step::Loaded;
                Notice::Loaded
            }
            _ => Notice::Nothing,
        }
    }

    /// Telemetry that was overtaken is dropped: an operator who acts on it would act on a state that is gone.
    fn telemetry(&mut self, telemetry: Telemetry, now_us: u64) -> Notice {
        if self.heard_tick.is_some_and(|tick| (telemetry.tick.wrapping_sub(tick) as i32) < 0) {
            return Notice::Nothing;
        }
        self.heard_tick = Some(telemetry.tick);
        self.heard_of(telemetry.tick);
        if let Some(ack) = telemetry.load {
            let _ = self.acked(&ack, now_us);
        }
        Notice::Telemetry(telemetry)
    }

    fn acked(&mut self, ack: &Ack, now_us: u64) -> Notice {
        if let Some(upload) = &mut self.upload {
            upload.acked(ack, now_us, &mut self.chunk_rto);
        }
        Notice::Nothing
    }

    fn chunk_refused(&mut self, refused: ChunkRefused) -> Notice {
        let ours = self.upload.take_if(|upload| upload.begin.path == refused.path).is_some();
        if ours { Notice::ChunkRefused(refused) } else { Notice::Nothing }
    }

    /// The next message to send now, if any. `path`: the waypoints given to [`Self::load`].
    pub fn poll(&mut self, now_us: u64, path: &[WireWaypoint]) -> Option<FromHost> {
        match self.link {
            Link::Closed => None,
            Link::Opening { due_us, sends } => self.poll_hello(due_us, sends, now_us),
            Link::Open { session, .. } => {
                let message = self.poll_open(now_us, path)?;
                Some(FromHost { session, message })
            }
        }
    }

    fn poll_hello(&mut self, due_us: u64, sends: u8, now_us: u64) -> Option<FromHost> {
        if now_us < due_us {
            return None;
        }
        let sends = sends.saturating_add(1);
        self.link = Link::Opening { due_us: now_us + self.rto.timeout_us(sends.min(3)), sends };
        let hello = Hello { version: wire::VERSION, schema: wire::SCHEMA, nonce: self.nonce };
        let message = match self.former {
            None => HostMessage::Hello(hello),
            Some(Former { nonce: former, path, digest }) => {
                HostMessage::Attach(Attach { hello, former, path, digest })
            }
        };
        Some(FromHost { session: 0, message })
    }

    fn poll_open(&mut self, now_us: u64, path: &[WireWaypoint]) -> Option<HostMessage> {
        if now_us >= self.ping_due_us {
            let slow = u64::from(self.rto.round_trip_us()) > PING_US;
            self.ping_due_us = now_us + if slow { SLOW_PING_US } else { PING_US };
            let token = now_us as u32;
            self.ping = Some(token);
            self.pings = self.pings.wrapping_add(1);
            return Some(HostMessage::Ping(Ping { count: self.pings, echo: self.pendant_tick, token }));
        }
        if let Some(control) = self.poll_control(now_us) {
            return Some(control);
        }
        if let Some(number) = self.fault_seen.take() {
            return Some(HostMessage::FaultSeen { number });
        }
        self.poll_chunk(now_us, path)
    }

    fn poll_control(&mut self, now_us: u64) -> Option<HostMessage> {
        if self.outstanding.is_none() {
            let (origin, command) = self.next_command()?;
            self.requests = self.requests.wrapping_add(1);
            let request = self.requests;
            self.outstanding = Some(Outstanding { request, command, origin, sent_us: now_us, sends: 0 });
        }
        let rto = self.rto;
        let outstanding = self.outstanding.as_mut()?;
        let waited_us = now_us.saturating_sub(outstanding.sent_us);
        if outstanding.sends > 0 && waited_us < rto.timeout_us(outstanding.sends) {
            return None;
        }
        outstanding.sends = outstanding.sends.saturating_add(1);
        outstanding.sent_us = now_us;
        Some(HostMessage::Control { request: outstanding.request, command: outstanding.command.clone() })
    }

    /// What the caller asked for first, then what the load needs.
    fn next_command(&mut self) -> Option<(Origin, Command)> {
        if let Some((ticket, command)) = self.queue.pop_front() {
            return Some((Origin::Caller(ticket), command));
        }
        let Upload { begin, digest, step, .. } = self.upload.as_ref()?;
        match step {
            Step::Begin => Some((Origin::Upload, Command::Begin(*begin))),
            Step::Commit => Some((Origin::Upload, Command::Commit { path: begin.path, digest: *digest })),
            Step::Chunks | Step::Loaded => None,
        }
    }

    fn poll_chunk(&mut self, now_us: u64, path: &[WireWaypoint]) -> Option<HostMessage> {
        let upload = self.upload.as_mut()?;
        let (number, again) = upload.due(now_us, &self.chunk_rto, u32::from(self.config.window))?;
        let chunk = upload.chunk(number, path)?;
        let count = chunk.waypoints.len() as u64;
        if again {
            self.statistics.resent += count;
        } else {
            self.statistics.waypoints += count;
        }
        Some(HostMessage::Chunk(chunk))
    }
}
