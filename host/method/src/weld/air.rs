//! Ways between seams (not in the paper): the shortest that keeps the torch clear, else up to a level above everything
//! that was scanned, across, and down again.
//!
//! Up is the base frame's z, unless the torch axes of the seams point below the horizontal on average: then the scan
//! is not in an upright base frame (a lone cloud in its camera's frame) or hangs overhead, and up is that average.
//! The safe level is the model's highest point plus a clearance. From a retract point the torch rises straight up if
//! a column as wide as the torch is free there; else, as under an overhang, it first leaves along its own axis until
//! it is outside the model's box by the clearance, and rises then. `crossing` looks for shorter ways over the
//! [`terrain`]; the first way down and the last way up always come from and lead to the safe level.

mod crossing;
pub mod terrain;

use nalgebra::{Point3, Unit, UnitQuaternion, UnitVector3, Vector3};

use super::PathPoint;
use super::pass::Pass;
use crate::cancellation::go_on;
use crossing::{Crossing, Stretches};
use terrain::{Known, MARK_MM, Terrain, swept};

/// Radius of a common MIG nozzle with some air around it, mm.
const TORCH_RADIUS_MM: f64 = 15.0;

/// Places nearer than this are one.
const SAME_PLACE_MM: f64 = 1e-3;

/// Less than this makes no way shorter, mm.
const GAIN_MM: f64 = 1e-6;

/// Where the torch is, and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorchPlace {
    /// Tip of the wire, mm, base frame.
    pub tip_mm: Point3<f64>,
    /// Columns `(o, m, n)`, as in [`PathPoint`].
    pub base_from_torch: UnitQuaternion<f64>,
}

impl TorchPlace {
    /// Of the torch over a point of a path, so far off along its axis.
    pub fn over(point: &PathPoint, off_mm: f64) -> Self {
        let tip_mm = point.position_mm + point.out_of_work() * off_mm;
        Self { tip_mm, base_from_torch: point.base_from_torch }
    }

    fn at(&self, tip_mm: Point3<f64>) -> Self {
        Self { tip_mm, ..*self }
    }

    fn out_of_work(&self) -> Vector3<f64> {
        self.base_from_torch * Vector3::z()
    }
}

/// The terrain, and where the torch is on its welds.
#[derive(Debug)]
pub struct Surroundings<'a> {
    terrain: &'a Terrain<'a>,
    known: Option<Known>,
    safe_level_mm: f64,
}

/// Where the air moves of a pass begin or end.
#[derive(Debug, Clone, PartialEq)]
pub struct End {
    /// The retract or the approach.
    pub pose: TorchPlace,
    /// From there to the safe level.
    pub way_out: WayOut,
    /// Distance of each piece of the torch from what was seen, mm; nothing where no map is used.
    room_mm: Vec<f64>,
    stretches: Stretches,
}

/// A way from a retract point to the safe level.
#[derive(Debug, Clone, PartialEq)]
pub struct WayOut {
    /// Places to pass, in order; the last is on the safe level. Empty if the retract point is there already.
    pub via_mm: Vec<Point3<f64>>,
    /// Whether the scanned points leave room for the torch.
    pub free: bool,
}

/// A way from the retract of one pass to the approach of the next.
#[derive(Debug, Clone, PartialEq)]
pub struct AirRoute {
    /// Places to pass with the torch turned as at the retract, mm.
    pub out_mm: Vec<Point3<f64>>,
    /// Places to pass after them, with the torch turned as at the approach, mm.
    pub back_mm: Vec<Point3<f64>>,
    /// From the one to the other, mm.
    pub length_mm: f64,
    /// Whether the scanned points leave room for the torch.
    pub free: bool,
}

