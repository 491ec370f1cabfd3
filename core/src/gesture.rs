//! Hand-guided scanning (paper II-B, Alg. 1): where the camera goes next, from one hand frame.
//!
//! Outside the interaction box the hand pushes the camera along one of six directions; inside (home) the camera's
//! optical axis follows the palm's normal. Lengths are millimetres, angles radians; palm poses are in the sensor's
//! frame (Leap Motion: x right, y up, z toward the user), camera poses in the robot base frame.
//!
//! Departures: the paper's line 7 forgets the current position, `P_{t+1} = P_t + u_d l`. Ours: hysteresis and a dead
//! band at the region's borders, a dead band against tremor, caps on speed and turn, a clutch, and a stop when the
//! hand is lost.

mod capture;
mod frame;
mod region;

pub use capture::CaptureGesture;
pub use frame::{Attitude, Fingers, HandFrame};
pub use region::{InteractionBox, Region};

use crate::rotation::{self, Arc};
use crate::{Orientation, Point, Vector};

/// Frames further apart than this do not move the camera: the hand was lost between them.
const LONGEST_GAP_US: u64 = 100_000;

/// The clutch closes at this grab strength and opens again below the second.
const CLUTCH_CLOSES: f32 = 0.8;
const CLUTCH_OPENS: f32 = 0.6;

/// Where the camera is: position and `base_from_camera`, optical axis along its z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraPose {
    /// Optical centre, mm, base frame.
    pub position_mm: Point,
    /// `base_from_camera`.
    pub orientation: Orientation,
}

/// How hand motion becomes camera motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Config {
    /// The home region: the paper's cube of 100 mm.
    pub interaction_box: InteractionBox,
    /// How far back inside the box the hand must come before a direction ends.
    pub hysteresis_mm: f32,
    /// Outside the box: no motion up to here, then growing from zero ...
    pub dead_band_mm: f32,
    /// ... to the full step this much further out.
    pub ramp_mm: f32,
    /// `l` of Alg. 1: the camera's motion per frame.
    pub step_mm: f32,
    /// Cap on the camera's speed, whatever the frame rate.
    pub max_speed_mm_s: f32,
    /// The hand may turn this much before the camera follows, and the camera stays this much behind.
    pub turn_dead_band_rad: f32,
    /// Cap on the camera's turn rate.
    pub max_turn_rad_s: f32,
    /// Orientation of the hand sensor on the robot's base.
    pub base_from_sensor: Orientation,
    /// Orientation of the camera in the hand: its z must be the hand's z for the optical axis to follow the palm.
    pub hand_from_camera: Orientation,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            interaction_box: InteractionBox::default(),
            hysteresis_mm: 5.0,
            dead_band_mm: 5.0,
            ramp_mm: 20.0,
            step_mm: 1.0,
            max_speed_mm_s: 100.0,
            turn_dead_band_rad: 0.01,
            max_turn_rad_s: 1.0,
            // The sensor lies flat, its user looking along the base's y.
            base_from_sensor: rotation::from_basis(&Vector::x(), &Vector::z(), &-Vector::y()),
            // Image up is where the fingers point.
            hand_from_camera: rotation::from_basis(&-Vector::x(), &-Vector::y(), &Vector::z()),
        }
    }
}

/// What one frame asks of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jog {
    /// Where the camera shall be.
    pub target: CameraPose,
    /// The region the hand is in; none while no hand steers.
    pub region: Option<Region>,
    /// The closed fist holds the camera.
    pub clutched: bool,
}

/// The steering hand from frame to frame.
#[derive(Debug, Clone)]
pub struct Steering {
    config: Config,
    region: Region,
    clutched: bool,
    previous_us: Option<u64>,
}

impl Steering {
    /// Steering that has not seen a hand yet.
    pub fn new(config: Config) -> Self {
        Self { config, region: Region::Home, clutched: false, previous_us: None }
    }

    /// As if no hand had been seen yet.
    pub fn forget(&mut self) {
        *self = Self::new(self.config);
    }

    /// Alg. 1 for one frame: the camera's next pose from its current one. No hand: the camera stays.
    ///
    /// The first frame of a hand, and the first after a gap, only say where the hand is.
    pub fn follow(&mut self, hand: Option<&HandFrame>, camera: &CameraPose) -> Jog {
        let Some(hand) = hand else {
            *self = Self::new(self.config);
            return Jog { target: *camera, region: None, clutched: false };
        };
        let elapsed_s = self.elapsed_s(hand.time_us());
        self.clutched = hand.grab() >= if self.clutched { CLUTCH_OPENS } else { CLUTCH_CLOSES };
        let config = &self.config;
        self.region = config.interaction_box.region(hand.palm_mm(), self.region, config.hysteresis_mm);
        let target = match self.region.direction() {
            _ if self.clutched => *camera,
            None => self.turned(hand, camera, elapsed_s),
            Some(direction) => self.pushed(hand, &direction, camera, elapsed_s),
        };
        Jog { target, region: Some(self.region), clutched: self.clutched }
    }

