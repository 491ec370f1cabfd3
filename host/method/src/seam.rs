//! Seams: what they are, and how they are found in a cloud.
//!
//! | room | what happens there | paper |
//! |---|---|---|
//! | [`input`] | what the steps before hand over | |
//! | [`score`] | how much of an edge each point is | II-E, eqs. (11)-(17) |
//! | [`trace`] | corners of two faces at the best scored points, strung together | ours |
//! | [`refine`] | each chain fitted anew to the raw points, below the voxel | ours |
//! | [`measure`] | kind of joint, fit-up, and how well the seam was seen | ours |
//! | [`extraction`] | the rooms in a row: seams of a cloud | II-E, and beyond it |
//! | [`segmentation`] | surfaces and their borders, for whoever looks at the scan | ours |
//! | [`asked`] | a seam that the search passed over, where a person clicked | ours |
//! | [`drawn`] | a line that a person draws on the surface | ours |
//! | [`facets`] | seams of a mesh, from its facets | ours |
//!
//! Of the paper's edge score the default takes the intensity, eqs. (11) and (12), with a gate of its own; the ratio test,
//! eqs. (13)-(17), is [`score::paper`].

pub mod asked;
mod confidence;
mod description;
pub mod drawn;
mod error;
pub mod extraction;
pub mod facets;
mod implied;
pub mod input;
pub(crate) mod joined;
pub mod measure;
mod ordering;
mod radius;
pub mod refine;
mod rounded;
pub mod score;
pub mod segmentation;
pub(crate) mod surfaces;
pub mod trace;
mod unwelded;

pub use error::{ErrorParts, FitError};
pub use input::{Cues, INDEX_VOXELS, Input, RawScan, SurfaceModel};
pub use unwelded::{Unwelded, WhyUnwelded};

use crate::model::orientation::Orientation;
use measure::dimension::Dimension;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use segmentation::Segmentation;
use serde::{Deserialize, Serialize};
use trace::chain::TraceConfig;
use trace::support::Support;
use trace::{Chain, InsideCorner};

/// Joint type of a seam; the names are the same in files, options and messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Joint {
    /// Two bevels that meet below the surface of the plates.
    ButtV,
    /// Two faces of different members at an inside corner.
    Fillet,
    /// The edge of a plate that lies on another.
    Lap,
    /// The outside corner of two plates: both faces are plate edges.
    Corner,
    /// A tube that stands on a flat face: a closed fillet.
    Pipe,
    /// A tube that stands on a curved face: a closed fillet off the plane.
    Saddle,
    /// A seam that meets others in a junction.
    Branch,
}

impl Joint {
    /// The name used in every file, option and message.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ButtV => "butt-v",
            Self::Fillet => "fillet",
            Self::Lap => "lap",
            Self::Corner => "corner",
            Self::Pipe => "pipe",
            Self::Saddle => "saddle",
            Self::Branch => "branch",
        }
    }

    /// Whether the members lie side by side in one surface: the positions of fillets, PB and PD, are none of theirs.
    pub const fn is_butt(self) -> bool {
        match self {
            Self::ButtV => true,
            Self::Fillet | Self::Lap | Self::Corner | Self::Pipe | Self::Saddle | Self::Branch => false,
        }
    }
}

/// One place on a seam.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Station {
    /// Where the two adjoining faces meet, mm, base frame.
    pub position_mm: Point3<f64>,
    /// Unit tangent, in the direction of the weld.
    pub tangent: Vector3<f64>,
    /// Unit normals of the two adjoining faces, out of the material. Their bisector is the torch direction.
    pub faces: [Vector3<f64>; 2],
}

impl Station {
    /// Where it is about an origin, mm.
    pub(crate) fn about(&self, origin_mm: &Point3<f64>) -> Point3<f32> {
        Point3::from((self.position_mm - origin_mm).cast::<f32>())
    }

    /// Where the air is, midway between the faces: twice as long as the sine of half the angle between them.
    fn air(&self) -> Vector3<f64> {
        self.faces[0] + self.faces[1]
    }

    /// Bisector of the faces, out of the work: where the torch points to. None of faces that look away from each other.
    pub(crate) fn bisector(&self) -> Option<Vector3<f64>> {
        self.air().try_normalize(LEAST_BISECTOR)
    }
}

/// What else than a joint two faces that meet may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Contact {
    /// The work is held there, or it is of what holds it.
    Held,
    /// The work rests there on a table: one view does not tell the two from a web on its plate.
    Table,
    /// The faces turn into each other over a radius: of a rolled or bent section, or of a finished bead.
    Radius,
}

impl Contact {
    /// The same in words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Held => {
                "it may be a contact with the fixture: the faces on both sides of the work face each other, and nothing else connects \
                 them to it"
            }
            Self::Table => {
                "it may be where the work rests on the table: one of its faces extends beyond the other part on all sides, or out of \
                 the picture below it, and nothing was seen close below"
            }
            Self::Radius => {
                "it may be the inside radius of a rolled or bent section, or a finished bead: its faces turn into each other over some \
                 millimetres, and other corners of the scan are sharp"
            }
        }
    }
}

