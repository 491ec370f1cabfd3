//! Spatial index: points sorted into cubic cells, coordinates in columns.
//!
//! Built by a counting sort in two passes; a radius search reads contiguous runs of slots and allocates nothing.
//! Queries outside the indexed box are clamped to its border cells.

use nalgebra::{Point3, Vector3};
use std::ops::Range;

/// Table entries per point at most; beyond that the cells grow.
const MAX_ENTRIES_PER_POINT: usize = 8;
/// Table entries that are always affordable.
const MIN_ENTRIES: usize = 1 << 20;

/// Points sorted by cell. A *slot* is a position in that order.
///
/// Cells lie in rows along x. A row keeps entries only between its first and last occupied cell, so a surface, which
/// crosses each row in a few places, takes little memory, and so do far outliers.
#[derive(Debug, Clone, Default)]
pub struct Grid {
    low_mm: [f32; 3],
    cell_mm: f32,
    per_mm: f32,
    cells: [usize; 3],
    /// Per row: x of its first entry, and where its entries begin; one past the last row at the end.
    rows: Vec<Row>,
    /// First slot of each entry, one past the last entry at the end.
    start: Vec<u32>,
    /// Index in the input of the point at each slot.
    order: Vec<u32>,
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

#[derive(Debug, Clone, Copy)]
struct Row {
    first_x: u32,
    entry: u32,
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
        let (low_mm, high_mm) = bounds(points);
        let budget = (points.len() * MAX_ENTRIES_PER_POINT).max(MIN_ENTRIES);
        let mut cell_mm = cell_mm.max(f32::MIN_POSITIVE);
        loop {
            let cells =
                [0, 1, 2].map(|k| (f64::from(high_mm[k] - low_mm[k]) / f64::from(cell_mm)) as usize + 1);
            if cells[0] < u32::MAX as usize && cells[1].saturating_mul(cells[2]) <= budget {
                let mut grid = Self { low_mm, cell_mm, per_mm: 1.0 / cell_mm, cells, ..Self::default() };
                let entries = grid.lay_out_rows(points);
                if entries <= budget {
                    grid.sort(points, entries);
                    return grid;
                }
            }
            cell_mm *= 1.5;
        }
    }

    /// Finds the extent of each row; returns the number of entries.
    fn lay_out_rows(&mut self, points: &[Point3<f32>]) -> usize {
        let rows = self.cells[1] * self.cells[2];
        let mut span = vec![(u32::MAX, 0u32); rows];
        for p in points {
            let [x, y, z] = self.cell(p);
            let s = &mut span[z * self.cells[1] + y];
            *s = (s.0.min(x as u32), s.1.max(x as u32 + 1));
        }
        self.rows.reserve(rows + 1);
        let mut entry = 0usize;
        for (first_x, end_x) in span {
            self.rows.push(Row { first_x, entry: entry as u32 });
            entry += end_x.saturating_sub(first_x) as usize;
        }
        self.rows.push(Row { first_x: 0, entry: entry as u32 });
        entry
    }

    fn sort(&mut self, points: &[Point3<f32>], entries: usize) {
        let entry_of: Vec<u32> = points
            .iter()
            .map(|p| {
                let [x, y, z] = self.cell(p);
                let row = self.rows[z * self.cells[1] + y];
                row.entry + (x as u32 - row.first_x)
            })
            .collect();
        self.start = vec![0; entries + 1];
        for &e in &entry_of {
            self.start[e as usize + 1] += 1;
        }
        for e in 1..self.start.len() {
            self.start[e] += self.start[e - 1];
        }
        let mut next = self.start.clone();
        self.order = vec![0; points.len()];
        for column in [&mut self.x, &mut self.y, &mut self.z] {
            column.resize(points.len(), 0.0);
        }
        for (i, (p, &e)) in points.iter().zip(&entry_of).enumerate() {
            let slot = next[e as usize] as usize;
            next[e as usize] += 1;
            (self.order[slot], self.x[slot], self.y[slot], self.z[slot]) = (i as u32, p.x, p.y, p.z);
        }
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
        self.cell_mm
    }

    /// The point at a slot.
    pub fn point(&self, slot: usize) -> Point3<f32> {
        Point3::new(self.x[slot], self.y[slot], self.z[slot])
    }

    /// Index in the input of the point at a slot.
    pub fn index(&self, slot: usize) -> usize {
        self.order[slot] as usize
    }

    /// Coordinates of all slots, column by column.
    pub fn columns(&self) -> [&[f32]; 3] {
        [&self.x, &self.y, &self.z]
    }

    /// Number of table entries; every occupied cell has one.
    pub fn entries(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// The occupied cells and their slots, in slot order.
    pub fn occupied(&self) -> impl Iterator<Item = (Cell, Range<usize>)> + '_ {
        let ny = self.cells[1];
        self.rows.windows(2).enumerate().flat_map(move |(row, w)| {
            (w[0].entry..w[1].entry).filter_map(move |entry| {
                let e = entry as usize;
                let slots = self.start[e] as usize..self.start[e + 1] as usize;
                let x = (w[0].first_x + entry - w[0].entry) as usize;
                (!slots.is_empty()).then_some((Cell { at: [x, row % ny, row / ny], entry: e }, slots))
            })
        })
    }

