//! The torch-side interlock: a pure function (state, event, inputs) -> (state, outputs, verdict).
//!
//! Not in the paper. This is a software interlock and not a certified safety function: E-stop and enabling switch also
//! have to cut power in hardware. E-stop and enabling switch are levels that are read with every event, never
//! messages; a message may stop and never enable.
//!
//! Held by the model test: arc power only in Running, armed, enabled, without E-stop, on a welded segment; faults
//! latch; only Start and Resume lead to Running; hold always drops and disarms the arc; every moving state stops. The
//! enabling switch has to be let go and gripped anew after a new session, Begin, a re-attached host and every hold.

mod arc;
pub mod channels;

use serde::{Deserialize, Serialize};

use arc::{Arc, Sequence};
pub use arc::{ArcPhase, ArcTimes, ArcTimesMs};

/// State of the interlock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum State {
    /// No path, enabling switch not held.
    Disabled,
    /// No path, enabled.
    Idle,
    /// A path is being received.
    Loading,
    /// A path is complete.
    Ready,
    /// The torch follows the path, or waits on it for the arc.
    Running,
    /// Decelerating on the path.
    Holding,
    /// Standing on the path.
    Held,
    /// Latched: needs a reset.
    Fault,
}

/// Why the torch holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Cause {
    /// Asked to.
    Hold,
    /// Asked to, for good.
    Stop,
    /// Enabling switch let go or gripped.
    EnableLost,
    /// No word from the host.
    Silence,
    /// Waypoints did not arrive in time.
    Underrun,
    /// No arc within the strike time.
    StrikeTimeout,
    /// The arc went out.
    ArcLost,
    /// A fault follows at standstill.
    Fault,
    /// The key switch was turned.
    Key,
    /// The segment ahead is to be welded faster than manual mode allows.
    ManualFeed,
    /// The robot's frames are late.
    RobotSilent,
    /// The robot is not where it has to be.
    RobotOff,
    /// The robot's drives do not follow.
    RobotDrives,
}

impl Cause {
    /// Whether Resume may follow.
    pub const fn is_resumable(self) -> bool {
        !matches!(self, Self::Stop | Self::StrikeTimeout | Self::ArcLost | Self::Fault)
    }
}

/// What is latched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// E-stop: cleared by the local reset only.
    EStop,
    /// The session changed while moving.
    Session,
    /// A waypoint behind a right checksum was not acceptable.
    Waypoint,
    /// The digest of the path was not the host's.
    Digest,
    /// Current flows although the arc is off.
    Current,
    /// The two channels of E-stop or enabling switch contradict each other.
    Channels,
    /// An output does not do what it is told.
    Readback,
}

impl Fault {
    /// Whether only the reset button at the pendant clears it.
    pub const fn is_local(self) -> bool {
        matches!(self, Self::EStop | Self::Current | Self::Channels | Self::Readback)
    }
}

/// Levels, read with every event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Inputs {
    /// E-stop pressed (or its line broken).
    pub e_stop: bool,
    /// Enabling switch in its middle position.
    pub enable: bool,
    /// Reset button at the pendant.
    pub local_reset: bool,
    /// The power source reports current.
    pub established: bool,
    /// The set-points move.
    pub moving: bool,
    /// The segment under the torch is to be welded.
    pub weld: bool,
    /// The torch stands at the end of a run of segments that are all welded or all not.
    pub run_end: bool,
    /// The torch stands at the committed end of the path.
    pub path_end: bool,
    /// A streamed path has filled half of the ring.
    pub prefilled: bool,
    /// The key switch is in manual.
    pub manual: bool,
    /// The segment under the torch is to be welded faster than manual mode allows, and the key is in manual.
    pub too_fast: bool,
    /// A Resume goes back first, so that a crater that was cut short is welded over.
    pub rewelds: bool,
    /// What the board found broken.
    pub defect: Option<Fault>,
}

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// A set-point period has passed.
    Tick,
    /// No valid byte for the silence limit.
    LinkSilent,
    /// Another session was opened.
    NewSession,
    /// A host that was lost is back and goes on with its path.
    Attach,
    /// The robot does not follow, on a path or under hands.
    Robot(Cause),
    /// A path is to be opened.
    Begin,
    /// All waypoints are there and the digest matches.
    Committed,
    /// Start, of the loaded path.
    Start,
    /// Resume, of the loaded path.
    Resume,
    /// Arm or disarm the arc.
    Arm(bool),
    /// Hold.
    Hold,
    /// Stop.
    Stop,
    /// The path received so far ends within the stopping distance.
    Underrun,
    /// A waypoint was not acceptable.
    BadWaypoint,
    /// The digest does not match.
    BadDigest,
    /// Reset by the host.
    Reset,
    /// The path is to be dropped.
    Abort,
}

