//! Seams that go on round a corner of small radius (ours), as on a square tube: no two flat faces meet there, so a trace stops before it
//! and begins anew beyond, and a curve as stiff as the straight sides ask for would cut it.
//!
//! Two refined seams that end at such a corner share a face, and their lines meet ahead of both. The radius is the one at which the points
//! of the wall lie nearest to both lines and the arc between them; where it is too small to tell from a sharp corner, or points are
//! missing, the seams stay apart.

use super::Refined;
use super::frame::Frame;
use super::path::{PathPoint, frames, nearest, resampled};
use crate::geometry::grid::Grid;
use crate::seam::trace::{Chain, obstruction};
use nalgebra::{Point3, Vector2, Vector3};
use std::ops::Range;

/// Turns of such a corner, degrees: a smaller one is followed by the trace, a larger one leaves no wall between.
const LEAST_TURN_DEG: f32 = 30.0;
const MOST_TURN_DEG: f32 = 120.0;
/// Radii of such a corner, voxels: from what two voxels still tell from a sharp one to what a trace follows by itself; and the step in
/// which they are tried.
const LEAST_RADIUS_VOXELS: f32 = 2.0;
const MOST_RADIUS_VOXELS: f32 = 8.0;
const RADIUS_STEP_VOXELS: f32 = 0.25;
/// Points of the wall are looked at this high over the shared face, and are on an arc within so much of it, voxels.
const WALL_VOXELS: [f32; 2] = [2.0, 8.0];
const ON_ARC_VOXELS: f32 = 0.5;
/// Share of the voxels of that strip of the wall that have to be there.
const LEAST_SHARE: f32 = 0.5;
/// Cosine of one face, and farthest that the seams are off it, voxels.
const SAME_FACE: f32 = 0.9;
const OFF_FACE_VOXELS: f32 = 1.0;
/// The last stations of a seam may be across the corner: its line is taken before them, where it is long enough.
const UNSURE_STATIONS: usize = 3;
const LINE_STATIONS: usize = 4;
/// Shorter vectors have no direction.
const LEAST_LENGTH: f32 = 1e-3;

/// All seams, those joined that go on round a rounded corner; closed if they come round to themselves.
pub fn joined(mut seams: Vec<(Chain, Refined)>, model: &Grid, voxel_mm: f32) -> Vec<(Chain, Refined)> {
    let scene = Scene { model, voxel_mm };
    let mut k = 0;
    while k < seams.len() {
        let next = (k + 1..seams.len()).find_map(|j| Some((j, scene.either_way(&seams[k].1, &seams[j].1)?)));
        match next {
            Some((j, whole)) => {
                let (chain, _) = seams.swap_remove(j);
                seams[k].0.take(chain);
                seams[k].1 = whole;
            }
            None => {
                if let Some(closed) = scene.closed(&seams[k].1) {
                    seams[k].1 = closed;
                }
                k += 1;
            }
        }
    }
    seams
}

struct Scene<'a> {
    model: &'a Grid,
    voxel_mm: f32,
}

/// A rounded corner: its arc, and how many stations of the seams are before and beyond it.
struct Bend {
    arc: Vec<Frame>,
    before: usize,
    beyond: usize,
    /// Whether the faces of the second seam are in the other order.
    swapped: bool,
}

