//! Stretches of a line in which two faces make an inside corner with air in it.

use super::meeting::Meeting;
use super::{GAP_MM, OPENING_DEG};
use crate::geometry::mesh::{Mesh, Side, directions};
use nalgebra::{Point3, Vector3};

/// A straight piece of a seam.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub ends: [Point3<f64>; 2],
    /// Unit, from the first end to the second.
    pub along: Vector3<f64>,
    /// Unit normals of the two faces, into the air between them.
    pub normals: [Vector3<f64>; 2],
    /// How far the torch can be seen off along the bisector, mm; none if nothing is in the way.
    pub blocked_mm: Option<f64>,
    /// Share of it whose air is seen from outside.
    pub seen: f64,
}

impl Piece {
    pub(super) fn length_mm(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }

    pub(super) fn middle(&self) -> Point3<f64> {
        nalgebra::center(&self.ends[0], &self.ends[1])
    }
}

/// Height off the other face at which a face has to be there: above any gap, within the edge of the thinnest sheet. The
/// middle of a chord of that length is in the air of the corner or in what fills it.
const FACE_MM: f64 = 0.6;
/// Heights at which a face may begin, up to the gap.
const BEGINS_MM: [f64; 7] = [0.02, 0.1, 0.2, 0.3, 0.4, 0.48, 0.52];
/// Cosine of the turn between facets of one plane, 0.3 degrees.
const SAME_PLANE_COSINE: f64 = 0.999_986;
const CHORD_MM: f64 = 2.0 * GAP_MM;
/// Share of the chord that is looked along: next to its ends a curved face may cross it.
const CHORD_SHARE: [f64; 2] = [0.2, 0.8];
/// How far a curved face leaves its tangent plane over that height, and how far its strips turn.
const OFF_PLANE_MM: f64 = 0.2;
pub(super) const ALIKE_COSINE: f64 = 0.86;
/// Distance of the places on a line that are looked at, mm, and least and largest number of them.
const STEP_MM: f64 = 1.0;
const PLACES: [usize; 2] = [4, 4096];
/// Ends are found to this many halvings of a step.
const HALVINGS: usize = 14;
/// Shorter pieces are rounding, mm.
const LEAST_MM: f64 = 0.02;
/// Rays that must leave a corner for it to be seen from outside, of how many: first a few, then enough for a narrow gap
/// between ribs. Fewer leave through the cracks between bodies.
const LOOKS: [(usize, usize); 2] = [(2, 64), (4, 384)];

/// Rays all round, of which those between the faces tell whether a place is inside a body.
const SOLID_LOOKS: usize = 64;

/// One of the four wedges between two planes.
struct Wedge<'a> {
    mesh: &'a Mesh,
    meeting: &'a Meeting,
    /// From the line into each face.
    into: [Vector3<f64>; 2],
    /// Of each face, into the wedge.
    normals: [Vector3<f64>; 2],
    /// Sine of the angle between the faces.
    sine: f64,
}

/// The inside corners of a meeting.
pub(super) fn pieces(mesh: &Mesh, meeting: &Meeting) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for signs in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
        if let Some(wedge) = Wedge::new(mesh, meeting, signs) {
            for span in &meeting.spans_mm {
                pieces.extend(wedge.runs(*span).into_iter().map(|run| wedge.piece(run)));
            }
        }
    }
    pieces
}

impl<'a> Wedge<'a> {
    /// None if it is too narrow or too wide.
    fn new(mesh: &'a Mesh, meeting: &'a Meeting, signs: [f64; 2]) -> Option<Self> {
        let planes = meeting.faces.map(|face| mesh.faces[face as usize].normal);
        let into = [0, 1].map(|k| meeting.line.along.cross(&planes[k]) * signs[k]);
        let opening_deg = into[0].dot(&into[1]).clamp(-1.0, 1.0).acos().to_degrees();
        let toward = |k: usize| if planes[k].dot(&into[1 - k]) < 0.0 { -planes[k] } else { planes[k] };
        let sine = into[0].cross(&into[1]).norm();
        let open = (OPENING_DEG[0]..OPENING_DEG[1]).contains(&opening_deg);
        open.then(|| Self { mesh, meeting, into, normals: [toward(0), toward(1)], sine })
    }

    fn at(&self, t_mm: f64) -> Point3<f64> {
        self.meeting.line.origin + self.meeting.line.along * t_mm
    }

    /// Whether both faces are there, with air between them.
    fn holds(&self, t_mm: f64) -> bool {
        let p = self.at(t_mm);
        if !(0..2).all(|k| self.is_there(k, &p)) {
            return false;
        }
        let [a, b] = self.chord(t_mm);
        let [from, to] = CHORD_SHARE;
        self.mesh.tree.is_free(&(a + (b - a) * from), &(b - a), to - from)
            && !self.is_solid(&nalgebra::center(&a, &b))
    }

    /// Across the corner, from face to face.
    fn chord(&self, t_mm: f64) -> [Point3<f64>; 2] {
        let p = self.at(t_mm);
        self.into.map(|into| p + into * CHORD_MM)
    }

