//! Depths that a camera rounds to coarse steps, put back between them (ours).
//!
//! Rounding lays the points of a face on sheets across the line of sight. The error is alike along a line of equal depth, so
//! it does not average out along a seam that runs that way: 1 mm steps turn a face by degrees. What was rounded is known,
//! though: the depth was nearer to this step than to the next. Within that, a pixel is put on the plane through the pixels
//! about it (over a picture the inverse depth of a plane is linear), of nine windows beside it the one that a plane fits
//! best, so that none is laid across an edge (Nagao, Matsuyama, "Edge preserving smoothing", 1979).

use std::ops::Range;

use rayon::prelude::*;

use crate::geometry::statistics::median;

/// Pixels from the middle of a window to its side: over nine rows the steps of a slanted face average out, and a face that
/// fills no such window is too small to be put right.
const HALF: usize = 4;
/// Share of a window that has to hold depths.
const LEAST_SHARE: f64 = 0.6;
/// How many times better, in variance, a window beside the pixel has to fit than the one about it: half of windows that are as
/// good fit better by chance, by less than this.
const BETTER: f32 = 1.3;
/// Steps of depth on either side among which the usual one is found: not every depth occurs.
const BESIDE: usize = 4;
/// Noise of this second difference, steps: rounding alone makes up to 1. Where more than half are no larger, rounding is a fifth
/// of the variance or more.
const COARSE_STEPS: f32 = 1.5;
/// A determinant of a window's spread below this, in pixels to the fourth, is of a line.
const LEAST_SPREAD: f64 = 1e-6;

/// Marks of no reading are 0 and this.
const SATURATED: u16 = u16::MAX;

/// Rows that are put right together: the planes of a few more are found for each such block.
const BLOCK_ROWS: usize = 32;

/// Depths of an image in counts, row by row, between their steps where these are coarse, else as they are; 0 where there is
/// no reading.
pub(super) fn restored(counts: &[u16], width: usize) -> Vec<f32> {
    let depth = |count: u16| if count == SATURATED { 0.0 } else { f32::from(count) };
    match Steps::of(counts).filter(|steps| steps.are_coarse(counts, width)) {
        None => counts.iter().map(|&count| depth(count)).collect(),
        Some(steps) => {
            let image = Image { counts, width, height: counts.len() / width, steps };
            let blocks = (0..image.height).into_par_iter().step_by(BLOCK_ROWS);
            blocks.flat_map_iter(|row| image.block(row..(row + BLOCK_ROWS).min(image.height))).collect()
        }
    }
}

/// A depth image whose steps are coarse.
struct Image<'a> {
    counts: &'a [u16],
    width: usize,
    height: usize,
    steps: Steps,
}

impl Image<'_> {
    fn depth(&self, at: usize) -> Option<f32> {
        (1..SATURATED).contains(&self.counts[at]).then(|| f32::from(self.counts[at]))
    }

    /// Some rows, put right.
    fn block(&self, rows: Range<usize>) -> Vec<f32> {
        let around = rows.start.saturating_sub(HALF)..(rows.end + HALF).min(self.height);
        let fits: Vec<Fit> = around.clone().flat_map(|row| self.fits(row)).collect();
        let fit = |row: usize, column: usize, [down, right]: [isize; 2]| {
            let row = row.checked_add_signed(down).filter(|row| around.contains(row))?;
            let column = column.checked_add_signed(right).filter(|column| *column < self.width)?;
            Some(&fits[(row - around.start) * self.width + column])
        };
        let pixel = |row: usize, column: usize| {
            let Some(depth) = self.depth(row * self.width + column) else { return 0.0 };
            let (mut least, mut inverse) = (f32::INFINITY, 0.0);
            for beside in BESIDES {
                let Some(fit) = fit(row, column, beside) else { continue };
                let miss = fit.variance * if beside == [0, 0] { 1.0 } else { BETTER };
                if miss < least {
                    (least, inverse) = (miss, fit.at(beside.map(|far| -far as f32)));
                }
            }
            let half = 0.5 * self.steps.about(depth as u16);
            if inverse > 0.0 { (1.0 / inverse).clamp(depth - half, depth + half) } else { depth }
        };
        rows.flat_map(|row| (0..self.width).map(move |column| (row, column)))
            .map(|(row, column)| pixel(row, column))
            .collect()
    }

    /// The planes through the windows about the pixels of a row.
    fn fits(&self, row: usize) -> impl Iterator<Item = Fit> + use<> {
        let width = self.width;
        let mut columns = vec![Sums::default(); width];
        for r in row.saturating_sub(HALF)..(row + HALF + 1).min(self.height) {
            let v = r as f64 - row as f64;
            for (column, sums) in columns.iter_mut().enumerate() {
                if let Some(depth) = self.depth(r * width + column) {
                    sums.add(v, 1.0 / f64::from(depth));
                }
            }
        }
        (0..width).map(move |column| {
            let mut sums = Sums::default();
            let from = column.saturating_sub(HALF);
            for (c, sum) in (from..).zip(&columns[from..(column + HALF + 1).min(width)]) {
                sums.add_column(sum, c as f64 - column as f64);
            }
            sums.fit()
        })
    }
}

