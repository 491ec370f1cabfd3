//! How far the tip is from the seam in the robot's base frame, where neither hand-eye transform nor robot is exact, and
//! what is stated of it: the committed scans with poses made anew from the true ones, and scans of the simulator's own cell.
//!
//! `cargo test -p weldpath-tests --test method base_frame -- --nocapture` prints the table; `-- --ignored` adds seeds and pieces.

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use weldpath::evaluation::Truth;
use weldpath::geometry::cloud::View;
use weldpath::input;
use weldpath::output::verdict::ReasonId;
use weldpath::pipeline::{self, Anchor, Plan};
use weldpath::run::job::Job;
use weldpath::run::verdict;
use weldpath::seam::Seam;
use weldpath::simulation::{CellErrors, MeshRequest, Part, Request, simulate_mesh};
use weldpath_tests::adversary::Random;
use weldpath_tests::scans::{Shared, block, of_mesh, read, scanned, scored};

/// A cell of everyday quality: what findings call "hand-eye off by 2 mm and 0.5 degrees, robot true to 0.1 mm".
const CELL: CellErrors = CellErrors {
    hand_eye_mm: 2.0,
    hand_eye_deg: 0.5,
    robot_mm: 0.1,
    robot_deg: 0.03,
    first_exact: false,
    seed: None,
};
/// Root mean square that is accepted over the scans of a group, mm.
const MOST_MM: f64 = 0.8;
/// The stated error against the true one: share of scans within twice the stated, and the median of stated by true, where
/// there are enough scans for a median.
const WITHIN: f64 = 0.95;
const HONEST: std::ops::Range<f64> = 0.7..3.0;
const ENOUGH: usize = 8;

/// Normal numbers of this standard deviation.
fn vector(random: &mut Random, sigma: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.normal()) * sigma
}

fn of_length(random: &mut Random, length: f64) -> Vector3<f64> {
    vector(random, 1.0).normalize() * length
}

fn pose(rows: &[[f64; 4]; 4]) -> Isometry3<f64> {
    let turn = Rotation3::from_matrix(&Matrix3::from_fn(|r, c| rows[r][c]));
    let shift = Vector3::new(rows[0][3], rows[1][3], rows[2][3]);
    Isometry3::from_parts(shift.into(), UnitQuaternion::from_rotation_matrix(&turn))
}

/// Gives every view the pose that a robot of such a cell would report, by rigid algebra alone.
fn put_into_cell(views: &mut [View], truth: &Truth, cell: CellErrors, seed: u64) {
    let random = &mut Random::new(seed);
    let turn = of_length(random, cell.hand_eye_deg.to_radians());
    let stated_from_true = Isometry3::new(of_length(random, cell.hand_eye_mm), turn);
    for (view, rows) in views.iter_mut().zip(&truth.true_cam) {
        let stated = pose(rows) * stated_from_true.inverse();
        let turn = UnitQuaternion::from_scaled_axis(vector(random, cell.robot_deg.to_radians()));
        let shift = Translation3::from(stated.translation.vector + vector(random, cell.robot_mm));
        view.base_from_camera = Isometry3::from_parts(shift, turn * stated.rotation);
    }
}

fn fixture(name: &str) -> (Vec<View>, Truth) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures").join(name);
    let scan = input::read(&folder, &input::Options::default()).unwrap();
    (scan.views, Truth::read(&folder.join("truth.json")).unwrap())
}

fn plan(views: &[View], anchor: Anchor) -> Plan {
    let mut config = Job::default().pipeline();
    config.merge.anchor = Some(anchor);
    pipeline::plan(views, &config, &mut ()).unwrap_or_else(|error| panic!("{error}"))
}

/// The plans of a fixture whose first pose is exact: by all poses, and by that one.
fn as_committed(name: &str) -> &'static [Plan; 2] {
    static PLANS: Shared<String, [Plan; 2]> = Shared::new();
    let of = |views: &[View]| [Anchor::default(), Anchor::First].map(|anchor| plan(views, anchor));
    PLANS.get(name.into(), || of(&fixture(name).0))
}

