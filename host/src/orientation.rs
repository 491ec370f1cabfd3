//! Sides of normals where no camera is known (ours; the paper's clouds come with their camera).
//!
//! A normal's side spreads from the highest point, which faces up, to its neighbours, most alike first (Hoppe et al. 1992,
//! *Surface reconstruction from unorganized points*). Around an edge the fitted normals turn gradually, so the side carries over.

use crate::downsampling::Voxels;
use crate::grid::Grid;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Neighbours farther apart than this are not the same surface, voxels.
const REACH_VOXELS: f32 = 2.0;

/// Turns the normals of a cloud to one side of its surface.
pub fn propagate(voxels: &mut Voxels) {
    let reach = REACH_VOXELS * voxels.edge_mm;
    let points = &voxels.cloud.points_mm;
    let grid = Grid::new(points, reach);
    let mut done = vec![false; points.len()];
    let mut by_height: Vec<usize> = (0..points.len()).collect();
    by_height.sort_unstable_by(|&a, &b| points[b].z.total_cmp(&points[a].z));
    let normals = &mut voxels.cloud.normals;
    for seed in by_height {
        if done[seed] {
            continue;
        }
        if normals[seed].z < 0.0 {
            normals[seed] = -normals[seed];
        }
        let mut queue = BinaryHeap::from([Step { likeness: 1.0, from: seed, to: seed }]);
        while let Some(step) = queue.pop() {
            if std::mem::replace(&mut done[step.to], true) {
                continue;
            }
            if normals[step.to].dot(&normals[step.from]) < 0.0 {
                normals[step.to] = -normals[step.to];
            }
            let own = normals[step.to];
            grid.within(&points[step.to], reach, |slot, _| {
                let to = grid.index(slot);
                if !done[to] {
                    queue.push(Step { likeness: own.dot(&normals[to]).abs(), from: step.to, to });
                }
            });
        }
    }
    voxels.toward_camera.clone_from(&voxels.cloud.normals);
}

struct Step {
    likeness: f32,
    from: usize,
    to: usize,
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Step {}

impl PartialOrd for Step {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Step {
    fn cmp(&self, other: &Self) -> Ordering {
        self.likeness.total_cmp(&other.likeness)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn the_faces_of_a_step_get_their_air_side() {
        // A floor, a riser and a tread, 1 mm lattice; normals of random sign, blended at the edges as fits blend them.
        let mut voxels = Voxels { edge_mm: 1.0, ..Voxels::default() };
        let slope = |d: f32| (d / 2.0).clamp(0.0, 1.0);
        for i in 0..30 {
            for j in 0..20 {
                let (x, t) = (i as f32, j as f32);
                let floor = (Point3::new(x, -t, 0.0), Vector3::new(0.0, -(1.0 - slope(t)), 1.0));
                let riser_turn = Vector3::new(0.0, -1.0, (1.0 - slope(t)) + (1.0 - slope(19.0 - t)));
                let riser = (Point3::new(x, 0.0, t), riser_turn);
                let tread = (Point3::new(x, t, 19.0), Vector3::new(0.0, -(1.0 - slope(t)), 1.0));
                for (p, n) in [floor, riser, tread] {
                    let sign = if (i * 7 + j * 13) % 3 == 0 { 1.0 } else { -1.0 };
                    voxels.cloud.points_mm.push(p);
                    voxels.cloud.normals.push(n.normalize() * sign);
                }
            }
        }
        propagate(&mut voxels);
        let wrong = voxels.cloud.normals.iter().filter(|n| n.z < -0.1 || n.y > 0.1).count();
        assert_eq!(wrong, 0);
    }
}
