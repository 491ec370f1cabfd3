//! Tells the tests at build time what lies beside the checkout, so that those which need it are counted as `ignored`
//! where it is absent, and not as passed.
//!
//! `cfg(shared_data)`: `../shared/data`, scans and recordings. `cfg(reference_script)`: `../shared/tools/evaluate.py`
//! and a Python that runs it.

use std::path::{Path, PathBuf};
use std::process::Command;

/// `shared/NAME` beside the checkout or above it.
fn beside(name: &str) -> Option<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().map(|folder| folder.join("shared").join(name)).find(|path| path.exists())
}

fn python_runs_the_reference() -> bool {
    let check = Command::new("python3").args(["-c", "import numpy, scipy"]).output();
    check.is_ok_and(|output| output.status.success())
}

fn main() {
    println!("cargo::rustc-check-cfg=cfg(shared_data, reference_script)");
    // Not the data themselves: cargo would walk all of them at every build, and build all tests anew at every build where
    // they are absent. That the answer is still true is a test of its own (tests/shared_data.rs).
    println!("cargo::rerun-if-changed=build.rs");
    if beside("data").is_some() {
        println!("cargo::rustc-cfg=shared_data");
    } else {
        println!("cargo::warning=no ../shared/data: the tests that need it will be ignored");
    }
    if beside("tools/evaluate.py").is_some() && python_runs_the_reference() {
        println!("cargo::rustc-cfg=reference_script");
    } else {
        println!(
            "cargo::warning=no ../shared/tools/evaluate.py with numpy and scipy: its test will be ignored"
        );
    }
}
