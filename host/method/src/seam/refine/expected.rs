//! How wrong a seam is expected to be (ours): noise of its points, and what the registration left open.
//!
//! The faces of a seam are averages over the views that saw them; an error of a view's pose moves its share of a face.
//! The covariance of all poses is carried through the shares and through the intersection of the two faces: against the
//! first view, against the views that saw the seam, for the error within the scan, and in the base frame.

use super::Refined;
use super::frame::{CrossAxes, Frame};
use crate::geometry::cloud::Merged;
use crate::geometry::point_to_plane;
use crate::model::reconstruction::Registration;
use crate::seam::input::RawScan;
use crate::seam::surfaces::Waves;
use crate::seam::{ErrorParts, FitError};
use nalgebra::{DMatrix, Matrix2, Matrix3, Matrix3x2, RowDVector, Vector3, Vector6};

/// Errors of the method itself that no covariance knows, mm and rad. Chosen on the simulated scans.
const FLOOR_MM: f64 = 0.015;
const FLOOR_RAD: f64 = 0.001;
/// Expected errors are meant to be exceeded rarely, not half of the time.
const CAUTION: f64 = 1.4;
/// A median distance in two dimensions over its root mean square: `√ln 2`, the median of a Rayleigh distribution.
pub(crate) const MEDIAN_OF_RMS: f64 = 0.83;
/// Stations of a seam, evenly, whose variances are averaged.
const STATIONS: usize = 20;
/// Share of the largest contribution to a seam's variance from which on a view is named.
const NAMED_SHARE: f64 = 0.5;

/// Expected root mean square errors of a seam.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    /// Across the seam, mm.
    pub position_mm: f64,
    /// The same relative to the mean pose of the views that saw the seam: how far these disagree, wherever the scan as a whole
    /// may be, mm.
    pub relative_mm: f64,
    /// Of the part that registration contributes, mm.
    pub registration_mm: f64,
    /// What comes from where.
    pub parts: ErrorParts,
    /// Without waves.
    pub fit: FitError,
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
pub fn expect(seam: &Refined, scan: &RawScan, waves: Waves) -> Expected {
    let (merged, registration) = (scan.merged, scan.registration);
    // Windows overlap: this many stations share their points.
    let shared = f64::from(seam.window_mm / seam.step_mm).max(1.0);
    let independent = (seam.frames.len() as f64 / shared).max(1.0);
    let kept = (seam.freedom / independent).min(1.0).sqrt();
    let views = merged.cameras_mm.len();
    let of = |r: &Registration, covariance: &DMatrix<f64>, first: usize, against: &[f64]| {
        let arm_mm = merged.origin_mm - r.centre_mm;
        registered(seam, &PoseErrors { covariance, first, against, arm_mm })
    };
    let poses = registration.map(|r| of(r, &r.covariance, 1, &[])).unwrap_or_default();
    let seen_by = mean_shares(seam, views);
    let apart = registration.map(|r| of(r, &r.covariance, 1, &seen_by)).unwrap_or_default();
    let in_base = registration.and_then(|r| Some(of(r, r.base_covariance.as_ref()?, 0, &[])));
    let by_view_mm2 = registration.map(|r| by_view(seam, merged, r)).unwrap_or_default();
    let (moved_mm2, turned_rad2) = (poses.position_mm2.trace(), poses.orientation_rad2);
    let eigen = poses.position_mm2.symmetric_eigen();
    let most = by_view_mm2.iter().copied().fold(0.0, f64::max);
    let (corner_mm2, corner_rad2) = lifted(seam);
    let fitted_mm2 = (seam.scatter_mm / MEDIAN_OF_RMS).powi(2);
    // Waves show in the scatter of a seam that is longer than they are.
    let waved_mm2 = fitted_mm2.max(of_heights(seam, [f64::from(waves.height_mm); 2]));
    let waved_rad = seam.tilt_rad.max(f64::from(waves.lean_rad));
    let noise = |mm2: f64| mm2 * kept.powi(2) + corner_mm2 + FLOOR_MM.powi(2);
    let tilt = |rad: f64| (rad * kept).powi(2) + corner_rad2 + FLOOR_RAD.powi(2);
    let (noise_mm2, tilt_rad2) = (noise(waved_mm2), tilt(waved_rad));
    let within_mm = |noise_mm2: f64| CAUTION * (noise_mm2 + apart.position_mm2.trace()).sqrt();
    let torch_rad = |tilt_rad2: f64| CAUTION * (tilt_rad2 + turned_rad2).sqrt();
    let fit = FitError {
        position_mm: within_mm(noise(fitted_mm2)),
        torch_deg: torch_rad(tilt(seam.tilt_rad)).to_degrees(),
    };
    let (own_mm2, own_rad2) = (CAUTION.powi(2) * noise_mm2, CAUTION.powi(2) * tilt_rad2);
    let base = |own: f64, of: fn(&Poses) -> f64| in_base.as_ref().map_or(f64::NAN, |b| (own + of(b)).sqrt());
    Expected {
        position_mm: CAUTION * (noise_mm2 + moved_mm2).sqrt(),
        relative_mm: within_mm(noise_mm2),
        registration_mm: moved_mm2.sqrt(),
        parts: parts(
            own_mm2,
            CAUTION.powi(2) * corner_mm2,
            &poses,
            in_base.as_ref().map(|base| [base, &apart]),
        ),
        fit,
        orientation_rad: torch_rad(tilt_rad2),
        base_mm: base(own_mm2, |poses| poses.position_mm2.trace()),
        base_rad: base(own_rad2, |poses| poses.orientation_rad2),
        loosest: eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned(),
        loose_views: (0..by_view_mm2.len()).filter(|&k| by_view_mm2[k] > NAMED_SHARE * most).collect(),
    }
}

