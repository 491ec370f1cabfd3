//! What the page and the planning thread share: the job as it is edited, the last plan, and how far the next one is.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use tokio::sync::watch;

use super::command::{self, Target};
use super::edit::Edit;
use crate::report::{Edition, Recording};
use weldpath_files::reading;
use weldpath_job::robot::dialect::Dialect;
use weldpath_job::robot::feasibility::catalogue;
use weldpath_job::run::job::{
    Job, PassSettings, PathSettings, SeamSettings, Sequence, StitchSettings, TorchSettings, WeaveSettings,
    Weld,
};
use weldpath_job::run::{planning, postprocessing, selection};
use weldpath_method::weld::SeamPath;

/// Edits that can be undone.
const MOST_UNDONE: usize = 1000;

/// What was found in the scan, and what the report shows of it beside.
pub(super) type Searched = planning::Searched<Recording>;

/// Where the files of a plan go, and what may be read and replaced for it.
#[derive(Debug, Clone, Default)]
pub struct Workplace {
    /// Folder of the results.
    pub out: PathBuf,
    /// Job file that was given and may be written anew.
    pub given: Option<PathBuf>,
    /// Whether files are replaced that weldpath did not write.
    pub overwrite: bool,
    /// What reading the scan may do.
    pub allowed: planning::Allowed,
    /// Whether what was found is kept in the folder of the results, for the next time that the page is opened.
    pub keeps: bool,
}

/// A failure as it is told.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Told {
    pub message: String,
    pub hint: String,
}

/// How much of a plan is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wish {
    /// All that it takes: somebody asked for it.
    Whole,
    /// What can be made of what is kept, so that an edit is seen at once; nothing if that is not enough.
    Kept,
}

/// A plan that is being made.
#[derive(Debug, Clone)]
struct Running {
    wish: Wish,
    job: Job,
    stage: &'static str,
    percent: u64,
    stop: Arc<AtomicBool>,
    /// A whole plan is wanted when this one has ended.
    is_followed: bool,
}

/// A job that is to be planned.
#[derive(Debug)]
pub(super) struct Begun {
    pub wish: Wish,
    pub job: Job,
    /// Set when nobody waits for it any more.
    pub stop: Arc<AtomicBool>,
}

/// What the last plan left.
#[derive(Debug, Clone, Default)]
pub(super) struct Shown {
    pub edition: Edition,
    /// What was found; none where there is no seam.
    pub found: Option<Arc<Searched>>,
    /// Its report.
    pub html: Arc<str>,
    /// Names of the files that were written.
    pub files: Arc<[String]>,
    /// The job that was planned.
    pub job: Job,
    /// The passes in the order in which they are welded.
    pub paths: Arc<[SeamPath]>,
    /// Seams that are welded against the direction in which they were found.
    pub reversed: BTreeSet<usize>,
}

/// A job that an edit led away from, and what the edit was.
#[derive(Debug, Clone)]
struct Step {
    job: Job,
    words: String,
}

#[derive(Debug, Default)]
struct Desk {
    job: Job,
    undo: Vec<Step>,
    redo: Vec<Step>,
    found: Option<Arc<Searched>>,
    shown: Option<Shown>,
    running: Option<Running>,
    failure: Option<Told>,
    /// How often the job has become another.
    edits: u64,
    /// What is wanted since the last plan has ended.
    next: Option<Wish>,
}

/// One job on one scan, from the first page to the last.
#[derive(Debug)]
pub(super) struct Session {
    pub workplace: Workplace,
    /// What plans have found: edits that leave it as it is need no new search.
    pub kept: planning::Kept<Recording>,
    desk: Mutex<Desk>,
    revision: watch::Sender<u64>,
}

/// What a page is told, as JSON.
#[derive(Debug, Serialize)]
struct Overview<'a> {
    revision: u64,
    plan: u64,
    /// Which cloud that plan is drawn in.
    cloud: u64,
    running: Option<(&'static str, u64)>,
    /// Whether an edit is on its way into the picture.
    drawing: bool,
    failure: Option<&'a Told>,
    unplanned: bool,
    undo: Option<&'a str>,
    redo: Option<&'a str>,
    job: &'a Job,
    /// Whose programs are written.
    formats: Vec<Dialect>,
    settings: Settings,
    seams: Vec<SeamState>,
    /// Ids of all seams: first those that are welded, in their order.
    order: Vec<usize>,
    command: String,
    out: String,
    /// Files of the last plan, in that folder.
    files: &'a [String],
    /// Arms that are known by name.
    models: &'static [&'static str],
}

/// How something is welded, with every default.
#[derive(Debug, Serialize)]
struct Settings {
    path: PathSettings,
    torch: TorchSettings,
    weave: WeaveSettings,
    stitch: StitchSettings,
    pass: Vec<PassSettings>,
}

impl From<&Weld> for Settings {
    fn from(weld: &Weld) -> Self {
        let Weld { path, torch, weave, stitch, passes } = weld.filled();
        Self { path, torch, weave, stitch, pass: passes }
    }
}

