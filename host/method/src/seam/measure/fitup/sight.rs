//! Raw points as rays in the cross-section of a seam: where each would have met the faces, were they continued to the root.
//!
//! Noise of a depth camera lies along the ray, so where a ray pierces a face is known far better than the point itself:
//! that is what makes the end of a face sharp.

use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::seam::refine::Refined;
use crate::seam::refine::beside::Foot;
use rayon::prelude::*;

/// A raw point and the ray that saw it, in the coordinates of both faces: along the face from the seam, and off it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SightRay {
    /// Along the seam, mm.
    pub(super) s: f32,
    along_mm: [f32; 2],
    off_mm: [f32; 2],
    ray_along: [f32; 2],
    ray_off: [f32; 2],
}

/// A correction of both faces: heights off the faces of the seam's frame are `offset + slope u`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Faces {
    pub(super) offset_mm: [f32; 2],
    pub(super) slope: [f32; 2],
    /// Cosine of the angle between the faces' normals.
    pub(super) cosine: f32,
}

/// A sight against a pair of faces that meet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pierced {
    /// The face that the ray meets first.
    pub(super) face: usize,
    /// Where, from the line in which the faces meet, mm.
    pub(super) u_mm: f32,
    /// How far along the ray the point lies behind that face, mm.
    pub(super) behind_mm: f32,
    /// The ray's unit vector off that face and along it, away from the seam.
    pub(super) ray_off: f32,
    pub(super) ray_along: f32,
    /// And how far before the other face, mm.
    pub(super) before_other_mm: f32,
    /// Height of the point over the line in which the faces meet, along their bisector, mm.
    pub(super) up_mm: f32,
    /// Cosine between the ray and the bisector.
    pub(super) ray_up: f32,
}

/// Least cosine between a ray and the normals of both faces, as a share of that of the bisector: other views hardly see
/// down to the root.
const LEAST_COSINE: f32 = 0.4;
/// Faces that meet at less do not meet: what is divided by.
const LEAST_SINE: f32 = 1e-3;
/// Neighbouring points that one thread works on at least.
const SHARE: usize = 1024;

/// An even sample of at most `most` of the points near a seam.
pub(super) fn sights(merged: &Merged, seam: &Refined, reach_mm: f32, most: usize) -> Vec<SightRay> {
    let stations: Vec<_> = seam.frames.iter().map(|f| f.position).collect();
    let grid = Grid::new(&stations, reach_mm);
    let every = seam.near.len().div_ceil(most).max(1);
    let sample: Vec<u32> = seam.near.iter().step_by(every).copied().collect();
    sample
        .par_iter()
        .with_min_len(SHARE)
        .filter_map(|&k| {
            let p = merged.points_mm[k as usize];
            let (slot, _) = grid.nearest(&p, reach_mm, |_| true)?;
            let Foot { s, offset, frame } = seam.line().foot(&p, grid.index(slot), f32::INFINITY)?;
            let ray = merged.toward_camera(k as usize).unwrap_or_else(|| frame.bisector());
            let into = frame.faces_inward();
            Some(SightRay {
                s,
                along_mm: into.map(|v| v.dot(&offset)),
                off_mm: frame.faces.map(|v| v.dot(&offset)),
                ray_along: into.map(|v| v.dot(&ray)),
                ray_off: frame.faces.map(|v| v.dot(&ray)),
            })
        })
        .collect()
}

impl Faces {
    /// Where the corrected faces meet, along each face from where the frame's faces do, mm.
    fn root_mm(&self) -> [f32; 2] {
        let [a, b] = self.offset_mm;
        let sine = (1.0 - self.cosine * self.cosine).sqrt().max(LEAST_SINE);
        [(b - self.cosine * a) / sine, (a - self.cosine * b) / sine]
    }

    /// A sight against these faces; `None` from where the root is hidden.
    pub(super) fn pierced(&self, sight: &SightRay) -> Option<Pierced> {
        let root_mm = self.root_mm();
        let off = |k: usize| sight.off_mm[k] - self.offset_mm[k] - self.slope[k] * sight.along_mm[k];
        let ray_off = |k: usize| sight.ray_off[k] - self.slope[k] * sight.ray_along[k];
        let (off, ray_off) = ([off(0), off(1)], [ray_off(0), ray_off(1)]);
        // Twice the cosine between the bisector and both normals.
        let spread = (2.0 + 2.0 * self.cosine).sqrt().max(LEAST_SINE);
        if ray_off[0].min(ray_off[1]) < 0.5 * LEAST_COSINE * spread {
            return None;
        }
        let behind_mm = [-off[0] / ray_off[0], -off[1] / ray_off[1]];
        let face = usize::from(behind_mm[1] > behind_mm[0]);
        Some(Pierced {
            face,
            u_mm: sight.along_mm[face] + behind_mm[face] * sight.ray_along[face] - root_mm[face],
            behind_mm: behind_mm[face],
            ray_off: ray_off[face],
            ray_along: sight.ray_along[face],
            before_other_mm: -behind_mm[1 - face],
            up_mm: (off[0] + off[1]) / spread,
            ray_up: (ray_off[0] + ray_off[1]) / spread,
        })
    }

    /// Moves a face by `offset + slope u`, with `u` from where the faces `from` meet.
    pub(super) fn moved(&mut self, from: &Self, face: usize, offset_mm: f32, slope: f32) {
        self.offset_mm[face] += offset_mm - slope * from.root_mm()[face];
        self.slope[face] += slope;
    }
}
