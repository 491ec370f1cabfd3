//! The rules of the tree, and that its documents are true.

mod architecture;
mod documents;
mod guide;
mod readme;
mod shared_data;

use std::path::{Path, PathBuf};

/// Sources of the host's crates.
const HOST: [&str; 7] = [
    "host/files/src",
    "host/method/src",
    "host/sim/src",
    "host/job/src",
    "host/pendant/src",
    "host/lab/src",
    "host/src",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the workspace")
}

fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All Rust files below a folder of the workspace.
fn sources(folder: &str) -> Vec<PathBuf> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                walk(&path, found);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    walk(&root().join(folder), &mut found);
    found.sort();
    assert!(!found.is_empty(), "{folder} holds no Rust file");
    found
}

/// Sources of core and host.
fn product() -> Vec<PathBuf> {
    ["core/src"].iter().chain(&HOST).flat_map(|folder| sources(folder)).collect()
}
