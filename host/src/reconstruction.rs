//! All views to one consistent model (paper II-C).
//!
//! Every view starts at its kinematic pose, eq. (1), and every pair of views that overlap is tied by point-to-plane
//! terms. Departures from the paper: all poses are solved together, not as a chain; the reported pose of each view is a
//! Gaussian prior, so that what the surfaces cannot see stays where the robot said; view 0 is never moved and defines
//! the frame. What remains uncertain is returned, per view, and goes into each seam's expected error.

mod correspondence;
pub mod icp;
pub mod pair;
mod source;
mod system;

use crate::cloud::View;
use crate::normals::Patches;
use nalgebra::{DMatrix, Isometry3, Matrix6, Point3, Vector3};

/// How views are registered.
#[derive(Debug, Clone)]
pub struct Config {
    /// Pairs farther apart than this are not matched; one value per round, coarse to fine.
    pub gates_mm: Vec<f32>,
    /// Most iterations of each round.
    pub iterations: usize,
    /// One standard deviation of a reported camera position, mm; infinite where poses are only a first guess.
    pub prior_mm: f64,
    /// One standard deviation of a reported camera orientation about each axis, rad.
    pub prior_rad: f64,
    /// Largest distance of a pair that counts as aligned in the fitness, mm.
    pub fitness_mm: f32,
    /// Patches of each view that are matched per iteration.
    pub sample: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            gates_mm: vec![15.0, 5.0, 2.5],
            iterations: 12,
            prior_mm: 1.5,
            prior_rad: 0.008,
            fitness_mm: 2.0,
            sample: 4000,
        }
    }
}

/// Where the views are, and how well that is known.
#[derive(Debug, Clone)]
pub struct Registration {
    /// Registered pose of each view.
    pub base_from_camera: Vec<Isometry3<f64>>,
    /// Share of each view's overlapping patches that have an aligned partner: before, and after each iteration.
    pub fitness: Vec<Vec<f64>>,
    /// Covariance of the 6 parameters (rotation about `centre_mm`, translation) of all views but the first.
    pub covariance: DMatrix<f64>,
    /// Centre of the rotations in `covariance`, mm, base frame.
    pub centre_mm: Point3<f64>,
    /// Robust standard deviation of the final residuals, mm.
    pub residual_mm: f64,
}

impl Registration {
    /// Covariance of the 6 parameters of one view; zero for the first.
    pub fn covariance_of(&self, view: usize) -> Matrix6<f64> {
        match view.checked_sub(1) {
            Some(k) => self.covariance.fixed_view::<6, 6>(6 * k, 6 * k).into_owned(),
            None => Matrix6::zeros(),
        }
    }

    /// Variance of a place as view `view` sees it, along a direction, mm².
    pub fn variance_mm2(&self, view: usize, place_mm: &Point3<f64>, along: &Vector3<f64>) -> f64 {
        let row = system::point_row(&(place_mm - self.centre_mm), along);
        (row.transpose() * self.covariance_of(view) * row)[0]
    }
}

/// How one view was registered.
#[derive(Debug, Clone)]
pub struct ViewReport {
    /// [`View::name`].
    pub name: String,
    /// Share of the overlapping points with a neighbour nearer than 2 mm, at the kinematic pose.
    pub fitness_before: f64,
    /// The same after registration.
    pub fitness_after: f64,
    /// The same after each iteration.
    pub fitness_per_iteration: Vec<f64>,
    /// How far the view was moved: mm at its centroid, degrees.
    pub moved_mm: f64,
    /// Rotation of the correction, degrees.
    pub moved_deg: f64,
    /// One standard deviation of its position at the work that remains, mm, in the worst direction.
    pub uncertainty_mm: f64,
}

/// Registers views, given their patches in camera frames; at least one view.
pub fn register(views: &[View], patches: &[Patches], config: &Config) -> Registration {
    icp::Problem::new(views, patches, config).solve(config)
}

/// Share of aligned patches below which a view counts as not registered.
const POOR_FITNESS: f64 = 0.35;

impl Registration {
    /// One report per view.
    pub fn report(&self, views: &[View]) -> Vec<ViewReport> {
        views
            .iter()
            .enumerate()
            .map(|(k, view)| {
                let done = self.base_from_camera[k] * view.base_from_camera.inverse();
                let (sd_mm, _) = self.loosest(k);
                ViewReport {
                    name: view.name.clone(),
                    fitness_before: self.fitness[k].first().copied().unwrap_or(0.0),
                    fitness_after: self.fitness[k].last().copied().unwrap_or(0.0),
                    fitness_per_iteration: self.fitness[k].clone(),
                    moved_mm: (done * self.centre_mm - self.centre_mm).norm(),
                    moved_deg: done.rotation.angle().to_degrees(),
                    uncertainty_mm: sd_mm,
                }
            })
            .collect()
    }

    /// Largest standard deviation of a view's translation at the centre of the work, mm, and its direction.
    pub fn loosest(&self, view: usize) -> (f64, Vector3<f64>) {
        let translation = self.covariance_of(view).fixed_view::<3, 3>(3, 3).into_owned();
        let eigen = translation.symmetric_eigen();
        let k = eigen.eigenvalues.imax();
        (eigen.eigenvalues[k].max(0.0).sqrt(), eigen.eigenvectors.column(k).into_owned())
    }

    /// What the user should know about the registration.
    pub fn warnings(&self, views: &[View], patches: &[Patches]) -> Vec<String> {
        let mut warnings = Vec::new();
        for (k, view) in views.iter().enumerate().filter(|_| views.len() > 1) {
            let fitness = self.fitness[k].last().copied().unwrap_or(0.0);
            if patches[k].cloud.len() < 100 {
                warnings.push(format!("{} shows almost nothing and was not registered", view.name));
            } else if fitness < POOR_FITNESS {
                let percent = 100.0 * fitness;
                warnings.push(format!(
                    "{} could not be registered: only {percent:.0} % of it lies on the other views; check its pose, or \
                     leave it out",
                    view.name
                ));
            }
        }
        warnings
    }
}
