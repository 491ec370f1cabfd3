//! `weldpath plan`: one cloud or scan in, the seams' paths and a robot program out.

use std::path::{Path, PathBuf};

use weldpath::files::{File, reading};
use weldpath::input;
use weldpath::output::summary::Source;
use weldpath::output::verdict::{Reason, ReasonId, State};
use weldpath::pipeline::{self, Method, Observer};
use weldpath::report;
use weldpath::robot::dialect::Dialect;
use weldpath::robot::dialect::moves::TooLong;
use weldpath::run::job::ask::{AskSettings, DrawSettings};
use weldpath::run::job::calibration::CalibrationSettings;
use weldpath::run::job::quantity::{
    self, ApproachMm, DepthScaleM, FeedMmS, OverlapMm, Place, Points, RatioThreshold, Region, SpacingMm,
    StandoffMm,
};
use weldpath::run::job::resume::ResumeSettings;
use weldpath::run::job::robot::{RobotSettings, TorchBodySettings};
use weldpath::run::job::scan::AnchorName;
use weldpath::run::job::touch::TouchSettings;
use weldpath::run::job::{Job, Sequence};
use weldpath::run::planning::{self, Allowed, Kept};
use weldpath::run::postprocessing;
use weldpath::run::postprocessing::{Output, postprocess_observed};
use weldpath::run::selection;

use super::folder::{Folder, FolderArgs};
use super::progress::Progress;
use super::weld::WeldArgs;
use super::{Exit, Failure, print, table, tell, whole};

