//! What an operator does at the panel, and a host before anything moves.

use std::io;
use std::time::{Duration, Instant};

use weldpath_core::wire::{Begin, ProcessTimes, Telemetry, WireWaypoint};

use super::{Client, Inputs, PATIENCE, Panel};

/// Nothing pressed nor held.
pub const RELEASED: Inputs = Inputs { e_stop: false, enable: false, reset: false };
/// The enabling switch held.
pub const GRIPPED: Inputs = Inputs { enable: true, ..RELEASED };

/// Presses the reset button until there is no fault: on a busy machine the panel may be heard too late, which is a stop.
pub fn acknowledge(client: &mut Client, panel: &Panel, others: Inputs) -> io::Result<()> {
    let begin = Instant::now();
    while let Some(fault) = client.wait_for_state(|_| true)?.fault {
        if begin.elapsed() > PATIENCE {
            return Err(io::Error::other(format!("{fault:?} stays, whatever is pressed")));
        }
        panel.reset(others)?;
        client.run_for(Duration::from_millis(60), true)?;
    }
    Ok(())
}

/// Lets the enabling switch go and grips it anew.
pub fn grip(client: &mut Client, panel: &Panel) -> io::Result<()> {
    panel.set(RELEASED)?;
    client.wait_for_state(|state| state.pins & Telemetry::ENABLE == 0)?;
    panel.set(GRIPPED)?;
    client.wait_for_state(|state| state.pins & Telemetry::ENABLED != 0)?;
    Ok(())
}

/// Begin of a path that is loaded whole, with steps of at most 10 mm, within a metre of the base.
pub fn begin(path: u16, waypoints: &[WireWaypoint]) -> Begin {
    Begin {
        path,
        total: waypoints.len() as u32,
        chunk: 4,
        streamed: false,
        reach_um: 1_000_000,
        max_step_um: 10_000,
        min_half_turn_cos_q15: 32_000,
        arc: true,
        times: ProcessTimes::default(),
    }
}
