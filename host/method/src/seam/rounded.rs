//! Seams in joints that a camera has rounded (ours).
//!
//! A matcher's window rounds a corner, and so does a radius of the work. A neighbourhood that is smaller than the rounding sees two wider
//! corners in it, each between a face and a ramp. Where one runs beside a joint that the faces about it imply, and is wider, it is such an
//! edge: the seam is sought in the joint, by what is seen of the faces beyond the rounding.

use super::description::is_sure;
use super::extraction::{SeamConfig, corner_seam};
use super::implied::{Joint, MOST_ROUNDED_MM, gap_mm};
use super::input::Input;
use super::refine::rounds;
use super::unwelded::{Unwelded, WhyUnwelded};
use super::{Seam, Station};

/// How much farther from a joint than the edges of its rounding its faces are taken for themselves: a fit to an edge lies within the
/// rounding. Of 1, 1.5 and 2 it found the most of 24 scans by another person's generator.
const BEYOND_EDGE: f32 = 1.5;

/// The joint in whose rounding a seam runs: of those beside it the longest. One view does not show enough of the faces beyond.
pub(super) fn joint_of(seam: &Seam, joints: &[Joint], input: &Input) -> Option<usize> {
    if !input.scan.is_seen_from_several() {
        return None;
    }
    let (voxel_mm, origin_mm) = (input.model.voxel_mm(), &input.scan.merged.origin_mm);
    let beside = joints.iter().position(|joint| joint.is_beside(seam, voxel_mm, origin_mm))?;
    joints[beside].is_sharper_than(seam).then_some(beside)
}

/// The seam in a joint that some seams run beside, as likely as the likeliest of these.
///
/// # Errors
/// The joint as a corner that is not welded, where it is not seen well enough.
pub(super) fn seam_in(
    joint: &Joint,
    edges: &[&Seam],
    input: &Input,
    config: &SeamConfig,
) -> Result<Seam, Unwelded> {
    let (v, origin_mm) = (input.model.voxel_mm(), &input.scan.merged.origin_mm);
    let (chain, off_mm) = joint.beside(edges, v, origin_mm);
    let rounded = || Unwelded::of_chain(&chain, origin_mm, WhyUnwelded::Rounded);
    if joint.rounding_mm(&input.model) >= MOST_ROUNDED_MM {
        return Err(rounded());
    }
    let sizes = config.refine.beyond(BEYOND_EDGE * off_mm / v);
    let confidence = edges.iter().map(|seam| seam.confidence).fold(0.0, f64::max);
    let seam = rounds::refine(&input.scan, &chain, v, &sizes).map(|refined| {
        let seam = corner_seam(input, &chain, &refined, sizes.reach * v);
        Seam { confidence, ..seam }
    });
    let is_seen = |seam: &Seam| is_sure(&input.scan, seam, false) && !joint.is_sharper_than(seam);
    seam.filter(is_seen).ok_or_else(rounded)
}

/// The stretches of a seam along which no other runs.
pub(super) fn free_of(others: &[Seam], seam: &Seam, input: &Input) -> Vec<Seam> {
    let near_mm = f64::from(gap_mm(input.model.voxel_mm()));
    let is_taken = |station: &Station| others.iter().any(|other| other.holds(station, near_mm));
    seam.stretches(is_taken)
}
