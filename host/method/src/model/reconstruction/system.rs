//! The joint linear system of all views and what of its solution is believed.

use super::{SurfaceEvidence, weak};
use crate::geometry::point_to_plane;
use crate::model::camera::{self, CameraEvidence, TieEvidence};
use nalgebra::{
    Cholesky, DMatrix, DVector, Dyn, Isometry3, Matrix3x5, Matrix5, Matrix6, Matrix6x5, Point3,
    UnitQuaternion, Vector3, Vector5, Vector6,
};

/// Share of information, of a motion that every pair sees in full, below which a motion counts as unseen.
const UNSEEN: f64 = 1e-4;
/// From so many unknowns on, 35 views, the eigenvectors that are unseen are sought alone: all of them would cost most of a step.
const MANY_UNKNOWNS: usize = 200;

/// A pair of patches of two views in the target's frame, its arm from the centre.
pub(super) struct PatchPair {
    pub(super) arm: Vector3<f32>,
    /// Of the target patch, and the distance of the source patch above it.
    pub(super) normal: Vector3<f32>,
    pub(super) residual_mm: f32,
    /// Of the source patch, and the distance of the target patch below it.
    pub(super) own_normal: Vector3<f32>,
    pub(super) own_residual_mm: f32,
    pub(super) weight: f32,
}

/// Normal equations of the pairs between two views, eq. (7).
#[derive(Default)]
pub(super) struct Block {
    information: Matrix6<f64>,
    pull: Vector6<f64>,
    weight: f64,
}

impl PatchPair {
    /// Robust weight (Geman-McClure), 1/mm².
    fn weight(&self, scale: f64) -> f64 {
        f64::from(self.weight) / (1.0 + (f64::from(self.residual_mm) / (2.0 * scale)).powi(2)).powi(2)
    }
}

impl Block {
    pub(super) fn add(&mut self, p: &PatchPair, scale: f64) {
        let (residual_mm, own_residual_mm) = (f64::from(p.residual_mm), f64::from(p.own_residual_mm));
        let w = p.weight(scale);
        // Two normals of one surface with independent noise: their product is unbiased where a square is not, so noise
        // does not pass for information (instrumental variables).
        let arm = p.arm.cast();
        let (own, other) =
            (point_to_plane::row(&arm, &p.own_normal.cast()), point_to_plane::row(&arm, &p.normal.cast()));
        self.information += own * (other * w).transpose();
        self.pull -= own * (0.5 * w * residual_mm) + other * (0.5 * w * own_residual_mm);
        self.weight += w;
    }

    /// The same with its axes turned from the target's frame into the base frame, its two products averaged.
    pub(super) fn turned(&self, turn: &UnitQuaternion<f64>) -> Self {
        let both = in_base(turn);
        let symmetric = (self.information + self.information.transpose()) * 0.5;
        let information = both * symmetric * both.transpose();
        Self { information, pull: both * self.pull, weight: self.weight }
    }
}

/// What the pairs between two views tell of the camera's errors: normal equations beside those of their motion.
pub(super) struct CameraBlock {
    with_motion: Matrix6x5<f64>,
    information: Matrix5<f64>,
    pull: Vector5<f64>,
}

impl CameraBlock {
    /// Of pairs in the target's frame, whose `centre` is there, and which the source sees from `target_from_source`.
    pub(super) fn of(
        pairs: &[PatchPair],
        scale: f64,
        centre: &Vector3<f64>,
        target_from_source: &Isometry3<f64>,
    ) -> Self {
        let mut sum =
            Self { with_motion: Matrix6x5::zeros(), information: Matrix5::zeros(), pull: Vector5::zeros() };
        let turn = target_from_source.rotation.to_rotation_matrix();
        for pair in pairs {
            let (residual_mm, own_residual_mm) =
                (f64::from(pair.residual_mm), f64::from(pair.own_residual_mm));
            let w = pair.weight(scale);
            let (arm, other, own): (Vector3<f64>, Vector3<f64>, Vector3<f64>) =
                (pair.arm.cast(), pair.normal.cast(), pair.own_normal.cast());
            let here = Point3::from(arm + centre);
            let there = target_from_source.inverse_transform_point(&here);
            let apart: Matrix3x5<f64> = turn.matrix() * camera::moved(&there) - camera::moved(&here);
            // Products of both normals, as above.
            let of = |normal: &Vector3<f64>| (point_to_plane::row(&arm, normal), apart.tr_mul(normal));
            let ((own_row, own), (other_row, other)) = (of(&own), of(&other));
            sum.information += (own * other.transpose() + other * own.transpose()) * (0.5 * w);
            sum.with_motion += (own_row * other.transpose() + other_row * own.transpose()) * (0.5 * w);
            sum.pull -= own * (0.5 * w * residual_mm) + other * (0.5 * w * own_residual_mm);
        }
        sum
    }

