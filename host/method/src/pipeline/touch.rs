//! Points of seams that the robot's own tip touched: they say where the plan is in the base frame, whatever robot, hand-eye
//! transform and camera got wrong (ours).
//!
//! A motion of the whole plan, shift and turn, is estimated by least squares with the stated error of the base frame as its
//! prior. A touch on a seam tells both directions across it and nothing along it. About the middle of the touches a single
//! one only shifts; several turn as far as they are apart and the prior lets them.

use super::result::Plan;
use crate::model::base_frame::CellAccuracy;
use crate::seam::{Seam, Station};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Matrix6, Point3, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// A place that the tip touched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Where the tip was, mm, base frame.
    pub at_mm: Point3<f64>,
    /// [`Seam::id`] of the seam that it touched; the nearest if not said.
    pub seam: Option<usize>,
    /// One standard deviation of a touch, each axis, mm.
    pub sigma_mm: f64,
}

/// What touches made of a plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Touched {
    /// From the plan as it was to the plan as it was touched, mm.
    pub base_from_planned: Isometry3<f64>,
    /// How far that moves the middle of the touches, mm.
    pub shift_mm: Vector3<f64>,
    /// How far it turns, degrees.
    pub turn_deg: f64,
    /// Of each touch, in their order.
    pub residuals: Vec<Residual>,
    /// Middle of the touches, and covariance of the motion that is left about it (turn, shift; rad, mm).
    middle_mm: Point3<f64>,
    covariance: Matrix6<f64>,
    /// Whether the plan's own errors in the base frame were known before.
    is_stated: bool,
}

/// How far a touch is from its seam, across it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// [`Seam::id`].
    pub seam: usize,
    /// As planned, mm.
    pub before_mm: f64,
    /// After the motion, mm.
    pub after_mm: f64,
}

/// Why touches are not taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A seam that there is not.
    #[error("touch {number}: there is no seam {seam}")]
    NoSuchSeam {
        /// Of the touch, from 1.
        number: usize,
        /// As it was named.
        seam: usize,
    },
    /// Two seams are about as near.
    #[error(
        "touch {number}: seams {nearest} and {other} are about as near, {nearest_mm:.1} and {other_mm:.1} mm"
    )]
    Ambiguous {
        /// Of the touch, from 1.
        number: usize,
        /// Nearest seam.
        nearest: usize,
        /// Next.
        other: usize,
        /// Their distances.
        nearest_mm: f64,
        /// Of the other.
        other_mm: f64,
    },
    /// Farther from its seam than robot, hand-eye transform and camera explain.
    #[error("touch {number} is {distance_mm:.1} mm from seam {seam}; at most {most_mm:.1} mm is plausible")]
    Implausible {
        /// Of the touch, from 1.
        number: usize,
        /// Its seam.
        seam: usize,
        /// Across the seam, or beyond its end.
        distance_mm: f64,
        /// From which on it is not believed.
        most_mm: f64,
    },
    /// No motion brings it to its seam together with the others.
    #[error(
        "touch {number} contradicts the others: it remains {left_mm:.1} mm from seam {seam}; at most {most_mm:.1} mm is plausible"
    )]
    Contradiction {
        /// Of the touch, from 1.
        number: usize,
        /// Its seam.
        seam: usize,
        /// After the motion.
        left_mm: f64,
        /// From which on it is not believed.
        most_mm: f64,
    },
    /// Nothing ties the plan to a robot.
    #[error("the plan is in the camera's frame, touches are in the robot's")]
    NoBaseFrame,
}

/// What is stated of nothing where the first view's pose counts as exact, hand-eye transform and camera: each axis, mm and
/// degrees.
const UNSTATED_MM: f64 = 1.0;
const UNSTATED_DEG: f64 = 0.3;
/// Standard deviations from which on a touch is not believed.
const UNBELIEVED: f64 = 5.0;
/// Another seam that is not farther than so many times the nearest, and so much more, might be meant as well, mm.
const ALIKE: f64 = 2.0;
const ALIKE_MM: f64 = 1.0;
/// Rounds of finding feet and moving: the motion is almost linear.
const ROUNDS: usize = 4;

