//! The cross-section of a seam at one of its stations: what the scan shows beside it, and what was made of it.
//!
//! Places are (o, n) in mm from the root: `o` to the right of the travel as the seam was found, `n` along the bisector of the
//! faces, out of the work.

use nalgebra::{Point3, Vector3};
use serde::Serialize;

use weldpath_method::pipeline::Plan;
use weldpath_method::seam::{Seam, Station};
use weldpath_method::weld::{PathPoint, SeamPath};

/// Points are shown up to this far from the root, mm: a leg of 12 mm, and as much of the plate beside it.
const REACH_MM: f64 = 25.0;
/// Points on either side of the plane are shown up to this far from it, in voxels of the model.
const HALF_SLAB_VOXELS: f64 = 0.75;
/// The same where no voxel is known, mm.
const HALF_SLAB_MM: f64 = 1.0;
/// A pass is shown where it comes so near to the plane, mm: farther, it begins or ends before.
const PASS_AWAY_MM: f64 = 2.5;

/// What the page draws, as JSON.
#[derive(Debug, Serialize)]
pub struct Section {
    seam: usize,
    /// Of the station, along the seam as it was found.
    at_mm: f64,
    length_mm: f64,
    reach_mm: f64,
    half_slab_mm: f64,
    root_mm: [f64; 3],
    tangent: [f64; 3],
    points_mm: Vec<[f64; 2]>,
    /// Unit directions from the root into both faces, as they were fitted.
    faces: [[f64; 2]; 2],
    /// Of each pass: where the tip is, and the torch's axis, a unit vector out of the work but for what leans along the travel.
    torches: Vec<Torch>,
    /// One standard deviation of the position across the seam; none where it is not known.
    error_mm: Option<f64>,
    /// The same within the scan.
    relative_mm: Option<f64>,
}

#[derive(Debug, Serialize)]
struct Torch {
    tip_mm: [f64; 2],
    axis: [f64; 2],
}

/// Axes of the plane, and its normal.
struct Axes {
    origin_mm: Point3<f64>,
    tangent: Vector3<f64>,
    right: Vector3<f64>,
    out: Vector3<f64>,
}

impl Axes {
    /// None where the faces of a station are opposite, or its tangent stands on them.
    fn of(station: &Station) -> Option<Self> {
        let tangent = station.tangent.try_normalize(1e-9)?;
        let bisector = station.faces[0] + station.faces[1];
        let out = (bisector - tangent * tangent.dot(&bisector)).try_normalize(1e-6)?;
        Some(Self { origin_mm: station.position_mm, tangent, right: tangent.cross(&out), out })
    }

    fn direction(&self, v: &Vector3<f64>) -> [f64; 2] {
        [self.right.dot(v), self.out.dot(v)]
    }

    fn place(&self, p_mm: &Point3<f64>) -> [f64; 2] {
        self.direction(&(p_mm - self.origin_mm)).map(|mm| (mm * 1e3).round() / 1e3 + 0.0)
    }

    fn ahead_mm(&self, p_mm: &Point3<f64>) -> f64 {
        (p_mm - self.origin_mm).dot(&self.tangent)
    }

    /// From the root along a face, on the side of the other one's air.
    fn along_face(&self, faces: &[Vector3<f64>; 2], k: usize) -> [f64; 2] {
        let along = self.tangent.cross(&faces[k]);
        let along = if along.dot(&faces[1 - k]) < 0.0 { -along } else { along };
        self.direction(&along.try_normalize(1e-9).unwrap_or_default())
    }
}

