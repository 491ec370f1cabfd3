//! Linear point-to-plane ICP (paper eqs. (2)-(8); Low 2004) over all views at once.
//!
//! Each iteration linearises small rotations about the common centre, solves for the increments of all views in one
//! system, and applies them as full rotations, left-multiplied. Residuals are weighted by Geman-McClure.

use super::{Config, Registration};
use crate::cloud::View;
use crate::grid::Grid;
use crate::normals::{Patches, median};
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6,
};
use rayon::prelude::*;

/// Least agreement of two normals that may be the same surface; keeps a pipe's inside from matching its outside.
const MIN_NORMAL_DOT: f32 = 0.6;
/// Patches are matched only where the surface is flat to this many noise deviations.
const MAX_BEND: f32 = 2.0;
/// Every pair is found from both sides, and a view's noise is shared by all its partners: this many pairs count as one.
const REPEATED_PAIRS: f64 = 4.0;
/// Share of information, of a motion that every pair sees in full, below which a motion counts as unseen.
const UNSEEN: f64 = 1e-4;

/// One view's patches, ready to be matched.
struct Source {
    grid: Grid,
    /// Normal per slot of the grid.
    normals: Vec<Vector3<f32>>,
    /// Variance of a patch's height, mm², per slot.
    variance_mm2: Vec<f32>,
    /// Variance of a normal's tilt, rad², per slot.
    tilt_variance: Vec<f32>,
    /// Slots that are matched, and the weight that makes up for the ones left out.
    sample: Vec<(u32, f32)>,
}

pub(super) struct Problem {
    sources: Vec<Source>,
    reported: Vec<Isometry3<f64>>,
    poses: Vec<Isometry3<f64>>,
    centre_mm: Point3<f64>,
}

/// A pair of patches of two views in the base frame, about the centre.
struct Pair {
    arm: Vector3<f64>,
    /// Of the target patch, and the distance of the source patch above it.
    normal: Vector3<f64>,
    residual_mm: f64,
    /// Of the source patch, and the distance of the target patch below it.
    own_normal: Vector3<f64>,
    own_residual_mm: f64,
    weight: f64,
}

/// Normal equations of the pairs from one view to another.
#[derive(Default)]
struct Terms {
    pairs: Vec<Pair>,
}

/// One row of `A`, eq. (7), by the small angles of eq. (4) in the motion of eq. (5): rotation part, then translation.
///
/// `arm` is where the point is from the centre.
pub(super) fn point_row(arm: &Vector3<f64>, normal: &Vector3<f64>) -> Vector6<f64> {
    let turn = arm.cross(normal);
    Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z)
}

impl Problem {
    pub(super) fn new(views: &[View], patches: &[Patches], config: &Config) -> Self {
        let sources: Vec<Source> = patches.par_iter().map(|p| Source::new(p, config.sample)).collect();
        let reported: Vec<_> = views.iter().map(|v| v.base_from_camera).collect();
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for (source, pose) in sources.iter().zip(&reported) {
            for &(slot, _) in &source.sample {
                sum += (pose * source.grid.point(slot as usize).cast::<f64>()).coords;
                count += 1.0;
            }
        }
        let centre_mm = Point3::from(sum / f64::max(count, 1.0));
        Self { sources, poses: reported.clone(), reported, centre_mm }
    }

    /// The poses that minimise the distances along the normals, eq. (2), gate by gate.
    pub(super) fn solve(mut self, config: &Config) -> Registration {
        let views = self.sources.len();
        let mut fitness = vec![vec![]; views];
        let mut covariance = DMatrix::zeros(6 * (views - 1), 6 * (views - 1));
        let mut residual_mm = 0.0;
        for (k, f) in self.fitness(config).into_iter().enumerate() {
            fitness[k].push(f);
        }
        if views < 2 {
            return self.finish(fitness, covariance, residual_mm);
        }
        for (round, &gate_mm) in config.gates_mm.iter().enumerate() {
            for _ in 0..config.iterations {
                let (step, cov, scale) = self.iterate(gate_mm, config);
                covariance = cov;
                residual_mm = scale;
                for (k, f) in self.fitness(config).into_iter().enumerate() {
                    fitness[k].push(f);
                }
                let fine = if round + 1 == config.gates_mm.len() { 0.002 } else { 0.05 };
                if step < fine {
                    break;
                }
            }
        }
        self.finish(fitness, covariance, residual_mm)
    }