impl<'a> Surroundings<'a> {
    /// With `passes`: where the torch is on them is no unknown place.
    pub fn new<'p>(terrain: &'a Terrain<'a>, passes: impl IntoIterator<Item = &'p Pass>) -> Self {
        let known = terrain.map.as_ref().map(|map| {
            let mut known = Known::new(map);
            for pass in passes {
                for [from, to] in moves_of(pass) {
                    swept(&from, &to, map.lever_mm(), MARK_MM).for_each(|pose| known.mark(map, &pose));
                }
            }
            known
        });
        Self { terrain, known, safe_level_mm: terrain.highest_mm + terrain.clearance_mm }
    }

    /// At `off_mm` over a point where a pass begins or ends.
    pub fn end(&self, point: &PathPoint, off_mm: f64) -> End {
        let pose = TorchPlace::over(point, off_mm);
        let way_out = self.way_out(pose.tip_mm, point.out_of_work(), off_mm);
        let (mut room_mm, mut stretches) = (Vec::new(), Stretches::default());
        if let (Some(map), Some(known)) = (&self.terrain.map, &self.known) {
            let room = |ball| map.distance_mm(ball, &map.centre_mm(ball, &pose));
            room_mm.extend((0..map.balls()).map(room));
            stretches = Stretches::of(map, known, &pose, &room_mm);
        }
        End { pose, way_out, room_mm, stretches }
    }

    /// The shortest way found; never longer than that over the safe level.
    pub fn way(&self, from: &End, to: &End) -> AirRoute {
        go_on();
        let safe = over_the_safe_level(from, to);
        let (Some(map), Some(known)) = (&self.terrain.map, &self.known) else { return safe };
        let (up, safe_level_mm) = (self.terrain.up, self.safe_level_mm);
        let crossing = Crossing { map, known, up, safe_level_mm, ends: [from, to] };
        let Some(across) = crossing.shortest(safe.length_mm) else { return safe };
        let length_mm = crossing.length_mm(&across);
        if length_mm > safe.length_mm - GAIN_MM {
            return safe;
        }
        let [out_mm, mut back_mm] = [0, 1].map(|k| moves(crossing.ends[k].pose.tip_mm, [across[k].tip_mm]));
        if (across[0].tip_mm - across[1].tip_mm).norm() < SAME_PLACE_MM && !out_mm.is_empty() {
            back_mm.clear();
        }
        AirRoute { out_mm, back_mm, length_mm, free: true }
    }

    /// From `retract_mm`, reached along `out_of_work`, to the safe level; `approach_mm` off the seam.
    fn way_out(&self, retract_mm: Point3<f64>, out_of_work: Vector3<f64>, approach_mm: f64) -> WayOut {
        let up = self.terrain.up.into_inner();
        let radius_mm = TORCH_RADIUS_MM.min(0.5 * approach_mm);
        if self.is_free(retract_mm, up, radius_mm) {
            return WayOut { via_mm: moves(retract_mm, [self.lift(retract_mm)]), free: true };
        }
        let beyond_mm = retract_mm + out_of_work * self.distance_out_mm(retract_mm, out_of_work);
        let free = self.is_free(retract_mm, out_of_work, radius_mm) && self.is_free(beyond_mm, up, radius_mm);
        WayOut { via_mm: moves(retract_mm, [beyond_mm, self.lift(beyond_mm)]), free }
    }

    /// The place on the safe level above `p`, or `p` if that is higher.
    fn lift(&self, p: Point3<f64>) -> Point3<f64> {
        let up = self.terrain.up;
        p + up.into_inner() * (self.safe_level_mm - up.dot(&p.coords)).max(0.0)
    }

    /// Whether no scanned point lies ahead of `from_mm` within `radius_mm` of the ray along the unit vector `along`.
    fn is_free(&self, from_mm: Point3<f64>, along: Vector3<f64>, radius_mm: f64) -> bool {
        self.terrain.work.is_free(&from_mm, &along, radius_mm)
    }

    /// How far along the unit vector `along` the model's box, grown by the clearance, is left behind, mm.
    fn distance_out_mm(&self, from_mm: Point3<f64>, along: Vector3<f64>) -> f64 {
        let Terrain { work, clearance_mm, .. } = self.terrain;
        (0..3).map(|axis| work.reach_mm(&from_mm, &along, axis, *clearance_mm)).fold(f64::INFINITY, f64::min)
    }
}

/// Length of the way over the safe level, mm.
pub(crate) fn safe_mm(from: &End, to: &End) -> f64 {
    over_the_safe_level(from, to).length_mm
}

fn over_the_safe_level(from: &End, to: &End) -> AirRoute {
    let out_mm = from.way_out.via_mm.clone();
    let back_mm: Vec<_> = to.way_out.via_mm.iter().rev().copied().collect();
    let across: Vec<_> = out_mm.iter().chain(&back_mm).chain([&to.pose.tip_mm]).copied().collect();
    let length_mm = polyline_mm(&[from.pose.tip_mm], &across);
    AirRoute { out_mm, back_mm, length_mm, free: from.way_out.free && to.way_out.free }
}

