//! The page's JSON and binary blocks. Schema: `docs/formats.md`.

use super::colour;
use super::extent;
use super::histogram::Histogram;
use super::points::{self, INTENSITY_FULL, Layer};
use super::run::Run;
use nalgebra::{Point3, Vector3};
use serde::Serialize;
use weldpath_job::output::arm::ArmDrawing;
use weldpath_job::output::summary::Summary;
use weldpath_method::pipeline::{Method, Plan};
use weldpath_method::seam::Seam;
use weldpath_method::seam::segmentation::{SeenSurface, SurfaceShape};
use weldpath_method::weld::air;
use weldpath_method::weld::program::{Kind, Waypoint};

/// Most waypoints in the page; the files hold all.
const WAYPOINTS: usize = 20_000;
/// The work reaches so far beyond its seams, in radii of the seams and mm, whichever is more.
const AROUND_RADII: f64 = 0.15;
const AROUND_MM: f64 = 25.0;

/// What every picture of a run agrees on.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    /// Middle of the seams, base frame.
    pub(super) centre_mm: Point3<f64>,
    /// Of a ball about the centre that holds the seams and what is round them.
    pub(super) radius_mm: f64,
    pub(super) up: Vector3<f64>,
    /// From the centre to the eye of the first view: unit vector.
    pub(super) eye: Vector3<f64>,
    /// Heights along `up` over the centre that the colours span.
    pub(super) heights_mm: [f64; 2],
    /// Outermost places of the work, base frame: what a picture of the whole has to hold.
    pub(super) outline_mm: Vec<Point3<f64>>,
}

impl Scene {
    pub(super) fn of(run: &Run) -> Self {
        let Run { plan, output, .. } = *run;
        let up = air::up(output.paths.iter().flat_map(|path| &path.points)).into_inner();
        let seams = || plan.seams.iter().flat_map(|s| &s.stations).map(|s| s.position_mm);
        let model = || (0..plan.model.len()).map(|i| plan.model.in_base_mm(i));
        let (centre_mm, reach_mm) = ball(seams()).or_else(|| ball(model())).unwrap_or_default();
        let radius_mm = reach_mm + (AROUND_RADII * reach_mm).max(AROUND_MM);
        let near = model().map(|p| p - centre_mm).filter(|v| v.norm() < radius_mm);
        let heights_mm = middle_range(near.map(|v| v.dot(&up)).collect());
        let outline_mm = extent::outline(plan, centre_mm, radius_mm, up, heights_mm);
        Self { centre_mm, radius_mm, up, eye: eye(plan, &up), heights_mm, outline_mm }
    }
}

/// Middle of the points' box and the largest distance from it.
fn ball(points: impl Iterator<Item = Point3<f64>> + Clone) -> Option<(Point3<f64>, f64)> {
    let first = points.clone().next()?.coords;
    let (low, high) = points.clone().fold((first, first), |(l, h), p| (l.inf(&p.coords), h.sup(&p.coords)));
    let centre_mm = Point3::from(0.5 * (low + high));
    let reach_mm = points.map(|p| (p - centre_mm).norm()).fold(0.0, f64::max);
    Some((centre_mm, reach_mm))
}

/// From the 1st to the 99th percentile.
fn middle_range(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_unstable_by(f64::total_cmp);
    let at =
        |percent: usize| values.get(values.len().saturating_sub(1) * percent / 100).copied().unwrap_or(0.0);
    [at(1), at(99).max(at(1) + 1.0)]
}

/// Obliquely from above, from the side to which most torches lean.
fn eye(plan: &Plan, up: &Vector3<f64>) -> Vector3<f64> {
    let stations = plan.seams.iter().flat_map(|s| &s.stations);
    let lean: Vector3<f64> =
        stations.map(|s| (s.faces[0] + s.faces[1]).try_normalize(1e-6).unwrap_or_default()).sum();
    let level = |v: Vector3<f64>| (v - up * up.dot(&v)).try_normalize(1e-6);
    let any = if up.x.abs() < 0.6 { Vector3::x() } else { Vector3::z() };
    let side = level(Vector3::new(0.45, -0.9, 0.0)).or(level(any)).unwrap_or(any);
    let lean = lean.try_normalize(1e-6).unwrap_or_default();
    let aside = lean - up * up.dot(&lean);
    (side * 0.75 + aside * 1.5 + up * 0.75).normalize()
}

