//! All solids in view and the table under them, with a bounding-volume hierarchy for speed. Millimetres, base frame.

use super::facet::Facet;
use super::solid::{Hit, Ray, Solid};
use nalgebra::{Isometry3, Point3, Vector3};

/// Solids or a mesh and a table, in the base frame.
#[derive(Debug, Clone)]
pub struct Scene {
    bodies: Vec<Body>,
    tree: Option<Node>,
    table_mm: f64,
}

/// Something that a ray can meet.
#[derive(Debug, Clone)]
pub(super) enum Body {
    Solid(Solid),
    Facet(Facet),
}

impl Body {
    fn corners(&self) -> &[Point3<f64>] {
        match self {
            Self::Solid(solid) => solid.corners(),
            Self::Facet(facet) => &facet.corners,
        }
    }

    fn first_hit(&self, ray: &Ray) -> Option<Hit> {
        match self {
            Self::Solid(solid) => solid.first_hit(ray),
            Self::Facet(facet) => facet.hit(ray),
        }
    }
}

#[derive(Debug, Clone)]
struct Bounds {
    low: Point3<f64>,
    high: Point3<f64>,
}

#[derive(Debug, Clone)]
enum Below {
    Leaf(Vec<usize>),
    Split(Box<[Node; 2]>),
}

#[derive(Debug, Clone)]
struct Node {
    bounds: Bounds,
    below: Below,
}

/// A leaf of the tree holds at most this many bodies.
const LEAF: usize = 3;

impl Scene {
    pub(super) fn new(solids: Vec<Solid>, table_mm: f64) -> Self {
        Self::of(solids.into_iter().map(Body::Solid).collect(), table_mm)
    }

    pub(super) fn of(bodies: Vec<Body>, table_mm: f64) -> Self {
        let mut boxes: Vec<(usize, Bounds)> =
            bodies.iter().map(|body| Bounds::of(body.corners())).enumerate().collect();
        let tree = (!boxes.is_empty()).then(|| Node::build(&mut boxes));
        Self { bodies, tree, table_mm }
    }

    /// The bodies in the frame `to_from`, on a table at another height.
    pub(super) fn moved(&self, to_from: &Isometry3<f64>, table_mm: f64) -> Self {
        let moved = |body: &Body| match body {
            Body::Solid(solid) => Body::Solid(solid.moved(to_from)),
            Body::Facet(facet) => Body::Facet(facet.moved(to_from)),
        };
        Self::of(self.bodies.iter().map(moved).collect(), table_mm)
    }

    /// Height of the table's top, mm.
    pub fn table_mm(&self) -> f64 {
        self.table_mm
    }

    /// The first surface that a ray from `origin` meets; its distance in multiples of `direction`.
    pub fn cast(&self, origin: Point3<f64>, direction: Vector3<f64>) -> Option<Hit> {
        let ray = Ray { origin, direction };
        let mut best = self.table_hit(&ray);
        if let Some(tree) = &self.tree {
            tree.first_hit(&self.bodies, &ray, &direction.map(|d| 1.0 / d), &mut best);
        }
        best
    }

    /// The facets within `radius_mm` of a point, or somewhat beyond.
    pub(super) fn facets_near(&self, point: &Point3<f64>, radius_mm: f64) -> Vec<&Facet> {
        let mut found = Vec::new();
        let mut nodes: Vec<&Node> = self.tree.iter().collect();
        while let Some(node) = nodes.pop() {
            if node.bounds.distance(point) > radius_mm {
                continue;
            }
            match &node.below {
                Below::Split(below) => nodes.extend(below.iter()),
                Below::Leaf(indices) => found.extend(indices),
            }
        }
        found.sort_unstable();
        let facet = |&i: &usize| match &self.bodies[i] {
            Body::Facet(facet) => Some(facet),
            Body::Solid(_) => None,
        };
        found.iter().filter_map(facet).collect()
    }

    /// Whether nothing stands between two points.
    pub fn is_free(&self, from: Point3<f64>, to: Point3<f64>) -> bool {
        self.cast(from, to - from).is_none_or(|hit| hit.distance >= 1.0)
    }

    fn table_hit(&self, ray: &Ray) -> Option<Hit> {
        let distance = (self.table_mm - ray.origin.z) / ray.direction.z;
        (ray.direction.z < 0.0 && distance > 0.0).then(|| Hit { distance, normal: Vector3::z() })
    }
}