#[derive(Debug, Serialize)]
struct SeamState {
    id: usize,
    on: bool,
    reversed: bool,
    /// Its joint type as it was found.
    found_joint: Option<&'static str>,
    /// What is said for it alone.
    own: serde_json::Value,
    settings: Settings,
}

impl Session {
    pub(super) fn new(job: Job, workplace: Workplace) -> Arc<Self> {
        let desk = Mutex::new(Desk { job, ..Desk::default() });
        let kept = match workplace.keeps {
            true => planning::Kept::within(&workplace.out),
            false => planning::Kept::default(),
        };
        Arc::new(Self { workplace, kept, desk, revision: watch::Sender::new(1) })
    }

    fn desk(&self) -> MutexGuard<'_, Desk> {
        // What a thread that died left is a whole job and a whole plan: both are put in their place in one step.
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes something, and tells the pages.
    fn change<T>(&self, change: impl FnOnce(&mut Desk) -> T) -> T {
        let done = change(&mut self.desk());
        self.revision.send_modify(|revision| *revision += 1);
        done
    }

    /// Sees every change from now on.
    pub(super) fn changes(&self) -> watch::Receiver<u64> {
        self.revision.subscribe()
    }

    /// One click. What is planned meanwhile goes on: it is the plan of the job before.
    pub(super) fn edit(&self, edit: &Edit) -> Result<(), String> {
        self.change(|desk| {
            let found = desk.found.clone();
            let edited = edit.on(&desk.job, found.as_ref().map(|found| &found.plan))?;
            if edited != desk.job {
                let job = desk.replace(edited);
                desk.undo.push(Step { job, words: edit.words() });
                desk.redo.clear();
                let many = desk.undo.len().saturating_sub(MOST_UNDONE);
                desk.undo.drain(..many);
            }
            Ok(())
        })
    }

    /// Takes the last edit back; nothing if there is none.
    pub(super) fn undo(&self) {
        self.change(|desk| {
            let Some(Step { job, words }) = desk.undo.pop() else { return };
            let job = desk.replace(job);
            desk.redo.push(Step { job, words });
        });
    }

    /// Makes the edit again that was taken back last; nothing if there is none.
    pub(super) fn redo(&self) {
        self.change(|desk| {
            let Some(Step { job, words }) = desk.redo.pop() else { return };
            let job = desk.replace(job);
            desk.undo.push(Step { job, words });
        });
    }

    /// How often the job has become another.
    pub(super) fn edits(&self) -> u64 {
        self.desk().edits
    }

    /// Hands out the job to be planned; none if a plan is being made, or there is no edit to be drawn.
    pub(super) fn begin(&self, wish: Wish) -> Option<Begun> {
        self.change(|desk| {
            if let Some(running) = &mut desk.running {
                // Whoever asks for a plan does not wait for the drawing of an edit, and gets it when that has ended.
                if (running.wish, wish) == (Wish::Kept, Wish::Whole) {
                    running.stop.store(true, Ordering::SeqCst);
                    running.is_followed = true;
                }
                return None;
            }
            if wish == Wish::Kept && !desk.is_unplanned() {
                return None;
            }
            let (stop, job) = (Arc::new(AtomicBool::new(false)), desk.job.clone());
            desk.running = Some(Running {
                wish,
                job: job.clone(),
                stage: "scan",
                percent: 0,
                stop: Arc::clone(&stop),
                is_followed: false,
            });
            desk.failure = None;
            Some(Begun { wish, job, stop })
        })
    }

    /// What is wanted since the last plan has ended: another that was asked for meanwhile, or the drawing of an edit.
    pub(super) fn next(&self) -> Option<Wish> {
        self.desk().next.take()
    }

    /// Gives the plan up that is being made; it ends with its present stage.
    pub(super) fn cancel(&self) {
        self.change(|desk| {
            if let Some(running) = &desk.running {
                running.stop.store(true, Ordering::SeqCst);
            }
        });
    }

    /// A stage of the plan has begun.
    pub(super) fn stage(&self, stage: &'static str, usual_percent: u64) {
        self.change(|desk| {
            if let Some(running) = &mut desk.running {
                // A finer scale begins some stages again: the bar does not go back.
                (running.stage, running.percent) = (stage, running.percent.max(usual_percent));
            }
        });
    }

    /// What was found, and what edits are held against.
    pub(super) fn found(&self, found: &Arc<Searched>) {
        self.change(|desk| desk.found = Some(Arc::clone(found)));
    }

    /// The plan that was being made can be looked at.
    pub(super) fn show(&self, shown: Shown) {
        self.change(|desk| {
            let Edition { plan, cloud } =
                desk.shown.as_ref().map_or_else(Edition::default, |last| last.edition);
            let found = |shown: &Shown| shown.found.as_ref().map(Arc::as_ptr);
            let last = desk.shown.as_ref().and_then(found);
            let is_same = last.is_some() && last == found(&shown);
            let edition = Edition { plan: plan + 1, cloud: cloud + u64::from(!is_same) };
            desk.shown = Some(Shown { edition, ..shown });
        });
    }

