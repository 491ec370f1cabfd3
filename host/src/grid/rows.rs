//! Where the cells of a grid lie and which of them keep an entry in its tables.
//!
//! Cells lie in rows along x. A row keeps entries only between its first and last occupied cell, so a surface, which
//! crosses each row in a few places, takes little memory, and so do far outliers.

use nalgebra::Point3;
use rayon::prelude::*;
use wide::f32x4;

/// Table entries per point at most; beyond that the cells grow.
const MAX_ENTRIES_PER_POINT: usize = 8;
/// Table entries that are always affordable.
const MIN_ENTRIES: usize = 1 << 20;
/// Points that a thread takes at a time.
const SHARE: usize = 1 << 14;

/// Rows of cubic cells over the box of some points.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rows {
    pub(crate) low_mm: [f32; 3],
    pub(crate) cell_mm: f32,
    per_mm: f32,
    /// Farthest that a point may lie beside its cell by rounding, mm.
    slack_mm: f32,
    /// Number of cells along x, y, z.
    pub(crate) cells: [usize; 3],
    /// One per row, and one past the last.
    rows: Vec<Row>,
}

/// x of a row's first entry, and where its entries begin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) first_x: u32,
    pub(crate) entry: u32,
}

/// The cell of a point: its row and its x.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CellAt {
    pub(crate) row: u32,
    pub(crate) x: u32,
}

impl Rows {
    /// Lays rows of cells of about `cell_mm` over `points`, which must be finite, and finds the cell of each.
    pub(crate) fn over(points: &[Point3<f32>], cell_mm: f32) -> (Self, Vec<CellAt>) {
        let (low_mm, high_mm) = bounds(points);
        let budget = (points.len() * MAX_ENTRIES_PER_POINT).max(MIN_ENTRIES);
        let farthest = (0..3).map(|k| low_mm[k].abs().max(high_mm[k].abs())).fold(0.0, f32::max);
        let mut cell_mm = cell_mm.max(f32::MIN_POSITIVE);
        loop {
            let cells =
                [0, 1, 2].map(|k| (f64::from(high_mm[k] - low_mm[k]) / f64::from(cell_mm)) as usize + 1);
            if cells[0] < i32::MAX as usize && cells[1].saturating_mul(cells[2]) <= budget {
                let slack_mm = 8.0 * f32::EPSILON * (farthest + cell_mm);
                let mut rows =
                    Self { low_mm, cell_mm, per_mm: 1.0 / cell_mm, slack_mm, cells, rows: Vec::new() };
                let at: Vec<CellAt> =
                    points.par_iter().with_min_len(SHARE).map(|p| rows.cell_at(p)).collect();
                rows.lay(&at);
                if rows.entries() <= budget {
                    return (rows, at);
                }
            }
            cell_mm *= 1.5;
        }
    }

    /// Finds the extent of each row.
    fn lay(&mut self, at: &[CellAt]) {
        let rows = self.cells[1] * self.cells[2];
        // A share has a table of its own, so it should not be smaller than that.
        let share = at.len().div_ceil(rayon::current_num_threads()).max(SHARE).max(2 * rows);
        let wider = |s: (u32, u32), t: (u32, u32)| (s.0.min(t.0), s.1.max(t.1));
        let nothing = || vec![(u32::MAX, 0u32); rows];
        let of_share = |at: &[CellAt]| {
            let mut span = nothing();
            at.iter().for_each(|at| {
                let s = &mut span[at.row as usize];
                *s = wider(*s, (at.x, at.x + 1));
            });
            span
        };
        let both = |mut span: Vec<_>, other: Vec<_>| {
            span.iter_mut().zip(other).for_each(|(s, t)| *s = wider(*s, t));
            span
        };
        let span = at.par_chunks(share).map(of_share).reduce_with(both).unwrap_or_else(nothing);
        self.rows.reserve_exact(rows + 1);
        let mut entry = 0;
        for (first_x, end_x) in span {
            self.rows.push(Row { first_x, entry });
            entry = entry.saturating_add(end_x.saturating_sub(first_x));
        }
        self.rows.push(Row { first_x: 0, entry });
    }

    /// Number of table entries.
    pub(crate) fn entries(&self) -> usize {
        self.rows.last().map_or(0, |end| end.entry as usize)
    }

    /// The entry of a point's cell.
    #[inline]
    pub(crate) fn entry_of(&self, at: &CellAt) -> usize {
        let row = self.rows[at.row as usize];
        (row.entry + (at.x - row.first_x)) as usize
    }

