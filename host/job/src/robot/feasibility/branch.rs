//! One continuous motion of the joints along a sequence of poses, by dynamic programming over all branches of the inverse
//! kinematics: first of all nothing is touched and no limit broken, then the arm stands as a person would have it stand, then
//! the joints move least.

use std::cmp::Ordering;
use std::f64::consts::{PI, TAU};
use std::ops::Add;

use nalgebra::Isometry3;
use rayon::prelude::*;

use super::arm::{Arm, Joints, Limits};

/// Between two poses that are close a joint that turns more than this has changed its branch, rad.
pub(super) const JUMP_RAD: f64 = 0.35;

/// How good it is to stand so.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Stand {
    /// A link is inside something.
    pub touches: bool,
    /// Nobody would have it stand so.
    pub odd: bool,
}

/// A way for the joints, one entry per pose.
#[derive(Debug, Clone, Default)]
pub(super) struct Way {
    /// None where no branch reaches the pose. Continuous through whole turns.
    pub joints_rad: Vec<Option<Joints>>,
    /// Largest step of a joint from the pose before, rad; 0 at the first and after a gap.
    pub step_rad: Vec<f64>,
}

/// What is had against a way; what comes first outweighs what follows.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    /// Jumps to another branch, joints beyond their limits. Where no way is free, the one is told that the arm could move
    /// along if what it touches were not there.
    breaks: usize,
    touches: usize,
    odd: usize,
    /// rad².
    motion: f64,
}

impl Cost {
    fn order(&self, other: &Self) -> Ordering {
        let counts = |cost: &Self| (cost.breaks, cost.touches, cost.odd);
        let counts = counts(self).cmp(&counts(other));
        counts.then(self.motion.total_cmp(&other.motion))
    }
}

impl Add for Cost {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            breaks: self.breaks + other.breaks,
            touches: self.touches + other.touches,
            odd: self.odd + other.odd,
            motion: self.motion + other.motion,
        }
    }
}

/// One solution of the inverse kinematics at one pose.
struct Node {
    joints_rad: Joints,
    /// Of the best way here, and the node before it.
    cost: Cost,
    from: Option<usize>,
}

/// The way with least against it.
///
/// Whole turns are settled at the end: each joint's way is shifted to where it stays farthest from its limits.
pub(super) fn follow(
    arm: &Arm,
    base_from_flange: &[Isometry3<f64>],
    judge: impl Fn(&Joints) -> Stand + Sync,
) -> Way {
    let stands = |pose: &Isometry3<f64>| -> Vec<(Joints, Stand)> {
        arm.inverse(pose).into_iter().map(|joints_rad| (joints_rad, judge(&joints_rad))).collect()
    };
    let layers = layers(&arm.limits, base_from_flange.par_iter().map(stands).collect());
    let Some(last) = layers.iter().rposition(|layer| !layer.is_empty()) else {
        return Way { joints_rad: vec![None; layers.len()], step_rad: vec![0.0; layers.len()] };
    };
    let judged = (0..layers[last].len()).map(|end| {
        let way = settled(&arm.limits, unwound(&layers, last, end));
        (Cost { breaks: breaks(&arm.limits, &way), ..layers[last][end].cost }, way)
    });
    judged.min_by(|a, b| a.0.order(&b.0)).map(|(_, way)| way).unwrap_or_default()
}

fn layers(limits: &Limits, stands: Vec<Vec<(Joints, Stand)>>) -> Vec<Vec<Node>> {
    let mut layers: Vec<Vec<Node>> = Vec::with_capacity(stands.len());
    let mut previous: Option<usize> = None;
    for (i, stands) in stands.into_iter().enumerate() {
        let before: &[Node] = previous.map_or(&[], |k| &layers[k]);
        let adjoins = previous.is_some_and(|k| k + 1 == i);
        let node = |(joints_rad, Stand { touches, odd }): (Joints, Stand)| {
            let (cost, from) = cheapest(before, &joints_rad, adjoins);
            let breaks = beyond(limits, &joints_rad);
            let own = Cost { breaks, touches: usize::from(touches), odd: usize::from(odd), motion: 0.0 };
            Node { joints_rad, cost: cost + own, from }
        };
        let layer: Vec<Node> = stands.into_iter().map(node).collect();
        if !layer.is_empty() {
            previous = Some(i);
        }
        layers.push(layer);
    }
    layers
}

