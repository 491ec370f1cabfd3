//! Ways between seams (not in the paper): up to a level above everything that was scanned, across, and down again.
//!
//! Up is the base frame's z, unless the torch axes of the seams point below the horizontal on average: then the scan
//! is not in an upright base frame (a lone cloud in its camera's frame) or hangs overhead, and up is that average.
//! The safe level is the model's highest point plus a clearance. From a retract point the torch rises straight up if
//! a column as wide as the torch is free there; else, as under an overhang, it first leaves along its own axis until
//! it is outside the model's box by the clearance, and rises then.

use nalgebra::{Point3, Unit, UnitVector3, Vector3};

use super::{PathPoint, SeamPath};
use crate::cloud::PointCloud;

/// Radius of a common MIG nozzle with some air around it, mm.
const TORCH_RADIUS_MM: f64 = 15.0;

/// Places nearer than this are one.
const SAME_PLACE_MM: f64 = 1e-3;

/// What the torch stays clear of between seams.
#[derive(Debug)]
pub struct Surroundings<'a> {
    model: &'a PointCloud,
    up: UnitVector3<f64>,
    safe_level_mm: f64,
    clearance_mm: f64,
}

/// A way from a retract point to the safe level.
#[derive(Debug, Clone, PartialEq)]
pub struct WayOut {
    /// Places to pass, in order; the last is on the safe level. Empty if the retract point is there already.
    pub via_mm: Vec<Point3<f64>>,
    /// Whether the scanned points leave room for the torch.
    pub free: bool,
}

impl<'a> Surroundings<'a> {
    /// Over `model` and all of `paths`, mm.
    pub fn new<'p>(
        model: &'a PointCloud,
        paths: impl IntoIterator<Item = &'p SeamPath, IntoIter: Clone>,
        clearance_mm: f64,
    ) -> Self {
        let points = paths.into_iter().flat_map(|path| &path.points);
        let up = up(points.clone());
        let seams = points.map(|point| point.position_mm);
        let highest_mm = (0..model.len())
            .map(|i| model.in_base_mm(i))
            .chain(seams)
            .map(|p| up.dot(&p.coords))
            .fold(f64::NEG_INFINITY, f64::max);
        Self { model, up, safe_level_mm: highest_mm + clearance_mm, clearance_mm }
    }

    /// From `retract_mm`, reached along `out_of_work`, to the safe level; `approach_mm` off the seam.
    pub fn way_out(&self, retract_mm: Point3<f64>, out_of_work: Vector3<f64>, approach_mm: f64) -> WayOut {
        let radius_mm = TORCH_RADIUS_MM.min(0.5 * approach_mm);
        if self.is_free(retract_mm, self.up.into_inner(), radius_mm) {
            return WayOut { via_mm: moves(retract_mm, [self.lift(retract_mm)]), free: true };
        }
        let beyond_mm = retract_mm + out_of_work * self.distance_out_mm(retract_mm, out_of_work);
        let free = self.is_free(retract_mm, out_of_work, radius_mm)
            && self.is_free(beyond_mm, self.up.into_inner(), radius_mm);
        WayOut { via_mm: moves(retract_mm, [beyond_mm, self.lift(beyond_mm)]), free }
    }

    /// The place on the safe level above `p`, or `p` if that is higher.
    fn lift(&self, p: Point3<f64>) -> Point3<f64> {
        p + self.up.into_inner() * (self.safe_level_mm - self.up.dot(&p.coords)).max(0.0)
    }

    /// Whether no scanned point lies ahead of `from_mm` within `radius_mm` of the ray along the unit vector `along`.
    fn is_free(&self, from_mm: Point3<f64>, along: Vector3<f64>, radius_mm: f64) -> bool {
        (0..self.model.len()).all(|i| {
            let v = self.model.in_base_mm(i) - from_mm;
            let ahead = v.dot(&along);
            ahead <= 0.0 || (v - along * ahead).norm_squared() > radius_mm * radius_mm
        })
    }

    /// How far along the unit vector `along` the model's box, grown by the clearance, is left behind, mm.
    fn distance_out_mm(&self, from_mm: Point3<f64>, along: Vector3<f64>) -> f64 {
        let points = || (0..self.model.len()).map(|i| self.model.in_base_mm(i));
        (0..3)
            .filter(|&axis| along[axis].abs() > 1e-6)
            .map(|axis| {
                let sign = along[axis].signum();
                let wall =
                    points().map(|p| sign * p[axis]).fold(f64::NEG_INFINITY, f64::max) + self.clearance_mm;
                ((wall - sign * from_mm[axis]) / along[axis].abs()).max(0.0)
            })
            .fold(f64::INFINITY, f64::min)
    }
}

