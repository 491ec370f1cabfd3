//! What the pendant computes when a host asks: camera poses from hand frames, edge scores of patches.
//!
//! Between [`crate::wire`]'s integers and [`crate::gesture`] and [`crate::seam`]. Host and pendant run this same code on
//! the same integers, and so give the same answers.

use crate::gesture::{
    Attitude, CameraPose, CaptureGesture, Config, Fingers, InteractionBox, Region, Steering,
};
use crate::path::TorchPose;
use crate::pendant::{JOG_LIMITS, Task};
use crate::seam::{Ball, Patch, RatioThreshold};
use crate::wire::{self, Answer, Field, MAX_PATCH, Refusal, WireEdgeScore, WirePose};
use crate::{Orientation, Point, Vector, gesture, seam};

/// Neighbours that a point of a wire patch can have.
pub const MAX_NEIGHBOURS: usize = 32;

/// Room for the largest patch on the wire, and its scores. 14 kB: keep it in static memory.
///
/// Its loops are compiled here, for speed: a firmware that calls them may be compiled for size.
#[derive(Debug, Clone, Default)]
pub struct Workspace(Patch<MAX_PATCH, MAX_NEIGHBOURS>);

impl Workspace {
    /// No patch.
    pub const fn empty() -> Self {
        Self(Patch::empty())
    }

    /// Takes the points and finds the neighbours of each; false for fewer than two.
    #[inline(never)]
    pub fn find(&mut self, patch: &wire::WirePatch, ball: &Ball) -> bool {
        let point = |offset: &wire::Offset| Point::from(offset.um.map(|um| f32::from(um) / 1000.0));
        self.0.find(patch.points.iter().map(point), ball)
    }

    /// What all scores need: intensities and gradients of every point.
    #[inline(never)]
    pub fn measure(&mut self) {
        self.0.measure();
    }

    /// Score of one point, once measured; `None` for an index out of range.
    #[inline(never)]
    pub fn score(&self, index: usize, threshold: RatioThreshold) -> Option<seam::EdgeScore> {
        self.0.score(index, threshold)
    }
}

/// Gestures from frame to frame.
#[derive(Debug, Clone)]
pub struct Tasks {
    steering: Steering,
    capture: CaptureGesture,
    camera: CameraPose,
    steer_right: bool,
    limits: wire::JogLimits,
}

impl Default for Tasks {
    /// The default box, the left hand steering, the camera at the base's origin.
    fn default() -> Self {
        let camera = CameraPose { position_mm: Point::origin(), orientation: Orientation::identity() };
        Self {
            steering: Steering::new(Config::default()),
            capture: CaptureGesture::default(),
            camera,
            steer_right: false,
            limits: JOG_LIMITS,
        }
    }
}

impl Tasks {
    /// Computes the answer to a task.
    pub fn perform(&mut self, task: &Task, workspace: &mut Workspace) -> Answer {
        let answer = match task {
            Task::Jog(jog, limits) => self.start(jog, limits).map(|()| Answer::Done),
            Task::HandFrame { hands, time_ms, anew, from } => {
                if let Some(TorchPose { position_mm, orientation }) = from.and_then(|from| from.to_pose()) {
                    self.camera = CameraPose { position_mm, orientation };
                }
                if *anew {
                    self.steering.forget();
                    self.capture = CaptureGesture::default();
                }
                self.follow(hands, *time_ms).map(Answer::Pose)
            }
            Task::Score(patch) => score(patch, workspace).map(Answer::EdgeScore),
        };
        answer.unwrap_or_else(Answer::Refused)
    }

    /// Gestures start anew, from this camera pose, with this box and within these limits.
    fn start(&mut self, jog: &wire::WireJog, limits: &wire::JogLimits) -> Result<(), Refusal> {
        let center_mm = Point::from(millimetres(jog.box_center_um));
        let edges_mm = Vector::from(jog.box_size_um.map(|um| um as f32 / 1000.0));
        let interaction_box =
            InteractionBox::with_edges(center_mm, edges_mm).ok_or(Refusal::Value(Field::Size))?;
        let start = jog.start.to_pose().ok_or(Refusal::Value(Field::Orientation))?;
        let sensor = WirePose { position_um: [0; 3], orientation_q15: jog.base_from_sensor_q15 };
        let sensor = sensor.to_pose().ok_or(Refusal::Value(Field::Orientation))?;
        let config = Config {
            interaction_box,
            step_mm: limits.step_um as f32 / 1000.0,
            max_speed_mm_s: limits.speed_um_s as f32 / 1000.0,
            max_turn_rad_s: limits.turn_mrad_s as f32 / 1000.0,
            base_from_sensor: sensor.orientation,
            ..Config::default()
        };
        *self = Self {
            steering: Steering::new(config),
            capture: CaptureGesture::default(),
            camera: CameraPose { position_mm: start.position_mm, orientation: start.orientation },
            steer_right: jog.steer_right,
            limits: *limits,
        };
        Ok(())
    }

