//! What a pendant says, in words for an operator.

use weldpath_core::interlock::{Cause, Fault, State};
use weldpath_core::wire::{AttachRefusal, Field, Refusal};

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
        Cause::EnableLost => "the enabling switch was released",
        Cause::Silence => "the pendant heard nothing from the host",
        Cause::Underrun => "waypoints did not arrive in time",
        Cause::StrikeTimeout => "the arc did not strike in time",
        Cause::ArcLost => "the arc went out",
        Cause::Fault => "a fault",
        Cause::Key => "the key switch was turned",
        Cause::ManualFeed => "the seam is to be welded faster than manual mode allows",
        Cause::RobotSilent => "the robot did not answer in time",
        Cause::RobotOff => "the robot is not where it should be",
        Cause::RobotDrives => "the robot's drives do not follow",
    }
}

/// A fault, and what clears it.
pub fn fault_words(fault: Fault) -> &'static str {
    match fault {
        Fault::EStop => "emergency stop: release it, then press the reset button at the pendant",
        Fault::Session => "the session changed while the torch moved",
        Fault::Waypoint => "a waypoint was not acceptable",
        Fault::Digest => "the path that arrived is not the one that was sent",
        Fault::Current => {
            "current flows although the arc is off: check the power source, then press the reset button"
        }
        Fault::Channels => {
            "the two contacts of emergency stop or enabling switch contradict each other: check the wiring, \
             then press the reset button"
        }
        Fault::Readback => {
            "an output does not follow its command: check the board, then press the reset button"
        }
    }
}

/// Why there is no path to go on with.
pub(crate) fn attach_words(why: AttachRefusal) -> String {
    match why {
        AttachRefusal::Busy => "its host is alive, or the torch still moves".into(),
        AttachRefusal::State(state) => format!("the pendant is {} and holds no path", state_words(state)),
        AttachRefusal::Session => "the pendant was reset, or another host had it since".into(),
        AttachRefusal::Path => "the pendant holds another path, or had not received all of this one".into(),
    }
}

/// Why a command was refused.
pub fn refusal_words(refusal: Refusal) -> String {
    match refusal {
        Refusal::State(state) => format!("not while the pendant is {}", state_words(state)),
        Refusal::Moving => "not while the torch moves".into(),
        Refusal::Path => "it names a path other than the loaded one".into(),
        Refusal::NotEnabled => "the enabling switch is not held, or was not seen released before".into(),
        Refusal::EStop => "an emergency stop or another fault that only the reset button at the pendant clears".into(),
        Refusal::TooLong { capacity } => {
            format!("the path is longer than the pendant's {capacity} waypoints")
        }
        Refusal::Incomplete { next } => format!("waypoint {next} is missing"),
        Refusal::Digest { computed } => format!("the path that arrived has digest {computed:08x}"),
        Refusal::Stale { .. } => "the pendant's state has changed meanwhile".into(),
        Refusal::NotResumable(cause) => format!("no resume is possible after this: {}", cause_words(cause)),
        Refusal::Away { distance_um, turn_mrad } => format!(
            "the torch is {:.1} mm and {:.1} degrees from where it has to be",
            f64::from(distance_um) * 1e-3,
            f64::from(turn_mrad) * 1e-3 * 180.0 / std::f64::consts::PI
        ),
        Refusal::PoseUnknown => {
            "it is not known where the torch is: bring it to where the path begins and press confirm at the pendant".into()
        }
        Refusal::Robot => "the robot at the port is silent, or its drives do not follow".into(),
        Refusal::TooFast { at } => {
            format!("waypoint {at} is to be welded faster than manual mode allows; it is not welded slower")
        }
        Refusal::ArcBarred => "the arc is barred on this path".into(),
        Refusal::NoTool => "a robot port is fitted, and no tool was set: `stream` sends [tool] of the job, `scan` its --flange-from-camera".into(),
        Refusal::NotManual => "the key switch at the pendant is not in manual".into(),
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
        Field::Time => "time of the arc's sequence",
        Field::Tool => "tool's length",
        Field::Workspace => "camera's place, which has to be in the workspace,",
    }
}
