//! The torch as a chain of cylinders and cones, and how far it stays from the scanned points.
//!
//! The wire is no part of it: everything nearer to the seam than the nozzle is the weld zone, and touching there is the
//! purpose. Nothing else is left out, so the faces of a narrow groove or an acute corner count as they should.

use std::collections::HashSet;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::chain::Capsule;
use super::links::TORCH;
use super::torch_from_tool;
use weldpath_method::geometry::surface::Surface;
use weldpath_method::weld::air::terrain::Ball;

/// Sizes of a torch, mm. Its axis is the torch axis `n`; the body behind the neck may be bent away from the travel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Torch {
    /// From the tip of the wire to the nozzle.
    pub stickout_mm: f64,
    /// Outer radius of the gas nozzle.
    pub nozzle_radius_mm: f64,
    /// Length of the gas nozzle.
    pub nozzle_length_mm: f64,
    /// Length of the cone from the nozzle to the body.
    pub neck_length_mm: f64,
    /// Angle of the neck: by so much the body leans from `n` toward `-m`, away from the travel.
    pub neck_deg: f64,
    /// Radius of the body.
    pub body_radius_mm: f64,
    /// Length of the body.
    pub body_length_mm: f64,
    /// Radius of the cable and its hoses about the flange.
    pub cable_radius_mm: f64,
}

impl Default for Torch {
    /// A straight torch of usual size for gas-shielded welding.
    fn default() -> Self {
        Self {
            stickout_mm: 15.0,
            nozzle_radius_mm: 10.0,
            nozzle_length_mm: 60.0,
            neck_length_mm: 40.0,
            neck_deg: 0.0,
            body_radius_mm: 25.0,
            body_length_mm: 150.0,
            cable_radius_mm: 60.0,
        }
    }
}

/// Nothing farther than this is looked at, mm.
pub const SIGHT_MM: f64 = 15.0;
/// Long sections are searched in pieces of at most this, mm.
const PIECE_MM: f64 = 30.0;
/// The clearance is that of the third nearest point: one or two flying pixels are no wall.
const WALL_POINTS: usize = 3;

/// A cylinder or cone about a line.
struct Section {
    start_mm: Point3<f64>,
    along: Vector3<f64>,
    length_mm: f64,
    radii_mm: [f64; 2],
}

impl Torch {
    /// Distance between the torch and the scanned points, mm; negative inside. None if nothing is within [`SIGHT_MM`].
    pub(super) fn clearance_mm(
        &self,
        work: &Surface,
        tip_mm: &Point3<f64>,
        base_from_torch: &UnitQuaternion<f64>,
    ) -> Option<f64> {
        let tip_mm = tip_mm - work.origin_mm.coords;
        let mut nearest = [(usize::MAX, SIGHT_MM); WALL_POINTS];
        for section in self.sections(&tip_mm, base_from_torch) {
            for (middle, reach_mm) in section.pieces(SIGHT_MM) {
                work.grid.within(&middle, reach_mm, |slot, _| {
                    keep(&mut nearest, slot, section.distance_mm(&work.grid.point(slot).cast()));
                });
            }
        }
        let [.., (slot, last)] = nearest;
        (slot != usize::MAX).then_some(last)
    }

    /// Whether no surface reaches deeper than `deep_mm` into the torch: less than what [`Torch::clearance_mm`] tells, and sooner
    /// told.
    pub(crate) fn fits(
        &self,
        work: &Surface,
        tip_mm: &Point3<f64>,
        base_from_torch: &UnitQuaternion<f64>,
        deep_mm: f64,
    ) -> bool {
        let tip_mm = tip_mm - work.origin_mm.coords;
        let mut inside = HashSet::new();
        self.sections(&tip_mm, base_from_torch).iter().all(|section| {
            section.pieces(0.0).all(|(middle, reach_mm)| {
                work.grid.within(&middle, reach_mm, |slot, _| {
                    let deep = || section.distance_mm(&work.grid.point(slot).cast()) < -deep_mm;
                    if inside.len() < WALL_POINTS && deep() {
                        inside.insert(slot);
                    }
                });
                inside.len() < WALL_POINTS
            })
        })
    }

    /// Balls that cover the torch, from the nozzle on, for the planning of air moves.
    pub fn balls(&self) -> Vec<Ball> {
        let sections = self.sections(&Point3::origin(), &UnitQuaternion::identity());
        sections.iter().filter(|section| section.length_mm > 0.0).flat_map(Section::balls).collect()
    }