    /// The steering hand moves the camera, the right hand captures, both by the pendant's clock: the sensor's own may run
    /// as it likes. A hand that the sensor is not sure of is none.
    fn follow(&mut self, hands: &wire::WireHandFrame, time_ms: u32) -> Result<wire::WireCameraPose, Refusal> {
        let time_us = u64::from(time_ms) * 1000;
        let sure = |hand: &&wire::Hand| hand.confidence_permille >= self.limits.confidence_permille;
        let right = hands.right.as_ref().filter(sure).and_then(|hand| seen(hand, time_us));
        let left = hands.left.as_ref().filter(sure).and_then(|hand| seen(hand, time_us));
        let steering = if self.steer_right { &right } else { &left };
        let jog = self.steering.follow(steering.as_ref(), &self.camera);
        self.camera = CameraPose { position_mm: self.inside(&jog.target.position_mm), ..jog.target };
        let capture = self.capture.observe(right.as_ref(), time_us);
        let CameraPose { position_mm, orientation } = self.camera;
        // Beyond the wire's 2 km; the camera's real limits are the robot's.
        let pose = WirePose::from_pose(&TorchPose { position_mm, orientation })
            .ok_or(Refusal::Value(Field::Reach))?;
        let region = number(jog.region);
        Ok(wire::WireCameraPose { pose, actual: None, region, capture, clutch: jog.clutched, time_ms })
    }

    /// The nearest point of the workspace.
    fn inside(&self, point_mm: &Point) -> Point {
        let wire::JogLimits { least_um, most_um, .. } = self.limits;
        let (least_mm, most_mm) = (Point::from(millimetres(least_um)), Point::from(millimetres(most_um)));
        Point::from(point_mm.coords.sup(&least_mm.coords).inf(&most_mm.coords))
    }
}

/// 0 at home and without a hand, then left, right, up, down, inward, outward.
fn number(region: Option<Region>) -> u8 {
    match region {
        None | Some(Region::Home) => 0,
        Some(Region::Left) => 1,
        Some(Region::Right) => 2,
        Some(Region::Up) => 3,
        Some(Region::Down) => 4,
        Some(Region::Inward) => 5,
        Some(Region::Outward) => 6,
    }
}

/// A hand as the gestures want it; one without a basis counts as not seen.
fn seen(hand: &wire::Hand, time_us: u64) -> Option<gesture::HandFrame> {
    let unit = |q15: [i16; 3]| Vector::from(q15.map(f32::from)) / f32::from(wire::Q15_ONE);
    let attitude = Attitude::from_direction_and_normal(&unit(hand.direction_q15), &unit(hand.normal_q15))?;
    let strength = |permille: u16| f32::from(permille) / 1000.0;
    let (grab, pinch) = (strength(hand.grab_permille), strength(hand.pinch_permille));
    let palm_mm = Point::from(millimetres(hand.palm_um));
    gesture::HandFrame::new(time_us, palm_mm, attitude, grab, pinch, Fingers::from_bits(hand.extended))
}

/// Edge score of the patch's first point.
fn score(patch: &wire::WirePatch, workspace: &mut Workspace) -> Result<WireEdgeScore, Refusal> {
    let ball = Ball::new(patch.radius_um as f32 / 1000.0, Ball::LEAST).ok_or(Refusal::Value(Field::Size))?;
    let threshold =
        RatioThreshold::new(patch.threshold_milli as f32 / 1000.0).ok_or(Refusal::Value(Field::Size))?;
    if !workspace.find(patch, &ball) {
        return Err(Refusal::Value(Field::Count));
    }
    workspace.measure();
    let score = workspace.score(0, threshold).ok_or(Refusal::Value(Field::Count))?;
    Ok(WireEdgeScore {
        neighbours: workspace.0.neighbours(0) as u8,
        // Casts from float saturate.
        intensity_ppm: (score.intensity * 1e6) as u32,
        ratio_milli: if score.ratio < 4e6 { (score.ratio * 1e3) as u32 } else { u32::MAX },
        edge: score.is_edge,
    })
}

