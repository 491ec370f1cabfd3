//! The interlock against its table: every state that can be reached, every event, every combination of inputs.
//!
//! The model below is the table of the design written down once more, column by column, with levels applied before
//! the event; beside it stand the invariants, which know nothing of the table.

use std::collections::HashSet;

use State::*;
use weldpath_core::interlock::{
    ArcPhase, ArcTimes, ArcTimesMs, Cause, Event, Fault, Inputs, Interlock, Motion, Outputs, Refused, State,
};
use weldpath_tests::adversary::Random;

const EVENTS: [Event; 18] = [
    Event::Tick,
    Event::LinkSilent,
    Event::NewSession,
    Event::Begin,
    Event::Committed,
    Event::Start,
    Event::Resume,
    Event::Arm(true),
    Event::Arm(false),
    Event::Hold,
    Event::Stop,
    Event::Underrun,
    Event::BadWaypoint,
    Event::BadDigest,
    Event::Reset,
    Event::Abort,
    Event::Attach,
    Event::Robot(Cause::RobotSilent),
];

/// Every phase lasts one or two ticks of 2 ms, so that all of the sequence is reached.
fn fresh() -> Interlock {
    let ms = ArcTimesMs {
        pre_flow: 2,
        strike: 10,
        lost: 4,
        crater_fill: 2,
        burn_back: 2,
        post_flow: 4,
        current_off: 2,
    };
    Interlock::new(ArcTimes::new(&ms, 2_000).expect("within bounds"))
}

fn inputs(bits: u32) -> Inputs {
    let bit = |n: u32| bits >> n & 1 == 1;
    Inputs {
        e_stop: bit(0),
        enable: bit(1),
        local_reset: bit(2),
        established: bit(3),
        moving: bit(4),
        weld: bit(5),
        run_end: bit(6),
        path_end: bit(7),
        prefilled: bit(8),
        ..Inputs::default()
    }
}

/// The combinations of the other inputs: each of the rare ones alone beside those.
fn rare(common: Inputs) -> [Inputs; 4] {
    [
        Inputs { manual: true, ..common },
        Inputs { manual: true, too_fast: true, ..common },
        Inputs { rewelds: true, ..common },
        Inputs { defect: Some(Fault::Channels), ..common },
    ]
}

/// What the table says of a state, apart from the arc.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Model {
    state: State,
    enabled: bool,
    armed: bool,
    cause: Option<Cause>,
    fault: Option<Fault>,
    released: bool,
    reset_pressed: bool,
    manual: bool,
}

/// A cell of the table.
enum Cell {
    /// "-", or "stay".
    Stay,
    /// "no".
    No,
    /// Hands are taken off the robot: Disabled until a new grip.
    TakenOff(Cause),
    /// A state without a path: Idle or, if the switch is not held, Disabled.
    Rest,
    Loading,
    Ready,
    /// Running, if enabled.
    Go,
    Holding(Cause),
    /// Holding, then Fault.
    HoldingThen(Fault),
    Fault(Fault),
}

impl Model {
    /// What cannot be asked is taken from what was expected.
    fn of(interlock: &Interlock, expected: &Self) -> Self {
        Self {
            state: interlock.state(),
            enabled: interlock.is_enabled(),
            armed: interlock.is_armed(),
            cause: interlock.cause(),
            fault: interlock.fault(),
            ..*expected
        }
    }

    /// After power-on.
    fn fresh() -> Self {
        Self {
            state: Disabled,
            enabled: false,
            armed: false,
            cause: None,
            fault: None,
            released: false,
            reset_pressed: true,
            manual: true,
        }
    }

    /// The switch has to be let go and gripped anew.
    fn regrip(&mut self) {
        (self.enabled, self.released, self.armed) = (false, false, false);
        if self.state == Idle {
            self.state = Disabled;
        }
    }

    fn levels(&mut self, inputs: &Inputs) {
        let reset = inputs.local_reset && !self.reset_pressed;
        self.reset_pressed = inputs.local_reset;
        let turned = inputs.manual != self.manual;
        self.manual = inputs.manual;
        let broken = if inputs.e_stop { Some(Fault::EStop) } else { inputs.defect };
        if let Some(fault) = broken {
            let told =
                if self.fault == Some(Fault::EStop) && self.state == Fault { Fault::EStop } else { fault };
            self.enter(Cell::Fault(told));
            self.regrip();
        } else if reset && self.state == Fault && !inputs.moving {
            self.enter(Cell::Rest);
        }
        if turned && self.state == Running {
            self.enter(Cell::Holding(Cause::Key));
        }
        if !inputs.enable {
            (self.enabled, self.released, self.armed) = (false, true, false);
            match self.state {
                Idle => self.enter(Cell::Rest),
                Running => self.enter(Cell::Holding(Cause::EnableLost)),
                _ => true,
            };
        } else if self.released && broken.is_none() {
            (self.enabled, self.released) = (true, false);
            if self.state == Disabled {
                self.enter(Cell::Rest);
            }
        }
    }

