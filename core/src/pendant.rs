//! The device end of the link: payloads and ticks in, actions out. No I/O, no clock but the tick, no allocation.
//!
//! The shell owns the line and the pins. It deframes bytes and gives each result to [`Pendant::receive`]; calls
//! [`Pendant::tick`] once per set-point period and performs what comes back; and asks [`Pendant::transmit`] for a
//! message when its transmit buffer has room. What a message may cause is decided by [`crate::interlock`]; waypoints
//! are placed exactly once by their index, commands are executed at most once by their number, and a session ends
//! with either side's start.

mod command;
mod drive;
mod report;
mod ring;

use crate::interlock::{ArcTimes, ArcTimesMs, Event, Fault, Inputs, Interlock, Outputs, Refused, State};
use crate::wire::frame::{self, Damage, Received};
use crate::wire::{
    self, Answer, Chunk, ChunkRefusal, ChunkRefused, Counters, FromHost, FromPendant, Hello, HelloAck,
    HelloRefusal, HelloRefused, HostMessage, Limits, PendantMessage, Sample, Telemetry, Unreadable,
    WireHandFrame, WireJog, WirePatch, WirePose,
};
pub use drive::{ALPHA_ONE, set_point};
use drive::{Drive, Machine};
use report::{Periods, Report};
use ring::{Dynamics, Placed, Ring};
pub use ring::{Slot, Slots};

/// Speed of the way back before a Resume, µm/s: slow enough for corners without a plan.
const RETRACE_UM_S: f32 = 5_000.0;

/// What the machine allows; [`Pendant::new`] checks it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Config {
    /// Farthest waypoint from the base, µm.
    pub reach_um: u32,
    /// Longest step, µm.
    pub max_step_um: u32,
    /// Cosine of half the largest turn of a step, Q15.
    pub min_half_turn_cos_q15: i16,
    /// Shortest step, µm, a turn of 1 rad counting as 10 mm.
    pub min_step_um: u32,
    /// Fastest feed, µm/s.
    pub max_feed_um_s: u32,
    /// Fastest feed in manual mode, µm/s: at most 250 mm/s.
    pub manual_feed_um_s: u32,
    /// Acceleration along the path, µm/s².
    pub accel_um_s2: u32,
    /// Deceleration of an emergency stop, µm/s².
    pub emergency_um_s2: u32,
    /// Change of the velocity vector at a waypoint, µm/s.
    pub corner_um_s: u32,
    /// Set-point period, µs.
    pub tick_us: u32,
    /// Silence after which motion is held, ms.
    pub silence_ms: u16,
    /// Period of telemetry, ms.
    pub telemetry_ms: u16,
    /// Times of the arc sequence.
    pub arc: ArcTimesMs,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            reach_um: 3_000_000,
            max_step_um: 100_000,
            min_half_turn_cos_q15: 28_377, // 60 degrees
            min_step_um: 50,
            max_feed_um_s: 250_000,
            manual_feed_um_s: MANUAL_UM_S,
            accel_um_s2: 500_000,
            emergency_um_s2: 5_000_000,
            corner_um_s: 5_000,
            tick_us: 2_000,
            silence_ms: 200,
            telemetry_ms: 50,
            arc: ArcTimesMs::default(),
        }
    }
}

/// Bound of the speed in manual mode, whatever the configuration says, µm/s.
pub const MANUAL_UM_S: u32 = 250_000;

impl Config {
    fn is_sound(&self) -> bool {
        let nonzero =
            [self.reach_um, self.max_step_um, self.min_step_um, self.max_feed_um_s, self.accel_um_s2];
        nonzero.into_iter().all(|x| x > 0)
            && self.manual_feed_um_s > 0
            && self.manual_feed_um_s <= MANUAL_UM_S
            && self.emergency_um_s2 >= self.accel_um_s2
            && (100..=100_000).contains(&self.tick_us)
            && self.silence_ms > 0
            && self.telemetry_ms > 0
            && u64::from(self.max_feed_um_s) * u64::from(self.tick_us)
                <= u64::from(self.min_step_um) * 16_000_000
    }