/// A weldable seam, ordered as it is welded.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Seam {
    /// 1, 2, ... in the order in which the seams are offered.
    pub id: usize,
    /// What kind of joint.
    pub joint: Joint,
    /// Why this joint type, in words.
    pub reason: String,
    /// Stations in weld order; a closed seam does not repeat its first.
    pub stations: Vec<Station>,
    /// Whether the last station is followed by the first.
    pub closed: bool,
    /// 0..1: the probability that this is a weld, within twice its stated error.
    pub confidence: f64,
    /// Expected RMSE of the position across the seam, mm.
    pub expected_error_mm: f64,
    /// Expected RMSE of the torch orientation, degrees.
    pub expected_error_deg: f64,
    /// Expected RMSE across the seam relative to the views that saw it, mm: how well it is known on the part, wherever the part
    /// may be.
    pub relative_error_mm: f64,
    /// What comes from where.
    pub error_parts: ErrorParts,
    /// By which it was judged whether it is a seam.
    pub fit_error: FitError,
    /// One standard deviation of the position across the seam in the robot's base frame, both axes together, mm: the error
    /// within the scan, and that of the frame. Not a number where nothing is known of the frame.
    pub base_error_mm: f64,
    /// The same of the torch orientation, degrees.
    pub base_error_deg: f64,
    /// Why it may be a contact, and not to be welded.
    pub contact: Option<Contact>,
    /// Whether a person drew it, and nothing that was found bears it out.
    pub drawn: bool,
    /// What was measured of the joint.
    pub dimensions: Vec<Dimension>,
    /// What the user should know about this seam.
    pub warnings: Vec<String>,
}

impl Seam {
    /// Marks it as what may be a contact.
    pub(crate) fn mark_contact(&mut self, contact: Contact) {
        self.contact = Some(contact);
        self.be_at_most(confidence::CONTACT);
    }

    fn be_at_most(&mut self, confidence: f64) {
        self.confidence = self.confidence.min(confidence);
    }

    /// Length along the stations, mm.
    pub fn length_mm(&self) -> f64 {
        let open: f64 = self.stations.windows(2).map(|w| (w[1].position_mm - w[0].position_mm).norm()).sum();
        match (self.closed, self.stations.first(), self.stations.last()) {
            (true, Some(first), Some(last)) => open + (first.position_mm - last.position_mm).norm(),
            _ => open,
        }
    }

    /// Its places, and the air there.
    fn places(&self) -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> {
        self.stations.iter().map(|station| (station.position_mm, station.air()))
    }

    /// One standard deviation of the tip across the seam, mm: in the robot's base frame where that is known, else against the
    /// first view.
    pub fn tip_error_mm(&self) -> f64 {
        if self.base_error_mm.is_finite() { self.base_error_mm } else { self.expected_error_mm }
    }

    /// The same of the torch orientation, degrees.
    pub fn tip_error_deg(&self) -> f64 {
        if self.base_error_deg.is_finite() { self.base_error_deg } else { self.expected_error_deg }
    }

    /// What is left of it without the stations that are out.
    pub(crate) fn stretches(&self, is_out: impl Fn(&Station) -> bool) -> Vec<Self> {
        let out: Vec<bool> = self.stations.iter().map(is_out).collect();
        let Some(first) = out.iter().position(|out| *out) else { return vec![self.clone()] };
        let mut stations: Vec<_> = self.stations.iter().zip(&out).collect();
        if self.closed {
            stations.rotate_left(first);
        }
        let runs = stations.split(|(_, out)| **out);
        let left = runs.map(|run| Self {
            stations: run.iter().map(|(station, _)| **station).collect(),
            closed: false,
            ..self.clone()
        });
        left.filter(|seam| seam.length_mm() >= SHORTEST_MM).collect()
    }

    /// Whether a place is on it.
    pub(crate) fn is_at(&self, place_mm: &Point3<f64>) -> bool {
        self.stations.iter().any(|station| (station.position_mm - place_mm).norm() < AT_MM)
    }

    /// What one that is not offered is called: its length, of less than 10 mm to a tenth, and the place of its middle.
    fn as_inside_corner(&self) -> String {
        let place = self.stations.get(self.stations.len() / 2).map_or(Point3::origin(), |s| s.position_mm);
        let decimals = usize::from(self.length_mm() < 10.0);
        format!(
            "an inside corner of {:.decimals$} mm near {:.0},{:.0},{:.0}",
            self.length_mm(),
            place.x,
            place.y,
            place.z
        )
    }
}

