//! The truth a path is measured against: every seam of a piece, in the base frame, in millimetres.

use serde::{Deserialize, Serialize};

/// What is true of a scan; the schema of `truth.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Name of the scan.
    pub name: String,
    /// The workpiece.
    #[serde(default)]
    pub kind: String,
    /// How it lies: flat, tilted, horizontal, vertical.
    #[serde(default)]
    pub pose: String,
    /// Seed of the simulator.
    #[serde(default)]
    pub seed: u64,
    /// Noise of the camera: low, mid, high.
    #[serde(default)]
    pub noise: String,
    /// Size of the depth images: vga, hd or WIDTHxHEIGHT.
    #[serde(default)]
    pub cam: String,
    /// Which view has an exact pose.
    #[serde(default)]
    pub anchor: String,
    /// Sizes of the piece, mm or degrees.
    #[serde(default)]
    pub params: std::collections::BTreeMap<String, f64>,
    /// Height of the table's top, mm.
    #[serde(default)]
    pub ztable: f64,
    /// True pose of the camera in each view, base from camera, row major, mm.
    #[serde(default)]
    pub true_cam: Vec<[[f64; 4]; 4]>,
    /// All seams, also those that no view sees.
    pub seams: Vec<TruthSeam>,
}

/// One seam as it is; the lists have one entry per station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruthSeam {
    /// Unique within the truth.
    pub name: String,
    /// Whether the last station is followed by the first.
    pub closed: bool,
    /// Whether a planner must find it.
    pub required: bool,
    /// Angle between the faces through the air, degrees.
    #[serde(default)]
    pub angle_deg: f64,
    /// 1 where at least two views see the station, else 0.
    pub visible: Vec<u8>,
    /// Where the two faces meet, mm.
    pub p: Vec<[f64; 3]>,
    /// Torch direction, out of the work.
    pub n: Vec<[f64; 3]>,
    /// Tangent.
    pub t: Vec<[f64; 3]>,
    /// Normal of one face.
    #[serde(rename = "nA", default)]
    pub normal_a: Vec<[f64; 3]>,
    /// Normal of the other face.
    #[serde(rename = "nB", default)]
    pub normal_b: Vec<[f64; 3]>,
    /// Centre of the root opening, mm.
    #[serde(default)]
    pub p_root: Vec<[f64; 3]>,
}