    /// What a pendant with so many waypoints in its ring tells its host.
    pub fn limits(&self, ring: u32) -> Limits {
        Limits {
            ring,
            reach_um: self.reach_um,
            max_step_um: self.max_step_um,
            min_half_turn_cos_q15: self.min_half_turn_cos_q15,
            min_step_um: self.min_step_um,
            max_feed_um_s: self.max_feed_um_s,
            manual_feed_um_s: self.manual_feed_um_s,
            accel_um_s2: self.accel_um_s2,
            tick_us: self.tick_us,
            silence_ms: self.silence_ms,
        }
    }

    fn dynamics(&self) -> Dynamics {
        Dynamics { accel_um_s2: self.accel_um_s2 as f32, corner_um_s: self.corner_um_s as f32 }
    }

    fn machine(&self) -> Machine {
        Machine {
            tick_s: self.tick_us as f32 * 1e-6,
            accel_um_s2: self.accel_um_s2 as f32,
            emergency_um_s2: self.emergency_um_s2 as f32,
            retrace_um_s: RETRACE_UM_S,
        }
    }

    /// Ticks in `ms`, rounded up.
    fn ticks(&self, ms: u16) -> u32 {
        (u32::from(ms) * 1000).div_ceil(self.tick_us.max(1))
    }
}

/// The pins, read once per tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Panel {
    /// E-stop pressed or its line broken.
    pub e_stop: bool,
    /// Enabling switch in its middle position.
    pub enable: bool,
    /// Reset button.
    pub local_reset: bool,
    /// The power source reports current.
    pub established: bool,
    /// Manual mode: 250 mm/s at most.
    pub manual: bool,
}

/// What a received frame asks of the shell.
#[derive(Debug, Clone, PartialEq, Eq)]
#[must_use = "the shell has to perform it"]
#[allow(clippy::large_enum_variant, reason = "no allocator to box with; one action is alive at a time")]
pub enum Action {
    /// Nothing.
    Idle,
    /// Send this.
    Send(FromPendant),
    /// Compute this and give the result to [`Pendant::answer`].
    Perform {
        /// Number to answer.
        request: u16,
        /// What to compute.
        task: Task,
    },
}

/// A computation that the pendant leaves to the shell, so that it does not depend on gestures and seams.
#[derive(Debug, Clone, PartialEq, Eq)]
#[allow(clippy::large_enum_variant, reason = "no allocator to box with; one task is alive at a time")]
pub enum Task {
    /// Start gestures anew from here: [`Answer::Done`].
    Jog(WireJog),
    /// Follow the hand: [`Answer::Pose`].
    HandFrame(WireHandFrame),
    /// Score the patch's first point: [`Answer::EdgeScore`].
    Score(WirePatch),
}

/// What a tick asks of the shell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use = "the shell has to perform it"]
pub struct Tick {
    /// Pins.
    pub outputs: Outputs,
    /// Where the torch has to be; none without a path that was started.
    pub set_point: Option<SetPoint>,
}

/// Where the torch has to be at the end of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SetPoint {
    /// Segment of the path.
    pub segment: u32,
    /// How far along it, [`ALPHA_ONE`] = its end.
    pub alpha_q24: u32,
    /// `base_from_torch`.
    pub pose: WirePose,
}

#[derive(Debug, Clone, Copy)]
struct Session {
    id: u32,
    nonce: u32,
}

/// Numbers and reply of the control messages of a session.
#[derive(Debug, Clone, Copy, Default)]
struct Requests {
    last: u16,
    reply: Option<Answer>,
}

/// The device end. `RING`: waypoints it can hold, in `S`.
#[derive(Debug, Clone)]
pub struct Pendant<const RING: usize, S = [Slot; RING]> {
    config: Config,
    limits: Limits,
    machine: Machine,
    boot: u32,
    session: Option<Session>,
    silent_ticks: u32,
    requests: Requests,
    used_path: Option<u16>,
    interlock: Interlock,
    changes: u16,
    panel: Panel,
    ring: Ring<RING, S>,
    loaded: bool,
    drive: Drive,
    started: bool,
    finished: Option<u16>,
    tool: WirePose,
    pose: WirePose,
    report: Report,
    counters: Counters,
    ticks: u32,
}

impl<const RING: usize> Pendant<RING> {
    /// After power-on. `boot` has to differ from start to start. `None` if the configuration contradicts itself.
    pub fn new(config: &Config, boot: u32) -> Option<Self> {
        Self::with_slots(config, boot, [Slot::EMPTY; RING])
    }
}

