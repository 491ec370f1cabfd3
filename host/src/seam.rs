//! Seams: what they are; finding them follows paper II-E, telling them apart and refining them is ours.

pub mod chain;
pub mod corner;
pub mod edges;
pub mod face;
pub mod refine;
pub mod section;
pub mod smooth;
pub mod support;

use nalgebra::{Point3, Vector3};
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

/// Corners of a cloud: the candidates that pass the gate, moved onto the line in which their faces meet.
pub fn corners(
    voxels: &crate::downsampling::Voxels,
    scores: &edges::Scores,
    config: &corner::Config,
) -> Vec<corner::Corner> {
    use crate::grid::Grid;
    use rayon::prelude::*;
    let v = voxels.edge_mm;
    let radius = config.radius_voxels * v;
    let grid = Grid::new(&voxels.cloud.points_mm, 0.5 * radius);
    let normals: Vec<_> = (0..grid.len()).map(|s| voxels.cloud.normals[grid.index(s)]).collect();
    let candidates: Vec<usize> = (0..voxels.cloud.len())
        .filter(|&k| scores.intensity[k] > scores.gate && scores.concavity[k] > 0.6 * scores.gate)
        .collect();
    candidates
        .par_iter()
        .map_init(Vec::new, |near, &k| {
            let at = voxels.cloud.points_mm[k];
            corner::surroundings(&grid, &normals, &at, radius, near);
            let (mut found, foot) = corner::fit(near, v, config)?;
            found.position = at + foot;
            Some(found)
        })
        .flatten()
        .collect()
}
