//! Errors of a camera that do not average out: depth scale, focal length, optical axis, radial distortion (ours; the model is
//! Brown's, "Decentering distortion of lenses", 1966, its first radial term).
//!
//! Each moves every point of every view in the same way in the camera's own frame. Views that see the same surfaces from
//! different places disagree by it, and the robot's poses tell what is left; [`base_frame`](super::base_frame) estimates
//! them with the poses and the hand-eye transform.

use crate::geometry::cloud::View;
use crate::model::normals::Patches;
use nalgebra::{
    DMatrix, DVector, Matrix3, Matrix3x5, Matrix5, Matrix6, Matrix6x5, Point3, SMatrix, Vector3, Vector5,
    Vector6,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One standard deviation of what a camera's own calibration leaves, where nobody states it: depth scale 0.2 %, of the order
/// that makers of industrial cameras state for lengths measured at working distance ("dimension trueness"); focal length
/// 0.5 % (Intel's D400 data sheet allows 2 % of the depth, its tuning guide expects well below 1 %); optical axis 5 mrad,
/// 3 pixels of a focal length of 600; k1 0.02, a fifth of what such a lens has uncorrected.
const USUAL: [f64; 5] = [0.002, 0.005, 0.005, 0.005, 0.02];

/// How far a camera is from what its intrinsics say.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CameraErrors {
    /// Depths are too large by this share.
    pub depth_scale: f64,
    /// The focal length is larger than stated by this share.
    pub focal: f64,
    /// The optical axis is this far from where it is stated, in focal lengths, columns and rows.
    pub centre: [f64; 2],
    /// First radial coefficient beyond the stated.
    pub k1: f64,
}

impl CameraErrors {
    /// Of depth scale, focal length, optical axis (two) and k1.
    pub(super) fn from_vector(errors: &Vector5<f64>) -> Self {
        let [depth_scale, focal, column, row, k1] = (*errors).into();
        Self { depth_scale, focal, centre: [column, row], k1 }
    }

    /// The same as one column.
    pub(super) fn vector(&self) -> Vector5<f64> {
        Vector5::new(self.depth_scale, self.focal, self.centre[0], self.centre[1], self.k1)
    }

    /// The view with these errors taken out of its points.
    pub(crate) fn taken_out_of(&self, view: &View) -> View {
        let errors = self.vector();
        let mend = |p: &Point3<f32>| {
            let p = p.cast::<f64>();
            (p + moved(&p) * errors).cast()
        };
        let points_mm = view.points_mm.par_iter().map(mend).collect();
        View { points_mm, ..view.clone() }
    }

    /// The same of its patches, whose normals turn as the surface does.
    pub(crate) fn taken_out_of_patches(&self, patches: &Patches) -> Patches {
        let errors = self.vector();
        let mut mended = patches.clone();
        let cloud = &mut mended.cloud;
        for (point, normal) in cloud.points_mm.iter_mut().zip(&mut cloud.normals) {
            let p = point.cast::<f64>();
            let slopes = Matrix3::from_columns(&slopes(&p).map(|slope| slope * errors));
            *point = (p + moved(&p) * errors).cast();
            *normal = (normal.cast::<f64>() - slopes.tr_mul(&normal.cast())).normalize().cast();
        }
        mended
    }
}

impl std::ops::Add for CameraErrors {
    type Output = Self;

    fn add(self, further: Self) -> Self {
        Self::from_vector(&(self.vector() + further.vector()))
    }
}

/// Standard deviations where nobody states any.
pub(super) fn usual() -> Vector5<f64> {
    Vector5::from(USUAL)
}

/// How far a point, camera frame, is from where it is seen, for each error, mm for an error of 1.
pub(super) fn moved(p: &Point3<f64>) -> Matrix3x5<f64> {
    if p.z <= 0.0 {
        return Matrix3x5::zeros();
    }
    let radius2 = (p.x * p.x + p.y * p.y) / (p.z * p.z);
    let aside = Vector3::new(p.x, p.y, 0.0);
    Matrix3x5::from_columns(&[-p.coords, -aside, -Vector3::x() * p.z, -Vector3::y() * p.z, -aside * radius2])
}

