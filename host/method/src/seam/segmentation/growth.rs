//! Surfaces grown from point to point, and what lies between them.

use super::{Grid, NEXT_VOXELS};
use crate::seam::implied;
use crate::seam::surfaces::near;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Which surface a point is of: none.
pub(super) const NONE: u32 = u32::MAX;
/// A surface turns by so much to the next point, a voxel on, at most, rad: a tube of five voxels' radius does. A sharp corner, blurred
/// over the three voxels from which normals are taken, turns by twice as much.
const TURN_RAD: f32 = 0.2;
/// Height of a point over the one beside it, voxels: half as much as voxels of noise scatter.
const HEIGHT_VOXELS: f32 = 0.6;
/// Fewer points are no surface: as of a flat face.
const LEAST_POINTS: usize = 40;

/// A cloud with its normals, by slot.
pub(super) struct Cloud<'a> {
    pub(super) index: &'a Grid,
    pub(super) normals: &'a [Vector3<f32>],
    pub(super) voxel_mm: f32,
}

impl Cloud<'_> {
    /// The nearest of the points next to one that are asked for.
    pub(super) fn nearest(&self, slot: usize, is_asked: impl Fn(usize) -> bool) -> Option<usize> {
        let nearest = self.index.nearest(&self.index.point(slot), NEXT_VOXELS * self.voxel_mm, is_asked);
        nearest.map(|(next, _)| next)
    }

    /// Surfaces of the points that are of none, numbered from `first` on; of each the slots of its points.
    pub(super) fn regions(&self, of: &mut [u32], first: u32) -> Vec<Vec<usize>> {
        let mut is_free: Vec<bool> = of.iter().map(|of| *of == NONE).collect();
        let mut regions: Vec<Vec<usize>> = Vec::new();
        for seed in 0..of.len() {
            if !std::mem::take(&mut is_free[seed]) {
                continue;
            }
            let (mut slots, mut next) = (vec![seed], 0);
            while next < slots.len() {
                let slot = slots[next];
                self.index.within(&self.index.point(slot), NEXT_VOXELS * self.voxel_mm, |other, d2| {
                    if is_free[other] && self.goes_on(slot, other, d2.sqrt()) {
                        is_free[other] = false;
                        slots.push(other);
                    }
                });
                next += 1;
            }
            if slots.len() >= LEAST_POINTS && self.is_wide(&slots) {
                slots.iter().for_each(|&slot| of[slot] = first + regions.len() as u32);
                regions.push(slots);
            }
        }
        regions
    }

    /// Whether a surface goes on from one point to another at this distance.
    fn goes_on(&self, slot: usize, other: usize, distance_mm: f32) -> bool {
        let [a, b] = [slot, other].map(|slot| self.normals[slot]);
        let apart = self.index.point(other) - self.index.point(slot);
        let turn_rad = TURN_RAD * (distance_mm / self.voxel_mm).max(1.0);
        a.dot(&b) > turn_rad.cos() && 0.5 * apart.dot(&(a + b)).abs() < HEIGHT_VOXELS * self.voxel_mm
    }

    /// Whether some points lie wider than what a camera makes of a corner or an edge: their area over how far they reach.
    pub(super) fn is_wide(&self, slots: &[usize]) -> bool {
        let points = || slots.iter().map(|&slot| self.index.point(slot));
        let first = self.index.point(slots[0]);
        let far = |from: &Point3<f32>| {
            let off = |p: &Point3<f32>| (p - from).norm_squared();
            points().max_by(|p, q| off(p).total_cmp(&off(q))).unwrap_or(first)
        };
        let end = far(&first);
        let length_mm = (far(&end) - end).norm();
        slots.len() as f32 * self.voxel_mm * self.voxel_mm > implied::gap_mm(self.voxel_mm) * length_mm
    }

    /// The slots in cells that hold points of several surfaces, or have such beside them: where points may be next to another.
    pub(super) fn mixed(&self, of: &[u32]) -> Vec<usize> {
        let cells: Vec<_> = self.index.occupied().map(|(cell, slots)| (cell.at, slots)).collect();
        let one = |slots: &Range<usize>| {
            let first = of[slots.start];
            of[slots.clone()].iter().all(|of| *of == first).then_some(first)
        };
        let mut by_place: Vec<_> = cells.iter().map(|(at, slots)| (*at, one(slots))).collect();
        by_place.sort_unstable_by_key(|(at, _)| *at);
        let is_mixed = |(at, slots): &([usize; 3], Range<usize>)| {
            let own = one(slots);
            own.is_none() || near(&by_place, *at).any(|other| *other != own)
        };
        cells.into_iter().filter(is_mixed).flat_map(|(_, slots)| slots).collect()
    }

    /// Of these slots those next to another surface, and the nearest slot of that.
    pub(super) fn beside(&self, of: &[u32], slots: &[usize]) -> Vec<(usize, usize)> {
        let next = |&slot: &usize| {
            let own = of[slot];
            let other =
                (own != NONE).then(|| self.nearest(slot, |next| of[next] != NONE && of[next] != own))?;
            Some((slot, other?))
        };
        slots.par_iter().filter_map(next).collect()
    }

    /// Gives points that are of no surface to the nearest, as far as half of what a camera may lose of a corner.
    pub(super) fn spread(&self, of: &mut Vec<u32>) {
        let rounds = (0.5 * implied::gap_mm(self.voxel_mm) / (NEXT_VOXELS * self.voxel_mm)).ceil() as usize;
        for _ in 0..rounds {
            let nearest = |slot: usize| match of[slot] {
                NONE => self.nearest(slot, |next| of[next] != NONE).map_or(NONE, |next| of[next]),
                known => known,
            };
            *of = (0..of.len()).into_par_iter().map(nearest).collect();
        }
    }
}
