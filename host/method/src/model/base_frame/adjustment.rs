//! One least-squares adjustment of all poses, the hand-eye transform and the camera's own errors (ours).
//!
//! Unknown are the true pose of every camera, one motion `X` of the camera on the flange, and five errors of the camera. With
//! `R` the poses that the robot reports, by forward kinematics and the hand-eye transform as stated, the true ones are
//! `E R X`; `E` is the robot's own error in each view. Known are the surfaces, which tie the views to each other and tell how
//! one camera bends all of them, and priors of `E`, `X` and the camera. What the
//! data do not tie down stays at its prior. Gauss-Newton; millimetres and radians; motions are about one centre.

use super::prior::{Prior, SHARED};
use crate::model::camera::{self, CameraErrors};
use crate::model::reconstruction::SurfaceEvidence;
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6, Point3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3,
    Vector5, Vector6,
};

/// Steps at most. The problem is almost linear: a step leaves about a hundredth; the robot's scatter settles in a few.
const STEPS: usize = 8;
/// A step and a change of scale so small end it, mm at the centre and share.
const SETTLED_MM: f64 = 1e-3;
const SETTLED_SHARE: f64 = 0.02;
/// One standard deviation of a pose that is exact.
const EXACT_MM: f64 = 1e-4;
const EXACT_RAD: f64 = 1e-7;
/// The stated accuracy of the robot counts as much as so many observed coordinates, when its scatter is estimated.
const STATED_FREEDOM: f64 = 4.0;
/// Steps that bring an adjustment to one with more unknowns.
const FURTHER_STEPS: usize = 2;

/// What is known before.
pub(super) struct Known<'a> {
    pub(super) reported: &'a [Isometry3<f64>],
    pub(super) registered: &'a [Isometry3<f64>],
    /// Of the views but the first, about the centre.
    pub(super) surfaces: &'a SurfaceEvidence,
    pub(super) centre_mm: Point3<f64>,
    pub(super) prior: &'a Prior,
}

/// What is known after.
#[derive(Clone)]
pub(super) struct Adjusted {
    /// Of each camera.
    pub(super) poses: Vec<Isometry3<f64>>,
    /// Camera as stated from camera as it is.
    pub(super) hand_eye: Isometry3<f64>,
    /// Errors of the camera that are left in the points.
    pub(super) camera: CameraErrors,
    /// Of the motions of all poses about the centre, then of the hand-eye motion in the camera's frame, rad and mm; then of the
    /// camera's errors.
    pub(super) covariance: DMatrix<f64>,
    /// How far the robot's poses scatter, in multiples of what was stated: orientation, position.
    pub(super) scale: [f64; 2],
    /// What that estimate rests on, in coordinates.
    pub(super) freedom: f64,
}

type Row = SMatrix<f64, 6, 12>;

impl Adjusted {
    pub(super) fn new(known: &Known) -> Option<Self> {
        let mut now = Self {
            poses: known.registered.to_vec(),
            hand_eye: Isometry3::identity(),
            camera: CameraErrors::default(),
            covariance: DMatrix::zeros(0, 0),
            scale: [1.0; 2],
            freedom: STATED_FREEDOM,
        };
        for _ in 0..STEPS {
            let longest = now.step(known)?;
            let before = now.scale;
            now.rescale(known);
            let change = before.iter().zip(now.scale).map(|(a, b)| (b / a - 1.0).abs()).fold(0.0, f64::max);
            if longest < SETTLED_MM && change < SETTLED_SHARE {
                break;
            }
        }
        Some(now)
    }

    /// The same with other priors, such as of a camera that may have errors, and the scatter as it was found: estimated anew it
    /// would give way to whatever bends the surfaces, until neither poses nor camera were held by anything.
    pub(super) fn further(mut self, known: &Known) -> Option<Self> {
        for _ in 0..FURTHER_STEPS {
            self.step(known)?;
        }
        Some(self)
    }

    /// One step; its largest number.
    fn step(&mut self, known: &Known) -> Option<f64> {
        let (information, pull) = self.normal_equations(known);
        let factor = information.cholesky()?;
        let step = factor.solve(&pull);
        self.covariance = factor.inverse();
        self.apply(&step, &known.centre_mm);
        Some(step.amax())
    }

    fn normal_equations(&self, known: &Known) -> (DMatrix<f64>, DVector<f64>) {
        let views = self.poses.len();
        let x = 6 * views;
        let mut information = DMatrix::zeros(x + SHARED, x + SHARED);
        let mut pull = DVector::zeros(x + SHARED);
        self.add_surfaces(known, &mut information, &mut pull);
        for k in 0..views {
            let (left, row) = self.pose_row(known, k);
            let weights = self.pose_weights(known, k);
            let weighted = row.transpose() * Matrix6::from_diagonal(&weights);
            let (square, side) = (weighted * row, weighted * left);
            for (a, at) in [(0, 6 * k), (6, x)] {
                let mut part = pull.fixed_rows_mut::<6>(at);
                part -= side.fixed_rows::<6>(a);
                for (b, to) in [(0, 6 * k), (6, x)] {
                    let mut part = information.fixed_view_mut::<6, 6>(at, to);
                    part += square.fixed_view::<6, 6>(a, b);
                }
            }
        }
        let held = &known.prior.shared;
        let mut part = pull.fixed_rows_mut::<SHARED>(x);
        part -= held * (self.shared() + known.prior.taken_out);
        let mut part = information.fixed_view_mut::<SHARED, SHARED>(x, x);
        part += held;
        (information, pull)
    }

