//! The one data type that flows through the pipeline: [`View`]s become a [`PointCloud`] and stay one until the seam.

use nalgebra::{Isometry3, Point3, Vector3};

/// What the camera saw from one pose.
#[derive(Debug, Clone)]
pub struct View {
    /// File it came from, for messages.
    pub name: String,
    /// Finite points, mm, in the view's own frame. With a known camera this is the camera's frame: the camera is at
    /// the origin. Without, it is the base frame shifted by `base_from_camera`, so that single precision suffices.
    pub points_mm: Vec<Point3<f32>>,
    /// One unit normal per point, out of the material, where the source knew them (a mesh); otherwise empty.
    pub normals: Vec<Vector3<f32>>,
    /// Pose of the view's frame as the robot reported it (eq. (1)), translation in mm.
    pub base_from_camera: Isometry3<f64>,
    /// Whether the camera stood at the origin of the view's frame. Not so for meshes and clouds of unknown origin.
    pub camera_known: bool,
}

/// Points with unit normals, in the base frame, relative to a local origin so that `f32` is enough anywhere.
#[derive(Debug, Clone, Default)]
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

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points_mm.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points_mm.is_empty()
    }
}
