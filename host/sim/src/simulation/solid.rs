//! Workpieces as exact solids: convex bodies bounded by planes and at most one cylinder, minus convex cuts.
//!
//! A ray meets a convex body in one interval, so the first surface it hits follows from comparing intervals:
//! no mesh, no tolerance. Millimetres.

use nalgebra::{Isometry3, Point3, Vector3};

/// A half-line; `direction` need not be a unit vector, distances along it are multiples of its length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub(super) origin: Point3<f64>,
    pub(super) direction: Vector3<f64>,
}

/// Where a ray meets a surface.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// Multiples of the ray's direction.
    pub distance: f64,
    /// Unit normal, out of the material.
    pub normal: Vector3<f64>,
}

#[derive(Debug, Clone)]
struct Plane {
    normal: Vector3<f64>,
    offset: f64,
}

#[derive(Debug, Clone)]
struct Cylinder {
    point: Point3<f64>,
    axis: Vector3<f64>,
    radius: f64,
}

/// An intersection of half-spaces and at most one infinite cylinder.
#[derive(Debug, Clone)]
pub(super) struct Convex {
    planes: Vec<Plane>,
    cylinder: Option<Cylinder>,
    corners: Vec<Point3<f64>>,
}

struct Span {
    enter: Hit,
    leave: Hit,
}

impl Convex {
    /// `profile` (convex, counter-clockwise in (y, z)) extruded along x from `from` to `to`.
    pub(super) fn prism(profile: &[[f64; 2]], from: f64, to: f64) -> Self {
        let mut planes =
            vec![Plane { normal: -Vector3::x(), offset: -from }, Plane { normal: Vector3::x(), offset: to }];
        for (a, b) in profile.iter().zip(profile.iter().cycle().skip(1)) {
            let normal = Vector3::new(0.0, b[1] - a[1], a[0] - b[0]).normalize();
            planes.push(Plane { normal, offset: normal.y * a[0] + normal.z * a[1] });
        }
        let corners = profile.iter().flat_map(|p| [from, to].map(|x| Point3::new(x, p[0], p[1]))).collect();
        Self { planes, cylinder: None, corners }
    }

    /// The box between two opposite corners.
    pub(super) fn cuboid(low: [f64; 3], high: [f64; 3]) -> Self {
        let profile = [[low[1], low[2]], [high[1], low[2]], [high[1], high[2]], [low[1], high[2]]];
        Self::prism(&profile, low[0], high[0])
    }

    /// A cylinder about x, from `from` to `to`, through the origin of (y, z).
    pub(super) fn cylinder(radius: f64, from: f64, to: f64) -> Self {
        let mut body = Self::cuboid([from, -radius, -radius], [to, radius, radius]);
        body.planes.truncate(2);
        body.cylinder = Some(Cylinder { point: Point3::origin(), axis: Vector3::x(), radius });
        body
    }

    /// The same, upright: about z through (`x`, `y`).
    pub(super) fn upright_cylinder(radius: f64, [x, y]: [f64; 2], from: f64, to: f64) -> Self {
        let columns = super::rotation::from_columns(Vector3::z(), Vector3::x(), Vector3::y());
        let frame = Isometry3::from_parts(nalgebra::Translation3::new(x, y, 0.0), columns);
        Self::cylinder(radius, from, to).moved(&frame)
    }

    /// The part on the inner side of a plane through `point` with outward `normal`.
    pub(super) fn clipped(mut self, point: Point3<f64>, normal: Vector3<f64>) -> Self {
        self.planes.push(Plane { normal, offset: normal.dot(&point.coords) });
        self
    }

    /// The body in the frame `to_from`.
    pub(super) fn moved(&self, to_from: &Isometry3<f64>) -> Self {
        let plane = |p: &Plane| {
            let normal = to_from.rotation * p.normal;
            Plane { normal, offset: p.offset + normal.dot(&to_from.translation.vector) }
        };
        let cylinder = |c: &Cylinder| Cylinder {
            point: to_from * c.point,
            axis: to_from.rotation * c.axis,
            radius: c.radius,
        };
        Self {
            planes: self.planes.iter().map(plane).collect(),
            cylinder: self.cylinder.as_ref().map(cylinder),
            corners: self.corners.iter().map(|p| to_from * p).collect(),
        }
    }

    /// Corners of a polytope that holds the body.
    pub(super) fn corners(&self) -> &[Point3<f64>] {
        &self.corners
    }

    fn span(&self, ray: &Ray) -> Option<Span> {
        let nothing = Vector3::zeros();
        let mut span = match &self.cylinder {
            Some(cylinder) => cylinder.span(ray)?,
            None => Span {
                enter: Hit { distance: f64::NEG_INFINITY, normal: nothing },
                leave: Hit { distance: f64::INFINITY, normal: nothing },
            },
        };
        for plane in &self.planes {
            let gap = plane.offset - plane.normal.dot(&ray.origin.coords);
            let approach = plane.normal.dot(&ray.direction);
            if approach == 0.0 {
                if gap < 0.0 {
                    return None;
                }
                continue;
            }
            let hit = Hit { distance: gap / approach, normal: plane.normal };
            if approach < 0.0 && hit.distance > span.enter.distance {
                span.enter = hit;
            } else if approach > 0.0 && hit.distance < span.leave.distance {
                span.leave = hit;
            }
        }
        (span.enter.distance < span.leave.distance).then_some(span)
    }
}

