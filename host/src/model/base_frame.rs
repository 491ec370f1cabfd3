//! Where the whole model is in the robot's base frame, and how well that is known (ours; the paper takes the hand-eye
//! transform and the robot's poses as exact).
//!
//! Registration ties the views to each other and leaves the first where the robot reported it, with all the errors of that
//! pose. What registration made of the other poses tells most of them: an error of the hand-eye transform moves every camera
//! alike in its own frame. Where it is significant it is taken out of all poses; what remains, known or not, is the
//! error of the frame. Millimetres, radians where a name says nothing else.

mod adjustment;

use crate::model::reconstruction::{Registration, SurfaceEvidence};
pub use adjustment::CellAccuracy;
use adjustment::{Adjusted, Known, parameters};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Point3, Vector3, Vector6};

/// Of the squared size of a hand-eye motion in standard deviations, six numbers: by chance it is larger in one of 370 scans,
/// as one number is beyond three standard deviations.
const SIGNIFICANT: f64 = 20.1;
/// Where the scatter itself is estimated from so many coordinates that the bound has to be twice as large, chance is to
/// find a motion as seldom (quantiles of Fisher's F for 6 and 12 to 40).
const LOOSE_FREEDOM: f64 = 9.0;

/// What holds the model in the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Anchor {
    /// Poses and hand-eye transform are as accurate as this.
    Cell(CellAccuracy),
    /// The first view that fits is where it is reported, exactly.
    First,
}

impl Default for Anchor {
    fn default() -> Self {
        Self::Cell(CellAccuracy::default())
    }
}

/// What the views say of the cell.
#[derive(Debug, Clone, PartialEq)]
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
    poses: Vec<Isometry3<f64>>,
    covariance: DMatrix<f64>,
}

/// Motion of the camera on the flange.
#[derive(Debug, Clone, PartialEq)]
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

/// Locates the registered views, given what the robot reported of them; none where a registration says too little.
///
/// Where the hand-eye transform is `beyond_repair`, nothing is corrected: it belongs to another camera or another flange.
pub fn locate(
    reported: &[Isometry3<f64>],
    registration: &Registration,
    cell: CellAccuracy,
    beyond_repair: bool,
) -> Option<BaseFrame> {
    let alone = SurfaceEvidence::of_one_view();
    let surfaces = match reported.len() {
        1 => &alone,
        _ => registration.evidence.as_ref()?,
    };
    let (registered, centre_mm) = (&registration.base_from_camera, registration.centre_mm);
    let adjusted = Adjusted::new(&Known { reported, registered, surfaces, centre_mm, cell })?;
    let [turn, shift] = adjusted.scale;
    let hand_eye = correction(&adjusted, beyond_repair)?;
    let poses = 6 * reported.len();
    let mut covariance = adjusted.covariance.view((0, 0), (poses, poses)).into_owned();
    if !hand_eye.is_applied {
        // What is known to be wrong and left as it is counts as an error like any other.
        let left = left_as_is(&adjusted, registered, &centre_mm);
        covariance += &left * left.transpose();
    }
    Some(BaseFrame {
        hand_eye,
        robot_mm: shift * cell.robot_mm,
        robot_deg: turn * cell.robot_deg,
        scale_mm: shift,
        scale_deg: turn,
        poses: adjusted.poses,
        covariance,
    })
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

fn correction(adjusted: &Adjusted, beyond_repair: bool) -> Option<HandEyeCorrection> {
    let at = adjusted.covariance.nrows() - 6;
    let covariance: Matrix6<f64> = adjusted.covariance.fixed_view::<6, 6>(at, at).into_owned();
    let found: Vector6<f64> = parameters(&adjusted.hand_eye, &Point3::origin());
    let squared = found.dot(&covariance.cholesky()?.solve(&found));
    let most = SIGNIFICANT * (1.0 + LOOSE_FREEDOM / adjusted.freedom);
    let part = |at: usize| {
        let (own, value) =
            (covariance.fixed_view::<3, 3>(at, at).into_owned(), found.fixed_rows::<3>(at).into_owned());
        let worst = own.symmetric_eigenvalues().max().max(0.0).sqrt();
        let along = |axis: Vector3<f64>| axis.dot(&(own * axis)).max(0.0).sqrt();
        [value.norm(), value.try_normalize(1e-12).map_or(worst, along), worst]
    };
    let ([turn, turn_sigma, loosest], [shift_mm, shift_sigma_mm, loosest_mm]) = (part(0), part(3));
    Some(HandEyeCorrection {
        camera_from_corrected: adjusted.hand_eye,
        shift_mm,
        shift_sigma_mm,
        loosest_mm,
        turn_deg: turn.to_degrees(),
        turn_sigma_deg: turn_sigma.to_degrees(),
        loosest_deg: loosest.to_degrees(),
        // Poses that contradict what is stated of the robot are no ground to move the frame by.
        is_applied: squared > most && !beyond_repair && !is_scattered(adjusted.scale),
    })
}

/// From so many times the stated accuracy on, the poses scatter more than was stated: by chance half as much again.
const SCATTERED: f64 = 2.0;

impl BaseFrame {
    /// Whether the reported poses scatter more than stated.
    pub fn is_scattered(&self) -> bool {
        is_scattered([self.scale_deg, self.scale_mm])
    }

    /// Puts the views where they are in the base frame, and tells the registration how well that is known.
    pub fn settle(&self, registration: &mut Registration) {
        if self.hand_eye.is_applied {
            registration.base_from_camera.clone_from(&self.poses);
            registration.covariance = against_first(&self.covariance);
        }
        registration.base_covariance = Some(self.covariance.clone());
    }

    /// What a user should know of it, if anything.
    pub fn warnings(&self) -> Vec<String> {
        self.hand_eye.is_applied.then(|| self.hand_eye.words()).into_iter().collect()
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
