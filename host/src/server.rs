//! `weldpath open`: the report as a page that edits its job, and the server on 127.0.0.1 that it talks to.
//!
//! The page asks for six things: itself, the numbers of the last plan, its files, a cross-section of one of its seams, the schema
//! of a job, and the state of the session, for which it waits until there is news. It does five: edit, undo, redo, plan, cancel.
//! It names no file but those that the last plan wrote, and what is typed on the start page. It changes the job only; a plan
//! writes the job with all other files of a run, and `weldpath plan --job` makes the same of it.

mod command;
mod edit;
mod guard;
mod http;
mod planner;
mod session;
mod start;

pub use session::Workplace;
pub use start::{Choice, Chooser, Start};

use http::First;
use weldpath_job::run::job::Job;

/// Plans `job` and shows it at a port, with 0 at any that is free, until Ctrl-C, or until no page is open any more. `announce` is told the page's address, and
/// another that leads there once, to be handed to a browser.
///
/// # Errors
/// If the system grants no port, no thread or no randomness.
pub fn open(
    job: Job,
    workplace: Workplace,
    port: u16,
    announce: impl FnOnce(&str, &str),
) -> std::io::Result<()> {
    let session = session::Session::new(job, workplace);
    planner::start(&session, session::Wish::Whole)?;
    http::serve(First::Session(session), port, announce)
}

/// Shows a page on which something to open is chosen, and then that; else as [`open`].
///
/// # Errors
/// If the system grants no port or no randomness.
pub fn choose(start: Start, port: u16, announce: impl FnOnce(&str, &str)) -> std::io::Result<()> {
    http::serve(First::Start(start), port, announce)
}
