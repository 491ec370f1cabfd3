//! A planned program as a pendant takes it: integers, feed and arc where a move begins, steps within its limits.
//!
//! A pendant knows no standing. Where a program stands, the torch goes some 0.12 mm of its own path so slowly that it takes
//! the time: the first of the way on or, where the arc is put out, the last of the way there. The path stays what it was,
//! and hold, resume and stop are those of any move. An exact stop takes 0.05 s.

use std::collections::BTreeMap;

use nalgebra::{Point3, UnitQuaternion};
use weldpath_core::path::TorchPose;
use weldpath_core::wire::{Begin, Limits, ProcessTimes, Q15_ONE, WirePose, WireWaypoint};
use weldpath_core::{Orientation, Point};

use weldpath_core::path::interpolation::position_between;
use weldpath_core::rotation::Arc;
use weldpath_method::weld::program;
use weldpath_method::weld::program::Segment;

/// A turn of 1 rad counts as this much way when a step is too short, µm: the pendant's rule.
const TURN_UM_PER_RAD: f64 = 10_000.0;
/// Moves are divided to this share of the largest step and turn, so that rounding cannot make one too large.
const MARGIN: f64 = 0.95;

/// The least way on which the torch is said to stand, in shortest steps of the pendant.
const STAND_STEPS: f64 = 2.4;
/// How long an exact stop takes, s.
const STOP_S: f64 = 0.05;

/// A program ready to be sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Upload {
    /// What the pendant gets.
    pub waypoints: Vec<WireWaypoint>,
    /// Times of the arc sequence.
    pub times: ProcessTimes,
    /// For each of them the waypoint of the program at whose move it stands, counted from 0.
    pub origin: Vec<usize>,
}

/// A program that no pendant with these limits can follow.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// Fewer than two waypoints.
    #[error("the program has fewer than two waypoints that differ: there is nothing to follow")]
    Short,
    /// A waypoint out of reach or not finite.
    #[error(
        "waypoint {index} (counted from 0) is farther from the base than the pendant's reach of {reach_mm} mm"
    )]
    Reach {
        /// Its place in the program.
        index: usize,
        /// The pendant's reach.
        reach_mm: u32,
    },
    /// What the pendant says of itself cannot be.
    #[error("the pendant reports that its {what} is 0: no path fits")]
    Limits {
        /// Which limit.
        what: &'static str,
    },
    /// The torch has to stand where the program does not move on.
    #[error(
        "waypoint {index} (counted from 0) has the torch stand still, but the program makes no move after it"
    )]
    Dwell {
        /// Its place in the program.
        index: usize,
    },
    /// Faster than the pendant moves.
    #[error(
        "waypoint {index} (counted from 0) asks for more than the pendant's {feed_mm_s} mm/s, or for no motion"
    )]
    Feed {
        /// Its place in the program.
        index: usize,
        /// The pendant's fastest feed.
        feed_mm_s: u32,
    },
}

impl Error {
    /// The same with its waypoint counted otherwise.
    #[must_use]
    pub fn counted(self, count: impl Fn(usize) -> usize) -> Self {
        match self {
            Self::Reach { index, reach_mm } => Self::Reach { index: count(index), reach_mm },
            Self::Dwell { index } => Self::Dwell { index: count(index) },
            Self::Feed { index, feed_mm_s } => Self::Feed { index: count(index), feed_mm_s },
            Self::Short | Self::Limits { .. } => self,
        }
    }
}

