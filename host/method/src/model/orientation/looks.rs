//! What is seen of a cloud by looks from far away.

use crate::model::downsampling::Voxels;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

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
const _: () = assert!(LOOKS < Directions::BITS as usize);
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
        /// Looks that are held at a time: a byte for each and voxel.
        const AT_A_TIME: usize = 8;
        let golden = std::f32::consts::PI * (3.0 - 5f32.sqrt());
        let direction = |k: usize| {
            let z = 1.0 - (2.0 * k as f32 + 1.0) / LOOKS as f32;
            let (sin, cos) = (golden * k as f32).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            Vector3::new(r * cos, r * sin, z)
        };
        let directions: Vec<Vector3<f32>> = (0..LOOKS).map(direction).collect();
        let (points, normals) = (&voxels.cloud.points_mm, &voxels.cloud.normals);
        let mut seen: Vec<Directions> = vec![0; points.len()];
        for (chunk, some) in directions.chunks(AT_A_TIME).enumerate() {
            let shown: Vec<Vec<bool>> = some
                .par_iter()
                .map(|look| Picture::new(points, voxels.edge_mm, look).seen(normals))
                .collect();
            seen.par_iter_mut().enumerate().for_each(|(i, seen)| {
                for (k, shown) in (AT_A_TIME * chunk..).zip(&shown) {
                    *seen |= Directions::from(shown[i]) << k;
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

    /// How many of these directions see each voxel from the side of its normal, and from the other.
    pub(super) fn counts(&self, normals: &[Vector3<f32>], from: Directions) -> Vec<[u16; 2]> {
        let count = |(seen, normal): (&Directions, &Vector3<f32>)| {
            let mut sides = [0; 2];
            bits(seen & from).for_each(|k| sides[usize::from(normal.dot(&self.directions[k]) < 0.0)] += 1);
            sides
        };
        self.seen.par_iter().zip(normals).map(count).collect()
    }
}

/// What a look from far away shows of points.
pub(super) struct Picture {
    look: Vector3<f32>,
    edge_mm: f32,
    /// To the right and up in it, each with where it begins, mm, and how many pixels it has.
    axes: [(Vector3<f32>, f32, usize); 2],
    /// Of each point its pixel, [`OFF`] if it is in none, and how near it is, mm along the look.
    places: Vec<(u32, f32)>,
    /// Of each pixel the nearest that is seen in it, mm along the look.
    nearest_mm: Vec<f32>,
}

/// The pixel of what is off the picture.
const OFF: u32 = u32::MAX;

impl Picture {
    pub(super) fn new(points: &[Point3<f32>], edge_mm: f32, look: &Vector3<f32>) -> Self {
        let mut aside = Vector3::zeros();
        aside[look.iamin()] = 1.0;
        let right = look.cross(&aside).normalize();
        let axes = [right, look.cross(&right)].map(|axis| {
            let [low, high] = middle_span(points, &axis);
            (axis, low, ((high - low) / (PIXEL_VOXELS * edge_mm) + 1.0).min(MOST_PIXELS) as usize + 1)
        });
        let mut nearest_mm = vec![f32::MIN; axes[0].2 * axes[1].2];
        let mut picture = Self { look: *look, edge_mm, axes, places: Vec::new(), nearest_mm: Vec::new() };
        let place =
            |p: &Point3<f32>| (picture.pixel(p).map_or(OFF, |pixel| pixel as u32), p.coords.dot(look));
        picture.places = points.iter().map(place).collect();
        for (pixel, depth_mm) in &picture.places {
            if let Some(nearest_mm) = nearest_mm.get_mut(*pixel as usize) {
                *nearest_mm = nearest_mm.max(*depth_mm);
            }
        }
        picture.nearest_mm = nearest_mm;
        picture
    }

    fn pixel(&self, p: &Point3<f32>) -> Option<usize> {
        let [x, y] = self.axes.map(|(axis, low, size)| {
            let at = (p.coords.dot(&axis) - low) / (PIXEL_VOXELS * self.edge_mm);
            (at >= 0.0 && at < size as f32).then_some(at as usize)
        });
        Some(y? * self.axes[0].2 + x?)
    }

    /// Which of the points it shows, of surfaces with these normals.
    fn seen(&self, normals: &[Vector3<f32>]) -> Vec<bool> {
        let sees = |((pixel, depth_mm), n): (&(u32, f32), &Vector3<f32>)| {
            let Some(nearest_mm) = self.nearest_mm.get(*pixel as usize) else { return false };
            let cosine = n.dot(&self.look).abs();
            let slope = (1.0 - cosine * cosine).max(0.0).sqrt() / cosine.max(LEAST_COSINE);
            let within_mm = (DEPTH_VOXELS + PIXEL_VOXELS * slope) * self.edge_mm;
            cosine > LEAST_COSINE && nearest_mm - depth_mm < within_mm
        };
        self.places.iter().zip(normals).map(sees).collect()
    }

    /// Whether nothing is before this place.
    pub(super) fn shows(&self, place: &Point3<f32>) -> bool {
        self.pixel(place).is_none_or(|pixel| self.nearest_mm[pixel] < place.coords.dot(&self.look))
    }
}

/// From where to where all but one in 500 of the points reach along an axis, and a little more.
fn middle_span(points: &[Point3<f32>], axis: &Vector3<f32>) -> [f32; 2] {
    let step = (points.len() / 20_000).max(1);
    let mut along: Vec<f32> = points.iter().step_by(step).map(|p| p.coords.dot(axis)).collect();
    let cut = along.len() / 500;
    let last = along.len() - 1 - cut;
    let (_, low, rest) = along.select_nth_unstable_by(cut, f32::total_cmp);
    let low = *low;
    let high = if last > cut { *rest.select_nth_unstable_by(last - cut - 1, f32::total_cmp).1 } else { low };
    let margin = 0.05 * (high - low) + 1.0;
    [low - margin, high + margin]
}