fn polyline_mm(first: &[Point3<f64>], rest: &[Point3<f64>]) -> f64 {
    let places: Vec<_> = first.iter().chain(rest).collect();
    places.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
}

/// The approach, the moves on the line, and the retract of a pass.
fn moves_of(pass: &Pass) -> impl Iterator<Item = [TorchPlace; 2]> {
    let points = pass.path.points.as_slice();
    let lifted = |point: Option<&PathPoint>, off_mm: f64| {
        point.map(|point| [TorchPlace::over(point, 0.0), TorchPlace::over(point, off_mm)])
    };
    let ends =
        [lifted(points.first(), pass.motion.approach_mm), lifted(points.last(), pass.motion.retract_mm)];
    let line = points.windows(2).map(|w| [TorchPlace::over(&w[0], 0.0), TorchPlace::over(&w[1], 0.0)]);
    ends.into_iter().flatten().chain(line)
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
    use crate::geometry::cloud::PointCloud;
    use crate::geometry::surface::Surface;
    use crate::weld::Process;
    use crate::weld::SeamPath;
    use nalgebra::UnitQuaternion;

    /// A 200 mm plate in the plane `z = 0`, 5 mm spacing, with more points if asked.
    fn plate(extra_mm: &[Point3<f32>]) -> Surface {
        let side = || (0..=40).map(|i| i as f32 * 5.0);
        let mut points_mm: Vec<Point3<f32>> =
            side().flat_map(|x| side().map(move |y| Point3::new(x, y, 0.0))).collect();
        points_mm.extend(extra_mm);
        let normals = vec![Vector3::z(); points_mm.len()];
        Surface::of(&PointCloud { origin_mm: Point3::origin(), points_mm, normals })
    }

    fn around(model: &Surface, out: Vector3<f64>) -> Terrain<'_> {
        Terrain::new(model, &pointing(out), 30.0, None)
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
        let terrain = around(&model, Vector3::z());
        let around = Surroundings::new(&terrain, []);
        let way = around.way_out(Point3::new(100.0, 100.0, 20.0), Vector3::z(), 20.0);
        assert_eq!(way, WayOut { via_mm: vec![Point3::new(100.0, 100.0, 30.0)], free: true });
    }

    #[test]
    fn a_retract_point_on_the_safe_level_needs_no_move() {
        let model = plate(&[]);
        let terrain = around(&model, Vector3::z());
        let around = Surroundings::new(&terrain, []);
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
        let terrain = around(&model, out);
        let around = Surroundings::new(&terrain, []);
        let way = around.way_out(Point3::new(100.0, 100.0, 40.0), out, 40.0);
        assert!(way.free);
        assert_eq!(way.via_mm, vec![Point3::new(100.0, 230.0, 40.0), Point3::new(100.0, 230.0, 110.0)]);
    }

    #[test]
    fn a_cavity_with_no_way_out_is_said() {
        // Of nine points each: one alone is no wall.
        let patch = |y: f32, z: f32| (0..9).map(move |k| Point3::new(96.0 + k as f32, y, z));
        let walls: Vec<_> = patch(100.0, 80.0).chain(patch(150.0, 40.0)).collect();
        let model = plate(&walls);
        let terrain = around(&model, Vector3::y());
        let around = Surroundings::new(&terrain, []);
        assert!(!around.way_out(Point3::new(100.0, 100.0, 40.0), Vector3::y(), 40.0).free);
        let strays = plate(&[Point3::new(100.0, 100.0, 80.0), Point3::new(100.0, 150.0, 40.0)]);
        let terrain = Terrain::new(&strays, &pointing(Vector3::y()), 30.0, None);
        let around = Surroundings::new(&terrain, []);
        assert!(
            around.way_out(Point3::new(100.0, 100.0, 40.0), Vector3::y(), 40.0).free,
            "strays are no wall"
        );
    }

    #[test]
    fn a_scan_in_a_camera_that_looks_along_plus_z_is_left_towards_the_camera() {
        let model = plate(&[]);
        let terrain = around(&model, -Vector3::z());
        let around = Surroundings::new(&terrain, []);
        let way = around.way_out(Point3::new(100.0, 100.0, -20.0), -Vector3::z(), 20.0);
        assert_eq!(way.via_mm, vec![Point3::new(100.0, 100.0, -30.0)]);
    }
}
