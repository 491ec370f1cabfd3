//! Where the whole model is in the robot's base frame, and how well that is known (ours; the paper takes the hand-eye
//! transform and the robot's poses as exact).
//!
//! Registration ties the views to each other and leaves the first where the robot reported it, with all the errors of that
//! pose. What registration made of the other poses tells most of them: an error of the hand-eye transform moves every camera
//! alike in its own frame. Where it is significant it is taken out of all poses; what remains, known or not, is the
//! error of the frame. Millimetres, radians where a name says nothing else.

mod adjustment;
mod calibration;
mod prior;

use crate::model::camera::CameraErrors;
use crate::model::reconstruction::{Registration, SurfaceEvidence};
use adjustment::{Adjusted, Known, parameters};
pub use calibration::Calibration;
use nalgebra::{DMatrix, DVector, Isometry3, Matrix5, Matrix6, Point3, SMatrix, Vector3, Vector6};
pub use prior::{Anchor, CellAccuracy};
use prior::{DEPTH_SCALE, Prior, SHARED};
use serde::{Deserialize, Serialize};

/// Standard deviations beyond which one number is significant.
const SIGNIFICANT_SIGMA: f64 = 3.0;
/// Of the squared size of a hand-eye motion in standard deviations, six numbers: by chance it is larger in one of 370 scans,
/// as one number is beyond three standard deviations.
const SIGNIFICANT: f64 = 20.1;
/// Where the scatter itself is estimated from so many coordinates that the bound has to be twice as large, chance is to
/// find a motion as seldom (quantiles of Fisher's F for 6 and 12 to 40).
const LOOSE_FREEDOM: f64 = 9.0;

/// Of the squared size of a camera's errors in standard deviations, focal length and k1: by chance larger in one of 370 scans.
const SIGNIFICANT_CAMERA: f64 = 11.8;

/// What the views say of the cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BaseFrame {
    /// How far the camera is from where the hand-eye transform puts it.
    pub hand_eye: HandEyeCorrection,
    /// One standard deviation of a pose that the robot reports, each axis, as these poses scatter, mm.
    pub robot_mm: f64,
    /// The same of its orientation, degrees.
    pub robot_deg: f64,
    /// How many times the stated accuracy that is.
    pub scale_mm: f64,
    /// The same of the orientation.
    pub scale_deg: f64,
}

/// Motion of the camera on the flange.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HandEyeCorrection {
    /// To be multiplied to the stated `flange_from_camera` from the right; mm.
    pub camera_from_corrected: Isometry3<f64>,
    /// Its length, mm.
    pub shift_mm: f64,
    /// One standard deviation along it, mm.
    pub shift_sigma_mm: f64,
    /// One standard deviation in the direction that the views tie down least, mm.
    pub loosest_mm: f64,
    /// Its angle, degrees.
    pub turn_deg: f64,
    /// One standard deviation about its axis, degrees.
    pub turn_sigma_deg: f64,
    /// One standard deviation about the axis that the views tie down least, degrees.
    pub loosest_deg: f64,
    /// Whether it is beyond three standard deviations, and is taken out of all poses.
    pub is_applied: bool,
}

/// Standard deviation of an optical axis that was taken as stated, in focal lengths.
const NOT_ASKED: f64 = 1e-5;
/// Share of its prior standard deviation below which the optical axis is told well enough to be moved.
const TOLD_SHARE: f64 = 0.25;
/// The same as a mean by chance: nothing is left to be taken out.
const SETTLED_CAMERA: f64 = 5.0;

/// What the views say of the camera's own errors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraFinding {
    /// As far as they are not taken out yet.
    pub errors: CameraErrors,
    /// One standard deviation of each.
    pub sigma: CameraErrors,
    /// Whether they are beyond three standard deviations together.
    pub is_significant: bool,
    /// Whether so much is left of them as of noise alone.
    pub is_settled: bool,
}

/// What is known of a scan's poses and camera before its surfaces are looked at.
#[derive(Debug, Clone, Copy)]
pub struct Stated<'a> {
    /// Poses that the robot reported of the registered views.
    pub reported: &'a [Isometry3<f64>],
    /// What holds the model.
    pub anchor: Anchor,
    /// What is known of hand-eye transform and camera from other scans, which is taken out of poses and points.
    pub calibration: Option<&'a Calibration>,
    /// Errors of the camera that this scan's own surfaces told, and that are taken out of its points.
    pub taken_out: Option<CameraErrors>,
    /// Whether the hand-eye transform belongs to another camera or another flange: nothing is corrected then.
    pub beyond_repair: bool,
}

