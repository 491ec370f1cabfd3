//! `report.html` and `report.svg`: what is in them, and that a browser shows it.

use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nalgebra::{Point3, Vector3};
use serde_json::Value;
use weldpath::evaluation::{Options, PathSet, Truth};
use weldpath::geometry::cloud::{Merged, PointCloud};
use weldpath::geometry::grid::Grid;
use weldpath::model::downsampling::Voxels;
use weldpath::output::frame::PathFrame;
use weldpath::output::summary::Source;
use weldpath::pipeline::{Evidence, Plan, PlanError};
use weldpath::report::{self, Recording};
use weldpath::run::job::Job;
use weldpath::run::postprocessing::postprocess;
use weldpath::seam::{Unwelded, WhyUnwelded};
use weldpath_tests::browser::{self, Browser};
use weldpath_tests::command::weldpath;
use weldpath_tests::plans;

/// Bytes of a point in the page.
const POINT_BYTES: usize = 14;
const MANY: usize = 300_000;

/// The pipe of [`plans::pipe_and_bend`] and the plate it stands on, as `count` points.
fn pipe_on_plate(count: usize) -> PointCloud {
    let mut cloud = PointCloud { origin_mm: Point3::new(0.0, 80.0, 0.0), ..PointCloud::default() };
    for i in 0..count {
        // Low-discrepancy places (R2 sequence).
        let [u, v] = [0.754_877_666, 0.569_840_29].map(|step: f64| (i as f64 * step).fract() as f32);
        let (point, normal) = if i % 3 == 0 {
            let turn = std::f32::consts::TAU * u;
            let radial = Vector3::new(turn.cos(), turn.sin(), 0.0);
            (Point3::from(radial * 20.0 + Vector3::new(0.0, -80.0, 80.0 * v)), radial)
        } else {
            (Point3::new(200.0 * u - 80.0, 360.0 * v - 150.0, 0.0), Vector3::z())
        };
        cloud.points_mm.push(point);
        cloud.normals.push(normal);
    }
    cloud
}

const REJECTED: &str = "an inside corner of 30 mm near 1,2,3 is too uncertain to weld";

fn rejected() -> Unwelded {
    let line_mm = vec![Point3::new(-14.0, 2.0, 3.0), Point3::new(16.0, 2.0, 3.0)];
    let air = vec![Vector3::z(); line_mm.len()];
    Unwelded { line_mm, air, reason: WhyUnwelded::Unsure, words: REJECTED.into() }
}

/// What is kept of a run over `model`.
fn recording(model: &PointCloud) -> Recording {
    let raw: Vec<Point3<f32>> =
        model.points_mm.iter().zip(&model.normals).map(|(p, n)| p + n * 0.15).collect();
    let view: Vec<u16> = (0..raw.len()).map(|i| (i % 3) as u16).collect();
    let merged = Merged {
        origin_mm: model.origin_mm,
        view: view.clone(),
        points_mm: raw.clone(),
        cameras_mm: [-100.0, 0.0, 100.0].map(|x| Point3::new(x, -200.0, 300.0)).to_vec(),
        ..Merged::default()
    };
    let index = Grid::new(&raw, 5.0);
    let cloud = PointCloud { points_mm: raw, ..model.clone() };
    let voxels = Voxels { cloud, view, edge_mm: 1.0, ..Voxels::default() };
    let intensity: Vec<f32> = model.points_mm.iter().map(|p| if p.z < 3.0 { 0.2 } else { 0.03 }).collect();
    Recording::of(&Evidence {
        merged: &merged,
        raw: &index,
        voxels: &voxels,
        model,
        index: &Grid::new(&model.points_mm, 4.0),
        intensity: &intensity,
        segmentation: None,
        rejected: &[REJECTED.to_owned()],
        unwelded: &[rejected()],
    })
}

