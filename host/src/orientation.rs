//! Sides of normals where no camera is known (ours; the paper's clouds come with their camera).
//!
//! A normal's side spreads from the highest point, which faces up, to its neighbours, most alike first (Hoppe et al. 1992,
//! *Surface reconstruction from unorganized points*). Around an edge the fitted normals turn gradually, so the side carries over.

use crate::downsampling::Voxels;
use crate::grid::Grid;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BinaryHeap;

/// Neighbours farther apart than this are not the same surface, voxels.
const REACH_VOXELS: f32 = 2.0;

/// The normals of a cloud, turned to one side of its surface.
pub fn propagated(voxels: &Voxels) -> Vec<Vector3<f32>> {
    let reach = REACH_VOXELS * voxels.edge_mm;
    let grid = Grid::new(&voxels.cloud.points_mm, reach);
    let mut normals: Vec<Vector3<f32>> =
        (0..grid.len()).map(|slot| voxels.cloud.normals[grid.index(slot)]).collect();
    let mut waiting = vec![Step { likeness: f32::NEG_INFINITY, from: 0 }; grid.len()];
    let mut by_height: Vec<usize> = (0..grid.len()).collect();
    let [.., heights] = grid.columns();
    by_height.par_sort_unstable_by(|&a, &b| heights[b].total_cmp(&heights[a]).then(a.cmp(&b)));
    let mut queue = BinaryHeap::new();
    for seed in by_height {
        if waiting[seed].likeness == DONE {
            continue;
        }
        if normals[seed].z < 0.0 {
            normals[seed] = -normals[seed];
        }
        waiting[seed].from = seed as u32;
        queue.push(key(1.0, seed));
        while let Some(to) = queue.pop().map(|key| key as u32 as usize) {
            if std::mem::replace(&mut waiting[to].likeness, DONE) == DONE {
                continue;
            }
            let own = normals[to];
            let own = if own.dot(&normals[waiting[to].from as usize]) < 0.0 { -own } else { own };
            normals[to] = own;
            grid.within(&grid.point(to), reach, |other, _| {
                let likeness = own.dot(&normals[other]).abs();
                // A step that is less alike than the one that waits would come too late.
                if likeness > waiting[other].likeness {
                    waiting[other] = Step { likeness, from: to as u32 };
                    queue.push(key(likeness, other));
                }
            });
        }
    }
    let mut turned = vec![Vector3::zeros(); grid.len()];
    normals.into_iter().enumerate().for_each(|(slot, normal)| turned[grid.index(slot)] = normal);
    turned
}

/// More alike than any two unit vectors: the normal is turned.
const DONE: f32 = f32::INFINITY;

/// The likest step to a slot so far.
#[derive(Clone, Copy)]
struct Step {
    likeness: f32,
    from: u32,
}

/// Orders the steps to slots by their likeness, 0 or more: the bits of such numbers are ordered as they are.
fn key(likeness: f32, slot: usize) -> u64 {
    u64::from(likeness.to_bits()) << 32 | slot as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

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
        let wrong = propagated(&voxels).iter().filter(|n| n.z < -0.1 || n.y > 0.1).count();
        assert_eq!(wrong, 0);
    }
}