/// Where registered views are in the base frame.
#[derive(Debug, Clone)]
pub struct Location {
    /// What they say of robot and hand-eye transform; none where the first view is exact.
    pub base_frame: Option<BaseFrame>,
    /// What they say of the camera; none of a single view.
    pub camera: Option<CameraFinding>,
    /// What all views share, beside a calibration that was taken out.
    pub shared: Calibration,
    poses: Vec<Isometry3<f64>>,
    covariance: Option<DMatrix<f64>>,
}

/// Locates the registered views; none where a registration says too little.
pub fn locate(stated: &Stated, registration: &Registration) -> Option<Location> {
    let reported = stated.reported;
    let alone = SurfaceEvidence::of_one_view();
    let surfaces = match reported.len() {
        1 => &alone,
        _ => registration.evidence.as_ref()?,
    };
    let (registered, centre_mm) = (&registration.base_from_camera, registration.centre_mm);
    let calibrated = stated.calibration.and_then(Calibration::information);
    let prior = Prior::new(stated.anchor, calibrated, stated.taken_out);
    let adjusted = |prior: &Prior| Adjusted::new(&Known { reported, registered, surfaces, centre_mm, prior });
    // The camera's errors move nothing until they are taken out of the points; what is not known of them is an error, and a
    // single view tells nothing of them. Where nobody looked for them, the camera counts as exact.
    let with_contradictions = |prior: Prior| {
        let adjusted = adjusted(&prior)?;
        let more =
            adjusted.contradictions(&Known { reported, registered, surfaces, centre_mm, prior: &prior });
        Some((adjusted, more))
    };
    let exact = adjusted(&prior.with_exact_camera())?;
    let looked_for = surfaces.camera.is_some();
    // Value and uncertainty are of one model: the poses scatter as they do with an exact camera.
    let further =
        |prior: &Prior| exact.clone().further(&Known { reported, registered, surfaces, centre_mm, prior });
    let free = if looked_for || reported.len() == 1 { further(&prior)? } else { exact.clone() };
    let plain = with_contradictions(prior.with_exact_scale_and_axis())?;
    let with_axis = with_contradictions(prior.with_exact_scale())?;
    let told = if is_axis_told(&with_axis) { &with_axis } else { &plain };
    let camera = if looked_for { finding(&plain, told) } else { None };
    let (told, contradictions) = &with_axis;
    let hand_eye = correction(&exact, &free, stated.beyond_repair)?;
    let mut covariance = free.of_rigid_motions(&centre_mm);
    if !hand_eye.is_applied {
        // What is known to be wrong and left as it is counts as an error like any other.
        let left = left_as_is(&exact, registered, &centre_mm);
        covariance += &left * left.transpose();
    }
    let shared = shared([told, &free], stated.taken_out, contradictions);
    let Anchor::Cell(cell) = stated.anchor else {
        // The first pose is exact; the camera is not, and what no scan shows of it, its depth scale first, is an error of the tip.
        let (poses, covariance) = (registered.clone(), Some(covariance));
        return Some(Location { base_frame: None, camera, shared, poses, covariance });
    };
    let [turn, shift] = exact.scale;
    let (scale_mm, scale_deg) = (shift, turn);
    let (robot_mm, robot_deg) = (shift * cell.robot_mm, turn * cell.robot_deg);
    let poses = if hand_eye.is_applied { exact.poses } else { registered.clone() };
    let base_frame = Some(BaseFrame { hand_eye, robot_mm, robot_deg, scale_mm, scale_deg });
    Some(Location { base_frame, camera, shared, poses, covariance: Some(covariance) })
}

impl Location {
    /// Puts the views where they are in the base frame, and tells the registration how well that is known.
    pub fn settle(&self, registration: &mut Registration) {
        let Some(covariance) = &self.covariance else { return anchor_first(registration) };
        if self.base_frame.as_ref().is_some_and(|found| found.hand_eye.is_applied) {
            registration.base_from_camera.clone_from(&self.poses);
            registration.covariance = against_first(covariance);
        }
        registration.base_covariance = Some(covariance.clone());
    }
}

