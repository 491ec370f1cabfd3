//! `firmware/bring_up.py`: a person's measurements are judged, and the protocol says what was found. No board was measured here.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// Runs it with these answers; its exit code and the protocol.
fn bring_up(folder: &Path, answers: &str) -> (Option<i32>, String) {
    let protocol = folder.join("protocol.md");
    let mut child = Command::new("python3")
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/../firmware/bring_up.py"))
        .arg(&protocol)
        .args(["--by", "a test"])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("python3");
    child.stdin.take().expect("piped").write_all(answers.as_bytes()).expect("listens");
    let code = child.wait().expect("ends").code();
    (code, std::fs::read_to_string(protocol).expect("a protocol"))
}

/// What a board as it should be measures.
const RIGHT: [&str; 21] = [
    "3.3", "0.1", "0", "2.83", "4,0001", "12", "1.2", "1.9", "24", "6.5", "0", "0", "11", "27", "0.2", "1",
    "0", "0", "108", "204", "2.0",
];

#[test]
fn a_board_passes_by_its_figures_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let (code, protocol) = bring_up(folder.path(), &RIGHT.join("\n"));
    assert_eq!(code, Some(0), "{protocol}");
    assert!(protocol.contains("all passed") && !protocol.contains("NOT PASSED"), "{protocol}");
    // One figure at a time beyond its bounds, and what is no number asked for again.
    for (at, wrong) in [(3, "2.4"), (5, "90"), (9, "12"), (13, "80"), (16, "3"), (15, "0")] {
        let mut answers = RIGHT;
        answers[at] = wrong;
        let (code, protocol) = bring_up(folder.path(), &format!("what?\nnan\n{}", answers.join("\n")));
        assert_eq!(code, Some(1), "{at}: {wrong}");
        assert_eq!(protocol.matches("NOT PASSED").count(), 1, "{protocol}");
        assert!(protocol.contains("1 of 21 not passed"), "{protocol}");
    }
}

#[test]
fn what_was_not_measured_has_not_passed() {
    let folder = tempfile::tempdir().expect("a folder");
    let (code, protocol) = bring_up(folder.path(), "3.3\nskip no clip fits\n0\nstop\n");
    assert_eq!(code, Some(1));
    assert!(protocol.contains("skip no clip fits") && protocol.contains("not measured"), "{protocol}");
    assert!(protocol.contains("19 of 21 not passed"), "{protocol}");
}
