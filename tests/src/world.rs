//! A host, a line and a pendant in virtual time, with an operator at the host and a witness at the torch.
//!
//! The witness knows the paths from outside and looks at nothing but set-points and pins.

use weldpath_core::interlock::{ArcTimesMs, Cause, Fault, State};
use weldpath_core::pendant::{self, ALPHA_ONE, Action, Panel, Pendant, SetPoint, Tick};
use weldpath_core::sender::{self, Notice, Sender};
use weldpath_core::wire::frame::{Received, decode, encode};
use weldpath_core::wire::{
    Begin, Command, FromPendant, HostDeframer, MAX_HOST_FRAME, MAX_PENDANT_FRAME, PendantDeframer,
    ProcessTimes, Q15_ONE, Telemetry, WirePose, WireWaypoint,
};

use crate::adversary::{Faults, Line, Random};

/// Set-point period.
pub const TICK_US: u64 = 2_000;
/// Waypoints in the ring.
pub const RING: usize = 512;

/// Short arc times, so that a test welds many seams.
pub fn config() -> pendant::Config {
    let arc = ArcTimesMs {
        pre_flow: 10,
        strike: 100,
        lost: 20,
        crater_fill: 10,
        burn_back: 4,
        post_flow: 10,
        current_off: 20,
    };
    pendant::Config { arc, ..pendant::Config::default() }
}

/// A pendant with [`config`].
pub fn pendant(boot: u32) -> Pendant<RING> {
    Pendant::new(&config(), boot).expect("sound configuration")
}

/// A path that winds through space, turns, welds in runs and changes its feed. Steps of 1 to 2 mm.
pub fn winding_path(random: &mut Random, total: u32) -> Vec<WireWaypoint> {
    let (mut position, mut heading) =
        ([0.4_f64, -0.2, 0.1].map(|m| m * 1e6), random.unit() * std::f64::consts::TAU);
    let (mut feed_um_s, mut weld) = (100_000, false);
    let mut waypoints = Vec::new();
    for index in 0..total {
        if random.chance(0.02) {
            feed_um_s = 20_000 + random.below(230_001) as u32;
            weld = !weld;
        }
        heading += 0.2 * (random.unit() - 0.5);
        let step_um = 1_000.0 + random.unit() * 1_000.0;
        let ahead = [heading.cos(), heading.sin(), 0.1].map(|part| part * step_um / 1.005);
        position = [0, 1, 2].map(|axis| position[axis] + ahead[axis]);
        position[2] = position[2].clamp(0.0, 3e5);
        if position[0].hypot(position[1]) > 1.5e6 {
            heading += std::f64::consts::PI;
            position = [0, 1, 2].map(|axis| position[axis] - 2.0 * ahead[axis]);
        }
        let half = 0.01 * f64::from(index % 300);
        let q15 = [half.cos(), 0.0, half.sin(), 0.0].map(|c| (c * f64::from(Q15_ONE)).round() as i16);
        let pose = WirePose { position_um: position.map(|um| um.round() as i32), orientation_q15: q15 };
        waypoints.push(WireWaypoint { pose, feed_um_s, weld });
    }
    waypoints
}

/// Begin of a path under the pendant's own limits.
pub fn begin(path: u16, waypoints: &[WireWaypoint], streamed: bool) -> Begin {
    let limits = config();
    Begin {
        path,
        total: waypoints.len() as u32,
        chunk: 4,
        streamed,
        reach_um: limits.reach_um,
        max_step_um: limits.max_step_um,
        min_half_turn_cos_q15: limits.min_half_turn_cos_q15,
        arc: true,
        times: times(),
    }
}

/// Those of [`config`].
pub fn times() -> ProcessTimes {
    let ms = config().arc;
    ProcessTimes {
        pre_flow_ms: ms.pre_flow,
        strike_ms: ms.strike,
        crater_fill_ms: ms.crater_fill,
        burn_back_ms: ms.burn_back,
        post_flow_ms: ms.post_flow,
    }
}

