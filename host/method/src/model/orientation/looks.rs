//! What is seen of a cloud by looks from far away.

use crate::geometry::columns::Columns;
use crate::geometry::grid::lanes::LANES;
use crate::model::downsampling::Voxels;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use wide::f32x8;

/// Directions all round.
pub(super) const LOOKS: usize = 96;
/// Sine of the least height of a look over a table.
const LEAST_HEIGHT: f32 = 0.12;
/// Edge of a pixel and depth by which what is seen in it may differ, voxels.
const PIXEL_VOXELS: f32 = 1.5;
const DEPTH_VOXELS: f32 = 1.2;
/// Cosine of the steepest angle at which a surface is seen.
const LEAST_COSINE: f32 = 0.2;
/// Share of the pixels along one axis of a look at most: stray points are off the picture.
const MOST_PIXELS: f32 = 2048.0;

/// What is seen of a cloud from directions all round.
pub(super) struct Looks {
    /// Unit directions, evenly spread (Fibonacci's spiral).
    pub(super) directions: Vec<Vector3<f32>>,
    /// Which of them see each voxel, a bit for each.
    pub(super) seen: Vec<Directions>,
}

/// Some of the directions: a bit for each.
pub(super) type Directions = u128;
const _: () = assert!(LOOKS < Directions::BITS as usize && LOOKS.is_multiple_of(LANES));
/// All of them.
pub(super) const ALL: Directions = (1 << LOOKS) - 1;

/// Their numbers.
pub(super) fn bits(mut left: Directions) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lowest = (left != 0).then(|| left.trailing_zeros() as usize);
        left &= left.wrapping_sub(1);
        lowest
    })
}

impl Looks {
    pub(super) fn at(voxels: &Voxels) -> Self {
        let golden = std::f32::consts::PI * (3.0 - 5f32.sqrt());
        let direction = |k: usize| {
            let z = 1.0 - (2.0 * k as f32 + 1.0) / LOOKS as f32;
            let (sin, cos) = (golden * k as f32).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            Vector3::new(r * cos, r * sin, z)
        };
        let directions: Vec<Vector3<f32>> = (0..LOOKS).map(direction).collect();
        let points = Columns::new(&voxels.cloud.points_mm);
        let normals = Columns::new(&voxels.cloud.normals);
        let mut seen: Vec<Directions> = vec![0; voxels.cloud.points_mm.len()];
        // The pictures of some looks at a time: all of them may be too many to hold.
        for (chunk, some) in directions.chunks(LANES).enumerate() {
            let pictures: Vec<Picture> =
                some.par_iter().map(|look| Picture::new(&points, voxels.edge_mm, look)).collect();
            seen.par_chunks_mut(LANES).enumerate().for_each(|(k, seen)| {
                let shown = std::array::from_fn(|look| pictures[look].shown(&points, &normals, k * LANES));
                for (seen, by) in seen.iter_mut().zip(transposed(shown)) {
                    *seen |= Directions::from(by) << (LANES * chunk);
                }
            });
        }
        Self { directions, seen }
    }

    /// Those over a plane that faces `up`.
    pub(super) fn half(&self, up: &Vector3<f32>) -> Directions {
        let over = self.directions.iter().map(|d| Directions::from(d.dot(up) > LEAST_HEIGHT));
        over.enumerate().map(|(k, over)| over << k).sum()
    }

    /// Share of the voxels that some of these directions see.
    pub(super) fn share(&self, from: Directions) -> f32 {
        self.seen.iter().filter(|seen| **seen & from != 0).count() as f32 / self.seen.len().max(1) as f32
    }

    /// Which directions surfaces with these normals face.
    pub(super) fn faced(&self, normals: &[Vector3<f32>]) -> Vec<Directions> {
        let directions = Columns::new(&self.directions);
        let faces = |normal: &Vector3<f32>| {
            let eight = |first| directions.along(first, normal).simd_ge(f32x8::ZERO).to_bitmask();
            directions.eights().map(|first| Directions::from(eight(first)) << first).sum()
        };
        normals.par_iter().map(faces).collect()
    }

    /// How many of these directions see each voxel from the side that it faces, and from the other.
    pub(super) fn counts(&self, faced: &[Directions], from: Directions) -> Vec<[u16; 2]> {
        let count = |(seen, faced): (&Directions, &Directions)| {
            [seen & from & faced, seen & from & !faced].map(|looks| looks.count_ones() as u16)
        };
        self.seen.iter().zip(faced).map(count).collect()
    }
}

/// Rows of bits as columns (Warren, *Hacker's Delight*, 7-3).
fn transposed(rows: [u8; LANES]) -> [u8; LANES] {
    let mut bits = u64::from_le_bytes(rows);
    for (by, mask) in [(7, 0x00AA_00AA_00AA_00AA), (14, 0x0000_CCCC_0000_CCCC), (28, 0x0000_0000_F0F0_F0F0)] {
        let swapped = (bits ^ bits >> by) & mask;
        bits ^= swapped ^ swapped << by;
    }
    bits.to_le_bytes()
}

/// How many of some sets have each direction: counts in binary, a set for each binary digit of all of them.
#[derive(Default)]
pub(super) struct Tally([Directions; 32]);

impl Tally {
    pub(super) fn of(sets: impl Iterator<Item = Directions>) -> [i64; LOOKS] {
        let mut tally = Self::default();
        sets.for_each(|set| tally.add(set));
        tally.counts()
    }

    pub(super) fn add(&mut self, set: Directions) {
        let mut carried = set;
        for digit in &mut self.0 {
            (*digit, carried) = (*digit ^ carried, *digit & carried);
            if carried == 0 {
                return;
            }
        }
    }

