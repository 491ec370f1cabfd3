//! `weldpath scan`: hands guide the simulated camera through the pendant, and capture views.

use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nalgebra::Isometry3;
use weldpath::files::File;
use weldpath::pendant::emulator::{Inputs, Panel};
use weldpath::pendant::link;
use weldpath::pendant::link::{Event, Link, cause_words};
use weldpath::pendant::teleop;
use weldpath::pendant::teleop::live::Live;
use weldpath::pendant::teleop::{Pace, REGIONS, Session, Setup, generator, recording};
use weldpath::run::job::quantity::Place;
use weldpath::run::job::robot::transform;
use weldpath::simulation;
use weldpath::simulation::{Noise, Part, Request};
use weldpath_core::interlock::Fault;
use weldpath_core::wire::{Telemetry, WireHandFrame};

use super::folder::{Folder, FolderArgs};
use super::port::{PortOrSim, lost, set_tool};
use super::simulate::keep_real_scans;
use super::{Exit, Failure, print, progress, whole};

/// Scan a simulated workpiece by hand gestures, played from recordings to the pendant
///
/// The steering hand moves the camera: outside the interaction box along one of six directions, inside it the camera
/// looks where the palm looks; a closed fist is the clutch, a lost hand stops the camera. The right hand's "ok", held
/// for 50 ms, captures a view. DIR is then a scan for `weldpath plan`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Recording: Leap Motion JSON, plain or LZ-String compressed, or CSV; several are joined in their order; - alone:
    /// live from standard input, JSON lines or CSV, until it ends
    #[arg(long, value_name = "FILE", required_unless_present = "make_hands")]
    hands: Vec<PathBuf>,
    /// Make a recording that scans the part, write it here as CSV, and end
    #[arg(long, value_name = "FILE", conflicts_with_all = ["hands", "port", "sim", "out"])]
    make_hands: Option<PathBuf>,
    #[command(flatten)]
    port: PortOrSim,
    /// Folder for the scan
    #[arg(long, value_name = "DIR", required_unless_present = "make_hands")]
    out: Option<PathBuf>,
    #[command(flatten)]
    folder: FolderArgs,
    /// The workpiece under the camera, as in `weldpath simulate`
    #[arg(long, default_value = "butt-v")]
    part: Part,
    /// Its sizes, place and noise follow from it
    #[arg(long, default_value_t = 1, value_parser = whole::<u64>, allow_negative_numbers = true)]
    seed: u64,
    /// none, low, mid or high
    #[arg(long, default_value_t = Noise::Mid)]
    noise: Noise,
    /// The hand that steers; the right one captures in any case
    #[arg(long, value_name = "HAND", default_value = "left", value_parser = ["left", "right"])]
    steer: String,
    /// Middle of the interaction box, mm, sensor frame
    #[arg(long, value_name = "X,Y,Z", default_value = "0,200,0", allow_hyphen_values = true)]
    box_center: Place,
    /// Edge of the interaction box
    #[arg(long, value_name = "MM", default_value_t = 100.0, allow_negative_numbers = true)]
    box_mm: f64,
    /// Where the camera is on the robot's flange, mm and a rotation vector in rad: a robot at the pendant's port needs it
    #[arg(long, value_name = "X,Y,Z,RX,RY,RZ", value_parser = transform, allow_hyphen_values = true)]
    flange_from_camera: Option<Isometry3<f64>>,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// Views that the made recording captures.
const VIEWS: usize = 6;

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if !(10.0..=1000.0).contains(&args.box_mm) {
        return Err(Failure::new(Exit::Usage, format!("--box-mm is {}, not 10 to 1000", args.box_mm)));
    }
    let request = request(args);
    let stage = simulation::stage(&request).map_err(|error| Failure::new(Exit::Usage, error))?;
    let start = stage.base_from_camera[0];
    let setup = Setup {
        base_from_camera: start,
        box_center_mm: args.box_center.get(),
        box_mm: args.box_mm,
        steer_right: args.steer == "right",
    };
    match &args.make_hands {
        Some(file) => make(args, file, &setup, &stage.base_from_camera),
        None => scan(args, &request, &setup),
    }
}

fn request(args: &Args) -> Request {
    Request { views: Some(VIEWS), noise: args.noise, ..Request::new(args.part, args.seed) }
}

