//! A triangle mesh as its modeller meant it: vertices welded, facets of one plane joined to faces, outer sides found.
//!
//! STL is a soup: every facet has its own corners, bodies overlap, facets come twice or turned over. Welding makes edges of
//! the soup; sides come from what the shell encloses or, where it is open, from what can be seen of it. Millimetres, relative
//! to the origin of the view; the tolerances follow the size of the mesh and the precision of its file.

mod shell;
mod tree;

use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, HashMap};

pub use shell::directions;
pub use tree::Tree;

/// Two facets turn less than this about their common edge: one plane, up to rounding.
const COPLANAR_DEG: f64 = 0.3;
/// Two facets turn less than this about their common edge: one smooth surface, such as a tube of 12 strips.
const SMOOTH_DEG: f64 = 31.0;
/// Vertices nearer than this share of the diagonal are one: what text with six digits keeps.
const WELD_SHARE: f64 = 1e-5;
/// However large the mesh is, mm.
const MOST_WELD_MM: f64 = 0.02;

/// Which side of a facet is air.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// That of the facet's normal.
    Front,
    /// The other one.
    Back,
    /// Both, or nobody knows: a sheet without thickness.
    Both,
}

/// A plane or a strip of the surface.
#[derive(Debug, Clone, Copy)]
pub struct Face {
    /// A place on it: of its largest facet.
    pub place: Point3<f64>,
    /// Unit; its sign means nothing.
    pub normal: Vector3<f64>,
    /// Faces with the same number go over into each other smoothly.
    pub patch: u32,
}

/// An edge and the facets that meet there.
#[derive(Debug, Clone)]
pub struct Edge {
    /// Indices of its vertices, ascending.
    pub ends: [u32; 2],
    /// One at a border, two in a sound body, more where bodies touch.
    pub facets: Vec<u32>,
}

/// A welded mesh.
#[derive(Debug, Clone)]
pub struct Mesh {
    /// Corners, each once, mm.
    pub vertices: Vec<Point3<f64>>,
    /// Facets that have an area, each once.
    pub facets: Vec<[u32; 3]>,
    /// Unit normals of the facets, as they are wound.
    pub normals: Vec<Vector3<f64>>,
    /// Side of each facet on which there is air.
    pub sides: Vec<Side>,
    /// Which face each facet belongs to.
    pub face_of: Vec<u32>,
    /// Planes and strips.
    pub faces: Vec<Face>,
    /// All edges, ordered by their ends.
    pub edges: Vec<Edge>,
    /// For rays and boxes.
    pub tree: Tree,
    /// How far apart two corners may be that are one, mm.
    pub weld_mm: f64,
}

impl Mesh {
    /// Welds a soup. `rounding_mm` is what the file's numbers cannot tell apart; none if nothing with an area is left.
    pub fn weld(corners: &[Point3<f64>], triangles: &[[usize; 3]], rounding_mm: f64) -> Option<Self> {
        Self::stitched(corners, triangles, rounding_mm).map(Self::with_faces)
    }

    /// The same before facets are joined to faces and their sides are found.
    pub(crate) fn stitched(
        corners: &[Point3<f64>],
        triangles: &[[usize; 3]],
        rounding_mm: f64,
    ) -> Option<Self> {
        let diagonal_mm = diagonal(corners.iter());
        let weld_mm = (WELD_SHARE * diagonal_mm).min(MOST_WELD_MM).max(4.0 * rounding_mm);
        let (vertices, vertex_of) = welded(corners, weld_mm);
        let facets = facets(&vertices, triangles, &vertex_of, weld_mm);
        let normals: Vec<_> = facets.iter().map(|f| across(&vertices, f).normalize()).collect();
        if facets.is_empty() {
            return None;
        }
        let edges = edges(&facets);
        let tree = Tree::new(&facets.iter().map(|f| f.map(|i| vertices[i as usize])).collect::<Vec<_>>());
        let sides = vec![Side::Both; facets.len()];
        Some(Self { vertices, facets, normals, sides, face_of: vec![], faces: vec![], edges, tree, weld_mm })
    }

