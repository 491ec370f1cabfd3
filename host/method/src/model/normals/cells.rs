//! Sums over the points of each occupied cell, and over windows of cells.
//!
//! The points are not sorted: each finds its cell and is added to it, in the order of the cloud.

use crate::geometry::grid::rows::{Rows, SHARE};
use crate::geometry::plane::{Moments, Scatter};
use nalgebra::Point3;
use rayon::prelude::*;
use wide::f64x2;

/// Moments of the occupied cells over some points, each about its cell's centre.
pub(crate) struct Cells {
    rows: Rows,
    /// Cells from the low corner along x, y, z.
    places: Vec<[u32; 3]>,
    pub(crate) centres_mm: Vec<Point3<f32>>,
    pub(crate) moments: Vec<Moments>,
    /// Position in `moments` of each point's cell.
    pub(crate) of_point: Vec<u32>,
    /// Who adds up which cells.
    pub(crate) shares: Shares,
    /// Position in `moments` plus one, per entry of the rows; 0 where empty.
    at: Vec<u32>,
}

impl Cells {
    /// Gathers finite `points` in cells of about `cell_mm`, in the order of the cells along x, then y, then z.
    pub(crate) fn new(points: &[Point3<f32>], cell_mm: f32) -> Self {
        let (rows, _) = Rows::over(points, cell_mm);
        let mut of_point: Vec<u32> =
            points.par_iter().with_min_len(SHARE).map(|p| rows.row_and_entry(p).1).collect();
        let mut at = vec![0u32; rows.entries()];
        of_point.iter().for_each(|&entry| at[entry as usize] = 1);
        let mut places = Vec::with_capacity(at.iter().sum::<u32>() as usize);
        rows.for_each_marked(&mut at, |place| {
            places.push(place.map(|k| k as u32));
            places.len() as u32
        });
        of_point.par_iter_mut().with_min_len(SHARE).for_each(|of| *of = at[*of as usize] - 1);
        let centre = |at: &[u32; 3]| rows.centre(at.map(|k| k as usize));
        let centres_mm: Vec<Point3<f32>> = places.iter().map(centre).collect();
        let shares = Shares::new(&of_point, places.len());
        let moments = gathered(points, &of_point, &shares, &centres_mm);
        Self { rows, places, centres_mm, moments, of_point, shares, at }
    }

    /// Edge of a cell, mm; at least what was asked for.
    pub(crate) fn cell_mm(&self) -> f32 {
        self.rows.cell_mm
    }

    pub(crate) fn len(&self) -> usize {
        self.moments.len()
    }

    /// Exact centroid of a cell's points.
    pub(crate) fn centroid(&self, k: usize) -> Point3<f32> {
        self.centres_mm[k] + self.moments[k].sum / self.moments[k].count
    }

    /// Sums of the cells' own points.
    pub(crate) fn sums(&self) -> Vec<Sums> {
        let own = self.places.par_iter().zip(&self.moments);
        own.map(|(&at, own)| Sums::new(at, own, self.rows.cell_mm)).collect()
    }

    /// Visits a cell and those of its 26 neighbours `stride` cells away that are occupied.
    pub(crate) fn for_each_around(&self, k: usize, stride: usize, mut visit: impl FnMut(usize)) {
        let at = self.places[k].map(|at| at as usize);
        let steps = |k: usize| [at[k].wrapping_sub(stride), at[k], at[k] + stride];
        for z in steps(2).into_iter().filter(|&z| z < self.rows.cells[2]) {
            for y in steps(1).into_iter().filter(|&y| y < self.rows.cells[1]) {
                let (row, end) = self.rows.row(y, z);
                let entries = &self.at[row.entry as usize..end as usize];
                for x in steps(0) {
                    // Outside the row, on either side, there is no entry.
                    let found =
                        entries.get(x.wrapping_sub(row.first_x as usize)).map_or(0, |at| *at as usize);
                    if let Some(other) = found.checked_sub(1) {
                        visit(other);
                    }
                }
            }
        }
    }

    /// Adds to each cell's sums those of its 26 neighbours.
    pub(crate) fn widen(&self, sums: &[Sums]) -> Vec<Sums> {
        (0..self.len()).into_par_iter().map(|k| self.window(k, sums, 1)).collect()
    }

