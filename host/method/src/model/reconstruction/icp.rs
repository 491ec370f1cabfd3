//! Linear point-to-plane ICP (paper eqs. (2)-(8); Low 2004) over all views at once.
//!
//! Each iteration linearises small rotations about the common centre, solves for the increments of all views in one
//! system, and applies them as full rotations, left-multiplied. Residuals are weighted by Geman-McClure.

use super::correlation;
use super::correspondence::Match;
use super::source::{MatchedPatch, PatchSurface, SourceView};
use super::system::{Block, CameraBlock, PatchPair, Solution, System};
use super::{ReconstructionConfig, Registration, SurfaceEvidence, fitness};
use crate::geometry::cloud::View;
use crate::geometry::statistics::robust_deviation;
use crate::model::camera::{CameraEvidence, TieEvidence};
use crate::model::normals::Patches;
use nalgebra::{
    DMatrix, Isometry3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6,
};
use rayon::prelude::*;

/// Least agreement of two normals that may be the same surface; keeps a pipe's inside from matching its outside.
const MIN_NORMAL_DOT: f32 = 0.6;
/// Every pair is found from both sides, and a view's noise is shared by all its partners: this many pairs count as one.
const REPEATED_PAIRS: f32 = 4.0;
/// Of the sampled patches, one in so many is matched in all rounds but the last, which decides the accuracy.
const COARSE_STEP: usize = 4;
/// Of the sampled patches, one in so many is asked for the fitness.
const FITNESS_STEP: usize = 4;
/// Every sampled patch is matched in at most about so many other views: the own noise of a patch is the same to all of
/// them, so that more of them tell little that is new, and all of them would cost the square of the number of views.
const MOST_PARTNERS: usize = 8;
/// From so many views on fewer partners do, down to [`FEWEST_PARTNERS`]: each view has so many neighbours then that its pose
/// is known far better than the noise of its own points, and the time grows with the views alone no more.
const MANY_VIEWS: usize = 50;
const FEWEST_PARTNERS: usize = 3;
/// Patches lie on a raster of cells: in the middle of four, the nearest is .71 of a cell away. This many cells count as aligned if
/// they are more than [`ReconstructionConfig::fitness_mm`].
const NEAR_CELLS: f32 = 0.75;
/// A view's patches nearer than this to another view's, in aligned distances, overlap it.
const OVERLAP: f32 = 4.0;

pub(super) struct RegistrationProblem {
    sources: Vec<SourceView>,
    ties: Vec<Tie>,
    /// Of each view, of every [`FITNESS_STEP`]th sampled patch.
    nearby: Vec<Vec<Nearby>>,
    /// Patches this near to each other are aligned, mm.
    near_mm: f32,
    reported: Vec<Isometry3<f64>>,
    poses: Vec<Isometry3<f64>>,
    centre_mm: Point3<f64>,
    /// By how much more than their patches' own noise says the surfaces of two views vary from each other, as variance.
    excess: f64,
}

/// What ties view `i` to view `j`: the partners in `j` of the sampled patches of `i`.
struct Tie {
    i: usize,
    j: usize,
    /// Of the sampled patches of `i`, which lie in the order of their directions, every `step`th from `first` on is
    /// matched in `j`; other views take the others.
    first: usize,
    step: usize,
    matches: Vec<Match>,
    pairs: Vec<PatchPair>,
}

impl Tie {
    fn new(i: usize, j: usize, sources: &[SourceView]) -> Self {
        let count = sources[i].sample.len();
        let partners = (MOST_PARTNERS * MANY_VIEWS / sources.len()).clamp(FEWEST_PARTNERS, MOST_PARTNERS);
        let step = (sources.len() - 1).div_ceil(partners);
        let first = (i + j) % step;
        Self {
            i,
            j,
            first,
            step,
            matches: vec![Match::NEW; count.saturating_sub(first).div_ceil(step)],
            pairs: Vec::new(),
        }
    }
}

/// What lies near one patch of a view in any other view, whatever its normal.
#[derive(Clone, Copy)]
struct Nearby {
    /// The view that had it near at last; it is asked first.
    view: usize,
    partner: Match,
}

/// Fitness of each view after each step, and overlap at the last.
struct FitnessLog {
    fitness: Vec<Vec<f64>>,
    overlap: Vec<f64>,
}

/// What one linear step did.
#[derive(Default)]
struct Step {
    /// The largest motion of a view.
    largest_mm: f64,
    /// Scale of the residuals before it.
    residual_mm: f64,
    /// None where the system could not be solved and nothing was moved.
    solution: Option<Solution>,
}

