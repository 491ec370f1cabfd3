//! Parametric workpieces: their solids, their seams in truth, and from where a camera sees them well.
//!
//! Piece frame: z up out of the base plate, z = 0 its underside, x along the main seam, the camera's side at -y.
//! Millimetres; sizes are drawn from the seed.

mod grooves;
mod plates;
mod round;
mod scenes;
mod tubes;
mod webs;

use super::random::Stream;
use super::rotation::sin_cos_deg;
use super::solid::Solid;
use super::{Part, Request};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeMap;

/// A workpiece in its own frame.
#[derive(Debug, Clone)]
pub(super) struct Workpiece {
    pub(super) solids: Vec<Solid>,
    pub(super) seams: Vec<TrueSeam>,
    pub(super) views: Views,
    /// The last so many solids only hold the work.
    pub(super) holding: usize,
    /// What was drawn, by name, mm or degrees.
    pub(super) drawn: BTreeMap<&'static str, f64>,
}

/// A seam as it is.
#[derive(Debug, Clone)]
pub(super) struct TrueSeam {
    pub(super) name: String,
    pub(super) closed: bool,
    /// Whether the cameras are placed to see it, so that it must be found.
    pub(super) required: bool,
    pub(super) stations: Vec<TrueStation>,
}

/// One place on a seam.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrueStation {
    /// Where the two faces meet.
    pub(super) apex: Point3<f64>,
    /// Centre of the root opening; the apex where there is none.
    pub(super) root: Point3<f64>,
    pub(super) tangent: Vector3<f64>,
    /// Normals of the two faces, out of the material.
    pub(super) faces: [Vector3<f64>; 2],
}

/// From where a piece is scanned.
#[derive(Debug, Clone)]
pub(super) enum Views {
    /// All round at equal steps, beginning with this one; this many unless the request says otherwise.
    Ring(Viewpoint, usize),
    /// These, the most telling first.
    List(Vec<Viewpoint>),
}

/// From where to look at the piece, before jitter.
#[derive(Debug, Clone, Copy)]
pub(super) struct Viewpoint {
    /// From x towards y.
    pub(super) azimuth_deg: f64,
    pub(super) elevation_deg: f64,
    pub(super) distance_mm: f64,
    pub(super) target: Point3<f64>,
}

impl Workpiece {
    /// The piece of a request; the same seed gives the same piece.
    pub(super) fn of(request: &Request) -> Self {
        let mut draw =
            Draw { random: Stream::new(request.seed, request.part.name(), 0), drawn: BTreeMap::new() };
        let mut piece = match request.part {
            Part::Fillet => webs::fillet(&mut draw, request),
            Part::Branch => webs::branch(&mut draw, request.weak),
            Part::Tacked => webs::tacked(&mut draw, request.weak),
            Part::Cruciform => webs::cruciform(&mut draw),
            Part::Lap => plates::lap(&mut draw, request),
            Part::Corner => plates::corner(&mut draw, request.length_mm),
            Part::Plate => plates::plate(&mut draw),
            Part::Box => plates::block(&mut draw),
            Part::RoundLap => round::round_lap(&mut draw),
            Part::Boss => round::boss(&mut draw),
            Part::Pipe => round::pipe(&mut draw),
            Part::Saddle => round::saddle(&mut draw, request.angle_deg),
            Part::SquareTube => tubes::square_tube(&mut draw),
            Part::Elbow => tubes::elbow(&mut draw),
            Part::Several => scenes::several(&mut draw),
            Part::Vise => scenes::vise(&mut draw),
            Part::HalfV => grooves::half_v(&mut draw, request),
            Part::ButtV => grooves::butt_v(&mut draw, request),
            Part::Scurve => grooves::scurve(&mut draw, request.angle_deg.unwrap_or(60.0)),
        };
        piece.drawn = draw.drawn;
        piece
    }

    /// What only holds the work.
    pub(super) fn without_work(mut self) -> Self {
        self.solids.drain(..self.solids.len() - self.holding);
        self.seams.clear();
        self
    }

    fn new(solids: Vec<Solid>, seams: Vec<TrueSeam>, views: Views) -> Self {
        Self { solids, seams, views, holding: 0, drawn: BTreeMap::new() }
    }
}

/// Draws sizes and remembers them.
struct Draw {
    random: Stream,
    drawn: BTreeMap<&'static str, f64>,
}

impl Draw {
    fn between(&mut self, name: &'static str, low: f64, high: f64) -> f64 {
        let value = self.random.between(low, high);
        self.given(name, value)
    }

    /// What is asked for; drawn otherwise. Later draws are the same either way.
    fn between_or(&mut self, name: &'static str, [low, high]: [f64; 2], asked: Option<f64>) -> f64 {
        let drawn = self.random.between(low, high);
        self.given(name, asked.unwrap_or(drawn))
    }

    fn given(&mut self, name: &'static str, value: f64) -> f64 {
        self.drawn.insert(name, value);
        value
    }
}

