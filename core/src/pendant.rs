//! The device end of the link: payloads and ticks in, actions out. No I/O, no clock but the tick, no allocation.
//!
//! The shell owns the line and the pins. It deframes bytes and gives each result to [`Pendant::receive`]; calls
//! [`Pendant::tick`] once per set-point period and performs what comes back; and asks [`Pendant::transmit`] for a
//! message when its transmit buffer has room. What a message may cause is decided by [`crate::interlock`]; waypoints
//! are placed exactly once by their index, commands are executed at most once by their number, and a session ends
//! with either side's start.

mod command;
mod drive;
mod jog;
mod place;
mod report;
mod ring;
mod robot;

use crate::interlock::{
    ArcTimes, ArcTimesMs, Event, Fault, Inputs, Interlock, Motion, Outputs, Refused, State,
};
use crate::wire::frame::{Damage, Received};
use crate::wire::{
    self, Answer, Attach, AttachRefusal, Chunk, ChunkRefusal, ChunkRefused, Counters, Firmware, FromHost,
    FromPendant, Hello, HelloAck, HelloRefusal, HelloRefused, HostMessage, JogLimits, Limits, PendantMessage,
    Ping, Sample, Telemetry, Unreadable, WireHandFrame, WireJog, WirePatch, WirePose, port,
};
pub use drive::{ALPHA_ONE, set_point};
use drive::{Drive, Machine};
use jog::Jogging;
use report::{Periods, Report};
use ring::{Dynamics, Placed, Ring};
pub use ring::{Slot, Slots};
use robot::Monitor;
pub use robot::PortConfig;

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
    /// Times of the arc sequence; a path brings its own of all but the longest interruption of an arc and the time for
    /// which current may flow on.
    pub arc: ArcTimesMs,
    /// Fastest turn of the torch, mrad/s.
    pub max_turn_mrad_s: u32,
    /// Change of the angular velocity at a waypoint, mrad/s.
    pub corner_mrad_s: u32,
    /// Angular acceleration between waypoints, mrad/s²: what `accel_um_s2` makes of it must not be more.
    pub turn_accel_mrad_s2: u32,
    /// Start and Resume: the torch has to be this near, µm ...
    pub near_um: u32,
    /// ... and turned by no more than this, mrad.
    pub near_mrad: u32,
    /// Of hand-guided motion.
    pub jog: JogLimits,
    /// The robot port, if the board has one.
    pub port: Option<PortConfig>,
    /// Whether the arc may be armed at all: a board that came up by its fall-back clock may not.
    pub can_weld: bool,
    /// What HelloAck says of the firmware.
    pub firmware: Firmware,
}

/// Fastest feed in manual mode unless the board says otherwise, µm/s.
const MANUAL_DEFAULT_UM_S: u32 = 25_000;

impl Default for Config {
    fn default() -> Self {
        Self {
            reach_um: 3_000_000,
            max_step_um: 100_000,
            min_half_turn_cos_q15: 28_377, // 60 degrees
            min_step_um: 50,
            max_feed_um_s: 250_000,
            manual_feed_um_s: MANUAL_DEFAULT_UM_S,
            accel_um_s2: 500_000,
            emergency_um_s2: 6_000_000,
            corner_um_s: 5_000,
            tick_us: 2_000,
            silence_ms: 200,
            telemetry_ms: 50,
            arc: ArcTimesMs::default(),
            max_turn_mrad_s: 3_142, // 180 degrees a second: the slowest wrist axis of common welding robots
            corner_mrad_s: 350,
            turn_accel_mrad_s2: 50_000,
            near_um: 2_000,
            near_mrad: 35, // 2 degrees
            jog: JOG_LIMITS,
            port: None,
            can_weld: true,
            firmware: Firmware::default(),
        }
    }
}

