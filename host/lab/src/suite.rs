//! Plans against truths in one figure each, over folders of scans, meshes and clouds: how much of what is there is
//! covered, and how much of what is offered is false. Millimetres.
//!
//! Unlike [`evaluation::score`](weldpath_sim::evaluation::score), which measures how well a seam is followed, this asks of each
//! millimetre of weld whether a path is there with its torch on the right side: lists of others have no more to say.

mod pieces;
mod reliability;

pub use pieces::{Piece, PieceKind, pieces};
pub use reliability::{Reliability, StatedSeam, reliability};

use nalgebra::{Point3, Vector3};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;
use weldpath_job::output::verdict::{ReasonId, State};
use weldpath_job::run::job::Job;
use weldpath_job::run::job::scan::AnchorName;
use weldpath_job::run::planning;
use weldpath_job::run::postprocessing::postprocess;
use weldpath_method::geometry::grid::Grid;
use weldpath_method::input;
use weldpath_method::pipeline::Plan;
use weldpath_method::seam::Seam;
use weldpath_sim::evaluation::{PathSet, Target, Truth};

/// A millimetre of weld is covered by a path point this near, whose torch is within this angle of the bisector: the
/// torch is in this corner and not in the one behind the rib.
const COVER_MM: f64 = 2.0;
const TORCH_DEG: f64 = 50.0;
/// A path runs along a weld whose direction is within 45 degrees of its own.
const ALONG_COS: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// A path point farther than this from every weld is false, and a corner that is farther from a weld does not name it, mm.
const FALSE_MM: f64 = 5.0;

/// A plan against the truth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Tally {
    /// Welds that can be seen, mm.
    pub weld_mm: f64,
    /// Share of them that is covered.
    pub covered: f64,
    /// Share of them that is not, but named as an inside corner that is not welded: the rest is missed without a word.
    pub named: f64,
    /// Share of path points that belong to no weld.
    pub false_share: f64,
    /// Root mean square distance of the path across the welds, of its points near them, mm.
    pub across_mm: Option<f64>,
    /// Mean angle between torch and bisector where a weld is covered, degrees.
    pub torch_deg: Option<f64>,
}

/// A row of the table.
#[derive(Debug, Clone, Serialize)]
pub struct PieceScore {
    /// Path of the piece below the folder of the suite.
    pub name: String,
    /// What it is.
    pub kind: PieceKind,
    /// Seams offered.
    pub seams: usize,
    /// Their length, mm.
    pub length_mm: f64,
    /// Against the truth, if there is one.
    pub tally: Option<Tally>,
    /// Expected error of the seams, root mean square over their length, mm.
    pub stated_mm: Option<f64>,
    /// Highest confidence of a seam that is false over half its length, or, without truth, of any.
    pub confidence: Option<f64>,
    /// The verdict of a run whose tool is stated; none without a plan.
    pub verdict: Option<State>,
    /// Each seam that is offered; empty without truth.
    pub scores: Vec<StatedSeam>,
    /// Wall time of reading and planning, seconds.
    pub plan_s: f64,
    /// Why there is no seam, or no plan.
    pub reason: Option<String>,
}

/// Plans a piece, its model held in the base frame by `anchor`, all else by default, and sets it against its truth.
pub fn measure(piece: &Piece, anchor: AnchorName) -> PieceScore {
    let begin = Instant::now();
    let planned = planned(&piece.input, anchor);
    let plan_s = begin.elapsed().as_secs_f64();
    let nothing = PieceScore {
        name: piece.name.clone(),
        kind: piece.kind,
        seams: 0,
        length_mm: 0.0,
        tally: None,
        stated_mm: None,
        confidence: None,
        verdict: None,
        scores: Vec::new(),
        plan_s,
        reason: None,
    };
    match (planned, piece.truth()) {
        (Ok(planned), Ok(truth)) => of_plan(&planned, truth.as_ref(), nothing),
        (Err(reason), Ok(truth)) => {
            let tally = truth.map(|truth| tally(&PathSet::default(), &[], &truth));
            PieceScore { tally, reason: Some(reason), ..nothing }
        }
        (_, Err(reason)) => PieceScore { reason: Some(reason), ..nothing },
    }
}

