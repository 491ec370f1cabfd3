//! Poses and waypoints as they travel: micrometres and Q15 quaternions, robot base frame.
//!
//! No float, so a NaN cannot be expressed and both ends hold the same numbers. Resolution: 1 µm and about
//! 4e-5 rad; range: 2.1 km.

use serde::{Deserialize, Serialize};

use crate::math;
use crate::path::TorchPose;
use crate::{Orientation, Point};

/// 1.0 in a Q15 quaternion component.
pub const Q15_ONE: i16 = i16::MAX;

/// A pose: where, and how it is turned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WirePose {
    /// x y z, µm.
    pub position_um: [i32; 3],
    /// w x y z, 32767 = 1; sent as four little-endian 16-bit words.
    #[serde(with = "super::fixed")]
    pub orientation_q15: [i16; 4],
}

/// A torch pose with what the welder does from here to the next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WireWaypoint {
    /// Torch tip, `base_from_torch`.
    pub pose: WirePose,
    /// Speed of the tip on the segment that begins here, µm/s.
    pub feed_um_s: u32,
    /// Whether the segment that begins here is welded.
    pub weld: bool,
}

impl WirePose {
    /// At the origin, not turned.
    pub const IDENTITY: Self = Self { position_um: [0; 3], orientation_q15: [Q15_ONE, 0, 0, 0] };

    /// Rounds to the wire's grid. `None` if a number is not finite or beyond 2.1 km.
    pub fn from_pose(pose: &TorchPose) -> Option<Self> {
        let [x, y, z] =
            [pose.position_mm.x, pose.position_mm.y, pose.position_mm.z].map(|mm| round(mm * 1000.0));
        let q = pose.orientation.quaternion();
        let [w, i, j, k] = [q.w, q.i, q.j, q.k].map(|c| round(c * f32::from(Q15_ONE)));
        let position_um = [x?, y?, z?];
        let orientation_q15 =
            [w?, i?, j?, k?].map(|c| c.clamp(-i32::from(Q15_ONE), i32::from(Q15_ONE)) as i16);
        Some(Self { position_um, orientation_q15 })
    }

    /// The pose in millimetres; `None` if the quaternion is not a unit one ([`Self::is_unit`]).
    pub fn to_pose(&self) -> Option<TorchPose> {
        if !self.is_unit() {
            return None;
        }
        let [x, y, z] = self.position_um.map(|um| um as f32 / 1000.0);
        let [w, i, j, k] = self.orientation_q15.map(f32::from);
        let q = nalgebra::Quaternion::new(w, i, j, k) / math::sqrt(w * w + i * i + j * j + k * k);
        Some(TorchPose { position_mm: Point::new(x, y, z), orientation: Orientation::new_unchecked(q) })
    }

    /// Whether the squared norm of the quaternion is 1 within 0.1 % (rounding alone makes 0.02 %).
    pub fn is_unit(&self) -> bool {
        const ONE: i64 = Q15_ONE as i64 * Q15_ONE as i64;
        (self.dot_q30(self) - ONE).abs() <= ONE / 1000
    }

    /// Scalar product of two orientations, Q30: the cosine of half the angle between them, with a free sign.
    pub fn dot_q30(&self, other: &Self) -> i64 {
        self.orientation_q15
            .iter()
            .zip(other.orientation_q15)
            .map(|(&a, b)| i64::from(a) * i64::from(b))
            .sum()
    }

    /// Whether the position is the origin and the orientation that of the base, in its usual sign.
    pub fn is_identity(&self) -> bool {
        let ([x, y, z], [w, i, j, k]) = (self.position_um, self.orientation_q15);
        (x | y | z) == 0 && (i | j | k) == 0 && w == Q15_ONE
    }

    /// Displacement to another pose's position, µm. Exact up to 16 m, then rounded.
    pub fn offset_um(&self, to: &Self) -> [f32; 3] {
        let ([ax, ay, az], [bx, by, bz]) = (self.position_um, to.position_um);
        // 64 bits are converted in software on a 32-bit processor: only where they are needed.
        let far = |a: i32, b: i32| (i64::from(b) - i64::from(a)) as f32;
        let way = |a: i32, b: i32| b.checked_sub(a).map_or_else(|| far(a, b), |um| um as f32);
        [way(ax, bx), way(ay, by), way(az, bz)]
    }

    /// Distance between the positions, µm.
    pub fn distance_um(&self, to: &Self) -> f32 {
        let [x, y, z] = self.offset_um(to);
        math::sqrt(x * x + y * y + z * z)
    }
}

impl WireWaypoint {
    /// Bytes of [`Self::to_bytes`].
    pub const BYTES: usize = 25;

    /// The waypoint in fixed-width little-endian form, which the path digest is computed over:
    /// x y z (i32), w x y z (i16), feed (u32), weld (u8: 0 or 1).
    pub fn to_bytes(&self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        let position = self.pose.position_um.into_iter().flat_map(i32::to_le_bytes);
        let orientation = self.pose.orientation_q15.into_iter().flat_map(i16::to_le_bytes);
        let rest = self.feed_um_s.to_le_bytes().into_iter().chain([u8::from(self.weld)]);
        for (to, from) in bytes.iter_mut().zip(position.chain(orientation).chain(rest)) {
            *to = from;
        }
        bytes
    }
}

/// Nearest integer, halves away from zero.
fn round(x: f32) -> Option<i32> {
    let nearest = x + 0.5_f32.copysign(x);
    (nearest.abs() < 2_147_483_500.0).then_some(nearest as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_survives_the_wire_within_its_grid() {
        let orientation = Orientation::from_euler_angles(3.1, -0.4, 1.7);
        let pose = TorchPose { position_mm: Point::new(812.3456, -1204.0017, 3.0004), orientation };
        let back = WirePose::from_pose(&pose).and_then(|wire| wire.to_pose()).expect("finite and unit");
        assert!((back.position_mm - pose.position_mm).norm() < 1.2e-3);
        assert!(back.orientation.angle_to(&orientation) < 1e-4);
    }

    #[test]
    fn a_pose_that_is_not_finite_has_no_wire_form() {
        let at =
            |x: f32| TorchPose { position_mm: Point::new(x, 0.0, 0.0), orientation: Orientation::identity() };
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3.0e6, -3.0e6] {
            assert_eq!(WirePose::from_pose(&at(x)), None);
        }
        assert!(WirePose::from_pose(&at(2.0e6)).is_some());
    }

    #[test]
    fn distances_at_the_ends_of_the_range_do_not_overflow() {
        let far = |um: i32| WirePose { position_um: [um; 3], ..WirePose::IDENTITY };
        let diagonal = far(i32::MIN).distance_um(&far(i32::MAX));
        assert!((diagonal / 7.4392e9 - 1.0).abs() < 1e-3);
    }
}
