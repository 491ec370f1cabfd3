//! STM32F407 Discovery (STM32F407VG, 8 MHz crystal). **Builds in CI; has not run on hardware.**
//!
//! | pin | what |
//! |---|---|
//! | PA2, PA3 | USART2 to the host, 115200 baud |
//! | PE7 | emergency stop: a contact to ground that opens when pressed, so that a broken wire is a stop |
//! | PE8 | enabling switch: a contact to 3.3 V that closes in the middle position |
//! | PE9, PE10 | reset button, power source's "current flows": contacts to 3.3 V |
//! | PE11 | key switch: a contact to ground that opens in manual |
//! | PD12 to PD15 | arc, shielding gas, motion, wire feed: high is on; the board's lamps |
//!
//! After any reset the pins are inputs until `start`: what they drive needs a pull-down of its own.
#![allow(unsafe_code)]

use core::cell::RefCell;

use critical_section::Mutex;
use defmt_rtt as _;
use stm32f4xx_hal::gpio::{ErasedPin, Input, Output, PinState};
use stm32f4xx_hal::rcc::Config;
use stm32f4xx_hal::serial::{Rx, RxISR, RxListen, Serial, Tx, TxISR, TxListen};
use stm32f4xx_hal::timer::{CounterHz, Event, Flag};
use stm32f4xx_hal::watchdog::IndependentWatchdog;
use stm32f4xx_hal::{ClearFlags, interrupt, pac, prelude::*};

use super::cortex_m4::{PORT_PRIORITY, TICK_PRIORITY};
use super::{BootRecord, Inputs, Outputs, ResetCause};
use crate::{serial, torch};

const BAUD: u32 = 115_200;
/// PD12 to PD15.
const OUTPUT_PINS: u32 = 0xf000;

/// Everything the interrupts own, from `start` on.
struct Owned {
    timer: CounterHz<pac::TIM2>,
    rx: Rx<pac::USART2>,
    tx: Tx<pac::USART2>,
    estop: ErasedPin<Input>,
    enable: ErasedPin<Input>,
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

impl Watchdog {
    /// Starts its count again.
    pub fn feed(&mut self) {
        self.0.feed();
    }
}

/// Clocks, pins, port, watchdog and tick; a number that differs from start to start. Outputs stay off.
pub fn start(_boot: &BootRecord) -> (Watchdog, u32) {
    // Taken once: `main` runs once.
    let (Some(device), Some(mut core)) = (pac::Peripherals::take(), cortex_m::Peripherals::take()) else {
        super::reset(ResetCause::Fault)
    };
    let clocks = Config::hse(8.MHz()).sysclk(168.MHz()).require_pll48clk();
    let mut rcc = device.RCC.freeze(clocks);
    let (a, d, e) =
        (device.GPIOA.split(&mut rcc), device.GPIOD.split(&mut rcc), device.GPIOE.split(&mut rcc));
    let line = Serial::new(device.USART2, (a.pa2, a.pa3), BAUD.bps(), &mut rcc);
    let Ok(line) = line else { super::reset(ResetCause::Fault) };
    let (tx, mut rx) = line.split();
    rx.listen();
    let mut timer = device.TIM2.counter_hz(&mut rcc);
    timer.listen(Event::Update);
    if timer.start(torch::TICK_HZ.Hz()).is_err() {
        super::reset(ResetCause::Fault);
    }
    let entropy = random(&device.RNG.constrain(&mut rcc).release());
    let low = PinState::Low;
    let owned = Owned {
        timer,
        rx,
        tx,
        estop: e.pe7.into_pull_up_input().erase(),
        enable: e.pe8.into_pull_down_input().erase(),
        reset: e.pe9.into_pull_down_input().erase(),
        established: e.pe10.into_pull_down_input().erase(),
        manual: e.pe11.into_pull_up_input().erase(),
        arc: d.pd12.into_push_pull_output_in_state(low).erase(),
        gas: d.pd13.into_push_pull_output_in_state(low).erase(),
        motion: d.pd14.into_push_pull_output_in_state(low).erase(),
        wire: d.pd15.into_push_pull_output_in_state(low).erase(),
    };
    critical_section::with(|cs| OWNED.borrow_ref_mut(cs).replace(owned));
    let mut watchdog = IndependentWatchdog::new(device.IWDG);
    watchdog.start(500.millis());
    // SAFETY: what the handlers use is in place.
    unsafe {
        core.NVIC.set_priority(pac::Interrupt::USART2, PORT_PRIORITY);
        core.NVIC.set_priority(pac::Interrupt::TIM2, TICK_PRIORITY);
        pac::NVIC::unmask(pac::Interrupt::USART2);
        pac::NVIC::unmask(pac::Interrupt::TIM2);
    }
    (Watchdog(watchdog), entropy)
}

/// A word of the hardware's noise; 0 if it does not come: then the boot count alone tells starts apart.
fn random(noise: &pac::RNG) -> u32 {
    let ready = (0..10_000).any(|_| noise.sr().read().drdy().bit_is_set());
    if ready { noise.dr().read().bits() } else { 0 }
}

/// Makes the transmit interrupt run.
pub fn wake_link() {
    with_owned(|owned| owned.tx.listen());
}

/// Everything off, from any context: one store to the port's reset bits.
pub fn outputs_off() {
    // SAFETY: a write to BSRR changes only the pins named, in one store.
    unsafe { (*pac::GPIOD::ptr()).bsrr().write(|w| w.bits(OUTPUT_PINS << 16)) };
}

/// What an NMI means here: the clock has failed.
pub const NMI_CAUSE: ResetCause = ResetCause::Fault;

/// Whether the watchdog caused this start; asking clears the flag.
pub fn watchdog_fired() -> bool {
    // SAFETY: before `start` nobody owns the register; only the flag's clear bit is written.
    let status = unsafe { (*pac::RCC::ptr()).csr() };
    let fired = status.read().wdgrstf().bit_is_set();
    status.modify(|_, w| w.rmvf().set_bit());
    fired
}

fn with_owned<T>(use_it: impl FnOnce(&mut Owned) -> T) -> Option<T> {
    critical_section::with(|cs| OWNED.borrow_ref_mut(cs).as_mut().map(use_it))
}

#[interrupt]
fn USART2() {
    with_owned(|owned| {
        if owned.rx.is_rx_not_empty() {
            match owned.rx.read() {
                Ok(byte) => serial::LINK.received(byte),
                Err(_) => serial::LINK.overrun(),
            }
        }
        if owned.tx.is_tx_empty() {
            match serial::LINK.next_to_send() {
                // Empty, so it takes the byte.
                Some(byte) => owned.tx.write(byte).unwrap_or(()),
                None => owned.tx.unlisten(),
            }
        }
    });
}

#[interrupt]
fn TIM2() {
    let inputs = with_owned(|owned| {
        owned.timer.clear_flags(Flag::Update);
        Inputs {
            estop: owned.estop.is_high(),
            enable: owned.enable.is_high(),
            reset: owned.reset.is_high(),
            established: owned.established.is_high(),
            manual: owned.manual.is_high(),
        }
    });
    let outputs: Outputs = torch::tick(inputs.unwrap_or(Inputs::SAFE));
    with_owned(|owned| {
        owned.arc.set_state(PinState::from(outputs.arc));
        owned.gas.set_state(PinState::from(outputs.gas));
        owned.motion.set_state(PinState::from(outputs.motion));
        owned.wire.set_state(PinState::from(outputs.wire));
    });
}