/// Brings a program into the pendant's form. Long moves are divided evenly, on the same line and the same arc;
/// waypoints nearer to the one before than the pendant's shortest step are left out.
pub fn upload(program: &[program::Waypoint], limits: &Limits) -> Result<Upload, Error> {
    let zero = [
        ("longest step", limits.max_step_um),
        ("shortest step", limits.min_step_um),
        ("reach", limits.reach_um),
        ("fastest feed", limits.max_feed_um_s),
        ("tick", limits.tick_us),
    ];
    if let Some((what, _)) = zero.into_iter().find(|(_, limit)| *limit == 0) {
        return Err(Error::Limits { what });
    }
    let mut upload = Upload { waypoints: Vec::new(), times: ProcessTimes::default(), origin: Vec::new() };
    let mut stands = Stands::default();
    let segments: Vec<Segment> = program::segments(program).collect();
    for (index, segment) in segments.iter().enumerate() {
        let feed_um_s = feed(segment, (index + 1).min(program.len() - 1), limits)?;
        let to = program.get(index + 1).unwrap_or(&program[index]);
        let (first, last) = stands_on(program, &segments, index);
        for (share, stand_s) in shares(&program[index], to, [first, last], limits) {
            // The reach is convex: between two waypoints, the one ahead is the one too far.
            let guilty = if share > 0.0 { index + 1 } else { index };
            let pose = within_reach(&between(&program[index], to, share), guilty, limits)?;
            upload.push(WireWaypoint { pose, feed_um_s, weld: segment.weld }, index, limits);
            stands.add(upload.waypoints.len() - 1, stand_s);
        }
    }
    // The last waypoint begins no move; as near as it may be to the one before, nothing is left out but it.
    if upload.waypoints.len() < 2 {
        return Err(Error::Short);
    }
    stands.slow_down(&mut upload, limits)?;
    Ok(upload)
}

/// How long the torch stands at the beginning of a move and at its end, s: where an arc is put out, before that; else
/// after it was reached.
fn stands_on(program: &[program::Waypoint], segments: &[Segment], index: usize) -> (f64, f64) {
    let stand_s = |at: usize| program.get(at).and_then(|waypoint| waypoint.dwell_s).map(|s| s.max(STOP_S));
    let puts_out = |at: usize| at > 0 && segments[at - 1].weld && !segments[at].weld;
    let first = stand_s(index).filter(|_| !puts_out(index)).unwrap_or(0.0);
    let last = stand_s(index + 1).filter(|_| puts_out(index + 1)).unwrap_or(0.0);
    (first, last)
}

/// The move on which the torch stands, by its waypoint in the upload, and how long, s.
#[derive(Default)]
struct Stands(BTreeMap<usize, f64>);

impl Stands {
    fn add(&mut self, at: usize, stand_s: f64) {
        if stand_s > 0.0 {
            *self.0.entry(at).or_default() += stand_s;
        }
    }

    /// The moves take their time, as the pendant measures them.
    fn slow_down(self, upload: &mut Upload, limits: &Limits) -> Result<(), Error> {
        for (at, stand_s) in self.0 {
            let Some(next) = upload.waypoints.get(at + 1) else {
                return Err(Error::Dwell { index: upload.origin[at] });
            };
            let way_um = measure_um(&upload.waypoints[at].pose, &next.pose);
            let feed_um_s = (way_um / stand_s).round().clamp(1.0, f64::from(limits.max_feed_um_s));
            upload.waypoints[at].feed_um_s = upload.waypoints[at].feed_um_s.min(feed_um_s as u32);
        }
        Ok(())
    }
}

/// Way or turn of a step, whichever counts for more, µm.
fn measure_um(a: &WirePose, b: &WirePose) -> f64 {
    f64::from(a.distance_um(b)).max(turn_rad(a, b) * TURN_UM_PER_RAD)
}

impl Upload {
    fn push(&mut self, waypoint: WireWaypoint, index: usize, limits: &Limits) {
        match self.waypoints.last_mut() {
            Some(last) if is_too_short(&last.pose, &waypoint.pose, limits) => {
                // The pose stays; what is done from here on is what the later waypoint says.
                *last = WireWaypoint { pose: last.pose, ..waypoint };
                if let Some(origin) = self.origin.last_mut() {
                    *origin = index;
                }
            }
            _ => {
                self.waypoints.push(waypoint);
                self.origin.push(index);
            }
        }
    }

    /// How long the torch moves and stands if nothing holds it, s; without the times of the arc.
    pub fn time_s(&self) -> f64 {
        let times =
            self.waypoints.windows(2).map(|w| measure_um(&w[0].pose, &w[1].pose) / f64::from(w[0].feed_um_s));
        times.sum()
    }

