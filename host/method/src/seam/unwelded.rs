//! Inside corners that are seen and not offered as seams (ours): where they run, and why not. Nothing vanishes without a word.

use super::Seam;
use super::trace::{Chain, ChainLink};
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
    /// Nobody knows which side of its faces is air.
    UnknownSide,
    /// It is rounded, and its faces are not seen well enough beyond the rounding.
    Rounded,
    /// Its faces would meet there if they went on: the corner itself was hardly seen.
    Implied,
}

/// An inside corner that is seen and not offered as a seam.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Unwelded {
    /// Places along it, mm, base frame.
    pub line_mm: Vec<Point3<f64>>,
    /// Where the air is from each of them, midway between its faces; not a unit vector. Corners on both sides of a wall are near to each
    /// other, and two.
    pub air: Vec<Vector3<f64>>,
    /// Why.
    pub reason: WhyUnwelded,
    /// The same in words.
    pub words: String,
}

impl Unwelded {
    /// A seam that was found and is not offered.
    pub(super) fn of(seam: &Seam, reason: WhyUnwelded, words: String) -> Self {
        let (line_mm, air) = seam.places().unzip();
        Self { line_mm, air, reason, words }
    }

    /// Corners that were strung together and made no seam; `origin_mm` is that of the scan.
    pub(super) fn of_chain(chain: &Chain, origin_mm: &Point3<f64>, reason: WhyUnwelded) -> Self {
        let place = |link: &ChainLink| {
            let air = link.faces[0] + link.faces[1];
            (origin_mm + link.position.coords.cast::<f64>(), air.cast::<f64>())
        };
        let (line_mm, air) = chain.links.iter().map(place).unzip();
        Self { line_mm, air, reason, words: String::new() }
    }

    pub(super) fn in_words(&self) -> String {
        let why = match self.reason {
            WhyUnwelded::Table => "is where the work rests on the table",
            WhyUnwelded::Implied => {
                "is where two faces would meet, but the corner itself was hardly seen: scan it again from nearer, or from \
                 where both faces show"
            }
            WhyUnwelded::Rounded => {
                "is rounded, in the scan or in the work, and too little is seen of its faces beyond the rounding to fit a seam to it: \
                 scan it again from nearer"
            }
            _ => {
                "is seen too thinly, or too blurred, to fit a seam to it: scan it again from nearer, or from more sides"
            }
        };
        let place = |p: &Point3<f64>| format!("{:.0},{:.0},{:.0}", p.x, p.y, p.z);
        let middle = self.line_mm.get(self.line_mm.len() / 2).map(place).unwrap_or_default();
        format!("an inside corner of {:.0} mm near {middle} {why}", self.length_mm())
    }

    /// Its stretches whose places are free, if they are long enough to be told.
    pub(super) fn stretches(
        &self,
        voxel_mm: f64,
        is_free: impl Fn(&Point3<f64>, &Vector3<f64>) -> bool,
    ) -> Vec<Self> {
        let places: Vec<_> =
            self.line_mm.iter().zip(&self.air).map(|(p, air)| (p, air, is_free(p, air))).collect();
        let runs = places.chunk_by(|a, b| a.2 == b.2).filter(|run| run[0].2);
        let stretch = |run: &[(&Point3<f64>, &Vector3<f64>, bool)]| {
            let (line_mm, air) = run.iter().map(|(place, air, _)| (**place, **air)).unzip();
            Self { line_mm, air, ..self.clone() }
        };
        let told = |stretch: &Self| stretch.length_mm() >= LEAST_MM.max(LEAST_VOXELS * voxel_mm);
        runs.map(stretch).filter(told).collect()
    }

    /// Its places, and the air there.
    pub(super) fn places(&self) -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> {
        self.line_mm.iter().copied().zip(self.air.iter().copied())
    }

    /// Length along its places, mm.
    pub fn length_mm(&self) -> f64 {
        self.line_mm.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }
}

/// Lines that are told are at least so long, mm, and this many voxels.
const LEAST_MM: f64 = 15.0;
const LEAST_VOXELS: f64 = 10.0;
/// A line this near to another is the same corner, voxels; one that is implied by faces, mm at least: as far as a tilt of
/// either that noise explains takes it.
const SAME_VOXELS: f64 = 3.0;
const SAME_IMPLIED_MM: f64 = 6.0;
/// Cosine between the airs of two lines that may be one corner: those of corners at both sides of a wall differ by a right angle.
const ONE_AIR: f64 = 0.5;

