//! Bounding boxes of triangles in a tree: which are near a box, which does a ray meet.

use crate::cancellation::go_on;
use nalgebra::{Point3, Vector3};

/// Triangles in a leaf at most.
const LEAF: usize = 4;

/// A tree of boxes over triangles.
#[derive(Debug, Clone)]
pub struct Tree {
    nodes: Vec<Node>,
    /// Triangles in the order of the leaves.
    order: Vec<u32>,
    triangles: Vec<Triangle>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    low: Point3<f64>,
    high: Point3<f64>,
    /// First triangle of a leaf; the second child of a branch, whose first child follows it.
    at: u32,
    /// Triangles of a leaf; 0 in a branch.
    count: u32,
}

#[derive(Debug, Clone, Copy)]
struct Triangle {
    corner: Point3<f64>,
    sides: [Vector3<f64>; 2],
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RayHit {
    /// Which triangle.
    pub facet: u32,
    /// How far along the ray, in multiples of its direction.
    pub t: f64,
}

impl Tree {
    /// A tree over triangles, which keep their numbers.
    pub fn new(triangles: &[[Point3<f64>; 3]]) -> Self {
        let of = |t: &[Point3<f64>; 3]| Triangle { corner: t[0], sides: [t[1] - t[0], t[2] - t[0]] };
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut nodes = Vec::with_capacity(triangles.len());
        if !order.is_empty() {
            let middles: Vec<Vector3<f64>> =
                triangles.iter().map(|t| (t[0].coords + t[1].coords + t[2].coords) / 3.0).collect();
            build(&mut nodes, &mut order, 0, triangles, &middles);
        }
        Self { nodes, order, triangles: triangles.iter().map(of).collect() }
    }

    /// Triangles whose boxes meet the given one.
    pub(crate) fn in_box(&self, low: &Point3<f64>, high: &Point3<f64>, mut found: impl FnMut(u32)) {
        let meets = |node: &Node| (0..3).all(|k| node.low[k] <= high[k] && low[k] <= node.high[k]);
        self.walk(meets, |facet| {
            let Triangle { corner, sides } = self.triangles[facet as usize];
            let corners = [corner, corner + sides[0], corner + sides[1]];
            let apart =
                |k: usize| corners.iter().all(|c| c[k] > high[k]) || corners.iter().all(|c| c[k] < low[k]);
            if !(0..3).any(apart) {
                found(facet);
            }
            false
        });
    }

    /// Calls back for every triangle that the ray meets up to `most` times its direction, until that returns true; whether
    /// it did. In no particular order.
    pub(crate) fn any_hit(
        &self,
        from: &Point3<f64>,
        direction: &Vector3<f64>,
        most: f64,
        mut stop: impl FnMut(RayHit) -> bool,
    ) -> bool {
        go_on();
        let inverse = direction.map(|d| 1.0 / d);
        let meets = |node: &Node| {
            let (mut near, mut far) = (0.0_f64, most);
            for k in 0..3 {
                let (a, b) = ((node.low[k] - from[k]) * inverse[k], (node.high[k] - from[k]) * inverse[k]);
                // Not a number where the ray runs in the plane of a side: nothing is said along this axis.
                if !a.is_nan() && !b.is_nan() {
                    near = near.max(a.min(b));
                    far = far.min(a.max(b));
                }
            }
            near <= far
        };
        self.walk(meets, |facet| {
            let t = self.triangles[facet as usize].met(from, direction);
            t.filter(|t| (0.0..=most).contains(t)).is_some_and(|t| stop(RayHit { facet, t }))
        })
    }

    /// Whether nothing stands between a place and the far end of a ray.
    pub fn is_free(&self, from: &Point3<f64>, direction: &Vector3<f64>, most: f64) -> bool {
        !self.any_hit(from, direction, most, |_| true)
    }

    /// How far a ray goes until it meets a triangle.
    pub fn first_hit(&self, from: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let mut first = f64::INFINITY;
        self.any_hit(from, direction, f64::INFINITY, |hit| {
            first = first.min(hit.t);
            false
        });
        first.is_finite().then_some(first)
    }