/// Plan the torch paths of all seams in a scan
///
/// INPUT is a folder with scan.json (depth images or clouds with robot poses), or one cloud or mesh: PLY, PCD, XYZ,
/// CSV, STL, OBJ, VTK, .npy. No option is needed: what depends on the data is derived from it (--verbose prints it).
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder with scan.json, or one cloud or mesh
    #[arg(required_unless_present = "job")]
    input: Option<PathBuf>,
    /// Folder for the results; files there are replaced all at once or not at all
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    #[command(flatten)]
    folder: FolderArgs,
    /// Settings from a file, as every run writes one to DIR/job.toml; options override it
    #[arg(long, value_name = "FILE")]
    job: Option<PathBuf>,
    /// Unit of the input, if the file does not state it [default: auto]
    #[arg(long)]
    units: Option<input::Units>,
    /// Camera intrinsics in px and distortion (OpenCV order), for depth images without scan.json
    #[arg(long, value_name = "FX,FY,CX,CY[,K1,K2,P1,P2,K3]", allow_hyphen_values = true)]
    intrinsics: Option<input::Intrinsics>,
    /// Metres per count, for depth images without scan.json [default: 0.001]
    #[arg(long, value_name = "M")]
    depth_scale_m: Option<DepthScaleM>,
    /// Camera position of a cloud that stores none: mm, in the cloud's own frame
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    camera: Option<input::CameraPosition>,
    /// Frame of a cloud's coordinates, if the file does not state it
    #[arg(long)]
    frame: Option<input::StatedFrame>,
    /// Treat a mesh as exact CAD or as a scan, if its data do not show which it is
    #[arg(long = "as", value_name = "KIND")]
    mesh_as: Option<input::MeshAs>,
    /// What ties the model to the robot's base frame: robot (all reported poses and the hand-eye transform), or first (the
    /// first view's pose, taken as exact) [default: robot]
    #[arg(long, value_name = "ANCHOR")]
    anchor: Option<AnchorName>,
    /// Hand-eye transform and camera corrections from `weldpath calibrate`
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Point on a seam that the robot touched with its tip: mm, base frame, and the seam's id if two are near. The plan is moved
    /// to it; repeatable
    #[arg(long, value_name = "X,Y,Z[,SEAM]", allow_hyphen_values = true)]
    touch: Vec<TouchSettings>,
    /// Touched points from a CSV file, one per line
    #[arg(long, value_name = "FILE", conflicts_with = "touch")]
    touches: Option<PathBuf>,
    /// Hold the tip this far off the seam, along the torch axis [default: 0]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    standoff_mm: Option<StandoffMm>,
    /// Spacing of the waypoints; corners and ends are always waypoints [default: 2]
    #[arg(long, value_name = "MM", conflicts_with = "points", allow_negative_numbers = true)]
    spacing_mm: Option<SpacingMm>,
    /// Waypoints of each seam, instead of a spacing
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    points: Option<Points>,
    /// Weld speed [default: 8]
    #[arg(long, value_name = "MM_S", allow_negative_numbers = true)]
    feed_mm_s: Option<FeedMmS>,
    /// Distance of approach and retract from the seam [default: 50]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    approach_mm: Option<ApproachMm>,
    #[command(flatten)]
    weld: WeldArgs,
    /// Confirm a reason of the verdict by its id; repeatable
    #[arg(long, value_name = "REASON-ID")]
    accept: Vec<ReasonId>,
    /// Resume an interrupted weld: write this seam (and pass) from this s_mm of path.csv on, and all that follows; use another
    /// --out
    #[arg(long, value_name = "SEAM[.PASS]:MM")]
    from: Option<ResumeSettings>,
    /// Overlap with what is already welded [default: 5]
    #[arg(long, value_name = "MM", requires = "from", allow_negative_numbers = true)]
    overlap_mm: Option<OverlapMm>,
    /// Order of the seams [default: shortest]
    #[arg(long, value_name = "SEQUENCE")]
    sequence: Option<Sequence>,
    /// Weld only this seam; repeatable
    #[arg(long, value_name = "ID", value_parser = whole::<usize>)]
    seam: Vec<usize>,
    /// Weld only the seam nearest to this point: mm, base frame
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    near: Option<Place>,
    /// Weld only seams with at least half of their length in this box: mm, base frame
    #[arg(long, value_name = "X,Y,Z..X,Y,Z", allow_hyphen_values = true)]
    roi: Option<Region>,
    /// Search no seam in this box: mm, base frame. The torch still keeps clear of its contents; repeatable
    #[arg(long, value_name = "X,Y,Z..X,Y,Z", allow_hyphen_values = true)]
    exclude: Vec<Region>,
    /// Scan of the empty cell or fixture (folder with scan.json, or one cloud in the same frame): no seam is searched on it
    #[arg(long, value_name = "SCAN")]
    background: Option<PathBuf>,
    /// Search a missed seam within 10 mm of these points: mm, base frame. Give both ends, and more points along a curve;
    /// repeatable
    #[arg(long, value_name = "X,Y,Z;X,Y,Z", allow_hyphen_values = true)]
    ask: Vec<AskSettings>,
    /// Weld a line on the surface where no seam is found, through these points: mm, base frame; repeatable
    #[arg(long, value_name = "X,Y,Z;X,Y,Z", allow_hyphen_values = true)]
    draw: Vec<DrawSettings>,
    /// Method of detection; the paper's is for comparison [default: weldpath]
    #[arg(long)]
    method: Option<Method>,
    /// Threshold of the paper's method, eq. (16) [default: 53]
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    t: Option<RatioThreshold>,
    /// Digital output that starts the arc [default: 0]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    arc_output: Option<quantity::Output>,
    /// Check reach, joint limits and singularities of this arm, such as ur5e or kuka-kr10-r1420 (list: docs/feasibility.md)
    #[arg(long, value_name = "NAME", value_parser = RobotSettings::named)]
    robot_model: Option<RobotSettings>,
    /// Pose of the robot's base in the scan's base frame: mm and a rotation vector in rad [default: identical]
    #[arg(long, value_name = "X,Y,Z,RX,RY,RZ", allow_hyphen_values = true)]
    robot_base: Option<String>,
    /// Torch dimensions for the collision check, such as stickout_mm=15,nozzle_radius_mm=10,neck_deg=22
    #[arg(long, value_name = "KEY=VALUE,...", value_parser = TorchBodySettings::from_pairs)]
    torch: Option<TorchBodySettings>,
    /// Write the program for this robot; repeatable [default: ur]
    #[arg(long, value_name = "ROBOT")]
    robot: Vec<Dialect>,
    /// Allow scan.json to refer to files outside its folder
    #[arg(long)]
    allow_outside: bool,
    /// Refuse inputs that need more memory than this [default: half of the machine's]
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(input::memory::LEAST_MB..))]
    memory_mb: Option<u64>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
    /// Print every reason, the measurements of each seam, the derived parameters, and how far each view was moved
    #[arg(long, short, conflicts_with_all = ["quiet", "json"])]
    verbose: bool,
    /// Print summary.json instead of the table
    #[arg(long, conflicts_with = "quiet")]
    json: bool,
    /// Save the cloud after every stage in DIR/stages
    #[arg(long)]
    dump_stages: bool,
    /// Skip report.html and report.svg
    #[arg(long)]
    no_report: bool,
    /// Neither use nor write the cache of detected seams in DIR
    #[arg(long)]
    no_cache: bool,
}