    /// Neck, body, and what holds it at the flange, in the flange's frame. The nozzle is where the work is.
    pub(super) fn at_the_flange(&self, flange_from_tcp: &Isometry3<f64>) -> Vec<Capsule> {
        let [_, neck, body] = self.sections(&Point3::origin(), &torch_from_tool());
        let end_mm = |section: &Section| section.start_mm + section.along * section.length_mm;
        let capsule = |ends_mm: [Point3<f64>; 2], radius_mm: f64| {
            let ends_mm = ends_mm.map(|end| flange_from_tcp * end);
            Capsule { link: TORCH, ends_mm, radius_mm }
        };
        let flange_mm = flange_from_tcp.inverse() * Point3::origin();
        vec![
            capsule([neck.start_mm, end_mm(&neck)], 0.5 * (neck.radii_mm[0] + neck.radii_mm[1])),
            capsule([body.start_mm, end_mm(&body)], self.body_radius_mm),
            capsule([end_mm(&body), flange_mm], self.body_radius_mm),
        ]
    }

    fn sections(&self, tip_mm: &Point3<f64>, base_from_torch: &UnitQuaternion<f64>) -> [Section; 3] {
        let n = base_from_torch * Vector3::z();
        let (sin, cos) = self.neck_deg.to_radians().sin_cos();
        let leaning = base_from_torch * Vector3::new(0.0, -sin, cos);
        let nozzle_mm = tip_mm + n * self.stickout_mm;
        let neck_mm = nozzle_mm + n * self.nozzle_length_mm;
        let body_mm = neck_mm + leaning * self.neck_length_mm;
        let (nozzle, body) = (self.nozzle_radius_mm, self.body_radius_mm);
        let section = |start_mm, along, length_mm, radii_mm| Section { start_mm, along, length_mm, radii_mm };
        [
            section(nozzle_mm, n, self.nozzle_length_mm, [nozzle, nozzle]),
            section(neck_mm, leaning, self.neck_length_mm, [nozzle, body]),
            section(body_mm, leaning, self.body_length_mm, [body, body]),
        ]
    }
}

impl Section {
    fn balls(&self) -> impl Iterator<Item = Ball> + '_ {
        let [near, far] = self.radii_mm;
        let pieces = (self.length_mm / near.max(far).max(1.0)).ceil().max(1.0);
        let half_mm = 0.5 * self.length_mm / pieces;
        (0..pieces as usize).map(move |k| {
            let radius = |edge: usize| near + (far - near) * edge as f64 / pieces;
            Ball {
                centre_mm: self.start_mm.coords + self.along * (half_mm * (2 * k + 1) as f64),
                radius_mm: radius(k).max(radius(k + 1)).hypot(half_mm),
            }
        })
    }

    /// It in pieces: the middle of each, and how far from there anything within `sight_mm` of it can be, mm. None of a section
    /// without length.
    fn pieces(&self, sight_mm: f64) -> impl Iterator<Item = (Point3<f32>, f32)> + '_ {
        let pieces = (self.length_mm / PIECE_MM).ceil();
        let half_mm = 0.5 * self.length_mm / pieces;
        let reach_mm = half_mm.hypot(self.radii_mm[0].max(self.radii_mm[1]) + sight_mm);
        let middle = move |k: usize| self.start_mm + self.along * (half_mm * (2 * k + 1) as f64);
        (0..pieces as usize).map(move |k| (middle(k).cast(), reach_mm as f32))
    }

    /// Distance of a point from the solid, mm; inside, minus the distance to its side.
    fn distance_mm(&self, point: &Point3<f64>) -> f64 {
        let offset = point - self.start_mm;
        let along = offset.dot(&self.along);
        let radial = (offset - self.along * along).norm();
        let [near, far] = self.radii_mm;
        let (slope, radius) =
            ((far - near) / self.length_mm, |at: f64| near + (far - near) * at / self.length_mm);
        match along {
            below if below < 0.0 => below.hypot((radial - near).max(0.0)),
            above if above > self.length_mm => (above - self.length_mm).hypot((radial - far).max(0.0)),
            _ => (radial - radius(along)) / slope.hypot(1.0),
        }
    }
}

/// One point of a surface in each cell of [`LINK_STEP_MM`], for links, which are thicker than a torch.
pub(super) struct Thinned(Surface);

/// Links are held against points so far apart, mm: a tenth of their least diameter.
const LINK_STEP_MM: f32 = 6.0;
const LINK_CELL_MM: f32 = 40.0;