#[cfg(test)]
impl Seam {
    /// One of these stations of which nothing else matters.
    pub(crate) fn through(stations: Vec<Station>) -> Self {
        Self {
            id: 1,
            joint: Joint::Fillet,
            reason: String::new(),
            stations,
            closed: false,
            confidence: 1.0,
            expected_error_mm: 0.0,
            expected_error_deg: 0.0,
            relative_error_mm: 0.0,
            error_parts: ErrorParts {
                noise_mm: 0.0,
                registration_mm: 0.0,
                calibration_mm: 0.0,
                corner_mm: 0.0,
                touch_mm: 0.0,
            },
            fit_error: FitError::default(),
            base_error_mm: 0.0,
            base_error_deg: 0.0,
            contact: None,
            drawn: false,
            dimensions: Vec::new(),
            warnings: Vec::new(),
        }
    }
}

/// Shorter sums of two unit normals have no direction.
const LEAST_BISECTOR: f64 = 1e-6;
/// What is left of a seam that is cut is one if it is as long as the shortest of a mesh, mm.
const SHORTEST_MM: f64 = 6.0;
/// A place nearer to a station than this is on the seam, mm: about the distance of stations.
const AT_MM: f64 = 3.0;

/// Seams and what was left out on the way.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// In the order of the weld, numbered from 1.
    pub seams: Vec<Seam>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Inside corners that are seen and are none of these.
    pub unwelded: Vec<Unwelded>,
    /// Why there is no seam, if there is none.
    pub reason: String,
    /// Whether the air side of the faces is assumed, as the cloud looks nearly alike from both.
    pub orientation_assumed: bool,
    /// The table that the work stands on, about the origin of the scan.
    pub(crate) table: Option<Support>,
    /// How far parts of faces are off them, beyond what noise explains: one standard deviation, mm.
    pub waves_mm: f32,
    /// Intensity gate, for the report.
    pub gate: f32,
    /// Edge intensity of each point of the model, for the report.
    pub intensity: Vec<f32>,
}

/// How far from a seam the side of its faces is looked up, voxels.
const SIDES_VOXELS: f32 = 4.0;

impl Found {
    /// Leaves out the seams on faces of which nobody knows the air side, and says so; is less sure of all where it is assumed.
    /// `oriented` is of the model.
    pub(crate) fn only_oriented(&mut self, oriented: &Orientation, model: &SurfaceModel) {
        self.warnings.extend(oriented.words());
        self.orientation_assumed = oriented.assumed;
        let unknown = |station: &Station| {
            let at = Point3::from((station.position_mm - model.cloud.origin_mm).cast::<f32>());
            model.nearest(&at, SIDES_VOXELS).is_some_and(|point| oriented.unknown[point])
        };
        let known = |seam: &Seam| {
            2 * seam.stations.iter().filter(|station| unknown(station)).count() <= seam.stations.len()
        };
        let (known, unknown): (Vec<_>, Vec<_>) = std::mem::take(&mut self.seams).into_iter().partition(known);
        let words: Vec<String> = unknown.iter().map(side_unknown).collect();
        if let (true, Some(first)) = (known.is_empty(), words.first()) {
            self.reason.clone_from(first);
        }
        let both = unknown.iter().zip(&words);
        self.unwelded
            .extend(both.map(|(seam, words)| Unwelded::of(seam, WhyUnwelded::UnknownSide, words.clone())));
        self.warnings.extend(words);
        self.seams = known;
        if oriented.assumed {
            self.seams.iter_mut().for_each(|seam| seam.be_at_most(confidence::SIDE_ASSUMED));
        }
        (1..).zip(&mut self.seams).for_each(|(id, seam)| seam.id = id);
    }
}

impl Found {
    /// Tells the inside corners and low steps between surfaces that make no seam and are not told yet, but for those on the table: a table
    /// that waves has many.
    pub(crate) fn tell_borders(
        &mut self,
        segmentation: &Segmentation,
        model: &SurfaceModel,
        config: &TraceConfig,
        is_sided: impl Fn(&Point3<f32>) -> bool,
    ) {
        let had_none = self.unwelded.is_empty();
        let is_asked = |corner: &InsideCorner| {
            let is_face =
                |table: &Support| corner.faces.iter().any(|face| table.is_face(face, &corner.position));
            !self.table.as_ref().is_some_and(is_face) && is_sided(&corner.position)
        };
        let mut chains = segmentation.lines(model, &config.faint(), is_asked);
        chains.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
        let line = |chain: &Chain| Unwelded::of_chain(chain, &model.cloud.origin_mm, WhyUnwelded::Unsure);
        let lines: Vec<_> = chains.iter().map(line).collect();
        let told = std::mem::take(&mut self.unwelded);
        self.unwelded = unwelded::told_besides(told, &lines, &self.seams, model.voxel_mm().into());
        if let (true, true, Some(first)) = (had_none, self.seams.is_empty(), self.unwelded.first()) {
            self.reason.clone_from(&first.words);
        }
    }
}

fn side_unknown(seam: &Seam) -> String {
    format!(
        "{} is not offered: it is unknown which side of its faces is air; give the views with their poses, or a cloud with \
         normals",
        seam.as_inside_corner()
    )
}
