//! `[exclude]`: what is scanned and is no work.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::quantity::{Place, Region, Up};
use weldpath_method::pipeline::exclusion::{Exclusion, HalfSpace};

/// `[exclude]`: what is scanned but does not belong to the work. No seam is searched there; the torch still keeps clear of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExcludeSettings {
    /// The empty cell or the fixture, scanned before the work was in it: folder with `scan.json`, or one cloud in the frame of the
    /// scan; relative to the job file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<PathBuf>,
    /// Boxes, mm, base frame.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub boxes_mm: Vec<Region>,
    /// All that lies beyond planes.
    #[serde(rename = "half_space", skip_serializing_if = "Vec::is_empty")]
    pub half_spaces: Vec<HalfSpaceSettings>,
}

/// `[[exclude.half_space]]`: all that lies beyond a plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HalfSpaceSettings {
    /// A place on the plane, mm, base frame.
    pub at_mm: Place,
    /// From the plane into what is excluded, square to it; any length.
    pub toward: Up,
}

impl ExcludeSettings {
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// With paths that are relative to `folder`.
    pub(super) fn within(self, folder: &Path) -> Self {
        Self { background: self.background.map(|path| folder.join(path)), ..self }
    }

    /// As the pipeline takes it; the background has to be read first.
    pub(super) fn exclusion(&self) -> Exclusion {
        let half_space =
            |half: &HalfSpaceSettings| HalfSpace { at_mm: half.at_mm.point_mm(), toward: half.toward.get() };
        Exclusion {
            boxes: self.boxes_mm.iter().map(Region::corners_mm).collect(),
            half_spaces: self.half_spaces.iter().map(half_space).collect(),
            ..Exclusion::default()
        }
    }
}
