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
pub(crate) const SHARE: usize = 1 << 14;

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
struct CellAt {
    row: u32,
    x: u32,
}

/// The occupied part of a row and its points.
#[derive(Clone, Copy)]
struct Span {
    first_x: u32,
    end_x: u32,
    points: u32,
}

impl Span {
    const NONE: Self = Self { first_x: u32::MAX, end_x: 0, points: 0 };

    fn add(&mut self, x: u32) {
        *self = self.with(&Self { first_x: x, end_x: x + 1, points: 1 });
    }

    fn with(&self, other: &Self) -> Self {
        Self {
            first_x: self.first_x.min(other.first_x),
            end_x: self.end_x.max(other.end_x),
            points: self.points + other.points,
        }
    }
}

/// A share of the points, for one thread, and how many of them lie in each row.
pub(crate) struct Share<'a> {
    /// Index in the cloud of the first of them.
    pub(crate) first: u32,
    pub(crate) points: &'a [Point3<f32>],
    pub(crate) in_row: Vec<u32>,
}

impl Rows {
    /// Lays rows of cells of about `cell_mm` over `points`, which must be finite.
    pub(crate) fn over(points: &[Point3<f32>], cell_mm: f32) -> (Self, Vec<Share<'_>>) {
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
                let shares = rows.lay(points);
                if rows.entries() <= budget {
                    return (rows, shares);
                }
            }
            cell_mm *= 1.5;
        }
    }

    /// Finds the extent of each row.
    fn lay<'a>(&mut self, points: &'a [Point3<f32>]) -> Vec<Share<'a>> {
        let rows = self.cells[1] * self.cells[2];
        // A share has tables of its own, so it should not be smaller than these.
        let share = points.len().div_ceil(rayon::current_num_threads()).max(SHARE).max(2 * rows);
        let of_share = |points: &'a [Point3<f32>]| {
            let mut spans = vec![Span::NONE; rows];
            points.iter().map(|p| self.cell_at(p)).for_each(|at| spans[at.row as usize].add(at.x));
            spans
        };
        let shares: Vec<(_, Vec<Span>)> =
            points.par_chunks(share).map(|points| (points, of_share(points))).collect();
        self.rows = Vec::with_capacity(rows + 1);
        let mut entry = 0;
        for row in 0..rows {
            let span = shares.iter().fold(Span::NONE, |span, (_, spans)| span.with(&spans[row]));
            self.rows.push(Row { first_x: span.first_x, entry });
            entry = entry.saturating_add(span.end_x.saturating_sub(span.first_x));
        }
        self.rows.push(Row { first_x: 0, entry });
        let counted = |(k, (points, spans)): (usize, (_, Vec<Span>))| Share {
            first: (k * share) as u32,
            points,
            in_row: spans.iter().map(|span| span.points).collect(),
        };
        shares.into_iter().enumerate().map(counted).collect()
    }

    /// Number of table entries.
    pub(crate) fn entries(&self) -> usize {
        self.rows.last().map_or(0, |end| end.entry as usize)
    }

    /// Row of an indexed point's cell, and entry of the cell.
    #[inline]
    pub(crate) fn row_and_entry(&self, p: &Point3<f32>) -> (usize, u32) {
        let at = self.cell_at(p);
        let row = self.rows[at.row as usize];
        (at.row as usize, row.entry + (at.x - row.first_x))
    }

    /// Where the entries of each row begin.
    pub(crate) fn begins(&self) -> impl Iterator<Item = u32> + '_ {
        self.rows.windows(2).map(|row| row[0].entry)
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
    let lanes = |p: &Point3<f32>| f32x4::new([p.x, p.y, p.z, 0.0]);
    let none = (f32x4::splat(f32::MAX), f32x4::splat(f32::MIN));
    let both = |a: (f32x4, f32x4), b: (f32x4, f32x4)| (a.0.fast_min(b.0), a.1.fast_max(b.1));
    let of = |share: &[Point3<f32>]| {
        // Two at a time, as each must wait for the one before it.
        let (pairs, last) = share.as_chunks::<2>();
        let ends = last.iter().map(lanes).fold(none, |ends, p| both(ends, (p, p)));
        let [even, odd] = pairs
            .iter()
            .fold([ends; 2], |ends, pair| [0, 1].map(|k| both(ends[k], (lanes(&pair[k]), lanes(&pair[k])))));
        both(even, odd)
    };
    let (low, high) = points.par_chunks(SHARE).map(of).reduce(|| none, both);
    let ([x, y, z, _], [u, v, w, _]) = (low.to_array(), high.to_array());
    ([x, y, z], [u, v, w])
}
