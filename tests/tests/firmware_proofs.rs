//! What the firmware cannot do: allocate, and panic inside core. Each proof with a control that must fail.

use std::path::Path;
use std::process::{Command, Output};
use std::{env, fs};

use weldpath_tests::qemu::firmware;

fn link_proof(features: &str) -> Output {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../firmware/build.sh");
    let arguments = ["build", "--release", "--bin", "no_panic", "--features", features];
    Command::new(script).args(arguments).output().expect("runs")
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
    assert!(proof.status.success(), "{}", String::from_utf8_lossy(&proof.stderr));
    let control = link_proof("negative-control");
    let said = String::from_utf8_lossy(&control.stderr).into_owned();
    assert!(!control.status.success() && said.contains("undefined symbol: core_can_panic"), "{said}");
}

#[test]
fn the_firmware_has_no_allocator() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    assert!(!allocates(&program));
    assert!(allocates(&env::current_exe().unwrap()), "this test allocates, and the check has to see it");
}
