//! The committed scans are what `fixtures/README.md` says they are, and small.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weldpath::evaluation::Truth;
use weldpath::simulation::{CellErrors, Request, simulate, write};

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures")
}

/// Folder and request of every `weldpath simulate` line in the README.
fn documented() -> Vec<(String, Request)> {
    let text = std::fs::read_to_string(fixtures().join("README.md")).expect("fixtures/README.md");
    text.lines().filter_map(|line| line.strip_prefix("weldpath simulate ")).map(request).collect()
}

fn request(arguments: &str) -> (String, Request) {
    let words: Vec<&str> = arguments.split_whitespace().collect();
    let options: BTreeMap<&str, &str> = words.chunks(2).map(|pair| (pair[0], pair[1])).collect();
    let mut request = Request::new(options["--part"].parse().expect("a part"), 0);
    let mut folder = String::new();
    for (name, value) in options {
        match name {
            "--part" => {}
            "--out" => folder = value.trim_start_matches("fixtures/").into(),
            "--noise" => request.noise = value.parse().expect("a noise"),
            "--seed" => request.seed = value.parse().expect("a seed"),
            "--views" => request.views = Some(value.parse().expect("a count")),
            "--length-mm" => request.length_mm = Some(value.parse().expect("a length")),
            "--robot-mm" => cell(&mut request).robot_mm = value.parse().expect("a length"),
            "--robot-deg" => cell(&mut request).robot_deg = value.parse().expect("an angle"),
            "--hand-eye-mm" => cell(&mut request).hand_eye_mm = value.parse().expect("a length"),
            "--hand-eye-deg" => cell(&mut request).hand_eye_deg = value.parse().expect("an angle"),
            _ => panic!("README uses {name}, which this test does not know"),
        }
    }
    (folder, request)
}

fn cell(request: &mut Request) -> &mut CellErrors {
    request.cell.get_or_insert_with(CellErrors::default)
}

/// Name and bytes of every file in a folder.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let file = |entry: std::fs::DirEntry| {
        (entry.file_name().to_string_lossy().into_owned(), std::fs::read(entry.path()).expect("a file"))
    };
    entries.map(|entry| file(entry.expect("an entry"))).collect()
}

#[test]
fn the_documented_commands_make_the_committed_bytes() {
    let scratch = tempfile::tempdir().expect("a folder");
    for (name, request) in documented() {
        let fresh = scratch.path().join(&name);
        write(&simulate(&request).expect("a scan"), &fresh).expect("a folder");
        let (fresh, committed) = (contents(&fresh), contents(&fixtures().join(&name)));
        let names = |files: &BTreeMap<String, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&fresh), names(&committed), "{name}");
        for (file, bytes) in &fresh {
            assert!(*bytes == committed[file], "{name}/{file} differs from what its command makes");
        }
    }
}

#[test]
fn every_folder_has_its_command() {
    let mut commanded: Vec<String> = documented().into_iter().map(|(name, _)| name).collect();
    commanded.sort();
    let entries = std::fs::read_dir(fixtures()).expect("fixtures/").map(|entry| entry.expect("an entry"));
    let mut folders: Vec<String> = entries
        .filter(|entry| entry.path().join("scan.json").is_file())
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    folders.sort();
    assert!(!folders.is_empty());
    assert_eq!(folders, commanded);
}

#[test]
fn the_simulated_scans_stay_under_8_mb_in_all() {
    let size = |name: &String| contents(&fixtures().join(name)).values().map(Vec::len).sum::<usize>();
    let total: usize = documented().iter().map(|(name, _)| size(name)).sum();
    assert!(total > 1_000_000 && total < 8_000_000, "{total} bytes");
}

#[test]
fn all_but_the_plate_have_a_required_seam_that_is_seen() {
    for (name, _) in documented() {
        let truth = Truth::read(&fixtures().join(&name).join("truth.json")).expect("a truth");
        let seen = |seam: &&weldpath::evaluation::TruthSeam| seam.required && seam.visible_count() > 50;
        assert_eq!(truth.seams.iter().any(|seam| seen(&seam)), name != "plate", "{name}");
    }
}
