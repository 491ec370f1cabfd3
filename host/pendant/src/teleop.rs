//! Hand-guided scanning (paper II-B): hand frames to a pendant, camera poses back, views where the hand says so.
//!
//! The camera is where the robot at the pendant's port has it. Without one it is simulated and follows the poses no faster
//! than [`MOST_MM_S`] and [`MOST_RAD_S`]. What it captured becomes a scan by `weldpath_sim::simulation::captured`. Millimetres, robot base frame.

pub mod generator;
pub mod live;
pub mod recording;

use std::borrow::Borrow;
use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use weldpath_core::path::TorchPose;
use weldpath_core::path::interpolation::position_between;
use weldpath_core::pendant::Task;
use weldpath_core::rotation::Arc;
use weldpath_core::tasks::{Tasks, Workspace};
use weldpath_core::wire::{
    Answer, Command, Hand, JogLimits, Refusal, WireCameraPose, WireHandFrame, WireJog, WirePose,
};
use weldpath_core::{Orientation, Point};

/// The camera moves no faster, whatever comes over the line, mm/s.
pub const MOST_MM_S: f64 = 250.0;
/// And turns no faster.
pub const MOST_RAD_S: f64 = 1.5;
/// After a longer gap between frames the camera does not catch up, s.
const LONGEST_STEP_S: f64 = 0.1;
/// The sensor lies flat, its user looking along the base's y: a quarter turn about x.
pub const BASE_FROM_SENSOR_Q15: [i16; 4] = [23_170, 23_170, 0, 0];
/// Names of the regions by their number on the wire.
pub const REGIONS: [&str; 7] = ["rotation", "left", "right", "up", "down", "inward", "outward"];

/// Who steers, from where, in which box.
#[derive(Debug, Clone, Copy)]
pub struct Setup {
    /// Where the camera starts.
    pub base_from_camera: Isometry3<f64>,
    /// Middle of the interaction box, sensor frame, mm.
    pub box_center_mm: [f64; 3],
    /// Its edge, mm.
    pub box_mm: f64,
    /// The right hand steers as well as captures.
    pub steer_right: bool,
}

/// What came of a recording.
#[derive(Debug, Clone, Default)]
pub struct Session {
    /// Where views were captured, and in which frame.
    pub captures: Vec<(usize, Isometry3<f64>)>,
    /// Answer times of frames with a steering hand, by region.
    pub latency: [Vec<Duration>; 7],
    /// Frames in which the clutch was open.
    pub clutched: usize,
    /// Frames without a steering hand.
    pub lost: usize,
    /// Frames answered exactly as the host computes them; none of them with a robot at the port, from whose place each
    /// step begins.
    pub agreed: Option<usize>,
    /// All frames.
    pub frames: usize,
    /// Largest turn of the commanded pose from one frame to the next, rad.
    pub largest_turn_rad: f64,
}

/// Why a recording was not played to its end.
#[derive(Debug, thiserror::Error)]
pub enum Error<E: std::error::Error + 'static> {
    /// The link.
    #[error(transparent)]
    Link(E),
    /// The pendant refused.
    #[error("the pendant refused frame {frame}: {}", crate::link::refusal_words(*.why))]
    Refused {
        /// Counted from 0.
        frame: usize,
        /// Why.
        why: Refusal,
    },
    /// The pendant answered something else.
    #[error("the pendant answered frame {frame} with something that is not a pose")]
    NoPose {
        /// Counted from 0.
        frame: usize,
    },
    /// The start pose or the box has no wire form.
    #[error("the start of the camera or the box is too far away or has no size")]
    Setup,
}

impl Setup {
    /// As the pendant takes it.
    pub fn jog(&self) -> Option<WireJog> {
        let um = |mm: f64| (mm.abs() < 1e6).then_some((mm * 1000.0).round() as i32);
        let [x, y, z] = self.box_center_mm.map(um);
        let edge_um = u32::try_from(um(self.box_mm)?).ok().filter(|&um| um > 0)?;
        Some(WireJog {
            start: wire_pose(&self.base_from_camera)?,
            box_center_um: [x?, y?, z?],
            box_size_um: [edge_um; 3],
            steer_right: self.steer_right,
            base_from_sensor_q15: BASE_FROM_SENSOR_Q15,
        })
    }
}

/// How fast a recording is played.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// As it was recorded: the pendant moves the camera by its own clock.
    Recorded,
    /// As fast as it is answered: by somebody who takes the sensor's clock for his own, or as a sensor sends it.
    Answers,
}

/// Plays hand frames, recorded or [`live`], to a pendant; `ask` carries a command there and its answer back.
pub fn play<E: std::error::Error + 'static>(
    frames: impl IntoIterator<Item = impl Borrow<WireHandFrame>>,
    setup: &Setup,
    limits: &JogLimits,
    pace: Pace,
    mut ask: impl FnMut(Command) -> Result<Answer, E>,
) -> Result<Session, Error<E>> {
    let jog = setup.jog().ok_or(Error::Setup)?;
    let mut twin = Twin::new(&jog, limits);
    if let Answer::Refused(why) = ask(Command::SetJog(jog)).map_err(Error::Link)? {
        return Err(Error::Refused { frame: 0, why });
    }
    let mut session = Session::default();
    let mut camera = Follower { base_from_camera: setup.base_from_camera, time_ms: None };
    let mut commanded = setup.base_from_camera;
    let (begun, mut first_ms) = (Instant::now(), None);
    for (index, frame) in frames.into_iter().enumerate() {
        let frame: &WireHandFrame = frame.borrow();
        if pace == Pace::Recorded {
            let first_ms = *first_ms.get_or_insert(frame.time_ms);
            let due = Duration::from_millis(frame.time_ms.saturating_sub(first_ms).into());
            std::thread::sleep(due.saturating_sub(begun.elapsed()));
        }
        let asked = Instant::now();
        let answer = ask(Command::HandFrame(*frame)).map_err(Error::Link)?;
        let took = asked.elapsed();
        let pose = match answer {
            Answer::Pose(pose) => pose,
            Answer::Refused(why) => return Err(Error::Refused { frame: index, why }),
            _ => return Err(Error::NoPose { frame: index }),
        };
        let target = isometry(&pose.pose).ok_or(Error::NoPose { frame: index })?;
        session.largest_turn_rad =
            session.largest_turn_rad.max(commanded.rotation.angle_to(&target.rotation));
        commanded = target;
        match pose.actual {
            Some(actual) => {
                camera.base_from_camera = isometry(&actual).ok_or(Error::NoPose { frame: index })?;
            }
            None => {
                camera.follow(&target, frame.time_ms);
                let agrees = twin.answer(frame, pose.time_ms) == answer;
                session.agreed = Some(session.agreed.unwrap_or(0) + usize::from(agrees));
            }
        }
        session.count(steering(frame, setup.steer_right), &pose, took);
        if pose.capture {
            session.captures.push((index, camera.base_from_camera));
        }
    }
    Ok(session)
}

