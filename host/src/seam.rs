//! Seams: what they are; finding them follows paper II-E, telling them apart and refining them is ours.

pub mod facets;
pub mod measure;
pub mod refine;
pub mod score;
pub mod trace;

use measure::{dimension, fitup, joint};
use refine::{expected, overlap};
use score::edges;
use trace::{chain, corner, loops, splice, step, support};

use crate::geometry::cloud::{Merged, PointCloud};
use crate::geometry::grid::Grid;
use crate::geometry::mesh::Mesh;
use crate::model::downsampling::Voxels;
use crate::model::reconstruction::Registration;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Joint type of a seam; the names are the same in files, options and messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Joint {
    /// Two bevels that meet below the surface of the plates.
    ButtV,
    /// Two faces of different members at an inside corner.
    Fillet,
    /// The edge of a plate that lies on another.
    Lap,
    /// The outside corner of two plates: both faces are plate edges.
    Corner,
    /// A tube that stands on a flat face: a closed fillet.
    Pipe,
    /// A tube that stands on a curved face: a closed fillet off the plane.
    Saddle,
    /// A seam that meets others in a junction.
    Branch,
}

impl Joint {
    /// The name used in every file, option and message.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ButtV => "butt-v",
            Self::Fillet => "fillet",
            Self::Lap => "lap",
            Self::Corner => "corner",
            Self::Pipe => "pipe",
            Self::Saddle => "saddle",
            Self::Branch => "branch",
        }
    }
}

/// One place on a seam.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Station {
    /// Where the two adjoining faces meet, mm, base frame.
    pub position_mm: Point3<f64>,
    /// Unit tangent, in the direction of the weld.
    pub tangent: Vector3<f64>,
    /// Unit normals of the two adjoining faces, out of the material. Their bisector is the torch direction.
    pub faces: [Vector3<f64>; 2],
}

/// A weldable seam, ordered as it is welded.
#[derive(Debug, Clone)]
pub struct Seam {
    /// 1, 2, ... in the order in which the seams are offered.
    pub id: usize,
    /// What kind of joint.
    pub joint: Joint,
    /// Why this joint type, in words.
    pub reason: String,
    /// Stations in weld order; a closed seam does not repeat its first.
    pub stations: Vec<Station>,
    /// Whether the last station is followed by the first.
    pub closed: bool,
    /// 0..1: how sure we are that this is a seam to weld.
    pub confidence: f64,
    /// Expected RMSE of the position across the seam, mm.
    pub expected_error_mm: f64,
    /// Expected RMSE of the torch orientation, degrees.
    pub expected_error_deg: f64,
    /// What was measured of the joint.
    pub dimensions: Vec<dimension::Dimension>,
    /// What the user should know about this seam.
    pub warnings: Vec<String>,
}

impl Seam {
    /// Length along the stations, mm.
    pub fn length_mm(&self) -> f64 {
        let open: f64 = self.stations.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm()).sum();
        match (self.closed, self.stations.first(), self.stations.last()) {
            (true, Some(first), Some(last)) => open + (first.position_mm - last.position_mm).norm(),
            _ => open,
        }
    }
}

/// Settings of the steps from cloud to seams, in their order.
#[derive(Debug, Clone, Default)]
pub struct Config {
    /// Two faces about a candidate.
    pub corner: corner::Config,
    /// Stringing corners together.
    pub chain: chain::Config,
    /// Refinement on the raw points.
    pub refine: refine::Config,
    /// Steps between parallel layers.
    pub step: step::Config,
}