/// An adjustment, and what contradictions add to the covariance of what all views share.
type Checked = (Adjusted, SMatrix<f64, SHARED, SHARED>);

/// Whether the views tell far more of the optical axis than was known before.
fn is_axis_told((adjusted, contradictions): &Checked) -> bool {
    let at = adjusted.covariance.nrows() - SHARED;
    let usual = prior::usual(0.0, 0.0, 1.0);
    prior::AXIS.iter().all(|&k| {
        let variance = adjusted.covariance[(at + k, at + k)] + contradictions[(k, k)];
        variance.sqrt() < TOLD_SHARE * usual[k]
    })
}

/// The camera's errors as the views tell them: whether there are any is asked with the optical axis where it is stated, since
/// what bends faces near their ends passes for an axis that is off; how large they are, with the axis free.
fn finding(plain: &Checked, told: &Checked) -> Option<CameraFinding> {
    let [asked, found] = [plain, told].map(|(adjusted, contradictions)| {
        let at = adjusted.covariance.nrows() - 5;
        let formal: Matrix5<f64> = adjusted.covariance.fixed_view::<5, 5>(at, at).into_owned();
        (adjusted, formal + contradictions.fixed_view::<5, 5>(6, 6))
    });
    let squared = |(adjusted, covariance): &(&Adjusted, Matrix5<f64>)| {
        let errors = adjusted.camera.vector();
        Some(errors.dot(&covariance.cholesky()?.solve(&errors)))
    };
    let most = SIGNIFICANT_CAMERA * (1.0 + LOOSE_FREEDOM / asked.0.freedom);
    Some(CameraFinding {
        errors: found.0.camera,
        sigma: CameraErrors::from_vector(&found.1.diagonal().map(|v| v.max(0.0).sqrt())),
        is_significant: squared(&asked)? > most && !is_scattered(asked.0.scale),
        is_settled: squared(&found)? < SETTLED_CAMERA,
    })
}

/// What was found beside what is `taken_out` of the points already, with the depth scale exact and with it free: it is
/// exact until it is significant, as views from one distance do not tell it from a shift of the camera. How sure that is
/// is told by the free one, and by pairs of views that contradict each other.
fn shared(
    [exact, free]: [&Adjusted; 2],
    taken_out: Option<CameraErrors>,
    contradictions: &SMatrix<f64, SHARED, SHARED>,
) -> Calibration {
    let at = free.covariance.nrows() - SHARED;
    let covariance = free.covariance.fixed_view::<SHARED, SHARED>(at, at) + contradictions;
    let scale_sigma = covariance[(DEPTH_SCALE, DEPTH_SCALE)].sqrt();
    let taken_out = taken_out.unwrap_or_default();
    let (found, camera) = if free.camera.depth_scale.abs() > SIGNIFICANT_SIGMA * scale_sigma {
        (free, free.camera)
    } else {
        (exact, CameraErrors { depth_scale: 0.0, ..exact.camera })
    };
    Calibration { camera_from_corrected: found.hand_eye, camera: taken_out + camera, covariance }
}

/// Motions, six numbers of each view, from the registered poses to the adjusted ones.
fn left_as_is(adjusted: &Adjusted, registered: &[Isometry3<f64>], centre_mm: &Point3<f64>) -> DVector<f64> {
    let mut left = DVector::zeros(6 * registered.len());
    for (k, (pose, registered)) in adjusted.poses.iter().zip(registered).enumerate() {
        left.fixed_rows_mut::<6>(6 * k).copy_from(&parameters(&(pose * registered.inverse()), centre_mm));
    }
    left
}

fn is_scattered([turn, shift]: [f64; 2]) -> bool {
    turn.max(shift) > SCATTERED
}

