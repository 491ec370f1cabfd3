//! Behaviour across packages; the tests themselves are in `tests/tests/`, what several of them need is here.

pub mod fanuc;
pub mod krl;
pub mod pictures;
pub mod plans;
pub mod rapid;
pub mod robot;
pub mod ros;
pub mod urscript;

pub mod adversary;
pub mod bench;
pub mod browser;
pub mod command;
pub mod in_process;
pub mod qemu;
pub mod simulated;
pub mod world;

use std::path::{Path, PathBuf};

/// A file or folder of the data that lies beside a checkout, `shared/data/`, if it is there.
///
/// It is not part of the repository: a test without it says so and is skipped.
pub fn shared_data(path: &str) -> Option<PathBuf> {
    let beside = |folder: &Path| folder.join("shared/data").join(path);
    let found = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(beside).find(|file| file.exists());
    if found.is_none() {
        println!("skipped: no shared/data/{path} beside the checkout");
    }
    found
}