/// A plan, the paths as they stand in its path.csv, and its verdict.
struct Planned {
    plan: Plan,
    paths: PathSet,
    verdict: State,
}

fn planned(input: &Path, anchor: AnchorName) -> Result<Planned, String> {
    let scan = input::read(input, &input::Options::default()).map_err(|error| error.to_string())?;
    let mut job = Job { accept: vec![ReasonId::ToolNotStated], ..Job::default() };
    job.scan.anchor = anchor;
    let plan = planning::plan(&scan, &job, &mut ()).map_err(|error| error.to_string())?;
    let output =
        postprocess(&plan, &job, planning::source(&scan, &job)).map_err(|error| error.to_string())?;
    let csv = output.files.iter().find(|file| file.name == "path.csv").ok_or("no path.csv")?;
    let paths = PathSet::parse(&csv.bytes, Path::new("path.csv")).map_err(|error| error.to_string())?;
    Ok(Planned { plan, paths, verdict: output.summary.verdict().state })
}

fn of_plan(planned: &Planned, truth: Option<&Truth>, row: PieceScore) -> PieceScore {
    let Planned { plan, paths, verdict } = planned;
    let length_mm: f64 = plan.seams.iter().map(|seam| seam.length_mm()).sum();
    let squares: f64 = plan.seams.iter().map(|seam| seam.tip_error_mm().powi(2) * seam.length_mm()).sum();
    let named: Vec<Vector3<f64>> =
        plan.unwelded.iter().flat_map(|corner| &corner.line_mm).map(|place| place.coords).collect();
    let own = |seam: &Seam| paths.of_seam(&seam.id.to_string());
    let scored = |truth: &Truth| {
        // What is not welded is offered to nobody.
        let offered = plan.seams.iter().filter(|seam| !own(seam).points_mm.is_empty());
        let stated = |seam: &Seam| {
            let Tally { false_share, across_mm, .. } = tally(&own(seam), &[], truth);
            StatedSeam::new(seam.confidence, seam.tip_error_mm(), false_share, across_mm)
        };
        offered.map(stated).collect()
    };
    let scores: Vec<StatedSeam> = truth.map(scored).unwrap_or_default();
    let of_false = scores.iter().filter(|score| !score.on_weld).map(|score| score.confidence);
    let of_any = plan.seams.iter().filter(|_| truth.is_none()).map(|seam| seam.confidence);
    PieceScore {
        seams: plan.seams.len(),
        length_mm,
        tally: truth.map(|truth| tally(paths, &named, truth)),
        stated_mm: (length_mm > 0.0).then(|| (squares / length_mm).sqrt()),
        confidence: of_false.chain(of_any).max_by(f64::total_cmp),
        verdict: Some(*verdict),
        scores,
        ..row
    }
}

/// A place on a weld.
struct Place {
    at: Vector3<f64>,
    torch: Vector3<f64>,
    tangent: Vector3<f64>,
    visible: bool,
}

