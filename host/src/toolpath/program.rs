//! The complete program of a plan (not in the paper): approach, weld, retract, and safe ways between the seams.

use nalgebra::{Point3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use super::air::{Surroundings, WayOut};
use super::{PathPoint, SeamPath};
use crate::cloud::PointCloud;

/// What a move is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Between seams, at or on the way to the safe level.
    Air,
    /// Off the start of a seam, along the torch axis.
    Approach,
    /// On a seam.
    Weld,
    /// Off the end of a seam, along the torch axis.
    Retract,
}

/// One pose of the program and how it is reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Tip of the wire, mm, base frame.
    pub position_mm: Point3<f64>,
    /// Columns `(o, m, n)`, `n` out of the work, as in [`PathPoint`].
    pub base_from_torch: UnitQuaternion<f64>,
    /// Speed of the straight move that ends here, mm/s.
    pub feed_mm_s: f64,
    /// The arc burns on a move between two waypoints of one seam that both say so. It is struck, standing still, at
    /// the first and put out at the last.
    pub weld: bool,
    /// [`crate::seam::Seam::id`]; none in the air.
    pub seam: Option<usize>,
    /// What the move is for.
    pub kind: Kind,
}

/// The straight move from one waypoint to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Speed, mm/s.
    pub feed_mm_s: f64,
    /// Whether the arc burns.
    pub weld: bool,
}

/// The segment that begins at each waypoint, for controllers that keep feed and weld where a move begins. The last
/// waypoint begins none: it gets its own feed and no arc.
pub fn segments(waypoints: &[Waypoint]) -> impl Iterator<Item = Segment> + '_ {
    waypoints.iter().enumerate().map(|(i, here)| match waypoints.get(i + 1) {
        Some(next) => {
            Segment { feed_mm_s: next.feed_mm_s, weld: here.weld && next.weld && here.seam == next.seam }
        }
        None => Segment { feed_mm_s: here.feed_mm_s, weld: false },
    })
}

/// How the torch moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Along the seam, mm/s.
    pub feed_mm_s: f64,
    /// From the approach to the seam, and off it, mm/s.
    pub approach_feed_mm_s: f64,
    /// In the air, mm/s.
    pub air_feed_mm_s: f64,
    /// Distance of approach and retract from the seam along the torch axis, mm.
    pub approach_mm: f64,
    /// Between the scanned model and the air moves, mm.
    pub clearance_mm: f64,
}

/// All moves from the first approach to the last retract.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Program {
    /// In the order in which they are reached.
    pub waypoints: Vec<Waypoint>,
    /// Air moves that the scan leaves no room for, in words.
    pub warnings: Vec<String>,
}

/// Strings `paths` together in their order; a path of fewer than two points is left out.
pub fn program(paths: &[SeamPath], model: &PointCloud, motion: &Motion) -> Program {
    let around = Surroundings::new(model, paths, motion.clearance_mm);
    let mut program = Program::default();
    for path in paths {
        if let [first, .., last] = path.points.as_slice() {
            let down = way_out(&around, first, motion);
            let up = way_out(&around, last, motion);
            if !(down.free && up.free) {
                program.warnings.push(blocked(path.seam));
            }
            let moves = Moves { seam: path.seam, motion };
            program.waypoints.extend(down.via_mm.iter().rev().map(|&via| moves.air(via, first)));
            program.waypoints.push(moves.off_seam(first, Kind::Approach));
            program.waypoints.extend(path.points.iter().enumerate().map(|(i, p)| moves.weld(p, i == 0)));
            program.waypoints.push(moves.off_seam(last, Kind::Retract));
            program.waypoints.extend(up.via_mm.iter().map(|&via| moves.air(via, last)));
        }
    }
    program
}

fn way_out(around: &Surroundings, point: &PathPoint, motion: &Motion) -> WayOut {
    let retract_mm = point.position_mm + point.out_of_work() * motion.approach_mm;
    around.way_out(retract_mm, point.out_of_work(), motion.approach_mm)
}

fn blocked(seam: usize) -> String {
    format!(
        "seam {seam}: the scan leaves the torch no free way to or from it; check the air moves before they are run, \
         or try another approach_mm"
    )
}

/// Makes the waypoints of one seam.
struct Moves<'a> {
    seam: usize,
    motion: &'a Motion,
}

