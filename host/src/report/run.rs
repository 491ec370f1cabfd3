//! One run of weldpath, as the page and the picture show it.

use super::recording::Recording;
use weldpath_job::run::job::Job;
use weldpath_job::run::postprocessing::Output;
use weldpath_method::pipeline::Plan;

/// What the page and the picture are made from.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    pub plan: &'a Plan,
    pub output: &'a Output,
    pub recording: &'a Recording,
    pub job: &'a Job,
    pub title: &'a str,
}
