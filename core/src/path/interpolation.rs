//! Position and rotation between the poses of a path (paper II-F, eqs. (18) and (19)).
//!
//! Lengths are millimetres, base frame. Lazy: nothing is stored but the segment at hand, so the microcontroller holds
//! the sparse path and computes set-points from it.
//!
//! Departures. The paper counts `j = 0..=rho`, which doubles every joint: here `j = 0..rho` and the last pose once.
//! It interpolates rotation vectors, which fails near half a turn (a torch that points down): here unit quaternions,
//! the short way round, see [`Arc`].

use core::iter;

use super::TorchPose;
use crate::math::{self, Real};
use crate::rotation::{self, Arc};
use nalgebra::Point3;

/// Position of the `j`-th of `rho` poses at `alpha = j / rho`, eq. (18), mm.
///
/// Host and pendant fill in their paths by this and by [`Arc::slerp`]: the host in double precision, the pendant in
/// single.
#[inline]
pub fn position_between<T: Real>(from_mm: &Point3<T>, to_mm: &Point3<T>, alpha: T) -> Point3<T> {
    from_mm + (to_mm - from_mm) * alpha
}

/// The straight and evenly turning motion between two poses.
#[derive(Debug, Clone, Copy)]
pub struct Segment {
    from: TorchPose,
    to: TorchPose,
    length_mm: f32,
    arc: Arc,
}

impl Segment {
    /// The segment between two poses; the sign of `to`'s quaternion is made that of `from`'s.
    pub fn new(from: &TorchPose, to: &TorchPose) -> Self {
        let orientation = rotation::same_hemisphere(&to.orientation, &from.orientation);
        Self {
            from: *from,
            to: TorchPose { orientation, ..*to },
            length_mm: math::norm(&(to.position_mm - from.position_mm)),
            arc: Arc::between(&from.orientation, &to.orientation),
        }
    }

    /// Distance between the two positions, mm; 0 if the torch only turns.
    pub fn length_mm(&self) -> f32 {
        self.length_mm
    }

    /// Angle between the two orientations, radians.
    pub fn angle_rad(&self) -> f32 {
        self.arc.angle_rad()
    }

    /// The pose after the share `alpha` of the segment; exactly the ends at and beyond 0 and 1.
    pub fn at(&self, alpha: f32) -> TorchPose {
        if alpha <= 0.0 {
            self.from
        } else if alpha >= 1.0 {
            self.to
        } else {
            TorchPose {
                position_mm: position_between(&self.from.position_mm, &self.to.position_mm, alpha),
                orientation: self.arc.slerp(alpha),
            }
        }
    }
}

/// The segments of a path in order, the quaternion of each starting where the one before ended.
pub fn segments(sparse: &[TorchPose]) -> impl Iterator<Item = Segment> + '_ {
    let mut poses = sparse.iter();
    let mut from = poses.next().copied();
    iter::from_fn(move || {
        let segment = Segment::new(&from?, poses.next()?);
        from = Some(segment.to);
        Some(segment)
    })
}

/// `per_segment` poses from each waypoint to before the next, and the last waypoint: every waypoint is among them.
///
/// 0 per segment is taken as 1, which is the waypoints alone.
///
/// ```
/// use weldpath_core::path::{TorchPose, interpolation::densify};
/// use weldpath_core::{Point, Vector, rotation};
///
/// let pose = |x_mm, turn_rad| TorchPose {
///     position_mm: Point::new(x_mm, 0.0, 0.0),
///     orientation: rotation::from_rotation_vector(&Vector::new(turn_rad, 0.0, 0.0)),
/// };
/// // A torch that points down: half a turn about x, where rotation vectors fail.
/// let sparse = [pose(0.0, 3.1), pose(10.0, 3.2)];
/// let dense: Vec<TorchPose> = densify(&sparse, 4).collect();
/// assert_eq!(dense.len(), 5);
/// assert_eq!(dense[2].position_mm, Point::new(5.0, 0.0, 0.0));
/// let off = rotation::Arc::between(&dense[2].orientation, &pose(0.0, 3.15).orientation);
/// assert!(off.angle_rad() < 1e-5);
/// ```
pub fn densify(sparse: &[TorchPose], per_segment: u16) -> impl Iterator<Item = TorchPose> + '_ {
    let rho = per_segment.max(1);
    let last = sparse.len().saturating_sub(2);
    let along = segments(sparse).enumerate().flat_map(move |(index, segment)| {
        let ends_path = index == last;
        let alphas = (0..rho).map(move |j| f32::from(j) / f32::from(rho)).chain(ends_path.then_some(1.0));
        alphas.map(move |alpha| segment.at(alpha))
    });
    along.chain(lone(sparse))
}

/// The only pose of a path that has no segment.
fn lone(sparse: &[TorchPose]) -> Option<TorchPose> {
    if sparse.len() == 1 { sparse.first().copied() } else { None }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::rotation::tests::{orientations, wide};
    use crate::{Orientation, Point};
    use std::vec::Vec;

    fn path(n: usize) -> Vec<TorchPose> {
        let turn = |(i, orientation): (usize, Orientation)| {
            let t = i as f32;
            TorchPose { position_mm: Point::new(10.0 * t, 3.0 * t * t, 500.0 - t), orientation }
        };
        orientations().take(n).enumerate().map(turn).collect()
    }

    fn quaternion_dot(a: &TorchPose, b: &TorchPose) -> f32 {
        a.orientation.coords.dot(&b.orientation.coords)
    }

    #[test]
    fn densify_keeps_both_ends_and_every_waypoint() {
        let sparse = path(9);
        let dense: Vec<_> = densify(&sparse, 4).collect();
        assert_eq!(dense.len(), 8 * 4 + 1);
        for (waypoint, kept) in sparse.iter().zip(dense.iter().step_by(4)) {
            assert_eq!(waypoint.position_mm, kept.position_mm);
            assert!(quaternion_dot(waypoint, kept).abs() > 1.0 - 1e-6, "the same rotation");
        }
    }

    #[test]
    fn densified_poses_match_double_precision() {
        let sparse = path(40);
        let rho = 16;
        for (i, pose) in densify(&sparse, rho).enumerate().take(39 * 16) {
            let (a, b) = (&sparse[i / 16], &sparse[i / 16 + 1]);
            let alpha = (i % 16) as f64 / 16.0;
            let lerp = a.position_mm.coords.cast::<f64>().lerp(&b.position_mm.coords.cast::<f64>(), alpha);
            assert!((pose.position_mm.coords.cast::<f64>() - lerp).norm() < 2e-4);
            let slerp = wide(&a.orientation).slerp(&wide(&b.orientation), alpha);
            let error = (slerp.inverse() * wide(&pose.orientation)).imag().norm() * 2.0;
            assert!(error < 1e-6, "{error} rad at {i}");
        }
    }

    #[test]
    fn the_quaternion_sign_never_flips_along_a_path() {
        let mut sparse = path(60);
        for pose in sparse.iter_mut().step_by(3) {
            pose.orientation = Orientation::new_unchecked(-pose.orientation.into_inner());
        }
        let dense: Vec<_> = densify(&sparse, 8).collect();
        assert!(dense.windows(2).all(|pair| quaternion_dot(&pair[0], &pair[1]) > 0.9));
    }

    #[test]
    fn short_paths_and_no_points_per_segment_have_an_answer() {
        let sparse = path(3);
        assert_eq!(densify(&[], 5).count(), 0);
        assert_eq!(densify(&sparse[..1], 5).collect::<Vec<_>>(), sparse[..1]);
        assert_eq!(densify(&sparse, 0).count(), 3);
    }
}
