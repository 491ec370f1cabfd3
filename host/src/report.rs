//! What a run looks like: `report.html`, one page without network, and `report.svg`, a picture without a browser.
//!
//! [`Recording`] keeps of a running pipeline what the plan itself forgets; [`files`] turns both into the page: a JSON
//! block with every number, a binary block with the points, and the bundled script of `web/`. Shape: `docs/formats.md`.

mod colour;
mod content;
mod deviation;
mod extent;
mod histogram;
mod page;
mod picture;
mod points;
mod ratio;
mod recording;
mod run;
#[cfg(feature = "open")]
mod section;

pub use deviation::deviation;
pub use page::with_deviation;
#[cfg(feature = "open")]
pub use page::{Edition, editable, numbers, start, waiting};
pub use recording::Recording;
use run::Run;
#[cfg(feature = "open")]
pub use section::{Section, section};

use weldpath_files::File;
use weldpath_job::output::summary::{self, Source, Summary};
use weldpath_job::output::verdict::{Finding, ReasonId, Verdict};
use weldpath_job::run::job::Job;
use weldpath_job::run::postprocessing::Output;
use weldpath_method::pipeline::{Plan, PlanError};
use weldpath_method::weld::program::Program;

/// Name of the page within a run's folder.
pub const PAGE: &str = "report.html";
/// Name of the picture within a run's folder.
pub const PICTURE: &str = "report.svg";

/// The page and the picture of a run.
pub fn files(plan: &Plan, output: &Output, recording: &Recording, job: &Job) -> Vec<File> {
    let title = title(job);
    let run = Run { plan, output, recording, job, title: &title };
    let scene = content::Scene::of(&run);
    let (page, picture) = rayon::join(|| page_of(&run, &scene), || picture::svg(&run, &scene));
    vec![File::new(PAGE, page), File::new(PICTURE, picture)]
}

/// The page of a run alone.
pub(crate) fn page(plan: &Plan, output: &Output, recording: &Recording, job: &Job) -> Vec<u8> {
    let title = title(job);
    let run = Run { plan, output, recording, job, title: &title };
    page_of(&run, &content::Scene::of(&run)).into()
}

fn page_of(run: &Run, scene: &content::Scene) -> String {
    let (content, bytes) = content::document(run, scene);
    page::page(run.title, &content, &bytes)
}

/// The same of a run that found no seam, and its `summary.json`: what was seen, in `error` why nothing came of it, and what looked
/// like a seam and was rejected. Empty if nothing was recorded.
pub fn without_seams(recording: &Recording, job: &Job, error: &PlanError, read: Source) -> Vec<File> {
    let Some(clouds) = &recording.clouds else { return Vec::new() };
    let (model, unwelded) = (clouds.model(), recording.unwelded.clone());
    let plan = Plan { model, unwelded, ..Plan::default() };
    let id = match error {
        PlanError::TooSparse { .. } => ReasonId::Sparse,
        _ => ReasonId::NoSeam,
    };
    let verdict = Verdict::new([Finding::new(id, error.to_string())], &[]);
    let rejected = recording.rejected.clone();
    let summary = Summary::new(&plan, read, &[], &[], job.order.up.get(), rejected).with_verdict(verdict);
    let output = Output {
        paths: Vec::new(),
        program: Program::default(),
        summary,
        feasibility: None,
        files: Vec::new(),
        program_files: Vec::new(),
    };
    let mut files = files(&plan, &output, recording, job);
    files.push(File::new(summary::FILE, output.summary.to_json()));
    files
}

/// Name of the input without its folders.
fn title(job: &Job) -> String {
    let name = job.input.as_ref().and_then(|input| input.file_name());
    name.map_or("scan".into(), |name| name.to_string_lossy().into_owned())
}