impl Thinned {
    pub(super) fn new(Surface { origin_mm, grid, .. }: &Surface) -> Self {
        let mut taken = HashSet::new();
        let cell = |p: &Point3<f32>| [p.x, p.y, p.z].map(|v| (v / LINK_STEP_MM).floor() as i32);
        let points = (0..grid.len()).map(|slot| grid.point(slot));
        let points: Vec<Point3<f32>> = points.filter(|point| taken.insert(cell(point))).collect();
        Self(Surface::new(*origin_mm, &points, LINK_CELL_MM))
    }

    /// Height of the lowest scanned surface, mm; none of an empty scan.
    pub(super) fn lowest_mm(&self) -> Option<f64> {
        let lowest_mm = f64::from(self.0.corners_mm[0].z) + self.0.origin_mm.z;
        lowest_mm.is_finite().then_some(lowest_mm)
    }

    /// How far scanned points lie inside a capsule, mm; none if they do not.
    pub(super) fn inside_mm(&self, ends_mm: &[Point3<f64>; 2], radius_mm: f64) -> Option<f64> {
        let [from, to] = ends_mm.map(|end| (end - self.0.origin_mm.coords).cast::<f32>());
        let (along, radius) = (to - from, radius_mm as f32);
        let [low, high] = self.0.corners_mm;
        let reach = Vector3::repeat(radius);
        let (near, far) = (from.inf(&to) - reach, from.sup(&to) + reach);
        let apart = (0..3).any(|i| near[i] > high[i] || far[i] < low[i]);
        if apart || self.0.is_empty() {
            return None;
        }
        let pieces = (along.norm() / (2.0 * radius)).ceil().max(1.0);
        let half = along / (2.0 * pieces);
        let squared = along.norm_squared().max(f32::MIN_POSITIVE);
        let mut nearest = [(usize::MAX, radius_mm); WALL_POINTS];
        for k in 0..pieces as usize {
            let middle = from + half * (2 * k + 1) as f32;
            // The round ends reach farther than the middle's rim.
            self.0.grid.within(&middle, half.norm() + radius, |slot, _| {
                let offset = self.0.grid.point(slot) - from;
                let share = (offset.dot(&along) / squared).clamp(0.0, 1.0);
                keep(&mut nearest, slot, f64::from((offset - along * share).norm()));
            });
        }
        let [.., (slot, last)] = nearest;
        (slot != usize::MAX).then_some(radius_mm - last)
    }
}