    fn walk(&self, meets: impl Fn(&Node) -> bool, mut stop: impl FnMut(u32) -> bool) -> bool {
        let mut stack: Vec<u32> = if self.nodes.is_empty() { vec![] } else { vec![0] };
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at as usize];
            if !meets(node) {
                continue;
            }
            if node.count == 0 {
                stack.extend([node.at, at + 1]);
                continue;
            }
            let leaf = node.at as usize..(node.at + node.count) as usize;
            if self.order[leaf].iter().any(|&facet| stop(facet)) {
                return true;
            }
        }
        false
    }
}

impl Triangle {
    /// Möller and Trumbore 1997, both sides; the rim counts, so that no ray slips through an edge.
    fn met(&self, from: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        const RIM: f64 = 1e-9;
        let across = direction.cross(&self.sides[1]);
        let determinant = self.sides[0].dot(&across);
        if determinant == 0.0 {
            return None;
        }
        let to = from - self.corner;
        let u = to.dot(&across) / determinant;
        let around = to.cross(&self.sides[0]);
        let v = direction.dot(&around) / determinant;
        (u >= -RIM && v >= -RIM && u + v <= 1.0 + RIM).then(|| self.sides[1].dot(&around) / determinant)
    }
}

/// The node of `order`, whose first triangle is `first` in the whole order, and those below it.
fn build(
    nodes: &mut Vec<Node>,
    order: &mut [u32],
    first: usize,
    triangles: &[[Point3<f64>; 3]],
    middles: &[Vector3<f64>],
) {
    let corners = order.iter().flat_map(|&f| triangles[f as usize]);
    let start = (Point3::from([f64::MAX; 3]), Point3::from([f64::MIN; 3]));
    let (low, high) = corners.fold(start, |(low, high), p| (low.inf(&p), high.sup(&p)));
    let own = nodes.len();
    nodes.push(Node { low, high, at: first as u32, count: order.len() as u32 });
    if order.len() <= LEAF {
        return;
    }
    let spread = order.iter().map(|&f| middles[f as usize]);
    let (least, most) =
        spread.fold((low.coords + (high - low), low.coords), |(l, h), m| (l.inf(&m), h.sup(&m)));
    let axis = (most - least).imax();
    let half = order.len() / 2;
    order.select_nth_unstable_by(half, |&a, &b| {
        middles[a as usize][axis].total_cmp(&middles[b as usize][axis]).then(a.cmp(&b))
    });
    let (left, right) = order.split_at_mut(half);
    build(nodes, left, first, triangles, middles);
    nodes[own].at = nodes.len() as u32;
    nodes[own].count = 0;
    build(nodes, right, first + half, triangles, middles);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of 20 x 20 squares in x = 1, each of two triangles.
    fn wall() -> Tree {
        let at = |i: i32, j: i32| Point3::new(1.0, f64::from(i), f64::from(j));
        let square =
            |i, j| [[at(i, j), at(i + 1, j), at(i, j + 1)], [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]];
        Tree::new(&(0..400).flat_map(|k| square(k / 20, k % 20)).collect::<Vec<_>>())
    }

    #[test]
    fn a_ray_meets_the_one_triangle_in_its_way() {
        let wall = wall();
        for k in 0..100 {
            let share = |step: f64| 20.0 * (step * f64::from(k + 1)).fract();
            let (y, z) = (share(0.754_877_666), share(0.569_840_291));
            let mut hits = Vec::new();
            wall.any_hit(&Point3::new(-1.0, y, z), &Vector3::x(), 10.0, |hit| {
                hits.push(hit);
                false
            });
            let [hit] = hits.as_slice() else { panic!("{hits:?}") };
            assert!((hit.t - 2.0).abs() < 1e-12);
            assert_eq!(hit.facet as usize / 2, y as usize * 20 + z as usize);
        }
        assert!(wall.is_free(&Point3::new(-1.0, 5.5, 5.5), &Vector3::x(), 1.9));
        assert!(wall.is_free(&Point3::new(-1.0, 25.0, 5.5), &Vector3::x(), 10.0));
        assert!(wall.is_free(&Point3::new(2.0, 5.5, 5.5), &Vector3::x(), 10.0));
    }

    #[test]
    fn a_box_finds_the_triangles_that_reach_into_it() {
        let mut found = Vec::new();
        wall()
            .in_box(&Point3::new(0.0, 3.2, 7.2), &Point3::new(2.0, 3.3, 8.3), |facet| found.push(facet / 2));
        found.sort_unstable();
        assert_eq!(found, [67, 67, 68, 68]);
    }
}