/// What the drive may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Follow the path, up to the end of the run of segments under the torch.
    Run,
    /// As Run, and the end of the run may be passed.
    Pass,
    /// Decelerate, and stand.
    Halt,
    /// Decelerate as fast as the machine can, and stand.
    EmergencyStop,
}

/// What the board has to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use = "the board has to perform it"]
pub struct Outputs {
    /// Arc power.
    pub arc: bool,
    /// Wire feed.
    pub wire: bool,
    /// Shielding gas.
    pub gas: bool,
    /// Motion.
    pub motion: Motion,
}

/// Why an event of a host's was not accepted; nothing changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// Not in this state.
    State(State),
    /// Not enabled.
    NotEnabled,
    /// E-stop, or its latched fault.
    EStop,
    /// Not from this hold.
    NotResumable(Cause),
    /// The segment under the torch is to be welded faster than manual mode allows.
    TooFast,
}

/// The whole state of the interlock. A new one is Disabled, and wants to see the switch released.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Interlock {
    times: ArcTimes,
    state: State,
    enabled: bool,
    released: bool,
    reset_pressed: bool,
    armed: bool,
    cause: Option<Cause>,
    fault: Option<Fault>,
    arc: Arc,
    manual: bool,
    stray: u16,
    cut_short: bool,
}

impl Interlock {
    /// After power-on.
    pub fn new(times: ArcTimes) -> Self {
        Self {
            times,
            state: State::Disabled,
            enabled: false,
            released: false,
            reset_pressed: true,
            armed: false,
            cause: None,
            fault: None,
            arc: Arc::default(),
            manual: true,
            stray: 0,
            cut_short: false,
        }
    }

    /// The same with other times of the arc sequence: those of the path that was just opened.
    pub fn timed(self, times: ArcTimes) -> Self {
        Self { times, ..self }
    }

    /// The function: reads the levels, applies the event, and says what follows and whether the event was accepted.
    ///
    /// Not inlined: it is asked from several places, and its code is large.
    #[inline(never)]
    pub fn step(mut self, event: Event, inputs: &Inputs) -> (Self, Outputs, Result<(), Refused>) {
        self.read_levels(inputs);
        let verdict = self.apply(event, inputs);
        (self, self.outputs(inputs), verdict)
    }

    /// State.
    pub fn state(&self) -> State {
        self.state
    }

    /// Why it holds, in Holding and Held; in Disabled, why the robot was taken out of the hands that guided it.
    pub fn cause(&self) -> Option<Cause> {
        self.cause
    }

    /// The latched fault; in Holding, the one that follows at standstill.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Arc phase.
    pub fn arc_phase(&self) -> ArcPhase {
        self.arc.phase
    }

    /// Whether the enabling switch was freshly pressed and is still held.
    pub fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// Whether the arc may be struck.
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// Whether a crater was cut short that was not welded over since.
    pub fn is_cut_short(&self) -> bool {
        self.cut_short
    }

    /// Arc power, in one expression: everything that has to be true is written here.
    pub fn outputs(&self, inputs: &Inputs) -> Outputs {
        let safe = self.enabled && inputs.enable && !inputs.e_stop;
        let power = self.state == State::Running && self.armed && safe && inputs.weld;
        Outputs {
            arc: power && self.arc.phase.wants_power(),
            wire: power && self.arc.phase.wants_wire(),
            gas: self.arc.phase.wants_gas() && !inputs.e_stop,
            motion: self.motion(inputs),
        }
    }

    fn motion(&self, inputs: &Inputs) -> Motion {
        match self.state {
            State::Fault => Motion::EmergencyStop,
            State::Holding if !inputs.enable || self.cause == Some(Cause::EnableLost) => {
                Motion::EmergencyStop
            }
            State::Running if self.arc.phase == ArcPhase::On => Motion::Run,
            State::Running if self.arc.phase == ArcPhase::Off && inputs.run_end => Motion::Pass,
            State::Running if self.arc.phase == ArcPhase::Off && !(inputs.weld && self.armed) => Motion::Run,
            _ => Motion::Halt,
        }
    }

