//! Whether a mesh was drawn or measured, by its own data.
//!
//! What is drawn has exact planes: two facets of one plane agree to the last digit of the file. What is measured has noise at
//! every vertex, so that no two facets do; what is drawn and curved everywhere is smooth at least. A depth camera's picture with
//! faces is known by its pixels, whatever its planes. What was sampled in a grid and smoothed has neither noise nor a sharp fold.

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use super::raw::Raw;
use crate::geometry::mesh::{Edge, Mesh};

/// What made a mesh, and how that shows.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Maker {
    Drawn,
    Measured(String),
    /// Nothing in the data decides.
    Unclear(String),
}

/// Share of the area in exact planes from which on a mesh is drawn. Noise puts the fourth corner of two facets off by twice its
/// deviation: noise of 8 times the file's precision leaves a tenth of the edges flat by chance, and a quarter of the facets.
/// Depth steps without any noise leave two thirds.
const DRAWN_FLAT: f64 = 0.7;
/// Scatter of vertices about a smooth surface through their neighbours, as a share of how far neighbouring facets turn apart.
/// Noise alone gives 1/2, since four vertices make a turn; a smooth surface only its third order: 0.2 where
/// a wave is 40 facets long, and less where it is longer.
/// Half of what noise gives is noisy, a quarter of it is smooth.
const NOISY: f64 = 0.25;
const SMOOTH: f64 = 0.125;
/// Facets are of one size if the middle of the area lies in facets less than so many times as large as the middle facet: a program
/// that draws gives a plane few facets, one that samples gives it as many as all else.
const ONE_SIZE: f64 = 3.0;
/// Least turn of a fold; it is sharp if what is across its facets turns by less than this share of it, as planes
/// that meet do. A corner that was sampled turns in two or three steps.
const FOLD_RAD: f64 = 0.17;
const SHARP_SHARE: f64 = 0.25;
/// Most of what is sampled is smooth; a surface that is drawn curved in few facets turns at most of its edges.
const MOST_FOLDED: f64 = 0.25;
/// Share of the folds' length that is sharp below which nothing says that they were drawn.
const DRAWN_SHARP: f64 = 0.5;
/// Vertices that are looked at, and how many of them have to speak.
const ASKED: usize = 3000;
const FEWEST: usize = 30;
/// Neighbours for a quadric of six numbers.
const NEIGHBOURS: usize = 12;

/// What made this mesh; its file's numbers are right to `precision_mm`.
pub(super) fn maker(mesh: &Mesh, precision_mm: f64) -> Maker {
    let precision_mm = precision_mm.max(0.1 * mesh.weld_mm);
    if is_sampled(mesh) {
        let words = "its facets are all of about one size, and its corners turn in several steps";
        return Maker::Unclear(words.into());
    }
    let offsets = Offsets::of(mesh);
    let flat = offsets.flat_share(mesh, precision_mm);
    if flat >= DRAWN_FLAT {
        return Maker::Drawn;
    }
    let scatter = offsets.scatter(mesh, precision_mm);
    let percent = 100.0 * flat;
    let of_turns = |scatter: f64| {
        format!(
            "{percent:.0} % of it lies in exact planes, and its vertices scatter by {scatter:.2} of the steps between facets"
        )
    };
    match scatter {
        Some(scatter) if scatter >= NOISY => Maker::Measured(of_turns(scatter)),
        Some(scatter) if scatter <= SMOOTH => Maker::Drawn,
        Some(scatter) => Maker::Unclear(of_turns(scatter)),
        // So few vertices no scanner gives.
        None => Maker::Drawn,
    }
}

