//! Points, depth images and poses that a caller holds in memory. They are read by the code that reads them from files, so that
//! the same data give the same scan.

use std::path::{Path, PathBuf};

use nalgebra::{Point3, Vector3};
use serde::Serialize;
use serde_json::Value;

use super::camera::{Camera, Intrinsics, Rays};
use super::manifest::{Entry, Held, Manifest};
use super::raw::{FARTHEST, Positions, Raw};
use super::{Error, Options, Scan, depth, manifest, single, whole};

/// Coordinates in the precision that the caller has.
#[derive(Debug, Clone)]
pub enum Coordinates {
    /// Single precision.
    Single(Vec<[f32; 3]>),
    /// Double precision.
    Double(Vec<[f64; 3]>),
}

/// A cloud or a mesh as a file would hold it: any unit, any frame, nothing dropped yet.
///
/// The points of an organised cloud come row by row, those without a reading as NaN or (0, 0, 0).
#[derive(Debug, Clone)]
pub struct RawCloud(Raw);

impl RawCloud {
    /// Points alone.
    pub fn new(coordinates: Coordinates) -> Self {
        Self(Raw::from(match coordinates {
            Coordinates::Single(points) => Positions::Single(points.into_iter().map(Point3::from).collect()),
            Coordinates::Double(points) => Positions::Double(points.into_iter().map(Point3::from).collect()),
        }))
    }

    /// With a normal for each point, of any length.
    ///
    /// # Errors
    /// If there are more or fewer normals than points.
    pub fn with_normals(mut self, normals: Vec<[f32; 3]>) -> Result<Self, Error> {
        let (points, count) = (self.0.positions.len(), normals.len());
        if points != count {
            let problem = format!("{count} normals for {points} points");
            return Err(Error::malformed(Path::new("normals"), "shape", problem, "Give one for each point"));
        }
        self.0.normals = normals.into_iter().map(Vector3::from).collect();
        Ok(self)
    }

    /// With the triangles of a mesh, each by the indices of its corners.
    ///
    /// # Errors
    /// If one of them names a point that there is not.
    pub fn with_triangles(mut self, triangles: Vec<[usize; 3]>) -> Result<Self, Error> {
        let points = self.0.positions.len();
        if let Some(k) = triangles.iter().position(|corners| corners.iter().any(|corner| *corner >= points)) {
            let problem = format!("{:?} of {points} points", triangles[k]);
            let help = "Indices of corners are counted from 0";
            return Err(Error::malformed(Path::new("triangles"), format!("row {k}"), problem, help));
        }
        self.0.triangles = triangles;
        Ok(self)
    }

    /// The scan that a file with this content is; `name` stands for the file in messages.
    ///
    /// # Errors
    /// As [`read`](super::read).
    ///
    /// ```
    /// use weldpath_method::input::{Coordinates, Options, RawCloud, Units};
    ///
    /// let points = Coordinates::Single(vec![[0.10, 0.0, 0.0], [0.11, 0.0, f32::NAN], [0.12, 0.0, 0.0]]);
    /// let options = Options { units: Units::Metres, ..Options::default() };
    /// let scan = RawCloud::new(points).read("part", &options)?;
    /// assert_eq!(scan.views[0].points_mm.len(), 2);
    /// # Ok::<(), weldpath_method::input::Error>(())
    /// ```
    pub fn read(self, name: &str, options: &Options) -> Result<Scan, Error> {
        let path = Path::new(name);
        whole(single(self.0, path, options)?, path, options)
    }
}

/// A rigid transform; lengths are in the unit of the scan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Transform {
    /// 4 x 4, row by row.
    Matrix([[f64; 4]; 4]),
    /// x, y, z and a rotation vector in rad, as UR controllers show a pose.
    Vector([f64; 6]),
}

impl Transform {
    fn value(&self) -> Value {
        // Numbers that JSON has no words for become null, which the reader refuses with their place.
        serde_json::to_value(self).unwrap_or_default()
    }
}

/// Where the camera stood for a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraPose {
    /// The camera's own pose: x right, y down, z forward.
    BaseFromCamera(Transform),
    /// Its inverse, such as Open3D's `extrinsic`.
    CameraFromBase(Transform),
    /// The flange's, with [`PosedViews::flange_from_camera`].
    BaseFromFlange(Transform),
    /// Its inverse.
    FlangeFromBase(Transform),
    /// The tool's, with [`PosedViews::flange_from_tcp`] as well.
    BaseFromTcp(Transform),
}

