//! What happens every 2 ms: pins in, the pendant stepped, pins out. The pendant lives here.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use critical_section::Mutex;
use static_cell::StaticCell;
use weldpath_core::interlock::Motion;
use weldpath_core::pendant::{Config, Panel, Pendant};

use crate::board::{Inputs, Outputs};

/// Ticks a second: the set-point rate.
pub const TICK_HZ: u32 = 500;

/// Waypoints that the pendant holds.
pub const RING: usize = 512;

static TICKS: AtomicU32 = AtomicU32::new(0);
static PENDANT: StaticCell<Pendant<RING>> = StaticCell::new();
static INSTALLED: Mutex<RefCell<Option<&'static mut Pendant<RING>>>> = Mutex::new(RefCell::new(None));

/// Starts the pendant; `nonce` has to differ from start to start. Once.
///
/// # Panics
/// If the default configuration contradicts itself.
pub fn install(nonce: u32) {
    let config = Config { tick_us: 1_000_000 / TICK_HZ, ..Config::default() };
    let checked = config.checked().expect("a sound configuration");
    // In place: the ring is larger than the stack, and a copy through it would be caught by the first boot.
    let pendant = PENDANT.init_with(|| Pendant::with(&checked, nonce));
    critical_section::with(|cs| INSTALLED.borrow_ref_mut(cs).replace(pendant));
}

/// Uses the pendant while no tick can; none before [`install`].
pub fn with<T>(use_it: impl FnOnce(&mut Pendant<RING>) -> T) -> Option<T> {
    critical_section::with(|cs| INSTALLED.borrow_ref_mut(cs).as_deref_mut().map(use_it))
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
