//! What is true of single parts, by formulas that the parts are not made with.

use super::super::workpiece::{TrueSeam, TrueStation, Workpiece};
use super::*;
use crate::evaluation::TruthSeam;

fn seam<'a>(piece: &'a Workpiece, name: &str) -> &'a TrueSeam {
    piece.seams.iter().find(|seam| seam.name == name).expect("a seam of this name")
}

/// Tangents point from each station to the next, both faces hold them, and the last station leads back to the first.
fn assert_closed(seam: &TrueSeam) {
    assert!(seam.closed && seam.required);
    let next = seam.stations.iter().cycle().skip(1);
    for (station, next) in seam.stations.iter().zip(next) {
        let step = next.apex - station.apex;
        assert!((0.9..1.1).contains(&step.norm()), "{step}");
        // Over a chord of 1 mm a corner of 6 mm turns by 0.17.
        assert!((step.normalize() - station.tangent).norm() < 0.1, "{step} {}", station.tangent);
        assert!(station.faces.iter().all(|face| face.dot(&station.tangent).abs() < 1e-9));
    }
}

/// Gradient of a surface's function by central differences.
fn gradient(of: &impl Fn(Point3<f64>) -> f64, at: Point3<f64>) -> Vector3<f64> {
    let along = |axis: Vector3<f64>| (of(at + axis * 1e-5) - of(at - axis * 1e-5)) / 2e-5;
    Vector3::new(along(Vector3::x()), along(Vector3::y()), along(Vector3::z()))
}

/// A station's apex lies on the surface of a function that is zero there and grows outwards, with that face's normal.
fn assert_on(station: &TrueStation, face: usize, of: impl Fn(Point3<f64>) -> f64) {
    assert!(of(station.apex).abs() < 1e-9, "{} off the surface", of(station.apex));
    let off = gradient(&of, station.apex) - station.faces[face];
    assert!(off.norm() < 1e-4, "normal off by {off}");
}

/// Distance from the axis through `point` along the unit vector `axis`, less `radius`.
fn from_axis(point: Point3<f64>, axis: Vector3<f64>, radius: f64) -> impl Fn(Point3<f64>) -> f64 {
    move |p| (p - point).cross(&axis).norm() - radius
}

#[test]
fn a_branch_at_45_degrees_meets_the_main_pipe_on_both_cylinders() {
    let request = Request { angle_deg: Some(45.0), ..small(Part::Saddle) };
    let piece = Workpiece::of(&request);
    let (main, radius) = (piece.drawn["R"], piece.drawn["r"]);
    let crossing = Point3::new(0.0, 0.0, main);
    let leaning = Vector3::new(1.0, 0.0, 1.0).normalize();
    let seam = seam(&piece, "saddle");
    assert_closed(seam);
    for station in &seam.stations {
        assert_on(station, 0, from_axis(crossing, leaning, radius));
        assert_on(station, 1, from_axis(crossing, Vector3::x(), main));
        assert!(station.apex.z > main, "on the upper side");
    }
    // In the plane of both axes the angle between the pipes is the one between the axes.
    let included = |s: &TrueStation| 180.0 - s.faces[0].angle(&s.faces[1]).to_degrees();
    let level = |s: &&TrueStation| s.apex.y.abs() < 0.5;
    let ends: Vec<&TrueStation> = seam.stations.iter().filter(level).collect();
    for station in &ends {
        let expected = if station.apex.x > ends[0].apex.x - 10.0 { 45.0 } else { 135.0 };
        assert!((included(station) - expected).abs() < 0.5, "{}", included(station));
    }
    assert!(ends.iter().any(|station| included(station) > 90.0));
}

