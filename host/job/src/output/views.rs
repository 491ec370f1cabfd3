//! `views.json`: where the camera stood at each view, as registered, for other programs. Schema: `docs/formats.md`.
//!
//! Poses are base_from_camera: the camera's z looks along its axis, its x to the right of the image. Millimetres, base frame.

use nalgebra::Isometry3;
use serde::Serialize;

use super::json::rounded;
use weldpath_method::pipeline::ViewReport;

/// Value of `version`; raised when a reader of the old one would misunderstand the new one.
pub const VERSION: u32 = 1;

#[derive(Serialize)]
struct Document<'a> {
    format: &'static str,
    version: u32,
    frame: &'static str,
    views: Vec<View<'a>>,
}

#[derive(Serialize)]
struct View<'a> {
    name: &'a str,
    used: bool,
    left_out: Option<&'a str>,
    position_mm: [f64; 3],
    base_from_camera_wxyz: [f64; 4],
    reported_position_mm: [f64; 3],
    reported_base_from_camera_wxyz: [f64; 4],
    correction_mm: Option<f64>,
    correction_deg: Option<f64>,
    uncertainty_mm: Option<f64>,
    uncertainty_deg: Option<f64>,
}

/// The file's text: all views that were read, those left out with the pose that was reported.
pub fn write(views: &[ViewReport]) -> String {
    let document = Document {
        format: "weldpath-views",
        version: VERSION,
        frame: "base",
        views: views.iter().map(view).collect(),
    };
    // Strings, numbers and lists only: there is nothing serde_json could refuse.
    serde_json::to_string_pretty(&document).map(|text| text + "\n").unwrap_or_default()
}

fn view(report: &ViewReport) -> View<'_> {
    let finite = |value: f64| value.is_finite().then_some(value);
    View {
        name: &report.name,
        used: report.left_out.is_none(),
        left_out: report.left_out.as_deref(),
        position_mm: position_mm(&report.base_from_camera),
        base_from_camera_wxyz: wxyz(&report.base_from_camera),
        reported_position_mm: position_mm(&report.reported),
        reported_base_from_camera_wxyz: wxyz(&report.reported),
        correction_mm: finite(report.moved_mm),
        correction_deg: finite(report.moved_deg),
        uncertainty_mm: finite(report.uncertainty_mm),
        uncertainty_deg: finite(report.uncertainty_deg),
    }
}

/// Position of a camera, to the nanometre.
pub(super) fn position_mm(pose: &Isometry3<f64>) -> [f64; 3] {
    let p = pose.translation.vector;
    [p.x, p.y, p.z].map(|v| rounded(v, 1e6))
}

/// Its orientation as a unit quaternion whose real part is not negative.
pub(super) fn wxyz(pose: &Isometry3<f64>) -> [f64; 4] {
    let q = pose.rotation;
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.w, q.i, q.j, q.k].map(|v| rounded(sign * v, 1e9))
}
