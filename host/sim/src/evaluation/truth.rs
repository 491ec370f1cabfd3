//! The truth a path is measured against: every seam of a piece, in the base frame, in millimetres.

use super::Error;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Which line of a seam a path should follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// Where the adjoining faces meet.
    Apex,
    /// The centre of the root opening.
    Root,
}

/// What is true of a scan; the schema of `truth.json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
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
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
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

impl Truth {
    /// A `truth.json` from bytes; `path` is for messages.
    pub fn parse(bytes: &[u8], path: &Path) -> Result<Self, Error> {
        let malformed = |place: String, reason: String| Error::Malformed { path: path.into(), place, reason };
        let truth: Self = serde_json::from_slice(bytes)
            .map_err(|e| malformed(format!("line {}, column {}", e.line(), e.column()), e.to_string()))?;
        for seam in &truth.seams {
            seam.check().map_err(|reason| malformed(format!("seam `{}`", seam.name), reason))?;
        }
        Ok(truth)
    }

    /// Visible stations of all seams, mm: what F1 compares with.
    pub fn visible_mm(&self, target: Target) -> Vec<[f64; 3]> {
        let visible = |seam: &TruthSeam| {
            let stations = seam.line(target).iter().zip(&seam.visible);
            stations.filter(|(_, v)| **v > 0).map(|(p, _)| *p).collect::<Vec<_>>()
        };
        self.seams.iter().flat_map(visible).collect()
    }
}

/// A seam has at most this many stations, at a millimetre apart a hundred metres of weld: scoring compares every path
/// point with every station.
pub(super) const MAX_STATIONS: usize = 100_000;

impl TruthSeam {
    /// The polyline that a path should follow, mm.
    pub fn line(&self, target: Target) -> &[[f64; 3]] {
        match target {
            Target::Root if self.p_root.len() == self.p.len() => &self.p_root,
            _ => &self.p,
        }
    }

    /// Stations that at least two views see.
    pub fn visible_count(&self) -> usize {
        self.visible.iter().filter(|v| **v > 0).count()
    }

    /// What would make the seam useless as truth.
    fn check(&self) -> Result<(), String> {
        let stations = self.p.len();
        if stations == 0 || stations > MAX_STATIONS {
            return Err(format!("has {stations} stations in `p`; 1 to {MAX_STATIONS} can be used"));
        }
        let lengths = [("n", self.n.len()), ("t", self.t.len()), ("visible", self.visible.len())];
        if let Some((name, length)) = lengths.iter().find(|(_, length)| *length != stations) {
            return Err(format!(
                "`{name}` has {length} entries, `p` has {stations}: one per station is needed"
            ));
        }
        let far = |v: &[f64; 3]| v.iter().any(|x| !x.is_finite() || x.abs() > 1e6);
        if let Some(i) = self.p.iter().chain(&self.p_root).position(far) {
            return Err(format!("position {} is not a position in millimetres", i % stations));
        }
        let frame = |i: &usize| {
            let (n, t) = (Vector3::from(self.n[*i]), Vector3::from(self.t[*i]));
            far(&self.n[*i]) || far(&self.t[*i]) || n.cross(&t).norm() <= 0.1 * n.norm() * t.norm()
        };
        match (0..stations).find(frame) {
            Some(i) => Err(format!("station {i}: `n` and `t` span no torch frame")),
            None => Ok(()),
        }
    }
}
