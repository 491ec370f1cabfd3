//! Parametric workpieces and a depth camera: a scan with exact truth, for anybody without a robot. Not in the paper.
//!
//! [`simulate`] places a piece on a table, looks at it from several places with a noisy camera on a robot whose
//! reported poses are slightly wrong, and returns what a real scan would hold, and the truth. [`Scene`] and
//! [`Camera`] do the same one view at a time. Millimetres, base frame. The same request gives the same bytes on every
//! machine: random numbers are integer hashes, and sines and rotations are plain arithmetic.

mod camera;
mod capture;
mod facet;
mod files;
mod mesh;
mod named;
mod noise;
mod placement;
mod random;
mod request;
mod rotation;
mod scene;
mod sensor;
mod solid;
mod truth;
mod workpiece;

pub use camera::{Camera, DepthImage, RANGE_MM};
pub use files::{files, write};
pub use mesh::{ListedWeld, MeshRequest, mesh_truth, simulate_mesh};
pub use noise::{Imaging, Noise};
pub use request::{CellErrors, Error, Format, Part, Pose, Request, Tacks};
pub use rotation::UrPose;
pub use scene::Scene;
pub use sensor::{REACH_MM, Sensor, SensorErrors};
pub use solid::Hit;

use crate::evaluation::Truth;
use nalgebra::Isometry3;
use workpiece::Workpiece;

/// A simulated scan.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// The camera of all views.
    pub camera: Camera,
    /// The hand-eye transform, mm.
    pub flange_from_camera: Isometry3<f64>,
    /// One per view; the first has an exact pose, unless a cell's errors were asked for.
    pub views: Vec<SimulatedView>,
    /// Seams and true camera poses.
    pub truth: Truth,
    /// How [`write()`] stores the views.
    pub format: Format,
}

/// One view of a simulated scan.
#[derive(Debug, Clone)]
pub struct SimulatedView {
    /// What the camera measured.
    pub image: DepthImage,
    /// The pose that the robot reports, of its flange.
    pub base_from_flange: UrPose,
}

/// A workpiece on its table, to be looked at from anywhere with [`Camera::capture`].
#[derive(Debug, Clone)]
pub struct Stage {
    /// What there is to see.
    pub scene: Scene,
    /// Where the cameras of a good scan stand.
    pub base_from_camera: Vec<Isometry3<f64>>,
    /// Seams; visibility is for the poses above.
    pub truth: Truth,
}

/// The workpiece of a request on its table, with good places for the camera and the truth, but no images.
pub fn stage(request: &Request) -> Result<Stage, Error> {
    let (piece, placed) = placed(request)?;
    let scene = placed.scene(&piece);
    let base_from_camera: Vec<Isometry3<f64>> = placed
        .true_flanges()
        .iter()
        .map(|flange| flange.isometry() * placement::flange_from_camera())
        .collect();
    let truth = truth::of(request, &piece, &placed, &scene, &base_from_camera);
    Ok(Stage { scene, base_from_camera, truth })
}

/// The workpiece of a request, or only what holds it, where the whole of it lies.
fn placed(request: &Request) -> Result<(Workpiece, placement::Placement), Error> {
    request.check()?;
    let piece = Workpiece::of(request);
    let placed = placement::Placement::of(&piece, request);
    Ok((if request.empty { piece.without_work() } else { piece }, placed))
}

/// A whole scan, as a robot with a camera on its flange would record it.
pub fn simulate(request: &Request) -> Result<Simulated, Error> {
    let Stage { scene, base_from_camera, truth } = stage(request)?;
    Ok(recorded(request, &scene, &base_from_camera, truth))
}

/// The scan that a camera moved by hand makes of a request's workpiece: views taken at these poses, with the truth for
/// them. The robot reports the poses with the errors of [`simulate`].
pub fn captured(request: &Request, base_from_camera: &[Isometry3<f64>]) -> Result<Simulated, Error> {
    let (piece, placed) = placed(request)?;
    let scene = placed.scene(&piece);
    let truth = truth::of(request, &piece, &placed, &scene, base_from_camera);
    Ok(recorded(request, &scene, base_from_camera, truth))
}

/// What the camera sees from these poses, and what the robot reports of them.
fn recorded(
    request: &Request,
    scene: &Scene,
    base_from_camera: &[Isometry3<f64>],
    truth: Truth,
) -> Simulated {
    let recording = Recording {
        name: request.part.name(),
        seed: request.seed,
        noise: request.noise,
        size_px: [request.width, request.height],
        poses: placement::PoseErrors::of(request.cell, request.noise, [1.0, 3.0], [0.3, 1.0]),
        sensor: request.sensor,
    };
    recording.of(scene, base_from_camera, truth, request.format)
}

/// What camera and robot add to what there is to see.
struct Recording<'a> {
    /// Of the piece: pieces with the same seed do not share their noise, so that errors over many pieces are independent.
    name: &'a str,
    seed: u64,
    noise: Noise,
    size_px: [u32; 2],
    poses: placement::PoseErrors,
    sensor: SensorErrors,
}

impl Recording<'_> {
    fn of(
        &self,
        scene: &Scene,
        base_from_camera: &[Isometry3<f64>],
        truth: Truth,
        format: Format,
    ) -> Simulated {
        let camera = Camera::with_size(self.size_px[0], self.size_px[1]);
        let taking = self.sensor.true_camera(&camera, self.poses.cell_seed().unwrap_or(self.seed));
        let imaging = Imaging { noise: self.noise, errors: self.sensor };
        let seed = random::Stream::new(self.seed, self.name, 2).next();
        let poses = random::Stream::new(self.seed, self.name, 3);
        let view = |(i, pose): (usize, &Isometry3<f64>)| SimulatedView {
            image: taking.capture(scene, pose, &imaging, seed, i as u64),
            base_from_flange: self.poses.reported(pose, &poses, i),
        };
        let views = base_from_camera.iter().enumerate().map(view).collect();
        let truth = Truth { anchor: self.poses.anchor().into(), ..truth };
        Simulated { camera, flange_from_camera: placement::flange_from_camera(), views, truth, format }
    }
}

#[cfg(test)]
mod tests;
