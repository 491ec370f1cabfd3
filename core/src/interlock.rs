//! The torch-side interlock: a pure function (state, event, inputs) -> (state, outputs, verdict).
//!
//! Not in the paper. This is a software interlock and not a certified safety function: E-stop and enabling switch also
//! have to cut power in hardware. E-stop and enabling switch are levels that are read with every event, never
//! messages; a message may stop and never enable.
//!
//! Held by the model test: arc power only in Running, armed, enabled, without E-stop, on a welded segment; faults
//! latch; only Start and Resume lead to Running; hold always drops and disarms the arc; every moving state stops.

mod arc;

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
}

impl Cause {
    /// Whether Resume may follow.
    pub const fn is_resumable(self) -> bool {
        matches!(self, Self::Hold | Self::EnableLost | Self::Silence | Self::Underrun)
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
        }
    }

    /// The function: reads the levels, applies the event, and says what follows and whether the event was accepted.
    pub fn step(mut self, event: Event, inputs: &Inputs) -> (Self, Outputs, Result<(), Refused>) {
        self.read_levels(inputs);
        let verdict = self.apply(event, inputs);
        (self, self.outputs(inputs), verdict)
    }

    /// State.
    pub fn state(&self) -> State {
        self.state
    }

    /// Why it holds: only in Holding and Held.
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
            State::Running if self.arc.phase == ArcPhase::On => Motion::Run,
            State::Running if self.arc.phase == ArcPhase::Off && inputs.run_end => Motion::Pass,
            State::Running if self.arc.phase == ArcPhase::Off && !(inputs.weld && self.armed) => Motion::Run,
            _ => Motion::Halt,
        }
    }

    fn read_levels(&mut self, inputs: &Inputs) {
        let reset = inputs.local_reset && !self.reset_pressed;
        self.reset_pressed = inputs.local_reset;
        if inputs.e_stop {
            self.emergency_stop();
        } else if reset && self.state == State::Fault && !inputs.moving {
            self.rest();
        }
        if !inputs.enable {
            self.released = true;
            self.enabled = false;
            self.enable_lost();
        } else if self.released && !inputs.e_stop {
            self.released = false;
            self.enabled = true;
            self.enable_edge();
        }
    }

    fn emergency_stop(&mut self) {
        self.latch(Fault::EStop);
        self.enabled = false;
        self.released = false;
        self.arc = Arc::default();
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
            Event::BadWaypoint => self.bad_path(Fault::Waypoint),
            Event::BadDigest => self.bad_path(Fault::Digest),
            Event::Begin => return self.begin(),
            Event::Committed => self.commit(),
            Event::Start => return self.start(inputs),
            Event::Resume => return self.resume(),
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
        if self.state != State::Running && self.fault != Some(Fault::EStop) {
            self.arc.rest(&self.times);
        }
    }

    fn run(&mut self, inputs: &Inputs) {
        let wanted = inputs.weld && self.armed;
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
            None if inputs.path_end => self.rest(),
            None => self.state = State::Held,
        }
    }

    fn hold_if_running(&mut self, cause: Cause) {
        if self.state == State::Running {
            self.hold(cause);
        }
    }

    /// Hold always drops the arc, and it has to be armed again.
    fn hold(&mut self, cause: Cause) {
        self.state = State::Holding;
        self.cause = Some(cause);
        self.armed = false;
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
        self.arc.cut();
    }

    fn new_session(&mut self, inputs: &Inputs) {
        match self.state {
            State::Running | State::Holding => self.fault_at_standstill(Fault::Session),
            State::Fault if self.fault != Some(Fault::Session) || inputs.moving => {}
            _ => self.rest(),
        }
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
            State::Ready => self.go(),
            State::Loading if inputs.prefilled => self.go(),
            _ => Err(self.wrong_state()),
        }
    }

    fn resume(&mut self) -> Result<(), Refused> {
        match (self.state, self.cause) {
            (State::Held, Some(cause)) if !cause.is_resumable() => Err(Refused::NotResumable(cause)),
            (State::Held, _) => self.go(),
            _ => Err(self.wrong_state()),
        }
    }

    fn go(&mut self) -> Result<(), Refused> {
        if !self.enabled {
            return Err(Refused::NotEnabled);
        }
        self.state = State::Running;
        self.cause = None;
        Ok(())
    }

    fn arm(&mut self, armed: bool) -> Result<(), Refused> {
        match self.state {
            State::Running if !armed => self.hold(Cause::Hold),
            State::Loading | State::Ready | State::Held => self.armed = armed,
            _ if !armed => {}
            _ => return Err(self.wrong_state()),
        }
        Ok(())
    }

    fn reset(&mut self, inputs: &Inputs) -> Result<(), Refused> {
        match self.state {
            State::Running | State::Holding => Err(self.wrong_state()),
            State::Fault if self.fault == Some(Fault::EStop) => Err(Refused::EStop),
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
        if self.fault == Some(Fault::EStop) { Refused::EStop } else { Refused::State(self.state) }
    }
}
