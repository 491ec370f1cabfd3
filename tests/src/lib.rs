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
pub mod arm;
pub mod bench;
pub mod browser;
pub mod command;
pub mod in_process;
pub mod markdown;
pub mod page;
pub mod qemu;
pub mod scans;
pub mod simulated;
pub mod solids;
pub mod world;

use std::path::{Path, PathBuf};

/// A file or folder `shared/PATH` that lies beside the checkout or above it, if it is there.
pub fn beside(path: &str) -> Option<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().map(|folder| folder.join("shared").join(path)).find(|file| file.exists())
}

/// A file or folder of the data that lies beside a checkout, `shared/data/PATH`.
///
/// It is not part of the repository: a test that calls this carries `#[cfg_attr(not(shared_data), ignore)]`
/// (`tests/build.rs`), so that it counts as ignored where the data is absent.
///
/// # Panics
/// If the data is there, but not this part of it.
pub fn shared_data(path: &str) -> PathBuf {
    beside(&format!("data/{path}")).unwrap_or_else(|| panic!("no shared/data/{path} beside the checkout"))
}
