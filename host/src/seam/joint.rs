//! What kind of joint a seam is (ours): from how far its faces reach, and what lies beyond them.

use super::Joint;
use super::refine::Refined;
use crate::cloud::PointCloud;
use crate::grid::Grid;
use nalgebra::Vector3;

/// What was seen of a seam's cross-section.
#[derive(Debug, Clone, Copy)]
pub struct Section {
    /// Angle between the faces through the air, degrees.
    pub opening_deg: f32,
    /// Whether each face ends within the window.
    pub short: [bool; 2],
    /// Mean normal of what lies beyond each face that ends.
    pub beyond: [Option<Vector3<f32>>; 2],
    /// Mean normals of the faces along a loop: length 1 where they keep their direction.
    pub steadiness: [f32; 2],
}

/// Looks at the cross-section of a seam in the model.
pub fn section(seam: &Refined, model: &PointCloud, grid: &Grid, voxel_mm: f32, most_mm: f32) -> Section {
    let n = seam.frames.len() as f32;
    let mean = |k: usize| seam.frames.iter().map(|f| f.faces[k]).sum::<Vector3<f32>>() / n;
    let cosine = seam.frames.iter().map(|f| f.faces[0].dot(&f.faces[1])).sum::<f32>() / n;
    let short = seam.reach_mm.map(|r| r < super::refine::NARROW * most_mm);
    Section {
        opening_deg: 180.0 - cosine.clamp(-1.0, 1.0).acos().to_degrees(),
        short,
        beyond: [0, 1].map(|k| if short[k] { beyond(seam, k, model, grid, voxel_mm) } else { None }),
        steadiness: [mean(0).norm(), mean(1).norm()],
    }
}

/// Mean normal, in the frame of the seam's middle cross-section, of the surface that begins where face `k` ends.
///
/// Expressed by its components along that station's own face normals, so that curved seams can be averaged.
fn beyond(seam: &Refined, k: usize, model: &PointCloud, grid: &Grid, voxel_mm: f32) -> Option<Vector3<f32>> {
    let mut votes = Vec::new();
    for frame in seam.frames.iter().step_by((seam.frames.len() / 24).max(1)) {
        let into = frame.into_faces()[k];
        let lip = frame.position + into * (seam.reach_mm[k] + 2.0 * voxel_mm);
        let mut sum = Vector3::zeros();
        grid.within(&lip, 5.0 * voxel_mm, |slot, _| {
            let normal = model.normals[grid.index(slot)];
            if normal.dot(&frame.faces[k]).abs() < 0.8
                && (grid.point(slot) - frame.position).dot(&into) > seam.reach_mm[k]
            {
                sum += normal;
            }
        });
        if let Some(normal) = sum.try_normalize(3.0) {
            // Components along this face, the other face, and the bisector.
            votes.push(Vector3::new(
                normal.dot(&frame.faces[k]),
                normal.dot(&frame.faces[1 - k]),
                normal.dot(&frame.bisector()),
            ));
        }
    }
    let least = 4.min(seam.frames.len() / 3 + 1);
    (votes.len() >= least).then(|| votes.iter().sum::<Vector3<f32>>() / votes.len() as f32)
}

/// The joint and the reason, without what only the other seams can tell (branches).
pub fn classify(section: &Section, closed: bool) -> (Joint, String) {
    const LIKE: f32 = 0.75;
    let opening = section.opening_deg;
    let like_other = |k: usize| section.beyond[k].is_some_and(|b| b.y > LIKE);
    // Between plates the surface beyond a bevel faces along the bisector, at an outside corner along the other face.
    let like_bisector = |k: usize| section.beyond[k].is_some_and(|b| b.z > LIKE && b.z > b.y);
    let steady = section.steadiness.map(|s| s > 0.97);
    if section.short == [true, true] && like_bisector(0) && like_bisector(1) {
        return (Joint::ButtV, format!("two bevels at {opening:.0} degrees below one surface"));
    }
    if section.short == [true, true] && like_other(0) && like_other(1) && opening < 135.0 {
        return (Joint::Corner, format!("the edges of two plates at {opening:.0} degrees"));
    }
    if (0..2).any(|k| section.short[k] && !section.short[1 - k] && like_other(k)) {
        return (Joint::Lap, format!("a plate edge at {opening:.0} degrees to the plate it lies on"));
    }
    match (closed, steady.iter().filter(|s| **s).count()) {
        (true, 0) => (Joint::Saddle, format!("a loop of two curved faces at {opening:.0} degrees")),
        (true, _) => (Joint::Pipe, format!("a loop of a flat and a curved face at {opening:.0} degrees")),
        _ => (Joint::Fillet, format!("an inside corner of two faces at {opening:.0} degrees")),
    }
}
