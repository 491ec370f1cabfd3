//! Point-to-plane ICP of one cloud onto another whose normals are given (paper eqs. (2)-(8)), without weights or priors.
//!
//! A step of the paper's [`chain`](super::chain), and what the well-known libraries offer under that name; the default
//! solves all views together. Departures: the small rotation is applied in full, not as the linear matrix of eq. (4);
//! Cholesky factors of the normal equations in place of the singular value decomposition of eq. (8), whose solution is the
//! same where it is unique: there are six unknowns and the damping leaves alone what the surfaces do not see.
//! The answer does not depend on the axes or the origin of the clouds beyond rounding, nor on the number of threads.

use super::correspondence::Match;
use crate::geometry::cloud::PointCloud;
use crate::geometry::grid::Grid;
use crate::geometry::point_to_plane;
use crate::model::normals::mean_spacing_mm;
use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

/// When pairs are made and when to stop.
#[derive(Debug, Clone)]
pub struct PairConfig {
    /// Points farther apart than this are not paired; one value per round, coarse to fine.
    pub gates_mm: Vec<f32>,
    /// Most iterations of each round.
    pub iterations: usize,
    /// A round ends when a step shifts the target's centre by less than this, mm ...
    pub stop_mm: f64,
    /// ... and turns by less than this, rad.
    pub stop_rad: f64,
}

impl Default for PairConfig {
    fn default() -> Self {
        Self { gates_mm: vec![5.0, 1.5], iterations: 100, stop_mm: 1e-3, stop_rad: 1e-5 }
    }
}

/// How one cloud lies on another.
#[derive(Debug, Clone, Copy)]
pub struct Alignment {
    /// Takes points of the source, in its base frame, to where they lie on the target.
    pub target_from_source: Isometry3<f64>,
    /// Linear steps taken, all rounds.
    pub iterations: usize,
    /// Whether the last round ended before its most iterations.
    pub converged: bool,
    /// Share of the source's points that have a partner within the last gate.
    pub inliers: f64,
    /// Root mean square of their distances along the normals, mm.
    pub rms_mm: f64,
}

/// Points in one chunk of a sum; fixed, so that the sum does not depend on the number of threads.
const CHUNK: usize = 2048;
/// Damping of each step, relative to the largest information: keeps what the surfaces do not see where it is.
const DAMPING: f64 = 1e-9;

/// Aligns `source`, whose normals are not read, to `target` by its points and normals; at least one point each.
pub fn align(
    source: &PointCloud,
    target: &PointCloud,
    guess: &Isometry3<f64>,
    config: &PairConfig,
) -> Alignment {
    let mut pair = CloudPair::new(source, target, guess);
    let (mut iterations, mut converged, mut sum) = (0, false, Sum::default());
    for (round, &gate_mm) in config.gates_mm.iter().enumerate() {
        if round > 0 && gate_mm > config.gates_mm[round - 1] {
            pair.matches.fill(Match::NEW);
        }
        converged = false;
        for _ in 0..config.iterations {
            sum = pair.sum(gate_mm);
            let Some(step) = sum.step() else { break };
            pair.apply(&step);
            iterations += 1;
            converged = step.fixed_rows::<3>(0).norm() < config.stop_rad
                && step.fixed_rows::<3>(3).norm() < config.stop_mm;
            if converged {
                break;
            }
        }
    }
    Alignment {
        target_from_source: pair.target_from_source(),
        iterations,
        converged,
        inliers: sum.count / source.len().max(1) as f64,
        rms_mm: (sum.squares / sum.count.max(1.0)).sqrt(),
    }
}

/// Both clouds about their own middles, so that single precision suffices.
struct CloudPair {
    source: Grid,
    target: Grid,
    /// Normal per slot of the target.
    normals: Vec<Vector3<f32>>,
    /// Per slot of the source.
    matches: Vec<Match>,
    source_middle_mm: Point3<f64>,
    target_middle_mm: Point3<f64>,
    /// From the source about its middle to the target about its middle.
    motion: Isometry3<f64>,
}

