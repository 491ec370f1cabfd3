//! `weldpath schema`: the JSON schema of job files, for editors.

use weldpath::run::job::Job;

use super::{Failure, print};

/// Print the JSON schema of job files, for editors
#[derive(Debug, clap::Args)]
pub(super) struct Args {}

pub(super) fn run(_: &Args) -> Result<(), Failure> {
    print(&Job::schema())
}
