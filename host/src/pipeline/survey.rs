//! The steps of a plan, each of which keeps what the next one needs: views that are merged, seams that are found in them, and the
//! plan with what a person asks for beside. Whoever holds a step goes on from it.
//!
//! A step is given a [`Config`] without the settings of the later ones, so that what it finds hangs on nothing else.

use std::sync::Arc;

use super::exclusion::{Exclusion, Scene};
use super::reconstructed::Reconstructed;
use super::scale_search::{ScaleResult, ScaleSearch};
use super::tacks::{self, Ground};
use super::{
    BaseFrame, CameraFinding, Clock, Config, HandEyeError, Observer, Plan, PlanError, RAW_CELL_MM,
    ViewReport, derived, no_seam,
};
use crate::geometry::cloud::{Merged, View};
use crate::geometry::grid::Grid;
use crate::model::downsampling::Scale;
use crate::model::reconstruction::Registration;
use crate::seam::extraction::SeamConfig;
use crate::seam::measure::coverage;
use crate::weld::SeamPath;

impl Config {
    /// What decides how views are merged: nothing is excluded or sought yet.
    pub fn of_merge(&self) -> Self {
        Self { exclusion: Exclusion::default(), seam: SeamConfig::default(), ..self.of_survey() }
    }

    /// What decides which seams are found without asking.
    pub fn of_survey(&self) -> Self {
        Self { asked: Vec::new(), drawn: Vec::new(), kept_back: Vec::new(), ..self.clone() }
    }
}

/// Registered views as one cloud.
pub struct MergedViews {
    /// Those that fit, without their points.
    views: Vec<View>,
    registration: Registration,
    cloud: Merged,
    scale: Scale,
    reports: Vec<ViewReport>,
    hand_eye: Option<HandEyeError>,
    base_frame: Option<BaseFrame>,
    camera: Option<CameraFinding>,
    warnings: Vec<String>,
    clock: Clock,
}

impl MergedViews {
    /// As [`Config::of_merge`] says.
    ///
    /// # Errors
    /// If the observer wants no more.
    pub fn new(views: &[View], config: &Config, observer: &mut impl Observer) -> Result<Self, PlanError> {
        let mut clock = Clock::default();
        let Reconstructed { views, patches, agreement, location, camera } =
            Reconstructed::new(views, config, &mut clock, observer)?;
        let base_frame = location.and_then(|location| location.base_frame);
        let views = &views[..];
        let reports = if views.len() > 1 { agreement.report(views, &patches) } else { Vec::new() };
        let mut warnings = agreement.warnings(views, &patches);
        warnings.extend(base_frame.iter().flat_map(BaseFrame::warnings));
        warnings.extend(camera.iter().flat_map(CameraFinding::warnings));
        let hand_eye = agreement.hand_eye;
        let (views, patches) = (agreement.of(views), agreement.of(&patches));
        let registration = agreement.registration.clone();
        let cloud = clock.time("merge", || Merged::new(&views, &registration.base_from_camera));
        let scale = Scale::of(&cloud, &patches, &config.downsampling);
        let views = views.iter().map(without_points).collect();
        Ok(Self { views, registration, cloud, scale, reports, hand_eye, base_frame, camera, warnings, clock })
    }
}

fn without_points(view: &View) -> View {
    let View { name, points_mm: _, normals: _, base_from_camera, camera_known, mesh } = view;
    View {
        name: name.clone(),
        points_mm: Vec::new(),
        normals: Vec::new(),
        base_from_camera: *base_from_camera,
        camera_known: *camera_known,
        mesh: mesh.clone(),
    }
}

/// The seams of a scan that show without asking.
pub struct Survey {
    merged: Arc<MergedViews>,
    scene: Scene,
    /// Spatial index of the work.
    raw: Grid,
    /// The work without its tacks, if there are any.
    ground: Option<Ground>,
    result: ScaleResult,
    clock: Clock,
}

impl Survey {
    /// As [`Config::of_survey`] says.
    ///
    /// # Errors
    /// If there is nothing to seek in, or the observer wants no more.
    pub fn new(
        merged: Arc<MergedViews>,
        config: &Config,
        observer: &mut impl Observer,
    ) -> Result<Self, PlanError> {
        let mut clock = merged.clock.clone();
        let MergedViews { views, registration, cloud, scale, .. } = &*merged;
        let scene = clock.time("exclusion", || Scene::new(cloud, scale, config))?;
        let work = scene.work(cloud);
        let raw = clock.time("index", || Grid::new(&work.points_mm, RAW_CELL_MM));
        let excluded = scene.excluded();
        let search = ScaleSearch { views, merged: work, excluded, raw: &raw, registration, config };
        let (result, ground) = tacks::sought_without(&search, scale, &mut clock, observer)?;
        Ok(Self { merged, scene, raw, ground, result, clock })
    }

    /// The plan, with what is asked for.
    ///
    /// # Errors
    /// If there is no seam.
    pub fn plan(&self, config: &Config, observer: &mut impl Observer) -> Result<Plan, PlanError> {
        let mut clock = self.clock.clone();
        let MergedViews { views, registration, cloud, reports, .. } = &*self.merged;
        let work = self.scene.work(cloud);
        let excluded = self.scene.excluded();
        let search = ScaleSearch { views, merged: work, excluded, raw: &self.raw, registration, config };
        let search = self.ground.as_ref().map_or(search, |ground| ground.in_place_of(&search));
        let mut result = self.result.clone();
        let ask = || (search.ask(&mut result), search.draw(&mut result));
        let (unmet, undrawn) = match config.asked.is_empty() && config.drawn.is_empty() {
            true => clock.time("seam", ask),
            false => clock.stage("asked", observer, ask),
        };
        let ScaleResult { scale, model, mut found, .. } = result;
        self.scene.trim(&mut found, views);
        self.scene.show(cloud, &model, search.raw, &found, observer);
        if found.seams.is_empty() {
            let reason = [vec![found.reason], unmet, undrawn].concat().join("; ");
            return Err(no_seam(self.scene.reason(cloud, reason)));
        }
        let paths = clock.stage("toolpath", observer, || found.seams.iter().map(SeamPath::along).collect());
        let gaps = || coverage::gaps(&found.seams, search.merged, search.raw, search.cameras_known());
        let coverage = clock.time("coverage", gaps);
        let tacks = self.ground.as_ref().map_or_else(Vec::new, |ground| ground.on(&found.seams));
        let mut warnings = self.merged.warnings.clone();
        warnings.extend(found.warnings);
        warnings.extend(tacks::words(&tacks));
        warnings.extend(coverage.iter().map(coverage::Gap::words));
        warnings.extend(self.scene.warning());
        let mut derived = derived(&scale, found.gate);
        derived.extend(self.scene.derived(cloud));
        Ok(Plan {
            model: model.scene().1.clone(),
            seams: found.seams,
            paths,
            coverage,
            tacks,
            views: reports.clone(),
            hand_eye: self.merged.hand_eye,
            base_frame: self.merged.base_frame.clone(),
            camera: self.merged.camera.clone(),
            touch: None,
            derived,
            stage_s: clock.stages,
            orientation_assumed: found.orientation_assumed,
            unmet,
            undrawn,
            warnings,
        })
    }
}
