//! The score of the path points that belong to one seam.

use super::path_set::PathSet;
use super::projection::{self, Foot};
use super::truth::TruthSeam;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use weldpath_method::geometry::statistics::{percentile, rms};

/// How well one seam is followed. The JSON keys are those of the project's reference script.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SeamScore {
    /// Whether a planner must find it.
    pub required: bool,
    /// Stations that at least two views see.
    pub visible: usize,
    /// Path points on it.
    #[serde(rename = "n")]
    pub points: usize,
    /// Covered share of its visible stations; none where nothing is visible.
    pub coverage: Option<f64>,
    /// RMSE of the lateral distance, mm.
    #[serde(rename = "rmse_p", skip_serializing_if = "Option::is_none")]
    pub rmse_mm: Option<f64>,
    /// 95th percentile of the lateral distance, mm.
    #[serde(rename = "p95", skip_serializing_if = "Option::is_none")]
    pub p95_mm: Option<f64>,
    /// Largest lateral distance, mm.
    #[serde(rename = "max", skip_serializing_if = "Option::is_none")]
    pub max_mm: Option<f64>,
    /// How far the path runs on beyond an end, mm.
    #[serde(rename = "overshoot", skip_serializing_if = "Option::is_none")]
    pub overshoot_mm: Option<f64>,
    /// Mean lateral offset along `n`, out of the work, mm.
    #[serde(rename = "bias_n", skip_serializing_if = "Option::is_none")]
    pub bias_n_mm: Option<f64>,
    /// Mean lateral offset along `o`, mm.
    #[serde(rename = "bias_o", skip_serializing_if = "Option::is_none")]
    pub bias_o_mm: Option<f64>,
    /// RMSE of the torch orientation, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rmse_deg: Option<f64>,
    /// RMSE of the torch axis, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub n_deg: Option<f64>,
    /// RMSE of the travel direction, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub m_deg: Option<f64>,
}

/// A seam's score and what the totals need.
pub(super) struct Measured {
    pub(super) score: SeamScore,
    pub(super) lateral_mm: Vec<f64>,
    pub(super) angles_deg: Vec<f64>,
}

/// The path points of one seam.
pub(super) struct OnSeam<'a> {
    /// All points of the path, without stand-off.
    pub(super) points: &'a [Vector3<f64>],
    pub(super) paths: &'a PathSet,
    /// The run (seam column, or stretch without a gap) of each point.
    pub(super) runs: &'a [usize],
    /// Indices of the points on this seam, ascending.
    pub(super) own: &'a [usize],
}

/// A point that far along the seam from its foot is beyond the seam's end, mm.
pub(super) const BEYOND_MM: f64 = 1.5;
/// Path segments of these lengths count as covered in between, mm.
const BRIDGED_MM: [f64; 2] = [0.8, 12.0];

struct Lateral {
    along_mm: Vec<f64>,
    offset_mm: Vec<Vector3<f64>>,
    feet: Vec<Foot>,
    /// Whether the point lies beside the seam and not beyond its end.
    beside: Vec<bool>,
}

