//! `weldpath evaluate --paper`: its pages are written, and its numbers are those of `weldpath evaluate`.

use serde_json::Value;
use std::path::Path;
use std::process::Output;
use weldpath_tests::command::weldpath;

fn run(args: &[&str]) -> Output {
    weldpath().args(args).output().unwrap()
}

#[test]
fn the_papers_tables_are_made_and_agree_with_evaluate() {
    let home = tempfile::tempdir().unwrap();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures");
    let at = |name: &str| home.path().join(name).display().to_string();
    let fixtures_arg = fixtures.display().to_string();
    let output = run(&[
        "evaluate",
        "--paper",
        "--runs",
        "1",
        "--fixtures",
        &fixtures_arg,
        "--out",
        &at("paper"),
        "--json",
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let measured: Value = serde_json::from_slice(&output.stdout).unwrap();

    for (piece, name) in [("cylinder (fixtures/pipe)", "pipe"), ("lap", "lap")] {
        let input = fixtures.join(name).display().to_string();
        assert!(run(&["plan", &input, "--out", &at(name), "--quiet"]).status.success());
        let truth = fixtures.join(name).join("truth.json").display().to_string();
        let score = run(&["evaluate", &at(name), "--truth", &truth, "--json"]);
        let score: Value = serde_json::from_slice(&score.stdout).unwrap();
        let quiet = run(&["evaluate", &at(name), "--truth", &truth, "--quiet"]);
        assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty());
        let row = measured["rmse"].as_array().unwrap().iter().find(|row| row["piece"] == piece).unwrap();
        for (key, evaluate) in [("rmse_mm", "rmse_p"), ("rmse_deg", "rmse_deg")] {
            let (ours, theirs) = (row[key].as_f64().unwrap(), score[evaluate].as_f64().unwrap());
            assert!((ours - theirs).abs() < 1e-6, "{name} {key}: {ours} {theirs}");
        }
    }
    assert_eq!(measured["runtime"].as_array().unwrap().len(), 8);
    for row in measured["runtime"].as_array().unwrap() {
        let [ms, speed, found_mm] =
            ["mean_ms", "speed_mm_s", "found_mm"].map(|key| row[key].as_f64().unwrap());
        assert!((ms * speed / 1000.0 - found_mm).abs() < 1e-6, "speed is the length found over the time");
        assert!(
            found_mm > 300.0 && found_mm < 501.0,
            "most of the seam's 500 mm, and nothing beside it: {found_mm}"
        );
    }
    for curves in measured["f1"].as_array().unwrap() {
        let lengths = ["thresholds", "before", "after"].map(|key| curves[key].as_array().unwrap().len());
        assert!(lengths[0] > 20 && lengths[0] == lengths[1] && lengths[1] == lengths[2]);
    }
    let page = std::fs::read_to_string(home.path().join("paper/paper.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 3);
    for published in ["3691", "0.86", "1.5", "900"] {
        assert!(page.contains(published), "the paper's {published} stands beside ours");
    }
    for name in ["paper.md", "fitness.svg", "f1_0.svg", "f1_1.svg"] {
        assert!(home.path().join("paper").join(name).is_file(), "{name}");
    }
}

#[test]
fn outside_the_repository_the_hint_names_the_option() {
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| home.path().join(name).display().to_string();
    let output = run(&["evaluate", "--paper", "--fixtures", &at("none"), "--out", &at("out")]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("--fixtures"), "{said}");
    assert!(!home.path().join("out").exists(), "nothing is left behind");
}
