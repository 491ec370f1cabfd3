//! Spatial index: points sorted into cubic cells, coordinates in columns.
//!
//! A radius search reads contiguous runs of slots and allocates nothing.
//! Queries outside the indexed box are clamped to its border cells.

pub mod lanes;
mod nearest;
pub(crate) mod rows;
mod sorting;
pub mod sweep;

use crate::cancellation::go_on;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use rows::Rows;
use sorting::Sorted;
use std::ops::Range;

/// Points sorted by cell. A *slot* is a position in that order.
#[derive(Debug, Clone, Default)]
pub struct Grid {
    rows: Rows,
    /// First slot of each entry, one past the last entry at the end.
    start: Vec<u32>,
    /// Index in the input of the point at each slot.
    order: Vec<u32>,
    /// Coordinates by slot; padded, so that eight can be read from any slot on.
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

/// An occupied cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Cells from the low corner along x, y, z.
    pub at: [usize; 3],
    /// Position in the table of entries; below [`Grid::entries`].
    pub entry: usize,
}

impl Grid {
    /// Sorts `points` into cells of about `cell_mm`. Points must be finite.
    pub fn new(points: &[Point3<f32>], cell_mm: f32) -> Self {
        let (rows, shares) = Rows::over(points, cell_mm);
        let Sorted { start, order, columns: [x, y, z] } = Sorted::new(&rows, &shares);
        Self { rows, start, order, x, y, z }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Edge of a cell, mm; at least what was asked for.
    pub fn cell_mm(&self) -> f32 {
        self.rows.cell_mm
    }

    /// The point at a slot.
    pub fn point(&self, slot: usize) -> Point3<f32> {
        Point3::new(self.x[slot], self.y[slot], self.z[slot])
    }

    /// Index in the input of the point at a slot.
    pub fn index(&self, slot: usize) -> usize {
        self.order[slot] as usize
    }

    /// What is known of each point, in the order of the input, by slot.
    pub(crate) fn by_slot<T: Copy + Send + Sync>(&self, by_point: &[T]) -> Vec<T> {
        self.order.par_iter().with_min_len(rows::SHARE).map(|index| by_point[*index as usize]).collect()
    }

    /// What is known of each slot, in the order of the input.
    pub fn by_point<T: Copy>(&self, by_slot: &[T]) -> Vec<T> {
        let mut by_point = by_slot.to_vec();
        self.order.iter().zip(by_slot).for_each(|(index, value)| by_point[*index as usize] = *value);
        by_point
    }

    /// Coordinates of all slots, column by column.
    pub fn columns(&self) -> [&[f32]; 3] {
        [&self.x, &self.y, &self.z].map(|column| &column[..self.len()])
    }

    /// Number of table entries; every occupied cell has one.
    pub fn entries(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// The occupied cells and their slots, in slot order.
    pub fn occupied(&self) -> impl Iterator<Item = (Cell, Range<usize>)> + '_ {
        self.rows.all().filter_map(|(entry, at)| {
            let slots = self.start[entry] as usize..self.start[entry + 1] as usize;
            (!slots.is_empty()).then_some((Cell { at, entry }, slots))
        })
    }

    /// The slots of each entry, in slot order; of an empty one, none.
    pub fn cells(&self) -> impl IndexedParallelIterator<Item = Range<usize>> + '_ {
        self.start.par_windows(2).map(|ends| ends[0] as usize..ends[1] as usize)
    }

    /// Calls `visit` with runs of slots that hold every point within `radius_mm` of `q`, and others near it.
    #[inline]
    pub fn runs(&self, q: &Point3<f32>, radius_mm: f32, visit: impl FnMut(Range<usize>)) {
        let reach = Vector3::repeat(radius_mm);
        self.runs_between(&(q - reach), &(q + reach), visit);
    }

    /// Calls `visit` with runs of slots that hold every point of a box, and others near it.
    #[inline]
    fn runs_between(&self, low: &Point3<f32>, high: &Point3<f32>, mut visit: impl FnMut(Range<usize>)) {
        if self.is_empty() {
            return;
        }
        go_on();
        let (low, high) = (self.rows.cell(low), self.rows.cell(high));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let run = self.run(y, z, low[0], high[0]);
                if !run.is_empty() {
                    visit(run);
                }
            }
        }
    }

    /// Slots of the cells from `low_x` to `high_x` of a row.
    #[inline]
    fn run(&self, y: usize, z: usize, low_x: usize, high_x: usize) -> Range<usize> {
        let (row, end) = self.rows.row(y, z);
        let from = row.entry + (low_x as u32).saturating_sub(row.first_x);
        let to = (row.entry + (high_x as u32 + 1).saturating_sub(row.first_x)).min(end);
        if from < to { self.start[from as usize] as usize..self.start[to as usize] as usize } else { 0..0 }
    }

    /// Calls `visit(slot, squared distance)` for every point nearer than `radius_mm` to `q`.
    ///
    /// ```
    /// use nalgebra::Point3;
    /// use weldpath_method::geometry::grid::Grid;
    ///
    /// let points = [Point3::new(0.0, 0.0, 0.0), Point3::new(3.0, 0.0, 0.0), Point3::new(9.0, 0.0, 0.0)];
    /// let grid = Grid::new(&points, 4.0);
    /// let mut near = Vec::new();
    /// grid.within(&points[0], 4.0, |slot, squared_mm2| near.push((grid.index(slot), squared_mm2)));
    /// assert_eq!(near, [(0, 0.0), (1, 9.0)]);
    /// ```
    #[inline]
    pub fn within(&self, q: &Point3<f32>, radius_mm: f32, mut visit: impl FnMut(usize, f32)) {
        let limit = radius_mm * radius_mm;
        self.runs(q, radius_mm, |run| {
            for slot in run {
                let d2 = self.squared_distance(slot, q);
                if d2 < limit {
                    visit(slot, d2);
                }
            }
        });
    }

    #[inline]
    fn squared_distance(&self, slot: usize, q: &Point3<f32>) -> f32 {
        let (dx, dy, dz) = (self.x[slot] - q.x, self.y[slot] - q.y, self.z[slot] - q.z);
        dx * dx + dy * dy + dz * dz
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 8 x 8 x 8 points, 1.5 mm apart.
    pub(super) fn lattice() -> Vec<Point3<f32>> {
        let at = |i: usize| i as f32 * 1.5 - 3.0;
        (0..512).map(|i| Point3::new(at(i % 8), at(i / 8 % 8), at(i / 64))).collect()
    }

    #[test]
    fn within_finds_what_a_plain_search_finds() {
        let mut points = lattice();
        points.push(Point3::new(900.0, -400.0, 7.0));
        points.extend([points[3]; 40]);
        let grid = Grid::new(&points, 2.0);
        for q in points.iter().chain([&Point3::new(-50.0, 0.0, 0.0), &Point3::new(2.2, 2.2, 2.2)]) {
            for radius in [0.5, 2.0, 3.1, 40.0] {
                let mut found = 0;
                grid.within(q, radius, |_, _| found += 1);
                assert_eq!(
                    found,
                    points.iter().filter(|p| (*p - q).norm_squared() < radius * radius).count()
                );
            }
        }
    }

    #[test]
    fn equal_and_absent_points_are_indexed() {
        assert!(Grid::new(&[], 1.0).nearest(&Point3::origin(), 5.0, |_| true).is_none());
        let same = vec![Point3::new(1.0, 2.0, 3.0); 100];
        let mut found = 0;
        Grid::new(&same, 1.0).within(&same[0], 0.1, |_, _| found += 1);
        assert_eq!(found, 100);
    }
}