/// The section of a seam at the station nearest to so far along it; `welded` are the passes as they are welded.
///
/// # Errors
/// In words, if there is no such seam, or no section of it there.
pub fn section(plan: &Plan, welded: &[SeamPath], id: usize, at_mm: f64) -> Result<Section, String> {
    let seam =
        plan.seams.iter().find(|seam| seam.id == id).ok_or_else(|| format!("there is no seam {id}"))?;
    let (station, at_mm) = nearest(seam, at_mm).ok_or_else(|| format!("seam {id} has no station"))?;
    let none = || format!("seam {id} has no section {at_mm:.1} mm along it: its faces are opposite there");
    let axes = Axes::of(station).ok_or_else(none)?;
    let voxel_mm = plan.derived.parameters.iter().find(|derived| derived.name == "voxel_mm");
    let half_slab_mm = voxel_mm.map_or(HALF_SLAB_MM, |voxel| HALF_SLAB_VOXELS * voxel.value);
    let passes = welded.iter().filter(|path| path.seam == id);
    let torches = passes.filter_map(|path| torch(path, &axes)).collect();
    let known = |mm: f64| mm.is_finite().then_some(mm);
    Ok(Section {
        seam: id,
        at_mm,
        length_mm: seam.length_mm(),
        reach_mm: REACH_MM,
        half_slab_mm,
        root_mm: axes.origin_mm.into(),
        tangent: axes.tangent.into(),
        points_mm: slab(plan, &axes, half_slab_mm),
        faces: [0, 1].map(|k| axes.along_face(&station.faces, k)),
        torches,
        error_mm: known(seam.tip_error_mm()),
        relative_mm: known(seam.relative_error_mm),
    })
}

/// The station nearest to so far along a seam, and how far along it is.
fn nearest(seam: &Seam, at_mm: f64) -> Option<(&Station, f64)> {
    let mut before: Option<(Point3<f64>, f64)> = None;
    let ways = seam.stations.iter().map(|station| {
        let way_mm = before.map_or(0.0, |(p_mm, way_mm)| way_mm + (station.position_mm - p_mm).norm());
        before = Some((station.position_mm, way_mm));
        (station, way_mm)
    });
    ways.min_by(|(_, a), (_, b)| (a - at_mm).abs().total_cmp(&(b - at_mm).abs()))
}

/// Points of the model near the plane.
fn slab(plan: &Plan, axes: &Axes, half_slab_mm: f64) -> Vec<[f64; 2]> {
    let near = |p_mm: &Point3<f64>| {
        (p_mm - axes.origin_mm).norm() < REACH_MM && axes.ahead_mm(p_mm).abs() < half_slab_mm
    };
    let points = (0..plan.model.len()).map(|i| plan.model.in_base_mm(i));
    points.filter(near).map(|p_mm| axes.place(&p_mm)).collect()
}

/// The torch of a pass where it passes through the plane.
fn torch(path: &SeamPath, axes: &Axes) -> Option<Torch> {
    let away_mm = |point: &&PathPoint| (point.position_mm - axes.origin_mm).norm();
    let through = |point: &&PathPoint| axes.ahead_mm(&point.position_mm).abs() < PASS_AWAY_MM;
    let point = path.points.iter().filter(through).min_by(|a, b| away_mm(a).total_cmp(&away_mm(b)))?;
    let axis = point.base_from_torch * Vector3::z();
    Some(Torch { tip_mm: axes.place(&point.position_mm), axis: axes.direction(&axis) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A seam along y in the corner of a floor (z up) and a wall that faces +x.
    fn station(y_mm: f64) -> Station {
        Station {
            position_mm: Point3::new(5.0, y_mm, 1.0),
            tangent: Vector3::y(),
            faces: [Vector3::z(), Vector3::x()],
        }
    }

    #[test]
    fn floor_and_wall_lie_at_half_a_right_angle_on_either_side_of_the_bisector() {
        let axes = Axes::of(&station(0.0)).unwrap();
        let half = 0.5_f64.sqrt();
        let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9;
        let faces = station(0.0).faces;
        // Looking along +y with z up, +x is to the right: the floor is on the right, the wall on the left.
        assert!(near(axes.along_face(&faces, 0), [half, half]), "{:?}", axes.along_face(&faces, 0));
        assert!(near(axes.along_face(&faces, 1), [-half, half]), "{:?}", axes.along_face(&faces, 1));
        let on_floor = axes.place(&Point3::new(15.0, 3.0, 1.0));
        assert!(near(on_floor, [7.071, 7.071]), "{on_floor:?}");
        assert_eq!(axes.ahead_mm(&Point3::new(15.0, 3.0, 1.0)), 3.0);
    }

    #[test]
    fn opposite_faces_have_no_section() {
        let thin = Station { faces: [Vector3::z(), -Vector3::z()], ..station(0.0) };
        assert!(Axes::of(&thin).is_none());
    }
}
