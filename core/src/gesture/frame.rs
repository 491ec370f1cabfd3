//! One hand in one frame of the sensor: a frame that exists is finite and its attitude is a rotation.

use crate::{Orientation, Point, Vector, math, rotation};

/// Vectors that should be unit and are shorter than this, or as near to parallel, make no basis.
const LEAST_LENGTH: f32 = 1e-3;

/// How the hand is turned: `sensor_from_hand`, x to the side, y toward the fingers, z out of the palm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude(Orientation);

impl Attitude {
    /// Right-handed basis from the palm's normal (kept) and the hand's direction (made perpendicular to it).
    ///
    /// None if a vector is short or not finite or the two are parallel.
    pub fn from_direction_and_normal(direction: &Vector, normal: &Vector) -> Option<Self> {
        let z = math::direction(normal, LEAST_LENGTH)?.into_inner();
        let y = math::direction(&(direction - z * z.dot(direction)), LEAST_LENGTH)?.into_inner();
        Some(Self(rotation::from_basis(&y.cross(&z), &y, &z)))
    }

    /// The paper's input, `Transform(alpha, beta, gamma)`: roll about z, then pitch about x, then yaw about y, as Leap
    /// Motion counts them (all zero: fingers along -z, palm along -y; a positive yaw points to +x).
    ///
    /// Limit: Leap's three angles are independent projections and not Euler angles. Rebuilt as a rotation they are
    /// right when the hand is turned about one axis, some degrees off when about two, and jump by up to 180 degrees
    /// when the fingers point up (pitch near 90 degrees). Prefer [`Self::from_direction_and_normal`].
    ///
    /// None outside +-pi. Sines by micromath: within 0.2 degrees.
    pub fn from_roll_pitch_yaw(rpy_rad: [f32; 3]) -> Option<Self> {
        let [roll, pitch, yaw] = rpy_rad;
        let half_turn = core::f32::consts::PI + 1e-6;
        if !rpy_rad.iter().all(|angle| angle.abs() <= half_turn) {
            return None;
        }
        let ((sr, cr), (sp, cp), (sy, cy)) =
            (math::sin_cos_coarse(roll), math::sin_cos_coarse(pitch), math::sin_cos_coarse(yaw));
        let direction = Vector::new(cp * sy, sp, -cp * cy);
        let normal = Vector::new(sr * cy + cr * sp * sy, -cr * cp, sr * sy - cr * sp * cy);
        Self::from_direction_and_normal(&direction, &normal)
    }

    /// `sensor_from_hand`.
    pub fn orientation(&self) -> Orientation {
        self.0
    }
}

/// Which fingers are stretched out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fingers(u8);

impl Fingers {
    /// The open hand.
    pub const ALL: Self = Self(0b1_1111);

    /// Thumb, index, middle, ring, little.
    pub fn new(extended: [bool; 5]) -> Self {
        Self(extended.iter().rev().fold(0, |bits, &finger| bits << 1 | u8::from(finger)))
    }

    /// From bits, the thumb the lowest; bits above the fifth are ignored.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & Self::ALL.0)
    }

    /// The thumb is the lowest bit.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Middle, ring and little finger are all stretched out.
    pub const fn middle_to_little(self) -> bool {
        self.0 & 0b1_1100 == 0b1_1100
    }
}

/// One hand at one time, in the sensor's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandFrame {
    time_us: u64,
    palm_mm: Point,
    attitude: Attitude,
    grab: f32,
    pinch: f32,
    fingers: Fingers,
}

impl HandFrame {
    /// A frame of finite numbers; grab and pinch are strengths from 0 to 1 and are held to that. None otherwise.
    pub fn new(
        time_us: u64,
        palm_mm: Point,
        attitude: Attitude,
        grab: f32,
        pinch: f32,
        fingers: Fingers,
    ) -> Option<Self> {
        let finite = palm_mm.iter().chain([&grab, &pinch]).all(|value| value.is_finite());
        let (grab, pinch) = (grab.clamp(0.0, 1.0), pinch.clamp(0.0, 1.0));
        finite.then_some(Self { time_us, palm_mm, attitude, grab, pinch, fingers })
    }

    /// Time of the sensor's clock, microseconds.
    pub fn time_us(&self) -> u64 {
        self.time_us
    }