    /// With the faces that the facets make, and the side of each on which there is air.
    pub(crate) fn with_faces(mut self) -> Self {
        self.join_faces();
        self.sides = shell::sides(&self);
        self
    }

    /// Corners of a facet.
    pub fn corners(&self, facet: u32) -> [Point3<f64>; 3] {
        self.facets[facet as usize].map(|i| self.vertices[i as usize])
    }

    /// Area of a facet, mm².
    pub(crate) fn area_mm2(&self, facet: u32) -> f64 {
        across(&self.vertices, &self.facets[facet as usize]).norm() / 2.0
    }

    /// Angle by which the surface turns at an edge between two of its facets, degrees; 0 if they lie in one plane.
    pub fn turn_deg(&self, edge: &Edge, f: u32, g: u32) -> f64 {
        let [into_f, into_g] = [f, g].map(|facet| self.facet_inward(edge, facet));
        180.0 - into_f.dot(&into_g).clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Unit direction from an edge into one of its facets, square to the edge.
    pub(crate) fn facet_inward(&self, edge: &Edge, facet: u32) -> Vector3<f64> {
        let [a, b] = edge.ends.map(|i| self.vertices[i as usize]);
        let along = (b - a).normalize();
        let opposite = self.facets[facet as usize].into_iter().find(|i| !edge.ends.contains(i));
        let to = self.vertices[opposite.unwrap_or(edge.ends[0]) as usize] - a;
        (to - along * to.dot(&along)).try_normalize(0.0).unwrap_or(self.normals[facet as usize])
    }

    /// Largest extent, mm.
    pub fn diagonal_mm(&self) -> f64 {
        diagonal(self.vertices.iter())
    }

    fn join_faces(&mut self) {
        let (mut planes, mut patches) = (Sets::new(self.facets.len()), Sets::new(self.facets.len()));
        for edge in &self.edges {
            for (k, &f) in edge.facets.iter().enumerate() {
                for &g in &edge.facets[k + 1..] {
                    let turn_deg = self.turn_deg(edge, f, g);
                    if turn_deg < COPLANAR_DEG || self.is_sliver_of(edge, f, g) {
                        planes.join(f, g);
                    }
                    if turn_deg < SMOOTH_DEG && edge.facets.len() == 2 {
                        patches.join(f, g);
                    }
                }
            }
        }
        let mut numbers: BTreeMap<u32, u32> = BTreeMap::new();
        let mut largest: Vec<(f64, u32)> = Vec::new();
        for f in 0..self.facets.len() as u32 {
            let next = numbers.len() as u32;
            let face = *numbers.entry(planes.root(f)).or_insert(next);
            self.face_of.push(face);
            let area = self.area_mm2(f);
            match largest.get_mut(face as usize) {
                Some(best) if best.0 >= area => {}
                Some(best) => *best = (area, f),
                None => largest.push((area, f)),
            }
        }
        let face = |&(_, f): &(f64, u32)| {
            let [place, ..] = self.corners(f);
            Face { place, normal: self.normals[f as usize], patch: patches.root(f) }
        };
        self.faces = largest.iter().map(face).collect();
    }

    /// Whether one of two facets is so thin that rounding turns it, and lies in the plane of the other.
    fn is_sliver_of(&self, edge: &Edge, f: u32, g: u32) -> bool {
        const THIN: f64 = 10.0;
        let [a, ..] = edge.ends.map(|i| self.vertices[i as usize]);
        let off = |facet: u32, plane: u32| {
            let corners = self.corners(facet);
            let normal = self.normals[plane as usize];
            corners.iter().map(|c| (c - a).dot(&normal).abs()).fold(0.0, f64::max)
        };
        let height = |facet: u32| {
            let into = self.facet_inward(edge, facet);
            self.corners(facet).iter().map(|c| (c - a).dot(&into)).fold(0.0, f64::max)
        };
        let opposite = self.facet_inward(edge, f).dot(&self.facet_inward(edge, g)) < 0.0;
        opposite
            && [(f, g), (g, f)].iter().any(|&(thin, wide)| {
                height(thin) < THIN * self.weld_mm && off(thin, wide) < 2.0 * self.weld_mm
            })
    }
}

fn across(vertices: &[Point3<f64>], facet: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c] = facet.map(|i| vertices[i as usize]);
    (b - a).cross(&(c - a))
}

