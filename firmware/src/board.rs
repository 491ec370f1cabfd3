//! What the pendant needs of a board. The modules below are the only ones with `unsafe`.
//!
//! Every board module has: `start` (clocks, ports, interrupts; outputs stay off; the tick runs), which gives a
//! `Watchdog` to feed and a number that differs from start to start; `wake_link`; `outputs_off` (from any context,
//! without a queue or a lock); `watchdog_fired`; `NMI_CAUSE`. It calls [`crate::torch::tick`] every 2 ms and
//! [`crate::serial::LINK`] from its port's interrupts, at the priorities in `cortex_m4`.

mod cortex_m4;
#[cfg(feature = "mps2-an386")]
mod mps2_an386;
#[cfg(feature = "stm32f407")]
mod stm32f407;

pub use cortex_m4::{BootRecord, ResetCause, Shared, boot_record, guard_stack, reset, stack_used_bytes};
#[cfg(feature = "mps2-an386")]
pub use mps2_an386::{NMI_CAUSE, Stopwatch, Watchdog, outputs_off, start, wake_link, watchdog_fired};
#[cfg(feature = "stm32f407")]
pub use stm32f407::{NMI_CAUSE, Watchdog, outputs_off, start, wake_link, watchdog_fired};

/// Pins that the torch reads. They are pins and never messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inputs {
    /// The emergency stop is pressed, or its wire is broken.
    pub estop: bool,
    /// The enabling switch is held in its middle position.
    pub enable: bool,
    /// The operator's local reset button.
    pub reset: bool,
    /// The power source says that current flows.
    pub established: bool,
    /// The key switch is in manual: no faster than 250 mm/s.
    pub manual: bool,
}

impl Inputs {
    /// What an unknown state is taken for.
    pub const SAFE: Self =
        Self { estop: true, enable: false, reset: false, established: false, manual: true };
}

/// Pins that the torch drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs {
    /// Arc power.
    pub arc: bool,
    /// Shielding gas valve.
    pub gas: bool,
    /// Motion enable of the robot.
    pub motion: bool,
    /// Wire feed.
    pub wire: bool,
}

impl Outputs {
    /// Nothing energised.
    pub const OFF: Self = Self { arc: false, gas: false, motion: false, wire: false };
}
