//! Whole programs: what a person who knows the arm would say of them.

use super::*;
use nalgebra::{Point3, Translation3, Vector3};
use problem::ProblemKind;
use suggestion::Change;
use weldpath_method::weld::air::terrain::Terrain;
use weldpath_method::weld::ends::reverse;
use weldpath_method::weld::program::{Motion, Pass, Waypoint, program};
use weldpath_method::weld::recipe::{Recipe, apply};
use weldpath_method::weld::{PathPoint, Process, SeamPath};

const MOTION: Motion = Motion {
    feed_mm_s: 8.0,
    approach_feed_mm_s: 25.0,
    air_feed_mm_s: 150.0,
    approach_mm: 50.0,
    retract_mm: 50.0,
    lift_mm: 10.0,
    clearance_mm: 50.0,
};

fn setup(name: &str) -> FeasibilitySetup {
    let robot = PlacedArm {
        arm: arm::by_name(name).unwrap(),
        base_from_robot: Isometry3::identity(),
        flange_from_tcp: Isometry3::translation(0.0, 0.0, 300.0),
    };
    FeasibilitySetup { robot: Some(robot), torch: Torch::default(), clearance_mm: 1.0 }
}

/// A straight seam along y through a place, torch upright or turned about its axis.
fn seam(id: usize, at_mm: [f64; 3], turn_deg: f64) -> SeamPath {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_deg.to_radians());
    let point = |i: i32| PathPoint {
        s_mm: f64::from(i) * 2.0,
        position_mm: Point3::from(at_mm) + Vector3::y() * (f64::from(i) * 2.0 - 100.0),
        base_from_torch: turn,
        process: Process::default(),
    };
    SeamPath { seam: id, points: (0..=100).map(point).collect() }
}

/// A plate 40 mm below the seams' height of 100 mm.
fn table() -> PointCloud {
    let points_mm: Vec<Point3<f32>> = (0..200)
        .flat_map(|i| {
            (0..200).map(move |j| Point3::new(300.0 + 2.0 * i as f32, -200.0 + 2.0 * j as f32, 60.0))
        })
        .collect();
    PointCloud { origin_mm: Point3::origin(), normals: vec![Vector3::z(); points_mm.len()], points_mm }
}

/// The program of one pass along each path.
fn welded(paths: &[SeamPath], model: &PointCloud) -> Vec<Waypoint> {
    let passes: Vec<Pass> = paths.iter().map(|path| Pass { path: path.clone(), motion: MOTION }).collect();
    program(&passes, &Terrain::new(model, paths, MOTION.clearance_mm, None)).waypoints
}

fn assessed(paths: &[SeamPath], model: &PointCloud, setup: &FeasibilitySetup) -> Report {
    let changed = |changes: &[(usize, Change)]| -> Vec<SeamPath> {
        paths
            .iter()
            .map(|path| {
                changes
                    .iter()
                    .filter(|(seam, _)| *seam == path.seam)
                    .fold(path.clone(), |path, (_, change)| rewelded(&path, *change))
            })
            .collect()
    };
    assess(&|changes| welded(&changed(changes), model), model, setup)
}

/// A path with a change, welded by nothing else.
fn rewelded(path: &SeamPath, change: Change) -> SeamPath {
    let path = if change.reverses() { reverse(path) } else { path.clone() };
    apply(&path, &change.on(Recipe::default()))
}