/// What may happen besides the faults of the line.
#[derive(Debug, Clone, Copy, Default)]
pub struct Events {
    /// E-stop and enabling switch, mean interval.
    pub panel_us: Option<u64>,
    /// Reset of either side, mean interval.
    pub reset_us: Option<u64>,
    /// Stalls of the host of up to 1.5 s, mean interval.
    pub stall_us: Option<u64>,
}

/// What the witness counted; all but the first four have to be 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Paths begun.
    pub begun: u32,
    /// Paths followed to their end.
    pub finished: u32,
    /// Paths that were followed to their end with a crater cut short on the way.
    pub cut: u32,
    /// Paths that a reset, an E-stop or a hold for good ended.
    pub ended: u32,
    /// Segments followed.
    pub segments: u64,
    /// Set-points that are not on the host's path where they claim to be.
    pub altered: u64,
    /// Segments skipped.
    pub lost: u64,
    /// Segments followed again without having been asked to.
    pub doubled: u64,
    /// Ticks of arc power outside Running or without enabling switch, with E-stop, or on no welded segment.
    pub stray_arc: u64,
    /// Ticks in which the speed changed by more than the acceleration allows, or was above the feed.
    pub rough: u64,
    /// Chunks or paths that the pendant refused: no fault if a reset or an E-stop took the path away.
    pub refused: u64,
}

/// Looks at the torch.
#[derive(Debug, Default)]
struct Witness {
    last: Option<SetPoint>,
    speed_um_s: f32,
}

/// All of it.
pub struct World {
    /// Virtual time.
    pub now_us: u64,
    /// Host end.
    pub host: Sender,
    /// Device end.
    pub pendant: Pendant<RING>,
    /// Host to pendant.
    pub up: Line,
    /// Pendant to host.
    pub down: Line,
    /// Pins.
    pub panel: Panel,
    /// Outputs and set-point of the last tick.
    pub tick: Option<Tick>,
    /// What was counted.
    pub counts: Counts,
    /// Telemetry received last.
    pub telemetry: Option<Telemetry>,
    /// Whether the operator starts and resumes by himself.
    pub operates: bool,
    /// Ticks since the last frame that belonged to the session arrived at the pendant.
    pub ticks_since_heard: u32,
    random: Random,
    events: Events,
    host_bytes: PendantDeframer,
    pendant_bytes: HostDeframer,
    path: Vec<WireWaypoint>,
    path_id: u16,
    boots: u32,
    streams: bool,
    seen_loading: bool,
    at_end: bool,
    stalled_until_us: u64,
    pressed_until_us: u64,
    arc_ticks: u32,
    witness: Witness,
}

impl World {
    /// At rest: switch released, no session.
    pub fn new(faults: Faults, events: Events, seed: u64) -> Self {
        Self::at_baud(faults, events, seed, 1_000_000)
    }

    /// The same on a line of another speed.
    pub fn at_baud(faults: Faults, events: Events, seed: u64, baud: u64) -> Self {
        Self {
            now_us: 0,
            host: Sender::new(&sender::Config::default()),
            pendant: pendant(1),
            up: Line::new(faults, baud, seed.wrapping_mul(3) + 1),
            down: Line::new(faults, baud, seed.wrapping_mul(5) + 2),
            panel: Panel::default(),
            tick: None,
            counts: Counts::default(),
            telemetry: None,
            operates: true,
            ticks_since_heard: 0,
            random: Random::new(seed),
            events,
            host_bytes: PendantDeframer::new(),
            pendant_bytes: HostDeframer::new(),
            path: Vec::new(),
            path_id: 0,
            boots: 1,
            streams: false,
            seen_loading: false,
            at_end: false,
            stalled_until_us: 0,
            pressed_until_us: 0,
            arc_ticks: 0,
            witness: Witness::default(),
        }
    }

