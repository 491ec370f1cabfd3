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
mod path;
mod place;
mod report;
mod ring;
mod robot;
mod session;

use crate::interlock::{
    ArcTimes, ArcTimesMs, Event, Fault, Inputs, Interlock, Motion, Outputs, Refused, State,
};
use crate::wire::frame::{Damage, Received};
use crate::wire::{
    Answer, Chunk, ChunkRefusal, ChunkRefused, Firmware, FromHost, FromPendant, HostMessage, JogLimits,
    Limits, PendantMessage, Sample, Telemetry, Unreadable, WireHandFrame, WireJog, WirePatch, WirePose, port,
};
use drive::Machine;
pub use drive::{ALPHA_ONE, set_point};
use path::Path;
use report::{Periods, Report};
use ring::{Dynamics, Placed, Ring};
pub use ring::{Slot, Slots};
pub use robot::PortConfig;
use robot::{Monitor, Robot};
use session::Host;

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

/// The device end. `RING`: waypoints it can hold, in `S`.
#[derive(Debug, Clone)]
pub struct Pendant<const RING: usize, S = [Slot; RING]> {
    config: Config,
    limits: Limits,
    machine: Machine,
    host: Host,
    interlock: Interlock,
    panel: Panel,
    path: Path<RING, S>,
    robot: Robot,
    report: Report,
    /// The clock of all of them.
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
            host: Host::new(boot, config.ticks(config.silence_ms)),
            interlock: Interlock::new(arc),
            panel: Panel::default(),
            path: Path::new(slots),
            robot: Robot::new(config.port.map(|port| Monitor::new(port, boot))),
            report: Report::new(periods),
            ticks: 0,
        })
    }

    /// State of the interlock.
    pub fn state(&self) -> State {
        self.interlock.state()
    }

    /// Id of the path that is loaded or being loaded.
    pub fn path(&self) -> Option<u16> {
        self.path.begin().map(|begin| begin.path)
    }

    /// `flange_from_torch` as the session has set it.
    pub fn tool(&self) -> Option<&WirePose> {
        self.robot.tool.as_ref().map(|tool| &tool.flange_from_torch)
    }

    /// Speed along the path, µm/s.
    pub fn speed_um_s(&self) -> f32 {
        self.path.drive.speed_um_s
    }

    /// The board lost this many received bytes.
    pub fn overrun(&mut self, bytes: u16) {
        self.report.counters.overrun = self.report.counters.overrun.wrapping_add(bytes);
    }

    /// One set-point period: reads the pins, moves the torch, says what the pins have to be.
    pub fn tick(&mut self, panel: &Panel) -> Tick {
        self.ticks = self.ticks.wrapping_add(1);
        self.report.tick();
        if self.panel != *panel {
            self.report.hurry();
        }
        self.panel = *panel;
        if !self.host.is_heard(self.ticks) {
            self.fire_own(Event::LinkSilent);
        }
        self.watch_robot();
        if self.state() == State::Running && self.path.is_starved(&self.machine) {
            self.fire_own(Event::Underrun);
        }
        self.fire_own(Event::Tick);
        self.read_confirmation(panel.confirm);
        self.advance_jog();
        let outputs = self.interlock.outputs(&self.inputs());
        let feed = if panel.manual { self.limits.manual_feed_um_s } else { self.limits.max_feed_um_s };
        let set_point = self.path.drive.started.then(|| self.follow(&outputs, feed as f32)).flatten();
        let motion = self.enables_motion(&outputs);
        let torch = set_point.as_ref().map(|at| &at.pose);
        let robot = self.robot.command(torch, self.ticks, motion, outputs.arc);
        Tick { outputs, set_point, motion, robot }
    }

    fn enables_motion(&self, outputs: &Outputs) -> bool {
        let stops = outputs.motion == Motion::EmergencyStop;
        let jogs = self.robot.jogging.commanded.is_some();
        jogs || (self.follows() && !stops && self.panel.enable)
    }

    fn follow(&mut self, outputs: &Outputs, feed_limit_um_s: f32) -> Option<SetPoint> {
        let runs = self.state() == State::Running;
        let at = self.path.follow(runs, outputs.motion, feed_limit_um_s, &self.machine)?;
        let SetPoint { segment, alpha_q24, pose } = at;
        self.robot.place.commanded = pose;
        let sample = Sample { tick: self.ticks, segment, alpha_q24, pose, arc: outputs.arc };
        self.report.executed(|| sample);
        Some(at)
    }

    /// Takes what a delimiter completed.
    pub fn receive(&mut self, received: Received<'_>) -> Action {
        match received {
            Received::Damaged(damage) => self.count(damage),
            Received::Payload(payload) => match FromHost::decode(payload) {
                Ok(frame) => self.handle(frame),
                Err(why) => {
                    self.report.counters.unread = self.report.counters.unread.wrapping_add(1);
                    self.send(PendantMessage::Unread(why))
                }
            },
        }
    }

    fn count(&mut self, damage: Damage) -> Action {
        let counter = match damage {
            Damage::Framing => &mut self.report.counters.framing,
            Damage::Crc => &mut self.report.counters.crc,
            Damage::Oversize => &mut self.report.counters.oversize,
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
        let known = self.host.has(frame.session);
        match frame.message {
            HostMessage::Hello(hello) => self.hello(&hello),
            HostMessage::Attach(attach) => self.attach(&attach),
            _ if !known => {
                let message = PendantMessage::NoSession { boot: self.host.boot };
                Action::Send(FromPendant { session: frame.session, message })
            }
            HostMessage::Control { request, command } => self.control(request, command),
            HostMessage::Chunk(chunk) => self.chunk(&chunk),
            HostMessage::Ping(ping) => self.ping(&ping),
            HostMessage::FaultSeen { number } => {
                self.report.fault_seen(number);
                Action::Idle
            }
        }
    }

    /// Whether the torch goes along the path, or comes to a stop on it.
    fn follows(&self) -> bool {
        matches!(self.state(), State::Running | State::Holding)
    }

    /// Whether nothing moves nor is about to.
    fn stands(&self) -> bool {
        !self.path.drive.is_moving() && !self.follows()
    }

    fn chunk(&mut self, chunk: &Chunk) -> Action {
        match self.path.place(chunk, &self.limits, &self.config.dynamics()) {
            Ok(Placed::New) => {}
            Ok(Placed::Duplicate) => {
                self.report.counters.duplicate = self.report.counters.duplicate.wrapping_add(1);
            }
            Err((at, why)) => return self.refuse_chunk(chunk, at, why),
        }
        self.send(PendantMessage::Ack(self.path.ring.ack()))
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
            self.report.due_samples(!self.path.drive.started)?
        };
        Some(self.host.frame(message))
    }

    /// The state as the host sees it.
    pub fn telemetry(&self) -> Telemetry {
        let outputs = self.interlock.outputs(&self.inputs());
        let drive = &self.path.drive;
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
            changes: self.report.changes,
            cause: self.interlock.cause(),
            fault: self.interlock.fault(),
            arc: self.interlock.arc_phase(),
            pins: bits.into_iter().rev().fold(0, |pins, bit| pins << 1 | u16::from(bit)),
            finished: self.path.finished,
            load: self.path.ack(),
            segment: drive.segment,
            alpha_q24: self.path.alpha_q24(),
            speed_um_s: drive.speed_um_s as u32,
            pose: self.robot.place.commanded,
            counters: self.report.counters,
            robot: self.robot.port.as_ref().and_then(Monitor::report),
            tool: self.tool().copied(),
        }
    }

    fn send(&self, message: PendantMessage) -> Action {
        Action::Send(self.host.frame(message))
    }

    /// Levels for the interlock.
    fn inputs(&self) -> Inputs {
        let path = &self.path;
        let (started, manual) = (path.drive.started, self.panel.manual);
        Inputs {
            e_stop: self.panel.e_stop,
            enable: self.panel.enable,
            local_reset: self.panel.local_reset,
            established: self.panel.established,
            moving: path.drive.is_moving(),
            weld: started && path.wants_weld(),
            run_end: started && path.is_at_run_end(),
            path_end: started && path.ring.is_sealed() && path.is_at_end(),
            prefilled: path.loaded && path.ring.is_prefilled(),
            manual,
            too_fast: started && manual && path.welds_faster(self.limits.manual_feed_um_s),
            rewelds: path.drive.rewelds,
            defect: self.panel.defect,
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
            self.report.changed();
        } else if next.is_armed() != before.is_armed() {
            self.report.hurry();
        }
        self.note_fault(before.state(), before.fault());
        if !self.keeps_path() {
            self.path.close(inputs.path_end && !before.is_cut_short() && self.state() != State::Fault);
        }
        verdict
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
            State::Fault => self.path.drive.is_moving(),
        }
    }

    /// Gives the result of a [`Task`]; it is cached for repetitions of the request.
    pub fn answer(&mut self, request: u16, mut answer: Answer) -> Action {
        if request != self.host.requests.last || self.host.requests.reply.is_some() {
            return Action::Idle;
        }
        if let Answer::Pose(camera) = &mut answer {
            if self.may_jog().is_ok() {
                self.robot.jog_to(&camera.pose, &self.limits.jog);
            }
            camera.actual = self.robot.port.as_ref().and_then(Monitor::torch);
        }
        self.reply(answer)
    }
}
