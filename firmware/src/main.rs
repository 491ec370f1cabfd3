//! The pendant: sets up the board, then decodes and answers for ever. See the library for the whole.
#![no_std]
#![no_main]

use weldpath_firmware::board::{self, Board, Fitted, Watchdog};
use weldpath_firmware::link::Link;
use weldpath_firmware::torch;

#[cortex_m_rt::entry]
fn main() -> ! {
    board::guard_stack();
    let boot = board::boot_record();
    let (mut watchdog, entropy, straps) = Fitted::start(&boot);
    let nonce = (entropy ^ boot.count).wrapping_mul(0x9e37_79b9);
    defmt::info!("boot {=u32} after {}, nonce {=u32:x}", boot.count, boot.cause, nonce);
    torch::install(nonce, straps);
    let mut link = Link::new();
    let mut fed_at = torch::ticks();
    loop {
        link.turn();
        let now = torch::ticks();
        if now != fed_at {
            // Both the tick and this loop are alive.
            watchdog.feed();
            fed_at = now;
        }
        cortex_m::asm::wfi();
    }
}