    /// Frames sent in both directions.
    pub fn frames(&self) -> u64 {
        self.up.sent() + self.down.sent()
    }

    /// Starts the host's session.
    pub fn connect(&mut self) {
        self.host.open(self.random.bits() as u32);
    }

    /// One set-point period of everything.
    pub fn step(&mut self) {
        self.now_us += TICK_US;
        self.happen();
        self.pendant_turn();
        if self.now_us >= self.stalled_until_us {
            self.host_turn();
        }
    }

    /// Steps until `done`, at most for `limit_ms`; whether it was reached.
    pub fn run_until(&mut self, limit_ms: u64, mut done: impl FnMut(&Self) -> bool) -> bool {
        let end_us = self.now_us + limit_ms * 1000;
        while self.now_us < end_us {
            if done(self) {
                return true;
            }
            self.step();
        }
        done(self)
    }

    /// The host says nothing for a while.
    pub fn stall_host(&mut self, us: u64) {
        self.stalled_until_us = self.now_us + us;
    }

    /// Presses E-stop for a while.
    pub fn press_e_stop(&mut self, us: u64) {
        self.panel.e_stop = true;
        self.pressed_until_us = self.now_us + us;
    }

    /// Lets the enabling switch go for a while.
    pub fn release_switch(&mut self, us: u64) {
        self.panel.enable = false;
        self.pressed_until_us = self.now_us + us;
    }

    /// Power cycle of the pendant.
    pub fn reset_pendant(&mut self) {
        self.boots += 1;
        self.pendant = pendant(self.boots);
        self.pendant_bytes = HostDeframer::new();
        self.witness.last = None;
        self.witness.speed_um_s = 0.0;
    }

    /// The host program starts again.
    pub fn reset_host(&mut self) {
        self.host = Sender::new(&sender::Config::default());
        self.host_bytes = PendantDeframer::new();
        self.telemetry = None;
        self.connect();
    }

    fn happen(&mut self) {
        let random = &mut self.random;
        let mut strikes =
            |mean_us: Option<u64>| mean_us.is_some_and(|us| random.chance(TICK_US as f64 / us as f64));
        let panel = [strikes(self.events.panel_us), strikes(self.events.panel_us)];
        let reset = [strikes(self.events.reset_us), strikes(self.events.reset_us)];
        let stall = strikes(self.events.stall_us);
        match panel {
            [true, _] => self.press_e_stop(50_000),
            [_, true] => self.release_switch(30_000),
            _ => {}
        }
        match reset {
            [true, _] => self.reset_pendant(),
            [_, true] => self.reset_host(),
            _ => {}
        }
        if stall {
            let us = self.random.below(1_500_000);
            self.stall_host(us);
        }
        self.hands();
    }

    /// The operator's hands: lets E-stop go, grips the switch anew if it does not count, presses reset for a tick.
    fn hands(&mut self) {
        let seen = self.pendant.telemetry();
        let latched = seen.fault == Some(Fault::EStop);
        let in_vain = self.panel.enable && seen.pins & Telemetry::ENABLED == 0;
        if self.now_us >= self.pressed_until_us && self.operates {
            self.panel.e_stop = false;
            self.panel.enable = !latched && !in_vain;
        }
        self.panel.local_reset = latched && !self.panel.e_stop && !self.panel.local_reset;
        self.panel.established = self.arc_ticks > 3;
        // He has the torch brought to the first waypoint, looks, and says so.
        let first = self.path.first().filter(|_| self.pendant.path() == Some(self.path_id));
        let unsaid =
            seen.pins & Telemetry::POSE_KNOWN == 0 || first.is_some_and(|first| first.pose != seen.pose);
        let waits = matches!(seen.state, State::Ready | State::Loading);
        self.panel.confirm = self.operates && waits && unsaid && !self.panel.confirm;
    }