    /// Time since the frame before, s; 0 for the first frame and after a gap.
    fn elapsed_s(&mut self, now_us: u64) -> f32 {
        let gap_us = self.previous_us.replace(now_us).map_or(0, |before_us| now_us.saturating_sub(before_us));
        if gap_us > LONGEST_GAP_US { 0.0 } else { gap_us as f32 * 1e-6 }
    }

    /// `P_{t+1} = P_t + u_d l`, with `l` growing from zero at the edge of the dead band.
    fn pushed(
        &self,
        hand: &HandFrame,
        direction: &Vector,
        camera: &CameraPose,
        elapsed_s: f32,
    ) -> CameraPose {
        let config = &self.config;
        let outside_mm = config.interaction_box.outside_mm(hand.palm_mm(), direction) - config.dead_band_mm;
        let share = (outside_mm / config.ramp_mm.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        let step_mm = (config.step_mm * share).min(config.max_speed_mm_s * elapsed_s);
        CameraPose {
            position_mm: camera.position_mm + config.base_from_sensor * direction * step_mm,
            ..*camera
        }
    }

    /// The camera turned toward where the palm looks, up to the dead band and no faster than the cap.
    fn turned(&self, hand: &HandFrame, camera: &CameraPose, elapsed_s: f32) -> CameraPose {
        let config = &self.config;
        let wanted = config.base_from_sensor * hand.sensor_from_hand() * config.hand_from_camera;
        let arc = Arc::between(&camera.orientation, &wanted);
        let angle_rad = arc.angle_rad();
        let turn_rad = (angle_rad - config.turn_dead_band_rad).min(config.max_turn_rad_s * elapsed_s);
        if turn_rad > 0.0 {
            CameraPose { orientation: arc.slerp(turn_rad / angle_rad), ..*camera }
        } else {
            *camera
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::math;
    use std::vec::Vec;

    const START: CameraPose = CameraPose {
        position_mm: Point::new(400.0, 0.0, 300.0),
        orientation: Orientation::new_unchecked(nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0)),
    };

    fn flat(time_us: u64, palm_mm: Point, grab: f32) -> HandFrame {
        let attitude = Attitude::from_direction_and_normal(&-Vector::z(), &-Vector::y()).unwrap();
        HandFrame::new(time_us, palm_mm, attitude, grab, 0.0, Fingers::ALL).unwrap()
    }

    /// The poses of a camera that follows palms at 100 frames a second.
    fn play(config: Config, palms: impl Iterator<Item = Point>) -> Vec<CameraPose> {
        let mut steering = Steering::new(config);
        let mut camera = START;
        let follow = |(i, palm): (usize, Point)| {
            camera = steering.follow(Some(&flat(i as u64 * 10_000, palm, 0.0)), &camera).target;
            camera
        };
        palms.enumerate().map(follow).collect()
    }

    #[test]
    fn the_camera_adds_the_unit_direction_times_the_step_to_where_it_is() {
        for (palm, base) in [
            (Point::new(90.0, 200.0, 0.0), Vector::x()),
            (Point::new(-90.0, 200.0, 0.0), -Vector::x()),
            (Point::new(0.0, 290.0, 0.0), Vector::z()),
            (Point::new(0.0, 110.0, 0.0), -Vector::z()),
            (Point::new(0.0, 200.0, -90.0), Vector::y()),
            (Point::new(0.0, 200.0, 90.0), -Vector::y()),
        ] {
            let poses = play(Config::default(), core::iter::repeat_n(palm, 11));
            let moved = poses[10].position_mm - START.position_mm;
            assert!(math::norm(&(moved - base * 10.0)) < 1e-3, "{palm}: {moved}");
            assert_eq!(poses[10].orientation, START.orientation);
        }
    }

    #[test]
    fn crossing_a_border_never_makes_the_speed_jump() {
        let out_and_back = (0..400).map(|i| Point::new(100.0 - (i as f32 - 200.0).abs() * 0.5, 200.0, 0.0));
        let config = Config { max_turn_rad_s: 0.0, ..Config::default() };
        let poses = play(config, out_and_back);
        let speeds: Vec<f32> =
            poses.windows(2).map(|p| math::norm(&(p[1].position_mm - p[0].position_mm))).collect();
        assert!(speeds.iter().any(|&v| v > 0.9));
        // The hand moves 0.5 mm a frame on a ramp of 20 mm to a step of 1 mm.
        assert!(speeds.windows(2).all(|v| (v[1] - v[0]).abs() < 0.5 / 20.0 + 1e-3));
    }

    #[test]
    fn speed_and_turn_rate_are_capped_whatever_the_frame_rate() {
        let config = Config { step_mm: 50.0, ..Config::default() };
        let fast = play(config, core::iter::repeat_n(Point::new(200.0, 200.0, 0.0), 101));
        assert!(math::norm(&(fast[100].position_mm - START.position_mm)) <= 100.0 * 1.0 + 1e-2);
        let home = play(config, core::iter::repeat_n(Point::new(0.0, 200.0, 0.0), 101));
        let turned = home.windows(2).map(|p| Arc::between(&p[0].orientation, &p[1].orientation).angle_rad());
        assert!(turned.fold(0.0, f32::max) <= 0.01 + 1e-5);
    }

    #[test]
    fn in_the_home_region_the_optical_axis_comes_to_follow_the_palm_normal() {
        let config = Config { turn_dead_band_rad: 0.0, max_turn_rad_s: 1e3, ..Config::default() };
        for q in crate::rotation::tests::orientations().take(500) {
            let (direction, normal) = (q * Vector::y(), q * Vector::z());
            let attitude = Attitude::from_direction_and_normal(&direction, &normal).unwrap();
            let frame =
                |t| HandFrame::new(t, Point::new(0.0, 200.0, 0.0), attitude, 0.0, 0.0, Fingers::ALL).unwrap();
            let mut steering = Steering::new(config);
            let _ = steering.follow(Some(&frame(0)), &START);
            let target = steering.follow(Some(&frame(10_000)), &START).target;
            let axis = target.orientation * Vector::z();
            assert!(math::norm(&(axis - config.base_from_sensor * normal)) < 2e-6);
            let up = target.orientation * -Vector::y();
            assert!(math::norm(&(up - config.base_from_sensor * direction)) < 2e-6);
            assert_eq!(target.position_mm, START.position_mm);
            let v = target.orientation.scaled_axis();
            assert!(
                Arc::between(&rotation::from_rotation_vector(&v), &target.orientation).angle_rad() < 2e-6
            );
        }
    }

    #[test]
    fn tremor_within_the_dead_band_does_not_turn_the_camera_and_leaving_it_is_no_jump() {
        let config = Config { turn_dead_band_rad: 0.02, max_turn_rad_s: 1e3, ..Config::default() };
        let tilted = |i: u64, angle: f32| {
            let turn = rotation::from_rotation_vector(&Vector::new(angle, 0.0, 0.0));
            let attitude =
                Attitude::from_direction_and_normal(&(turn * -Vector::z()), &(turn * -Vector::y()));
            HandFrame::new(i * 10_000, Point::new(0.0, 200.0, 0.0), attitude.unwrap(), 0.0, 0.0, Fingers::ALL)
                .unwrap()
        };
        let mut steering = Steering::new(config);
        let mut camera = CameraPose {
            orientation: config.base_from_sensor
                * tilted(0, 0.0).sensor_from_hand()
                * config.hand_from_camera,
            ..START
        };
        for i in 0..200 {
            let angle = i as f32 * 1e-3;
            let next = steering.follow(Some(&tilted(i, angle)), &camera).target;
            let step = Arc::between(&camera.orientation, &next.orientation).angle_rad();
            assert!(step < 1.1e-3, "no jump at {angle}");
            assert!(angle > 0.0199 || step < 1e-6, "still at {angle}");
            camera = next;
        }
    }

    #[test]
    fn a_fist_or_a_lost_hand_or_a_gap_stops_the_camera() {
        let far = Point::new(150.0, 200.0, 0.0);
        let mut steering = Steering::new(Config::default());
        let mut step = |hand: Option<HandFrame>| steering.follow(hand.as_ref(), &START);
        assert_eq!(step(Some(flat(0, far, 0.0))).target, START);
        assert_ne!(step(Some(flat(10_000, far, 0.0))).target, START);
        let fist = step(Some(flat(20_000, far, 0.9)));
        assert!(fist.clutched && fist.target == START);
        assert_eq!(step(Some(flat(30_000, far, 0.7))).target, START, "not open yet");
        assert_ne!(step(Some(flat(40_000, far, 0.5))).target, START);
        assert_eq!(step(None).region, None);
        assert_eq!(step(Some(flat(50_000, far, 0.0))).target, START, "back, at an unknown speed");
        assert_eq!(step(Some(flat(900_000, far, 0.0))).target, START, "a gap");
        assert_eq!(step(Some(flat(0, far, 0.0))).target, START, "time runs back");
    }
}
