//! The links of an arm against the work, the floor, the torch and each other.
//!
//! Links are capsules of nominal size. The work is what was scanned, without points that stand alone: what no view saw is
//! not known to be free. Millimetres, the scan's base frame.

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::arm::Joints;
use super::body::BEHIND_THE_WRIST;
use super::branch::{self, Stand, Way};
use super::chain::{Capsule, LinkChain};
use super::moves::Station;
use super::torch::{Thinned, Torch};
use super::{Check, Floor, JointCheck, Oddity, PlacedArm, torch_from_tool};
use crate::robot::posture::{PlannedPosture, Stance};
use weldpath_method::geometry::surface::Surface;

/// The link that carries the cable.
const FLANGE: usize = 6;
/// The base and the column stand on the floor and beside the work for good.
const FIRST_OVER_THE_FLOOR: usize = 2;
/// Links overlap by more than this before it is a touch of each other: their sizes are nominal, mm.
const PLAY_MM: f64 = 5.0;

/// What a link touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Obstacle {
    /// The surface that the arm stands on, or a lower one.
    Floor,
    /// What was scanned.
    Work,
    /// The torch that it carries.
    Torch,
    /// Another link.
    Link(Link),
}

/// A part of the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Link {
    /// The joint that carries it, from 1; 0 stands still, 7 is the torch.
    pub index: usize,
    /// What a person calls it.
    pub name: &'static str,
}

/// A link, or the torch, inside something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// What is inside something.
    pub link: Link,
    /// What it touches.
    pub obstacle: Obstacle,
    /// How far inside, mm.
    pub depth_mm: f64,
}

/// The deepest of some touches.
pub(super) fn deepest(touches: impl IntoIterator<Item = Touch>) -> Option<Touch> {
    touches.into_iter().max_by(|a, b| a.depth_mm.total_cmp(&b.depth_mm))
}

/// A share of the way between two stands of the joints, all of which turn evenly.
pub(super) fn between(from_rad: &Joints, to_rad: &Joints, share: f64) -> Joints {
    std::array::from_fn(|j| from_rad[j] + (to_rad[j] - from_rad[j]) * share)
}

/// A wrist that is bent by less is near its singularity, degrees.
const LEAST_BEND_DEG: f64 = 10.0;

/// An arm with its capsules, and what they may not touch.
pub(super) struct Links<'a> {
    pub(super) robot: &'a PlacedArm,
    chain: LinkChain,
    ahead: Vector3<f64>,
    work: Thinned,
    /// What holds the torch, and the torch, in the flange's frame.
    torch: Vec<Capsule>,
    cable_radius_mm: f64,
    pub(super) floor_mm: Option<f64>,
}

impl<'a> Links<'a> {
    pub(super) fn new(robot: &'a PlacedArm, torch: &Torch, work: &Surface) -> Self {
        let work = Thinned::new(work);
        let mounting_mm = robot.base_from_robot * Point3::new(0.0, 0.0, robot.arm.body.mounting_mm);
        let floor_mm = match robot.floor {
            Floor::Mounting => Some(work.lowest_mm().map_or(mounting_mm.z, |mm| mm.min(mounting_mm.z))),
            Floor::At(floor_mm) => Some(floor_mm),
            Floor::None => None,
        };
        let chain = LinkChain::of(&robot.arm);
        let (ahead, cable_radius_mm) = (robot.arm.ahead(), torch.cable_radius_mm);
        let torch = torch.at_the_flange(&robot.flange_from_tcp);
        Self { robot, chain, ahead, work, torch, cable_radius_mm, floor_mm }
    }

    /// The motion of the joints along the stations that has least against it.
    pub(super) fn follow(&self, stations: &[Station]) -> Way {
        let poses: Vec<_> = stations.iter().map(|station| self.robot.robot_from_flange(station)).collect();
        let judge = |joints_rad: &Joints| {
            let carried = self.chain.carried(joints_rad);
            let touches = self.touch_of(&carried).is_some();
            Stand { touches, odd: self.oddity_of(&carried, joints_rad).is_some() }
        };
        branch::follow(&self.robot.arm, &poses, judge)
    }

