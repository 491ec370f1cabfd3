//! Depths that a camera rounds to coarse steps, put back between them (ours).
//!
//! Rounding lays the points of a face on sheets across the line of sight. The error is alike along a line of equal depth, so
//! it does not average out along a seam that runs that way: 1 mm steps turn a face by degrees. What was rounded is known,
//! though: the depth was nearer to this step than to the next. Within that, a pixel is put on the plane through a window
//! that holds it (over a picture the inverse depth of a plane is linear): the largest that misses no more than rounding and
//! noise explain, since a face that is seen squarely has steps many pixels wide. Where no window does, at edges, it is the
//! smallest one beside the pixel that fits best (Nagao, Matsuyama, "Edge preserving smoothing", 1979). Then an error of rounding is
//! added again, drawn for each pixel by itself: as large as it was, so that what follows sees the noise that there is, but it averages out.

use std::ops::Range;

use rayon::prelude::*;

use crate::geometry::statistics::{lower_quartile, median};

/// Pixels from the middle of a window to its side, the largest first. Over the nine rows of the smallest the steps of a slanted
/// face average out, and a face that fills none of these is too small to be put right.
const HALVES: [usize; 4] = [32, 16, 8, 4];
/// Windows overlap: one begins after this part of their half.
const APART: usize = 2;
/// The windows of these tell the noise: large enough that noise which is alike over some pixels shows in them, and small
/// enough that a quarter of them lie on one face.
const NOISE_HALF: usize = 8;
/// Share of a window that has to hold depths.
const LEAST_SHARE: f64 = 0.6;
/// Variance of rounding, in steps squared.
const ROUNDING: f32 = 1.0 / 12.0;
/// So many times the variance that rounding and noise explain a window may miss: that of the smallest ones scatters by as much.
const EXPLAINED: f32 = 1.15;
/// Steps of depth on either side among which the usual one is found: not every depth occurs.
const BESIDE: usize = 4;
/// Noise of the second difference of neighbours, steps: rounding alone makes up to 1. Where more than half are no larger,
/// rounding is a fifth of the variance or more.
const COARSE_STEPS: f32 = 1.5;
/// Steps up to this share of the width of a pixel are fine: over the nine pixels of the smallest window they turn a face by 1.6
/// degrees at most.
const FINE: f64 = 0.25;
/// A determinant of a window's spread below this, in pixels to the fourth, is of a line.
const LEAST_SPREAD: f64 = 1e-6;

/// Marks of no reading are 0 and this.
const SATURATED: u16 = u16::MAX;

/// Neighbours on a face differ by less than this share of their depth: with pixels of a 500th of it, on a face whose normal is
/// up to 87 degrees off the line of sight.
const NEIGHBOURS: f32 = 0.05;

/// Depths of an image in counts, row by row, between their steps where these are coarse, else as they are; 0 where there is
/// no reading. A pixel is `wide` times as wide as what it sees is deep.
pub(super) fn restored(counts: &[u16], width: usize, wide: f64) -> Vec<f32> {
    let as_read = |at: usize| depth(counts[at]).unwrap_or(0.0);
    let faces = without_lone(counts, width);
    let image = Image { counts: &faces, width, height: counts.len() / width.max(1) };
    match Steps::of(&faces).filter(|steps| steps.are_coarse(&faces, width, wide)) {
        None => (0..counts.len()).map(as_read).collect(),
        Some(steps) => {
            let windows = HALVES.map(|half| image.windows(half));
            let noise = windows.iter().find(|windows| windows.half == NOISE_HALF).map_or(0.0, Windows::noise);
            let row = |row: usize| {
                let (windows, steps, faces) = (&windows, &steps, &faces);
                (0..width).map(move |column| {
                    let at = row * width + column;
                    let Some(depth) = depth(faces[at]) else { return as_read(at) };
                    let step = steps.about(depth as u16);
                    let most = EXPLAINED * noise.max(ROUNDING * step * step);
                    let on_plane = windows.iter().find_map(|windows| windows.at(row, column, most));
                    let within = |on: f32| on.clamp(depth - 0.5 * step, depth + 0.5 * step);
                    on_plane.map_or(depth, |on| within(on) + step * drawn(at))
                })
            };
            (0..image.height).into_par_iter().flat_map_iter(row).collect()
        }
    }
}

