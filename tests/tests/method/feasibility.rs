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
    let mut args = vec!["plan", &input, "--no-report", "--out", out.to_str().unwrap()];
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
    assert!(
        said.contains("links of ur10e are checked only against what was scanned and a floor at z ="),
        "{said}"
    );
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
fn what_the_arm_cannot_run_is_refused_and_written_where_that_is_accepted() {
    let home = tempfile::tempdir().unwrap();
    let far = ["--robot-model", "ur3e", "--robot-base", "-3000,0,0,0,0,0"];
    let (done, said, summary) = planned(home.path(), &far);
    assert!(!done && summary["verdict"]["state"] == "refused", "{said}");
    assert_eq!(summary["feasibility"]["feasible"], false);
    assert!(
        said.contains("infeasible: seam 1: 0 to ")
            && said.contains(" mm along it (waypoints 0 to")
            && said.contains("move the part"),
        "{said}"
    );
    assert!(!home.path().join("path.script").exists() && !home.path().join("path.json").exists());
    let accepted = home.path().join("accepted");
    let (done, said, _) = planned(&accepted, &[far.as_slice(), &["--accept", "infeasible"]].concat());
    assert!(done && said.contains("infeasible (accepted)"), "{said}");
    let replay = home.path().join("again");
    let job = accepted.join("job.toml");
    let output =
        run(&["plan", "--no-report", "--job", job.to_str().unwrap(), "--out", replay.to_str().unwrap()]);
    assert!(output.status.success());
    for name in ["feasibility.csv", "job.toml", "path.json"] {
        let read = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
        assert_eq!(read(&accepted), read(&replay), "{name}");
    }
}

/// The first case of the findings: the elbow stood 178 mm below the arm's base, and the plan was called ready.
#[test]
fn the_cell_with_a_ur10e_keeps_every_link_above_the_floor() {
    let home = tempfile::tempdir().unwrap();
    let (cell, job) = (fixture("cell"), fixture("cell.toml"));
    let out = home.path().to_str().unwrap();
    let output = run(&["plan", &cell, "--no-report", "--job", &job, "--robot-model", "ur10e", "--out", out]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let table = std::fs::read_to_string(home.path().join("feasibility.csv")).unwrap();
    let mut rows = 0;
    for line in table.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let deg = |k: usize| cells[k].parse::<f64>().unwrap().to_radians();
        let (q2, q3) = (deg(5), deg(6));
        // The maker's DH table: d1 = 180.7, a2 = -612.7, a3 = -571.55 mm.
        let elbow_mm = 180.7 - 612.7 * q2.sin();
        let wrist_mm = elbow_mm - 571.55 * (q2 + q3).sin();
        assert!(elbow_mm > 75.0 && wrist_mm > 60.0, "{line}: elbow {elbow_mm} mm, wrist {wrist_mm} mm");
        rows += 1;
    }
    assert!(rows > 100);
    let summary: Value =
        serde_json::from_slice(&std::fs::read(home.path().join("summary.json")).unwrap()).unwrap();
    let reasons: Vec<&str> =
        summary["verdict"]["reasons"].as_array().unwrap().iter().map(|r| r["id"].as_str().unwrap()).collect();
    assert_eq!(reasons, ["first-move-unchecked"]);
}

