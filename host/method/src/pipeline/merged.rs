//! Registered views as one cloud.

use super::config::{Method, SearchConfig};
use super::exclusion::Scene;
use super::reconstruction::Reconstruction;
use super::scale_search::ScaleSearch;
use super::stages::Stages;
use crate::geometry::cloud::{Merged, View};
use crate::geometry::grid::Grid;
use crate::model::agreement::{HandEyeError, ViewReport};
use crate::model::base_frame::{BaseFrame, CameraFinding};
use crate::model::downsampling::{Scale, VoxelConfig};
use crate::model::reconstruction::Registration;

/// Registered views as one cloud, and what was learned of them.
pub struct MergedViews {
    /// Those that fit, without their points.
    pub(super) views: Vec<View>,
    pub(super) registration: Registration,
    pub(super) cloud: Merged,
    pub(super) scale: Scale,
    pub(super) reports: Vec<ViewReport>,
    pub(super) hand_eye: Option<HandEyeError>,
    pub(super) base_frame: Option<BaseFrame>,
    pub(super) camera: Option<CameraFinding>,
    pub(super) warnings: Vec<String>,
}

impl MergedViews {
    pub(super) fn new(reconstruction: Reconstruction, sizes: &VoxelConfig, stages: &mut Stages) -> Self {
        let Reconstruction { views, patches, agreement, location, camera } = reconstruction;
        let base_frame = location.and_then(|location| location.base_frame);
        let views = &views[..];
        let reports = if views.len() > 1 { agreement.report(views, &patches) } else { Vec::new() };
        let mut warnings = agreement.warnings(views, &patches);
        warnings.extend(base_frame.iter().flat_map(BaseFrame::warnings));
        warnings.extend(camera.iter().flat_map(CameraFinding::warnings));
        let hand_eye = agreement.hand_eye;
        let (views, patches) = (agreement.of(views), agreement.of(&patches));
        let registration = agreement.registration.clone();
        let cloud = stages.time("merge", || Merged::new(&views, &registration.base_from_camera));
        let scale = Scale::of(&cloud, &patches, sizes);
        let views = views.iter().map(without_points).collect();
        Self { views, registration, cloud, scale, reports, hand_eye, base_frame, camera, warnings }
    }

    /// The search for seams in what is work.
    pub(super) fn search<'a>(
        &'a self,
        scene: &'a Scene,
        raw: &'a Grid,
        method: Method,
        config: &'a SearchConfig,
    ) -> ScaleSearch<'a> {
        let (merged, excluded) = (scene.work(&self.cloud), scene.excluded());
        let Self { views, registration, .. } = self;
        ScaleSearch { views, merged, excluded, raw, registration, method, config }
    }
}

fn without_points(view: &View) -> View {
    let View { name, points_mm: _, normals: _, base_from_camera, camera_known, mesh, picture } = view;
    View {
        name: name.clone(),
        points_mm: Vec::new(),
        normals: Vec::new(),
        base_from_camera: *base_from_camera,
        camera_known: *camera_known,
        mesh: mesh.clone(),
        picture: *picture,
    }
}