/// Whether a mesh looks as if a grid had been laid through the part: facets of one size, and no sharp fold where it turns.
fn is_sampled(mesh: &Mesh) -> bool {
    let mut areas: Vec<f64> = (0..mesh.facets.len()).map(|f| mesh.area_mm2(f as u32)).collect();
    areas.sort_unstable_by(f64::total_cmp);
    let half = 0.5 * areas.iter().sum::<f64>();
    let mut below = 0.0;
    let of_area = areas.iter().find(|area| {
        below += **area;
        below >= half
    });
    let is_one_size = of_area.is_some_and(|area| *area < ONE_SIZE * areas[areas.len() / 2]);
    areas.len() >= FEWEST && is_one_size && sharp_share(mesh).is_some_and(|share| share < DRAWN_SHARP)
}

/// Share of the length of folds that is sharp; none without folds, or where most edges are.
fn sharp_share(mesh: &Mesh) -> Option<f64> {
    let turn = |facets: &[u32]| match *facets {
        [f, g] => mesh.normals[f as usize].angle(&mesh.normals[g as usize]),
        _ => 0.0,
    };
    let turns: Vec<f64> = mesh.edges.iter().map(|edge| turn(&edge.facets)).collect();
    let mut at_vertex = vec![0.0f64; mesh.vertices.len()];
    for (edge, turn) in mesh.edges.iter().zip(&turns) {
        edge.ends.iter().for_each(|v| at_vertex[*v as usize] = at_vertex[*v as usize].max(*turn));
    }
    // Of the facets at an edge, what is across from it.
    let beyond = |edge: &Edge| -> f64 {
        let across =
            edge.facets.iter().flat_map(|f| mesh.facets[*f as usize]).filter(|v| !edge.ends.contains(v));
        across.map(|v| at_vertex[v as usize]).fold(0.0, f64::max)
    };
    let (mut sharp_mm, mut folded_mm, mut all_mm) = (0.0, 0.0, 0.0);
    for (edge, turn) in mesh.edges.iter().zip(&turns) {
        let [a, b] = edge.ends.map(|v| mesh.vertices[v as usize]);
        let length_mm = (b - a).norm();
        all_mm += length_mm;
        if *turn > FOLD_RAD {
            folded_mm += length_mm;
            sharp_mm += if beyond(edge) < SHARP_SHARE * turn { length_mm } else { 0.0 };
        }
    }
    (folded_mm > 0.0 && folded_mm < MOST_FOLDED * all_mm).then(|| sharp_mm / folded_mm)
}

/// How far the corner of one facet is off the plane of its neighbour.
struct Offsets {
    /// Per edge, mm; none where not two facets meet.
    of_edge: Vec<Option<f64>>,
}

impl Offsets {
    fn of(mesh: &Mesh) -> Self {
        let off = |f: u32, g: u32| {
            let [place, ..] = mesh.corners(f);
            let normal = mesh.normals[f as usize];
            mesh.corners(g).iter().map(|c| (c - place).dot(&normal).abs()).fold(0.0, f64::max)
        };
        let offset = |facets: &[u32]| match *facets {
            [f, g] => Some(off(f, g).min(off(g, f))),
            _ => None,
        };
        Self { of_edge: mesh.edges.iter().map(|edge| offset(&edge.facets)).collect() }
    }

    /// Share of the area whose facets lie in the plane of a neighbour.
    fn flat_share(&self, mesh: &Mesh, precision_mm: f64) -> f64 {
        let mut flat = vec![false; mesh.facets.len()];
        for (edge, offset) in mesh.edges.iter().zip(&self.of_edge) {
            if offset.is_some_and(|mm| mm <= precision_mm) {
                edge.facets.iter().for_each(|&f| flat[f as usize] = true);
            }
        }
        let area = |all: bool| -> f64 {
            let wanted = (0..mesh.facets.len()).filter(|&f| all || flat[f]);
            wanted.map(|f| mesh.area_mm2(f as u32)).sum()
        };
        area(false) / area(true)
    }