#[test]
fn a_square_tube_meets_its_plate_in_sides_and_round_corners() {
    let piece = Workpiece::of(&small(Part::SquareTube));
    let (half, plate) = (piece.drawn["half_side"], piece.drawn["T"]);
    let turn = super::super::rotation::about(Vector3::z(), -piece.drawn["turn_deg"]);
    // Distance from a square with round corners.
    let square = |p: Point3<f64>, half: f64, corner: f64| {
        let p = turn * p;
        let (x, y) = (p.x.abs() - (half - corner), p.y.abs() - (half - corner));
        x.max(0.0).hypot(y.max(0.0)) + x.max(y).min(0.0) - corner
    };
    let tube = |p| square(p, half, 6.0);
    let inside = seam(&piece, "tube inside");
    assert!(inside.closed && !inside.required);
    for station in &inside.stations {
        assert_on(station, 0, |p| -square(p, half - 4.0, 2.0));
    }
    let seam = seam(&piece, "tube");
    assert_closed(seam);
    let round = 8.0 * (half - 6.0) + 12.0 * std::f64::consts::PI;
    assert!((seam.stations.len() as f64 - round).abs() < 1.0);
    for station in &seam.stations {
        assert_on(station, 0, tube);
        assert_on(station, 1, |p| p.z - plate);
    }
}

#[test]
fn boss_and_elbow_stand_on_a_circle() {
    for (part, name) in [(Part::Boss, "boss"), (Part::Elbow, "outer")] {
        let piece = Workpiece::of(&small(part));
        let (radius, plate) = (piece.drawn["r"], piece.drawn["T"]);
        let seam = seam(&piece, name);
        assert_closed(seam);
        assert!((seam.stations.len() as f64 - 2.0 * std::f64::consts::PI * radius).abs() < 1.0);
        for station in &seam.stations {
            assert_on(station, 0, from_axis(Point3::origin(), Vector3::z(), radius));
            assert_on(station, 1, |p| p.z - plate);
        }
    }
}

#[test]
fn an_elbow_is_a_torus() {
    let piece = Workpiece::of(&small(Part::Elbow));
    let [plate, leg, radius, bend] = ["T", "leg", "r", "R"].map(|name| piece.drawn[name]);
    let scene = Scene::new(piece.solids, -1.0);
    let centre = Point3::new(bend, 0.0, plate + leg);
    let mut met = 0;
    for step in 0..200 {
        // Level lines of sight from the side onto the bend.
        let turn = std::f64::consts::FRAC_PI_2 * f64::from(step) / 200.0;
        for off in [-15.0, -8.0, 0.0, 8.0, 15.0] {
            let (x, z) = ((bend + off) * turn.cos(), (bend + off) * turn.sin());
            let from = Point3::new(bend - x, -200.0, plate + leg + z + 1e-3);
            let hit = scene.cast(from, Vector3::y()).expect("the bend");
            let at = from + Vector3::y() * hit.distance - centre;
            let far_mm = (at.x.hypot(at.z) - bend).hypot(at.y) - radius;
            assert!(far_mm.abs() < 0.02, "{far_mm} mm off the torus at {turn}, {off}");
            met += 1;
        }
    }
    assert_eq!(met, 1000);
}

#[test]
fn a_half_v_opens_by_its_angle_above_its_gap() {
    let request = Request { thickness_mm: Some(25.0), ..small(Part::HalfV) };
    let piece = Workpiece::of(&request);
    let seam = seam(&piece, "groove");
    assert_eq!(piece.drawn["T"], 25.0);
    assert!((seam.included_deg() - 50.0).abs() < 1e-6);
    for station in &seam.stations {
        let root = station.root;
        assert!((root.y + 0.5 * piece.drawn["gap"]).abs() < 1e-9);
        assert!((root.z - piece.drawn["root_face"]).abs() < 1e-9);
        assert_on(station, 1, |p| -p.y);
    }
}