/// Middles of the nine windows of a pixel, the one about it first: rows and columns from it.
const BESIDES: [[isize; 2]; 9] = {
    let far = HALF as isize;
    [[0, 0], [far, 0], [-far, 0], [0, far], [0, -far], [far, far], [-far, far], [far, -far], [-far, -far]]
};

/// The counts that occur in an image, and how far apart they are.
struct Steps {
    used: Vec<u16>,
    /// From each to the next, as usual about there.
    apart: Vec<f32>,
}

impl Steps {
    /// None where there are too few to tell.
    fn of(counts: &[u16]) -> Option<Self> {
        let mut occurs = vec![false; usize::from(SATURATED) + 1];
        counts.iter().for_each(|&count| occurs[usize::from(count)] = true);
        let used: Vec<u16> = (1..SATURATED).filter(|&count| occurs[usize::from(count)]).collect();
        let gaps: Vec<u16> = used.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let usual = |at: usize| {
            let mut near = gaps[at.saturating_sub(BESIDE)..(at + BESIDE + 1).min(gaps.len())].to_vec();
            f32::from(median(&mut near))
        };
        let apart: Vec<f32> = (0..gaps.len()).map(usual).collect();
        (apart.len() > 2 * BESIDE).then_some(Self { used, apart })
    }

    /// The step about a count.
    fn about(&self, count: u16) -> f32 {
        self.apart[self.used.partition_point(|&used| used < count).min(self.apart.len() - 1)]
    }

    /// Whether neighbouring pixels differ by little more than rounding makes them.
    fn are_coarse(&self, counts: &[u16], width: usize) -> bool {
        let is_reading = |count: &u16| (1..SATURATED).contains(count);
        let (mut all, mut few) = (0_usize, 0_usize);
        for row in counts.chunks_exact(width) {
            for three in row.windows(3).filter(|three| three.iter().all(is_reading)) {
                let [a, b, c] = [0, 1, 2].map(|k| f32::from(three[k]));
                all += 1;
                few += usize::from((a - 2.0 * b + c).abs() < COARSE_STEPS * self.about(three[1]));
            }
        }
        2 * few > all
    }
}

/// The plane through the window about a pixel: its inverse depth in the middle, and by how much that grows from row to row
/// and from column to column.
#[derive(Clone, Copy)]
struct Fit {
    middle: f32,
    down: f32,
    right: f32,
    /// Of what it misses; infinite where there is no plane.
    variance: f32,
}

impl Fit {
    fn at(&self, [down, right]: [f32; 2]) -> f32 {
        self.middle + down * self.down + right * self.right
    }
}

/// Sums over the pixels of a window: their number, places, inverse depths, and products of these.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: f64,
    u: f64,
    v: f64,
    uu: f64,
    uv: f64,
    vv: f64,
    w: f64,
    uw: f64,
    vw: f64,
    ww: f64,
}

impl Sums {
    /// One more pixel, `v` rows below the middle.
    fn add(&mut self, v: f64, w: f64) {
        self.n += 1.0;
        self.v += v;
        self.vv += v * v;
        self.w += w;
        self.vw += v * w;
        self.ww += w * w;
    }

    /// A column of pixels, `u` columns to the right of the middle.
    fn add_column(&mut self, column: &Self, u: f64) {
        self.n += column.n;
        self.u += u * column.n;
        self.v += column.v;
        self.uu += u * u * column.n;
        self.uv += u * column.v;
        self.vv += column.vv;
        self.w += column.w;
        self.uw += u * column.w;
        self.vw += column.vw;
        self.ww += column.ww;
    }

