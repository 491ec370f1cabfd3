//! How thick an arm is, and what it stands on: nominal sizes, for the check of its links.

/// Capsules of these radii hold the links of an arm; sources are in `docs/feasibility.md`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// What a person calls what stands still, and what each joint carries.
    pub names: [&'static str; 7],
    /// Radii of the same.
    pub radii_mm: [f64; 7],
    /// How far upper arm and forearm stand beside the plane of the arm, along the axis of joint 2.
    pub beside_mm: [f64; 2],
    /// Height of the surface that the arm is mounted on, in the robot's base frame.
    pub mounting_mm: f64,
    /// Pairs of links that can touch each other; the others are kept apart by the joints between them.
    pub pairs: &'static [[usize; 2]],
}

/// Links that the torch can touch: the wrist carries it.
pub(super) const BEHIND_THE_WRIST: usize = 4;

/// Of arms whose forearm is carried by joint 3, with three joints beside each other in the wrist.
pub(super) const OFFSET_WRIST: Body = Body {
    names: ["base", "shoulder", "upper arm", "forearm", "wrist 1", "wrist 2", "wrist 3"],
    radii_mm: [0.0; 7],
    beside_mm: [0.0; 2],
    mounting_mm: 0.0,
    pairs: &[[0, 3], [0, 4], [0, 5], [0, 6], [1, 3], [1, 4], [1, 5], [1, 6], [2, 4], [2, 5], [2, 6], [3, 6]],
};

/// Of arms whose forearm is carried by joint 4, with three axes that meet in the wrist.
pub(super) const SPHERICAL_WRIST: Body = Body {
    names: ["base", "column", "upper arm", "elbow", "forearm", "wrist", "flange"],
    radii_mm: [0.0; 7],
    beside_mm: [0.0; 2],
    mounting_mm: 0.0,
    pairs: &[[0, 4], [0, 5], [0, 6], [1, 4], [1, 5], [1, 6], [2, 5], [2, 6]],
};

/// Radii of an arm of which nothing but the reach is known, as shares of upper arm and forearm together: base, column, upper
/// arm, elbow, forearm, wrist, flange. About those of common arms of 6 to 12 kg.
const RADIUS_SHARES: [f64; 7] = [0.11, 0.10, 0.075, 0.075, 0.055, 0.045, 0.04];

impl Body {
    /// Of a spherical-wrist arm with these lengths of upper arm and forearm together.
    pub(crate) fn of_reach(reach_mm: f64, mounting_mm: f64) -> Self {
        Self {
            radii_mm: RADIUS_SHARES.map(|share| (share * reach_mm).round()),
            mounting_mm,
            ..SPHERICAL_WRIST
        }
    }

    /// Least radius of what moves.
    pub(super) fn least_radius_mm(&self) -> f64 {
        self.radii_mm[1..].iter().copied().fold(f64::INFINITY, f64::min)
    }
}