/// The middle of a cloud in the base frame, and the cloud's points about it, sorted into cells of `spacings`.
fn about_middle(cloud: &PointCloud, spacings: f32) -> (Point3<f64>, Grid) {
    let sum: Vector3<f64> = cloud.points_mm.iter().map(|p| p.coords.cast::<f64>()).sum();
    let middle: Vector3<f32> = (sum / cloud.len().max(1) as f64).cast();
    let points: Vec<Point3<f32>> = cloud.points_mm.iter().map(|p| p - middle).collect();
    let cell_mm = spacings * mean_spacing_mm(&points);
    (cloud.origin_mm + middle.cast::<f64>(), Grid::new(&points, cell_mm))
}

impl CloudPair {
    fn new(source: &PointCloud, target: &PointCloud, guess: &Isometry3<f64>) -> Self {
        let (source_middle_mm, source) = about_middle(source, SOURCE_CELL_SPACINGS);
        let (target_middle_mm, grid) = about_middle(target, TARGET_CELL_SPACINGS);
        let normals = grid.by_slot(&target.normals);
        let motion = Translation3::from(-target_middle_mm.coords)
            * guess
            * Translation3::from(source_middle_mm.coords);
        let matches = vec![Match::NEW; source.len()];
        Self { source, target: grid, normals, matches, source_middle_mm, target_middle_mm, motion }
    }

    fn target_from_source(&self) -> Isometry3<f64> {
        Translation3::from(self.target_middle_mm.coords)
            * self.motion
            * Translation3::from(-self.source_middle_mm.coords)
    }

    /// A small motion about the middle as a full rotation, left-multiplied.
    fn apply(&mut self, step: &Vector6<f64>) {
        let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
        let shift = Translation3::from(step.fixed_rows::<3>(3).into_owned());
        self.motion = Isometry3::from_parts(shift, turn) * self.motion;
    }

    /// Pairs every source point and sums up the normal equations.
    fn sum(&mut self, gate_mm: f32) -> Sum {
        let turn = self.motion.rotation.to_rotation_matrix().cast::<f32>();
        let shift: Vector3<f32> = self.motion.translation.vector.cast();
        let (source, target, normals) = (&self.source, &self.target, &self.normals);
        let parts: Vec<Sum> = self
            .matches
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, matches)| {
                let mut sum = Sum::default();
                for (k, partner) in matches.iter_mut().enumerate() {
                    let q = turn * source.point(chunk * CHUNK + k) + shift;
                    if let Some((slot, hit)) = partner.find(target, &q, gate_mm, |_| true) {
                        sum.add(&q, &normals[slot], normals[slot].dot(&(q - hit)));
                    }
                }
                sum
            })
            .collect();
        parts.iter().fold(Sum::default(), Sum::joined)
    }
}

/// Edge of a source cell in mean spacings: neighbours in memory are neighbours in space.
const SOURCE_CELL_SPACINGS: f32 = 6.0;
/// Edge of a target cell in mean spacings: a few points per cell.
const TARGET_CELL_SPACINGS: f32 = 3.0;

/// Normal equations of pairs.
#[derive(Debug, Clone, Default)]
struct Sum {
    information: Matrix6<f64>,
    pull: Vector6<f64>,
    squares: f64,
    count: f64,
}

impl Sum {
    fn add(&mut self, q: &Point3<f32>, normal: &Vector3<f32>, residual_mm: f32) {
        let row = point_to_plane::row(&q.coords.cast(), &normal.cast());
        let residual_mm = f64::from(residual_mm);
        // The lower triangle is enough for the factorisation.
        for column in 0..6 {
            for r in column..6 {
                self.information[(r, column)] += row[r] * row[column];
            }
        }
        self.pull -= row * residual_mm;
        self.squares += residual_mm * residual_mm;
        self.count += 1.0;
    }

