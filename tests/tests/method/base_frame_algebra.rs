//! What the base frame is, where the truth is made here: rigid poses with errors of a known size, many times.

use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6,
};
use weldpath::model::base_frame::{Anchor, BaseFrame, CellAccuracy, Location, Stated, anchor_first, locate};
use weldpath::model::reconstruction::{Registration, SurfaceEvidence};
use weldpath_tests::adversary::Random;

/// How far registration is off in these tests, each view, each axis.
const REGISTERED_MM: f64 = 0.05;
const REGISTERED_RAD: f64 = 3e-4;
const SEEDS: u64 = 60;

/// A shift and a turn, each axis of these standard deviations.
fn motion(random: &mut Random, mm: f64, rad: f64) -> Isometry3<f64> {
    let mut vector = |sigma: f64| Vector3::from_fn(|_, _| random.normal()) * sigma;
    Isometry3::new(vector(mm), vector(rad))
}

/// Rotation vector of a motion, and shift of the origin, where the work is.
fn parameters(motion: &Isometry3<f64>) -> Vector6<f64> {
    let (turn, shift) = (motion.rotation.scaled_axis(), motion.translation.vector);
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}

/// Six cameras 400 mm from the origin, leaning by about this much, each by another angle.
fn cameras(lean_deg: f64) -> Vec<Isometry3<f64>> {
    let one = |k: usize| {
        let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 1.05 * k as f64);
        let own_deg = lean_deg * [1.0, 0.2, 1.2, 0.5, 1.4, 0.8][k];
        let lean = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), own_deg.to_radians());
        let turn = about * lean;
        Isometry3::from_parts(Translation3::from(turn * Vector3::z() * 400.0), turn)
    };
    (0..6).map(one).collect()
}

/// A scan of the origin: what the robot reports, and what registration makes of it.
struct Scanned {
    reported: Vec<Isometry3<f64>>,
    registration: Registration,
}

/// The hand-eye transform lacks `hand_eye`, and the robot is off by so much in every view, each axis.
fn scanned(
    truth: &[Isometry3<f64>],
    hand_eye: Isometry3<f64>,
    robot: [f64; 2],
    random: &mut Random,
) -> Scanned {
    let own = |pose: &Isometry3<f64>, random: &mut Random, [mm, rad]: [f64; 2]| {
        let off = motion(random, mm, rad);
        Isometry3::from_parts(
            (pose.translation.vector + off.translation.vector).into(),
            off.rotation * pose.rotation,
        )
    };
    let reported: Vec<_> =
        truth.iter().map(|pose| own(&(pose * hand_eye.inverse()), random, robot)).collect();
    let seen: Vec<_> =
        truth.iter().map(|pose| motion(random, REGISTERED_MM, REGISTERED_RAD) * pose).collect();
    // Registration leaves the first view where it was reported.
    let keep = reported[0] * seen[0].inverse();
    let n = 6 * (truth.len() - 1);
    let sigma2 = |d: usize| if d % 6 < 3 { REGISTERED_RAD.powi(2) } else { REGISTERED_MM.powi(2) };
    let covariance = DMatrix::from_fn(n, n, |r, c| {
        let own = if r == c { sigma2(r) } else { 0.0 };
        own + if r % 6 == c % 6 { sigma2(r) } else { 0.0 }
    });
    let evidence = SurfaceEvidence {
        information: covariance.clone().try_inverse().unwrap(),
        pull: DVector::zeros(n),
        camera: None,
    };
    let registration = Registration {
        base_from_camera: seen.iter().map(|pose| keep * pose).collect(),
        fitness: vec![vec![1.0]; truth.len()],
        overlap: vec![1.0; truth.len()],
        covariance,
        centre_mm: Point3::origin(),
        evidence: Some(evidence),
        base_covariance: None,
        residual_mm: 0.1,
    };
    Scanned { reported, registration }
}

/// What is stated of a cell.
fn stated(reported: &[Isometry3<f64>], cell: CellAccuracy, beyond_repair: bool) -> Stated<'_> {
    Stated { reported, anchor: Anchor::Cell(cell), calibration: None, taken_out: None, beyond_repair }
}

impl Scanned {
    fn location(&self) -> Location {
        locate(&stated(&self.reported, CellAccuracy::default(), false), &self.registration).unwrap()
    }

    fn located(&self) -> BaseFrame {
        self.location().base_frame.unwrap()
    }

    /// Where the work comes to lie in the base frame, as motion from where it is, and the covariance that is stated of it.
    fn error(&self, truth: &[Isometry3<f64>]) -> (Vector6<f64>, Matrix6<f64>) {
        let found = self.location();
        let mut settled = self.registration.clone();
        found.settle(&mut settled);
        let off = settled.base_from_camera[0] * truth[0].inverse();
        let stated = settled.base_covariance.unwrap().fixed_view::<6, 6>(0, 0).into_owned();
        (parameters(&off), stated)
    }
}

/// Root mean squares over the seeds, mm at the work: true and stated; share of scans whose truth is within twice the stated.
fn over_seeds(hand_eye: [f64; 2], robot: [f64; 2]) -> [f64; 3] {
    let truth = cameras(25.0);
    let (mut real, mut stated, mut within) = (0.0, 0.0, 0.0);
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let lacking = motion(random, hand_eye[0], hand_eye[1]);
        let (off, covariance) = scanned(&truth, lacking, robot, random).error(&truth);
        let own = off.fixed_rows::<3>(3).norm_squared();
        let told = covariance.fixed_view::<3, 3>(3, 3).trace();
        (real, stated) = (real + own, stated + told);
        within += f64::from(u8::from(own < 4.0 * told));
    }
    let n = SEEDS as f64;
    [(real / n).sqrt(), (stated / n).sqrt(), within / n]
}

