//! A run as a library user has it: what was found, and what may be done with it.

use std::path::Path;
use std::sync::Arc;

use weldpath_files::{self as files, File};
use weldpath_job::output::summary::Summary;
use weldpath_job::output::verdict::{ReasonId, State, Verdict};
use weldpath_job::robot::dialect::Dialect;
use weldpath_job::run::job::{self, Job};
use weldpath_job::run::{planning, postprocessing};
use weldpath_method::geometry::cloud::PointCloud;
use weldpath_method::input::Scan;
use weldpath_method::pipeline::{Evidence, Observer, Plan, PlanError};
use weldpath_method::seam::Seam;
use weldpath_method::weld::SeamPath;
use weldpath_method::weld::program::Waypoint;

use crate::report::{self, Recording};

/// Why there is no run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Settings of the job exclude each other.
    #[error(transparent)]
    Job(#[from] job::Error),
    /// No seam was found, or the plan was given up.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The job selects nothing, or more than a program may have.
    #[error(transparent)]
    Selection(#[from] postprocessing::Error),
}

/// Why paths or a program are not handed out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Withheld {
    /// The plan is refused.
    #[error("the plan is refused: {}", lines(.0))]
    Refused(Verdict),
    /// A person has to confirm these reasons first.
    #[error("not confirmed: {}", ids(.0))]
    Unconfirmed(Vec<ReasonId>),
}

fn lines(verdict: &Verdict) -> String {
    verdict.lines().get(1..).unwrap_or_default().join("; ")
}

fn ids(reasons: &[ReasonId]) -> String {
    reasons.iter().map(|id| id.name()).collect::<Vec<_>>().join(", ")
}

/// What was found in a scan, and the program that a job makes of it.
///
/// A refused run hands out no path and no program; of one that has to be checked, the program only to who names what is to be
/// confirmed. Seams and model can always be looked at.
#[derive(Debug)]
pub struct Run {
    scan: Arc<Scan>,
    found: Arc<Found>,
    job: Job,
    output: postprocessing::Output,
}

#[derive(Debug)]
struct Found {
    plan: Plan,
    seen: Recording,
}

/// Plans a scan as `weldpath plan` does: seams, paths, program, verdict. The job says nothing of where the scan is from.
///
/// The observer is asked about twenty times a second whether the run is still wanted.
///
/// # Errors
/// If the job contradicts itself, nothing weldable is in view, or the observer wants no more.
///
/// ```no_run
/// use std::path::Path;
/// use weldpath::{Job, input};
///
/// let scan = input::read(Path::new("fixtures/cell"), &input::Options::default())?;
/// let run = weldpath::plan(&scan, &Job::default(), &mut ())?;
/// for reason in &run.verdict().reasons {
///     println!("{}", reason.line());
/// }
/// for path in run.paths()? {
///     println!("seam {}: {} points", path.seam, path.points.len());
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn plan(scan: &Scan, job: &Job, observer: &mut dyn Observer) -> Result<Run, Error> {
    job.check()?;
    let mut watching = Watching { inner: observer, seen: Recording::default() };
    let plan = planning::plan(scan, job, &mut watching)?;
    let found = Arc::new(Found { plan, seen: watching.seen });
    Run::of(Arc::new(scan.without_points()), found, job.clone(), observer)
}

impl Run {
    fn of(scan: Arc<Scan>, found: Arc<Found>, job: Job, observer: &mut dyn Observer) -> Result<Self, Error> {
        let source = planning::source(&scan, &job);
        let output = postprocessing::postprocess_observed(&found.plan, &job, source, observer)?;
        Ok(Self { scan, found, job, output })
    }

    /// The same run with its program for other robots; nothing is searched again.
    ///
    /// # Errors
    /// If a seam is too long for one of them, or the observer wants no more.
    pub fn for_robots(&self, robots: &[Dialect], observer: &mut dyn Observer) -> Result<Self, Error> {
        let job = Job { formats: Some(robots.to_vec()), ..self.job.clone() };
        job.check()?;
        Self::of(Arc::clone(&self.scan), Arc::clone(&self.found), job, observer)
    }

