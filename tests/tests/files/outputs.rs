//! The files of a run agree with the plan and with each other.

use std::path::Path;

use nalgebra::Point3;
use weldpath::evaluation::{Options, PathSet, score};
use weldpath::files;
use weldpath::output::json;
use weldpath::run::job::Job;
use weldpath::run::postprocessing::{MOST_POINTS, Output, postprocess};
use weldpath::simulation::{Part, Request, stage};
use weldpath_tests::plans;

fn output(job: &str) -> Output {
    let job = Job::parse(job, Path::new("job.toml")).unwrap();
    postprocess(&plans::pipe_and_bend(), &job, Default::default()).unwrap()
}

fn text(output: &Output, name: &str) -> String {
    let file = output.files.iter().find(|file| file.name == name).unwrap();
    String::from_utf8(file.bytes.clone()).unwrap()
}

/// Rows of path.csv by column name.
fn column(csv: &str, name: &str) -> Vec<f64> {
    let mut lines = csv.lines();
    let index = lines.next().unwrap().split(',').position(|column| column == name).unwrap();
    lines.map(|line| line.split(',').nth(index).unwrap().parse().unwrap()).collect()
}

#[test]
fn path_csv_has_the_documented_columns_and_lies_on_the_seams() {
    let csv = text(&output(""), "path.csv");
    assert_eq!(csv.lines().next(), Some("seam,index,s_mm,x_mm,y_mm,z_mm,qw,qx,qy,qz"));
    let [seam, x, y, z] = ["seam", "x_mm", "y_mm", "z_mm"].map(|name| column(&csv, name));
    for i in 0..seam.len() {
        let off_mm = if seam[i] == 1.0 {
            (x[i].hypot(y[i]) - 20.0).abs()
        } else {
            let [cx, cy, _] = plans::CORNER_MM;
            (y[i] - cy).abs().min((x[i] - cx).abs())
        };
        assert!(off_mm < 1e-3 && z[i].abs() < 1e-4, "row {i} is {off_mm} mm off");
    }
    let [cx, cy, _] = plans::CORNER_MM;
    assert!((0..x.len()).any(|i| (x[i] - cx).hypot(y[i] - cy) < 1e-4), "the corner is a waypoint");
}

