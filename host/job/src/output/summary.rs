//! `summary.json`: what was found, how, and how far to trust it. Schema: `docs/formats.md`.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::Serialize;

use super::base_frame::BaseFrameSummary;
use super::frame::PathFrame;
use super::verdict::{Finding, Verdict};
use super::{feasibility, views};
use crate::robot::feasibility::Report;
use nalgebra::UnitVector3;
use weldpath_method::pipeline::tacks::Tack;
use weldpath_method::pipeline::touch::{Residual, Touched};
use weldpath_method::pipeline::{self, Plan, ViewReport};
use weldpath_method::seam::measure::coverage::{Gap, OneSided};
use weldpath_method::seam::measure::dimension::Dimension;
use weldpath_method::seam::{ErrorParts, Joint, Seam, Unwelded, WhyUnwelded};
use weldpath_method::weld::SeamPath;
use weldpath_method::weld::position::{Position, positions};

/// Name of the file within a run's folder.
pub const FILE: &str = "summary.json";
/// Value of `version`; raised when a reader of the old one would misunderstand the new one.
pub const VERSION: u32 = 1;

/// Note of a seam whose direction was free.
const DOWNHILL: &str = "welded downhill (PG), because the job states no direction: direction = \"up\" in \
                        [path], or for this seam alone, welds it uphill";

/// The whole file.
#[derive(Debug, Serialize)]
pub struct Summary {
    format: &'static str,
    version: u32,
    weldpath: &'static str,
    #[serde(flatten)]
    source: Source,
    verdict: Verdict,
    derived: Vec<Parameter>,
    views: Vec<View>,
    base_frame: BaseFrameSummary,
    touch: Option<TouchSummary>,
    seams: Vec<SeamSummary>,
    unwelded: Vec<UnweldedSummary>,
    coverage: Vec<Stretch>,
    tacks: Vec<TackSummary>,
    stages: Vec<Stage>,
    feasibility: Option<feasibility::FeasibilitySummary>,
    warnings: Vec<String>,
}

/// What was read, and how it was understood.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Source {
    /// Files, in the order of reading.
    pub inputs: Vec<String>,
    /// Whose frame all poses and positions are in.
    pub frame: PathFrame,
    /// How they were understood, in words.
    pub notes: Vec<String>,
    /// What speaks against them; the verdict tells it.
    #[serde(skip)]
    pub findings: Vec<Finding>,
}

/// What points that the tip touched made of the plan.
#[derive(Debug, Serialize)]
struct TouchSummary {
    shift_mm: [f64; 3],
    turn_deg: f64,
    touches: Vec<TouchRow>,
}

#[derive(Debug, Serialize)]
struct TouchRow {
    seam: usize,
    before_mm: f64,
    after_mm: f64,
}

#[derive(Debug, Serialize)]
struct Parameter {
    name: Cow<'static, str>,
    value: Option<f64>,
    how: String,
}

#[derive(Debug, Serialize)]
struct View {
    name: String,
    left_out: Option<String>,
    position_mm: [f64; 3],
    base_from_camera_wxyz: [f64; 4],
    fitness_before: Option<f64>,
    fitness_after: Option<f64>,
    fitness_per_iteration: Vec<Option<f64>>,
    moved_mm: Option<f64>,
    moved_deg: Option<f64>,
    uncertainty_mm: Option<f64>,
    uncertainty_deg: Option<f64>,
}

#[derive(Debug, Serialize)]
struct SeamSummary {
    id: usize,
    joint: Joint,
    selected: bool,
    closed: bool,
    length_mm: f64,
    points: usize,
    passes: usize,
    order: Option<usize>,
    positions: Vec<Position>,
    confidence: Option<f64>,
    expected_error_mm: Option<f64>,
    expected_error_deg: Option<f64>,
    relative_mm: Option<f64>,
    error_parts_mm: ErrorPartsSummary,
    dimensions: Vec<Measured>,
    one_side: Option<OneSide>,
    reason: String,
    notes: Vec<String>,
    warnings: Vec<String>,
}

/// What no view shows of the upright plate of a T, and from where to see it.
#[derive(Debug, Serialize)]
struct OneSide {
    face_normal: [f64; 3],
    camera_position_mm: [f64; 3],
    camera_direction: [f64; 3],
}

/// An inside corner that is seen and is no seam.
#[derive(Debug, Serialize)]
struct UnweldedSummary {
    id: usize,
    line_mm: Vec<[f64; 3]>,
    length_mm: f64,
    reason: WhyUnwelded,
    words: String,
}

/// What the expected error of a seam comes from.
#[derive(Debug, Serialize)]
struct ErrorPartsSummary {
    noise: Option<f64>,
    registration: Option<f64>,
    calibration: Option<f64>,
    corner: Option<f64>,
    touch: Option<f64>,
}

/// A dimension of a joint, or why it could not be measured.
#[derive(Debug, Serialize)]
struct Measured {
    name: &'static str,
    value: Option<f64>,
    uncertainty: Option<f64>,
    reason: Option<Cow<'static, str>>,
}

