//! How wrong a seam is expected to be (ours): noise of its points, and what the registration left open.
//!
//! The faces of a seam are averages over the views that saw them; an error of a view's pose moves its share of a face.
//! The covariance of all poses is carried through the shares and through the intersection of the two faces: once against
//! the first view, for the error within the scan, and once in the base frame.

use super::Refined;
use super::frame::{CrossAxes, Frame};
use crate::geometry::cloud::Merged;
use crate::geometry::point_to_plane;
use crate::model::reconstruction::Registration;
use nalgebra::{DMatrix, Matrix2, Matrix3, Matrix3x2, RowDVector, Vector3, Vector6};

/// Errors of the method itself that no covariance knows, mm and rad. Chosen on the simulated scans.
const FLOOR_MM: f64 = 0.015;
const FLOOR_RAD: f64 = 0.001;
/// Expected errors are meant to be exceeded rarely, not half of the time.
const CAUTION: f64 = 1.4;
/// A median distance in two dimensions over its root mean square: `√ln 2`, the median of a Rayleigh distribution.
const MEDIAN_OF_RMS: f64 = 0.83;
/// Stations of a seam, evenly, whose variances are averaged.
const STATIONS: usize = 20;
/// Share of the largest contribution to a seam's variance from which on a view is named.
const NAMED_SHARE: f64 = 0.5;

/// Expected root mean square errors of a seam.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    /// Across the seam, mm.
    pub position_mm: f64,
    /// Of the part that registration contributes, mm.
    pub registration_mm: f64,
    /// Torch orientation, rad.
    pub orientation_rad: f64,
    /// One standard deviation of the position across the seam in the base frame, both axes together, mm; not a number where
    /// nothing is known of the frame.
    pub base_mm: f64,
    /// The same of the torch orientation, rad.
    pub base_rad: f64,
    /// Direction across the seam in which the registration is least sure, unit, base frame.
    pub loosest: Vector3<f64>,
    /// The views that cause most of that.
    pub loose_views: Vec<usize>,
}

/// The expected error of a refined seam.
pub fn expect(seam: &Refined, merged: &Merged, registration: Option<&Registration>) -> Expected {
    // Windows overlap: this many stations share their points.
    let shared = f64::from(seam.window_mm / seam.step_mm).max(1.0);
    let independent = (seam.frames.len() as f64 / shared).max(1.0);
    let kept = (seam.freedom / independent).min(1.0).sqrt();
    let poses = registration.map(|r| registered(seam, merged, r, &r.covariance, 1)).unwrap_or_default();
    let in_base = |r: &Registration| Some(registered(seam, merged, r, r.base_covariance.as_ref()?, 0));
    let in_base = registration.and_then(in_base);
    let (moved_mm2, turned_rad2) = (poses.position_mm2.trace(), poses.orientation_rad2);
    let eigen = poses.position_mm2.symmetric_eigen();
    let most = poses.by_view_mm2.iter().copied().fold(0.0, f64::max);
    let noise_mm = seam.scatter_mm / MEDIAN_OF_RMS * kept;
    let tilt_rad = seam.tilt_rad * kept;
    let own_mm2 = CAUTION.powi(2) * (noise_mm.powi(2) + FLOOR_MM.powi(2));
    let own_rad2 = CAUTION.powi(2) * (tilt_rad.powi(2) + FLOOR_RAD.powi(2));
    let base = |own: f64, of: fn(&Poses) -> f64| in_base.as_ref().map_or(f64::NAN, |b| (own + of(b)).sqrt());
    Expected {
        position_mm: CAUTION * (noise_mm.powi(2) + moved_mm2 + FLOOR_MM.powi(2)).sqrt(),
        registration_mm: moved_mm2.sqrt(),
        orientation_rad: CAUTION * (tilt_rad.powi(2) + turned_rad2 + FLOOR_RAD.powi(2)).sqrt(),
        base_mm: base(own_mm2, |poses| poses.position_mm2.trace()),
        base_rad: base(own_rad2, |poses| poses.orientation_rad2),
        loosest: eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned(),
        loose_views: (0..poses.by_view_mm2.len())
            .filter(|&k| poses.by_view_mm2[k] > NAMED_SHARE * most)
            .collect(),
    }
}