    fn fit(&self) -> Fit {
        let side = (2 * HALF + 1) as f64;
        let none = Fit { middle: 0.0, down: 0.0, right: 0.0, variance: f32::INFINITY };
        if self.n < LEAST_SHARE * side * side {
            return none;
        }
        let [u, v, w] = [self.u, self.v, self.w].map(|sum| sum / self.n);
        let spread = |sum: f64, a: f64, b: f64| sum / self.n - a * b;
        let (uu, uv, vv) = (spread(self.uu, u, u), spread(self.uv, u, v), spread(self.vv, v, v));
        let (uw, vw, ww) = (spread(self.uw, u, w), spread(self.vw, v, w), spread(self.ww, w, w));
        let determinant = uu * vv - uv * uv;
        if determinant < LEAST_SPREAD {
            return none;
        }
        let (right, down) = ((uw * vv - vw * uv) / determinant, (vw * uu - uw * uv) / determinant);
        Fit {
            middle: (w - right * u - down * v) as f32,
            down: down as f32,
            right: right as f32,
            variance: (ww - right * uw - down * vw).max(0.0) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 80;
    const HEIGHT: usize = 60;

    /// Depths of an image by row and column, rounded to steps of so many counts.
    fn image(step: f64, depth: impl Fn(f64, f64) -> f64) -> (Vec<u16>, Vec<f64>) {
        let exact: Vec<f64> =
            (0..WIDTH * HEIGHT).map(|at| depth((at / WIDTH) as f64, (at % WIDTH) as f64)).collect();
        (exact.iter().map(|depth| ((depth / step).round() * step) as u16).collect(), exact)
    }

    /// Root mean square of what depths miss, away from the rim.
    fn miss(depths: &[f32], exact: &[f64]) -> f64 {
        let inner =
            |at: &usize| (8..HEIGHT - 8).contains(&(at / WIDTH)) && (8..WIDTH - 8).contains(&(at % WIDTH));
        let misses: Vec<f64> =
            (0..exact.len()).filter(inner).map(|at| f64::from(depths[at]) - exact[at]).collect();
        crate::geometry::statistics::rms(&misses).unwrap()
    }

    #[test]
    fn a_slanted_plane_is_put_back_between_its_steps() {
        for step in [1.0, 10.0] {
            // Inverse depth is linear over the picture.
            let (counts, exact) = image(step, |row, _| 1.0 / (1.0 / (450.0 * step) + row * 3.7e-6 / step));
            let rounded: Vec<f32> = counts.iter().map(|&count| f32::from(count)).collect();
            let (before, after) = (miss(&rounded, &exact), miss(&restored(&counts, WIDTH), &exact));
            assert!(before > 0.25 * step && after < 0.12 * step, "{step}: {before} -> {after}");
        }
    }

    #[test]
    fn an_edge_stays_where_it_is_and_no_pixel_leaves_its_step() {
        let roof = |_: f64, column: f64| 400.0 + 0.83 * (column - 40.0).abs();
        let (counts, exact) = image(1.0, roof);
        let depths = restored(&counts, WIDTH);
        assert!(depths.iter().zip(&counts).all(|(depth, count)| (depth - f32::from(*count)).abs() <= 0.5));
        let ridge: Vec<f64> = (10..50)
            .flat_map(|row| (38..43).map(move |column| row * WIDTH + column))
            .map(|at| f64::from(depths[at]) - exact[at])
            .collect();
        assert!(crate::geometry::statistics::rms(&ridge).unwrap() < 0.3);
    }

    #[test]
    fn fine_steps_holes_and_images_without_depth_are_left_alone() {
        let noisy =
            |row: f64, column: f64| 5000.0 + 7.0 * ((row * 12.9 + column * 78.2).sin() * 43_758.5).fract();
        let (mut counts, _) = image(1.0, noisy);
        counts[7] = 0;
        counts[8] = SATURATED;
        let as_read: Vec<f32> =
            counts.iter().map(|&c| if c == SATURATED { 0.0 } else { f32::from(c) }).collect();
        assert_eq!(restored(&counts, WIDTH), as_read);
        for counts in [vec![], vec![0; 80], vec![500; 80], vec![SATURATED; 80]] {
            let expected: Vec<f32> =
                counts.iter().map(|&c| if c == SATURATED { 0.0 } else { f32::from(c) }).collect();
            assert_eq!(restored(&counts, WIDTH), expected);
        }
    }
}
