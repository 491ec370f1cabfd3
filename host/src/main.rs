//! The command `weldpath`. Each subcommand is one file in `cli/`; all they do is in the library.
#![forbid(unsafe_code)]

mod cli;

use clap::Parser;

fn main() -> std::process::ExitCode {
    cli::run(cli::Cli::parse())
}
