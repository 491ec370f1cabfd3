//! A planned program as a pendant takes it: integers, feed and arc where a move begins, steps within its limits.

use nalgebra::{Point3, UnitQuaternion};
use weldpath_core::path::TorchPose;
use weldpath_core::wire::{Begin, Limits, Q15_ONE, Waypoint, WirePose};
use weldpath_core::{Orientation, Point};

use crate::toolpath::program::{self, Segment};

/// A turn of 1 rad counts as this much way when a step is too short, µm: the pendant's rule.
const TURN_UM_PER_RAD: f64 = 10_000.0;
/// Moves are divided to this share of the largest step and turn, so that rounding cannot make one too large.
const MARGIN: f64 = 0.95;

/// A program ready to be sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Upload {
    /// What the pendant gets.
    pub waypoints: Vec<Waypoint>,
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

/// Brings a program into the pendant's form. Long moves are divided evenly, on the same line and the same arc;
/// waypoints nearer to the one before than the pendant's shortest step are left out.
pub fn upload(program: &[program::Waypoint], limits: &Limits) -> Result<Upload, Error> {
    let mut upload = Upload { waypoints: Vec::new(), origin: Vec::new() };
    for (index, segment) in program::segments(program).enumerate() {
        let feed_um_s = feed(&segment, (index + 1).min(program.len() - 1), limits)?;
        for pose in moves(&program[index], program.get(index + 1), limits) {
            let pose = within_reach(&pose, index, limits)?;
            upload.push(Waypoint { pose, feed_um_s, weld: segment.weld }, index, limits);
        }
    }
    // The last waypoint begins no move; as near as it may be to the one before, nothing is left out but it.
    if upload.waypoints.len() < 2 { Err(Error::Short) } else { Ok(upload) }
}

impl Upload {
    fn push(&mut self, waypoint: Waypoint, index: usize, limits: &Limits) {
        match self.waypoints.last_mut() {
            Some(last) if is_too_short(&last.pose, &waypoint.pose, limits) => {
                // The pose stays; what is done from here on is what the later waypoint says.
                *last = Waypoint { pose: last.pose, ..waypoint };
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
        }
    }
}

fn half_turn_cos_q15(a: &WirePose, b: &WirePose) -> i16 {
    (a.dot_q30(b).abs() / i64::from(Q15_ONE)).min(i64::from(Q15_ONE)) as i16
}

fn is_too_short(a: &WirePose, b: &WirePose, limits: &Limits) -> bool {
    let turn_rad = 2.0 * (f64::from(half_turn_cos_q15(a, b)) / f64::from(Q15_ONE)).acos();
    let way_um = f64::from(a.distance_um(b)) + turn_rad * TURN_UM_PER_RAD;
    // What is just long enough by this reckoning may be a little too short by the pendant's.
    f64::from(a.distance_um(b)) < 2.0 * f64::from(limits.min_step_um)
        && way_um < 4.0 * f64::from(limits.min_step_um)
}

fn feed(segment: &Segment, index: usize, limits: &Limits) -> Result<u32, Error> {
    let feed_um_s = (segment.feed_mm_s * 1000.0).round();
    let possible = feed_um_s >= 1.0 && feed_um_s <= f64::from(limits.max_feed_um_s);
    possible.then_some(feed_um_s as u32).ok_or(Error::Feed { index, feed_mm_s: limits.max_feed_um_s / 1000 })
}

/// The pose of a waypoint, and those that divide the move from it to the next.
fn moves(
    here: &program::Waypoint,
    next: Option<&program::Waypoint>,
    limits: &Limits,
) -> impl Iterator<Item = (Point3<f64>, UnitQuaternion<f64>)> {
    let to = *next.unwrap_or(here);
    let here = *here;
    let way_um = (to.position_mm - here.position_mm).norm() * 1000.0;
    let turn_rad = here.base_from_torch.angle_to(&to.base_from_torch);
    let most_rad =
        2.0 * (f64::from(limits.min_half_turn_cos_q15) / f64::from(Q15_ONE)).clamp(0.0, 1.0).acos();
    let parts = |all: f64, most: f64| (all / (most * MARGIN).max(1e-6)).ceil().clamp(1.0, 1e6);
    let count = parts(way_um, f64::from(limits.max_step_um)).max(parts(turn_rad, most_rad));
    (0..count as u32).map(move |k| {
        let alpha = f64::from(k) / count;
        let position_mm = here.position_mm + (to.position_mm - here.position_mm) * alpha;
        let turned = here.base_from_torch.try_slerp(&to.base_from_torch, alpha, 1e-9);
        (position_mm, turned.unwrap_or(here.base_from_torch))
    })
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
    use crate::toolpath::program::Kind;
    use nalgebra::Vector3;

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
        }
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
        assert!(matches!(upload(&far, &limits()), Err(Error::Reach { .. })));
        let fast = [at(0.0, 0.0, 100.0, Kind::Air), at(9.0, 0.0, 300.0, Kind::Air)];
        assert_eq!(upload(&fast, &limits()), Err(Error::Feed { index: 1, feed_mm_s: 250 }));
        assert_eq!(upload(&[], &limits()), Err(Error::Short));
    }
}
