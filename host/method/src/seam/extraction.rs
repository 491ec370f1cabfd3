//! Seams of a cloud (paper II-E, and beyond it: several seams, types, order, accuracy below the voxel).
//!
//! Scores tell the candidates, two faces are fitted about each, and the corners in which they meet are strung together;
//! each chain is refined on the raw points and measured. Where that finds nothing, other cues are tried if asked for.

use super::description::{Identity, described, is_sure, left_out};
use super::implied;
use super::input::Input;
use super::measure::dimension::Quantity;
use super::measure::{fitup, grip, joint, resting};
use super::ordering::{mark_branches, order};
use super::refine::{RefineConfig, Refined, bend, expected, layers, overlap, rounds};
use super::rounded;
use super::score::edges;
use super::trace::chain::{self, TraceConfig, Traced};
use super::trace::corner::{self, CornerConfig};
use super::trace::step::{self, StepConfig, StepModel};
use super::trace::support::{self, Support};
use super::trace::{Chain, InsideCorner, loops, splice};
use super::unwelded::{self, Unwelded, WhyUnwelded};
use super::{Found, Joint, Seam, Station, facets};
use crate::geometry::mesh::Mesh;
use nalgebra::Isometry3;
use rayon::prelude::*;

/// Settings of the steps from cloud to seams, in their order.
#[derive(Debug, Clone, Default)]
pub struct SeamConfig {
    /// Two faces about a candidate.
    pub corner: CornerConfig,
    /// Stringing corners together.
    pub trace: TraceConfig,
    /// Refinement on the raw points.
    pub refine: RefineConfig,
    /// Steps between parallel layers.
    pub step: StepConfig,
}

/// Largest expected error of the position of a seam that was traced as a blurred valley, voxels. Chosen on the simulated
/// scans.
const BLURRED_ERROR_VOXELS: f64 = 0.15;
/// Largest expected error of the position of a step, voxels.
pub(super) const STEP_ERROR_VOXELS: f64 = 1.0;
/// A lap and a step nearer to each other than this are one seam, voxels: a thin side leaves its foot this uncertain.
const NEAR_VOXELS: f64 = 3.0;
/// Sides of plates that are narrower are of sheet, voxels: those at both edges hold points of other faces, and normals are taken
/// over three.
const NARROW_VOXELS: f64 = 4.0;
/// Ends of seams that are no farther apart meet in a junction, voxels.
const JUNCTION_VOXELS: f64 = 6.0;
/// Longest stretch without points in an arc that closes a loop, in the longest that is bridged elsewhere.
const LOOP_GAPS: f32 = 2.0;
/// Strip of a bevel next to its end that is left out where the root is open wide, voxels, and how often its end is sought.
/// Chosen on the simulated scans.
const OPEN_VOXELS: f32 = 0.4;
const OPEN_ROUNDS: usize = 3;

