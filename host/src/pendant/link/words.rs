//! What a pendant says, in words for an operator.

use weldpath_core::interlock::{Cause, Fault, State};
use weldpath_core::wire::{Field, Refusal};

/// A state in a word.
pub fn state_words(state: State) -> &'static str {
    match state {
        State::Disabled => "disabled",
        State::Idle => "idle",
        State::Loading => "loading",
        State::Ready => "ready",
        State::Running => "running",
        State::Holding => "holding",
        State::Held => "held",
        State::Fault => "fault",
    }
}

/// Why the torch holds.
pub fn cause_words(cause: Cause) -> &'static str {
    match cause {
        Cause::Hold => "hold was asked for",
        Cause::Stop => "stop was asked for",
        Cause::EnableLost => "the enabling switch was let go",
        Cause::Silence => "the pendant heard nothing from the host",
        Cause::Underrun => "waypoints did not arrive in time",
        Cause::StrikeTimeout => "the arc did not strike in time",
        Cause::ArcLost => "the arc went out",
        Cause::Fault => "a fault",
    }
}

/// A fault, and what clears it.
pub fn fault_words(fault: Fault) -> &'static str {
    match fault {
        Fault::EStop => "emergency stop: release it, then press the reset button at the pendant",
        Fault::Session => "the session changed while the torch moved",
        Fault::Waypoint => "a waypoint was not acceptable",
        Fault::Digest => "the path that arrived is not the one that was sent",
    }
}

/// Why a command was refused.
pub fn refusal_words(refusal: Refusal) -> String {
    match refusal {
        Refusal::State(state) => format!("not while the pendant is {}", state_words(state)),
        Refusal::Moving => "not while the torch moves".into(),
        Refusal::Path => "it names another path than the loaded one".into(),
        Refusal::NotEnabled => "the enabling switch is not held, or was not seen released before".into(),
        Refusal::EStop => fault_words(Fault::EStop).into(),
        Refusal::TooLong { capacity } => {
            format!("the path is longer than the pendant's {capacity} waypoints")
        }
        Refusal::Incomplete { next } => format!("waypoint {next} is missing"),
        Refusal::Digest { computed } => format!("the path that arrived has digest {computed:08x}"),
        Refusal::Stale { .. } => "the pendant's state has changed meanwhile".into(),
        Refusal::NotResumable(cause) => format!("no resume is possible after this: {}", cause_words(cause)),
        Refusal::Value(field) => format!("the {} is out of range", field_words(field)),
    }
}

fn field_words(field: Field) -> &'static str {
    match field {
        Field::Count => "number of points",
        Field::Chunk => "chunk length",
        Field::Reach => "distance from the base",
        Field::Step => "distance between waypoints",
        Field::Turn => "turn between waypoints",
        Field::Orientation => "orientation",
        Field::Size => "box or radius",
        Field::Back => "way back",
    }
}