/// How [`moved`] changes along the three axes, 1/mm.
fn slopes(p: &Point3<f64>) -> [Matrix3x5<f64>; 3] {
    const STEP_MM: f64 = 1.0;
    [0, 1, 2].map(|axis| {
        let mut aside = Vector3::zeros();
        aside[axis] = STEP_MM;
        (moved(&(p + aside)) - moved(&(p - aside))) / (2.0 * STEP_MM)
    })
}

/// The rigid part of the same near a point: turn, rad, then shift of the point, mm; axes of the camera.
pub(super) fn moved_rigidly(p: &Point3<f64>) -> SMatrix<f64, 6, 5> {
    let [dx, dy, dz] = slopes(p);
    let mut rigid = SMatrix::<f64, 6, 5>::zeros();
    // Half the curl is the rotation of a displacement field.
    rigid.fixed_view_mut::<1, 5>(0, 0).copy_from(&((dy.row(2) - dz.row(1)) * 0.5));
    rigid.fixed_view_mut::<1, 5>(1, 0).copy_from(&((dz.row(0) - dx.row(2)) * 0.5));
    rigid.fixed_view_mut::<1, 5>(2, 0).copy_from(&((dx.row(1) - dy.row(0)) * 0.5));
    rigid.fixed_view_mut::<3, 5>(3, 0).copy_from(&moved(p));
    rigid
}

/// What the surfaces that views share tell of the camera's errors, beside the motions of all views but the first.
#[derive(Debug, Clone)]
pub struct CameraEvidence {
    /// Of the motions (six rows a view) with the errors.
    pub(super) with_poses: DMatrix<f64>,
    /// Of the errors alone.
    pub(super) information: Matrix5<f64>,
    /// Where the surfaces pull the errors.
    pub(super) pull: Vector5<f64>,
    /// What each pair of views tells by itself.
    pub(super) ties: Vec<TieEvidence>,
}

/// Normal equations of the pairs of patches between two views: motion of the first against the second about the centre, base
/// frame, rad and mm, and the camera's errors.
#[derive(Debug, Clone)]
pub(super) struct TieEvidence {
    pub(super) views: [usize; 2],
    pub(super) motion: Matrix6<f64>,
    pub(super) motion_pull: Vector6<f64>,
    pub(super) with_motion: Matrix6x5<f64>,
    pub(super) information: Matrix5<f64>,
    pub(super) pull: Vector5<f64>,
}

impl CameraEvidence {
    /// Of so many views but the first, nothing yet.
    pub(super) fn new(views: usize) -> Self {
        Self {
            with_poses: DMatrix::zeros(6 * views, 5),
            information: Matrix5::zeros(),
            pull: Vector5::zeros(),
            ties: Vec::new(),
        }
    }

    /// What pairs of views that contradict each other add to the covariance of the motions of all views but the first: the
    /// outer products of what each pair's own residuals do to the solution; `gain` is what a pull on these motions does to them.
    pub(super) fn contradictions(&self, gain: &DMatrix<f64>) -> DMatrix<f64> {
        let n = gain.nrows();
        let mut by_pair = BTreeMap::<[usize; 2], DVector<f64>>::new();
        for tie in &self.ties {
            let [i, j] = tie.views;
            let does = by_pair.entry([i.min(j), i.max(j)]).or_insert_with(|| DVector::zeros(n));
            for (view, sign) in [(i, 1.0), (j, -1.0)] {
                let Some(k) = view.checked_sub(1) else { continue };
                *does += gain.columns(6 * k, 6) * (tie.motion_pull * sign);
            }
        }
        let mut all = DMatrix::zeros(n, by_pair.len());
        by_pair.values().enumerate().for_each(|(k, does)| all.set_column(k, does));
        &all * all.transpose()
    }

    /// Adds what a pair of views tells.
    pub(super) fn add(&mut self, tie: TieEvidence) {
        for (view, sign) in tie.views.into_iter().zip([1.0, -1.0]) {
            let Some(k) = view.checked_sub(1) else { continue };
            let mut part = self.with_poses.fixed_view_mut::<6, 5>(6 * k, 0);
            part += tie.with_motion * sign;
        }
        self.information += tie.information;
        self.pull += tie.pull;
        self.ties.push(tie);
    }
}
