//! The paper's own extraction (II-E, eqs. (11)-(17)), for comparison: the ratio test alone, no gate, no joint types, edge
//! points ordered as they come, the normal of the surroundings as the torch axis.

use super::edges;
use super::sparse::Sparse;
use crate::geometry::cloud::PointCloud;
use crate::geometry::grid::Grid;
use crate::seam::input::{INDEX_VOXELS, SurfaceModel};
use crate::seam::{ErrorParts, Found, Joint, Seam, Station};
use nalgebra::Vector3;
use weldpath_core::seam::{RatioThreshold, Tensor};

/// Every point whose `Tr³/Det` reaches the threshold, as one seam.
pub fn find(surface: &SurfaceModel, ratio_threshold: f64) -> Found {
    let SurfaceModel { voxels, cloud: model, index, asymmetries } = *surface;
    let Some(threshold) = RatioThreshold::new(ratio_threshold as f32) else {
        let reason =
            format!("t = {ratio_threshold} marks everything; it must exceed {}", RatioThreshold::FLOOR);
        return Found { reason, ..Found::default() };
    };
    let tensors = smoothed(index, asymmetries, INDEX_VOXELS * voxels.edge_mm);
    let edges: Vec<usize> = (0..tensors.len()).filter(|&k| tensors[k].is_edge(threshold)).collect();
    let stations: Vec<Station> = edges
        .windows(2)
        .map(|w| {
            let p = |k: usize| model.in_base_mm(k);
            let normal = model.normals[w[0]].cast::<f64>();
            let chord = p(w[1]) - p(w[0]);
            let across = (chord - normal * normal.dot(&chord)).try_normalize(1e-9);
            Station {
                position_mm: p(w[0]),
                tangent: across.unwrap_or_else(|| any_across(&normal)),
                faces: [normal; 2],
            }
        })
        .collect();
    if stations.is_empty() {
        return Found { reason: format!("no point reaches t = {ratio_threshold}"), ..Found::default() };
    }
    let seam = Seam {
        id: 1,
        joint: Joint::Fillet,
        reason: format!("{} edge points at t = {ratio_threshold}, not classified", stations.len()),
        stations,
        closed: false,
        confidence: 0.0,
        expected_error_mm: f64::from(voxels.edge_mm),
        relative_error_mm: f64::from(voxels.edge_mm),
        fit_error: crate::seam::FitError::default(),
        error_parts: ErrorParts::of_noise(f64::from(voxels.edge_mm)),
        expected_error_deg: 15.0,
        base_error_mm: f64::NAN,
        base_error_deg: f64::NAN,
        contact: None,
        drawn: false,
        dimensions: vec![],
        warnings: vec!["the paper's method, for comparison only: do not weld this".into()],
    };
    let intensity = edges::score(surface).intensity;
    Found { seams: vec![seam], intensity, ..Found::default() }
}

/// Smoothed tensor of every point, in the order of the cloud.
pub fn tensors(model: &PointCloud, voxel_mm: f32) -> Vec<Tensor> {
    let radius_mm = INDEX_VOXELS * voxel_mm;
    let grid = Grid::new(&model.points_mm, radius_mm);
    smoothed(&grid, &edges::asymmetries(&grid, radius_mm), radius_mm)
}

/// The same of a cloud that is indexed, and whose [`edges::asymmetries`] are known.
fn smoothed(grid: &Grid, asymmetries: &[Vector3<f32>], radius_mm: f32) -> Vec<Tensor> {
    let sparse = Sparse::of(grid, radius_mm);
    let mut intensities: Vec<f32> = asymmetries.iter().map(Vector3::norm).collect();
    sparse.rescore(&mut intensities);
    let mut gradients = edges::gradients(grid, radius_mm, &intensities);
    sparse.steepen(&intensities, &mut gradients);
    let mut tensors = edges::tensors(grid, radius_mm, &gradients);
    sparse.smooth(&gradients, &mut tensors);
    grid.by_point(&tensors)
}

fn any_across(normal: &Vector3<f64>) -> Vector3<f64> {
    let axis = if normal.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() };
    normal.cross(&axis).normalize()
}