/// A rigid motion in single precision.
struct SingleMotion {
    turn: Rotation3<f32>,
    shift: Vector3<f32>,
}

impl SingleMotion {
    fn new(motion: &Isometry3<f64>) -> Self {
        let turn = motion.rotation.to_rotation_matrix().cast();
        Self { turn, shift: motion.translation.vector.cast() }
    }

    fn apply(&self, p: &Point3<f32>) -> Point3<f32> {
        self.turn * p + self.shift
    }
}

impl RegistrationProblem {
    pub(super) fn new(views: &[View], patches: &[Patches], config: &ReconstructionConfig) -> Self {
        let sources: Vec<SourceView> =
            patches.par_iter().map(|p| SourceView::new(p, config.sample)).collect();
        let reported: Vec<_> = views.iter().map(|v| v.base_from_camera).collect();
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for (source, pose) in sources.iter().zip(&reported) {
            for sample in &source.sample {
                sum += (pose * sample.point.cast::<f64>()).coords;
                count += 1.0;
            }
        }
        let centre_mm = Point3::from(sum / f64::max(count, 1.0));
        let views = 0..sources.len();
        let combos = views.clone().flat_map(|i| views.clone().filter(move |&j| j != i).map(move |j| (i, j)));
        let ties = combos.map(|(i, j)| Tie::new(i, j, &sources)).collect();
        let nearby = sources.iter().enumerate().map(|(i, source)| {
            let first = Nearby { view: usize::from(i == 0), partner: Match::NEW };
            vec![first; source.sample.len().div_ceil(FITNESS_STEP)]
        });
        let nearby = nearby.collect();
        let cell_mm = patches.iter().map(|patches| patches.cell_mm).fold(0.0, f32::max);
        let near_mm = config.fitness_mm.max(NEAR_CELLS * cell_mm);
        Self { sources, ties, nearby, near_mm, poses: reported.clone(), reported, centre_mm, excess: 1.0 }
    }

    /// The poses that minimise the distances along the normals, eq. (2), gate by gate.
    pub(super) fn solve(mut self, config: &ReconstructionConfig) -> Registration {
        let views = self.sources.len();
        let mut seen = FitnessLog { fitness: vec![vec![]; views], overlap: vec![0.0; views] };
        let mut reached = Step::default();
        self.look(&mut seen);
        if views < 2 {
            return self.finish(seen, &reached);
        }
        for (round, &gate_mm) in config.gates_mm.iter().enumerate() {
            if round > 0 && gate_mm > config.gates_mm[round - 1] {
                self.ties.iter_mut().for_each(|tie| tie.matches.fill(Match::NEW));
            }
            let last = round + 1 == config.gates_mm.len();
            let thin = if last { 1 } else { COARSE_STEP };
            for iteration in 0..config.iterations {
                self.pair(gate_mm, thin);
                if last && iteration == 0 {
                    self.excess = correlation::excess(self.ties.iter().map(|tie| tie.pairs.as_slice()));
                }
                reached = self.iterate(gate_mm, config);
                self.look(&mut seen);
                let fine_mm = if last { 0.002 } else { 0.05 };
                if reached.largest_mm < fine_mm {
                    break;
                }
            }
        }
        self.finish(seen, &reached)
    }

    fn finish(self, seen: FitnessLog, reached: &Step) -> Registration {
        let unknowns = 6 * (self.sources.len() - 1);
        let covariance = reached
            .solution
            .as_ref()
            .map_or_else(|| DMatrix::zeros(unknowns, unknowns), Solution::covariance);
        let evidence = reached.solution.as_ref().map(Solution::evidence);
        let camera =
            reached.solution.as_ref().map(|solution| self.camera_evidence(solution, reached.residual_mm));
        let contradictions = camera
            .as_ref()
            .zip(reached.solution.as_ref())
            .map(|(camera, solution)| camera.contradictions(&solution.gain()));
        let covariance = contradictions.map_or(covariance.clone(), |more| covariance + more);
        let evidence = evidence.map(|surfaces| SurfaceEvidence { camera, ..surfaces });
        Registration {
            base_from_camera: self.poses,
            fitness: seen.fitness,
            overlap: seen.overlap,
            covariance,
            evidence,
            base_covariance: None,
            centre_mm: self.centre_mm,
            residual_mm: reached.residual_mm,
        }
    }

    /// What the pairs of the last step tell of the camera's own errors.
    fn camera_evidence(&self, solution: &Solution, scale: f64) -> CameraEvidence {
        let (poses, centre_mm) = (&self.poses, &self.centre_mm);
        let ties: Vec<TieEvidence> =
            self.ties.par_iter().map(|tie| tie.evidence(scale, poses, centre_mm)).collect();
        let mut evidence = CameraEvidence::new(self.sources.len() - 1);
        ties.into_iter().for_each(|tie| evidence.add(tie));
        solution.believed(&mut evidence);
        evidence
    }