/// What a run of `plan` leaves: page and picture.
fn report(plan: &Plan, job: &str) -> [String; 2] {
    let recording = recording(&plan.model);
    let job = Job::parse(job, Path::new("job.toml")).unwrap();
    let output = postprocess(plan, &job, Default::default()).unwrap();
    let files = report::files(plan, &output, &recording, &job);
    assert_eq!([files[0].name.as_str(), &files[1].name], [report::PAGE, report::PICTURE]);
    [0, 1].map(|k| String::from_utf8(files[k].bytes.clone()).unwrap())
}

#[test]
fn a_run_without_a_seam_shows_the_cloud_and_names_what_was_rejected() {
    let error = PlanError::NoSeam { reason: "thin".into() };
    let read = Source { frame: PathFrame::Base, ..Source::default() };
    let files = report::without_seams(&recording(&pipe_on_plate(3000)), &Job::default(), &error, read);
    let page = String::from_utf8(files[0].bytes.clone()).unwrap();
    let block = page.split("id=\"content\">").nth(1).unwrap().split("</script>").next().unwrap();
    let content: Value = serde_json::from_str(block).unwrap();
    let verdict = &content["summary"]["verdict"];
    assert_eq!((&verdict["state"], &verdict["reasons"][0]["id"]), (&"refused".into(), &"no-seam".into()));
    assert_eq!(verdict["reasons"][0]["words"], "no seam found: thin");
    assert_eq!(content["summary"]["warnings"][0], REJECTED);
    let summary: Value = serde_json::from_slice(&files[2].bytes).unwrap();
    assert_eq!((&summary["unwelded"][0]["words"], &summary["frame"]), (&REJECTED.into(), &"base".into()));
    assert_eq!(content["summary"], summary);
    assert!(content["clouds"]["model"]["count"].as_u64() > Some(1000), "{}", content["clouds"]);
}

fn plan(points: usize) -> Plan {
    Plan { model: pipe_on_plate(points), ..plans::pipe_and_bend() }
}

/// Page and picture with few points.
static SMALL: LazyLock<[String; 2]> = LazyLock::new(|| report(&plan(3000), ""));

/// Text of the element with this id.
fn block<'a>(page: &'a str, id: &str) -> &'a str {
    let begin = page.find(&format!("id=\"{id}\">")).unwrap() + id.len() + "id=\"\">".len();
    page[begin..].split("</script>").next().unwrap()
}

fn content(page: &str) -> Value {
    serde_json::from_str(block(page, "content")).unwrap()
}

#[test]
fn the_page_holds_every_point_seam_and_waypoint() {
    let page = &SMALL[0];
    let content = content(page);
    let layers = ["model", "raw"].map(|name| content["clouds"][name].clone());
    for layer in &layers {
        assert_eq!((layer["count"].as_u64(), layer["of"].as_u64()), (Some(3000), Some(3000)));
    }
    assert_eq!(STANDARD.decode(block(page, "points")).unwrap().len(), 2 * 3000 * POINT_BYTES);
    assert_eq!(content["seams"].as_array().unwrap().len(), 2);
    let output = postprocess(&plan(3000), &Job::default(), Default::default()).unwrap();
    assert_eq!(content["waypoints"].as_array().unwrap().len(), output.program.waypoints.len());
    assert_eq!(content["summary"]["format"], "weldpath-summary");
    assert_eq!(block(page, "deviation"), "null");
}

#[test]
fn points_in_the_page_lie_on_the_pipe_or_the_plate() {
    let (page, number) = (&SMALL[0], |v: &Value| v.as_f64().unwrap());
    let layer = &content(page)["clouds"]["model"];
    let bytes = STANDARD.decode(block(page, "points")).unwrap();
    let at = layer["positions_at"].as_u64().unwrap() as usize;
    for i in 0..3000 {
        let steps = |k: usize| {
            f64::from(u16::from_le_bytes([bytes[at + 8 * i + 2 * k], bytes[at + 8 * i + 2 * k + 1]]))
        };
        let [x, y, z] = [0, 1, 2].map(|k| number(&layer["low_mm"][k]) + steps(k) * number(&layer["step_mm"]));
        let off_mm = if i % 3 == 0 { (x.hypot(y) - 20.0).abs() } else { z.abs() };
        assert!(off_mm < 0.02, "point {i}: {x} {y} {z}");
        assert!((steps(3) - 32_768.0 - 150.0).abs() <= 1.0, "the filter moved it by 0.15 mm");
    }
}

