//! Position and rotation between the poses of a path (paper II-F, eqs. (18) and (19)).
//!
//! Lengths are millimetres, base frame. Lazy: nothing is stored but the segment at hand, so the microcontroller holds
//! the sparse path and computes set-points from it.
//!
//! Departures. The paper counts `j = 0..=rho`, which doubles every joint: here `j = 0..rho` and the last pose once.
//! It interpolates rotation vectors, which fails near half a turn (a torch that points down): here unit quaternions,
//! the short way round. See [`Arc`] for how.

use core::iter;

use super::TorchPose;
use crate::rotation::{self, Arc};
use crate::{Orientation, Point, Vector, math};

/// The straight and evenly turning motion between two poses.
#[derive(Debug, Clone, Copy)]
pub struct Segment {
    from: TorchPose,
    to: TorchPose,
    chord_mm: Vector,
    length_mm: f32,
    arc: Arc,
}

impl Segment {
    /// The segment between two poses; the sign of `to`'s quaternion is made that of `from`'s.
    pub fn new(from: &TorchPose, to: &TorchPose) -> Self {
        let chord_mm = to.position_mm - from.position_mm;
        let orientation = rotation::same_hemisphere(&to.orientation, &from.orientation);
        Self {
            from: *from,
            to: TorchPose { orientation, ..*to },
            chord_mm,
            length_mm: math::norm(&chord_mm),
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
            TorchPose { position_mm: self.position_at(alpha), orientation: self.orientation_at(alpha) }
        }
    }

    /// Position of the `j`-th of `rho` poses at `alpha = j / rho`, eq. (18), mm.
    fn position_at(&self, alpha: f32) -> Point {
        self.from.position_mm + self.chord_mm * alpha
    }

    /// Rotation at the same `alpha`, eq. (19), as quaternions: error below 1e-6 rad.
    fn orientation_at(&self, alpha: f32) -> Orientation {
        self.arc.at(alpha)
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
/// use weldpath_core::{Orientation, Point};
///
/// let at = |x_mm| TorchPose { position_mm: Point::new(x_mm, 0.0, 0.0), orientation: Orientation::identity() };
/// let poses = densify(&[at(0.0), at(10.0), at(14.0)], 2);
/// assert!(poses.map(|pose| pose.position_mm.x).eq([0.0, 5.0, 10.0, 12.0, 14.0]));
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

/// Distance between the poses of an evenly spaced path, mm.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Pitch(f32);

impl Pitch {
    /// A pitch above zero; none otherwise.
    pub fn new(pitch_mm: f32) -> Option<Self> {
        (pitch_mm.is_finite() && pitch_mm > 0.0).then_some(Self(pitch_mm))
    }

    /// How many equal steps of at most this pitch make up `length_mm`; at least one.
    fn steps(self, length_mm: f32) -> u32 {
        let whole = (length_mm / self.0) as u32;
        let short = whole as f32 * self.0 < length_mm * (1.0 - 1e-6);
        whole.saturating_add(u32::from(short)).max(1)
    }
}

/// Both ends, and between them poses at equal arc lengths of at most `pitch`; a path that only turns gives its ends.
///
/// ```
/// use weldpath_core::path::{TorchPose, interpolation::{Pitch, densify_by_pitch}};
/// use weldpath_core::{Orientation, Point};
///
/// let at = |x_mm| TorchPose { position_mm: Point::new(x_mm, 0.0, 0.0), orientation: Orientation::identity() };
/// let path = [at(0.0), at(3.0), at(10.0)];
/// let poses = densify_by_pitch(&path, Pitch::new(2.5).unwrap());
/// assert!(poses.map(|pose| pose.position_mm.x).eq([0.0, 2.5, 5.0, 7.5, 10.0]));
/// ```
pub fn densify_by_pitch(sparse: &[TorchPose], pitch: Pitch) -> impl Iterator<Item = TorchPose> + '_ {
    let length_mm: f32 = segments(sparse).map(|s| s.length_mm()).sum();
    let steps = pitch.steps(length_mm);
    let mut rest = segments(sparse);
    let mut current = rest.next();
    let mut passed_mm = 0.0;
    let mut next_step = 0;
    let along = iter::from_fn(move || {
        let mut segment = current?;
        if next_step == steps {
            current = None;
            return Some(rest.by_ref().last().unwrap_or(segment).to);
        }
        let at_mm = length_mm * (next_step as f32 / steps as f32);
        while at_mm > passed_mm + segment.length_mm {
            let Some(following) = rest.next() else { break };
            passed_mm += segment.length_mm;
            segment = following;
        }
        current = Some(segment);
        next_step += 1;
        Some(segment.at(share(at_mm - passed_mm, segment.length_mm)))
    });
    along.chain(lone(sparse))
}

/// The only pose of a path that has no segment.
fn lone(sparse: &[TorchPose]) -> Option<TorchPose> {
    if sparse.len() == 1 { sparse.first().copied() } else { None }
}

fn share(part_mm: f32, whole_mm: f32) -> f32 {
    if whole_mm > 0.0 { part_mm / whole_mm } else { 0.0 }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::rotation::tests::{orientations, wide};
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
        let even: Vec<_> = densify_by_pitch(&sparse, Pitch::new(0.5).unwrap()).collect();
        assert!(even.windows(2).all(|pair| quaternion_dot(&pair[0], &pair[1]) > 0.0));
    }

    #[test]
    fn short_paths_and_no_points_per_segment_have_an_answer() {
        let sparse = path(3);
        let pitch = Pitch::new(1.0).unwrap();
        assert_eq!(densify(&[], 5).count(), 0);
        assert_eq!(densify_by_pitch(&[], pitch).count(), 0);
        assert_eq!(densify(&sparse[..1], 5).collect::<Vec<_>>(), sparse[..1]);
        assert_eq!(densify_by_pitch(&sparse[..1], pitch).collect::<Vec<_>>(), sparse[..1]);
        assert_eq!(densify(&sparse, 0).count(), 3);
        let turning = [sparse[0], TorchPose { position_mm: sparse[0].position_mm, ..sparse[1] }];
        assert_eq!(densify_by_pitch(&turning, pitch).count(), 2);
    }

    #[test]
    fn equal_pitch_means_equal_arc_length() {
        let sparse = path(12);
        let dense: Vec<_> = densify_by_pitch(&sparse, Pitch::new(0.7).unwrap()).collect();
        let length: f32 = segments(&sparse).map(|s| s.length_mm()).sum();
        assert_eq!(dense.first().unwrap().position_mm, sparse[0].position_mm);
        assert_eq!(dense.last().unwrap().position_mm, sparse[11].position_mm);
        let step = length / (dense.len() - 1) as f32;
        assert!(step <= 0.7 && step > 0.69);
        for pair in dense.windows(2) {
            // A chord across a waypoint is shorter than the way round it, never longer.
            let chord = math::norm(&(pair[1].position_mm - pair[0].position_mm));
            assert!(chord < step + 1e-3);
        }
    }

    #[test]
    fn a_pitch_has_a_length() {
        assert!([0.0, -1.0, f32::NAN, f32::INFINITY].into_iter().all(|p| Pitch::new(p).is_none()));
        let even = Pitch::new(0.1).unwrap();
        assert_eq!((even.steps(1.0), even.steps(0.0), even.steps(0.05)), (10, 1, 1));
    }
}