#[test]
fn the_program_is_for_the_arms_maker_and_another_ones_is_asked_about() {
    let home = tempfile::tempdir().unwrap();
    let (_, said, _) = planned(home.path(), &["--robot-model", "kuka-kr10-r1420"]);
    assert!(home.path().join("weldpath.src").exists() && !home.path().join("path.script").exists(), "{said}");
    assert!(!said.contains("dialect-and-arm-differ"), "{said}");
    let (_, said, _) = planned(home.path(), &["--robot-model", "kuka-kr10-r1420", "--robot", "abb"]);
    assert!(said.contains("dialect-and-arm-differ: the program is for ABB"), "{said}");
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

/// The feasibility of the fillet by what is added to its job, with the files in `out`.
fn checked(out: &Path, settings: &str) -> Value {
    let file = out.with_extension("toml");
    std::fs::write(&file, format!("input = {:?}\n{settings}", fixture("fillet"))).unwrap();
    let [file, folder] = [file.to_str().unwrap(), out.to_str().unwrap()];
    let output =
        run(&["plan", "--job", file, "--out", folder, "--no-report", "--json", "--accept", "infeasible"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice::<Value>(&output.stdout).unwrap()["feasibility"].clone()
}

/// The job with a torch that leans into the web, its passes and its turn given.
fn leaning(home: &Path, work_angle_deg: f64, turn_deg: f64, passes: usize) -> Value {
    let torch = format!("[torch]\nwork_angle_deg = {work_angle_deg}\nturn_deg = {turn_deg}\n[torch_body]\n");
    checked(&home.join("lean"), &(torch + &"[[pass]]\n".repeat(passes)))
}

#[test]
fn a_suggestion_solves_what_it_says_for_every_turn_and_number_of_passes() {
    let home = tempfile::tempdir().unwrap();
    for (turn_deg, passes) in [(0.0, 1), (180.0, 1), (90.0, 2), (0.0, 2)] {
        let before = leaning(home.path(), 18.0, turn_deg, passes);
        assert_eq!(before["feasible"], false, "turn {turn_deg}");
        let words = before["suggestions"][0].as_str().unwrap_or_default();
        let change = words.split("work angle by ").nth(1).and_then(|rest| rest.split(' ').next());
        let deg: f64 =
            change.unwrap_or_else(|| panic!("turn {turn_deg}, {passes} passes: {before}")).parse().unwrap();
        let after = leaning(home.path(), 18.0 + deg, turn_deg, passes);
        assert_eq!(after["feasible"], true, "turn {turn_deg}, {passes} passes, {words}: {after}");
    }
}

#[test]
fn every_pass_is_checked_at_its_own_feed() {
    let home = tempfile::tempdir().unwrap();
    let arm = "[robot]\nfloor_z_mm = \"none\"\n[robot.opw]\na1_mm = 150\na2_mm = 0\nc1_mm = 486.5\nc2_mm = 700\nc3_mm = 600\nc4_mm = 65\n\
               offsets_deg = [0, 0, -90, 0, 0, 0]\nlimits_deg = [[-180, 180], [-180, 180], [-245, 245], \
               [-400, 400], [-180, 180], [-400, 400]]\nspeeds_deg_s = [12, 12, 12, 12, 12, 12]\n\
               [path]\napproach_feed_mm_s = 2\nair_feed_mm_s = 2\n";
    let too_fast = |passes: &str| {
        let out = home.path().join("feeds");
        let report = checked(&out, &format!("{arm}{passes}"));
        let program: Value = serde_json::from_slice(&std::fs::read(out.join("path.json")).unwrap()).unwrap();
        let rows = std::fs::read_to_string(out.join("feasibility.csv")).unwrap().lines().count();
        assert_eq!(rows, 1 + program["waypoints"].as_array().unwrap().len());
        let problems = report["problems"].as_array().unwrap();
        problems.iter().filter(|p| p["kind"] == "joint-speed" && !p["seam"].is_null()).count()
    };
    let fast = too_fast("[[pass]]\npath.feed_mm_s = 250\n");
    assert!(fast > 0);
    let slow = too_fast("[[pass]]\npath.feed_mm_s = 2\npath.approach_mm = 20\n");
    assert_eq!(slow, 0);
    let both =
        too_fast("[[pass]]\npath.feed_mm_s = 2\npath.approach_mm = 20\n[[pass]]\npath.feed_mm_s = 250\n");
    assert!(both > 0, "the slow pass before it makes the fast one no slower");
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
        (vec!["--robot-model", "ur5e", "--robot-base", "0,0,0,1.6,0,0"], "floor_z_mm"),
    ] {
        let (done, said, _) = planned(home.path(), &extra);
        assert!(!done && said.contains(word), "{extra:?}: {said}");
    }
}
