//! STM32F407 Discovery (STM32F407VG, 8 MHz crystal). **Builds in CI; has not run on hardware.**
//!
//! | pin | what |
//! |---|---|
//! | PA2, PA3 | USART2 to the host, 115200 baud |
//! | PC6, PC7 | USART6 to the robot, 460800 baud |
//! | PE7, PE12 | emergency stop: two contacts to ground that open when pressed, so that a broken wire is a stop |
//! | PE8, PE13 | enabling switch: two contacts to 3.3 V that close in the middle position |
//! | PE9, PE10 | reset button, power source's "current flows": contacts to 3.3 V |
//! | PE11 | key switch: a contact to ground that opens in manual |
//! | PE14 | confirm button: a contact to 3.3 V |
//! | PE15 | strap: to ground where a robot port is fitted |
//! | PD12, PD14 | arc, motion: each before a charge pump, which holds while the pin toggles with every tick |
//! | PD8, PD9 | read-back of those pumps: contacts to 3.3 V that close while energised |
//! | PD13, PD15 | shielding gas, wire feed: high is on |
//!
//! The independent watchdog starts before anything is waited for. Without the crystal the board runs on its internal clock, is not to
//! weld, and says so. Should the crystal stop later, the clock security system raises the NMI. The brown-out level is an option byte of
//! the chip: it is read and logged, and never written here.
//!
//! After any reset the pins are inputs until `start`: what they drive needs a pull-down of its own.
#![allow(unsafe_code)]

use core::cell::RefCell;

use critical_section::Mutex;
use defmt_rtt as _;
use stm32f4xx_hal::gpio::{ErasedPin, Input, Output, PinState};
use stm32f4xx_hal::rcc::Config;
use stm32f4xx_hal::serial::{Instance, Rx, RxISR, RxListen, Serial, Tx, TxISR, TxListen};
use stm32f4xx_hal::timer::{CounterHz, Event, Flag};
use stm32f4xx_hal::watchdog::IndependentWatchdog;
use stm32f4xx_hal::{ClearFlags, Ptr, interrupt, pac, prelude::*};

use super::cortex_m4::{PORT_PRIORITY, TICK_PRIORITY};
use super::{Board, BootRecord, Inputs, LINK_BAUD, Outputs, ROBOT_BAUD, ResetCause, Straps};
use crate::serial::{self, Registers};
use crate::torch;

/// Of the watchdog at its clock's nominal 32 kHz: 49 ms at the slowest 17 kHz, 18 ms at the fastest 47 kHz.
const WATCHDOG_MS: u32 = 26;
/// Looks at the crystal, each of ten cycles of 16 MHz or more: it has at least 5 ms, of the 2 ms that it takes.
const CRYSTAL_LOOKS: u32 = 8_000;
/// PD12 to PD15.
const OUTPUT_PINS: u32 = 0xf000;

/// Everything the interrupts own, from `start` on.
struct Owned {
    timer: CounterHz<pac::TIM2>,
    link: Usart<pac::USART2>,
    robot: Usart<pac::USART6>,
    estop: [ErasedPin<Input>; 2],
    enable: [ErasedPin<Input>; 2],
    confirm: ErasedPin<Input>,
    arc_readback: ErasedPin<Input>,
    motion_readback: ErasedPin<Input>,
    reset: ErasedPin<Input>,
    established: ErasedPin<Input>,
    manual: ErasedPin<Input>,
    arc: ErasedPin<Output>,
    gas: ErasedPin<Output>,
    motion: ErasedPin<Output>,
    wire: ErasedPin<Output>,
}

static OWNED: Mutex<RefCell<Option<Owned>>> = Mutex::new(RefCell::new(None));

/// The independent watchdog: it has a clock of its own and cannot be stopped.
pub struct Watchdog(IndependentWatchdog);

impl super::Watchdog for Watchdog {
    fn feed(&mut self) {
        self.0.feed();
    }
}

/// The Discovery board.
pub struct Stm32f407;

impl Board for Stm32f407 {
    type Watchdog = Watchdog;

    /// The budget of docs/robot-port.md.
    const LATE_TICKS: u16 = 5;
    /// The clock has failed.
    const NMI_CAUSE: ResetCause = ResetCause::Fault;

