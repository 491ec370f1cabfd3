//! What happens every 2 ms: pins in, outputs out.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::board::{Inputs, Outputs};

/// Ticks a second: the set-point rate.
pub const TICK_HZ: u32 = 500;

static TICKS: AtomicU32 = AtomicU32::new(0);

/// Ticks since the start, wrapping.
pub fn ticks() -> u32 {
    TICKS.load(Relaxed)
}

/// One tick, from the board's timer interrupt.
pub fn tick(inputs: Inputs) -> Outputs {
    TICKS.fetch_add(1, Relaxed);
    Outputs { motion: inputs.enable && !inputs.estop, ..Outputs::OFF }
}
