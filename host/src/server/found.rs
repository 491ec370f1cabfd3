//! What was found in a scan: kept, so that an edit of how the seams are welded needs no new search.

use std::sync::Arc;

use crate::files::reading::{self, Stamp};
use crate::input::Scan;
use crate::pipeline::Plan;
use crate::report::Recording;
use crate::run::job::Job;
use crate::run::planning;

/// What was found, for which job, and in which files.
#[derive(Debug)]
pub(super) struct Found {
    job: Job,
    stamps: Vec<Option<Stamp>>,
    /// Without its views.
    pub(super) scan: Scan,
    pub(super) plan: Plan,
    pub(super) recording: Recording,
}

/// Of each file of a scan, when it was last written. Taken before the seams are sought: what is written meanwhile counts as
/// changed.
pub(super) fn stamps(scan: &Scan) -> Vec<Option<Stamp>> {
    scan.inputs.iter().map(|path| reading::stamp(path)).collect()
}

impl Found {
    pub(super) fn new(
        job: &Job,
        stamps: Vec<Option<Stamp>>,
        scan: Scan,
        plan: Plan,
        recording: Recording,
    ) -> Self {
        Self {
            job: job.clone(),
            stamps,
            scan: Scan { views: Vec::new(), background: Arc::default(), ..scan },
            plan,
            recording,
        }
    }

    /// Whether this job finds the same, in files that are as they were.
    pub(super) fn holds_for(&self, job: &Job) -> bool {
        planning::finds_the_same(&self.job, job) && stamps(&self.scan) == self.stamps
    }
}
