//! Where the piece and the cameras are, and what the robot says about it. Millimetres, base frame.

use super::random::Stream;
use super::rotation::{UrPose, about, from_columns, round_to, sin_cos_deg};
use super::scene::Scene;
use super::workpiece::{TrueSeam, Viewpoint, Workpiece};
use super::{CellErrors, Noise, Pose, Request};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Height of the table's top.
pub(super) const TABLE_MM: f64 = 40.0;
/// Cameras stay this far above the table.
const CLEARANCE_MM: f64 = 80.0;
/// An upright piece is held this far above the table.
const HELD_MM: f64 = 55.0;

/// The piece and the cameras in the base frame.
pub(super) struct Placement {
    base_from_piece: Isometry3<f64>,
    /// True poses of the flange, as a robot controller would write them.
    flanges: Vec<UrPose>,
}

/// The hand-eye transform of all simulated scans, the one of the scans the project was given:
/// turned by -1.1, 0.4 and 0.3 degrees about x, y and z.
pub(super) fn flange_from_camera() -> Isometry3<f64> {
    let turn = about(Vector3::z(), 0.3) * about(Vector3::y(), -0.4) * about(Vector3::x(), 1.1);
    Isometry3::from_parts(Translation3::new(-10.3, -122.4, 74.8), turn)
}

/// How far the poses that the robot reports are off.
#[derive(Debug, Clone, Copy)]
pub(super) enum PoseErrors {
    /// Each view by so much, least and most; the first is exact.
    Scattered { shift_mm: [f64; 2], turn_deg: [f64; 2] },
    /// As a cell errs.
    Cell(CellErrors),
}

impl PoseErrors {
    /// Those of a cell, if given; otherwise these with a noisy camera, none with an exact one.
    pub(super) fn of(cell: Option<CellErrors>, noise: Noise, shift_mm: [f64; 2], turn_deg: [f64; 2]) -> Self {
        if let Some(cell) = cell {
            return Self::Cell(cell);
        }
        let exact = noise == Noise::None;
        let if_noisy = |range: [f64; 2]| if exact { [0.0; 2] } else { range };
        Self::Scattered { shift_mm: if_noisy(shift_mm), turn_deg: if_noisy(turn_deg) }
    }

    /// Which view has an exact pose, as a truth names it.
    pub(super) const fn anchor(&self) -> &'static str {
        match self {
            Self::Cell(CellErrors { first_exact: false, .. }) => "none",
            Self::Scattered { .. } | Self::Cell(_) => "first",
        }
    }

    /// What the camera's own errors follow from, where a cell names it.
    pub(super) fn cell_seed(&self) -> Option<u64> {
        match self {
            Self::Cell(cell) => cell.seed,
            Self::Scattered { .. } => None,
        }
    }

    /// What the robot reports of view `i`, truly at `base_from_camera`.
    pub(super) fn reported(&self, base_from_camera: &Isometry3<f64>, random: &Stream, i: usize) -> UrPose {
        match self {
            Self::Scattered { shift_mm, turn_deg } => {
                scattered([*shift_mm, *turn_deg], base_from_camera, random, i)
            }
            Self::Cell(cell) if i == 0 && cell.first_exact => {
                UrPose::reported(&(base_from_camera * flange_from_camera().inverse()))
            }
            Self::Cell(cell) => in_cell(cell, base_from_camera, random, i),
        }
    }
}

fn scattered(
    [shift_mm, turn_deg]: [[f64; 2]; 2],
    base_from_camera: &Isometry3<f64>,
    random: &Stream,
    i: usize,
) -> UrPose {
    let mut random = random.at(i as u64);
    let (shift, axis) = (random.direction(), random.direction());
    let mut drawn = |[low, high]: [f64; 2]| if i == 0 { 0.0 } else { random.between(low, high) };
    let (shift_mm, turn_deg) = (drawn(shift_mm), drawn(turn_deg));
    let moved = Isometry3::from_parts(
        Translation3::from(base_from_camera.translation.vector + shift * shift_mm),
        about(axis, turn_deg) * base_from_camera.rotation,
    );
    UrPose::reported(&(moved * flange_from_camera().inverse()))
}

/// Of the places of a stream that are those of views, none is this.
const HAND_EYE_PLACE: u64 = u64::MAX;

/// The camera sits on the flange otherwise than the hand-eye transform says, and the robot's own errors are normal.
fn in_cell(cell: &CellErrors, base_from_camera: &Isometry3<f64>, random: &Stream, i: usize) -> UrPose {
    let own = || random.at(HAND_EYE_PLACE);
    let mut of_all = cell.seed.map_or_else(own, |seed| Stream::new(seed, "hand-eye", 0));
    let (shift, axis) = (of_all.direction() * cell.hand_eye_mm, of_all.direction());
    let lacking = Isometry3::from_parts(Translation3::from(shift), about(axis, cell.hand_eye_deg));
    let base_from_flange = base_from_camera * (flange_from_camera() * lacking).inverse();
    let mut own = random.at(i as u64);
    let mut normal = || Vector3::new(own.gaussian(), own.gaussian(), own.gaussian());
    let (shift, turn) = (normal() * cell.robot_mm, normal() * cell.robot_deg);
    let turn = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| about(axis, turn.dot(&axis)));
    let rotation = turn[0] * turn[1] * turn[2] * base_from_flange.rotation;
    let shift = Translation3::from(base_from_flange.translation.vector + shift);
    UrPose::reported(&Isometry3::from_parts(shift, rotation))
}