#[test]
fn torch_axes_in_path_csv_point_out_of_the_work() {
    let csv = text(&output(""), "path.csv");
    let [w, x, y, z] = ["qw", "qx", "qy", "qz"].map(|name| column(&csv, name));
    for i in 0..w.len() {
        let n_z = 1.0 - 2.0 * (x[i] * x[i] + y[i] * y[i]);
        let norm = (w[i] * w[i] + x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
        assert!(n_z > 0.5 && (norm - 1.0).abs() < 1e-8, "row {i}");
    }
}

#[test]
fn standoff_lifts_every_point_along_its_own_axis() {
    let csv = text(&output("[path]\nstandoff_mm = 10\n[selection]\nseams = [1]"), "path.csv");
    let [x, y, z] = ["x_mm", "y_mm", "z_mm"].map(|name| column(&csv, name));
    let rise = 10.0 * 0.5f64.sqrt();
    for i in 0..x.len() {
        assert!((x[i].hypot(y[i]) - 20.0 - rise).abs() < 1e-3 && (z[i] - rise).abs() < 1e-3);
    }
}

#[test]
fn path_json_read_back_is_the_program() {
    let output = output("");
    let (back, _) = json::read(&text(&output, "path.json")).unwrap();
    assert_eq!(back.len(), output.program.waypoints.len());
    for (a, b) in back.iter().zip(&output.program.waypoints) {
        assert!((a.position_mm - b.position_mm).norm() < 1e-5);
        assert!(a.base_from_torch.angle_to(&b.base_from_torch) < 1e-6);
        assert_eq!((a.weld, a.seam, a.kind, a.feed_mm_s), (b.weld, b.seam, b.kind, b.feed_mm_s));
    }
    let welds: Vec<Point3<f64>> = back.iter().filter(|w| w.weld).map(|w| w.position_mm).collect();
    let csv = text(&output, "path.csv");
    assert_eq!(welds.len(), csv.lines().count() - 1, "path.csv holds the seam points and no others");
}

#[test]
fn air_moves_over_the_safe_level_stay_above_the_pipe() {
    let output = output("[order]\nair = \"safe-level\"\n[path]\nclearance_mm = 25");
    let air: Vec<f64> = output
        .program
        .waypoints
        .windows(2)
        .filter(|w| !w[0].weld && w[1].seam.is_none())
        .map(|w| w[1].position_mm.z)
        .collect();
    assert!(!air.is_empty() && air.iter().all(|z| (z - 105.0).abs() < 1e-6), "{air:?}");
}

#[test]
fn a_perfect_plan_scores_full_marks_through_path_csv() {
    for part in [Part::Pipe, Part::Fillet, Part::Saddle, Part::Branch] {
        let truth = stage(&Request::new(part, 7)).unwrap().truth;
        let job = Job::parse("[path]\nstandoff_mm = 12", Path::new("job.toml")).unwrap();
        let output = postprocess(&plans::of_truth(&truth), &job, Default::default()).unwrap();
        let paths = PathSet::parse(text(&output, "path.csv").as_bytes(), Path::new("path.csv")).unwrap();
        let score = score(&paths, &truth, &Options { standoff_mm: 12.0, ..Options::default() });
        let (off_mm, off_deg) = (score.rmse_mm.unwrap(), score.rmse_deg.unwrap());
        assert!(off_mm < 0.01 && off_deg < 0.1, "{part}: {off_mm} mm, {off_deg} deg");
        assert_eq!(score.false_share, 0.0, "{part}");
        assert!(score.coverage > 0.99, "{part}: {}", score.coverage);
    }
}

#[test]
fn the_effective_job_replays_to_the_same_bytes() {
    let first = output("[path]\nfeed_mm_s = 6\npoints = 50\n[selection]\nseams = [2]");
    let again = output(&text(&first, "job.toml"));
    for (a, b) in first.files.iter().zip(&again.files) {
        assert_eq!(a.name, b.name);
        assert!(a.bytes == b.bytes, "{} differs", a.name);
    }
}

/// Everything the vocabulary can say at once.
const ALL: &str = r#"
[order]
up = [0, 1, 0]
[path]
points = 70
direction = "up"
extend_end_mm = 6
lead_in_mm = 8
end_dwell_s = 0.4
corner = "blend"
[torch]
work_angle_deg = 7
travel_angle_deg = -9
turn_deg = 45
[weave]
shape = "triangle"
frequency_hz = 1.5
dwell_left_s = 0.2
[stitch]
pattern = "stitches"
length_mm = 15
[[pass]]
[[pass]]
across_mm = 2
out_mm = 1.5
reverse = true
torch.work_angle_deg = -7
[[seam]]
near_mm = [60, 200, 0]
weave.shape = "none"
stitch = { pattern = "tacks", count = 2 }
[[seam.pass]]
path.spacing_mm = 3
"#;

#[test]
fn a_job_with_every_word_replays_to_the_same_bytes() {
    let first = output(ALL);
    let again = output(&text(&first, "job.toml"));
    for (a, b) in first.files.iter().zip(&again.files) {
        assert!(a.bytes == b.bytes, "{} differs", a.name);
    }
    assert!(first.program.waypoints != output("").program.waypoints);
}

#[test]
fn stitches_show_in_path_json_as_welds_of_their_length_with_lifts_between() {
    let output =
        output("[stitch]\npattern = \"stitches\"\nlength_mm = 10\npitch_mm = 30\n[selection]\nseams = [2]");
    let (waypoints, _) = json::read(&text(&output, "path.json")).unwrap();
    let welds: Vec<_> = waypoints.split(|w| !w.weld).filter(|run| !run.is_empty()).collect();
    assert_eq!(welds.len(), 4, "100 mm: gaps of 30 mm");
    for run in &welds {
        let length_mm: f64 = run.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm()).sum();
        assert!((length_mm - 10.0).abs() < 1e-4, "{length_mm}");
    }
    let lifted = waypoints
        .iter()
        .filter(|w| !w.weld && w.seam.is_some() && (w.position_mm.z - 10.0 / 3f64.sqrt()).abs() < 1e-4);
    assert!(lifted.count() >= 6, "10 mm along (-1, 1, 1)");
    let csv = text(&output, "path.csv");
    assert_eq!(csv.lines().count() - 1, waypoints.iter().filter(|w| w.weld).count());
}

