//! The torch-side pendant, from the host's end: its line, the session over it, its firmware in an emulator, and hands that
//! guide the camera through it.
#![forbid(unsafe_code)]

#[cfg(unix)]
pub mod emulator;
pub mod link;
pub mod serial;
pub mod teleop;
