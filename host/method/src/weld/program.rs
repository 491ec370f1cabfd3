//! The complete program of a plan (not in the paper): approach, weld, retract, and free ways between the seams.

use nalgebra::{Point3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use super::PathPoint;
use super::air::terrain::Terrain;
use super::air::{End, Surroundings};
pub use super::pass::{Motion, Pass};

/// What a move is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Between seams.
    Air,
    /// Off the start of a weld, along the torch axis, or on the line before it.
    Approach,
    /// On a seam.
    Weld,
    /// Off the end of a weld, along the torch axis, on the line beyond it, or between two stitches.
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
    /// The arc burns on a move between two successive waypoints of one seam that both say so. It is struck, standing
    /// still, at the first and put out at the last: once for every stitch and pass.
    pub weld: bool,
    /// [`crate::seam::Seam::id`]; none in the air.
    pub seam: Option<usize>,
    /// What the move is for.
    pub kind: Kind,
    /// How long the torch stands still here, s; 0 stops exactly and goes on, none passes without a stop.
    pub dwell_s: Option<f64>,
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

/// All moves from the first approach to the last retract.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Program {
    /// In the order in which they are reached.
    pub waypoints: Vec<Waypoint>,
    /// Air moves that the scan leaves no room for, in words.
    pub warnings: Vec<String>,
}

/// Strings `passes` together in their order; a path with fewer than two welded points is left out.
pub fn program(passes: &[Pass], terrain: &Terrain) -> Program {
    let around = Surroundings::new(terrain, passes);
    let mut program = Program::default();
    let mut before: Option<(End, Moves)> = None;
    for pass in passes {
        let Some([first, last]) = pass.ends() else { continue };
        let moves = Moves { seam: pass.path.seam, motion: &pass.motion };
        let approach = around.end(first, pass.motion.approach_mm);
        program.go_to(&approach, &moves, before.as_ref(), &around);
        program.waypoints.extend(moves.along(&pass.path.points));
        before = Some((around.end(last, pass.motion.retract_mm), moves));
    }
    if let Some((end, moves)) = before {
        program.warn(end.way_out.free, &moves);
        program.waypoints.extend(end.way_out.via_mm.iter().map(|&via| moves.air(via, &end)));
    }
    program.turn_in_time();
    program
}

impl Program {
    /// From the safe level or from the pass before to the approach of the next.
    fn go_to(&mut self, approach: &End, next: &Moves, before: Option<&(End, Moves)>, around: &Surroundings) {
        let Some((retract, last)) = before else {
            self.warn(approach.way_out.free, next);
            let down = approach.way_out.via_mm.iter().rev();
            return self.waypoints.extend(down.map(|&via| next.air(via, approach)));
        };
        let way = around.way(retract, approach);
        self.warn(way.free || retract.way_out.free, last);
        self.warn(way.free || approach.way_out.free, next);
        self.waypoints.extend(way.out_mm.iter().map(|&via| last.air(via, retract)));
        self.waypoints.extend(way.back_mm.iter().map(|&via| next.air(via, approach)));
    }

    /// Between the welds the torch turns no faster than [`MOST_TURN_RAD_S`].
    fn turn_in_time(&mut self) {
        for k in 1..self.waypoints.len() {
            let (before, here) = (self.waypoints[k - 1], &mut self.waypoints[k]);
            let turn_rad = before.base_from_torch.angle_to(&here.base_from_torch);
            let way_mm = (here.position_mm - before.position_mm).norm();
            let most_mm_s = (way_mm * MOST_TURN_RAD_S / turn_rad.max(1e-9)).max(LEAST_FEED_MM_S);
            if !before.weld && !here.weld && most_mm_s < here.feed_mm_s {
                // Whole mm/s, since some controllers take no fraction.
                here.feed_mm_s = here.feed_mm_s.min(most_mm_s.floor());
            }
        }
    }

    fn warn(&mut self, free: bool, moves: &Moves) {
        let warning = blocked(moves.seam);
        if !free && !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }
}

fn blocked(seam: usize) -> String {
    format!(
        "seam {seam}: the scan leaves the torch no free way to or from it; check the air moves before they are run, \
         or try another approach_mm"
    )
}

/// Makes the waypoints of one pass.
struct Moves<'a> {
    seam: usize,
    motion: &'a Motion,
}