impl<const RING: usize, S: Slots> Pendant<RING, S> {
    /// As [`Self::new`], with the waypoints kept in `slots`, of which there have to be `RING`.
    pub fn with_slots(config: &Config, boot: u32, slots: S) -> Option<Self> {
        let arc = ArcTimes::new(&config.arc, config.tick_us).filter(|_| config.is_sound())?;
        let telemetry = u16::try_from(config.ticks(config.telemetry_ms)).ok()?;
        let periods = Periods { telemetry, fault: telemetry.saturating_mul(2) };
        (slots.borrow().len() == RING).then(|| Self {
            config: *config,
            limits: config.limits(Ring::<RING, S>::CAPACITY),
            machine: config.machine(),
            boot,
            session: None,
            silent_ticks: 0,
            requests: Requests::default(),
            used_path: None,
            interlock: Interlock::new(arc),
            changes: 0,
            panel: Panel::default(),
            ring: Ring::new(slots),
            loaded: false,
            drive: Drive::new(),
            started: false,
            finished: None,
            tool: WirePose::IDENTITY,
            pose: WirePose::IDENTITY,
            report: Report::new(periods),
            counters: Counters::default(),
            ticks: 0,
        })
    }

    /// State of the interlock.
    pub fn state(&self) -> State {
        self.interlock.state()
    }

    /// Id of the path that is loaded or being loaded.
    pub fn path(&self) -> Option<u16> {
        self.loaded.then(|| self.ring.begin().path)
    }

    /// `flange_from_torch` as the host set it.
    pub fn tool(&self) -> &WirePose {
        &self.tool
    }

    /// Speed along the path, µm/s.
    pub fn speed_um_s(&self) -> f32 {
        self.drive.speed_um_s()
    }

    /// The board lost this many received bytes.
    pub fn overrun(&mut self, bytes: u16) {
        self.counters.overrun = self.counters.overrun.wrapping_add(bytes);
    }

    /// One set-point period: reads the pins, moves the torch, says what the pins have to be.
    pub fn tick(&mut self, panel: &Panel) -> Tick {
        self.ticks = self.ticks.wrapping_add(1);
        self.silent_ticks = self.silent_ticks.saturating_add(1);
        self.report.tick();
        if self.panel != *panel {
            self.report.hurry();
        }
        self.panel = *panel;
        if !self.is_heard() {
            self.fire_own(Event::LinkSilent);
        }
        if self.state() == State::Running && self.drive.is_starved(&self.ring, &self.machine) {
            self.fire_own(Event::Underrun);
        }
        self.fire_own(Event::Tick);
        let outputs = self.interlock.outputs(&self.inputs());
        let feed = if panel.manual { self.limits.manual_feed_um_s } else { self.limits.max_feed_um_s };
        let set_point = self.started.then(|| self.follow(&outputs, feed as f32)).flatten();
        Tick { outputs, set_point }
    }

    fn follow(&mut self, outputs: &Outputs, feed_limit_um_s: f32) -> Option<SetPoint> {
        self.drive.advance(&self.ring, outputs.motion, feed_limit_um_s, &self.machine);
        self.ring.release(self.drive.segment());
        let segment = self.drive.segment();
        let alpha_q24 = self.drive.alpha_q24(&self.ring);
        let pose = self.drive.pose(&self.ring, alpha_q24)?;
        self.pose = pose;
        let sample = Sample { tick: self.ticks, segment, alpha_q24, pose, arc: outputs.arc };
        self.report.executed(|| sample);
        Some(SetPoint { segment, alpha_q24, pose })
    }

    /// Takes what a delimiter completed.
    pub fn receive(&mut self, received: Received<'_>) -> Action {
        match received {
            Received::Damaged(damage) => self.count(damage),
            Received::Payload(payload) => match frame::decode::<FromHost>(payload) {
                Ok(frame) => self.handle(frame),
                Err(why) => {
                    self.counters.unread = self.counters.unread.wrapping_add(1);
                    self.send(PendantMessage::Unread(why))
                }
            },
        }
    }