    /// Running, unless what is to be welded is too fast for manual mode.
    fn go(&self, inputs: &Inputs) -> Cell {
        if self.armed && inputs.too_fast { Cell::No } else { Cell::Go }
    }

    /// Whether only the button at the pendant clears the fault.
    fn is_local(&self) -> bool {
        [Fault::EStop, Fault::Current, Fault::Channels, Fault::Readback].map(Some).contains(&self.fault)
    }

    /// Rows and columns of the table.
    fn cell(&self, event: Event, inputs: &Inputs) -> Cell {
        let resumable = self.cause.is_some_and(|cause| {
            ![Cause::Stop, Cause::StrikeTimeout, Cause::ArcLost, Cause::Fault].contains(&cause)
        });
        match (self.state, event) {
            (_, Event::Tick) => Cell::Stay,
            (Running, Event::LinkSilent) => Cell::Holding(Cause::Silence),
            (Running, Event::Hold) => Cell::Holding(Cause::Hold),
            (Running, Event::Stop) => Cell::Holding(Cause::Stop),
            (Running, Event::Underrun) => Cell::Holding(Cause::Underrun),
            (Running, Event::Robot(cause)) => Cell::Holding(cause),
            (Idle, Event::Robot(cause)) => Cell::TakenOff(cause),
            (_, Event::Robot(_)) => Cell::Stay,
            (Held, Event::Attach) => Cell::Stay,
            (_, Event::Attach) => Cell::No,
            (_, Event::LinkSilent | Event::Hold | Event::Stop | Event::Underrun) => Cell::Stay,
            (Disabled | Idle | Loading | Ready | Held, Event::NewSession) => Cell::Rest,
            (Running | Holding, Event::NewSession) => Cell::HoldingThen(Fault::Session),
            (Fault, Event::NewSession) if self.fault == Some(Fault::Session) && !inputs.moving => Cell::Rest,
            (Fault, Event::NewSession) => Cell::Stay,
            (Disabled | Idle | Loading | Ready | Held, Event::Begin) => Cell::Loading,
            (Running | Holding | Fault, Event::Begin) => Cell::No,
            (Loading, Event::Committed) => Cell::Ready,
            (_, Event::Committed) => Cell::Stay,
            (Ready, Event::Start) => self.go(inputs),
            (Loading, Event::Start) if inputs.prefilled => self.go(inputs),
            (_, Event::Start) => Cell::No,
            (Running | Holding, Event::BadWaypoint) => Cell::HoldingThen(Fault::Waypoint),
            (Running | Holding, Event::BadDigest) => Cell::HoldingThen(Fault::Digest),
            (Loading | Held, Event::BadWaypoint) => Cell::Fault(Fault::Waypoint),
            (Loading | Held, Event::BadDigest) => Cell::Fault(Fault::Digest),
            (_, Event::BadWaypoint | Event::BadDigest) => Cell::Stay,
            (Held, Event::Resume) if resumable => self.go(inputs),
            (_, Event::Resume) => Cell::No,
            (Running | Holding, Event::Reset | Event::Abort) => Cell::No,
            (Fault, Event::Reset) if !self.is_local() && !inputs.moving => Cell::Rest,
            (Fault, Event::Reset | Event::Abort) => Cell::No,
            (_, Event::Reset | Event::Abort) => Cell::Rest,
            (Running, Event::Arm(false)) => Cell::Holding(Cause::Hold),
            (Loading | Ready | Held, Event::Arm(true)) if !self.enabled => Cell::No,
            (Loading | Ready | Held, Event::Arm(_)) | (_, Event::Arm(false)) => Cell::Stay,
            (_, Event::Arm(true)) => Cell::No,
        }
    }