/// Those of `places_mm` that are a move away from the one before: controllers refuse moves of no length.
fn moves<const N: usize>(from_mm: Point3<f64>, places_mm: [Point3<f64>; N]) -> Vec<Point3<f64>> {
    let mut at_mm = from_mm;
    let is_move =
        |place: &Point3<f64>| (place - std::mem::replace(&mut at_mm, *place)).norm() > SAME_PLACE_MM;
    places_mm.into_iter().filter(is_move).collect()
}

/// Up, as the safe level is measured: a unit vector in the base frame.
pub fn up<'p>(points: impl Iterator<Item = &'p PathPoint>) -> UnitVector3<f64> {
    let sum: Vector3<f64> = points.map(PathPoint::out_of_work).sum();
    match Unit::try_new(sum, 1e-9) {
        Some(mean) if mean.z < 0.0 => mean,
        _ => Vector3::z_axis(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toolpath::Process;
    use nalgebra::UnitQuaternion;

    /// A 200 mm plate in the plane `z = 0`, 5 mm spacing, with more points if asked.
    fn plate(extra_mm: &[Point3<f32>]) -> PointCloud {
        let side = || (0..=40).map(|i| i as f32 * 5.0);
        let mut points_mm: Vec<Point3<f32>> =
            side().flat_map(|x| side().map(move |y| Point3::new(x, y, 0.0))).collect();
        points_mm.extend(extra_mm);
        let normals = vec![Vector3::z(); points_mm.len()];
        PointCloud { origin_mm: Point3::origin(), points_mm, normals }
    }

    fn pointing(out: Vector3<f64>) -> Vec<SeamPath> {
        let base_from_torch = UnitQuaternion::face_towards(&out, &Vector3::x());
        let position_mm = Point3::new(100.0, 100.0, 0.0);
        let process = Process::default();
        let point = PathPoint { s_mm: 0.0, position_mm, base_from_torch, process };
        vec![SeamPath { seam: 1, points: vec![point; 2] }]
    }

    #[test]
    fn the_torch_rises_straight_where_nothing_is_above() {
        let model = plate(&[]);
        let around = Surroundings::new(&model, &pointing(Vector3::z()), 30.0);
        let way = around.way_out(Point3::new(100.0, 100.0, 20.0), Vector3::z(), 20.0);
        assert_eq!(way, WayOut { via_mm: vec![Point3::new(100.0, 100.0, 30.0)], free: true });
    }

    #[test]
    fn a_retract_point_on_the_safe_level_needs_no_move() {
        let model = plate(&[]);
        let around = Surroundings::new(&model, &pointing(Vector3::z()), 30.0);
        for z_mm in [30.0, 45.0] {
            let way = around.way_out(Point3::new(100.0, 100.0, z_mm), Vector3::z(), 20.0);
            assert_eq!(way, WayOut { via_mm: vec![], free: true });
        }
    }

    #[test]
    fn under_an_overhang_the_torch_leaves_along_its_axis_first() {
        let roof: Vec<_> = (0..40).map(|i| Point3::new(5.0 * i as f32, 100.0, 80.0)).collect();
        let model = plate(&roof);
        let out = Vector3::y();
        let around = Surroundings::new(&model, &pointing(out), 30.0);
        let way = around.way_out(Point3::new(100.0, 100.0, 40.0), out, 40.0);
        assert!(way.free);
        assert_eq!(way.via_mm, vec![Point3::new(100.0, 230.0, 40.0), Point3::new(100.0, 230.0, 110.0)]);
    }

    #[test]
    fn a_cavity_with_no_way_out_is_said() {
        let mut walls = vec![Point3::new(100.0, 100.0, 80.0)];
        walls.push(Point3::new(100.0, 150.0, 40.0));
        let model = plate(&walls);
        let around = Surroundings::new(&model, &pointing(Vector3::y()), 30.0);
        assert!(!around.way_out(Point3::new(100.0, 100.0, 40.0), Vector3::y(), 40.0).free);
    }

    #[test]
    fn a_scan_in_a_camera_that_looks_along_plus_z_is_left_towards_the_camera() {
        let model = plate(&[]);
        let around = Surroundings::new(&model, &pointing(-Vector3::z()), 30.0);
        let way = around.way_out(Point3::new(100.0, 100.0, -20.0), -Vector3::z(), 20.0);
        assert_eq!(way.via_mm, vec![Point3::new(100.0, 100.0, -30.0)]);
    }
}
