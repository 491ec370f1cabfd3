//! From a plan to what a run leaves behind: selection, path modifiers, the program, and the files.

use std::collections::BTreeSet;

use crate::export::directory::File;
use crate::export::summary::{Source, Summary};
use crate::export::{csv, json, moves, ply, robot};
use crate::job::{Job, Method};
use crate::pipeline::Plan;
use crate::selection::{self, select};
use crate::toolpath::SeamPath;
use crate::toolpath::program::{Program, program};
use crate::toolpath::resampling::resample;
use crate::toolpath::standoff::standoff;

/// What a run leaves behind.
#[derive(Debug)]
pub struct Output {
    /// The selected seams' paths as they are written.
    pub paths: Vec<SeamPath>,
    /// The complete program.
    pub program: Program,
    /// What was found and how.
    pub summary: Summary,
    /// The files of the run, the summary among them.
    pub files: Vec<File>,
}

/// Why a plan leads to no files.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The selection leaves nothing.
    #[error(transparent)]
    Selection(#[from] selection::Error),
    /// A seam that is too long for one of the robots' programs.
    #[error(transparent)]
    TooLong(#[from] moves::TooLong),
}

/// Everything that follows from `plan` and `job`; writes nothing.
pub fn postprocess(plan: &Plan, job: &Job, source: Source) -> Result<Output, Error> {
    let paths = modified(&select(&plan.paths, &job.selection)?, job);
    let program = program(&paths, &plan.model, &job.motion());
    let mut warnings = plan.warnings.clone();
    warnings.extend(program.warnings.iter().cloned());
    warnings.extend(tool_warning(job));
    let summary = Summary::new(plan, source, &paths, warnings);
    let mut files = vec![
        File::new("path.csv", csv::write(&paths)),
        File::new("path.json", json::write(&program.waypoints)),
    ];
    for robot in job.formats.0.iter().copied().collect::<BTreeSet<_>>() {
        files.extend(robot::files(robot, &program.waypoints, &job.robot())?);
    }
    files.extend([
        File::new("model.ply", ply::write(&plan.model)),
        File::new("job.toml", job.to_toml()),
        File::new("summary.json", summary.to_json()),
    ]);
    Ok(Output { paths, program, summary, files })
}

/// The path modifiers, in their order.
fn modified(paths: &[SeamPath], job: &Job) -> Vec<SeamPath> {
    let standoff_mm = job.path.standoff_mm.get();
    // The paper's edge points come in no order that could be sampled anew.
    let sampled = |path: &SeamPath| match job.method {
        Method::Paper => path.clone(),
        Method::Weldpath => resample(path, job.sampling()),
    };
    paths.iter().map(|path| standoff(sampled(path), standoff_mm)).collect()
}

fn tool_warning(job: &Job) -> Option<String> {
    let text = "the robot program uses the TCP and payload that are set on the controller; give them as [tool] in a job file";
    job.tool.is_none().then(|| text.to_owned())
}
