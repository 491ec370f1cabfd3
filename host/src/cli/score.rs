//! `weldpath score`: edge scores from the pendant, beside the host's own.

use std::path::PathBuf;

use nalgebra::{Point3, Vector3};
use weldpath::input;
use weldpath::pendant::link::refusal_words;
use weldpath::pendant::teleop::Twin;
use weldpath::run::job::quantity::{Place, RatioThreshold};
use weldpath_core::wire::{Answer, Command, MAX_PATCH, Offset, WireEdgeScore, WirePatch};

use super::port::{PortOrSim, lost};
use super::{Exit, Failure, print};

/// Ask the pendant for edge scores (eqs. (11) to (17)) of points of a cloud, and compare them with the host's
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Cloud or scan folder, as for `weldpath plan`
    #[arg(value_name = "CLOUD")]
    cloud: PathBuf,
    /// Score the points nearest to this place, mm, base frame
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    near: Place,
    #[command(flatten)]
    port: PortOrSim,
    /// Number of points
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    count: u16,
    /// Ball radius of eq. (11) [default: half the distance to a point's 64th neighbour]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    radius_mm: Option<f64>,
    /// Threshold of eq. (16) [default: 53]
    #[arg(long, value_name = "T")]
    t: Option<RatioThreshold>,
}

/// A point of a patch is at most so far from the first along an axis, mm: the wire's 16 bits.
const FARTHEST_MM: f64 = 32.0;
/// Nearest points that are looked at for a patch.
const CANDIDATES: usize = 8192;

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(radius_mm) = args.radius_mm.filter(|radius_mm| !(0.01..=FARTHEST_MM).contains(radius_mm)) {
        return Err(Failure::new(
            Exit::Usage,
            format!("--radius-mm is {radius_mm}, not 0.01 to {FARTHEST_MM}"),
        ));
    }
    let near = nearest(args)?;
    let (link, _emulator) = args.port.open()?;
    let mut twin = Twin::default();
    let (mut text, mut differ) = (heading(), 0);
    for &point in near.iter().take(usize::from(args.count)) {
        let patch = patch(args, point, &near)?;
        let host = twin.score(&patch);
        let pendant = link.ask(Command::Score(patch)).map_err(lost)?;
        differ += usize::from(host != pendant);
        text += &row(point, &pendant, &host);
    }
    text += &format!("{} of {} scores differ\n", differ, near.len().min(usize::from(args.count)));
    print(&text)?;
    if differ == 0 { Ok(()) } else { Err(Failure::new(Exit::Unfinished, "pendant and host disagree")) }
}

/// Points round the place, nearest first: enough for the scored ones and their neighbours.
fn nearest(args: &Args) -> Result<Vec<Point3<f64>>, Failure> {
    let options = input::Options::default();
    let scan = input::read(&args.cloud, &options).map_err(|error| Failure::new(Exit::Input, error))?;
    let place = args.near.point_mm();
    let views = scan.views.iter();
    let mut points: Vec<Point3<f64>> = views
        .flat_map(|view| view.points_mm.iter().map(|p| view.base_from_camera * p.cast::<f64>()))
        .collect();
    points.sort_by(|a, b| (a - place).norm_squared().total_cmp(&(b - place).norm_squared()));
    points.truncate(CANDIDATES + usize::from(args.count));
    if points.len() < 4 {
        return Err(Failure::new(Exit::Input, format!("{} holds fewer than 4 points", args.cloud.display())));
    }
    Ok(points)
}

/// The point and its nearest neighbours, at most as many as the wire carries.
fn patch(args: &Args, point: Point3<f64>, near: &[Point3<f64>]) -> Result<WirePatch, Failure> {
    let mut offsets: Vec<Vector3<f64>> = near.iter().map(|other| other - point).collect();
    offsets.retain(|offset| offset.amax() < FARTHEST_MM);
    offsets.sort_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    offsets.truncate(MAX_PATCH);
    let widest_mm = offsets.last().map_or(0.0, |offset| offset.norm());
    let radius_mm = args.radius_mm.unwrap_or(0.5 * widest_mm);
    let um = |mm: f64| (mm * 1000.0).round();
    let points = offsets.iter().map(|offset| Offset { um: offset.map(|mm| um(mm) as i16).into() }).collect();
    let threshold = args.t.unwrap_or_default().get();
    let patch =
        WirePatch { radius_um: um(radius_mm) as u32, threshold_milli: (threshold * 1000.0) as u32, points };
    if patch.radius_um == 0 || patch.points.len() < 4 {
        return Err(Failure::new(Exit::Input, "too few points within 32 mm of that place")
            .hint("`weldpath plan` prints where the seams are; check the cloud's units"));
    }
    Ok(patch)
}

fn heading() -> String {
    format!(
        "{:^29} {:>4} {:>9} {:>9} {:>5} {:>6}\n",
        "x y z, mm", "near", "intensity", "ratio", "edge", "host"
    )
}

fn row(point: Point3<f64>, pendant: &Answer, host: &Answer) -> String {
    let place = format!("{:9.3} {:9.3} {:9.3}", point.x, point.y, point.z);
    let same = if pendant == host { "same" } else { "DIFFER" };
    match pendant {
        Answer::EdgeScore(WireEdgeScore { neighbours, intensity_ppm, ratio_milli, edge }) => format!(
            "{place} {neighbours:>4} {:>9.6} {:>9} {:>5} {same:>6}\n",
            f64::from(*intensity_ppm) * 1e-6,
            if *ratio_milli == u32::MAX {
                "inf".into()
            } else {
                format!("{:.3}", f64::from(*ratio_milli) * 1e-3)
            },
            if *edge { "yes" } else { "no" },
        ),
        Answer::Refused(why) => format!("{place} refused: {} {same:>6}\n", refusal_words(*why)),
        other => format!("{place} {other:?} {same:>6}\n"),
    }
}
