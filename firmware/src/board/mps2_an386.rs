//! Arm MPS2 with the AN386 image as QEMU emulates it (`-M mps2-an386`).
//!
//! QEMU gives the machine no pins, so the panel - emergency stop, enabling switch, buttons, straps, and the lamps for
//! arc, gas, motion and wire - is a second serial port that only the tick touches. Addresses: Arm AN386, chapter 3.
#![allow(unsafe_code)]

mod panel;

use core::arch::global_asm;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::peripheral::{NVIC, SYST};
use cortex_m_semihosting::syscall;
use defmt_semihosting as _;

use super::cortex_m4::{PORT_PRIORITY, TICK_PRIORITY};
use super::{Board, BootRecord, Inputs, LINK_BAUD, Outputs, ROBOT_BAUD, ResetCause, Straps};
use crate::serial::{self, Registers};
use crate::torch;

const CLOCK_HZ: u32 = 25_000_000;
const PANEL_BAUD: u32 = 115_200;
/// What the charge pumps last for without a change of their pins: 8 ms.
const PUMP_CYCLES: u32 = CLOCK_HZ / 125;
/// To the NMI; as long again to a reset. Far longer than on a real board: QEMU's clock goes on while a busy host leaves
/// the emulator without a processor, and half a second of that was taken for a hang.
const WATCHDOG_CYCLES: u32 = CLOCK_HZ * 3;
/// Less than the watchdog's.
const PANEL_PATIENCE_CYCLES: u32 = CLOCK_HZ / 5;

const LINK: Uart = Uart(0x4000_4000);
const PANEL: Uart = Uart(0x4000_5000);
const ROBOT: Uart = Uart(0x4000_6000);
const TIMER: usize = 0x4000_0000;
/// The second timer again, from the first tick on: the charge of the pumps.
const PUMP: usize = STOPWATCH;
const STOPWATCH: usize = 0x4000_1000;
const WATCHDOG: usize = 0x4000_8000;

/// Interrupt lines of the image that are used here.
#[derive(Clone, Copy)]
#[repr(u16)]
enum Line {
    LinkReceive = 0,
    LinkTransmit = 1,
    PanelReceive = 2,
    PanelTransmit = 3,
    RobotReceive = 4,
    RobotTransmit = 5,
    Timer = 8,
    Pump = 9,
}

// SAFETY: each number is that line of the NVIC, which has 32.
unsafe impl cortex_m::interrupt::InterruptNumber for Line {
    fn number(self) -> u16 {
        self as u16
    }
}

type Handler = unsafe extern "C" fn();

#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Handler; 32] = {
    let mut lines: [Handler; 32] = [unexpected; 32];
    lines[Line::LinkReceive as usize] = link_receive;
    lines[Line::LinkTransmit as usize] = link_transmit;
    lines[Line::PanelReceive as usize] = panel_receive;
    lines[Line::PanelTransmit as usize] = panel_transmit;
    lines[Line::RobotReceive as usize] = robot_receive;
    lines[Line::RobotTransmit as usize] = robot_transmit;
    lines[Line::Timer as usize] = timer;
    lines[Line::Pump as usize] = pump_empty;
    lines
};

// The first instructions after a reset, before RAM is set up: the panel's "all off", on a transmitter that is empty.
global_asm!(
    ".section .text.__pre_init, \"ax\"",
    ".global __pre_init",
    ".type __pre_init,%function",
    ".thumb_func",
    "__pre_init:",
    "ldr r0, ={panel}",
    "movs r1, #217",
    "str r1, [r0, #16]",
    "movs r1, #1",
    "str r1, [r0, #8]",
    "movs r1, #{off}",
    "str r1, [r0]",
    "bx lr",
    ".ltorg",
    panel = const PANEL.0,
    off = const panel::ALL_OFF,
);

/// The emulated board.
pub struct Mps2An386;

impl Board for Mps2An386 {
    type Watchdog = Watchdog;

