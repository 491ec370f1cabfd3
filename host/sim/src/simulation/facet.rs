//! A triangle of a mesh, seen from either side. Millimetres.

use super::solid::{Hit, Ray};
use nalgebra::{Isometry3, Point3, Vector3};

/// A triangle.
#[derive(Debug, Clone)]
pub(super) struct Facet {
    pub(super) corners: [Point3<f64>; 3],
    /// Unit normal by the order of the corners: out of the material where the mesh is sound.
    pub(super) normal: Vector3<f64>,
}

/// A ray this far outside an edge, as a share of the triangle, still meets it: neighbours leave no crack between them.
const SEAL: f64 = 1e-9;

impl Facet {
    /// The triangle, if it has an area.
    pub(super) fn new(corners: [Point3<f64>; 3]) -> Option<Self> {
        let [a, b, c] = corners;
        Some(Self { corners, normal: (b - a).cross(&(c - a)).try_normalize(1e-12)? })
    }

    /// The triangle in the frame `to_from`.
    pub(super) fn moved(&self, to_from: &Isometry3<f64>) -> Self {
        Self { corners: self.corners.map(|p| to_from * p), normal: to_from.rotation * self.normal }
    }

    /// Where a ray meets the triangle (Moeller and Trumbore 1997); the normal is that of the side it comes from.
    pub(super) fn hit(&self, ray: &Ray) -> Option<Hit> {
        let [a, b, c] = self.corners;
        let (first, second) = (b - a, c - a);
        let across = ray.direction.cross(&second);
        let volume = first.dot(&across);
        let from = ray.origin - a;
        let u = from.dot(&across) / volume;
        let lifted = from.cross(&first);
        let v = ray.direction.dot(&lifted) / volume;
        let distance = second.dot(&lifted) / volume;
        // A ray in the plane gives infinities or NaN, which fail here.
        let inside = u >= -SEAL && v >= -SEAL && u + v <= 1.0 + SEAL && distance > 0.0;
        let normal = if self.normal.dot(&ray.direction) < 0.0 { self.normal } else { -self.normal };
        (inside && distance.is_finite()).then_some(Hit { distance, normal })
    }

    /// Distance from a point to the nearest place of the triangle.
    pub(super) fn distance(&self, point: &Point3<f64>) -> f64 {
        let height = self.normal.dot(&(point - self.corners[0]));
        let foot = point - self.normal * height;
        let sides = [0, 1, 2].map(|k| (self.corners[k], self.corners[(k + 1) % 3]));
        let inside = sides.iter().all(|(a, b)| (b - a).cross(&(foot - a)).dot(&self.normal) >= 0.0);
        if inside {
            return height.abs();
        }
        let to_side = |(a, b): &(Point3<f64>, Point3<f64>)| {
            let along = b - a;
            let share = ((point - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (point - (a + along * share)).norm()
        };
        sides.iter().map(to_side).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facet() -> Facet {
        Facet::new([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]].map(Point3::from)).unwrap()
    }

    #[test]
    fn a_triangle_is_met_from_both_sides_and_nowhere_else() {
        let ray = |x: f64, z: f64| Ray {
            origin: Point3::new(x, 2.0, z),
            direction: Vector3::new(0.0, 0.0, -z.signum()),
        };
        let above = facet().hit(&ray(3.0, 5.0)).unwrap();
        assert_eq!((above.distance, above.normal), (5.0, Vector3::z()));
        assert_eq!(facet().hit(&ray(3.0, -5.0)).unwrap().normal, -Vector3::z());
        assert!(facet().hit(&ray(8.5, 5.0)).is_none() && facet().hit(&ray(-0.1, 5.0)).is_none());
        let level = Ray { origin: Point3::new(-5.0, 2.0, 0.0), direction: Vector3::x() };
        assert!(facet().hit(&level).is_none());
    }

    #[test]
    fn the_nearest_place_is_inside_on_an_edge_or_at_a_corner() {
        let distance = |x: f64, y: f64, z: f64| facet().distance(&Point3::new(x, y, z));
        assert_eq!(distance(2.0, 2.0, 3.0), 3.0);
        assert_eq!(distance(4.0, -3.0, 4.0), 5.0);
        assert_eq!(distance(-3.0, -4.0, 0.0), 5.0);
    }

    #[test]
    fn three_corners_in_a_line_are_no_triangle() {
        assert!(Facet::new([[0.0; 3], [1.0; 3], [2.0; 3]].map(Point3::from)).is_none());
    }
}