    /// How the arm stands there that nobody would have it stand.
    fn oddity_of(&self, carried: &[Isometry3<f64>; 7], joints_rad: &Joints) -> Option<Oddity> {
        let (front, elbow_up) = self.chain.stance(carried, &self.ahead);
        let straight = self.robot.arm.wrist_bend(joints_rad) < LEAST_BEND_DEG.to_radians().sin();
        let oddities = [
            (!elbow_up, Oddity::ElbowBelow),
            (!front, Oddity::ReachesBack),
            (straight, Oddity::WristStraight),
        ];
        oddities.into_iter().find(|(is_so, _)| *is_so).map(|(_, oddity)| oddity)
    }

    /// How the arm stands along the program, as its controller counts the joints.
    pub(super) fn posture(&self, checks: &[Check]) -> Option<PlannedPosture> {
        let counting = self.robot.arm.counting?;
        let stance = |check: &Check| {
            let joints_rad = check.joints?.joints_rad;
            let (front, elbow_up) = self.chain.stance(&self.chain.carried(&joints_rad), &self.ahead);
            Some(Stance { joints_deg: counting.shown_deg(&joints_rad), front, elbow_up })
        };
        Some(PlannedPosture {
            counted_by: counting.maker,
            stances: checks.iter().map(stance).collect::<Option<_>>()?,
            home_deg: self.robot.home_rad.map(|home| counting.shown_deg(&home)),
            end: self.robot.end,
        })
    }

    /// The torch where the joints stand so.
    pub(super) fn station(&self, joints_rad: &Joints) -> Station {
        let PlacedArm { arm, base_from_robot, flange_from_tcp, .. } = self.robot;
        let base_from_tcp = base_from_robot * arm.forward(joints_rad) * flange_from_tcp;
        let base_from_torch = base_from_tcp.rotation * torch_from_tool().inverse();
        let tip_mm = Point3::from(base_from_tcp.translation.vector);
        Station { waypoint: 0, tip_mm, base_from_torch, time_s: 0.0 }
    }

    /// Steps between two stands of the joints on which no link goes farther than its radius.
    pub(super) fn steps_between(&self, from_rad: &Joints, to_rad: &Joints) -> usize {
        // A joint that turns far may bring the links back to where they were: the way is measured by parts.
        let turn_rad = (0..6).map(|j| (to_rad[j] - from_rad[j]).abs()).fold(0.0, f64::max);
        let parts = (turn_rad / branch::JUMP_RAD).ceil().max(1.0);
        let at = |k: usize| between(from_rad, to_rad, k as f64 / parts);
        let part_mm = |k: usize| self.largest_way_mm(&at(k), &at(k + 1));
        let way_mm = parts * (0..parts.min(1e3) as usize).map(part_mm).fold(0.0, f64::max);
        (way_mm / self.robot.arm.body.least_radius_mm()).ceil().clamp(1.0, 10_000.0) as usize
    }

    /// One check per waypoint; the worst of each on the move to it.
    pub(super) fn joint_checks(
        &self,
        stations: &[Station],
        way: &Way,
        waypoints: usize,
        fully: bool,
    ) -> Vec<Option<JointCheck>> {
        let indices: Vec<usize> = (0..stations.len()).collect();
        let single: Vec<Option<JointCheck>> = indices
            .par_iter()
            .map(|&i| {
                let before = i.checked_sub(1).and_then(|k| way.joints_rad[k]);
                let own = self.joint_check(way.joints_rad[i]?, before, stations[i].time_s, fully);
                Some(JointCheck { step_rad: way.step_rad[i], ..own })
            })
            .collect();
        let mut merged: Vec<Option<Option<JointCheck>>> = vec![None; waypoints];
        for (station, now) in stations.iter().zip(single) {
            let slot = &mut merged[station.waypoint];
            *slot = Some(match slot.take() {
                None => now,
                Some(before) => before.zip(now).map(|(before, now)| before.worse(&now)),
            });
        }
        merged.into_iter().map(Option::flatten).collect()
    }

    fn joint_check(&self, joints: Joints, before: Option<Joints>, time_s: f64, fully: bool) -> JointCheck {
        let limits = &self.robot.arm.limits;
        let margin_rad = (0..6).map(|j| limits.margin_rad(j, joints[j])).fold(f64::INFINITY, f64::min);
        let share = |before: Joints| {
            let speed = |j: usize| (joints[j] - before[j]).abs() / time_s / limits.speed_rad_s[j];
            (0..6).map(speed).fold(0.0, f64::max)
        };
        let speed_share = before.filter(|_| time_s > 0.0).map_or(0.0, share);
        let dexterity = if fully { self.robot.arm.dexterity(&joints) } else { 1.0 };
        let touch = before.map_or_else(|| self.touch(&joints), |before| self.touch_to(&before, &joints));
        let odd = self.oddity_of(&self.chain.carried(&joints), &joints);
        JointCheck { joints_rad: joints, margin_rad, dexterity, step_rad: 0.0, speed_share, touch, odd }
    }