/// Everything but the points.
#[derive(Serialize)]
struct Content<'a> {
    format: &'static str,
    version: u32,
    title: &'a str,
    job: String,
    ramp: [[u8; 3]; 6],
    summary: &'a Summary,
    centre_mm: [f64; 3],
    radius_mm: f64,
    up: [f64; 3],
    eye: [f64; 3],
    heights_mm: [f64; 2],
    outline_mm: Vec<[f64; 3]>,
    clouds: Clouds,
    intensity_full: f32,
    surfaces: Vec<SurfaceRow>,
    cameras_mm: Vec<[f64; 3]>,
    seams: Vec<SeamLine>,
    waypoints: Vec<Row>,
    waypoints_of: usize,
    arm: Option<ArmDrawing>,
    histograms: Histograms<'a>,
}

#[derive(Serialize)]
struct Clouds {
    model: Option<Layer>,
    raw: Option<Layer>,
}

#[derive(Serialize)]
struct SeamLine {
    id: usize,
    closed: bool,
    colour: String,
    line_mm: Vec<[f64; 3]>,
}

#[derive(Serialize)]
struct SurfaceRow {
    shape: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    radius_mm: Option<f64>,
    deviation_mm: f64,
}

/// x, y, z, w, x, y, z of the quaternion, feed, seam or 0, kind.
type Row = (f64, f64, f64, f64, f64, f64, f64, f64, usize, Kind);

#[derive(Serialize)]
struct Histograms<'a> {
    intensity: &'a Histogram,
    intensity_gate: Option<f64>,
    ratio: &'a Histogram,
    ratio_threshold: f64,
    ratio_decides: bool,
    spacing_mm: &'a Histogram,
    spacing_marks_mm: Vec<(&'static str, f64)>,
}

/// Value of `version`.
const VERSION: u32 = 1;

/// The JSON block and the binary block.
pub(super) fn document(run: &Run, scene: &Scene) -> (String, Vec<u8>) {
    let Run { plan, output, recording, job, title } = *run;
    let mut block = Vec::new();
    let clouds = match &recording.clouds {
        Some(c) => Clouds {
            model: Some(points::pack(&c.frame, &c.model, c.model_of, &mut block)),
            raw: Some(points::pack(&c.frame, &c.raw, c.raw_of, &mut block)),
        },
        None => Clouds { model: None, raw: None },
    };
    let waypoints = &output.program.waypoints;
    let shown: Vec<usize> = shown(waypoints).collect();
    let arm = job.feasibility().and_then(|setup| setup.robot).zip(output.feasibility.as_ref());
    let content = Content {
        format: "weldpath-report",
        version: VERSION,
        title,
        job: job.to_toml(),
        ramp: colour::RAMP,
        summary: &output.summary,
        centre_mm: scene.centre_mm.into(),
        radius_mm: scene.radius_mm,
        up: scene.up.into(),
        eye: scene.eye.into(),
        heights_mm: scene.heights_mm,
        outline_mm: scene.outline_mm.iter().map(|&p| rounded(p.into())).collect(),
        clouds,
        intensity_full: INTENSITY_FULL,
        surfaces: recording.surfaces.iter().map(surface_row).collect(),
        cameras_mm: recording.cameras_mm.iter().map(|&c| c.into()).collect(),
        seams: plan.seams.iter().map(seam_line).collect(),
        waypoints: shown.iter().map(|&i| row(&waypoints[i])).collect(),
        waypoints_of: waypoints.len(),
        arm: arm.map(|(arm, report)| ArmDrawing::new(&arm, report, &shown)),
        histograms: histograms(run),
    };
    // Strings, finite numbers and lists only: there is nothing serde_json could refuse.
    (serde_json::to_string(&content).unwrap_or_default(), block)
}