impl Scene<'_> {
    fn either_way(&self, a: &Refined, b: &Refined) -> Option<Refined> {
        if a.closed || b.closed {
            return None;
        }
        [(false, false), (false, true), (true, false), (true, true)].into_iter().find_map(
            |(turn_a, turn_b)| {
                let bend = self.bend(&run(a, turn_a), &run(b, turn_b), a.step_mm)?;
                let (first, second) = (turned(a, turn_a), turned(b, turn_b));
                let second = if bend.swapped { swapped(&second) } else { second };
                let from = second.frames.len() - bend.beyond;
                let stations = Stations::of(&first, 0..bend.before)
                    .with(&bend.arc)
                    .and(Stations::of(&second, from..second.frames.len()));
                stations.refined(&worse(&first, &second), false)
            },
        )
    }

    /// A seam closed round the corner between its end and its start.
    fn closed(&self, seam: &Refined) -> Option<Refined> {
        let bend = if seam.closed { None } else { self.bend(&seam.frames, &seam.frames, seam.step_mm) }?;
        let first = seam.frames.len() - bend.beyond;
        if bend.swapped || first >= bend.before {
            return None;
        }
        Stations::of(seam, first..bend.before).with(&bend.arc).refined(seam, true)
    }

    /// The corner from the end of `a` to the start of `b`, if wall and air bear it out.
    fn bend(&self, a: &[Frame], b: &[Frame], step_mm: f32) -> Option<Bend> {
        let (end, start) = (line_at_end(a)?, line_at_start(b)?);
        let apart = b.first()?.position - a.last()?.position;
        if apart.norm() > 2.0 * MOST_RADIUS_VOXELS * self.voxel_mm {
            return None;
        }
        [(0, 0), (0, 1), (1, 0), (1, 1)].into_iter().find_map(|(i, j)| {
            let is_shared = end.faces[i].dot(&start.faces[j]) > SAME_FACE
                && end.faces[i].dot(&apart).abs() < OFF_FACE_VOXELS * self.voxel_mm;
            let corner = if is_shared { Corner::between(&end, &start, [i, j]) } else { None }?;
            let radius_mm = self.radius_mm(&corner)?;
            let tangent_mm = corner.tangent_mm(radius_mm);
            let before = |f: &Frame| (f.position - corner.apex).dot(&corner.ahead) < -tangent_mm;
            let beyond = |f: &Frame| (f.position - corner.apex).dot(&start.tangent) > tangent_mm;
            let arc = corner.arc(radius_mm, step_mm);
            let bend = Bend {
                arc,
                before: a.len() - a.iter().rev().take_while(|f| !before(f)).count(),
                beyond: b.len() - b.iter().take_while(|f| !beyond(f)).count(),
                swapped: i != j,
            };
            let is_free = bend.arc.windows(2).all(|w| {
                !obstruction::blocked(self.model, self.voxel_mm, &w[0].position, &w[1].position, &w[0].faces)
            });
            (bend.before > 1 && bend.beyond > 1 && is_free).then_some(bend)
        })
    }

    /// The radius at which the wall's points lie nearest to both lines and the arc between, if enough lie on the arc.
    fn radius_mm(&self, corner: &Corner) -> Option<f32> {
        let v = self.voxel_mm;
        let reach_mm = MOST_RADIUS_VOXELS.hypot(WALL_VOXELS[1]) * v;
        let mut wall = Vec::new();
        self.model.within(&corner.apex, reach_mm, |slot, _| {
            let (at, height_mm) = corner.flat(&self.model.point(slot));
            if (WALL_VOXELS[0] * v..WALL_VOXELS[1] * v).contains(&height_mm) {
                wall.push(at);
            }
        });
        let most_mm = ON_ARC_VOXELS * v;
        let off = |radius_mm: f32| -> f32 {
            wall.iter().map(|at| corner.off_mm(at, radius_mm).0.min(2.0 * most_mm).powi(2)).sum()
        };
        let steps = (MOST_RADIUS_VOXELS / RADIUS_STEP_VOXELS) as usize;
        let radii = (0..=steps).map(|k| k as f32 * RADIUS_STEP_VOXELS * v);
        let (radius_mm, _) = radii.map(|r| (r, off(r))).min_by(|a, b| a.1.total_cmp(&b.1))?;
        let is_on_arc = |at: &&Vector2<f32>| {
            let (off_mm, of_arc) = corner.off_mm(at, radius_mm);
            of_arc && off_mm < most_mm
        };
        let strip = corner.turn_rad * radius_mm / v * (WALL_VOXELS[1] - WALL_VOXELS[0]);
        let is_round = radius_mm >= LEAST_RADIUS_VOXELS * v
            && wall.iter().filter(is_on_arc).count() as f32 > LEAST_SHARE * strip;
        is_round.then_some(radius_mm)
    }
}