    /// Whether it was accepted.
    fn enter(&mut self, cell: Cell) -> bool {
        let (state, cause, fault) = match cell {
            Cell::Stay => return true,
            Cell::No => return false,
            Cell::Go if !self.enabled => return false,
            Cell::Go => (Running, None, None),
            Cell::Ready => (Ready, None, None),
            Cell::Rest if self.enabled => (Idle, None, None),
            Cell::Rest => (Disabled, None, None),
            Cell::Loading => (Loading, None, None),
            Cell::TakenOff(cause) => (Disabled, Some(cause), None),
            Cell::Holding(cause) => (Holding, Some(cause), None),
            Cell::HoldingThen(fault) => (Holding, Some(Cause::Fault), self.fault.or(Some(fault))),
            Cell::Fault(fault) => (Fault, None, Some(fault)),
        };
        let keeps_arm = matches!(state, Running | Ready);
        let held = self.state == Holding;
        *self = Self { state, cause, fault, armed: self.armed && keeps_arm, ..*self };
        if state == Loading || state == Holding && !held || matches!(cell, Cell::TakenOff(_)) {
            self.regrip();
        }
        true
    }

    fn event(&mut self, event: Event, inputs: &Inputs) -> bool {
        let accepted = self.enter(self.cell(event, inputs));
        match (event, self.state) {
            (Event::Arm(armed), Loading | Ready | Held) if accepted => self.armed = armed,
            (Event::NewSession, _) | (Event::Attach, Held) => self.regrip(),
            _ => {}
        }
        accepted
    }

    /// States that a tick may lead to: what the arc sequence decides is checked by the invariants.
    fn after_tick(&self, inputs: &Inputs) -> Vec<State> {
        match self.state {
            Holding if inputs.moving => vec![Holding],
            Holding if self.fault.is_some() => vec![Fault],
            Holding if inputs.path_end => vec![Idle, Disabled, Held],
            Holding => vec![Held],
            Running if inputs.path_end => vec![Running, Holding, Idle],
            Running => vec![Running, Holding],
            other => vec![other],
        }
    }
}

fn check_invariants(before: &Interlock, event: Event, inputs: &Inputs, after: &Interlock, outputs: &Outputs) {
    let context = || format!("{before:?}\n{event:?} {inputs:?}\n{after:?} {outputs:?}");
    if outputs.arc {
        let allowed =
            after.state() == Running && after.is_armed() && inputs.enable && !inputs.e_stop && inputs.weld;
        assert!(allowed && after.is_enabled(), "arc: {}", context());
        let phases = [ArcPhase::Striking, ArcPhase::On, ArcPhase::CraterFill, ArcPhase::BurnBack];
        assert!(phases.contains(&after.arc_phase()), "arc phase: {}", context());
    }
    assert!(!(outputs.gas && inputs.e_stop), "gas: {}", context());
    assert!(!outputs.wire || outputs.arc, "wire: {}", context());
    if inputs.e_stop {
        assert_eq!((after.state(), after.fault()), (Fault, Some(Fault::EStop)), "E-stop: {}", context());
    }
    let goes = matches!(outputs.motion, Motion::Run | Motion::Pass);
    assert!(!goes || (after.state() == Running && inputs.enable && !inputs.e_stop), "motion: {}", context());
    if after.state() == Running && before.state() != Running {
        assert!(matches!(event, Event::Start | Event::Resume), "started by itself: {}", context());
    }
    if after.state() == Holding || after.state() == Held && before.state() != Held {
        assert!(!after.is_armed() && !after.arc_phase().wants_power(), "hold drops the arc: {}", context());
    }
    if before.state() == Fault && after.state() != Fault {
        let operator = event == Event::Reset || inputs.local_reset || event == Event::NewSession;
        assert!(operator && !inputs.e_stop && !inputs.moving, "faults latch: {}", context());
        let by_host = event == Event::Reset && !inputs.local_reset;
        assert!(
            !(by_host && before.fault() == Some(Fault::EStop)),
            "E-stop is reset at the pendant: {}",
            context()
        );
    }
    if before.is_cut_short() && before.state() == Holding && event == Event::Tick && !inputs.e_stop {
        assert!(
            !matches!(after.state(), Idle | Disabled),
            "a crater cut short is not the end: {}",
            context()
        );
    }
    let waits = matches!(after.arc_phase(), ArcPhase::PreFlow | ArcPhase::Striking | ArcPhase::CraterFill);
    assert!(!(waits && goes), "motion waits for the arc: {}", context());
}

