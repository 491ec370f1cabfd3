//! A saved program follows a part that has moved: simulated, seen by other cameras, moved by a known motion.

use nalgebra::{Isometry3, Matrix4, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use weldpath::geometry::cloud::{PointCloud, View};
use weldpath::input;
use weldpath::run::refit::{Error, cloud, moved, refit};
use weldpath::simulation::{Part, Request, write};
use weldpath::weld::program::{Kind, Waypoint};
use weldpath_tests::command::{end_of, plan_the_cell, weldpath};
use weldpath_tests::scans::shared;

/// A part seen by every other camera of a scan, seen by the others, its true seams as a program, and the table's height.
struct Seen {
    old: PointCloud,
    new: PointCloud,
    program: Vec<Waypoint>,
    table_mm: f64,
}

fn seen(part: Part) -> Seen {
    let simulated = shared(&Request::new(part, 1));
    let home = tempfile::tempdir().unwrap();
    write(simulated, home.path()).unwrap();
    let mut views = input::read(home.path(), &input::Options::default()).unwrap().views;
    for (view, rows) in views.iter_mut().zip(&simulated.truth.true_cam) {
        let pose = Matrix4::from_fn(|r, c| rows[r][c]);
        let turn = Rotation3::from_matrix(&pose.fixed_view::<3, 3>(0, 0).into_owned());
        let shift = Translation3::new(pose[(0, 3)], pose[(1, 3)], pose[(2, 3)]);
        view.base_from_camera = Isometry3::from_parts(shift, UnitQuaternion::from_rotation_matrix(&turn));
    }
    let (old, new): (Vec<_>, Vec<_>) = views.into_iter().enumerate().partition(|(k, _)| k % 2 == 0);
    let of = |views: Vec<(usize, View)>| cloud(&views.into_iter().map(|(_, view)| view).collect::<Vec<_>>());
    let at = |p: &[f64; 3]| Waypoint {
        position_mm: Point3::from(*p),
        base_from_torch: UnitQuaternion::identity(),
        feed_mm_s: 8.0,
        weld: true,
        seam: Some(1),
        kind: Kind::Weld,
        dwell_s: None,
    };
    let required = simulated.truth.seams.iter().filter(|seam| seam.required);
    let program = required.flat_map(|seam| seam.p.iter().map(at)).collect();
    Seen { old: of(old), new: of(new), program, table_mm: simulated.truth.ztable }
}

/// A turn about the middle of the welds, then a shift.
fn motion(program: &[Waypoint], axis: [f64; 3], deg: f64, shift_mm: [f64; 3]) -> Isometry3<f64> {
    let sum: Vector3<f64> = program.iter().map(|w| w.position_mm.coords).sum();
    let middle = sum / program.len() as f64;
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from(axis).normalize() * deg.to_radians());
    Isometry3::from_parts(Translation3::from(middle - turn * middle + Vector3::from(shift_mm)), turn)
}

fn moved_cloud(cloud: &PointCloud, by: &Isometry3<f64>, moves: impl Fn(&Point3<f64>) -> bool) -> PointCloud {
    let mut all = cloud.clone();
    for k in 0..cloud.len() {
        let p = cloud.in_base_mm(k);
        if moves(&p) {
            all.points_mm[k] = Point3::from((by * p - cloud.origin_mm).cast());
            all.normals[k] = (by.rotation * cloud.normals[k].cast::<f64>()).cast();
        }
    }
    all
}

/// Largest distance between the program where it was put and where it belongs, mm.
fn off_mm(program: &[Waypoint], found: &Isometry3<f64>, truth: &Isometry3<f64>) -> f64 {
    let pairs = moved(program, found).into_iter().zip(moved(program, truth));
    pairs.map(|(a, b)| (a.position_mm - b.position_mm).norm()).fold(0.0, f64::max)
}

const STILL: ([f64; 3], f64, [f64; 3]) = ([0.0, 0.0, 1.0], 0.0, [0.0; 3]);
const SLID: ([f64; 3], f64, [f64; 3]) = ([0.0, 0.0, 1.0], 0.0, [16.0, 12.0, 0.0]);
const TURNED: ([f64; 3], f64, [f64; 3]) = ([0.0, 0.0, 1.0], 10.0, [0.0; 3]);
const FAR: ([f64; 3], f64, [f64; 3]) = ([0.0, 0.0, 1.0], 20.0, [30.0, -20.0, 0.0]);
const LIFTED: ([f64; 3], f64, [f64; 3]) = ([-0.3, 1.0, -1.0], 15.0, [-25.0, 0.0, -40.0]);

#[test]
fn a_part_whose_ends_are_seen_takes_its_program_along() {
    for part in [Part::Fillet, Part::Lap, Part::Branch] {
        let Seen { old, new, program, .. } = seen(part);
        for (axis, deg, shift_mm) in [STILL, SLID, TURNED, FAR] {
            let truth = motion(&program, axis, deg, shift_mm);
            let fit = refit(&program, &old, &moved_cloud(&new, &truth, |_| true)).unwrap();
            let off_mm = off_mm(&program, &fit.new_from_old, &truth);
            println!(
                "{part} {deg} deg {shift_mm:?}: {off_mm:.2} mm, found {:.2} {:?}",
                fit.found, fit.warnings
            );
            assert!(!fit.unknown && off_mm < 1.5, "{part}, {deg} deg, {shift_mm:?}: {off_mm} mm, {fit:?}");
        }
    }
}