    /// The deepest touch on a straight move to neighbouring joints, where these stand included.
    fn touch_to(&self, before: &Joints, joints: &Joints) -> Option<Touch> {
        // Between two branches there is no motion to look at.
        if (0..6).any(|j| (joints[j] - before[j]).abs() > branch::JUMP_RAD) {
            return self.touch(joints);
        }
        let steps = self.steps_between(before, joints);
        deepest((1..=steps).filter_map(|k| self.touch(&between(before, joints, k as f64 / steps as f64))))
    }

    /// The deepest touch where the joints stand so.
    pub(super) fn touch(&self, joints_rad: &Joints) -> Option<Touch> {
        self.touch_of(&self.chain.carried(joints_rad))
    }

    fn touch_of(&self, carried: &[Isometry3<f64>; 7]) -> Option<Touch> {
        let flange = carried[6] * self.chain.base_from_flange;
        let robot: Vec<Capsule> =
            self.chain.capsules.iter().map(|capsule| capsule.moved(&carried[capsule.link])).collect();
        let torch: Vec<Capsule> = self.torch.iter().map(|capsule| capsule.moved(&flange)).collect();
        let own = self.own_touches(&robot, &torch);
        let others = robot.iter().chain(&torch).flat_map(|capsule| self.outer_touches(capsule));
        deepest(own.chain(others))
    }

    fn link(&self, index: usize) -> Link {
        Link { index, name: self.robot.arm.body.names.get(index).copied().unwrap_or("torch") }
    }

    /// The largest way of an end of a link between two stands of the joints, mm.
    fn largest_way_mm(&self, from_rad: &Joints, to_rad: &Joints) -> f64 {
        let (from, to) = (self.chain.carried(from_rad), self.chain.carried(to_rad));
        let ends = self.chain.capsules.iter().flat_map(|c| c.ends_mm.map(|end| (c.link, end)));
        let ways = ends.map(|(link, end)| (to[link] * end - from[link] * end).norm());
        ways.fold(0.0, f64::max)
    }

    /// Between links that no joint keeps apart, and between the torch and those behind the wrist; robot's frame.
    fn own_touches<'b>(
        &'b self,
        robot: &'b [Capsule],
        torch: &'b [Capsule],
    ) -> impl Iterator<Item = Touch> + 'b {
        let of = |link: usize| robot.iter().filter(move |capsule| capsule.link == link);
        let pairs = self.robot.arm.body.pairs.iter().flat_map(move |&[a, b]| {
            of(a).flat_map(move |one| of(b).map(move |other| (one, other))).map(move |(one, other)| {
                let depth_mm = -one.gap_mm(other);
                Touch { link: self.link(b), obstacle: Obstacle::Link(self.link(a)), depth_mm }
            })
        });
        let behind = robot.iter().filter(|capsule| capsule.link < BEHIND_THE_WRIST);
        let with_torch = behind.flat_map(move |link| {
            torch.iter().map(move |part| {
                let depth_mm = -link.gap_mm(part);
                Touch { link: self.link(link.link), obstacle: Obstacle::Torch, depth_mm }
            })
        });
        pairs.chain(with_torch).filter(|touch| touch.depth_mm > PLAY_MM)
    }

    /// With the floor and the work. The torch has a check of its own against the work.
    fn outer_touches(&self, capsule: &Capsule) -> impl Iterator<Item = Touch> {
        let is_torch = capsule.link == TORCH;
        let link = self.link(capsule.link);
        let mut placed = capsule.moved(&self.robot.base_from_robot);
        if capsule.link == FLANGE {
            placed.radius_mm = placed.radius_mm.max(self.cable_radius_mm);
        }
        let over = capsule.link >= FIRST_OVER_THE_FLOOR;
        let floor = self.floor_mm.filter(|_| over).map(|floor_mm| {
            let lowest_mm = placed.ends_mm.iter().map(|end| end.z).fold(f64::INFINITY, f64::min);
            (Obstacle::Floor, floor_mm - (lowest_mm - placed.radius_mm))
        });
        let work = || self.work.inside_mm(&placed.ends_mm, placed.radius_mm);
        let work = (over && !is_torch).then(work).flatten().map(|depth_mm| (Obstacle::Work, depth_mm));
        let found = floor.into_iter().chain(work).filter(|(_, depth_mm)| *depth_mm > 0.0);
        found.map(move |(obstacle, depth_mm)| Touch { link, obstacle, depth_mm })
    }
}