fn make(args: &Args, file: &Path, setup: &Setup, poses: &[Isometry3<f64>]) -> Result<(), Failure> {
    let setup = Setup { steer_right: false, ..*setup };
    let frames = generator::recording(&setup, poses)
        .ok_or_else(|| Failure::new(Exit::Usage, "these poses cannot be reached from within this box"))?;
    let part =
        format!("made by `weldpath scan --make-hands` for seed {} of the part; no hand moved", args.seed);
    let name = file.file_name().and_then(|name| name.to_str()).unwrap_or("hands.csv");
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let content = recording::to_csv(&frames, &part);
    Folder::new(folder, args.folder, args.quiet).write(&[File::new(name, content)])?;
    let text = format!("{}: {} frames, {} captures\n", file.display(), frames.len(), poses.len());
    if args.quiet { Ok(()) } else { print(&text) }
}

fn scan(args: &Args, request: &Request, setup: &Setup) -> Result<(), Failure> {
    let out = args.out.as_deref().ok_or_else(|| Failure::new(Exit::Usage, "no --out"))?;
    keep_real_scans(out)?;
    let hands = Hands::open(&args.hands)?;
    let (link, simulated) = args.port.open()?;
    if let Some(camera) = &args.flange_from_camera {
        let tool = teleop::wire_pose(camera)
            .ok_or_else(|| Failure::new(Exit::Usage, "--flange-from-camera is too far from the flange"))?;
        set_tool(&link, tool)?;
    }
    enable(&link, simulated.as_ref().map(|(_, panel)| panel), args.quiet)?;
    let session = hands.play(setup, &link, args.quiet).map_err(|failure| taken_off(&link, failure))?;
    if !args.quiet {
        print(&table(&session))?;
    }
    let poses: Vec<Isometry3<f64>> = session.captures.iter().map(|(_, pose)| *pose).collect();
    if poses.is_empty() {
        return Err(Failure::new(Exit::Unfinished, "no view was captured: the hands made no \"ok\"")
            .hint("\"ok\" is pinch > 0.7, grab < 0.5, middle to little finger extended, held 50 ms"));
    }
    let scan = simulation::captured(request, &poses).map_err(|error| Failure::new(Exit::Usage, error))?;
    let files = simulation::files(&scan).map_err(|error| Failure::new(Exit::Output, error))?;
    Folder::new(out, args.folder, args.quiet).write(&files)?;
    let text = format!("{}: {} views\nnext: weldpath plan {}\n", out.display(), poses.len(), out.display());
    if args.quiet { Ok(()) } else { print(&text) }
}

/// Hands move the camera only while the switch is held and the key is in manual: in a simulation that is done here, at a
/// real pendant by whoever holds it.
fn enable(link: &Link, panel: Option<&Panel>, quiet: bool) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::new(Exit::Pendant, format!("the simulated panel: {error}"));
    let mut told = false;
    loop {
        let Some(Event::Telemetry(state)) = link.next(Duration::from_millis(20)).map_err(lost)? else {
            continue;
        };
        if state.fault == Some(Fault::EStop) && panel.is_some() {
            // The emulator was slow to hear its panel, which counts as a stop.
            panel.map_or(Ok(()), Panel::reset).map_err(failed)?;
            continue;
        }
        let held = state.pins & Telemetry::ENABLED != 0;
        if held && state.pins & Telemetry::MANUAL != 0 {
            return Ok(());
        }
        match panel {
            Some(panel) => {
                panel.manual(true).map_err(failed)?;
                panel.set(Inputs::default()).map_err(failed)?;
                std::thread::sleep(Duration::from_millis(60));
                panel.set(Inputs { enable: true, ..Inputs::default() }).map_err(failed)?;
                std::thread::sleep(Duration::from_millis(60));
            }
            None if !told && !quiet => {
                told = true;
                print(
                    "waiting for the key switch in manual and the enabling switch (released first, then held)\n",
                )?;
            }
            None => {}
        }
    }
}

/// Whence the hands are.
enum Hands {
    Recorded(Vec<WireHandFrame>),
    Live(Live),
}