/// What the steps before the seams hand over.
pub struct Input<'a> {
    /// All raw points.
    pub merged: &'a Merged,
    /// Their spatial index.
    pub raw: &'a Grid,
    /// The thinned cloud.
    pub voxels: &'a Voxels,
    /// The thinned cloud, denoised, in the same order.
    pub model: &'a PointCloud,
    /// Spatial index of its points, in cells of [`INDEX_VOXELS`].
    pub index: &'a Grid,
    /// Of the neighbourhoods in it, by its slots: [`edges::asymmetries`] within [`INDEX_VOXELS`].
    pub asymmetries: &'a [Vector3<f32>],
    /// Where the views are, if there are several.
    pub registration: Option<&'a Registration>,
    /// Names of the views, for messages.
    pub names: Vec<&'a str>,
    /// Whether every point was seen by a camera of known place.
    pub cameras_known: bool,
    /// Which size of voxels this is.
    pub trial: Trial,
}

/// Edge of the cells in which the model is looked up, and radius of the neighbourhoods of edge scores, voxels (the paper
/// gives none).
pub const INDEX_VOXELS: f32 = 4.0;

/// Where one size of voxels stands among those that are tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Trial {
    /// Larger than the cloud asks for.
    pub coarser: bool,
    /// No larger ones follow.
    pub last: bool,
}

impl Input<'_> {
    /// Whether the cloud is a scan of cameras whose whole view is kept, so that a table would be in it.
    fn whole_views(&self) -> bool {
        self.names.len() > 1 && self.cameras_known
    }

    /// Whether steps between layers are looked for, too: in the smallest voxels the layers of a sparse cloud have holes.
    fn second_cue(&self) -> bool {
        self.whole_views() || self.trial.coarser || self.trial.last
    }

    /// Whether nothing showed so far and nothing follows.
    fn last_resort(&self) -> bool {
        self.trial.coarser && self.trial.last
    }
}

/// Seams and what was left out on the way.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// In the order of the weld, numbered from 1.
    pub seams: Vec<Seam>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Why there is no seam, if there is none.
    pub reason: String,
    /// Intensity gate, for the report.
    pub gate: f32,
    /// Edge intensity of each point of the model, for the report.
    pub intensity: Vec<f32>,
}

/// Weldable seams of a cloud (paper II-E, and beyond it: several seams, types, order, accuracy below the voxel).
pub fn find(input: &Input, config: &Config) -> Found {
    let v = input.voxels.edge_mm;
    let grid = input.index;
    let scores = edges::score(input.voxels, grid, input.asymmetries);
    let corners = corners(input, &scores, &config.corner);
    let table = support::find(input.voxels);
    let (on_table, off_table): (Vec<_>, Vec<_>) = corners
        .into_iter()
        .partition(|c| table.is_some_and(|t| c.faces.iter().any(|face| t.is_face(face, &c.position))));
    let mut found = Found { gate: scores.gate, ..Found::default() };
    let mut chains = chains(input, &off_table, &on_table, grid, &config.chain);
    if chains.is_empty() && input.last_resort() {
        chains = splice::joined(chain::trace(&off_table, grid, v, &config.chain.blurred()), grid, v);
    }
    let measured: Vec<(&chain::Chain, refine::Refined)> =
        chains.par_iter().filter_map(|chain| Some((chain, measure(input, chain, grid, config)?))).collect();
    let measured = overlap::apart(measured, v, config.chain.shortest_voxels * v);
    let most_mm = config.refine.reach * v;
    let described = measured.iter().map(|(chain, seam)| describe(input, chain, seam, grid, most_mm));
    found.intensity = scores.intensity;
    let most_error_mm = if input.last_resort() { LAST_ERROR_VOXELS * f64::from(v) } else { f64::INFINITY };
    let (sure, unsure): (Vec<Seam>, Vec<Seam>) =
        described.partition(|seam| is_sure(seam) && seam.expected_error_mm < most_error_mm);
    found.seams = sure;
    found.warnings.extend(unsure.iter().map(left_out));
    if found.seams.is_empty() && input.second_cue() {
        found.seams = steps(input, table.as_ref(), grid, config);
    }
    mark_branches(&mut found.seams, 6.0 * f64::from(v));
    order(&mut found.seams);
    let unsure = unsure.first().map(left_out);
    found.reason = match (on_table.is_empty(), off_table.is_empty()) {
        _ if unsure.is_some() => unsure.unwrap_or_default(),
        (false, true) => "the only inside corners are where the work rests on the table".into(),
        (_, false) => "no inside corner is long and steady enough to be a seam".into(),
        _ => "there is no inside corner between two faces".into(),
    };
    found
}