/// A reading.
fn depth(count: u16) -> Option<f32> {
    (1..SATURATED).contains(&count).then(|| f32::from(count))
}

/// Readings with one of about their depth beside them. A camera invents others, which lie on no face but spoil each window that
/// holds them.
fn without_lone(counts: &[u16], width: usize) -> Vec<u16> {
    let beside = |at: usize, rows: isize, columns: isize| {
        let column = (at % width).checked_add_signed(columns).filter(|&column| column < width)?;
        let row = (at / width).checked_add_signed(rows)?;
        depth(*counts.get(row * width + column)?)
    };
    let is_lone = |at: usize, own: f32| {
        let near = |other: f32| (other - own).abs() < NEIGHBOURS * own;
        ![(0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (1, 1), (-1, 1), (1, -1)]
            .iter()
            .any(|&(rows, columns)| beside(at, rows, columns).is_some_and(near))
    };
    let kept = |at: usize| depth(counts[at]).map_or(0, |own| if is_lone(at, own) { 0 } else { counts[at] });
    (0..counts.len()).into_par_iter().map(kept).collect()
}

/// A number from -0.5 to 0.5 that follows from the pixel alone (splitmix64).
fn drawn(pixel: usize) -> f32 {
    let mut mixed = (pixel as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((mixed ^ (mixed >> 31)) >> 40) as f32 / (1u32 << 24) as f32 - 0.5
}

/// A depth image.
#[derive(Clone, Copy)]
struct Image<'a> {
    counts: &'a [u16],
    width: usize,
    height: usize,
}

impl Image<'_> {
    /// Windows of one size, half as many pixels apart as they reach from their middle.
    fn windows(&self, half: usize) -> Windows {
        let apart = half / APART;
        let [rows, columns] = [self.height, self.width].map(|size| size.div_ceil(apart) + 1);
        let fits = (0..rows * columns).into_par_iter();
        let fits = fits.map(|at| self.fit(apart * (at / columns), apart * (at % columns), half)).collect();
        Windows { half, apart, columns, fits }
    }

    /// The plane through the window about a place.
    fn fit(&self, row: usize, column: usize, half: usize) -> Fit {
        let about = |middle: usize, size: usize| -> Range<usize> {
            middle.saturating_sub(half)..(middle + half + 1).min(size)
        };
        let mut sums = Sums::default();
        for r in about(row, self.height) {
            for c in about(column, self.width) {
                if let Some(depth) = depth(self.counts[r * self.width + c]) {
                    sums.add(c as f64 - column as f64, r as f64 - row as f64, 1.0 / f64::from(depth));
                }
            }
        }
        sums.fit(half)
    }
}

/// The planes through windows of one size.
struct Windows {
    half: usize,
    /// Pixels from one to the next.
    apart: usize,
    columns: usize,
    fits: Vec<Fit>,
}

impl Windows {
    /// Variance of what a window on one face misses, counts squared.
    fn noise(&self) -> f32 {
        let mut misses: Vec<f32> =
            self.fits.iter().map(|fit| fit.variance).filter(|miss| miss.is_finite()).collect();
        lower_quartile(&mut misses)
    }

    /// Depth of a pixel on the plane of the window that fits best of those that hold it, if that misses no more than `most`; of the
    /// smallest windows whatever it misses.
    fn at(&self, row: usize, column: usize, most: f32) -> Option<f32> {
        let middles =
            |at: usize| at.saturating_sub(self.half).div_ceil(self.apart)..(at + self.half) / self.apart + 1;
        let mut best: Option<(&Fit, f32, f32)> = None;
        for r in middles(row) {
            for c in middles(column) {
                let Some(fit) = self.fits.get(r * self.columns + c).filter(|_| c < self.columns) else {
                    continue;
                };
                if fit.variance.is_finite() && best.is_none_or(|(least, ..)| fit.variance < least.variance) {
                    let from = |at: usize, middle: usize| at as f32 - (self.apart * middle) as f32;
                    best = Some((fit, from(row, r), from(column, c)));
                }
            }
        }
        let (fit, down, right) = best?;
        let is_smallest = Some(&self.half) == HALVES.last();
        let inverse = fit.middle + down * fit.down + right * fit.right;
        ((is_smallest || fit.variance <= most) && inverse > 0.0).then(|| 1.0 / inverse)
    }
}

