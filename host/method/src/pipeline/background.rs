//! What was there before the work (ours): the empty cell or the fixture, scanned as the work is.
//!
//! The background is registered by itself, as a scan is, and laid over the scan by what both show: the reported poses of either
//! are exact to millimetres only. A point of the scan is of the background if it is no farther from its surface than the two
//! scans of one surface are apart, which is measured on them. It is looked at in voxels first, whose means hardly scatter, so
//! that a sheet on the table is told from the table, and then by itself. Millimetres, base frame.

use super::config::{MergeConfig, Method};
use super::merged::MergedViews;
use super::reconstruction::Reconstruction;
use super::result::{Parameter, PlanError};
use super::stages::Stages;
use crate::geometry::cloud::{Merged, PointCloud, View};
use crate::geometry::grid::Grid;
use crate::model::downsampling::{Occupancy, Scale, voxel_grid};
use crate::model::reconstruction::pair::{PairConfig, align};
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

/// Points of both scans are paired up to this far, mm, coarse to fine: poses and hand-eye transforms of two scans differ by a few
/// millimetres. Not finer than this many deviations of the noise, since pairs would then be chosen by it.
const GATES_MM: [f32; 3] = [6.0, 2.5, 1.25];
const GATE_NOISES: f32 = 3.0;
/// Deviations within which nearly all of a normal scatter lies.
const DEVIATIONS: f32 = 3.0;
/// Least tolerance, voxels: where a surface bends the means of two grids differ by some part of a voxel.
const LEAST_VOXELS: f32 = 0.1;
/// How far from a place its surface is known by a voxel's plane, voxels: the next voxels but no more, so that a face is not
/// continued beyond its edge.
const REACH_VOXELS: f32 = 2.0;
/// A point takes part in what its own voxel and the next are, voxels.
const NEXT_VOXELS: f32 = 1.5;

/// The surface that was there before, laid over the scan.
pub(super) struct Background {
    /// Relative to the scan's origin.
    points: Grid,
    /// By slot.
    normals: Vec<Vector3<f32>>,
    origin_mm: Point3<f64>,
    reach_mm: f32,
    /// How far means of both scans are apart at most on one surface.
    half_mm: f32,
}

impl Background {
    /// Of these views, over a scan in voxels of this size.
    ///
    /// # Errors
    /// As of a scan that cannot be put together.
    pub(super) fn new(
        views: &[View],
        scan: &MergedViews,
        method: Method,
        config: &MergeConfig,
    ) -> Result<Self, PlanError> {
        let MergedViews { cloud: scan, scale, .. } = scan;
        let Reconstruction { views, agreement, .. } =
            Reconstruction::new(views, method, config, &mut Stages::new(&mut ()))?;
        let views = agreement.of(&views);
        let merged = Merged::new(&views, &agreement.registration.base_from_camera);
        let mut cloud = voxel_grid(&merged, scale.edge_mm, scale.occupancy()).cloud;
        let seen = voxel_grid(scan, scale.edge_mm, scale.occupancy()).cloud;
        let mut apart_mm = 0.0;
        if !cloud.is_empty() && !seen.is_empty() {
            let finest_mm = GATE_NOISES * scale.noise_mm;
            let gates_mm = GATES_MM.map(|gate_mm| gate_mm.max(finest_mm)).to_vec();
            let pairs = PairConfig { gates_mm, ..PairConfig::default() };
            let laid = align(&cloud, &seen, &Isometry3::identity(), &pairs);
            apart_mm = laid.rms_mm as f32;
            cloud = moved(&cloud, &laid.target_from_source);
        }
        let shift: Vector3<f32> = (cloud.origin_mm - scan.origin_mm).cast();
        cloud.points_mm.iter_mut().for_each(|p| *p += shift);
        let reach_mm = REACH_VOXELS * scale.edge_mm;
        let points = Grid::new(&cloud.points_mm, reach_mm);
        let normals = points.by_slot(&cloud.normals);
        let half_mm = (DEVIATIONS * apart_mm).max(LEAST_VOXELS * scale.edge_mm);
        Ok(Self { points, normals, origin_mm: scan.origin_mm, reach_mm, half_mm })
    }

    /// How far a place relative to the scan's origin is from the surface, along its normal; none where no surface is known.
    fn height_mm(&self, p: &Point3<f32>) -> Option<f32> {
        let mut least: Option<f32> = None;
        self.points.within(p, self.reach_mm, |slot, _| {
            let height_mm = self.normals[slot].dot(&(p - self.points.point(slot))).abs();
            least = Some(least.map_or(height_mm, |least| least.min(height_mm)));
        });
        least
    }

    /// Whether a place of the base frame is on the surface.
    pub(super) fn holds(&self, place_mm: &Point3<f64>) -> bool {
        let p = Point3::from((place_mm - self.origin_mm).cast::<f32>());
        self.height_mm(&p).is_some_and(|height_mm| height_mm <= self.half_mm)
    }

    /// Marks the points of the scan that are on the surface.
    pub(super) fn mark(&self, scan: &Merged, scale: &Scale, leave: &mut [bool]) {
        let means = voxel_grid(scan, scale.edge_mm, Occupancy::of(1)).cloud.points_mm;
        let is_on = |p: &Point3<f32>, within_mm: f32| self.height_mm(p).is_some_and(|mm| mm <= within_mm);
        let of_background: Vec<Point3<f32>> =
            means.into_par_iter().filter(|mean| is_on(mean, self.half_mm)).collect();
        let next_mm = NEXT_VOXELS * scale.edge_mm;
        let voxels = Grid::new(&of_background, next_mm);
        let within_mm = self.half_mm + DEVIATIONS * scale.noise_mm;
        let marks = leave.par_iter_mut().zip(&scan.points_mm);
        marks.for_each(|(leaves, p)| {
            *leaves = *leaves || (voxels.is_near(p, next_mm) && is_on(p, within_mm));
        });
    }

    /// The tolerance, for the summary.
    pub(super) fn derived(&self) -> Parameter {
        let how =
            format!("{DEVIATIONS} x rms between the voxels of the background and those of the scan on it");
        Parameter { name: "background_mm".into(), value: f64::from(self.half_mm), how }
    }
}

fn moved(cloud: &PointCloud, motion: &Isometry3<f64>) -> PointCloud {
    let turn = motion.rotation.cast::<f32>();
    let about_origin = motion * cloud.origin_mm;
    PointCloud {
        origin_mm: about_origin,
        points_mm: cloud.points_mm.par_iter().map(|p| turn * p).collect(),
        normals: cloud.normals.par_iter().map(|n| turn * n).collect(),
    }
}
