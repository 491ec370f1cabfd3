//! What the registered poses say of the hand-eye transform (ours): an error of it moves every camera alike in its own frame.
//!
//! With `P` the reported poses of the cameras and `R` the registered ones, `R = G P X`: `X` is the motion of the camera that
//! the hand-eye transform lacks, `G` one motion of everything, of which registration knows nothing. Both are small
//! against the distances of the cameras, so that rotations add; one linear system finds the twelve numbers. Where the
//! views do not turn, `X` cannot be told from `G`, and its standard deviation says so.

use super::{POSE_DEG, POSE_MM};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Matrix6, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Fewer views leave nothing to judge the fit by: three give eighteen numbers for twelve.
const LEAST_VIEWS: usize = 3;
/// How loosely the two motions are held where the views say nothing, mm and rad: farther than any tool is long.
const LOOSE_MM: f64 = 1000.0;
const LOOSE_RAD: f64 = 1.0;
/// A motion is believed from this many standard deviations on: of six numbers that are normal, one in a million is
/// farther out by chance.
const BELIEVED_SIGMAS: f64 = 5.0;
/// A hand-eye transform that is calibrated badly is off by a few millimetres and a degree or two; a tool in place of the
/// flange is off by its length, an axis in place of another by a right angle.
const MOST_MM: f64 = 20.0;
const MOST_DEG: f64 = 3.0;

/// The motion that the hand-eye transform lacks, in the camera's frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HandEyeError {
    /// Of the camera, mm.
    pub shift_mm: f64,
    /// One standard deviation of that, worst direction, mm.
    pub shift_sigma_mm: f64,
    /// Rotation, degrees.
    pub turn_deg: f64,
    /// One standard deviation of that, worst axis, degrees.
    pub turn_sigma_deg: f64,
}

impl HandEyeError {
    /// Whether the views show that the transform is not the camera's.
    pub fn is_gross(&self) -> bool {
        let shifted = self.shift_mm > MOST_MM && self.shift_mm > BELIEVED_SIGMAS * self.shift_sigma_mm;
        shifted || self.turn_deg > MOST_DEG && self.turn_deg > BELIEVED_SIGMAS * self.turn_sigma_deg
    }
}

/// The error of the hand-eye transform that explains best what registration made of the reported poses.
pub(super) fn error(reported: &[Isometry3<f64>], registered: &[Isometry3<f64>]) -> Option<HandEyeError> {
    if reported.len() < LEAST_VIEWS {
        return None;
    }
    let (design, done) = system(reported, registered);
    let loose = DVector::from_fn(12, |k, _| if k / 3 % 2 == 0 { LOOSE_RAD } else { LOOSE_MM });
    let prior = DMatrix::from_diagonal(&loose.map(|sigma| sigma.powi(-2)));
    let covariance = (design.transpose() * &design + prior).cholesky()?.inverse();
    let solution = &covariance * design.transpose() * &done;
    let left = (&done - &design * &solution).norm_squared() / (done.len() - 12) as f64;
    // Where two such motions do not explain what was done, something else is wrong: nothing is believed of them then.
    let covariance: Matrix6<f64> = covariance.fixed_view::<6, 6>(6, 6) * left.max(1.0);
    let sigma = |at: usize| {
        covariance.fixed_view::<3, 3>(at, at).into_owned().symmetric_eigenvalues().max().max(0.0).sqrt()
    };
    Some(HandEyeError {
        shift_mm: solution.fixed_rows::<3>(9).norm(),
        shift_sigma_mm: sigma(3),
        turn_deg: solution.fixed_rows::<3>(6).norm().to_degrees(),
        turn_sigma_deg: sigma(0).to_degrees(),
    })
}

