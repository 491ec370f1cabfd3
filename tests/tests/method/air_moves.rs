//! Air moves between seams, held against geometry: the torch is measured here anew, point by point, and no code of the
//! planner is used for it.

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use weldpath::geometry::cloud::PointCloud;
use weldpath::geometry::surface::Surface;
use weldpath::robot::feasibility::torch::Torch;
use weldpath::weld::air::terrain::Terrain;
use weldpath::weld::program::{Kind, Motion, Pass, Program, Waypoint, program};
use weldpath::weld::{PathPoint, Process, SeamPath};
use weldpath_tests::adversary::Random;

const CLEARANCE_MM: f64 = 30.0;

const MOTION: Motion = Motion {
    feed_mm_s: 8.0,
    approach_feed_mm_s: 25.0,
    air_feed_mm_s: 150.0,
    approach_mm: 50.0,
    retract_mm: 50.0,
    lift_mm: 10.0,
    clearance_mm: CLEARANCE_MM,
};

/// Points every 3 mm on `from + a u + b v`.
fn face(from: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Vec<Point3<f64>> {
    let [u, v] = [Vector3::from(u), Vector3::from(v)];
    let steps = |edge: &Vector3<f64>| (edge.norm() / 3.0).ceil() as i32;
    let at = |k: i32, edge: &Vector3<f64>| edge * (f64::from(k) / f64::from(steps(edge)));
    let row = |i: i32| (0..=steps(&v)).map(move |j| Point3::from(from) + at(i, &u) + at(j, &v));
    (0..=steps(&u)).flat_map(row).collect()
}

/// A wall across x: both faces and the top.
fn wall(x: [f64; 2], y: [f64; 2], height_mm: f64) -> Vec<Point3<f64>> {
    let along = [0.0, y[1] - y[0], 0.0];
    let side = |x: f64| face([x, y[0], 0.0], along, [0.0, 0.0, height_mm]);
    let top = face([x[0], y[0], height_mm], along, [x[1] - x[0], 0.0, 0.0]);
    [side(x[0]), side(x[1]), top].concat()
}

fn cloud(parts: &[Vec<Point3<f64>>]) -> PointCloud {
    let origin_mm = Point3::new(500.0, -300.0, 40.0);
    let points_mm: Vec<Point3<f32>> =
        parts.iter().flatten().map(|p| Point3::from((p - origin_mm).cast::<f32>())).collect();
    PointCloud { origin_mm, normals: vec![Vector3::z(); points_mm.len()], points_mm }
}

/// A straight path; `out` is the torch axis.
fn seam(id: usize, from: [f64; 3], to: [f64; 3], out: [f64; 3]) -> SeamPath {
    let (from, to) = (Point3::from(from), Point3::from(to));
    let (n, m) = (Vector3::from(out).normalize(), (to - from).normalize());
    let m = (m - n * n.dot(&m)).normalize();
    let columns = Matrix3::from_columns(&[m.cross(&n), m, n]);
    let base_from_torch = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns));
    let at = |k: i32| {
        let position_mm = from + (to - from) * (f64::from(k) / 20.0);
        PathPoint { s_mm: 0.0, position_mm, base_from_torch, process: Process::default() }
    };
    SeamPath { seam: id, points: (0..=20).map(at).collect() }
}

fn planned(paths: &[SeamPath], model: &PointCloud, torch: Option<&Torch>) -> Program {
    let passes: Vec<Pass> = paths.iter().map(|path| Pass { path: path.clone(), motion: MOTION }).collect();
    let balls = torch.map(Torch::balls);
    program(&passes, &Terrain::new(&Surface::of(model), paths, CLEARANCE_MM, balls.as_deref()))
}

/// Each way from a retract to the next approach, both with it.
fn ways(program: &Program) -> Vec<Vec<Waypoint>> {
    let waypoints = &program.waypoints;
    let mut ways = Vec::new();
    let mut retract = None;
    for (k, waypoint) in waypoints.iter().enumerate() {
        match (waypoint.kind, retract) {
            (Kind::Retract, _) => retract = Some(k),
            (Kind::Approach, Some(from)) => ways.push(waypoints[from..=k].to_vec()),
            _ => {}
        }
    }
    ways
}

