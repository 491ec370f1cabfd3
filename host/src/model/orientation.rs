//! Sides of normals where no camera is known (ours; the paper's clouds come with their camera).
//!
//! A normal's side spreads from the highest point, which faces up, to its neighbours, most alike first (Hoppe et al. 1992,
//! *Surface reconstruction from unorganized points*). Around an edge the fitted normals turn gradually, so the side carries over.

use crate::geometry::grid::Grid;
use crate::geometry::grid::lanes::{LANES, eight};
use crate::model::downsampling::Voxels;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BinaryHeap;
use wide::f32x8;

/// Neighbours farther apart than this are not the same surface, voxels.
const REACH_VOXELS: f32 = 2.0;

/// The normals of a cloud, turned to one side of its surface.
pub fn propagated(voxels: &Voxels) -> Vec<Vector3<f32>> {
    let reach_mm = REACH_VOXELS * voxels.edge_mm;
    let grid = Grid::new(&voxels.cloud.points_mm, reach_mm);
    let mut by_height: Vec<usize> = (0..grid.len()).collect();
    let [.., heights] = grid.columns();
    by_height.par_sort_unstable_by(|&a, &b| heights[b].total_cmp(&heights[a]).then(a.cmp(&b)));
    let mut sides = Sides::new(&grid, &voxels.cloud.normals);
    for seed in by_height {
        if sides.likeness[seed] != DONE {
            sides.spread(seed, reach_mm);
        }
    }
    grid.by_point(&sides.normals)
}

/// More alike than any two unit vectors: the normal is turned.
const DONE: f32 = f32::INFINITY;

/// Normals by slot, on their way to one side; what is read eight at a time is padded.
struct Sides<'a> {
    grid: &'a Grid,
    normals: Vec<Vector3<f32>>,
    /// As they were given, column by column: how alike two are does not depend on their sides.
    columns: [Vec<f32>; 3],
    /// Of the likest step to each slot so far.
    likeness: Vec<f32>,
    /// Where that step begins.
    from: Vec<u32>,
    queue: Queue,
}

impl<'a> Sides<'a> {
    fn new(grid: &'a Grid, normals: &[Vector3<f32>]) -> Self {
        let normals = grid.by_slot(normals);
        let padding = [0.0; LANES - 1];
        let columns = [0, 1, 2].map(|axis| normals.iter().map(|n| n[axis]).chain(padding).collect());
        let mut likeness = vec![f32::NEG_INFINITY; grid.len()];
        likeness.extend([DONE; LANES - 1]);
        Self { grid, normals, columns, likeness, from: vec![0; grid.len()], queue: Queue::default() }
    }

    /// Turns the seed up, and what can be reached from it accordingly.
    fn spread(&mut self, seed: usize, reach_mm: f32) {
        if self.normals[seed].z < 0.0 {
            self.normals[seed] = -self.normals[seed];
        }
        self.from[seed] = seed as u32;
        self.queue.push(1.0, seed);
        while let Some(slot) = self.queue.pop() {
            if std::mem::replace(&mut self.likeness[slot], DONE) != DONE {
                if self.normals[slot].dot(&self.normals[self.from[slot] as usize]) < 0.0 {
                    self.normals[slot] = -self.normals[slot];
                }
                self.step_on(slot, reach_mm);
            }
        }
    }

    /// Steps from `slot` that are liker than those that wait; others would come too late.
    fn step_on(&mut self, slot: usize, reach_mm: f32) {
        let Self { grid, normals, columns, likeness, from, queue } = self;
        let (at, own) = (grid.point(slot), normals[slot]);
        let (place, limit) = ([at.x, at.y, at.z].map(f32x8::splat), f32x8::splat(reach_mm * reach_mm));
        grid.runs(&at, reach_mm, |run| {
            // Past the end of a run come points of other cells, judged by their distance like all, and past the last slot what
            // counts as turned.
            for first in run.step_by(LANES) {
                let [x, y, z] = columns.each_ref().map(|column| eight(column, first));
                let alike = (x * own.x + y * own.y + z * own.z).abs();
                let better = alike.simd_gt(eight(likeness, first))
                    & grid.squared_distances(first, &place).simd_lt(limit);
                let (alike, mut better) = (alike.to_array(), better.to_bitmask());
                while better != 0 {
                    let lane = better.trailing_zeros() as usize;
                    better &= better - 1;
                    (likeness[first + lane], from[first + lane]) = (alike[lane], slot as u32);
                    queue.push(alike[lane], first + lane);
                }
            }
        });
    }
}

/// Slots to step to: the likest first, and of equal ones the last slot.
///
/// A heap for each class of likeness, and so small ones: most steps wait until a liker one has been taken instead.
struct Queue {
    heaps: [BinaryHeap<u64>; CLASSES],
    /// Those before are empty.
    best: usize,
    /// In all of them.
    held: usize,
}

impl Default for Queue {
    fn default() -> Self {
        Self { heaps: [const { BinaryHeap::new() }; CLASSES], best: 0, held: 0 }
    }
}

impl Queue {
    /// `likeness` is 0 or more: the bits of such numbers are ordered as they are.
    fn push(&mut self, likeness: f32, slot: usize) {
        let class = class(likeness);
        self.heaps[class].push(u64::from(likeness.to_bits()) << 32 | slot as u64);
        self.best = self.best.min(class);
        self.held += 1;
    }

    fn pop(&mut self) -> Option<usize> {
        self.held = self.held.checked_sub(1)?;
        loop {
            if let Some(key) = self.heaps.get_mut(self.best)?.pop() {
                return Some(key as u32 as usize);
            }
            self.best += 1;
        }
    }
}

/// For no difference, eight for each halving of what is missing to 1, from 2^-24 on, and for likeness 0.
const CLASSES: usize = 1 + 8 * 24 + 1;

/// 0 for the most alike.
fn class(likeness: f32) -> usize {
    const EIGHTH: u32 = 20;
    const LEAST: u32 = (f32::EPSILON / 2.0).to_bits() >> EIGHTH;
    let missing = (1.0 - likeness).max(0.0).to_bits() >> EIGHTH;
    (missing.saturating_sub(LEAST - 1) as usize).min(CLASSES - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn steps_come_in_the_order_of_one_heap() {
        let ends = [0.0, 1e-30, 0.5, 1.0 - f32::EPSILON / 2.0, 1.0, 1.0 + f32::EPSILON, 1.0 + 1e-6];
        let (mut queue, mut heap) = (Queue::default(), BinaryHeap::new());
        let mut noise = 1u32;
        for slot in 0..20_000usize {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let apart = (noise >> 8) as f32 / (1 << 24) as f32;
            let likeness = if slot % 5 == 0 { ends[slot / 5 % ends.len()] } else { 1.0 - apart.powi(8) };
            queue.push(likeness, slot);
            heap.push((likeness.to_bits(), slot));
            // Now and then more are taken than were put, until none is left.
            for _ in 0..[0, 1, 0, 3][noise as usize >> 30] {
                assert_eq!(queue.pop(), heap.pop().map(|(_, slot)| slot));
            }
        }
        while let Some((_, slot)) = heap.pop() {
            assert_eq!(queue.pop(), Some(slot));
        }
        assert_eq!(queue.pop(), None);
    }

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