/// What a camera saw from one pose: a depth image or a cloud in the camera's frame (x right, y down, z forward).
#[derive(Debug, Clone)]
pub struct RawView {
    name: Option<String>,
    held: Held,
    pose: Option<CameraPose>,
}

/// Steps that a depth image in metres may have been made from, m.
const STEPS_M: [f64; 6] = [1e-3, 5e-4, 2.5e-4, 1.25e-4, 1e-4, 5e-5];
/// How near to a whole number of steps all its depths are then, steps: single precision leaves 0.02 of the finest at 10 m.
const ON_STEP: f64 = 0.05;

/// Farther away no depth camera sees, m.
const FARTHEST_SEEN_M: f32 = 100.0;

impl RawView {
    /// A depth image in counts, row by row; 0 and 65535 are no readings.
    ///
    /// # Errors
    /// If it has another size than it says, or no camera has such intrinsics.
    pub fn of_depth(
        counts: Vec<u16>,
        size_px: [u32; 2],
        intrinsics: &Intrinsics,
        depth_scale_m: f64,
    ) -> Result<Self, Error> {
        let rays = rays(counts.len(), size_px, intrinsics, depth_scale_m)?;
        let points_mm = depth::points_of(&counts, &rays);
        Ok(Self { name: None, held: Held::Depth { points_mm, rays }, pose: None })
    }

    /// A depth image in metres, row by row; what is not finite and above 0 is no reading. Depths that are all multiples of one of
    /// a camera's usual steps are taken as its counts.
    ///
    /// # Errors
    /// As [`RawView::of_depth`].
    pub fn of_depth_m(depth_m: &[f32], size_px: [u32; 2], intrinsics: &Intrinsics) -> Result<Self, Error> {
        let rays = rays(depth_m.len(), size_px, intrinsics, STEPS_M[0])?;
        let mut seen: Vec<f32> = depth_m.iter().copied().filter(|z| *z > 0.0).collect();
        seen.sort_unstable_by(f32::total_cmp);
        if let Some(median) = seen.get(seen.len() / 2).filter(|median| **median > FARTHEST_SEEN_M) {
            let problem = format!("metres are expected, and half of the depths are over {median:.0}");
            let help = "Divide by 1000 if they are millimetres";
            return Err(Error::malformed(Path::new("depth"), "values", problem, help));
        }
        if let Some((counts, step_m)) = STEPS_M.iter().find_map(|step| Some((counts(depth_m, *step)?, *step)))
        {
            return Self::of_depth(counts, size_px, intrinsics, step_m);
        }
        let width = size_px[0].max(1) as usize;
        let point = |(at, &z): (usize, &f32)| {
            let [x, y] = rays.slopes().at(at % width, at / width);
            Point3::new(x * z, y * z, z) * 1000.0
        };
        let seen = depth_m.iter().enumerate().filter(|(_, z)| **z > 0.0);
        // Too far for any camera, or on a ray that the lens does not have.
        let usable = |p: &Point3<f32>| p.iter().all(|c| c.abs() <= FARTHEST as f32);
        let points_mm = seen.map(point).filter(usable).collect();
        Ok(Self { name: None, held: Held::Depth { points_mm, rays }, pose: None })
    }

    /// A cloud with the camera at its origin, in the unit of the scan.
    pub fn of_cloud(RawCloud(raw): RawCloud) -> Self {
        Self { name: None, held: Held::Cloud(raw), pose: None }
    }

    /// With the camera's pose.
    #[must_use]
    pub fn posed(self, pose: CameraPose) -> Self {
        Self { pose: Some(pose), ..self }
    }

    /// With a name for messages, in place of `view 0` and so on.
    #[must_use]
    pub fn named(self, name: impl Into<String>) -> Self {
        Self { name: Some(name.into()), ..self }
    }
}

fn rays(
    pixels: usize,
    size_px: [u32; 2],
    intrinsics: &Intrinsics,
    depth_scale_m: f64,
) -> Result<Rays, Error> {
    let path = Path::new("depth");
    let [width, height] = size_px;
    if u64::from(width) * u64::from(height) != pixels as u64 {
        let problem = format!("{pixels} pixels are not {width} x {height}");
        return Err(Error::malformed(path, "shape", problem, "Give an array of height x width"));
    }
    let camera = Camera::new(size_px, intrinsics, depth_scale_m);
    match camera.fault() {
        Some((field @ "depth_scale_m", problem)) => {
            Err(Error::malformed(path, field, problem, "Give the metres in one count, often 0.001"))
        }
        Some((field, problem)) => {
            Err(Error::malformed(path, field, problem, "Give the intrinsics of the depth stream, in pixels"))
        }
        None => Ok(Rays::new(camera)),
    }
}