    /// A row, and where its entries end.
    #[inline]
    pub(crate) fn row(&self, y: usize, z: usize) -> (Row, u32) {
        let row = z * self.cells[1] + y;
        (self.rows[row], self.rows[row + 1].entry)
    }

    /// Entries and places of all cells that have one, in order.
    pub(crate) fn all(&self) -> impl Iterator<Item = (usize, [usize; 3])> + '_ {
        let ny = self.cells[1];
        self.rows.windows(2).enumerate().flat_map(move |(row, w)| {
            (w[0].entry..w[1].entry).map(move |entry| {
                let x = (w[0].first_x + entry - w[0].entry) as usize;
                (entry as usize, [x, row % ny, row / ny])
            })
        })
    }

    /// Passes over a table with a number per entry, and replaces those that are not 0 by what `number` makes of the cell's place.
    pub(crate) fn for_each_marked(&self, table: &mut [u32], mut number: impl FnMut([usize; 3]) -> u32) {
        let ny = self.cells[1];
        for (row, w) in self.rows.windows(2).enumerate() {
            let (y, z) = (row % ny, row / ny);
            let entries = &mut table[w[0].entry as usize..w[1].entry as usize];
            for (x, marked) in entries.iter_mut().enumerate().filter(|(_, mark)| **mark > 0) {
                *marked = number([w[0].first_x as usize + x, y, z]);
            }
        }
    }

    /// Centre of a cell, mm.
    #[inline]
    pub(crate) fn centre(&self, at: [usize; 3]) -> Point3<f32> {
        Point3::from([0, 1, 2].map(|k| self.low_mm[k] + (at[k] as f32 + 0.5) * self.cell_mm))
    }

    /// The cell of a place; outside the box, the border cell.
    #[inline]
    pub(crate) fn cell(&self, p: &Point3<f32>) -> [usize; 3] {
        let [x, y, z] = self.low_mm;
        let from_low = f32x4::new([p.x, p.y, p.z, 0.0]) - f32x4::new([x, y, z, 0.0]);
        // What is too large for the conversion becomes a large number or, read as unsigned, 2^31.
        let at = (from_low * self.per_mm).fast_max(f32x4::ZERO).fast_trunc_int().to_array();
        [0, 1, 2].map(|k| (at[k] as u32 as usize).min(self.cells[k] - 1))
    }

    fn cell_at(&self, p: &Point3<f32>) -> CellAt {
        let [x, y, z] = self.cell(p);
        CellAt { row: (z * self.cells[1] + y) as u32, x: x as u32 }
    }

    /// Distance of `q` from the slab of cells `at` along an axis, mm, or a little less: points are put into cells in
    /// single precision, and some lie beside theirs by a rounding error. Beyond the box, the border cells go on.
    #[inline]
    pub(crate) fn gap_mm(&self, q: &Point3<f32>, axis: usize, at: usize) -> f32 {
        let low = self.low_mm[axis] + at as f32 * self.cell_mm;
        (low - q[axis]).max(q[axis] - (low + self.cell_mm)).max(self.slack_mm) - self.slack_mm
    }
}

/// Lowest and highest coordinate on each axis; the origin for no points.
pub(crate) fn bounds(points: &[Point3<f32>]) -> ([f32; 3], [f32; 3]) {
    if points.is_empty() {
        return ([0.0; 3], [0.0; 3]);
    }
    // Written so that it compiles to single instructions: the coordinates are finite.
    let lesser = |a: f32, b: f32| if b < a { b } else { a };
    let greater = |a: f32, b: f32| if b > a { b } else { a };
    let of = |share: &[Point3<f32>]| {
        share.iter().fold(([f32::MAX; 3], [f32::MIN; 3]), |(low, high), p| {
            ([0, 1, 2].map(|k| lesser(low[k], p[k])), [0, 1, 2].map(|k| greater(high[k], p[k])))
        })
    };
    let both = |(l, h): ([f32; 3], [f32; 3]), (m, i): ([f32; 3], [f32; 3])| {
        ([0, 1, 2].map(|k| lesser(l[k], m[k])), [0, 1, 2].map(|k| greater(h[k], i[k])))
    };
    points.par_chunks(SHARE).map(of).reduce(|| ([f32::MAX; 3], [f32::MIN; 3]), both)
}