    fn start(_boot: &BootRecord) -> (Watchdog, u32, Straps) {
        // Taken once: `main` runs once.
        let (Some(device), Some(mut core)) = (pac::Peripherals::take(), cortex_m::Peripherals::take()) else {
            super::reset(ResetCause::Fault)
        };
        let mut watchdog = IndependentWatchdog::new(device.IWDG);
        watchdog.start(WATCHDOG_MS.millis());
        let crystal = crystal_runs();
        let source = if crystal { Config::hse(8.MHz()) } else { Config::hsi() };
        let mut rcc = device.RCC.freeze(source.sysclk(168.MHz()).require_pll48clk());
        watchdog.feed();
        if crystal {
            watch_crystal();
        }
        defmt::info!("crystal {=bool}, brown-out level {=u8}", crystal, brown_out_level());
        let (a, c) = (device.GPIOA.split(&mut rcc), device.GPIOC.split(&mut rcc));
        let (d, e) = (device.GPIOD.split(&mut rcc), device.GPIOE.split(&mut rcc));
        let line = Serial::new(device.USART2, (a.pa2, a.pa3), LINK_BAUD.bps(), &mut rcc);
        let Ok(line) = line else { super::reset(ResetCause::Fault) };
        let (tx, mut rx) = line.split();
        rx.listen();
        let robot = Serial::new(device.USART6, (c.pc6, c.pc7), ROBOT_BAUD.bps(), &mut rcc);
        let Ok(robot) = robot else { super::reset(ResetCause::Fault) };
        let (robot_tx, mut robot_rx) = robot.split();
        robot_rx.listen();
        let straps = Straps { port: e.pe15.into_pull_up_input().is_low(), clock: crystal };
        let mut timer = device.TIM2.counter_hz(&mut rcc);
        timer.listen(Event::Update);
        if timer.start(torch::TICK_HZ.Hz()).is_err() {
            super::reset(ResetCause::Fault);
        }
        let entropy = random(&device.RNG.constrain(&mut rcc).release());
        let low = PinState::Low;
        let owned = Owned {
            timer,
            link: Usart { rx, tx },
            robot: Usart { rx: robot_rx, tx: robot_tx },
            estop: [e.pe7.into_pull_up_input().erase(), e.pe12.into_pull_up_input().erase()],
            enable: [e.pe8.into_pull_down_input().erase(), e.pe13.into_pull_down_input().erase()],
            confirm: e.pe14.into_pull_down_input().erase(),
            arc_readback: d.pd8.into_pull_down_input().erase(),
            motion_readback: d.pd9.into_pull_down_input().erase(),
            reset: e.pe9.into_pull_down_input().erase(),
            established: e.pe10.into_pull_down_input().erase(),
            manual: e.pe11.into_pull_up_input().erase(),
            arc: d.pd12.into_push_pull_output_in_state(low).erase(),
            gas: d.pd13.into_push_pull_output_in_state(low).erase(),
            motion: d.pd14.into_push_pull_output_in_state(low).erase(),
            wire: d.pd15.into_push_pull_output_in_state(low).erase(),
        };
        critical_section::with(|cs| OWNED.borrow_ref_mut(cs).replace(owned));
        watchdog.feed();
        // SAFETY: what the handlers use is in place.
        unsafe {
            core.NVIC.set_priority(pac::Interrupt::USART2, PORT_PRIORITY);
            core.NVIC.set_priority(pac::Interrupt::USART6, PORT_PRIORITY);
            core.NVIC.set_priority(pac::Interrupt::TIM2, TICK_PRIORITY);
            pac::NVIC::unmask(pac::Interrupt::USART2);
            pac::NVIC::unmask(pac::Interrupt::USART6);
            pac::NVIC::unmask(pac::Interrupt::TIM2);
        }
        (Watchdog(watchdog), entropy, straps)
    }

    fn wake_link() {
        with_owned(|owned| owned.link.tx.listen());
    }

    fn wake_robot() {
        with_owned(|owned| owned.robot.tx.listen());
    }

    /// One store to the port's reset bits.
    fn outputs_off() {
        // SAFETY: a write to BSRR changes only the pins named, in one store.
        unsafe { (*pac::GPIOD::ptr()).bsrr().write(|w| w.bits(OUTPUT_PINS << 16)) };
    }