    /// Whether a place in the wedge is inside a body, as where two faces go on into a wall that stands on both: most of what is
    /// met first between the faces turns its back.
    fn is_solid(&self, from: &Point3<f64>) -> bool {
        let mesh = self.mesh;
        let meets_a_back = |direction: &Vector3<f64>| {
            let mut first = (f64::INFINITY, false);
            mesh.tree.any_hit(from, direction, f64::INFINITY, |hit| {
                let away = mesh.normals[hit.facet as usize].dot(direction);
                let is_back = match mesh.sides[hit.facet as usize] {
                    Side::Front => away > 0.0,
                    Side::Back => away < 0.0,
                    Side::Both => false,
                };
                if hit.t < first.0 {
                    first = (hit.t, is_back);
                }
                false
            });
            first.1
        };
        let between =
            |direction: &Vector3<f64>| self.normals.iter().all(|normal| normal.dot(direction) > 0.0);
        let (backs, looks) = directions(SOLID_LOOKS)
            .filter(between)
            .fold((0, 0), |(backs, looks), d| (backs + usize::from(meets_a_back(&d)), looks + 1));
        2 * backs > looks
    }

    /// Share of a stretch whose air is seen from outside.
    fn seen(&self, [from, to]: [f64; 2]) -> f64 {
        let places = ((to - from) / STEP_MM).ceil().clamp(PLACES[0] as f64, PLACES[1] as f64) as usize;
        let is_seen = |k: &usize| {
            let [a, b] = self.chord(from + (to - from) * (*k as f64 + 0.5) / places as f64);
            is_seen(self.mesh, &nalgebra::center(&a, &b))
        };
        (0..places).filter(is_seen).count() as f64 / places as f64
    }

    /// Whether face `k` itself begins within the gap beside a place of the line, and it or what it goes over into is there
    /// farther up, with its air in the wedge.
    fn is_there(&self, k: usize, p: &Point3<f64>) -> bool {
        let itself = |facet: u32, cosine: f64| {
            self.mesh.face_of[facet as usize] == self.meeting.faces[k] || cosine > SAME_PLANE_COSINE
        };
        let begins = BEGINS_MM.iter().any(|&up_mm| self.is_met(k, p, up_mm, 2.0 * self.mesh.weld_mm, itself));
        begins && self.is_met(k, p, FACE_MM, OFF_PLANE_MM, |_, cosine| cosine > ALIKE_COSINE)
    }

    /// Whether a facet as wanted, by its number and the cosine of its turn, lies so far up in the plane of face `k`.
    fn is_met(
        &self,
        k: usize,
        p: &Point3<f64>,
        up_mm: f64,
        off_mm: f64,
        wanted: impl Fn(u32, f64) -> bool,
    ) -> bool {
        let normal = self.normals[k];
        let above = p + self.into[k] * (up_mm / self.sine) + normal * off_mm;
        self.mesh.tree.any_hit(&above, &-normal, 2.0 * off_mm, |hit| {
            let cosine = self.mesh.normals[hit.facet as usize].dot(&normal);
            let faces_us = match self.mesh.sides[hit.facet as usize] {
                Side::Front => cosine > 0.0,
                Side::Back => cosine < 0.0,
                Side::Both => true,
            };
            faces_us && wanted(hit.facet, cosine.abs())
        })
    }

    /// Stretches within a span where the corner holds.
    fn runs(&self, [from, to]: [f64; 2]) -> Vec<[f64; 2]> {
        let count = ((to - from) / STEP_MM).ceil().clamp(PLACES[0] as f64, PLACES[1] as f64) as usize;
        let step = (to - from) / count as f64;
        let inside = step / f64::from(1 << HALVINGS);
        let middles = (0..count).map(|k| from + (k as f64 + 0.5) * step);
        let places: Vec<f64> = std::iter::once(from + inside).chain(middles).chain([to - inside]).collect();
        let holds: Vec<bool> = places.iter().map(|&t| self.holds(t)).collect();
        let mut runs = Vec::new();
        let mut begin = holds[0].then_some(from);
        for k in 1..places.len() {
            match (holds[k - 1], holds[k]) {
                (false, true) => begin = Some(self.change(places[k], places[k - 1])),
                (true, false) => {
                    runs.extend(begin.take().map(|b| [b, self.change(places[k - 1], places[k])]))
                }
                _ => {}
            }
        }
        runs.extend(begin.map(|b| [b, to]));
        runs.retain(|run| run[1] - run[0] > LEAST_MM);
        runs
    }

    /// Where between a place at which the corner holds and one at which it does not that changes.
    fn change(&self, holds: f64, fails: f64) -> f64 {
        let (mut holds, mut fails) = (holds, fails);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (holds + fails);
            *(if self.holds(middle) { &mut holds } else { &mut fails }) = middle;
        }
        holds
    }

    fn piece(&self, [from, to]: [f64; 2]) -> Piece {
        let bisector = (self.normals[0] + self.normals[1]).normalize();
        let middle = self.at(0.5 * (from + to)) + bisector * CHORD_MM;
        Piece {
            ends: [self.at(from), self.at(to)],
            along: self.meeting.line.along,
            normals: self.normals,
            blocked_mm: self.mesh.tree.first_hit(&middle, &bisector),
            seen: self.seen([from, to]),
        }
    }
}

/// Whether rays leave the mesh from here.
fn is_seen(mesh: &Mesh, from: &Point3<f64>) -> bool {
    LOOKS.iter().any(|&(least, count)| {
        let free = directions(count).filter(|d| mesh.tree.is_free(from, d, f64::INFINITY));
        free.take(least).count() == least
    })
}