#[test]
fn a_seam_has_its_own_settings_and_the_others_the_jobs() {
    let output = output("[path]\nfeed_mm_s = 9\n[[seam]]\nnear_mm = [60, 200, 0]\npath.feed_mm_s = 5");
    for waypoint in output.program.waypoints.windows(2).filter(|w| w[0].weld && w[1].weld).map(|w| &w[1]) {
        let wanted = if waypoint.seam == Some(2) { 5.0 } else { 9.0 };
        assert_eq!(waypoint.feed_mm_s, wanted);
    }
}

#[test]
fn a_seam_may_be_switched_off_by_its_place_and_one_that_is_gone_is_refused() {
    let bend = "[[seam]]\nnear_mm = [60, 200, 0]\nwithin_mm = 5\nweld = false\n";
    assert_eq!(output(bend).paths.iter().map(|path| path.seam).collect::<Vec<_>>(), [1]);
    let refused = |job: &str| {
        let job = Job::parse(job, Path::new("job.toml")).unwrap();
        postprocess(&plans::pipe_and_bend(), &job, Default::default()).unwrap_err().to_string()
    };
    let gone = refused(&bend.replace("200", "150"));
    assert!(gone.contains("the seam nearest to (60, 150, 0)"), "{gone}");
    let none = refused(&format!("{bend}[[seam]]\nid = 1\nweld = false"));
    assert!(none.contains("none is left to weld"), "{none}");
    let alone = Job::parse("[[seam]]\nid = 1\nwithin_mm = 5", Path::new("job.toml")).unwrap_err();
    assert!(alone.to_string().contains(":3: within_mm"), "{alone}");
}

#[test]
fn seams_are_welded_as_the_job_lists_them_and_the_others_behind() {
    let order = |job: &str| {
        let paths = output(&format!("{job}[order]\nsequence = \"listed\"")).paths;
        paths.iter().map(|path| path.seam).collect::<Vec<_>>()
    };
    assert_eq!(order(""), [1, 2]);
    assert_eq!(order("[[seam]]\nnear_mm = [60, 200, 0]\n"), [2, 1]);
    assert_eq!(order("[[seam]]\nid = 1\n[[seam]]\nid = 2\n"), [1, 2]);
    let reverse = output(
        "[[seam]]\nid = 2\npath.direction = \"reverse\"\n[[seam]]\nid = 1\n[order]\nsequence = \"listed\"",
    );
    let first = &reverse.program.waypoints.iter().find(|w| w.weld).unwrap();
    let found = plans::pipe_and_bend();
    let end = found.paths[1].points.last().unwrap().position_mm;
    assert_eq!(first.seam, Some(2));
    assert!((first.position_mm - end).norm() < 1e-9, "none is turned round but by its direction");
}

#[test]
fn the_shortest_order_has_no_longer_air_way_than_the_order_found() {
    let air_mm = |job: &str| -> f64 {
        let waypoints = output(job).program.waypoints;
        let air = waypoints.windows(2).filter(|w| w[0].seam != w[1].seam || w[0].seam.is_none());
        air.map(|w| (w[1].position_mm - w[0].position_mm).norm()).sum()
    };
    for air in ["shortest", "safe-level"] {
        let order = format!("[order]\nair = \"{air}\"\n");
        let (shortest, found) = (air_mm(&order), air_mm(&format!("{order}sequence = \"found\"")));
        assert!(shortest <= found + 1e-9 && found > 0.0, "{shortest} mm, {found} mm");
    }
}