impl OnSeam<'_> {
    pub(super) fn measure(
        &self,
        seam: &TruthSeam,
        line: &[[f64; 3]],
        cover_mm: f64,
        at_corner: impl Fn(usize) -> bool,
    ) -> Measured {
        let (required, visible) = (seam.required, seam.visible_count());
        let mut score = SeamScore { required, visible, points: self.own.len(), ..SeamScore::default() };
        if self.own.len() < 2 {
            score.coverage = (visible > 0).then_some(0.0);
            return Measured { score, lateral_mm: Vec::new(), angles_deg: Vec::new() };
        }
        let lateral = self.lateral(seam, line);
        let lateral_mm = lateral.report(&mut score);
        let angles_deg = self.angles(&lateral, at_corner, &mut score);
        score.coverage = self.coverage(seam, line, cover_mm);
        Measured { score, lateral_mm, angles_deg }
    }

    fn lateral(&self, seam: &TruthSeam, line: &[[f64; 3]]) -> Lateral {
        let mut lateral =
            Lateral { along_mm: Vec::new(), offset_mm: Vec::new(), feet: Vec::new(), beside: Vec::new() };
        for &i in self.own {
            let foot = projection::foot(seam, line, &self.points[i]);
            let gap = self.points[i] - foot.point;
            let m = foot.frame.column(1);
            let along_mm = gap.dot(&m);
            lateral.offset_mm.push(gap - m * along_mm);
            lateral.beside.push(along_mm.abs() < BEYOND_MM);
            lateral.along_mm.push(along_mm);
            lateral.feet.push(foot);
        }
        if lateral.beside.iter().filter(|b| **b).count() < 2 {
            lateral.beside.fill(true);
        }
        lateral
    }

    /// Geodesic angles between the path's torch and the true one, where that is defined.
    fn angles(
        &self,
        lateral: &Lateral,
        at_corner: impl Fn(usize) -> bool,
        score: &mut SeamScore,
    ) -> Vec<f64> {
        let Some(torches) = self.travelling_with(lateral) else { return Vec::new() };
        let clear: Vec<bool> =
            lateral.beside.iter().zip(self.own).map(|(beside, i)| *beside && !at_corner(*i)).collect();
        let enough = clear.iter().filter(|c| **c).count() >= 2;
        let keep = if enough { &clear } else { &lateral.beside };
        let each = |angle: &dyn Fn(&Matrix3<f64>, &Matrix3<f64>) -> f64| -> Vec<f64> {
            let pairs = torches.iter().zip(&lateral.feet).zip(keep).filter(|(_, keep)| **keep);
            pairs
                .map(|((torch, foot), _)| angle(torch, &foot.frame).clamp(-1.0, 1.0).acos().to_degrees())
                .collect()
        };
        let angles_deg = each(&|a, b| (a.dot(b) - 1.0) / 2.0);
        score.rmse_deg = rms(&angles_deg);
        score.n_deg = rms(&each(&|a, b| a.column(2).dot(&b.column(2))));
        score.m_deg = rms(&each(&|a, b| a.column(1).dot(&b.column(1))));
        angles_deg
    }

    /// Torch frames of this seam's points; a run that travels against the truth is turned round as a whole,
    /// since the direction of travel is free.
    fn travelling_with(&self, lateral: &Lateral) -> Option<Vec<Matrix3<f64>>> {
        let frames = self.paths.frames.as_ref()?;
        let mut torches: Vec<Matrix3<f64>> = self.own.iter().map(|&i| frames[i]).collect();
        let mut runs: Vec<usize> = self.own.iter().map(|&i| self.runs[i]).collect();
        runs.sort_unstable();
        runs.dedup();
        for run in runs {
            let members: Vec<usize> =
                (0..self.own.len()).filter(|&j| self.runs[self.own[j]] == run).collect();
            let with = |&j: &usize| torches[j].column(1).dot(&lateral.feet[j].frame.column(1));
            let agreement: Vec<f64> = members.iter().map(with).collect();
            if percentile(&agreement, 50.0).is_some_and(|m| m < 0.0) {
                for j in members {
                    torches[j].column_mut(0).neg_mut();
                    torches[j].column_mut(1).neg_mut();
                }
            }
        }
        Some(torches)
    }

    /// Share of visible stations near a path point or near a path segment between two of them.
    fn coverage(&self, seam: &TruthSeam, line: &[[f64; 3]], cover_mm: f64) -> Option<f64> {
        let mut dense: Vec<[f64; 3]> = self.own.iter().map(|&i| self.points[i].into()).collect();
        for pair in self.own.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let step = self.points[b] - self.points[a];
            let length_mm = step.norm();
            let joined = b == a + 1 && self.runs[a] == self.runs[b];
            if joined && length_mm > BRIDGED_MM[0] && length_mm < BRIDGED_MM[1] {
                let parts = length_mm as usize + 1;
                let between =
                    |k: usize| -> [f64; 3] { (self.points[a] + step * (k as f64 / parts as f64)).into() };
                dense.extend((1..parts).map(between));
            }
        }
        let visible: Vec<usize> = (0..line.len()).filter(|&i| seam.visible[i] > 0).collect();
        let is_covered = |&&i: &&usize| projection::nearest_station(&line[i].into(), &dense).1 < cover_mm;
        let covered = visible.iter().filter(is_covered).count();
        (!visible.is_empty()).then(|| covered as f64 / visible.len() as f64)
    }
}

impl Lateral {
    /// Fills in the position part of a score and returns the lateral distances beside the seam.
    fn report(&self, score: &mut SeamScore) -> Vec<f64> {
        let beside = || (0..self.beside.len()).filter(|&j| self.beside[j]);
        let distances: Vec<f64> = beside().map(|j| self.offset_mm[j].norm()).collect();
        let mean = |axis: usize| {
            let sum: f64 = beside().map(|j| self.offset_mm[j].dot(&self.feet[j].frame.column(axis))).sum();
            sum / distances.len() as f64
        };
        let beyond = (0..self.beside.len()).filter(|&j| !self.beside[j]);
        score.rmse_mm = rms(&distances);
        score.p95_mm = percentile(&distances, 95.0);
        score.max_mm = percentile(&distances, 100.0);
        score.overshoot_mm = Some(beyond.map(|j| self.along_mm[j].abs()).fold(0.0, f64::max));
        score.bias_n_mm = Some(mean(2));
        score.bias_o_mm = Some(mean(0));
        distances
    }
}