/// What the views say of the hand-eye transform: the motion that is significant if the camera has no errors, and how exact
/// it is if it may have some.
fn correction(exact: &Adjusted, free: &Adjusted, beyond_repair: bool) -> Option<HandEyeCorrection> {
    let at = exact.covariance.nrows() - SHARED;
    let of =
        |adjusted: &Adjusted| -> Matrix6<f64> { adjusted.covariance.fixed_view::<6, 6>(at, at).into_owned() };
    let found: Vector6<f64> = parameters(&exact.hand_eye, &Point3::origin());
    let squared = found.dot(&of(exact).cholesky()?.solve(&found));
    let most = SIGNIFICANT * (1.0 + LOOSE_FREEDOM / exact.freedom);
    let covariance = of(free);
    let part = |at: usize| {
        let (own, value) =
            (covariance.fixed_view::<3, 3>(at, at).into_owned(), found.fixed_rows::<3>(at).into_owned());
        let worst = own.symmetric_eigenvalues().max().max(0.0).sqrt();
        let along = |axis: Vector3<f64>| axis.dot(&(own * axis)).max(0.0).sqrt();
        [value.norm(), value.try_normalize(1e-12).map_or(worst, along), worst]
    };
    let ([turn, turn_sigma, loosest], [shift_mm, shift_sigma_mm, loosest_mm]) = (part(0), part(3));
    Some(HandEyeCorrection {
        camera_from_corrected: exact.hand_eye,
        shift_mm,
        shift_sigma_mm,
        loosest_mm,
        turn_deg: turn.to_degrees(),
        turn_sigma_deg: turn_sigma.to_degrees(),
        loosest_deg: loosest.to_degrees(),
        // Poses that contradict what is stated of the robot are no ground to move the frame by.
        is_applied: squared > most && !beyond_repair && !is_scattered(exact.scale),
    })
}

/// From so many times the stated accuracy on, the poses scatter more than was stated: by chance half as much again.
const SCATTERED: f64 = 2.0;

impl BaseFrame {
    /// Whether the reported poses scatter more than stated.
    pub fn is_scattered(&self) -> bool {
        is_scattered([self.scale_deg, self.scale_mm])
    }

    /// What a user should know of it, if anything.
    pub fn warnings(&self) -> Vec<String> {
        self.hand_eye.is_applied.then(|| self.hand_eye.words()).into_iter().collect()
    }
}

impl CameraFinding {
    /// What a user should know of it, if anything.
    pub fn warnings(&self) -> Vec<String> {
        let words = || {
            format!(
                "camera: {}, corrected in all views; calibrate it with `weldpath calibrate`",
                self.words()
            )
        };
        self.is_significant.then(words).into_iter().collect()
    }

    /// The errors in words.
    pub fn words(&self) -> String {
        let (CameraErrors { focal, centre, k1, .. }, sigma) = (self.errors, &self.sigma);
        let axis = match sigma.centre {
            [columns, rows] if columns.max(rows) > NOT_ASKED => format!(
                "optical axis {:+.1} +- {:.1} and {:+.1} +- {:.1} thousandths of it, ",
                1e3 * centre[0],
                1e3 * columns,
                1e3 * centre[1],
                1e3 * rows,
            ),
            _ => String::new(),
        };
        format!(
            "focal length {:+.2} +- {:.2} % off, {axis}k1 {k1:+.4} +- {:.4}",
            100.0 * focal,
            100.0 * sigma.focal,
            sigma.k1,
        )
    }
}

impl HandEyeCorrection {
    /// In words.
    pub fn words(&self) -> String {
        format!(
            "hand-eye moved by {:.1} +- {:.1} mm and {:.2} +- {:.2} deg, in all views; write it back to your cell \
             (base_frame.hand_eye in summary.json)",
            self.shift_mm, self.shift_sigma_mm, self.turn_deg, self.turn_sigma_deg
        )
    }
}

/// Covariance of the motions of all views but the first against the first.
fn against_first(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let n = covariance.nrows() - 6;
    let c = |row: usize, column: usize| covariance[(row, column)];
    DMatrix::from_fn(n, n, |r, s| {
        let (first_r, first_s) = (r % 6, s % 6);
        c(r + 6, s + 6) - c(r + 6, first_s) - c(first_r, s + 6) + c(first_r, first_s)
    })
}

/// Tells the registration that its first view is exact.
pub fn anchor_first(registration: &mut Registration) {
    let n = registration.covariance.nrows();
    let mut covariance = DMatrix::zeros(n + 6, n + 6);
    covariance.view_mut((6, 6), (n, n)).copy_from(&registration.covariance);
    registration.base_covariance = Some(covariance);
}
