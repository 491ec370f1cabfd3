//! What a plan is, and why there is none.

use super::{tacks, touch};
use crate::geometry::cloud::PointCloud;
use crate::geometry::surface::Surface;
use crate::model::agreement::{HandEyeError, ViewReport};
use crate::model::base_frame::{BaseFrame, CameraFinding};
use crate::model::downsampling::{DISTANCE_VOXELS, HEIGHT_NOISES, RADIUS_VOXELS, Scale};
use crate::seam::measure::coverage;
use crate::seam::score::edges;
use crate::seam::{Seam, Unwelded};
use crate::weld::SeamPath;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// What [`plan`](super::plan) found, what it derived on the way, and what the user should be told.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Plan {
    /// All views merged, registered, downsampled and denoised.
    pub model: PointCloud,
    /// Weldable seams in weld order.
    pub seams: Vec<Seam>,
    /// Inside corners that are seen and are none of these.
    pub unwelded: Vec<Unwelded>,
    /// One path per seam, in the same order.
    pub paths: Vec<SeamPath>,
    /// Stretches of the seams that should be scanned again.
    pub coverage: Vec<coverage::Gap>,
    /// Seams at an upright plate of which one side was seen.
    pub one_sided: Vec<coverage::OneSided>,
    /// What was taken off the seams before they were sought again, along each.
    pub tacks: Vec<tacks::Tack>,
    /// What was derived from the views.
    pub derived: Derivation,
    /// What the user should be told.
    pub said: Remarks,
    /// See [`Plan::surface`].
    #[serde(skip)]
    pub surface: OnceLock<Surface>,
    /// See [`Plan::remembered`].
    #[serde(skip)]
    pub remembered: Remembered,
}

/// Sets of seams, by what decided them.
#[derive(Debug, Default)]
pub struct Remembered(Mutex<HashMap<String, Arc<BTreeSet<usize>>>>);

impl Clone for Remembered {
    /// Empty: a copy is made to be changed.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Plan {
    /// Ids of seams that are found once for all who ask with the same key.
    pub fn remembered(&self, key: String, find: impl FnOnce() -> BTreeSet<usize>) -> Arc<BTreeSet<usize>> {
        let sets = || self.remembered.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = sets().get(&key).cloned();
        known.unwrap_or_else(|| {
            // Found without the lock: it may take long, and be given up.
            let found = Arc::new(find());
            sets().insert(key, Arc::clone(&found));
            found
        })
    }

    /// The model without points that stand alone; found when it is first asked for.
    pub fn surface(&self) -> &Surface {
        self.surface.get_or_init(|| Surface::of(&self.model))
    }
}

/// What a plan derived from the views, and how long that took.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Derivation {
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
    /// Whether what was seen hardly tells from which side, and it is assumed.
    pub orientation_assumed: bool,
    /// Parameters: name, value, unit, how each was derived.
    pub parameters: Vec<Parameter>,
    /// Stage name and wall time, seconds.
    pub stage_s: Vec<(Cow<'static, str>, f64)>,
}

/// What the user should be told of a plan, in words.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Remarks {
    /// What may be wrong, and what to do.
    pub warnings: Vec<String>,
    /// Of the seams that were asked for, those that are not there, and why.
    pub unmet: Vec<String>,
    /// Of the lines that were drawn, those that the scan does not bear, and why.
    pub undrawn: Vec<String>,
}

/// A parameter that was derived from the data.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Parameter {
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
    /// No seam in view, and the points are too far apart to show one.
    #[error("no seam found: {reason}")]
    TooSparse {
        /// How far apart they are, and how near they have to be.
        reason: String,
    },
    /// Views that no reader makes: none, too many, an empty one, numbers that are none.
    #[error("view {view}: {problem}")]
    NoView {
        /// Counted from 0.
        view: usize,
        /// What is wrong with it.
        problem: String,
    },
    /// [`Observer::is_done`](super::Observer::is_done) said so.
    #[error("the plan was given up")]
    GivenUp,
    /// Points that the tip touched do not fit the plan.
    #[error(transparent)]
    Touch(#[from] touch::Error),
}

/// No seam, for this reason.
pub(super) fn no_seam(reason: String) -> PlanError {
    PlanError::NoSeam { reason }
}

/// The sizes that were derived from the data, for the summary.
pub(super) fn sizes(scale: &Scale, gate: f32) -> Vec<Parameter> {
    let row = |name: &'static str, value: f32, how: &str| Parameter {
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