#[test]
fn a_seam_amid_the_workspace_is_feasible_for_arms_of_every_kind() {
    for (name, x) in
        [("ur5e", 450.0), ("ur10e", 600.0), ("kuka-kr10-r1420", 800.0), ("abb-irb1600-10-145", 800.0)]
    {
        let report = assessed(&[seam(1, [x, 0.0, 100.0], 0.0)], &PointCloud::default(), &setup(name));
        assert!(report.is_feasible(), "{name}: {:?}", report.problems);
        assert!(report.suggestions.is_empty());
        let setup = setup(name);
        let robot = setup.robot.unwrap();
        let waypoints = welded(&[seam(1, [x, 0.0, 100.0], 0.0)], &PointCloud::default());
        for (waypoint, check) in waypoints.iter().zip(&report.checks) {
            let joints = check.joints.unwrap();
            assert!(joints.margin_rad > 0.0 && joints.speed_share < 1.0);
            let tip = robot.arm.forward(&joints.joints_rad) * robot.flange_from_tcp * Point3::origin();
            assert!(
                (tip - waypoint.position_mm).norm() < 1e-3,
                "{name}: the joints bring the tip to the waypoint"
            );
        }
    }
}

#[test]
fn a_seam_two_metres_away_is_out_of_reach_and_no_turn_of_the_torch_is_suggested() {
    let report = assessed(&[seam(3, [2000.0, 0.0, 100.0], 0.0)], &PointCloud::default(), &setup("ur5e"));
    assert!(!report.is_feasible() && report.suggestions.is_empty());
    assert!(report.checks.iter().all(|check| check.joints.is_none()));
    let words = report.warnings().join("\n");
    assert!(words.contains("seam 3, waypoints 0 to") && words.contains("move the part"), "{words}");
}

#[test]
fn the_base_placement_brings_the_same_seam_within_reach() {
    let mut setup = setup("ur5e");
    let robot = setup.robot.as_mut().unwrap();
    robot.base_from_robot = Isometry3::from_parts(
        Translation3::new(2000.0, 450.0, 0.0),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -std::f64::consts::FRAC_PI_2),
    );
    let report = assessed(&[seam(1, [2000.0, 0.0, 100.0], 0.0)], &PointCloud::default(), &setup);
    assert!(report.is_feasible(), "{:?}", report.problems);
}

/// With the wire along its last axis' offset, an arm that may turn its last joint by 20 degrees only reaches few headings.
#[test]
fn a_turn_about_the_torch_axis_is_suggested_where_the_last_joint_has_no_range_left() {
    let mut setup = setup("ur5e");
    let model = PointCloud::default();
    let free = assessed(&[seam(1, [450.0, 0.0, 100.0], 0.0)], &model, &setup);
    let used: Vec<f64> =
        free.checks.iter().map(|check| check.joints.unwrap().joints_rad[5].to_degrees()).collect();
    let (low, high) = used.iter().fold((f64::MAX, f64::MIN), |(l, h), &q| (l.min(q), h.max(q)));
    // The range ends a little before the way begins, on one side; on the other it goes on.
    let robot = setup.robot.as_mut().unwrap();
    robot.arm.limits.range_rad = [[-360.0, 360.0]; 6].map(|range: [f64; 2]| range.map(f64::to_radians));
    robot.arm.limits.range_rad[5] = [high + 2.0, high + 62.0 + (high - low)].map(f64::to_radians);
    for j in 0..5 {
        // Only the branch that was used.
        let way: Vec<f64> = free.checks.iter().map(|check| check.joints.unwrap().joints_rad[j]).collect();
        let (low, high) = way.iter().fold((f64::MAX, f64::MIN), |(l, h), &q| (l.min(q), h.max(q)));
        robot.arm.limits.range_rad[j] = [low - 0.3, high + 0.3];
    }
    let report = assessed(&[seam(1, [450.0, 0.0, 100.0], 0.0)], &model, &setup);
    assert!(report.problems.iter().any(|p| p.kind == ProblemKind::Limit), "{:?}", report.problems);
    let [suggestion] = report.suggestions.as_slice() else { panic!("{:?}", report.suggestions) };
    assert!(suggestion.solves_all && suggestion.seam == 1);
    let changed = rewelded(&seam(1, [450.0, 0.0, 100.0], 0.0), suggestion.change);
    assert!(assessed(&[changed], &model, &setup).is_feasible(), "{suggestion:?} must do what it says");
    assert!(
        report.warnings().iter().any(|w| w.contains("tried: the whole program")),
        "{:?}",
        report.warnings()
    );
}