fn length_mm(way: &[Waypoint]) -> f64 {
    way.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm()).sum()
}

fn highest_mm(way: &[Waypoint]) -> f64 {
    way.iter().map(|w| w.position_mm.z).fold(f64::NEG_INFINITY, f64::max)
}

/// A pose of the torch: tip, axis of nozzle and neck, axis of the body.
type Placed = (Point3<f64>, UnitQuaternion<f64>);

/// Every second millimetre of a move.
fn poses(from: &Waypoint, to: &Waypoint) -> Vec<Placed> {
    let steps = (0.5 * (to.position_mm - from.position_mm).norm()).ceil().max(12.0);
    let at = |k: i32| {
        let share = f64::from(k) / steps;
        let turned = from.base_from_torch.slerp(&to.base_from_torch, share);
        (from.position_mm + (to.position_mm - from.position_mm) * share, turned)
    };
    (0..=steps as i32).map(at).collect()
}

/// Radius of the straight torch so far from its tip; none where it has nothing.
fn radius_mm(torch: &Torch, along_mm: f64) -> Option<f64> {
    let neck_mm = torch.stickout_mm + torch.nozzle_length_mm;
    let body_mm = neck_mm + torch.neck_length_mm;
    match along_mm {
        s if s < torch.stickout_mm || s > body_mm + torch.body_length_mm => None,
        s if s <= neck_mm => Some(torch.nozzle_radius_mm),
        s if s <= body_mm => {
            let share = (s - neck_mm) / torch.neck_length_mm;
            Some(torch.nozzle_radius_mm + (torch.body_radius_mm - torch.nozzle_radius_mm) * share)
        }
        _ => Some(torch.body_radius_mm),
    }
}

/// Distance of the torch from a point, mm, by its discs, one every two millimetres.
fn distance_mm(torch: &Torch, (tip_mm, turn): &Placed, point: &Point3<f64>) -> f64 {
    let local = turn.inverse() * (point - tip_mm);
    let radial = local.x.hypot(local.y);
    let disc = |s: i32| {
        let s = f64::from(s);
        radius_mm(torch, s).map(|radius| (local.z - s).hypot((radial - radius).max(0.0)))
    };
    let nearest = local.z as i32;
    (nearest - 60..nearest + 60).step_by(2).filter_map(disc).fold(f64::INFINITY, f64::min)
}

/// Distance from all points; those farther than `sight_mm` from the torch's whole length are left out.
fn clearance_mm(torch: &Torch, pose: &Placed, points: &[Point3<f64>]) -> f64 {
    let (tip_mm, axis) = (pose.0, pose.1 * Vector3::z());
    let is_near = |p: &&Point3<f64>| {
        let v = *p - tip_mm;
        let along = v.dot(&axis).clamp(0.0, 270.0);
        (v - axis * along).norm() < 25.0 + CLEARANCE_MM + 5.0
    };
    points.iter().filter(is_near).map(|p| distance_mm(torch, pose, p)).fold(f64::INFINITY, f64::min)
}

/// The torch keeps the clearance wherever it is between `out` and `back`, and on the stretches to and from them it comes
/// no nearer than at their ends.
fn assert_clear(torch: &Torch, way: &[Waypoint], points: &[Point3<f64>]) {
    let turning = (0..way.len() - 1)
        .find(|&k| way[k].base_from_torch.angle_to(&way[k + 1].base_from_torch) > 1e-6)
        .unwrap_or((way.len() - 1) / 2);
    for k in 0..way.len() - 1 {
        let most_mm = if k == turning {
            CLEARANCE_MM
        } else {
            let end = if k < turning { &way[0] } else { &way[way.len() - 1] };
            clearance_mm(torch, &(end.position_mm, end.base_from_torch), points).min(CLEARANCE_MM) - 6.0
        };
        for pose in poses(&way[k], &way[k + 1]).iter().step_by(3) {
            let found_mm = clearance_mm(torch, pose, points);
            assert!(found_mm > most_mm - 1e-3, "{found_mm} mm at {pose:?}, of {most_mm}");
        }
    }
}

