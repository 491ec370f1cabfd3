//! The plane that the work rests on: the table (ours).
//!
//! Where a plate lies on the table, its edge makes a true inside corner that nobody welds; only knowing the table tells
//! it apart. The support is the largest plane that has (almost) nothing behind it.

use crate::geometry::cloud::PointCloud;
use crate::geometry::plane::Moments;
use crate::model::downsampling::Voxels;
use crate::model::orientation;
use nalgebra::{Matrix2, Point3, Vector2, Vector3};
use rayon::prelude::*;

// All chosen on the simulated scans, unless told otherwise.

/// Least share of all points that the support holds.
const LEAST_SHARE: f32 = 0.15;
/// Largest share of all points that may lie behind it, and from how far behind they do, half thicknesses.
const MOST_BEHIND: f32 = 0.01;
const BEHIND_HALVES: f32 = 3.0;

/// Directions of normals are counted in bins of this many to a unit; of the most common, so many are tried.
const BINS_PER_UNIT: f32 = 5.0;
const BINS: usize = 2 * BINS_PER_UNIT as usize + 1;
const DIRECTIONS: usize = 6;
/// Cosine within which a point faces as the plane does; of a face that may be the support, which is also this near to it,
/// half thicknesses.
const FACING: f32 = 0.9;
const SAME_FACE: f32 = 0.96;
const SAME_HALVES: f32 = 1.5;

/// Rounds of finding the plane and fitting it.
const ROUNDS: usize = 3;
/// Bin of the histogram of heights, voxels; the most bins; and the share of the least support at which a layer is one.
const BIN_VOXELS: f32 = 2.0;
const MOST_BINS: f32 = 1e6;
const PEAK_SHARE: f32 = 0.6;
/// Bins from the first of a layer among which its fullest pair is.
const PEAK_BINS: usize = 3;

/// Standard deviations beyond which points are left out of the second fit, the least such distance, voxels, and what of a
/// normal scatter then remains: 0.88 of its deviation lies within two.
const TRIM: f32 = 2.0;
const TRIM_VOXELS: f32 = 0.5;
const TRIMMED: f32 = 1.0 / 0.88;
/// Standard deviations in the half thickness, and the least of it, voxels.
const HALF_DEVIATIONS: f32 = 3.0;

/// Largest half thickness of a table, voxels.
const FLAT_VOXELS: f32 = 2.5;

/// Largest share of the spread of a table's normals that goes with the place: noise leaves none, a tube nearly all.
const MOST_CURVED: f32 = 0.4;
/// Spread of the normals, as a mean squared sine, below which a surface is flat however it is spread.
const FLAT_SPREAD: f32 = 0.004;

/// Shorter vectors have no direction.
const LEAST_LENGTH: f32 = 1e-3;

/// A plane and how far its points scatter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Support {
    /// Unit, toward the work.
    pub normal: Vector3<f32>,
    /// Distance of the plane from the cloud's origin along `normal`, mm.
    pub offset_mm: f32,
    /// Half thickness within which a point belongs to it, mm.
    pub half_mm: f32,
    /// Share of all points that lie on it.
    pub share: f32,
}

impl Support {
    /// Height over the plane, mm.
    pub fn height_mm(&self, p: &Point3<f32>) -> f32 {
        self.normal.dot(&p.coords) - self.offset_mm
    }

    /// Whether it reaches farther than what stands on it, whichever way one looks along it.
    fn surrounds(&self, voxels: &Voxels) -> bool {
        orientation::surrounds(&voxels.cloud.points_mm, &self.normal, self.offset_mm, self.half_mm)
    }

    /// Whether a face with this normal at this place is the support itself.
    pub fn is_face(&self, normal: &Vector3<f32>, place: &Point3<f32>) -> bool {
        normal.dot(&self.normal) > SAME_FACE && self.height_mm(place).abs() < SAME_HALVES * self.half_mm
    }
}

/// Whether a cloud shows the table that the work stands on, and so all of the scene.
pub fn is_table_shown(voxels: &Voxels) -> bool {
    find(voxels).is_some_and(|table| table.surrounds(voxels))
}

/// The support of a cloud, if it has one.
pub fn find(voxels: &Voxels) -> Option<Support> {
    let directions = common_normals(&voxels.cloud.normals);
    let found: Vec<Support> = directions.par_iter().filter_map(|n| along(voxels, n)).collect();
    found.into_iter().max_by(|a, b| a.share.total_cmp(&b.share))
}

/// Mean normals of the most common directions.
fn common_normals(normals: &[Vector3<f32>]) -> Vec<Vector3<f32>> {
    let mut bins = vec![(0usize, Vector3::zeros()); BINS * BINS * BINS];
    for n in normals {
        let c =
            |v: f32| ((v * BINS_PER_UNIT).round() + BINS_PER_UNIT).clamp(0.0, 2.0 * BINS_PER_UNIT) as usize;
        let bin = &mut bins[(c(n.x) * BINS + c(n.y)) * BINS + c(n.z)];
        *bin = (bin.0 + 1, bin.1 + n);
    }
    bins.sort_by_key(|b| std::cmp::Reverse(b.0));
    bins.iter().take(DIRECTIONS).filter_map(|(_, sum)| sum.try_normalize(LEAST_LENGTH)).collect()
}

