//! `weldpath plan --robot-model`: what a user gets from the command line and from a job file.

use serde_json::Value;
use std::path::Path;
use std::process::Output;
use weldpath_tests::command::weldpath;

fn run(args: &[&str]) -> Output {
    weldpath().args(args).output().unwrap()
}

fn fixture(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures").join(name).display().to_string()
}

fn planned(out: &Path, extra: &[&str]) -> (bool, String, Value) {
    let input = fixture("fillet");
    let mut args = vec!["plan", &input, "--out", out.to_str().unwrap()];
    args.extend(extra);
    let output = run(&args);
    let said =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    let summary = std::fs::read(out.join("summary.json")).unwrap_or_default();
    (output.status.success(), said, serde_json::from_slice(&summary).unwrap_or_default())
}

#[test]
fn an_arm_that_reaches_is_said_so_and_its_joints_are_written() {
    let home = tempfile::tempdir().unwrap();
    let (done, said, summary) = planned(home.path(), &["--robot-model", "ur10e"]);
    assert!(done, "{said}");
    assert_eq!(summary["feasibility"]["robot"], "ur10e");
    assert_eq!(summary["feasibility"]["feasible"], true, "{said}");
    let table = std::fs::read_to_string(home.path().join("feasibility.csv")).unwrap();
    let program: Value =
        serde_json::from_slice(&std::fs::read(home.path().join("path.json")).unwrap()).unwrap();
    assert_eq!(table.lines().count(), 1 + program["waypoints"].as_array().unwrap().len());
    assert!(table.lines().skip(1).all(|line| line.split(',').count() == 15 && line.contains(",true,")));
}

#[test]
fn a_far_base_ends_well_with_a_warning_that_names_seam_and_waypoints() {
    let home = tempfile::tempdir().unwrap();
    let (done, said, summary) =
        planned(home.path(), &["--robot-model", "ur3e", "--robot-base", "-3000,0,0,0,0,0"]);
    assert!(done, "infeasible is a warning: {said}");
    assert_eq!(summary["feasibility"]["feasible"], false);
    assert!(said.contains("warning: seam 1, waypoints 0 to") && said.contains("move the part"), "{said}");
    let replay = home.path().join("again");
    let job = home.path().join("job.toml");
    let output = run(&["plan", "--job", job.to_str().unwrap(), "--out", replay.to_str().unwrap()]);
    assert!(output.status.success());
    for name in ["feasibility.csv", "job.toml", "path.json"] {
        let read = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
        assert_eq!(read(home.path()), read(&replay), "{name}");
    }
}

#[test]
fn a_torch_too_wide_for_the_corner_collides() {
    let home = tempfile::tempdir().unwrap();
    let wide = "stickout_mm=5,nozzle_radius_mm=20,body_radius_mm=40";
    let (done, said, summary) = planned(home.path(), &["--torch", wide]);
    assert!(done, "{said}");
    assert_eq!(summary["feasibility"]["robot"], Value::Null);
    let kinds: Vec<&str> = summary["feasibility"]["problems"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|p| p["kind"].as_str())
        .collect();
    assert!(kinds.contains(&"collision"), "{said}");
}

#[test]
fn without_a_robot_or_a_torch_nothing_is_checked() {
    let home = tempfile::tempdir().unwrap();
    let (done, _, summary) = planned(home.path(), &[]);
    assert!(done && summary["feasibility"].is_null() && !home.path().join("feasibility.csv").exists());
}

#[test]
fn what_makes_no_sense_is_refused_with_a_way_out() {
    let home = tempfile::tempdir().unwrap();
    for (extra, word) in [
        (vec!["--robot-model", "ur6e"], "did you mean"),
        (vec!["--robot-base", "0,0,0,0,0,0"], "--robot-model"),
        (vec!["--robot-model", "ur5e", "--robot-base", "1,2,3"], "six"),
        (vec!["--torch", "nozzle=3"], "nozzle_radius_mm"),
    ] {
        let (done, said, _) = planned(home.path(), &extra);
        assert!(!done && said.contains(word), "{extra:?}: {said}");
    }
}