    fn pendant_turn(&mut self) {
        while let Some(bytes) = self.up.arrived(self.now_us) {
            for byte in bytes {
                let Some(received) = self.pendant_bytes.push(byte) else { continue };
                if matches!(received, Received::Payload(_)) {
                    self.ticks_since_heard = 0;
                }
                if let Action::Send(frame) = self.pendant.receive(received) {
                    self.reply(&frame);
                }
            }
        }
        self.ticks_since_heard += 1;
        let tick = self.pendant.tick(&self.panel);
        self.arc_ticks = if tick.outputs.arc { self.arc_ticks + 1 } else { 0 };
        self.observe(&tick);
        self.tick = Some(tick);
        while self.down.has_room(self.now_us) {
            let Some(frame) = self.pendant.transmit() else { break };
            self.reply(&frame);
        }
    }

    /// Sends a message of the pendant's.
    pub fn reply(&mut self, frame: &FromPendant) {
        let mut out = [0; MAX_PENDANT_FRAME];
        let len = encode(frame, &mut out).expect("every message fits");
        self.down.send(self.now_us, &out[..len]);
    }

    fn host_turn(&mut self) {
        while let Some(bytes) = self.down.arrived(self.now_us) {
            for byte in bytes {
                let frame = match self.host_bytes.push(byte) {
                    Some(Received::Payload(payload)) => {
                        decode::<FromPendant>(payload).expect("the pendant's messages")
                    }
                    _ => continue,
                };
                let notice = self.host.receive(frame, self.now_us);
                self.noticed(notice);
            }
        }
        while self.up.has_room(self.now_us) {
            let Some(frame) = self.host.poll(self.now_us, &self.path) else { break };
            let mut out = [0; MAX_HOST_FRAME];
            let len = encode(&frame, &mut out).expect("every message fits");
            self.up.send(self.now_us, &out[..len]);
        }
    }

    fn noticed(&mut self, notice: Notice) {
        match notice {
            Notice::SessionLost { .. } => self.connect(),
            Notice::Connected(_) if self.operates => self.next_path(),
            Notice::LoadRefused(_) | Notice::ChunkRefused(_) => self.counts.refused += 1,
            Notice::Telemetry(telemetry) => {
                self.telemetry = Some(telemetry);
                if self.operates && !self.host.is_busy() {
                    self.operate(&telemetry);
                }
            }
            _ => {}
        }
    }

    fn operate(&mut self, seen: &Telemetry) {
        let ours = seen.load.is_some_and(|load| load.path == self.path_id);
        // Acks may overtake telemetry: only telemetry that follows telemetry tells that a path is gone.
        self.seen_loading |= ours;
        match seen.state {
            State::Disabled | State::Idle if seen.finished == Some(self.path_id) => {
                self.counts.finished += 1;
                self.next_path();
            }
            State::Disabled | State::Idle if self.seen_loading || self.host.progress().is_none() => {
                let ended = if self.at_end { &mut self.counts.cut } else { &mut self.counts.ended };
                *ended += 1;
                self.next_path();
            }
            State::Ready if ours => self.weld(Command::Start { path: self.path_id }),
            State::Loading if ours && self.is_prefilled(seen) => {
                self.weld(Command::Start { path: self.path_id })
            }
            State::Held if ours && seen.cause.is_some_and(Cause::is_resumable) => {
                self.weld(Command::Resume { path: self.path_id, changes: seen.changes, back_um: 0 });
            }
            State::Held => self.ask(Command::Reset),
            State::Loading if self.host.progress().is_none() => self.ask(Command::Reset),
            State::Fault if seen.fault != Some(Fault::EStop) => self.ask(Command::Reset),
            _ => {}
        }
    }

    fn is_prefilled(&self, seen: &Telemetry) -> bool {
        self.streams && seen.load.is_some_and(|load| load.next >= RING as u32 / 2)
    }