/// Files that every plan writes, whatever it finds.
pub(super) const CERTAIN: &[&str] = &["path.csv", "path.json", "model.ply", "summary.json"];

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let job = job(args)?;
    let folder = Folder::new(&args.out, args.folder, args.quiet).given(args.job.as_deref());
    folder.check(CERTAIN)?;
    let mut progress = Progress::new(args.quiet, args.dump_stages, !args.no_report);
    // The clouds after each stage are kept nowhere: the stages have to be gone through.
    let kept = if args.no_cache || args.dump_stages { Kept::default() } else { Kept::within(&args.out) };
    let allowed = Allowed::new(args.allow_outside, args.memory_mb);
    let result = planning::find(&job, allowed, &kept, &mut progress, Progress::take_recording);
    let is_kept = !progress.has_begun();
    let found = match result {
        Ok(found) => found,
        Err(error) => {
            let (stages, recording) = progress.finish();
            let seen = match (&error, recording) {
                (planning::Error::Plan { error, read }, Some(seen)) => {
                    report::without_seams(&seen, &job, error, Source::clone(read))
                }
                _ => Vec::new(),
            };
            return keep_seen(&folder, stages, seen).and(Err(not_found(error)));
        }
    };
    let (plan, source) = (&found.plan, planning::source(&found.scan, &job));
    let output = postprocess_observed(plan, &job, source.clone(), &mut progress);
    let report = |output: &Output| {
        let seen = found.seen.as_ref().filter(|_| !args.no_report)?;
        progress.stage("report");
        Some(report::files(plan, output, seen, &job))
    };
    let report = output.as_ref().ok().and_then(report);
    let (stages, _) = progress.finish();
    let mut output = output.map_err(not_written_out)?;
    output.files.extend(stages.into_iter().chain(report.into_iter().flatten()));
    folder.write(&output.files)?;
    kept.save();
    match (args.quiet, args.json) {
        (true, _) => {}
        (_, true) => print(&output.summary.to_json())?,
        _ => print(&table::result(plan, &output, &source, &args.out, args.verbose))?,
    }
    if is_kept && !args.quiet {
        tell("note: seams are from the cache of an earlier plan of this scan; --no-cache searches again");
    }
    refused(&output)
}

/// A plan that is refused is told on standard error, too: its programs are missing.
fn refused(output: &Output) -> Result<(), Failure> {
    let verdict = output.summary.verdict();
    if verdict.state != State::Refused {
        return Ok(());
    }
    let stands =
        verdict.reasons.iter().filter(|reason| !reason.accepted && reason.id.state() == State::Refused);
    let lines: Vec<String> = stands.map(Reason::line).collect();
    Err(Failure::new(Exit::Refused, format!("the plan is refused, no program is written: {}", lines.join("; ")))
        .hint("docs/troubleshooting.md says of each reason what to do; --accept REASON-ID where it is known to be harmless"))
}

/// The job file, if there is one, with the command line on top.
fn job(args: &Args) -> Result<Job, Failure> {
    let mut job = match &args.job {
        Some(path) => {
            Job::read(path).map_err(|error| Failure::new(Exit::Usage, &error).hint(error.hint()))?
        }
        None => Job::default(),
    };
    how_to_read(&mut job, args);
    replace(&mut job.scan.anchor, args.anchor);
    if let Some(path) = &args.calibration {
        let read = CalibrationSettings::read(path);
        job.scan.calibration =
            Some(read.map_err(|error| Failure::new(Exit::Usage, &error).hint(error.hint()))?);
    }
    touches(&mut job, args)?;
    replace(&mut job.method, args.method);
    if args.method == Some(Method::Weldpath) {
        job.ratio_threshold = None;
    }
    job.ratio_threshold = args.t.or(job.ratio_threshold);
    replace(&mut job.order.sequence, args.sequence);
    job.path.standoff_mm = args.standoff_mm.or(job.path.standoff_mm);
    job.path.feed_mm_s = args.feed_mm_s.or(job.path.feed_mm_s);
    job.path.approach_mm = args.approach_mm.or(job.path.approach_mm);
    args.weld.put_on(&mut job);
    args.weld.check(&job)?;
    replace(&mut job.arc.output, args.arc_output);
    job.selection.near_mm = args.near.or(job.selection.near_mm);
    job.selection.roi_mm = args.roi.or(job.selection.roi_mm);
    where_to_look(&mut job, args)?;
    if !args.robot.is_empty() {
        job.formats = Some(args.robot.clone());
    }
    if args.spacing_mm.is_some() || args.points.is_some() {
        (job.path.spacing_mm, job.path.points) = (args.spacing_mm, args.points);
    }
    job.torch_body = args.torch.or(job.torch_body);
    job.accept.extend(args.accept.iter().copied());
    job.accept.sort_unstable();
    job.accept.dedup();
    place_robot(&mut job, args)?;
    if let Some((key, why)) = job.unwritable() {
        return Err(Failure::new(Exit::Usage, format!("[robot] {key}: {why}"))
            .hint("change [robot] in the job file, or --robot: docs/programs.md, \"Frames and tools\""));
    }
    if let Some(from) = args.from {
        job.resume = Some(ResumeSettings { overlap_mm: args.overlap_mm.unwrap_or_default(), ..from });
    }
    job.input = Some(input(args.input.as_ref(), &job)?);
    exclusive(&job)?;
    Ok(job)
}