/// Stands for the torch among the links: it is carried by the flange.
pub(super) const TORCH: usize = 7;
pub(super) const TORCH_LINK: Link = Link { index: TORCH, name: "torch" };

impl Capsule {
    fn moved(&self, by: &Isometry3<f64>) -> Self {
        Self { ends_mm: self.ends_mm.map(|end| by * end), ..*self }
    }

    /// Between two surfaces, mm; negative where they overlap.
    fn gap_mm(&self, other: &Self) -> f64 {
        let ([a, b], [c, d]) = (self.ends_mm, other.ends_mm);
        lines_apart_mm(&a, &(b - a), &c, &(d - c)) - self.radius_mm - other.radius_mm
    }
}

/// Between the lines from `a` and `c` along `u` and `v` (Ericson, Real-Time Collision Detection 2005, 5.1.9).
fn lines_apart_mm(a: &Point3<f64>, u: &Vector3<f64>, c: &Point3<f64>, v: &Vector3<f64>) -> f64 {
    let between = a - c;
    let (uu, vv, uv) = (u.norm_squared(), v.norm_squared(), u.dot(v));
    let (ub, vb) = (u.dot(&between), v.dot(&between));
    let share = |value: f64, of: f64| if of > 0.0 { (value / of).clamp(0.0, 1.0) } else { 0.0 };
    let across = uu * vv - uv * uv;
    let mut s = if across > 1e-9 * uu * vv { share(uv * vb - ub * vv, across) } else { 0.0 };
    let mut t = if vv > 0.0 { (uv * s + vb) / vv } else { 0.0 };
    if !(0.0..=1.0).contains(&t) || vv == 0.0 {
        t = t.clamp(0.0, 1.0);
        s = share(uv * t - ub, uu);
    }
    (between + u * s - v * t).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn capsule(from: [f64; 3], to: [f64; 3], radius_mm: f64) -> Capsule {
        Capsule { link: 0, ends_mm: [from.into(), to.into()], radius_mm }
    }

    #[test]
    fn capsules_are_as_far_apart_as_their_lines_less_their_radii() {
        let bar = capsule([0.0; 3], [100.0, 0.0, 0.0], 10.0);
        for (other, gap_mm) in [
            (capsule([50.0, -50.0, 40.0], [50.0, 50.0, 40.0], 5.0), 25.0),
            (capsule([130.0, 40.0, 0.0], [300.0, 40.0, 0.0], 5.0), 35.0),
            (capsule([-30.0, 0.0, 40.0], [-30.0, 0.0, 40.0], 0.0), 40.0),
            (capsule([20.0, 0.0, 12.0], [80.0, 0.0, 12.0], 5.0), -3.0),
        ] {
            assert!((bar.gap_mm(&other) - gap_mm).abs() < 1e-9, "{other:?}");
            assert!((other.gap_mm(&bar) - gap_mm).abs() < 1e-9, "{other:?}");
        }
    }

    proptest! {
        #[test]
        fn no_two_places_of_two_lines_are_nearer_than_the_lines(
            places in prop::array::uniform4(prop::array::uniform3(-10.0..10.0f64)),
            s in 0.0..=1.0f64,
            t in 0.0..=1.0f64,
        ) {
            let [a, b, c, d] = places.map(Point3::from);
            let apart_mm = lines_apart_mm(&a, &(b - a), &c, &(d - c));
            let some_mm = (a + (b - a) * s - (c + (d - c) * t)).norm();
            prop_assert!(apart_mm <= some_mm + 1e-9);
            // It is reached somewhere on a fine raster.
            let raster = (0..=60).flat_map(|i| (0..=60).map(move |k| (f64::from(i) / 60.0, f64::from(k) / 60.0)));
            let least_mm = raster.map(|(s, t)| (a + (b - a) * s - (c + (d - c) * t)).norm()).fold(f64::MAX, f64::min);
            prop_assert!(least_mm - apart_mm < 0.5, "{least_mm} {apart_mm}");
        }
    }
}
