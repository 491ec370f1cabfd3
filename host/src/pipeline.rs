//! The method on one page: the paper's Fig. 1 from views to torch paths.

use crate::cloud::{PointCloud, View};
use crate::seam::Seam;
use crate::toolpath::SeamPath;

/// How seams are found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Method {
    /// Everything this crate knows.
    #[default]
    Weldpath,
    /// Eqs. (13)-(17) alone: no gate, no classification, edge points ordered as they come; for comparison.
    Paper {
        /// `t` of eq. (16).
        ratio_threshold: f64,
    },
}

/// Settings of every stage, in the order of the stages.
#[derive(Debug, Clone, Default)]
pub struct Config {
    /// How seams are found.
    pub method: Method,
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

/// What [`plan`] found.
#[derive(Debug, Clone)]
pub struct Plan {
    /// All views merged, registered, downsampled and denoised.
    pub model: PointCloud,
    /// Weldable seams in weld order.
    pub seams: Vec<Seam>,
    /// One path per seam, in the same order.
    pub paths: Vec<SeamPath>,
    /// One per view; empty for a single cloud.
    pub views: Vec<ViewReport>,
    /// Parameters that were derived from the data: name, value, unit, how.
    pub derived: Vec<Derived>,
    /// Stage name and wall time, seconds.
    pub stage_s: Vec<(&'static str, f64)>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// A parameter that was derived from the data.
#[derive(Debug, Clone)]
pub struct Derived {
    /// Name with its unit, such as `voxel_mm`.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// How it was derived, in words.
    pub how: &'static str,
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// Nothing weldable in view; the reason says what was seen instead.
    #[error("no seam found: {reason}")]
    NoSeam {
        /// What was seen instead, and what to do.
        reason: String,
    },
}

/// Sees every stage as it finishes; `()` looks away.
pub trait Observer {
    /// A stage begins; `name` is the name of its module.
    fn stage(&mut self, name: &'static str) {
        let _ = name;
    }
    /// The cloud after a stage.
    fn cloud(&mut self, stage: &'static str, cloud: &PointCloud) {
        let _ = (stage, cloud);
    }
}

impl Observer for () {}

/// From views to torch paths.
pub fn plan(views: &[View], config: &Config, observer: &mut impl Observer) -> Result<Plan, Error> {
    let _ = (views, config, observer);
    Err(Error::NoSeam { reason: "the pipeline is not built yet".into() })
}