/// Weldable seams of a cloud.
pub fn find(input: &Input, config: &SeamConfig) -> Found {
    let v = input.model.voxel_mm();
    let scores = edges::score(&input.model);
    let support = support::find(input.scene, input.scan.table_edge());
    let table = support.filter(|support| support.is_table(&input.scan));
    let corner_config = config.corner.for_scan(&input.scan);
    let corners = Corners::parted(corner::corners(&input.model, &scores, &corner_config), |c| {
        table.is_some_and(|t| c.faces.iter().any(|face| t.is_face(face, &c.position)))
    });
    let found = corner_seams(input, &corners, config);
    let most_error_mm = if input.cues.blurred { BLURRED_ERROR_VOXELS * f64::from(v) } else { f64::INFINITY };
    let joints = implied::joints(input.faces(), v, table.as_ref());
    let Judged { mut seams, mut unsure, rounded } = Judged::of(found, input, most_error_mm, &joints, config);
    let is_lap = |seam: &Seam| seam.joint == Joint::Lap;
    if input.cues.steps && ((seams.is_empty() && rounded.is_empty()) || seams.iter().any(is_lap)) {
        let mut steps = step_seams(input, table.as_ref(), config);
        if !seams.is_empty() {
            steps.retain(|step| {
                is_elsewhere(step, &seams, v) || is_better(step, seams.iter().filter(|seam| is_lap(seam)), v)
            });
        }
        for worse in [&mut seams, &mut unsure] {
            worse.retain(|seam| !is_lap(seam) || !steps.iter().any(|step| is_beside(seam, step, v)));
        }
        seams.append(&mut steps);
    }
    let feet = resting::take_feet(&mut seams, table.as_ref(), input);
    mark_branches(&mut seams, JUNCTION_VOXELS * f64::from(v));
    order(&mut seams);
    let on_table = corners.on_table.iter().map(|corner| corner.position);
    grip::mark_contacts(&mut seams, &corners.off_table, on_table, &input.model);
    if let Some(support) = support.filter(|_| input.scan.is_one_view()) {
        resting::mark_resting(&mut seams, &support, input);
    }
    if input.scan.cameras_known {
        resting::mark_lying(&mut seams, table.as_ref(), input);
    }
    let warnings = unsure.iter().map(left_out).collect();
    let unsure_lines = unsure.iter().map(|seam| Unwelded::of(seam, WhyUnwelded::Unsure, left_out(seam)));
    let unsure_lines = unsure_lines.chain(feet).chain(rounded);
    let lines = unsure_lines.chain(corners.unwelded(input, &config.trace)).collect();
    let implied = joints.iter().map(|joint| joint.unwelded(&input.scan.merged.origin_mm)).collect();
    let waves_mm = if seams.is_empty() { 0.0 } else { input.waves().height_mm };
    let unwelded = unwelded::told(lines, implied, &seams, f64::from(v));
    let reason = unsure.first().map(left_out);
    // The table is the last thing that a reader asks about.
    let told = unwelded.iter().min_by_key(|line| line.reason == WhyUnwelded::Table);
    let reason = reason.or_else(|| told.map(|line| line.words.clone()));
    Found {
        seams,
        reason: reason.unwrap_or_else(|| corners.reason().into()),
        warnings,
        unwelded,
        table,
        waves_mm,
        gate: scores.gate,
        intensity: scores.intensity,
        ..Found::default()
    }
}

/// Seams by whether they are offered.
#[derive(Default)]
struct Judged {
    seams: Vec<Seam>,
    /// Too uncertain.
    unsure: Vec<Seam>,
    /// Joints that are rounded and not seen well enough to be seams.
    rounded: Vec<Unwelded>,
}

impl Judged {
    /// Of seams, and whether one view alone saw a face of them.
    fn of(
        found: Vec<(Seam, bool)>,
        input: &Input,
        most_error_mm: f64,
        joints: &[implied::Joint],
        config: &SeamConfig,
    ) -> Self {
        let mut judged = Self::default();
        let mut edges = Vec::new();
        for (seam, is_seen_alone) in found {
            let is_sure =
                is_sure(&input.scan, &seam, is_seen_alone) && seam.fit_error.position_mm < most_error_mm;
            match is_sure.then(|| rounded::joint_of(&seam, joints, input)) {
                None => judged.unsure.push(seam),
                Some(Some(joint)) => edges.push((joint, seam)),
                Some(None) => judged.seams.push(seam),
            }
        }
        edges.sort_by_key(|(joint, _)| *joint);
        for edges in edges.chunk_by(|a, b| a.0 == b.0) {
            let seams: Vec<&Seam> = edges.iter().map(|(_, seam)| seam).collect();
            match rounded::seam_in(&joints[edges[0].0], &seams, input, config) {
                Ok(seam) => {
                    let free = rounded::free_of(&judged.seams, &seam, input);
                    judged.seams.extend(free);
                }
                Err(line) => judged.rounded.push(line),
            }
        }
        judged
    }
}

/// Weldable seams of a mesh, from its facets.
pub(crate) fn find_in_mesh(input: &Input, mesh: &Mesh, base_from_mesh: &Isometry3<f64>) -> Found {
    let found = facets::find(mesh, base_from_mesh);
    let scores = edges::score(&input.model);
    Found { gate: scores.gate, intensity: scores.intensity, ..found }
}

/// Inside corners by whether one of their faces is the table.
struct Corners {
    off_table: Vec<InsideCorner>,
    on_table: Vec<InsideCorner>,
}

impl Corners {
    fn parted(corners: Vec<InsideCorner>, is_on_table: impl Fn(&InsideCorner) -> bool) -> Self {
        let (on_table, off_table) = corners.into_iter().partition(is_on_table);
        Self { off_table, on_table }
    }

    /// Corners off the table strung together. Where there are none, that on which all lie may be part of the work: a cropped cloud has no
    /// table in it, and without cameras nothing tells a table from a plate.
    fn chains(&self, input: &Input, config: &TraceConfig) -> Vec<Chain> {
        let chains = traced(input, &self.off_table, config);
        if chains.is_empty() && !(input.scan.cameras_known && input.scan.has_whole_views()) {
            traced(input, &self.on_table, config)
        } else {
            chains
        }
    }