fn parts_sum_to_the_whole(seam: &Seam) {
    let parts = seam.error_parts;
    let all = [parts.noise_mm, parts.registration_mm, parts.calibration_mm, parts.corner_mm, parts.touch_mm];
    // A part of which nothing is known is none.
    let sum: f64 = all.iter().filter(|mm| mm.is_finite()).map(|mm| mm * mm).sum();
    assert!((sum.sqrt() - seam.tip_error_mm()).abs() < 1e-9, "{parts:?} {}", seam.tip_error_mm());
}

/// Root mean squares of a plan's seams across them, mm: from the truth, and as stated in the base frame.
fn errors(plan: &Plan, truth: &Truth) -> [f64; 2] {
    let real = scored(plan, truth).rmse_mm.unwrap_or(f64::INFINITY);
    let length: f64 = plan.seams.iter().map(|seam| seam.length_mm()).sum();
    let squares: f64 = plan.seams.iter().map(|s| s.tip_error_mm().powi(2) * s.length_mm()).sum();
    plan.seams.iter().for_each(parts_sum_to_the_whole);
    [real, (squares / length).sqrt()]
}

/// A group of scans: true and stated errors, and the true ones with the first view's pose taken as exact.
#[derive(Default)]
struct Group {
    real: Vec<f64>,
    stated: Vec<f64>,
    first: Vec<f64>,
}

impl Group {
    fn add(&mut self, name: &str, views: &[View], truth: &Truth) {
        let found = plan(views, Anchor::default());
        let ([real, stated], [first, _]) =
            (errors(&found, truth), errors(&plan(views, Anchor::First), truth));
        let hand_eye = found.derived.base_frame.expect("poses and cameras are known").hand_eye;
        println!(
            "{name:24} {first:.2} -> {real:.2} mm, stated {stated:.2}; hand-eye {:.2} +- {:.2} mm, {:.2} +- {:.2} deg, {}",
            hand_eye.shift_mm,
            hand_eye.shift_sigma_mm,
            hand_eye.turn_deg,
            hand_eye.turn_sigma_deg,
            hand_eye.is_applied
        );
        self.real.push(real);
        self.stated.push(stated);
        self.first.push(first);
    }

    fn check(&self) {
        let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        let (real, first) = (rms(&self.real), rms(&self.first));
        let pairs = || self.real.iter().zip(&self.stated);
        let within = pairs().filter(|(real, stated)| *real <= &(2.0 * *stated)).count() as f64;
        let mut ratios: Vec<f64> = pairs().map(|(real, stated)| stated / real).collect();
        ratios.sort_by(f64::total_cmp);
        let median = ratios[ratios.len() / 2];
        println!(
            "of {}: {first:.2} -> {real:.2} mm rms, stated by true {median:.2}, within twice {within}",
            ratios.len()
        );
        assert!(real < MOST_MM && real < 0.6 * first, "{real} mm in place of {first}");
        assert!(within >= WITHIN * ratios.len() as f64, "{within} of {}", ratios.len());
        assert!(ratios.len() < ENOUGH || HONEST.contains(&median), "{median}");
        // An error that is stated as large as it was before is no news.
        assert!(rms(&self.stated) < first, "{} mm are stated of {first}", rms(&self.stated));
    }
}

fn in_cells(pieces: &[&str], seeds: u64) -> Group {
    let mut group = Group::default();
    for piece in pieces {
        let (mut views, truth) = fixture(piece);
        for seed in 1..=seeds {
            put_into_cell(&mut views, &truth, CELL, seed);
            group.add(&format!("{piece}, seed {seed}"), &views, &truth);
        }
    }
    group
}