/// A stretch of a seam that should be scanned again, and from where.
#[derive(Debug, Serialize)]
struct Stretch {
    seam: usize,
    fault: &'static str,
    from_mm: f64,
    to_mm: f64,
    face_normal: [f64; 3],
    camera_position_mm: [f64; 3],
    camera_direction: [f64; 3],
}

/// Where a seam is tacked.
#[derive(Debug, Serialize)]
struct TackSummary {
    seam: usize,
    from_mm: f64,
    to_mm: f64,
    height_mm: f64,
}

#[derive(Debug, Serialize)]
struct Stage {
    name: Cow<'static, str>,
    time_s: f64,
}

impl Summary {
    /// Of a plan: `lines` are the seams that were selected, in weld order and direction, `paths` their passes as they
    /// are written, `up` is against gravity.
    pub fn new(
        plan: &Plan,
        source: Source,
        lines: &[SeamPath],
        paths: &[SeamPath],
        up: UnitVector3<f64>,
        warnings: Vec<String>,
    ) -> Self {
        Self {
            format: "weldpath-summary",
            version: VERSION,
            weldpath: env!("CARGO_PKG_VERSION"),
            source,
            verdict: Verdict::default(),
            derived: plan.derived.parameters.iter().map(parameter).collect(),
            views: plan.derived.views.iter().map(view).collect(),
            base_frame: BaseFrameSummary::new(plan),
            touch: plan.derived.touch.as_ref().map(touch),
            seams: seams_of(plan, lines, paths, up),
            unwelded: (1..).zip(&plan.unwelded).map(|(id, line)| unwelded(id, line)).collect(),
            coverage: plan.coverage.iter().map(stretch).collect(),
            tacks: plan.tacks.iter().map(tack).collect(),
            stages: plan
                .derived
                .stage_s
                .iter()
                .map(|(name, time_s)| Stage { name: name.clone(), time_s: *time_s })
                .collect(),
            feasibility: None,
            warnings,
        }
    }

    /// The same with the joint types that the user states, by the ids of their seams.
    #[must_use]
    pub(crate) fn with_joints(
        mut self,
        plan: &Plan,
        stated: &BTreeMap<usize, Joint>,
        lines: &[SeamPath],
        up: UnitVector3<f64>,
    ) -> Self {
        for (own, found) in self.seams.iter_mut().zip(&plan.seams) {
            let Some(joint) = stated.get(&own.id).filter(|joint| **joint != found.joint) else { continue };
            let reason = format!(
                "{} as stated in the job; detected and measured as {}: {}",
                joint.name(),
                found.joint.name(),
                found.reason
            );
            let corrected = Seam { joint: *joint, reason, ..found.clone() };
            let SeamSummary { joint, positions, reason, .. } = seam_summary(&corrected, lines, &[], up);
            (own.joint, own.positions, own.reason) = (joint, positions, reason);
        }
        self
    }

    /// Joint type of the seam with this id.
    pub fn joint(&self, id: usize) -> Option<Joint> {
        self.seams.iter().find(|seam| seam.id == id).map(|seam| seam.joint)
    }

    /// The same with a note for each of these seams that is welded downhill, since nobody said which way.
    #[must_use]
    pub(crate) fn with_downhill(mut self, free: &[usize]) -> Self {
        let falls =
            |seam: &&mut SeamSummary| free.contains(&seam.id) && seam.positions.contains(&Position::PG);
        for seam in self.seams.iter_mut().filter(falls) {
            seam.notes.push(DOWNHILL.into());
        }
        self
    }

    /// The same with what became of the feasibility check, if there was one.
    #[must_use]
    pub(crate) fn with_feasibility(self, report: Option<&Report>) -> Self {
        Self { feasibility: report.map(feasibility::FeasibilitySummary::new), ..self }
    }

    /// The same with the verdict.
    #[must_use]
    pub fn with_verdict(self, verdict: Verdict) -> Self {
        Self { verdict, ..self }
    }

    /// Whether the program may be run.
    pub fn verdict(&self) -> &Verdict {
        &self.verdict
    }

    /// What the user should know about the run; what concerns one seam stands there.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Whose frame all poses and positions are in.
    pub fn frame(&self) -> PathFrame {
        self.source.frame
    }

    /// Welding positions of the seam with this id.
    pub fn positions(&self, id: usize) -> &[Position] {
        self.seams.iter().find(|seam| seam.id == id).map_or(&[], |seam| &seam.positions)
    }

    /// What is worth knowing of the seam with this id.
    pub fn notes(&self, id: usize) -> &[String] {
        self.seams.iter().find(|seam| seam.id == id).map_or(&[], |seam| &seam.notes)
    }

    /// The file's text.
    pub fn to_json(&self) -> String {
        // Strings, numbers and lists only: there is nothing serde_json could refuse.
        serde_json::to_string_pretty(self).map(|text| text + "\n").unwrap_or_default()
    }
}

