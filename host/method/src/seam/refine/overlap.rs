//! One seam for one corner (ours): where two refined seams run over each other, the longer keeps the stretch.

use super::Refined;
use super::frame::Frame;
use super::stretch::longest_run;
use crate::geometry::grid::Grid;

// All chosen on the simulated scans.

/// Two stations are the same place within this distance, voxels, and these angles' cosines.
const NEAR_VOXELS: f32 = 2.0;
const SAME_DIRECTION: f32 = 0.9;
const SAME_FACE: f32 = 0.8;

/// Cuts every seam to the stretch along which no longer seam runs; what is then shorter than `shortest_mm` is dropped.
pub fn apart<T>(mut seams: Vec<(T, Refined)>, voxel_mm: f32, shortest_mm: f32) -> Vec<(T, Refined)> {
    let length = |s: &Refined| s.step_mm * s.frames.len() as f32;
    seams.sort_by(|a, b| length(&b.1).total_cmp(&length(&a.1)));
    let mut kept: Vec<(T, Refined)> = Vec::new();
    for (chain, mut seam) in seams {
        let taken: Vec<Frame> = kept.iter().flat_map(|(_, s)| s.frames.iter().copied()).collect();
        let free = free(&seam.frames, &taken, voxel_mm);
        if free.iter().any(|f| !f) {
            let Some(range) = longest_run(&free, 0) else { continue };
            seam.keep(range.0..range.1);
            if length(&seam) < shortest_mm {
                continue;
            }
        }
        kept.push((chain, seam));
    }
    kept
}

/// Which stations are at none of the places that are taken.
pub fn free(frames: &[Frame], taken: &[Frame], voxel_mm: f32) -> Vec<bool> {
    let places: Vec<_> = taken.iter().map(|f| f.position).collect();
    let grid = Grid::new(&places, NEAR_VOXELS * voxel_mm);
    let is_free = |f: &Frame| {
        let mut same = false;
        grid.within(&f.position, NEAR_VOXELS * voxel_mm, |slot, _| {
            same |= is_same(f, &taken[grid.index(slot)]);
        });
        !same
    };
    frames.iter().map(is_free).collect()
}

fn is_same(a: &Frame, b: &Frame) -> bool {
    let fits = |k: usize, l: usize| {
        a.faces[0].dot(&b.faces[k]) > SAME_FACE && a.faces[1].dot(&b.faces[l]) > SAME_FACE
    };
    a.tangent.dot(&b.tangent).abs() > SAME_DIRECTION && (fits(0, 1) || fits(1, 0))
}
