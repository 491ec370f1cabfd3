//! The method on one page: the paper's Fig. 1 from views to torch paths.

pub mod background;
pub mod calibration;
pub mod exclusion;
mod reconstructed;
mod scale_search;
pub mod survey;
pub mod tacks;
pub mod touch;

use self::exclusion::Exclusion;
use self::survey::{MergedViews, Survey};
use crate::geometry::cloud::{Merged, PointCloud, View};
use crate::geometry::grid::Grid;
pub use crate::model::agreement::{HandEyeError, Misfit, ViewReport};
pub use crate::model::base_frame::{
    Anchor, BaseFrame, Calibration, CameraFinding, CellAccuracy, HandEyeCorrection,
};
pub use crate::model::camera::CameraErrors;
use crate::model::downsampling::Voxels;
use crate::model::downsampling::{DISTANCE_VOXELS, HEIGHT_NOISES, RADIUS_VOXELS};
use crate::model::{downsampling, normals, reconstruction};
use crate::seam::Seam;
use crate::seam::extraction::SeamConfig;
use crate::seam::measure::coverage;
use crate::seam::score::edges;
use crate::weld::SeamPath;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::time::Instant;

/// How seams are found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Method {
    /// Everything this crate knows.
    #[default]
    Weldpath,
    /// Eqs. (1)-(17) as printed where that can be run: views chained, no gate, no classification, edge points ordered as
    /// they come; for comparison. ARCHITECTURE.md lists the repairs.
    Paper {
        /// `t` of eq. (16).
        ratio_threshold: f64,
    },
}

/// Settings of every stage, in the order of the stages.
#[derive(Debug, Clone)]
pub struct Config {
    /// How seams are found.
    pub method: Method,
    /// Normals per view.
    pub normals: normals::NormalsConfig,
    /// Registration of the views.
    pub reconstruction: reconstruction::ReconstructionConfig,
    /// What holds the model in the robot's base frame; nothing where the coordinates are not the robot's.
    pub anchor: Option<Anchor>,
    /// What other scans of the cell told of hand-eye transform and camera.
    pub calibration: Option<Calibration>,
    /// Voxel grid.
    pub downsampling: downsampling::VoxelConfig,
    /// What is scanned and is no work.
    pub exclusion: Exclusion,
    /// Seams and their refinement.
    pub seam: SeamConfig,
    /// Seams that a person asks for, each by places near it in their order, mm.
    pub asked: Vec<Vec<Point3<f64>>>,
    /// Lines that a person draws on the surface, each by its places in their order, mm.
    pub drawn: Vec<Vec<Point3<f64>>>,
    /// Places whose seams are kept from the search, mm: to measure what asking for them finds.
    pub kept_back: Vec<Point3<f64>>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            method: Method::default(),
            normals: normals::NormalsConfig::default(),
            reconstruction: reconstruction::ReconstructionConfig::default(),
            anchor: Some(Anchor::default()),
            calibration: None,
            downsampling: downsampling::VoxelConfig::default(),
            exclusion: Exclusion::default(),
            seam: SeamConfig::default(),
            asked: Vec::new(),
            drawn: Vec::new(),
            kept_back: Vec::new(),
        }
    }
}

/// What [`plan`] found.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Plan {
    /// All views merged, registered, downsampled and denoised.
    pub model: PointCloud,
    /// Weldable seams in weld order.
    pub seams: Vec<Seam>,
    /// One path per seam, in the same order.
    pub paths: Vec<SeamPath>,
    /// Stretches of the seams that should be scanned again.
    pub coverage: Vec<coverage::Gap>,
    /// What was taken off the seams before they were sought again, along each.
    pub tacks: Vec<tacks::Tack>,
    /// One per view that was read, those left out among them; empty for a single cloud.
    pub views: Vec<ViewReport>,
    /// What the views say of the hand-eye transform, where there are enough of them.
    pub hand_eye: Option<HandEyeError>,
    /// What the views say of robot and camera; none where the coordinates are not the robot's, and where the first view is
    /// taken as exact.
    pub base_frame: Option<BaseFrame>,
    /// What the views say of the camera's own errors; none of a single view, and where the coordinates are not the robot's.
    pub camera: Option<CameraFinding>,
    /// What points that the robot's tip touched made of it.
    pub touch: Option<touch::Touched>,
    /// Parameters that were derived from the data: name, value, unit, how.
    pub derived: Vec<Derived>,
    /// Stage name and wall time, seconds.
    pub stage_s: Vec<(Cow<'static, str>, f64)>,
    /// Whether what was seen hardly tells from which side, and it is assumed.
    pub orientation_assumed: bool,
    /// Of the seams that were asked for, those that are not there, and why.
    pub unmet: Vec<String>,
    /// Of the lines that were drawn, those that the scan does not bear, and why.
    pub undrawn: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// A parameter that was derived from the data.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Derived {
    /// Name with its unit, such as `voxel_mm`.
    pub name: Cow<'static, str>,
    /// Its value.
    pub value: f64,
    /// How it was derived, in words.
    pub how: String,
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Nothing weldable in view; the reason says what was seen instead.
    #[error("no seam found: {reason}")]
    NoSeam {
        /// What was seen instead, and what to do.
        reason: String,
    },
    /// [`Observer::is_done`] said so.
    #[error("the plan was given up")]
    GivenUp,
    /// Points that the tip touched do not fit the plan.
    #[error(transparent)]
    Touch(#[from] touch::Error),
}

/// What the seams were sought in, for those who draw it.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// All registered views, raw.
    pub merged: &'a Merged,
    /// Spatial index of its points.
    pub raw: &'a Grid,
    /// The thinned cloud, before the filter.
    pub voxels: &'a Voxels,
    /// The same after it, in the same order.
    pub model: &'a PointCloud,
    /// Spatial index of the model.
    pub index: &'a Grid,
    /// Edge intensity of each point of the model.
    pub intensity: &'a [f32],
    /// What looked like a seam and is none that could be welded: each with its place and why.
    pub rejected: &'a [String],
}