    /// How the path is announced. A path longer than the pendant's ring is streamed.
    pub fn begin(&self, path: u16, limits: &Limits) -> Begin {
        let pairs = || self.waypoints.windows(2).map(|pair| (&pair[0].pose, &pair[1].pose));
        let longest_um = pairs().map(|(a, b)| f64::from(a.distance_um(b))).fold(0.0, f64::max);
        let least_cos = pairs().map(|(a, b)| half_turn_cos_q15(a, b)).min().unwrap_or(Q15_ONE);
        let total = u32::try_from(self.waypoints.len()).unwrap_or(u32::MAX);
        Begin {
            path,
            total,
            chunk: 4,
            streamed: total > limits.ring,
            reach_um: limits.reach_um,
            max_step_um: ((longest_um * 1.001) as u32 + 1).min(limits.max_step_um),
            min_half_turn_cos_q15: least_cos.saturating_sub(8).max(limits.min_half_turn_cos_q15),
            arc: self.waypoints.iter().any(|waypoint| waypoint.weld),
            times: self.times,
        }
    }
}

fn half_turn_cos_q15(a: &WirePose, b: &WirePose) -> i16 {
    (a.dot_q30(b).abs() / i64::from(Q15_ONE)).min(i64::from(Q15_ONE)) as i16
}

fn turn_rad(a: &WirePose, b: &WirePose) -> f64 {
    2.0 * (f64::from(half_turn_cos_q15(a, b)) / f64::from(Q15_ONE)).acos()
}

fn is_too_short(a: &WirePose, b: &WirePose, limits: &Limits) -> bool {
    let way_um = f64::from(a.distance_um(b)) + turn_rad(a, b) * TURN_UM_PER_RAD;
    // What is just long enough by this reckoning may be a little too short by the pendant's.
    f64::from(a.distance_um(b)) < 2.0 * f64::from(limits.min_step_um)
        && way_um < 4.0 * f64::from(limits.min_step_um)
}

fn feed(segment: &Segment, index: usize, limits: &Limits) -> Result<u32, Error> {
    let feed_um_s = (segment.feed_mm_s * 1000.0).round();
    let possible = feed_um_s >= 1.0 && feed_um_s <= f64::from(limits.max_feed_um_s);
    possible.then_some(feed_um_s as u32).ok_or(Error::Feed { index, feed_mm_s: limits.max_feed_um_s / 1000 })
}

/// Where the pieces of a move begin, as shares of it, and how long the torch stands on each, s.
fn shares(
    here: &program::Waypoint,
    to: &program::Waypoint,
    stands_s: [f64; 2],
    limits: &Limits,
) -> Vec<(f64, f64)> {
    let way_um = (to.position_mm - here.position_mm).norm() * 1000.0;
    let turn_rad = here.base_from_torch.angle_to(&to.base_from_torch);
    let most_rad =
        2.0 * (f64::from(limits.min_half_turn_cos_q15) / f64::from(Q15_ONE)).clamp(0.0, 1.0).acos();
    let parts = |all: f64, most: f64| (all / (most * MARGIN).max(1e-6)).ceil().clamp(1.0, 1e6);
    let [first_um, last_um] = stands_s.map(|stand_s| stand_um(stand_s, limits));
    if first_um + last_um > 0.5 * way_um {
        // Too short to be divided: the torch stands on all of it.
        return vec![(0.0, stands_s[0] + stands_s[1])];
    }
    let [from, end] = [first_um / way_um.max(1.0), 1.0 - last_um / way_um.max(1.0)];
    let rest = end - from;
    let count =
        parts(way_um * rest, f64::from(limits.max_step_um)).max(parts(turn_rad * rest, most_rad)) as u32;
    let first = (from > 0.0).then_some((0.0, stands_s[0]));
    let last = (end < 1.0).then_some((end, stands_s[1]));
    let middle = (0..count).map(|k| (from + rest * f64::from(k) / f64::from(count), 0.0));
    first.into_iter().chain(middle).chain(last).collect()
}