/// Variances that the poses of the views leave at a seam, means over its stations.
#[derive(Default)]
struct Poses {
    /// Of the position across the seam, base frame, mm².
    position_mm2: Matrix3<f64>,
    /// Of the orientation, rad².
    orientation_rad2: f64,
    /// What each view alone would contribute to the faces' heights, mm².
    by_view_mm2: Vec<f64>,
}

/// Variances at a seam from a covariance of the poses of all views from the `first` on; those before have no error.
fn registered(
    seam: &Refined,
    merged: &Merged,
    registration: &Registration,
    covariance: &DMatrix<f64>,
    first: usize,
) -> Poses {
    let views = merged.cameras_mm.len();
    let mut poses = Poses { by_view_mm2: vec![0.0; views], ..Poses::default() };
    if covariance.is_empty() {
        return poses;
    }
    let mut count = 0.0;
    for (frame, shares) in
        seam.frames.iter().zip(&seam.view_share).step_by((seam.frames.len() / STATIONS).max(1))
    {
        let arm = merged.origin_mm + frame.position.coords.cast::<f64>() - registration.centre_mm;
        let normals = frame.faces.map(|n| n.cast::<f64>());
        let part = normals.map(|normal| point_to_plane::row(&arm, &normal));
        let row = |k: usize| pose_row(&shares[k], first, covariance.ncols(), &part[k]);
        let rows = [row(0), row(1)];
        let heights = Matrix2::from_fn(|a, b| (&rows[a] * covariance * rows[b].transpose())[0]);
        let Some(across) = across(frame, &normals) else { continue };
        poses.position_mm2 += across * heights * across.transpose();
        poses.orientation_rad2 += rotation_variance(shares, covariance, first);
        for (view, sum) in poses.by_view_mm2.iter_mut().enumerate().skip(1) {
            for (k, share) in shares.iter().enumerate() {
                let own = part[k] * f64::from(share.get(view).copied().unwrap_or(0.0));
                *sum += (own.transpose() * registration.covariance_of(view) * own)[0];
            }
        }
        count += 1.0;
    }
    poses.position_mm2 /= f64::max(count, 1.0);
    poses.orientation_rad2 /= f64::max(count, 1.0);
    poses
}

/// From heights of both faces to the place across the seam where they meet, base frame.
fn across(frame: &Frame, normals: &[Vector3<f64>; 2]) -> Option<Matrix3x2<f64>> {
    let CrossAxes { o, n } = frame.cross_section();
    let (o, n) = (o.cast::<f64>(), n.cast::<f64>());
    let faces = Matrix2::new(normals[0].dot(&o), normals[0].dot(&n), normals[1].dot(&o), normals[1].dot(&n));
    Some(Matrix3x2::from_columns(&[o, n]) * faces.try_inverse()?)
}

/// The row that sums the contributions of all views from the `first` on, each weighted by its share.
fn pose_row(shares: &[f32], first: usize, columns: usize, part: &Vector6<f64>) -> RowDVector<f64> {
    let mut row = RowDVector::zeros(columns);
    for (view, &share) in shares.iter().enumerate().skip(first) {
        for (d, value) in part.iter().enumerate() {
            row[6 * (view - first) + d] = f64::from(share) * value;
        }
    }
    row
}

/// Variance of the mean rotation of the views that saw the seam, rad².
fn rotation_variance(shares: &[Vec<f32>; 2], covariance: &DMatrix<f64>, first: usize) -> f64 {
    let mean: Vec<f32> = shares[0].iter().zip(&shares[1]).map(|(a, b)| 0.5 * (a + b)).collect();
    let about = |axis: Vector3<f64>| {
        let turn = Vector6::new(axis.x, axis.y, axis.z, 0.0, 0.0, 0.0);
        let row = pose_row(&mean, first, covariance.ncols(), &turn);
        (&row * covariance * row.transpose())[0]
    };
    about(Vector3::x()) + about(Vector3::y()) + about(Vector3::z())
}
