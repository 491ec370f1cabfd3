//! What the fit-up of a joint is measured from.

use crate::seam::Joint;
use crate::seam::input::Input;
use crate::seam::refine::Refined;
use crate::seam::refine::expected::Expected;

/// What a joint is measured from.
pub struct JointEvidence<'a> {
    /// What the steps before handed over.
    pub input: &'a Input<'a>,
    /// The refined seam.
    pub seam: &'a Refined,
    /// Its kind.
    pub joint: Joint,
    /// Which faces were seen to end.
    pub short: [bool; 2],
    /// How far the faces reach, mm.
    pub reach_mm: [f32; 2],
    /// How wrong the seam may be.
    pub expected: &'a Expected,
}
