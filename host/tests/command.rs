//! The command as a script sees it: exit codes, messages, and nothing left behind by a failure.

use std::path::Path;
use std::process::{Command, Output};

fn weldpath(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_weldpath")).args(arguments).current_dir(folder).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// A folder with a flat patch of points: an input without a seam.
fn home() -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    let rows = (0..60).flat_map(|i| (0..60).map(move |j| format!("{i} {j} 0\n")));
    std::fs::write(home.path().join("flat.xyz"), rows.collect::<String>()).unwrap();
    home
}

#[test]
fn wrong_usage_is_2_and_says_what_is_right() {
    let home = home();
    for (arguments, part) in [
        (vec![], "weldpath --help"),
        (vec!["plan"], "INPUT"),
        (vec!["plan", "flat.xyz", "--feed-mm-s", "nan"], "0.1 to 250 mm/s"),
        (vec!["plan", "flat.xyz", "--feed-mm-s", "0"], "at least 0.1 mm/s"),
        (vec!["plan", "flat.xyz", "--spacing-mm", "-2"], "at least 0.1 mm"),
        (vec!["plan", "flat.xyz", "--approach-mm", "1e9"], "at most 500 mm"),
        (vec!["plan", "flat.xyz", "--points", "2.5"], "whole"),
        (vec!["plan", "flat.xyz", "--points", "9", "--spacing-mm", "2"], "cannot be used with"),
        (vec!["plan", "flat.xyz", "--near", "1,2"], "three"),
        (vec!["plan", "flat.xyz", "--roi", "0,0,0"], "two corners"),
        (vec!["plan", "flat.xyz", "--t", "60"], "--method paper"),
        (vec!["plan", "flat.xyz", "--arc-output", "8"], "at most 7"),
        (vec!["plan", "flat.xyz", "--units", "inch"], "possible values"),
    ] {
        let output = weldpath(home.path(), &arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(part), "{arguments:?}: {}", stderr(&output));
    }
}

#[test]
fn a_job_file_with_a_slip_is_2_with_the_line_and_the_right_name() {
    let home = home();
    std::fs::write(home.path().join("job.toml"), "input = \"flat.xyz\"\n[path]\nfeed_mm_min = 480\n")
        .unwrap();
    let output = weldpath(home.path(), &["plan", "--job", "job.toml"]);
    assert_eq!(output.status.code(), Some(2));
    for part in ["job.toml:3", "feed_mm_min", "did you mean `feed_mm_s`?"] {
        assert!(stderr(&output).contains(part), "{}", stderr(&output));
    }
}

#[test]
fn an_input_that_cannot_be_read_is_4_and_named() {
    let home = home();
    std::fs::write(home.path().join("torn.ply"), "ply\nformat ascii 1.0\nelement vertex 9\n").unwrap();
    for input in ["nowhere", "torn.ply"] {
        let output = weldpath(home.path(), &["plan", input]);
        assert_eq!(output.status.code(), Some(4), "{input}");
        assert!(stderr(&output).contains(input));
    }
}