    fn count(&mut self, damage: Damage) -> Action {
        let counter = match damage {
            Damage::Framing => &mut self.counters.framing,
            Damage::Crc => &mut self.counters.crc,
            Damage::Oversize => &mut self.counters.oversize,
        };
        *counter = counter.wrapping_add(1);
        match damage {
            Damage::Oversize => self.send(PendantMessage::Unread(Unreadable::Oversize)),
            Damage::Framing | Damage::Crc => Action::Idle,
        }
    }

    /// Not inlined: the copies it makes of a message would add to the stack that decoding needs.
    #[inline(never)]
    fn handle(&mut self, frame: FromHost) -> Action {
        if let HostMessage::Hello(hello) = frame.message {
            return self.hello(&hello);
        }
        if self.session.is_none_or(|session| session.id != frame.session) {
            let message = PendantMessage::NoSession { boot: self.boot };
            return Action::Send(FromPendant { session: frame.session, message });
        }
        self.silent_ticks = 0;
        match frame.message {
            HostMessage::Hello(hello) => self.hello(&hello),
            HostMessage::Control { request, command } => self.control(request, command),
            HostMessage::Chunk(chunk) => self.chunk(&chunk),
            HostMessage::Ping { token } => self.send(PendantMessage::Pong { token }),
            HostMessage::FaultSeen { number } => {
                self.report.fault_seen(number);
                Action::Idle
            }
        }
    }

    /// A Hello that is repeated is answered again; another host's is refused while this one is alive. Neither counts
    /// as a sign of life, so that a storm of them cannot keep a dead host's torch moving.
    fn hello(&mut self, hello: &Hello) -> Action {
        if let Some(why) = self.refuse_hello(hello) {
            return self.send(PendantMessage::HelloRefused(HelloRefused { nonce: hello.nonce, why }));
        }
        if self.session.is_none_or(|session| session.nonce != hello.nonce) {
            let id = wire::session_id(self.boot, hello.nonce);
            self.session = Some(Session { id, nonce: hello.nonce });
            self.requests = Requests::default();
            self.used_path = None;
            self.finished = None;
            self.report.subscribe(0);
            self.silent_ticks = 0;
            self.fire_own(Event::NewSession);
        }
        let (version, boot, limits) = (wire::VERSION, self.boot, self.limits);
        self.send(PendantMessage::HelloAck(HelloAck { version, nonce: hello.nonce, boot, limits }))
    }

    fn refuse_hello(&self, hello: &Hello) -> Option<HelloRefusal> {
        if hello.version != wire::VERSION {
            return Some(HelloRefusal::Version { host: hello.version, pendant: wire::VERSION });
        }
        if hello.schema != wire::SCHEMA {
            return Some(HelloRefusal::Schema { host: hello.schema, pendant: wire::SCHEMA });
        }
        let same = self.session.is_some_and(|session| session.nonce == hello.nonce);
        let alive = self.session.is_some() && self.is_heard();
        (!same && (alive || !self.stands())).then_some(HelloRefusal::Busy)
    }

    /// Whether the session's host was heard within the silence limit.
    fn is_heard(&self) -> bool {
        self.session.is_some() && self.silent_ticks <= self.config.ticks(self.config.silence_ms)
    }

    /// Whether nothing moves nor is about to.
    fn stands(&self) -> bool {
        !self.drive.is_moving() && !matches!(self.state(), State::Running | State::Holding)
    }

    fn chunk(&mut self, chunk: &Chunk) -> Action {
        if !self.loaded || chunk.path != self.ring.begin().path {
            return self.refuse_chunk(chunk, 0, ChunkRefusal::Path);
        }
        let known = self.ring.next();
        match self.ring.place(chunk, &self.limits) {
            Ok(Placed::New) => self.ring.replan(known, self.drive.segment(), &self.config.dynamics()),
            Ok(Placed::Duplicate) => self.counters.duplicate = self.counters.duplicate.wrapping_add(1),
            Err((at, why)) => return self.refuse_chunk(chunk, at, why),
        }
        self.send(PendantMessage::Ack(self.ring.ack()))
    }

    fn refuse_chunk(&mut self, chunk: &Chunk, at: u8, why: ChunkRefusal) -> Action {
        if !matches!(why, ChunkRefusal::Path | ChunkRefusal::Index | ChunkRefusal::Credit { .. }) {
            self.fire_own(Event::BadWaypoint);
        }
        let (path, first) = (chunk.path, chunk.first);
        self.send(PendantMessage::ChunkRefused(ChunkRefused { path, first, at, why }))
    }

