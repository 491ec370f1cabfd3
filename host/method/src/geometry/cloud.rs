//! The one data type that flows through the pipeline: [`View`]s become a [`PointCloud`] and stay one until the seam.

use crate::geometry::mesh::Mesh;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What the camera saw from one pose.
#[derive(Debug, Clone)]
pub struct View {
    /// File it came from, for messages.
    pub name: String,
    /// Finite points, mm, in the view's own frame. With a known camera this is the camera's frame: the camera is at
    /// the origin. Without, it is the base frame shifted by `base_from_camera`, so that single precision suffices.
    pub points_mm: Vec<Point3<f32>>,
    /// One unit normal per point, where the source has them (a mesh, a file of a cloud without its camera); otherwise empty.
    pub normals: Vec<Vector3<f32>>,
    /// Pose of the view's frame as the robot reported it (eq. (1)), translation in mm.
    pub base_from_camera: Isometry3<f64>,
    /// Whether the camera stood at the origin of the view's frame. Not so for meshes and clouds of unknown origin.
    pub camera_known: bool,
    /// The mesh that the points were spread over, in the view's own frame.
    pub mesh: Option<Arc<Mesh>>,
    /// Where the picture ends that it came from, if it came from one.
    pub picture: Option<Picture>,
}

/// The part of the world that a camera's picture shows: the least and largest slopes x/z and y/z of its rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picture {
    /// Least.
    pub low: [f32; 2],
    /// Largest.
    pub high: [f32; 2],
}

impl View {
    /// Whether it is known which side of its surfaces is air: from the camera, or from facets. Normals in a file have to be
    /// checked first.
    pub fn tells_orientation(&self) -> bool {
        self.camera_known || self.mesh.is_some()
    }
}

/// Points with unit normals, in the base frame, relative to a local origin so that `f32` is enough anywhere.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct PointCloud {
    /// Origin of `points_mm` in the base frame, mm.
    pub origin_mm: Point3<f64>,
    /// Points relative to `origin_mm`, mm; axes of the base frame.
    pub points_mm: Vec<Point3<f32>>,
    /// One unit normal per point, facing the camera that saw it.
    pub normals: Vec<Vector3<f32>>,
}

impl PointCloud {
    /// Point `i` in the base frame, mm.
    pub fn in_base_mm(&self, i: usize) -> Point3<f64> {
        self.origin_mm + self.points_mm[i].coords.cast::<f64>()
    }

    /// The first `count` points stay; the others are given back.
    pub(crate) fn split_off(&mut self, count: usize) -> Self {
        let normals = self.normals.split_off(count.min(self.normals.len()));
        Self { origin_mm: self.origin_mm, points_mm: self.points_mm.split_off(count), normals }
    }

    /// Joins a cloud about the same origin.
    pub fn append(&mut self, mut other: Self) {
        self.points_mm.append(&mut other.points_mm);
        self.normals.append(&mut other.normals);
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points_mm.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points_mm.is_empty()
    }
}

/// All views in the base frame, raw: what the voxel grid thins and what the refinement of seams reads again.
#[derive(Debug, Clone, Default)]
pub struct Merged {
    /// Origin of every position here in the base frame, mm.
    pub origin_mm: Point3<f64>,
    /// Points relative to `origin_mm`, mm; axes of the base frame.
    pub points_mm: Vec<Point3<f32>>,
    /// Which view saw the point.
    pub view: Vec<u16>,
    /// Normals of a mesh or of a file; empty where the points came from a camera.
    pub normals: Vec<Vector3<f32>>,
    /// Whether these tell sides only, and not the exact direction, as those of a mesh do.
    pub normals_estimated: bool,
    /// Whether some view's camera is assumed, not known.
    pub cameras_unknown: bool,
    /// Position of each view's camera relative to `origin_mm`; where it is unknown, a place far above the points.
    pub cameras_mm: Vec<Point3<f32>>,
}

impl Merged {
    /// Puts views together at the given poses.
    pub fn new(views: &[View], base_from_camera: &[Isometry3<f64>]) -> Self {
        let origin_mm = centre_mm(views, base_from_camera);
        let mut merged = Self {
            origin_mm,
            normals_estimated: views.iter().any(|view| view.mesh.is_none()),
            cameras_unknown: views.iter().any(|view| !view.camera_known),
            ..Self::default()
        };
        for (k, (view, pose)) in views.iter().zip(base_from_camera).enumerate() {
            let turn: nalgebra::UnitQuaternion<f32> = pose.rotation.cast();
            let turn = turn.to_rotation_matrix();
            let shift: Vector3<f32> = (pose.translation.vector - origin_mm.coords).cast();
            merged.points_mm.par_extend(view.points_mm.par_iter().map(|p| turn * p + shift));
            merged.normals.par_extend(view.normals.par_iter().map(|n| turn * n));
            merged.view.resize(merged.points_mm.len(), k as u16);
            let above = Vector3::z() * FAR_ABOVE_MM;
            merged.cameras_mm.push(Point3::from(if view.camera_known { shift } else { shift + above }));
        }
        if merged.normals.len() != merged.points_mm.len() {
            merged.normals.clear();
        }
        merged
    }

    /// The points that stay and those that `leave`, each with all that is known of them, in their order.
    pub(crate) fn parted(&self, leave: &[bool]) -> [Self; 2] {
        [false, true].map(|leaving| {
            let chosen: Vec<usize> = (0..self.points_mm.len()).filter(|&k| leave[k] == leaving).collect();
            let normals = if self.normals.is_empty() { &[][..] } else { &chosen[..] };
            Self {
                points_mm: chosen.iter().map(|&k| self.points_mm[k]).collect(),
                view: chosen.iter().map(|&k| self.view[k]).collect(),
                normals: normals.iter().map(|&k| self.normals[k]).collect(),
                cameras_mm: self.cameras_mm.clone(),
                ..*self
            }
        })
    }

    /// Direction from point `k` to the camera that saw it, unit; `None` where the camera is assumed.
    pub fn toward_camera(&self, k: usize) -> Option<Vector3<f32>> {
        let camera = self.cameras_mm[usize::from(self.view[k])];
        (!self.cameras_unknown).then(|| (camera - self.points_mm[k]).normalize())
    }
}

/// Where a camera is assumed that nobody told us about.
const FAR_ABOVE_MM: f32 = 1e5;

/// Mean of an even sample of all points, mm, base frame.
fn centre_mm(views: &[View], base_from_camera: &[Isometry3<f64>]) -> Point3<f64> {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for (view, pose) in views.iter().zip(base_from_camera) {
        for p in view.points_mm.iter().step_by(101) {
            sum += (pose * p.cast::<f64>()).coords;
            count += 1.0;
        }
    }
    Point3::from(sum / f64::max(count, 1.0))
}