fn millimetres(um: [i32; 3]) -> [f32; 3] {
    um.map(|um| um as f32 / 1000.0)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::wire::{Hand, Offset, Q15_ONE, WireHandFrame, WireJog};

    static EMPTY: Workspace = Workspace::empty();

    fn hand(palm_um: [i32; 3]) -> Hand {
        Hand {
            palm_um,
            direction_q15: [0, 0, -Q15_ONE],
            normal_q15: [0, -Q15_ONE, 0],
            grab_permille: 100,
            pinch_permille: 900,
            confidence_permille: 1000,
            extended: 0b1_1100,
        }
    }

    fn jog(steer_right: bool) -> Task {
        let start = WirePose { position_um: [400_000, 0, 300_000], orientation_q15: [0, Q15_ONE, 0, 0] };
        let (box_center_um, box_size_um) = ([0, 200_000, 0], [100_000; 3]);
        // A quarter turn about x: the sensor lies flat.
        let base_from_sensor_q15 = [23_170, 23_170, 0, 0];
        Task::Jog(
            WireJog { start, box_center_um, box_size_um, steer_right, base_from_sensor_q15 },
            JOG_LIMITS,
        )
    }

    fn last_pose(steer_right: bool, hands: impl Fn(u32) -> WireHandFrame) -> wire::WireCameraPose {
        let (mut tasks, mut workspace) = (Tasks::default(), EMPTY.clone());
        assert_eq!(tasks.perform(&jog(steer_right), &mut workspace), Answer::Done);
        let frame = |i| {
            let hands = hands(i);
            let task = Task::HandFrame { hands, time_ms: hands.time_ms, anew: i == 0, from: None };
            (task, i)
        };
        let mut frame = |i| match tasks.perform(&frame(i).0, &mut workspace) {
            Answer::Pose(pose) => pose,
            other => panic!("{other:?}"),
        };
        (0..11).map(&mut frame).last().expect("frames")
    }

    #[test]
    fn the_left_hand_steers_and_the_right_hand_captures() {
        let frame = |i: u32| WireHandFrame {
            time_ms: 10 * i,
            left: Some(hand([90_000, 200_000, 0])),
            right: (i == 5).then(|| hand([0; 3])),
        };
        let pose = last_pose(false, frame);
        assert_eq!((pose.pose.position_um, pose.region), ([410_000, 0, 300_000], 2));
        assert_eq!(last_pose(true, frame).pose.position_um, [400_000, 0, 300_000], "the right hand is lost");
        let held = |i: u32| WireHandFrame { time_ms: 5 * i, left: None, right: Some(hand([0; 3])) };
        assert!(last_pose(false, held).capture, "held for 50 ms in the eleventh frame");
    }

    #[test]
    fn a_corner_scores_as_an_edge_and_a_lone_point_is_refused() {
        let offset = |k: i16| {
            let (x, v) = (k % 8 * 1000 - 4000, k / 16 * 1000);
            Offset { um: if k / 8 % 2 == 0 { [x, v, 0] } else { [x, 0, v] } }
        };
        let points: heapless::Vec<_, MAX_PATCH> =
            core::iter::once(Offset { um: [0; 3] }).chain((0..63).map(offset)).collect();
        let patch = wire::WirePatch { radius_um: 2200, threshold_milli: 53_000, points };
        let (mut tasks, mut workspace) = (Tasks::default(), EMPTY.clone());
        let mut ask = |patch: &wire::WirePatch| tasks.perform(&Task::Score(patch.clone()), &mut workspace);
        let Answer::EdgeScore(score) = ask(&patch) else { panic!("no score") };
        assert!(score.intensity_ppm > 150_000 && score.neighbours > 10, "{score:?}");
        let lone =
            wire::WirePatch { points: patch.points.iter().take(1).copied().collect(), ..patch.clone() };
        assert_eq!(ask(&lone), Answer::Refused(Refusal::Value(Field::Count)));
        let below = wire::WirePatch { threshold_milli: 27_000, ..patch };
        assert_eq!(ask(&below), Answer::Refused(Refusal::Value(Field::Size)));
    }
}
