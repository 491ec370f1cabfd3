//! The scan of a job, read and planned: the one way that the command and the page that edits a job both take.

use std::path::Path;
use std::sync::Arc;

use crate::geometry::cloud::View;
use crate::input::{self, CloudFrame, Scan};
use crate::output::summary::Source;
use crate::pipeline::touch::{self, Touch};
use crate::pipeline::{self, Observer, Plan, PlanError};
use crate::run::job::Job;
use crate::run::job::touch::TouchSettings;
use crate::run::verdict;

/// Share of the time, in percent, that has usually passed when a stage begins, measured on the fixtures: a stage at a time
/// says little about when it is over.
pub const PASSED: [(&str, u64); 7] = [
    ("scan", 0),
    ("normals", 3),
    ("reconstruction", 32),
    ("downsampling", 48),
    ("denoising", 62),
    ("seam", 67),
    ("toolpath", 99),
];

/// Said of a scan whose cameras nobody knows.
const UNUSED_CALIBRATION: &str =
    "the calibration is not used: nothing says where the camera was, or that the coordinates are the robot's";

/// Reads the input that the job names, and what was there before.
///
/// # Errors
/// If there is no input, one of them cannot be read, or both are not in one frame.
pub fn read(job: &Job, allow_outside: bool) -> Result<Scan, input::Error> {
    let options = input::Options {
        units: job.units,
        intrinsics: job.intrinsics,
        depth_scale_m: job.depth_scale_m.map(|scale| scale.get()),
        camera_mm: job.camera_mm,
        frame: job.frame,
        allow_outside,
    };
    let scan = input::read(job.input.as_deref().unwrap_or(Path::new(".")), &options)?;
    let Some(background) = &job.exclude.background else { return Ok(scan) };
    // What is said of the work's cloud is not said of another.
    let options = input::Options { camera_mm: None, frame: None, ..options };
    scan.over(input::read(background, &options)?)
}

/// All seams of a scan, as the job says they are found.
///
/// # Errors
/// If there is none, or the observer wants no more.
pub fn plan(scan: &Scan, job: &Job, observer: &mut impl Observer) -> Result<Plan, PlanError> {
    let mut config = job.pipeline();
    if scan.frame != CloudFrame::Base {
        // Coordinates that are not the robot's have no error in its base frame.
        config.anchor = None;
    }
    let calibrated = config.calibration.is_some() && scan.frame == CloudFrame::Base;
    let unused = (config.calibration.is_some() && !calibrated).then(|| UNUSED_CALIBRATION.to_owned());
    if !calibrated {
        config.calibration = None;
    }
    config.exclusion.background = Arc::clone(&scan.background);
    let mut plan = pipeline::plan(&scan.views, &config, observer)?;
    if !job.touches.is_empty() {
        plan = touched(&plan, scan, job, &config, observer)?;
    }
    plan.warnings.splice(0..0, scan.warnings.iter().cloned().chain(unused));
    verdict::lower_confidence(&mut plan, scan, job);
    Ok(plan)
}

/// The plan of the same scan where the tip touched it: all poses are moved, and it is planned anew, so that everything which
/// hangs on places says the same.
fn touched(
    plan: &Plan,
    scan: &Scan,
    job: &Job,
    config: &pipeline::Config,
    observer: &mut impl Observer,
) -> Result<Plan, PlanError> {
    if scan.frame == CloudFrame::Camera {
        return Err(touch::Error::NoBaseFrame.into());
    }
    let touches: Vec<Touch> = job.touches.iter().map(TouchSettings::touch).collect();
    let touched = touch::fit(plan, &touches)?;
    let moved = |view: &View| View {
        base_from_camera: touched.base_from_planned * view.base_from_camera,
        ..view.clone()
    };
    let views: Vec<View> = scan.views.iter().map(moved).collect();
    let mut config = config.clone();
    config.exclusion.background = scan.background.iter().map(moved).collect();
    let mut plan = pipeline::plan(&views, &config, observer)?;
    touched.settle(&mut plan);
    Ok(plan)
}

/// What the files of a run say about its input.
pub fn source(scan: &Scan, job: &Job) -> Source {
    let inputs = scan.inputs.iter().map(|path| path.display().to_string()).collect();
    Source {
        inputs,
        frame: scan.frame.into(),
        notes: scan.notes.clone(),
        findings: verdict::of_scan(scan, job),
    }
}

/// Whether both jobs find the same seams in the same scan: what they differ by is only what is made of these.
pub fn finds_the_same(a: &Job, b: &Job) -> bool {
    let search = |job: &Job| {
        let Job {
            input,
            units,
            intrinsics,
            depth_scale_m,
            camera_mm,
            frame,
            method,
            ratio_threshold,
            scan,
            exclude,
            ..
        } = job.clone();
        let read = (input, units, intrinsics, depth_scale_m, camera_mm, frame);
        (read, method, ratio_threshold, scan, exclude, job.touches.clone(), job.asks.clone())
    };
    search(a) == search(b)
}
