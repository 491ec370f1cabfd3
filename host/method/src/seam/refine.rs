//! Below the voxel: each station of a seam is the intersection of the two faces fitted to raw points beside it (ours).
//!
//! Raw points, because the bilateral filter rounds corners. Seam coordinates, because a straight window would bend a curved
//! seam. Heights are fitted over a window along the seam, the root itself left out, and the fits are intersected in the
//! cross-section; the stations are then smoothed as stiffly as cross-validation allows.
//!
//! [`rounds`] does this for inside corners, [`layers`] for the feet of steps. Both put points into the coordinates of a
//! `path` ([`beside`]), gather them in `windows`, fit them ([`face`], `reach`, `sections`) to `station`s, and smooth these
//! to a seam (`stretch`, [`smooth`]). [`overlap`] keeps seams apart, [`bend`] joins them round rounded corners, [`expected`] says how wrong they may be.

pub mod bend;
pub mod beside;
pub mod expected;
pub mod face;
pub mod frame;
pub mod layers;
pub mod overlap;
mod path;
mod reach;
mod rounding;
pub mod rounds;
mod sections;
pub mod smooth;
mod station;
mod stretch;
mod windows;

use beside::StationLine;
use frame::Frame;
use std::ops::Range;

/// Sizes, in voxels unless named otherwise. The defaults were chosen on the simulated scans.
#[derive(Debug, Clone, Copy)]
pub struct RefineConfig {
    /// Distance of stations.
    pub step: f32,
    /// Half length of the window along the seam.
    pub half: f32,
    /// Strip beside the root that is left out.
    pub root: f32,
    /// The same where the faces meet at less than [`ACUTE_DEG`]: there is a gap, or a root face.
    pub acute_root: f32,
    /// Part of a face next to the seam that is taken for the face without question.
    pub inner: f32,
    /// Farthest from the seam that points are used.
    pub reach: f32,
    /// The same on curved faces.
    pub curved_reach: f32,
    /// Longest stretch without points that is bridged.
    pub gap: f32,
    /// Rounds of fit and re-projection.
    pub rounds: usize,
}

impl Default for RefineConfig {
    fn default() -> Self {
        Self {
            step: 1.7,
            half: 8.3,
            root: 0.85,
            acute_root: 1.85,
            inner: 5.4,
            reach: 11.7,
            curved_reach: 8.3,
            gap: 6.7,
            rounds: 3,
        }
    }
}

impl RefineConfig {
    /// The same where the corner is rounded so far from the seam, voxels: that is left out, and as much more is looked at beyond.
    pub(super) fn beyond(self, rounded: f32) -> Self {
        Self {
            root: self.root + rounded,
            acute_root: self.acute_root + rounded,
            inner: self.inner + rounded,
            reach: self.reach + rounded,
            curved_reach: self.curved_reach + rounded,
            ..self
        }
    }
}

/// Faces that meet at less leave a gap or a root face between them, degrees.
pub const ACUTE_DEG: f32 = 75.0;
/// Share of the farthest reach below which a face counts as narrow.
pub(crate) const NARROW: f32 = 0.93;

/// A refined seam.
#[derive(Debug, Clone)]
pub struct Refined {
    /// Stations at equal steps.
    pub frames: Vec<Frame>,
    /// Distance of stations, mm.
    pub step_mm: f32,
    /// Whether the last station is followed by the first.
    pub closed: bool,
    /// Which stations were measured, not bridged.
    pub measured: Vec<bool>,
    /// Noise of the points about the faces, mm.
    pub sigma_mm: f64,
    /// Standard deviation of the smoothed position across the seam from the points' noise alone, mm.
    pub scatter_mm: f64,
    /// Standard deviation of the smoothed face normals, rad.
    pub tilt_rad: f64,
    /// Distance that points of each face reach from the seam, mm.
    pub reach_mm: [f32; 2],
    /// Standard deviation of each face's height at the root because something lifts its points there: a camera that rounds or
    /// fills corners, or a radius, mm.
    pub lift_unknown_mm: [f64; 2],
    /// Length of the window of a station, mm.
    pub window_mm: f32,
    /// Effective number of free parameters of the smoothed curve, per coordinate.
    pub freedom: f64,
    /// Per station and face: share of each view in the fit.
    pub view_share: Vec<[Vec<f32>; 2]>,
    /// The raw points that lie near enough to matter.
    pub near: Vec<u32>,
}

impl Refined {
    /// Cuts an open or closed seam to some of its stations.
    pub fn keep(&mut self, stations: Range<usize>) {
        let whole = stations.len() == self.frames.len();
        self.frames = self.frames[stations.clone()].to_vec();
        self.measured = self.measured[stations.clone()].to_vec();
        self.view_share = self.view_share[stations].to_vec();
        self.closed &= whole;
    }

    /// Its stations, to find feet on.
    pub fn line(&self) -> StationLine<'_> {
        StationLine { frames: &self.frames, step_mm: self.step_mm, closed: self.closed }
    }

    /// Most stations in a row that were not measured.
    pub(crate) fn longest_gap(&self) -> usize {
        self.measured.split(|m| *m).map(<[bool]>::len).max().unwrap_or(0)
    }
}
