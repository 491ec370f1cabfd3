//! From the views to one model in the base frame: registration, the place of all views, and the camera's own errors, which are
//! taken out of the points where the views show them.

use super::config::{MergeConfig, Method};
use super::result::PlanError;
use super::stages::Stages;
use crate::geometry::cloud::View;
use crate::model::agreement::Agreement;
use crate::model::base_frame::{Anchor, Calibration, CameraFinding, Location, Stated};
use crate::model::camera::CameraErrors;
use crate::model::{agreement, base_frame, normals, reconstruction};
use rayon::prelude::*;
use std::borrow::Cow;

/// How often the camera's errors are sought anew: they are small, and the second time little is left.
const CAMERA_ROUNDS: usize = 4;
/// Views in one model.
pub(super) struct Reconstruction<'a> {
    /// With the camera's errors taken out.
    pub(super) views: Cow<'a, [View]>,
    pub(super) patches: Vec<normals::Patches>,
    pub(super) agreement: Agreement,
    pub(super) location: Option<Location>,
    pub(super) camera: Option<CameraFinding>,
}

impl<'a> Reconstruction<'a> {
    /// Puts the views together and in the base frame, as far as that is known. What their surfaces tell of the camera's errors is
    /// taken out of the points, and all is done anew.
    pub(super) fn new(
        views: &'a [View],
        method: Method,
        config: &MergeConfig,
        stages: &mut Stages,
    ) -> Result<Self, PlanError> {
        let calibrated =
            |calibration: &Calibration| views.iter().map(|view| calibration.taken_out_of(view)).collect();
        let stated: Cow<[View]> = config.calibration.as_ref().map_or(Cow::Borrowed(views), calibrated);
        let seen = stages.stage("normals", || normals::of_views(&stated, &config.normals));
        stages.go_on()?;
        let (mut patches, mut taken_out, mut round) = (Cow::Borrowed(&seen), None, 0);
        stages.observer.stage("reconstruction");
        loop {
            let mut agreement =
                stages.time("reconstruction", || registered(&stated, &patches, method, config));
            stages.go_on()?;
            let found = stages.time("base frame", || {
                knows_cameras(&stated, method)
                    .then(|| located(&stated, &agreement, config, taken_out))
                    .flatten()
            });
            let camera = found.as_ref().and_then(|found| found.camera.clone());
            let goes_on = |camera: &&CameraFinding| {
                round < CAMERA_ROUNDS && (camera.is_significant || taken_out.is_some() && !camera.is_settled)
            };
            if let Some(further) = camera.as_ref().filter(goes_on) {
                let errors = taken_out.unwrap_or_default() + further.errors;
                let mended = seen.par_iter().map(|patches| errors.taken_out_of_patches(patches)).collect();
                (patches, taken_out, round) = (Cow::Owned(mended), Some(errors), round + 1);
                continue;
            }
            match &found {
                Some(found) => found.settle(&mut agreement.registration),
                None if config.anchor == Some(Anchor::First) && knows_cameras(&stated, method) => {
                    base_frame::anchor_first(&mut agreement.registration);
                }
                None => {}
            }
            let camera = camera.map(|camera| CameraFinding {
                errors: taken_out.unwrap_or(camera.errors),
                is_significant: taken_out.is_some(),
                ..camera
            });
            let views = match taken_out {
                Some(errors) => stated.iter().map(|view| errors.taken_out_of(view)).collect(),
                None => stated,
            };
            let patches = patches.into_owned();
            return Ok(Self { views, patches, agreement, location: found, camera });
        }
    }
}

/// Whether anything can be said of the base frame.
fn knows_cameras(views: &[View], method: Method) -> bool {
    views.iter().all(|view| view.camera_known) && method != Method::Paper
}

/// Where the views that fit are in the base frame, as far as that is known.
fn located(
    views: &[View],
    agreement: &Agreement,
    config: &MergeConfig,
    taken_out: Option<CameraErrors>,
) -> Option<Location> {
    let reported: Vec<_> = agreement.kept.iter().map(|&k| views[k].base_from_camera).collect();
    let stated = Stated {
        reported: &reported,
        anchor: config.anchor?,
        calibration: config.calibration.as_ref(),
        taken_out,
        beyond_repair: agreement.hand_eye.is_some_and(|error| error.is_gross()),
    };
    base_frame::locate(&stated, &agreement.registration)
}

/// Views put right against each other, and those that do not fit left out.
fn registered(
    views: &[View],
    patches: &[normals::Patches],
    method: Method,
    config: &MergeConfig,
) -> Agreement {
    match method {
        Method::Weldpath => {
            let known = match &config.anchor {
                Some(Anchor::Cell(cell)) => {
                    let [mm, rad] = cell.camera();
                    config.reconstruction.of_poses(mm, rad)
                }
                _ => config.reconstruction.clone(),
            };
            agreement::agreeing(views, patches, &known)
        }
        Method::Paper => {
            Agreement::of_all(reconstruction::chain::register(views, patches, &config.reconstruction))
        }
    }
}