/// The depths as multiples of a step, if all of them are.
fn counts(depth_m: &[f32], step_m: f64) -> Option<Vec<u16>> {
    let count = |z: &f32| {
        let steps = f64::from(*z) / step_m;
        match z.is_finite() && *z > 0.0 {
            false => Some(0),
            true if (steps - steps.round()).abs() > ON_STEP || steps.round() >= f64::from(u16::MAX) => None,
            true => Some(steps.round() as u16),
        }
    };
    depth_m.iter().map(count).collect()
}

/// Views with what they share.
#[derive(Debug, Clone, Default)]
pub struct PosedViews {
    /// One for each place of the camera.
    pub views: Vec<RawView>,
    /// Hand-eye transform, for poses of the flange or the tool.
    pub flange_from_camera: Option<Transform>,
    /// What the controller's TCP is set to, for poses of the tool.
    pub flange_from_tcp: Option<Transform>,
}

/// What stands for the file in messages about views in memory.
const NAME: &str = "views";

impl PosedViews {
    /// The scan that a `scan.json` with these views is. A single view without a pose is a scan in its camera's frame.
    ///
    /// # Errors
    /// As [`read`](super::read).
    pub fn read(self, options: &Options) -> Result<Scan, Error> {
        let path = Path::new(NAME);
        let Self { mut views, flange_from_camera, flange_from_tcp } = self;
        if views.is_empty() {
            return Err(Error::empty(path, "the list of views is empty"));
        }
        if let [RawView { pose: None, .. }] = views[..] {
            let RawView { name, held, .. } = views.remove(0);
            let name = name.unwrap_or_else(|| "view".into());
            return match held {
                Held::Depth { points_mm, rays } => {
                    let path = Path::new(&name);
                    whole(depth::single(points_mm, &rays, path)?, path, options)
                }
                Held::Cloud(raw) => RawCloud(raw).read(&name, options),
            };
        }
        let mut manifest = Manifest {
            flange_from_camera: flange_from_camera.map(|transform| transform.value()),
            flange_from_tcp: flange_from_tcp.map(|transform| transform.value()),
            ..Manifest::default()
        };
        for (k, RawView { name, held, pose }) in views.into_iter().enumerate() {
            let file = Some(PathBuf::from(name.unwrap_or_else(|| format!("view {k}"))));
            let entry = match &held {
                Held::Depth { rays, .. } => {
                    // What is tried of the depth's unit is tried for all images alike.
                    manifest.camera.get_or_insert(rays.camera);
                    Entry { depth: file, ..Entry::default() }
                }
                Held::Cloud(_) => Entry { cloud: file, ..Entry::default() },
            };
            manifest.views.push(match pose {
                None => entry,
                Some(CameraPose::BaseFromCamera(t)) => Entry { base_from_camera: Some(t.value()), ..entry },
                Some(CameraPose::CameraFromBase(t)) => Entry { camera_from_base: Some(t.value()), ..entry },
                Some(CameraPose::BaseFromFlange(t)) => Entry { base_from_flange: Some(t.value()), ..entry },
                Some(CameraPose::FlangeFromBase(t)) => Entry { flange_from_base: Some(t.value()), ..entry },
                Some(CameraPose::BaseFromTcp(t)) => Entry { base_from_tcp: Some(t.value()), ..entry },
            });
            manifest.held.push(held);
        }
        whole(manifest::views(&manifest, path, options)?, path, options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two walls that meet, in the camera's frame at half a metre; mm.
    fn corner() -> (Vec<f32>, Intrinsics) {
        let intrinsics: Intrinsics = "60,60,32,24".parse().expect("intrinsics");
        let depth = |k: usize| 0.5 + 0.003 * ((k % 64) as f32 - 32.0).abs();
        ((0..64 * 48).map(depth).collect(), intrinsics)
    }

    const FROM_ABOVE: [[f64; 4]; 4] =
        [[1.0, 0.0, 0.0, 0.4], [0.0, -1.0, 0.0, 0.1], [0.0, 0.0, -1.0, 0.7], [0.0, 0.0, 0.0, 1.0]];

    #[test]
    fn depths_in_metres_are_the_counts_that_they_were_made_from() {
        let (depth_m, intrinsics) = corner();
        let by_metres = RawView::of_depth_m(&depth_m, [64, 48], &intrinsics).expect("a view");
        let counts = depth_m.iter().map(|z| (z * 1000.0).round() as u16).collect();
        let by_counts = RawView::of_depth(counts, [64, 48], &intrinsics, 0.001).expect("a view");
        let points = |view| {
            let scan = PosedViews { views: vec![view], ..PosedViews::default() }.read(&Options::default());
            scan.expect("a scan").views[0].points_mm.clone()
        };
        assert_eq!(points(by_metres), points(by_counts));
        // Others stay as they are, and keep the bounds of their picture.
        let odd: Vec<f32> = depth_m.iter().map(|z| z * 1.000_37).collect();
        let view = RawView::of_depth_m(&odd, [64, 48], &intrinsics).expect("a view");
        let scan = PosedViews { views: vec![view], ..PosedViews::default() }
            .read(&Options::default())
            .expect("a scan");
        assert!((scan.views[0].points_mm[0].z - 1000.0 * odd[0]).abs() < 1e-3);
        assert!(scan.views[0].picture.is_some());
    }

    #[test]
    fn an_extrinsic_is_a_camera_from_base() {
        let (depth_m, intrinsics) = corner();
        let view = RawView::of_depth_m(&depth_m, [64, 48], &intrinsics).expect("a view");
        let inverse =
            [[1.0, 0.0, 0.0, -0.4], [0.0, -1.0, 0.0, 0.1], [0.0, 0.0, -1.0, 0.7], [0.0, 0.0, 0.0, 1.0]];
        let read = |pose| {
            let views = vec![view.clone().posed(pose)];
            let options = Options { units: super::super::Units::Metres, ..Options::default() };
            PosedViews { views, ..PosedViews::default() }.read(&options).expect("a scan").views[0]
                .base_from_camera
        };
        let given = read(CameraPose::BaseFromCamera(Transform::Matrix(FROM_ABOVE)));
        let turned = read(CameraPose::CameraFromBase(Transform::Matrix(inverse)));
        assert!((given.translation.vector - turned.translation.vector).norm() < 1e-9);
        assert!(given.rotation.angle_to(&turned.rotation) < 1e-9);
    }

    #[test]
    fn what_no_camera_could_have_seen_is_named() {
        let (depth_m, intrinsics) = corner();
        let refused = |result: Result<RawView, Error>, part: &str| {
            let error = result.expect_err(part).to_string();
            assert!(error.contains(part), "{error}");
        };
        refused(RawView::of_depth_m(&depth_m, [64, 47], &intrinsics), "3072 pixels are not 64 x 47");
        refused(RawView::of_depth(vec![1; 4], [2, 2], &intrinsics, 0.0), "depth_scale_m");
        let view = RawView::of_depth_m(&depth_m, [64, 48], &intrinsics).expect("a view");
        let read = |views| PosedViews { views, ..PosedViews::default() }.read(&Options::default());
        let error = |views| read(views).expect_err("refused").to_string();
        assert!(error(vec![view.clone(), view.clone()]).contains("views[0].base_from_flange"));
        assert!(error(Vec::new()).contains("the list of views is empty"));
        let flange = CameraPose::BaseFromFlange(Transform::Vector([0.4, 0.0, 0.5, 0.0, 3.0, 0.0]));
        assert!(error(vec![view.clone().posed(flange)]).contains("flange_from_camera: it is missing"));
        for numbers in [[f64::NAN; 6], [400.0; 6]] {
            let pose = CameraPose::BaseFromCamera(Transform::Vector(numbers));
            assert!(error(vec![view.clone().posed(pose)]).contains("views[0].base_from_camera"));
        }
        let cloud = || RawCloud::new(Coordinates::Double(vec![[0.0; 3]; 4]));
        assert!(cloud().with_normals(vec![[0.0; 3]; 3]).is_err_and(|e| e.to_string().contains("3 normals")));
        assert!(cloud().with_triangles(vec![[0, 1, 4]]).is_err_and(|e| e.to_string().contains("row 0")));
        assert!(matches!(cloud().read("a", &Options::default()), Err(Error::Empty { .. })));
    }
}