/// Hand-guided motion unless the board says otherwise: 1 mm a frame, 100 mm/s, 1 rad/s, in a box that reaches 1.5 m to
/// every side and from the base plane 2 m up; Leap Motion's confidence is below 0.2 for hands that it guesses.
pub const JOG_LIMITS: JogLimits = JogLimits {
    step_um: 1_000,
    speed_um_s: 100_000,
    turn_mrad_s: 1_000,
    least_um: [-1_500_000, -1_500_000, 0],
    most_um: [1_500_000, 1_500_000, 2_000_000],
    confidence_permille: 200,
};

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
            && self.bounds_turns()
            && u64::from(self.max_feed_um_s) * u64::from(self.tick_us)
                <= u64::from(self.min_step_um) * 16_000_000
    }

    /// A step is at least as long as its turn on a lever of [`ring::TURN_LEVER_UM`], so that what bounds motion along
    /// the path bounds the turn's acceleration, too.
    fn bounds_turns(&self) -> bool {
        let accel_mrad_s2 = u64::from(self.accel_um_s2) * 1000 / ring::TURN_LEVER_UM as u64;
        self.max_turn_mrad_s > 0
            && self.corner_mrad_s > 0
            && accel_mrad_s2 <= u64::from(self.turn_accel_mrad_s2)
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
            max_turn_mrad_s: self.max_turn_mrad_s,
            corner_um_s: self.corner_um_s,
            corner_mrad_s: self.corner_mrad_s,
            retrace_um_s: RETRACE_UM_S as u32,
            near_um: self.near_um,
            near_mrad: self.near_mrad,
            port: self.port.is_some(),
            jog: self.jog,
        }
    }

    fn dynamics(&self) -> Dynamics {
        Dynamics {
            accel_um_s2: self.accel_um_s2 as f32,
            corner_um_s: self.corner_um_s as f32,
            corner_rad_s: self.corner_mrad_s as f32 * 1e-3,
        }
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
    /// The key switch is in manual.
    pub manual: bool,
    /// The operator's button: the torch is where it has to begin or to go on.
    pub confirm: bool,
    /// What the board found broken.
    pub defect: Option<Fault>,
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
    /// Start gestures anew from here, within these limits: [`Answer::Done`].
    Jog(WireJog, JogLimits),
    /// Follow the hand: [`Answer::Pose`].
    HandFrame {
        /// What the sensor saw.
        hands: WireHandFrame,
        /// The pendant's clock.
        time_ms: u32,
        /// Whether it is the first since hands may move the camera: it only says where the hand is.
        anew: bool,
        /// Where the camera of a robot at the port is to go on from; without one it goes on from the last answer.
        from: Option<WirePose>,
    },
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
    /// Whether the robot's motion is enabled: in Running and while it comes to a controlled stop. A released switch and an
    /// E-stop end it at once.
    pub motion: bool,
    /// For the robot's line, if a port is fitted.
    pub robot: Option<port::WireSetPoint>,
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

/// Signs of life: the newest count, and the pendant's own tick that came back with it.
#[derive(Debug, Clone, Copy, Default)]
struct Life {
    count: u32,
    echo: u32,
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
    life: Life,
    silence_ticks: u32,
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
    /// The flange itself until a session has set one.
    tool: WirePose,
    has_tool: bool,
    torch_from_flange: WirePose,
    pose: WirePose,
    known: bool,
    confirm_pressed: bool,
    rewelds: bool,
    jogging: Jogging,
    robot: Option<Monitor>,
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
            life: Life::default(),
            silence_ticks: config.ticks(config.silence_ms),
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
            has_tool: false,
            torch_from_flange: WirePose::IDENTITY,
            pose: WirePose::IDENTITY,
            known: false,
            confirm_pressed: true,
            rewelds: false,
            jogging: Jogging::default(),
            robot: config.port.map(|port| Monitor::new(port, boot)),
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

    /// `flange_from_torch` as the session has set it.
    pub fn tool(&self) -> Option<&WirePose> {
        self.has_tool.then_some(&self.tool)
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
        self.report.tick();
        if self.panel != *panel {
            self.report.hurry();
        }
        self.panel = *panel;
        if !self.is_heard() {
            self.fire_own(Event::LinkSilent);
        }
        self.watch_robot();
        if self.state() == State::Running && self.drive.is_starved(&self.ring, &self.machine) {
            self.fire_own(Event::Underrun);
        }
        self.fire_own(Event::Tick);
        self.read_confirmation(panel.confirm);
        self.advance_jog();
        let outputs = self.interlock.outputs(&self.inputs());
        let feed = if panel.manual { self.limits.manual_feed_um_s } else { self.limits.max_feed_um_s };
        let set_point = self.started.then(|| self.follow(&outputs, feed as f32)).flatten();
        let motion = self.enables_motion(&outputs);
        let robot = self.command_robot(set_point.as_ref(), motion, outputs.arc);
        Tick { outputs, set_point, motion, robot }
    }

    fn enables_motion(&self, outputs: &Outputs) -> bool {
        let stops = outputs.motion == Motion::EmergencyStop;
        let jogs = self.jogged().is_some();
        jogs || (matches!(self.state(), State::Running | State::Holding) && !stops && self.panel.enable)
    }

    fn follow(&mut self, outputs: &Outputs, feed_limit_um_s: f32) -> Option<SetPoint> {
        self.drive.advance(&self.ring, outputs.motion, feed_limit_um_s, &self.machine);
        // A hold ends the way back; gas that still flows after the arc only delays it.
        if self.state() != State::Running && !self.drive.is_moving() {
            self.drive.retrace(0.0);
        }
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
            Received::Payload(payload) => match FromHost::decode(payload) {
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
        match frame.message {
            HostMessage::Hello(hello) => return self.hello(&hello),
            HostMessage::Attach(attach) => return self.attach(&attach),
            _ => {}
        }
        if self.session.is_none_or(|session| session.id != frame.session) {
            let message = PendantMessage::NoSession { boot: self.boot };
            return Action::Send(FromPendant { session: frame.session, message });
        }
        match frame.message {
            HostMessage::Hello(hello) => self.hello(&hello),
            HostMessage::Attach(attach) => self.attach(&attach),
            HostMessage::Control { request, command } => self.control(request, command),
            HostMessage::Chunk(chunk) => self.chunk(&chunk),
            HostMessage::Ping(ping) => self.ping(&ping),
            HostMessage::FaultSeen { number } => {
                self.report.fault_seen(number);
                Action::Idle
            }
        }
    }

    /// The only sign of life. It has to be ahead of all before it, and is as old as the pendant's own time that it brings
    /// back: one that was recorded, repeated or delayed keeps nobody's torch moving.
    fn ping(&mut self, ping: &Ping) -> Action {
        let age = self.ticks.wrapping_sub(ping.echo);
        let ahead = ping.count.wrapping_sub(self.life.count) as i32 > 0;
        let fresh = age <= self.silence_ticks && age <= self.ticks.wrapping_sub(self.life.echo);
        if ahead && fresh {
            self.life = Life { count: ping.count, echo: ping.echo };
        } else {
            self.counters.stale = self.counters.stale.wrapping_add(1);
        }
        self.send(PendantMessage::Pong { token: ping.token, tick: self.ticks })
    }

    /// A Hello that is repeated is answered again; another host's is refused while this one is alive. Neither counts
    /// as a sign of life, so that a storm of them cannot keep a dead host's torch moving.
    fn hello(&mut self, hello: &Hello) -> Action {
        if let Some(why) = self.refuse_hello(hello) {
            return self.send(PendantMessage::HelloRefused(HelloRefused { nonce: hello.nonce, why }));
        }
        if self.session.is_none_or(|session| session.nonce != hello.nonce) {
            self.open_session(hello.nonce);
            self.requests = Requests::default();
            self.used_path = None;
            self.finished = None;
            self.forget_tool();
            self.report.subscribe(0);
            self.fire_own(Event::NewSession);
        }
        self.acknowledge(hello.nonce)
    }

    fn open_session(&mut self, nonce: u32) {
        let id = wire::session_id(self.boot, nonce);
        self.session = Some(Session { id, nonce });
        if let Some(robot) = &mut self.robot {
            robot.open(id);
        }
        self.life = Life { count: 0, echo: self.ticks };
    }

    fn acknowledge(&self, nonce: u32) -> Action {
        self.send(PendantMessage::HelloAck(HelloAck {
            version: wire::VERSION,
            nonce,
            boot: self.boot,
            tick: self.ticks,
            request: self.requests.last,
            firmware: self.config.firmware,
            limits: self.limits,
        }))
    }

    /// A host goes on with the path of one that was lost, in a session of its own, so that nothing that the lost one may
    /// still have on the line counts. Its requests go on from the last number.
    fn attach(&mut self, attach: &Attach) -> Action {
        let nonce = attach.hello.nonce;
        if self.session.is_some_and(|session| session.nonce == nonce) {
            return self.acknowledge(nonce);
        }
        if let Some(why) = self.refuse_version(&attach.hello) {
            return self.send(PendantMessage::HelloRefused(HelloRefused { nonce, why }));
        }
        if let Err(why) = self.check_attach(attach) {
            return self.send(PendantMessage::AttachRefused { nonce, why });
        }
        self.open_session(nonce);
        self.requests.reply = None;
        self.changes = self.changes.wrapping_add(1);
        self.fire_own(Event::Attach);
        self.report.hurry();
        self.acknowledge(nonce)
    }

    fn check_attach(&self, attach: &Attach) -> Result<(), AttachRefusal> {
        if self.session.is_none_or(|session| session.nonce != attach.former) {
            return Err(AttachRefusal::Session);
        }
        if self.is_heard() || !self.stands() {
            return Err(AttachRefusal::Busy);
        }
        if self.state() != State::Held {
            return Err(AttachRefusal::State(self.state()));
        }
        let same =
            self.path() == Some(attach.path) && self.ring.is_sealed() && self.ring.digest() == attach.digest;
        if same { Ok(()) } else { Err(AttachRefusal::Path) }
    }

    fn refuse_version(&self, hello: &Hello) -> Option<HelloRefusal> {
        if hello.version != wire::VERSION {
            return Some(HelloRefusal::Version { host: hello.version, pendant: wire::VERSION });
        }
        if hello.schema != wire::SCHEMA {
            return Some(HelloRefusal::Schema { host: hello.schema, pendant: wire::SCHEMA });
        }
        None
    }

    fn refuse_hello(&self, hello: &Hello) -> Option<HelloRefusal> {
        let same = self.session.is_some_and(|session| session.nonce == hello.nonce);
        let alive = self.session.is_some() && self.is_heard();
        let busy = !same && (alive || !self.stands());
        self.refuse_version(hello).or(busy.then_some(HelloRefusal::Busy))
    }

    /// Whether the session's newest fresh ping is within the silence limit.
    fn is_heard(&self) -> bool {
        self.session.is_some() && self.ticks.wrapping_sub(self.life.echo) <= self.silence_ticks
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
            self.torch().is_some(),
            self.panel.confirm,
            self.enables_motion(&outputs),
            self.panel.defect.is_some(),
        ];
        Telemetry {
            tick: self.ticks,
            state: self.state(),
            changes: self.changes,
            cause: self.interlock.cause(),
            fault: self.interlock.fault(),
            arc: self.interlock.arc_phase(),
            pins: bits.into_iter().rev().fold(0, |pins, bit| pins << 1 | u16::from(bit)),
            finished: self.finished,
            load: self.loaded.then(|| self.ring.ack()),
            segment: self.drive.segment(),
            alpha_q24: self.drive.alpha_q24(&self.ring),
            speed_um_s: self.drive.speed_um_s() as u32,
            pose: self.pose,
            counters: self.counters,
            robot: self.robot.as_ref().and_then(Monitor::report),
            tool: self.tool().copied(),
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
            manual: self.panel.manual,
            too_fast: on_path && self.panel.manual && self.is_too_fast(),
            rewelds: self.rewelds,
            defect: self.panel.defect,
        }
    }

    /// Whether the segment under the torch is to be welded faster than manual mode allows.
    fn is_too_fast(&self) -> bool {
        let here = self.ring.get(self.drive.segment()).map(|slot| slot.waypoint);
        here.is_some_and(|waypoint| waypoint.weld && waypoint.feed_um_s > self.limits.manual_feed_um_s)
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
            self.drop_path(inputs.path_end && !before.is_cut_short() && self.state() != State::Fault);
        }
        verdict
    }

    fn drop_path(&mut self, finished: bool) {
        if finished {
            self.finished = Some(self.ring.begin().path);
        }
        self.loaded = false;
        self.started = false;
        self.rewelds = false;
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
    pub fn answer(&mut self, request: u16, mut answer: Answer) -> Action {
        if request != self.requests.last || self.requests.reply.is_some() {
            return Action::Idle;
        }
        if let Answer::Pose(camera) = &mut answer {
            self.jog_to(&camera.pose);
            camera.actual = self.robot_torch();
        }
        self.reply(answer)
    }
}