#[test]
fn surfaces_in_the_page_are_the_pipe_and_the_plate() {
    let [page, _] = report(&plan(60_000), "");
    let content = content(&page);
    let surfaces = content["surfaces"].as_array().unwrap();
    let round = surfaces.iter().position(|surface| surface["shape"] == "cylinder").expect("the pipe");
    assert!((surfaces[round]["radius_mm"].as_f64().unwrap() - 20.0).abs() < 0.1, "{surfaces:?}");
    assert_eq!(surfaces[0]["shape"], "plane");
    let bytes = STANDARD.decode(block(&page, "points")).unwrap();
    let at = content["clouds"]["model"]["surfaces_at"].as_u64().unwrap() as usize;
    let number = |i: usize| usize::from(bytes[at + 2 * i]);
    for (first, surface) in [(0, round), (1, 0)] {
        let all = (first..60_000).step_by(3);
        let of_it = all.clone().filter(|&i| number(i) == 1 + surface).count();
        assert!(of_it as f64 > 0.95 * all.count() as f64, "{of_it} points of surface {surface}");
    }
}

#[test]
fn an_assumed_side_is_written_in_the_picture_and_no_other_plan_says_so() {
    let mut assumed = plan(3000);
    assumed.derived.orientation_assumed = true;
    let [page, picture] = report(&assumed, "");
    let note = "side assumed: check that the torch is on the open side";
    assert_eq!((picture.matches(note).count(), SMALL[1].matches(note).count()), (4, 0), "once in each view");
    let Some(chromium) = browser::chromium() else { return };
    for (page, notes) in [(&page, vec![note]), (&SMALL[0], Vec::new())] {
        let mut browser = Browser::open(&chromium, page);
        browser.wait_for("document.querySelector('#seams tr[data-seam]')");
        let shown = browser.evaluate(
            "[...document.querySelectorAll('#assumed:not([hidden]) [data-assumed]')].map((one) => one.textContent)",
        );
        assert_eq!(shown, Value::from(notes));
    }
}

#[test]
fn the_page_may_fetch_nothing_and_names_no_address() {
    let page = &SMALL[0];
    assert!(page.contains("http-equiv=\"Content-Security-Policy\" content=\"default-src 'none';"));
    let (markup, _) = page.rsplit_once("<script>").unwrap();
    let markup = markup.replace("http-equiv", "");
    for word in ["http:", "https:", "src=", "@import", "//cdn"] {
        assert!(!markup.contains(word), "{word}");
    }
}

#[test]
fn a_page_of_300_000_points_is_at_most_12_mb() {
    let [page, picture] = report(&plan(MANY), "");
    assert_eq!(content(&page)["clouds"]["model"]["count"], MANY);
    assert!(page.len() <= 12_000_000, "{}", page.len());
    assert!(picture.len() <= 4_000_000, "{}", picture.len());
}

#[test]
fn larger_clouds_are_thinned_and_the_page_says_so() {
    let [page, _] = report(&plan(2 * MANY + 1), "");
    let model = &content(&page)["clouds"]["model"];
    assert!(model["count"].as_u64().unwrap() <= MANY as u64);
    assert_eq!(model["of"], 2 * MANY + 1);
    assert!(page.len() <= 12_000_000, "{}", page.len());
}

#[test]
fn the_bundle_is_built_from_the_sources_beside_it() {
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("host/src/report/web");
    let sum =
        Command::new("sh").args(["-c", "cat src/*.js package-lock.json | cksum"]).current_dir(&web).output();
    let sum = String::from_utf8(sum.expect("sh and cksum").stdout).unwrap().trim().replace(' ', "-");
    let bundle = std::fs::read_to_string(web.join("dist/report.js")).unwrap();
    let banner = bundle.lines().next().unwrap();
    assert!(banner.contains(&format!("sources {sum} ")), "{banner}: run host/src/report/web/build.sh");
    assert!(bundle.contains("Three.js Authors") && web.join("dist/LICENSE-three.txt").is_file());
}