    /// Far more than on a real board, as QEMU's clock goes on while a busy host leaves the emulator or the robot without a
    /// processor. The 5 ticks of other boards are held in virtual time.
    const LATE_TICKS: u16 = 250;
    const NMI_CAUSE: ResetCause = ResetCause::Watchdog;

    /// The number is the host's clock, as QEMU has nothing else that differs from start to start.
    fn start(boot: &BootRecord) -> (Watchdog, u32, Straps) {
        panel::report_boot(boot.cause);
        LINK.start(LINK_BAUD);
        PANEL.start(PANEL_BAUD);
        ROBOT.start(ROBOT_BAUD);
        let watchdog = Watchdog::start();
        // Periodic down-counter with interrupt.
        let reload = CLOCK_HZ / torch::TICK_HZ - 1;
        write(TIMER + 0x4, reload);
        write(TIMER + 0x8, reload);
        write(TIMER, 0b1001);
        // SAFETY: the handlers above are in place.
        unsafe {
            let core = cortex_m::Peripherals::steal();
            let (mut nvic, mut clock) = (core.NVIC, core.SYST);
            clock.set_clock_source(SystClkSource::Core);
            clock.set_reload(CLOCK_MASK);
            clock.clear_current();
            clock.enable_counter();
            let ports = [
                Line::LinkReceive,
                Line::LinkTransmit,
                Line::PanelReceive,
                Line::PanelTransmit,
                Line::RobotReceive,
                Line::RobotTransmit,
                // More urgent than the tick: it is there for a tick that hangs.
                Line::Pump,
            ];
            for line in ports {
                nvic.set_priority(line, PORT_PRIORITY);
                NVIC::unmask(line);
            }
            nvic.set_priority(Line::Timer, TICK_PRIORITY);
        }
        wake_panel();
        await_panel();
        // SAFETY: as above.
        unsafe { NVIC::unmask(Line::Timer) };
        // SAFETY: semihosting call SYS_TIME takes no argument and returns a number.
        (watchdog, unsafe { syscall!(TIME) as u32 }, panel::straps())
    }

    fn wake_link() {
        NVIC::pend(Line::LinkTransmit);
    }

    fn wake_robot() {
        NVIC::pend(Line::RobotTransmit);
    }

    /// Straight to the transmitter.
    fn outputs_off() {
        let mut port = PANEL;
        port.send(panel::ALL_OFF);
    }

    /// Never: the image has no reset register; its NMI notes the cause.
    fn watchdog_fired() -> bool {
        false
    }
}

/// Pins are known at once; the panel answers the report of the start. One that does not counts as a pressed stop.
fn await_panel() {
    write(STOPWATCH + 0x4, PANEL_PATIENCE_CYCLES);
    write(STOPWATCH, 0b1);
    while !panel::is_heard() && read(STOPWATCH + 0x4) != 0 {}
    write(STOPWATCH, 0);
}

fn wake_panel() {
    NVIC::pend(Line::PanelTransmit);
}

/// CMSDK watchdog: an NMI when it runs out, a reset if that hangs, too.
pub struct Watchdog(());

impl Watchdog {
    fn start() -> Self {
        write(WATCHDOG + 0xc00, 0x1acc_e551);
        write(WATCHDOG, WATCHDOG_CYCLES);
        write(WATCHDOG + 0x8, 0b11);
        Self(())
    }
}

impl super::Watchdog for Watchdog {
    fn feed(&mut self) {
        write(WATCHDOG + 0xc, 1);
    }
}

/// Counts instructions under `-icount shift=10`, where one takes 1024 ns, by a timer of 40 ns.
pub struct Stopwatch {
    /// What an empty measurement shows.
    empty: u32,
}

impl Stopwatch {
    /// Starts the second timer.
    pub fn start() -> Self {
        write(STOPWATCH + 0x4, u32::MAX);
        write(STOPWATCH + 0x8, u32::MAX);
        write(STOPWATCH, 0b1);
        Self { empty: Self { empty: 0 }.instructions(|| ()) }
    }

