//! The torch-side pendant's firmware.
//!
//! | priority | what | where |
//! |---|---|---|
//! | highest | every 2 ms: read the pins, step the torch, drive the outputs | [`torch::tick`] |
//! | lower | bytes from and to the host's serial line | [`serial`] |
//! | none | decode, answer, feed the watchdog | `main` |
//!
//! No allocator; nothing waits for a transmitter; `unsafe` only in [`board`]. A panic, a fault and a hang all end in
//! outputs off and a reset whose cause is reported.
#![no_std]
#![no_main]

mod board;
mod serial;
mod torch;

use board::ResetCause;
use core::panic::PanicInfo;

#[cortex_m_rt::entry]
fn main() -> ! {
    let boot = board::boot_record();
    let (mut watchdog, entropy) = board::start(&boot);
    let nonce = (entropy ^ boot.count).wrapping_mul(0x9e37_79b9);
    defmt::info!("boot {=u32} after {}, nonce {=u32:x}", boot.count, boot.cause, nonce);
    let mut fed_at = torch::ticks();
    loop {
        while let Some(byte) = serial::LINK.take_received() {
            serial::LINK.send(&[byte]);
        }
        let now = torch::ticks();
        if now != fed_at {
            // Both the tick and this loop are alive.
            watchdog.feed();
            fed_at = now;
        }
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    board::outputs_off();
    if let Some(place) = info.location() {
        defmt::error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    board::reset(ResetCause::Panic)
}