    /// Corners that may have made no seam.
    fn unwelded(&self, input: &Input, config: &TraceConfig) -> Vec<Unwelded> {
        let origin_mm = input.scan.merged.origin_mm;
        let config = config.faint();
        let lines = |corners: &[InsideCorner], reason| {
            let mut chains = traced(input, corners, &config);
            chains.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
            chains.into_iter().map(move |chain| Unwelded::of_chain(&chain, &origin_mm, reason))
        };
        let unsure = lines(&self.off_table, WhyUnwelded::Unsure);
        unsure.chain(lines(&self.on_table, WhyUnwelded::Table)).collect()
    }

    /// Why they make no seam.
    fn reason(&self) -> &'static str {
        match (self.on_table.is_empty(), self.off_table.is_empty()) {
            (false, true) => "the only inside corners are where the work rests on the table",
            (_, false) => "no inside corner is long and steady enough to be a seam",
            _ => "there is no inside corner between two faces",
        }
    }
}

pub(super) fn traced(input: &Input, corners: &[InsideCorner], config: &TraceConfig) -> Vec<Chain> {
    let (model, voxel_mm) = (input.model.index, input.model.voxel_mm());
    let Traced { chains, short } = chain::trace(corners, model, voxel_mm, config);
    let chains = splice::joined(chains, model, voxel_mm);
    let round_corners = splice::round_corners(short, &chains, voxel_mm);
    chains.into_iter().chain(round_corners).collect()
}

/// Seams where two faces meet in an inside corner, sure or not, and whether one view alone saw a face of them.
fn corner_seams(input: &Input, corners: &Corners, config: &SeamConfig) -> Vec<(Seam, bool)> {
    let mut chains = corners.chains(input, &config.trace);
    if chains.is_empty() && input.cues.blurred {
        chains = traced(input, &corners.off_table, &config.trace.blurred());
    }
    let refined = refined_apart(input, &chains, config, |chain| refined(input, chain, config));
    let refined = refined.into_iter().map(|(chain, seam)| (chain.clone(), seam)).collect();
    let refined = bend::joined(refined, input.model.index, input.model.voxel_mm());
    let most_mm = config.refine.reach * input.model.voxel_mm();
    let seam = |(chain, seam): &(Chain, Refined)| {
        (corner_seam(input, chain, seam, most_mm), expected::is_seen_alone(seam))
    };
    refined.iter().map(seam).collect()
}

/// Every chain refined, each stretch of corner in one of them only.
fn refined_apart<'a>(
    input: &Input,
    chains: &'a [Chain],
    config: &SeamConfig,
    refine: impl Fn(&Chain) -> Option<Refined> + Sync,
) -> Vec<(&'a Chain, Refined)> {
    let v = input.model.voxel_mm();
    let refined = chains.par_iter().filter_map(|chain| Some((chain, refine(chain)?))).collect();
    overlap::apart(refined, v, config.trace.shortest_voxels * v)
}

/// A chain refined; closed where its ends ask for it and raw points bear it out.
pub(super) fn refined(input: &Input, chain: &Chain, config: &SeamConfig) -> Option<Refined> {
    let v = input.model.voxel_mm();
    let refine = |chain: &Chain| rounds::refine(&input.scan, chain, v, &config.refine);
    let whole = loops::closed(chain, input.model.index, v, config.trace.step_voxels * v)
        .and_then(|chain| refine(&chain))
        .filter(|seam| seam.longest_gap() as f32 * seam.step_mm <= LOOP_GAPS * config.refine.gap * v);
    let mut refined = whole.or_else(|| refine(chain))?;
    // What shows through a wide root opening is not of the faces, and would pull them.
    let mut open = config.refine;
    for _ in 0..OPEN_ROUNDS {
        let Some(end_mm) = fitup::groove_end_mm(input, &refined) else { break };
        if end_mm < (open.acute_root + OPEN_VOXELS) * v {
            break;
        }
        open.acute_root = end_mm / v + OPEN_VOXELS;
        let Some(better) = rounds::refine(&input.scan, chain, v, &open) else { break };
        refined = better;
    }
    Some(refined)
}

