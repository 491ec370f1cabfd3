//! The plane that the work rests on: the table (ours).
//!
//! Where a plate lies on the table, its edge makes a true inside corner that nobody welds; only knowing the table tells
//! it apart. The support is the largest plane that has (almost) nothing behind it.

use crate::geometry::cloud::PointCloud;
use crate::geometry::plane::Moments;
use crate::model::downsampling::Voxels;
use nalgebra::{Matrix2, Point3, Vector2, Vector3};
use rayon::prelude::*;

/// Least share of all points that the support holds.
const LEAST_SHARE: f32 = 0.15;
/// Largest share of all points that may lie behind it.
const MOST_BEHIND: f32 = 0.01;

/// Standard deviations beyond which points are left out of the second fit, and what of a normal scatter then remains.
const TRIM: f32 = 2.0;
const TRIMMED: f32 = 1.0 / 0.88;

/// Largest half thickness of a table, voxels.
const FLAT_VOXELS: f32 = 2.5;

/// Largest share of the spread of a table's normals that goes with the place: noise leaves none, a tube nearly all.
const MOST_CURVED: f32 = 0.4;
/// Spread of the normals, as a mean squared sine, below which a surface is flat however it is spread.
const FLAT_SPREAD: f32 = 0.004;

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

    /// Whether a face with this normal at this place is the support itself.
    pub fn is_face(&self, normal: &Vector3<f32>, place: &Point3<f32>) -> bool {
        normal.dot(&self.normal) > 0.96 && self.height_mm(place).abs() < 1.5 * self.half_mm
    }
}

/// The support of a cloud, if it has one.
pub fn find(voxels: &Voxels) -> Option<Support> {
    let directions = common_normals(&voxels.cloud.normals);
    let found: Vec<Support> = directions.par_iter().filter_map(|n| along(voxels, n)).collect();
    found.into_iter().max_by(|a, b| a.share.total_cmp(&b.share))
}

/// Mean normals of the most common directions.
fn common_normals(normals: &[Vector3<f32>]) -> Vec<Vector3<f32>> {
    let mut bins = vec![(0usize, Vector3::zeros()); 11 * 11 * 11];
    for n in normals {
        let c = |v: f32| ((v * 5.0).round() + 5.0).clamp(0.0, 10.0) as usize;
        let bin = &mut bins[(c(n.x) * 11 + c(n.y)) * 11 + c(n.z)];
        *bin = (bin.0 + 1, bin.1 + n);
    }
    bins.sort_by_key(|b| std::cmp::Reverse(b.0));
    bins.iter().take(6).filter_map(|(_, sum)| sum.try_normalize(1e-3)).collect()
}

/// The lowest large plane about normal to `direction`.
fn along(voxels: &Voxels, direction: &Vector3<f32>) -> Option<Support> {
    let total = voxels.cloud.len() as f32;
    let bin_mm = 2.0 * voxels.edge_mm;
    let mut normal = *direction;
    let mut found = None;
    for _ in 0..3 {
        let PointCloud { points_mm, normals, .. } = &voxels.cloud;
        let facing = points_mm.iter().zip(normals).filter(|(_, n)| n.dot(&normal) > 0.9);
        let facing: Vec<Vector3<f32>> = facing.map(|(p, _)| p.coords).collect();
        let heights: Vec<f32> = facing.iter().map(|p| normal.dot(p)).collect();
        let (low, high) = heights.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        if heights.is_empty() || high - low > 1e6 * bin_mm {
            return None;
        }
        let mut histogram = vec![0u32; ((high - low) / bin_mm) as usize + 2];
        heights.iter().for_each(|h| histogram[((h - low) / bin_mm) as usize] += 1);
        let peak = histogram.windows(2).position(|w| (w[0] + w[1]) as f32 > LEAST_SHARE * 0.6 * total)?;
        let best =
            (peak..(peak + 3).min(histogram.len() - 1)).max_by_key(|&b| histogram[b] + histogram[b + 1])?;
        let middle = low + (best + 1) as f32 * bin_mm;
        let fitted = |axis: &Vector3<f32>, middle: f32, within: f32| {
            let mut moments = Moments::default();
            for p in &facing {
                if (axis.dot(p) - middle).abs() < within {
                    moments.add(p - axis * middle);
                }
            }
            let plane = moments.plane();
            let up = if plane.normal.dot(axis) < 0.0 { -plane.normal } else { plane.normal };
            (up, up.dot(&(plane.mean + axis * middle)), plane.variance_mm2.sqrt(), moments.count)
        };
        let (up, offset_mm, sigma_mm, _) = fitted(&normal, middle, bin_mm);
        // Once more without what is not of the plane: another layer within the bin would thicken it.
        let within = (TRIM * sigma_mm).max(0.5 * voxels.edge_mm);
        let (up, offset_mm, sigma_mm, count) = fitted(&up, offset_mm, within);
        normal = up;
        let half_mm = (3.0 * TRIMMED * sigma_mm).max(voxels.edge_mm);
        found = Some(Support { normal, offset_mm, half_mm, share: count / total });
    }
    let support = found?;
    let behind =
        voxels.cloud.points_mm.iter().filter(|p| support.height_mm(p) < -3.0 * support.half_mm).count();
    // A curved or rough surface is no table.
    let flat = support.half_mm <= FLAT_VOXELS * voxels.edge_mm && !is_curved(voxels, &support);
    (flat && support.share > LEAST_SHARE && behind as f32 <= MOST_BEHIND * total).then_some(support)
}

/// Whether the normals of a support's points turn with their place on it, as on a tube.
fn is_curved(voxels: &Voxels, support: &Support) -> bool {
    let across = support.normal.cross(&Vector3::new(support.normal.z, support.normal.x, support.normal.y));
    let Some(a) = across.try_normalize(1e-3) else { return false };
    let b = support.normal.cross(&a);
    let rows = || {
        let both = voxels.cloud.points_mm.iter().zip(&voxels.cloud.normals);
        both.filter(|(p, n)| n.dot(&support.normal) > 0.9 && support.height_mm(p).abs() < support.half_mm)
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