impl Cylinder {
    fn span(&self, ray: &Ray) -> Option<Span> {
        let across = |v: Vector3<f64>| v - self.axis * self.axis.dot(&v);
        let (d, o) = (across(ray.direction), across(ray.origin - self.point));
        let (a, b, c) = (d.norm_squared(), d.dot(&o), o.norm_squared() - self.radius * self.radius);
        let root = b * b - a * c;
        if a == 0.0 || root <= 0.0 {
            let inside = a == 0.0 && c < 0.0;
            let end = |distance| Hit { distance, normal: Vector3::zeros() };
            return inside.then(|| Span { enter: end(f64::NEG_INFINITY), leave: end(f64::INFINITY) });
        }
        let at = |distance: f64| Hit { distance, normal: (o + d * distance) / self.radius };
        Some(Span { enter: at((-b - root.sqrt()) / a), leave: at((-b + root.sqrt()) / a) })
    }
}

/// A convex body minus convex cuts.
#[derive(Debug, Clone)]
pub(super) struct Solid {
    body: Convex,
    cuts: Vec<Convex>,
}

impl From<Convex> for Solid {
    fn from(body: Convex) -> Self {
        Self { body, cuts: Vec::new() }
    }
}

impl Solid {
    /// The solid without what lies in `cut`.
    pub(super) fn without(mut self, cut: Convex) -> Self {
        self.cuts.push(cut);
        self
    }

    /// The solid in the frame `to_from`.
    pub(super) fn moved(&self, to_from: &Isometry3<f64>) -> Self {
        Self { body: self.body.moved(to_from), cuts: self.cuts.iter().map(|c| c.moved(to_from)).collect() }
    }

    /// Corners of a polytope that holds the solid.
    pub(super) fn corners(&self) -> &[Point3<f64>] {
        self.body.corners()
    }

    /// First surface ahead of a ray that starts outside the material.
    pub(super) fn first_hit(&self, ray: &Ray) -> Option<Hit> {
        let span = self.body.span(ray)?;
        let mut hit = span.enter;
        let cuts: Vec<Span> = self.cuts.iter().filter_map(|cut| cut.span(ray)).collect();
        // Each round leaves one cut for good: intervals on a line.
        for _ in 0..=cuts.len() {
            let inside = |c: &&Span| c.enter.distance <= hit.distance && hit.distance < c.leave.distance;
            match cuts.iter().find(inside) {
                Some(cut) => hit = Hit { distance: cut.leave.distance, normal: -cut.leave.normal },
                None => break,
            }
        }
        (hit.distance > 0.0 && hit.distance < span.leave.distance).then_some(hit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: Point3::from(origin), direction: Vector3::from(direction) }
    }

    #[test]
    fn a_ray_meets_the_near_face_of_a_box() {
        let solid = Solid::from(Convex::cuboid([-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]));
        let hit = solid.first_hit(&ray([0.5, 0.5, 10.0], [0.0, 0.0, -2.0])).unwrap();
        assert_eq!((hit.distance, hit.normal), (3.5, Vector3::z()));
        assert!(solid.first_hit(&ray([1.5, 0.0, 10.0], [0.0, 0.0, -1.0])).is_none());
        assert!(solid.first_hit(&ray([0.0, 0.0, 10.0], [0.0, 0.0, 1.0])).is_none());
    }

    #[test]
    fn a_ray_down_a_tube_meets_its_inner_wall() {
        let tube = Solid::from(Convex::upright_cylinder(10.0, [5.0, 0.0], 0.0, 50.0))
            .without(Convex::upright_cylinder(8.0, [5.0, 0.0], -1.0, 51.0));
        let hit = tube.first_hit(&ray([5.0, 0.0, 55.0], [1.0, 0.0, -1.0])).unwrap();
        assert!((hit.distance - 8.0).abs() < 1e-12 && (hit.normal + Vector3::x()).norm() < 1e-12);
        assert!(tube.first_hit(&ray([5.0, 0.0, 60.0], [0.0, 0.0, -1.0])).is_none());
        let outer = tube.first_hit(&ray([-20.0, 0.0, 25.0], [1.0, 0.0, 0.0])).unwrap();
        assert!((outer.distance - 15.0).abs() < 1e-12 && (outer.normal + Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn moving_a_solid_moves_what_a_ray_meets() {
        let frame = Isometry3::from_parts(
            nalgebra::Translation3::new(100.0, 0.0, 0.0),
            super::super::rotation::about(Vector3::z(), 90.0),
        );
        let solid = Solid::from(Convex::cuboid([0.0, 0.0, 0.0], [10.0, 20.0, 30.0])).moved(&frame);
        let hit = solid.first_hit(&ray([95.0, -50.0, 15.0], [0.0, 1.0, 0.0])).unwrap();
        assert!((hit.distance - 50.0).abs() < 1e-9 && (hit.normal + Vector3::y()).norm() < 1e-9);
    }
}
