//! `weldpath open`: a job and its scan in the browser.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use weldpath::files::manifest;
use weldpath::input;
use weldpath::run::job::Job;
use weldpath::run::planning::Allowed;
use weldpath::server::{self, Choice, Start, Workplace};
use weldpath::simulation::{self, Part};

use super::folder::{Folder, FolderArgs};
use super::{Exit, Failure, plan, simulate, tell, whole};

/// Plan in the browser: view, select, correct and plan again
///
/// INPUT is what `weldpath plan` takes, the folder of an earlier run, or a job file. The scan is planned, and its report
/// opened as a page in which the job is edited: which seams, in which order and direction, and how each is welded. What is
/// edited is saved in job.toml with the next plan. The page is on 127.0.0.1 alone, and its address holds a secret word; the
/// command ends with Ctrl-C, or a minute after the last page is closed. Without INPUT the page asks for a folder, or simulates an
/// example.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder with scan.json, one cloud or mesh, a folder with results, or a job file
    input: Option<PathBuf>,
    /// Folder for the results; files there are replaced all at once or not at all [default: out, or the folder of results]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    folder: FolderArgs,
    /// Allow scan.json to refer to files outside its folder
    #[arg(long)]
    allow_outside: bool,
    /// Refuse inputs that need more memory than this [default: half of the machine's]
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(input::memory::LEAST_MB..))]
    memory_mb: Option<u64>,
    /// Neither use nor write the cache of detected seams in DIR
    #[arg(long)]
    no_cache: bool,
    /// Only print the address
    #[arg(long)]
    no_browser: bool,
    /// Serve the page at this port of 127.0.0.1, for instance to forward it through SSH [default: any that is free]
    #[arg(long, value_name = "N", value_parser = whole::<u16>)]
    port: Option<u16>,
}

/// Where the results go, if neither the command line nor the input says.
const OUT: &str = "out";
/// Where the example of the start page goes.
const EXAMPLE: &str = "weldpath-example";
/// The job of a folder of results.
const JOB: &str = "job.toml";

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let allowed = Allowed::new(args.allow_outside, args.memory_mb);
    let how = How { folder: args.folder, allowed, keeps: !args.no_cache };
    let announce = |address: &str, ticket: &str| announce(address, (!args.no_browser).then_some(ticket));
    let port = args.port.unwrap_or(0);
    let served = match &args.input {
        Some(input) => {
            let (job, workplace) = how.opened(input, args.out.as_deref())?;
            server::open(job, workplace, port, announce)
        }
        None => server::choose(start(how, args.out.as_deref())?, port, announce),
    };
    served.map_err(|error| {
        let taken = error.kind() == ErrorKind::AddrInUse;
        let failure = Failure::new(Exit::Output, format!("the page cannot be served: {error}"));
        if taken {
            failure.hint("another program has that port: take another --port, or none")
        } else {
            failure
        }
    })
}

/// The start page: it reads and writes what is typed on it, the folder of the example, and that of the results.
fn start(how: How, out: Option<&Path>) -> Result<Start, Failure> {
    let absolute = |path: &Path| std::path::absolute(path).map_err(|error| Failure::new(Exit::Output, error));
    let (usual, example) = (absolute(out.unwrap_or(Path::new(OUT)))?, absolute(Path::new(EXAMPLE))?);
    let (given, folder) = (out.map(Path::to_path_buf), example.clone());
    let example_job = folder.join(simulate::JOB);
    let choose = move |choice: &Choice| {
        let (input, out) = match choice {
            Choice::Input { input, out } => (Ok(input), out),
            Choice::Example { out } => (simulate_example(&folder, how.folder).map(|()| &example_job), out),
        };
        let out = out.as_deref().or(given.as_deref());
        let opened = input.and_then(|input| how.opened(input, out));
        opened.map_err(|Failure { message, hint, .. }| match hint {
            Some(hint) => format!("{message}: {hint}"),
            None => message,
        })
    };
    Ok(Start::new(usual, example, Arc::new(choose)))
}

/// A scan of two crossed plates on a third.
fn simulate_example(folder: &Path, args: FolderArgs) -> Result<(), Failure> {
    simulate::keep_real_scans(folder)?;
    let failure = |error: simulation::Error| Failure::new(Exit::Output, error);
    let scan = simulation::simulate(&simulation::Request::new(Part::Cruciform, 1)).map_err(failure)?;
    let mut files = simulation::files(&scan).map_err(failure)?;
    files.push(simulate::job(None));
    Folder::new(folder, args, true).write(&files)
}

/// How whatever is opened is read and written.
#[derive(Debug, Clone, Copy)]
struct How {
    folder: FolderArgs,
    allowed: Allowed,
    keeps: bool,
}

impl How {
    /// The job of an input, and where its results go.
    fn opened(self, named: &Path, out: Option<&Path>) -> Result<(Job, Workplace), Failure> {
        let given = job_file(named);
        let mut job = match &given {
            Some(path) => {
                Job::read(path).map_err(|error| Failure::new(Exit::Usage, &error).hint(error.hint()))?
            }
            None => Job::default(),
        };
        let named_input = named.to_path_buf();
        let input = if given.is_some() { None } else { Some(&named_input) };
        job.input = Some(plan::input(input, &job)?);
        let results = is_results(named).then_some(named);
        let out = out.or(results).unwrap_or(Path::new(OUT));
        Folder::new(out, self.folder, false).given(given.as_deref()).check(plan::CERTAIN)?;
        let out = std::path::absolute(out).map_err(|error| Failure::new(Exit::Output, error))?;
        let How { allowed, keeps, .. } = self;
        let workplace = Workplace { out, given, overwrite: self.folder.overwrite(), allowed, keeps };
        Ok((job, workplace))
    }
}

/// Whether a run has left its files here.
fn is_results(folder: &Path) -> bool {
    folder.join(manifest::NAME).is_file() && folder.join(JOB).is_file()
}

/// The job file that is given, alone or in a folder of results.
fn job_file(input: &Path) -> Option<PathBuf> {
    if is_results(input) {
        return Some(input.join(JOB));
    }
    let is_job = input.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    is_job.then(|| input.to_path_buf())
}

/// Says where the page is, and opens it unless it shall not be.
fn announce(address: &str, ticket: Option<&str>) {
    // Where nobody can be told, the browser may be; and the other way round.
    let _ = writeln!(std::io::stdout(), "{address}");
    let _ = std::io::stdout().flush();
    tell("Ctrl-C ends it, and so does the last page a minute after it is closed");
    if let Some(ticket) = ticket
        && let Err(error) = browse(ticket)
    {
        tell(&format!("warning: no browser could be started ({error}): open the address above"));
    }
}

/// Hands an address to the browser of this machine.
fn browse(address: &str) -> std::io::Result<()> {
    let program = if cfg!(target_os = "macos") { "open" } else { "xdg-open" };
    let mut browser = Command::new(program);
    browser.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut browser = browser.spawn()?;
    // Somebody has to wait for it, or it stays in the table of processes.
    std::thread::Builder::new().name("browser".into()).spawn(move || browser.wait()).map(drop)
}
