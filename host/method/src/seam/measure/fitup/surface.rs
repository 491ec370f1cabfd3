//! Surfaces beyond the lips of a joint: top of the plates beside a groove, top of the upper sheet of a lap.
//!
//! They are flat and wide, so the thinned model serves: its points are averages of the raw ones.

use super::evidence::JointEvidence;
use crate::geometry::statistics::robust_deviation;
use crate::seam::refine::frame::Frame;
use nalgebra::Vector3;

/// Where a face ends at a surface, in the cross-section.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lip {
    /// Away from the seam square to the direction of `up_mm`, mm.
    pub(super) out_mm: f64,
    /// Height over the seam, mm.
    pub(super) up_mm: f64,
    /// Of the height, mm.
    pub(super) uncertainty_mm: f64,
}

// All chosen on the simulated scans.

/// Points of the surface are sought so far from the end of the face, voxels, and face up within this cosine.
const AWAY_VOXELS: f32 = 2.0;
const WITHIN_VOXELS: f32 = 5.0;
const LEVEL: f32 = 0.9;
/// Cross-sections looked at, and points of the surface that make it one.
const SECTIONS: usize = 24;
const LEAST_POINTS: usize = 40;
/// Of a flat surface's height, in voxels: it is an average of many, but all are registered alike.
const FLOOR_VOXELS: f64 = 0.05;
/// Shorter vectors have no direction.
const LEAST_LENGTH: f32 = 1e-3;
/// Rounds of fitting a line and dropping what is off it; how far that is, standard deviations, and at least this, mm; the
/// share of the least number of points that must be left; and the least spread to divide by, mm².
const ROUNDS: usize = 3;
const OFF_DEVIATIONS: f64 = 3.0;
const OFF_MM: f64 = 0.02;
const LEFT_ONE_OF: usize = 2;
const LEAST_SPREAD_MM2: f64 = 1e-9;
/// Standard deviations of an uncertainty: the truth is within it in about 19 cases of 20.
const SURE_DEVIATIONS: f64 = 2.0;

/// The lip of a bevel: where the line `up = out cotangent` meets the surface of its plate.
pub(super) fn above_bevel(evidence: &JointEvidence, side: usize, cotangent: f64) -> Option<Lip> {
    let up = |frame: &Frame| frame.bisector();
    let line = surface(evidence, side, &up)?;
    let out_mm = line.height_mm / (cotangent - line.slope);
    Some(Lip { out_mm, up_mm: out_mm * cotangent, uncertainty_mm: line.uncertainty_mm })
}

/// The upper edge of a plate that stands square on the other face.
pub(super) fn above_edge(evidence: &JointEvidence, side: usize) -> Option<Lip> {
    let up = |frame: &Frame| frame.faces[1 - side];
    let line = surface(evidence, side, &up)?;
    Some(Lip { out_mm: 0.0, up_mm: line.height_mm, uncertainty_mm: line.uncertainty_mm })
}

/// A surface in the cross-section: `height + slope out`.
struct SurfaceLine {
    height_mm: f64,
    slope: f64,
    uncertainty_mm: f64,
}

fn surface(
    evidence: &JointEvidence,
    side: usize,
    up: &dyn Fn(&Frame) -> Vector3<f32>,
) -> Option<SurfaceLine> {
    let (seam, voxel_mm) = (evidence.seam, evidence.input.model.voxel_mm());
    let reach_mm = evidence.reach_mm[side];
    let mut points = Vec::new();
    for frame in seam.frames.iter().step_by((seam.frames.len() / SECTIONS).max(1)) {
        let (up, into) = (up(frame), frame.faces_inward()[side]);
        let out = (into - up * into.dot(&up)).try_normalize(LEAST_LENGTH);
        let out = out.unwrap_or(-frame.faces[side]);
        let lip = frame.position + into * (reach_mm + AWAY_VOXELS * voxel_mm);
        evidence.input.model.index.within(&lip, WITHIN_VOXELS * voxel_mm, |slot, _| {
            let d = evidence.input.model.index.point(slot) - frame.position;
            let normal = evidence.input.model.cloud.normals[evidence.input.model.index.index(slot)];
            if normal.dot(&up) > LEVEL && d.dot(&into) > reach_mm {
                points.push([d.dot(&out), d.dot(&up)].map(f64::from));
            }
        });
    }
    (points.len() >= LEAST_POINTS).then(|| fitted(&mut points, f64::from(voxel_mm)))?
}

/// A line through most of the points, which come from few voxels each seen from several sections.
fn fitted(points: &mut Vec<[f64; 2]>, voxel_mm: f64) -> Option<SurfaceLine> {
    let mut line = SurfaceLine { height_mm: 0.0, slope: 0.0, uncertainty_mm: 0.0 };
    for _ in 0..ROUNDS {
        let n = points.len() as f64;
        let mean = [0, 1].map(|d| points.iter().map(|p| p[d]).sum::<f64>() / n);
        let spread: f64 = points.iter().map(|p| (p[0] - mean[0]).powi(2)).sum();
        let both: f64 = points.iter().map(|p| (p[0] - mean[0]) * (p[1] - mean[1])).sum();
        line.slope = both / spread.max(LEAST_SPREAD_MM2);
        line.height_mm = mean[1] - line.slope * mean[0];
        let miss = |p: &[f64; 2]| (p[1] - line.height_mm - line.slope * p[0]).abs();
        let usual = robust_deviation(&mut points.iter().map(miss).collect::<Vec<_>>());
        let limit = (OFF_DEVIATIONS * usual).max(OFF_MM);
        points.retain(|p| miss(p) < limit);
        // The surface is continued from its middle to the lip.
        let lever = 1.0 + mean[0] * mean[0] * n / spread.max(LEAST_SPREAD_MM2);
        line.uncertainty_mm = SURE_DEVIATIONS * (usual * (lever / n).sqrt()).hypot(FLOOR_VOXELS * voxel_mm);
    }
    (points.len() >= LEAST_POINTS / LEFT_ONE_OF).then_some(line)
}
