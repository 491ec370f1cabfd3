//! What kind of joint a seam is (ours): from how far its faces reach, and what lies beyond them.

use crate::geometry::statistics::median;
use crate::seam::Joint;
use crate::seam::input::SurfaceModel;
use crate::seam::refine::{ACUTE_DEG, NARROW, Refined};
use nalgebra::Vector3;

// All chosen on the simulated scans.

/// How far bevels are followed, in reaches of the refinement.
const FAR: f32 = 3.0;
/// Cross-sections in which a lip is sought; how near to a face its model goes on, voxels, and within which cosine; and what
/// a lip rounds, voxels.
const LIP_SECTIONS: usize = 9;
const ON_FACE_VOXELS: f32 = 1.5;
const ON_FACE: f32 = 0.9;
const ROUNDED_VOXELS: f32 = 2.0;
/// Cross-sections in which the surface beyond a lip is sought: this far beyond it and about there, voxels, facing at more
/// than this cosine from the face; and the least length of the sum of its normals.
const BEYOND_SECTIONS: usize = 24;
const BEYOND_VOXELS: f32 = 2.0;
const ABOUT_VOXELS: f32 = 5.0;
const OTHER_FACE: f32 = 0.8;
const LEAST_NORMALS: f32 = 3.0;
/// Cross-sections that must show it, and of a short seam one more than a part of its stations.
const LEAST_VOTES: usize = 4;
const VOTES_ONE_OF: usize = 3;
/// Cosine from which on a surface faces as another does.
const LIKE: f32 = 0.75;
/// Length of the mean normal of a face that keeps its direction round a loop.
const STEADY: f32 = 0.97;
/// The edges of two plates meet at less, degrees.
const CORNER_DEG: f32 = 135.0;

/// What was seen of a seam's cross-section.
#[derive(Debug, Clone, Copy)]
pub struct CrossSection {
    /// Angle between the faces through the air, degrees.
    pub opening_deg: f32,
    /// Whether each face ends near enough to be seen.
    pub short: [bool; 2],
    /// How far each face reaches from the seam, mm; no farther than was looked.
    pub reach_mm: [f32; 2],
    /// Mean normal of what lies beyond each face that ends.
    pub beyond: [Option<Vector3<f32>>; 2],
    /// Mean normals of the faces along a loop: length 1 where they keep their direction.
    pub steadiness: [f32; 2],
}

/// Looks at the cross-section of a seam in the model.
pub(crate) fn cross_section(seam: &Refined, model: &SurfaceModel, most_mm: f32) -> CrossSection {
    let n = seam.frames.len() as f32;
    let mean = |k: usize| seam.frames.iter().map(|f| f.faces[k]).sum::<Vector3<f32>>() / n;
    let cosine = seam.frames.iter().map(|f| f.faces[0].dot(&f.faces[1])).sum::<f32>() / n;
    let opening_deg = 180.0 - cosine.clamp(-1.0, 1.0).acos().to_degrees();
    let mut reach_mm = seam.reach_mm;
    let mut short = reach_mm.map(|reach_mm| reach_mm < NARROW * most_mm);
    let lies_beyond = |k: usize, reach_mm: f32| beyond(seam, k, reach_mm, model);
    let mut beyond = [0, 1].map(|k| if short[k] { lies_beyond(k, reach_mm[k]) } else { None });
    for k in 0..2 {
        // The bevels of a thick plate, or of a wide root opening, end farther out.
        if beyond[k].is_none() && opening_deg < ACUTE_DEG {
            let far_mm = FAR * most_mm;
            reach_mm[k] = lip_mm(seam, k, model, far_mm);
            short[k] = reach_mm[k] < NARROW * far_mm;
            beyond[k] = if short[k] { lies_beyond(k, reach_mm[k]) } else { None };
        }
    }
    CrossSection { opening_deg, short, reach_mm, beyond, steadiness: [mean(0).norm(), mean(1).norm()] }
}

/// How far face `k` goes on in the model, less what its lip rounds, mm.
fn lip_mm(seam: &Refined, k: usize, model: &SurfaceModel, most_mm: f32) -> f32 {
    let (grid, voxel_mm) = (model.index, model.voxel_mm());
    let mut lips: Vec<f32> = Vec::with_capacity(2 * LIP_SECTIONS);
    for frame in seam.frames.iter().step_by((seam.frames.len() / LIP_SECTIONS).max(1)) {
        let into = frame.faces_inward()[k];
        let goes_on = |u_mm: f32| {
            let mut on_face = false;
            grid.within(&(frame.position + into * u_mm), ON_FACE_VOXELS * voxel_mm, |slot, _| {
                on_face |= model.cloud.normals[grid.index(slot)].dot(&frame.faces[k]) > ON_FACE;
            });
            on_face
        };
        let steps = (most_mm / voxel_mm) as usize;
        let from = (seam.reach_mm[k] / voxel_mm) as usize;
        let end = (from..steps).find(|&step| !goes_on(step as f32 * voxel_mm)).unwrap_or(steps);
        lips.push((end as f32 - ROUNDED_VOXELS) * voxel_mm);
    }
    median(&mut lips)
}

/// Mean normal, in the frame of the seam's middle cross-section, of the surface that begins where face `k` ends.
///
/// Expressed by its components along that station's own face normals, so that curved seams can be averaged.
fn beyond(seam: &Refined, k: usize, reach_mm: f32, model: &SurfaceModel) -> Option<Vector3<f32>> {
    let (grid, voxel_mm) = (model.index, model.voxel_mm());
    let mut votes = Vec::new();
    for frame in seam.frames.iter().step_by((seam.frames.len() / BEYOND_SECTIONS).max(1)) {
        let into = frame.faces_inward()[k];
        let lip = frame.position + into * (reach_mm + BEYOND_VOXELS * voxel_mm);
        let mut sum = Vector3::zeros();
        grid.within(&lip, ABOUT_VOXELS * voxel_mm, |slot, _| {
            let normal = model.cloud.normals[grid.index(slot)];
            if normal.dot(&frame.faces[k]).abs() < OTHER_FACE
                && (grid.point(slot) - frame.position).dot(&into) > reach_mm
            {
                sum += normal;
            }
        });
        if let Some(normal) = sum.try_normalize(LEAST_NORMALS) {
            // Components along this face, the other face, and the bisector.
            votes.push(Vector3::new(
                normal.dot(&frame.faces[k]),
                normal.dot(&frame.faces[1 - k]),
                normal.dot(&frame.bisector()),
            ));
        }
    }
    let least = LEAST_VOTES.min(seam.frames.len() / VOTES_ONE_OF + 1);
    (votes.len() >= least).then(|| votes.iter().sum::<Vector3<f32>>() / votes.len() as f32)
}

/// The joint and the reason, without what only the other seams can tell (branches).
pub(crate) fn classify(section: &CrossSection, closed: bool) -> (Joint, String) {
    let opening = section.opening_deg;
    let like_other = |k: usize| section.beyond[k].is_some_and(|b| b.y > LIKE);
    // Between plates the surface beyond a bevel faces along the bisector, at an outside corner along the other face.
    let like_bisector = |k: usize| section.beyond[k].is_some_and(|b| b.z > LIKE && b.z > b.y);
    let steady = section.steadiness.map(|s| s > STEADY);
    if section.short == [true, true] && like_bisector(0) && like_bisector(1) {
        return (Joint::ButtV, format!("two bevels at {opening:.0} degrees below one surface"));
    }
    if section.short == [true, true] && like_other(0) && like_other(1) && opening < CORNER_DEG {
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
