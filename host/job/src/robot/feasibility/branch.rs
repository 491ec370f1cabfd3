//! One continuous motion of the joints along a sequence of poses: the least motion over all branches of the inverse
//! kinematics, by dynamic programming.

use super::arm::{Arm, Joints, Limits};
use nalgebra::Isometry3;
use std::f64::consts::{PI, TAU};

/// Between two poses that are close a joint that turns more than this has changed its branch, rad.
pub(super) const JUMP_RAD: f64 = 0.35;
/// What a change of branch, or a joint beyond its limits, costs beside the motion itself, rad².
const FAULT: f64 = 1e4;

/// A way for the joints, one entry per pose.
#[derive(Debug, Clone, Default)]
pub(super) struct Way {
    /// None where no branch reaches the pose. Continuous through whole turns.
    pub joints_rad: Vec<Option<Joints>>,
    /// Largest step of a joint from the pose before, rad; 0 at the first and after a gap.
    pub step_rad: Vec<f64>,
}

/// One solution of the inverse kinematics at one pose.
struct Node {
    joints_rad: Joints,
    /// Of the best way here, and the node before it.
    cost: f64,
    from: Option<usize>,
}

/// The way with the fewest faults and, among those, the least motion.
///
/// Whole turns are settled at the end: each joint's way is shifted to where it stays farthest from its limits.
pub(super) fn follow(arm: &Arm, base_from_flange: &[Isometry3<f64>]) -> Way {
    let layers = layers(arm, base_from_flange);
    let Some(last) = layers.iter().rposition(|layer| !layer.is_empty()) else {
        return Way { joints_rad: vec![None; layers.len()], step_rad: vec![0.0; layers.len()] };
    };
    let ways = (0..layers[last].len()).map(|end| settled(&arm.limits, unwound(&layers, last, end)));
    let judged = ways.enumerate().map(|(end, way)| (faults(&arm.limits, &way), layers[last][end].cost, way));
    judged.min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))).map(|(_, _, way)| way).unwrap_or_default()
}

fn layers(arm: &Arm, base_from_flange: &[Isometry3<f64>]) -> Vec<Vec<Node>> {
    let mut layers: Vec<Vec<Node>> = Vec::with_capacity(base_from_flange.len());
    let mut previous: Option<usize> = None;
    for (i, pose) in base_from_flange.iter().enumerate() {
        let before: &[Node] = previous.map_or(&[], |k| &layers[k]);
        let adjoins = previous.is_some_and(|k| k + 1 == i);
        let node = |joints_rad: Joints| {
            let (cost, from) = cheapest(before, &joints_rad, adjoins);
            Node { joints_rad, cost: cost + beyond(&arm.limits, &joints_rad) * FAULT, from }
        };
        let layer: Vec<Node> = arm.inverse(pose).into_iter().map(node).collect();
        if !layer.is_empty() {
            previous = Some(i);
        }
        layers.push(layer);
    }
    layers
}

/// The cheapest way to these joints; after a gap the motion itself counts for nothing.
fn cheapest(before: &[Node], joints_rad: &Joints, adjoins: bool) -> (f64, Option<usize>) {
    let costs = before.iter().enumerate().map(|(k, node)| {
        let step = if adjoins { motion(&node.joints_rad, joints_rad) } else { 0.0 };
        (node.cost + step, Some(k))
    });
    costs.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, None))
}

fn motion(from: &Joints, to: &Joints) -> f64 {
    let steps = (0..6).map(|j| shortest(to[j] - from[j]));
    let (sum, largest) =
        steps.fold((0.0, 0f64), |(sum, most), step| (sum + step * step, most.max(step.abs())));
    sum + if largest > JUMP_RAD { FAULT } else { 0.0 }
}

/// Joints that no whole turn brings within their limits.
fn beyond(limits: &Limits, joints_rad: &Joints) -> f64 {
    (0..6).filter(|&j| limits.margin_rad(j, limits.centred(j, joints_rad[j])) < 0.0).count() as f64
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
fn faults(limits: &Limits, way: &Way) -> usize {
    let broken = |joints: &Joints| (0..6).any(|j| limits.margin_rad(j, joints[j]) < 0.0);
    way.joints_rad.iter().flatten().filter(|joints| broken(joints)).count()
        + way.step_rad.iter().filter(|step| **step > JUMP_RAD).count()
}

#[cfg(test)]
mod tests {
    use super::super::arm::by_name;
    use super::*;

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
        let way = follow(&arm, &poses);
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
        let way = follow(&arm, &poses);
        let last: Vec<f64> = way.joints_rad.iter().map(|q| q.unwrap()[5]).collect();
        assert!(last.windows(2).all(|w| (w[1] - w[0]).abs() < 0.1));
        assert!((last[0] - last[120]).abs() > 9.0);
        assert!(last.iter().all(|q| q.abs() <= TAU), "{} {}", last[0], last[120]);
    }

    #[test]
    fn two_poses_that_no_single_branch_joins_are_a_jump() {
        let arm = by_name("ur5e").unwrap();
        let here = arm.forward(&[0.2, -1.4, 1.6, -0.5, 1.1, 0.3]);
        let there = arm.forward(&[1.2, -1.4, 1.6, -0.5, 1.1, 0.3]);
        let way = follow(&arm, &[here, there]);
        assert!(way.step_rad[1] > JUMP_RAD);
    }

    #[test]
    fn a_pose_out_of_reach_is_a_gap_and_the_others_keep_their_joints() {
        let arm = by_name("ur5e").unwrap();
        let (_, mut poses) =
            line(&arm, &[0.2, -1.4, 1.6, -0.5, 1.1, 0.3], &[0.3, -1.4, 1.6, -0.5, 1.1, 0.3], 4);
        poses[2].translation.vector.x += 5000.0;
        let way = follow(&arm, &poses);
        let reached: Vec<bool> = way.joints_rad.iter().map(Option::is_some).collect();
        assert_eq!(reached, [true, true, false, true, true]);
        poses.iter_mut().for_each(|pose| pose.translation.vector.x += 5000.0);
        assert!(follow(&arm, &poses).joints_rad.iter().all(Option::is_none));
        assert!(follow(&arm, &[]).joints_rad.is_empty());
    }
}
