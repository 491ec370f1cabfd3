//! The scan of a job, read and planned: the one way that the command and the page that edits a job both take.
//!
//! [`find`] does what has to be done, and no more: an edit of how seams are welded leaves what is read and what the pipeline is
//! told as they are, and then neither is done again; a seam that is asked for is sought in what is merged and found already.

mod reading;
mod search;
mod steps;

use std::path::Path;
use std::sync::Arc;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::output::summary::Source;
use crate::run::job::Job;
use crate::run::kept::{Key, Shelf, content};
use crate::run::verdict;
use weldpath_method::input::{self, Scan};
use weldpath_method::pipeline::{Observer, Plan, PlanError};

use reading::Reading;
pub use reading::{Allowed, options, over_background, read};
pub use search::Search;
use steps::Steps;

/// Share of the time, in percent, that has usually passed when a stage begins, measured on the fixtures: a stage at a time
/// says little about when it is over.
pub const PASSED: [(&str, u64); 11] = [
    ("scan", 0),
    ("normals", 3),
    ("reconstruction", 32),
    ("downsampling", 48),
    ("denoising", 62),
    ("seam", 67),
    ("asked", 94),
    ("toolpath", 95),
    ("order", 96),
    ("air", 97),
    ("torch", 98),
];

/// All seams of a scan, as the job says they are found.
///
/// # Errors
/// If there is none, or the observer wants no more.
pub fn plan(scan: &Scan, job: &Job, observer: &mut dyn Observer) -> Result<Plan, PlanError> {
    Search::new(job, scan.frame).run(scan, observer)
}

/// What was found in a scan.
#[derive(Debug, Serialize, Deserialize)]
pub struct Searched<R> {
    /// What was read, without its points.
    pub scan: Scan,
    /// Its seams.
    pub plan: Plan,
    /// What an observer saw of it; none if nobody wanted to.
    pub seen: Option<R>,
}

/// What earlier plans read and found.
#[derive(Debug)]
pub struct Kept<R> {
    readings: Shelf<Reading>,
    plans: Shelf<Searched<R>>,
    steps: Steps,
}

impl<R> Default for Kept<R> {
    fn default() -> Self {
        Self { readings: Shelf::in_memory(), plans: Shelf::in_memory(), steps: Steps::default() }
    }
}

impl<R> Kept<R> {
    /// What is kept in a folder of results, too, from one run of the program to the next.
    pub fn within(results: &Path) -> Self {
        let (readings, plans) = (Shelf::within(results, "scan"), Shelf::within(results, "plan"));
        Self { readings, plans, steps: Steps::default() }
    }
}

impl<R: Record> Kept<R> {
    /// Puts on the disk what is not there yet, if it is kept there: when the files of the run are written.
    pub fn save(&self) {
        self.readings.save();
        self.plans.save();
    }

    fn keep(&self, key: Key, scan: &Scan, plan: Plan, seen: Option<R>) -> Arc<Searched<R>> {
        let scan = Scan { background: Arc::default(), ..scan.without_points() };
        let found = Arc::new(Searched { scan, plan, seen });
        // Who saw nothing of the search would keep from others what they want to see.
        if found.seen.is_some() {
            self.plans.put(key, &found);
        }
        found
    }
}

/// What an observer saw of a search, and can be kept on a disk.
pub trait Record: Serialize + DeserializeOwned {}
impl<R: Serialize + DeserializeOwned> Record for R {}

/// Why nothing was found.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The input cannot be read.
    #[error(transparent)]
    Input(#[from] input::Error),
    /// There is no plan of what was read.
    #[error("{error}")]
    Plan {
        /// Why.
        error: PlanError,
        /// What was read.
        read: Box<Source>,
    },
}

impl Error {
    fn of_plan(error: PlanError, scan: &Scan, job: &Job) -> Self {
        Self::Plan { error, read: Box::new(source(scan, job)) }
    }
}

/// What is kept of the same job on the same files, if there is any: nothing is read or sought.
pub fn kept<R: Record>(job: &Job, allowed: Allowed, kept: &Kept<R>) -> Option<Arc<Searched<R>>> {
    let reading = kept.readings.get(reading::key(job, allowed))?;
    let (frame, content) = reading.from(reading::files_now(job, Some(&reading)))?;
    kept.plans.get(Search::new(job, frame).key(content))
}

/// Reads the scan of a job and finds its seams, or takes what is kept of the same: then no stage begins. `seen` is what the
/// observer saw of the search; a plan of which it saw nothing is not kept.
///
/// # Errors
/// If the scan cannot be read, has no seam, or the observer wants no more.
pub fn find<R: Record, O: Observer>(
    job: &Job,
    allowed: Allowed,
    kept: &Kept<R>,
    observer: &mut O,
    seen: impl FnOnce(&mut O) -> Option<R>,
) -> Result<Arc<Searched<R>>, Error> {
    let key = reading::key(job, allowed);
    let earlier = kept.readings.get(key);
    let files = reading::files_now(job, earlier.as_deref());
    if let Some((frame, content)) = earlier.and_then(|reading| reading.from(files)) {
        let search = Search::new(job, frame);
        if let Some(found) = kept.plans.get(search.key(content)) {
            return Ok(found);
        }
        if let Some(begun) = kept.steps.begun(&search, content) {
            let planned = kept.steps.go_on(&begun, &search, content, observer);
            let plan = planned.map_err(|error| Error::of_plan(error, &begun.scan, job))?;
            return Ok(kept.keep(search.key(content), &begun.scan, plan, seen(observer)));
        }
    }
    observer.stage("scan");
    let scan = read(job, allowed)?;
    let content = content::of_scan(&scan);
    kept.readings.put(key, &Arc::new(Reading::new(job, &scan, content, files)));
    let search = Search::new(job, scan.frame);
    let key = search.key(content);
    // Files that were written anew, or lie elsewhere in the folder, and say the same.
    if let Some(found) = kept.plans.get(key) {
        return Ok(found);
    }
    let planned = kept.steps.run(&search, &scan, content, observer);
    let plan = planned.map_err(|error| Error::of_plan(error, &scan, job))?;
    Ok(kept.keep(key, &scan, plan, seen(observer)))
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