/// Coordinates of the polylines of an SVG, px.
fn polylines(svg: &str) -> Vec<Vec<[f64; 2]>> {
    let place = |pair: &str| {
        let (x, y) = pair.split_once(',').unwrap();
        [x.parse().unwrap(), y.parse().unwrap()]
    };
    let points = svg.split("points=\"").skip(1).map(|rest| rest.split('"').next().unwrap());
    points.map(|list| list.split_whitespace().map(place).collect()).collect()
}

#[test]
fn the_scale_bar_of_the_picture_measures_the_pipe() {
    let svg = &SMALL[1];
    let lines = polylines(svg);
    assert_eq!(lines.len(), 4 * 2 * 2, "four views of two seams, each line with its edge");
    // The second view is from above: there the first seam is a circle of 40 mm.
    let circle = &lines[4];
    let extent = |k: usize| {
        let of = |fold: fn(f64, f64) -> f64, first| circle.iter().map(|p| p[k]).fold(first, fold);
        of(f64::max, f64::MIN) - of(f64::min, f64::MAX)
    };
    let view = svg.split("<g transform").nth(2).unwrap();
    let bar = view.rsplit_once("v8h").unwrap().1;
    let px: f64 = bar.split('v').next().unwrap().parse().unwrap();
    let mm: f64 = bar.split(" mm</text>").next().unwrap().rsplit('>').next().unwrap().parse().unwrap();
    for k in [0, 1] {
        assert!((extent(k) * mm / px - 40.0).abs() < 0.4, "{} mm", extent(k) * mm / px);
    }
}

#[test]
fn a_perfect_plan_deviates_from_the_truth_by_nothing() {
    let request = weldpath::simulation::Request::new(weldpath::simulation::Part::Fillet, 3);
    let truth: Truth = weldpath::simulation::stage(&request).unwrap().truth;
    let output = postprocess(&plans::of_truth(&truth), &Job::default(), Default::default()).unwrap();
    let csv = &output.files.iter().find(|file| file.name == "path.csv").unwrap().bytes;
    let paths = PathSet::parse(csv, Path::new("path.csv")).unwrap();
    let deviation = report::deviation(&paths, &truth, &Options::default());
    let page = report::with_deviation(&SMALL[0], &deviation).unwrap();
    let shown: Value = serde_json::from_str(block(&page, "deviation")).unwrap();
    let points = shown["points"].as_array().unwrap();
    assert_eq!(points.len(), paths.points_mm.len());
    assert!(points.iter().all(|p| p["lateral_mm"].as_f64().is_none_or(|mm| mm < 0.01)));
    assert!(points.iter().filter(|p| p["lateral_mm"].is_number()).count() * 10 > 9 * points.len());
    assert_eq!(shown["lines"].as_array().unwrap().len(), truth.seams.len());
}

#[test]
fn a_run_leaves_its_page_and_evaluate_puts_the_deviation_in_it() {
    let home = tempfile::tempdir().unwrap();
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures/butt-v");
    let run = |args: &[&str]| {
        let output = weldpath().args(args).current_dir(home.path()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    run(&["plan", fixture.to_str().unwrap(), "--quiet"]);
    let page = || std::fs::read_to_string(home.path().join("out").join(report::PAGE)).unwrap();
    assert_eq!((content(&page())["title"].as_str(), block(&page(), "deviation")), (Some("butt-v"), "null"));
    assert!(home.path().join("out").join(report::PICTURE).is_file());
    let truth = fixture.join("truth.json");
    run(&["evaluate", "out", "--truth", truth.to_str().unwrap(), "--report", "--json"]);
    let deviation: Value = serde_json::from_str(block(&page(), "deviation")).unwrap();
    assert!(deviation["score"]["rmse_p"].as_f64().unwrap() < 0.5, "{}", deviation["score"]);
    assert!(!content(&page())["waypoints"].as_array().unwrap().is_empty(), "the rest is as it was");
}

const PROBE: &str = include_str!("probe.js");
/// Where a station of seam 2 is in the window, and a corner of the picture in which nothing is.
const PLACE_ON_SEAM_2: &str = "(() => {
    const { scene, content } = weldpath;
    const line = content.seams.find((seam) => seam.id === 2).line_mm;
    const Vector3 = scene.camera.position.constructor;
    const on = scene.project(new Vector3(...line[line.length >> 2]));
    const box = document.getElementById('canvas').getBoundingClientRect();
    return [box.left + on.x, box.top + on.y, box.right - 4, box.top + 0.5 * box.height];
})()";