/// The lowest large plane about normal to `direction`.
fn along(voxels: &Voxels, direction: &Vector3<f32>) -> Option<Support> {
    let total = voxels.cloud.len() as f32;
    let mut normal = *direction;
    let mut found = None;
    for _ in 0..ROUNDS {
        let support = fitted(voxels, &normal)?;
        normal = support.normal;
        found = Some(support);
    }
    let support = found?;
    let is_behind = |p: &&Point3<f32>| support.height_mm(p) < -BEHIND_HALVES * support.half_mm;
    let behind = voxels.cloud.points_mm.iter().filter(is_behind).count();
    // A curved or rough surface is no table.
    let flat = support.half_mm <= FLAT_VOXELS * voxels.edge_mm && !is_curved(voxels, &support);
    (flat && support.share > LEAST_SHARE && behind as f32 <= MOST_BEHIND * total).then_some(support)
}

/// The plane fitted to the lowest full layer of the points that face along `normal`.
fn fitted(voxels: &Voxels, normal: &Vector3<f32>) -> Option<Support> {
    let total = voxels.cloud.len() as f32;
    let bin_mm = BIN_VOXELS * voxels.edge_mm;
    let PointCloud { points_mm, normals, .. } = &voxels.cloud;
    let facing = points_mm.iter().zip(normals).filter(|(_, n)| n.dot(normal) > FACING);
    let facing: Vec<Vector3<f32>> = facing.map(|(p, _)| p.coords).collect();
    let heights: Vec<f32> = facing.iter().map(|p| normal.dot(p)).collect();
    let middle_mm = lowest_layer_mm(&heights, bin_mm, LEAST_SHARE * PEAK_SHARE * total)?;
    let layer = layer(&facing, normal, middle_mm, bin_mm);
    // Once more without what is not of the plane: another layer within the bin would thicken it.
    let within_mm = (TRIM * layer.deviation_mm).max(TRIM_VOXELS * voxels.edge_mm);
    let Layer { normal, offset_mm, deviation_mm, count } =
        self::layer(&facing, &layer.normal, layer.offset_mm, within_mm);
    let half_mm = (HALF_DEVIATIONS * TRIMMED * deviation_mm).max(voxels.edge_mm);
    Some(Support { normal, offset_mm, half_mm, share: count / total })
}

/// The middle of the fullest pair of bins where heights first fill one with more than `least`.
fn lowest_layer_mm(heights: &[f32], bin_mm: f32, least: f32) -> Option<f32> {
    let (low, high) = heights.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
    if heights.is_empty() || high - low > MOST_BINS * bin_mm {
        return None;
    }
    let mut histogram = vec![0u32; ((high - low) / bin_mm) as usize + 2];
    heights.iter().for_each(|h| histogram[((h - low) / bin_mm) as usize] += 1);
    let first = histogram.windows(2).position(|w| (w[0] + w[1]) as f32 > least)?;
    let pairs = first..(first + PEAK_BINS).min(histogram.len() - 1);
    let best = pairs.max_by_key(|&b| histogram[b] + histogram[b + 1])?;
    Some(low + (best + 1) as f32 * bin_mm)
}

/// A plane through some points.
struct Layer {
    normal: Vector3<f32>,
    offset_mm: f32,
    deviation_mm: f32,
    count: f32,
}

/// The plane through the points that are nearer than `within_mm` to one square to `axis`.
fn layer(points: &[Vector3<f32>], axis: &Vector3<f32>, middle_mm: f32, within_mm: f32) -> Layer {
    let mut moments = Moments::default();
    for p in points {
        if (axis.dot(p) - middle_mm).abs() < within_mm {
            moments.add(p - axis * middle_mm);
        }
    }
    let plane = moments.plane();
    let normal = if plane.normal.dot(axis) < 0.0 { -plane.normal } else { plane.normal };
    let offset_mm = normal.dot(&(plane.mean + axis * middle_mm));
    Layer { normal, offset_mm, deviation_mm: plane.variance_mm2.sqrt(), count: moments.count }
}

/// Whether the normals of a support's points turn with their place on it, as on a tube.
fn is_curved(voxels: &Voxels, support: &Support) -> bool {
    let across = support.normal.cross(&Vector3::new(support.normal.z, support.normal.x, support.normal.y));
    let Some(a) = across.try_normalize(LEAST_LENGTH) else { return false };
    let b = support.normal.cross(&a);
    let rows = || {
        let both = voxels.cloud.points_mm.iter().zip(&voxels.cloud.normals);
        both.filter(|(p, n)| n.dot(&support.normal) > FACING && support.height_mm(p).abs() < support.half_mm)
            .map(|(p, n)| {
                (Vector2::new(p.coords.dot(&a), p.coords.dot(&b)), Vector2::new(n.dot(&a), n.dot(&b)))
            })
    };
    let count = rows().count().max(1) as f32;
    let sum = rows().fold((Vector2::zeros(), Vector2::zeros()), |s, r| (s.0 + r.0, s.1 + r.1));
    let (place, tilt) = (sum.0 / count, sum.1 / count);
    let (mut places, mut crossed, mut spread) = (Matrix2::zeros(), Matrix2::zeros(), 0.0);
    for (p, n) in rows() {
        let (p, n) = (p - place, n - tilt);
        places += p * p.transpose();
        crossed += n * p.transpose();
        spread += n.norm_squared();
    }
    let Some(inverse) = places.try_inverse() else { return false };
    let explained = (crossed * inverse * crossed.transpose()).trace();
    spread > FLAT_SPREAD * count && explained > MOST_CURVED * spread
}