    /// Instructions that `work` takes.
    #[inline(never)]
    pub fn instructions<T>(&self, work: impl FnOnce() -> T) -> u32 {
        let before = read(STOPWATCH + 0x4);
        let result = work();
        let after = read(STOPWATCH + 0x4);
        core::hint::black_box(result);
        let nanoseconds = u64::from(before.wrapping_sub(after)) * 40;
        ((nanoseconds + 512) / 1024) as u32 - self.empty
    }
}

/// CMSDK serial port at this address.
#[derive(Clone, Copy)]
struct Uart(usize);

impl Uart {
    fn start(self, baud: u32) {
        write(self.0 + 0x10, CLOCK_HZ / baud);
        // Transmitter, receiver, and both their interrupts.
        write(self.0 + 0x8, 0b1111);
    }
}

impl Registers for Uart {
    fn receive(&mut self) -> (Option<u8>, bool) {
        write(self.0 + 0xc, 0b10);
        let state = read(self.0 + 0x4);
        let overrun = state & 0b1000 != 0;
        if overrun {
            write(self.0 + 0x4, 0b1000);
        }
        ((state & 0b10 != 0).then(|| read(self.0) as u8), overrun)
    }

    fn can_send(&mut self) -> bool {
        write(self.0 + 0xc, 0b1);
        read(self.0 + 0x4) & 0b1 == 0
    }

    fn send(&mut self, byte: u8) {
        write(self.0, u32::from(byte));
    }

    /// It interrupts only after a byte.
    fn rest(&mut self) {}
}

unsafe extern "C" fn link_receive() {
    serial::LINK.receive_from(LINK);
}

unsafe extern "C" fn link_transmit() {
    serial::LINK.send_to(LINK);
}

unsafe extern "C" fn panel_receive() {
    let mut port = PANEL;
    if let (Some(byte), _) = port.receive() {
        panel::received(byte);
    }
}

unsafe extern "C" fn panel_transmit() {
    let mut port = PANEL;
    if port.can_send()
        && let Some(byte) = panel::next_to_send()
    {
        port.send(byte);
    }
}

unsafe extern "C" fn robot_receive() {
    serial::ROBOT.receive_from(ROBOT);
}

unsafe extern "C" fn robot_transmit() {
    serial::ROBOT.send_to(ROBOT);
}

/// The processor's own clock counts down to 0 from this.
const CLOCK_MASK: u32 = 0xff_ffff;
static TICKED_AT: AtomicU32 = AtomicU32::new(0);

/// The pins before the pumps change: their charge lasts anew.
fn charge_pumps() {
    write(PUMP + 0x4, PUMP_CYCLES);
    write(PUMP + 0x8, PUMP_CYCLES);
    write(PUMP, 0b1001);
}

/// The pins stood still for too long.
unsafe extern "C" fn pump_empty() {
    write(PUMP, 0);
    write(PUMP + 0xc, 1);
    let passed = TICKED_AT.load(Relaxed).wrapping_sub(SYST::get_current()) & CLOCK_MASK;
    panel::pumps_dropped(passed / (CLOCK_HZ / 1_000_000));
}

unsafe extern "C" fn timer() {
    write(TIMER + 0xc, 1);
    TICKED_AT.store(SYST::get_current(), Relaxed);
    let inputs: Inputs = panel::inputs();
    let outputs: Outputs = torch::tick(inputs);
    if panel::pump(outputs) {
        charge_pumps();
    }
    panel::show(outputs, torch::ticks());
}

unsafe extern "C" fn unexpected() {
    panic!("an interrupt that nobody asked for");
}

fn read(address: usize) -> u32 {
    // SAFETY: only called with addresses of the image's peripherals, all 32 bits wide.
    unsafe { (address as *const u32).read_volatile() }
}

fn write(address: usize, value: u32) {
    // SAFETY: as `read`; what a write starts is what the caller means.
    unsafe { (address as *mut u32).write_volatile(value) }
}
