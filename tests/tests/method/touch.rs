//! Points of seams that the robot's own tip touched: the plan of a scan from a cell that errs is put where they are.
//! Truth is the simulator's; the tip errs by 0.1 mm in each axis.

use std::path::Path;

use nalgebra::{Point3, Vector3};
use weldpath::evaluation::Truth;
use weldpath::input::Scan;
use weldpath::output::csv;
use weldpath::output::frame::PathFrame;
use weldpath::pipeline::PlanError;
use weldpath::pipeline::{Plan, touch};
use weldpath::run::job::Job;
use weldpath::run::planning;
use weldpath::simulation::{CellErrors, Part, Request};
use weldpath_tests::adversary::Random;
use weldpath_tests::scans::{read, scored, shared};

const CELL: CellErrors = CellErrors {
    hand_eye_mm: 2.0,
    hand_eye_deg: 0.5,
    robot_mm: 0.1,
    robot_deg: 0.03,
    first_exact: false,
    seed: None,
};
/// Standard deviation of the tip, each axis, mm.
const TIP_MM: f64 = 0.1;

fn of_cell(part: Part, seed: u64) -> (Scan, Truth) {
    let simulated = shared(&Request { cell: Some(CELL), ..Request::new(part, seed) });
    (read(simulated), simulated.truth.clone())
}

/// The required seam's true stations at these shares of its length, as a tip that errs finds them.
fn touched(truth: &Truth, shares: &[f64], random: &mut Random) -> String {
    let seam = truth.seams.iter().find(|seam| seam.required).expect("a seam");
    let at = |share: &f64| {
        let place = seam.p[(share * (seam.p.len() - 1) as f64) as usize];
        let [x, y, z] = place.map(|v| v + TIP_MM * random.normal());
        format!("[[touch]]\nat_mm = [{x:.3}, {y:.3}, {z:.3}]\nseam = 1\n")
    };
    shares.iter().map(at).collect()
}

fn planned(scan: &Scan, job: &str) -> Result<Plan, PlanError> {
    let job = Job::parse(job, Path::new("job.toml")).unwrap_or_else(|error| panic!("{error}"));
    planning::plan(scan, &job, &mut ())
}

fn rmse_mm(plan: &Plan, truth: &Truth) -> f64 {
    scored(plan, truth).rmse_mm.unwrap_or(f64::INFINITY)
}

#[test]
fn one_touch_shifts_a_plan_and_three_turn_it_to_where_the_seam_is() {
    let random = &mut Random::new(5);
    let (mut before, mut one, mut three, mut honest) = (0.0, 0.0, 0.0, 0);
    let scans = [(Part::Fillet, 51), (Part::Fillet, 52), (Part::ButtV, 51), (Part::ButtV, 52)];
    for (part, seed) in scans {
        let (scan, truth) = of_cell(part, seed);
        let plans = [vec![], vec![0.5], vec![0.1, 0.5, 0.9]]
            .map(|shares| planned(&scan, &touched(&truth, &shares, random)).expect("a plan"));
        let errors = plans.each_ref().map(|plan| rmse_mm(plan, &truth));
        let stated = plans.each_ref().map(|plan| plan.seams[0].base_error_mm);
        println!("{part} {seed}: {errors:.2?} mm with no, one, three touches; stated {stated:.2?}");
        before += errors[0].powi(2);
        one += errors[1].powi(2);
        three += errors[2].powi(2);
        honest += errors.iter().zip(stated).filter(|(real, stated)| **real < 2.0 * stated).count();
        assert!(
            stated[1] < stated[0] + 1e-9 && stated[2] < stated[1],
            "touches make a plan surer: {stated:?}"
        );
        let [none, _, held] = plans.each_ref().map(|plan| plan.seams[0].error_parts);
        assert!(none.touch_mm == 0.0 && none.calibration_mm > none.registration_mm, "{none:?}");
        assert!(held.calibration_mm == 0.0 && held.touch_mm > 0.0, "{held:?}");
        assert_eq!(plans[2].derived.touch.as_ref().expect("touched").residuals.len(), 3);
    }
    let rms = |sum: f64| (sum / scans.len() as f64).sqrt();
    println!(
        "rms {:.2}, {:.2}, {:.2} mm; {honest} of 12 within twice the stated",
        rms(before),
        rms(one),
        rms(three)
    );
    assert!(rms(one) < 0.5 && rms(three) < 0.3 && rms(three) < rms(before));
    assert!(honest >= 11);
}

#[test]
fn a_touched_job_replays_to_the_same_path_and_the_poses_that_the_robot_reported_stand() {
    let (scan, truth) = of_cell(Part::Fillet, 53);
    let text = touched(&truth, &[0.4], &mut Random::new(7));
    let plan = planned(&scan, &text).expect("a plan");
    let job = Job::parse(&text, Path::new("job.toml")).unwrap();
    let again = planned(&scan, &job.to_toml()).expect("a plan");
    assert_eq!(csv::write(&plan.paths, PathFrame::Base), csv::write(&again.paths, PathFrame::Base));
    for (view, report) in scan.views.iter().zip(&plan.derived.views) {
        let off = view.base_from_camera.inverse() * report.reported;
        assert!(off.translation.vector.norm() < 1e-6 && off.rotation.angle() < 1e-9);
    }
}

#[test]
fn a_touch_that_cannot_be_is_refused_and_says_why() {
    let (scan, truth) = of_cell(Part::Fillet, 51);
    let seam = truth.seams.iter().find(|seam| seam.required).expect("a seam");
    let amid = Point3::from(seam.p[seam.p.len() / 2]);
    let off = |by: Vector3<f64>, seam: &str| {
        let [x, y, z]: [f64; 3] = (amid + by).into();
        planned(&scan, &format!("[[touch]]\nat_mm = [{x}, {y}, {z}]\n{seam}"))
    };
    let far = Vector3::from(seam.n[seam.n.len() / 2]) * 40.0;
    let Err(PlanError::Touch(touch::Error::Implausible { distance_mm, most_mm, .. })) =
        off(far, "seam = 1\n")
    else {
        panic!("40 mm off is no touch")
    };
    assert!((35.0..45.0).contains(&distance_mm) && most_mm < 20.0, "{distance_mm} {most_mm}");
    assert!(matches!(
        off(Vector3::zeros(), "seam = 9\n"),
        Err(PlanError::Touch(touch::Error::NoSuchSeam { seam: 9, .. }))
    ));
    // Two touches at one place that are 2.5 mm apart.
    let [x, y, z]: [f64; 3] = amid.into();
    let up = Vector3::from(seam.n[seam.n.len() / 2]) * 2.5;
    let both = format!(
        "[[touch]]\nat_mm = [{x}, {y}, {z}]\nseam = 1\n[[touch]]\nat_mm = [{}, {}, {}]\nseam = 1\n",
        x + up.x,
        y + up.y,
        z + up.z
    );
    assert!(matches!(planned(&scan, &both), Err(PlanError::Touch(touch::Error::Contradiction { .. }))));
}
