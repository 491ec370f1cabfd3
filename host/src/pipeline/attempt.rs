//! Seams sought in voxels of one size, and in larger ones until some show (ours; the paper has one size, typed by hand).

use super::{Clock, Config, Error, Method, Observer, no_seam};
use crate::geometry::cloud::{Merged, PointCloud, View};
use crate::geometry::grid::Grid;
use crate::geometry::mesh::Mesh;
use crate::model::downsampling;
use crate::model::downsampling::{Scale, Voxels};
use crate::model::reconstruction::Registration;
use crate::model::{denoising, orientation};
use crate::seam::score::edges;
use crate::seam::{self, Found, Input, Seam, Trial};
use nalgebra::Isometry3;

/// Registered views, in which seams are sought.
pub(super) struct Scan<'a> {
    pub views: &'a [View],
    pub merged: &'a Merged,
    /// Spatial index of its points.
    pub raw: &'a Grid,
    pub registration: &'a Registration,
    pub config: &'a Config,
}

impl Scan<'_> {
    pub(super) fn cameras_known(&self) -> bool {
        self.views.iter().all(|view| view.camera_known)
    }

    /// The mesh that is the scan, and its pose.
    fn mesh(&self) -> Option<(&Mesh, &Isometry3<f64>)> {
        let [view] = self.views else { return None };
        Some((view.mesh.as_deref()?, self.registration.base_from_camera.first()?))
    }

    /// Tries larger voxels than `first` until seams show; the attempt with clearly the most of them.
    pub(super) fn best_attempt(
        &self,
        first: &Scale,
        clock: &mut Clock,
        observer: &mut impl Observer,
    ) -> Result<Attempt, Error> {
        let coarser = coarser(first);
        let mut best =
            self.attempt(first, Trial { coarser: false, last: coarser.is_empty() }, clock, observer)?;
        let mut settled = self.settles(&best);
        for (k, scale) in coarser.iter().enumerate() {
            if settled {
                break;
            }
            let trial = Trial { coarser: true, last: k + 1 == coarser.len() };
            // Where larger voxels are too few, those before them have the last word.
            let Ok(attempt) = self.attempt(scale, trial, clock, observer) else { break };
            settled = self.settles(&attempt);
            if attempt.length_mm() > CLEARLY * best.length_mm() {
                best = attempt;
            }
        }
        Ok(best)
    }

    /// Seams in voxels of one size.
    fn attempt(
        &self,
        scale: &Scale,
        trial: Trial,
        clock: &mut Clock,
        observer: &mut impl Observer,
    ) -> Result<Attempt, Error> {
        observer.stage("downsampling");
        let mut voxels =
            clock.time("downsampling", || downsampling::voxel_grid(self.merged, scale.edge_mm, scale.least));
        if self.config.method != Method::Weldpath {
            voxels.fit_around_points(scale.bilateral().radius_mm);
        }
        observer.stage("denoising");
        let sides_unknown = !self.views.iter().all(View::tells_sides);
        // The filter moves points along their normals, whichever way these face: neither it nor what follows from places
        // alone need wait to be told.
        let turned = || sides_unknown.then(|| orientation::propagated(&voxels));
        let filtered = || {
            let model = denoising::bilateral(&voxels.cloud, &scale.bilateral());
            let reach_mm = seam::INDEX_VOXELS * voxels.edge_mm;
            let index = Grid::new(&model.points_mm, reach_mm);
            let asymmetries = edges::asymmetries(&index, reach_mm);
            (model, index, asymmetries)
        };
        let (turned, (mut model, index, asymmetries)) =
            clock.time("denoising", || rayon::join(turned, filtered));
        if let Some(normals) = turned {
            model.normals.clone_from(&normals);
            voxels.turn(normals);
        }
        observer.cloud("downsampling", &voxels.cloud);
        observer.cloud("denoising", &model);
        if model.len() < MIN_POINTS {
            let reason =
                format!("{} voxels are too few for two faces; at least {MIN_POINTS} are needed", model.len());
            return Err(no_seam(reason));
        }
        observer.stage("seam");
        let input = Input {
            merged: self.merged,
            raw: self.raw,
            voxels: &voxels,
            model: &model,
            index: &index,
            asymmetries: &asymmetries,
            registration: Some(self.registration),
            names: self.views.iter().map(|view| view.name.as_str()).collect(),
            cameras_known: self.cameras_known(),
            trial,
        };
        let found = clock.time("seam", || match self.config.method {
            Method::Weldpath => match self.mesh() {
                Some((mesh, pose)) => seam::find_in_mesh(&input, mesh, pose, &self.config.seam),
                None => seam::find(&input, &self.config.seam),
            },
            Method::Paper { ratio_threshold } => seam::score::paper::find(&input, ratio_threshold),
        });
        Ok(Attempt { scale: *scale, voxels, model, index, found })
    }

    /// Whether larger voxels have nothing to add. Views that show a whole scene without a seam at their own scale
    /// show none.
    fn settles(&self, attempt: &Attempt) -> bool {
        if self.config.method == Method::Weldpath && self.mesh().is_some() {
            return true;
        }
        if attempt.found.seams.is_empty() {
            self.views.len() > 1 && self.cameras_known()
        } else {
            self.config.method != Method::Weldpath || !attempt.is_weak()
        }
    }
}

/// What one size of voxels showed.
pub(super) struct Attempt {
    pub scale: Scale,
    pub voxels: Voxels,
    pub model: PointCloud,
    /// Spatial index of the model.
    pub index: Grid,
    pub found: Found,
}

impl Attempt {
    /// Of all its seams, mm.
    fn length_mm(&self) -> f64 {
        self.found.seams.iter().map(Seam::length_mm).sum()
    }

    /// Whether only scraps show, as of a blurred valley in voxels that are too small.
    fn is_weak(&self) -> bool {
        let longest_mm = self.found.seams.iter().map(Seam::length_mm).fold(0.0, f64::max);
        longest_mm < WEAK_VOXELS * f64::from(self.scale.edge_mm)
    }
}

/// Seams shorter than this, in voxels, ask for larger ones; those must show clearly more, by this factor.
const WEAK_VOXELS: f64 = 22.0;
const CLEARLY: f64 = 1.5;

/// The larger voxels that are tried until seams show: blurred or quantised clouds show theirs only in these.
fn coarser(first: &Scale) -> Vec<Scale> {
    let mut scales = vec![*first];
    let edges_mm = [COARSER * first.edge_mm, COARSEST_MM];
    for edge_mm in edges_mm.into_iter().filter(|edge| *edge <= COARSEST_MM) {
        if scales.last().is_some_and(|last| edge_mm > 1.1 * last.edge_mm) {
            scales.push(first.coarser(edge_mm / first.edge_mm));
        }
    }
    scales.split_off(1)
}

/// The smaller of them, in multiples of the first, and the largest, which still resolves thick plates, mm.
const COARSER: f32 = 1.8;
const COARSEST_MM: f32 = 3.0;
/// Fewer voxels than this cannot make two faces.
const MIN_POINTS: usize = 40;