/// Along its groove, or about its axis: right within 1 mm, refused, or called unknown; and left alone where it is.
#[test]
fn a_part_that_may_slide_unseen_is_right_or_refused_or_called_unknown() {
    for part in [Part::ButtV, Part::Pipe] {
        let Seen { old, new, program, .. } = seen(part);
        for (axis, deg, shift_mm) in [STILL, SLID, TURNED] {
            let truth = motion(&program, axis, deg, shift_mm);
            let still = truth == Isometry3::identity();
            match refit(&program, &old, &moved_cloud(&new, &truth, |_| true)) {
                Ok(fit) => {
                    let off_mm = off_mm(&program, &fit.new_from_old, &truth);
                    println!(
                        "{part} {deg} deg {shift_mm:?}: {off_mm:.2} mm, found {:.2} {:?}",
                        fit.found, fit.warnings
                    );
                    let told = !still && fit.unknown && fit.warnings.iter().any(|w| w.starts_with("UNKNOWN"));
                    assert!(off_mm < 1.0 || told, "{part}, {deg} deg, {shift_mm:?}: {off_mm} mm, {fit:?}");
                }
                Err(error) => assert!(!still, "{part} did not move, but is refused: {error}"),
            }
        }
    }
}

#[test]
fn a_part_that_was_lifted_or_slid_over_its_table_takes_its_program_along() {
    let Seen { old, new, program, table_mm } = seen(Part::Fillet);
    let off_table = |p: &Point3<f64>| p.z > table_mm + 1.5;
    for ((axis, deg, shift_mm), all) in [(LIFTED, true), (SLID, false), (TURNED, false)] {
        let truth = motion(&program, axis, deg, shift_mm);
        let fit = refit(&program, &old, &moved_cloud(&new, &truth, |p| all || off_table(p))).unwrap();
        let off_mm = off_mm(&program, &fit.new_from_old, &truth);
        println!("{deg} deg {shift_mm:?}: {off_mm:.2} mm, found {:.2} {:?}", fit.found, fit.warnings);
        assert!(off_mm < 1.0, "{deg} deg, {shift_mm:?}: {off_mm} mm, {fit:?}");
    }
}

#[test]
fn another_part_or_one_far_away_is_refused() {
    let Seen { old, program, .. } = seen(Part::Pipe);
    let refused = refit(&program, &old, &seen(Part::Fillet).new).unwrap_err();
    assert!(matches!(refused, Error::NotFound { .. }), "{refused}");
    let away = motion(&program, [0.0, 0.0, 1.0], 0.0, [600.0, 0.0, 300.0]);
    let far = refit(&program, &old, &moved_cloud(&old, &away, |_| true)).unwrap_err();
    assert!(far.to_string().contains("within 50 mm and 20 degrees"), "{far}");
    assert!(matches!(refit(&[], &old, &old), Err(Error::Saved { .. })));
    assert!(matches!(refit(&program, &PointCloud::default(), &old), Err(Error::Saved { .. })));
    assert!(matches!(refit(&program, &old, &PointCloud::default()), Err(Error::NotFound { .. })));
}

#[test]
fn the_command_writes_nothing_along_an_unknown_direction_unless_told_to() {
    let scratch = tempfile::tempdir().expect("a folder");
    let pipe = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/pipe");
    let run = |arguments: &[&str]| {
        let mut command = weldpath_tests::command::weldpath();
        command.args(arguments).current_dir(scratch.path()).output().expect("weldpath runs")
    };
    let pipe = pipe.to_str().expect("a path");
    assert!(run(&["plan", pipe, "--out", "saved", "--no-report", "-q"]).status.success());
    let refused = run(&["refit", "saved", pipe, "--out", "moved"]);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(3), "{said}");
    assert!(said.contains("UNKNOWN") && said.contains("--accept-unknown"), "{said}");
    assert!(!scratch.path().join("moved/path.json").exists());
    assert!(run(&["refit", "saved", pipe, "--out", "moved", "--accept-unknown", "-q"]).status.success());
    assert!(scratch.path().join("moved/path.json").exists());
}

#[test]
fn the_arm_is_checked_anew_where_the_part_is_now() {
    let home = tempfile::tempdir().unwrap();
    let fixture = plan_the_cell(home.path());
    let refit = |out: &str| {
        let mut command = weldpath();
        command.args(["refit", "out"]).arg(&fixture).args(["--out", out]).current_dir(home.path());
        end_of(&mut command)
    };
    let good = refit("near");
    assert_eq!(good.code, Some(0), "{}", good.said);
    assert!(
        good.said.contains("verdict: check") && good.said.contains("first-move-unchecked"),
        "{}",
        good.said
    );
    let script = std::fs::read_to_string(home.path().join("near/path.script")).unwrap();
    assert!(
        script.contains("movej([") && script.contains("links of"),
        "it begins by the joints that were checked"
    );
    // The robot stands elsewhere: what the saved plan was checked for holds no longer.
    let job = home.path().join("out/job.toml");
    let text = std::fs::read_to_string(&job).unwrap();
    let far = text.replace("base_mm = [0.0, 0.0, 0.0]", "base_mm = [5000.0, 0.0, 0.0]");
    assert_ne!(far, text);
    std::fs::write(&job, far).unwrap();
    let refused = refit("far");
    assert_eq!(refused.code, Some(8), "{}", refused.said);
    assert!(refused.said.contains("infeasible") && !home.path().join("far").exists(), "{}", refused.said);
}
