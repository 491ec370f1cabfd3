//! Scans of any mesh: it lies on a table as it was modelled, z up, and is looked at from all round.
//!
//! The truth comes from a list of welds, or from the mesh's own inside corners. Millimetres.

mod corners;
mod faces;
mod welds;

pub use welds::ListedWeld;

use super::camera::{Camera, RANGE_MM};
use super::facet::Facet;
use super::placement::{PoseErrors, TABLE_MM, aimed, flange_from_camera};
use super::random::Stream;
use super::request::within;
use super::rotation::{UrPose, about, sin_cos_deg};
use super::scene::{Body, Scene};
use super::sensor::SensorErrors;
use super::workpiece::{TrueSeam, TrueStation};
use super::{CellErrors, Error, Format, Noise, Recording, Simulated, truth};
use crate::evaluation::Truth;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

/// A mesh to scan.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshRequest {
    /// Name of the scan.
    pub name: String,
    /// Corners of its triangles, mm; z is up.
    pub triangles: Vec<[Point3<f64>; 3]>,
    /// What is to be welded; the inside corners of the mesh if not given.
    pub welds: Option<Vec<ListedWeld>>,
    /// How many views.
    pub views: usize,
    /// How noisy the camera is.
    pub noise: Noise,
    /// Places and noise follow from it.
    pub seed: u64,
    /// Columns and rows of a depth image.
    pub size_px: [u32; 2],
    /// Distance of the cameras from the middle of the part; from its size if not given.
    pub distance_mm: Option<f64>,
    /// How views are stored.
    pub format: Format,
    /// How the cell errs; if not given, the first pose is exact and the others are off by 0.5 to 2 mm.
    pub cell: Option<CellErrors>,
    /// What the camera does wrong beside its noise.
    pub sensor: SensorErrors,
}

/// Usual distance of the cameras, as a share of the diagonal of the part's plan, and its bounds: a camera of 56 degrees
/// then sees the part and little besides, in the range in which depth cameras are good.
const DISTANCE_SHARE: f64 = 0.75;
const DISTANCE_MM: [f64; 2] = [300.0, 700.0];
/// Elevation of the cameras above the table.
const ELEVATION_DEG: [f64; 2] = [38.0, 52.0];
/// Errors of the reported poses.
const SHIFT_MM: [f64; 2] = [0.5, 2.0];
const TURN_DEG: [f64; 2] = [0.2, 0.6];
/// A weld is seen where a point this far off its root along the bisector is, within this angle of the bisector: the
/// reach of a torch's wire, and what leaves each face of a right angle at 18 degrees or more.
const PROBE_MM: f64 = 2.0;
const OFF_BISECTOR_DEG: f64 = 63.0;
/// Views that must see it.
const MIN_VIEWS: usize = 2;

/// A scan of a mesh, as a robot with a camera on its flange would record it.
pub fn simulate_mesh(request: &MeshRequest) -> Result<Simulated, Error> {
    request.check()?;
    let part: Vec<Facet> = request.triangles.iter().filter_map(|t| Facet::new(*t)).collect();
    let Some(bounds) = Bounds::of(&part) else { return Err(Error::EmptyMesh) };
    let mut random = Stream::new(request.seed, &request.name, 1);
    let base_from_part = placed(&bounds, &mut random);
    let cameras = request.cameras(&bounds, &base_from_part, &mut random);
    let resting = Scene::of(part.into_iter().map(Body::Facet).collect(), bounds.low.z);
    let seams = match &request.welds {
        Some(welds) => welds::seams(welds, &resting),
        None => corners::seams(&request.triangles, &resting),
    };
    let scene = resting.moved(&base_from_part, TABLE_MM);
    let seams: Vec<TrueSeam> = seams.iter().map(|seam| seam.moved(&base_from_part)).collect();
    let truth = request.truth(&scene, &seams, &cameras);
    let recording = Recording {
        name: &request.name,
        seed: request.seed,
        noise: request.noise,
        size_px: request.size_px,
        poses: PoseErrors::of(request.cell, request.noise, SHIFT_MM, TURN_DEG),
        sensor: request.sensor,
    };
    Ok(recording.of(&scene, &cameras, truth, request.format))
}

/// The truth of a mesh in its own frame: its welds, as if all were seen.
pub fn mesh_truth(triangles: &[[Point3<f64>; 3]], welds: &[ListedWeld]) -> Truth {
    let part = triangles.iter().filter_map(|t| Facet::new(*t)).map(Body::Facet).collect();
    let seams = welds::seams(welds, &Scene::of(part, 0.0));
    Truth {
        kind: "mesh".into(),
        seams: seams.iter().map(|s| s.written(|_| true)).collect(),
        ..Truth::default()
    }
}

/// Box of the part, in its own frame.
struct Bounds {
    low: Point3<f64>,
    high: Point3<f64>,
}