impl TrueSeam {
    /// Straight from `a` to `b` between two flat faces, a station every millimetre or so.
    fn straight(
        name: &str,
        a: Point3<f64>,
        b: Point3<f64>,
        faces: [Vector3<f64>; 2],
        required: bool,
    ) -> Self {
        let along = b - a;
        let steps = along.norm().round().max(1.0);
        let station = |i: usize| {
            let apex = a + along * (i as f64 / steps);
            TrueStation { apex, root: apex, tangent: along.normalize(), faces }
        };
        let stations = (0..=steps as usize).map(station).collect();
        Self { name: name.into(), closed: false, required, stations }
    }

    /// The same with its root opening `root_mm` above the apex along the bisector.
    fn with_root(mut self, root_mm: f64) -> Self {
        for station in &mut self.stations {
            station.root = station.apex + station.torch() * root_mm;
        }
        self
    }

    /// The same with one member standing off the other by `opening` at the root.
    fn with_opening(mut self, opening: Vector3<f64>) -> Self {
        for station in &mut self.stations {
            station.root = station.apex + 0.5 * opening;
        }
        self
    }

    /// A horizontal circle between an upright cylinder and a flat face below it, counter-clockwise.
    fn circle(name: &str, centre: Point3<f64>, radius: f64, outside: bool, required: bool) -> Self {
        let count = (2.0 * std::f64::consts::PI * radius).round().max(8.0);
        let station = |i: usize| {
            let (sin, cos) = sin_cos_deg(360.0 * i as f64 / count);
            let radial = Vector3::new(cos, sin, 0.0);
            let apex = centre + radial * radius;
            let wall = if outside { radial } else { -radial };
            TrueStation {
                apex,
                root: apex,
                tangent: Vector3::new(-sin, cos, 0.0),
                faces: [wall, Vector3::z()],
            }
        };
        let stations = (0..count as usize).map(station).collect();
        Self { name: name.into(), closed: true, required, stations }
    }

    /// A closed seam from its stations at shares of one turn, resampled to a station every millimetre or so.
    fn closed(name: &str, at: impl Fn(f64) -> TrueStation) -> Self {
        let fine: Vec<TrueStation> = (0..7200).map(|i| at(f64::from(i) / 7200.0)).collect();
        let mut lengths = vec![0.0];
        for pair in fine.windows(2) {
            lengths.push(lengths[lengths.len() - 1] + (pair[1].apex - pair[0].apex).norm());
        }
        let total = lengths[fine.len() - 1] + (fine[0].apex - fine[fine.len() - 1].apex).norm();
        let count = total.round();
        let station = |i: usize| {
            let s = total * i as f64 / count;
            fine[lengths.partition_point(|l| *l < s).min(fine.len() - 1)]
        };
        let stations = (0..count as usize).map(station).collect();
        Self { name: name.into(), closed: true, required: true, stations }
    }

    /// The seam in the frame `to_from`.
    pub(super) fn moved(&self, to_from: &Isometry3<f64>) -> Self {
        let station = |s: &TrueStation| TrueStation {
            apex: to_from * s.apex,
            root: to_from * s.root,
            tangent: to_from.rotation * s.tangent,
            faces: s.faces.map(|n| to_from.rotation * n),
        };
        Self { stations: self.stations.iter().map(station).collect(), ..self.clone() }
    }

    /// Mean angle between the faces through the air, degrees.
    pub(super) fn included_deg(&self) -> f64 {
        let angle = |s: &TrueStation| 180.0 - s.faces[0].angle(&s.faces[1]).to_degrees();
        let sum: f64 = self.stations.iter().map(angle).sum();
        sum / self.stations.len().max(1) as f64
    }
}

impl TrueStation {
    /// Torch direction out of the work: the bisector of the faces.
    pub(super) fn torch(&self) -> Vector3<f64> {
        (self.faces[0] + self.faces[1]).normalize()
    }
}

impl Views {
    /// `count` viewpoints, or as many as the piece needs.
    pub(super) fn take(&self, count: Option<usize>) -> Vec<Viewpoint> {
        match self {
            Self::Ring(first, usual) => {
                let count = count.unwrap_or(*usual);
                let turned = |i: usize| first.azimuth_deg + 360.0 * i as f64 / count as f64;
                (0..count).map(|i| Viewpoint { azimuth_deg: turned(i), ..*first }).collect()
            }
            // A second round through the list stands between the places of the first.
            Self::List(list) => (0..count.unwrap_or(list.len()))
                .map(|i| (list[i % list.len()], (i / list.len()) as f64))
                .map(|(v, round)| Viewpoint { azimuth_deg: v.azimuth_deg + 9.0 * round, ..v })
                .collect(),
        }
    }
}

/// Viewpoints all round at the same elevation; the first at `first_deg`.
fn ring(views: usize, first_deg: f64, elevation_deg: f64, distance_mm: f64, target: Point3<f64>) -> Views {
    Views::Ring(Viewpoint { azimuth_deg: first_deg, elevation_deg, distance_mm, target }, views)
}

/// Viewpoints given as (azimuth, elevation, distance) about one target.
fn around(target: Point3<f64>, places: &[[f64; 3]]) -> Views {
    let viewpoint =
        |p: &[f64; 3]| Viewpoint { azimuth_deg: p[0], elevation_deg: p[1], distance_mm: p[2], target };
    Views::List(places.iter().map(viewpoint).collect())
}