    /// Median over vertices off the exact planes of how far they scatter about a quadric, as a share of the offsets there.
    fn scatter(&self, mesh: &Mesh, precision_mm: f64) -> Option<f64> {
        let rings = Rings::of(mesh);
        let step = mesh.vertices.len().div_ceil(ASKED).max(1);
        let of = |v: usize| {
            let offsets = rings.edges(v).iter().map(|&e| self.of_edge[e as usize]);
            let offsets: Vec<f64> = offsets.collect::<Option<_>>()?;
            let squared = offsets.iter().map(|mm| mm * mm).sum::<f64>() / offsets.len().max(1) as f64;
            let turns_mm = squared.sqrt();
            (turns_mm > precision_mm).then_some(())?;
            Some(scatter_mm(mesh, &rings.two_around(v))? / turns_mm)
        };
        let mut shares: Vec<f64> = (0..mesh.vertices.len()).step_by(step).filter_map(of).collect();
        shares.sort_unstable_by(f64::total_cmp);
        (shares.len() >= FEWEST).then(|| shares[shares.len() / 2])
    }
}

/// The edges at each vertex.
struct Rings<'a> {
    mesh: &'a Mesh,
    begin: Vec<u32>,
    edges: Vec<u32>,
}

impl<'a> Rings<'a> {
    fn of(mesh: &'a Mesh) -> Self {
        let mut begin = vec![0; mesh.vertices.len() + 1];
        let ends = || mesh.edges.iter().enumerate().flat_map(|(e, edge)| edge.ends.map(|v| (e as u32, v)));
        ends().for_each(|(_, v)| begin[v as usize + 1] += 1);
        for v in 1..begin.len() {
            begin[v] += begin[v - 1];
        }
        let mut next = begin.clone();
        let mut edges = vec![0; 2 * mesh.edges.len()];
        for (e, v) in ends() {
            edges[next[v as usize] as usize] = e;
            next[v as usize] += 1;
        }
        Self { mesh, begin, edges }
    }

    fn edges(&self, vertex: usize) -> &[u32] {
        &self.edges[self.begin[vertex] as usize..self.begin[vertex + 1] as usize]
    }

    /// The vertex, its neighbours and theirs.
    fn two_around(&self, vertex: usize) -> Vec<u32> {
        let beside = |v: u32| self.edges(v as usize).iter().flat_map(|&e| self.mesh.edges[e as usize].ends);
        let mut near: Vec<u32> = beside(vertex as u32).collect();
        near.sort_unstable();
        near.dedup();
        let mut all: Vec<u32> = near.iter().flat_map(|&v| beside(v)).collect();
        all.sort_unstable();
        all.dedup();
        all
    }
}

/// Deviation of vertices from the quadric through them, mm; none where they do not determine one.
fn scatter_mm(mesh: &Mesh, vertices: &[u32]) -> Option<f64> {
    let free = vertices.len().checked_sub(NEIGHBOURS)? + NEIGHBOURS - 6;
    let points: Vec<Point3<f64>> = vertices.iter().map(|&v| mesh.vertices[v as usize]).collect();
    let middle = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let spread = points.iter().fold(Matrix3::zeros(), |sum, p| {
        let d = p.coords - middle;
        sum + d * d.transpose()
    });
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let size = (eigen.eigenvalues[order[0]] / points.len() as f64).sqrt();
    let axis = |k: usize| eigen.eigenvectors.column(order[k]) / size;
    let (right, up, out) = (axis(0), axis(1), axis(2));
    let row = |p: &Point3<f64>| {
        let d = p.coords - middle;
        let (x, y) = (d.dot(&right), d.dot(&up));
        (SVector::<f64, 6>::from([1.0, x, y, x * x, x * y, y * y]), d.dot(&out))
    };
    let (mut normal, mut right_side) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    for (a, z) in points.iter().map(row) {
        normal += a * a.transpose();
        right_side += a * z;
    }
    let fit = normal.cholesky()?.solve(&right_side);
    let squared: f64 = points.iter().map(row).map(|(a, z)| (z - a.dot(&fit)).powi(2)).sum();
    Some(size * (squared / free as f64).sqrt())
}

