//! The session: whose it is, whether its host is heard, and who may begin another.

use super::{Action, Pendant, Slots};
use crate::interlock::{Event, State};
use crate::wire::{
    self, Answer, Attach, AttachRefusal, FromPendant, Hello, HelloAck, HelloRefusal, HelloRefused,
    PendantMessage, Ping,
};

/// Its last two are the newest sign of life: its count, and the pendant's own tick that came back with it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Session {
    id: u32,
    nonce: u32,
    pub(super) count: u32,
    echo: u32,
}

/// Numbers and reply of the control messages of a session.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Requests {
    pub(super) last: u16,
    pub(super) reply: Option<Answer>,
}

/// The other end of the link.
#[derive(Debug, Clone)]
pub(super) struct Host {
    pub(super) boot: u32,
    silence_ticks: u32,
    pub(super) session: Option<Session>,
    pub(super) requests: Requests,
}

impl Host {
    pub(super) fn new(boot: u32, silence_ticks: u32) -> Self {
        Self { boot, silence_ticks, session: None, requests: Requests::default() }
    }

    /// Whether the session is the one with this id.
    pub(super) fn has(&self, id: u32) -> bool {
        self.session.is_some_and(|session| session.id == id)
    }

    /// Whether the session was begun with this nonce.
    fn began_with(&self, nonce: u32) -> bool {
        self.session.is_some_and(|session| session.nonce == nonce)
    }

    /// The only sign of life. It has to be ahead of all before it, and is as old as the pendant's own time that it brings
    /// back: one that was recorded, repeated or delayed keeps nobody's torch moving.
    pub(super) fn hear(&mut self, ping: &Ping, tick: u32) -> bool {
        let Some(session) = &mut self.session else { return false };
        let age = tick.wrapping_sub(ping.echo);
        let ahead = ping.count.wrapping_sub(session.count) as i32 > 0;
        let fresh = ahead && age <= self.silence_ticks && age <= tick.wrapping_sub(session.echo);
        if fresh {
            (session.count, session.echo) = (ping.count, ping.echo);
        }
        fresh
    }

    /// Whether the session's newest fresh ping is within the silence limit.
    pub(super) fn is_heard(&self, tick: u32) -> bool {
        self.session.is_some_and(|session| tick.wrapping_sub(session.echo) <= self.silence_ticks)
    }

    pub(super) fn frame(&self, message: PendantMessage) -> FromPendant {
        FromPendant { session: self.session.map_or(0, |session| session.id), message }
    }
}

impl<const RING: usize, S: Slots> Pendant<RING, S> {
    pub(super) fn ping(&mut self, ping: &Ping) -> Action {
        if !self.host.hear(ping, self.ticks) {
            self.report.counters.stale = self.report.counters.stale.wrapping_add(1);
        }
        self.send(PendantMessage::Pong { token: ping.token, tick: self.ticks })
    }

    /// A Hello that is repeated is answered again; another host's is refused while this one is alive. Neither counts
    /// as a sign of life, so that a storm of them cannot keep a dead host's torch moving.
    pub(super) fn hello(&mut self, hello: &Hello) -> Action {
        let nonce = hello.nonce;
        let again = self.host.began_with(nonce);
        let busy = !again && (self.host.is_heard(self.ticks) || !self.stands());
        if let Some(why) = refuse_version(hello).or(busy.then_some(HelloRefusal::Busy)) {
            return self.send(PendantMessage::HelloRefused(HelloRefused { nonce, why }));
        }
        if !again {
            self.open_session(nonce);
            self.host.requests = Requests::default();
            self.path.forget();
            self.robot.carry(None);
            self.report.subscribe(0);
            self.report.hurry();
            self.fire_own(Event::NewSession);
        }
        self.acknowledge(nonce)
    }

    /// It is heard at its start.
    fn open_session(&mut self, nonce: u32) {
        let id = wire::session_id(self.host.boot, nonce);
        self.host.session = Some(Session { id, nonce, count: 0, echo: self.ticks });
        if let Some(port) = &mut self.robot.port {
            port.open(id);
        }
    }

    fn acknowledge(&self, nonce: u32) -> Action {
        self.send(PendantMessage::HelloAck(HelloAck {
            version: wire::VERSION,
            nonce,
            boot: self.host.boot,
            tick: self.ticks,
            request: self.host.requests.last,
            firmware: self.config.firmware,
            limits: self.limits,
        }))
    }

    /// A host goes on with the path of one that was lost, in a session of its own, so that nothing that the lost one may
    /// still have on the line counts. Its requests go on from the last number.
    pub(super) fn attach(&mut self, attach: &Attach) -> Action {
        let nonce = attach.hello.nonce;
        if self.host.began_with(nonce) {
            return self.acknowledge(nonce);
        }
        if let Some(why) = refuse_version(&attach.hello) {
            return self.send(PendantMessage::HelloRefused(HelloRefused { nonce, why }));
        }
        if let Err(why) = self.check_attach(attach) {
            return self.send(PendantMessage::AttachRefused { nonce, why });
        }
        self.open_session(nonce);
        self.host.requests.reply = None;
        self.report.changed();
        self.fire_own(Event::Attach);
        self.acknowledge(nonce)
    }

    fn check_attach(&self, attach: &Attach) -> Result<(), AttachRefusal> {
        if !self.host.began_with(attach.former) {
            return Err(AttachRefusal::Session);
        }
        if self.host.is_heard(self.ticks) || !self.stands() {
            return Err(AttachRefusal::Busy);
        }
        if self.state() != State::Held {
            return Err(AttachRefusal::State(self.state()));
        }
        let ring = &self.path.ring;
        let same = self.path() == Some(attach.path) && ring.is_sealed() && ring.digest() == attach.digest;
        if same { Ok(()) } else { Err(AttachRefusal::Path) }
    }
}

fn refuse_version(hello: &Hello) -> Option<HelloRefusal> {
    if hello.version != wire::VERSION {
        return Some(HelloRefusal::Version { host: hello.version, pendant: wire::VERSION });
    }
    if hello.schema != wire::SCHEMA {
        return Some(HelloRefusal::Schema { host: hello.schema, pendant: wire::SCHEMA });
    }
    None
}
