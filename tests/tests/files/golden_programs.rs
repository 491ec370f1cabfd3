//! One short program in every dialect, as it was read line by line against the vendors' manuals.
//!
//! The files in `golden/programs/` change only when a dialect is meant to change, and are then read again; what they do
//! is checked by the dialects' own tests. After such a change: `WELDPATH_GOLDEN=write cargo test --test files golden_programs`.

use std::path::Path;

use weldpath_tests::robot::{output, texts};

const JOB: &str = r#"
formats = ["ur", "abb", "kuka", "fanuc", "ros"]
[selection]
seams = [2]
[path]
points = 5
standoff_mm = 1
[arc]
gas_output = 1
established_input = 0
[program]
tool_number = 3
weld_schedule = 2
[tool]
flange_from_tcp_mm = [0, -50, 300]
flange_from_tcp_rotation_rad = [0, 0.5, 0]
payload_kg = 2.5
"#;

#[test]
fn every_dialect_writes_its_golden_program() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/programs");
    let programs = [".script", ".mod", ".src", ".dat", "_sps.txt", ".ls", "poses.yaml", "poses.json"];
    let files = texts(&output(JOB), &programs);
    assert_eq!(files.len(), programs.len());
    for (name, text) in files {
        let golden = folder.join(&name);
        if std::env::var("WELDPATH_GOLDEN").is_ok_and(|mode| mode == "write") {
            std::fs::write(&golden, &text).unwrap();
        }
        let expected = std::fs::read_to_string(&golden).unwrap();
        let differs = text.lines().zip(expected.lines()).position(|(a, b)| a != b);
        assert!(text == expected, "{name} differs from line {:?} on", differs.map(|line| line + 1));
    }
}
