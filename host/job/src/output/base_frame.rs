//! `base_frame` of `summary.json`: what the views say of robot and camera, and how exact the program is in the base frame.
//! Millimetres, degrees; schema: `docs/formats.md`.

use serde::Serialize;

use super::views;
use weldpath_method::pipeline::{BaseFrame, CameraFinding, Plan};

/// The object; its numbers are null where nothing is known.
#[derive(Debug, Serialize)]
pub(super) struct BaseFrameSummary {
    error_mm: Option<f64>,
    error_deg: Option<f64>,
    robot: Option<Scatter>,
    hand_eye: Option<HandEye>,
    camera: Option<Camera>,
}

/// How the reported poses scatter.
#[derive(Debug, Serialize)]
struct Scatter {
    scatter_mm: f64,
    scatter_deg: f64,
    of_stated_mm: f64,
    of_stated_deg: f64,
}

/// What the camera's place on the flange lacks.
#[derive(Debug, Serialize)]
struct HandEye {
    applied: bool,
    shift_mm: f64,
    shift_sigma_mm: f64,
    loosest_mm: f64,
    turn_deg: f64,
    turn_sigma_deg: f64,
    loosest_deg: f64,
    camera_from_corrected_mm: [f64; 3],
    camera_from_corrected_wxyz: [f64; 4],
}

/// How far the camera is from what its intrinsics say.
#[derive(Debug, Serialize)]
struct Camera {
    applied: bool,
    focal: f64,
    focal_sigma: f64,
    centre: [f64; 2],
    centre_sigma: [f64; 2],
    k1: f64,
    k1_sigma: f64,
}

impl BaseFrameSummary {
    pub(super) fn new(plan: &Plan) -> Self {
        let worst = |errors: Vec<f64>| errors.into_iter().filter(|e| e.is_finite()).reduce(f64::max);
        Self {
            error_mm: worst(plan.seams.iter().map(|seam| seam.base_error_mm).collect()),
            error_deg: worst(plan.seams.iter().map(|seam| seam.base_error_deg).collect()),
            robot: plan.derived.base_frame.as_ref().map(scatter),
            hand_eye: plan.derived.base_frame.as_ref().map(hand_eye),
            camera: plan.derived.camera.as_ref().map(camera),
        }
    }
}

fn scatter(found: &BaseFrame) -> Scatter {
    Scatter {
        scatter_mm: found.robot_mm,
        scatter_deg: found.robot_deg,
        of_stated_mm: found.scale_mm,
        of_stated_deg: found.scale_deg,
    }
}

fn camera(found: &CameraFinding) -> Camera {
    let (errors, sigma) = (&found.errors, &found.sigma);
    Camera {
        applied: found.is_significant,
        focal: errors.focal,
        focal_sigma: sigma.focal,
        centre: errors.centre,
        centre_sigma: sigma.centre,
        k1: errors.k1,
        k1_sigma: sigma.k1,
    }
}

fn hand_eye(found: &BaseFrame) -> HandEye {
    let own = &found.hand_eye;
    HandEye {
        applied: own.is_applied,
        shift_mm: own.shift_mm,
        shift_sigma_mm: own.shift_sigma_mm,
        loosest_mm: own.loosest_mm,
        turn_deg: own.turn_deg,
        turn_sigma_deg: own.turn_sigma_deg,
        loosest_deg: own.loosest_deg,
        camera_from_corrected_mm: views::position_mm(&own.camera_from_corrected),
        camera_from_corrected_wxyz: views::wxyz(&own.camera_from_corrected),
    }
}