    /// The sums of one cell and its 26 neighbours `stride` cells away.
    pub(crate) fn window(&self, k: usize, sums: &[Sums], stride: usize) -> Sums {
        let mut window = Sums::default();
        self.for_each_around(k, stride, |other| {
            window.0.iter_mut().zip(sums[other].0).for_each(|(own, more)| *own += more);
        });
        window
    }
}

/// Consecutive cells for each thread, and which points are theirs.
pub(crate) struct Shares {
    /// Cells of a share.
    pub(crate) cells: usize,
    points: usize,
    /// By piece of the cloud and share; none where one share has all points.
    lists: Vec<Vec<Vec<u32>>>,
}

impl Shares {
    fn new(of_point: &[u32], cells: usize) -> Self {
        let shares = rayon::current_num_threads().min(of_point.len() / SHARE + 1);
        let size = cells.div_ceil(shares).max(1);
        let piece = of_point.len().div_ceil(shares).max(1);
        let lists = |(k, of_point): (usize, &[u32])| {
            let mut lists = vec![Vec::with_capacity(piece / shares + piece / 8); shares];
            let indices = k * piece..;
            indices.zip(of_point).for_each(|(i, &of)| lists[of as usize / size].push(i as u32));
            lists
        };
        let pieces = of_point.par_chunks(piece).enumerate();
        let lists = if shares > 1 { pieces.map(lists).collect() } else { Vec::new() };
        Self { cells: size, points: of_point.len(), lists }
    }

    /// Visits the points of a share in the order of the cloud.
    pub(crate) fn visit(&self, share: usize, mut visit: impl FnMut(usize)) {
        if self.lists.is_empty() {
            (0..self.points).for_each(visit);
        } else {
            self.lists.iter().flat_map(|lists| &lists[share]).for_each(|&i| visit(i as usize));
        }
    }
}

/// The moments of each cell's points about its centre, added in the order of the cloud with any number of threads.
fn gathered(
    points: &[Point3<f32>],
    of_point: &[u32],
    shares: &Shares,
    centres_mm: &[Point3<f32>],
) -> Vec<Moments> {
    let mut moments = vec![Moments::default(); centres_mm.len()];
    moments.par_chunks_mut(shares.cells).enumerate().for_each(|(k, own)| {
        let first = k * shares.cells;
        shares.visit(k, |i| {
            let of = of_point[i] as usize;
            own[of - first].add(points[i] - centres_mm[of]);
        });
    });
    moments
}

/// Count, sum and second moments of points about one origin for all cells, so that they add up term by term: 1, x y z,
/// xx xy xz yy yz zz. Double precision makes up for the distance of the origin.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums([f64x2; 5]);

impl Sums {
    /// About the middle of the grid's first cell.
    fn new(at: [u32; 3], own: &Moments, cell_mm: f32) -> Self {
        let [x, y, z] = at.map(|at| f64::from(at) * f64::from(cell_mm));
        let [n, u, v, w] = [own.count, own.sum.x, own.sum.y, own.sum.z].map(f64::from);
        let s = own.second.map(f64::from);
        let pairs = [
            [n, u + n * x],
            [v + n * y, w + n * z],
            [s[0] + 2.0 * x * u + n * x * x, s[1] + x * v + y * u + n * x * y],
            [s[2] + x * w + z * u + n * x * z, s[3] + 2.0 * y * v + n * y * y],
            [s[4] + y * w + z * v + n * y * z, s[5] + 2.0 * z * w + n * z * z],
        ];
        Self(pairs.map(f64x2::new))
    }

    /// How the points scatter about their mean, of two cells.
    pub(crate) fn scatter(two: [&Self; 2]) -> [Scatter; 2] {
        let [one, other] = two.map(Self::matrix);
        Scatter::of_two([one.0, other.0], [one.1, other.1])
    }

    /// Of how points scatter about their mean, and their number.
    fn matrix(&self) -> ([f64; 6], f32) {
        let [[n, x], [y, z], [xx, xy], [xz, yy], [yz, zz]] = self.0.map(f64x2::to_array);
        let per = 1.0 / n.max(1.0);
        let [x, y, z, xx, xy, xz, yy, yz, zz] = [x, y, z, xx, xy, xz, yy, yz, zz].map(|sum| sum * per);
        let matrix = [xx - x * x, xy - x * y, xz - x * z, yy - y * y, yz - y * z, zz - z * z];
        (matrix, n.max(1.0) as f32)
    }
}