/// Weldable seams of a mesh, from its facets; from the cloud on it only if that is a scan, drawn as a mesh.
pub fn find_in_mesh(input: &Input, mesh: &Mesh, base_from_mesh: &Isometry3<f64>, config: &Config) -> Found {
    let scores = edges::score(input.voxels, input.index, input.asymmetries);
    let found = facets::find(mesh, base_from_mesh);
    if found.seams.is_empty() && mesh.is_scan() {
        return find(input, config);
    }
    Found { gate: scores.gate, intensity: scores.intensity, ..found }
}

/// Corners off the table strung together. A cropped cloud has no table in it: its lowest plane is part of the work.
fn chains(
    input: &Input,
    off_table: &[corner::Corner],
    on_table: &[corner::Corner],
    model: &Grid,
    config: &chain::Config,
) -> Vec<chain::Chain> {
    let v = input.voxels.edge_mm;
    let trace =
        |corners: &[corner::Corner]| splice::joined(chain::trace(corners, model, v, config), model, v);
    let chains = trace(off_table);
    if chains.is_empty() && !input.whole_views() { trace(on_table) } else { chains }
}

/// A chain refined; closed where its ends ask for it and raw points bear it out.
fn measure(input: &Input, chain: &chain::Chain, model: &Grid, config: &Config) -> Option<refine::Refined> {
    let v = input.voxels.edge_mm;
    let refine = |chain: &chain::Chain| refine::refine(input.merged, input.raw, chain, v, &config.refine);
    let whole = loops::closed(chain, model, v, config.chain.step_voxels * v)
        .and_then(|chain| refine(&chain))
        .filter(|seam| longest_gap(&seam.measured) as f32 * seam.step_mm <= 2.0 * config.refine.gap * v);
    let mut refined = whole.or_else(|| refine(chain))?;
    // What shows through a wide root opening is not of the faces, and would pull them.
    let mut open = config.refine;
    for _ in 0..OPEN_ROUNDS {
        let Some(end_mm) = fitup::groove_end_mm(input, &refined) else { break };
        if end_mm < (open.acute_root + OPEN_VOXELS) * v {
            break;
        }
        open.acute_root = end_mm / v + OPEN_VOXELS;
        let Some(better) = refine::refine(input.merged, input.raw, chain, v, &open) else { break };
        refined = better;
    }
    Some(refined)
}

/// Strip of a bevel next to its end that is left out where the root is open wide, voxels, and how often its end is sought.
const OPEN_VOXELS: f32 = 0.4;
const OPEN_ROUNDS: usize = 3;

/// Seams by the second cue: plates on plates whose sides were not seen.
fn steps(input: &Input, table: Option<&support::Support>, model: &Grid, config: &Config) -> Vec<Seam> {
    let v = input.voxels.edge_mm;
    let cloud = &input.voxels.cloud;
    let corners = step::corners(cloud, &Grid::new(&cloud.points_mm, 4.0 * v), v, &config.step);
    let is_table = |c: &corner::Corner| table.is_some_and(|t| t.is_face(&c.faces[0], &c.position));
    let (on_table, off_table): (Vec<_>, Vec<_>) = corners.into_iter().partition(is_table);
    let chains = chains(input, &off_table, &on_table, model, &config.chain);
    let refine = |chain: &chain::Chain| {
        let scan = step::Scan { merged: input.merged, raw: input.raw, of_cameras: input.cameras_known };
        step::refine(&scan, chain, v, &config.refine, &config.step)
    };
    let measured = chains.par_iter().filter_map(|chain| Some((chain, refine(chain)?))).collect();
    let measured = overlap::apart(measured, v, config.chain.shortest_voxels * v);
    let seams = measured.iter().map(|(chain, refined)| {
        let seam = describe(input, chain, refined, model, config.refine.reach * v);
        Seam {
            joint: Joint::Lap,
            reason: format!("a step of {:.1} mm between parallel faces", refined.reach_mm[1]),
            dimensions: fitup::of_step(f64::from(refined.reach_mm[1]), seam.expected_error_mm),
            warnings: vec!["the side of the upper plate was not seen and is taken as square to it".into()],
            ..seam
        }
    });
    seams.filter(|seam| is_sure(seam) && seam.expected_error_mm < f64::from(v)).collect()
}