/// How far apart the depths of an image are about each count.
struct Steps(Vec<f32>);

impl Steps {
    /// None where there are too few depths to tell.
    fn of(counts: &[u16]) -> Option<Self> {
        let mut occurs = vec![false; usize::from(SATURATED) + 1];
        counts.iter().for_each(|&count| occurs[usize::from(count)] = true);
        let used: Vec<u16> = (1..SATURATED).filter(|&count| occurs[usize::from(count)]).collect();
        let gaps: Vec<u16> = used.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if gaps.len() <= 2 * BESIDE {
            return None;
        }
        let usual = |at: usize| {
            let mut near = gaps[at.saturating_sub(BESIDE)..(at + BESIDE + 1).min(gaps.len())].to_vec();
            f32::from(median(&mut near))
        };
        let mut about = vec![0.0; occurs.len()];
        for (at, &count) in used.iter().enumerate() {
            about[usize::from(count)] = usual(at.min(gaps.len() - 1));
        }
        Some(Self(about))
    }

    /// The step about a count that occurs.
    fn about(&self, count: u16) -> f32 {
        self.0[usize::from(count)]
    }

    /// Whether most steps are coarse beside a pixel, and neighbouring pixels differ by little more than rounding makes them.
    fn are_coarse(&self, counts: &[u16], width: usize, wide: f64) -> bool {
        let fine = (FINE * wide) as f32;
        let (mut all, mut few) = (0_usize, 0_usize);
        for row in counts.chunks_exact(width) {
            for three in row.windows(3).filter(|three| three.iter().all(|&count| depth(count).is_some())) {
                let [a, b, c] = [0, 1, 2].map(|k| f32::from(three[k]));
                all += 1;
                let step = self.about(three[1]);
                few += usize::from(step > fine * b && (a - 2.0 * b + c).abs() < COARSE_STEPS * step);
            }
        }
        2 * few > all
    }
}

/// The plane through a window: its inverse depth in the middle, and by how much that grows from row to row and from column to
/// column.
#[derive(Clone, Copy)]
struct Fit {
    middle: f32,
    down: f32,
    right: f32,
    /// Of what it misses, as depth in counts squared; infinite where there is no plane.
    variance: f32,
}