impl Placement {
    pub(super) fn of(piece: &Workpiece, request: &Request) -> Self {
        let mut random = Stream::new(request.seed, request.part.name(), 1);
        let rotation = attitude(request.pose, &mut random);
        let aside = Vector3::new(random.between(-40.0, 40.0), -480.0 + random.between(-40.0, 40.0), 0.0);
        let cameras: Vec<Isometry3<f64>> =
            piece.views.take(request.views).iter().map(|v| piece_from_camera(v, &mut random)).collect();
        let lift = Vector3::z() * height(piece, &rotation, request.pose, &cameras);
        let base_from_piece = Isometry3::from_parts(Translation3::from(aside + lift), rotation);
        let camera_from_flange = flange_from_camera().inverse();
        let flange =
            |camera: &Isometry3<f64>| UrPose::reported(&(base_from_piece * camera * camera_from_flange));
        Self { base_from_piece, flanges: cameras.iter().map(flange).collect() }
    }

    /// Piece and table in the base frame.
    pub(super) fn scene(&self, piece: &Workpiece) -> Scene {
        let solids = piece.solids.iter().map(|solid| solid.moved(&self.base_from_piece)).collect();
        Scene::new(solids, TABLE_MM)
    }

    /// The piece's seams in the base frame.
    pub(super) fn seams(&self, piece: &Workpiece) -> Vec<TrueSeam> {
        piece.seams.iter().map(|seam| seam.moved(&self.base_from_piece)).collect()
    }

    pub(super) fn true_flanges(&self) -> &[UrPose] {
        &self.flanges
    }
}

/// How the piece is turned.
fn attitude(pose: Pose, random: &mut Stream) -> UnitQuaternion<f64> {
    let (x, z) = (Vector3::x(), Vector3::z());
    match pose {
        Pose::Flat => about(z, random.between(-180.0, 180.0)),
        Pose::Tilted => {
            about(z, random.between(-180.0, 180.0)) * about(x, 30.0) * about(z, random.between(-40.0, 40.0))
        }
        // Upright pieces lean back by 15 degrees and face away from the robot.
        Pose::Horizontal => about(z, random.between(-30.0, 30.0)) * about(x, 75.0),
        Pose::Vertical => about(z, random.between(-30.0, 30.0)) * about(x, 75.0) * about(z, 90.0),
    }
}

/// Height of the piece's origin at which it rests on the table, or is held so high that all cameras clear the table.
fn height(piece: &Workpiece, rotation: &UnitQuaternion<f64>, pose: Pose, cameras: &[Isometry3<f64>]) -> f64 {
    let level = |p: Point3<f64>| (rotation * p).z;
    let corners = piece.solids.iter().flat_map(|s| s.corners().iter().copied());
    let lowest = corners.map(level).fold(f64::INFINITY, f64::min);
    let lowest_camera =
        cameras.iter().map(|c| level(c.translation.vector.into())).fold(f64::INFINITY, f64::min);
    let above = match pose {
        Pose::Flat => 0.0,
        Pose::Tilted => 5.0,
        Pose::Horizontal | Pose::Vertical => HELD_MM,
    };
    round_to(TABLE_MM + (above - lowest).max(CLEARANCE_MM - lowest_camera), 1e-3)
}

/// A camera at the viewpoint, give or take what a hand gives or takes.
fn piece_from_camera(view: &Viewpoint, random: &mut Stream) -> Isometry3<f64> {
    let mut about_value = |value: f64, spread: f64| value + random.between(-spread, spread);
    let (sin_a, cos_a) = sin_cos_deg(about_value(view.azimuth_deg, 6.0));
    let (sin_e, cos_e) = sin_cos_deg(about_value(view.elevation_deg, 3.0));
    let distance = about_value(view.distance_mm, 20.0);
    let target = Vector3::new(
        about_value(view.target.x, 12.0),
        about_value(view.target.y, 12.0),
        about_value(view.target.z, 6.0),
    );
    let roll_deg = about_value(0.0, 5.0);
    let forward = -Vector3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
    aimed(target - forward * distance, forward, roll_deg)
}

/// A camera that looks along the unit vector `forward`, turned about it by `roll_deg` from upright.
pub(super) fn aimed(eye: Vector3<f64>, forward: Vector3<f64>, roll_deg: f64) -> Isometry3<f64> {
    // Down in the image is down in the world; looking straight down, the long side of the piece lies along the rows.
    let hint = if forward.z < -0.9 { -Vector3::y() } else { -Vector3::z() };
    let down = (hint - forward * hint.dot(&forward)).normalize();
    let rotation = from_columns(down.cross(&forward), down, forward) * about(Vector3::z(), roll_deg);
    Isometry3::from_parts(Translation3::from(eye), rotation)
}