/// Rows in standard deviations of a reported pose; unknowns: turn and shift of `G` about the cameras' middle, of `X`.
fn system(reported: &[Isometry3<f64>], registered: &[Isometry3<f64>]) -> (DMatrix<f64>, DVector<f64>) {
    let place = |pose: &Isometry3<f64>| pose.translation.vector;
    let middle = reported.iter().map(place).sum::<Vector3<f64>>() / reported.len() as f64;
    let mut design = DMatrix::zeros(6 * reported.len(), 12);
    let mut done = DVector::zeros(6 * reported.len());
    let (turn, shift) = (1.0 / POSE_DEG.to_radians(), 1.0 / POSE_MM);
    for (k, (reported, registered)) in reported.iter().zip(registered).enumerate() {
        let correction = registered * reported.inverse();
        let camera = Point3::from(place(reported));
        let axes: Matrix3<f64> = *reported.rotation.to_rotation_matrix().matrix();
        let row = 6 * k;
        design.fixed_view_mut::<3, 3>(row, 0).copy_from(&(Matrix3::identity() * turn));
        design.fixed_view_mut::<3, 3>(row, 6).copy_from(&(axes * turn));
        design
            .fixed_view_mut::<3, 3>(row + 3, 0)
            .copy_from(&(-(camera.coords - middle).cross_matrix() * shift));
        design.fixed_view_mut::<3, 3>(row + 3, 3).copy_from(&(Matrix3::identity() * shift));
        design.fixed_view_mut::<3, 3>(row + 3, 9).copy_from(&(axes * shift));
        done.fixed_rows_mut::<3>(row).copy_from(&(correction.rotation.scaled_axis() * turn));
        done.fixed_rows_mut::<3>(row + 3).copy_from(&((correction * camera - camera) * shift));
    }
    (design, done)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    /// Five cameras 400 mm from the origin, leaning by about this much. On one cone a shift along its axis would move all
    /// of them alike, which nothing could tell from a motion of everything.
    fn cameras(lean_deg: f64) -> Vec<Isometry3<f64>> {
        let one = |k: usize| {
            let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 1.25 * k as f64);
            let own_deg = lean_deg * [1.0, 0.2, 1.2, 0.5, 1.4][k];
            let lean = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), own_deg.to_radians());
            let turn = about * lean;
            Isometry3::from_parts(Translation3::from(turn * Vector3::z() * 400.0), turn)
        };
        (0..5).map(one).collect()
    }

    fn shifted(reported: &[Isometry3<f64>], lacking: Isometry3<f64>) -> Vec<Isometry3<f64>> {
        // Registration keeps the first view where it was reported.
        let keep = reported[0] * (reported[0] * lacking).inverse();
        reported.iter().map(|pose| keep * pose * lacking).collect()
    }

    #[test]
    fn a_tool_in_place_of_the_flange_is_found_where_views_turn() {
        let reported = cameras(20.0);
        let error = error(&reported, &shifted(&reported, Isometry3::translation(0.0, 30.0, -95.0))).unwrap();
        assert!((error.shift_mm - 99.6).abs() < 6.0 && error.is_gross(), "{error:?}");
    }

    #[test]
    fn an_everyday_calibration_and_views_that_do_not_turn_are_no_evidence() {
        let reported = cameras(20.0);
        let small = Isometry3::new(Vector3::new(1.5, -1.0, 1.0), Vector3::new(0.005, 0.004, -0.006));
        assert!(!error(&reported, &shifted(&reported, small)).unwrap().is_gross());
        let level = cameras(0.5);
        let far = Isometry3::translation(0.0, 30.0, -95.0);
        assert!(!error(&level, &shifted(&level, far)).unwrap().is_gross());
    }

    #[test]
    fn one_view_that_is_off_is_no_error_of_the_hand_eye() {
        let reported = cameras(20.0);
        let mut registered = reported.clone();
        registered[3] = Isometry3::translation(60.0, 0.0, 0.0) * registered[3];
        let error = error(&reported, &registered).unwrap();
        assert!(!error.is_gross(), "{error:?}");
    }
}