    /// Finds the pairs of all views anew.
    fn pair(&mut self, gate_mm: f32, thin: usize) {
        let (sources, poses, centre_mm) = (&self.sources, &self.poses, &self.centre_mm);
        self.ties.par_iter_mut().for_each(|tie| tie.pair(sources, poses, centre_mm, gate_mm, thin));
    }

    /// One linear step of all views, eq. (6).
    fn iterate(&mut self, gate_mm: f32, config: &ReconstructionConfig) -> Step {
        let views = self.sources.len();
        let share = (1.0 / self.excess) as f32;
        self.ties.par_iter_mut().flat_map(|tie| &mut tie.pairs).for_each(|pair| pair.weight *= share);
        let poses = &self.poses;
        let pairs = self.ties.iter().flat_map(|tie| &tie.pairs);
        let mut size: Vec<f32> = pairs.map(|pair| pair.residual_mm.abs()).collect();
        let scale = f64::from(robust_deviation(&mut size)).max(0.02).min(f64::from(gate_mm));
        let spread_mm = self.spread_mm();
        let mut system = System::new(views, spread_mm);
        let blocks: Vec<Block> = self.ties.par_iter().map(|tie| tie.block(scale, poses)).collect();
        for (tie, block) in self.ties.iter().zip(&blocks) {
            system.add(tie.i, tie.j, block);
        }
        let priors: Vec<_> = (1..views).map(|view| self.prior(view, config)).collect();
        let Some(solution) = system.solve(&priors) else {
            return Step { residual_mm: scale, ..Step::default() };
        };
        let mut largest_mm = 0.0f64;
        for view in 1..views {
            let step = solution.x.fixed_rows::<6>(6 * (view - 1)).into_owned();
            self.poses[view] = self.moved(&step) * self.poses[view];
            largest_mm =
                largest_mm.max(step.fixed_rows::<3>(3).norm() + spread_mm * step.fixed_rows::<3>(0).norm());
        }
        Step { largest_mm, residual_mm: scale, solution: Some(solution) }
    }

    /// A small motion about the centre as a full rotation and a translation, eq. (3).
    fn moved(&self, x: &Vector6<f64>) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(x.fixed_rows::<3>(0).into_owned());
        let c = self.centre_mm.coords;
        let shift = c - turn * c + x.fixed_rows::<3>(3);
        Isometry3::from_parts(Translation3::from(shift), turn)
    }

    /// Information of the reported pose about the centre, and its pull toward it.
    fn prior(&self, view: usize, config: &ReconstructionConfig) -> (Matrix6<f64>, Vector6<f64>) {
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

    /// Appends each view's fitness at the poses as they are, and sets its overlap.
    fn look(&mut self, seen: &mut FitnessLog) {
        let near = NearnessSearch { sources: &self.sources, poses: &self.poses, near_mm: self.near_mm };
        let of_views = self.nearby.par_iter_mut().enumerate().map(|(i, nearby)| near.shares(i, nearby));
        for (i, [fitness, overlap]) in of_views.collect::<Vec<_>>().into_iter().enumerate() {
            seen.fitness[i].push(fitness);
            seen.overlap[i] = overlap;
        }
    }

    /// Root mean square distance of the patches from the centre, mm: turns rotations into lengths.
    fn spread_mm(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (source, pose) in self.sources.iter().zip(&self.poses) {
            for sample in source.sample.iter().step_by(16) {
                sum += (pose * sample.point.cast::<f64>() - self.centre_mm).norm_squared();
                count += 1.0;
            }
        }
        (sum / f64::max(count, 1.0)).sqrt()
    }
}