/// The cheapest way to these joints; after a gap the motion itself counts for nothing.
fn cheapest(before: &[Node], joints_rad: &Joints, adjoins: bool) -> (Cost, Option<usize>) {
    let costs = before.iter().enumerate().map(|(k, node)| {
        let step = if adjoins { motion(&node.joints_rad, joints_rad) } else { Cost::default() };
        (node.cost + step, Some(k))
    });
    costs.min_by(|a, b| a.0.order(&b.0)).unwrap_or_default()
}

fn motion(from: &Joints, to: &Joints) -> Cost {
    let steps = (0..6).map(|j| shortest(to[j] - from[j]));
    let (motion, largest) =
        steps.fold((0.0, 0f64), |(sum, most), step| (sum + step * step, most.max(step.abs())));
    Cost { breaks: usize::from(largest > JUMP_RAD), motion, ..Cost::default() }
}

/// Joints that no whole turn brings within their limits.
fn beyond(limits: &Limits, joints_rad: &Joints) -> usize {
    (0..6).filter(|&j| limits.margin_rad(j, limits.centred(j, joints_rad[j])) < 0.0).count()
}

/// The angle within half a turn of zero.
fn shortest(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

/// The way that ends at node `end` of layer `last`, each joint continued through whole turns.
fn unwound(layers: &[Vec<Node>], last: usize, end: usize) -> Way {
    let mut chosen = vec![None; layers.len()];
    let mut at = Some(end);
    for (i, layer) in layers.iter().enumerate().take(last + 1).rev().filter(|(_, layer)| !layer.is_empty()) {
        let node = at.and_then(|k| layer.get(k));
        chosen[i] = node.map(|node| node.joints_rad);
        at = node.and_then(|node| node.from);
    }
    let mut way = Way { joints_rad: chosen, step_rad: vec![0.0; layers.len()] };
    let mut before: Option<Joints> = None;
    let mut gap = true;
    for (joints, step) in way.joints_rad.iter_mut().zip(&mut way.step_rad) {
        if let (Some(now), Some(before)) = (joints.as_mut(), before) {
            let steps: [f64; 6] = std::array::from_fn(|j| shortest(now[j] - before[j]));
            *now = std::array::from_fn(|j| before[j] + steps[j]);
            *step = if gap { 0.0 } else { steps.iter().fold(0.0, |most, step| step.abs().max(most)) };
        }
        gap = joints.is_none();
        before = joints.or(before);
    }
    way
}

/// Each joint shifted by the whole turns that leave its whole way farthest from the limits.
fn settled(limits: &Limits, mut way: Way) -> Way {
    for j in 0..6 {
        let angles = || way.joints_rad.iter().flatten().map(|joints| joints[j]);
        let (low, high) = angles().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), a| (l.min(a), h.max(a)));
        let middle = 0.5 * (low + high);
        let shift = limits.centred(j, middle) - middle;
        way.joints_rad.iter_mut().flatten().for_each(|joints| joints[j] += shift);
    }
    way
}

/// Poses where the way jumps or breaks a limit.
fn breaks(limits: &Limits, way: &Way) -> usize {
    let broken = |joints: &Joints| (0..6).any(|j| limits.margin_rad(j, joints[j]) < 0.0);
    way.joints_rad.iter().flatten().filter(|joints| broken(joints)).count()
        + way.step_rad.iter().filter(|step| **step > JUMP_RAD).count()
}

#[cfg(test)]
mod tests {
    use super::super::arm::by_name;
    use super::*;

    fn any(_: &Joints) -> Stand {
        Stand::default()
    }

    fn line(arm: &Arm, from: &Joints, to: &Joints, n: usize) -> (Vec<Joints>, Vec<Isometry3<f64>>) {
        let at = |k: usize| std::array::from_fn(|j| from[j] + (to[j] - from[j]) * k as f64 / n as f64);
        let joints: Vec<Joints> = (0..=n).map(at).collect();
        let poses = joints.iter().map(|q| arm.forward(q)).collect();
        (joints, poses)
    }

