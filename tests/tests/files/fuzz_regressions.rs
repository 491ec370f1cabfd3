//! Inputs that once failed under fuzzing (`fuzz/`), and the seeds, held against their targets again.

use std::path::Path;

use weldpath_fuzz::{TARGETS, seeds};

#[test]
fn every_seed_is_taken() {
    for (name, target) in TARGETS {
        let seeds = seeds::of(name);
        assert!(!seeds.is_empty(), "{name}");
        seeds.iter().for_each(|bytes| target(bytes));
    }
}

#[test]
fn what_once_failed_no_longer_does() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/regressions");
    let mut held = 0;
    for (name, target) in TARGETS {
        let Ok(entries) = std::fs::read_dir(folder.join(name)) else { continue };
        for entry in entries {
            let path = entry.unwrap().path();
            println!("{}", path.display());
            target(&std::fs::read(&path).unwrap());
            held += 1;
        }
    }
    assert!(held > 0, "no input was held against its target");
}