    /// Beside the equations of the motion, whose axes are turned already; the axes of the target are `turn` in the base frame.
    pub(super) fn beside(
        &self,
        motion: &Block,
        views: [usize; 2],
        turn: &UnitQuaternion<f64>,
    ) -> TieEvidence {
        TieEvidence {
            views,
            motion: motion.information,
            motion_pull: motion.pull,
            with_motion: in_base(turn) * self.with_motion,
            information: self.information,
            pull: self.pull,
        }
    }
}

/// Turns both parts of a motion into the base frame.
fn in_base(turn: &UnitQuaternion<f64>) -> Matrix6<f64> {
    let turn = turn.to_rotation_matrix();
    let mut both = Matrix6::zeros();
    both.fixed_view_mut::<3, 3>(0, 0).copy_from(turn.matrix());
    both.fixed_view_mut::<3, 3>(3, 3).copy_from(turn.matrix());
    both
}

/// The joint system of all views but the first in units in which every unknown is a length.
pub(super) struct System {
    information: DMatrix<f64>,
    pull: DVector<f64>,
    weight: Vec<f64>,
    spread_mm: f64,
}

impl System {
    pub(super) fn new(views: usize, spread_mm: f64) -> Self {
        let n = 6 * (views - 1);
        Self {
            information: DMatrix::zeros(n, n),
            pull: DVector::zeros(n),
            weight: vec![0.0; views],
            spread_mm,
        }
    }

    pub(super) fn add(&mut self, i: usize, j: usize, block: &Block) {
        // The same rows with opposite sign move the other view.
        for (a, sa) in [(i, 1.0), (j, -1.0)] {
            self.weight[a] += block.weight;
            let Some(ra) = a.checked_sub(1) else { continue };
            let mut part = self.pull.fixed_rows_mut::<6>(6 * ra);
            part += block.pull * sa;
            for (b, sb) in [(i, 1.0), (j, -1.0)] {
                let Some(rb) = b.checked_sub(1) else { continue };
                let mut part = self.information.fixed_view_mut::<6, 6>(6 * ra, 6 * rb);
                part += block.information * (sa * sb);
            }
        }
    }

    /// The increments of all views, eq. (8), and what their covariance comes from.
    ///
    /// By a Cholesky factor of the normal equations, where the paper takes the singular value decomposition of `A`: with
    /// the prior they have full rank, the solution is the same, and the covariance comes from the same factor.
    /// Along each eigenvector of the information only what exceeds the normals' noise is believed; where nothing is
    /// left, the prior alone decides.
    pub(super) fn solve(self, priors: &[(Matrix6<f64>, Vector6<f64>)]) -> Option<Solution> {
        let n = self.pull.len();
        // Rows scaled so that a motion which every pair of a view sees in full has information 1.
        let unit = DVector::from_fn(n, |k, _| {
            let length = if k % 6 < 3 { 1.0 / self.spread_mm.max(1e-9) } else { 1.0 };
            length / self.weight[k / 6 + 1].max(1e-12).sqrt()
        });
        let scaled = |m: &DMatrix<f64>| DMatrix::from_fn(n, n, |r, c| m[(r, c)] * unit[r] * unit[c]);
        let pull = self.pull.component_mul(&unit);
        let (mut h, mut g) = believed(scaled(&self.information), &pull);
        let (seen, seen_pull) = (h.clone(), g.clone());
        for (k, (information, pull)) in priors.iter().enumerate() {
            for r in 0..6 {
                g[6 * k + r] += pull[r] * unit[6 * k + r];
                for c in 0..6 {
                    h[(6 * k + r, 6 * k + c)] += information[(r, c)] * unit[6 * k + r] * unit[6 * k + c];
                }
            }
        }
        let factor = h.cholesky()?;
        let scaled = factor.solve(&g);
        let left = seen_pull - &seen * &scaled;
        Some(Solution { x: scaled.component_mul(&unit), factor, unit, seen, left })
    }
}

