//! Where the work is held and not welded (ours): two bodies face each other across a third, as the jaws of a vise do, and nothing else ties
//! them to it.
//!
//! The surface is parted into bodies along its inside corners, and the corners tell which bodies touch. Walls that a rib or another wall
//! braces are of the work. Where nothing is welded on the body between, it may as well be a beam's web between its flanges, and is
//! left as it is.

use crate::seam::input::SurfaceModel;
use crate::seam::refine::frame::Frame;
use crate::seam::trace::InsideCorner;
use crate::seam::{Contact, Seam};
use nalgebra::{Point3, Vector3};

/// Points nearer to an inside corner than this are of no body, voxels: normals about it are of both faces.
const CUT_VOXELS: f32 = 3.0;
/// Points within this of each other are of one body, voxels: those of two neighbouring voxels at their farthest.
const LINK_VOXELS: f32 = 2.0;
/// A face is looked up this far from the corner, and within so much of there, voxels.
const BESIDE_VOXELS: f32 = 4.5;
const NEAR_VOXELS: f32 = 1.5;
/// Cosine of directions that count as one.
const SAME_DIRECTION: f32 = 0.9;
/// Fewer corners are no line: the shortest seam has as many.
const LEAST_CORNERS: usize = 20;
/// What ties two bodies above the face that is held is this high, voxels.
const ABOVE_VOXELS: f32 = 3.0;
/// Shorter vectors have no direction.
const LEAST_LENGTH: f32 = 1e-3;

/// Marks the seams that may be where the work is held, and those of what holds it. `corners` are those that are not on the table, long
/// enough for a seam or not; `on_table` the places of the others, mm, in the model's frame.
pub(crate) fn mark_contacts(
    seams: &mut [Seam],
    corners: &[InsideCorner],
    on_table: impl Iterator<Item = Point3<f32>>,
    model: &SurfaceModel,
) {
    if !any_across(corners) {
        return;
    }
    let mut bodies = Bodies::parted(model, corners.iter().map(|corner| corner.position).chain(on_table));
    let of_corners = |bodies: &Bodies| {
        lines(corners, |corner| {
            let beside = |k| bodies.beside(&corner.position, &corner.faces, k);
            Some([beside(0)?, beside(1)?])
        })
    };
    bodies.join(webs(&of_corners(&bodies)));
    let mut lines = of_corners(&bodies);
    lines.retain(|line| line.bodies[0] != line.bodies[1]);
    let sides: Vec<Sides> = seams.iter().map(|seam| bodies.sides_of(seam)).collect();
    for k in contacts(&lines, &sides, ABOVE_VOXELS * model.voxel_mm()) {
        seams[k].mark_contact(Contact::Held);
    }
}

/// Whether any two corners on faces of one direction have other faces that look at each other, so that it pays to part bodies.
fn any_across(corners: &[InsideCorner]) -> bool {
    // Directions of the two faces, and the least place along the second.
    let mut known: Vec<([Vector3<f32>; 2], f32)> = Vec::new();
    for corner in corners {
        let [a, b] = corner.faces;
        for faces in [[a, b], [b, a]] {
            let along_mm = faces[1].dot(&corner.position.coords);
            let same = |other: &[Vector3<f32>; 2]| (0..2).all(|k| other[k].dot(&faces[k]) > SAME_DIRECTION);
            match known.iter_mut().find(|(other, _)| same(other)) {
                Some((_, least_mm)) => *least_mm = along_mm.min(*least_mm),
                None => known.push((faces, along_mm)),
            }
        }
    }
    let is_across = |(a, a_mm): &([Vector3<f32>; 2], f32), (b, b_mm): &([Vector3<f32>; 2], f32)| {
        a[0].dot(&b[0]) > SAME_DIRECTION && a[1].dot(&b[1]) < -SAME_DIRECTION && a_mm + b_mm < 0.0
    };
    known.iter().enumerate().any(|(k, a)| known[..k].iter().any(|b| is_across(a, b)))
}

/// The bodies on the two faces of a seam, where they are known.
type Sides = [Option<usize>; 2];

/// Inside corners between the same two bodies, on faces of the same directions.
#[derive(Clone)]
struct Line {
    bodies: [usize; 2],
    faces: [Vector3<f32>; 2],
    direction: Vector3<f32>,
    place_mm: Vector3<f32>,
    count: usize,
}

/// The lines in which bodies touch, or one has an inside corner of its own.
fn lines(corners: &[InsideCorner], bodies_of: impl Fn(&InsideCorner) -> Option<[usize; 2]>) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    for corner in corners {
        let Some([a, b]) = bodies_of(corner) else { continue };
        let faces = if a <= b { corner.faces } else { [corner.faces[1], corner.faces[0]] };
        let bodies = [a.min(b), a.max(b)];
        let is_on = |line: &&mut Line| {
            line.bodies == bodies && (0..2).all(|k| line.faces[k].dot(&faces[k]) > SAME_DIRECTION)
        };
        match lines.iter_mut().find(is_on) {
            Some(line) => {
                line.place_mm += corner.position.coords;
                line.count += 1;
            }
            None => lines.push(Line {
                bodies,
                faces,
                direction: corner.direction,
                place_mm: corner.position.coords,
                count: 1,
            }),
        }
    }
    lines.retain(|line| line.count >= LEAST_CORNERS);
    lines.iter_mut().for_each(|line| line.place_mm /= line.count as f32);
    lines
}