fn diagonal<'a>(points: impl Iterator<Item = &'a Point3<f64>>) -> f64 {
    let start = (Point3::from([f64::MAX; 3]), Point3::from([f64::MIN; 3]));
    let (low, high) = points.fold(start, |(low, high), p| (low.inf(p), high.sup(p)));
    (high - low).norm()
}

/// Corners that are one become one: the first of them. Vertices and the vertex of each corner.
fn welded(corners: &[Point3<f64>], weld_mm: f64) -> (Vec<Point3<f64>>, Vec<u32>) {
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut vertices: Vec<Point3<f64>> = Vec::new();
    let cell_mm = 2.0 * weld_mm;
    let cell = |p: Point3<f64>| [0, 1, 2].map(|k| (p[k] / cell_mm).floor() as i64);
    let weld = |p: &Point3<f64>| {
        let (low, high) = (cell(p - Vector3::repeat(weld_mm)), cell(p + Vector3::repeat(weld_mm)));
        let known = (low[0]..=high[0]).find_map(|x| {
            (low[1]..=high[1]).find_map(|y| {
                (low[2]..=high[2]).find_map(|z| {
                    let near = |&v: &u32| (vertices[v as usize] - p).norm() <= weld_mm;
                    cells.get(&[x, y, z])?.iter().copied().find(near)
                })
            })
        });
        known.unwrap_or_else(|| {
            let vertex = vertices.len() as u32;
            vertices.push(*p);
            cells.entry(cell(*p)).or_default().push(vertex);
            vertex
        })
    };
    let vertex_of = corners.iter().map(weld).collect();
    (vertices, vertex_of)
}

/// Facets that have an area, each once, in the order of the file.
fn facets(
    vertices: &[Point3<f64>],
    triangles: &[[usize; 3]],
    vertex_of: &[u32],
    weld_mm: f64,
) -> Vec<[u32; 3]> {
    let mut known = std::collections::HashSet::new();
    let has_area = |facet: &[u32; 3]| {
        let [a, b, c] = facet.map(|i| vertices[i as usize]);
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        across(vertices, facet).norm() > 0.1 * weld_mm * longest
    };
    let facets = triangles.iter().map(|t| t.map(|corner| vertex_of[corner]));
    let mut once = |facet: &[u32; 3]| {
        let mut sorted = *facet;
        sorted.sort_unstable();
        known.insert(sorted)
    };
    facets.filter(has_area).filter(|facet| once(facet)).collect()
}

fn edges(facets: &[[u32; 3]]) -> Vec<Edge> {
    let mut all: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * facets.len());
    for (f, &[a, b, c]) in facets.iter().enumerate() {
        all.extend([[a, b], [b, c], [c, a]].map(|[p, q]| ([p.min(q), p.max(q)], f as u32)));
    }
    all.sort_unstable();
    let edge = |run: &[([u32; 2], u32)]| Edge { ends: run[0].0, facets: run.iter().map(|r| r.1).collect() };
    all.chunk_by(|a, b| a.0 == b.0).map(edge).collect()
}

/// Disjoint sets.
struct Sets(Vec<u32>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn root(&self, mut of: u32) -> u32 {
        while self.0[of as usize] != of {
            of = self.0[of as usize];
        }
        of
    }

    /// The lower root stays; ways are shortened as they are gone.
    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.shortened(a), self.shortened(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    fn shortened(&mut self, mut of: u32) -> u32 {
        let root = self.root(of);
        while self.0[of as usize] != root {
            of = std::mem::replace(&mut self.0[of as usize], root);
        }
        root
    }
}