    fn read_levels(&mut self, inputs: &Inputs) {
        let reset = inputs.local_reset && !self.reset_pressed;
        self.reset_pressed = inputs.local_reset;
        let turned = inputs.manual != self.manual;
        self.manual = inputs.manual;
        if inputs.e_stop {
            self.emergency_stop(Fault::EStop);
        } else if let Some(defect) = inputs.defect {
            self.emergency_stop(defect);
        } else if reset && self.state == State::Fault && !inputs.moving {
            self.rest();
        }
        if turned {
            self.hold_if_running(Cause::Key);
        }
        let healthy = !inputs.e_stop && inputs.defect.is_none();
        if !inputs.enable {
            self.released = true;
            self.enabled = false;
            self.armed = false;
            self.enable_lost();
        } else if self.released && healthy {
            self.released = false;
            self.enabled = true;
            self.enable_edge();
        }
    }

    /// A pressed E-stop stays the fault that is told, whatever breaks besides.
    fn emergency_stop(&mut self, fault: Fault) {
        let told =
            if self.state == State::Fault && self.fault == Some(Fault::EStop) { Fault::EStop } else { fault };
        self.latch(told);
        self.regrip();
        self.arc = Arc::default();
    }

    /// The enabling switch counts only after it was let go and gripped anew.
    fn regrip(&mut self) {
        self.enabled = false;
        self.released = false;
        self.armed = false;
        if self.state == State::Idle {
            self.state = State::Disabled;
        }
    }

    fn enable_lost(&mut self) {
        match self.state {
            State::Idle => self.state = State::Disabled,
            State::Running => self.hold(Cause::EnableLost),
            _ => {}
        }
    }

    fn enable_edge(&mut self) {
        if self.state == State::Disabled {
            self.state = State::Idle;
            self.cause = None;
        }
    }

    fn apply(&mut self, event: Event, inputs: &Inputs) -> Result<(), Refused> {
        match event {
            Event::Tick => self.tick(inputs),
            Event::LinkSilent => self.hold_if_running(Cause::Silence),
            Event::Underrun => self.hold_if_running(Cause::Underrun),
            Event::Hold => self.hold_if_running(Cause::Hold),
            Event::Stop => self.hold_if_running(Cause::Stop),
            Event::NewSession => self.new_session(inputs),
            Event::Attach => return self.attach(),
            Event::Robot(cause) => self.robot(cause),
            Event::BadWaypoint => self.bad_path(Fault::Waypoint),
            Event::BadDigest => self.bad_path(Fault::Digest),
            Event::Begin => return self.begin(),
            Event::Committed => self.commit(),
            Event::Start => return self.start(inputs),
            Event::Resume => return self.resume(inputs),
            Event::Arm(armed) => return self.arm(armed),
            Event::Reset => return self.reset(inputs),
            Event::Abort => return self.abort(),
        }
        Ok(())
    }

    fn tick(&mut self, inputs: &Inputs) {
        match self.state {
            State::Running => self.run(inputs),
            State::Holding if !inputs.moving => self.stand(inputs),
            _ => {}
        }
        if self.state != State::Running && !self.fault.is_some_and(Fault::is_local) {
            self.arc.rest(&self.times);
        }
        self.watch_current(inputs);
    }

    /// Current that flows for longer than a source needs to switch off, while nothing asks for it, is a fault.
    fn watch_current(&mut self, inputs: &Inputs) {
        let asked = self.state == State::Running && self.arc.phase.wants_power();
        self.stray = if inputs.established && !asked { self.stray.saturating_add(1) } else { 0 };
        if self.stray <= self.times.current_off() {
            return;
        }
        self.stray = 0;
        match self.state {
            State::Running | State::Holding => self.fault_at_standstill(Fault::Current),
            State::Fault => {}
            _ => self.latch(Fault::Current),
        }
    }

    fn run(&mut self, inputs: &Inputs) {
        let wanted = inputs.weld && self.armed;
        if wanted && inputs.too_fast && !inputs.run_end {
            self.hold(Cause::ManualFeed);
            return;
        }
        match self.arc.run(&self.times, wanted, inputs.run_end, inputs.established) {
            Sequence::StrikeTimeout => self.hold(Cause::StrikeTimeout),
            Sequence::Lost => self.hold(Cause::ArcLost),
            Sequence::Going if inputs.path_end && self.arc.phase == ArcPhase::Off => self.rest(),
            Sequence::Going => {}
        }
    }

    /// Standstill after a hold.
    fn stand(&mut self, inputs: &Inputs) {
        match self.fault {
            Some(fault) => self.latch(fault),
            None if inputs.path_end && !self.cut_short => self.rest(),
            None => self.state = State::Held,
        }
    }

    fn hold_if_running(&mut self, cause: Cause) {
        if self.state == State::Running {
            self.hold(cause);
        }
    }