fn bare(points: &PointCloud) -> Vec<Point3<f64>> {
    (0..points.len()).map(|i| points.in_base_mm(i)).collect()
}

/// 400 mm by 300 mm, and something 200 mm high in a corner of it that lifts the safe level.
fn plate_with_a_post() -> Vec<Vec<Point3<f64>>> {
    vec![
        face([0.0, 0.0, 0.0], [400.0, 0.0, 0.0], [0.0, 300.0, 0.0]),
        wall([380.0, 400.0], [0.0, 20.0], 200.0),
    ]
}

#[test]
fn over_a_flat_plate_the_way_is_straight() {
    let model = cloud(&plate_with_a_post());
    let upright = [0.0, 0.0, 1.0];
    let paths = [
        seam(1, [60.0, 150.0, 0.0], [60.0, 250.0, 0.0], upright),
        seam(2, [160.0, 250.0, 0.0], [160.0, 150.0, 0.0], upright),
    ];
    let [way] = ways(&planned(&paths, &model, Some(&Torch::default()))).try_into().unwrap();
    assert_eq!(way.len(), 2, "{way:?}");
    assert!((length_mm(&way) - 100.0).abs() < 1e-9);
}

#[test]
fn a_wall_between_two_seams_is_passed_over_its_own_top_with_the_clearance() {
    let mut parts = plate_with_a_post();
    parts.push(wall([100.0, 110.0], [0.0, 300.0], 90.0));
    let model = cloud(&parts);
    let paths = [
        seam(1, [100.0, 200.0, 0.0], [100.0, 100.0, 0.0], [-1.0, 0.0, 1.0]),
        seam(2, [110.0, 100.0, 0.0], [110.0, 200.0, 0.0], [1.0, 0.0, 1.0]),
    ];
    let torch = Torch::default();
    let [way] = ways(&planned(&paths, &model, Some(&torch))).try_into().unwrap();
    let [safe] = ways(&planned(&paths, &model, None)).try_into().unwrap();
    assert!(highest_mm(&way) > 90.0 && highest_mm(&way) < 130.0, "{way:?}");
    assert!(length_mm(&way) < 0.5 * length_mm(&safe), "{} {}", length_mm(&way), length_mm(&safe));
    assert_clear(&torch, &way, &bare(&model));
}

#[test]
fn passes_in_one_corner_stay_in_it() {
    let web = || wall([100.0, 110.0], [0.0, 300.0], 150.0);
    let corner = |width_mm: f64| {
        let plate = face([100.0 - width_mm, 0.0, 0.0], [width_mm, 0.0, 0.0], [0.0, 300.0, 0.0]);
        cloud(&[plate, web()])
    };
    let pass = |off_mm: f64| {
        let x_mm = 100.0 - off_mm;
        seam(1, [x_mm, 40.0, off_mm], [x_mm, 260.0, off_mm], [-1.0, 0.0, 1.0])
    };
    let torch = Torch::default();
    for width_mm in [300.0, 30.0] {
        let model = corner(width_mm);
        let [way] = ways(&planned(&[pass(0.0), pass(3.0)], &model, Some(&torch))).try_into().unwrap();
        assert!(length_mm(&way) < 220.0 + 40.0, "{width_mm}: {} mm", length_mm(&way));
        assert!(highest_mm(&way) < 60.0, "{width_mm}: {way:?}");
        assert_clear(&torch, &way, &bare(&model));
    }
}