    /// The entries of the row of cells along x at `y`, `z`, and the x of the first of them.
    #[inline]
    pub fn row(&self, y: usize, z: usize) -> (usize, Range<usize>) {
        let row = z * self.cells[1] + y;
        let (first, end) = (self.rows[row], self.rows[row + 1].entry);
        (first.first_x as usize, first.entry as usize..end as usize)
    }

    /// Centre of a cell, mm.
    pub fn centre(&self, cell: Cell) -> Point3<f32> {
        Point3::from([0, 1, 2].map(|k| self.low_mm[k] + (cell.at[k] as f32 + 0.5) * self.cell_mm))
    }

    /// Number of cells along x, y, z.
    pub fn cells(&self) -> [usize; 3] {
        self.cells
    }

    fn cell(&self, p: &Point3<f32>) -> [usize; 3] {
        // A negative float becomes 0 in the conversion, so both ends are clamped.
        [0, 1, 2].map(|k| (((p[k] - self.low_mm[k]) * self.per_mm) as usize).min(self.cells[k] - 1))
    }

    /// Calls `visit` with runs of slots that hold every point within `radius_mm` of `q`, and others near it.
    #[inline]
    pub fn runs(&self, q: &Point3<f32>, radius_mm: f32, mut visit: impl FnMut(Range<usize>)) {
        if self.is_empty() {
            return;
        }
        let reach = Vector3::repeat(radius_mm);
        let (low, high) = (self.cell(&(q - reach)), self.cell(&(q + reach)));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let row = z * self.cells[1] + y;
                let (row, end) = (self.rows[row], self.rows[row + 1].entry);
                let from = row.entry + (low[0] as u32).saturating_sub(row.first_x);
                let to = (row.entry + (high[0] as u32 + 1).saturating_sub(row.first_x)).min(end);
                if from < to {
                    visit(self.start[from as usize] as usize..self.start[to as usize] as usize);
                }
            }
        }
    }

    /// Calls `visit(slot, squared distance)` for every point nearer than `radius_mm` to `q`.
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

    /// The nearest point to `q` that `accept`s, nearer than `radius_mm`: its slot and squared distance.
    #[inline]
    pub fn nearest(
        &self,
        q: &Point3<f32>,
        radius_mm: f32,
        mut accept: impl FnMut(usize) -> bool,
    ) -> Option<(usize, f32)> {
        let (mut best, mut best_d2) = (None, radius_mm * radius_mm);
        let mut reach = self.cell_mm.min(radius_mm);
        loop {
            self.runs(q, reach, |run| {
                for slot in run {
                    let d2 = self.squared_distance(slot, q);
                    if d2 < best_d2 && accept(slot) {
                        (best, best_d2) = (Some(slot), d2);
                    }
                }
            });
            if best_d2 <= reach * reach || reach >= radius_mm {
                return best.map(|slot| (slot, best_d2));
            }
            reach = (reach * 2.0).min(radius_mm);
        }
    }

    /// The nearest accepted point within `radius_mm`, as [`Grid::nearest`], and a distance within which there is no other.
    #[inline]
    pub fn nearest_alone(
        &self,
        q: &Point3<f32>,
        radius_mm: f32,
        mut accept: impl FnMut(usize) -> bool,
    ) -> (Option<(usize, f32)>, f32) {
        let limit = radius_mm * radius_mm;
        let mut reach = self.cell_mm.min(radius_mm);
        loop {
            // Counted anew with each reach, else the nearest would be met twice and become its own second.
            let (mut best, mut best_d2, mut second_d2) = (None, limit, limit);
            self.runs(q, reach, |run| {
                for slot in run {
                    let d2 = self.squared_distance(slot, q);
                    if d2 < second_d2 && accept(slot) {
                        if d2 < best_d2 {
                            (best, second_d2, best_d2) = (Some(slot), best_d2, d2);
                        } else {
                            second_d2 = d2;
                        }
                    }
                }
            });
            if best_d2 <= reach * reach || reach >= radius_mm {
                return (best.map(|slot| (slot, best_d2)), second_d2.sqrt().min(reach));
            }
            reach = (reach * 2.0).min(radius_mm);
        }
    }

    #[inline]
    fn squared_distance(&self, slot: usize, q: &Point3<f32>) -> f32 {
        let (dx, dy, dz) = (self.x[slot] - q.x, self.y[slot] - q.y, self.z[slot] - q.z);
        dx * dx + dy * dy + dz * dz
    }
}

/// Lowest and highest coordinate on each axis; the origin for no points.
fn bounds(points: &[Point3<f32>]) -> ([f32; 3], [f32; 3]) {
    let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
    for p in points {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    if points.is_empty() { ([0.0; 3], [0.0; 3]) } else { (low, high) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lattice() -> Vec<Point3<f32>> {
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
    fn equal_and_absent_points_are_indexed() {
        assert!(Grid::new(&[], 1.0).nearest(&Point3::origin(), 5.0, |_| true).is_none());
        let same = vec![Point3::new(1.0, 2.0, 3.0); 100];
        let mut found = 0;
        Grid::new(&same, 1.0).within(&same[0], 0.1, |_, _| found += 1);
        assert_eq!(found, 100);
    }
}
