//! The command line: subcommands, exit codes, and how a failure is told. No part of the library's promise.

mod calibrate;
mod completions;
mod doctor;
mod evaluate;
mod folder;
mod help;
mod keys;
mod monitor;
#[cfg(feature = "open")]
mod open;
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
mod threads;
mod warnings;
mod weld;

use std::ffi::OsString;
use std::io::Write;

use clap::{Parser, Subcommand};
use weldpath::files::interrupt;

const EXIT_CODES: &str = "Exit codes: 0 done; 2 wrong usage or job file; 3 no seam found; 4 input cannot be read; \
                          5 output cannot be written; 6 no pendant, or the link was lost; 7 the pendant did not finish; \
                          8 the plan is refused: no program is written.";

/// From scans of a workpiece to the motion of a welding torch.
#[derive(Debug, Parser)]
#[command(name = "weldpath", version, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Plan(Box<plan::Args>),
    #[cfg(feature = "open")]
    Open(open::Args),
    Calibrate(calibrate::Args),
    Simulate(Box<simulate::Args>),
    Refit(refit::Args),
    Evaluate(evaluate::Args),
    Stream(stream::Args),
    Monitor(monitor::Args),
    Pendant(pendant::Args),
    Scan(scan::Args),
    Score(score::Args),
    Doctor(doctor::Args),
    Completions(completions::Args),
    Schema(schema::Args),
}

/// Does what a command line says, and returns the exit code; its first word is the name of the program.
pub fn start(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let threads = threads::prepare();
    // Without handlers a signal ends the run at once, and the next run settles what was being written.
    let _ = interrupt::arm();
    match help::parse(&arguments) {
        Ok(cli) => end(if threads { run(&cli.command) } else { run_alone(&cli.command) }),
        Err(exit) => exit,
    }
}

/// A link to a pendant is read and driven at the same time; all else is done by one thread where there are no more.
fn run_alone(command: &Command) -> Result<(), Failure> {
    match command {
        #[cfg(feature = "open")]
        Command::Open(_) => Err(Failure::new(
            Exit::Output,
            "the system grants this program no threads, and a page needs one beside the plan",
        )
        .hint("raise the limit of processes: `ulimit -u` shows it; `weldpath plan` does without")),
        Command::Stream(_)
        | Command::Monitor(_)
        | Command::Pendant(_)
        | Command::Scan(_)
        | Command::Score(_) => Err(Failure::new(
            Exit::Pendant,
            "the system grants this program no threads, and a link needs some",
        )
        .hint("raise the limit of processes: `ulimit -u` shows it")),
        _ => run(command),
    }
}

fn run(command: &Command) -> Result<(), Failure> {
    match command {
        Command::Plan(args) => plan::run(args),
        #[cfg(feature = "open")]
        Command::Open(args) => open::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Refit(args) => refit::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Stream(args) => stream::run(args),
        Command::Monitor(args) => monitor::run(args),
        Command::Pendant(args) => pendant::run(args),
        Command::Scan(args) => scan::run(args),
        Command::Score(args) => score::run(args),
        Command::Doctor(args) => doctor::run(args),
        Command::Completions(args) => completions::run(args),
        Command::Schema(args) => schema::run(args),
    }
}

/// The exit code; a failure is told in words on standard error.
fn end(result: Result<(), Failure>) -> u8 {
    match result {
        Ok(()) => 0,
        Err(failure) => {
            tell(&format!("error: {}", failure.message));
            if let Some(hint) = &failure.hint {
                tell(&format!("  hint: {hint}"));
            }
            failure.exit as u8
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
    Refused = 8,
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

/// A line on standard error. Where nobody can be told, nobody is: the exit code says it all the same.
fn tell(line: &str) {
    let _ = writeln!(std::io::stderr(), "{}", shown(line));
}

/// Without what a terminal would take for a command: a name may hold anything.
fn shown(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\n' | '\t' => shown.push(c),
            c if c.is_control() => shown.extend(c.escape_default()),
            c => shown.push(c),
        }
    }
    shown
}

/// Prints a result. A reader that has gone away (`| head`) has seen what it wanted.
fn print(result: &str) -> Result<(), Failure> {
    match std::io::stdout().write_all(shown(result).as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::new(Exit::Output, error))
        }
        _ => Ok(()),
    }
}
