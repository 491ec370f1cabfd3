//! What can be asked of the simulator, and what is wrong with a request.

use super::named::named;
use super::noise::Noise;
use super::sensor::SensorErrors;
use serde::{Deserialize, Serialize};

named! {
    "part":
    /// The workpieces.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    pub enum Part {
        /// T joint, 300 mm; its web may lean.
        Fillet = "fillet",
        /// Plate on plate, 300 mm.
        Lap = "lap",
        /// Disc on plate: a closed lap joint.
        RoundLap = "round-lap",
        /// Boss, a low cylinder, on a plate: one closed seam.
        Boss = "boss",
        /// Outside corner of two plates, 250 mm.
        Corner = "corner",
        /// Pipe on plate.
        Pipe = "pipe",
        /// Square tube with round corners on a plate: one closed seam.
        SquareTube = "square-tube",
        /// Pipe bend whose straight leg stands on a plate: one closed seam.
        Elbow = "elbow",
        /// V groove between two plates, 500 mm.
        ButtV = "butt-v",
        /// Half-V groove, 500 mm: one plate bevelled, the other square.
        HalfV = "half-v",
        /// Branch pipe on a main pipe; it may lean.
        Saddle = "saddle",
        /// Three webs at 120 degrees on a plate: six seams in two pockets.
        Branch = "branch",
        /// Block and rib on a plate.
        Tacked = "tacked",
        /// V groove along an S with a crown.
        Scurve = "scurve",
        /// Two webs that cross, on a plate: twelve seams in four pockets.
        Cruciform = "cruciform",
        /// T joint, boss and square tube apart from each other on the table.
        Several = "several",
        /// T joint held by its plate between the jaws of a vise, whose contacts are no seams.
        Vise = "vise",
        /// A plate with two holes: nothing to weld.
        Plate = "plate",
        /// A block on the table: nothing to weld.
        Box = "box",
    }
}

named! {
    "pose":
    /// How the piece lies.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    pub enum Pose {
        /// On the table (PA, PB).
        Flat = "flat",
        /// Inclined by 30 degrees.
        Tilted = "tilted",
        /// Upright, main seam level (PC).
        Horizontal = "horizontal",
        /// Upright, main seam rising (PF).
        Vertical = "vertical",
    }
}

named! {
    "format":
    /// How views are stored.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    pub enum Format {
        /// 16-bit depth images.
        Png = "png",
        /// Binary PLY clouds in the camera frame.
        Ply = "ply",
    }
}

/// How a cell errs: the camera is not where the hand-eye transform says, and no pose of the robot is exact.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CellErrors {
    /// Length of the camera's shift on the flange, mm; its direction follows from the seed.
    pub hand_eye_mm: f64,
    /// Angle of its turn, degrees.
    pub hand_eye_deg: f64,
    /// One standard deviation of a reported position, each axis, mm.
    pub robot_mm: f64,
    /// The same of an orientation, degrees.
    pub robot_deg: f64,
    /// Whether the camera of the first view is exactly where its pose says, all the same.
    pub first_exact: bool,
    /// Scans with the same number are of one cell: the directions of hand-eye error and optical axis follow from it; from
    /// the scan's own seed if not given.
    pub seed: Option<u64>,
}

/// Length of a fillet if not told otherwise, mm.
pub(super) const FILLET_MM: f64 = 300.0;
/// Shortest and longest tack, mm.
pub(super) const TACK_MM: [f64; 2] = [10.0, 20.0];

/// Short beads on the line of a joint; 10 to 20 mm long, at equal steps give or take a tenth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tacks {
    /// How many.
    pub count: usize,
    /// Leg of a bead on either face, mm.
    pub leg_mm: f64,
}