/// Bodies that are one: a web, and the half of its plate that nothing but the web parts from the other half. The web's flush end ties
/// that to it, and its foot there is a corner of one body.
fn webs(lines: &[Line]) -> Groups {
    let mut groups = Groups::default();
    for own in lines.iter().filter(|line| line.bodies[0] == line.bodies[1]) {
        for line in lines.iter().filter(|line| line.bodies[0] != line.bodies[1]) {
            let is_foot = |web: usize, wall: usize| {
                line.bodies[web] == own.bodies[0]
                    && line.faces[web].dot(&own.faces[wall]) < -SAME_DIRECTION
                    && line.faces[1 - web].dot(&own.faces[1 - wall]) > SAME_DIRECTION
            };
            if [(0, 0), (0, 1), (1, 0), (1, 1)].into_iter().any(|(web, wall)| is_foot(web, wall)) {
                groups.join(line.bodies);
            }
        }
    }
    groups
}

/// Two lines of a body across each other: the bodies that meet it in them look at each other, or away from each other.
struct Pair {
    lines: [usize; 2],
    held: usize,
    jaws: [usize; 2],
    /// Of the face between.
    normal: Vector3<f32>,
    inwards: bool,
}

impl Pair {
    /// Whether a line is of the body between with one of those that grip it.
    fn holds_by(&self, line: &Line) -> bool {
        self.jaws.iter().any(|&jaw| line.is_of(self.held, jaw))
    }

    /// Whether a line is where the body between lies on what carries both that grip it, as it would on the table.
    fn rests_by(&self, line: &Line, lines: &[Line]) -> bool {
        let carries = |body: usize, jaw: usize| {
            lines.iter().any(|l| l.is_of(body, jaw) && l.face_of(body).dot(&self.normal) > SAME_DIRECTION)
        };
        let is_carrier = |body: usize| self.jaws.iter().all(|&jaw| carries(body, jaw));
        let [a, b] = line.bodies;
        a == self.held && is_carrier(b) || b == self.held && is_carrier(a)
    }
}

impl Line {
    fn is_of(&self, a: usize, b: usize) -> bool {
        self.bodies == [a.min(b), a.max(b)]
    }

    fn face_of(&self, body: usize) -> &Vector3<f32> {
        &self.faces[usize::from(self.bodies[1] == body)]
    }
}

fn pairs(lines: &[Line]) -> Vec<Pair> {
    let mut found = Vec::new();
    for (m, b) in lines.iter().enumerate() {
        for (l, a) in lines[..m].iter().enumerate() {
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let [jaw, other] = [&a.faces[1 - i], &b.faces[1 - j]];
                let across = a.bodies[i] == b.bodies[j]
                    && a.faces[i].dot(&b.faces[j]) > SAME_DIRECTION
                    && jaw.dot(other) < -SAME_DIRECTION
                    && a.direction.dot(&b.direction).abs() > SAME_DIRECTION;
                if across {
                    found.push(Pair {
                        lines: [l, m],
                        held: a.bodies[i],
                        jaws: [a.bodies[1 - i], b.bodies[1 - j]],
                        normal: a.faces[i],
                        inwards: jaw.dot(&(b.place_mm - a.place_mm)) > 0.0,
                    });
                }
            }
        }
    }
    found
}

/// Which seams are contacts.
fn contacts(lines: &[Line], sides: &[Sides], above_mm: f32) -> Vec<usize> {
    let pairs = pairs(lines);
    // A web has the face that it stands on at both of its sides.
    let is_web = |body: usize, grip: &Pair| {
        let stands = |p: &&Pair| p.held == grip.held && p.normal.dot(&grip.normal) > SAME_DIRECTION;
        pairs.iter().filter(stands).any(|p| !p.inwards && p.jaws == [body, body])
    };
    let is_grip = |pair: &&Pair| pair.inwards && !pair.jaws.iter().any(|&jaw| is_web(jaw, pair));
    let grips: Vec<&Pair> = pairs.iter().filter(is_grip).collect();
    let mut groups = Groups::default();
    let ties = |line: &&Line| !grips.iter().any(|grip| grip.holds_by(line) || grip.rests_by(line, lines));
    lines.iter().filter(ties).for_each(|line| groups.join(line.bodies));
    let mut found = Vec::new();
    for grip in grips {
        let held = groups.of(grip.held);
        let jaws = grip.jaws.map(|jaw| groups.of(jaw));
        let first = &lines[grip.lines[0]];
        let is_held = |body: usize| groups.of(body) == held;
        let holds = |body: usize| jaws.contains(&groups.of(body));
        let braces = |line: &Line| {
            let [a, b] = line.bodies;
            let is_along = line.direction.dot(&first.direction).abs() > SAME_DIRECTION;
            // The end of a plate meets what holds it below its face.
            let is_end = line.direction.dot(&grip.normal).abs() > SAME_DIRECTION
                && grip.normal.dot(&(line.place_mm - first.place_mm)) < above_mm;
            let is_between = is_held(a) && holds(b) || is_held(b) && holds(a);
            is_between && !is_along && !is_end && !grip.rests_by(line, lines)
        };
        let on = |k: &usize, one: &dyn Fn(usize) -> bool, two: &dyn Fn(usize) -> bool| {
            let [Some(a), Some(b)] = sides[*k] else { return false };
            one(a) && two(b) || one(b) && two(a)
        };
        let has_own_seam = (0..sides.len()).any(|k| on(&k, &is_held, &is_held));
        if !jaws.contains(&held) && has_own_seam && !lines.iter().any(braces) {
            found.extend((0..sides.len()).filter(|k| on(k, &is_held, &holds) || on(k, &holds, &holds)));
        }
    }
    found
}

