//! Where two faces of a mesh may meet: the line in which their planes cut, as far as both are near it.

use super::{GAP_MM, OPENING_DEG};
use crate::cancellation::go_on;
use crate::geometry::mesh::{Edge, Mesh, Side};
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;
use std::collections::HashSet;

/// Stretches of the line in which the planes of two faces cut.
#[derive(Debug, Clone)]
pub(super) struct Meeting {
    pub faces: [u32; 2],
    pub line: Line,
    /// Along the line from its origin, mm; ascending, apart from each other.
    pub spans_mm: Vec<[f64; 2]>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub origin: Point3<f64>,
    pub along: Vector3<f64>,
}

/// Spans nearer than this are one, mm.
const SAME_MM: f64 = 1e-6;

type Span = ([u32; 2], [f64; 2]);

/// All candidates: edges at which the surface turns, and pairs of faces that come within the gap of each other.
pub(super) fn meetings(mesh: &Mesh) -> Vec<Meeting> {
    let neighbours: HashSet<[u32; 2]> = mesh.edges.iter().flat_map(|edge| pairs(mesh, edge)).collect();
    let curve = Curves::new(mesh);
    let mut spans: Vec<Span> =
        mesh.edges.par_iter().flat_map_iter(|edge| at_edge(mesh, edge, &curve)).collect();
    let count = mesh.facets.len() as u32;
    spans.par_extend((0..count).into_par_iter().flat_map_iter(|f| {
        go_on();
        near(mesh, f, &neighbours)
    }));
    spans.par_sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1[0].total_cmp(&b.1[0])));
    let meeting = |run: &[Span]| {
        let mut spans_mm: Vec<[f64; 2]> = Vec::new();
        for &(_, [from, to]) in run {
            match spans_mm.last_mut() {
                Some(last) if from <= last[1] + SAME_MM => last[1] = last[1].max(to),
                _ => spans_mm.push([from, to]),
            }
        }
        Some(Meeting { faces: run[0].0, line: line(mesh, run[0].0)?, spans_mm })
    };
    spans.chunk_by(|a, b| a.0 == b.0).filter_map(meeting).collect()
}

