//! What every Cortex-M4 board shares: why it started, its stack, and the way out of a fault.
#![allow(unsafe_code)]

use core::arch::global_asm;
use core::cell::RefCell;
use core::mem::MaybeUninit;
use core::ptr::{addr_of, addr_of_mut};
use core::sync::atomic::{Ordering::SeqCst, compiler_fence};

use cortex_m::peripheral::{MPU, SCB};
use cortex_m::register::basepri;

use super::{Board, Fitted};

/// Why the controller started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, defmt::Format)]
#[repr(u8)]
pub enum ResetCause {
    /// Power-on, or a reset from outside.
    Power = 0,
    /// A panic of the firmware.
    Panic = 1,
    /// A fault of the processor, a stack overflow among them.
    Fault = 2,
    /// The main loop or the tick stood still.
    Watchdog = 3,
}

/// What the firmware knows about its start.
#[derive(Debug, Clone, Copy)]
pub struct BootRecord {
    /// Starts since power-on, this one included.
    pub count: u32,
    /// Why it started.
    pub cause: ResetCause,
}

/// Survives a reset: the start-up code leaves `.uninit` alone.
#[repr(C)]
#[derive(Clone, Copy)]
struct Kept {
    magic: u32,
    count: u32,
    cause: u32,
}

const MAGIC: u32 = 0x5745_4c44;

#[unsafe(link_section = ".uninit.boot")]
static mut KEPT: MaybeUninit<Kept> = MaybeUninit::uninit();

/// Reads and advances the record; once, at the start.
pub fn boot_record() -> BootRecord {
    // SAFETY: single-threaded, before interrupts run; any bit pattern is a `Kept`.
    let kept = unsafe { addr_of!(KEPT).cast::<Kept>().read_volatile() };
    let known = kept.magic == MAGIC;
    let count = if known { kept.count.wrapping_add(1) } else { 1 };
    let cause = match kept.cause {
        1 if known => ResetCause::Panic,
        2 if known => ResetCause::Fault,
        3 if known => ResetCause::Watchdog,
        _ if Fitted::watchdog_fired() => ResetCause::Watchdog,
        _ => ResetCause::Power,
    };
    keep(Kept { magic: MAGIC, count, cause: ResetCause::Power as u32 });
    BootRecord { count, cause }
}

fn keep(kept: Kept) {
    // SAFETY: aligned and in RAM; written before interrupts run or on the way into a reset.
    unsafe { addr_of_mut!(KEPT).cast::<Kept>().write_volatile(kept) }
}

/// Notes the cause and resets.
pub fn reset(cause: ResetCause) -> ! {
    // SAFETY: as in `boot_record`; whoever is interrupted does not run again.
    let kept = unsafe { addr_of!(KEPT).cast::<Kept>().read_volatile() };
    keep(Kept { cause: cause as u32, ..kept });
    SCB::sys_reset()
}

/// Priority of the tick. The serial ports' interrupts are more urgent, for they last microseconds and lose bytes if
/// they wait, and the tick can wait those microseconds.
pub const TICK_PRIORITY: u8 = 0x40;
/// Priority of the serial ports.
pub const PORT_PRIORITY: u8 = 0x20;

/// What the tick and the main loop share, and no other interrupt: while one uses it the other waits, the ports do not.
pub struct Shared<T>(RefCell<T>);

// SAFETY: one core; `with` keeps the tick from preempting the main loop, and a third user would fail the borrow.
unsafe impl<T: Send> Sync for Shared<T> {}

impl<T> Shared<T> {
    /// Holds a value.
    pub const fn new(value: T) -> Self {
        Self(RefCell::new(value))
    }

    /// Uses the value while no tick can.
    pub fn with<R>(&self, use_it: impl FnOnce(&mut T) -> R) -> R {
        let before = basepri::read();
        // SAFETY: masks the tick and what is less urgent; restored below, and a panic does not come back.
        unsafe { basepri::write(TICK_PRIORITY) };
        compiler_fence(SeqCst);
        let result = use_it(&mut self.0.borrow_mut());
        compiler_fence(SeqCst);
        // SAFETY: as it was.
        unsafe { basepri::write(before) };
        result
    }
}

/// Most of the stack ever used, bytes: the start-up code painted it.
pub fn stack_used_bytes() -> u32 {
    unsafe extern "C" {
        static _stack_start: u32;
        static _stack_end: u32;
    }
    let (top, bottom) = (addr_of!(_stack_start), addr_of!(_stack_end));
    let mut untouched = bottom;
    // SAFETY: both are the linker's ends of one region of RAM, and the walk stays between them.
    unsafe {
        while untouched < top && untouched.read_volatile() == cortex_m_rt::STACK_PAINT_VALUE {
            untouched = untouched.add(1);
        }
    }
    (top as u32) - (untouched as u32)
}

/// Below the stack: 1 MB, larger than any frame, so that none reaches past it.
const GUARD_START: u32 = 0x1ff0_0000;
const GUARD_SIZE_LOG2: u32 = 20;

/// Makes a stack overflow a fault; first of all. That there is no RAM below the stack is not enough: QEMU's board takes
/// writes to nowhere, and other chips have something there.
pub fn guard_stack() {
    const EXECUTE_NEVER: u32 = 1 << 28;
    const REGION_ON: u32 = 1;
    /// The rest of the memory as without the unit; off in fault handlers and the NMI.
    const ON_WITH_DEFAULT_MAP: u32 = 0b101;
    // SAFETY: single-threaded, before interrupts run; nothing below the stack is ever used. No access at all is 0.
    unsafe {
        let unit = &*MPU::PTR;
        unit.rnr.write(0);
        unit.rbar.write(GUARD_START);
        unit.rasr.write(EXECUTE_NEVER | (GUARD_SIZE_LOG2 - 1) << 1 | REGION_ON);
        unit.ctrl.write(ON_WITH_DEFAULT_MAP);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

// After a stack overflow there is no stack for a handler: these two, which do not return, get a fresh one first.
global_asm!(
    ".section .HardFault.fresh_stack, \"ax\"",
    ".global HardFault",
    ".type HardFault,%function",
    ".thumb_func",
    "HardFault:",
    "ldr r0, =_stack_start",
    "mov sp, r0",
    "b {fault}",
    ".global NonMaskableInt",
    ".type NonMaskableInt,%function",
    ".thumb_func",
    "NonMaskableInt:",
    "ldr r0, =_stack_start",
    "mov sp, r0",
    "b {nmi}",
    ".ltorg",
    fault = sym hard_fault,
    nmi = sym non_maskable,
);

extern "C" fn hard_fault() -> ! {
    Fitted::outputs_off();
    defmt::error!("fault");
    reset(ResetCause::Fault)
}

/// Where a board's watchdog raises it, before it resets; elsewhere a clock that failed.
extern "C" fn non_maskable() -> ! {
    Fitted::outputs_off();
    reset(Fitted::NMI_CAUSE)
}