    fn joined(mut self, other: &Self) -> Self {
        self.information += other.information;
        self.pull += other.pull;
        self.squares += other.squares;
        self.count += other.count;
        self
    }

    /// The step that solves them; none without pairs.
    fn step(&self) -> Option<Vector6<f64>> {
        let largest = self.information.diagonal().max();
        let damped = self.information + Matrix6::identity() * (DAMPING * largest);
        Some(damped.cholesky()?.solve(&self.pull))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bowl with a ridge, which ties down all six directions, and its exact normals.
    fn bowl(count: usize, shift: f64) -> PointCloud {
        let mut cloud = PointCloud::default();
        for k in 0..count {
            let t = k as f64 + shift;
            let (x, y) =
                (80.0 * (t * 0.754_877_666).fract() - 40.0, 80.0 * (t * 0.569_840_291).fract() - 40.0);
            let z = 0.01 * (x * x + y * y) + 3.0 * (0.2 * x + 0.1 * y).sin();
            let slope = (0.2 * x + 0.1 * y).cos();
            let normal = Vector3::new(-0.02 * x - 0.6 * slope, -0.02 * y - 0.3 * slope, 1.0).normalize();
            cloud.points_mm.push(Point3::new(x as f32, y as f32, z as f32));
            cloud.normals.push(normal.cast());
        }
        cloud
    }

    fn moved(cloud: &PointCloud, pose: &Isometry3<f64>) -> PointCloud {
        let points_mm = cloud.points_mm.iter().map(|p| (pose * p.cast::<f64>()).cast()).collect();
        let normals = cloud.normals.iter().map(|n| (pose * n.cast::<f64>()).cast()).collect();
        PointCloud { points_mm, normals, ..PointCloud::default() }
    }

    fn pose(shift: [f64; 3], turn: [f64; 3]) -> Isometry3<f64> {
        Isometry3::new(Vector3::from(shift), Vector3::from(turn))
    }

    #[test]
    fn a_moved_cloud_is_found_in_any_frame() {
        let truth = pose([0.9, -1.1, 0.6], [0.004, -0.006, 0.005]);
        let (target, source) = (bowl(40_000, 0.0), bowl(20_000, 0.37));
        let config = PairConfig { stop_mm: 1e-5, stop_rad: 1e-7, ..PairConfig::default() };
        let frames = [
            Isometry3::identity(),
            pose([300.0, -120.0, 450.0], [0.4, 0.8, 0.2]),
            pose([-900.0, 700.0, 1000.0], [-1.5, 0.3, 2.0]),
        ];
        let errors = frames.map(|frame| {
            let (target, source) = (moved(&target, &frame), moved(&source, &(frame * truth.inverse())));
            let found = align(&source, &target, &Isometry3::identity(), &config);
            assert!(found.converged && found.inliers > 0.95, "{found:?}");
            frame.inverse() * found.target_from_source * frame
        });
        for error in errors.map(|found| found * truth.inverse()) {
            assert!(error.translation.vector.norm() < 0.01 && error.rotation.angle() < 2e-4, "{error}");
        }
        for found in &errors[1..] {
            let apart = errors[0].inverse() * found;
            assert!(
                apart.rotation.angle().to_degrees() < 1e-3 && apart.translation.vector.norm() < 1e-3,
                "{apart}"
            );
        }
    }

    #[test]
    fn clouds_apart_stay_where_they_are() {
        let (target, source) = (bowl(1000, 0.0), moved(&bowl(1000, 0.3), &pose([500.0, 0.0, 0.0], [0.0; 3])));
        let found = align(&source, &target, &Isometry3::identity(), &PairConfig::default());
        assert!(!found.converged && found.inliers == 0.0);
        assert!(found.target_from_source.translation.vector.norm() < 1e-9);
    }
}
