//! All views to one consistent model (paper II-C).
//!
//! Every view starts at its kinematic pose, eq. (1), and every pair of views that overlap is tied by point-to-plane
//! terms. Departures from the paper: all poses are solved together, not as a chain; the reported pose of each view is a
//! Gaussian prior, so that what the surfaces cannot see stays where the robot said; view 0 is never moved and defines
//! the frame. What remains uncertain is returned, per view, and goes into each seam's expected error.

pub mod icp;

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
            sample: std::env::var("SM").ok().and_then(|v| v.parse().ok()).unwrap_or(4000),
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
        let row = icp::point_row(&(place_mm - self.centre_mm), along);
        (row.transpose() * self.covariance_of(view) * row)[0]
    }
}

/// Registers views, given their patches in camera frames.
pub fn register(views: &[View], patches: &[Patches], config: &Config) -> Registration {
    icp::Problem::new(views, patches, config).solve(config)
}