/// Keeps the nearest points in order, each once.
fn keep(nearest: &mut [(usize, f64); WALL_POINTS], slot: usize, distance_mm: f64) {
    let known = nearest.iter().position(|(other, _)| *other == slot);
    let place = known.unwrap_or(WALL_POINTS - 1);
    if distance_mm < nearest[place].1 {
        nearest[place] = (slot, distance_mm);
        nearest.sort_by(|a, b| a.1.total_cmp(&b.1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_4;
    use weldpath_method::geometry::cloud::PointCloud;

    /// Two faces that meet in the y axis: each rises by `half_deg` less than 90 degrees from the vertical plane between them.
    fn corner(half_deg: f64) -> PointCloud {
        let (sin, cos) = half_deg.to_radians().sin_cos();
        let mut points_mm = Vec::new();
        for i in 0..120 {
            for j in -60..=60 {
                let (a, y) = (f64::from(i), f64::from(j));
                points_mm.push(Point3::new(a * sin, y, a * cos).cast());
                points_mm.push(Point3::new(-a * sin, y, a * cos).cast());
            }
        }
        let normals = vec![Vector3::z(); points_mm.len()];
        PointCloud { origin_mm: Point3::origin(), points_mm, normals }
    }

    fn clearance(half_deg: f64, torch: &Torch, turn: UnitQuaternion<f64>) -> Option<f64> {
        torch.clearance_mm(&Surface::of(&corner(half_deg)), &Point3::origin(), &turn)
    }

    #[test]
    fn in_a_right_corner_the_nozzles_rim_is_as_far_from_the_faces_as_geometry_says() {
        let torch = Torch { body_radius_mm: 10.0, ..Torch::default() };
        // The rim is at (10, 15) mm; a face at 45 degrees passes (15 - 10)/sqrt 2 below it.
        let found = clearance(45.0, &torch, UnitQuaternion::identity()).unwrap();
        assert!((found - 5.0 * FRAC_PI_4.cos()).abs() < 0.6, "{found}");
        assert!(found >= 5.0 * FRAC_PI_4.cos() - 1e-3);
    }

    #[test]
    fn in_an_acute_corner_the_same_nozzle_is_inside_the_faces() {
        let found = clearance(25.0, &Torch::default(), UnitQuaternion::identity()).unwrap();
        assert!(found < -2.0, "{found}");
        let long =
            Torch { stickout_mm: 40.0, nozzle_radius_mm: 6.0, body_radius_mm: 6.0, ..Torch::default() };
        assert!(clearance(25.0, &long, UnitQuaternion::identity()).unwrap() > 5.0);
    }

    #[test]
    fn the_wire_may_touch_and_an_empty_scan_is_free() {
        let flat = corner(90.0);
        let torch = Torch { stickout_mm: 12.0, ..Torch::default() };
        let found =
            torch.clearance_mm(&Surface::of(&flat), &Point3::origin(), &UnitQuaternion::identity()).unwrap();
        assert!(
            (found - 12.0).abs() < 1e-6,
            "over a flat face the nozzle is as high as the wire is long: {found}"
        );
        let none = Surface::of(&PointCloud::default());
        assert_eq!(
            Torch::default().clearance_mm(&none, &Point3::origin(), &UnitQuaternion::identity()),
            None
        );
    }

    #[test]
    fn a_bent_neck_reaches_the_wall_behind_and_turned_about_its_axis_it_does_not() {
        let bent = Torch { neck_deg: 60.0, ..Torch::default() };
        let wall = |y: f64| {
            let points_mm: Vec<Point3<f32>> = (0..60)
                .flat_map(|x| (0..300).map(move |z| Point3::new(x as f32 - 30.0, y as f32, z as f32)))
                .collect();
            PointCloud {
                origin_mm: Point3::origin(),
                normals: vec![Vector3::z(); points_mm.len()],
                points_mm,
            }
        };
        let behind = Surface::of(&wall(-80.0));
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        let at = |turn: &UnitQuaternion<f64>| bent.clearance_mm(&behind, &Point3::origin(), turn);
        assert!(at(&UnitQuaternion::identity()).unwrap() < 0.0);
        assert_eq!(at(&turned), None);
    }

    #[test]
    fn points_inside_a_capsule_are_found_to_its_round_ends() {
        // A sheet across the x axis, 20 mm beyond the end of a bar of radius 30 mm: 10 mm of it are inside.
        let sheet = |x: f32| {
            let points_mm: Vec<Point3<f32>> = (-10..=10)
                .flat_map(|y| (-10..=10).map(move |z| Point3::new(x, 3.0 * y as f32, 3.0 * z as f32)))
                .collect();
            let normals = vec![Vector3::x(); points_mm.len()];
            Thinned::new(&Surface::of(&PointCloud { origin_mm: Point3::origin(), points_mm, normals }))
        };
        let bar = |from: f64, to: f64| [Point3::new(from, 0.0, 0.0), Point3::new(to, 0.0, 0.0)];
        for (ends_mm, x, depth_mm) in
            [(bar(0.0, 500.0), 520.0, 10.0), (bar(500.0, 0.0), 520.0, 10.0), (bar(0.0, 500.0), 250.0, 30.0)]
        {
            let found = sheet(x).inside_mm(&ends_mm, 30.0).unwrap_or_default();
            // The third nearest of points that stand 6 mm apart.
            assert!(found <= depth_mm && found > depth_mm - 6.5, "{ends_mm:?}: {found}");
        }
        assert_eq!(sheet(531.0).inside_mm(&bar(0.0, 500.0), 30.0), None);
    }

    #[test]
    fn a_torch_fits_where_its_clearance_says_so() {
        let work = Surface::of(&corner(30.0));
        for deg in (-60..=60).step_by(5) {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), f64::from(deg).to_radians());
            let clearance_mm = Torch::default().clearance_mm(&work, &Point3::origin(), &turn).unwrap();
            for deep_mm in [0.5, 3.0, 8.0] {
                let fits = Torch::default().fits(&work, &Point3::origin(), &turn, deep_mm);
                assert_eq!(fits, clearance_mm >= -deep_mm, "{deg} {deep_mm} {clearance_mm}");
            }
        }
    }

    #[test]
    fn two_stray_points_are_no_wall_and_a_third_is() {
        let stray = |n: usize| {
            let points_mm: Vec<Point3<f32>> =
                (0..n).map(|i| Point3::new(0.0, 0.0, 40.0 + i as f32)).collect();
            let model = PointCloud { origin_mm: Point3::origin(), normals: vec![Vector3::z(); n], points_mm };
            Torch::default().clearance_mm(
                &Surface::of(&model),
                &Point3::origin(),
                &UnitQuaternion::identity(),
            )
        };
        assert_eq!(stray(2), None);
        assert!(stray(3).unwrap() < -9.0);
    }
}