#[test]
fn an_output_that_cannot_be_written_is_5_before_any_work() {
    let home = home();
    let output = weldpath(home.path(), &["plan", "flat.xyz", "--out", "flat.xyz/out"]);
    assert_eq!(output.status.code(), Some(5), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("flat.xyz/out") && stderr(&output).contains("--out"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn a_flat_plate_is_3_and_leaves_what_was_seen_only() {
    let home = home();
    for more in [vec!["--no-report"], vec![], vec!["--quiet"], vec!["--json"]] {
        let output = weldpath(home.path(), &[&["plan", "flat.xyz"], more.as_slice()].concat());
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        assert!(stderr(&output).starts_with("error: no seam found: "), "{}", stderr(&output));
        assert!(output.stdout.is_empty());
        let mut left: Vec<_> = std::fs::read_dir(home.path().join("out"))
            .map(|files| files.map(|file| file.unwrap().file_name()).collect())
            .unwrap_or_default();
        left.sort();
        match more[..] {
            ["--no-report"] => assert!(left.is_empty(), "{left:?}"),
            _ => assert_eq!(left, ["report.html", "report.svg", "summary.json", "weldpath-manifest.json"]),
        }
    }
}

#[test]
fn nothing_but_the_message_is_printed_without_a_terminal() {
    let home = home();
    let output = weldpath(home.path(), &["plan", "flat.xyz"]);
    assert!(!stderr(&output).contains('\u{1b}'), "no bar, no colour: {}", stderr(&output));
}

#[test]
fn a_simulated_scan_is_read_by_plan() {
    let home = home();
    let simulate = ["simulate", "--part", "box", "--views", "2", "--size", "320x240", "--out", "scan"];
    let output = weldpath(home.path(), &simulate);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("2 views, 0 seams"));
    for file in ["scan.json", "truth.json", "view_000.png", "view_001.png"] {
        assert!(home.path().join("scan").join(file).exists(), "{file}");
    }
    let output = weldpath(home.path(), &["plan", "scan", "--quiet"]);
    assert_eq!(output.status.code(), Some(3), "a box has no seam: {}", stderr(&output));
}

/// Printed by a command that ends well.
fn printed(folder: &Path, arguments: &[&str]) -> String {
    let output = weldpath(folder, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn with_what_is_known_of_its_cell_a_simulated_scan_is_ready_and_without_it_says_both_errors() {
    let home = home();
    printed(home.path(), &["simulate", "--part", "fillet", "--size", "320x240", "--out", "scan"]);
    let known = printed(home.path(), &["plan", "--job", "scan/cell.toml"]);
    assert!(known.starts_with("verdict: ready\n") && !known.contains("voxel_mm"), "{known}");
    let evaluated = printed(home.path(), &["evaluate", "out", "--truth", "scan/truth.json"]);
    assert!(
        evaluated
            .lines()
            .any(|line| line.starts_with("stated by the plan ") && line.contains("within the scan")),
        "{evaluated}"
    );
    let unknown = printed(home.path(), &["plan", "scan", "--verbose"]);
    assert!(unknown.starts_with("verdict: check") && unknown.contains("voxel_mm = "), "{unknown}");
    let reason = unknown.lines().find(|line| line.starts_with("base-error-over-limit")).expect("a reason");
    assert!(reason.contains("mm within the scan"), "{reason}");
    // A cell whose errors are known states them.
    let cell = [
        "simulate",
        "--part",
        "fillet",
        "--size",
        "320x240",
        "--out",
        "off",
        "--hand-eye-mm",
        "0.4",
        "--robot-mm",
        "0.1",
    ];
    printed(home.path(), &cell);
    let job = std::fs::read_to_string(home.path().join("off/cell.toml")).unwrap();
    assert!(
        job.contains("hand_eye_mm = 0.4") && job.contains("robot_mm = 0.1") && !job.contains("anchor"),
        "{job}"
    );
    assert!(printed(home.path(), &["plan", "--job", "off/cell.toml"]).starts_with("verdict: "));
}

#[test]
fn a_scan_that_was_not_simulated_is_never_overwritten() {
    let home = home();
    std::fs::write(home.path().join("scan.json"), "precious").unwrap();
    let output = weldpath(home.path(), &["simulate", "--part", "box", "--out", "."]);
    assert_eq!(output.status.code(), Some(5));
    assert_eq!(std::fs::read_to_string(home.path().join("scan.json")).unwrap(), "precious");
}

#[test]
fn a_part_or_size_that_is_not_known_is_2_with_the_choices() {
    let home = home();
    for (option, value, part) in
        [("--part", "tee", "fillet"), ("--size", "big", "640x480"), ("--views", "0", "views")]
    {
        let arguments = ["simulate", "--out", "s", option, value, "--part", "box"];
        let count = if option == "--part" { 5 } else { 7 };
        let output = weldpath(home.path(), &arguments[..count]);
        assert_eq!(output.status.code(), Some(2), "{option} {value}");
        assert!(stderr(&output).contains(part), "{}", stderr(&output));
    }
}

#[test]
fn a_path_that_is_the_truth_scores_full_marks() {
    let home = home();
    let simulate = ["simulate", "--part", "fillet", "--views", "2", "--size", "160x120", "--out", "scan"];
    assert!(weldpath(home.path(), &simulate).status.success());
    let truth: serde_json::Value =
        serde_json::from_slice(&std::fs::read(home.path().join("scan/truth.json")).unwrap()).unwrap();
    let mut csv = "seam,x_mm,y_mm,z_mm\n".to_owned();
    for seam in truth["seams"].as_array().unwrap() {
        for p in seam["p"].as_array().unwrap() {
            csv += &format!("{},{},{},{}\n", seam["name"], p[0], p[1], p[2]);
        }
    }
    std::fs::write(home.path().join("path.csv"), csv).unwrap();
    let arguments = ["evaluate", "path.csv", "--truth", "scan/truth.json"];
    let json = weldpath(home.path(), &[arguments.as_slice(), &["--json"]].concat());
    let scores: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert!(scores["rmse_p"].as_f64().unwrap() < 1e-3, "{scores}");
    assert_eq!((scores["coverage"].as_f64(), scores["false_frac"].as_f64()), (Some(1.0), Some(0.0)));
    let table = weldpath(home.path(), &arguments);
    assert!(String::from_utf8_lossy(&table.stdout).contains("coverage               100.0 %"));
}

#[test]
fn the_summary_says_whose_frame_the_path_is_in() {
    let home = home();
    let frame = |input: &str| {
        let planned = weldpath(home.path(), &["plan", input, "--json", "--no-report"]);
        let summary: serde_json::Value =
            serde_json::from_slice(&planned.stdout).unwrap_or_else(|_| panic!("{}", stderr(&planned)));
        summary["frame"].as_str().unwrap().to_owned()
    };
    let simulate = ["simulate", "--part", "fillet", "--views", "4", "--out", "scan"];
    assert!(weldpath(home.path(), &simulate).status.success());
    assert_eq!(frame("scan"), "base");
    assert_eq!(frame("out/model.ply"), "unknown", "a cloud that was merged elsewhere");
}

#[test]
fn a_path_in_the_cameras_frame_says_so_in_every_file_and_moves_no_robot() {
    let home = home();
    let simulate = ["simulate", "--part", "fillet", "--views", "1", "--out", "scan"];
    assert!(weldpath(home.path(), &simulate).status.success());
    // With no pose but the identity the model is a cloud in the frame of its camera.
    let file = home.path().join("scan/scan.json");
    let mut scan: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    scan["flange_from_camera"] = serde_json::json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    scan["views"][0]["base_from_flange"] = serde_json::json!([0, 0, 0, 0, 0, 0]);
    std::fs::write(&file, scan.to_string()).unwrap();
    weldpath(home.path(), &["plan", "scan", "--quiet", "--out", "seen"]);
    let cloud = ["plan", "seen/model.ply", "--frame", "camera"];
    let text = |name: &str| std::fs::read(home.path().join("out").join(name)).unwrap_or_default();
    let says = |name: &str, words: &str| String::from_utf8_lossy(&text(name)).contains(words);
    assert_eq!(weldpath(home.path(), &cloud).status.code(), Some(8));
    assert!(text("path.json").is_empty() && text("path.script").is_empty(), "no program");
    let accepted = [&cloud[..], &["--accept", "camera-frame"]].concat();
    assert!(weldpath(home.path(), &accepted).status.success());
    assert!(says("path.json", "\"frame\": \"camera\"") && says("summary.json", "\"frame\": \"camera\""));
    assert!(says("model.ply", "the camera's frame") && says("report.html", "\"frame\":\"camera\""));
    assert!(says("path.csv", ",frame\n") && says("path.csv", ",camera\n"));
    let scored = weldpath(home.path(), &["evaluate", "out", "--truth", "scan/truth.json"]);
    assert!(scored.status.success(), "{}", stderr(&scored));
    let streamed = weldpath(home.path(), &["stream", "out", "--port", "none"]);
    assert!(streamed.status.code() == Some(4) && stderr(&streamed).contains("camera's frame"));
}

#[test]
fn a_stated_frame_is_taken_where_the_file_is_silent_and_refused_where_it_is_not() {
    let home = home();
    let simulate = ["simulate", "--part", "fillet", "--views", "4", "--out", "scan"];
    assert!(weldpath(home.path(), &simulate).status.success());
    assert!(weldpath(home.path(), &["plan", "scan"]).status.success());
    let stated = ["plan", "out/model.ply", "--frame", "base", "--json", "--no-report", "--out", "again"];
    let planned = weldpath(home.path(), &stated);
    let summary: serde_json::Value = serde_json::from_slice(&planned.stdout).unwrap();
    assert_eq!(summary["frame"], "base");
    let job = std::fs::read_to_string(home.path().join("again/job.toml")).unwrap();
    assert!(job.contains("frame = \"base\""), "{job}");
    let refused = weldpath(home.path(), &["plan", "scan", "--frame", "camera"]);
    assert!(refused.status.code() == Some(4) && stderr(&refused).contains("its poses put the views"));
    let agreed = weldpath(home.path(), &["plan", "scan", "--frame", "base", "--out", "agreed"]);
    assert!(agreed.status.success(), "{}", stderr(&agreed));
}

#[test]
fn a_truth_that_cannot_be_read_is_4() {
    let home = home();
    std::fs::write(home.path().join("path.csv"), "x_mm,y_mm,z_mm\n1,2,3\n").unwrap();
    std::fs::write(home.path().join("truth.json"), "{").unwrap();
    for truth in ["none.json", "truth.json"] {
        let output = weldpath(home.path(), &["evaluate", "path.csv", "--truth", truth]);
        assert_eq!(output.status.code(), Some(4));
        assert!(stderr(&output).contains(truth), "{}", stderr(&output));
    }
}
