//! What is true of every simulated scan.

mod parts;

use super::*;
use nalgebra::{Point3, Vector3};

fn small(part: Part) -> Request {
    Request { width: 160, height: 120, noise: Noise::None, ..Request::new(part, 5) }
}

/// Distance from a point to the nearest surface along the camera's line of sight through it.
fn gap_mm(scene: &Scene, eye: Point3<f64>, point: Point3<f64>) -> f64 {
    let sight = point - eye;
    scene.cast(eye, sight).map_or(f64::INFINITY, |hit| (hit.distance - 1.0).abs() * sight.norm())
}

#[test]
fn without_noise_every_reading_lies_on_the_scene_at_the_reported_pose() {
    for request in pieces() {
        let part = request.part;
        let scene = stage(&request).unwrap().scene;
        let scan = simulate(&request).unwrap();
        for view in &scan.views {
            let base_from_camera = view.base_from_flange.isometry() * scan.flange_from_camera;
            let eye = Point3::from(base_from_camera.translation.vector);
            for point in view.image.points_mm(&scan.camera).iter().step_by(37) {
                let far_mm = gap_mm(&scene, eye, base_from_camera * point);
                assert!(far_mm < 0.04, "{part}: {far_mm} mm off the surface");
            }
        }
    }
}

/// Every part as it comes, and those that sheet, angles and tacks make of it.
fn pieces() -> Vec<Request> {
    let sheet = |part| Request { thickness_mm: Some(1.0), ..small(part) };
    let thick = |part| Request { thickness_mm: Some(25.0), ..small(part) };
    let leaning = |part, angle_deg| Request { angle_deg: Some(angle_deg), ..small(part) };
    let tacked = Request { tacks: Some(Tacks { count: 5, leg_mm: 4.0 }), ..small(Part::Fillet) };
    let more = [
        sheet(Part::Fillet),
        sheet(Part::Lap),
        thick(Part::ButtV),
        thick(Part::HalfV),
        leaning(Part::Fillet, 60.0),
        leaning(Part::Fillet, 120.0),
        leaning(Part::Saddle, 45.0),
        tacked,
    ];
    Part::ALL.into_iter().map(small).chain(more).collect()
}

#[test]
fn the_truth_lies_where_two_surfaces_meet() {
    for piece in pieces().into_iter().filter(|piece| piece.tacks.is_none()) {
        let (part, Stage { scene, truth, .. }) = (piece.part, stage(&piece).unwrap());
        let reach_mm = piece.thickness_mm.map_or(3.0, |thick| (0.5 * thick).min(3.0));
        for seam in truth.seams.iter().filter(|s| s.required) {
            for i in (5..seam.p.len() - 5).step_by(11) {
                let [p, a, b] = [seam.p[i], seam.normal_a[i], seam.normal_b[i]].map(Vector3::from);
                for (face, other) in [(a, b), (b, a)] {
                    let away = (other - face * other.dot(&face)).normalize();
                    let on_face = Point3::from(p + away * reach_mm);
                    let hit = scene.cast(on_face + face, -face).expect("a face beside the seam");
                    // A chord of 3 mm leaves a cylinder of 29 mm radius by 0.16 mm.
                    let far_mm = (hit.distance - 1.0).abs();
                    assert!(far_mm < 0.2, "{part} {}: face is {far_mm} mm from the truth", seam.name);
                    assert!(hit.normal.dot(&face) > 0.98, "{part} {}: face normal", seam.name);
                }
            }
        }
    }
}

#[test]
fn torch_and_tangent_are_unit_and_perpendicular() {
    for piece in pieces() {
        let part = piece.part;
        for seam in stage(&piece).unwrap().truth.seams {
            for (n, t) in seam.n.iter().zip(&seam.t) {
                let (n, t) = (Vector3::from(*n), Vector3::from(*t));
                assert!((n.norm() - 1.0).abs() < 1e-5 && (t.norm() - 1.0).abs() < 1e-5);
                assert!(n.dot(&t).abs() < 1e-5, "{part} {}: {}", seam.name, n.dot(&t));
            }
        }
    }
}

#[test]
fn stations_are_a_millimetre_apart() {
    for piece in pieces() {
        let part = piece.part;
        for seam in stage(&piece).unwrap().truth.seams {
            for pair in seam.p.windows(2) {
                let step = (Vector3::from(pair[1]) - Vector3::from(pair[0])).norm();
                assert!((0.95..1.05).contains(&step), "{part} {}: {step} mm", seam.name);
            }
        }
    }
}

