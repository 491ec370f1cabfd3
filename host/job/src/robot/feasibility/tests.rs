//! Whole programs: what a person who knows the arm would say of them.

use super::*;
use crate::robot::posture::Maker;
use links::Obstacle;
use nalgebra::{Point3, Translation3, Vector3};
use problem::ProblemKind;
use suggestion::Change;
use weldpath_method::geometry::cloud::PointCloud;
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
        floor: Floor::Mounting,
        home_rad: None,
        end: ProgramEnd::Stay,
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
    program(&passes, &Terrain::new(&Surface::of(model), paths, MOTION.clearance_mm, None)).waypoints
}

fn assessed(paths: &[SeamPath], model: &PointCloud, setup: &FeasibilitySetup) -> Report {
    assessed_among(paths, model, model, setup)
}

/// The air moves pass over `terrain` and know nothing of what else is in `model`.
fn assessed_among(
    paths: &[SeamPath],
    terrain: &PointCloud,
    model: &PointCloud,
    setup: &FeasibilitySetup,
) -> Report {
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
    assess(&|changes| welded(&changed(changes), terrain), &Surface::of(model), setup)
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
    assert!(
        words.contains("seam 3, 0 to 200 mm along it (waypoints 0 to") && words.contains("move the part"),
        "{words}"
    );
}

#[test]
fn what_is_out_of_reach_is_said_to_be_too_far_or_too_near_and_by_how_much() {
    let unreached = |name: &str, x_mm: f64| -> Option<Problem> {
        let report = assessed(&[seam(1, [x_mm, 0.0, 100.0], 0.0)], &PointCloud::default(), &setup(name));
        report.problems.into_iter().find(|problem| problem.kind == ProblemKind::OutOfReach)
    };
    for (name, x_mm, word) in
        [("ur5e", 2000.0, "too far"), ("ur10e", 1500.0, "too far"), ("ur5e", 60.0, "too near")]
    {
        let problem = unreached(name, x_mm).expect("out of reach");
        let words = problem.words(name);
        assert!(words.contains(word), "{words}");
        let shift_mm = problem.shift_mm.expect("a way");
        assert!(unreached(name, x_mm + shift_mm).is_none(), "{name}: {words}");
        assert!(unreached(name, x_mm + shift_mm - 20.0 * shift_mm.signum()).is_some(), "{name}: {words}");
    }
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

fn joints_of(report: &Report) -> Vec<Joints> {
    report.checks.iter().map(|check| check.joints.unwrap().joints_rad).collect()
}

fn wall(x_mm: std::ops::Range<i32>, y_mm: std::ops::Range<i32>, z_mm: std::ops::Range<i32>) -> PointCloud {
    let raster =
        |range: &std::ops::Range<i32>| range.clone().step_by(6).map(|v| v as f32).collect::<Vec<_>>();
    let [xs, ys, zs] = [&x_mm, &y_mm, &z_mm].map(raster);
    let points_mm: Vec<Point3<f32>> = xs
        .iter()
        .flat_map(|x| ys.iter().flat_map(|y| zs.iter().map(|z| Point3::new(*x, *y, *z))).collect::<Vec<_>>())
        .collect();
    PointCloud { origin_mm: Point3::origin(), normals: vec![Vector3::z(); points_mm.len()], points_mm }
}

/// Elbow above, facing the work, wrist bent, nothing below the floor: for arms of all makers, wherever the work is around them.
#[test]
fn arms_of_all_makers_stand_over_the_work_as_a_person_would_have_them_stand() {
    for (name, reach_mm) in [
        ("ur5e", 500.0),
        ("ur10e", 700.0),
        ("kuka-kr10-r1420", 850.0),
        ("abb-irb1600-10-145", 850.0),
        ("fanuc-m10ia", 850.0),
    ] {
        for azimuth_deg in [0.0f64, 100.0, -80.0, 170.0] {
            let mut setup = setup(name);
            let robot = setup.robot.as_mut().unwrap();
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), azimuth_deg.to_radians());
            let mounting_mm = robot.arm.body.mounting_mm;
            robot.base_from_robot = Isometry3::from_parts(
                (turn * Vector3::new(-reach_mm, 0.0, 0.0) - Vector3::z() * mounting_mm).into(),
                turn,
            );
            let report = assessed(&[seam(1, [0.0, 0.0, 100.0], 40.0)], &PointCloud::default(), &setup);
            assert!(report.problems.is_empty(), "{name} at {azimuth_deg}: {:?}", report.problems);
            let robot = setup.robot.as_ref().unwrap();
            for joints in joints_of(&report) {
                // The elbow is where the forward kinematics have it with the joints behind it folded away.
                let elbow_mm = robot.base_from_robot * chain::LinkChain::of(&robot.arm).elbow_mm(&joints);
                assert!(elbow_mm.z > 250.0, "{name} at {azimuth_deg}: elbow at {} mm", elbow_mm.z);
            }
        }
    }
}