/// The candidates that pass the gate, moved onto the line in which their faces meet.
fn corners(input: &Input, scores: &edges::Scores, config: &corner::Config) -> Vec<corner::Corner> {
    let v = input.voxels.edge_mm;
    let radius = config.radius_voxels * v;
    let cloud = &input.voxels.cloud;
    let grid = Grid::new(&cloud.points_mm, 0.5 * radius);
    let normals = grid.by_slot(&cloud.normals);
    let candidates: Vec<usize> = (0..cloud.len())
        .filter(|&k| scores.intensity[k] > scores.gate && scores.concavity[k] > 0.5 * scores.gate)
        .collect();
    candidates
        .par_iter()
        .map_init(Vec::new, |near, &k| {
            let at = cloud.points_mm[k];
            corner::surroundings(&grid, &normals, &at, radius, near);
            let (mut found, foot) = corner::fit(near, v, config)?;
            found.position = at + foot;
            Some(found)
        })
        .flatten()
        .collect()
}

/// Error from the registration, in standard deviations of the points' noise, above which a seam carries a warning.
const LOOSE_NOISES: f64 = 0.38;
/// Least confidence, and largest expected error of the torch, with which a seam is offered.
const LEAST_CONFIDENCE: f64 = 0.6;
const MOST_ERROR_DEG: f64 = 6.0;
/// Largest expected error of the position of a seam that only the coarsest voxels show, in those.
const LAST_ERROR_VOXELS: f64 = 0.15;

fn is_sure(seam: &Seam) -> bool {
    seam.confidence >= LEAST_CONFIDENCE && seam.expected_error_deg <= MOST_ERROR_DEG
}

fn left_out(seam: &Seam) -> String {
    let place = seam.stations.get(seam.stations.len() / 2).map_or(Point3::origin(), |s| s.position_mm);
    format!(
        "an inside corner of {:.0} mm near {:.0},{:.0},{:.0} is too uncertain to weld (confidence {:.0} %, torch to {:.0} deg): \
         scan it again from nearer, or from more sides",
        seam.length_mm(),
        place.x,
        place.y,
        place.z,
        100.0 * seam.confidence,
        seam.expected_error_deg
    )
}