    /// Centre of the palm, mm, sensor frame.
    pub fn palm_mm(&self) -> &Point {
        &self.palm_mm
    }

    /// How the hand is turned.
    pub fn sensor_from_hand(&self) -> Orientation {
        self.attitude.0
    }

    /// 0 an open hand, 1 a fist.
    pub fn grab(&self) -> f32 {
        self.grab
    }

    /// 0 no pinch, 1 thumb and a finger touch.
    pub fn pinch(&self) -> f32 {
        self.pinch
    }

    /// The stretched fingers.
    pub fn fingers(&self) -> Fingers {
        self.fingers
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::Arc;

    #[test]
    fn the_hand_basis_is_right_handed_and_keeps_the_normal() {
        let normal = Vector::new(0.1, -0.9, -0.2);
        let attitude = Attitude::from_direction_and_normal(&Vector::new(0.2, 0.4, -0.9), &normal).unwrap();
        let (x, y, z) = (attitude.0 * Vector::x(), attitude.0 * Vector::y(), attitude.0 * Vector::z());
        assert!(math::norm(&(z - normal / math::norm(&normal))) < 1e-6);
        assert!(math::norm(&(x.cross(&y) - z)) < 1e-6);
        assert!(y.dot(&Vector::new(0.2, 0.4, -0.9)) > 0.0);
    }

    #[test]
    fn parallel_short_or_non_finite_vectors_make_no_attitude() {
        let y = Vector::y();
        for bad in [y, -y, Vector::zeros(), Vector::repeat(f32::NAN), Vector::repeat(f32::INFINITY)] {
            assert!(Attitude::from_direction_and_normal(&bad, &y).is_none(), "{bad}");
            assert!(Attitude::from_direction_and_normal(&Vector::y(), &bad).is_none(), "{bad}");
        }
        assert!(Attitude::from_roll_pitch_yaw([0.0, f32::NAN, 0.0]).is_none());
        assert!(Attitude::from_roll_pitch_yaw([4.0, 0.0, 0.0]).is_none());
    }

    #[test]
    fn a_turn_about_one_axis_is_the_same_by_angles_and_by_vectors() {
        // Leap's own definitions of the angles, in double precision.
        for degrees in -80..=80 {
            let a = (degrees as f64).to_radians();
            let (s, c) = (a.sin() as f32, a.cos() as f32);
            let (down, ahead) = (-Vector::y(), -Vector::z());
            for (rpy, direction, normal) in [
                ([a as f32, 0.0, 0.0], ahead, Vector::new(s, -c, 0.0)),
                ([0.0, a as f32, 0.0], Vector::new(0.0, s, -c), Vector::new(0.0, -c, -s)),
                ([0.0, 0.0, a as f32], Vector::new(s, 0.0, -c), down),
            ] {
                let by_vectors = Attitude::from_direction_and_normal(&direction, &normal).unwrap();
                let by_angles = Attitude::from_roll_pitch_yaw(rpy).unwrap();
                assert!(
                    Arc::between(&by_vectors.0, &by_angles.0).angle_rad() < 0.2_f32.to_radians(),
                    "{rpy:?}"
                );
            }
        }
    }

    #[test]
    fn a_frame_that_exists_is_finite() {
        let attitude = Attitude::from_direction_and_normal(&-Vector::z(), &-Vector::y()).unwrap();
        let build =
            |x, grab, pinch| HandFrame::new(0, Point::new(x, 0.0, 0.0), attitude, grab, pinch, Fingers::ALL);
        assert!(build(f32::NAN, 0.0, 0.0).is_none());
        assert!(build(f32::INFINITY, 0.0, 0.0).is_none());
        assert!(build(0.0, f32::NAN, 0.0).is_none());
        assert!(build(0.0, 0.0, f32::NEG_INFINITY).is_none());
        assert_eq!(build(0.0, 1.5, -0.1).map(|f| (f.grab(), f.pinch())), Some((1.0, 0.0)));
    }

    #[test]
    fn fingers_count_from_the_thumb() {
        assert_eq!(Fingers::new([true, false, false, false, false]).bits(), 1);
        assert!(Fingers::new([false, false, true, true, true]).middle_to_little());
        assert!(!Fingers::new([true, true, true, true, false]).middle_to_little());
        assert_eq!(Fingers::from_bits(0xff), Fingers::ALL);
    }
}