/// A scan to simulate.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The workpiece.
    pub part: Part,
    /// How it lies.
    pub pose: Pose,
    /// How many views; as many as the piece needs if not given.
    pub views: Option<usize>,
    /// How noisy the camera is.
    pub noise: Noise,
    /// Sizes, places and noise follow from it.
    pub seed: u64,
    /// Columns of a depth image.
    pub width: u32,
    /// Rows of a depth image.
    pub height: u32,
    /// Place the cameras badly on purpose: views that share too little. For `branch` and `tacked`.
    pub weak: bool,
    /// Leave the work out: what is there before it, from the same places.
    pub empty: bool,
    /// How views are stored.
    pub format: Format,
    /// Included angle of a groove, angle between plate and web of a fillet, or between the pipes of a saddle, degrees; 60
    /// (50 of a half-V) and 90 if not given.
    pub angle_deg: Option<f64>,
    /// Length of a straight seam, mm, for `fillet`, `lap`, `corner`, `butt-v`, `half-v`.
    pub length_mm: Option<f64>,
    /// Thickness of both members, mm, for `fillet`, `lap`, `butt-v`, `half-v`; drawn from 7 to 10 if not given.
    pub thickness_mm: Option<f64>,
    /// Distance of the members at the root, mm, for `fillet`, `lap`, `butt-v`, `half-v`; if not given, a groove draws its
    /// own, and the others are tight.
    pub root_opening_mm: Option<f64>,
    /// Beads that hold a `fillet` on the camera's side already.
    pub tacks: Option<Tacks>,
    /// How the cell errs; if not given, the first pose is exact and the others are off by 1 to 3 mm.
    pub cell: Option<CellErrors>,
    /// What the camera does wrong beside its noise.
    pub sensor: SensorErrors,
}

/// Why a scan cannot be simulated or written.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A word that names nothing.
    #[error("unknown {what} `{word}`: choose one of {choices}")]
    Unknown {
        /// What the word should name.
        what: &'static str,
        /// The word.
        word: String,
        /// What it may be.
        choices: String,
    },
    /// A number out of its range.
    #[error("{name} is {value}, it must lie between {low} and {high}")]
    OutOfRange {
        /// Name of the setting.
        name: &'static str,
        /// What was given.
        value: f64,
        /// Least.
        low: f64,
        /// Greatest.
        high: f64,
    },
    /// A setting that the workpiece does not have.
    #[error("`{part}` has no {setting}: leave it out, or choose one of {choices}")]
    NotForPart {
        /// Name of the part.
        part: &'static str,
        /// The setting.
        setting: &'static str,
        /// Parts that have it.
        choices: &'static str,
    },
    /// A mesh that has nothing to see.
    #[error("the mesh has no triangle with an area")]
    EmptyMesh,
    /// A file cannot be made.
    #[error("cannot make {name}: {source}")]
    Encode {
        /// The file.
        name: String,
        /// What is wrong.
        source: std::io::Error,
    },
    /// The folder or a file in it cannot be written.
    #[error(transparent)]
    Write(#[from] weldpath_files::Error),
}

impl Request {
    /// A scan of `part` lying flat, at medium noise, in 640 x 480 depth images.
    pub fn new(part: Part, seed: u64) -> Self {
        Self {
            part,
            pose: Pose::Flat,
            views: None,
            noise: Noise::Mid,
            seed,
            width: 640,
            height: 480,
            weak: false,
            empty: false,
            format: Format::Png,
            angle_deg: None,
            length_mm: None,
            thickness_mm: None,
            root_opening_mm: None,
            tacks: None,
            cell: None,
            sensor: SensorErrors::default(),
        }
    }

    /// Name of the scan: piece, pose, noise, seed.
    pub fn name(&self) -> String {
        let how = if self.weak { "weak" } else { self.pose.name() };
        format!("{}_{how}_{}_s{}", self.part, self.noise, self.seed)
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        let (part, views) = (self.part, self.views.unwrap_or(1));
        within("views", views as f64, 1.0, 200.0)?;
        within("width", f64::from(self.width), 16.0, 4096.0)?;
        within("height", f64::from(self.height), 16.0, 4096.0)?;
        self.cell.map_or(Ok(()), |cell| cell.check())?;
        self.sensor.check()?;
        self.check_sizes()?;
        match (self.weak, part) {
            (true, Part::Branch | Part::Tacked) | (false, _) => Ok(()),
            (true, _) => self.refuse("weak placement", "branch, tacked"),
        }
    }

    fn refuse(&self, setting: &'static str, choices: &'static str) -> Result<(), Error> {
        Err(Error::NotForPart { part: self.part.name(), setting, choices })
    }