/// A refined chain of inside corners, its joint told apart and measured.
pub(super) fn corner_seam(input: &Input, chain: &Chain, seam: &Refined, most_mm: f32) -> Seam {
    let cross_section = joint::cross_section(seam, &input.model, most_mm);
    let (joint, reason) = joint::classify(&cross_section, seam.closed);
    let expected = expected::expect(seam, &input.scan, input.waves());
    let evidence = fitup::JointEvidence {
        input,
        seam,
        joint,
        short: cross_section.short,
        reach_mm: cross_section.reach_mm,
        expected: &expected,
    };
    let dimensions = fitup::measure(&evidence);
    described(&input.scan, chain, seam, &expected, Identity { joint, reason, dimensions })
}

/// Whether the step at the place of some laps shows them better.
fn is_better<'a>(step: &Seam, laps: impl Iterator<Item = &'a Seam>, voxel_mm: f32) -> bool {
    let mut beside = laps.filter(|lap| is_beside(lap, step, voxel_mm)).peekable();
    beside.peek().is_some() && beside.all(|lap| shows_better(step, lap, voxel_mm))
}

/// Whether a step shows the lap at its place better: the side of a thin sheet is narrow to fit a face to, its edge is not.
pub(super) fn shows_better(step: &Seam, lap: &Seam, voxel_mm: f32) -> bool {
    let heights = step.dimensions.iter().filter(|d| d.quantity == Quantity::SheetThickness);
    let height_mm = heights.filter_map(|d| d.value.as_ref().ok()).map(|height| height.value).sum::<f64>();
    height_mm < NARROW_VOXELS * f64::from(voxel_mm) && step.fit_error.position_mm < lap.fit_error.position_mm
}

/// Whether most of a lap runs beside a step.
fn is_beside(lap: &Seam, step: &Seam, voxel_mm: f32) -> bool {
    2 * beside(lap, std::slice::from_ref(step), voxel_mm) > lap.stations.len()
}

/// Whether a third or more of a step is where no seam is.
fn is_elsewhere(step: &Seam, seams: &[Seam], voxel_mm: f32) -> bool {
    3 * beside(step, seams, voxel_mm) < 2 * step.stations.len()
}

/// How many stations of a seam are beside others.
fn beside(seam: &Seam, others: &[Seam], voxel_mm: f32) -> usize {
    let near_mm = NEAR_VOXELS * f64::from(voxel_mm);
    let near = |a: &Station, b: &Station| (b.position_mm - a.position_mm).norm() < near_mm;
    let is_near = |a: &&Station| others.iter().any(|other| other.stations.iter().any(|b| near(a, b)));
    seam.stations.iter().filter(is_near).count()
}

/// Seams by the second cue: plates and sheets on others, whose sides were not seen or are too narrow.
fn step_seams(input: &Input, table: Option<&Support>, config: &SeamConfig) -> Vec<Seam> {
    let v = input.model.voxel_mm();
    let model = StepModel::new(&input.model.voxels.cloud, v);
    let seams = |layers: &StepConfig| {
        let corners = Corners::parted(step::corners(&model, layers), |c| {
            table.is_some_and(|t| t.is_face(&c.faces[0], &c.position))
        });
        let chains = corners.chains(input, &config.trace);
        let refine = |chain: &Chain| layers::refine(&input.scan, chain, v, &config.refine, layers);
        let refined = refined_apart(input, &chains, config, refine);
        let mut seams: Vec<Seam> =
            refined.iter().map(|(chain, seam)| step_seam(input, chain, seam)).collect();
        seams.retain(|seam| {
            is_sure(&input.scan, seam, false) && seam.fit_error.position_mm < STEP_ERROR_VOXELS * f64::from(v)
        });
        seams
    };
    if !shows_sheets(input) {
        return seams(&config.step);
    }
    let sheets = seams(&config.step.for_layers_of(&model));
    if sheets.is_empty() { seams(&config.step) } else { sheets }
}

/// Whether layers as near to each other as those of sheet may be told apart: one view alone shows no layer twice, and where no
/// camera tells what hides what, a model's hidden faces are in the cloud, too.
pub(super) fn shows_sheets(input: &Input) -> bool {
    input.scan.is_seen_from_several()
}

/// A refined chain at the foot of a step.
pub(super) fn step_seam(input: &Input, chain: &Chain, seam: &Refined) -> Seam {
    let height_mm = seam.reach_mm[1];
    let expected = expected::expect(seam, &input.scan, input.waves());
    let identity = Identity {
        joint: Joint::Lap,
        reason: format!("a step of {height_mm:.1} mm between parallel faces"),
        dimensions: fitup::of_step(f64::from(height_mm), expected.position_mm),
    };
    Seam {
        warnings: vec!["the side of the upper plate was not seen and is taken as square to it".into()],
        ..described(&input.scan, chain, seam, &expected, identity)
    }
}