impl Moves<'_> {
    fn air(&self, position_mm: Point3<f64>, end: &End) -> Waypoint {
        self.free(position_mm, end.pose.base_from_torch)
    }

    fn free(&self, position_mm: Point3<f64>, base_from_torch: UnitQuaternion<f64>) -> Waypoint {
        Waypoint {
            position_mm,
            base_from_torch,
            feed_mm_s: self.motion.air_feed_mm_s,
            weld: false,
            seam: None,
            kind: Kind::Air,
            dwell_s: None,
        }
    }

    /// From the approach to the retract. What is not welded before the first stretch and after the last is on the line
    /// (lead-in, lead-out); between stretches the torch is lifted.
    fn along(&self, points: &[PathPoint]) -> Vec<Waypoint> {
        let (first, last) = (&points[0], &points[points.len() - 1]);
        let weld = |k: &usize| points[*k].process.weld;
        let first_weld = (0..points.len()).find(weld).unwrap_or(0);
        let last_weld = (0..points.len()).rfind(weld).unwrap_or(points.len() - 1);
        let Motion { approach_mm, retract_mm, approach_feed_mm_s: slow, air_feed_mm_s: fast, .. } =
            *self.motion;
        let mut waypoints = vec![self.lifted(first, approach_mm, Kind::Approach, fast)];
        for (k, point) in points.iter().enumerate() {
            match k {
                _ if point.process.weld => self.weld(points, k, &mut waypoints),
                lead_in if lead_in < first_weld => {
                    waypoints.push(self.lifted(point, 0.0, Kind::Approach, slow))
                }
                lead_out if lead_out > last_weld => {
                    waypoints.push(self.lifted(point, 0.0, Kind::Retract, slow))
                }
                _ => waypoints.push(self.lifted(point, self.motion.lift_mm, Kind::Retract, fast)),
            }
        }
        waypoints.push(self.lifted(last, retract_mm, Kind::Retract, slow));
        waypoints
    }

    /// A welded point; between stitches with the lift that leads to it, or off it.
    fn weld(&self, points: &[PathPoint], k: usize, waypoints: &mut Vec<Waypoint>) {
        let Motion { lift_mm, approach_feed_mm_s: slow, air_feed_mm_s: fast, .. } = *self.motion;
        let (point, burning) = (&points[k], k > 0 && points[k - 1].process.weld);
        if !burning && points[..k].iter().any(|point| point.process.weld) {
            waypoints.push(self.lifted(point, lift_mm, Kind::Approach, fast));
        }
        let feed_mm_s = if burning { self.feed_mm_s(point) } else { slow };
        let dwell_s = point.process.dwell_s;
        waypoints.push(Waypoint { weld: true, dwell_s, ..self.lifted(point, 0.0, Kind::Weld, feed_mm_s) });
        let ends = points.get(k + 1).is_some_and(|next| !next.process.weld);
        if ends && points[k..].iter().skip(1).any(|point| point.process.weld) {
            waypoints.push(self.lifted(point, lift_mm, Kind::Retract, slow));
        }
    }

    /// Speed of a welding move; what is faster than a robot may move in manual mode is slowed down to that.
    fn feed_mm_s(&self, point: &PathPoint) -> f64 {
        (self.motion.feed_mm_s * point.process.feed_factor).min(MOST_FEED_MM_S)
    }

    fn lifted(&self, point: &PathPoint, by_mm: f64, kind: Kind, feed_mm_s: f64) -> Waypoint {
        let position_mm = point.position_mm + point.out_of_work() * by_mm;
        Waypoint { feed_mm_s, seam: Some(self.seam), kind, ..self.free(position_mm, point.base_from_torch) }
    }
}

/// Fastest welding move, mm/s: manual mode of ISO 10218-1.
const MOST_FEED_MM_S: f64 = 250.0;

/// Fastest turn of the torch between seams, rad/s: a third of what the wrists of common arms can do.
const MOST_TURN_RAD_S: f64 = 1.0;

