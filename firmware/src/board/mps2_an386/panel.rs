//! The emulated panel's bytes.
//!
//! In: `0x40 | estop | enable << 1 | reset << 2 | established << 3 | manual << 4`, the state of the inputs; before the first one the emergency
//! stop counts as pressed. `0x60 | confirm | estop's second contact differs << 1 | enable's differs << 2 | read-back lies << 3 | robot port
//! fitted << 4`: the rest; the last is a strap, read once at the start. `?` asks for the stack's use. `!` makes the firmware panic, `$` hang and `%` overflow its stack: faults that a test
//! cannot cause from outside.
//!
//! Out: `0x80 | arc | gas << 1 | motion << 2 | wire << 3` or `0xa0 | reset cause`, each followed by the tick, or `0xb0` by the stack's bytes, or `0xb1`, the charge pumps have dropped, by the microseconds since the tick began, in five groups of
//! seven bits, highest first; and [`ALL_OFF`] alone, which the first instruction and every fatal handler send.

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, AtomicU8, Ordering::Relaxed};

use critical_section::Mutex;
use heapless::Deque;

use crate::board::{Inputs, Outputs, ResetCause, Straps, stack_used_bytes};

/// Outputs off, no clock.
pub const ALL_OFF: u8 = 0xe0;

const ESTOP: u8 = 1;
const ENABLE: u8 = 1 << 1;
const RESET: u8 = 1 << 2;
/// Nothing heard.
const UNKNOWN: u8 = ESTOP;

/// The second byte of inputs.
static MORE: AtomicU8 = AtomicU8::new(0);
/// What the pumps' far sides are: bit 0 the arc's, bit 1 the motion's.
static ENERGISED: AtomicU8 = AtomicU8::new(0);
/// What they were when they dropped since the last tick. QEMU's clock runs on while a busy host leaves it without a
/// processor: a tick that is late for that finds pumps dropped that are not broken. One that hangs finds nothing.
static DROPPED: AtomicU8 = AtomicU8::new(0);
/// Levels before the pumps at the tick before.
static LEVELS: AtomicU8 = AtomicU8::new(0);
static STATE: AtomicU8 = AtomicU8::new(UNKNOWN);
/// Levels that a tick must see although they have passed: on a busy host QEMU hands over a press and its release at
/// once. Stop and reset if they were pressed since the last tick, the enabling switch if it was released.
static PASSED: AtomicU8 = AtomicU8::new(0);
/// What the lamps show; none of the codes at first, so that the first tick reports.
static SHOWN: AtomicU8 = AtomicU8::new(0);
static WAITING: Mutex<RefCell<Deque<u8, 96>>> = Mutex::new(RefCell::new(Deque::new()));
static HANG: AtomicBool = AtomicBool::new(false);

/// A byte from the panel.
pub fn received(byte: u8) {
    match byte {
        0x40..=0x5f => {
            STATE.store(byte, Relaxed);
            PASSED.fetch_or(byte & (ESTOP | RESET) | !byte & ENABLE, Relaxed);
        }
        0x60..=0x7f => MORE.store(byte, Relaxed),
        b'?' => {
            report(0xb0, stack_used_bytes());
        }
        b'!' => panic!("asked for by the panel"),
        b'$' => HANG.store(true, Relaxed),
        b'%' => {
            overflow(0);
        }
        _ => {}
    }
}

/// Whether the panel has said anything since the start.
pub fn is_heard() -> bool {
    STATE.load(Relaxed) != UNKNOWN
}

/// The inputs as the panel told them since the last tick, for the tick alone.
pub fn inputs() -> Inputs {
    let passed = PASSED.swap(0, Relaxed);
    let state = (STATE.load(Relaxed) | passed & (ESTOP | RESET)) & !(passed & ENABLE);
    let is = |bit: u8| state & bit != 0;
    let more = MORE.load(Relaxed);
    let said = |bit: u8| more & bit != 0;
    let energised =
        (ENERGISED.load(Relaxed) | DROPPED.swap(0, Relaxed)) ^ if said(1 << 3) { 0b11 } else { 0 };
    Inputs {
        estop: [is(ESTOP), is(ESTOP) != said(1 << 1)],
        enable: [is(ENABLE), is(ENABLE) != said(1 << 2)],
        reset: is(RESET),
        established: is(1 << 3),
        manual: is(1 << 4),
        confirm: said(1),
        arc_readback: energised & 0b01 != 0,
        motion_readback: energised & 0b10 != 0,
    }
}

/// As the panel said at the start.
pub fn straps() -> Straps {
    Straps { port: MORE.load(Relaxed) & 1 << 4 != 0, clock: true }
}

/// The levels before the pumps; whether one of them changed. A pump whose pin stands still drops by its own clock.
pub fn pump(outputs: Outputs) -> bool {
    let levels = u8::from(outputs.arc_pump) | u8::from(outputs.motion_pump) << 1;
    let changed = LEVELS.swap(levels, Relaxed) ^ levels;
    // One that is no longer driven drops within its charge; here at once, so that both need only one clock.
    let driven = u8::from(outputs.arc) | u8::from(outputs.motion) << 1;
    let energised = ENERGISED.load(Relaxed);
    ENERGISED.store((energised | changed) & driven, Relaxed);
    changed & driven != 0
}

/// The pumps have dropped: nobody has changed their pins. `after_us`: since the last tick began.
pub fn pumps_dropped(after_us: u32) {
    let energised = ENERGISED.swap(0, Relaxed);
    if energised != 0 {
        DROPPED.store(energised, Relaxed);
        SHOWN.store(0, Relaxed);
        report(0xb1, after_us);
    }
}

/// Drives the lamps: a report when they change. If it finds no room, the next tick tries again.
pub fn show(outputs: Outputs, tick: u32) {
    while HANG.load(Relaxed) {
        core::hint::spin_loop();
    }
    let Outputs { arc, gas, motion, wire, .. } = outputs;
    let code = [wire, motion, gas, arc].iter().fold(0b1000, |bits, &on| bits << 1 | u8::from(on));
    if SHOWN.load(Relaxed) != code && report(code, tick) {
        SHOWN.store(code, Relaxed);
    }
}

/// Says why the firmware started.
pub fn report_boot(cause: ResetCause) {
    report(0xa0 | cause as u8, 0);
}

/// The next byte for the panel.
pub fn next_to_send() -> Option<u8> {
    critical_section::with(|cs| WAITING.borrow_ref_mut(cs).pop_front())
}

/// Queues a code and its number; false if there is no room.
fn report(code: u8, number: u32) -> bool {
    let group = |i: u32| (number >> (7 * i)) as u8 & 0x7f;
    let frame = [code, group(4), group(3), group(2), group(1), group(0)];
    let queued = critical_section::with(|cs| {
        let mut waiting = WAITING.borrow_ref_mut(cs);
        let fits = waiting.capacity() - waiting.len() >= frame.len();
        if fits {
            waiting.extend(frame);
        }
        fits
    });
    if queued {
        super::wake_panel();
    }
    queued
}

/// Uses stack without end.
#[inline(never)]
#[allow(unconditional_recursion)]
fn overflow(depth: u32) -> u32 {
    let frame = core::hint::black_box([depth; 64]);
    overflow(depth.wrapping_add(1)).wrapping_add(frame.iter().sum())
}