    /// Covariance of what all views share as the pairs of views contradict each other: the outer products of what each pair's
    /// own residuals do to the solution (Huber's and White's "sandwich", with pairs of views as clusters).
    pub(super) fn contradictions(&self, known: &Known) -> SMatrix<f64, SHARED, SHARED> {
        let mut sum = SMatrix::zeros();
        let Some(camera) = &known.surfaces.camera else { return sum };
        let motion = |k: usize| self.poses[k] * known.registered[k].inverse();
        let done: Vec<Vector6<f64>> =
            (0..self.poses.len()).map(|k| parameters(&motion(k), &known.centre_mm)).collect();
        let (x, errors) = (6 * self.poses.len(), self.camera.vector());
        let mut by_pair = std::collections::BTreeMap::<[usize; 2], SVector<f64, SHARED>>::new();
        for tie in &camera.ties {
            let [i, j] = tie.views;
            let moved = done[i] - done[j];
            let left = tie.motion_pull - tie.motion * moved - tie.with_motion * errors;
            let own = tie.pull - tie.with_motion.tr_mul(&moved) - tie.information * errors;
            let rows = |at: usize| self.covariance.fixed_view::<SHARED, 6>(x, at);
            let camera = self.covariance.fixed_view::<SHARED, 5>(x, x + 6);
            let does = rows(6 * i) * left - rows(6 * j) * left + camera * own;
            *by_pair.entry([i.min(j), i.max(j)]).or_insert_with(SVector::zeros) += does;
        }
        for does in by_pair.values() {
            sum += does * does.transpose();
        }
        sum
    }

    /// Covariance of what poses and camera together do to the middle of the work: six numbers of each view, rad and mm.
    pub(super) fn of_rigid_motions(&self, centre_mm: &Point3<f64>) -> DMatrix<f64> {
        let n = 6 * self.poses.len();
        let mut of_all = DMatrix::identity(n, n + SHARED);
        for (k, pose) in self.poses.iter().enumerate() {
            let turn = pose.rotation.to_rotation_matrix();
            let rigid = camera::moved_rigidly(&pose.inverse_transform_point(centre_mm));
            for part in [0, 3] {
                let in_base = turn.matrix() * rigid.fixed_view::<3, 5>(part, 0);
                of_all.fixed_view_mut::<3, 5>(6 * k + part, n + 6).copy_from(&in_base);
            }
        }
        &of_all * &self.covariance * of_all.transpose()
    }

    /// Hand-eye motion and the camera's errors as one column.
    fn shared(&self) -> SVector<f64, SHARED> {
        let mut shared = SVector::<f64, SHARED>::zeros();
        shared.fixed_rows_mut::<6>(0).copy_from(&parameters(&self.hand_eye, &Point3::origin()));
        shared.fixed_rows_mut::<5>(6).copy_from(&self.camera.vector());
        shared
    }

    /// The surfaces know where each view is against the first, and nothing of where all of them are.
    fn add_surfaces(&self, known: &Known, information: &mut DMatrix<f64>, pull: &mut DVector<f64>) {
        let motion = |k: usize| self.poses[k] * known.registered[k].inverse();
        let back = motion(0).inverse();
        let others = self.poses.len() - 1;
        let mut done = DVector::zeros(6 * others);
        for k in 0..others {
            let against_first = parameters(&(back * motion(k + 1)), &known.centre_mm);
            done.fixed_rows_mut::<6>(6 * k).copy_from(&against_first);
        }
        let seen = &known.surfaces.information;
        let mut left = &known.surfaces.pull - seen * &done;
        if let Some(camera) = &known.surfaces.camera {
            let errors = self.camera.vector();
            left -= &camera.with_poses * errors;
            let at = 6 * self.poses.len() + 6;
            let own = camera.pull - camera.with_poses.tr_mul(&done) - camera.information * errors;
            let mut part = pull.fixed_rows_mut::<5>(at);
            part += own;
            let mut part = information.fixed_view_mut::<5, 5>(at, at);
            part += camera.information;
            for k in 0..others {
                let block = camera.with_poses.fixed_view::<6, 5>(6 * k, 0);
                for (view, sign) in [(k + 1, 1.0), (0, -1.0)] {
                    let mut part = information.fixed_view_mut::<6, 5>(6 * view, at);
                    part += block * sign;
                    let mut part = information.fixed_view_mut::<5, 6>(at, 6 * view);
                    part += block.transpose() * sign;
                }
            }
        }
        for k in 0..others {
            let own = left.fixed_rows::<6>(6 * k);
            let mut part = pull.fixed_rows_mut::<6>(6 * (k + 1));
            part += own;
            let mut part = pull.fixed_rows_mut::<6>(0);
            part -= own;
            for l in 0..others {
                let block = seen.fixed_view::<6, 6>(6 * k, 6 * l);
                for (at, to, sign) in [(k + 1, l + 1, 1.0), (k + 1, 0, -1.0), (0, l + 1, -1.0), (0, 0, 1.0)] {
                    let mut part = information.fixed_view_mut::<6, 6>(6 * at, 6 * to);
                    part += block * sign;
                }
            }
        }
    }