/// Of the pipe's foot and rim, where it is in the window beyond the canvas, px; positive where the picture cuts it off.
const CUT_OFF: &str = "(() => {
    const { scene, content } = weldpath;
    const Vector3 = scene.camera.position.constructor;
    const canvas = document.getElementById('canvas').getBoundingClientRect();
    const beyond = [];
    for (const z of [0, 80]) for (let k = 0; k < 16; k++) {
        const turn = k * Math.PI / 8;
        const on = scene.project(new Vector3(20 * Math.cos(turn), 20 * Math.sin(turn), z));
        beyond.push(-on.x, -on.y, on.x - canvas.width, on.y - canvas.height);
    }
    return Math.max(...beyond);
})()";

#[test]
fn the_first_view_cuts_nothing_of_the_work_off() {
    let Some(chromium) = browser::chromium() else { return };
    let [page, _] = report(&plan(30_000), "");
    let mut browser = Browser::open(&chromium, &page);
    let beyond_px = browser.evaluate(CUT_OFF);
    assert!(beyond_px.as_f64().is_some_and(|px| px < 0.0), "{beyond_px} px beyond the picture");
}

#[test]
fn a_browser_shows_300_000_points_and_slider_clicks_and_keys_work() {
    let Some(chromium) = browser::chromium() else { return };
    let [page, _] = report(&plan(MANY), "");
    let waypoints = content(&page)["waypoints"].as_array().unwrap().clone();
    let mut browser = Browser::open(&chromium, &page);
    // A place on seam 2, and one on none, clicked with the mouse; again if the page was still being laid out, as it is for
    // seconds on a busy machine without a graphics card.
    let detail = "document.getElementById('detail').textContent";
    let (mut place, mut from_picture) = (Value::Null, Value::Null);
    for _ in 0..5 {
        place = browser.evaluate(PLACE_ON_SEAM_2);
        browser.click(place[0].as_f64().unwrap(), place[1].as_f64().unwrap());
        from_picture = browser.evaluate(detail);
        if from_picture.as_str().is_some_and(|text| text.starts_with("Seam 2")) {
            break;
        }
        std::thread::sleep(std::time::Duration::from_secs(1));
    }
    browser.click(place[2].as_f64().unwrap(), place[3].as_f64().unwrap());
    assert_eq!(browser.evaluate(detail), from_picture, "a click beside all seams selects none");
    let answer = &browser.evaluate(PROBE);
    assert!(browser.console().is_empty(), "{:?}", browser.console());

    let number = |v: &Value| v.as_f64().unwrap_or_else(|| panic!("{v} of {answer}"));
    assert!(
        number(&answer["first"]["colours"]) > 200.0 && number(&answer["first"]["drawn"]) > 0.1,
        "{answer}"
    );
    let pictures = answer["pictures"].as_array().unwrap();
    for (k, picture) in pictures[..5].iter().enumerate() {
        assert!(!pictures[..k].contains(picture), "colouring {k} looks like another");
    }
    assert!(pictures[5] != pictures[7] && pictures[6] != pictures[7], "the clouds look the same");

    let torch = |k: usize| [0, 1, 2].map(|c| number(&answer["torch"][k][c]));
    for (k, waypoint) in [(0, waypoints.first().unwrap()), (2, waypoints.last().unwrap())] {
        for c in 0..3 {
            assert!((torch(k)[c] - number(&waypoint[c])).abs() < 1e-3, "slider at end {k}: {:?}", torch(k));
        }
    }
    assert!(torch(1) != torch(0) && torch(1) != torch(2));
    let text = |key: &str| answer[key].as_str().unwrap_or_else(|| panic!("{key} of {answer}")).to_owned();
    for detail in [text("fromList"), from_picture.to_string()] {
        assert!(detail.contains("Seam 2: fillet") && detail.contains("100 mm"), "{detail}");
    }
    assert!(text("fromLabel").contains("Seam 1: pipe"));
    assert_eq!(answer["fromKey"], 2);
    assert!(number(&answer["played_s"]) > 0.0);
    for key in ["paused", "turned"] {
        assert_eq!(answer[key], true, "{key}");
    }
    assert_eq!((&answer["unnamed"], &answer["idleFrames"]), (&Value::from(0), &Value::from(0)));
    assert_eq!(answer["theme"], "dark");
    assert_eq!(answer["points"], MANY);
    assert!(number(&answer["drawCalls"]) <= 12.0, "{}", answer["drawCalls"]);
    println!(
        "{} draw calls; script per frame, ms, median and most: {}",
        answer["drawCalls"], answer["script_ms"]
    );
}