/// The way on which the torch stands for so long, µm: a whole feed in whole micrometres takes the time.
fn stand_um(stand_s: f64, limits: &Limits) -> f64 {
    let least_um = STAND_STEPS * f64::from(limits.min_step_um);
    if stand_s > 0.0 { (least_um / stand_s).ceil() * stand_s } else { 0.0 }
}

fn between(
    here: &program::Waypoint,
    to: &program::Waypoint,
    share: f64,
) -> (Point3<f64>, UnitQuaternion<f64>) {
    let position_mm = position_between(&here.position_mm, &to.position_mm, share);
    (position_mm, Arc::between(&here.base_from_torch, &to.base_from_torch).slerp(share))
}

fn within_reach(
    (position_mm, orientation): &(Point3<f64>, UnitQuaternion<f64>),
    index: usize,
    limits: &Limits,
) -> Result<WirePose, Error> {
    let error = Error::Reach { index, reach_mm: limits.reach_um / 1000 };
    let is_near = position_mm.coords.norm() * 1000.0 < f64::from(limits.reach_um);
    if !is_near {
        return Err(error);
    }
    let q = orientation.quaternion().cast::<f32>();
    let position_mm = Point::from(position_mm.coords.cast::<f32>());
    let orientation = Orientation::new_normalize(q);
    WirePose::from_pose(&TorchPose { position_mm, orientation }).ok_or(error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use weldpath_method::weld::program::Kind;

    fn limits() -> Limits {
        weldpath_core::pendant::Config::default().limits(512)
    }

    fn at(x_mm: f64, turn_rad: f64, feed_mm_s: f64, kind: Kind) -> program::Waypoint {
        program::Waypoint {
            position_mm: Point3::new(x_mm, 0.0, 0.0),
            base_from_torch: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rad),
            feed_mm_s,
            weld: kind == Kind::Weld,
            seam: (kind != Kind::Air).then_some(1),
            kind,
            dwell_s: None,
        }
    }

    #[test]
    fn a_pendant_that_says_a_limit_of_zero_is_refused_by_its_name() {
        let program = [at(0.0, 0.0, 10.0, Kind::Air), at(50.0, 0.0, 10.0, Kind::Air)];
        let none = Limits { max_step_um: 0, ..limits() };
        assert_eq!(upload(&program, &none), Err(Error::Limits { what: "longest step" }));
        let far = [at(0.0, 0.0, 10.0, Kind::Air), at(4000.0, 0.0, 10.0, Kind::Air)];
        let counted = upload(&far, &limits()).unwrap_err().counted(|index| index + 40);
        assert_eq!(counted, Error::Reach { index: 41, reach_mm: 3000 });
    }

    #[test]
    fn feed_and_arc_stand_where_a_move_begins() {
        let program = [
            at(0.0, 0.0, 150.0, Kind::Approach),
            at(50.0, 0.0, 25.0, Kind::Weld),
            at(60.0, 0.0, 8.0, Kind::Weld),
            at(110.0, 0.0, 20.0, Kind::Retract),
        ];
        let upload = upload(&program, &limits()).unwrap();
        let said: Vec<_> = upload.waypoints.iter().map(|w| (w.feed_um_s, w.weld)).collect();
        assert_eq!(said, [(25_000, false), (8_000, true), (20_000, false), (20_000, false)]);
    }

    #[test]
    fn long_moves_and_large_turns_are_divided_on_the_line() {
        let program = [at(0.0, 0.0, 150.0, Kind::Air), at(530.0, 3.0, 150.0, Kind::Air)];
        let upload = upload(&program, &limits()).unwrap();
        let begin = upload.begin(1, &limits());
        assert!(begin.max_step_um <= 100_000 && begin.min_half_turn_cos_q15 >= 28_377, "{begin:?}");
        for (k, waypoint) in upload.waypoints.iter().enumerate() {
            let share = k as f64 / (upload.waypoints.len() - 1) as f64;
            assert!(
                (f64::from(waypoint.pose.position_um[0]) - share * 530e3).abs() < 40.0,
                "single precision"
            );
            assert_eq!(waypoint.pose.position_um[1..], [0, 0]);
        }
        assert_eq!(upload.origin.last(), Some(&1));
    }

    #[test]
    fn waypoints_at_one_place_become_one_and_the_later_one_says_what_follows() {
        let program = [
            at(0.0, 0.0, 100.0, Kind::Air),
            at(10.0, 0.0, 100.0, Kind::Approach),
            at(10.0, 0.0, 25.0, Kind::Weld),
            at(20.0, 0.0, 8.0, Kind::Weld),
        ];
        let upload = upload(&program, &limits()).unwrap();
        assert_eq!(upload.origin, [0, 2, 3]);
        assert!(upload.waypoints[1].weld && upload.waypoints[1].feed_um_s == 8_000);
    }

    #[test]
    fn what_the_pendant_cannot_do_is_named() {
        let far = [at(0.0, 0.0, 100.0, Kind::Air), at(3500.0, 0.0, 100.0, Kind::Air)];
        assert!(matches!(upload(&far, &limits()), Err(Error::Reach { index: 1, .. })));
        let fast = [at(0.0, 0.0, 100.0, Kind::Air), at(9.0, 0.0, 300.0, Kind::Air)];
        assert_eq!(upload(&fast, &limits()), Err(Error::Feed { index: 1, feed_mm_s: 250 }));
        assert_eq!(upload(&[], &limits()), Err(Error::Short));
        let mut stands = [at(0.0, 0.0, 100.0, Kind::Air), at(9.0, 0.0, 30.0, Kind::Air)];
        stands[1].dwell_s = Some(0.0);
        assert_eq!(upload(&stands, &limits()), Err(Error::Dwell { index: 1 }));
    }

    #[test]
    fn the_torch_stands_on_its_own_path_for_the_time_and_with_the_arc_that_the_program_says() {
        let mut program = [
            at(0.0, 0.0, 100.0, Kind::Approach),
            at(50.0, 0.0, 20.0, Kind::Weld),
            at(60.0, 0.0, 8.0, Kind::Weld),
            at(70.0, 0.0, 8.0, Kind::Weld),
            at(90.0, 0.0, 20.0, Kind::Retract),
        ];
        let moving_s = upload(&program, &limits()).unwrap().time_s();
        (program[1].dwell_s, program[2].dwell_s, program[3].dwell_s) = (Some(0.2), Some(1.0), Some(60.0));
        let upload = upload(&program, &limits()).unwrap();
        let slow: Vec<_> = upload.waypoints.windows(2).filter(|w| w[0].feed_um_s < 1_000).collect();
        let times_s = slow.iter().map(|w| {
            let way_um = w[1].pose.position_um[0] - w[0].pose.position_um[0];
            assert!(way_um < 200 && w[0].weld, "{w:?}");
            f64::from(way_um) / f64::from(w[0].feed_um_s)
        });
        for (found_s, said_s) in times_s.zip([0.2, 1.0, 60.0]) {
            assert!((found_s / said_s - 1.0).abs() < 0.01, "{found_s} s instead of {said_s} s");
        }
        let places_um: Vec<i32> = slow.iter().map(|w| w[0].pose.position_um[0]).collect();
        assert_eq!(places_um, [50_000, 60_000, 70_000 - 120]);
        assert!((upload.time_s() - moving_s - 61.2).abs() < 0.4, "{} {moving_s}", upload.time_s());
    }

    #[test]
    fn an_exact_stop_is_passed_slowly_and_a_short_move_stands_as_a_whole() {
        let mut program = [
            at(0.0, 0.0, 100.0, Kind::Weld),
            at(9.0, 0.0, 30.0, Kind::Weld),
            at(9.15, 0.0, 30.0, Kind::Weld),
        ];
        program[0].dwell_s = Some(0.0);
        program[1].dwell_s = Some(0.5);
        let upload = upload(&program, &limits()).unwrap();
        let said: Vec<_> = upload.waypoints.iter().map(|w| (w.pose.position_um[0], w.feed_um_s)).collect();
        assert_eq!(said, [(0, 2_400), (120, 30_000), (9_000, 300), (9_150, 30_000)]);
    }
}