/// Stations to be resampled, and what is known of each.
struct Stations {
    points: Vec<PathPoint>,
    measured: Vec<bool>,
    view_share: Vec<[Vec<f32>; 2]>,
}

impl Stations {
    fn of(seam: &Refined, range: Range<usize>) -> Self {
        Self {
            points: seam.frames[range.clone()].iter().map(PathPoint::from).collect(),
            measured: seam.measured[range.clone()].to_vec(),
            view_share: seam.view_share[range].to_vec(),
        }
    }

    /// Then those of an arc, seen as the last station was.
    fn with(mut self, arc: &[Frame]) -> Self {
        let share = self.view_share.last().cloned().unwrap_or_default();
        self.points.extend(arc.iter().map(PathPoint::from));
        self.measured.extend(arc.iter().map(|_| true));
        self.view_share.extend(arc.iter().map(|_| share.clone()));
        self
    }

    fn and(mut self, after: Self) -> Self {
        self.points.extend(after.points);
        self.measured.extend(after.measured);
        self.view_share.extend(after.view_share);
        self
    }

    /// At equal steps, with all else as in `like`.
    fn refined(self, like: &Refined, closed: bool) -> Option<Refined> {
        let (points, step_mm) = resampled(&self.points, closed, like.step_mm);
        let frames = frames(&points, closed)?;
        let of = |k: usize| nearest(k, points.len(), self.points.len());
        Some(Refined {
            measured: (0..points.len()).map(|k| self.measured[of(k)]).collect(),
            view_share: (0..points.len()).map(|k| self.view_share[of(k)].clone()).collect(),
            frames,
            step_mm,
            closed,
            ..like.clone()
        })
    }
}

/// The stations of a seam, or of the same seen by a weld that runs the other way.
fn run(seam: &Refined, is_turned: bool) -> Vec<Frame> {
    if is_turned { seam.frames.iter().rev().map(Frame::reversed).collect() } else { seam.frames.clone() }
}

fn turned(seam: &Refined, is_turned: bool) -> Refined {
    let mut seam = Refined { frames: run(seam, is_turned), ..seam.clone() };
    if is_turned {
        seam.measured.reverse();
        seam.view_share.reverse();
    }
    seam
}

/// The same with its faces in the other order.
fn swapped(seam: &Refined) -> Refined {
    let flip = |[a, b]: [f32; 2]| [b, a];
    let [a, b] = seam.lift_unknown_mm;
    Refined {
        frames: seam.frames.iter().map(|f| Frame { faces: [f.faces[1], f.faces[0]], ..*f }).collect(),
        view_share: seam.view_share.iter().map(|[a, b]| [b.clone(), a.clone()]).collect(),
        reach_mm: flip(seam.reach_mm),
        lift_unknown_mm: [b, a],
        ..seam.clone()
    }
}

/// What holds of two seams together: of each figure the worse one.
fn worse(a: &Refined, b: &Refined) -> Refined {
    let mut near = [a.near.as_slice(), &b.near].concat();
    near.sort_unstable();
    near.dedup();
    Refined {
        sigma_mm: a.sigma_mm.max(b.sigma_mm),
        scatter_mm: a.scatter_mm.max(b.scatter_mm),
        tilt_rad: a.tilt_rad.max(b.tilt_rad),
        reach_mm: [0, 1].map(|k| a.reach_mm[k].min(b.reach_mm[k])),
        lift_unknown_mm: [0, 1].map(|k| a.lift_unknown_mm[k].max(b.lift_unknown_mm[k])),
        freedom: a.freedom + b.freedom,
        near,
        ..a.clone()
    }
}

/// The line of a seam's last stations that are surely before the corner.
fn line_at_end(frames: &[Frame]) -> Option<Frame> {
    let from = frames.len().checked_sub(UNSURE_STATIONS + LINE_STATIONS);
    line(from.map_or(frames, |from| &frames[from..from + LINE_STATIONS]))
}