/// A robot that stands 600 mm beside the pipe.
const ROBOT: &str = "[robot]\nmodel = \"{model}\"\nbase_mm = [-600, 100, -50]\nbase_rotation_rad = [0, 0, 0.3]\n\
                     [tool]\nflange_from_tcp_mm = [0, -50, 300]\nflange_from_tcp_rotation_rad = [0, 0.5, 0]\n\
                     payload_kg = 2.5\n";

/// Between two waypoints the joints turn evenly, so the tip leaves a straight line by this at most, mm.
const BETWEEN_MM: f64 = 0.3;

/// The player in the middle of each move, and at each waypoint: whether it stands at one, how far the tip of the drawn arm is
/// from the torch, mm, and by how much it is turned from it, rad; null and the words of the player where no arm is drawn.
const TIPS: &str = "(() => {
    const { scene } = weldpath;
    const slider = document.getElementById('slider');
    const Vector3 = scene.camera.position.constructor;
    const rows = weldpath.content.waypoints;
    const off = (time_s, stands) => {
        slider.value = time_s;
        slider.dispatchEvent(new Event('input'));
        scene.scene.updateMatrixWorld(true);
        const [arm, torch] = [scene.arm.tip, scene.groups.torch];
        if (!scene.arm.visible) return [stands, null, document.getElementById('readout').textContent];
        const at = (object) => new Vector3().setFromMatrixPosition(object.matrixWorld);
        // The tool's z points into the work, the torch's out of it.
        const z = (object) => new Vector3().setFromMatrixColumn(object.matrixWorld, 2);
        const y = (object) => new Vector3().setFromMatrixColumn(object.matrixWorld, 1);
        return [stands, at(arm).distanceTo(at(torch)), Math.max(z(arm).add(z(torch)).length(), y(arm).sub(y(torch)).length())];
    };
    let [time_s, found] = [0, []];
    rows.forEach((row, i) => {
        const before = rows[Math.max(i - 1, 0)];
        const move_s = Math.hypot(row[0] - before[0], row[1] - before[1], row[2] - before[2]) / row[7];
        if (move_s > 0) found.push(off(time_s + 0.5 * move_s, false));
        time_s += move_s;
        found.push(off(time_s, true));
    });
    return found;
})()";

