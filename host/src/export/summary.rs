//! `summary.json`: what was found, how, and how far to trust it. Schema: `docs/formats.md`.

use serde::Serialize;

use super::feasibility;
use crate::coverage::Gap;
use crate::feasibility::Report;
use crate::pipeline::{Derived, Plan, ViewReport};
use crate::seam::{Joint, Seam};
use crate::toolpath::SeamPath;

/// Value of `version`; raised when a reader of the old one would misunderstand the new one.
pub const VERSION: u32 = 1;

/// The whole file.
#[derive(Debug, Serialize)]
pub struct Summary {
    format: &'static str,
    version: u32,
    weldpath: &'static str,
    #[serde(flatten)]
    source: Source,
    derived: Vec<Parameter>,
    views: Vec<View>,
    seams: Vec<SeamSummary>,
    coverage: Vec<Stretch>,
    stages: Vec<Stage>,
    feasibility: Option<feasibility::Section>,
    warnings: Vec<String>,
}

/// What was read, and how it was understood.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Source {
    /// Files, in the order of reading.
    pub inputs: Vec<String>,
    /// How they were understood, in words.
    pub notes: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Parameter {
    name: &'static str,
    value: Option<f64>,
    how: &'static str,
}

#[derive(Debug, Serialize)]
struct View {
    name: String,
    fitness_before: Option<f64>,
    fitness_after: Option<f64>,
    fitness_per_iteration: Vec<Option<f64>>,
    moved_mm: Option<f64>,
    moved_deg: Option<f64>,
    uncertainty_mm: Option<f64>,
}

#[derive(Debug, Serialize)]
struct SeamSummary {
    id: usize,
    joint: Joint,
    selected: bool,
    closed: bool,
    length_mm: f64,
    points: usize,
    confidence: Option<f64>,
    expected_error_mm: Option<f64>,
    expected_error_deg: Option<f64>,
    reason: String,
    warnings: Vec<String>,
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

#[derive(Debug, Serialize)]
struct Stage {
    name: &'static str,
    time_s: f64,
}

impl Summary {
    /// Of a plan: `paths` are those of the seams that were selected, as they are written.
    pub fn new(plan: &Plan, source: Source, paths: &[SeamPath], warnings: Vec<String>) -> Self {
        Self {
            format: "weldpath-summary",
            version: VERSION,
            weldpath: env!("CARGO_PKG_VERSION"),
            source,
            derived: plan.derived.iter().map(parameter).collect(),
            views: plan.views.iter().map(view).collect(),
            seams: plan.seams.iter().map(|seam| seam_summary(seam, paths)).collect(),
            coverage: plan.coverage.iter().map(stretch).collect(),
            stages: plan.stage_s.iter().map(|&(name, time_s)| Stage { name, time_s }).collect(),
            feasibility: None,
            warnings,
        }
    }

    /// The same with what became of the feasibility check, if there was one.
    #[must_use]
    pub fn with_feasibility(self, report: Option<&Report>) -> Self {
        Self { feasibility: report.map(feasibility::Section::new), ..self }
    }

    /// What the user should know about the run; what concerns one seam stands there.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The file's text.
    pub fn to_json(&self) -> String {
        // Strings, numbers and lists only: there is nothing serde_json could refuse.
        serde_json::to_string_pretty(self).map(|text| text + "\n").unwrap_or_default()
    }
}

fn parameter(derived: &Derived) -> Parameter {
    Parameter { name: derived.name, value: finite(derived.value), how: derived.how }
}

fn view(report: &ViewReport) -> View {
    View {
        name: report.name.clone(),
        fitness_before: finite(report.fitness_before),
        fitness_after: finite(report.fitness_after),
        fitness_per_iteration: report.fitness_per_iteration.iter().copied().map(finite).collect(),
        moved_mm: finite(report.moved_mm),
        moved_deg: finite(report.moved_deg),
        uncertainty_mm: finite(report.uncertainty_mm),
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

fn seam_summary(seam: &Seam, paths: &[SeamPath]) -> SeamSummary {
    let path = paths.iter().find(|path| path.seam == seam.id);
    SeamSummary {
        id: seam.id,
        joint: seam.joint,
        selected: path.is_some(),
        closed: seam.closed,
        length_mm: seam.length_mm(),
        points: path.map_or(0, |path| path.points.len()),
        confidence: finite(seam.confidence),
        expected_error_mm: finite(seam.expected_error_mm),
        expected_error_deg: finite(seam.expected_error_deg),
        reason: seam.reason.clone(),
        warnings: seam.warnings.clone(),
    }
}

/// JSON has no infinity: what is unbounded is `null`.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