#[test]
fn a_torch_pressed_into_the_table_collides_and_held_above_it_does_not() {
    let (model, setup) = (table(), setup("ur5e"));
    let above = assessed(&[seam(1, [450.0, 0.0, 100.0], 0.0)], &model, &setup);
    assert!(above.is_feasible(), "{:?}", above.problems);
    let below = assessed(&[seam(1, [450.0, 0.0, 20.0], 0.0)], &model, &setup);
    assert!(
        below.problems.iter().any(|p| p.kind == ProblemKind::Collision && p.seam == Some(1)),
        "{:?}",
        below.problems
    );
    let free = FeasibilitySetup { robot: None, ..setup };
    let torch_only = assessed(&[seam(1, [450.0, 0.0, 20.0], 0.0)], &model, &free);
    assert!(!torch_only.is_feasible() && torch_only.checks.iter().all(|check| check.joints.is_none()));
}

#[test]
fn another_work_angle_is_suggested_beside_a_wall() {
    // A wall 8 mm beside the seam: the nozzle of 10 mm radius meets it, leaning away it does not.
    let points_mm: Vec<Point3<f32>> = (0..150)
        .flat_map(|j| {
            (0..30).map(move |k| Point3::new(458.0, -150.0 + 2.0 * j as f32, 100.0 + 2.0 * k as f32))
        })
        .collect();
    let model =
        PointCloud { origin_mm: Point3::origin(), normals: vec![Vector3::z(); points_mm.len()], points_mm };
    let report = assessed(&[seam(1, [450.0, 0.0, 100.0], 0.0)], &model, &setup("ur5e"));
    assert!(report.problems.iter().any(|p| p.kind == ProblemKind::Collision));
    let [suggestion] = report.suggestions.as_slice() else { panic!("{:?}", report) };
    assert!(matches!(suggestion.change, Change::WorkAngle(deg) if deg < 0.0), "{suggestion:?}");
    let changed = rewelded(&seam(1, [450.0, 0.0, 100.0], 0.0), suggestion.change);
    assert!(changed.points[0].out_of_work().x < 0.0, "the torch leans away from the wall");
    assert!(assessed(&[changed], &model, &setup("ur5e")).is_feasible());
}

#[test]
fn a_reversed_path_runs_back_over_the_same_tips_with_a_right_handed_frame() {
    let path = seam(1, [450.0, 0.0, 100.0], 30.0);
    let back = rewelded(&path, Change::Reverse);
    assert_eq!(back.points.len(), path.points.len());
    assert_eq!(back.points[0].position_mm, path.points[100].position_mm);
    assert!((back.points[0].s_mm, back.points[100].s_mm) == (0.0, 200.0));
    for (there, here) in path.points.iter().rev().zip(&back.points) {
        assert!((there.out_of_work() - here.out_of_work()).norm() < 1e-12);
        let m = |point: &PathPoint| point.base_from_torch * Vector3::y();
        assert!((m(there) + m(here)).norm() < 1e-12);
    }
}

#[test]
fn the_feed_decides_whether_a_joint_is_too_fast() {
    let mut setup = setup("ur5e");
    setup.robot.as_mut().unwrap().arm.limits.speed_rad_s = [0.005; 6];
    let report = assessed(&[seam(1, [450.0, 0.0, 100.0], 0.0)], &PointCloud::default(), &setup);
    assert!(report.problems.iter().any(|p| p.kind == ProblemKind::Speed), "{:?}", report.problems);
}

#[test]
fn an_empty_program_has_nothing_to_check() {
    let report = assessed(&[], &PointCloud::default(), &setup("ur5e"));
    assert!(report.is_feasible() && report.checks.is_empty() && report.warnings().is_empty());
}