#[test]
fn an_error_of_the_hand_eye_is_taken_out_and_what_is_left_is_as_large_as_stated() {
    // 2 mm and 0.5 degrees in all, as three axes; a robot true to 0.1 mm and 0.03 degrees.
    let [real, stated, within] = over_seeds([1.2, 0.005], [0.1, 5.2e-4]);
    assert!(real < 0.5, "{real} mm are left");
    assert!((0.7..2.0).contains(&(stated / real)), "stated {stated} of {real} mm");
    assert!(within >= 0.95, "{within}");
}

#[test]
fn poses_ten_times_as_scattered_as_a_robots_are_told_and_their_error_stated() {
    let truth = cameras(25.0);
    let found = scanned(&truth, Isometry3::identity(), [3.0, 0.009], &mut Random::new(4)).located();
    assert!((1.5..5.0).contains(&found.robot_mm) && found.is_scattered(), "{} mm", found.robot_mm);
    assert!((0.25..0.9).contains(&found.robot_deg), "{} deg", found.robot_deg);
    let [real, stated, within] = over_seeds([0.0, 0.0], [3.0, 0.009]);
    assert!((0.7..2.0).contains(&(stated / real)), "stated {stated} of {real} mm");
    assert!(within >= 0.93, "{within}");
}

#[test]
fn a_good_hand_eye_transform_is_left_as_it_is() {
    let truth = cameras(25.0);
    for robot in [[0.02, 1e-4], [0.3, 8.7e-4], [2.0, 0.008]] {
        let applied = (0..SEEDS).filter(|&seed| {
            scanned(&truth, Isometry3::identity(), robot, &mut Random::new(seed))
                .located()
                .hand_eye
                .is_applied
        });
        assert!(applied.count() <= 1, "{robot:?}");
    }
}

#[test]
fn the_estimate_of_the_hand_eye_is_as_exact_as_it_says() {
    let truth = cameras(25.0);
    let mut squared = 0.0;
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let lacking = motion(random, 1.2, 0.005);
        let found = scanned(&truth, lacking, [0.3, 8.7e-4], random).located().hand_eye;
        let off = (found.camera_from_corrected.translation.vector - lacking.translation.vector).norm();
        squared += (off / found.loosest_mm).powi(2);
    }
    let mean = (squared / SEEDS as f64).sqrt();
    assert!((0.5..1.6).contains(&mean), "{mean} of the worst direction's standard deviation");
}

#[test]
fn where_the_views_do_not_turn_the_hand_eye_stays_at_its_prior_and_so_does_the_error() {
    let truth = cameras(0.3);
    let lacking = Isometry3::translation(0.5, -0.5, 2.0);
    let scan = scanned(&truth, lacking, [0.1, 5e-4], &mut Random::new(7));
    let hand_eye = scan.located().hand_eye;
    assert!(hand_eye.loosest_mm > 2.5, "{hand_eye:?}");
    let (off, stated) = scan.error(&truth);
    assert!(off.z.abs() < 3.0 * stated[(5, 5)].sqrt() && stated[(5, 5)].sqrt() > 2.0, "{off} {stated}");
}

#[test]
fn nothing_is_corrected_where_the_hand_eye_is_beyond_repair_or_the_first_view_exact() {
    let truth = cameras(25.0);
    let scan = scanned(&truth, Isometry3::translation(0.0, 30.0, -90.0), [0.1, 5e-4], &mut Random::new(3));
    let cell = CellAccuracy::default();
    let found = locate(&stated(&scan.reported, cell, true), &scan.registration).unwrap();
    let mut settled = scan.registration.clone();
    found.settle(&mut settled);
    assert!(
        !found.base_frame.unwrap().hand_eye.is_applied
            && settled.base_from_camera == scan.registration.base_from_camera
    );
    anchor_first(&mut settled);
    let covariance = settled.base_covariance.unwrap();
    assert_eq!(covariance.fixed_view::<6, 6>(0, 0).norm(), 0.0);
    assert_eq!(covariance.view((6, 6), (30, 30)), scan.registration.covariance.view((0, 0), (30, 30)));
}

#[test]
fn a_single_view_is_as_exact_as_robot_and_hand_eye_together() {
    let pose = cameras(25.0)[0];
    let registration = Registration {
        base_from_camera: vec![pose],
        fitness: vec![vec![]],
        overlap: vec![0.0],
        covariance: DMatrix::zeros(0, 0),
        centre_mm: Point3::origin(),
        evidence: None,
        base_covariance: None,
        residual_mm: 0.1,
    };
    let cell = CellAccuracy { hand_eye_deg: 0.001, robot_deg: 0.001, ..CellAccuracy::default() };
    let mut settled = registration.clone();
    locate(&stated(&[pose], cell, false), &registration).unwrap().settle(&mut settled);
    let covariance = settled.base_covariance.unwrap();
    let expected = cell.robot_mm.hypot(cell.hand_eye_mm);
    assert!((covariance[(3, 3)].sqrt() - expected).abs() < 0.02, "{covariance}");
}
