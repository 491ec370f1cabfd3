//! Inside corners that are seen and not offered as seams (ours): where they run, and why not. Nothing vanishes without a word.

use super::refine::longest_run;
use super::trace::{Chain, ChainLink};
use super::{Seam, Station};
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Why an inside corner is not offered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WhyUnwelded {
    /// One of its faces is the table.
    Table,
    /// Too little of it was seen, or too badly.
    Unsure,
    /// It is too short to weld.
    Short,
    /// It is a piece of the inner foot of a closed wall.
    InnerFoot,
    /// Nobody knows which side of its faces is air.
    UnknownSide,
}

/// An inside corner that is seen and not offered as a seam.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Unwelded {
    /// Places along it, mm, base frame.
    pub line_mm: Vec<Point3<f64>>,
    /// Why.
    pub reason: WhyUnwelded,
    /// The same in words.
    pub words: String,
}

impl Unwelded {
    /// A seam that was found and is not offered.
    pub(super) fn of(seam: &Seam, reason: WhyUnwelded, words: String) -> Self {
        Self { line_mm: seam.stations.iter().map(|station| station.position_mm).collect(), reason, words }
    }

    /// Corners that were strung together and made no seam; `origin_mm` is that of the scan.
    pub(super) fn of_chain(chain: &Chain, origin_mm: &Point3<f64>, reason: WhyUnwelded) -> Self {
        let place = |link: &ChainLink| origin_mm + link.position.coords.cast::<f64>();
        Self { line_mm: chain.links.iter().map(place).collect(), reason, words: String::new() }
    }

    fn in_words(&self) -> String {
        let middle = self.line_mm.get(self.line_mm.len() / 2).copied().unwrap_or_else(Point3::origin);
        let why = match self.reason {
            WhyUnwelded::Table => "is where the work rests on the table",
            _ => "is too thinly seen to fit a seam to it: scan it again from nearer, or from more sides",
        };
        let length_mm = self.length_mm();
        format!(
            "an inside corner of {length_mm:.0} mm near {:.0},{:.0},{:.0} {why}",
            middle.x, middle.y, middle.z
        )
    }

    /// Length along its places, mm.
    pub fn length_mm(&self) -> f64 {
        self.line_mm.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }
}

/// Cosine of faces that look opposite ways.
const OPPOSITE: f64 = -0.8;
/// A wall is thinner than this share of what it encloses is across.
const THIN_WALL: f64 = 0.25;

/// Takes out the pieces of the inner foot of closed walls, such as a pipe's: over the rim a part of it is seen, and whoever welds it
/// asks for it.
pub(super) fn inner_feet(seams: &mut Vec<Seam>) -> Vec<Unwelded> {
    let closed: Vec<Seam> = seams.iter().filter(|seam| seam.closed).cloned().collect();
    let (kept, inner): (Vec<_>, Vec<_>) = std::mem::take(seams)
        .into_iter()
        .partition(|seam| seam.closed || !closed.iter().any(|wall| is_inside(seam, wall)));
    *seams = kept;
    let words = |seam: &Seam| {
        format!(
            "{} is a piece of the inner foot of a closed wall: name it to weld it",
            seam.as_inside_corner()
        )
    };
    inner.iter().map(|seam| Unwelded::of(seam, WhyUnwelded::InnerFoot, words(seam))).collect()
}

/// Whether most of a seam runs along the inner side of the wall along whose outer side another does.
fn is_inside(seam: &Seam, outer: &Seam) -> bool {
    let Some(first) = outer.stations.first() else { return false };
    let across_mm =
        outer.stations.iter().map(|s| (s.position_mm - first.position_mm).norm()).fold(0.0, f64::max);
    let is_behind = |a: &&Station| {
        let away = |b: &&Station| (a.position_mm - b.position_mm).norm_squared();
        let Some(b) = outer.stations.iter().min_by(|x, y| away(x).total_cmp(&away(y))) else { return false };
        let from: Vector3<f64> = a.position_mm - b.position_mm;
        let backs = |face: &Vector3<f64>| {
            face.dot(&from) > 0.0 && b.faces.iter().any(|other| face.dot(other) < OPPOSITE)
        };
        from.norm() < THIN_WALL * across_mm && a.faces.iter().any(backs)
    };
    2 * seam.stations.iter().filter(is_behind).count() > seam.stations.len()
}

/// Lines that are told are at least so long, mm, and this many voxels.
const LEAST_MM: f64 = 15.0;
const LEAST_VOXELS: f64 = 10.0;
/// A line this near to another is the same corner, voxels.
const SAME_VOXELS: f64 = 3.0;

/// The lines that are long enough to be told, without what runs beside seams or beside lines before them, longest first.
pub(super) fn told(lines: Vec<Unwelded>, seams: &[Seam], voxel_mm: f64) -> Vec<Unwelded> {
    let (near_mm, least_mm) = (SAME_VOXELS * voxel_mm, LEAST_MM.max(LEAST_VOXELS * voxel_mm));
    let mut known: Vec<Point3<f64>> =
        seams.iter().flat_map(|seam| seam.stations.iter().map(|station| station.position_mm)).collect();
    let mut told = Vec::new();
    for mut line in lines {
        let free = |p: &Point3<f64>| known.iter().all(|q| (p - q).norm() > near_mm);
        let free: Vec<bool> = line.line_mm.iter().map(free).collect();
        if let Some((from, to)) = longest_run(&free, 0) {
            line.line_mm = line.line_mm[from..to].to_vec();
        } else {
            continue;
        }
        if line.length_mm() >= least_mm {
            if line.words.is_empty() {
                line.words = line.in_words();
            }
            known.extend_from_slice(&line.line_mm);
            told.push(line);
        }
    }
    told
}