    /// Asking clears the flag.
    fn watchdog_fired() -> bool {
        // SAFETY: before `start` nobody owns the register; only the flag's clear bit is written.
        let status = unsafe { (*pac::RCC::ptr()).csr() };
        let fired = status.read().wdgrstf().bit_is_set();
        status.modify(|_, w| w.rmvf().set_bit());
        fired
    }
}

/// Starts the crystal and gives it a bounded time.
fn crystal_runs() -> bool {
    // SAFETY: before the clocks are set up nobody else uses the register.
    let control = unsafe { (*pac::RCC::ptr()).cr() };
    control.modify(|_, w| w.hseon().set_bit());
    (0..CRYSTAL_LOOKS).any(|_| control.read().hserdy().bit_is_set())
}

/// From here on a crystal that stops raises the NMI.
fn watch_crystal() {
    // SAFETY: single-threaded, before interrupts run; one bit is set.
    unsafe { (*pac::RCC::ptr()).cr() }.modify(|_, w| w.csson().set_bit());
}

/// 0 the highest, 3 off: as the chip's option bytes were set when it was flashed.
fn brown_out_level() -> u8 {
    // SAFETY: read only.
    unsafe { (*pac::FLASH::ptr()).optcr().read().bor_lev().bits() }
}

/// A word of the hardware's noise; 0 if it does not come: then the boot count alone tells starts apart.
fn random(noise: &pac::RNG) -> u32 {
    let ready = (0..10_000).any(|_| noise.sr().read().drdy().bit_is_set());
    if ready { noise.dr().read().bits() } else { 0 }
}

fn with_owned<T>(use_it: impl FnOnce(&mut Owned) -> T) -> Option<T> {
    critical_section::with(|cs| OWNED.borrow_ref_mut(cs).as_mut().map(use_it))
}

/// A serial port.
struct Usart<U: Instance> {
    rx: Rx<U>,
    tx: Tx<U>,
}

impl<U: Instance + Ptr<RB = pac::usart1::RegisterBlock>> Registers for &mut Usart<U> {
    fn receive(&mut self) -> (Option<u8>, bool) {
        // SAFETY: the handler owns the port; reading its status, then its data, clears an overrun, which would else
        // raise this interrupt without end.
        let port = unsafe { &*U::ptr() };
        let overrun = port.sr().read().ore().bit_is_set() && !self.rx.is_rx_not_empty();
        if overrun {
            let _ = port.dr().read();
        }
        match self.rx.is_rx_not_empty().then(|| self.rx.read()) {
            Some(Ok(byte)) => (Some(byte), overrun),
            Some(Err(_)) => (None, true),
            None => (None, overrun),
        }
    }

    fn can_send(&mut self) -> bool {
        self.tx.is_tx_empty()
    }

    fn send(&mut self, byte: u8) {
        // Empty, so it takes the byte.
        self.tx.write(byte).unwrap_or(());
    }

    fn rest(&mut self) {
        self.tx.unlisten();
    }
}

#[interrupt]
fn USART2() {
    with_owned(|owned| {
        serial::LINK.receive_from(&mut owned.link);
        serial::LINK.send_to(&mut owned.link);
    });
}

#[interrupt]
fn USART6() {
    with_owned(|owned| {
        serial::ROBOT.receive_from(&mut owned.robot);
        serial::ROBOT.send_to(&mut owned.robot);
    });
}

#[interrupt]
fn TIM2() {
    let inputs = with_owned(|owned| {
        owned.timer.clear_flags(Flag::Update);
        Inputs {
            estop: [owned.estop[0].is_high(), owned.estop[1].is_high()],
            enable: [owned.enable[0].is_high(), owned.enable[1].is_high()],
            confirm: owned.confirm.is_high(),
            arc_readback: owned.arc_readback.is_high(),
            motion_readback: owned.motion_readback.is_high(),
            reset: owned.reset.is_high(),
            established: owned.established.is_high(),
            manual: owned.manual.is_high(),
        }
    });
    let outputs: Outputs = torch::tick(inputs.unwrap_or(Inputs::SAFE));
    with_owned(|owned| {
        owned.arc.set_state(PinState::from(outputs.arc_pump));
        owned.gas.set_state(PinState::from(outputs.gas));
        owned.motion.set_state(PinState::from(outputs.motion_pump));
        owned.wire.set_state(PinState::from(outputs.wire));
    });
}