/// Sees every stage as it finishes; `()` is an observer that does nothing.
pub trait Observer {
    /// A stage begins; `name` is the name of its module.
    fn stage(&mut self, name: &'static str) {
        let _ = name;
    }
    /// The cloud after a stage.
    fn cloud(&mut self, stage: &'static str, cloud: &PointCloud) {
        let _ = (stage, cloud);
    }
    /// What seams were searched in, whether or not any was found: called once, when the size of the voxels is settled.
    fn evidence(&mut self, evidence: &Evidence) {
        let _ = evidence;
    }
    /// Whether nobody waits for the plan any more; asked between stages.
    fn is_done(&self) -> bool {
        false
    }
}

impl Observer for () {}

/// Cells in which the raw points are looked up, mm: what seams and their surroundings ask for is a few times as large.
pub const RAW_CELL_MM: f32 = 5.0;

/// From views to torch paths: the paper's Fig. 1 in the steps of [`survey`].
///
/// ```
/// use std::path::Path;
/// use weldpath::{input, pipeline};
///
/// // A level plate of 40 by 40 mm and nothing on it: no seam, and a reason why.
/// let rows = (0..1600).map(|i| format!("{} {} {}\n", i % 40, i / 40, 0.001 * f64::from(i % 7)));
/// let bytes = rows.collect::<String>().into_bytes();
/// let options = input::Options { units: input::Units::Millimetres, ..Default::default() };
/// let scan = input::read_bytes(bytes, Path::new("plate.xyz"), &options)?;
/// let planned = pipeline::plan(&scan.views, &pipeline::Config::default(), &mut ());
/// assert!(planned.unwrap_err().to_string().starts_with("no seam found: "));
/// # Ok::<(), input::Error>(())
/// ```
pub fn plan(views: &[View], config: &Config, observer: &mut impl Observer) -> Result<Plan, PlanError> {
    let merged = MergedViews::new(views, &config.of_merge(), observer)?;
    Survey::new(merged.into(), &config.of_survey(), observer)?.plan(config, observer)
}

fn go_on(observer: &impl Observer) -> Result<(), PlanError> {
    if observer.is_done() { Err(PlanError::GivenUp) } else { Ok(()) }
}

/// The sizes that were derived from the data, for the summary.
fn derived(scale: &downsampling::Scale, gate: f32) -> Vec<Derived> {
    let row = |name: &'static str, value: f32, how: &str| Derived {
        name: name.into(),
        value: f64::from(value),
        how: how.into(),
    };
    let filter = scale.bilateral();
    vec![
        row("spacing_mm", scale.spacing_mm, "mean distance to the nearest neighbour within a view"),
        row(
            "noise_mm",
            scale.noise_mm,
            "lower quartile of the deviation of points from the planes fitted to them",
        ),
        row("voxel_mm", scale.edge_mm, scale.how),
        row("voxel_points", scale.least as f32, "points a voxel must hold, from the usual number"),
        row("bilateral_radius_mm", filter.radius_mm, &format!("{RADIUS_VOXELS} voxels")),
        row("bilateral_distance_mm", filter.distance_mm, &format!("{DISTANCE_VOXELS} voxels")),
        row("bilateral_height_mm", filter.height_mm, &format!("{HEIGHT_NOISES} x noise")),
        row("intensity_gate", gate, &edges::gate_in_words()),
    ]
}

fn no_seam(reason: String) -> PlanError {
    PlanError::NoSeam { reason }
}

/// Wall time of each stage.
#[derive(Clone, Default)]
struct Clock {
    stages: Vec<(Cow<'static, str>, f64)>,
}

impl Clock {
    /// Does the work of a stage, and tells the observer before.
    fn stage<T>(&mut self, name: &'static str, observer: &mut impl Observer, work: impl FnOnce() -> T) -> T {
        observer.stage(name);
        self.time(name, work)
    }

    fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let begin = Instant::now();
        let done = work();
        let spent = begin.elapsed().as_secs_f64();
        match self.stages.iter_mut().find(|(name, _)| name == stage) {
            Some((_, total)) => *total += spent,
            None => self.stages.push((stage.into(), spent)),
        }
        done
    }
}