/// One step of all views but the first.
pub(super) struct Solution {
    /// The increments, six of each view: rad, mm.
    pub(super) x: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    /// What a scaled unknown is in radians or millimetres.
    unit: DVector<f64>,
    /// What the surfaces alone tell of the scaled unknowns, and where they still pull after the step.
    seen: DMatrix<f64>,
    left: DVector<f64>,
}

impl Solution {
    /// Of the increments; costs more than the step itself, and only the last step's is asked for.
    pub(super) fn covariance(&self) -> DMatrix<f64> {
        let scaled = self.factor.inverse();
        let n = self.unit.len();
        DMatrix::from_fn(n, n, |r, c| scaled[(r, c)] * self.unit[r] * self.unit[c])
    }

    /// What a pull on the increments does to them, as far as it is believed: along motions that the surfaces do not show a pull is
    /// noise, and there the reported poses alone decide. `B P^-1` of it is believed, with `B` of the information `P = B + u I`.
    pub(super) fn gain(&self) -> DMatrix<f64> {
        let (n, unit) = (self.unit.len(), &self.unit);
        let whole = (&self.seen + DMatrix::identity(n, n) * UNSEEN).cholesky();
        let trust =
            whole.map_or_else(|| DMatrix::identity(n, n), |whole| whole.solve(&self.seen).transpose());
        let scaled = self.factor.solve(&trust);
        DMatrix::from_fn(n, n, |r, c| scaled[(r, c)] * unit[r] * unit[c])
    }

    /// What the surfaces alone tell, without the reported poses, about the poses after the step.
    pub(super) fn evidence(&self) -> SurfaceEvidence {
        let (n, unit) = (self.unit.len(), &self.unit);
        SurfaceEvidence {
            information: DMatrix::from_fn(n, n, |r, c| self.seen[(r, c)] / (unit[r] * unit[c])),
            pull: self.left.component_div(unit),
            camera: None,
        }
    }

    /// Makes what is told of the camera fit what is believed of the increments: where `B` of their information `P = B + u I` is
    /// believed, `B P^-1` of what both have in common is. With the increments eliminated the same is told of the camera as
    /// before, so that what a motion of the views does just as well stays untold.
    pub(super) fn believed(&self, camera: &mut CameraEvidence) {
        let n = self.unit.len();
        let Some(whole) = (&self.seen + DMatrix::identity(n, n) * UNSEEN).cholesky() else { return };
        let scale = |m: &mut DMatrix<f64>, by: &DVector<f64>| {
            m.row_iter_mut().zip(by.iter()).for_each(|(mut row, by)| row *= *by);
        };
        scale(&mut camera.with_poses, &self.unit);
        let instead = whole.solve(&camera.with_poses);
        let held_back = whole.solve(&self.left);
        let believed = &self.seen * &instead;
        let common: Matrix5<f64> = instead.tr_mul(&believed).fixed_view::<5, 5>(0, 0).into_owned();
        let held: Matrix5<f64> = (instead.tr_mul(&instead) * UNSEEN).fixed_view::<5, 5>(0, 0).into_owned();
        camera.information = common + possible(&(camera.information - common - held));
        camera.pull -= (instead.tr_mul(&held_back) * UNSEEN).fixed_rows::<5>(0);
        camera.with_poses = believed;
        scale(&mut camera.with_poses, &self.unit.map(|unit| 1.0 / unit));
    }
}

/// Information without what noise made less than none, in errors of usual size.
fn possible(information: &Matrix5<f64>) -> Matrix5<f64> {
    let usual = Matrix5::from_diagonal(&camera::usual());
    let eigen = (usual * information * usual).symmetric_eigen();
    let kept = Matrix5::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0)));
    let scaled = eigen.eigenvectors * kept * eigen.eigenvectors.transpose();
    let back = Matrix5::from_diagonal(&camera::usual().map(|size| 1.0 / size));
    back * scaled * back
}