#[test]
fn good_views_see_most_of_every_required_seam_and_the_anchor_sees_it_too() {
    let asked =
        |piece: Request| Pose::ALL.map(|pose| Request { width: 640, height: 480, pose, ..piece.clone() });
    for request in pieces().into_iter().flat_map(asked) {
        let (part, pose) = (request.part, request.pose);
        for seam in stage(&request).unwrap().truth.seams.iter().filter(|s| s.required) {
            let seen = seam.visible.iter().filter(|v| **v > 0).count() as f64 / seam.visible.len() as f64;
            assert!(seen > 0.6, "{part} {pose} {}: {seen}", seam.name);
        }
    }
}

#[test]
fn pose_errors_are_zero_for_the_anchor_and_1_to_3_mm_for_the_others() {
    let request = Request { noise: Noise::Mid, width: 64, height: 48, ..Request::new(Part::Pipe, 9) };
    let scan = simulate(&request).unwrap();
    for (i, view) in scan.views.iter().enumerate() {
        let said = view.base_from_flange.isometry() * scan.flange_from_camera;
        let rows = scan.truth.true_cam[i];
        let truth = Vector3::new(rows[0][3], rows[1][3], rows[2][3]);
        let off_mm = (said.translation.vector - truth).norm();
        match i {
            0 => assert!(off_mm < 1e-9, "{off_mm}"),
            _ => assert!((0.999..3.001).contains(&off_mm), "{off_mm}"),
        }
    }
}

#[test]
fn the_same_request_gives_the_same_scan_and_another_seed_another() {
    let request = Request { noise: Noise::Mid, width: 64, height: 48, ..Request::new(Part::Lap, 3) };
    let (a, b) = (simulate(&request).unwrap(), simulate(&request).unwrap());
    assert_eq!(a.views[1].image, b.views[1].image);
    assert_eq!(a.truth, b.truth);
    let other = simulate(&Request { seed: 4, ..request }).unwrap();
    assert_ne!(a.views[1].image, other.views[1].image);
    assert_ne!(a.truth.seams[0].p, other.truth.seams[0].p);
}

/// Depths of the first view of a T joint without noise, mm, row by row.
fn depths_mm(sensor: SensorErrors) -> Vec<f64> {
    let scan = simulate(&Request { sensor, ..small(Part::Fillet) }).unwrap();
    scan.views[0].image.counts.iter().map(|c| f64::from(*c) * scan.camera.depth_scale_mm).collect()
}

#[test]
fn a_wrong_depth_scale_stretches_every_reading() {
    let sensor = SensorErrors { depth_scale_percent: 2.0, ..Default::default() };
    for (exact, long) in depths_mm(SensorErrors::default()).iter().zip(depths_mm(sensor)) {
        assert!((long - 1.02 * exact).abs() < 0.06, "{exact} {long}");
    }
}

#[test]
fn a_lens_bends_what_it_projects_as_it_bends_what_it_takes() {
    let sensor = SensorErrors { focal_percent: 1.0, centre_px: 3.0, k1: 0.05, ..Default::default() };
    let stated = Camera::with_size(640, 480);
    let taking = sensor.true_camera(&stated, 7);
    for (column, row) in [(10.0, 20.0), (320.0, 240.0), (600.0, 30.0), (630.0, 470.0)] {
        let [c, r] = taking.project(&Point3::from(taking.ray(column, row) * 400.0)).expect("in the image");
        assert!((c - column).abs() < 1e-6 && (r - row).abs() < 1e-6, "{c} {r}");
    }
    let (a, b) = (stated.ray(600.0, 30.0), taking.ray(600.0, 30.0));
    assert!((a - b).norm() > 2e-3, "{a} {b}");
}