    fn weld(&mut self, go: Command) {
        let switch = Telemetry::ENABLED;
        if self.telemetry.is_some_and(|seen| seen.pins & switch != 0) {
            self.ask(Command::ArcArm { armed: true });
            self.ask(go);
        }
    }

    /// Queues a command.
    pub fn ask(&mut self, command: Command) {
        // A full queue or a closed session: the operator asks again at the next telemetry.
        let _ = self.host.request(command);
    }

    /// The next path: mostly short and stored, sometimes long and streamed.
    fn next_path(&mut self) {
        let streamed = self.random.chance(0.1);
        let total = if streamed { 600 + self.random.below(1500) } else { 2 + self.random.below(400) };
        let path = winding_path(&mut self.random, total as u32);
        self.load(path, streamed);
    }

    /// Loads a path.
    pub fn load(&mut self, path: Vec<WireWaypoint>, streamed: bool) {
        self.host.cancel_load();
        self.path_id = self.path_id.wrapping_add(1);
        self.streams = streamed;
        self.seen_loading = false;
        self.at_end = false;
        self.path = path;
        assert!(self.host.load(begin(self.path_id, &self.path, streamed), &self.path), "a session is open");
        self.counts.begun += 1;
    }

    /// Id of the path loaded last.
    pub fn path_id(&self) -> u16 {
        self.path_id
    }

    fn observe(&mut self, tick: &Tick) {
        let running = self.pendant.state() == State::Running;
        let on_weld = |at: SetPoint| self.path.get(at.segment as usize).is_some_and(|waypoint| waypoint.weld);
        let place = tick.set_point.or(self.witness.last);
        let allowed = running && self.panel.enable && !self.panel.e_stop && place.is_none_or(on_weld);
        if tick.outputs.arc && !allowed {
            self.counts.stray_arc += 1;
        }
        let Some(now) = tick.set_point else {
            self.witness.last = None;
            self.witness.speed_um_s = 0.0;
            return;
        };
        if self.pendant.path() == Some(self.path_id) {
            self.compare(now);
        } else {
            self.counts.altered += 1;
        }
        self.at_end |= now.alpha_q24 == ALPHA_ONE && now.segment as usize + 2 == self.path.len();
        self.witness.last = Some(now);
    }

    fn compare(&mut self, now: SetPoint) {
        let at = now.segment as usize;
        let expected = match self.path.get(at..at + 2) {
            Some([from, to]) => pendant::set_point(&from.pose, &to.pose, now.alpha_q24),
            _ => None,
        };
        if expected != Some(now.pose) {
            self.counts.altered += 1;
        }
        match self.witness.last {
            None => self.counts.lost += u64::from(now.segment),
            Some(last) => {
                let ends_before = last.alpha_q24 == ALPHA_ONE || now.segment == last.segment + 1;
                self.counts.lost += u64::from(now.segment.saturating_sub(last.segment + 1));
                let back = (now.segment, now.alpha_q24) < (last.segment, last.alpha_q24);
                self.counts.doubled += u64::from(back);
                self.counts.segments += u64::from(now.segment > last.segment && ends_before);
            }
        }
        self.check_speed();
    }

    fn check_speed(&mut self) {
        let speed = self.pendant.speed_um_s();
        let change = (speed - self.witness.speed_um_s) / (TICK_US as f32 * 1e-6);
        let config = config();
        let seen = self.pendant.telemetry();
        let disabled =
            seen.cause == Some(Cause::EnableLost) || seen.state == State::Holding && !self.panel.enable;
        let hard = seen.state == State::Fault || disabled;
        let bound = if hard { config.emergency_um_s2 } else { config.accel_um_s2 };
        let stops = speed == 0.0 && change > -2.0 * bound as f32;
        self.counts.rough += u64::from(!stops && change.abs() > bound as f32 * 1.02 + 10.0);
        self.witness.speed_um_s = speed;
    }
}