/// Bodies that belong together.
#[derive(Default)]
struct Groups {
    next: Vec<usize>,
}

impl Groups {
    fn of(&self, mut body: usize) -> usize {
        while let Some(&next) = self.next.get(body).filter(|next| **next != body) {
            body = next;
        }
        body
    }

    fn join(&mut self, [a, b]: [usize; 2]) {
        let known = self.next.len();
        self.next.extend(known..known.max(a.max(b) + 1));
        let (a, b) = (self.of(a), self.of(b));
        self.next[a.max(b)] = a.min(b);
    }
}

/// The points of a model by the body that they are of; those next to inside corners are of none.
struct Bodies<'a> {
    model: &'a SurfaceModel<'a>,
    /// By slots of the model's index.
    of_point: Vec<Option<usize>>,
}

impl<'a> Bodies<'a> {
    fn parted(model: &'a SurfaceModel<'a>, corners: impl Iterator<Item = Point3<f32>>) -> Self {
        let (index, v) = (model.index, model.voxel_mm());
        let mut open = vec![true; index.len()];
        for corner in corners {
            index.within(&corner, CUT_VOXELS * v, |slot, _| open[slot] = false);
        }
        let mut of_point = vec![None; index.len()];
        let mut ahead = Vec::new();
        let mut body = 0;
        for first in 0..index.len() {
            if !std::mem::take(&mut open[first]) {
                continue;
            }
            ahead.push(first);
            while let Some(slot) = ahead.pop() {
                of_point[slot] = Some(body);
                index.within(&index.point(slot), LINK_VOXELS * v, |near, _| {
                    if std::mem::take(&mut open[near]) {
                        ahead.push(near);
                    }
                });
            }
            body += 1;
        }
        Self { model, of_point }
    }

    /// Makes one of those that belong together.
    fn join(&mut self, groups: Groups) {
        self.of_point.iter_mut().flatten().for_each(|body| *body = groups.of(*body));
    }

    /// The bodies that most stations of a seam have on their faces.
    fn sides_of(&self, seam: &Seam) -> Sides {
        let frames: Vec<Frame> =
            seam.stations.iter().map(|station| Frame::of(station, &self.model.cloud.origin_mm)).collect();
        [0, 1].map(|k| {
            let beside = |frame: &Frame| self.beside(&frame.position, &frame.faces, k);
            let mut bodies: Vec<usize> = frames.iter().filter_map(beside).collect();
            bodies.sort_unstable();
            let runs = bodies.chunk_by(|a, b| a == b);
            runs.max_by_key(|run| run.len()).map(|run| run[0])
        })
    }

    /// The body on a face beside a corner.
    fn beside(&self, place: &Point3<f32>, faces: &[Vector3<f32>; 2], k: usize) -> Option<usize> {
        let v = self.model.voxel_mm();
        let (face, other) = (faces[k], faces[1 - k]);
        let away = (other - face * face.dot(&other)).try_normalize(LEAST_LENGTH)?;
        let at = place + away * (BESIDE_VOXELS * v);
        let (slot, _) =
            self.model.index.nearest(&at, NEAR_VOXELS * v, |slot| self.of_point[slot].is_some())?;
        self.of_point[slot]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(bodies: [usize; 2], faces: [Vector3<f32>; 2]) -> Line {
        Line { bodies, faces, direction: Vector3::x(), place_mm: Vector3::zeros(), count: LEAST_CORNERS }
    }

    /// A web (1) on a plate between two jaws (3, 4); its flush end makes one body of it and of the plate on one side.
    #[test]
    fn a_web_ties_both_halves_of_its_plate_and_no_jaw() {
        let (up, left, right) = (Vector3::z(), Vector3::y(), -Vector3::y());
        let own_foot = line([1, 1], [up, left]);
        let other_foot = line([1, 2], [right, up]);
        let jaws = [line([2, 3], [up, left]), line([1, 4], [up, right])];
        let groups = webs(&[vec![own_foot, other_foot], jaws.into()].concat());
        assert_eq!(groups.of(1), groups.of(2));
        assert!(groups.of(3) != groups.of(1) && groups.of(4) != groups.of(1));
        assert_eq!(webs(&[line([1, 2], [right, up])]).of(2), 2, "a wall that is seen from one side only");
    }
}
