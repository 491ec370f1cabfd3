//! Nearest points in a [`Grid`]: row by row, eight slots at a time.
//!
//! The stretch of row about the place in question is searched first: it usually holds the nearest point, whose distance then
//! bounds the ball that must be searched, and rules out most of its rows.

use super::Grid;
use super::lanes::{LANES, eight};
use crate::cancellation::go_on;
use nalgebra::{Point3, Vector3};
use std::ops::Range;
use wide::f32x8;

/// A little more than 1: what a square root may lose.
const ROUNDED_UP: f32 = 1.000_001;

impl Grid {
    /// The nearest point to `q` that `accept`s, nearer than `radius_mm`: its slot and squared distance.
    /// Of several at the same distance, the one with the least slot.
    #[inline]
    pub fn nearest(
        &self,
        q: &Point3<f32>,
        radius_mm: f32,
        accept: impl FnMut(usize) -> bool,
    ) -> Option<(usize, f32)> {
        let mut search = Search::<_, false>::new(self, q, radius_mm, accept);
        search.outward(radius_mm);
        search.found()
    }

    /// The nearest accepted point within `radius_mm`, as [`Grid::nearest`], and a distance within which there is no other.
    #[inline]
    pub(crate) fn nearest_alone(
        &self,
        q: &Point3<f32>,
        radius_mm: f32,
        accept: impl FnMut(usize) -> bool,
    ) -> (Option<(usize, f32)>, f32) {
        let mut search = Search::<_, true>::new(self, q, radius_mm, accept);
        let reach_mm = search.outward(radius_mm);
        (search.found(), search.second_d2.sqrt().min(reach_mm))
    }

    /// Whether any point is nearer than `radius_mm` to `q`.
    #[inline]
    pub fn is_near(&self, q: &Point3<f32>, radius_mm: f32) -> bool {
        let mut search = Search::<_, false>::new(self, q, radius_mm, |_| true);
        if !self.is_empty() {
            search.own_stretch();
        }
        search.slot.is_some() || {
            search.outward(radius_mm);
            search.slot.is_some()
        }
    }

    /// Squared distances of eight slots from `q`; those beyond the last are of no point.
    #[inline(always)]
    pub(crate) fn squared_distances(&self, slot: usize, [x, y, z]: &[f32x8; 3]) -> f32x8 {
        let [dx, dy, dz] = [eight(&self.x, slot) - *x, eight(&self.y, slot) - *y, eight(&self.z, slot) - *z];
        dx * dx + dy * dy + dz * dz
    }
}

/// A search for the nearest point and, where `SECOND`, for how far the next one is.
struct Search<'a, F, const SECOND: bool> {
    grid: &'a Grid,
    q: &'a Point3<f32>,
    lanes: [f32x8; 3],
    accept: F,
    slot: Option<usize>,
    /// Of the nearest and of the second, or the bound.
    d2: f32,
    second_d2: f32,
}

impl<'a, F: FnMut(usize) -> bool, const SECOND: bool> Search<'a, F, SECOND> {
    #[inline]
    fn new(grid: &'a Grid, q: &'a Point3<f32>, radius_mm: f32, accept: F) -> Self {
        let (lanes, limit) = ([q.x, q.y, q.z].map(f32x8::splat), radius_mm * radius_mm);
        Self { grid, q, lanes, accept, slot: None, d2: limit, second_d2: limit }
    }

    fn found(&self) -> Option<(usize, f32)> {
        self.slot.map(|slot| (slot, self.d2))
    }

    /// Squared distance beyond which nothing is asked for.
    #[inline(always)]
    fn bound(&self) -> f32 {
        if SECOND { self.second_d2 } else { self.d2 }
    }

    /// Searches ever larger balls, up to `radius_mm`, until one holds the nearest; the radius of the last.
    #[inline]
    fn outward(&mut self, radius_mm: f32) -> f32 {
        if self.grid.is_empty() {
            return radius_mm;
        }
        go_on();
        self.own_stretch();
        let mut reach = self.grid.cell_mm().min(radius_mm);
        loop {
            if self.slot.is_some() {
                // Far enough for what has been found; for a second point, not beyond a cell.
                let least = ROUNDED_UP * self.d2.sqrt();
                reach = if SECOND { least.max(reach.min(ROUNDED_UP * self.second_d2.sqrt())) } else { least };
            }
            self.ball(reach);
            if self.d2 <= reach * reach || reach >= radius_mm {
                return reach;
            }
            reach = (reach * 2.0).min(radius_mm);
        }
    }

