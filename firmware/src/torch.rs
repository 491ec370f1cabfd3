//! What happens every 2 ms: pins in, the pendant stepped, pins out. The pendant lives here.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use static_cell::ConstStaticCell;
use weldpath_core::interlock::Motion;
use weldpath_core::pendant::{Config, Panel, Pendant, Slot};

use crate::board::{Inputs, Outputs, Shared};

/// Ticks a second: the set-point rate.
pub const TICK_HZ: u32 = 500;

/// Waypoints that the pendant holds.
pub const RING: usize = 512;

static TICKS: AtomicU32 = AtomicU32::new(0);
static SLOTS: ConstStaticCell<[Slot; RING]> = ConstStaticCell::new([Slot::EMPTY; RING]);
static PENDANT: Shared<Option<Lent>> = Shared::new(None);

/// A pendant whose waypoints lie in static memory.
type Lent = Pendant<RING, &'static mut [Slot]>;

/// Starts the pendant; `nonce` has to differ from start to start. Once.
///
/// # Panics
/// If the default configuration contradicts itself.
pub fn install(nonce: u32) {
    let config = Config { tick_us: 1_000_000 / TICK_HZ, ..Config::default() };
    let pendant = Pendant::with_slots(&config, nonce, SLOTS.take().as_mut_slice());
    assert!(pendant.is_some(), "the configuration contradicts itself");
    PENDANT.with(|installed| *installed = pendant);
}

/// Uses the pendant while no tick can; none before [`install`].
pub fn with<T>(use_it: impl FnOnce(&mut Lent) -> T) -> Option<T> {
    PENDANT.with(|pendant| pendant.as_mut().map(use_it))
}

/// Ticks since the start, wrapping.
pub fn ticks() -> u32 {
    TICKS.load(Relaxed)
}

/// One tick, from the board's timer interrupt.
pub fn tick(inputs: Inputs) -> Outputs {
    TICKS.fetch_add(1, Relaxed);
    let Inputs { estop, enable, reset, established, manual } = inputs;
    let panel = Panel { e_stop: estop, enable, local_reset: reset, established, manual };
    let Some(tick) = with(|pendant| pendant.tick(&panel)) else { return Outputs::OFF };
    let runs = matches!(tick.outputs.motion, Motion::Run | Motion::Pass);
    Outputs { arc: tick.outputs.arc, gas: tick.outputs.gas, wire: tick.outputs.wire, motion: runs }
}