impl Tie {
    /// Finds the pairs of every `thin`th of the patches that this tie matches anew. The patches left to other views are not
    /// made up for by weight: each counts as often as with few views.
    fn pair(
        &mut self,
        sources: &[SourceView],
        poses: &[Isometry3<f64>],
        centre_mm: &Point3<f64>,
        gate_mm: f32,
        thin: usize,
    ) {
        let (source, target) = (&sources[self.i], &sources[self.j]);
        let motion = SingleMotion::new(&(poses[self.j].inverse() * poses[self.i]));
        let centre = poses[self.j].inverse_transform_point(centre_mm).cast::<f32>();
        self.pairs.clear();
        let own = source.sample.iter().skip(self.first).step_by(self.step);
        for (sample, partner) in own.zip(&mut self.matches).step_by(thin) {
            let (q, facing) = (motion.apply(&sample.point), motion.turn * sample.normal);
            let same_side = |s: usize| target.surfaces[s].normal.dot(&facing) > MIN_NORMAL_DOT;
            let Some((slot, hit)) = partner.find(&target.grid, &q, gate_mm, same_side) else { continue };
            let (PatchSurface { normal, variance_mm2, tilt_variance }, above) =
                (target.surfaces[slot], q - hit);
            let residual_mm = normal.dot(&above);
            let aside = (above.norm_squared() - residual_mm * residual_mm).max(0.0);
            let variance = sample.variance_mm2 + variance_mm2 + tilt_variance * aside;
            self.pairs.push(PatchPair {
                arm: q - centre,
                normal,
                residual_mm,
                own_normal: facing,
                own_residual_mm: facing.dot(&above),
                weight: thin as f32 * sample.weight / (variance * REPEATED_PAIRS),
            });
        }
    }

    /// Normal equations of the pairs about the centre, axes of the base frame.
    fn block(&self, scale: f64, poses: &[Isometry3<f64>]) -> Block {
        let mut block = Block::default();
        self.pairs.iter().for_each(|pair| block.add(pair, scale));
        block.turned(&poses[self.j].rotation)
    }

    /// What the pairs tell of the motion and of the camera's own errors.
    fn evidence(&self, scale: f64, poses: &[Isometry3<f64>], centre_mm: &Point3<f64>) -> TieEvidence {
        let pose = &poses[self.j];
        let centre = pose.inverse_transform_point(centre_mm).coords;
        let camera = CameraBlock::of(&self.pairs, scale, &centre, &(pose.inverse() * poses[self.i]));
        camera.beside(&self.block(scale, poses), [self.i, self.j], &pose.rotation)
    }
}

/// Asks the other views for what is near to a view's patches.
struct NearnessSearch<'a> {
    sources: &'a [SourceView],
    poses: &'a [Isometry3<f64>],
    near_mm: f32,
}

impl NearnessSearch<'_> {
    /// Fitness and overlap of view `i`.
    fn shares(&self, i: usize, nearby: &mut [Nearby]) -> [f64; 2] {
        let motion = |j: usize| SingleMotion::new(&(self.poses[j].inverse() * self.poses[i]));
        let motions: Vec<SingleMotion> = (0..self.sources.len()).map(motion).collect();
        let asked = self.sources[i].sample.iter().step_by(FITNESS_STEP);
        let squared = asked
            .zip(nearby.iter_mut())
            .filter_map(|(sample, nearby)| self.squared(i, &motions, sample, nearby));
        let squared: Vec<f32> = squared.collect();
        [fitness(&squared, self.near_mm), squared.len() as f64 / nearby.len().max(1) as f64]
    }

    /// Squared distance to the nearest patch of another view, mm², or to one of those that are aligned; none beyond reach. No part of
    /// what both see is what faces elsewhere, a wall beside the floor or the other side of a plate, nor what lies in the plane of
    /// the nearest patch and beyond it: there the surface goes on where the other view saw no more of it.
    ///
    /// The view that was near at last is asked first, the others only where it is not aligned any more.
    fn squared(
        &self,
        i: usize,
        motions: &[SingleMotion],
        sample: &MatchedPatch,
        nearby: &mut Nearby,
    ) -> Option<f32> {
        let near_mm2 = self.near_mm * self.near_mm;
        let ask = |view: usize, partner: &mut Match| {
            let (motion, target) = (&motions[view], &self.sources[view]);
            let (q, facing) = (motion.apply(&sample.point), motion.turn * sample.normal);
            let same_side = |slot: usize| target.surfaces[slot].normal.dot(&facing) > MIN_NORMAL_DOT;
            let found = partner.find(&target.grid, &q, OVERLAP * self.near_mm, same_side);
            found.map_or(f32::INFINITY, |(slot, hit)| {
                let above = q - hit;
                let aside = above.norm_squared() >= near_mm2;
                let level = target.surfaces[slot].normal.dot(&above).powi(2) < near_mm2;
                if aside && level { f32::INFINITY } else { above.norm_squared() }
            })
        };
        let last = nearby.view;
        let mut best = if last < motions.len() { ask(last, &mut nearby.partner) } else { f32::INFINITY };
        for view in (0..motions.len()).filter(|view| *view != i && *view != last) {
            if best < near_mm2 {
                break;
            }
            let mut partner = Match::NEW;
            let squared = ask(view, &mut partner);
            if squared < best {
                (best, *nearby) = (squared, Nearby { view, partner });
            }
        }
        best.is_finite().then_some(best)
    }
}