#[test]
fn a_floor_that_the_arm_would_have_to_go_through_is_named_with_the_link() {
    let mut setup = setup("ur5e");
    setup.robot.as_mut().unwrap().floor = Floor::At(700.0);
    let path = seam(4, [450.0, 0.0, 100.0], 0.0);
    let report = assessed(std::slice::from_ref(&path), &PointCloud::default(), &setup);
    assert!(!report.is_feasible());
    let problem = report.problems.iter().find(|p| p.kind == ProblemKind::LinkCollision).unwrap();
    assert_eq!((problem.seam, problem.touch.unwrap().obstacle), (Some(4), Obstacle::Floor));
    let words = report.warnings().join("\n");
    assert!(words.contains("of ur5e is up to") && words.contains("below the floor"), "{words}");
    setup.robot.as_mut().unwrap().floor = Floor::None;
    assert!(assessed(&[path], &PointCloud::default(), &setup).is_feasible());
}

/// Where the upper arm stands, a wall is scanned: with it the arm stands otherwise, and with walls all around it cannot.
#[test]
fn what_was_scanned_where_a_link_would_stand_makes_it_stand_elsewhere_or_not_at_all() {
    let path = [seam(1, [450.0, 0.0, 100.0], 0.0)];
    let setup = setup("ur5e");
    let robot = setup.robot.as_ref().unwrap();
    let free = assessed(&path, &PointCloud::default(), &setup);
    let chain = chain::LinkChain::of(&robot.arm);
    let elbows_mm: Vec<Point3<f64>> = joints_of(&free).iter().map(|joints| chain.elbow_mm(joints)).collect();
    let middle = elbows_mm[elbows_mm.len() / 2].map(|v| v.round() as i32);
    let around = |half: i32| {
        wall(
            middle.x - half..middle.x + half,
            middle.y - half..middle.y + half,
            middle.z - half..middle.z + half,
        )
    };
    let among = |model: &PointCloud| assessed_among(&path, &PointCloud::default(), model, &setup);
    let report = among(&around(40));
    for (joints, before_mm) in joints_of(&report).iter().zip(&elbows_mm) {
        let moved_mm = (chain.elbow_mm(joints) - before_mm).norm();
        assert!(!report.is_feasible() || moved_mm > 60.0, "the elbow stays in the wall: {moved_mm}");
    }
    let report = among(&wall(-700..900, -700..700, 500..501));
    let low = among(&wall(-700..900, -700..700, 330..331));
    assert!(report.is_feasible() || !low.is_feasible(), "a lower ceiling leaves less room");
    assert!(
        low.problems.iter().any(|p| p.touch.is_some_and(|touch| touch.obstacle == Obstacle::Work)),
        "{low:?}"
    );
}

#[test]
fn an_arm_that_can_only_reach_backwards_is_odd_and_no_fault() {
    let mut setup = setup("kuka-kr10-r1420");
    let path = [seam(1, [800.0, 0.0, 400.0], 0.0)];
    let free = assessed(&path, &PointCloud::default(), &setup);
    assert!(free.problems.is_empty(), "{:?}", free.problems);
    // Joint 1 may only face away.
    let arm = &mut setup.robot.as_mut().unwrap().arm;
    arm.limits.range_rad = [[-400.0f64, 400.0]; 6].map(|range| range.map(f64::to_radians));
    arm.limits.range_rad[0] = [120.0, 240.0].map(f64::to_radians);
    let report = assessed(&path, &PointCloud::default(), &setup);
    let kinds: Vec<ProblemKind> = report.problems.iter().map(|p| p.kind).collect();
    assert!(report.is_feasible() && kinds.contains(&ProblemKind::OddPosture), "{:?}", report.problems);
    assert!(report.warnings().iter().any(|w| w.contains("reaches backwards")), "{:?}", report.warnings());
}