/// Where the perpendicular from a touch meets its seam.
struct Foot {
    seam: usize,
    /// Errors of the seam: within the scan, mm; in the base frame, mm and degrees.
    relative_mm: f64,
    base: [f64; 2],
    at_mm: Point3<f64>,
    tangent: Vector3<f64>,
}

impl Foot {
    /// Two directions across the seam.
    fn across(&self) -> [Vector3<f64>; 2] {
        let aside = if self.tangent.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
        let first = self.tangent.cross(&aside).normalize();
        [first, self.tangent.cross(&first)]
    }
}

/// The motion that the touches tell of a plan.
///
/// # Errors
/// If a touch is on no seam, on two, or farther off than can be believed.
pub fn fit(plan: &Plan, touches: &[Touch]) -> Result<Touched, Error> {
    let mut feet = Vec::with_capacity(touches.len());
    for (k, touch) in touches.iter().enumerate() {
        feet.push(first_foot(plan, touch, k + 1)?);
    }
    let sum: Vector3<f64> = touches.iter().map(|touch| touch.at_mm.coords).sum();
    let middle_mm = Point3::from(sum / touches.len().max(1) as f64);
    let prior = prior(&feet, plan.derived.base_frame.is_some());
    let before: Vec<f64> =
        feet.iter().zip(touches).map(|(foot, touch)| (touch.at_mm - foot.at_mm).norm()).collect();
    for ((k, foot), (distance_mm, touch)) in feet.iter().enumerate().zip(before.iter().zip(touches)) {
        let most_mm = UNBELIEVED * (prior[(3, 3)] + touch.sigma_mm.powi(2) + foot.relative_mm.powi(2)).sqrt();
        if *distance_mm > most_mm {
            let (number, seam, distance_mm) = (k + 1, foot.seam, *distance_mm);
            return Err(Error::Implausible { number, seam, distance_mm, most_mm });
        }
    }
    let mut motion = Isometry3::identity();
    let mut solved = (Vector6::zeros(), prior);
    for _ in 0..ROUNDS {
        solved = step(&feet, touches, &prior, middle_mm, &solved.0);
        motion = as_motion(&solved.0, middle_mm);
        for (foot, touch) in feet.iter_mut().zip(touches) {
            let seam = plan.seams.iter().find(|seam| seam.id == foot.seam);
            *foot = seam
                .and_then(|seam| foot_on(seam, &touch.at_mm, &motion))
                .ok_or(Error::NoSuchSeam { number: 1, seam: foot.seam })?;
        }
    }
    let mut residuals = Vec::with_capacity(touches.len());
    for ((k, foot), (before_mm, touch)) in feet.iter().enumerate().zip(before.iter().zip(touches)) {
        let left_mm = (touch.at_mm - foot.at_mm).norm();
        let most_mm = UNBELIEVED * touch.sigma_mm.hypot(foot.relative_mm);
        if left_mm > most_mm {
            return Err(Error::Contradiction { number: k + 1, seam: foot.seam, left_mm, most_mm });
        }
        residuals.push(Residual { seam: foot.seam, before_mm: *before_mm, after_mm: left_mm });
    }
    Ok(Touched {
        base_from_planned: motion,
        shift_mm: motion * middle_mm - middle_mm,
        turn_deg: motion.rotation.angle().to_degrees(),
        residuals,
        middle_mm,
        covariance: solved.1,
        is_stated: plan.derived.base_frame.is_some(),
    })
}