    /// The next message of the pendant's own accord, if one is due: to be asked for when the line has room.
    pub fn transmit(&mut self) -> Option<FromPendant> {
        let message = if let Some(fault) = self.report.due_fault() {
            fault
        } else if self.report.due_telemetry() {
            PendantMessage::Telemetry(self.telemetry())
        } else {
            self.report.due_samples(!self.started)?
        };
        Some(self.frame(message))
    }

    /// The state as the host sees it.
    pub fn telemetry(&self) -> Telemetry {
        let outputs = self.interlock.outputs(&self.inputs());
        let bits = [
            self.panel.e_stop,
            self.panel.enable,
            self.interlock.is_enabled(),
            self.interlock.is_armed(),
            self.panel.established,
            self.panel.manual,
            outputs.arc,
            outputs.gas,
        ];
        Telemetry {
            tick: self.ticks,
            state: self.state(),
            changes: self.changes,
            cause: self.interlock.cause(),
            fault: self.interlock.fault(),
            arc: self.interlock.arc_phase(),
            pins: bits.into_iter().rev().fold(0, |pins, bit| pins << 1 | u8::from(bit)),
            finished: self.finished,
            load: self.loaded.then(|| self.ring.ack()),
            segment: self.drive.segment(),
            alpha_q24: self.drive.alpha_q24(&self.ring),
            speed_um_s: self.drive.speed_um_s() as u32,
            pose: self.pose,
            counters: self.counters,
        }
    }

    fn frame(&self, message: PendantMessage) -> FromPendant {
        FromPendant { session: self.session.map_or(0, |session| session.id), message }
    }

    fn send(&self, message: PendantMessage) -> Action {
        Action::Send(self.frame(message))
    }

    /// Levels for the interlock.
    fn inputs(&self) -> Inputs {
        let on_path = self.started;
        Inputs {
            e_stop: self.panel.e_stop,
            enable: self.panel.enable,
            local_reset: self.panel.local_reset,
            established: self.panel.established,
            moving: self.drive.is_moving(),
            weld: on_path && self.drive.wants_weld(&self.ring),
            run_end: on_path && self.drive.is_at_run_end(&self.ring),
            path_end: on_path && self.ring.is_sealed() && self.drive.is_at_path_end(&self.ring),
            prefilled: self.loaded && self.ring.is_prefilled(),
        }
    }

    /// An event that nobody waits to see accepted.
    fn fire_own(&mut self, event: Event) {
        // The pendant's own events are never refused.
        let _ = self.fire(event);
    }

    fn fire(&mut self, event: Event) -> Result<(), Refused> {
        let (before, inputs) = (self.interlock, self.inputs());
        let (next, _, verdict) = before.step(event, &inputs);
        self.interlock = next;
        if next.state() != before.state() {
            self.changes = self.changes.wrapping_add(1);
        }
        if next.state() != before.state() || next.is_armed() != before.is_armed() {
            self.report.hurry();
        }
        self.note_fault(before.state(), before.fault());
        if !self.keeps_path() {
            self.drop_path(inputs.path_end && self.state() != State::Fault);
        }
        verdict
    }

    fn drop_path(&mut self, finished: bool) {
        if finished {
            self.finished = Some(self.ring.begin().path);
        }
        self.loaded = false;
        self.started = false;
        self.drive = Drive::new();
    }

    fn note_fault(&mut self, state: State, fault: Option<Fault>) {
        let same = state == State::Fault && fault == self.interlock.fault();
        if let Some(fault) = self.interlock.fault().filter(|_| self.state() == State::Fault && !same) {
            self.report.fault(fault);
        }
    }

    fn keeps_path(&self) -> bool {
        match self.state() {
            State::Disabled | State::Idle => false,
            State::Loading | State::Ready | State::Running | State::Holding | State::Held => true,
            State::Fault => self.drive.is_moving(),
        }
    }

    /// Gives the result of a [`Task`]; it is cached for repetitions of the request.
    pub fn answer(&mut self, request: u16, answer: Answer) -> Action {
        if request != self.requests.last || self.requests.reply.is_some() {
            return Action::Idle;
        }
        self.reply(answer)
    }
}