    /// Error of the robot in view `k` as the unknowns are (turn, shift of the camera), and its change with the view's motion
    /// and with the hand-eye motion.
    fn pose_row(&self, known: &Known, k: usize) -> (Vector6<f64>, Row) {
        let (pose, expected) = (&self.poses[k], known.reported[k] * self.hand_eye);
        let turn = (pose.rotation * expected.rotation.inverse()).scaled_axis();
        let shift = pose.translation.vector - expected.translation.vector;
        let arm = pose.translation.vector - known.centre_mm.coords;
        let axes = -expected.rotation.to_rotation_matrix().into_inner();
        let mut row = Row::zeros();
        row.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
        row.fixed_view_mut::<3, 3>(3, 0).copy_from(&-arm.cross_matrix());
        row.fixed_view_mut::<3, 3>(0, 6).copy_from(&axes);
        row.fixed_view_mut::<3, 3>(3, 9).copy_from(&axes);
        (stacked(&turn, &shift), row)
    }

    fn pose_weights(&self, known: &Known, view: usize) -> Vector6<f64> {
        let ([turn, shift], prior) = (self.scale, known.prior);
        if prior.first_exact && view == 0 {
            return weights_of(EXACT_RAD, EXACT_MM);
        }
        weights_of(turn * prior.robot_rad, shift * prior.robot_mm)
    }

    fn apply(&mut self, step: &DVector<f64>, centre_mm: &Point3<f64>) {
        let views = self.poses.len();
        for (k, pose) in self.poses.iter_mut().enumerate() {
            *pose = motion(&step.fixed_rows::<6>(6 * k).into_owned(), centre_mm) * *pose;
        }
        self.hand_eye *= motion(&step.fixed_rows::<6>(6 * views).into_owned(), &Point3::origin());
        let further: Vector5<f64> = step.fixed_rows::<5>(6 * views + 6).into_owned();
        self.camera = CameraErrors::from_vector(&(self.camera.vector() + further));
    }

    /// Estimates the scatter of the robot's poses from what is left of them, orientation and position each (Helmert's
    /// estimate of variance components), with what was stated as some observations more.
    fn rescale(&mut self, known: &Known) {
        let x = 6 * self.poses.len();
        let stated = weights_of(known.prior.robot_rad, known.prior.robot_mm);
        let (mut squares, mut freedom) = ([STATED_FREEDOM; 2], [STATED_FREEDOM; 2]);
        for k in usize::from(known.prior.first_exact)..self.poses.len() {
            let (left, row) = self.pose_row(known, k);
            let weights = self.pose_weights(known, k);
            let mut own = SMatrix::<f64, 12, 12>::zeros();
            for (a, at) in [(0, 6 * k), (6, x)] {
                for (b, to) in [(0, 6 * k), (6, x)] {
                    own.fixed_view_mut::<6, 6>(a, b).copy_from(&self.covariance.fixed_view::<6, 6>(at, to));
                }
            }
            let explained = row * own * row.transpose();
            for d in 0..6 {
                squares[d / 3] += stated[d] * left[d] * left[d];
                freedom[d / 3] += 1.0 - (weights[d] * explained[(d, d)]).clamp(0.0, 1.0);
            }
        }
        self.scale = [0, 1].map(|group| (squares[group] / freedom[group]).sqrt());
        self.freedom = freedom[0] + freedom[1] - STATED_FREEDOM;
    }
}

/// Information of a turn and a shift with these standard deviations about and along each axis.
fn weights_of(turn_rad: f64, shift_mm: f64) -> Vector6<f64> {
    stacked(&Vector3::repeat(turn_rad.powi(-2)), &Vector3::repeat(shift_mm.powi(-2)))
}

fn stacked(turn: &Vector3<f64>, shift: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}

/// Rotation vector of a motion, and shift of the centre.
pub(super) fn parameters(motion: &Isometry3<f64>, centre_mm: &Point3<f64>) -> Vector6<f64> {
    stacked(&motion.rotation.scaled_axis(), &(motion * centre_mm - centre_mm))
}

/// The motion with these parameters.
pub(super) fn motion(parameters: &Vector6<f64>, centre_mm: &Point3<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(parameters.fixed_rows::<3>(0).into_owned());
    let c = centre_mm.coords;
    Isometry3::from_parts(Translation3::from(c - turn * c + parameters.fixed_rows::<3>(3)), turn)
}