/// Sets paths with orientations against a truth; `named_mm` are places along the corners that the plan names and does not weld.
pub fn tally(paths: &PathSet, named_mm: &[Vector3<f64>], truth: &Truth) -> Tally {
    let places: Vec<Place> = truth.seams.iter().flat_map(places).collect();
    let seen: Vec<&Place> = places.iter().filter(|place| place.visible).collect();
    let path = Nearest::new(&paths.points_mm);
    let torch_deg = |place: &Place| {
        let (i, distance_mm) = path.to(&place.at)?;
        let torch = paths.frames.as_ref()?.get(i)?.column(2).into_owned();
        let off_deg = torch.angle(&place.torch).to_degrees();
        (distance_mm < COVER_MM && off_deg < TORCH_DEG).then_some(off_deg)
    };
    let (mut covered, mut named) = (Vec::new(), 0);
    let corners = Nearest::new(named_mm);
    for place in &seen {
        match torch_deg(place) {
            Some(off_deg) => covered.push(off_deg),
            None => named += usize::from(corners.to(&place.at).is_some()),
        }
    }
    let line: Vec<Vector3<f64>> = places.iter().map(|place| place.at).collect();
    let welds = Nearest::new(&line);
    let nearest: Vec<Option<(usize, f64)>> = paths.points_mm.iter().map(|p| welds.to(p)).collect();
    let is_false = |near: &&Option<(usize, f64)>| near.is_none_or(|(_, mm)| mm >= FALSE_MM);
    let across = |(k, p): (usize, &Vector3<f64>)| {
        let travel = paths.frames.as_ref().map(|frames| frames[k].column(1).into_owned());
        // Where welds meet in a corner, the one along which the path runs.
        let along = |i: usize| travel.is_none_or(|travel| travel.dot(&places[i].tangent).abs() > ALONG_COS);
        let (i, _) = welds.to_such(p, along).filter(|(_, mm)| *mm < COVER_MM)?;
        let off = p - places[i].at;
        Some((off - places[i].tangent * off.dot(&places[i].tangent)).norm_squared())
    };
    let squares: Vec<f64> = paths.points_mm.iter().enumerate().filter_map(across).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let share = |part: usize, of: usize| if of == 0 { 0.0 } else { part as f64 / of as f64 };
    Tally {
        weld_mm: seen.len() as f64,
        covered: share(covered.len(), seen.len()),
        named: share(named, seen.len()),
        false_share: share(nearest.iter().filter(is_false).count(), nearest.len()),
        across_mm: (!squares.is_empty()).then(|| mean(&squares).sqrt()),
        torch_deg: (!covered.is_empty()).then(|| mean(&covered)),
    }
}

fn places(seam: &weldpath_sim::evaluation::TruthSeam) -> impl Iterator<Item = Place> {
    let line = seam.line(Target::Apex);
    line.iter().zip(&seam.n).zip(&seam.t).zip(&seam.visible).map(|(((p, n), t), visible)| Place {
        at: Vector3::from(*p),
        torch: Vector3::from(*n),
        tangent: Vector3::from(*t).normalize(),
        visible: *visible > 0,
    })
}

/// Nearest of some points, within the distance that matters.
struct Nearest<'a> {
    points: &'a [Vector3<f64>],
    grid: Grid,
}

impl<'a> Nearest<'a> {
    fn new(points: &'a [Vector3<f64>]) -> Self {
        let single: Vec<Point3<f32>> = points.iter().map(|p| Point3::from(p.cast::<f32>())).collect();
        Self { points, grid: Grid::new(&single, FALSE_MM as f32) }
    }

    fn to(&self, place: &Vector3<f64>) -> Option<(usize, f64)> {
        self.to_such(place, |_| true)
    }

    /// The nearest of those that are such.
    fn to_such(&self, place: &Vector3<f64>, such: impl Fn(usize) -> bool) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        self.grid.within(&Point3::from(place.cast::<f32>()), FALSE_MM as f32 + 0.1, |slot, _| {
            let i = self.grid.index(slot);
            let distance_mm = (self.points[i] - place).norm();
            if such(i) && best.is_none_or(|(k, mm)| distance_mm < mm || (distance_mm == mm && i < k)) {
                best = Some((i, distance_mm));
            }
        });
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;
    use weldpath_sim::evaluation::TruthSeam;

    /// A weld of 100 mm along x; the second half is seen by nobody.
    fn truth() -> Truth {
        let n = 100;
        let seam = TruthSeam {
            name: "one".into(),
            required: true,
            visible: (0..n).map(|k| u8::from(k < 50)).collect(),
            p: (0..n).map(|k| [k as f64 + 0.5, 0.0, 0.0]).collect(),
            n: vec![[0.0, 0.0, 1.0]; n],
            t: vec![[1.0, 0.0, 0.0]; n],
            ..TruthSeam::default()
        };
        Truth { seams: vec![seam], ..Truth::default() }
    }

