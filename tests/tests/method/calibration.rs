//! Hand-eye transform and camera of a cell from its own scans: `weldpath calibrate`, and what `plan` finds by itself. Truth is
//! the simulator's.

use weldpath::evaluation::Truth;
use weldpath::input::Scan;
use weldpath::pipeline::calibration::{self, Error, Loose};
use weldpath::pipeline::{self, Anchor, Calibration, CellAccuracy, Config, Plan};
use weldpath::simulation::{CellErrors, Part, Request, SensorErrors};
use weldpath_tests::command::weldpath;
use weldpath_tests::scans::{scanned, scored};

const CELL: CellErrors = CellErrors {
    hand_eye_mm: 2.0,
    hand_eye_deg: 0.5,
    robot_mm: 0.1,
    robot_deg: 0.03,
    first_exact: false,
    seed: Some(3),
};
const FOCAL_PERCENT: f64 = -0.5;
const K1: f64 = -0.01;

/// A camera that is not as its intrinsics say.
fn bad_camera() -> SensorErrors {
    SensorErrors { focal_percent: FOCAL_PERCENT, k1: K1, centre_px: 2.0, ..SensorErrors::default() }
}

fn of_cell(part: Part, seed: u64, sensor: SensorErrors) -> (Scan, Truth) {
    scanned(&Request { cell: Some(CELL), sensor, ..Request::new(part, seed) })
}

fn rmse_mm(plan: &Plan, truth: &Truth) -> f64 {
    scored(plan, truth).rmse_mm.unwrap_or(f64::INFINITY)
}

fn planned(scan: &Scan, config: &Config) -> Plan {
    pipeline::plan(&scan.views, config, &mut ()).unwrap_or_else(|error| panic!("{error}"))
}

/// Hand-eye transform and camera of the cell, from scans of these parts.
fn calibrated(parts: &[(Part, u64)]) -> Calibration {
    let mut known = None;
    for (part, seed) in parts {
        let (scan, _) = of_cell(*part, *seed, bad_camera());
        let (calibration, told) =
            calibration::calibrate(&scan.views, known.as_ref(), CellAccuracy::default()).expect("it tells");
        println!("{part}: {told:?}");
        known = Some(calibration);
    }
    known.expect("scans")
}

#[test]
fn three_scans_of_a_cell_tell_its_camera_and_a_fourth_is_planned_nearer_to_the_truth() {
    let known = calibrated(&[(Part::Branch, 81), (Part::Tacked, 82), (Part::Corner, 83)]);
    let (camera, sigma) = (known.camera, known.sigma());
    println!("{camera:?}\n{sigma:?}");
    for (found, truth, sigma) in [(camera.focal, 0.01 * FOCAL_PERCENT, sigma[7]), (camera.k1, K1, sigma[10])]
    {
        assert!(sigma < 0.2 * truth.abs(), "{sigma} of {truth}");
        assert!((found - truth).abs() < 4.0 * sigma, "{found} +- {sigma}, not {truth}");
    }
    // The simulator's axis is off by 2 pixels, in units of its focal length of 600.
    let off = camera.centre[0].hypot(camera.centre[1]);
    assert!((0.6..1.6).contains(&(off * 600.0 / 2.0)), "{camera:?}");
    assert!(!calibration::loose(&known, CellAccuracy::default()).contains(&Loose::Focal));
    let usual = Config::default();
    let mut with = Config::default();
    with.merge.calibration = Some(known);
    let (mut alone, mut knowing) = (0.0, 0.0);
    for (part, seed) in [(Part::Fillet, 84), (Part::ButtV, 84), (Part::Pipe, 84)] {
        let (scan, truth) = of_cell(part, seed, bad_camera());
        let plans = [&usual, &with].map(|config| planned(&scan, config));
        let [a, b] = plans.each_ref().map(|plan| rmse_mm(plan, &truth));
        let stated = plans.each_ref().map(|plan| plan.seams[0].base_error_mm);
        println!("{part}: {a:.2} mm alone, {b:.2} calibrated; stated {stated:.2?}");
        alone += a * a;
        knowing += b * b;
        assert!(b < 2.0 * stated[1] && stated[1] < stated[0], "{b} {stated:?}");
    }
    assert!((knowing / 3.0).sqrt() < 0.7 && knowing < alone, "{knowing} {alone}");
}

