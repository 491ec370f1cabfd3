//! Settings of the steps. A step is given its own and no others: what is kept of it depends on nothing else.

use super::exclusion::Exclusion;
use crate::model::base_frame::{Anchor, Calibration};
use crate::model::{downsampling, normals, reconstruction};
use crate::seam::extraction::SeamConfig;
use nalgebra::Point3;

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
#[derive(Debug, Clone, Default)]
pub struct SearchConfig {
    /// What is scanned and is no work.
    pub exclusion: Exclusion,
    /// Seams and their refinement.
    pub seam: SeamConfig,
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