impl Bounds {
    fn of(corners: &[Point3<f64>]) -> Self {
        let mut bounds =
            Self { low: Point3::from([f64::INFINITY; 3]), high: Point3::from([f64::NEG_INFINITY; 3]) };
        for corner in corners {
            bounds = Self { low: bounds.low.inf(corner), high: bounds.high.sup(corner) };
        }
        bounds
    }

    fn union(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    fn distance(&self, point: &Point3<f64>) -> f64 {
        let outside = |k: usize| (self.low[k] - point[k]).max(point[k] - self.high[k]).max(0.0);
        Vector3::new(outside(0), outside(1), outside(2)).norm()
    }

    fn centre(&self, axis: usize) -> f64 {
        self.low[axis] + self.high[axis]
    }

    /// Whether the ray enters before `limit`. A ray in a face's plane gives NaN there, which max and min pass over.
    fn is_met(&self, ray: &Ray, inverse: &Vector3<f64>, limit: f64) -> bool {
        let (mut enter, mut leave) = (0.0_f64, limit);
        for axis in 0..3 {
            let low = (self.low[axis] - ray.origin[axis]) * inverse[axis];
            let high = (self.high[axis] - ray.origin[axis]) * inverse[axis];
            let (near, far) = if inverse[axis].is_sign_positive() { (low, high) } else { (high, low) };
            enter = enter.max(near);
            leave = leave.min(far);
        }
        enter <= leave
    }
}

impl Node {
    /// `boxes` is not empty.
    fn build(boxes: &mut [(usize, Bounds)]) -> Self {
        let first = boxes[0].1.clone();
        let bounds = boxes.iter().fold(first, |all, (_, b)| all.union(b));
        if boxes.len() <= LEAF {
            let below = Below::Leaf(boxes.iter().map(|(i, _)| *i).collect());
            return Self { bounds, below };
        }
        let axis = (bounds.high - bounds.low).imax();
        boxes.sort_by(|a, b| a.1.centre(axis).total_cmp(&b.1.centre(axis)));
        let (left, right) = boxes.split_at_mut(boxes.len() / 2);
        Self { bounds, below: Below::Split(Box::new([Self::build(left), Self::build(right)])) }
    }

    fn first_hit(&self, bodies: &[Body], ray: &Ray, inverse: &Vector3<f64>, best: &mut Option<Hit>) {
        let limit = best.map_or(f64::INFINITY, |hit| hit.distance);
        if !self.bounds.is_met(ray, inverse, limit) {
            return;
        }
        match &self.below {
            Below::Split(nodes) => nodes.iter().for_each(|node| node.first_hit(bodies, ray, inverse, best)),
            Below::Leaf(indices) => {
                for hit in indices.iter().filter_map(|&i| bodies[i].first_hit(ray)) {
                    if best.is_none_or(|b| hit.distance < b.distance) {
                        *best = Some(hit);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::solid::Convex;
    use super::*;

    #[test]
    fn the_tree_finds_what_a_search_through_all_finds() {
        let at = |i: i32| f64::from(i) * 15.0;
        let solids: Vec<Solid> = (0..10)
            .flat_map(|i| (0..10).map(move |j| (i, j)))
            .map(|(i, j)| {
                let low = [at(i), at(j), 0.0];
                Convex::cuboid(low, [low[0] + 9.0, low[1] + 8.0, f64::from(3 + (i * j) % 7)]).into()
            })
            .collect();
        let scene = Scene::new(solids.clone(), -1.0);
        for k in 0..500 {
            let k = f64::from(k);
            let ray = Ray {
                origin: Point3::new(k % 150.0, (k * 7.3) % 150.0, 60.0),
                direction: Vector3::new((k * 0.7) % 2.0 - 1.0, (k * 1.3) % 2.0 - 1.0, -1.0),
            };
            let all =
                solids.iter().filter_map(|s| s.first_hit(&ray)).map(|h| h.distance).fold(61.0, f64::min);
            assert_eq!(scene.cast(ray.origin, ray.direction).unwrap().distance, all);
        }
    }

    #[test]
    fn a_wall_hides_what_is_behind_it() {
        let scene = Scene::new(vec![Convex::cuboid([-1.0, -50.0, 0.0], [1.0, 50.0, 50.0]).into()], 0.0);
        assert!(!scene.is_free(Point3::new(-20.0, 0.0, 10.0), Point3::new(20.0, 0.0, 10.0)));
        assert!(scene.is_free(Point3::new(-20.0, 0.0, 60.0), Point3::new(20.0, 0.0, 60.0)));
    }
}
