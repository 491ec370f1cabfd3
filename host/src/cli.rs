//! Command line: subcommands, exit codes, and how a failure is told.

mod completions;
mod evaluate;
mod help;
mod keys;
mod memory;
mod monitor;
mod pendant;
mod plan;
mod port;
mod progress;
mod refit;
mod scan;
mod schema;
mod score;
mod simulate;
mod stream;
mod suite;
mod table;
mod weld;

use std::io::Write;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

const EXIT_CODES: &str = "Exit codes: 0 done; 2 wrong usage or job file; 3 no seam found; 4 input cannot be read; \
                          5 output cannot be written; 6 no pendant, or the link was lost; 7 the pendant did not finish.";

/// From scans of a workpiece to the motion of a welding torch.
#[derive(Debug, Parser)]
#[command(name = "weldpath", version, after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Plan(Box<plan::Args>),
    Simulate(simulate::Args),
    Refit(refit::Args),
    Evaluate(evaluate::Args),
    Stream(stream::Args),
    Monitor(monitor::Args),
    Pendant(pendant::Args),
    Scan(scan::Args),
    Score(score::Args),
    Completions(completions::Args),
    Schema(schema::Args),
}

/// Reads the command line and does what it says.
pub(crate) fn start() -> ExitCode {
    memory::keep_freed();
    match help::parse() {
        Ok(cli) => run(&cli),
        Err(exit) => exit,
    }
}

/// Runs a subcommand and tells a failure in words on standard error.
fn run(cli: &Cli) -> ExitCode {
    let result = match &cli.command {
        Command::Plan(args) => plan::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Refit(args) => refit::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Stream(args) => stream::run(args),
        Command::Monitor(args) => monitor::run(args),
        Command::Pendant(args) => pendant::run(args),
        Command::Scan(args) => scan::run(args),
        Command::Score(args) => score::run(args),
        Command::Completions(args) => completions::run(args),
        Command::Schema(args) => schema::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {}", failure.message);
            if let Some(hint) = &failure.hint {
                eprintln!("  hint: {hint}");
            }
            ExitCode::from(failure.exit as u8)
        }
    }
}

/// What a script learns from a failure; documented in `docs/formats.md`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Exit {
    Usage = 2,
    NoSeam = 3,
    Input = 4,
    Output = 5,
    Pendant = 6,
    Unfinished = 7,
}

/// Why a command did not do its work.
#[derive(Debug)]
struct Failure {
    exit: Exit,
    message: String,
    hint: Option<String>,
}

impl Failure {
    fn new(exit: Exit, message: impl ToString) -> Self {
        Self { exit, message: message.to_string(), hint: None }
    }

    fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }
}

/// A whole number of the command line.
fn whole<T: std::str::FromStr>(text: &str) -> Result<T, String> {
    text.trim().parse().map_err(|_| format!("{text:?} is not a whole number that fits here, as in 3"))
}

/// Prints a result. A reader that has gone away (`| head`) has seen what it wanted.
fn print(result: &str) -> Result<(), Failure> {
    match std::io::stdout().write_all(result.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::new(Exit::Output, error))
        }
        _ => Ok(()),
    }
}