#[test]
fn the_drawn_arm_holds_the_torch_wherever_the_player_stands_and_is_not_drawn_beyond_its_reach() {
    let Some(chromium) = browser::chromium() else { return };
    for (model, reaches) in
        [("ur10e", true), ("abb-irb1600-10-145", true), ("fanuc-m10ia", true), ("ur3", false)]
    {
        let [page, _] = report(&plan(3000), &ROBOT.replace("{model}", model));
        let mut browser = Browser::open(&chromium, &page);
        let tips = browser.evaluate(TIPS);
        let tips = tips.as_array().unwrap();
        let (drawn, absent): (Vec<&Value>, Vec<&Value>) = tips.iter().partition(|tip| tip[1].is_number());
        let [at, between] = [true, false].map(|stands| {
            let some = || drawn.iter().filter(|tip| tip[0] == stands);
            [1, 2].map(|k| some().map(|tip| tip[k].as_f64().unwrap()).fold(0.0, f64::max))
        });
        println!(
            "{model}: {} of {} places, mm and rad off {at:?}, between {between:?}",
            drawn.len(),
            tips.len()
        );
        assert!(at[0] < 0.1 && at[1] < 1e-3, "{model}: {at:?}");
        assert!(between[0] < BETWEEN_MM && between[1] < 2e-3, "{model}: {between:?}");
        assert_eq!(absent.is_empty(), reaches, "{model}: {} of {}", absent.len(), tips.len());
        let said = format!("{model} does not reach this pose");
        assert!(absent.iter().all(|tip| tip[2].as_str().unwrap().contains(&said)), "{absent:?}");
        assert!(drawn.len() > 10, "{model}");
        let legend = browser.evaluate("document.getElementById('legend').textContent");
        assert!(legend.as_str().unwrap().contains("checked against what was scanned only"), "{legend}");
        let answer = browser.evaluate(PROBE);
        assert!(browser.console().is_empty(), "{:?}", browser.console());
        assert!(answer["drawCalls"].as_f64().unwrap() <= 40.0, "{}", answer["drawCalls"]);
        assert_eq!(answer["idleFrames"], 0);
        println!("{model}: {} draw calls", answer["drawCalls"]);
    }
}

#[test]
fn the_joints_in_the_page_bring_the_tip_to_each_waypoint_by_the_forward_kinematics() {
    for model in ["ur10e", "abb-irb1600-10-145", "kuka-kr10-r1420"] {
        let text = ROBOT.replace("{model}", model);
        let job = Job::parse(&text, Path::new("job.toml")).unwrap();
        let placed = job.feasibility().unwrap().robot.unwrap();
        let [page, _] = report(&plan(3000), &text);
        let content = content(&page);
        let rows = content["waypoints"].as_array().unwrap();
        let moves = content["arm"]["joints_rad"].as_array().unwrap();
        assert_eq!(rows.len(), moves.len());
        for (row, poses) in rows.iter().zip(moves) {
            let angles = poses.as_array().unwrap().last().unwrap();
            let joints_rad = [0, 1, 2, 3, 4, 5].map(|j| angles[j].as_f64().unwrap());
            let flange = placed.base_from_robot * placed.arm.forward(&joints_rad);
            let tip_mm = (flange * placed.flange_from_tcp).translation.vector;
            let waypoint_mm = Vector3::from([0, 1, 2].map(|c| row[c].as_f64().unwrap()));
            assert!((tip_mm - waypoint_mm).norm() < 0.02, "{model}: {tip_mm} and {waypoint_mm}");
        }
    }
    assert!(content(&SMALL[0])["arm"].is_null(), "no robot is chosen");
}

#[test]
fn names_that_look_like_markup_are_shown_as_text() {
    let Some(chromium) = browser::chromium() else { return };
    let evil = "</script><img src=x onerror=console.error(1)>&amp;{{points}}";
    let mut plan = plan(3000);
    plan.said.warnings = vec![evil.into()];
    plan.derived.views[0].name = evil.into();
    plan.seams[0].reason = evil.into();
    let [page, _] = report(&plan, &format!("input = {evil:?}"));
    let mut browser = Browser::open(&chromium, &page);
    let answer = browser.evaluate(PROBE);
    assert!(browser.console().is_empty(), "{:?}", browser.console());
    assert_eq!(answer["strange"], 0);
    // The title is the last part of a path.
    assert_eq!(answer["title"], evil.rsplit('/').next().unwrap());
    assert!(answer["warnings"][0].as_str().unwrap().contains(evil), "{}", answer);
    assert!(answer["inputs"].as_str().unwrap().contains(evil));
}
