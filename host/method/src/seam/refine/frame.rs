//! Stations of a seam that is being refined, and the axes of its cross-sections.

use crate::seam::Station;
use nalgebra::{Point3, Vector2, Vector3};

/// One station of a seam that is being refined; single precision about the cloud's origin.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// On the seam, mm.
    pub position: Point3<f32>,
    /// Unit tangent.
    pub tangent: Vector3<f32>,
    /// Unit normals of the faces, each normal to the tangent.
    pub faces: [Vector3<f32>; 2],
}

/// Shorter tangents and bisectors have no direction.
const LEAST_TANGENT: f32 = 1e-6;
/// A face whose normal is left with less than this across the tangent has none.
const LEAST_NORMAL: f32 = 1e-3;

impl Frame {
    /// Makes tangent and face normals unit and square to each other.
    pub fn new(position: Point3<f32>, tangent: Vector3<f32>, faces: [Vector3<f32>; 2]) -> Option<Self> {
        Self::about(position, tangent.try_normalize(LEAST_TANGENT)?, faces)
    }

    /// The same about a unit tangent.
    pub(super) fn about(
        position: Point3<f32>,
        tangent: Vector3<f32>,
        faces: [Vector3<f32>; 2],
    ) -> Option<Self> {
        let square = |n: Vector3<f32>| (n - tangent * n.dot(&tangent)).try_normalize(LEAST_NORMAL);
        Some(Self { position, tangent, faces: [square(faces[0])?, square(faces[1])?] })
    }

    /// A station in a cloud about this origin.
    pub fn of(station: &Station, origin_mm: &Point3<f64>) -> Self {
        Self {
            position: station.about(origin_mm),
            tangent: station.tangent.cast(),
            faces: station.faces.map(|face| face.cast()),
        }
    }

    /// The same place, seen by a weld that runs the other way.
    pub fn reversed(&self) -> Self {
        Self { tangent: -self.tangent, ..*self }
    }

    /// In-face direction from the seam into each face.
    pub(crate) fn faces_inward(&self) -> [Vector3<f32>; 2] {
        [0, 1].map(|k| {
            let along = self.tangent.cross(&self.faces[k]);
            if along.dot(&self.faces[1 - k]) < 0.0 { -along } else { along }
        })
    }

    /// Bisector of the faces, out of the work.
    pub fn bisector(&self) -> Vector3<f32> {
        (self.faces[0] + self.faces[1]).try_normalize(LEAST_TANGENT).unwrap_or(self.faces[0])
    }

    /// Axes of the cross-section: `o = m × n`, `n`.
    pub(super) fn cross_section(&self) -> CrossAxes {
        let n = self.bisector();
        CrossAxes { o: self.tangent.cross(&n), n }
    }

    /// Position at a share of the way from one frame to another.
    pub(super) fn mixed_position(a: &Self, b: &Self, share: f32) -> Point3<f32> {
        a.position + (b.position - a.position) * share
    }

    /// Unit tangent there.
    pub(super) fn mixed_tangent(a: &Self, b: &Self, share: f32) -> Option<Vector3<f32>> {
        blend(&a.tangent, &b.tangent, share).try_normalize(LEAST_TANGENT)
    }

    /// Normals of the faces there, not yet made square.
    pub(super) fn mixed_faces(a: &Self, b: &Self, share: f32) -> [Vector3<f32>; 2] {
        [0, 1].map(|k| blend(&a.faces[k], &b.faces[k], share))
    }
}

fn blend(a: &Vector3<f32>, b: &Vector3<f32>, share: f32) -> Vector3<f32> {
    a * (1.0 - share) + b * share
}

/// Unit axes of the cross-section of a seam: across the bisector of the faces, and along it out of the work.
#[derive(Debug, Clone, Copy)]
pub(super) struct CrossAxes {
    pub(super) o: Vector3<f32>,
    pub(super) n: Vector3<f32>,
}

impl CrossAxes {
    /// Components in the cross-section.
    pub(super) fn flat(&self, v: &Vector3<f32>) -> Vector2<f64> {
        Vector2::new(f64::from(v.dot(&self.o)), f64::from(v.dot(&self.n)))
    }

    /// The vector with these components.
    pub(super) fn lifted(&self, v: &Vector2<f64>) -> Vector3<f64> {
        (self.o * v.x as f32 + self.n * v.y as f32).cast::<f64>()
    }
}