    fn finish(self, fitness: Vec<Vec<f64>>, covariance: DMatrix<f64>, residual_mm: f64) -> Registration {
        Registration {
            base_from_camera: self.poses,
            fitness,
            covariance,
            centre_mm: self.centre_mm,
            residual_mm,
        }
    }

    /// One linear step of all views, eq. (6): the largest motion of a view, mm, the covariance, the residual scale.
    fn iterate(&mut self, gate_mm: f32, config: &Config) -> (f64, DMatrix<f64>, f64) {
        let views = self.sources.len();
        let combos: Vec<(usize, usize)> =
            (0..views).flat_map(|i| (0..views).filter(move |&j| j != i).map(move |j| (i, j))).collect();
        let terms: Vec<Terms> = combos.par_iter().map(|&(i, j)| self.pairs(i, j, gate_mm)).collect();
        let mut size: Vec<f64> =
            terms.iter().flat_map(|t| t.pairs.iter().map(|p| p.residual_mm.abs())).collect();
        let scale = (1.4826 * median(&mut size)).max(0.02).min(f64::from(gate_mm));
        let spread_mm = self.spread_mm();
        let mut system = System::new(views, spread_mm);
        for (&(i, j), t) in combos.iter().zip(&terms) {
            let mut block = Block::default();
            t.pairs.iter().for_each(|p| block.add(p, scale));
            system.add(i, j, &block);
        }
        let priors: Vec<_> = (1..views).map(|view| self.prior(view, config)).collect();
        let Some((x, covariance)) = system.solve(&priors) else { return (0.0, DMatrix::zeros(0, 0), scale) };
        let mut largest = 0.0f64;
        for view in 1..views {
            let step = x.fixed_rows::<6>(6 * (view - 1)).into_owned();
            self.poses[view] = self.moved(&step) * self.poses[view];
            largest =
                largest.max(step.fixed_rows::<3>(3).norm() + spread_mm * step.fixed_rows::<3>(0).norm());
        }
        (largest, covariance, scale)
    }

