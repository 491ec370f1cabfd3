//! `weldpath refit`: a saved program on a part that has moved.

use std::path::{Path, PathBuf};

use weldpath::files::File;
use weldpath::files::reading;
use weldpath::input;
use weldpath::output::frame::PathFrame;
use weldpath::output::verdict::{ReasonId, State};
use weldpath::output::{json, ply};
use weldpath::robot::dialect::ProgramSetup;
use weldpath::run::job::Job;
use weldpath::run::postprocessing::program_files;
use weldpath::run::refit;
use weldpath::run::refit::Refit;
use weldpath::weld::program::Waypoint;

use super::folder::{Folder, FolderArgs, settle};
use super::{Exit, Failure, print};

/// Move a saved program to where the part is in a new scan
///
/// Lays the saved model over the new scan, and moves the program with it. The part is looked for within 50 mm and 20
/// degrees of where it was; if it is not found there, or the scan leaves a direction unknown, nothing is written.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder that `weldpath plan` wrote
    saved: PathBuf,
    /// New scan of the part: folder with scan.json, or one cloud
    scan: PathBuf,
    /// Folder for the results; files there are replaced all at once or not at all
    #[arg(long, value_name = "DIR", default_value = "refitted")]
    out: PathBuf,
    #[command(flatten)]
    folder: FolderArgs,
    /// Unit of the new scan, if the file does not state it [default: auto]
    #[arg(long)]
    units: Option<input::Units>,
    /// Allow scan.json to refer to files outside its folder
    #[arg(long)]
    allow_outside: bool,
    /// Write the program even if the scan leaves a direction unknown; the smallest motion is taken along it
    #[arg(long)]
    accept_unknown: bool,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    settle(&args.saved)?;
    let saved = read(&args.saved)?;
    let folder = Folder::new(&args.out, args.folder, args.quiet);
    folder.check(&["path.csv", "path.json", "model.ply", "job.toml", "refit.json"])?;
    let options = input::Options {
        units: args.units.unwrap_or_default(),
        allow_outside: args.allow_outside,
        ..input::Options::default()
    };
    let scan = input::read(&args.scan, &options).map_err(|error| Failure::new(Exit::Input, error))?;
    let frame = PathFrame::from(scan.frame);
    hold_frame(frame, &saved.job)?;
    let new = refit::cloud(&scan.views);
    let fit = refit::refit(&saved.program, &saved.model, &new).map_err(|error| {
        Failure::new(Exit::NoSeam, error).hint("plan the new scan with `weldpath plan` instead")
    })?;
    if let Some(warning) = fit
        .warnings
        .iter()
        .find(|warning| fit.unknown && !args.accept_unknown && warning.starts_with("UNKNOWN"))
    {
        return Err(Failure::new(Exit::NoSeam, warning)
            .hint("scan the ends of the part, too; or check the place, and say --accept-unknown"));
    }
    let program = refit::moved(&saved.program, &fit.new_from_old);
    let (verdict, posture) = refit::checked(&program, &new, &saved.job);
    if verdict.state == State::Refused {
        let why = format!("the program cannot be run where the part is now: {}", verdict.lines().join("; "));
        return Err(Failure::new(Exit::Refused, why)
            .hint("docs/troubleshooting.md says what to do about each reason; nothing was written"));
    }
    let remarks = [refitted(&args.saved)].into_iter().chain(verdict.lines()).collect();
    let setup = ProgramSetup { remarks, posture, ..saved.job.program_setup() };
    let mut files = program_files(&program, frame, &saved.job, &setup).map_err(super::plan::too_long)?;
    files.push(File::new("model.ply", ply::write(&new, frame)));
    files.push(File::new("job.toml", saved.job.to_toml()));
    files.push(File::new("refit.json", summary(&fit)));
    folder.write(&files)?;
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    let said = verdict.lines().join("\n") + "\n";
    let text =
        said + &told(&fit, &scan.warnings) + &format!("{}: {}\n", args.out.display(), names.join(", "));
    if args.quiet { Ok(()) } else { print(&text) }
}

/// A program for a robot needs a scan that says where the robot is.
fn hold_frame(frame: PathFrame, job: &Job) -> Result<(), Failure> {
    if frame != PathFrame::Camera || job.dialects().is_empty() || job.accept.contains(&ReasonId::CameraFrame)
    {
        return Ok(());
    }
    let message = "the new scan is in the camera's frame, and the robot's position in it is unknown: no program is written";
    Err(Failure::new(Exit::Refused, message).hint("give a scan.json with poses"))
}

/// What was found of the seams is the saved plan's; torch and arm are checked anew.
fn refitted(saved: &Path) -> String {
    let folder =
        saved.file_name().map_or_else(|| saved.display().to_string(), |name| name.to_string_lossy().into());
    format!("refitted from {folder}: its summary.json still describes the seams")
}

struct Saved {
    program: Vec<Waypoint>,
    model: weldpath::geometry::cloud::PointCloud,
    job: Job,
}

fn read(folder: &Path) -> Result<Saved, Failure> {
    let cannot = |file: &Path, why: String| {
        Failure::new(Exit::Input, format!("cannot read {}: {why}", file.display()))
            .hint("give the folder that `weldpath plan` wrote, with path.json, model.ply and job.toml")
    };
    let path = folder.join("path.json");
    let text =
        reading::text(&path, reading::MOST_RESULT).map_err(|error| cannot(&path, error.to_string()))?;
    let (program, _) = json::read(&text).map_err(|error| cannot(&path, error.to_string()))?;
    let path = folder.join("model.ply");
    let bytes =
        reading::bytes(&path, reading::MOST_RESULT).map_err(|error| cannot(&path, error.to_string()))?;
    let model = ply::read(&bytes).map_err(|error| cannot(&path, error.to_string()))?;
    let path = folder.join("job.toml");
    let job = Job::read(&path).map_err(|error| Failure::new(Exit::Input, &error).hint(error.hint()))?;
    Ok(Saved { program, model, job })
}

fn summary(fit: &Refit) -> String {
    let rows: Vec<Vec<f64>> =
        fit.new_from_old.to_homogeneous().row_iter().map(|row| row.iter().copied().collect()).collect();
    let text = serde_json::json!({
        "format": "weldpath-refit",
        "version": 1,
        "new_from_old": rows,
        "found": fit.found,
        "rms_mm": fit.rms_mm,
        "moved_mm": fit.moved_mm,
        "turned_deg": fit.turned_deg,
        "warnings": fit.warnings,
    });
    format!("{text:#}\n")
}

fn told(fit: &Refit, scan_warnings: &[String]) -> String {
    let mut text = format!(
        "the part moved by {:.1} mm and {:.2} deg; {:.0} % of the saved model around the welds matches the new scan, {:.2} mm RMS\n",
        fit.moved_mm,
        fit.turned_deg,
        100.0 * fit.found,
        fit.rms_mm
    );
    for warning in scan_warnings.iter().chain(&fit.warnings) {
        text.push_str(&format!("warning: {warning}\n"));
    }
    text
}