fn line_at_start(frames: &[Frame]) -> Option<Frame> {
    line(frames.get(UNSURE_STATIONS..UNSURE_STATIONS + LINE_STATIONS).unwrap_or(frames))
}

fn line(frames: &[Frame]) -> Option<Frame> {
    let sum = |of: &dyn Fn(&Frame) -> Vector3<f32>| frames.iter().map(of).sum::<Vector3<f32>>();
    let place = sum(&|frame| frame.position.coords) / frames.len().max(1) as f32;
    Frame::new(Point3::from(place), sum(&|frame| frame.tangent), [0, 1].map(|k| sum(&|frame| frame.faces[k])))
}

/// A corner between two lines on one face.
struct Corner {
    /// Where the lines meet.
    apex: Point3<f32>,
    /// Unit: along the first line, and across it to the side of the second.
    ahead: Vector3<f32>,
    across: Vector3<f32>,
    /// The shared face, and which of a station's faces it is.
    shared: Vector3<f32>,
    k: usize,
    turn_rad: f32,
}

impl Corner {
    /// Of a line that ends and one that starts ahead of it, round the outside of a wall.
    fn between(end: &Frame, start: &Frame, [k, of_start]: [usize; 2]) -> Option<Self> {
        let shared = end.faces[k];
        let flat = |d: &Vector3<f32>| (d - shared * shared.dot(d)).try_normalize(LEAST_LENGTH);
        let (ahead, onward) = (flat(&end.tangent)?, flat(&start.tangent)?);
        let across = (onward - ahead * ahead.dot(&onward)).try_normalize(LEAST_LENGTH)?;
        let turn_rad = ahead.angle(&onward);
        let way = start.position - end.position;
        let beyond_mm = way.dot(&across) / turn_rad.sin();
        let before_mm = way.dot(&ahead) - beyond_mm * turn_rad.cos();
        let turns = (LEAST_TURN_DEG..MOST_TURN_DEG).contains(&turn_rad.to_degrees());
        let beyond = ahead * turn_rad.sin() - across * turn_rad.cos();
        let is_outside =
            end.faces[1 - k].dot(&across) < -SAME_FACE && start.faces[1 - of_start].dot(&beyond) > SAME_FACE;
        let apex = end.position + ahead * before_mm;
        (turns && is_outside && before_mm > 0.0 && beyond_mm > 0.0).then_some(Self {
            apex,
            ahead,
            across,
            shared,
            k,
            turn_rad,
        })
    }

    /// From the apex to where the arc begins and ends.
    fn tangent_mm(&self, radius_mm: f32) -> f32 {
        radius_mm * (0.5 * self.turn_rad).tan()
    }

    /// Along the first line and across it, from the apex, and the height over the shared face.
    fn flat(&self, p: &Point3<f32>) -> (Vector2<f32>, f32) {
        let d = p - self.apex;
        (Vector2::new(d.dot(&self.ahead), d.dot(&self.across)), d.dot(&self.shared))
    }

    /// How far a place is from the lines and the arc between, mm, and whether it is the arc that it is near to.
    fn off_mm(&self, at: &Vector2<f32>, radius_mm: f32) -> (f32, bool) {
        let from_centre = at - Vector2::new(-self.tangent_mm(radius_mm), radius_mm);
        let angle_rad = from_centre.x.atan2(-from_centre.y);
        let onward = Vector2::new(self.turn_rad.cos(), self.turn_rad.sin());
        if angle_rad < 0.0 {
            (at.y.abs(), false)
        } else if angle_rad > self.turn_rad {
            (onward.perp(at).abs(), false)
        } else {
            ((from_centre.norm() - radius_mm).abs(), true)
        }
    }

