//! From a plan to what a run leaves behind: selection, path modifiers, the program, and the files.

use crate::export::directory::File;
use crate::export::summary::{Source, Summary};
use crate::export::{csv, feasibility as feasibility_csv, json, ply, urscript};
use crate::feasibility::{self, Report};
use crate::job::{ASSUMED_TCP_MM, Job, Method};
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

/// Everything that follows from `plan` and `job`; writes nothing.
pub fn postprocess(plan: &Plan, job: &Job, source: Source) -> Result<Output, selection::Error> {
    let paths = modified(&select(&plan.paths, &job.selection)?, job);
    let program = program(&paths, &plan.model, &job.motion());
    let mut warnings = plan.warnings.clone();
    warnings.extend(program.warnings.iter().cloned());
    warnings.extend(tool_warning(job));
    let feasibility = feasibility(plan, job, &paths);
    warnings.extend(feasibility.iter().flat_map(Report::warnings));
    let summary = Summary::new(plan, source, &paths, warnings).with_feasibility(feasibility.as_ref());
    let mut files = vec![
        File::new("path.csv", csv::write(&paths)),
        File::new("path.json", json::write(&program.waypoints)),
        File::new("path.script", urscript::write(&program.waypoints, &job.controller())),
        File::new("model.ply", ply::write(&plan.model)),
        File::new("job.toml", job.to_toml()),
        File::new("summary.json", summary.to_json()),
    ];
    if let Some(report) = &feasibility {
        files.push(File::new("feasibility.csv", feasibility_csv::csv(&program.waypoints, report)));
    }
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

/// Reach, joints and torch, if the job says with what.
fn feasibility(plan: &Plan, job: &Job, paths: &[SeamPath]) -> Option<Report> {
    let program = |paths: &[SeamPath]| program(paths, &plan.model, &job.motion()).waypoints;
    Some(feasibility::assess(paths, &program, &plan.model, &job.feasibility()?))
}

fn tool_warning(job: &Job) -> Option<String> {
    let text = "path.script uses the TCP and payload that are set on the controller; give them as [tool] in a job file";
    let assumed = if job.robot.is_some() {
        format!(
            "; for the feasibility check the tip is taken {ASSUMED_TCP_MM} mm straight ahead of the flange"
        )
    } else {
        String::new()
    };
    job.tool.is_none().then(|| format!("{text}{assumed}"))
}