impl Bounds {
    fn of(part: &[Facet]) -> Option<Self> {
        let mut corners = part.iter().flat_map(|facet| facet.corners);
        let first = corners.next()?;
        let grown = |b: Self, p: Point3<f64>| Self { low: b.low.inf(&p), high: b.high.sup(&p) };
        Some(corners.fold(Self { low: first, high: first }, grown))
    }

    fn plan_diagonal_mm(&self) -> f64 {
        (self.high - self.low).xy().norm()
    }
}

/// On the table in front of the robot, turned by chance about the vertical.
fn placed(bounds: &Bounds, random: &mut Stream) -> Isometry3<f64> {
    let turn = about(Vector3::z(), random.between(-180.0, 180.0));
    let middle = nalgebra::center(&bounds.low, &bounds.high);
    let at = Vector3::new(random.between(-40.0, 40.0), random.between(-520.0, -440.0), TABLE_MM);
    let foot = turn * Vector3::new(middle.x, middle.y, bounds.low.z);
    Isometry3::from_parts(Translation3::from(at - foot), turn)
}

impl MeshRequest {
    fn check(&self) -> Result<(), Error> {
        within("views", self.views as f64, 1.0, 99.0)?;
        within("width", f64::from(self.size_px[0]), 16.0, 4096.0)?;
        within("height", f64::from(self.size_px[1]), 16.0, 4096.0)?;
        self.cell.map_or(Ok(()), |cell| cell.check())?;
        self.sensor.check()?;
        self.distance_mm.map_or(Ok(()), |mm| within("distance", mm, RANGE_MM[0], RANGE_MM[1]))
    }

    /// True poses of the camera: all round at equal steps, give or take what a hand gives or takes.
    fn cameras(
        &self,
        bounds: &Bounds,
        base_from_part: &Isometry3<f64>,
        random: &mut Stream,
    ) -> Vec<Isometry3<f64>> {
        let diagonal_mm = bounds.plan_diagonal_mm();
        let usual_mm = (DISTANCE_SHARE * diagonal_mm).clamp(DISTANCE_MM[0], DISTANCE_MM[1]);
        let distance_mm = self.distance_mm.unwrap_or(usual_mm);
        let middle = base_from_part * nalgebra::center(&bounds.low, &bounds.high);
        let step_deg = 360.0 / self.views as f64;
        let first_deg = random.between(-180.0, 180.0);
        let camera = |i: usize| {
            let (sin_a, cos_a) = sin_cos_deg(first_deg + step_deg * (i as f64 + random.between(-0.2, 0.2)));
            let (sin_e, cos_e) = sin_cos_deg(random.between(ELEVATION_DEG[0], ELEVATION_DEG[1]));
            let forward = -Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
            let aside = random.direction() * random.between(0.0, 0.03 * diagonal_mm);
            let away_mm = distance_mm * random.between(0.95, 1.05);
            let camera = aimed(middle.coords + aside - forward * away_mm, forward, random.between(-5.0, 5.0));
            // As the controller would write it.
            let camera_from_flange = flange_from_camera().inverse();
            UrPose::reported(&(camera * camera_from_flange)).isometry() * flange_from_camera()
        };
        (0..self.views).map(camera).collect()
    }

    fn truth(&self, scene: &Scene, seams: &[TrueSeam], cameras: &[Isometry3<f64>]) -> Truth {
        let camera = Camera::with_size(self.size_px[0], self.size_px[1]);
        let visible = |station: &TrueStation| is_visible(station, scene, &camera, cameras);
        Truth {
            name: format!("{}_{}_s{}", self.name, self.noise, self.seed),
            kind: "mesh".into(),
            pose: "flat".into(),
            seed: self.seed,
            noise: self.noise.name().into(),
            cam: truth::size_name(self.size_px),
            anchor: "first".into(),
            ztable: scene.table_mm(),
            true_cam: cameras.iter().map(truth::rows).collect(),
            seams: seams.iter().map(|seam| seam.written(visible)).collect(),
            ..Truth::default()
        }
    }
}

fn is_visible(station: &TrueStation, scene: &Scene, camera: &Camera, cameras: &[Isometry3<f64>]) -> bool {
    let torch = station.torch();
    let probe = station.apex + torch * PROBE_MM;
    let (_, least_cosine) = sin_cos_deg(OFF_BISECTOR_DEG);
    let sees = |pose: &&Isometry3<f64>| {
        let eye = Point3::from(pose.translation.vector);
        let in_camera = pose.inverse_transform_point(&probe);
        torch.dot(&(eye - probe).normalize()) >= least_cosine
            && camera.project(&in_camera).is_some()
            && (RANGE_MM[0]..=RANGE_MM[1]).contains(&in_camera.z)
            && scene.is_free(probe, eye)
    };
    cameras.iter().filter(sees).count() >= MIN_VIEWS
}

#[cfg(test)]
mod tests;