#[test]
fn the_way_from_home_is_checked_with_links_torch_and_floor() {
    let path = [seam(1, [450.0, 0.0, 100.0], 0.0)];
    let mut setup = setup("ur5e");
    let first = joints_of(&assessed(&path, &PointCloud::default(), &setup))[0];
    let robot = setup.robot.as_mut().unwrap();
    // Joint 1 turned by a right angle; the torch passes over the table's place, and a post stands there.
    let mut home = first;
    home[0] += 1.5;
    (robot.home_rad, robot.end) = (Some(home), ProgramEnd::Home);
    assert!(assessed(&path, &PointCloud::default(), &setup).is_feasible());
    let half: Joints = std::array::from_fn(|j| 0.5 * (first[j] + home[j]));
    let robot = setup.robot.as_ref().unwrap();
    let tip = (robot.arm.forward(&half) * robot.flange_from_tcp * Point3::origin()).map(|v| v.round() as i32);
    let post = wall(tip.x - 20..tip.x + 20, tip.y - 20..tip.y + 20, tip.z - 60..tip.z + 60);
    let report = assessed_among(&path, &PointCloud::default(), &post, &setup);
    let kinds: Vec<ProblemKind> = report.problems.iter().map(|p| p.kind).collect();
    assert!(kinds.contains(&ProblemKind::FromHome) && kinds.contains(&ProblemKind::ToHome), "{kinds:?}");
    assert!(!kinds.contains(&ProblemKind::Collision), "the seam itself is free: {kinds:?}");
}

#[test]
fn a_program_for_fanuc_gets_joint_3_from_the_horizontal_and_those_of_others_as_they_are() {
    for (name, maker) in [("fanuc-m10ia", Maker::Fanuc), ("ur10e", Maker::UniversalRobots)] {
        let report = assessed(&[seam(1, [800.0, 0.0, 200.0], 0.0)], &PointCloud::default(), &setup(name));
        let posture = report.posture.as_ref().unwrap();
        assert_eq!(posture.counted_by, Some(maker));
        for (stance, joints_rad) in posture.stances.iter().zip(joints_of(&report)) {
            let mut wanted = joints_rad.map(f64::to_degrees);
            if maker == Maker::Fanuc {
                wanted[2] -= wanted[1];
            }
            assert!(stance.joints_deg.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9));
            let back = arm::by_name(name).unwrap().counting.unwrap().from_shown_rad(&stance.joints_deg);
            assert!(back.iter().zip(joints_rad).all(|(a, b)| (a - b).abs() < 1e-12));
            assert!(stance.front && stance.elbow_up);
        }
    }
}

#[test]
fn strays_all_over_the_place_are_no_wall_and_a_thin_surface_is() {
    let path = [seam(1, [450.0, 0.0, 100.0], 0.0)];
    let setup = setup("ur5e");
    let mut model = table();
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    // Two in a hundred, in the box around part and torch.
    for _ in 0..model.points_mm.len() / 50 {
        model.points_mm.push(Point3::new(
            300.0 + 400.0 * random(),
            -200.0 + 400.0 * random(),
            60.0 + 300.0 * random(),
        ));
        model.normals.push(Vector3::z());
    }
    let report = assessed(&path, &model, &setup);
    assert!(report.problems.is_empty(), "{:?}", report.problems);
    // A sheet across the seam, seen three times as thinly as the table.
    for y in 0..30 {
        for z in 0..30 {
            model.points_mm.push(Point3::new(
                450.0 + y as f32 * 0.1,
                -90.0 + 6.0 * y as f32,
                110.0 + 6.0 * z as f32,
            ));
            model.normals.push(Vector3::x());
        }
    }
    let report = assessed(&path, &model, &setup);
    assert!(report.problems.iter().any(|p| p.kind == ProblemKind::Collision), "{:?}", report.problems);
}
