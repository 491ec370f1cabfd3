//! A pendant on the bench: messages and ticks by hand, no line between.

use weldpath_core::interlock::State;
use weldpath_core::pendant::{self, Action, Panel, Pendant, Tick};
use weldpath_core::tasks::{Tasks, Workspace};
use weldpath_core::wire::frame::{Received, encode};
use weldpath_core::wire::{
    self, Answer, Attach, Chunk, Command, FromHost, FromPendant, Hello, HostDeframer, HostMessage,
    MAX_HOST_FRAME, PendantMessage, Ping, WireWaypoint,
};

use crate::world::{self, RING};

/// Nonce of the bench's host.
pub const NONCE: u32 = 4711;

/// A pendant with its panel and a session.
pub struct Bench {
    /// The device.
    pub pendant: Pendant<RING>,
    /// Its pins.
    pub panel: Panel,
    /// Number of the request sent last.
    pub request: u16,
    /// Session id.
    pub session: u32,
    /// Count of the ping sent last.
    pub pings: u32,
    deframer: HostDeframer,
    tasks: Tasks,
    workspace: Box<Workspace>,
}

impl Bench {
    /// Session open, switch gripped: Idle.
    pub fn enabled() -> Self {
        Self::with(&world::config())
    }

    /// The same with another configuration.
    pub fn with(config: &pendant::Config) -> Self {
        let pendant = Pendant::new(config, 1).expect("sound configuration");
        let deframer = HostDeframer::new();
        let (tasks, workspace) = (Tasks::default(), Box::default());
        let panel = Panel::default();
        let mut bench = Self { pendant, panel, request: 0, session: 0, pings: 0, deframer, tasks, workspace };
        bench.ticks(2);
        bench.open(NONCE);
        bench.grip();
        assert_eq!(bench.pendant.state(), State::Idle);
        bench
    }

    /// A session of its own.
    pub fn open(&mut self, nonce: u32) {
        let answer = self.hello(nonce);
        assert!(matches!(answer, PendantMessage::HelloAck(_)), "{answer:?}");
        (self.session, self.request, self.pings) = (wire::session_id(1, nonce), 0, 0);
    }

    /// Lets the enabling switch go and grips it anew.
    pub fn grip(&mut self) {
        self.panel.enable = false;
        self.ticks(2);
        self.panel.enable = true;
        self.ticks(2);
    }

    /// The operator says that the torch is where it is to begin or to go on.
    pub fn confirm(&mut self) {
        self.panel.confirm = true;
        self.ticks(1);
        self.panel.confirm = false;
        self.ticks(1);
    }

    /// A Ping that is fresh.
    pub fn ping(&mut self) -> Action {
        self.pings = self.pings.wrapping_add(1);
        let (count, echo) = (self.pings, self.pendant.telemetry().tick);
        self.say(HostMessage::Ping(Ping { count, echo, token: 0 }))
    }

    /// Another host goes on with a path of the bench's.
    pub fn attach(&mut self, nonce: u32, former: u32, path: u16, digest: u32) -> PendantMessage {
        let hello = Hello { version: wire::VERSION, schema: wire::SCHEMA, nonce };
        self.reply(HostMessage::Attach(Attach { hello, former, path, digest }))
    }

    /// A frame from the host, through framing and all.
    pub fn frame(&mut self, frame: &FromHost) -> Action {
        let mut out = [0; MAX_HOST_FRAME];
        let len = encode(frame, &mut out).expect("fits");
        self.bytes(&out[..len])
    }

    /// Bytes from the host; the action of the last frame in them.
    pub fn bytes(&mut self, bytes: &[u8]) -> Action {
        let mut last = Action::Idle;
        for &byte in bytes {
            if let Some(received) = self.deframer.push(byte) {
                last = self.pendant.receive(received);
            }
        }
        last
    }

    /// A payload with a right checksum.
    pub fn payload(&mut self, payload: &[u8]) -> Action {
        self.pendant.receive(Received::Payload(payload))
    }

    /// A message of the session.
    pub fn say(&mut self, message: HostMessage) -> Action {
        self.frame(&FromHost { session: self.session, message })
    }

    /// What the pendant answers; there has to be an answer.
    pub fn reply(&mut self, message: HostMessage) -> PendantMessage {
        match self.say(message) {
            Action::Send(FromPendant { message, .. }) => message,
            other => panic!("no answer but {other:?}"),
        }
    }

    /// A Hello with this version's numbers.
    pub fn hello(&mut self, nonce: u32) -> PendantMessage {
        self.reply(HostMessage::Hello(Hello { version: wire::VERSION, schema: wire::SCHEMA, nonce }))
    }

    /// The next command.
    pub fn command(&mut self, command: Command) -> Answer {
        self.request = self.request.wrapping_add(1);
        let action = match self.say(HostMessage::Control { request: self.request, command }) {
            Action::Perform { request, task } => {
                let answer = self.tasks.perform(&task, &mut self.workspace);
                self.pendant.answer(request, answer)
            }
            other => other,
        };
        match action {
            Action::Send(FromPendant { message: PendantMessage::Reply { request, answer }, .. })
                if request == self.request =>
            {
                answer
            }
            other => panic!("no reply but {other:?}"),
        }
    }

    /// A chunk of a path that is sent in chunks of 4.
    pub fn chunk(&mut self, path: u16, waypoints: &[WireWaypoint], number: usize) -> PendantMessage {
        let part = waypoints.chunks(4).nth(number).expect("the path has this chunk");
        let waypoints = heapless::Vec::from_slice(part).expect("4 at most");
        self.reply(HostMessage::Chunk(Chunk { path, first: 4 * number as u32, waypoints }))
    }

    /// Loads a stored path: Ready.
    pub fn load(&mut self, path: u16, waypoints: &[WireWaypoint]) {
        assert_eq!(self.command(Command::Begin(world::begin(path, waypoints, false))), Answer::Done);
        for number in 0..waypoints.len().div_ceil(4) {
            let answer = self.chunk(path, waypoints, number);
            assert!(matches!(answer, PendantMessage::Ack(_)), "{answer:?}");
        }
        let digest = wire::path_digest(waypoints).expect("short");
        assert_eq!(self.command(Command::Commit { path, digest }), Answer::Done);
        assert_eq!(self.pendant.state(), State::Ready);
        self.grip();
        self.confirm();
    }

    /// One tick; the power source strikes at once.
    pub fn tick(&mut self) -> Tick {
        let tick = self.pendant.tick(&self.panel);
        self.panel.established = tick.outputs.arc;
        tick
    }

    /// Ticks without a word from the host.
    pub fn ticks(&mut self, count: u32) {
        for _ in 0..count {
            let _ = self.tick();
        }
    }

    /// A tick after a ping, so that the session stays alive.
    pub fn lively_tick(&mut self) -> Tick {
        let _ = self.ping();
        self.tick()
    }

    /// So many of them.
    pub fn lively_ticks(&mut self, count: u32) {
        for _ in 0..count {
            let _ = self.lively_tick();
        }
    }

    /// Lively ticks until a state is reached; whether it was.
    pub fn until(&mut self, state: State, limit: u32) -> bool {
        for _ in 0..limit {
            if self.pendant.state() == state {
                return true;
            }
            let _ = self.lively_tick();
        }
        self.pendant.state() == state
    }
}