/// What the command line says of the input's units, camera and frame.
fn how_to_read(job: &mut Job, args: &Args) {
    replace(&mut job.units, args.units);
    job.intrinsics = args.intrinsics.or(job.intrinsics);
    job.depth_scale_m = args.depth_scale_m.or(job.depth_scale_m);
    job.camera_mm = args.camera.or(job.camera_mm);
    job.frame = args.frame.or(job.frame);
    job.mesh_as = args.mesh_as.or(job.mesh_as);
}

/// What it says of where seams are asked for, what is no work, and which seams are welded.
fn where_to_look(job: &mut Job, args: &Args) -> Result<(), Failure> {
    if !args.ask.is_empty() {
        job.asks.clone_from(&args.ask);
    }
    if !args.draw.is_empty() {
        job.draws.clone_from(&args.draw);
    }
    if !args.exclude.is_empty() {
        job.exclude.boxes_mm.clone_from(&args.exclude);
    }
    if let Some(background) = args.background.as_ref().or(job.exclude.background.as_ref()) {
        job.exclude.background = Some(absolute(background, "name the scan of the empty cell")?);
    }
    if let Some(id) =
        args.seam.iter().enumerate().find(|(at, id)| args.seam[..*at].contains(id)).map(|(_, id)| id)
    {
        return Err(
            Failure::new(Exit::Usage, format!("--seam {id} is given twice")).hint("name each seam once")
        );
    }
    if !args.seam.is_empty() {
        job.selection.seams.clone_from(&args.seam);
    }
    Ok(())
}

/// Settings that exclude each other.
fn exclusive(job: &Job) -> Result<(), Failure> {
    if !job.asks.is_empty() && job.method == Method::Paper {
        let failure = Failure::new(
            Exit::Usage,
            "the paper's method fits no faces, so it cannot search for a requested seam",
        );
        return Err(failure.hint("leave --method paper out, or --ask and [[ask]]"));
    }
    if !job.draws.is_empty() && job.method == Method::Paper {
        let failure = Failure::new(
            Exit::Usage,
            "the paper's method fits no faces, so it cannot fit a drawn line to them",
        );
        return Err(failure.hint("leave --method paper out, or --draw and [[draw]]"));
    }
    if let Some(id) = job.accept.iter().find(|id| !id.may_be_accepted()) {
        let failure = Failure::new(Exit::Usage, format!("{} cannot be accepted", id.name()));
        return Err(failure.hint("a person looks at what is drawn each time: the verdict stays at check"));
    }
    if job.ratio_threshold.is_some() && job.method == Method::Weldpath {
        let failure = Failure::new(Exit::Usage, "--t is the threshold of the paper's method only");
        return Err(
            failure.hint("add --method paper, or leave --t out: the threshold is found from the data")
        );
    }
    Ok(())
}

/// What the tip touched, in place of what the job file says.
fn touches(job: &mut Job, args: &Args) -> Result<(), Failure> {
    if !args.touch.is_empty() {
        job.touches.clone_from(&args.touch);
    }
    let Some(path) = &args.touches else { return Ok(()) };
    let unread = |why: String| Failure::new(Exit::Usage, why);
    let text = reading::text(path, reading::MOST_JOB)
        .map_err(|error| unread(format!("cannot read {}: {error}", path.display())))?;
    job.touches = TouchSettings::of_csv(&text, path).map_err(unread)?;
    Ok(())
}