fn ordered(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Pairs of different faces at an edge.
fn pairs<'a>(mesh: &'a Mesh, edge: &'a Edge) -> impl Iterator<Item = [u32; 2]> + 'a {
    let face = |f: &u32| mesh.face_of[*f as usize];
    let of =
        move |k: usize| edge.facets[k + 1..].iter().map(move |g| ordered(face(&edge.facets[k]), face(g)));
    (0..edge.facets.len()).flat_map(of).filter(|[a, b]| a != b)
}

/// The line in which the planes of two faces cut, through the foot of the first one's place.
pub(super) fn line(mesh: &Mesh, faces: [u32; 2]) -> Option<Line> {
    let [f, g] = faces.map(|face| mesh.faces[face as usize]);
    let along = f.normal.cross(&g.normal).try_normalize(OPENING_DEG[0].to_radians().sin())?;
    let planes = Matrix3::from_rows(&[f.normal.transpose(), g.normal.transpose(), along.transpose()]);
    let offsets = Vector3::new(
        f.normal.dot(&f.place.coords),
        g.normal.dot(&g.place.coords),
        along.dot(&f.place.coords),
    );
    Some(Line { origin: Point3::from(planes.try_inverse()? * offsets), along })
}

/// The spans of an edge between faces that may make an inside corner there.
fn at_edge(mesh: &Mesh, edge: &Edge, curve: &Curves) -> Vec<Span> {
    let ends = edge.ends.map(|v| mesh.vertices[v as usize]);
    let sharp = |f: u32, g: u32| 180.0 - mesh.turn_deg(edge, f, g) < OPENING_DEG[1];
    let mut spans = Vec::new();
    for (k, &f) in edge.facets.iter().enumerate() {
        for &g in &edge.facets[k + 1..] {
            let faces = ordered(mesh.face_of[f as usize], mesh.face_of[g as usize]);
            let single = edge.facets.len() == 2;
            if faces[0] == faces[1]
                || !sharp(f, g)
                || single && (is_convex(mesh, edge, f, g) || curve.holds(mesh, edge))
            {
                continue;
            }
            let Some(line) = line(mesh, faces) else { continue };
            let t = ends.map(|end| (end - line.origin).dot(&line.along));
            spans.push((faces, [t[0].min(t[1]), t[0].max(t[1])]));
        }
    }
    spans
}

/// Whether the air is known to be on the outer side of an edge.
fn is_convex(mesh: &Mesh, edge: &Edge, f: u32, g: u32) -> bool {
    let out = match mesh.sides[f as usize] {
        Side::Front => mesh.normals[f as usize],
        Side::Back => -mesh.normals[f as usize],
        Side::Both => return false,
    };
    out.dot(&mesh.facet_inward(edge, g)) < 0.0
}

/// The spans of a facet and of those near it that are not its neighbours.
fn near(mesh: &Mesh, f: u32, neighbours: &HashSet<[u32; 2]>) -> Vec<Span> {
    let corners = mesh.corners(f);
    let low = corners[0].inf(&corners[1]).inf(&corners[2]) - Vector3::repeat(GAP_MM);
    let high = corners[0].sup(&corners[1]).sup(&corners[2]) + Vector3::repeat(GAP_MM);
    let mut spans = Vec::new();
    let own = mesh.face_of[f as usize];
    let least = OPENING_DEG[0].to_radians().sin();
    mesh.tree.in_box(&low, &high, |g| {
        let faces = ordered(own, mesh.face_of[g as usize]);
        let [a, b] = faces.map(|face| mesh.faces[face as usize]);
        let sine = a.normal.cross(&b.normal).norm();
        if g <= f || a.patch == b.patch || sine < least || neighbours.contains(&faces) {
            return;
        }
        let Some(line) = line(mesh, faces) else { return };
        let within_mm = GAP_MM / sine;
        if let (Some(p), Some(q)) =
            (clip(&line, &corners, within_mm), clip(&line, &mesh.corners(g), within_mm))
        {
            let span = [p[0].max(q[0]), p[1].min(q[1])];
            if span[0] < span[1] {
                spans.push((faces, span));
            }
        }
    });
    spans
}

/// The stretch of a line in the plane of a triangle that is nearer than `within_mm` to each side, or within it.
fn clip(line: &Line, corners: &[Point3<f64>; 3], within_mm: f64) -> Option<[f64; 2]> {
    let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for k in 0..3 {
        let side = corners[(k + 1) % 3] - corners[k];
        let outward = side.cross(&normal).try_normalize(0.0)?;
        let (off, slope) = (within_mm - (line.origin - corners[k]).dot(&outward), line.along.dot(&outward));
        match slope {
            _ if slope.abs() < 1e-12 && off < 0.0 => return None,
            _ if slope.abs() < 1e-12 => {}
            _ if slope > 0.0 => to = to.min(off / slope),
            _ => from = from.max(off / slope),
        }
    }
    (from < to).then_some([from, to])
}

/// Edges with the same turn on strips side by side: a coarse tube seen from inside, and no corner.
struct Curves {
    /// By face: turn and direction of the sharp edges at its rim.
    rims: Vec<Vec<Rim>>,
}

#[derive(Clone, Copy)]
struct Rim {
    ends: [u32; 2],
    turn_deg: f64,
    along: Vector3<f64>,
}

/// Sharper edges are no strips of a curve, degrees: a tube of eight strips.
const STRIP_DEG: f64 = 46.0;

impl Curves {
    fn new(mesh: &Mesh) -> Self {
        let mut rims = vec![Vec::new(); mesh.faces.len()];
        for edge in &mesh.edges {
            let &[f, g] = edge.facets.as_slice() else { continue };
            let turn_deg = mesh.turn_deg(edge, f, g);
            if !(180.0 - OPENING_DEG[1]..STRIP_DEG).contains(&turn_deg) || is_convex(mesh, edge, f, g) {
                continue;
            }
            let [a, b] = edge.ends.map(|v| mesh.vertices[v as usize]);
            let rim = Rim { ends: edge.ends, turn_deg, along: (b - a).normalize() };
            [f, g].iter().for_each(|&f| rims[mesh.face_of[f as usize] as usize].push(rim));
        }
        Self { rims }
    }

    /// Whether the faces at an edge both turn by as much again at their other sides.
    fn holds(&self, mesh: &Mesh, edge: &Edge) -> bool {
        let of = |f: u32| &self.rims[mesh.face_of[f as usize] as usize];
        let Some(own) = edge.facets.first().and_then(|&f| of(f).iter().find(|rim| rim.ends == edge.ends))
        else {
            return false;
        };
        let again = |rim: &Rim| {
            rim.ends != own.ends
                && (rim.turn_deg - own.turn_deg).abs() < 0.15 * own.turn_deg
                && rim.along.dot(&own.along).abs() > 0.98
                && rim.ends.iter().all(|v| !on_line(mesh, own, *v))
        };
        edge.facets.iter().all(|&f| of(f).iter().any(again))
    }
}

/// Whether a vertex lies on the line of an edge.
fn on_line(mesh: &Mesh, rim: &Rim, vertex: u32) -> bool {
    let off = mesh.vertices[vertex as usize] - mesh.vertices[rim.ends[0] as usize];
    off.cross(&rim.along).norm() < 10.0 * mesh.weld_mm
}
