//! The neighbourhoods of all points of a [`Grid`], cell by cell.
//!
//! The points of a cell share the points around it: these are gathered once, column by column, and padded to whole
//! lanes, eight numbers at a time. A kernel then runs over them without a test for ends. Each point's sums depend on its
//! cell alone, so the result is the same with any number of threads.

use super::Grid;
use super::lanes::LANES;
use crate::cancellation::go_on;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::ops::Range;
use wide::f32x8;

/// Where the padding lies, mm: near to nothing, and its square is finite.
const FAR_MM: f32 = 1e15;
/// Slots that a thread takes at a time.
const SHARE: usize = 2048;

/// The points around a cell in whole lanes.
#[derive(Debug, Clone)]
pub struct Around<const C: usize> {
    runs: Vec<Range<usize>>,
    place: [Vec<f32>; 3],
    columns: [Vec<f32>; C],
}

/// Eight points of those around; some may be beyond the radius.
#[derive(Debug, Clone, Copy)]
pub struct Eight<const C: usize> {
    /// Offsets from the point in question along x, y, z, mm.
    pub offset: [f32x8; 3],
    /// Squared distances from it, mm².
    pub d2: f32x8,
    /// The columns that were asked for; 0 in the padding.
    pub columns: [f32x8; C],
}

impl<const C: usize> Eight<C> {
    /// How many of the eight are nearer than `radius_mm`.
    #[inline(always)]
    pub fn inside(&self, radius_mm: f32) -> u32 {
        self.d2.simd_lt(f32x8::splat(radius_mm * radius_mm)).to_bitmask().count_ones()
    }
}

impl<const C: usize> Around<C> {
    fn empty() -> Self {
        Self { runs: Vec::new(), place: [const { Vec::new() }; 3], columns: [const { Vec::new() }; C] }
    }

    fn gather(&mut self, grid: &Grid, own: Range<usize>, radius_mm: f32, columns: &[&[f32]; C]) {
        let (low, high) = grid.box_of(own);
        let reach = Vector3::repeat(radius_mm);
        self.runs.clear();
        grid.runs_between(&(low - reach), &(high + reach), |run| self.runs.push(run));
        for (to, from) in self.place.iter_mut().zip(grid.columns()) {
            fill(to, from, &self.runs, FAR_MM);
        }
        for (to, from) in self.columns.iter_mut().zip(columns) {
            fill(to, from, &self.runs, 0.0);
        }
    }

    /// The points as seen from `q`, eight at a time.
    #[inline(always)]
    pub fn from(&self, q: Point3<f32>) -> impl Iterator<Item = Eight<C>> {
        let [x, y, z] = self.place.each_ref().map(|column| column.as_chunks::<LANES>().0);
        let columns = self.columns.each_ref().map(|column| column.as_chunks::<LANES>().0);
        x.iter().zip(y).zip(z).enumerate().map(move |(k, ((x, y), z))| {
            let offset = [f32x8::new(*x) - q.x, f32x8::new(*y) - q.y, f32x8::new(*z) - q.z];
            let d2 = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
            Eight { offset, d2, columns: columns.map(|c| f32x8::new(c[k])) }
        })
    }
}

fn fill(to: &mut Vec<f32>, from: &[f32], runs: &[Range<usize>], padding: f32) {
    to.clear();
    for run in runs {
        to.extend_from_slice(&from[run.clone()]);
    }
    to.resize(to.len().next_multiple_of(LANES), padding);
}

impl Grid {
    /// What `kernel` makes of each slot and the points around it, in slot order.
    ///
    /// Among those around are all points nearer than `radius_mm`, the point itself included; `columns` hold further
    /// numbers per slot. Fastest where the edge of a cell is about the radius.
    pub fn sweep<T: Clone + Default + Send, const C: usize>(
        &self,
        radius_mm: f32,
        columns: [&[f32]; C],
        kernel: impl Fn(usize, &Around<C>) -> T + Sync,
    ) -> Vec<T> {
        let mut made = vec![T::default(); self.len()];
        self.shares(&mut made).into_par_iter().for_each_init(Around::empty, |around, (entries, made)| {
            let first = self.start[entries.start] as usize;
            for entry in entries {
                let own = self.start[entry] as usize..self.start[entry + 1] as usize;
                if !own.is_empty() {
                    go_on();
                    around.gather(self, own.clone(), radius_mm, &columns);
                    own.for_each(|slot| made[slot - first] = kernel(slot, around));
                }
            }
        });
        made
    }

    /// Cuts the entries, and what is made of their slots, into shares of about [`SHARE`] slots.
    fn shares<'a, T>(&self, made: &'a mut [T]) -> Vec<(Range<usize>, &'a mut [T])> {
        let mut shares = Vec::new();
        let (mut rest, mut from) = (made, 0);
        while from < self.entries() {
            let first = self.start[from];
            let full = first.saturating_add(SHARE as u32);
            let to = (from + self.start[from..].partition_point(|&slot| slot <= full))
                .min(self.entries())
                .max(from + 1);
            let (mine, others) = rest.split_at_mut((self.start[to] - first) as usize);
            shares.push((from..to, mine));
            (rest, from) = (others, to);
        }
        shares
    }

    /// Lowest and highest coordinates of some slots.
    fn box_of(&self, slots: Range<usize>) -> (Point3<f32>, Point3<f32>) {
        let span = |column: &[f32]| {
            let lesser = |a: f32, b: f32| if b < a { b } else { a };
            let greater = |a: f32, b: f32| if b > a { b } else { a };
            column.iter().fold((f32::MAX, f32::MIN), |(low, high), &v| (lesser(low, v), greater(high, v)))
        };
        let [x, y, z] = self.columns().map(|column| span(&column[slots.clone()]));
        (Point3::new(x.0, y.0, z.0), Point3::new(x.1, y.1, z.1))
    }
}
