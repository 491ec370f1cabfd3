//! The thread that plans: the same steps as `weldpath plan --job`, and the same files.
//!
//! What was found in the scan is kept: an edit that leaves the search as it is only makes the paths and files anew, and is drawn
//! without being asked for.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::Vector3;

use super::session::{Begun, Searched, Session, Shown, Told, Wish, Workplace};
use crate::report::{self, Recording};
use weldpath_files::{File, Writer};
use weldpath_job::output::verdict::State;
use weldpath_job::run::job::Job;
use weldpath_job::run::planning::{self, Error, PASSED};
use weldpath_job::run::postprocessing::{self, Output, postprocess_observed};
use weldpath_method::pipeline::{Evidence, Observer, Plan, PlanError};
use weldpath_method::weld::{PathPoint, SeamPath};

/// Tells the pages how far the plan is.
struct Watch<'a> {
    session: &'a Session,
    stop: &'a AtomicBool,
    recording: Recording,
}

impl Observer for Watch<'_> {
    fn stage(&mut self, name: &'static str) {
        let usual = PASSED.iter().find(|(stage, _)| *stage == name).map_or(0, |(_, percent)| *percent);
        self.session.stage(name, usual);
    }

    fn evidence(&mut self, evidence: &Evidence) {
        self.recording = Recording::of(evidence);
    }

    fn is_done(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }
}

/// Says that the plan has ended, however it does.
struct Turn<'a> {
    session: &'a Session,
    failure: Option<Told>,
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.session.ended(self.failure.take());
    }
}

/// Begins to plan the job as it is now, to write its files, and to show its report; with [`Wish::Kept`] only if what is kept is
/// enough for it. Nothing if a plan is being made.
///
/// # Errors
/// If the system grants no thread.
pub(super) fn start(session: &Arc<Session>, wish: Wish) -> std::io::Result<()> {
    let mut next = session.begin(wish);
    if next.is_none() {
        return Ok(());
    }
    let own = Arc::clone(session);
    let work = move || {
        while let Some(begun) = next.take() {
            plan(&own, begun);
            next = own.next().and_then(|wish| own.begin(wish));
        }
    };
    let thread = std::thread::Builder::new().name("plan".into()).spawn(work);
    thread.map(drop).inspect_err(|_| session.ended(None))
}

fn plan(session: &Session, Begun { wish, job, stop }: Begun) {
    let died = told("the plan ended before its time", "the terminal says why; plan again");
    let mut turn = Turn { session, failure: Some(died) };
    let found = match wish {
        Wish::Whole => search(session, &job, &stop).map(Some),
        Wish::Kept => Ok(planning::kept(&job, session.workplace.allowed, &session.kept)),
    };
    let planned = found.and_then(|found| found.map_or(Ok(()), |found| show(session, job, found, &stop)));
    // An edit that another one overtook is no failure.
    let is_overtaken = wish == Wish::Kept && stop.load(Ordering::SeqCst);
    turn.failure = planned.err().filter(|_| !is_overtaken);
}

/// What follows from what was found: the files, and the page.
fn show(session: &Session, job: Job, found: Arc<Searched>, stop: &AtomicBool) -> Result<(), Told> {
    session.found(&found);
    let source = planning::source(&found.scan, &job);
    let mut watch = Watch { session, stop, recording: Recording::default() };
    let mut output =
        postprocess_observed(&found.plan, &job, source, &mut watch).map_err(|error| match error {
            postprocessing::Error::GivenUp => given_up(),
            error => told(error, "take the last edit back, or choose other seams"),
        })?;
    session.stage("files", 99);
    let report = found.seen.as_ref().map(|seen| report::files(&found.plan, &output, seen, &job));
    let report = report.unwrap_or_default();
    let html =
        report.first().map(|page| String::from_utf8_lossy(&page.bytes).into_owned()).unwrap_or_default();
    output.files.extend(report);
    if stop.load(Ordering::SeqCst) {
        return Err(given_up());
    }
    write(&session.workplace, &output.files)?;
    session.kept.save();
    let (html, reversed) = (html.into(), reversed(&found.plan, &output));
    let (paths, files) = (output.paths.as_slice().into(), names(&output.files));
    session.show(Shown { html, files, job, paths, reversed, found: Some(found), ..Shown::default() });
    refused(&output)
}

/// The seams of the scan. What was seen where there is none is written and shown.
fn search(session: &Session, job: &Job, stop: &AtomicBool) -> Result<Arc<Searched>, Told> {
    let mut watch = Watch { session, stop, recording: Recording::default() };
    let recording = |watch: &mut Watch| Some(std::mem::take(&mut watch.recording));
    match planning::find(job, session.workplace.allowed, &session.kept, &mut watch, recording) {
        Ok(found) => Ok(found),
        Err(Error::Input(error)) => Err(told(error, "the scan is read anew with the next plan")),
        Err(Error::Plan { error: PlanError::GivenUp, .. }) => Err(given_up()),
        Err(Error::Plan { error: error @ PlanError::NoView { .. }, .. }) => Err(told(error, "scan again")),
        Err(Error::Plan { error: error @ PlanError::Touch(_), .. }) => {
            Err(told(error, "take the touch out of the job, or name its seam"))
        }
        Err(Error::Plan {
            error: error @ (PlanError::NoSeam { .. } | PlanError::TooSparse { .. }),
            read,
        }) => {
            let seen = report::without_seams(&watch.recording, job, &error, *read);
            write(&session.workplace, &seen)?;
            if let Some(page) = seen.first() {
                let html = String::from_utf8_lossy(&page.bytes).into();
                session.show(Shown { html, files: names(&seen), job: job.clone(), ..Shown::default() });
            }
            Err(told(error, "docs/troubleshooting.md says what to try"))
        }
    }
}

/// Seams whose first pass is welded against the direction in which they were found.
fn reversed(plan: &Plan, output: &Output) -> BTreeSet<usize> {
    let turned = |found: &&SeamPath| {
        let welded = output.paths.iter().find(|path| path.seam == found.seam)?;
        let amid = welded.points.get(welded.points.len() / 2)?;
        let away_mm = |p: &&PathPoint| (p.position_mm - amid.position_mm).norm();
        let beside = found.points.iter().min_by(|a, b| away_mm(a).total_cmp(&away_mm(b)))?;
        let travel = |point: &PathPoint| point.base_from_torch * Vector3::y();
        Some(travel(amid).dot(&travel(beside)) < 0.0)
    };
    plan.paths.iter().filter(|path| turned(path) == Some(true)).map(|path| path.seam).collect()
}

fn names(files: &[File]) -> Arc<[String]> {
    files.iter().map(|file| file.name.clone()).collect()
}

fn write(workplace: &Workplace, files: &[File]) -> Result<(), Told> {
    let Workplace { out, given, overwrite, .. } = workplace;
    let writer = Writer::new(out).overwrite(*overwrite).given(given.as_deref());
    let hint = "nothing is lost: free the folder, or start again with --out and another one, and plan again";
    writer.write(files).map(drop).map_err(|error| told(error, hint))
}

fn refused(output: &Output) -> Result<(), Told> {
    match output.summary.verdict().state {
        State::Refused => Err(told(
            "the plan is refused: no program is written",
            "the verdict below the picture unfolds to its reasons; confirm one where it is known to be harmless",
        )),
        State::Ready | State::Check => Ok(()),
    }
}

fn given_up() -> Told {
    told("the plan was given up: no file has changed", "plan again when you are ready")
}

fn told(message: impl std::fmt::Display, hint: &str) -> Told {
    Told { message: message.to_string(), hint: hint.into() }
}
