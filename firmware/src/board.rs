//! What the pendant needs of a board. The modules below are the only ones with `unsafe`.

mod cortex_m4;
#[cfg(feature = "mps2-an386")]
mod mps2_an386;
#[cfg(feature = "stm32f407")]
mod stm32f407;

pub use cortex_m4::{BootRecord, ResetCause, Shared, boot_record, guard_stack, reset, stack_used_bytes};
#[cfg(feature = "mps2-an386")]
pub use mps2_an386::{Mps2An386 as Fitted, Stopwatch};
#[cfg(feature = "stm32f407")]
pub use stm32f407::Stm32f407 as Fitted;

/// A board; [`Fitted`] is the one that the features choose.
///
/// It calls [`crate::torch::tick`] every 2 ms and, from its ports' interrupts, [`crate::serial::LINK`] and
/// [`crate::serial::ROBOT`], at the priorities in `cortex_m4`.
pub trait Board {
    /// Resets a pendant that stands still.
    type Watchdog: Watchdog;

    /// The robot's answers are late after this.
    const LATE_TICKS: u16;
    /// What an NMI means.
    const NMI_CAUSE: ResetCause;

    /// Clocks, pins, ports, watchdog and tick; a number that differs from start to start. Outputs stay off. Once.
    fn start(boot: &BootRecord) -> (Self::Watchdog, u32, Straps);

    /// Makes the transmit interrupt of the host's line run.
    fn wake_link();

    /// The same for the robot's line.
    fn wake_robot();

    /// Everything off, from any context, without a queue or a lock.
    fn outputs_off();

    /// Whether the watchdog caused this start. Asked once, before [`Self::start`].
    fn watchdog_fired() -> bool;
}

/// A board's watchdog, which runs.
pub trait Watchdog {
    /// Starts its count again.
    fn feed(&mut self);
}

/// Of the host's line.
const LINK_BAUD: u32 = 115_200;
/// Of the robot's line.
const ROBOT_BAUD: u32 = 460_800;

/// Pins that the torch reads. They are pins and never messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inputs {
    /// The emergency stop's two contacts: pressed, or the wire broken.
    pub estop: [bool; 2],
    /// The enabling switch's two contacts: held in the middle position.
    pub enable: [bool; 2],
    /// The operator's local reset button.
    pub reset: bool,
    /// The power source says that current flows.
    pub established: bool,
    /// The key switch is in manual.
    pub manual: bool,
    /// The operator's button: the torch is where it has to begin or to go on.
    pub confirm: bool,
    /// The arc's charge pump is energised.
    pub arc_readback: bool,
    /// The motion enable's charge pump is energised.
    pub motion_readback: bool,
}

impl Inputs {
    /// What an unknown state is taken for.
    pub const SAFE: Self = Self {
        estop: [true; 2],
        enable: [false; 2],
        reset: false,
        established: false,
        manual: true,
        confirm: false,
        arc_readback: false,
        motion_readback: false,
    };
}

/// How the board was set up, and came up: read once at the start, never messages and never guessed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Straps {
    /// A robot port is fitted.
    pub port: bool,
    /// The clock is the one that it was built for; else no arc is armed.
    pub clock: bool,
}

/// Pins that the torch drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs {
    /// Arc power, as it is meant.
    pub arc: bool,
    /// Shielding gas valve.
    pub gas: bool,
    /// Motion enable of the robot, as it is meant.
    pub motion: bool,
    /// Wire feed.
    pub wire: bool,
    /// Level of the pin before the arc's charge pump: toggles with every tick while `arc`.
    pub arc_pump: bool,
    /// The same for motion.
    pub motion_pump: bool,
}

impl Outputs {
    /// Nothing energised.
    pub const OFF: Self =
        Self { arc: false, gas: false, motion: false, wire: false, arc_pump: false, motion_pump: false };
}