    /// The thread that plans has done, or could not.
    pub(super) fn ended(&self, failure: Option<Told>) {
        self.change(|desk| {
            desk.next = desk.running.take().and_then(|running| match running.is_followed {
                true => Some(Wish::Whole),
                false => (running.job != desk.job).then_some(Wish::Kept),
            });
            desk.failure = failure;
        });
    }

    /// What the last plan left.
    pub(super) fn shown(&self) -> Option<Shown> {
        self.desk().shown.clone()
    }

    /// A file of the last plan; none if that has none of this name.
    pub(super) fn file(&self, name: &str) -> Option<std::io::Result<Vec<u8>>> {
        let shown = self.shown()?;
        let own = shown.files.iter().find(|file| *file == name)?;
        Some(reading::bytes(&self.workplace.out.join(own), reading::MOST_RESULT))
    }

    /// Whether nothing would be lost if the server ended.
    pub(super) fn is_at_rest(&self) -> bool {
        let desk = self.desk();
        desk.running.is_none() && !desk.is_unplanned()
    }

    /// All that a page shows beside the report, as JSON.
    pub(super) fn told(&self) -> String {
        let desk = self.desk();
        let Workplace { out, overwrite, allowed, .. } = &self.workplace;
        let target = Target { out, overwrite: *overwrite, allow_outside: allowed.outside };
        let edition = desk.shown.as_ref().map(|shown| shown.edition).unwrap_or_default();
        let running = |wish: Wish| desk.running.as_ref().filter(|running| running.wish == wish);
        let told = Overview {
            revision: *self.revision.borrow(),
            plan: edition.plan,
            cloud: edition.cloud,
            running: running(Wish::Whole).map(|running| (running.stage, running.percent)),
            drawing: running(Wish::Kept).is_some(),
            failure: desk.failure.as_ref(),
            unplanned: desk.is_unplanned(),
            undo: desk.undo.last().map(|step| step.words.as_str()),
            redo: desk.redo.last().map(|step| step.words.as_str()),
            job: &desk.job,
            formats: desk.job.dialects(),
            settings: Settings::from(&desk.job.weld()),
            seams: desk.seams(),
            order: desk.order(),
            command: command::command(&desk.job, target),
            out: out.display().to_string(),
            files: desk.shown.as_ref().map_or(&[], |shown| &shown.files),
            models: catalogue::NAMES,
        };
        // Strings, finite numbers and lists only: there is nothing serde_json could refuse.
        serde_json::to_string(&told).unwrap_or_default()
    }
}

impl Desk {
    /// Another job in place of this one, which is handed back. What is drawn of this one is given up.
    fn replace(&mut self, job: Job) -> Job {
        self.edits += 1;
        if let Some(running) = self.running.as_ref().filter(|running| running.wish == Wish::Kept) {
            running.stop.store(true, Ordering::SeqCst);
        }
        std::mem::replace(&mut self.job, job)
    }

    fn is_unplanned(&self) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.job != self.job)
    }

    /// All seams: as the job lists them, or as the last plan welds them, the others behind by id.
    fn order(&self) -> Vec<usize> {
        let (Some(found), Some(shown)) = (&self.found, &self.shown) else { return Vec::new() };
        let mut order = match self.job.order.sequence {
            Sequence::Listed => postprocessing::listed(&found.plan, &self.job).unwrap_or_default(),
            Sequence::Found => Vec::new(),
            Sequence::Shortest => shown.paths.iter().map(|path| path.seam).collect(),
        };
        order.extend(found.plan.paths.iter().map(|path| path.seam));
        let mut seen = BTreeSet::new();
        order.retain(|id| seen.insert(*id));
        order
    }

    fn seams(&self) -> Vec<SeamState> {
        let (Some(found), Some(shown)) = (&self.found, &self.shown) else { return Vec::new() };
        let plan = &found.plan;
        let chosen = postprocessing::chosen(plan, &self.job).unwrap_or_default();
        let state = |path: &SeamPath| {
            let id = path.seam;
            let named = |own: &&SeamSettings| selection::named(&plan.paths, own) == Ok(Some(id));
            let own = self.job.seams.iter().rfind(named);
            // A job that names a seam which is gone says of none how it is welded.
            let weld = postprocessing::weld(path, plan, &self.job).unwrap_or_else(|_| self.job.weld());
            SeamState {
                id,
                found_joint: plan.seams.iter().find(|seam| seam.id == id).map(|seam| seam.joint.name()),
                on: chosen.iter().any(|path| path.seam == id),
                reversed: shown.reversed.contains(&id),
                own: own.and_then(|own| serde_json::to_value(own).ok()).unwrap_or_default(),
                settings: Settings::from(&weld),
            }
        };
        plan.paths.iter().map(state).collect()
    }
}