#[test]
fn both_sides_of_a_leaning_web_are_in_the_truth() {
    for angle_deg in [60.0, 120.0] {
        let piece = Workpiece::of(&Request { angle_deg: Some(angle_deg), ..small(Part::Fillet) });
        let (right, left) = (seam(&piece, "right"), seam(&piece, "left"));
        assert!((right.included_deg() - angle_deg).abs() < 1e-6);
        assert!((left.included_deg() - (180.0 - angle_deg)).abs() < 1e-6);
        assert!(right.required && !left.required);
        // The web's thickness is measured across it.
        let between = (left.stations[0].apex - right.stations[0].apex).dot(&left.faces_of_web());
        assert!((between - piece.drawn["t"]).abs() < 1e-9, "{between}");
    }
}

impl TrueSeam {
    fn faces_of_web(&self) -> Vector3<f64> {
        self.stations[0].faces[1]
    }
}

#[test]
fn sheet_is_as_thin_as_asked_and_all_else_is_as_drawn() {
    for part in [Part::Fillet, Part::Lap] {
        let thick = stage(&small(part)).unwrap().truth;
        let sheet = Request { thickness_mm: Some(1.5), ..small(part) };
        let thin = stage(&sheet).unwrap();
        let sizes: Vec<f64> = thin.truth.params.values().copied().collect();
        assert_eq!(sizes.iter().filter(|size| **size == 1.5).count(), 2, "{sizes:?}");
        assert_eq!(thick.params.len(), sizes.len());
        let seam = &thin.truth.seams[0];
        assert!((seam.p[0][2] - thin.truth.ztable - 1.5).abs() < 2e-3, "the seam is on the lower sheet");
    }
}

/// Lengths of the runs of stations that no two views see, in stations.
fn hidden_runs(seam: &TruthSeam) -> Vec<usize> {
    let visible: Vec<bool> = seam.visible.iter().map(|v| *v > 0).collect();
    visible.chunk_by(|a, b| a == b).filter(|run| !run[0]).map(<[bool]>::len).collect()
}

#[test]
fn tacks_cover_the_joint_in_places_and_do_not_move_it() {
    let plain = Request { width: 640, height: 480, ..small(Part::Fillet) };
    let tacked = Request { tacks: Some(Tacks { count: 5, leg_mm: 4.0 }), ..plain.clone() };
    let (plain, tacked) = (stage(&plain).unwrap().truth, stage(&tacked).unwrap().truth);
    assert_eq!(plain.seams[0].p, tacked.seams[0].p);
    let hidden = |truth: &crate::evaluation::Truth| hidden_runs(&truth.seams[0]);
    let beads: Vec<usize> =
        hidden(&tacked).into_iter().filter(|run| !hidden(&plain).contains(run) && *run > 5).collect();
    assert_eq!(beads.len(), 5, "{beads:?}");
    // A bead also hides what is beside its ends from a camera that looks along the joint.
    assert!(beads.iter().all(|run| (9..28).contains(run)), "{beads:?}");
}

#[test]
fn the_jaws_of_a_vise_touch_the_work_where_no_seam_is() {
    let piece = Workpiece::of(&small(Part::Vise));
    let plate = piece.drawn["T"];
    let names: Vec<&str> = piece.seams.iter().map(|seam| seam.name.as_str()).collect();
    assert_eq!(names, ["right", "left"]);
    let scene = Scene::new(piece.solids.clone(), -100.0);
    for side in [-1.0, 1.0] {
        let contact = Point3::new(0.0, 40.0 * side, plate);
        let down = scene.cast(contact + Vector3::new(0.0, -0.1 * side, 50.0), -Vector3::z()).unwrap();
        let aside = scene.cast(contact + Vector3::new(0.0, -10.0 * side, 2.0), Vector3::y() * side).unwrap();
        assert!(
            (down.distance - 50.0).abs() < 1e-9 && (aside.distance - 10.0).abs() < 1e-9,
            "an inside corner"
        );
        let near = |s: &TrueStation| (s.apex - contact).norm();
        let nearest =
            piece.seams.iter().flat_map(|s| s.stations.iter().map(near)).fold(f64::INFINITY, f64::min);
        assert!(nearest > 30.0, "{nearest}");
    }
}

