//! A made recording of two hands that scan a workpiece: for trying, and for tests of the whole workflow.
//!
//! Nobody moved these hands. They are computed so that the gestures lead the camera through every direction, to each
//! given pose, and capture there; once the clutch is used, and once the left hand is lost amid a motion.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use weldpath_core::gesture::Config;
use weldpath_core::pendant::JOG_LIMITS;
use weldpath_core::wire::{Answer, Hand, Q15_ONE, WireHandFrame};

use super::{Setup, Twin, isometry};

/// Time between frames, ms.
const FRAME_MS: u32 = 20;
/// Way of the first tour along each direction, mm: more than 100 frames of 1 mm each.
const TOUR_MM: f64 = 110.0;
/// So near is there.
const NEAR_MM: f64 = 0.02;
/// A pose that is not reached after so many frames cannot be.
const MOST_FRAMES: usize = 20_000;
const OPEN: u8 = 0b1_1111;
const OK: u8 = 0b1_1100;

struct Hands {
    config: Config,
    twin: Twin,
    setup: Setup,
    camera: Isometry3<f64>,
    attitude: UnitQuaternion<f64>,
    frames: Vec<WireHandFrame>,
}

/// The recording that captures at each of the poses; none if one of them cannot be reached.
pub fn recording(setup: &Setup, captures: &[Isometry3<f64>]) -> Option<Vec<WireHandFrame>> {
    let mut hands = Hands {
        config: Config::default(),
        twin: Twin::new(&setup.jog()?, &JOG_LIMITS),
        setup: *setup,
        camera: setup.base_from_camera,
        attitude: UnitQuaternion::identity(),
        frames: Vec::new(),
    };
    hands.attitude = hands.attitude_for(&setup.base_from_camera);
    hands.tour()?;
    for (index, pose) in captures.iter().enumerate() {
        hands.go_to(pose)?;
        hands.capture()?;
        match index {
            1 => hands.clutch()?,
            2 => hands.lose()?,
            _ => {}
        }
    }
    Some(hands.frames)
}

impl Hands {
    /// `sensor_from_hand` with which the camera comes to look like this.
    fn attitude_for(&self, camera: &Isometry3<f64>) -> UnitQuaternion<f64> {
        let wide =
            |q: &weldpath_core::Orientation| UnitQuaternion::new_normalize(q.quaternion().cast::<f64>());
        wide(&self.config.base_from_sensor).inverse()
            * camera.rotation
            * wide(&self.config.hand_from_camera).inverse()
    }

    /// Six ways out and back, which visit all seven regions.
    fn tour(&mut self) -> Option<()> {
        let start = self.camera;
        for axis in [Vector3::z(), Vector3::x(), Vector3::y()] {
            for way_mm in [TOUR_MM, 0.0] {
                let mut target = start;
                target.translation.vector += axis * way_mm;
                self.go_to(&target)?;
            }
        }
        Some(())
    }

    /// First the turn, at home, then one axis after the other, from above.
    fn go_to(&mut self, pose: &Isometry3<f64>) -> Option<()> {
        self.attitude = self.attitude_for(pose);
        let dead_band_rad = f64::from(self.config.turn_dead_band_rad);
        self.home(2)?;
        while self.camera.rotation.angle_to(&pose.rotation) > dead_band_rad + 1e-3 {
            self.home(1)?;
        }
        let way_mm = |hands: &Self| pose.translation.vector - hands.camera.translation.vector;
        let axes = if way_mm(self).z > 0.0 { [2, 0, 1] } else { [0, 1, 2] };
        for axis in axes {
            while way_mm(self)[axis].abs() > NEAR_MM {
                let mut push = Vector3::zeros();
                push[axis] = way_mm(self)[axis];
                self.push(&push)?;
            }
        }
        self.home(3)
    }

    /// One frame outside the box in this direction of the base, as far out as the way that is left needs.
    fn push(&mut self, way_mm: &Vector3<f64>) -> Option<()> {
        let config = &self.config;
        let share = (way_mm.norm() / f64::from(config.step_mm)).min(1.0);
        let out_mm =
            0.5 * self.setup.box_mm + f64::from(config.dead_band_mm) + f64::from(config.ramp_mm) * share;
        let direction = config.base_from_sensor.cast::<f64>().inverse() * way_mm.normalize();
        let left = self.hand(direction * out_mm, 0.0);
        self.frame(Some(left), false)
    }

    fn home(&mut self, frames: usize) -> Option<()> {
        (0..frames).try_for_each(|_| {
            let left = self.hand(Vector3::zeros(), 0.0);
            self.frame(Some(left), false)
        })
    }

    fn capture(&mut self) -> Option<()> {
        for ok in [false, true, false] {
            for _ in 0..8 {
                let left = self.hand(Vector3::zeros(), 0.0);
                self.frame(Some(left), ok)?;
            }
        }
        Some(())
    }

    /// Out to the right, and back with a closed fist: the camera stays meanwhile.
    fn clutch(&mut self) -> Option<()> {
        for k in 0..40 {
            let out_mm = 0.5 * self.setup.box_mm + f64::from(40 - k) * 2.0;
            let left = self.hand(Vector3::new(out_mm, 0.0, 0.0), 0.95);
            self.frame(Some(left), false)?;
        }
        self.home(1)
    }

    /// Amid a way to the right the left hand is not seen for a while.
    fn lose(&mut self) -> Option<()> {
        for k in 0..60 {
            let left = self.hand(Vector3::new(self.setup.box_mm, 0.0, 0.0), 0.0);
            self.frame((!(20..50).contains(&k)).then_some(left), false)?;
        }
        self.home(1)
    }

    fn hand(&self, offset_mm: Vector3<f64>, grab: f64) -> Hand {
        let q15 = |v: Vector3<f64>| (v * f64::from(Q15_ONE)).map(|c| c.round() as i16).into();
        let palm_mm = Vector3::from(self.setup.box_center_mm) + offset_mm;
        Hand {
            palm_um: palm_mm.map(|mm| (mm * 1000.0).round() as i32).into(),
            direction_q15: q15(self.attitude * Vector3::y()),
            normal_q15: q15(self.attitude * Vector3::z()),
            grab_permille: (grab * 1000.0) as u16,
            pinch_permille: 0,
            confidence_permille: 1000,
            extended: if grab > 0.5 { 0 } else { OPEN },
        }
    }

    /// Adds a frame, and sees where it leads the camera.
    fn frame(&mut self, left: Option<Hand>, ok: bool) -> Option<()> {
        let open = Hand { palm_um: [150_000, 200_000, 50_000], ..self.hand(Vector3::zeros(), 0.0) };
        let right = if ok { Hand { pinch_permille: 950, extended: OK, ..open } } else { open };
        let frame = WireHandFrame { time_ms: FRAME_MS * self.frames.len() as u32, left, right: Some(right) };
        let Answer::Pose(pose) = self.twin.answer(&frame, frame.time_ms) else { return None };
        self.camera = isometry(&pose.pose)?;
        self.frames.push(frame);
        (self.frames.len() < MOST_FRAMES).then_some(())
    }
}
