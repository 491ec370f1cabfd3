//! Sums over the points of each occupied cell, and over windows of cells.
//!
//! The points are not sorted: each finds its cell and is added to it, in the order of the cloud.

use super::{Moments, Scatter};
use crate::grid::rows::Rows;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

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
        let moments = gathered(points, &of_point, &rows, places.len());
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

    /// Sums of a cell's own points.
    pub(crate) fn sums(&self, k: usize) -> Sums {
        Sums::new(self.places[k], &self.moments[k], self.rows.cell_mm)
    }

    /// Adds up to threes, `stride` apart, what `sums` says of each cell: the first step of a window. `threes` are made anew.
    pub(crate) fn add_threes(&self, stride: usize, sums: impl Fn(usize) -> Sums, threes: &mut Threes) {
        threes.clear(stride);
        for (first, end) in self.rows.spans() {
            let own = &self.at[first as usize..end as usize];
            // A row's threes begin `stride` cells before its first cell.
            let reach = if own.is_empty() { 0 } else { own.len() + 2 * stride };
            for place in 0..reach {
                let three = [Some(place), place.checked_sub(stride), place.checked_sub(2 * stride)];
                let cells = three.into_iter().flatten().filter_map(|x| own.get(x).filter(|cell| **cell > 0));
                let sum = cells.fold(None, |sum: Option<Sums>, &cell| {
                    let more = sums(cell as usize - 1);
                    Some(sum.map_or(more, |sum| sum.plus(&more)))
                });
                threes.at.push(if sum.is_some() { threes.sums.len() as u32 } else { 0 });
                threes.sums.extend(sum);
            }
            threes.start.push(threes.at.len() as u32);
        }
    }

    /// The sums of one cell and its 26 neighbours at the threes' stride: nine threes.
    pub(crate) fn window(&self, k: usize, threes: &Threes) -> Sums {
        let ([x, y, z], stride) = (self.places[k].map(|at| at as usize), threes.stride);
        let steps = |at: usize, cells: usize| {
            let high = Some(at + stride).filter(|&at| at < cells);
            [at.checked_sub(stride), Some(at), high].into_iter().flatten()
        };
        let mut window = Sums::default();
        for z in steps(z, self.rows.cells[2]) {
            for y in steps(y, self.rows.cells[1]) {
                let row = z * self.rows.cells[1] + y;
                let found = &threes.at[threes.start[row] as usize..threes.start[row + 1] as usize];
                let place = (x + stride).wrapping_sub(self.rows.row(y, z).0.first_x as usize);
                // The first of the threes holds nothing: no branch is cheaper than a wrong guess.
                let three = found.get(place).map_or(0, |at| *at as usize);
                window = window.plus(&threes.sums[three]);
            }
        }
        window
    }
}

/// Sums over three cells of a row each, wherever one of the three is occupied.
#[derive(Default)]
pub(crate) struct Threes {
    stride: usize,
    /// Where each row begins in `at`, and the end.
    start: Vec<u32>,
    /// Position in `sums` of the three about a place; 0 where there is none.
    at: Vec<u32>,
    sums: Vec<Sums>,
}

impl Threes {
    /// Keeps the memory, and nothing else but the sum that holds nothing.
    fn clear(&mut self, stride: usize) {
        self.stride = stride;
        self.start.clear();
        self.start.push(0);
        self.at.clear();
        self.sums.clear();
        self.sums.push(Sums::default());
    }
}

/// The moments of each cell's points about its centre.
///
/// A thread takes a range of cells and passes over all points, so that each cell's are added in the order of the cloud
/// with any number of threads.
fn gathered(points: &[Point3<f32>], of_point: &[u32], rows: &Rows, cells: usize) -> Vec<Moments> {
    let mut moments = vec![Moments::default(); cells];
    let share = cells.div_ceil(rayon::current_num_threads()).max(SHARE / 4);
    moments.par_chunks_mut(share).enumerate().for_each(|(k, own)| {
        let first = k * share;
        for (&of, p) in of_point.iter().zip(points) {
            if let Some(moments) = own.get_mut((of as usize).wrapping_sub(first)) {
                moments.add(rows.offset_in_cell(p));
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

    #[inline]
    fn plus(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }

    /// How the points scatter about their mean.
    pub(crate) fn scatter(&self) -> Scatter {
        Scatter::new(&self.covariance(), self.0[0].max(1.0) as f32)
    }

    /// Unit normal of the plane fitted to the points, given their scatter.
    pub(crate) fn normal(&self, scatter: &Scatter) -> Vector3<f32> {
        scatter.normal(&self.covariance())
    }

    /// xx xy xz yy yz zz
    fn covariance(&self) -> [f64; 6] {
        let [n, x, y, z, s @ ..] = self.0;
        let per = 1.0 / n.max(1.0);
        let [x, y, z] = [x, y, z].map(|sum| sum * per);
        let [xx, xy, xz, yy, yz, zz] = s.map(|sum| sum * per);
        [xx - x * x, xy - x * y, xz - x * z, yy - y * y, yz - y * z, zz - z * z]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: usize) -> f32 {
        ((seed as f32 * 12.9898).sin() * 43_758.547).fract()
    }

    fn points() -> Vec<Point3<f32>> {
        (0..3000)
            .map(|k| Point3::new(40.0 * noise(3 * k), 25.0 * noise(3 * k + 1), 3.0 * noise(3 * k + 2)))
            .collect()
    }

    #[test]
    fn the_sums_of_a_cell_give_the_mean_of_its_points() {
        let points = points();
        let cells = Cells::new(&points, 2.0);
        let mut means = vec![(Vector3::zeros(), 0.0); cells.len()];
        for (p, &of) in points.iter().zip(&cells.of_point) {
            assert!((p - cells.centres_mm[of as usize]).amax() <= 1.0 + 1e-4);
            let (sum, count) = means[of as usize];
            means[of as usize] = (sum + p.coords, count + 1.0);
        }
        for (k, (sum, count)) in means.into_iter().enumerate() {
            let own = &cells.moments[k];
            assert_eq!(own.count, count);
            assert!((cells.centres_mm[k].coords + own.sum / count - sum / count).norm() < 1e-4);
        }
    }

    #[test]
    fn a_window_holds_the_points_of_27_cells_at_its_stride() {
        let points = points();
        let cells = Cells::new(&points, 2.0);
        for stride in [1, 2] {
            let mut threes = Threes::default();
            cells.add_threes(stride, |k| cells.sums(k), &mut threes);
            for k in 0..cells.len() {
                let apart = |j: usize, axis: usize| cells.places[j][axis].abs_diff(cells.places[k][axis]);
                let inside = |j: &usize| (0..3).all(|axis| [0, stride as u32].contains(&apart(*j, axis)));
                let count: f32 = (0..cells.len()).filter(inside).map(|j| cells.moments[j].count).sum();
                assert_eq!(cells.window(k, &threes).0[0] as f32, count, "cell {k}");
            }
        }
    }
}
