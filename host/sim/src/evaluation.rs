//! How good a path is, as the paper's section III measures it: F1, eq. (21), and RMSE, eq. (22). The fitness of eq. (20) is
//! measured where views are registered, [`weldpath_method::model::reconstruction::fitness`].
//!
//! The arithmetic of [`score`] is ours, since the paper's `m_i - g_i` needs equal counts and order ([`paper_rmse`]):
//! lateral distance to the true seam, geodesic angle of the torch, covered share of the visible seam, share of path
//! points that belong to no seam. Millimetres and degrees; base frame; torch frame `(o, m, n)`, `n` out of the work.

mod alignment;
mod deviation;
mod paper;
mod path_set;
mod projection;
mod raster;
mod seam_score;
mod taught;
mod truth;

pub use alignment::{Aligned, align};
pub use deviation::{Deviation, deviations};
pub use paper::paper_rmse;
pub use path_set::PathSet;
pub use raster::{CELL_MM, F1, f1};
pub use seam_score::SeamScore;
pub use truth::{Target, Truth, TruthSeam};

use nalgebra::Vector3;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use weldpath_method::geometry::statistics;

/// How paths are scored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Which line of a groove the path should follow.
    pub target: Target,
    /// A path point farther than this from every seam belongs to none, mm.
    pub near_mm: f64,
    /// A station nearer than this to the path is covered, mm.
    pub cover_mm: f64,
    /// The path was offset by this much along the torch axis, out of the work, mm.
    pub standoff_mm: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { target: Target::Apex, near_mm: 8.0, cover_mm: 2.0, standoff_mm: 0.0 }
    }
}

/// Why a path cannot be scored.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file cannot be opened or read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The file holds something else than it should.
    #[error("{path}: {place}: {reason}")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line, seam or field.
        place: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
}

/// A path set against the truth. The JSON keys are those of the project's reference script.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// By seam name; seams that are neither visible nor touched are left out.
    pub seams: BTreeMap<String, SeamScore>,
    /// Path points.
    #[serde(rename = "n")]
    pub points: usize,
    /// Share of path points that belong to no seam.
    #[serde(rename = "false_frac")]
    pub false_share: f64,
    /// Covered share of the visible stations of all required seams.
    pub coverage: f64,
    /// RMSE of the lateral distance over all points on seams, mm.
    #[serde(rename = "rmse_p", skip_serializing_if = "Option::is_none")]
    pub rmse_mm: Option<f64>,
    /// 95th percentile of the lateral distance, mm.
    #[serde(rename = "p95", skip_serializing_if = "Option::is_none")]
    pub p95_mm: Option<f64>,
    /// RMSE of the torch orientation, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rmse_deg: Option<f64>,
}

/// Scores `paths` against `truth`.
pub fn score(paths: &PathSet, truth: &Truth, options: &Options) -> Score {
    let points = paths.without_standoff(options.standoff_mm);
    let runs = paths.runs();
    let lines: Vec<&[[f64; 3]]> = truth.seams.iter().map(|seam| seam.line(options.target)).collect();
    let nearest: Vec<Nearest> = points.iter().map(|p| Nearest::of(p, &lines)).collect();
    let mut measured = Vec::new();
    for (k, seam) in truth.seams.iter().enumerate() {
        let own: Vec<usize> = (0..points.len())
            .filter(|&i| nearest[i].seam == k && nearest[i].distance_mm <= options.near_mm)
            .collect();
        if own.is_empty() && seam.visible_count() == 0 {
            continue;
        }
        let at_corner = |i: usize| nearest[i].second_mm <= CORNER_MM;
        let on_seam = seam_score::OnSeam { points: &points, paths, runs: &runs, own: &own };
        measured.push((seam, on_seam.measure(seam, lines[k], options.cover_mm, at_corner)));
    }
    total(points.len(), nearest.iter().filter(|n| n.distance_mm > options.near_mm).count(), measured)
}

/// A point within this distance of two seams has no single right frame: its orientation is not scored, mm.
const CORNER_MM: f64 = 3.0;
/// A seam with fewer visible stations does not count for coverage.
const MIN_VISIBLE: usize = 10;

struct Nearest {
    seam: usize,
    distance_mm: f64,
    second_mm: f64,
}

impl Nearest {
    /// Nearest station over all seams; the distance to the next nearest seam tells corners.
    fn of(point: &Vector3<f64>, lines: &[&[[f64; 3]]]) -> Self {
        let mut best = Self { seam: 0, distance_mm: f64::INFINITY, second_mm: f64::INFINITY };
        for (seam, line) in lines.iter().enumerate() {
            let distance_mm = projection::nearest_station(point, line).1;
            if distance_mm < best.distance_mm {
                best = Self { seam, distance_mm, second_mm: best.distance_mm };
            } else {
                best.second_mm = best.second_mm.min(distance_mm);
            }
        }
        best
    }
}

fn total(points: usize, strays: usize, measured: Vec<(&TruthSeam, seam_score::Measured)>) -> Score {
    let lateral: Vec<f64> = measured.iter().flat_map(|(_, m)| m.lateral_mm.iter().copied()).collect();
    let angles: Vec<f64> = measured.iter().flat_map(|(_, m)| m.angles_deg.iter().copied()).collect();
    let required = |m: &&(&TruthSeam, seam_score::Measured)| m.0.required && m.1.score.visible > MIN_VISIBLE;
    let (mut covered, mut visible) = (0.0, 0.0);
    for (_, m) in measured.iter().filter(required) {
        covered += m.score.coverage.unwrap_or(0.0) * m.score.visible as f64;
        visible += m.score.visible as f64;
    }
    Score {
        points,
        false_share: if points == 0 { 0.0 } else { strays as f64 / points as f64 },
        coverage: covered / visible.max(1.0),
        rmse_mm: statistics::rms(&lateral),
        p95_mm: statistics::percentile(&lateral, 95.0),
        rmse_deg: statistics::rms(&angles),
        seams: measured.into_iter().map(|(seam, m)| (seam.name.clone(), m.score)).collect(),
    }
}

#[cfg(test)]
mod tests;