/// The lines without what runs beside seams or beside lines before them, those that are implied last; of that, each run that is
/// long enough to be told.
pub(super) fn told(
    lines: Vec<Unwelded>,
    implied: Vec<Unwelded>,
    seams: &[Seam],
    voxel_mm: f64,
) -> Vec<Unwelded> {
    let mut told = Told::besides(Vec::new(), seams, voxel_mm);
    lines.iter().for_each(|line| told.add(line, SAME_VOXELS * voxel_mm));
    told.add_loosely(&implied);
    told.lines
}

/// Some more lines beside those that are told, as [`told`] takes those that are implied.
pub(super) fn told_besides(
    told: Vec<Unwelded>,
    more: &[Unwelded],
    seams: &[Seam],
    voxel_mm: f64,
) -> Vec<Unwelded> {
    let mut told = Told::besides(told, seams, voxel_mm);
    told.add_loosely(more);
    told.lines
}

struct Told {
    /// Places of seams and of lines that are told, and the air there.
    known: Vec<(Point3<f64>, Vector3<f64>)>,
    lines: Vec<Unwelded>,
    voxel_mm: f64,
}

impl Told {
    fn besides(lines: Vec<Unwelded>, seams: &[Seam], voxel_mm: f64) -> Self {
        let known =
            seams.iter().flat_map(Seam::places).chain(lines.iter().flat_map(Unwelded::places)).collect();
        Self { known, lines, voxel_mm }
    }

    /// Adds lines of which it is not known as well where they run.
    fn add_loosely(&mut self, lines: &[Unwelded]) {
        let near_mm = (SAME_VOXELS * self.voxel_mm).max(SAME_IMPLIED_MM);
        lines.iter().for_each(|line| self.add(line, near_mm));
    }

    fn add(&mut self, line: &Unwelded, near_mm: f64) {
        let is_one =
            |air: &Vector3<f64>, other: &Vector3<f64>| air.dot(other) > ONE_AIR * air.norm() * other.norm();
        let is_free = |p: &Point3<f64>, air: &Vector3<f64>| {
            self.known.iter().all(|(q, other)| (p - q).norm() > near_mm || !is_one(air, other))
        };
        for mut part in line.stretches(self.voxel_mm, is_free) {
            if part.words.is_empty() {
                part.words = part.in_words();
            }
            self.known.extend(part.places());
            self.lines.push(part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_runs_beside_another_or_is_short_is_not_told() {
        let line = |from_mm: f64, to_mm: f64| Unwelded {
            line_mm: (0..=20)
                .map(|k| Point3::new(from_mm + (to_mm - from_mm) * f64::from(k) / 20.0, 0.0, 0.0))
                .collect(),
            air: vec![Vector3::z(); 21],
            reason: WhyUnwelded::Table,
            words: String::new(),
        };
        let told = told(vec![line(0.0, 100.0), line(20.0, 80.0), line(200.0, 210.0)], vec![], &[], 1.2);
        assert_eq!(told.len(), 1);
        let behind = |line: Unwelded| Unwelded { air: vec![Vector3::x(); 21], ..line };
        let both = super::told(vec![line(0.0, 100.0), behind(line(20.0, 80.0))], vec![], &[], 1.2);
        assert_eq!(both.len(), 2, "at the other side of a wall is another");
        let besides = told_besides(both, &[line(20.0, 80.0), line(90.0, 140.0)], &[], 1.2);
        assert_eq!(besides.len(), 3, "what runs on is told where it is alone");
        let cut = super::told(vec![line(40.0, 60.0), line(0.0, 100.0)], vec![], &[], 1.2);
        assert_eq!(cut.len(), 3);
        for part in &cut[1..] {
            let length_mm = part.length_mm();
            assert!((30.0..36.5).contains(&length_mm), "cut where another is: {length_mm}");
        }
        assert!((told[0].length_mm() - 100.0).abs() < 1e-9);
        assert!(told[0].words.contains("100 mm near 50,0,0"), "{}", told[0].words);
    }
}
