//! One run along a seam: its path, and how the torch moves on it.

use super::{PathPoint, SeamPath};

/// How the torch moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Along the seam, mm/s.
    pub feed_mm_s: f64,
    /// From the approach to the seam, and off it, mm/s.
    pub approach_feed_mm_s: f64,
    /// In the air, mm/s.
    pub air_feed_mm_s: f64,
    /// Distance of the approach from the seam along the torch axis, mm.
    pub approach_mm: f64,
    /// Distance of the retract from the seam along the torch axis, mm.
    pub retract_mm: f64,
    /// How far the torch is lifted along its axis between the stitches of a seam, mm.
    pub lift_mm: f64,
    /// Between the scanned model and the air moves, mm.
    pub clearance_mm: f64,
}

/// One run along a seam, and how the torch moves on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    /// Where the torch goes, and where the arc burns.
    pub path: SeamPath,
    /// How it moves.
    pub motion: Motion,
}

impl Pass {
    /// Its first and last point; none if fewer than two of them are welded: such a pass is left out.
    pub fn ends(&self) -> Option<[&PathPoint; 2]> {
        let [first, .., last] = self.path.points.as_slice() else { return None };
        let welded = self.path.points.iter().filter(|point| point.process.weld).count();
        (welded > 1).then_some([first, last])
    }
}