impl Hands {
    fn open(files: &[PathBuf]) -> Result<Self, Failure> {
        let input = Path::new("-");
        if files == [input] {
            return Ok(Self::Live(Live::listen(BufReader::new(std::io::stdin()))));
        }
        if files.iter().any(|file| file == input) {
            return Err(Failure::new(Exit::Usage, "--hands - stands alone: live hands follow no recording"));
        }
        let read = |file: &PathBuf| {
            recording::read(file).map_err(|error| {
                Failure::new(Exit::Input, error)
                    .hint("`weldpath scan --make-hands FILE` makes a recording to try")
            })
        };
        Ok(Self::Recorded(recording::join(files.iter().map(read).collect::<Result<Vec<_>, _>>()?)))
    }

    fn play(self, setup: &Setup, link: &Link, quiet: bool) -> Result<Session, Failure> {
        let limits = &link.pendant().limits.jog;
        match self {
            Self::Recorded(frames) => {
                let bar = "{bar:24} {pos}/{len} frames {elapsed:>4}, {eta} left";
                let bar = progress::bar(quiet, frames.len() as u64, bar);
                let ask = |command| {
                    bar.inc(1);
                    link.ask(command)
                };
                let played = teleop::play(&frames, setup, limits, Pace::Recorded, ask);
                bar.finish_and_clear();
                played.map_err(unplayed)
            }
            Self::Live(mut hands) => {
                let ask = |command| link.ask(command);
                let session =
                    teleop::play(&mut hands, setup, limits, Pace::Answers, ask).map_err(unplayed)?;
                if let Some(why) = hands.failure() {
                    return Err(Failure::new(Exit::Input, format!("standard input: {why}"))
                        .hint("docs/pendant.md has the lines that `--hands -` reads"));
                }
                if hands.skipped() > 0 && !quiet {
                    print(&format!("{} frames left out for newer ones\n", hands.skipped()))?;
                }
                Ok(session)
            }
        }
    }
}

/// The failure, with why the robot was taken out of the hands, if it was.
fn taken_off(link: &Link, failure: Failure) -> Failure {
    let mut newest = None;
    while let Ok(Some(event)) = link.next(Duration::ZERO) {
        if let Event::Telemetry(state) = event {
            newest = state.cause;
        }
    }
    let Some(cause) = newest else { return failure };
    let message = format!("hand guiding was stopped because of the robot: {}", cause_words(cause));
    Failure { message, ..failure }
        .hint("check the robot, release the enabling switch, and scan again; nothing was written")
}

fn unplayed(error: teleop::Error<link::Error>) -> Failure {
    match error {
        teleop::Error::Link(error) => lost(error),
        teleop::Error::Setup => Failure::new(Exit::Usage, error),
        refused => {
            Failure::new(Exit::Unfinished, refused).hint("hand frames are answered while nothing moves")
        }
    }
}

/// Latency of each motion, beside the paper's.
fn table(session: &Session) -> String {
    let mut text = format!(
        "{} frames: {} clutched, {} without a steering hand; {}\n\
         answer time per frame, ms (the paper's include its robot's motion)\n\
         {:10} {:>6} {:>8} {:>8} {:>8} {:>8}\n",
        session.frames,
        session.clutched,
        session.lost,
        match session.agreed {
            Some(agreed) => format!("{agreed} poses are the host's own to the last bit"),
            None => "the camera is where the robot has it".into(),
        },
        "motion",
        "frames",
        "median",
        "95 %",
        "max",
        "paper"
    );
    for (number, (name, latency)) in REGIONS.iter().zip(&session.latency).enumerate() {
        let paper_ms = if number == 0 { 900 } else { 50 };
        let [median, most, max] = quantiles(latency);
        text += &format!("{name:10} {:>6} {median:>8} {most:>8} {max:>8} {paper_ms:>8}\n", latency.len());
    }
    text
}

/// Median, 95th percentile and maximum in milliseconds.
fn quantiles(latency: &[Duration]) -> [String; 3] {
    let mut sorted = latency.to_vec();
    sorted.sort_unstable();
    let at =
        |share: f64| sorted.get(((sorted.len() as f64 * share) as usize).min(sorted.len().saturating_sub(1)));
    [0.5, 0.95, 1.0]
        .map(|share| at(share).map_or("-".into(), |time| format!("{:.2}", time.as_secs_f64() * 1e3)))
}
