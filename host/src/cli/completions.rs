//! `weldpath completions`: what a shell needs to complete subcommands and options.

use clap_complete::{Shell, generate};

use super::{Failure, help, print};

/// Print the completions of a shell, to be put where it looks for them
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// bash, zsh, fish, elvish or powershell
    #[arg(value_enum, hide_possible_values = true)]
    shell: Shell,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let mut script = Vec::new();
    generate(args.shell, &mut help::command(), "weldpath", &mut script);
    print(&String::from_utf8_lossy(&script))
}
