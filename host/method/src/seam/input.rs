//! What the steps before the seams hand over: the raw scan, the thinned model of it, and what is looked for in it.

use super::surfaces::{Face, Surfaces, Waves};
use super::trace::support::TableEdge;
use crate::geometry::cloud::{Merged, Picture, PointCloud};
use crate::geometry::grid::Grid;
use crate::model::downsampling::Voxels;
use crate::model::reconstruction::Registration;
use nalgebra::{Isometry3, Point3, Vector3};

/// Edge of the cells in which the model is looked up, and radius of the neighbourhoods of edge scores, voxels. The paper
/// gives none; chosen on the simulated scans.
pub const INDEX_VOXELS: f32 = 4.0;

/// In what seams are sought, and which.
pub struct Input<'a> {
    /// All raw points.
    pub scan: RawScan<'a>,
    /// The model that was made of them.
    pub model: SurfaceModel<'a>,
    /// The work and all that stands round it, thinned, in which the table is recognised; the model's own where nothing was excluded.
    pub scene: &'a Voxels,
    /// What is looked for besides sharp inside corners.
    pub cues: Cues,
    surfaces: Surfaces,
}

impl<'a> Input<'a> {
    /// What is given; the faces of the model are sought when they are first asked for.
    pub fn new(scan: RawScan<'a>, model: SurfaceModel<'a>, scene: &'a Voxels, cues: Cues) -> Self {
        Self { scan, model, scene, cues, surfaces: Surfaces::default() }
    }

    /// What was sought of the model's surfaces.
    pub(crate) fn into_surfaces(self) -> Surfaces {
        self.surfaces
    }

    /// The flat faces of the model.
    pub(crate) fn faces(&self) -> &[Face] {
        self.surfaces.faces(&self.model)
    }

    /// How far they wave.
    pub(crate) fn waves(&self) -> Waves {
        self.surfaces.waves(&self.model)
    }
}

/// The registered views before anything was thinned or filtered.
#[derive(Clone)]
pub struct RawScan<'a> {
    /// All raw points of the work.
    pub merged: &'a Merged,
    /// The points that are excluded from the work.
    pub excluded: Option<&'a Merged>,
    /// Spatial index of the work's.
    pub index: &'a Grid,
    /// How sure the poses of the views are, if that is known.
    pub registration: Option<&'a Registration>,
    /// Names of the views, for messages.
    pub view_names: Vec<&'a str>,
    /// Where their pictures end, as far as that is known.
    pub pictures: Vec<Option<Picture>>,
    /// Whether every point was seen by a camera of known place.
    pub cameras_known: bool,
    /// Whether the table that the work stands on is in a cloud of unknown cameras.
    pub table_shown: bool,
}

impl RawScan<'_> {
    /// Whether the cloud is a scan of cameras whose whole view is kept, so that a table would be in it.
    pub(crate) fn has_whole_views(&self) -> bool {
        if self.cameras_known { self.view_names.len() > 1 } else { self.table_shown }
    }

    /// Whether it is what one camera saw from one place.
    pub(crate) fn is_one_view(&self) -> bool {
        self.cameras_known && self.view_names.len() == 1
    }

    /// Whether a table may show its edge.
    pub(crate) const fn table_edge(&self) -> TableEdge {
        if self.cameras_known { TableEdge::Seen } else { TableEdge::Hidden }
    }

    /// Whether cameras saw it from several places.
    pub(crate) fn is_seen_from_several(&self) -> bool {
        self.cameras_known && self.merged.cameras_mm.len() > 1
    }

    /// What a view saw, the excluded too; none where its pose is unknown.
    pub(crate) fn seen_by(&self, view: usize) -> Option<Seen> {
        let pose = self.registration?.base_from_camera.get(view)?;
        let place = pose.translation.vector - self.merged.origin_mm.coords;
        let all = [Some(self.merged), self.excluded].into_iter().flatten();
        let own: Vec<Point3<f32>> = all
            .flat_map(|cloud| cloud.points_mm.iter().zip(&cloud.view))
            .filter(|(_, of)| usize::from(**of) == view)
            .map(|(point, _)| *point)
            .collect();
        Some(Seen {
            points_mm: own.iter().step_by(own.len() / SAMPLE + 1).copied().collect(),
            cloud_from_camera: Isometry3::from_parts(place.cast::<f32>().into(), pose.rotation.cast()),
            picture: self.pictures.get(view).copied().flatten(),
        })
    }
}

/// What one view saw.
pub(crate) struct Seen {
    /// Some of its points, evenly, about the origin of the scan.
    pub(crate) points_mm: Vec<Point3<f32>>,
    /// Pose of its camera among them.
    pub(crate) cloud_from_camera: Isometry3<f32>,
    /// Where its picture ends.
    pub(crate) picture: Option<Picture>,
}

/// Points of a view that show where its surfaces end.
const SAMPLE: usize = 20_000;

/// The thinned, denoised cloud in which corners are sought.
#[derive(Clone, Copy)]
pub struct SurfaceModel<'a> {
    /// The thinned cloud, before the filter.
    pub voxels: &'a Voxels,
    /// The same after it, in the same order.
    pub cloud: &'a PointCloud,
    /// Spatial index of its points, in cells of [`INDEX_VOXELS`].
    pub index: &'a Grid,
    /// Of the neighbourhoods in it, by its slots: [`super::score::edges::asymmetries`] within [`INDEX_VOXELS`].
    pub asymmetries: &'a [Vector3<f32>],
}

impl SurfaceModel<'_> {
    /// Edge of a voxel, mm: the scale of all sizes that are given in voxels.
    pub fn voxel_mm(&self) -> f32 {
        self.voxels.edge_mm
    }

    /// The number of the point nearest to a place, within so many voxels.
    pub(crate) fn nearest(&self, place: &Point3<f32>, voxels: f32) -> Option<usize> {
        let (slot, _) = self.index.nearest(place, voxels * self.voxel_mm(), |_| true)?;
        Some(self.index.index(slot))
    }
}

/// What is looked for where sharp inside corners make no seam.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cues {
    /// Steps between parallel layers. In the smallest voxels the layers of a sparse cloud have holes, which pass for steps.
    pub steps: bool,
    /// Valleys whose faces blend into each other, traced loosely; what is found must then be the surer.
    pub blurred: bool,
}