/// Of information and pull, along each eigenvector of the information, what exceeds the normals' noise.
///
/// With eigenvalues s that is (1 - [`UNSEEN`] / s) of each, at least nothing. Where all of them exceed it, as in a scan whose
/// views all see enough, it is `A - u I` and `(I - u A^-1) b`, without the eigenvectors.
fn believed(information: DMatrix<f64>, pull: &DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
    let n = pull.len();
    let exceeding = &information - DMatrix::identity(n, n) * UNSEEN;
    if exceeding.clone().cholesky().is_some()
        && let Some(whole) = information.clone().cholesky()
    {
        return (exceeding, pull - whole.solve(pull) * UNSEEN);
    }
    if n > MANY_UNKNOWNS
        && let Some(unseen) = weak::below(&information, UNSEEN)
        && let Some(believed) = without(&unseen, &information, pull)
    {
        return believed;
    }
    let eigen = information.symmetric_eigen();
    let mut h = DMatrix::zeros(n, n);
    let mut g = DVector::zeros(n);
    for (&seen, v) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        let trust = (1.0 - UNSEEN / seen.max(1e-300)).max(0.0);
        h.ger(trust * seen, &v, &v, 1.0);
        g.axpy(trust * v.dot(pull), &v, 1.0);
    }
    (h, g)
}

/// The same where only the eigenvectors with an eigenvalue below [`UNSEEN`] are known, and nothing is believed along them.
fn without(
    unseen: &weak::Eigenpairs,
    information: &DMatrix<f64>,
    pull: &DVector<f64>,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    // Along them any other eigenvalue does: 1 keeps the matrix positive definite.
    let mut whole = information.clone();
    let mut left = pull.clone();
    for (&value, v) in unseen.values.iter().zip(unseen.vectors.column_iter()) {
        whole.ger(1.0 - value, &v, &v, 1.0);
        left.axpy(-v.dot(pull), &v, 1.0);
    }
    let g = &left - whole.clone().cholesky()?.solve(&left) * UNSEEN;
    let mut h = whole;
    for k in 0..h.nrows() {
        h[(k, k)] -= UNSEEN;
    }
    for v in unseen.vectors.column_iter() {
        h.ger(UNSEEN - 1.0, &v, &v, 1.0);
    }
    Some((h, g))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_views_the_unseen_motions_alone_are_sought() {
        let n = MANY_UNKNOWNS + 20;
        let basis = DMatrix::from_fn(n, n, |r, c| ((3 * r + 7 * c * c + r * c) as f64).sin()).qr().q();
        let pull = DVector::from_fn(n, |k, _| (k as f64).cos());
        for unseen in [1, 7, 20] {
            let seen = DVector::from_fn(n, |k, _| {
                if k < unseen {
                    UNSEEN * (0.99 - 0.04 * k as f64)
                } else {
                    UNSEEN * (1.01 + 0.3 * (k - unseen) as f64)
                }
            });
            let information = &basis * DMatrix::from_diagonal(&seen) * basis.transpose();
            let found = weak::below(&information, UNSEEN).expect("few are unseen");
            assert_eq!(found.values.len(), unseen);
            let (h, g) = without(&found, &information, &pull).unwrap();
            let trust = seen.map(|s| (1.0 - UNSEEN / s.max(1e-300)).max(0.0));
            let expected_h = &basis * DMatrix::from_diagonal(&trust.component_mul(&seen)) * basis.transpose();
            let expected_g = &basis * DMatrix::from_diagonal(&trust) * basis.transpose() * &pull;
            assert!((h - expected_h).norm() < 1e-6 * UNSEEN, "{unseen}");
            assert!((g - expected_g).norm() < 1e-4 * pull.norm(), "{unseen}");
        }
    }

    #[test]
    fn what_is_believed_is_the_same_with_and_without_eigenvectors() {
        let n = 12;
        let basis = DMatrix::from_fn(n, n, |r, c| ((3 * r + 7 * c) as f64).sin()).qr().q();
        let pull = DVector::from_fn(n, |k, _| (k as f64).cos());
        let matrix = |least: f64| {
            let seen = DVector::from_fn(n, |k, _| if k == 0 { least } else { 0.3 * k as f64 });
            (&basis * DMatrix::from_diagonal(&seen) * basis.transpose(), seen)
        };
        for least in [2.0 * UNSEEN, 1.5, 0.5 * UNSEEN, -0.1] {
            let (information, seen) = matrix(least);
            let (h, g) = believed(information, &pull);
            let trust = seen.map(|s| (1.0 - UNSEEN / s.max(1e-300)).max(0.0));
            let expected_h = &basis * DMatrix::from_diagonal(&trust.component_mul(&seen)) * basis.transpose();
            let expected_g = &basis * DMatrix::from_diagonal(&trust) * basis.transpose() * &pull;
            assert!((h - expected_h).norm() < 1e-12 && (g - expected_g).norm() < 1e-12, "{least}");
        }
    }
}
