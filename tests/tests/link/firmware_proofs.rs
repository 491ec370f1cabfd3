//! What the firmware cannot do: allocate, and panic inside core. Each proof with a control that must fail.

use std::path::Path;
use std::process::Command;
use std::{env, fs};

use weldpath_tests::command::{Ended, end_of};
use weldpath_tests::qemu::firmware;

fn link_proof(features: &str) -> Ended {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../firmware/build.sh");
    let arguments = ["build", "--release", "--bin", "no_panic", "--features", features];
    end_of(Command::new(script).args(arguments))
}

/// Whether a program contains the hooks of Rust's allocator.
fn allocates(program: &Path) -> bool {
    let bytes = fs::read(program).expect("readable");
    ["__rust_alloc", "__rustc14___rust_alloc", "__rdl_alloc"]
        .iter()
        .any(|name| bytes.windows(name.len()).any(|window| window == name.as_bytes()))
}

#[test]
fn no_panic_is_reachable_from_what_the_pendant_runs_of_core() {
    if firmware("weldpath-firmware").is_none() {
        return;
    }
    let proof = link_proof("proof");
    assert_eq!(proof.code, Some(0), "{}", proof.said);
    let control = link_proof("negative-control");
    let lacks_panic = control.said.contains("undefined symbol: core_can_panic");
    assert!(control.code != Some(0) && lacks_panic, "{}", control.said);
}

#[test]
fn the_firmware_has_no_allocator() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    assert!(!allocates(&program));
    assert!(allocates(&env::current_exe().unwrap()), "this test allocates, and the check has to see it");
}