/// No move is slowed down to less than this, mm/s.
const LEAST_FEED_MM_S: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::super::SeamPath;
    use super::*;
    use crate::geometry::cloud::PointCloud;
    use crate::geometry::surface::Surface;
    use crate::weld::Process;
    use crate::weld::ends::{directions, lead};
    use nalgebra::Vector3;

    const MOTION: Motion = Motion {
        feed_mm_s: 8.0,
        approach_feed_mm_s: 20.0,
        air_feed_mm_s: 100.0,
        approach_mm: 50.0,
        retract_mm: 50.0,
        lift_mm: 5.0,
        clearance_mm: 30.0,
    };

    fn of(paths: &[SeamPath]) -> Program {
        let pass = |path: &SeamPath| Pass { path: path.clone(), motion: MOTION };
        let model = Surface::of(&model());
        let terrain = Terrain::new(&model, paths, MOTION.clearance_mm, None);
        program(&paths.iter().map(pass).collect::<Vec<_>>(), &terrain)
    }

    fn line(seam: usize, y_mm: f64, tilt_rad: f64) -> SeamPath {
        let base_from_torch = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt_rad);
        let at = |i| PathPoint {
            s_mm: f64::from(i),
            position_mm: Point3::new(0.0, y_mm + f64::from(i), 0.0),
            base_from_torch,
            process: Process::default(),
        };
        SeamPath { seam, points: (0..5).map(at).collect() }
    }

    fn model() -> PointCloud {
        let points_mm = vec![Point3::new(-200.0, 0.0, 0.0), Point3::new(-200.0, 9.0, 120.0)];
        PointCloud { origin_mm: Point3::origin(), points_mm, normals: vec![Vector3::z(); 2] }
    }

    #[test]
    fn every_seam_is_approached_and_left_along_its_torch_axis() {
        let program = of(&[line(1, 0.0, 0.5), line(2, 40.0, -0.5)]);
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
        let program = of(&[line(1, 0.0, 0.5), line(2, 40.0, -0.5)]);
        let crossing = |w: &&[Waypoint]| w[0].kind == Kind::Air && w[1].kind == Kind::Air;
        let crossings: Vec<_> = program.waypoints.windows(2).filter(crossing).collect();
        assert_eq!(crossings.len(), 1);
        assert!(crossings[0].iter().all(|w| (w.position_mm.z - 150.0).abs() < 1e-9));
        assert!(program.warnings.is_empty());
    }

    #[test]
    fn only_the_moves_along_a_seam_have_the_weld_feed() {
        let program = of(&[line(1, 0.0, 0.0)]);
        let feeds: Vec<f64> = program.waypoints.iter().map(|w| w.feed_mm_s).collect();
        assert_eq!(feeds, [100.0, 100.0, 20.0, 8.0, 8.0, 8.0, 8.0, 20.0, 100.0]);
    }

    #[test]
    fn segments_burn_between_the_waypoints_of_one_seam_and_nowhere_else() {
        let waypoints = of(&[line(1, 0.0, 0.0), line(2, 40.0, 0.0)]).waypoints;
        let segments: Vec<Segment> = segments(&waypoints).collect();
        assert_eq!(segments.len(), waypoints.len());
        assert_eq!(segments.iter().filter(|segment| segment.weld).count(), 2 * 4);
        assert!(segments.iter().all(|segment| segment.weld == (segment.feed_mm_s == 8.0)));
    }

    #[test]
    fn no_seams_or_a_single_point_make_no_moves() {
        let lonely = SeamPath { seam: 1, points: line(1, 0.0, 0.0).points[..1].to_vec() };
        assert!(of(&[]).waypoints.is_empty());
        assert!(of(&[lonely]).waypoints.is_empty());
        let pass = Pass { path: line(1, 0.0, 0.0), motion: MOTION };
        let nothing = Surface::of(&PointCloud::default());
        let terrain = Terrain::new(&nothing, [&pass.path], MOTION.clearance_mm, Some(&[]));
        assert!(
            !program(std::slice::from_ref(&pass), &terrain).waypoints.is_empty(),
            "a model without points is none"
        );
    }

    #[test]
    fn between_stitches_the_torch_is_lifted_and_the_arc_is_off() {
        let mut path = line(1, 0.0, 0.0);
        path.points[2].process.weld = false;
        let waypoints = of(&[path]).waypoints;
        let row = |w: &Waypoint| (w.kind, w.weld, w.position_mm.y, w.position_mm.z);
        let rows: Vec<_> = waypoints.iter().filter(|w| w.seam.is_some()).map(row).collect();
        let (a, w, r) = (Kind::Approach, Kind::Weld, Kind::Retract);
        assert_eq!(
            rows,
            [
                (a, false, 0.0, 50.0),
                (w, true, 0.0, 0.0),
                (w, true, 1.0, 0.0),
                (r, false, 1.0, 5.0),
                (r, false, 2.0, 5.0),
                (a, false, 3.0, 5.0),
                (w, true, 3.0, 0.0),
                (w, true, 4.0, 0.0),
                (r, false, 4.0, 50.0),
            ]
        );
        assert_eq!(segments(&waypoints).filter(|segment| segment.weld).count(), 2);
    }

    #[test]
    fn leads_are_on_the_line_without_an_arc() {
        let line = line(1, 0.0, 0.0);
        let waypoints = of(&[lead(&line, &directions(&line).unwrap(), 7.0, 3.0)]).waypoints;
        let on_line: Vec<_> = waypoints.iter().filter(|w| w.position_mm.z == 0.0).collect();
        let (first, last) = (on_line[0], on_line[on_line.len() - 1]);
        assert_eq!((first.kind, first.weld, first.position_mm.y), (Kind::Approach, false, -7.0));
        assert_eq!((last.kind, last.weld, last.position_mm.y), (Kind::Retract, false, 7.0));
        assert_eq!(segments(&waypoints).filter(|segment| segment.weld).count(), 4);
    }

    #[test]
    fn a_weave_faster_than_manual_mode_is_slowed_down() {
        let mut path = line(1, 0.0, 0.0);
        path.points[2].process.feed_factor = 2.0;
        path.points[3].process.feed_factor = 100.0;
        let feeds: Vec<f64> = of(&[path]).waypoints.iter().filter(|w| w.weld).map(|w| w.feed_mm_s).collect();
        assert_eq!(feeds, [20.0, 8.0, 16.0, 250.0, 8.0]);
    }
}