    /// A path along x at a distance across, its torch leaning about x.
    fn path(from_mm: f64, to_mm: f64, across_mm: f64, lean_deg: f64) -> PathSet {
        let steps = (to_mm - from_mm) as usize;
        let points_mm: Vec<_> =
            (0..=steps).map(|k| Vector3::new(from_mm + k as f64, across_mm, 0.0)).collect();
        let (sin, cos) = lean_deg.to_radians().sin_cos();
        let n = Vector3::new(0.0, sin, cos);
        let frame = Matrix3::from_columns(&[Vector3::x().cross(&n), Vector3::x(), n]);
        PathSet { frames: Some(vec![frame; points_mm.len()]), points_mm, seams: None }
    }

    #[test]
    fn half_a_path_covers_half_of_what_is_seen() {
        let half = tally(&path(0.0, 25.0, 0.5, 10.0), &[], &truth());
        assert_eq!(half.weld_mm, 50.0);
        // A point reaches 2 mm beyond its end.
        assert!((half.covered - 0.54).abs() < 0.011, "{}", half.covered);
        assert!((half.across_mm.unwrap() - 0.5).abs() < 1e-6);
        assert!((half.torch_deg.unwrap() - 10.0).abs() < 1e-6);
        assert_eq!(half.false_share, 0.0);
    }

    #[test]
    fn what_is_not_welded_counts_as_named_beside_a_corner_that_is_told() {
        let told: Vec<Vector3<f64>> = (20..90).map(|x| Vector3::new(f64::from(x), 3.0, 0.0)).collect();
        let found = tally(&path(0.0, 29.0, 0.0, 0.0), &told, &truth());
        assert!((found.covered - 0.62).abs() < 0.011 && (found.covered + found.named - 1.0).abs() < 1e-9);
        let far: Vec<Vector3<f64>> = told.iter().map(|p| p * 2.0).collect();
        assert_eq!(tally(&PathSet::default(), &far, &truth()).named, 0.0);
    }

    #[test]
    fn a_torch_on_the_other_side_covers_nothing() {
        assert_eq!(tally(&path(0.0, 100.0, 0.0, 60.0), &[], &truth()).covered, 0.0);
        assert_eq!(tally(&path(0.0, 100.0, 0.0, 40.0), &[], &truth()).covered, 1.0);
        assert_eq!(tally(&path(0.0, 100.0, 2.5, 0.0), &[], &truth()).covered, 0.0);
    }

    /// Another along y begins where the first does: at that corner its points are the nearer ones.
    #[test]
    fn in_a_corner_a_path_is_measured_across_the_weld_that_it_follows() {
        let mut truth = truth();
        let aside = TruthSeam {
            p: (0..100).map(|k| [0.0, k as f64 - 50.0, 0.0]).collect(),
            t: vec![[0.0, 1.0, 0.0]; 100],
            ..truth.seams[0].clone()
        };
        truth.seams.push(aside);
        let across_mm = tally(&path(1.0, 50.0, 0.1, 0.0), &[], &truth).across_mm.unwrap();
        assert!((across_mm - 0.1).abs() < 1e-6, "{across_mm}");
    }

    #[test]
    fn what_lies_off_every_weld_is_false_whether_seen_or_not() {
        assert_eq!(tally(&path(60.0, 90.0, 1.0, 0.0), &[], &truth()).false_share, 0.0);
        assert_eq!(tally(&path(0.0, 100.0, 5.5, 0.0), &[], &truth()).false_share, 1.0);
        let nothing = tally(&PathSet::default(), &[], &truth());
        assert_eq!((nothing.covered, nothing.false_share, nothing.across_mm), (0.0, 0.0, None));
    }
}