/// Covariance of the plan's motion before any touch: turn and shift about the touches, rad and mm.
fn prior(feet: &[Foot], is_stated: bool) -> Matrix6<f64> {
    let usual = CellAccuracy::default();
    // Stated is the error of two axes together, and of three; of a cloud without its cameras nothing is.
    let each =
        |stated: f64, axes: f64, usual: f64| if stated.is_finite() { stated / axes.sqrt() } else { usual };
    let largest = |of: &dyn Fn(&Foot) -> f64| feet.iter().map(of).fold(0.0, f64::max);
    let [more_mm, more_deg] = if is_stated { [0.0; 2] } else { [UNSTATED_MM, UNSTATED_DEG] };
    let shift = largest(&|foot| each(foot.base[0], 2.0, usual.hand_eye_mm)).hypot(more_mm);
    let turn = largest(&|foot| each(foot.base[1], 3.0, usual.hand_eye_deg)).hypot(more_deg).to_radians();
    let mut prior = Matrix6::identity() * turn.powi(2);
    prior.fixed_view_mut::<3, 3>(3, 3).copy_from(&(Matrix3::identity() * shift.powi(2)));
    prior
}

/// The whole motion and its covariance, by the feet as they are after the motion `done`.
fn step(
    feet: &[Foot],
    touches: &[Touch],
    prior: &Matrix6<f64>,
    middle_mm: Point3<f64>,
    done: &Vector6<f64>,
) -> (Vector6<f64>, Matrix6<f64>) {
    let n = 2 * feet.len();
    let (mut rows, mut seen) = (DMatrix::zeros(n, 6), DVector::zeros(n));
    let mut noise = DMatrix::zeros(n, n);
    for (k, (foot, touch)) in feet.iter().zip(touches).enumerate() {
        let arm = foot.at_mm - middle_mm;
        for (j, across) in foot.across().iter().enumerate() {
            let turning = arm.cross(across);
            for axis in 0..3 {
                rows[(2 * k + j, axis)] = turning[axis];
                rows[(2 * k + j, 3 + axis)] = across[axis];
            }
            seen[2 * k + j] = across.dot(&(touch.at_mm - foot.at_mm));
            noise[(2 * k + j, 2 * k + j)] = touch.sigma_mm.powi(2) + 0.5 * foot.relative_mm.powi(2);
        }
    }
    seen += &rows * done;
    let gain = prior * rows.transpose();
    let innovation = &rows * &gain + noise;
    // Positive definite: every touch has noise.
    let Some(factor) = innovation.cholesky() else { return (*done, *prior) };
    let motion = &gain * factor.solve(&seen);
    let told = &gain * factor.solve(&gain.transpose());
    (motion, prior - Matrix6::from_iterator(told.iter().copied()))
}

fn as_motion(parameters: &Vector6<f64>, middle_mm: Point3<f64>) -> Isometry3<f64> {
    let part = |at: usize| Vector3::new(parameters[at], parameters[at + 1], parameters[at + 2]);
    let turn = nalgebra::UnitQuaternion::from_scaled_axis(part(0));
    let shift = middle_mm.coords + part(3) - turn * middle_mm.coords;
    Isometry3::from_parts(shift.into(), turn)
}

/// The foot of a touch on the seam that it names, or on the nearest.
fn first_foot(plan: &Plan, touch: &Touch, number: usize) -> Result<Foot, Error> {
    let still = Isometry3::identity();
    if let Some(id) = touch.seam {
        let seam = plan.seams.iter().find(|seam| seam.id == id);
        return seam
            .and_then(|seam| foot_on(seam, &touch.at_mm, &still))
            .ok_or(Error::NoSuchSeam { number, seam: id });
    }
    let away_mm = |foot: &Foot| (touch.at_mm - foot.at_mm).norm();
    let mut feet: Vec<Foot> =
        plan.seams.iter().filter_map(|seam| foot_on(seam, &touch.at_mm, &still)).collect();
    feet.sort_by(|a, b| away_mm(a).total_cmp(&away_mm(b)));
    let mut feet = feet.into_iter();
    let nearest = feet.next().ok_or(Error::NoSuchSeam { number, seam: 1 })?;
    let nearest_mm = away_mm(&nearest);
    match feet.next() {
        Some(other) if away_mm(&other) < ALIKE * nearest_mm + ALIKE_MM => Err(Error::Ambiguous {
            number,
            nearest: nearest.seam,
            other: other.seam,
            nearest_mm,
            other_mm: away_mm(&other),
        }),
        _ => Ok(nearest),
    }
}

