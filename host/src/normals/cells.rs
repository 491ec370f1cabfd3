//! Sums over the points of each occupied cell, and over windows of cells.
//!
//! The points are not sorted: each finds its cell and is added to it, in the order of the cloud.

use super::{Moments, Scatter};
use crate::grid::rows::Rows;
use nalgebra::Point3;
use rayon::prelude::*;
use wide::f64x2;

/// Points that a thread takes at a time.
const SHARE: usize = 1 << 14;

/// Moments of the occupied cells over some points, each about its cell's centre.
pub(crate) struct Cells {
    rows: Rows,
    /// Cells from the low corner along x, y, z.
    places: Vec<[u32; 3]>,
    pub(crate) centres_mm: Vec<Point3<f32>>,
    pub(crate) moments: Vec<Moments>,
    /// Position in `moments` of each point's cell.
    pub(crate) of_point: Vec<u32>,
    /// Position in `moments` plus one, per entry of the rows; 0 where empty.
    at: Vec<u32>,
}

impl Cells {
    /// Gathers finite `points` in cells of about `cell_mm`, in the order of the cells along x, then y, then z.
    pub(crate) fn new(points: &[Point3<f32>], cell_mm: f32) -> Self {
        let (rows, cells) = Rows::over(points, cell_mm);
        let mut of_point: Vec<u32> =
            cells.par_iter().with_min_len(SHARE).map(|cell| rows.entry_of(cell) as u32).collect();
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
        let moments = gathered(points, &of_point, &centres_mm);
        Self { rows, places, centres_mm, moments, of_point, at }
    }

    /// Edge of a cell, mm; at least what was asked for.
    pub(crate) fn cell_mm(&self) -> f32 {
        self.rows.cell_mm
    }

    pub(crate) fn len(&self) -> usize {
        self.moments.len()
    }

    /// Exact centroid of each cell's points.
    pub(crate) fn centroids(&self) -> Vec<Point3<f32>> {
        let own = self.centres_mm.iter().zip(&self.moments);
        own.map(|(centre, own)| centre + own.sum / own.count).collect()
    }

    /// Sums of the cells' own points.
    pub(crate) fn sums(&self) -> Vec<Sums> {
        let own = self.places.par_iter().zip(&self.moments);
        own.map(|(&at, own)| Sums::new(at, own, self.rows.cell_mm)).collect()
    }

    /// Adds to each cell's sums those of its 26 neighbours `stride` cells away.
    pub(crate) fn widen(&self, sums: &[Sums], stride: usize) -> Vec<Sums> {
        (0..self.len()).into_par_iter().map(|k| self.window(k, sums, stride)).collect()
    }

    /// The sums of one cell and its 26 neighbours `stride` cells away.
    pub(crate) fn window(&self, k: usize, sums: &[Sums], stride: usize) -> Sums {
        let at = self.places[k].map(|at| at as usize);
        let steps = |k: usize| [at[k].wrapping_sub(stride), at[k], at[k] + stride];
        let mut window = [f64x2::ZERO; 5];
        for z in steps(2).into_iter().filter(|&z| z < self.rows.cells[2]) {
            for y in steps(1).into_iter().filter(|&y| y < self.rows.cells[1]) {
                let (row, end) = self.rows.row(y, z);
                let entries = &self.at[row.entry as usize..end as usize];
                for x in steps(0) {
                    // Outside the row, on either side, there is no entry.
                    let found =
                        entries.get(x.wrapping_sub(row.first_x as usize)).map_or(0, |at| *at as usize);
                    if let Some(other) = sums.get(found.wrapping_sub(1)) {
                        let pairs = other.0.as_chunks().0.iter();
                        window.iter_mut().zip(pairs).for_each(|(own, more)| *own += f64x2::new(*more));
                    }
                }
            }
        }
        let mut sums = Sums::default();
        let pairs = sums.0.as_chunks_mut().0.iter_mut();
        pairs.zip(window).for_each(|(own, pair)| *own = pair.to_array());
        sums
    }
}

/// The moments of each cell's points about its centre.
///
/// A thread takes a range of cells and passes over all points, so that each cell's are added in the order of the cloud
/// with any number of threads.
fn gathered(points: &[Point3<f32>], of_point: &[u32], centres_mm: &[Point3<f32>]) -> Vec<Moments> {
    let mut moments = vec![Moments::default(); centres_mm.len()];
    let share = centres_mm.len().div_ceil(rayon::current_num_threads()).max(SHARE / 4);
    moments.par_chunks_mut(share).enumerate().for_each(|(k, own)| {
        let first = k * share;
        for (&of, p) in of_point.iter().zip(points) {
            let of = of as usize;
            if let Some(moments) = own.get_mut(of.wrapping_sub(first)) {
                moments.add(p - centres_mm[of]);
            }
        }
    });
    moments
}

/// Count, sum and second moments of points about one origin for all cells, so that they add up term by term: 1, x y z,
/// xx xy xz yy yz zz. Double precision makes up for the distance of the origin.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sums([f64; 10]);

impl Sums {
    /// About the middle of the grid's first cell.
    fn new(at: [u32; 3], own: &Moments, cell_mm: f32) -> Self {
        let [x, y, z] = at.map(|at| f64::from(at) * f64::from(cell_mm));
        let [n, u, v, w] = [own.count, own.sum.x, own.sum.y, own.sum.z].map(f64::from);
        let s = own.second.map(f64::from);
        Self([
            n,
            u + n * x,
            v + n * y,
            w + n * z,
            s[0] + 2.0 * x * u + n * x * x,
            s[1] + x * v + y * u + n * x * y,
            s[2] + x * w + z * u + n * x * z,
            s[3] + 2.0 * y * v + n * y * y,
            s[4] + y * w + z * v + n * y * z,
            s[5] + 2.0 * z * w + n * z * z,
        ])
    }

    /// How the points scatter about their mean.
    pub(crate) fn scatter(&self) -> Scatter {
        let [n, x, y, z, s @ ..] = self.0;
        let per = 1.0 / n.max(1.0);
        let [x, y, z] = [x, y, z].map(|sum| sum * per);
        let [xx, xy, xz, yy, yz, zz] = s.map(|sum| sum * per);
        let matrix = [xx - x * x, xy - x * y, xz - x * z, yy - y * y, yz - y * z, zz - z * z];
        Scatter::new(matrix, n.max(1.0) as f32)
    }
}