    /// Stations along the arc, its ends among them.
    fn arc(&self, radius_mm: f32, step_mm: f32) -> Vec<Frame> {
        let centre = self.apex - self.ahead * self.tangent_mm(radius_mm) + self.across * radius_mm;
        let count = (self.turn_rad * radius_mm / step_mm).round().max(2.0) as usize;
        let station = |j: usize| {
            let (sin, cos) = (self.turn_rad * j as f32 / count as f32).sin_cos();
            let wall = self.ahead * sin - self.across * cos;
            let mut faces = [self.shared; 2];
            faces[1 - self.k] = wall;
            Frame {
                position: centre + wall * radius_mm,
                tangent: self.ahead * cos + self.across * sin,
                faces,
            }
        };
        (0..=count).map(station).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of two walls that meet in a corner at the origin, rounded by `radius_mm`, up to `high_mm` over the floor.
    fn walls(radius_mm: f32, high_mm: f32) -> Grid {
        let outline = (0..120).map(|k| {
            let s = 0.5 * k as f32 - 30.0;
            let arc = radius_mm * std::f32::consts::FRAC_PI_2;
            let (sin, cos) = (s / radius_mm).sin_cos();
            match s {
                s if s < 0.0 => Vector2::new(-radius_mm + s, 0.0),
                s if s < arc => Vector2::new(radius_mm * (sin - 1.0), radius_mm * (1.0 - cos)),
                s => Vector2::new(0.0, radius_mm + s - arc),
            }
        });
        let outline: Vec<_> = outline.collect();
        let heights = || (0..).map(|k| k as f32).take_while(|z| *z < high_mm);
        let points: Vec<Point3<f32>> =
            outline.iter().flat_map(|at| heights().map(|z| Point3::new(at.x, at.y, z))).collect();
        Grid::new(&points, 4.8)
    }

    /// Along x to the corner, and from it along y; the walls face -y and +x.
    fn lines() -> [Frame; 2] {
        let line = |at: [f32; 3], tangent: Vector3<f32>, wall: Vector3<f32>| {
            Frame::new(Point3::from(at), tangent, [wall, Vector3::z()]).expect("square")
        };
        [
            line([-15.0, 0.0, 0.0], Vector3::x(), -Vector3::y()),
            line([0.0, 15.0, 0.0], Vector3::y(), Vector3::x()),
        ]
    }

    fn radius_mm(model: &Grid) -> Option<f32> {
        let [end, start] = lines();
        let corner = Corner::between(&end, &start, [1, 1]).expect("a corner");
        Scene { model, voxel_mm: 1.2 }.radius_mm(&corner)
    }

    #[test]
    fn the_wall_tells_the_radius() {
        for radius in [3.0, 6.0, 9.0] {
            let found = radius_mm(&walls(radius, 12.0)).expect("rounded");
            assert!((found - radius).abs() < 0.3, "{found} of {radius} mm");
        }
    }

    #[test]
    fn a_sharp_corner_and_one_without_a_wall_are_not_rounded() {
        assert_eq!(radius_mm(&walls(0.1, 12.0)), None);
        assert_eq!(radius_mm(&walls(6.0, 3.0)), None, "hardly above the floor");
    }

    #[test]
    fn the_arc_touches_both_lines() {
        let [end, start] = lines();
        let corner = Corner::between(&end, &start, [1, 1]).expect("a corner");
        let arc = corner.arc(6.0, 2.0);
        let (first, last) = (arc[0], arc[arc.len() - 1]);
        assert!((first.position - Point3::new(-6.0, 0.0, 0.0)).norm() < 1e-3);
        assert!((last.position - Point3::new(0.0, 6.0, 0.0)).norm() < 1e-3);
        assert!(
            (first.tangent - end.tangent).norm() < 1e-3 && (last.faces[0] - start.faces[0]).norm() < 1e-3
        );
    }

    #[test]
    fn nothing_goes_on_round_an_inside_corner_or_from_one_side_of_a_wall_to_the_other() {
        let [end, start] = lines();
        let inside = |frame: &Frame| Frame { faces: [-frame.faces[0], frame.faces[1]], ..*frame };
        assert!(Corner::between(&inside(&end), &inside(&start), [1, 1]).is_none());
        assert!(Corner::between(&end, &inside(&start), [1, 1]).is_none());
    }
}