#[test]
fn windows_and_light_between_faces_change_corners_and_not_the_middle_of_faces() {
    let exact = depths_mm(SensorErrors::default());
    let near_corner = |sensor: SensorErrors| -> (f64, f64) {
        let off: Vec<f64> = depths_mm(sensor).iter().zip(&exact).map(|(a, b)| a - b).collect();
        let mut sizes: Vec<f64> = off.iter().map(|d| d.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        (sizes[sizes.len() / 2], off.iter().copied().fold(f64::INFINITY, f64::min))
    };
    for sensor in [
        SensorErrors { window_px: 1, ..Default::default() },
        SensorErrors { interreflection_mm: 1.0, ..Default::default() },
    ] {
        let (usual, nearest) = near_corner(sensor);
        assert!(usual < 0.06, "{sensor:?}: {usual} mm off in the middle of faces");
        // At edges a window mixes what is up to a plate apart.
        assert!((-10.0..-0.5).contains(&nearest), "{sensor:?}: {nearest} mm off in the corner");
    }
    let (_, nearest) = near_corner(SensorErrors { interreflection_mm: -1.0, ..Default::default() });
    assert!(nearest > -0.06, "a corner that is seen too deep comes no nearer: {nearest} mm");
}

#[test]
fn a_near_edge_covers_what_is_behind_it() {
    let exact = depths_mm(SensorErrors::default());
    let fat = depths_mm(SensorErrors { fattening_px: 2, ..Default::default() });
    let covered = exact.iter().zip(&fat).filter(|(a, b)| *a - *b > 5.0).count();
    assert!(covered > 50, "{covered} pixels");
    assert!(exact.iter().zip(&fat).all(|(a, b)| b - a < 0.06), "and none is farther");
}

#[test]
fn waves_are_as_high_and_as_long_as_asked() {
    let exact = depths_mm(SensorErrors::default());
    let waved = depths_mm(SensorErrors { waves_mm: 1.0, wavelength_mm: 40.0, ..Default::default() });
    let width = small(Part::Fillet).width as usize;
    // At 350 mm; the error grows with the square of the depth.
    let height = |i: usize| (exact[i] > 0.0).then(|| (waved[i] - exact[i]) * (350.0 / exact[i]).powi(2));
    let product = |apart: usize| {
        let pairs = (0..exact.len() - apart).filter(|i| i % width + apart < width);
        let all: Vec<f64> = pairs.filter_map(|i| Some(height(i)? * height(i + apart)?)).collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    let focal_px = Camera::with_size(small(Part::Fillet).width, small(Part::Fillet).height).focal_px;
    let half_px = (20.0 * focal_px / 350.0) as usize;
    let variance = product(0);
    assert!((0.7..1.4).contains(&variance), "{variance} mm2");
    assert!(product(half_px / 8) > 0.85 * variance, "neighbours wave alike");
    assert!(product(2 * half_px + 2).abs() < 0.35 * variance, "a wave apart they do not");
}

#[test]
fn every_preset_makes_a_scan_of_its_own() {
    let scans: Vec<Vec<f64>> = Sensor::ALL.map(|sensor| depths_mm(sensor.errors())).into();
    for (k, scan) in scans.iter().enumerate() {
        assert!(scan.iter().filter(|z| **z > 0.0).count() > scan.len() / 2);
        assert!(scans[..k].iter().all(|other| other != scan));
    }
}

#[test]
fn a_first_pose_may_be_exact_in_a_cell_that_errs() {
    let cell = CellErrors {
        hand_eye_mm: 2.0,
        hand_eye_deg: 0.5,
        robot_mm: 0.3,
        robot_deg: 0.1,
        first_exact: true,
        seed: None,
    };
    let scan = simulate(&Request { cell: Some(cell), ..small(Part::Lap) }).unwrap();
    assert_eq!(scan.truth.anchor, "first");
    let off_mm = |i: usize| {
        let said = scan.views[i].base_from_flange.isometry() * scan.flange_from_camera;
        let rows = scan.truth.true_cam[i];
        (said.translation.vector - Vector3::new(rows[0][3], rows[1][3], rows[2][3])).norm()
    };
    assert!(off_mm(0) < 1e-6 && off_mm(1) > 0.5, "{} {}", off_mm(0), off_mm(1));
}

#[test]
fn a_piece_without_a_seam_has_none_in_its_truth() {
    for part in [Part::Plate, Part::Box] {
        assert!(stage(&small(part)).unwrap().truth.seams.is_empty());
    }
}

#[test]
fn nonsense_is_refused_with_a_way_out() {
    let refused = |request: &Request| stage(request).unwrap_err().to_string();
    assert!("pip".parse::<Part>().unwrap_err().to_string().contains("pipe"));
    assert!(refused(&Request { views: Some(0), ..small(Part::Lap) }).contains("between 1"));
    assert!(refused(&Request { width: u32::MAX, ..small(Part::Lap) }).contains("width"));
    assert!(refused(&Request { angle_deg: Some(f64::NAN), ..small(Part::ButtV) }).contains("angle"));
    assert!(refused(&Request { angle_deg: Some(60.0), ..small(Part::Pipe) }).contains("butt-v"));
    assert!(refused(&Request { length_mm: Some(200.0), ..small(Part::Pipe) }).contains("butt-v"));
    assert!(refused(&Request { weak: true, ..small(Part::Pipe) }).contains("branch"));
    let erring = |sensor| refused(&Request { sensor, ..small(Part::Pipe) });
    assert!(erring(SensorErrors { window_px: 99, ..Default::default() }).contains("matching window"));
    assert!(erring(SensorErrors { k1: f64::NAN, ..Default::default() }).contains("k1"));
    assert!("kinect".parse::<Sensor>().unwrap_err().to_string().contains("stereo"));
    assert!(refused(&Request { thickness_mm: Some(0.5), ..small(Part::Lap) }).contains("thickness"));
    assert!(refused(&Request { thickness_mm: Some(2.0), ..small(Part::Pipe) }).contains("half-v"));
    let tacks = |part, count| Request { tacks: Some(Tacks { count, leg_mm: 4.0 }), ..small(part) };
    assert!(refused(&tacks(Part::Lap, 3)).contains("fillet"));
    assert!(refused(&tacks(Part::Fillet, 8)).contains("number of tacks"));
    let opening = |part, mm| Request { root_opening_mm: Some(mm), ..small(part) };
    assert!(refused(&opening(Part::Pipe, 1.0)).contains("butt-v"));
    assert!(refused(&opening(Part::ButtV, -0.1)).contains("root opening"));
}

/// Least eigenvalue of the mean of n nᵀ over what a view sees of the piece: 0 if a direction is not tied down.
fn least_information(stage: &Stage, view: usize) -> f64 {
    let camera = Camera::with_size(160, 120);
    let pose = &stage.base_from_camera[view];
    let eye = Point3::from(pose.translation.vector);
    let (mut sum, mut count) = (nalgebra::Matrix3::zeros(), 0.0);
    for (row, column) in (0..120).flat_map(|row| (0..160).map(move |column| (row, column))) {
        let sight = pose.rotation * camera.ray(f64::from(column), f64::from(row));
        let Some(hit) = stage.scene.cast(eye, sight) else { continue };
        let is_table = (eye + sight * hit.distance).z < stage.scene.table_mm() + 0.01;
        if !is_table && -hit.normal.dot(&sight) / sight.norm() > 0.2 {
            sum += hit.normal * hit.normal.transpose();
            count += 1.0;
        }
    }
    (sum / f64::max(count, 1.0)).symmetric_eigenvalues().min()
}

#[test]
fn where_seams_run_every_way_the_anchor_sees_faces_every_way_unless_placed_badly() {
    for part in
        [Part::Pipe, Part::Saddle, Part::Branch, Part::Tacked, Part::Cruciform, Part::SquareTube, Part::Box]
    {
        let information = least_information(&stage(&small(part)).unwrap(), 0);
        assert!(information > 0.02, "{part}: {information}");
    }
    let weak = stage(&Request { weak: true, ..small(Part::Tacked) }).unwrap();
    assert!(least_information(&weak, 0) < 0.005);
}

#[test]
fn the_first_two_views_of_a_weak_branch_share_no_upright_face() {
    let weak = stage(&Request { weak: true, ..small(Part::Branch) }).unwrap();
    let names = |view| -> Vec<&str> {
        weak.truth.seams.iter().filter(|s| sees_a_face_of(&weak, view, s)).map(|s| s.name.as_str()).collect()
    };
    let (first, second) = (names(0), names(1));
    assert!(!first.is_empty() && !second.is_empty());
    assert!(first.iter().all(|name| !second.contains(name)), "{first:?} {second:?}");
}

/// Whether a view sees the wall beside the middle of a seam on the plate.
fn sees_a_face_of(stage: &Stage, view: usize, seam: &crate::evaluation::TruthSeam) -> bool {
    let middle = seam.p.len() / 2;
    let wall = Vector3::from(seam.normal_a[middle]);
    let probe = Point3::from(Vector3::from(seam.p[middle]) + Vector3::z() * 15.0 + wall * 0.02);
    let eye = Point3::from(stage.base_from_camera[view].translation.vector);
    seam.name.starts_with("foot")
        && wall.dot(&(eye - probe).normalize()) > 0.2
        && stage.scene.is_free(probe, eye)
}