#[test]
fn without_the_work_the_vise_and_the_cameras_are_where_they_were() {
    let full = stage(&small(Part::Vise)).unwrap();
    let empty = stage(&Request { empty: true, ..small(Part::Vise) }).unwrap();
    assert_eq!(empty.base_from_camera, full.base_from_camera);
    assert!(empty.truth.seams.is_empty() && full.truth.seams.len() == 2);
    // Down onto the web's ridge, and onto a jaw.
    let middle = |seam: &TruthSeam| Vector3::from(seam.p[seam.p.len() / 2]);
    let [right, left] = [0, 1].map(|k| middle(&full.truth.seams[k]));
    let across = (left - right).normalize();
    let down = |scene: &Scene, at: Vector3<f64>| {
        scene.cast(Point3::from(at + Vector3::z() * 200.0), -Vector3::z()).unwrap().distance
    };
    let (web, jaw) = (0.5 * (left + right), left + across * 50.0);
    assert!(down(&empty.scene, web) - down(&full.scene, web) > 50.0);
    assert_eq!(down(&empty.scene, jaw), down(&full.scene, jaw));
}

#[test]
fn several_parts_stand_apart_and_each_has_its_seams() {
    for seed in 1..6 {
        let piece = Workpiece::of(&Request { seed, ..small(Part::Several) });
        let required = piece.seams.iter().filter(|seam| seam.required);
        let names: Vec<&str> = required.map(|seam| seam.name.as_str()).collect();
        assert_eq!(names, ["right", "left", "boss", "tube"]);
        // From above, the table shows all round each plate: between neighbours on the lines between their middles.
        let scene = Scene::new(piece.solids, 0.0);
        let middles = [[0.0, -85.0], [-85.0, 60.0], [85.0, 60.0]];
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let at = |share: f64, k: usize| middles[a][k] + share * (middles[b][k] - middles[a][k]);
            let open = (0..=200).map(|i| f64::from(i) / 200.0).any(|share| {
                let eye = Point3::new(at(share, 0), at(share, 1), 200.0);
                scene.cast(eye, -Vector3::z()).is_some_and(|hit| (hit.distance - 200.0).abs() < 1e-9)
            });
            assert!(open, "seed {seed}: parts {a} and {b} touch");
        }
    }
}

#[test]
fn stray_pixels_read_metres_or_full_scale_or_nothing_and_the_rest_is_as_before() {
    let clean = simulate(&small(Part::Fillet)).unwrap();
    let sensor = SensorErrors { stray_px: 20, ..Default::default() };
    let stray = simulate(&Request { sensor, ..small(Part::Fillet) }).unwrap();
    let camera = Camera::with_size(160, 120);
    for (clean, stray) in clean.views.iter().zip(&stray.views) {
        let changed = clean.image.counts.iter().zip(&stray.image.counts).filter(|(a, b)| a != b).count();
        // Two strays seldom fall on one pixel; one that reads nothing may fall where there was nothing.
        assert!((35..=60).contains(&changed), "{changed}");
        let depths_mm: Vec<f64> = stray.image.points_mm(&camera).iter().map(|p| p.z).collect();
        let full_mm = f64::from(u16::MAX) * camera.depth_scale_mm;
        let full = depths_mm.iter().filter(|z| (**z - full_mm).abs() < 1e-6).count();
        let far = depths_mm.iter().filter(|z| **z > 900.0).count();
        assert!((17..=20).contains(&full) && (35..=40).contains(&far), "{full} of {far}");
        // What a count cannot say is full scale in an image.
        let images = stray.image.counts.iter().filter(|count| **count == u16::MAX).count();
        assert_eq!(images, full + stray.image.beyond_mm.len());
        assert!(stray.image.beyond_mm.values().all(|depth| (full_mm..60e3).contains(depth)));
    }
}