    /// A small motion about the centre as a full rotation and a translation, eq. (3).
    fn moved(&self, x: &Vector6<f64>) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(x.fixed_rows::<3>(0).into_owned());
        let c = self.centre_mm.coords;
        let shift = c - turn * c + x.fixed_rows::<3>(3);
        Isometry3::from_parts(Translation3::from(shift), turn)
    }

    /// Information of the reported pose about the centre, and its pull toward it.
    fn prior(&self, view: usize, config: &Config) -> (Matrix6<f64>, Vector6<f64>) {
        if !config.prior_mm.is_finite() {
            return (Matrix6::identity() * 1e-9, Vector6::zeros());
        }
        // What was done so far, as a motion about the camera: rotation, then translation of the camera.
        let done = self.poses[view] * self.reported[view].inverse();
        let camera = Point3::from(self.reported[view].translation.vector);
        let shift = (done * camera) - camera;
        let turn = done.rotation.scaled_axis();
        // A step (w, t) about the centre turns by w and moves the camera by w x (camera - centre) + t.
        let arm = Point3::from(self.poses[view].translation.vector) - self.centre_mm;
        let mut jacobian = Matrix6::identity();
        jacobian.fixed_view_mut::<3, 3>(3, 0).copy_from(&(-arm.cross_matrix()));
        let mut information = Vector6::repeat(1.0 / config.prior_mm.powi(2));
        information.fixed_rows_mut::<3>(0).fill(1.0 / config.prior_rad.powi(2));
        let weighted = jacobian.transpose() * Matrix6::from_diagonal(&information);
        let offset = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
        (weighted * jacobian, -(weighted * offset))
    }

    fn pairs(&self, i: usize, j: usize, gate_mm: f32) -> Terms {
        let (source, target) = (&self.sources[i], &self.sources[j]);
        let j_from_i = self.poses[j].inverse() * self.poses[i];
        let turn: UnitQuaternion<f32> = j_from_i.rotation.cast();
        let shift: Vector3<f32> = j_from_i.translation.vector.cast();
        let mut terms = Terms::default();
        for &(slot, thinned) in &source.sample {
            let slot = slot as usize;
            let q = turn * source.grid.point(slot) + shift;
            let facing = turn * source.normals[slot];
            let Some((hit, _)) =
                target.grid.nearest(&q, gate_mm, |s| target.normals[s].dot(&facing) > MIN_NORMAL_DOT)
            else {
                continue;
            };
            let (p, n) = (target.grid.point(hit), target.normals[hit]);
            let residual = n.dot(&(q - p));
            let aside = ((q - p).norm_squared() - residual * residual).max(0.0);
            let tilt = target.tilt_variance[hit];
            let variance = source.variance_mm2[slot] + target.variance_mm2[hit] + tilt * aside;
            let pose = &self.poses[j];
            terms.pairs.push(Pair {
                arm: pose * q.cast::<f64>() - self.centre_mm,
                normal: pose * n.cast::<f64>(),
                residual_mm: f64::from(residual),
                own_normal: pose * facing.cast::<f64>(),
                own_residual_mm: f64::from(facing.dot(&(q - p))),
                weight: f64::from(thinned / variance) / REPEATED_PAIRS,
            });
        }
        terms
    }

    fn fitness(&self, config: &Config) -> Vec<f64> {
        let reach = 4.0 * config.fitness_mm;
        (0..self.sources.len())
            .into_par_iter()
            .map(|i| {
                let (mut near, mut overlap) = (0, 0);
                for &(slot, _) in self.sources[i].sample.iter().step_by(4) {
                    let place = self.poses[i] * self.sources[i].grid.point(slot as usize).cast::<f64>();
                    let others = (0..self.sources.len()).filter(|&j| j != i);
                    let d2 = others
                        .filter_map(|j| {
                            let q = self.poses[j].inverse_transform_point(&place).cast::<f32>();
                            self.sources[j].grid.nearest(&q, reach, |_| true).map(|(_, d2)| d2)
                        })
                        .fold(f32::INFINITY, f32::min);
                    overlap += usize::from(d2.is_finite());
                    near += usize::from(d2 < config.fitness_mm.powi(2));
                }
                near as f64 / f64::from(overlap.max(1) as u32)
            })
            .collect()
    }

    /// Root mean square distance of the patches from the centre, mm: turns rotations into lengths.
    fn spread_mm(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (source, pose) in self.sources.iter().zip(&self.poses) {
            for &(slot, _) in source.sample.iter().step_by(16) {
                sum +=
                    (pose * source.grid.point(slot as usize).cast::<f64>() - self.centre_mm).norm_squared();
                count += 1.0;
            }
        }
        (sum / f64::max(count, 1.0)).sqrt()
    }
}

/// Normal equations of the pairs between two views, eq. (7).
#[derive(Default)]
struct Block {
    information: Matrix6<f64>,
    pull: Vector6<f64>,
    weight: f64,
}

impl Block {
    fn add(&mut self, p: &Pair, scale: f64) {
        let w = p.weight / (1.0 + (p.residual_mm / (2.0 * scale)).powi(2)).powi(2);
        // Two normals of one surface with independent noise: their product is unbiased where a square is not, so noise
        // does not pass for information (instrumental variables).
        let (own, other) = (point_row(&p.arm, &p.own_normal), point_row(&p.arm, &p.normal));
        self.information.ger(0.5 * w, &own, &other, 1.0);
        self.information.ger(0.5 * w, &other, &own, 1.0);
        self.pull.axpy(-0.5 * w * p.residual_mm, &own, 1.0);
        self.pull.axpy(-0.5 * w * p.own_residual_mm, &other, 1.0);
        self.weight += w;
    }
}

/// The joint system of all views but the first in units in which every unknown is a length.
struct System {
    information: DMatrix<f64>,
    pull: DVector<f64>,
    weight: Vec<f64>,
    spread_mm: f64,
}

impl System {
    fn new(views: usize, spread_mm: f64) -> Self {
        let n = 6 * (views - 1);
        Self {
            information: DMatrix::zeros(n, n),
            pull: DVector::zeros(n),
            weight: vec![0.0; views],
            spread_mm,
        }
    }

