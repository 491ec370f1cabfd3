//! Settings of the steps. A step is given its own and no others: what is kept of it depends on nothing else.

use super::exclusion::Exclusion;
use crate::model::base_frame::{Anchor, Calibration};
use crate::model::{downsampling, normals, reconstruction};
use crate::seam::extraction::SeamConfig;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How seams are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The whole pipeline.
    #[default]
    Weldpath,
    // Views chained, no gate, no classification, edge points ordered as they come; ARCHITECTURE.md lists the repairs.
    /// The paper's eqs. (13)-(17) alone, for comparison.
    Paper,
}

/// `t` of eq. (16), where nothing else is said.
pub const RATIO_THRESHOLD: f64 = 53.0;

/// Settings of all steps, in their order.
#[derive(Debug, Clone, Default)]
pub struct Config {
    /// How seams are found.
    pub method: Method,
    /// From views to one cloud.
    pub merge: MergeConfig,
    /// From the cloud to the seams that show without asking.
    pub search: SearchConfig,
    /// What a person asks for beside.
    pub wishes: Wishes,
}

/// How views become one cloud in the robot's base frame.
#[derive(Debug, Clone)]
pub struct MergeConfig {
    /// Normals per view.
    pub normals: normals::NormalsConfig,
    /// Registration of the views.
    pub reconstruction: reconstruction::ReconstructionConfig,
    /// What holds the model in the robot's base frame; nothing where the coordinates are not the robot's.
    pub anchor: Option<Anchor>,
    /// Hand-eye transform and camera errors, from other scans of the cell.
    pub calibration: Option<Calibration>,
    /// Size of the voxels.
    pub downsampling: downsampling::VoxelConfig,
}

impl Default for MergeConfig {
    fn default() -> Self {
        Self {
            normals: normals::NormalsConfig::default(),
            reconstruction: reconstruction::ReconstructionConfig::default(),
            anchor: Some(Anchor::default()),
            calibration: None,
            downsampling: downsampling::VoxelConfig::default(),
        }
    }
}

/// Where seams are sought, and how.
#[derive(Debug, Clone)]
pub struct SearchConfig {
    /// What is scanned and is no work.
    pub exclusion: Exclusion,
    /// Seams and their refinement.
    pub seam: SeamConfig,
    /// `t` of eq. (16), for [`Method::Paper`].
    pub ratio_threshold: f64,
}

impl Default for SearchConfig {
    fn default() -> Self {
        let (exclusion, seam) = Default::default();
        Self { exclusion, seam, ratio_threshold: RATIO_THRESHOLD }
    }
}

/// What a person asks for; places are in the base frame, mm.
#[derive(Debug, Clone, Default)]
pub struct Wishes {
    /// Seams, each by places near it in their order.
    pub asked: Vec<Vec<Point3<f64>>>,
    /// Lines drawn on the surface, each by its places in their order.
    pub drawn: Vec<Vec<Point3<f64>>>,
    /// Places whose seams are kept from the search: to measure what asking for them finds.
    pub kept_back: Vec<Point3<f64>>,
}