/// Compares one step with the model and the invariants; returns what follows.
fn check(before: &Interlock, model: &Model, event: Event, inputs: &Inputs) -> (Interlock, Model) {
    let (after, outputs, verdict) = before.step(event, inputs);
    let mut expected = *model;
    expected.levels(inputs);
    let accepted = expected.event(event, inputs);
    let context = || format!("{before:?}\n{event:?} {inputs:?}\n{after:?}");
    if event == Event::Tick {
        // How long current may flow on is a test of its own; here, that it is a fault only while it does.
        let stray = inputs.established && after.fault() == Some(Fault::Current);
        let follows = expected.after_tick(inputs).contains(&after.state());
        assert!(follows || stray && matches!(after.state(), Holding | Fault), "tick: {}", context());
        if matches!(after.state(), Holding) && expected.state != Holding {
            expected.regrip();
        }
    } else {
        assert_eq!(Model::of(&after, &expected), expected, "{}", context());
    }
    assert_eq!(verdict.is_ok(), accepted, "{:?}: {}", verdict, context());
    if verdict == Err(Refused::NotEnabled) {
        assert!(!after.is_enabled());
    }
    check_invariants(before, event, inputs, &after, &outputs);
    (after, Model::of(&after, &expected))
}

#[test]
fn every_state_event_and_input_follows_the_table() {
    let start = (fresh(), Model::fresh());
    let mut seen = HashSet::from([start]);
    let mut queue = vec![start];
    let mut steps = 0_u64;
    while let Some((interlock, model)) = queue.pop() {
        for event in EVENTS {
            let rarely =
                (0..512).filter(|bits| bits & 0b1_0000_0101 == 0).flat_map(|bits| rare(inputs(bits)));
            for now in (0..512).map(inputs).chain(rarely) {
                let next = check(&interlock, &model, event, &now);
                steps += 1;
                if seen.insert(next) {
                    queue.push(next);
                }
            }
        }
    }
    println!("{} states reached, {steps} steps", seen.len());
    for state in [Disabled, Idle, Loading, Ready, Running, Holding, Held, Fault] {
        assert!(seen.iter().any(|(interlock, _)| interlock.state() == state), "{state:?} was not reached");
    }
    for phase in
        [ArcPhase::Striking, ArcPhase::On, ArcPhase::CraterFill, ArcPhase::BurnBack, ArcPhase::PostFlow]
    {
        assert!(
            seen.iter().any(|(interlock, _)| interlock.arc_phase() == phase),
            "{phase:?} was not reached"
        );
    }
}

#[test]
fn a_million_random_walks_keep_the_table_and_come_to_rest() {
    let mut random = Random::new(7);
    let mut runs = 0;
    for _ in 0..1_000_000 {
        let (mut interlock, mut model) = (fresh(), Model::fresh());
        // The ordinary way to Running first, so that walks begin where it matters.
        let held = Inputs { enable: true, ..Inputs::default() };
        for (event, now) in [(Event::Begin, held), (Event::Tick, Inputs::default()), (Event::Tick, held)] {
            (interlock, model) = check(&interlock, &model, event, &now);
        }
        for event in [Event::Committed, Event::Arm(true), Event::Start] {
            (interlock, model) = check(&interlock, &model, event, &held);
        }
        assert_eq!(interlock.state(), Running);
        for _ in 0..random.below(24) {
            let event = EVENTS[random.below(EVENTS.len() as u64) as usize];
            // Mostly healthy inputs: else every walk ends in the E-stop's fault at once.
            let bits = random.bits() as u32 & 0x1FF;
            let now = if random.chance(0.8) { inputs(bits & !5 | 2) } else { inputs(bits) };
            let now = if random.chance(0.95) { now } else { rare(now)[random.below(4) as usize] };
            (interlock, model) = check(&interlock, &model, event, &now);
            runs += u32::from(interlock.state() == Running);
        }
        comes_to_rest(interlock, model, random.below(20));
    }
    assert!(runs > 500_000, "walks spend time in Running: {runs}");
}

/// With the host silent the torch stops, whatever was before; it moves for some ticks more.
fn comes_to_rest(mut interlock: Interlock, mut model: Model, moving_ticks: u64) {
    let moving = Inputs { enable: true, moving: true, ..Inputs::default() };
    (interlock, model) = check(&interlock, &model, Event::LinkSilent, &moving);
    for _ in 0..moving_ticks {
        (interlock, model) = check(&interlock, &model, Event::Tick, &moving);
        assert_ne!(interlock.state(), Running);
    }
    (interlock, _) = check(&interlock, &model, Event::Tick, &Inputs { moving: false, ..moving });
    assert!(!matches!(interlock.state(), Running | Holding), "{interlock:?}");
}
