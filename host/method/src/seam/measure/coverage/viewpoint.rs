//! From where a stretch should be scanned again: the badly seen face in full view, the other one too, and nothing between.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::geometry::statistics::median;
use crate::seam::Station;
use serde::{Deserialize, Serialize};

/// A camera pose, base frame; the roll about the direction is free.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Viewpoint {
    /// Where the camera stands, mm.
    pub position_mm: Point3<f64>,
    /// Where it looks, unit.
    pub direction: Vector3<f64>,
}

impl Viewpoint {
    /// Where the camera stands and where it looks.
    pub(super) fn words(&self) -> String {
        let (at, look) = (self.position_mm, self.direction);
        format!(
            "the camera near ({:.0}, {:.0}, {:.0}) mm, looking along ({:.2}, {:.2}, {:.2})",
            at.x, at.y, at.z, look.x, look.y, look.z
        )
    }
}

/// Nearer to the seam than this the faces themselves stand beside the line of sight, mm.
const BESIDE_MM: f64 = 15.0;
/// So near to the line of sight a point hides the seam, mm.
const HIDING_MM: f32 = 4.0;
/// Weights of the other face's normal, from the best view of the bad one to the bisector.
const OTHERS: [f64; 4] = [0.6, 0.8, 1.0, 0.4];
/// Tilts along the seam, degrees.
const TILTS_DEG: [f64; 5] = [0.0, 20.0, -20.0, 40.0, -40.0];
/// Points whose distance is asked for, and the distance of a camera where there are none, mm.
const SAMPLE: usize = 5000;
const UNKNOWN_MM: f64 = 300.0;
/// Shorter vectors have no direction.
const LEAST_LENGTH: f64 = 1e-6;

/// The first direction from which nothing that was scanned hides the seam; if all are hidden, the first.
pub(super) fn best(station: &Station, face: usize, grid: &Grid, merged: &Merged) -> Viewpoint {
    let distance_mm = usual_distance_mm(merged);
    let from = |out: Vector3<f64>| Viewpoint {
        position_mm: station.position_mm + out * distance_mm,
        direction: -out,
    };
    let candidates: Vec<Viewpoint> = directions(station, face).map(from).collect();
    let free = candidates.iter().find(|view| is_free(station, view, distance_mm, grid, merged));
    *free.unwrap_or(&candidates[0])
}

/// Unit directions out of the seam, the best first.
fn directions(station: &Station, face: usize) -> impl Iterator<Item = Vector3<f64>> + '_ {
    let (bad, other) = (station.faces[face], station.faces[1 - face]);
    OTHERS.into_iter().flat_map(move |weight| {
        let out = (bad + other * weight).try_normalize(LEAST_LENGTH).unwrap_or(bad);
        TILTS_DEG.into_iter().map(move |tilt_deg| {
            let axis = nalgebra::Unit::new_normalize(station.tangent.cross(&out));
            UnitQuaternion::from_axis_angle(&axis, f64::to_radians(tilt_deg)) * out
        })
    })
}

fn is_free(station: &Station, view: &Viewpoint, distance_mm: f64, grid: &Grid, merged: &Merged) -> bool {
    let step_mm = f64::from(HIDING_MM);
    let steps = ((distance_mm - BESIDE_MM) / step_mm).max(0.0) as usize;
    (0..steps).all(|k| {
        let place = station.position_mm - view.direction * (BESIDE_MM + step_mm * k as f64);
        let local: Point3<f32> = (place - merged.origin_mm.coords).cast();
        grid.nearest(&local, HIDING_MM, |_| true).is_none()
    })
}

/// Median distance of the points from the cameras that saw them, mm.
fn usual_distance_mm(merged: &Merged) -> f64 {
    let distance = |(p, &view): (&Point3<f32>, &u16)| (p - merged.cameras_mm[usize::from(view)]).norm();
    let step = (merged.points_mm.len() / SAMPLE).max(1);
    let mut distances: Vec<f32> =
        merged.points_mm.iter().zip(&merged.view).step_by(step).map(distance).collect();
    if distances.is_empty() { UNKNOWN_MM } else { f64::from(median(&mut distances)) }
}