    /// The cells before, about and after the place in its own row: the likeliest to hold the nearest point.
    #[inline]
    fn own_stretch(&mut self) {
        let [x, y, z] = self.grid.rows.cell(self.q);
        self.scan(self.grid.run(y, z, x.saturating_sub(1), x + 1));
    }

    /// Scans what may be nearer than both `reach` and the bound.
    #[inline]
    fn ball(&mut self, reach: f32) {
        let (near, rows) = (Vector3::repeat(reach), &self.grid.rows);
        let (low, high) = (rows.cell(&(self.q - near)), rows.cell(&(self.q + near)));
        for z in low[2]..=high[2] {
            let dz = rows.gap_mm(self.q, 2, z);
            for y in low[1]..=high[1] {
                let dy = rows.gap_mm(self.q, 1, y);
                if dy * dy + dz * dz <= self.bound() {
                    self.scan(self.grid.run(y, z, low[0], high[0]));
                }
            }
        }
    }

    #[inline]
    fn scan(&mut self, run: Range<usize>) {
        for from in run.clone().step_by(LANES) {
            let d2 = self.grid.squared_distances(from, &self.lanes);
            let mut near = d2.simd_le(f32x8::splat(self.bound())).to_bitmask();
            if run.end - from < LANES {
                near &= (1 << (run.end - from)) - 1;
            }
            if near != 0 {
                self.consider(from, near, &d2.to_array());
            }
        }
    }

    /// Takes the slots of `near`, a bit each from slot `from` on, that are nearer than what was found before.
    ///
    /// A slot may come again, and must not become its own second.
    #[inline]
    fn consider(&mut self, from: usize, mut near: u32, d2: &[f32; LANES]) {
        while near != 0 {
            let lane = near.trailing_zeros() as usize;
            near &= near - 1;
            let (slot, d2) = (from + lane, d2[lane % LANES]);
            let nearer = d2 < self.d2 || (d2 == self.d2 && self.slot.is_some_and(|best| slot < best));
            if self.slot == Some(slot) || !(nearer || SECOND && d2 < self.second_d2) || !(self.accept)(slot) {
                continue;
            }
            if nearer {
                (self.slot, self.d2, self.second_d2) = (Some(slot), d2, self.d2);
            } else {
                self.second_d2 = d2;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::lattice;
    use super::*;

    #[test]
    fn nearest_is_the_nearest_accepted() {
        let points = lattice();
        let grid = Grid::new(&points, 2.0);
        let q = Point3::new(0.4, 1.9, -2.2);
        let odd = |i: usize| i % 2 == 1;
        let (slot, d2) = grid.nearest(&q, 20.0, |slot| odd(grid.index(slot))).expect("there is one");
        let expected = (0..points.len()).filter(|&i| odd(i)).map(|i| (points[i] - q).norm_squared());
        assert_eq!(d2, expected.fold(f32::MAX, f32::min));
        assert!(odd(grid.index(slot)));
        assert!(grid.nearest(&q, 0.1, |_| true).is_none());
    }

    #[test]
    fn no_other_point_is_within_the_distance_beside_the_nearest() {
        let points = lattice();
        let grid = Grid::new(&points, 2.0);
        for q in [Point3::new(0.4, 1.9, -2.2), Point3::new(-9.0, 3.1, 4.4), Point3::new(1.5, 0.1, 0.7)] {
            for radius in [0.3, 1.6, 7.0, 20.0] {
                let (found, alone) = grid.nearest_alone(&q, radius, |_| true);
                assert_eq!(found, grid.nearest(&q, radius, |_| true));
                let own = found.map(|(slot, _)| grid.index(slot));
                let others = (0..points.len()).filter(|&i| Some(i) != own);
                let next = others.map(|i| (points[i] - q).norm()).fold(f32::MAX, f32::min);
                assert!(alone <= next && alone <= radius, "{alone} {next}");
                assert!(found.is_none_or(|(_, d2)| d2.sqrt() <= alone));
            }
        }
    }

    #[test]
    fn a_place_is_near_where_a_point_is_within_the_radius() {
        let points = lattice();
        let grid = Grid::new(&points, 2.0);
        for i in 0..1000 {
            let q = Point3::new(0.02, 0.03, 0.017) * (i as f32 - 400.0);
            for radius in [0.4, 1.1, 6.0] {
                let near = points.iter().any(|p| (p - q).norm_squared() < radius * radius);
                assert_eq!(grid.is_near(&q, radius), near, "{q} {radius}");
            }
        }
        assert!(!Grid::new(&[], 1.0).is_near(&Point3::origin(), 9.0));
    }
}
