//! `weldpath calibrate`: hand-eye transform and camera of a cell, from scans.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use weldpath::files::File;
use weldpath::input::{self, CloudFrame};
use weldpath::pipeline::calibration::{self, Calibrating};
use weldpath::pipeline::{Calibration, CellAccuracy};
use weldpath::run::job::calibration::CalibrationSettings;
use weldpath::run::job::quantity::{HandEyeDeg, HandEyeMm, RobotDeg, RobotMm};
use weldpath::run::job::scan::ScanSettings;

use super::folder::{Folder, FolderArgs};
use super::{Exit, Failure, print};

/// Find the hand-eye transform and the camera's errors from scans of a cell
///
/// SCAN is a folder with scan.json; the work may be anything with faces in three directions. Several scans are better than one,
/// above all from different distances and with the camera turned about its own axis. What they do not constrain is listed.
/// `weldpath plan --calibration` uses the file.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folders with scan.json
    #[arg(required = true, value_name = "SCAN")]
    scans: Vec<PathBuf>,
    /// File to write
    #[arg(long, value_name = "FILE", default_value = "calibration.toml")]
    out: PathBuf,
    #[command(flatten)]
    folder: FolderArgs,
    /// One standard deviation of a position that the robot reports, each axis [default: 0.3]
    #[arg(long, value_name = "MM")]
    robot_mm: Option<RobotMm>,
    /// The same of its orientation [default: 0.05]
    #[arg(long, value_name = "DEG")]
    robot_deg: Option<RobotDeg>,
    /// One standard deviation of the camera's position on the flange, each axis [default: 3]
    #[arg(long, value_name = "MM")]
    hand_eye_mm: Option<HandEyeMm>,
    /// The same of its orientation [default: 1]
    #[arg(long, value_name = "DEG")]
    hand_eye_deg: Option<HandEyeDeg>,
    /// Allow scan.json to refer to files outside its folder
    #[arg(long)]
    allow_outside: bool,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let usual = ScanSettings::default();
    let stated = ScanSettings {
        robot_mm: args.robot_mm.unwrap_or(usual.robot_mm),
        robot_deg: args.robot_deg.unwrap_or(usual.robot_deg),
        hand_eye_mm: args.hand_eye_mm.unwrap_or(usual.hand_eye_mm),
        hand_eye_deg: args.hand_eye_deg.unwrap_or(usual.hand_eye_deg),
        ..usual
    };
    let cell = stated.cell();
    let name = args.out.file_name().and_then(|name| name.to_str());
    let Some(name) = name else {
        return Err(Failure::new(Exit::Usage, format!("--out {} names no file", args.out.display())));
    };
    let parent = args.out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Whatever else lies there is no older calibration's.
    let folder = Folder::new(parent, args.folder, true);
    folder.check(&[name])?;
    let (mut known, mut text): (Option<Calibration>, String) = (None, String::new());
    for path in &args.scans {
        let (calibration, scan) = one(args, path, known.as_ref(), cell)?;
        text += &row(path, &scan);
        known = Some(calibration);
    }
    let Some(calibration) = known else { return Ok(()) };
    let file = CalibrationSettings::from(&calibration).to_toml();
    folder.write(&[File::new(name, file)])?;
    text += &words(&calibration, cell);
    let _ = writeln!(text, "{}: use it with `weldpath plan --calibration`", args.out.display());
    if args.quiet { Ok(()) } else { print(&text) }
}

/// What one scan tells after those before it.
fn one(
    args: &Args,
    path: &Path,
    known: Option<&Calibration>,
    cell: CellAccuracy,
) -> Result<(Calibration, Calibrating), Failure> {
    let options = input::Options { allow_outside: args.allow_outside, ..input::Options::default() };
    let scan = input::read(path, &options).map_err(|error| Failure::new(Exit::Input, error))?;
    let named = |why: &dyn std::fmt::Display| Failure::new(Exit::Input, format!("{}: {why}", path.display()));
    let hint = "calibrate from folders with scan.json, each with at least three views that see the same \
                faces from different directions; docs/scan.md says how";
    if scan.frame != CloudFrame::Base {
        return Err(named(&calibration::Error::NoPoses).hint(hint));
    }
    calibration::calibrate(&scan.views, known, cell).map_err(|error| {
        named(&error).hint(match error {
            calibration::Error::Scattered { .. } => {
                "state how exact the robot is with --robot-mm and --robot-deg, or look for the view whose pose is wrong"
            }
            calibration::Error::BeyondRepair => "docs/scan.md says which transform and which pose are meant",
            _ => hint,
        })
    })
}

fn row(path: &Path, scan: &Calibrating) -> String {
    let [fit, views] = scan.views;
    format!(
        "{}: {fit} of {views} views, surfaces {:.3} mm apart, poses scatter by {:.2} mm and {:.3} deg\n",
        path.display(),
        scan.residual_mm,
        scan.robot_mm,
        scan.robot_deg
    )
}

/// The result with its standard deviations, and what is loose.
fn words(found: &Calibration, cell: CellAccuracy) -> String {
    let sigma = found.sigma();
    let motion = &found.camera_from_corrected;
    let (shift, turn) = (motion.translation.vector, motion.rotation.scaled_axis() * 1f64.to_degrees());
    let camera = &found.camera;
    let mut text = String::new();
    let mut line = |name: &str, values: &[f64], sigmas: &[f64], factor: f64, decimals: usize, unit: &str| {
        let pairs: Vec<String> = values
            .iter()
            .zip(sigmas)
            .map(|(value, sigma)| format!("{:+.decimals$} +- {:.decimals$}", factor * value, factor * sigma))
            .collect();
        let _ = writeln!(text, "{name:<38} {} {unit}", pairs.join(", "));
    };
    line("hand-eye shift x, y, z of the camera", shift.as_slice(), &sigma[3..6], 1.0, 2, "mm");
    let turn_sigma: Vec<f64> = sigma[0..3].iter().map(|s| s.to_degrees()).collect();
    line("hand-eye turn about x, y, z", turn.as_slice(), &turn_sigma, 1.0, 3, "deg");
    line("depths too large by", &[camera.depth_scale], &sigma[6..7], 100.0, 2, "%");
    line("focal length larger than stated by", &[camera.focal], &sigma[7..8], 100.0, 2, "%");
    line(
        "optical axis off by columns, rows",
        &camera.centre,
        &sigma[8..10],
        1e3,
        2,
        "thousandths of a focal length",
    );
    line("k1 beyond the stated", &[camera.k1], &sigma[10..11], 1.0, 4, "");
    let loose = calibration::loose(found, cell);
    let mut remedies: Vec<&str> = loose.iter().map(|loose| loose.remedy()).collect();
    remedies.dedup();
    for remedy in remedies {
        let _ = writeln!(text, "warning: the scans hardly constrain {remedy}");
    }
    text
}
