//! The truth of a simulated scan: its seams, and which of their stations at least two views see.

use super::Request;
use super::camera::{Camera, RANGE_MM};
use super::placement::Placement;
use super::rotation::round_to;
use super::scene::Scene;
use super::workpiece::{TrueSeam, TrueStation, Workpiece};
use crate::evaluation::{Truth, TruthSeam};
use nalgebra::{Isometry3, Matrix4, Point3, Vector3};

/// A face counts as seen up to this angle from its normal, as cosine: what the scans given to the project hold.
const MIN_INCIDENCE: f64 = 0.30;
/// Where a face is probed: so far from the seam along it, so far out of it.
const PROBE_MM: [f64; 2] = [2.5, 0.02];
/// Views that must see a station.
const MIN_VIEWS: usize = 2;

pub(super) fn of(
    request: &Request,
    piece: &Workpiece,
    placed: &Placement,
    scene: &Scene,
    base_from_camera: &[Isometry3<f64>],
) -> Truth {
    let camera = Camera::with_size(request.width, request.height);
    let eyes = Eyes { camera, scene, base_from_camera };
    Truth {
        name: request.name(),
        kind: request.part.name().into(),
        pose: request.pose.name().into(),
        seed: request.seed,
        noise: request.noise.name().into(),
        cam: size_name([request.width, request.height]),
        anchor: "first".into(),
        params: piece.drawn.iter().map(|(name, value)| ((*name).into(), *value)).collect(),
        ztable: scene.table_mm(),
        true_cam: base_from_camera.iter().map(rows).collect(),
        seams: placed.seams(piece).iter().map(|seam| eyes.seam(seam)).collect(),
    }
}

/// How a truth names the size of the images.
pub(super) fn size_name([width, height]: [u32; 2]) -> String {
    match (width, height) {
        (640, 480) => "vga".into(),
        (1280, 720) => "hd".into(),
        _ => format!("{width}x{height}"),
    }
}

/// The matrix of a pose, row by row.
pub(super) fn rows(pose: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let m: Matrix4<f64> = pose.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)]))
}

struct Eyes<'a> {
    camera: Camera,
    scene: &'a Scene,
    base_from_camera: &'a [Isometry3<f64>],
}

impl TrueSeam {
    /// As a truth holds it.
    pub(super) fn written(&self, is_visible: impl Fn(&TrueStation) -> bool) -> TruthSeam {
        let each = |value: &dyn Fn(&TrueStation) -> Vector3<f64>| -> Vec<[f64; 3]> {
            self.stations.iter().map(|s| value(s).map(|x| round_to(x, 1e-6)).into()).collect()
        };
        TruthSeam {
            name: self.name.clone(),
            closed: self.closed,
            required: self.required,
            angle_deg: round_to(self.included_deg(), 1e-6),
            visible: self.stations.iter().map(|s| u8::from(is_visible(s))).collect(),
            p: each(&|s| s.apex.coords),
            n: each(&|s| s.torch()),
            t: each(&|s| s.tangent),
            normal_a: each(&|s| s.faces[0]),
            normal_b: each(&|s| s.faces[1]),
            p_root: each(&|s| s.root.coords),
        }
    }
}

impl Eyes<'_> {
    fn seam(&self, seam: &TrueSeam) -> TruthSeam {
        seam.written(|station| self.is_visible(station))
    }

    fn is_visible(&self, station: &TrueStation) -> bool {
        let [a, b] = station.faces;
        let seen = |pose: &&Isometry3<f64>| {
            self.sees(pose, station.apex, a, b) && self.sees(pose, station.apex, b, a)
        };
        self.base_from_camera.iter().filter(seen).count() >= MIN_VIEWS
    }

    /// Whether a view sees the face with normal `face` beside the seam; it leads away towards the `other` face's normal.
    fn sees(
        &self,
        pose: &Isometry3<f64>,
        apex: Point3<f64>,
        face: Vector3<f64>,
        other: Vector3<f64>,
    ) -> bool {
        let away = (other - face * other.dot(&face)).normalize();
        let probe = apex + away * PROBE_MM[0] + face * PROBE_MM[1];
        let eye = Point3::from(pose.translation.vector);
        let sight = (eye - probe).normalize();
        let in_camera = pose.inverse_transform_point(&probe);
        self.camera.project(&in_camera).is_some()
            && (RANGE_MM[0]..=RANGE_MM[1]).contains(&in_camera.z)
            && face.dot(&sight) >= MIN_INCIDENCE
            // From the camera: a place within a tack lies behind its surface.
            && self.scene.is_free(eye, probe)
    }
}
