//! Hand-eye transform and camera of a cell, from scans of anything with faces in three directions (ours).
//!
//! Each scan is registered with what those before it told taken out, and with the covariance of that as its prior; what all
//! scans together leave loose is named.

use super::config::{MergeConfig, Method};
use super::reconstruction::Reconstruction;
use super::result::PlanError;
use super::stages::Stages;
use crate::geometry::cloud::View;
use crate::model::base_frame::CellAccuracy;
use crate::model::base_frame::{Anchor, Calibration};

/// Fewer views tell nothing of what they share.
pub(crate) const LEAST_VIEWS: usize = 3;
/// Share of its prior standard deviation above which something is loose: four times the data would not tell it either.
const LOOSE: f64 = 0.5;

/// What one scan was like.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibrating {
    /// Views that fit each other, and all of them.
    pub views: [usize; 2],
    /// How the poses that the robot reported scatter, one standard deviation of each axis, mm.
    pub robot_mm: f64,
    /// The same of their orientation, degrees.
    pub robot_deg: f64,
    /// Robust standard deviation of the distances between the views' surfaces, mm.
    pub residual_mm: f64,
}

/// Why a scan calibrates nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A cloud or mesh, or depth images without poses.
    #[error("its views have no camera poses in the robot's base frame")]
    NoPoses,
    /// Too few views, or too few that fit each other.
    #[error("{fit} of its {views} views fit each other, but {LEAST_VIEWS} are needed")]
    TooFewViews {
        /// That fit each other.
        fit: usize,
        /// Of so many.
        views: usize,
    },
    /// The views' surfaces say nothing of where they are against each other.
    #[error("its views overlap too little for a calibration")]
    NoSurfaces,
    /// The hand-eye transform belongs to another camera or flange.
    #[error(
        "the hand-eye transform in it is off by centimetres or several degrees: it belongs to another \
         camera, or to a tool"
    )]
    BeyondRepair,
    /// The poses contradict what is stated of the robot.
    #[error(
        "the poses in it scatter by {robot_mm:.1} mm and {robot_deg:.2} deg, more than twice the stated \
         accuracy of the robot"
    )]
    Scattered {
        /// Each axis.
        robot_mm: f64,
        /// Each axis.
        robot_deg: f64,
    },
}

/// What can be loose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loose {
    /// The camera's orientation on the flange.
    Turn,
    /// Its position.
    Shift,
    /// Depth scale.
    DepthScale,
    /// Focal length.
    Focal,
    /// Optical axis.
    Centre,
    /// Radial distortion.
    Distortion,
}

impl Loose {
    /// Which poses would tie it down.
    pub fn remedy(self) -> &'static str {
        match self {
            Self::Turn | Self::Shift => {
                "the hand-eye transform: add views turned by 30 degrees and more about two axes that are not parallel, \
                 the camera's own axis among them"
            }
            Self::DepthScale => {
                "the depth scale: add views of the same faces from two distances, one of them 1.5 times the \
                 other"
            }
            Self::Focal => {
                "the focal length: add views that see the same faces at the image's edges and in its middle"
            }
            Self::Centre => {
                "the optical axis: add views turned about the camera's own axis by 90 and 180 degrees"
            }
            Self::Distortion => "the distortion: add views that see the work in the corners of the image",
        }
    }
}

/// Adds what a scan tells to what is known from others.
///
/// # Errors
/// If the scan tells nothing.
pub fn calibrate(
    views: &[View],
    known: Option<&Calibration>,
    cell: CellAccuracy,
) -> Result<(Calibration, Calibrating), Error> {
    if !views.iter().all(|view| view.camera_known) {
        return Err(Error::NoPoses);
    }
    let anchor = Some(Anchor::Cell(cell));
    let config = MergeConfig { anchor, calibration: known.cloned(), ..MergeConfig::default() };
    let done = Reconstruction::new(views, Method::default(), &config, &mut Stages::new(&mut ()));
    let found = done.map_err(|_: PlanError| Error::NoSurfaces)?;
    let fit = found.agreement.kept.len();
    if fit < LEAST_VIEWS {
        return Err(Error::TooFewViews { fit, views: views.len() });
    }
    if found.agreement.hand_eye.is_some_and(|error| error.is_gross()) {
        return Err(Error::BeyondRepair);
    }
    let location = found.location.ok_or(Error::NoSurfaces)?;
    let base_frame = location.base_frame.ok_or(Error::NoSurfaces)?;
    let (robot_mm, robot_deg) = (base_frame.robot_mm, base_frame.robot_deg);
    if base_frame.is_scattered() {
        return Err(Error::Scattered { robot_mm, robot_deg });
    }
    let residual_mm = found.agreement.registration.residual_mm;
    let calibration = match known {
        Some(known) => known.then(&location.shared),
        None => location.shared,
    };
    Ok((calibration, Calibrating { views: [fit, views.len()], robot_mm, robot_deg, residual_mm }))
}

/// What the scans did not tie down, of what was unknown before.
pub fn loose(calibration: &Calibration, cell: CellAccuracy) -> Vec<Loose> {
    let sigma = calibration.sigma();
    let usual = Calibration::unknown(cell).sigma();
    let kinds = [
        (Loose::Turn, 0..3),
        (Loose::Shift, 3..6),
        (Loose::DepthScale, 6..7),
        (Loose::Focal, 7..8),
        (Loose::Centre, 8..10),
        (Loose::Distortion, 10..11),
    ];
    let is_loose =
        |(_, at): &(Loose, std::ops::Range<usize>)| at.clone().any(|k| sigma[k] > LOOSE * usual[k]);
    kinds.into_iter().filter(is_loose).map(|(kind, _)| kind).collect()
}