    #[test]
    fn a_motion_of_the_joints_is_found_again_without_a_jump() {
        let arm = by_name("ur5e").unwrap();
        let (from, to) = ([0.2, -1.4, 1.6, -0.5, 1.1, 0.3], [0.9, -1.0, 1.2, -0.9, 1.5, 1.4]);
        let (joints, poses) = line(&arm, &from, &to, 60);
        let way = follow(&arm, &poses, any);
        assert!(way.step_rad.iter().all(|&step| step < 0.03), "{:?}", way.step_rad);
        // Another branch may move less; on whichever it is, the flange follows.
        for (pose, q) in poses.iter().zip(&way.joints_rad) {
            let back = arm.forward(&q.unwrap());
            assert!((back.translation.vector - pose.translation.vector).norm() < 1e-4);
        }
        assert_eq!(way.joints_rad.len(), joints.len());
    }

    #[test]
    fn a_joint_that_turns_one_and_a_half_times_is_unwound_within_its_limits() {
        let arm = by_name("ur5e").unwrap();
        let (from, to) = ([0.2, -1.4, 1.6, -0.5, 1.1, -4.7], [0.2, -1.4, 1.6, -0.5, 1.1, 4.7]);
        let (_, poses) = line(&arm, &from, &to, 120);
        let way = follow(&arm, &poses, any);
        let last: Vec<f64> = way.joints_rad.iter().map(|q| q.unwrap()[5]).collect();
        assert!(last.windows(2).all(|w| (w[1] - w[0]).abs() < 0.1));
        assert!((last[0] - last[120]).abs() > 9.0);
        assert!(last.iter().all(|q| q.abs() <= TAU), "{} {}", last[0], last[120]);
    }

    #[test]
    fn what_touches_is_avoided_before_what_is_odd_and_that_before_motion() {
        let arm = by_name("ur5e").unwrap();
        let (from, to) = ([0.2, -1.4, 1.6, -0.5, 1.1, 0.3], [0.4, -1.0, 1.2, -0.9, 1.5, 0.9]);
        let (_, poses) = line(&arm, &from, &to, 60);
        let bent_down = |q: &Joints| q[2] < 0.0;
        let touching = |q: &Joints| Stand { touches: !bent_down(q), odd: bent_down(q) };
        let odd = |q: &Joints| Stand { touches: false, odd: !bent_down(q) };
        for way in [follow(&arm, &poses, touching), follow(&arm, &poses, odd)] {
            assert!(way.joints_rad.iter().flatten().all(bent_down));
            assert!(way.step_rad.iter().all(|&step| step < JUMP_RAD));
        }
        let free = follow(&arm, &poses, |q| Stand { touches: bent_down(q), odd: bent_down(q) });
        assert!(!free.joints_rad.iter().flatten().any(bent_down));
    }

    #[test]
    fn two_poses_that_no_single_branch_joins_are_a_jump() {
        let arm = by_name("ur5e").unwrap();
        let here = arm.forward(&[0.2, -1.4, 1.6, -0.5, 1.1, 0.3]);
        let there = arm.forward(&[1.2, -1.4, 1.6, -0.5, 1.1, 0.3]);
        let way = follow(&arm, &[here, there], any);
        assert!(way.step_rad[1] > JUMP_RAD);
    }

    #[test]
    fn a_pose_out_of_reach_is_a_gap_and_the_others_keep_their_joints() {
        let arm = by_name("ur5e").unwrap();
        let (_, mut poses) =
            line(&arm, &[0.2, -1.4, 1.6, -0.5, 1.1, 0.3], &[0.3, -1.4, 1.6, -0.5, 1.1, 0.3], 4);
        poses[2].translation.vector.x += 5000.0;
        let way = follow(&arm, &poses, any);
        let reached: Vec<bool> = way.joints_rad.iter().map(Option::is_some).collect();
        assert_eq!(reached, [true, true, false, true, true]);
        poses.iter_mut().for_each(|pose| pose.translation.vector.x += 5000.0);
        assert!(follow(&arm, &poses, any).joints_rad.iter().all(Option::is_none));
        assert!(follow(&arm, &[], any).joints_rad.is_empty());
    }
}
