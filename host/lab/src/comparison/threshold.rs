//! F1 of the paper's edge points over the threshold `t` of eq. (16), before and after the bilateral filter.

use nalgebra::Point3;
use serde::Serialize;
use weldpath_core::seam::RatioThreshold;

use super::Piece;
use weldpath_job::run::job::Job;
use weldpath_method::geometry::cloud::{Merged, PointCloud};
use weldpath_method::model::downsampling::{Scale, voxel_grid};
use weldpath_method::model::{denoising, normals, reconstruction};
use weldpath_method::pipeline::Plan;
use weldpath_method::seam::score::paper;
use weldpath_sim::evaluation::{CELL_MM, Target, f1};

/// Beyond this from the seams a point is no part of the workpiece that the paper shows, mm.
const CROP_MM: f64 = 40.0;

/// Thresholds from just above where every point is an edge, eight to a factor of two, to where almost none is.
const LEAST: f64 = 28.0;
const STEP: f64 = 1.0905;
const STEPS: i32 = 64;

/// F1 over the threshold.
#[derive(Debug, Serialize)]
pub struct Curves {
    /// Name of the piece.
    pub piece: String,
    /// `t`.
    pub thresholds: Vec<f64>,
    /// F1 of the edge points in the voxel grid.
    pub before: Vec<f64>,
    /// F1 of the edge points in the filtered cloud.
    pub after: Vec<f64>,
    /// F1 of weldpath's own path, which has no threshold.
    pub weldpath: Option<f64>,
}

impl Curves {
    /// The threshold at which F1 after the filter is largest.
    pub(crate) fn best_threshold(&self) -> Option<f64> {
        let best = (0..self.after.len()).max_by(|&a, &b| self.after[a].total_cmp(&self.after[b]))?;
        self.thresholds.get(best).copied()
    }
}

/// Measures a piece: the stages before the seams once, the detector for every threshold.
pub(super) fn curves(piece: &Piece, plan: &Plan) -> Curves {
    let config = Job::default().pipeline();
    let views = &piece.scan.views;
    let patches = normals::of_views(views, &config.merge.normals);
    let registration = reconstruction::register(views, &patches, &config.merge.reconstruction);
    let merged = Merged::new(views, &registration.base_from_camera);
    let scale = Scale::of(&merged, &patches, &config.merge.downsampling);
    let voxels = voxel_grid(&merged, scale.edge_mm, scale.occupancy());
    let filtered = denoising::bilateral(&voxels.cloud, &scale.bilateral());
    let truth = piece.truth.visible_mm(Target::Apex);
    let thresholds: Vec<f64> = (0..=STEPS).map(|k| LEAST * STEP.powi(k)).collect();
    let over = |model: &PointCloud| -> Vec<f64> {
        let tensors = paper::tensors(model, voxels.edge_mm);
        let near: Vec<usize> = (0..model.len()).filter(|&k| is_near(&model.in_base_mm(k), &truth)).collect();
        let at = |&t: &f64| {
            let threshold = RatioThreshold::new(t as f32)?;
            let edges = near.iter().filter(|&&k| tensors[k].is_edge(threshold));
            let points: Vec<[f64; 3]> = edges.map(|&k| model.in_base_mm(k).coords.into()).collect();
            Some(f1(&points, &truth, CELL_MM)?.dice)
        };
        thresholds.iter().map(|t| at(t).unwrap_or(0.0)).collect()
    };
    let path: Vec<[f64; 3]> =
        plan.paths.iter().flat_map(|path| path.points.iter().map(|p| p.position_mm.coords.into())).collect();
    Curves {
        piece: piece.name.clone(),
        before: over(&voxels.cloud),
        after: over(&filtered),
        weldpath: f1(&path, &truth, CELL_MM).map(|f1| f1.dice),
        thresholds,
    }
}

/// The paper crops the scene to the workpiece; so does this, about the seams.
fn is_near(point: &Point3<f64>, truth: &[[f64; 3]]) -> bool {
    truth.iter().step_by(10).any(|station| (point - Point3::from(*station)).norm() < CROP_MM)
}