/// Sums over the pixels of a window: their number, places from its middle, inverse depths, and products of these.
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
    /// One more pixel, `u` columns to the right of the middle and `v` rows below it, of inverse depth `w`.
    fn add(&mut self, u: f64, v: f64, w: f64) {
        self.n += 1.0;
        self.u += u;
        self.v += v;
        self.uu += u * u;
        self.uv += u * v;
        self.vv += v * v;
        self.w += w;
        self.uw += u * w;
        self.vw += v * w;
        self.ww += w * w;
    }

    fn fit(&self, half: usize) -> Fit {
        let side = (2 * half + 1) as f64;
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
        // A depth is off by its own square times as much as its inverse.
        let variance = (ww - right * uw - down * vw).max(0.0) / w.powi(4);
        Fit {
            middle: (w - right * u - down * v) as f32,
            down: down as f32,
            right: right as f32,
            variance: variance as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 160;
    const HEIGHT: usize = 120;
    const WIDE: f64 = 1.0 / 600.0;

    /// Depths of an image by row and column, rounded to steps of so many counts.
    fn image(step: f64, depth: impl Fn(f64, f64) -> f64) -> (Vec<u16>, Vec<f64>) {
        let exact: Vec<f64> =
            (0..WIDTH * HEIGHT).map(|at| depth((at / WIDTH) as f64, (at % WIDTH) as f64)).collect();
        (exact.iter().map(|depth| ((depth / step).round() * step) as u16).collect(), exact)
    }

    /// Root mean square of what sixteen pixels of a row miss together, away from the rim: rounding is alike along a row.
    fn miss(depths: &[f32], exact: &[f64]) -> f64 {
        let mean = |row: usize, from: usize| {
            let misses = (from..from + 16).map(|column| row * WIDTH + column);
            misses.map(|at| f64::from(depths[at]) - exact[at]).sum::<f64>() / 16.0
        };
        let misses: Vec<f64> = (8..HEIGHT - 8)
            .flat_map(|row| [8, 24, 40, 56, 72, 88, 104, 120, 136].map(|column| mean(row, column)))
            .collect();
        crate::geometry::statistics::rms(&misses).unwrap()
    }

    fn rounded(counts: &[u16]) -> Vec<f32> {
        counts.iter().map(|&count| f32::from(count)).collect()
    }

    #[test]
    fn a_slanted_plane_is_put_back_between_its_steps() {
        for step in [1.0, 10.0] {
            // Inverse depth is linear over the picture.
            let (counts, exact) = image(step, |row, _| 1.0 / (1.0 / (450.0 * step) + row * 3.7e-6 / step));
            let (before, after) =
                (miss(&rounded(&counts), &exact), miss(&restored(&counts, WIDTH, WIDE), &exact));
            assert!(before > 0.25 * step && after < 0.12 * step, "{step}: {before} -> {after}");
        }
    }

    #[test]
    fn a_face_whose_steps_are_wider_than_a_small_window_is_put_back_too() {
        let (counts, exact) =
            image(1.0, |row, column| 1.0 / (1.0 / 450.0 + (row + 0.1 * column) * 1.9e-7 * 3.0));
        let (before, after) =
            (miss(&rounded(&counts), &exact), miss(&restored(&counts, WIDTH, WIDE), &exact));
        assert!(before > 0.2 && after < 0.1, "{before} -> {after}");
    }

    #[test]
    fn an_edge_stays_where_it_is_and_no_pixel_goes_beyond_the_next_step() {
        let roof = |_: f64, column: f64| 400.0 + 0.83 * (column - 80.0).abs();
        let (counts, exact) = image(1.0, roof);
        let depths = restored(&counts, WIDTH, WIDE);
        assert!(depths.iter().zip(&counts).all(|(depth, count)| (depth - f32::from(*count)).abs() <= 1.0));
        for column in 76..85 {
            let misses = (8..112).map(|row| row * WIDTH + column).map(|at| f64::from(depths[at]) - exact[at]);
            let mean = misses.sum::<f64>() / 104.0;
            assert!(mean.abs() < 0.3, "{column}: {mean}");
        }
    }

    #[test]
    fn steps_much_finer_than_a_pixel_are_left_alone_however_little_noise_there_is() {
        let (counts, _) = image(1.0, |row, column| 1.0 / (1.0 / 9000.0 + (row + 0.03 * column) * 1.9e-7));
        assert!(restored(&counts, WIDTH, WIDE) == rounded(&counts));
    }

    #[test]
    fn readings_that_lie_alone_change_no_other() {
        let (mut counts, _) = image(1.0, |row, _| 1.0 / (1.0 / 450.0 + row * 3.7e-6));
        let lone = |at: usize| at % 97 == 5;
        (0..counts.len()).filter(|&at| lone(at)).for_each(|at| counts[at] = 0);
        let clean = restored(&counts, WIDTH, WIDE);
        (0..counts.len()).filter(|&at| lone(at)).for_each(|at| counts[at] = 5000 + (at % 7) as u16);
        let strewn = restored(&counts, WIDTH, WIDE);
        assert!(
            (0..counts.len())
                .all(|at| strewn[at] == if lone(at) { f32::from(counts[at]) } else { clean[at] })
        );
    }

    #[test]
    fn fine_steps_holes_and_images_without_depth_are_left_alone() {
        let noisy =
            |row: f64, column: f64| 5000.0 + 7.0 * ((row * 12.9 + column * 78.2).sin() * 43_758.5).fract();
        let (mut counts, _) = image(1.0, noisy);
        counts[7] = 0;
        counts[8] = SATURATED;
        for counts in [counts, vec![], vec![0; WIDTH], vec![500; WIDTH], vec![SATURATED; WIDTH]] {
            let as_read: Vec<f32> =
                counts.iter().map(|&c| if c == SATURATED { 0.0 } else { f32::from(c) }).collect();
            assert!(restored(&counts, WIDTH, WIDE) == as_read);
        }
    }
}
