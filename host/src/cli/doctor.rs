//! `weldpath doctor`: what this machine has of what weldpath can use, and whether a small plan comes out right.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use weldpath::evaluation::{self, PathSet, Truth};
use weldpath::input;
use weldpath::output::csv;
use weldpath::output::frame::PathFrame;
use weldpath::pendant::{emulator, serial};
use weldpath::pipeline;
use weldpath::simulation::{self, Part, Request};

use super::{Exit, Failure, print};

/// The trial's path may lie this far from its seam, mm (root mean square): the floor of the committed scans in `fixtures/`
/// is 0.2 mm at twice the trial's resolution.
const MOST_TRIAL_RMSE_MM: f64 = 0.4;
/// The trial's path covers at least this share of its seam.
const LEAST_TRIAL_COVERAGE: f64 = 0.9;

/// Browsers that open report.html, by the names of their programs.
const BROWSERS: [&str; 7] =
    ["xdg-open", "firefox", "firefox-esr", "chromium", "chromium-browser", "google-chrome", "open"];

/// Show versions, readers, ports, QEMU and browser, and try a small plan
#[derive(Debug, clap::Args)]
pub(super) struct Args {}

pub(super) fn run(_: &Args) -> Result<(), Failure> {
    print(&table(&[
        (
            "weldpath",
            format!("{} for {}-{}", env!("CARGO_PKG_VERSION"), std::env::consts::ARCH, std::env::consts::OS),
        ),
        ("machine", machine()),
        ("readers", readers()),
        ("ports", ports()),
        ("QEMU", qemu()),
        ("firmware", firmware()),
        ("browser", browser()),
    ]))?;
    let begun = Instant::now();
    match trial() {
        Ok(found) => {
            print(&table(&[("trial", format!("{found}, in {:.2} s", begun.elapsed().as_secs_f64()))]))
        }
        Err(reason) => Err(Failure::new(Exit::NoSeam, format!("the trial failed: {reason}"))
            .hint("the simulated fillet should always be found: this build or machine is faulty")),
    }
}

fn table(rows: &[(&str, String)]) -> String {
    rows.iter().map(|(name, words)| format!("{name:<9} {words}\n")).collect()
}

fn machine() -> String {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let megabytes = input::memory::Limit::default().mb();
    format!("{threads} threads, at most {megabytes} MB of memory for a plan (--memory-mb)")
}

/// Readers are chosen when the program is built.
fn readers() -> String {
    let optional = [
        ("PLY", cfg!(feature = "ply")),
        ("PCD", cfg!(feature = "pcd")),
        ("E57", cfg!(feature = "e57")),
        ("LAS", cfg!(feature = "las")),
    ];
    let named = |there: bool| -> Vec<&str> {
        optional.iter().filter(|(_, built)| *built == there).map(|(name, _)| *name).collect()
    };
    let built = format!("depth images, text, STL, OBJ, VTK, .npy, {}", named(true).join(", "));
    match named(false).as_slice() {
        [] => built,
        left => format!("{built}; {} left out of this build (--features e57,las)", left.join(", ")),
    }
}

fn ports() -> String {
    match serial::ports() {
        Ok(ports) if ports.is_empty() => "no serial port: no pendant is plugged in".into(),
        Ok(ports) => ports.join(", "),
        Err(error) => error.to_string(),
    }
}

fn qemu() -> String {
    let version = Command::new("qemu-system-arm").arg("--version").output().ok();
    let line = version
        .filter(|answer| answer.status.success())
        .and_then(|answer| Some(String::from_utf8_lossy(&answer.stdout).lines().next()?.to_owned()));
    line.unwrap_or_else(|| {
        format!("not installed, needed by --sim only; {}", emulator::Error::NoEmulator.hint())
    })
}

fn firmware() -> String {
    match emulator::firmware(None) {
        Ok(path) => path.display().to_string(),
        Err(error) => format!("{error}, needed by --sim only; {}", error.hint()),
    }
}

fn browser() -> String {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> = std::env::split_paths(&folders).collect();
    let there = |name: &str| folders.iter().any(|folder| folder.join(name).is_file());
    BROWSERS.into_iter().find(|name| there(name)).map_or_else(
        || "none found here; report.html opens in any".into(),
        |name| format!("{name}, for report.html"),
    )
}

/// Simulates a fillet, writes, reads and plans it, and holds the path against the truth.
fn trial() -> Result<String, String> {
    let said = |error: &dyn std::fmt::Display| error.to_string();
    let folder = tempfile::tempdir().map_err(|e| said(&e))?;
    let scan = simulation::simulate(&Request { width: 320, height: 240, ..Request::new(Part::Fillet, 1) })
        .map_err(|e| said(&e))?;
    simulation::write(&scan, folder.path()).map_err(|e| said(&e))?;
    let read = input::read(folder.path(), &input::Options::default()).map_err(|e| said(&e))?;
    let plan = pipeline::plan(&read.views, &pipeline::Config::default(), &mut ()).map_err(|e| said(&e))?;
    let file = folder.path().join("truth.json");
    let bytes = std::fs::read(&file).map_err(|e| said(&e))?;
    let truth = Truth::parse(&bytes, &file).map_err(|e| said(&e))?;
    let paths = PathSet::parse(csv::write(&plan.paths, PathFrame::Base).as_bytes(), Path::new("path.csv"))
        .map_err(|e| said(&e))?;
    let score = evaluation::score(&paths, &truth, &evaluation::Options::default());
    let rmse_mm = score.rmse_mm.unwrap_or(f64::INFINITY);
    let found = format!(
        "a simulated fillet, {} points, {rmse_mm:.2} mm off its truth, {:.0} % covered",
        score.points,
        100.0 * score.coverage
    );
    if rmse_mm <= MOST_TRIAL_RMSE_MM && score.coverage >= LEAST_TRIAL_COVERAGE && score.false_share == 0.0 {
        Ok(found)
    } else {
        Err(found)
    }
}
