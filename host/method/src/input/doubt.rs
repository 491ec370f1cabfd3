//! What a scan says of itself that cannot well be true, and whose frame its coordinates are in.

use serde::{Deserialize, Serialize};

/// Whose frame the coordinates of a scan are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum CloudFrame {
    /// The robot's base: the poses of the views are the robot's.
    Base,
    /// That of the camera that took it: nothing says where the robot is.
    Camera,
    /// Another: of a mesh, of a cloud merged elsewhere, of a trajectory that no robot reported.
    #[default]
    Unknown,
}

impl CloudFrame {
    /// Whose coordinates they are.
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Base => "in the robot's base frame",
            Self::Camera => "in its camera's frame",
            Self::Unknown => "in an unknown frame",
        }
    }
}

/// What is doubtful about a scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum DoubtKind {
    /// The unit of positions.
    Units,
    /// The unit of angles.
    Angles,
    /// The metres in one step of a depth image.
    DepthScale,
    /// The direction of a transform: it, or its inverse.
    Direction,
    /// Whose the coordinates are.
    Frame,
    /// Whether a mesh was drawn or scanned.
    CadOrScan,
}

/// A doubt in words; the same words are among the scan's warnings.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Doubt {
    /// About what.
    pub kind: DoubtKind,
    /// What was seen.
    pub words: String,
}