    fn add(&mut self, i: usize, j: usize, block: &Block) {
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

    /// The increments of all views, eq. (8), and their covariance.
    ///
    /// Along each eigenvector of the information only what exceeds the normals' noise is believed; where nothing is
    /// left, the prior alone decides.
    fn solve(self, priors: &[(Matrix6<f64>, Vector6<f64>)]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let n = self.pull.len();
        // Rows scaled so that a motion which every pair of a view sees in full has information 1.
        let unit = DVector::from_fn(n, |k, _| {
            let length = if k % 6 < 3 { 1.0 / self.spread_mm.max(1e-9) } else { 1.0 };
            length / self.weight[k / 6 + 1].max(1e-12).sqrt()
        });
        let scaled = |m: &DMatrix<f64>| DMatrix::from_fn(n, n, |r, c| m[(r, c)] * unit[r] * unit[c]);
        let pull = self.pull.component_mul(&unit);
        let eigen = scaled(&self.information).symmetric_eigen();
        let mut h = DMatrix::zeros(n, n);
        let mut g = DVector::zeros(n);
        for (&seen, v) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            let trust = (1.0 - UNSEEN / seen.max(1e-300)).max(0.0);
            h.ger(trust * seen, &v, &v, 1.0);
            g.axpy(trust * v.dot(&pull), &v, 1.0);
        }
        for (k, (information, pull)) in priors.iter().enumerate() {
            for r in 0..6 {
                g[6 * k + r] += pull[r] * unit[6 * k + r];
                for c in 0..6 {
                    h[(6 * k + r, 6 * k + c)] += information[(r, c)] * unit[6 * k + r] * unit[6 * k + c];
                }
            }
        }
        let factor = h.cholesky()?;
        let x = factor.solve(&g).component_mul(&unit);
        let covariance = factor.inverse();
        Some((x, DMatrix::from_fn(n, n, |r, c| covariance[(r, c)] * unit[r] * unit[c])))
    }
}

impl Source {
    fn new(patches: &Patches, sample: usize) -> Self {
        let mut variance = patches.variance_mm2.clone();
        let noise = median(&mut variance).max(1e-6);
        let flat: Vec<usize> = (0..patches.cloud.len())
            .filter(|&k| patches.variance_mm2[k] < MAX_BEND * MAX_BEND * noise)
            .collect();
        let points: Vec<_> = flat.iter().map(|&k| patches.cloud.points_mm[k]).collect();
        let grid = Grid::new(&points, 2.0 * patches.cell_mm);
        let at = |slot: usize| flat[grid.index(slot)];
        let normals: Vec<_> = (0..grid.len()).map(|s| patches.cloud.normals[at(s)]).collect();
        let variance_mm2 = (0..grid.len())
            .map(|s| 5.5 * patches.variance_mm2[at(s)].max(0.25 * noise) / patches.count[at(s)])
            .collect();
        let tilt_variance = (0..grid.len()).map(|s| patches.tilt_variance[at(s)]).collect();
        let sample = spread_over_normals(&normals, sample);
        Self { grid, normals, variance_mm2, tilt_variance, sample }
    }
}

/// A sample in which rare directions are kept whole and common ones thinned, each with the weight that makes up for it.
fn spread_over_normals(normals: &[Vector3<f32>], sample: usize) -> Vec<(u32, f32)> {
    let bin = |n: &Vector3<f32>| {
        let c = |v: f32| ((v * 3.0).round() as i32 + 3) as usize;
        (c(n.x) * 7 + c(n.y)) * 7 + c(n.z)
    };
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); 343];
    for (slot, n) in normals.iter().enumerate() {
        members[bin(n)].push(slot as u32);
    }
    members.retain(|m| !m.is_empty());
    // Fill the smallest bins first; what they leave over is shared by the larger.
    members.sort_by_key(Vec::len);
    let (mut left, mut out) = (sample, Vec::with_capacity(sample));
    for (k, m) in members.iter().enumerate() {
        let share = (left / (members.len() - k)).min(m.len());
        left -= share;
        let step = m.len() as f64 / share.max(1) as f64;
        out.extend((0..share).map(|s| (m[(s as f64 * step) as usize], step.sqrt() as f32)));
    }
    out
}