/// The arm and its base from the command line; a named arm keeps the base of the job file.
fn place_robot(job: &mut Job, args: &Args) -> Result<(), Failure> {
    if let Some(named) = &args.robot_model {
        let robot = job.robot.get_or_insert_with(Default::default);
        // Another arm has another home.
        if robot.model != named.model || robot.opw.is_some() {
            (robot.home_deg, robot.end) = Default::default();
        }
        (robot.model, robot.opw) = (named.model.clone(), None);
    }
    let Some(base) = &args.robot_base else { return Ok(()) };
    let Some(robot) = &mut job.robot else {
        return Err(Failure::new(Exit::Usage, "--robot-base places a robot, and none is given")
            .hint("add --robot-model, or [robot] in a job file"));
    };
    robot.place(base).map_err(|why| Failure::new(Exit::Usage, format!("--robot-base: {why}")))
}

fn replace<T: Copy>(setting: &mut T, given: Option<T>) {
    *setting = given.unwrap_or(*setting);
}

/// Absolute, so that the written job replays from anywhere.
pub(super) fn input(given: Option<&PathBuf>, job: &Job) -> Result<PathBuf, Failure> {
    let hint = "name a folder with scan.json, or a cloud; `weldpath simulate --help` makes one to try";
    let path = given.or(job.input.as_ref());
    let path = path.ok_or_else(|| {
        Failure::new(Exit::Usage, "neither INPUT nor the job file says what to plan").hint(hint)
    })?;
    absolute(path, hint)
}

/// The same from any folder, and a text that job.toml can hold.
fn absolute(path: &Path, hint: &str) -> Result<PathBuf, Failure> {
    let missing =
        |error| Failure::new(Exit::Input, format!("cannot read {}: {error}", path.display())).hint(hint);
    let path = std::fs::canonicalize(path).map_err(missing)?;
    if path.to_str().is_none() {
        let message = format!(
            "cannot plan {}: its path is no text (UTF-8), so job.toml cannot name it",
            path.display()
        );
        return Err(Failure::new(Exit::Input, message).hint("rename it, or the folder that it is in"));
    }
    Ok(path)
}

fn not_found(error: planning::Error) -> Failure {
    match error {
        planning::Error::Input(error) => Failure::new(Exit::Input, error),
        planning::Error::Plan { error, .. } => not_planned(error),
    }
}

/// What led to no plan is what one wants to look at most.
fn keep_seen(folder: &Folder<'_>, mut stages: Vec<File>, seen: Vec<File>) -> Result<(), Failure> {
    stages.extend(seen);
    if stages.is_empty() { Ok(()) } else { folder.write(&stages) }
}

fn not_planned(error: pipeline::PlanError) -> Failure {
    if matches!(error, pipeline::PlanError::Touch(_)) {
        return Failure::new(Exit::Usage, error).hint(
            "check the tool that is set on the controller, the unit (mm) and the frame (base); name the seam as x,y,z,SEAM; plan without --touch to see the seams",
        );
    }
    Failure::new(Exit::NoSeam, error).hint(
        "DIR/report.html and DIR/summary.json show what was seen and rejected, --dump-stages keeps the cloud after every stage; docs/troubleshooting.md says what to try",
    )
}

fn not_written_out(error: postprocessing::Error) -> Failure {
    match error {
        postprocessing::Error::Selection(error) => not_selected(error),
        postprocessing::Error::TooLong(error) => too_long(error),
        postprocessing::Error::Resuming(error) => Failure::new(Exit::Usage, error)
            .hint("path.csv of the whole plan has its seams, passes and s_mm"),
        error @ postprocessing::Error::GivenUp => Failure::new(Exit::Unfinished, error),
        error @ postprocessing::Error::TooMany { .. } => Failure::new(Exit::Usage, error).hint(
            "a wider spacing_mm in [path], a longer wavelength_mm in [weave], fewer passes, or fewer seams at a time with --seam",
        ),
    }
}

pub(super) fn too_long(error: TooLong) -> Failure {
    Failure::new(Exit::Usage, error)
        .hint("plan with a wider --spacing-mm: a seam is not divided while the arc burns")
}

fn not_selected(error: selection::Error) -> Failure {
    let exit = match error {
        selection::Error::UnknownId { .. }
        | selection::Error::NothingNear { .. }
        | selection::Error::NoneLeft => Exit::Usage,
        selection::Error::OutsideRegion { .. } => Exit::NoSeam,
    };
    Failure::new(exit, error).hint("run once without --seam, --near and --roi to see all seams")
}
