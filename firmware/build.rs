//! Gives the linker the board's memory map and the scripts of cortex-m-rt and defmt.

use std::path::PathBuf;
use std::process::Command;
use std::{env, fs};

/// First 32 bits of the commit, in decimal; 0 where there is no repository.
fn build() -> u32 {
    let commit = Command::new("git").args(["rev-parse", "HEAD"]).output().ok();
    let text = commit.filter(|out| out.status.success()).and_then(|out| String::from_utf8(out.stdout).ok());
    println!("cargo:rerun-if-changed=../.git/logs/HEAD");
    text.and_then(|text| u32::from_str_radix(text.get(..8)?, 16).ok()).unwrap_or(0)
}

fn main() {
    let board = if env::var_os("CARGO_FEATURE_STM32F407").is_some() { "stm32f407" } else { "mps2_an386" };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    let map = format!("memory/{board}.x");
    fs::copy(&map, out.join("memory.x")).expect("the board's memory map");
    if board == "mps2_an386" {
        // cortex-m-rt asks a device crate for default handlers; the board module lists every vector itself.
        fs::write(out.join("device.x"), "").expect("OUT_DIR is writable");
    }
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    println!("cargo:rustc-env=WELDPATH_BUILD={}", build());
    println!("cargo:rerun-if-changed={map}");
    println!("cargo:rerun-if-changed=build.rs");
}
