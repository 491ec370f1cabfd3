//! The torch-side pendant's firmware, shared by the pendant itself (`main.rs`) and the programs that measure it.
//!
//! | priority | what | where |
//! |---|---|---|
//! | highest | bytes from and to the serial lines: microseconds | [`serial`] |
//! | high | every 2 ms: read the pins, step the torch, drive the outputs | [`torch::tick`] |
//! | none | decode, answer, feed the watchdog | [`link`], `main` |
//!
//! No allocator; nothing waits for a transmitter; `unsafe` only in [`board`]. A panic, a fault and a hang all end in
//! outputs off and a reset whose cause is reported.
#![no_std]

pub mod board;
pub mod link;
pub mod serial;
pub mod torch;

use core::panic::PanicInfo;

use board::{Board, Fitted, ResetCause};

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    Fitted::outputs_off();
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    board::reset(ResetCause::Panic)
}