/// Parts of the error: `own_mm2` is the variance of the seam's own points and corners, `poses` what the poses add against the
/// first view, `in_base` in the base frame, and of that what is between the views that saw the seam.
fn parts(own_mm2: f64, corner_mm2: f64, poses: &Poses, in_base: Option<[&Poses; 2]>) -> ErrorParts {
    let (registration_mm2, calibration_mm2) = match in_base.map(|both| both.map(|p| p.position_mm2.trace())) {
        Some([base, apart]) => (apart.min(base), base - apart.min(base)),
        None => (CAUTION.powi(2) * poses.position_mm2.trace(), f64::NAN),
    };
    ErrorParts {
        noise_mm: (own_mm2 - corner_mm2).max(0.0).sqrt(),
        registration_mm: registration_mm2.sqrt(),
        calibration_mm: calibration_mm2.sqrt(),
        corner_mm: corner_mm2.sqrt(),
        touch_mm: 0.0,
    }
}

/// Variances that the poses of the views leave at a seam, means over its stations.
#[derive(Default)]
struct Poses {
    /// Of the position across the seam, base frame, mm².
    position_mm2: Matrix3<f64>,
    /// Of the orientation, rad².
    orientation_rad2: f64,
}

/// What is known of the poses, and what of it counts as an error.
struct PoseErrors<'a> {
    /// Of the poses of all views from the `first` on; those before have no error.
    covariance: &'a DMatrix<f64>,
    first: usize,
    /// Share of each view in a mean pose, whose motion is no error; empty where every motion is one.
    against: &'a [f64],
    /// From the centre of the rotations to the origin of the seam's positions, base frame.
    arm_mm: Vector3<f64>,
}

impl PoseErrors<'_> {
    /// The row that sums the contributions of all views, each weighted by its share.
    fn row(&self, shares: &[f32], part: &Vector6<f64>) -> RowDVector<f64> {
        let mut row = RowDVector::zeros(self.covariance.ncols());
        for (view, &share) in shares.iter().enumerate().skip(self.first) {
            let share = f64::from(share) - self.against.get(view).copied().unwrap_or(0.0);
            for (d, value) in part.iter().enumerate() {
                row[6 * (view - self.first) + d] = share * value;
            }
        }
        row
    }

    /// Variance of the mean rotation of the views that saw the seam, rad².
    fn rotation_variance(&self, shares: &[Vec<f32>; 2]) -> f64 {
        let mean: Vec<f32> = shares[0].iter().zip(&shares[1]).map(|(a, b)| 0.5 * (a + b)).collect();
        let about = |axis: Vector3<f64>| {
            let turn = Vector6::new(axis.x, axis.y, axis.z, 0.0, 0.0, 0.0);
            let row = self.row(&mean, &turn);
            (&row * self.covariance * row.transpose())[0]
        };
        about(Vector3::x()) + about(Vector3::y()) + about(Vector3::z())
    }
}

/// Some stations of a seam, evenly, and the shares of the views in both faces there.
fn sampled(seam: &Refined) -> impl Iterator<Item = (&Frame, &[Vec<f32>; 2])> {
    seam.frames.iter().zip(&seam.view_share).step_by((seam.frames.len() / STATIONS).max(1))
}