fn parameter(derived: &pipeline::Parameter) -> Parameter {
    Parameter { name: derived.name.clone(), value: finite(derived.value), how: derived.how.clone() }
}

fn view(report: &ViewReport) -> View {
    View {
        name: report.name.clone(),
        left_out: report.left_out.clone(),
        position_mm: views::position_mm(&report.base_from_camera),
        base_from_camera_wxyz: views::wxyz(&report.base_from_camera),
        fitness_before: finite(report.fitness_before),
        fitness_after: finite(report.fitness_after),
        fitness_per_iteration: report.fitness_per_iteration.iter().copied().map(finite).collect(),
        moved_mm: finite(report.moved_mm),
        moved_deg: finite(report.moved_deg),
        uncertainty_mm: finite(report.uncertainty_mm),
        uncertainty_deg: finite(report.uncertainty_deg),
    }
}

fn stretch(gap: &Gap) -> Stretch {
    Stretch {
        seam: gap.seam,
        fault: gap.fault.name(),
        from_mm: gap.from_mm,
        to_mm: gap.to_mm,
        face_normal: gap.face.into(),
        camera_position_mm: gap.view.position_mm.coords.into(),
        camera_direction: gap.view.direction.into(),
    }
}

fn touch(touched: &Touched) -> TouchSummary {
    let row = |r: &Residual| TouchRow { seam: r.seam, before_mm: r.before_mm, after_mm: r.after_mm };
    TouchSummary {
        shift_mm: touched.shift_mm.into(),
        turn_deg: touched.turn_deg,
        touches: touched.residuals.iter().map(row).collect(),
    }
}

fn seams_of(plan: &Plan, lines: &[SeamPath], paths: &[SeamPath], up: UnitVector3<f64>) -> Vec<SeamSummary> {
    let one_sided = |id: usize| plan.one_sided.iter().find(|one| one.seam == id);
    let summary = |seam: &Seam| SeamSummary {
        one_side: one_sided(seam.id).map(one_side),
        notes: one_sided(seam.id).map(OneSided::words).into_iter().collect(),
        ..seam_summary(seam, lines, paths, up)
    };
    plan.seams.iter().map(summary).collect()
}

fn one_side(one: &OneSided) -> OneSide {
    OneSide {
        face_normal: one.face.into(),
        camera_position_mm: one.view.position_mm.coords.into(),
        camera_direction: one.view.direction.into(),
    }
}

fn seam_summary(seam: &Seam, lines: &[SeamPath], paths: &[SeamPath], up: UnitVector3<f64>) -> SeamSummary {
    let passes = || paths.iter().filter(|path| path.seam == seam.id);
    let welded = |path: &SeamPath| path.points.iter().filter(|point| point.process.weld).count();
    let order = lines.iter().position(|path| path.seam == seam.id);
    let found = SeamPath::along(seam);
    let line = order.map_or(&found, |k| &lines[k]);
    SeamSummary {
        id: seam.id,
        joint: seam.joint,
        selected: order.is_some(),
        closed: seam.closed,
        length_mm: seam.length_mm(),
        points: passes().map(welded).sum(),
        passes: passes().count(),
        order: order.map(|k| k + 1),
        positions: positions(line, up, seam.joint.is_butt()),
        confidence: finite(seam.confidence),
        expected_error_mm: finite(seam.tip_error_mm()),
        expected_error_deg: finite(seam.tip_error_deg()),
        relative_mm: finite(seam.relative_error_mm),
        error_parts_mm: error_parts(seam.error_parts),
        dimensions: seam.dimensions.iter().map(measured).collect(),
        one_side: None,
        reason: seam.reason.clone(),
        notes: Vec::new(),
        warnings: seam.warnings.clone(),
    }
}

fn unwelded(id: usize, line: &Unwelded) -> UnweldedSummary {
    let round = |v: f64| (100.0 * v).round() / 100.0;
    UnweldedSummary {
        id,
        line_mm: line.line_mm.iter().map(|p| [p.x, p.y, p.z].map(round)).collect(),
        length_mm: round(line.length_mm()),
        reason: line.reason,
        words: line.words.clone(),
    }
}

fn tack(tack: &Tack) -> TackSummary {
    let Tack { seam, from_mm, to_mm, height_mm } = *tack;
    TackSummary { seam, from_mm, to_mm, height_mm }
}

fn error_parts(parts: ErrorParts) -> ErrorPartsSummary {
    ErrorPartsSummary {
        noise: finite(parts.noise_mm),
        registration: finite(parts.registration_mm),
        calibration: finite(parts.calibration_mm),
        corner: finite(parts.corner_mm),
        touch: finite(parts.touch_mm),
    }
}

fn measured(dimension: &Dimension) -> Measured {
    let value = dimension.value.as_ref().ok();
    Measured {
        name: dimension.quantity.name(),
        value: value.and_then(|v| finite(v.value)),
        uncertainty: value.and_then(|v| finite(v.uncertainty)),
        reason: dimension.value.as_ref().err().cloned(),
    }
}

/// JSON has no infinity: what is unbounded is `null`.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