fn histograms<'a>(run: &Run<'a>) -> Histograms<'a> {
    let Run { plan, recording, job, .. } = *run;
    let derived = |name: &str| plan.derived.parameters.iter().find(|d| d.name == name).map(|d| d.value);
    Histograms {
        intensity: &recording.intensity,
        intensity_gate: derived("intensity_gate").filter(|gate| *gate > 0.0),
        ratio: &recording.ratio,
        ratio_threshold: job.ratio_threshold.unwrap_or_default().get(),
        ratio_decides: job.method == Method::Paper,
        spacing_mm: &recording.spacing_mm,
        spacing_marks_mm: [("mean", "spacing_mm"), ("voxel", "voxel_mm")]
            .iter()
            .filter_map(|(label, name)| Some((*label, derived(name)?)))
            .collect(),
    }
}

fn surface_row(surface: &SeenSurface) -> SurfaceRow {
    let (shape, radius_mm) = match surface.shape {
        SurfaceShape::Plane => ("plane", None),
        SurfaceShape::Cylinder { radius_mm } => ("cylinder", Some(f64::from(radius_mm))),
        SurfaceShape::Freeform => ("freeform", None),
    };
    SurfaceRow { shape, radius_mm, deviation_mm: surface.deviation_mm.into() }
}

fn seam_line(seam: &Seam) -> SeamLine {
    let every = seam.stations.len().div_ceil(WAYPOINTS).max(1);
    let places = seam.stations.iter().step_by(every).chain(seam.stations.last());
    SeamLine {
        id: seam.id,
        closed: seam.closed,
        colour: colour::css(colour::of_seam(seam.id)),
        line_mm: places.map(|s| rounded(s.position_mm.into())).collect(),
    }
}

/// All moves. Of a long seam only an even share of its points, and always both ends.
fn shown(waypoints: &[Waypoint]) -> impl Iterator<Item = usize> + '_ {
    let every = waypoints.len().div_ceil(WAYPOINTS).max(1);
    let inside = |i: usize| {
        let welds = |k: usize| waypoints.get(k).is_some_and(|w| w.weld && w.seam == waypoints[i].seam);
        i > 0 && welds(i - 1) && welds(i) && welds(i + 1)
    };
    (0..waypoints.len()).filter(move |&i| i % every == 0 || !inside(i))
}

fn row(w: &Waypoint) -> Row {
    let ([x, y, z], q) = (rounded(w.position_mm.into()), w.base_from_torch);
    let [qw, qx, qy, qz] = [q.w, q.i, q.j, q.k].map(|v| (v * 1e6).round() / 1e6);
    (x, y, z, qw, qx, qy, qz, w.feed_mm_s, w.seam.unwrap_or(0), w.kind)
}

/// To the micrometre.
pub(super) fn rounded(p_mm: [f64; 3]) -> [f64; 3] {
    p_mm.map(|v| (v * 1e3).round() / 1e3 + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn waypoint(i: usize, seam: usize) -> Waypoint {
        Waypoint {
            position_mm: Point3::new(i as f64, 0.0, 0.0),
            base_from_torch: UnitQuaternion::identity(),
            feed_mm_s: 8.0,
            weld: seam > 0,
            seam: (seam > 0).then_some(seam),
            kind: if seam > 0 { Kind::Weld } else { Kind::Air },
            dwell_s: None,
        }
    }

    #[test]
    fn a_long_program_keeps_its_air_moves_and_the_ends_of_its_seams() {
        let seam = |i: usize| [0, 1, 1, 0, 2][i * 5 / 100_000];
        let all: Vec<Waypoint> = (0..100_000).map(|i| waypoint(i, seam(i))).collect();
        let kept: Vec<Row> = shown(&all).map(|i| row(&all[i])).collect();
        let places: Vec<f64> = kept.iter().map(|row| row.0).collect();
        for end in [20_000.0, 59_999.0, 80_000.0, 99_999.0] {
            assert!(places.contains(&end), "{end}");
        }
        assert_eq!(kept.iter().filter(|row| row.9 == Kind::Air).count(), 40_000);
        assert!(kept.iter().filter(|row| row.9 == Kind::Weld).count() < 13_000);
    }

    #[test]
    fn the_ball_holds_all_points() {
        let points = [Point3::new(0.0, 0.0, 0.0), Point3::new(10.0, 0.0, 0.0), Point3::new(5.0, 3.0, 0.0)];
        let (centre_mm, reach_mm) = ball(points.into_iter()).unwrap();
        assert!(points.iter().all(|p| (p - centre_mm).norm() <= reach_mm + 1e-12));
        assert!(ball([].into_iter()).is_none());
    }
}