/// Whether the faces are the pixels of the picture that a camera at `at` took: all of about one size there. File units.
pub(super) fn is_picture(raw: &Raw, at: Vector3<f64>) -> bool {
    /// Pixels are alike; a facet that leaps over one that is missing is larger.
    const ALIKE: f64 = 0.1;
    const SHARE: f64 = 0.9;
    let towards = raw.positions.at(0) - at;
    let ahead = if towards.z < 0.0 { -1.0 } else { 1.0 };
    let area = |t: &[usize; 3]| {
        let [a, b, c] = t.map(|i| {
            let ray = raw.positions.at(i) - at;
            [ray.x, ray.y].map(|along| ahead * along / ray.z)
        });
        ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs()
    };
    let mut areas: Vec<f64> = raw.triangles.iter().map(area).filter(|area| area.is_finite()).collect();
    areas.sort_unstable_by(f64::total_cmp);
    let Some(&usual) = areas.get(areas.len() / 2) else { return false };
    let alike = areas.iter().filter(|area| (*area / usual - 1.0).abs() < ALIKE).count();
    usual > 0.0 && alike as f64 > SHARE * raw.triangles.len() as f64
}

/// The last digit that the numbers of a file have: a power of ten, where all are multiples of it. File units.
pub(super) fn last_digit(raw: &Raw) -> f64 {
    const LOOKED_AT: usize = 600;
    const MOST_DIGITS: i32 = 9;
    let sample = raw.positions.sample(LOOKED_AT);
    let is_multiple =
        |c: f64, step: f64| (c / step - (c / step).round()).abs() * step <= f64::from(f32::EPSILON) * c.abs();
    let digits = |k: &i32| {
        let step = 10f64.powi(-k);
        sample.iter().all(|p| p.iter().all(|&c| is_multiple(c, step)))
    };
    (0..=MOST_DIGITS).find(digits).map_or(0.0, |k| 10f64.powi(-k))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An L profile, 60 mm long, in facets of 2 mm, without noise: its corner is turned in so many steps.
    fn corner(steps: usize) -> Mesh {
        const STEP_MM: f64 = 2.0;
        let turn = std::f64::consts::FRAC_PI_2 / steps as f64;
        let (mut at, mut profile) = ([-40.0, 0.0], Vec::new());
        let mut advance = |way: f64| {
            profile.push(at);
            at = [at[0] + STEP_MM * way.cos(), at[1] + STEP_MM * way.sin()];
        };
        (0..20).for_each(|_| advance(0.0));
        (1..steps).for_each(|k| advance(k as f64 * turn));
        (0..=20).for_each(|_| advance(std::f64::consts::FRAC_PI_2));
        let (rows, columns) = (31, profile.len());
        let point = |k: usize| {
            let [x, z] = profile[k % columns];
            Point3::new(x, STEP_MM * (k / columns) as f64, z)
        };
        let points: Vec<_> = (0..rows * columns).map(point).collect();
        let cells = (0..rows - 1).flat_map(|j| (0..columns - 1).map(move |i| j * columns + i));
        let triangles: Vec<_> =
            cells.flat_map(|k| [[k, k + 1, k + columns], [k + 1, k + columns + 1, k + columns]]).collect();
        Mesh::weld(&points, &triangles, 1e-6).expect("a mesh")
    }

    #[test]
    fn a_mesh_of_even_facets_is_drawn_if_its_corner_is_sharp_and_doubtful_if_it_turns_in_steps() {
        assert_eq!(maker(&corner(1), 1e-6), Maker::Drawn);
        for steps in [2, 3, 5] {
            let maker = maker(&corner(steps), 1e-6);
            assert!(
                matches!(&maker, Maker::Unclear(why) if why.contains("several steps")),
                "{steps}: {maker:?}"
            );
        }
    }
}