fn simulated(parts: &[Part], seeds: std::ops::RangeInclusive<u64>) -> Group {
    let mut group = Group::default();
    for &part in parts {
        for seed in seeds.clone() {
            let (scan, truth) = scanned(&Request { cell: Some(CELL), ..Request::new(part, seed) });
            assert_eq!(truth.anchor, "none");
            group.add(&format!("simulated {part}, seed {seed}"), &scan.views, &truth);
        }
    }
    group
}

#[test]
fn an_error_of_the_hand_eye_is_taken_out_of_the_committed_scans_and_the_rest_is_stated() {
    in_cells(&["fillet", "lap"], 2).check();
}

#[test]
#[ignore = "minutes: more pieces and seeds of the same"]
fn the_same_on_all_pieces_with_eight_seeds() {
    in_cells(&["fillet", "lap", "pipe", "butt-v"], 8).check();
}

#[test]
fn the_simulators_own_cell_is_found_out_too() {
    simulated(&[Part::Fillet], 11..=12).check();
}

#[test]
#[ignore = "minutes: more parts and seeds of the same"]
fn the_same_of_more_parts() {
    simulated(&[Part::Fillet, Part::Pipe, Part::ButtV, Part::Corner, Part::Branch], 21..=24).check();
}

/// Many views tell so much of the surfaces that what bends these passes for a camera that is off, unless something holds it.
#[test]
fn a_panel_in_sixteen_views_states_about_what_it_is_off_by() {
    let upright =
        (0..3).map(|i| 60.0 + 140.0 * f64::from(i)).map(|x| block([x, 20.0, 10.0], [x + 8.0, 240.0, 45.0]));
    let across = (0..3).map(|i| (85.0 + 140.0 * f64::from(i % 2), 70.0 + 60.0 * f64::from(i)));
    let across = across.map(|(x, y)| block([x, y, 10.0], [x + 95.0, y + 7.0, 40.0]));
    let plate = block([0.0; 3], [420.0, 260.0, 10.0]);
    let triangles = plate.into_iter().chain(upright.flatten()).chain(across.flatten()).collect();
    let request = MeshRequest { cell: Some(CELL), ..of_mesh("panel", triangles, 16, 22) };
    let scan = simulate_mesh(&request).unwrap();
    let read = read(&scan);
    let [real, stated] = errors(&plan(&read.views, Anchor::default()), &scan.truth);
    println!("panel: {real:.2} mm, stated {stated:.2}");
    assert!(real < MOST_MM && stated < 2.0 * real && real < 2.0 * stated, "{real} and {stated} mm");
}

#[test]
fn scans_whose_first_pose_is_exact_stay_where_they_are_and_first_says_so() {
    for piece in ["fillet", "pipe"] {
        let ([cell, first], (_, truth)) = (as_committed(piece), fixture(piece));
        let ([real, stated], [anchored, told]) = (errors(cell, &truth), errors(first, &truth));
        assert!((real - anchored).abs() < 1e-9, "{piece}: {real} and {anchored} mm");
        assert!(!cell.derived.base_frame.as_ref().unwrap().hand_eye.is_applied, "{piece}");
        // The others are off by 1 to 3 mm: who does not know that the first is exact has to expect the same of it. Who does
        // knows all but the camera, whose depth scale shows in no scan: 0.2 % of 400 mm and less.
        assert!(stated > 0.5 && told < 1.0 && told < stated, "{piece}: {stated} and {told} mm");
        let within = first.seams.iter().map(|seam| seam.relative_error_mm).fold(0.0, f64::max);
        assert!(within < 0.3, "{piece}: {within} mm");
    }
}

#[test]
fn a_frame_that_may_be_off_by_more_than_the_limit_has_to_be_confirmed() {
    let uncertain = as_committed("fillet").each_ref().map(|plan| {
        let found = verdict::of_plan(plan, &Job::default());
        found.iter().any(|finding| finding.id == ReasonId::BaseErrorOverLimit)
    });
    assert_eq!(uncertain, [true, false]);
}