    fn check_sizes(&self) -> Result<(), Error> {
        match (self.angle_deg, self.part) {
            (Some(angle_deg), Part::Fillet) => within("angle", angle_deg, 45.0, 135.0)?,
            (Some(angle_deg), Part::ButtV | Part::Scurve) => within("angle", angle_deg, 30.0, 120.0)?,
            (Some(angle_deg), Part::HalfV) => within("angle", angle_deg, 30.0, 60.0)?,
            (Some(angle_deg), Part::Saddle) => within("angle", angle_deg, 45.0, 90.0)?,
            (Some(_), _) => return self.refuse("angle", "fillet, butt-v, half-v, scurve, saddle"),
            _ => {}
        }
        match (self.length_mm, self.part) {
            (Some(length_mm), Part::Fillet | Part::Lap | Part::Corner | Part::ButtV | Part::HalfV) => {
                within("length", length_mm, 60.0, 600.0)?;
            }
            (Some(_), _) => return self.refuse("length", "fillet, lap, corner, butt-v, half-v"),
            _ => {}
        }
        let plates = matches!(self.part, Part::Fillet | Part::Lap | Part::ButtV | Part::HalfV);
        match (self.root_opening_mm, plates) {
            (Some(opening_mm), true) => within("root opening", opening_mm, 0.0, 5.0)?,
            (Some(_), false) => return self.refuse("root opening", "fillet, lap, butt-v, half-v"),
            _ => {}
        }
        match (self.thickness_mm, plates) {
            (Some(thickness_mm), true) => within("thickness", thickness_mm, 1.0, 30.0)?,
            (Some(_), false) => return self.refuse("thickness", "fillet, lap, butt-v, half-v"),
            _ => {}
        }
        match (self.tacks, self.part) {
            (Some(tacks), Part::Fillet) => tacks.check(self.length_mm.unwrap_or(FILLET_MM)),
            (Some(_), _) => self.refuse("tacks", "fillet"),
            _ => Ok(()),
        }
    }
}

impl Tacks {
    /// The longest of them, with as much between them, fit on the seam.
    fn check(&self, seam_mm: f64) -> Result<(), Error> {
        within("number of tacks", self.count as f64, 0.0, (seam_mm / (2.0 * TACK_MM[1])).floor())?;
        within("tack's leg", self.leg_mm, 1.0, 10.0)
    }
}

impl CellErrors {
    pub(super) fn check(&self) -> Result<(), Error> {
        within("hand-eye shift", self.hand_eye_mm, 0.0, 100.0)?;
        within("hand-eye turn", self.hand_eye_deg, 0.0, 20.0)?;
        within("robot position error", self.robot_mm, 0.0, 20.0)?;
        within("robot orientation error", self.robot_deg, 0.0, 5.0)
    }
}

impl SensorErrors {
    pub(super) fn check(&self) -> Result<(), Error> {
        let optional =
            |name, value: Option<f64>, low, high| value.map_or(Ok(()), |v| within(name, v, low, high));
        within("matching window", f64::from(self.window_px), 0.0, 32.0)?;
        within("edge fattening", f64::from(self.fattening_px), 0.0, 32.0)?;
        optional("share of flying pixels", self.flying, 0.0, 1.0)?;
        optional("correlation of the noise", self.correlated_px, 0.1, 20.0)?;
        optional("disparity step", self.disparity_step_px, 1e-3, 2.0)?;
        within("depth step", self.depth_step_mm, 0.0, 50.0)?;
        within("interreflection", self.interreflection_mm, -20.0, 20.0)?;
        within("number of stray pixels", f64::from(self.stray_px), 0.0, 1000.0)?;
        within("specular angle", self.specular_deg, 0.0, 45.0)?;
        optional("grazing angle", self.grazing_deg, 20.0, 89.0)?;
        within("stripes", self.stripes_mm, 0.0, 10.0)?;
        within("waves", self.waves_mm, 0.0, 10.0)?;
        within("wavelength", self.wavelength_mm, 2.0, 1000.0)?;
        within("error of the depth scale", self.depth_scale_percent, -20.0, 20.0)?;
        within("error of the focal length", self.focal_percent, -20.0, 20.0)?;
        within("error of the optical axis", self.centre_px, 0.0, 100.0)?;
        within("distortion k1", self.k1, -0.3, 0.3)
    }
}

pub(super) fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), Error> {
    let good = (low..=high).contains(&value);
    if good { Ok(()) } else { Err(Error::OutOfRange { name, value, low, high }) }
}
