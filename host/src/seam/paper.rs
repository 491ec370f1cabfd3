//! The paper's own extraction (II-E, eqs. (11)-(17)), for comparison: the ratio test alone, no gate, no joint types, edge
//! points ordered as they come, the normal of the surroundings as the torch axis.

use super::{Found, Input, Joint, Seam, Station, edges};
use crate::grid::Grid;
use nalgebra::Vector3;
use rayon::prelude::*;
use weldpath_core::seam::{RatioThreshold, Tensor, gradient, intensity};

/// Radius of the neighbourhoods, voxels (the paper gives none).
const RADIUS_VOXELS: f32 = 4.0;
/// Capacity of a neighbourhood.
const CAPACITY: usize = 192;

/// Every point whose `Tr³/Det` reaches the threshold, as one seam.
pub fn find(input: &Input, ratio_threshold: f64) -> Found {
    let Some(threshold) = RatioThreshold::new(ratio_threshold as f32) else {
        let reason =
            format!("t = {ratio_threshold} marks everything; it must exceed {}", RatioThreshold::FLOOR);
        return Found { reason, ..Found::default() };
    };
    let edges = edge_points(input, threshold);
    let stations: Vec<Station> = edges
        .windows(2)
        .map(|w| {
            let p = |k: usize| input.model.in_base_mm(k);
            let normal = input.model.normals[w[0]].cast::<f64>();
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
        expected_error_mm: f64::from(input.voxels.edge_mm),
        expected_error_deg: 15.0,
        warnings: vec!["the paper's method, for comparison only: do not weld this".into()],
    };
    let radius_mm = RADIUS_VOXELS * input.voxels.edge_mm;
    let grid = Grid::new(&input.model.points_mm, radius_mm);
    let intensity = edges::score(input.voxels, input.model, &grid, radius_mm).intensity;
    Found { seams: vec![seam], intensity, ..Found::default() }
}

/// Indices of the edge points in the order of the cloud.
pub fn edge_points(input: &Input, threshold: RatioThreshold) -> Vec<usize> {
    let ratios = tensors(input);
    (0..ratios.len()).filter(|&k| ratios[k].is_edge(threshold)).collect()
}

/// Smoothed tensor of every point, in the order of the cloud.
pub fn tensors(input: &Input) -> Vec<Tensor> {
    let radius_mm = RADIUS_VOXELS * input.voxels.edge_mm;
    let grid = Grid::new(&input.model.points_mm, radius_mm);
    let near = |slot: usize| {
        let at = grid.point(slot);
        let mut found = heapless::Vec::<(usize, Vector3<f32>, f32), CAPACITY>::new();
        grid.within(&at, radius_mm, |other, d2| {
            if other != slot {
                let _ = found.push((other, grid.point(other) - at, d2));
            }
        });
        found
    };
    let all = || (0..grid.len()).into_par_iter().with_min_len(256);
    let intensities: Vec<f32> = all()
        .map(|slot| {
            let offsets: heapless::Vec<Vector3<f32>, CAPACITY> = near(slot).iter().map(|n| n.1).collect();
            intensity(&offsets, radius_mm)
        })
        .collect();
    let gradients: Vec<Vector3<f32>> = all()
        .map(|slot| {
            let near = near(slot);
            gradient(near.iter().map(|&(other, offset, _)| (offset, intensities[other] - intensities[slot])))
        })
        .collect();
    let by_slot: Vec<Tensor> = all()
        .map(|slot| {
            let near = near(slot);
            Tensor::smoothed(&gradients[slot], near.iter().map(|(other, _, d2)| (*d2, &gradients[*other])))
        })
        .collect();
    let mut tensors = vec![Tensor::default(); grid.len()];
    by_slot.into_iter().enumerate().for_each(|(slot, t)| tensors[grid.index(slot)] = t);
    tensors
}

fn any_across(normal: &Vector3<f64>) -> Vector3<f64> {
    let axis = if normal.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() };
    normal.cross(&axis).normalize()
}