/// A refined chain as a seam.
fn describe(input: &Input, chain: &chain::Chain, seam: &refine::Refined, grid: &Grid, most_mm: f32) -> Seam {
    let section = joint::section(seam, input.model, grid, input.voxels.edge_mm, most_mm);
    let (joint, reason) = joint::classify(&section, seam.closed);
    let expected = expected::expect(seam, input.merged, input.registration);
    let evidence = fitup::Evidence {
        input,
        grid,
        seam,
        joint,
        short: section.short,
        reach_mm: section.reach_mm,
        expected: &expected,
    };
    let dimensions = fitup::measure(&evidence);
    let measured = seam.measured.iter().filter(|m| **m).count() as f64 / seam.measured.len() as f64;
    let density = chain.support as f64 / (3.0 * chain.links.len() as f64);
    let stations = seam
        .frames
        .iter()
        .map(|f| Station {
            position_mm: input.merged.origin_mm + f.position.coords.cast::<f64>(),
            tangent: f.tangent.cast(),
            faces: f.faces.map(|n| n.cast()),
        })
        .collect();
    let mut warnings = Vec::new();
    let bridged_mm = longest_gap(&seam.measured) as f64 * f64::from(seam.step_mm);
    if expected.registration_mm > LOOSE_NOISES * seam.sigma_mm {
        let views: Vec<&str> =
            expected.loose_views.iter().filter_map(|&k| input.names.get(k).copied()).collect();
        let d = expected.loosest;
        warnings.push(format!(
            "{} not tied down along ({:.2}, {:.2}, {:.2}) by surfaces that other views share: the seam may be off by {:.1} mm \
             there; add a view that sees those faces together with the first view's",
            if views.len() == 1 { format!("{} is", views[0]) } else { format!("{} are", views.join(", ")) },
            d.x,
            d.y,
            d.z,
            2.0 * expected.registration_mm
        ));
    }
    if bridged_mm > 4.0 {
        warnings.push(format!("{bridged_mm:.0} mm were bridged without points: scan that part again"));
    }
    Seam {
        id: 0,
        joint,
        reason,
        stations,
        closed: seam.closed,
        confidence: (measured * density.min(1.0) * f64::from(chain.share / 0.8).min(1.0)).clamp(0.0, 1.0),
        expected_error_mm: expected.position_mm,
        expected_error_deg: expected.orientation_rad.to_degrees(),
        dimensions,
        warnings,
    }
}

/// Most stations in a row that were not measured.
fn longest_gap(measured: &[bool]) -> usize {
    measured.split(|m| *m).map(<[bool]>::len).max().unwrap_or(0)
}

/// Open seams of which an end meets the ends of two others are branches.
fn mark_branches(seams: &mut [Seam], near_mm: f64) {
    let ends: Vec<Vec<Point3<f64>>> = seams
        .iter()
        .map(|s| match (s.closed, s.stations.first(), s.stations.last()) {
            (false, Some(a), Some(b)) => vec![a.position_mm, b.position_mm],
            _ => Vec::new(),
        })
        .collect();
    let meets = |k: usize, end: &Point3<f64>| {
        let near = |other: &Vec<Point3<f64>>| other.iter().any(|e| (e - end).norm() < near_mm);
        (0..ends.len()).filter(|&j| j != k && near(&ends[j])).count()
    };
    for (k, mine) in ends.iter().enumerate() {
        if let Some(others) = mine.iter().map(|e| meets(k, e)).max().filter(|&n| n >= 2) {
            let was = std::mem::replace(&mut seams[k].joint, Joint::Branch);
            seams[k].reason =
                format!("{}; meets {others} others in a junction ({})", seams[k].reason, was.name());
        }
    }
}

/// Longest first, then always the seam that begins or ends nearest to where the torch is; numbers them.
fn order(seams: &mut Vec<Seam>) {
    let mut left = std::mem::take(seams);
    left.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
    let mut torch: Option<Point3<f64>> = None;
    while !left.is_empty() {
        let ends = |s: &Seam| {
            let first = s.stations.first().map_or(Point3::origin(), |x| x.position_mm);
            let last = s.stations.last().map_or(first, |x| x.position_mm);
            (first, if s.closed { first } else { last })
        };
        let away = |s: &Seam| torch.map_or(0.0, |t| (ends(s).0 - t).norm().min((ends(s).1 - t).norm()));
        let next = (0..left.len()).min_by(|&a, &b| away(&left[a]).total_cmp(&away(&left[b]))).unwrap_or(0);
        let mut seam = left.remove(next);
        let (first, last) = ends(&seam);
        if torch.is_some_and(|t| (last - t).norm() < (first - t).norm()) {
            seam.stations.reverse();
            seam.stations.iter_mut().for_each(|s| s.tangent = -s.tangent);
        }
        torch = Some(ends(&seam).1);
        seam.id = seams.len() + 1;
        seams.push(seam);
    }
}