    pub(super) fn counts(&self) -> [i64; LOOKS] {
        let digits = || self.0.iter().enumerate();
        std::array::from_fn(|k| digits().map(|(digit, set)| ((set >> k & 1) as i64) << digit).sum())
    }
}

/// What a look from far away shows of points.
pub(super) struct Picture {
    look: Vector3<f32>,
    edge_mm: f32,
    /// To the right and up in it, each with where its second pixel begins, mm, and how many pixels it has.
    axes: [(Vector3<f32>, f32, usize); 2],
    /// Of each pixel the nearest that is seen in it, mm along the look. Those along the rim stand for all that is off the picture,
    /// and are hidden.
    nearest_mm: Vec<f32>,
}

impl Picture {
    pub(super) fn new(points: &Columns, edge_mm: f32, look: &Vector3<f32>) -> Self {
        let mut aside = Vector3::zeros();
        aside[look.iamin()] = 1.0;
        let right = look.cross(&aside).normalize();
        let axes = [right, look.cross(&right)].map(|axis| {
            let [low, high] = middle_span(points, &axis);
            (axis, low, ((high - low) / (PIXEL_VOXELS * edge_mm) + 1.0).min(MOST_PIXELS) as usize + 3)
        });
        let [width, height] = axes.map(|(.., size)| size);
        let mut nearest_mm = vec![f32::MIN; width * height];
        for (row, pixels) in nearest_mm.chunks_mut(width).enumerate() {
            if row == 0 || row + 1 == height {
                pixels.fill(f32::INFINITY);
            }
            (pixels[0], pixels[width - 1]) = (f32::INFINITY, f32::INFINITY);
        }
        let mut picture = Self { look: *look, edge_mm, axes, nearest_mm };
        for first in points.eights() {
            let depths_mm = points.along(first, look).to_array();
            for (pixel, depth_mm) in picture.pixels(points, first).into_iter().zip(depths_mm) {
                let nearest_mm = &mut picture.nearest_mm[pixel];
                *nearest_mm = nearest_mm.max(depth_mm);
            }
        }
        picture
    }

    /// The pixels of eight points from `first` on.
    #[inline(always)]
    fn pixels(&self, points: &Columns, first: usize) -> [usize; LANES] {
        let per_mm = 1.0 / (PIXEL_VOXELS * self.edge_mm);
        let at = |(axis, low, size): &(Vector3<f32>, f32, usize)| {
            let at = (points.along(first, axis) - *low) * per_mm + 1.0;
            at.fast_max(f32x8::ZERO).fast_min(f32x8::splat((size - 1) as f32)).fast_trunc_int().to_array()
        };
        let (x, y) = (at(&self.axes[0]), at(&self.axes[1]));
        let width = self.axes[0].2;
        std::array::from_fn(|k| y[k] as usize * width + x[k] as usize)
    }

    /// Which of eight points from `first` on it shows, a bit for each, of surfaces with these normals.
    fn shown(&self, points: &Columns, normals: &Columns, first: usize) -> u8 {
        let nearest_mm = f32x8::new(self.pixels(points, first).map(|pixel| self.nearest_mm[pixel]));
        let cosine = normals.along(first, &self.look).abs();
        let least = f32x8::splat(LEAST_COSINE);
        let sine = (1.0 - cosine * cosine).fast_max(f32x8::ZERO).sqrt();
        let within_mm = (sine / cosine.fast_max(least) * PIXEL_VOXELS + DEPTH_VOXELS) * self.edge_mm;
        let behind_mm = nearest_mm - points.along(first, &self.look);
        (cosine.simd_gt(least) & behind_mm.simd_lt(within_mm)).to_bitmask() as u8
    }

    /// Whether nothing is before this place.
    pub(super) fn shows(&self, place: &Point3<f32>) -> bool {
        let [x, y] = self.axes.map(|(axis, low, size)| {
            let at = (place.coords.dot(&axis) - low) / (PIXEL_VOXELS * self.edge_mm) + 1.0;
            (at as usize).min(size - 1)
        });
        let nearest_mm = self.nearest_mm[y * self.axes[0].2 + x];
        nearest_mm.is_infinite() || nearest_mm < place.coords.dot(&self.look)
    }
}

/// Points of which a span is known well enough.
const SPAN_POINTS: usize = 4000;

/// From where to where all but one in 500 of the points reach along an axis, and a little more.
fn middle_span(points: &Columns, axis: &Vector3<f32>) -> [f32; 2] {
    let mut along = points.some_along(SPAN_POINTS, axis);
    let cut = along.len() / 500;
    let last = along.len() - 1 - cut;
    let (_, low, rest) = along.select_nth_unstable_by(cut, f32::total_cmp);
    let low = *low;
    let high = if last > cut { *rest.select_nth_unstable_by(last - cut - 1, f32::total_cmp).1 } else { low };
    let margin = 0.05 * (high - low) + 1.0;
    [low - margin, high + margin]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_transposed_and_tallied() {
        let rows = [0x01, 0x80, 0xFF, 0x00, 0x5A, 0xC3, 0x10, 0x7E];
        let columns = transposed(rows);
        for (i, j) in (0..LANES).flat_map(|i| (0..LANES).map(move |j| (i, j))) {
            assert_eq!(rows[i] >> j & 1, columns[j] >> i & 1, "{i} {j}");
        }
        let sets = rows.map(|row| Directions::from(row) << 60);
        let counts = Tally::of(sets.into_iter());
        assert_eq!(counts[60..68], [3, 4, 2, 3, 4, 2, 4, 3].map(i64::from));
        assert_eq!(counts.iter().sum::<i64>(), 25);
    }
}
