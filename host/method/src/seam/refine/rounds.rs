//! Rounds of projection, fit and smoothing of an inside corner on the raw points (ours).

use super::beside::near_path;
use super::path::Path;
use super::sections::FaceSections;
use super::stretch::Stretch;
use super::{RefineConfig, Refined};
use crate::seam::input::RawScan;
use crate::seam::trace::Chain;

/// Stations put to each end of an open path in the first round, and in later ones. Chosen on the simulated scans.
const ADDED_FIRST: usize = 2;
const ADDED_LATER: usize = 4;
/// Rounds in which the points near the path are looked up: the path hardly moves in later ones.
const LOOK_UPS: usize = 2;
/// How much farther than the reach points are looked up, voxels: by no more does a path move in a round.
const SPARE_VOXELS: f32 = 4.0;

/// Refines a chain; `None` if too little of it is supported by raw points.
pub(crate) fn refine(scan: &RawScan, chain: &Chain, voxel_mm: f32, config: &RefineConfig) -> Option<Refined> {
    let mut path = Path::along(chain, config.step * voxel_mm)?;
    let mut refined: Option<Refined> = None;
    for round in 0..config.rounds {
        let added = if round == 0 { ADDED_FIRST } else { ADDED_LATER };
        path.extend(added);
        let known = refined.filter(|_| round >= LOOK_UPS).map(|refined| refined.near);
        let reach_mm = config.reach * voxel_mm;
        let near =
            known.unwrap_or_else(|| near_path(scan.index, &path.frames, reach_mm + SPARE_VOXELS * voxel_mm));
        let sections = FaceSections::new(scan, &near, &path, voxel_mm, config, round);
        let stations = sections.stations(&path);
        let stretch = Stretch {
            path: &path,
            stations: &stations,
            inside: sections.before_walls(&stations, &path, added),
            both_seen_mm: sections.both_seen_mm(),
            half_mm: sections.windows.half_mm,
            voxel_mm,
        };
        let smoothed = stretch.smoothed(sections.reach_mm, near, config.gap)?;
        let outcome = Refined { lift_unknown_mm: sections.lift_unknown_mm, ..smoothed };
        path = Path::of(&outcome);
        refined = Some(outcome);
    }
    refined
}