/// The share of each view in the whole seam, both faces alike.
fn mean_shares(seam: &Refined, views: usize) -> Vec<f64> {
    let mut mean = vec![0.0; views];
    for (view, sum) in mean.iter_mut().enumerate() {
        let of = |shares: &Vec<f32>| shares.get(view).copied().map_or(0.0, f64::from);
        *sum = sampled(seam).flat_map(|(_, shares)| shares).map(of).sum();
    }
    let whole: f64 = mean.iter().sum();
    mean.iter_mut().for_each(|share| *share /= whole.max(f64::MIN_POSITIVE));
    mean
}

/// Share of a face's points from which on one view alone saw it.
const ALONE: f32 = 0.9;

/// Whether one view alone saw one of its faces, for the most part.
pub(crate) fn is_seen_alone(seam: &Refined) -> bool {
    let is_alone = |shares: &Vec<f32>| shares.iter().any(|share| *share > ALONE);
    let (mut stations, mut alone) = (0, [0, 0]);
    for (_, shares) in sampled(seam) {
        stations += 1;
        alone.iter_mut().zip(shares).for_each(|(count, shares)| *count += usize::from(is_alone(shares)));
    }
    alone.iter().any(|count| 2 * count > stations)
}

/// Variances that the poses of the views leave at a seam.
fn registered(seam: &Refined, errors: &PoseErrors<'_>) -> Poses {
    let mut poses = Poses::default();
    if errors.covariance.is_empty() {
        return poses;
    }
    let mut count = 0.0;
    for (frame, shares) in sampled(seam) {
        let arm = errors.arm_mm + frame.position.coords.cast::<f64>();
        let normals = frame.faces.map(|n| n.cast::<f64>());
        let row = |k: usize| errors.row(&shares[k], &point_to_plane::row(&arm, &normals[k]));
        let rows = [row(0), row(1)];
        let heights = Matrix2::from_fn(|a, b| (&rows[a] * errors.covariance * rows[b].transpose())[0]);
        let Some(across) = across(frame, &normals) else { continue };
        poses.position_mm2 += across * heights * across.transpose();
        poses.orientation_rad2 += errors.rotation_variance(shares);
        count += 1.0;
    }
    poses.position_mm2 /= f64::max(count, 1.0);
    poses.orientation_rad2 /= f64::max(count, 1.0);
    poses
}

/// Variances that unknown lifts of the faces beside the root leave: of the position across the seam, mm², and of the
/// orientation, rad²; means over the stations.
fn lifted(seam: &Refined) -> (f64, f64) {
    // A face that is off at the root and right at its far end leans by so much; the torch by half of both.
    let leans =
        seam.lift_unknown_mm.iter().zip(seam.reach_mm).map(|(mm, reach)| mm / f64::from(reach).max(1.0));
    (of_heights(seam, seam.lift_unknown_mm), 0.25 * leans.map(|rad| rad * rad).sum::<f64>())
}

/// Variance of the position across a seam whose faces are too high by independent errors, mm²; mean over the stations.
fn of_heights(seam: &Refined, sigma_mm: [f64; 2]) -> f64 {
    let heights_mm2 = Matrix2::from_diagonal(&sigma_mm.map(|mm| mm * mm).into());
    let (mut sum, mut count) = (0.0, 0.0);
    for (frame, _) in sampled(seam) {
        let Some(across) = across(frame, &frame.faces.map(|n| n.cast::<f64>())) else { continue };
        sum += (across * heights_mm2 * across.transpose()).trace();
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

/// What each view alone would contribute to the faces' heights, mm².
fn by_view(seam: &Refined, merged: &Merged, registration: &Registration) -> Vec<f64> {
    let mut sums = vec![0.0; merged.cameras_mm.len()];
    for (frame, shares) in sampled(seam) {
        let place = merged.origin_mm + frame.position.coords.cast::<f64>();
        for (view, sum) in sums.iter_mut().enumerate().skip(1) {
            for (normal, shares) in frame.faces.iter().zip(shares) {
                let share = shares.get(view).copied().map_or(0.0, f64::from);
                *sum += share * share * registration.variance_mm2(view, &place, &normal.cast());
            }
        }
    }
    sums
}

/// From heights of both faces to the place across the seam where they meet, base frame.
fn across(frame: &Frame, normals: &[Vector3<f64>; 2]) -> Option<Matrix3x2<f64>> {
    let CrossAxes { o, n } = frame.cross_section();
    let (o, n) = (o.cast::<f64>(), n.cast::<f64>());
    let faces = Matrix2::new(normals[0].dot(&o), normals[0].dot(&n), normals[1].dot(&o), normals[1].dot(&n));
    Some(Matrix3x2::from_columns(&[o, n]) * faces.try_inverse()?)
}
