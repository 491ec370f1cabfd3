//! A cylinder through points with normals.

use crate::geometry::plane::Moments;
use crate::geometry::statistics::rms;
use crate::geometry::table;
use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

/// Steps of the fit; each squares what is left of the error.
const STEPS: usize = 6;
/// The largest radius that is told from a plane, in lengths across it.
const MOST_RADIUS: f32 = 5.0;

/// A cylinder without ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cylinder {
    /// A point of its axis.
    foot: Point3<f32>,
    /// Unit.
    axis: Vector3<f32>,
    pub(super) radius_mm: f32,
}

impl Cylinder {
    /// Through points with normals, and how far they scatter about it, mm. None where they are flat, or lie on no cylinder at all.
    pub(super) fn of(rows: &[(Point3<f32>, Vector3<f32>)]) -> Option<(Self, f32)> {
        let mut cylinder = Self::first(rows)?;
        for _ in 0..STEPS {
            cylinder = cylinder.better(rows)?;
        }
        let off_mm: Vec<f64> = rows.iter().map(|(p, _)| f64::from(cylinder.off_mm(p))).collect();
        let across = cylinder.axis.cross(&rows[0].1);
        let at = rows.iter().map(|(p, _)| p.coords.dot(&across));
        let wide_mm = at.clone().fold(f32::MIN, f32::max) - at.fold(f32::MAX, f32::min);
        let is_round = cylinder.radius_mm < MOST_RADIUS * wide_mm;
        Some((cylinder, rms(&off_mm)? as f32)).filter(|_| is_round)
    }

    /// By the normals: the axis is square to all of them, and they meet in it.
    fn first(rows: &[(Point3<f32>, Vector3<f32>)]) -> Option<Self> {
        let mut moments = Moments::default();
        for (_, n) in rows {
            moments.add(*n);
            moments.add(-n);
        }
        let axis = moments.plane().normal;
        let across = |v: Vector3<f32>| v - axis * v.dot(&axis);
        // The place that all lines along the normals are nearest to.
        let (mut matrix, mut right) = (axis * axis.transpose(), Vector3::zeros());
        let from = rows.first()?.0;
        for (p, n) in rows {
            let Some(n) = across(*n).try_normalize(1e-3) else { continue };
            let part = Matrix3::identity() - axis * axis.transpose() - n * n.transpose();
            matrix += part;
            right += part * (p - from);
        }
        let foot = from + matrix.try_inverse()? * right;
        let radii = rows.iter().map(|(p, _)| across(p - foot).norm());
        Some(Self { foot, axis, radius_mm: radii.sum::<f32>() / rows.len() as f32 })
    }

    /// After one step of Gauss and Newton's: both turns of the axis, both shifts of its foot, the radius.
    fn better(&self, rows: &[(Point3<f32>, Vector3<f32>)]) -> Option<Self> {
        let [a, b] = table::axes(&self.axis);
        let middle =
            rows.iter().map(|(p, _)| (p - self.foot).dot(&self.axis)).sum::<f32>() / rows.len() as f32;
        let foot = self.foot + self.axis * middle;
        let (mut matrix, mut right) = (SMatrix::<f64, 5, 5>::zeros(), SVector::<f64, 5>::zeros());
        for (p, _) in rows {
            let off = p - foot;
            let along = off.dot(&self.axis);
            let Some(out) = (off - self.axis * along).try_normalize(1e-3) else { continue };
            let [x, y] = [out.dot(&a), out.dot(&b)];
            let row = SVector::<f32, 5>::from([along * x, along * y, x, y, 1.0]).cast::<f64>();
            matrix += row * row.transpose();
            right += row * f64::from(off.dot(&out) - self.radius_mm);
        }
        let [tilt_x, tilt_y, x, y, radius_mm] = matrix.cholesky()?.solve(&right).cast::<f32>().into();
        let axis = (self.axis + a * tilt_x + b * tilt_y).normalize();
        Some(Self { foot: foot + a * x + b * y, axis, radius_mm: self.radius_mm + radius_mm })
    }

    /// How far a point lies outside it, mm.
    pub(super) fn off_mm(&self, p: &Point3<f32>) -> f32 {
        let off = p - self.foot;
        (off - self.axis * off.dot(&self.axis)).norm() - self.radius_mm
    }

    /// Whether a normal at a place points out of it, or into it: 1 or -1.
    pub(super) fn side(&self, place: &Point3<f32>, normal: &Vector3<f32>) -> f32 {
        (place - self.foot).dot(normal).signum()
    }

    /// Square to it at a place, about as one that was seen near it.
    pub(super) fn normal_at(&self, place: &Point3<f32>, seen: &Vector3<f32>) -> Vector3<f32> {
        let off = place - self.foot;
        let out = (off - self.axis * off.dot(&self.axis)).try_normalize(1e-3).unwrap_or(*seen);
        if out.dot(seen) < 0.0 { -out } else { out }
    }
}