    /// Only the hands that guide the robot move it in Idle: they have to grip anew.
    fn robot(&mut self, cause: Cause) {
        self.hold_if_running(cause);
        if self.state == State::Idle {
            self.regrip();
            self.cause = Some(cause);
        }
    }

    /// Hold always drops the arc; it has to be armed again, and before that the switch gripped anew.
    fn hold(&mut self, cause: Cause) {
        if self.state != State::Holding {
            self.state = State::Holding;
            self.regrip();
        }
        self.cause = Some(cause);
        self.cut_short |= matches!(self.arc.phase, ArcPhase::CraterFill | ArcPhase::BurnBack);
        self.arc.cut();
    }

    fn latch(&mut self, fault: Fault) {
        self.state = State::Fault;
        self.fault = Some(fault);
        self.cause = None;
        self.armed = false;
        self.arc.cut();
    }

    /// No path, no fault: Idle, or Disabled if the switch is not held.
    fn rest(&mut self) {
        self.state = if self.enabled { State::Idle } else { State::Disabled };
        self.cause = None;
        self.fault = None;
        self.armed = false;
        self.cut_short = false;
        self.arc.cut();
    }

    fn new_session(&mut self, inputs: &Inputs) {
        match self.state {
            State::Running | State::Holding => self.fault_at_standstill(Fault::Session),
            State::Fault if self.fault != Some(Fault::Session) || inputs.moving => {}
            _ => self.rest(),
        }
        self.regrip();
    }

    fn attach(&mut self) -> Result<(), Refused> {
        if self.state != State::Held {
            return Err(self.wrong_state());
        }
        self.regrip();
        Ok(())
    }

    fn bad_path(&mut self, fault: Fault) {
        match self.state {
            State::Running | State::Holding => self.fault_at_standstill(fault),
            State::Loading | State::Held => self.latch(fault),
            _ => {}
        }
    }

    fn fault_at_standstill(&mut self, fault: Fault) {
        self.hold(Cause::Fault);
        self.fault = self.fault.or(Some(fault));
    }

    fn begin(&mut self) -> Result<(), Refused> {
        match self.state {
            State::Running | State::Holding | State::Fault => Err(self.wrong_state()),
            _ => {
                self.rest();
                self.state = State::Loading;
                self.regrip();
                Ok(())
            }
        }
    }

    fn commit(&mut self) {
        if self.state == State::Loading {
            self.state = State::Ready;
        }
    }

    fn start(&mut self, inputs: &Inputs) -> Result<(), Refused> {
        match self.state {
            State::Ready => self.go(inputs),
            State::Loading if inputs.prefilled => self.go(inputs),
            _ => Err(self.wrong_state()),
        }
    }

    fn resume(&mut self, inputs: &Inputs) -> Result<(), Refused> {
        match (self.state, self.cause) {
            (State::Held, Some(cause)) if !cause.is_resumable() => Err(Refused::NotResumable(cause)),
            (State::Held, _) => self.go(inputs),
            _ => Err(self.wrong_state()),
        }
    }

    fn go(&mut self, inputs: &Inputs) -> Result<(), Refused> {
        if !self.enabled {
            return Err(Refused::NotEnabled);
        }
        if self.armed && inputs.too_fast {
            return Err(Refused::TooFast);
        }
        self.state = State::Running;
        self.cause = None;
        self.cut_short &= !(inputs.rewelds && self.armed);
        Ok(())
    }

    fn arm(&mut self, armed: bool) -> Result<(), Refused> {
        match self.state {
            State::Running if !armed => self.hold(Cause::Hold),
            State::Loading | State::Ready | State::Held if armed && !self.enabled => {
                return Err(Refused::NotEnabled);
            }
            State::Loading | State::Ready | State::Held => self.armed = armed,
            _ if !armed => {}
            _ => return Err(self.wrong_state()),
        }
        Ok(())
    }

    fn reset(&mut self, inputs: &Inputs) -> Result<(), Refused> {
        match self.state {
            State::Running | State::Holding => Err(self.wrong_state()),
            State::Fault if self.fault.is_some_and(Fault::is_local) => Err(Refused::EStop),
            State::Fault if inputs.moving => Err(self.wrong_state()),
            _ => {
                self.rest();
                Ok(())
            }
        }
    }

    fn abort(&mut self) -> Result<(), Refused> {
        match self.state {
            State::Running | State::Holding | State::Fault => Err(self.wrong_state()),
            _ => {
                self.rest();
                Ok(())
            }
        }
    }

    fn wrong_state(&self) -> Refused {
        let local = self.state == State::Fault && self.fault.is_some_and(Fault::is_local);
        if local { Refused::EStop } else { Refused::State(self.state) }
    }
}
