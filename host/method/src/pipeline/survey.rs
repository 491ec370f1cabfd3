//! The seams of a scan that show without asking, and what is said and derived beside them.

use super::config::{Method, SearchConfig};
use super::exclusion::Scene;
use super::merged::MergedViews;
use super::result::{self, Derivation};
use super::scale_search::{ScaleResult, ScaleSearch};
use super::sparse;
use super::stages::Times;
use super::tacks::{self, Ground, Tack};
use crate::geometry::grid::Grid;
use crate::seam::Seam;
use crate::seam::measure::coverage::Gap;

/// The seams of a scan that show without asking.
pub struct Survey {
    pub(super) scene: Scene,
    /// Spatial index of the work.
    pub(super) raw: Grid,
    /// The work without its tacks, if there are any.
    pub(super) ground: Option<Ground>,
    pub(super) result: ScaleResult,
}

impl Survey {
    /// The search that found them, to go on with.
    pub(super) fn search<'a>(
        &'a self,
        merged: &'a MergedViews,
        method: Method,
        config: &'a SearchConfig,
    ) -> ScaleSearch<'a> {
        let search = merged.search(&self.scene, &self.raw, method, config);
        self.ground.as_ref().map_or(search, |ground| ground.in_place_of(&search))
    }

    /// The tacks on these seams.
    pub(super) fn tacks(&self, seams: &[Seam]) -> Vec<Tack> {
        self.ground.as_ref().map_or_else(Vec::new, |ground| ground.on(seams))
    }

    /// What the user should know of all steps.
    pub(super) fn warnings(
        &self,
        merged: &MergedViews,
        result: &ScaleResult,
        tacks: &[Tack],
        gaps: &[Gap],
    ) -> Vec<String> {
        let mut warnings = merged.warnings.clone();
        warnings.extend_from_slice(&result.found.warnings);
        warnings.extend(tacks::words(tacks));
        warnings.extend(gaps.iter().map(Gap::words));
        warnings.extend(self.scene.warning());
        warnings.extend(sparse::words(&self.raw));
        warnings
    }

    /// What all steps derived.
    pub(super) fn derived(&self, merged: &MergedViews, result: &ScaleResult, times: &Times) -> Derivation {
        let mut parameters = result::sizes(&result.scale, result.found.gate);
        parameters.extend(self.scene.derived(&merged.cloud));
        Derivation {
            views: merged.reports.clone(),
            hand_eye: merged.hand_eye,
            base_frame: merged.base_frame.clone(),
            camera: merged.camera.clone(),
            touch: None,
            orientation_assumed: result.found.orientation_assumed,
            parameters,
            stage_s: times.clone(),
        }
    }
}