fn steering(frame: &WireHandFrame, right: bool) -> Option<&Hand> {
    if right { frame.right.as_ref() } else { frame.left.as_ref() }
}

impl Session {
    fn count(&mut self, hand: Option<&Hand>, pose: &WireCameraPose, took: Duration) {
        self.frames += 1;
        match (hand, self.latency.get_mut(usize::from(pose.region))) {
            (None, _) => self.lost += 1,
            _ if pose.clutch => self.clutched += 1,
            (_, Some(latency)) => latency.push(took),
            _ => {}
        }
    }
}

/// A camera that is told where to be and goes there at a bounded speed.
struct Follower {
    base_from_camera: Isometry3<f64>,
    time_ms: Option<u32>,
}

impl Follower {
    fn follow(&mut self, target: &Isometry3<f64>, time_ms: u32) {
        let passed_ms = self.time_ms.replace(time_ms).map_or(0, |before| time_ms.saturating_sub(before));
        let passed_s = (f64::from(passed_ms) * 1e-3).min(LONGEST_STEP_S);
        let here = self.base_from_camera;
        let way_mm = (target.translation.vector - here.translation.vector).norm();
        let turn_rad = here.rotation.angle_to(&target.rotation);
        let share = |all: f64, most: f64| if all > most { most / all } else { 1.0 };
        let (moved, turned) = (share(way_mm, MOST_MM_S * passed_s), share(turn_rad, MOST_RAD_S * passed_s));
        let places = [here, *target].map(|pose| pose.translation.vector.into());
        let position_mm = position_between(&places[0], &places[1], moved);
        let rotation = Arc::between(&here.rotation, &target.rotation).slerp(turned);
        self.base_from_camera = Isometry3::from_parts(Translation3::from(position_mm), rotation);
    }
}

/// The host's own answers to what it asks the pendant: the same code on the same integers.
#[derive(Default)]
pub struct Twin {
    tasks: Tasks,
    workspace: Box<Workspace>,
    begun: bool,
}

impl Twin {
    /// Gestures from this start.
    pub fn new(jog: &WireJog, limits: &JogLimits) -> Self {
        let mut twin = Self::default();
        // A refusal here is a refusal there, which is what counts.
        let _ = twin.tasks.perform(&Task::Jog(*jog, *limits), &mut twin.workspace);
        twin
    }

    /// The answer to a frame that the pendant took at this time of its own clock.
    pub fn answer(&mut self, frame: &WireHandFrame, time_ms: u32) -> Answer {
        let anew = !std::mem::replace(&mut self.begun, true);
        self.tasks.perform(&Task::HandFrame { hands: *frame, time_ms, anew, from: None }, &mut self.workspace)
    }

    /// The answer to a neighbourhood.
    pub fn score(&mut self, patch: &weldpath_core::wire::WirePatch) -> Answer {
        self.tasks.perform(&Task::Score(patch.clone()), &mut self.workspace)
    }
}

/// Rounded to the wire's grid.
/// As the pendant takes it; none if it is farther away than the wire can say.
pub fn wire_pose(pose: &Isometry3<f64>) -> Option<WirePose> {
    let position_mm = Point::from(pose.translation.vector.cast::<f32>());
    let orientation = Orientation::new_normalize(pose.rotation.quaternion().cast::<f32>());
    WirePose::from_pose(&TorchPose { position_mm, orientation })
}

fn isometry(pose: &WirePose) -> Option<Isometry3<f64>> {
    let [w, i, j, k] = pose.is_unit().then_some(pose.orientation_q15)?.map(f64::from);
    let rotation = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, i, j, k));
    let [x, y, z] = pose.position_um.map(|um| f64::from(um) * 1e-3);
    Some(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_never_goes_faster_than_it_may_and_arrives() {
        let mut camera = Follower { base_from_camera: Isometry3::identity(), time_ms: None };
        let rotation = UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), 1.0);
        let target = Isometry3::from_parts(Translation3::new(100.0, 0.0, 0.0), rotation);
        for k in 0..200 {
            let before = camera.base_from_camera;
            camera.follow(&target, 1000 + 10 * k);
            let after = camera.base_from_camera;
            assert!((after.translation.vector - before.translation.vector).norm() <= 2.5 + 1e-9);
            assert!(after.rotation.angle_to(&before.rotation) <= 0.015 + 1e-9);
        }
        assert!((camera.base_from_camera.translation.vector - target.translation.vector).norm() < 1e-9);
        assert!(camera.base_from_camera.rotation.angle_to(&target.rotation) < 1e-6);
    }
}
