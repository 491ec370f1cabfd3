//! Scans of a single view, as the simulator makes them: what one view does not show is stated, or asked.

use std::path::Path;

use weldpath::input;
use weldpath::lab::evaluation::{Options, PathSet, Truth, score};
use weldpath::lab::simulation::{Part, Request, SensorErrors, simulate, write};
use weldpath::output::verdict::{ReasonId, State, Verdict};
use weldpath::pipeline::Plan;
use weldpath::run::job::Job;
use weldpath::run::planning;
use weldpath::run::postprocessing::postprocess;
use weldpath::seam::Contact;

/// Nothing was chosen on it.
const SEED: u64 = 43;

/// The plan of one view whose pose is exact, its verdict, and how far its path is from the truth, mm; none if nothing is welded.
fn planned(part: Part, sensor: SensorErrors) -> (Plan, Verdict, Option<f64>) {
    let request = Request { views: Some(1), sensor, ..Request::new(part, SEED) };
    let scratch = tempfile::tempdir().expect("a folder");
    write(&simulate(&request).expect("a scan"), scratch.path()).expect("a folder");
    let scan = input::read(scratch.path(), &input::Options::default()).expect("a scan");
    let text = "accept = [\"tool-not-stated\", \"torch-collision\"]\n[scan]\nanchor = \"first\"\n";
    let job = Job::parse(text, Path::new("job.toml")).expect("a job");
    let plan = planning::plan(&scan, &job, &mut ()).unwrap_or_else(|error| panic!("{part}: {error}"));
    let output = postprocess(&plan, &job, planning::source(&scan, &job)).expect("a program");
    let csv = output.files.iter().find(|file| file.name == "path.csv").expect("path.csv");
    let truth = Truth::read(&scratch.path().join("truth.json")).expect("a truth");
    let paths = PathSet::parse(&csv.bytes, Path::new("path.csv")).ok();
    let error_mm = paths.and_then(|paths| score(&paths, &truth, &Options::default()).rmse_mm);
    (plan, output.summary.verdict().clone(), error_mm)
}

#[test]
fn what_the_camera_may_err_is_stated_though_no_other_view_tells_it() {
    // The least, the depth scale alone, is 0.2 % of half a metre; a time-of-flight camera bends a corner by 2 mm.
    let sensors = [SensorErrors::default(), SensorErrors { interreflection_mm: 2.0, ..Default::default() }];
    for (part, sensor) in [Part::Fillet, Part::Lap, Part::Pipe].into_iter().zip(sensors.into_iter().cycle()) {
        let (plan, verdict, error_mm) = planned(part, sensor);
        let error_mm = error_mm.unwrap_or_else(|| panic!("{part}: nothing is welded"));
        for seam in &plan.seams {
            println!("{part}: {error_mm:.2} mm off, {:.2} stated", seam.tip_error_mm());
            assert!(seam.tip_error_mm() > 0.8, "{part}");
            assert!(error_mm < 2.0 * seam.tip_error_mm(), "{part}");
        }
        let asked = verdict.reasons.iter().any(|reason| reason.id == ReasonId::BaseErrorOverLimit);
        assert!(verdict.state == State::Check && asked, "{part}: {verdict:?}");
    }
}

#[test]
fn the_foot_of_a_box_on_a_table_is_named_and_not_welded() {
    let (plan, verdict, error_mm) = planned(Part::Box, SensorErrors::default());
    assert!(!plan.seams.is_empty() && error_mm.is_none());
    assert!(plan.seams.iter().all(|seam| seam.contact == Some(Contact::Table) && seam.confidence <= 0.5));
    assert!(verdict.reasons.iter().any(|reason| reason.id == ReasonId::MayBeContact), "{verdict:?}");
    // A web on a plate that lies on the table is none.
    let (plan, ..) = planned(Part::Fillet, SensorErrors::default());
    assert!(plan.seams.iter().all(|seam| seam.contact.is_none() && seam.confidence > 0.9));
}