impl Moves<'_> {
    fn air(&self, position_mm: Point3<f64>, pose: &PathPoint) -> Waypoint {
        Waypoint {
            position_mm,
            base_from_torch: pose.base_from_torch,
            feed_mm_s: self.motion.air_feed_mm_s,
            weld: false,
            seam: None,
            kind: Kind::Air,
        }
    }

    fn off_seam(&self, end: &PathPoint, kind: Kind) -> Waypoint {
        let position_mm = end.position_mm + end.out_of_work() * self.motion.approach_mm;
        let feed_mm_s = match kind {
            Kind::Retract => self.motion.approach_feed_mm_s,
            _ => self.motion.air_feed_mm_s,
        };
        Waypoint { feed_mm_s, seam: Some(self.seam), kind, ..self.air(position_mm, end) }
    }

    fn weld(&self, point: &PathPoint, first: bool) -> Waypoint {
        let feed_mm_s = if first { self.motion.approach_feed_mm_s } else { self.motion.feed_mm_s };
        let pose = self.air(point.position_mm, point);
        Waypoint { feed_mm_s, weld: true, seam: Some(self.seam), kind: Kind::Weld, ..pose }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    const MOTION: Motion = Motion {
        feed_mm_s: 8.0,
        approach_feed_mm_s: 20.0,
        air_feed_mm_s: 100.0,
        approach_mm: 50.0,
        clearance_mm: 30.0,
    };

    fn line(seam: usize, y_mm: f64, tilt_rad: f64) -> SeamPath {
        let base_from_torch = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt_rad);
        let at = |i| PathPoint {
            s_mm: f64::from(i),
            position_mm: Point3::new(0.0, y_mm + f64::from(i), 0.0),
            base_from_torch,
        };
        SeamPath { seam, points: (0..5).map(at).collect() }
    }

    fn model() -> PointCloud {
        let points_mm = vec![Point3::new(-200.0, 0.0, 0.0), Point3::new(-200.0, 9.0, 120.0)];
        PointCloud { origin_mm: Point3::origin(), points_mm, normals: vec![Vector3::z(); 2] }
    }

    #[test]
    fn every_seam_is_approached_and_left_along_its_torch_axis() {
        let program = program(&[line(1, 0.0, 0.5), line(2, 40.0, -0.5)], &model(), &MOTION);
        for w in program.waypoints.windows(2) {
            let step = w[1].position_mm - w[0].position_mm;
            let n = w[1].base_from_torch * Vector3::z();
            match (w[0].kind, w[1].kind) {
                (Kind::Approach, Kind::Weld) => assert!((step + n * 50.0).norm() < 1e-9),
                (Kind::Weld, Kind::Retract) => assert!((step - n * 50.0).norm() < 1e-9),
                (Kind::Weld, Kind::Weld) | (Kind::Air, Kind::Approach | Kind::Air) => {}
                (Kind::Retract, Kind::Air) => {}
                other => panic!("unexpected order {other:?}"),
            }
        }
        assert_eq!(program.waypoints.iter().filter(|w| w.weld).count(), 10);
        assert!(program.waypoints.iter().all(|w| w.weld == (w.kind == Kind::Weld)));
    }

    #[test]
    fn air_moves_cross_above_the_highest_point_of_the_model() {
        let program = program(&[line(1, 0.0, 0.5), line(2, 40.0, -0.5)], &model(), &MOTION);
        let crossing = |w: &&[Waypoint]| w[0].kind == Kind::Air && w[1].kind == Kind::Air;
        let crossings: Vec<_> = program.waypoints.windows(2).filter(crossing).collect();
        assert_eq!(crossings.len(), 1);
        assert!(crossings[0].iter().all(|w| (w.position_mm.z - 150.0).abs() < 1e-9));
        assert!(program.warnings.is_empty());
    }

    #[test]
    fn only_the_moves_along_a_seam_have_the_weld_feed() {
        let program = program(&[line(1, 0.0, 0.0)], &model(), &MOTION);
        let feeds: Vec<f64> = program.waypoints.iter().map(|w| w.feed_mm_s).collect();
        assert_eq!(feeds, [100.0, 100.0, 20.0, 8.0, 8.0, 8.0, 8.0, 20.0, 100.0]);
    }

    #[test]
    fn segments_burn_between_the_waypoints_of_one_seam_and_nowhere_else() {
        let waypoints = program(&[line(1, 0.0, 0.0), line(2, 40.0, 0.0)], &model(), &MOTION).waypoints;
        let segments: Vec<Segment> = segments(&waypoints).collect();
        assert_eq!(segments.len(), waypoints.len());
        assert_eq!(segments.iter().filter(|segment| segment.weld).count(), 2 * 4);
        assert!(segments.iter().all(|segment| segment.weld == (segment.feed_mm_s == 8.0)));
    }

    #[test]
    fn no_seams_or_a_single_point_make_no_moves() {
        let lonely = SeamPath { seam: 1, points: line(1, 0.0, 0.0).points[..1].to_vec() };
        assert!(program(&[], &model(), &MOTION).waypoints.is_empty());
        assert!(program(&[lonely], &PointCloud::default(), &MOTION).waypoints.is_empty());
    }
}