    /// Whether the program may be run, and what stands against it.
    pub fn verdict(&self) -> &Verdict {
        self.output.summary.verdict()
    }

    /// The job as it was planned.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// The content of `summary.json`.
    pub fn summary(&self) -> &Summary {
        &self.output.summary
    }

    /// All seams that were found, whether or not they are welded.
    pub fn seams(&self) -> &[Seam] {
        &self.found.plan.seams
    }

    /// All views merged, registered, thinned and filtered.
    pub fn model(&self) -> &PointCloud {
        &self.found.plan.model
    }

    /// Torch paths in the order in which they are welded, one for each pass.
    ///
    /// # Errors
    /// If the plan is refused.
    pub fn paths(&self) -> Result<&[SeamPath], Withheld> {
        match self.verdict().state {
            State::Refused => Err(Withheld::Refused(self.verdict().clone())),
            _ => Ok(&self.output.paths),
        }
    }

    /// The whole program with its approaches and air moves.
    ///
    /// # Errors
    /// If the plan is refused, or has a reason that is neither accepted by the job nor among those `confirmed`.
    pub fn program(&self, confirmed: &[ReasonId]) -> Result<&[Waypoint], Withheld> {
        self.confirm(confirmed)?;
        Ok(&self.output.program.waypoints)
    }

    /// The program in the words of each robot: the files that hold it.
    ///
    /// # Errors
    /// As [`Run::program`].
    pub fn program_files(&self, confirmed: &[ReasonId]) -> Result<Vec<&File>, Withheld> {
        self.confirm(confirmed)?;
        let is_program = |file: &&File| self.output.program_files.contains(&file.name);
        Ok(self.output.files.iter().filter(is_program).collect())
    }

    fn confirm(&self, confirmed: &[ReasonId]) -> Result<(), Withheld> {
        self.paths()?;
        let reasons = &self.verdict().reasons;
        let open = reasons.iter().filter(|reason| !reason.accepted && !confirmed.contains(&reason.id));
        let mut open: Vec<ReasonId> = open.map(|reason| reason.id).collect();
        // Several of one kind are confirmed by its one id.
        open.sort_unstable();
        open.dedup();
        if open.is_empty() { Ok(()) } else { Err(Withheld::Unconfirmed(open)) }
    }

    /// Every file that `weldpath plan` writes, the report among them. The programs of a run that has to be checked name its
    /// reasons in their heads; a refused one has none.
    pub fn files(&self) -> Vec<File> {
        let report = report::files(&self.found.plan, &self.output, &self.found.seen, &self.job);
        self.output.files.iter().cloned().chain(report).collect()
    }

    /// The page with the 3-D picture, HTML.
    pub fn report(&self) -> Vec<u8> {
        report::page(&self.found.plan, &self.output, &self.found.seen, &self.job)
    }

    /// Writes [`Run::files`] to a folder, all or none. What weldpath did not write there is kept unless `overwrite` says otherwise.
    ///
    /// # Errors
    /// If a file there is not ours, or the folder cannot be written.
    pub fn write(&self, folder: &Path, overwrite: bool) -> Result<(), files::Error> {
        files::Writer::new(folder).overwrite(overwrite).write(&self.files()).map(drop)
    }
}

/// Hands everything on, and keeps what the report shows.
struct Watching<'a> {
    inner: &'a mut dyn Observer,
    seen: Recording,
}

impl Observer for Watching<'_> {
    fn stage(&mut self, name: &'static str) {
        self.inner.stage(name);
    }
    fn cloud(&mut self, stage: &'static str, cloud: &PointCloud) {
        self.inner.cloud(stage, cloud);
    }
    fn evidence(&mut self, evidence: &Evidence) {
        self.seen = Recording::of(evidence);
        self.inner.evidence(evidence);
    }
    fn is_done(&self) -> bool {
        self.inner.is_done()
    }
}