/// The nearest place of a moved seam.
fn foot_on(seam: &Seam, at_mm: &Point3<f64>, motion: &Isometry3<f64>) -> Option<Foot> {
    let moved = |station: &Station| motion * station.position_mm;
    let mut ends: Vec<Point3<f64>> = seam.stations.iter().map(moved).collect();
    ends.extend(ends.first().copied().filter(|_| seam.closed));
    let on = |pair: &[Point3<f64>]| {
        let way = pair[1] - pair[0];
        let share = ((at_mm - pair[0]).dot(&way) / way.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (pair[0] + way * share, way)
    };
    let feet = ends.windows(2).map(on).filter(|(_, way)| way.norm() > 0.0);
    let (foot, way) = feet.min_by(|a, b| (at_mm - a.0).norm().total_cmp(&(at_mm - b.0).norm()))?;
    Some(Foot {
        seam: seam.id,
        relative_mm: seam.relative_error_mm,
        base: [seam.base_error_mm, seam.base_error_deg],
        at_mm: foot,
        tangent: way.normalize(),
    })
}

impl Touched {
    /// Writes into a plan that was made anew, with all poses moved, what it is known by: its errors, the poses that the
    /// robot had reported, and a word on it.
    pub fn settle(self, plan: &mut Plan) {
        for seam in &mut plan.seams {
            let [shift_mm2, turn_rad2] = self.left_at(seam);
            let mm = (seam.relative_error_mm.powi(2) + shift_mm2).sqrt();
            let deg = seam.expected_error_deg.hypot(turn_rad2.sqrt().to_degrees());
            // The prior is the same in all directions, where what was known is not: a touch makes nothing less sure.
            let surer = |stated: f64, left: f64| if self.is_stated { left.min(stated) } else { left };
            let held_mm = surer(seam.base_error_mm, mm);
            if held_mm >= mm {
                seam.error_parts = seam.error_parts.held_by_touch(seam.relative_error_mm, shift_mm2.sqrt());
            }
            seam.base_error_mm = held_mm;
            seam.base_error_deg = surer(seam.base_error_deg, deg);
        }
        for view in &mut plan.derived.views {
            view.reported = self.base_from_planned.inverse() * view.reported;
        }
        plan.said.warnings.insert(0, self.words());
        plan.derived.touch = Some(self);
    }

    /// Variances of a seam's motion that is left: across it, mm², and of its orientation, rad²; means over its stations.
    fn left_at(&self, seam: &Seam) -> [f64; 2] {
        let of = |station: &Station| {
            let arm = station.position_mm - self.middle_mm;
            let mut moved = nalgebra::Matrix3x6::zeros();
            moved.fixed_view_mut::<3, 3>(0, 0).copy_from(&-arm.cross_matrix());
            moved.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
            let covariance = moved * self.covariance * moved.transpose();
            covariance.trace() - station.tangent.dot(&(covariance * station.tangent))
        };
        let count = seam.stations.len().max(1) as f64;
        let turned = self.covariance.fixed_view::<3, 3>(0, 0).trace();
        [seam.stations.iter().map(of).sum::<f64>() / count, turned]
    }

    /// In words.
    pub fn words(&self) -> String {
        let [x, y, z]: [f64; 3] = self.shift_mm.into();
        let each: Vec<String> = self
            .residuals
            .iter()
            .map(|r| format!("seam {}: {:.2} mm off before, {:.2} after", r.seam, r.before_mm, r.after_mm))
            .collect();
        format!(
            "touched: the plan is moved by {x:.2},{y:.2},{z:.2} mm and {:.2} deg ({})",
            self.turn_deg,
            each.join("; ")
        )
    }
}
