//! `weldpath open`: the report as a page that edits its job, and the server on 127.0.0.1 that it talks to.
//!
//! The page asks for four things: itself, the numbers of the last plan, the schema of a job, and the state of things, for which
//! it waits until there is news. It does five: edit, undo, redo, plan, cancel. Nothing that it sends names a file. What it changes is the job; a
//! plan writes the job with all other files of a run, and `weldpath plan --job` makes the same of it.

mod command;
mod edit;
mod guard;
mod http;
mod planner;
mod session;

pub use session::Workplace;

use crate::run::job::Job;

/// Plans `job` and shows it until Ctrl-C, or until no page is open any more. `announce` is told the page's address, and
/// another that leads there once, to be handed to a browser.
///
/// # Errors
/// If the system grants no port, no thread or no randomness.
pub fn open(job: Job, workplace: Workplace, announce: impl FnOnce(&str, &str)) -> std::io::Result<()> {
    let session = session::Session::new(job, workplace);
    planner::start(&session, session::Wish::Whole)?;
    http::serve(session, announce)
}