#[test]
fn a_place_that_was_not_seen_is_not_crossed_below_the_highest_point() {
    let half = |from: f64| face([from, 0.0, 0.0], [150.0, 0.0, 0.0], [0.0, 300.0, 0.0]);
    let post = wall([0.0, 20.0], [0.0, 20.0], 120.0);
    let upright = [0.0, 0.0, 1.0];
    let paths = [
        seam(1, [75.0, 150.0, 0.0], [75.0, 200.0, 0.0], upright),
        seam(2, [325.0, 200.0, 0.0], [325.0, 150.0, 0.0], upright),
    ];
    let torch = Torch::default();
    let rise = |parts: &[Vec<Point3<f64>>]| {
        let program = planned(&paths, &cloud(parts), Some(&torch));
        let [way] = ways(&program).try_into().unwrap();
        let over_gap = |(tip_mm, _): &Placed| (150.0 - 10.0..250.0 + 10.0).contains(&tip_mm.x);
        let poses: Vec<Placed> = way.windows(2).flat_map(|w| poses(&w[0], &w[1])).filter(over_gap).collect();
        poses.iter().map(|(tip_mm, _)| tip_mm.z).fold(f64::INFINITY, f64::min)
    };
    let unseen_mm = rise(&[half(0.0), half(250.0), post.clone()]);
    assert!(
        unseen_mm + torch.stickout_mm >= 120.0,
        "the nozzle is {unseen_mm} mm high over what was not seen"
    );
    let seen_mm =
        rise(&[half(0.0), half(250.0), face([150.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 300.0, 0.0]), post]);
    assert!((seen_mm - 50.0).abs() < 1e-6, "{seen_mm}");
}

#[test]
fn behind_a_wall_seen_from_one_side_is_no_way() {
    let model = cloud(&[
        face([0.0, 0.0, 0.0], [150.0, 0.0, 0.0], [0.0, 300.0, 0.0]),
        face([150.0, 0.0, 0.0], [0.0, 300.0, 0.0], [0.0, 0.0, 160.0]),
        face([320.0, 0.0, 0.0], [100.0, 0.0, 0.0], [0.0, 300.0, 0.0]),
    ]);
    let upright = [0.0, 0.0, 1.0];
    let paths = [
        seam(1, [330.0, 50.0, 0.0], [330.0, 100.0, 0.0], upright),
        seam(2, [330.0, 200.0, 0.0], [330.0, 250.0, 0.0], [-1.0, 0.0, 1.0]),
    ];
    let torch = Torch::default();
    let [way] = ways(&planned(&paths, &model, Some(&torch))).try_into().unwrap();
    assert_clear(&torch, &way, &bare(&model));
    let turning =
        way.windows(2).find(|w| w[0].base_from_torch.angle_to(&w[1].base_from_torch) > 0.1).unwrap();
    for (tip_mm, turn) in poses(&turning[0], &turning[1]) {
        for s in 15..265 {
            let p = tip_mm + turn * Vector3::z() * f64::from(s);
            // Where a torch of the second weld goes is known; it leans there from x = 330 mm on.
            let on_weld = p.y > 150.0 && p.z > 330.0 - p.x - 60.0;
            assert!(p.x > 320.0 || p.z > 160.0 || on_weld, "the torch is at {p}, where nothing was seen");
        }
    }
}

#[test]
fn among_random_walls_ways_are_clear_and_never_longer_than_over_the_safe_level() {
    let random = &mut Random::new(17);
    let torch = Torch::default();
    let (mut shorter, mut all) = (0, 0);
    for _ in 0..6 {
        let mut parts = vec![face([0.0, 0.0, 0.0], [400.0, 0.0, 0.0], [0.0, 300.0, 0.0])];
        for k in 0..3 {
            let x = 80.0 + 120.0 * f64::from(k);
            let y = 150.0 * random.unit();
            parts.push(wall([x, x + 8.0], [y, y + 100.0], 20.0 + 120.0 * random.unit()));
        }
        let model = cloud(&parts);
        let paths: Vec<SeamPath> = (0..3)
            .map(|k| {
                let x = 40.0 + 120.0 * f64::from(k);
                let (a, b) = (300.0 * random.unit(), 300.0 * random.unit());
                let lean = random.unit() - 0.5;
                seam(k as usize + 1, [x, a, 0.0], [x, b, 0.0], [lean, 0.3 * lean, 1.0])
            })
            .collect();
        let [short, safe] = [Some(&torch), None].map(|torch| ways(&planned(&paths, &model, torch)));
        for (short, safe) in short.iter().zip(&safe) {
            assert!(length_mm(short) <= length_mm(safe) + 1e-6);
            all += 1;
            if length_mm(short) < length_mm(safe) - 1e-6 {
                shorter += 1;
                assert_clear(&torch, short, &bare(&model));
            }
        }
    }
    assert!(2 * shorter > all, "{shorter} of {all} ways are shorter than over the safe level");
}