#[test]
fn the_command_writes_what_plan_reads_and_its_job_replays() {
    let home = tempfile::tempdir().unwrap();
    let run = |args: &str, ends: i32| {
        let output = weldpath().args(args.split(' ')).current_dir(home.path()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(ends), "{args}: {said}");
        (String::from_utf8_lossy(&output.stdout).into_owned(), said)
    };
    let cell =
        "--size 320x240 --hand-eye-mm 2 --robot-mm 0.1 --robot-deg 0.03 --cell-seed 7 --focal-percent 1";
    run(&format!("simulate --part branch --seed 5 --out a {cell}"), 0);
    run(&format!("simulate --part fillet --seed 6 --out b {cell}"), 0);
    let (told, _) = run("calibrate a b --out cell/calibration.toml", 0);
    assert!(
        told.contains("focal length larger than stated by") && told.contains("a: 8 of 8 views"),
        "{told}"
    );
    let (_, said) = run("plan b --calibration cell/calibration.toml --out out --quiet --no-report", 0);
    run("plan --job out/job.toml --out again --quiet --no-report", 0);
    let path = |folder: &str| std::fs::read(home.path().join(folder).join("path.csv")).unwrap();
    assert_eq!(path("out"), path("again"), "{said}");
    run("plan b --out without --quiet --no-report", 0);
    assert_ne!(path("out"), path("without"));
    let (_, said) = run("calibrate a/view_000.png --out c.toml", 4);
    assert!(said.contains("view_000.png"), "{said}");
    let (_, said) = run("plan b --calibration a/scan.json --out out2", 2);
    assert!(said.contains("scan.json") && said.contains("weldpath calibrate"), "{said}");
}

#[test]
fn a_plan_takes_a_wrong_focal_length_and_distortion_out_of_its_points() {
    let mut config = Config::default();
    config.merge.anchor = Some(Anchor::First);
    let cell = CellErrors { robot_mm: 0.6, robot_deg: 0.2, first_exact: true, seed: None, ..CELL };
    let cell = CellErrors { hand_eye_mm: 0.0, hand_eye_deg: 0.0, ..cell };
    for (part, seed) in [(Part::Fillet, 91), (Part::Pipe, 92)] {
        let request = Request { cell: Some(cell), sensor: bad_camera(), ..Request::new(part, seed) };
        let (scan, truth) = scanned(&request);
        let plan = planned(&scan, &config);
        let found = plan.derived.camera.as_ref().expect("several views");
        let (error, stated) = (rmse_mm(&plan, &truth), plan.seams[0].base_error_mm);
        println!("{part}: {error:.2} mm, stated {stated:.2}; {}", found.words());
        assert!(found.is_significant && plan.said.warnings.iter().any(|w| w.starts_with("camera: ")));
        assert!((found.errors.focal - 0.01 * FOCAL_PERCENT).abs() < 0.0025, "{found:?}");
        assert!((found.errors.k1 - K1).abs() < 0.006, "{found:?}");
        assert!(error < 0.6 && error < 2.0 * stated, "{error} {stated}");
    }
}

#[test]
fn a_camera_that_is_as_it_says_is_left_as_it_is_whatever_else_it_does_wrong() {
    let rounds =
        SensorErrors { window_px: 3, correlated_px: Some(4.0), depth_step_mm: 1.0, ..Default::default() };
    let fills = SensorErrors { interreflection_mm: 1.0, ..Default::default() };
    for (part, seed, sensor) in [
        (Part::Fillet, 95, SensorErrors::default()),
        (Part::Lap, 96, SensorErrors::default()),
        (Part::Fillet, 97, rounds),
        (Part::Fillet, 98, fills),
        (Part::ButtV, 97, rounds),
        (Part::Pipe, 97, rounds),
        (Part::Pipe, 98, fills),
    ] {
        let (scan, _) = of_cell(part, seed, sensor);
        let found = planned(&scan, &Config::default()).derived.camera.expect("several views");
        println!("{part} {seed}: {}", found.words());
        assert!(!found.is_significant, "{part} {seed}: {found:?}");
    }
}

#[test]
fn what_scans_cannot_tell_is_named_or_refused() {
    let cell = CellAccuracy::default();
    let (scan, _) = of_cell(Part::Corner, 99, SensorErrors::default());
    let few = calibration::calibrate(&scan.views[..2], None, cell);
    assert_eq!(few.unwrap_err(), Error::TooFewViews { fit: 2, views: 2 });
    let mut cloud = scan.views[0].clone();
    cloud.camera_known = false;
    assert_eq!(calibration::calibrate(&[cloud], None, cell).unwrap_err(), Error::NoPoses);
    // One flat plate says nothing of where the camera is along it.
    let (plate, _) = of_cell(Part::Plate, 99, SensorErrors::default());
    let (told, _) = calibration::calibrate(&plate.views, None, cell).expect("it tells little");
    assert!(calibration::loose(&told, cell).contains(&Loose::Shift), "{:?}", told.sigma());
}
