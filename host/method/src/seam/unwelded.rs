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
        let why = match self.reason {
            WhyUnwelded::Table => "is where the work rests on the table",
            WhyUnwelded::InnerFoot => {
                "is a piece of the inner foot of a closed wall; if it is to be welded, ask for it"
            }
            _ => "is too thinly seen to fit a seam to it: scan it again from nearer, or from more sides",
        };
        // Without a negative zero.
        let whole = |v: f64| v.round() + 0.0;
        let place = |p: &Point3<f64>| format!("{},{},{}", whole(p.x), whole(p.y), whole(p.z));
        let ask = match self.reason {
            WhyUnwelded::InnerFoot => {
                let places: Vec<String> = self.asked_by().map(place).collect();
                format!(" (--ask \"{}\")", places.join(";"))
            }
            _ => String::new(),
        };
        let middle = self.line_mm.get(self.line_mm.len() / 2).map(place).unwrap_or_default();
        format!("an inside corner of {:.0} mm near {middle} {why}{ask}", self.length_mm())
    }

    /// Places along it by which a person would ask for it: its ends, of a line that bends some between.
    fn asked_by(&self) -> impl Iterator<Item = &Point3<f64>> {
        let last = self.line_mm.len().saturating_sub(1);
        let chord_mm = self.line_mm.first().zip(self.line_mm.last()).map_or(0.0, |(a, b)| (b - a).norm());
        let stretches = if chord_mm > STRAIGHT * self.length_mm() { 1 } else { STRETCHES };
        (0..=stretches).filter_map(move |k| self.line_mm.get(k * last / stretches))
    }

    /// Length along its places, mm.
    pub fn length_mm(&self) -> f64 {
        self.line_mm.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }
}

/// Share of its length that the ends of a straight line are apart, and into how many stretches a bent one is parted.
const STRAIGHT: f64 = 0.99;
const STRETCHES: usize = 4;
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
    inner.iter().map(|seam| Unwelded::of(seam, WhyUnwelded::InnerFoot, String::new())).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seam::{Joint, error::ErrorParts};

    /// At the foot of a wall round the origin, so many of 36 stations of it; `side` is 1 outside and -1 inside.
    fn foot(radius_mm: f64, count: usize, side: f64) -> Seam {
        let station = |k: usize| {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / 36.0).sin_cos();
            let out = Vector3::new(cos, sin, 0.0);
            Station {
                position_mm: Point3::from(out * radius_mm),
                tangent: Vector3::new(-sin, cos, 0.0),
                faces: [out * side, Vector3::z()],
            }
        };
        Seam {
            id: 0,
            joint: Joint::Fillet,
            reason: String::new(),
            stations: (0..count).map(station).collect(),
            closed: count == 36,
            confidence: 0.9,
            expected_error_mm: 0.1,
            expected_error_deg: 0.1,
            relative_error_mm: 0.1,
            error_parts: ErrorParts::of_noise(0.1),
            base_error_mm: 0.1,
            base_error_deg: 0.1,
            contact: None,
            drawn: false,
            dimensions: Vec::new(),
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_piece_of_the_inner_foot_of_a_closed_wall_is_no_seam_and_all_else_is() {
        let left = |seams: &[Seam]| {
            let mut seams = seams.to_vec();
            let told = inner_feet(&mut seams);
            assert!(told.iter().all(|corner| corner.reason == WhyUnwelded::InnerFoot));
            (seams.len(), told.len())
        };
        let outer = foot(45.0, 36, 1.0);
        assert_eq!(left(&[outer.clone(), foot(40.0, 12, -1.0)]), (1, 1), "seen over the rim");
        assert_eq!(left(&[outer.clone(), foot(40.0, 36, -1.0)]), (2, 0), "the whole of it");
        assert_eq!(left(&[foot(45.0, 20, 1.0), foot(40.0, 12, -1.0)]), (2, 0), "an open wall");
        assert_eq!(left(&[outer.clone(), foot(60.0, 12, -1.0)]), (2, 0), "a wall round it that looks at it");
        assert_eq!(left(&[outer, foot(10.0, 12, 1.0)]), (2, 0), "a post in it");
    }

    #[test]
    fn what_runs_beside_a_seam_or_is_short_is_not_told() {
        let line = |from_mm: f64, to_mm: f64| Unwelded {
            line_mm: (0..=20)
                .map(|k| Point3::new(from_mm + (to_mm - from_mm) * f64::from(k) / 20.0, 0.0, 0.0))
                .collect(),
            reason: WhyUnwelded::InnerFoot,
            words: String::new(),
        };
        let seam = Seam { stations: Vec::new(), ..foot(45.0, 1, 1.0) };
        let told = told(vec![line(0.0, 100.0), line(20.0, 80.0), line(200.0, 210.0)], &[seam], 1.2);
        assert_eq!(told.len(), 1);
        assert!((told[0].length_mm() - 100.0).abs() < 1e-9);
        assert!(told[0].words.contains("--ask \"0,0,0;100,0,0\""), "{}", told[0].words);
        let beside = Seam { stations: foot(45.0, 1, 1.0).stations, ..foot(45.0, 1, 1.0) };
        let cut = super::told(vec![line(0.0, 100.0)], &[beside], 1.2);
        assert!(cut[0].length_mm() < 56.0, "cut where the seam is: {}", cut[0].length_mm());
    }
}