#[test]
fn seams_are_welded_uphill_or_downhill_as_asked() {
    // Seam 2 runs along +x and then along +y.
    for (direction, up, forward) in [
        ("up", "[1, 1, 0]", true),
        ("down", "[1, 1, 0]", false),
        ("up", "[-1, -1, 0]", false),
        ("down", "[-1, -1, 0]", true),
    ] {
        let job =
            format!("[order]\nup = {up}\n[path]\ndirection = \"{direction}\"\n[selection]\nseams = [2]");
        let output = output(&job);
        let welds: Vec<_> = output.program.waypoints.iter().filter(|w| w.weld).collect();
        let rise = welds[welds.len() - 1].position_mm - welds[0].position_mm;
        assert_eq!(rise.x + rise.y > 0.0, forward, "{job}");
    }
}

#[test]
fn the_summary_names_the_welding_position_and_the_order() {
    let seams = |job: &str| {
        let summary: serde_json::Value = serde_json::from_str(&text(&output(job), "summary.json")).unwrap();
        summary["seams"].as_array().unwrap().clone()
    };
    let level = seams("[selection]\nseams = [2]");
    assert_eq!(level[0]["positions"], serde_json::json!(["PB"]), "a pipe that stands on a plate");
    assert!(level[0]["order"].is_null() && level[1]["order"] == 1);
    let wall = seams("[order]\nup = [1, 0, 0]\n[path]\ndirection = \"up\"");
    assert_eq!(wall[1]["positions"][0], "PF", "its first 60 mm climb");
}

#[test]
fn the_summary_names_every_seam_and_which_are_welded() {
    let summary: serde_json::Value =
        serde_json::from_str(&text(&output("[selection]\nseams = [2]"), "summary.json")).unwrap();
    let seams = summary["seams"].as_array().unwrap();
    let of = |key: &str| seams.iter().map(|seam| seam[key].clone()).collect::<Vec<_>>();
    assert_eq!(of("joint"), ["pipe", "fillet"]);
    assert_eq!(of("selected"), [false, true]);
    assert!((seams[0]["length_mm"].as_f64().unwrap() - 40.0 * std::f64::consts::PI).abs() < 0.01);
    assert!((seams[1]["length_mm"].as_f64().unwrap() - 100.0).abs() < 1e-9);
    assert_eq!(summary["views"][0]["fitness_per_iteration"].as_array().unwrap().len(), 3);
    assert!(summary["views"][0]["uncertainty_mm"].is_null(), "unbounded is null");
    assert_eq!(summary["derived"][0]["name"], "voxel_mm");
}

#[test]
fn a_folder_that_refuses_is_left_as_it_was() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("out");
    std::fs::create_dir_all(out.join("summary.json")).unwrap();
    std::fs::write(out.join("path.csv"), "precious").unwrap();
    assert!(files::write(&out, &output("").files).is_err());
    assert_eq!(std::fs::read_to_string(out.join("path.csv")).unwrap(), "precious");
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 2);
}

#[test]
fn a_job_at_the_ends_of_its_ranges_is_refused_by_the_number_of_its_points() {
    let weave =
        "[path]\nspacing_mm = 0.1\n[weave]\nshape = \"triangle\"\nwavelength_mm = 0.5\nheight_mm = 1.0\n";
    let written = |job: &str| {
        let job = Job::parse(job, Path::new("job.toml")).expect("each number is within its range");
        postprocess(&plans::pipe_and_bend(), &job, Default::default())
    };
    assert!(written(weave).is_ok(), "one pass");
    let longer = weave.replace("[weave]", "extend_start_mm = 1000\nextend_end_mm = 1000\n[weave]");
    let error = written(&format!("{longer}{}", "[[pass]]\n".repeat(16))).expect_err("too many").to_string();
    let mut numbers = error.split_whitespace().filter_map(|word| word.parse::<usize>().ok()).skip(1);
    assert!(numbers.next().is_some_and(|points| points > MOST_POINTS), "{error}");
    assert_eq!(numbers.next(), Some(MOST_POINTS), "{error}");
}
