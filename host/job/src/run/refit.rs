//! A saved program on a part that has moved (ours): the saved model is laid over a new scan, and the program moves with it.
//!
//! Point-to-plane ICP as in [`weldpath_method::model::reconstruction`], but of one rigid cloud onto another, from a pose that nobody
//! reported: so first from many poses about the old one with few points, then finely from the best of them. Only the
//! model about the welds counts, as the table need not have moved. Directions in which surfaces are common (the faces
//! of plates) are sampled no more often than rare ones. Where a surface ends, its edge counts as a surface of its own that
//! faces out of it in its plane: a straight groove in flat plates is held along its length by nothing else. Along motions
//! that surfaces hardly hinder, the part is followed step by step: what faces along the motion decides, and where that
//! leaves several places, the smallest motion is taken with a warning, or none.

mod alignment;
mod part;
mod search;
mod slide;
mod target;

use nalgebra::{Isometry3, Point3};

use alignment::align;
use part::{Part, sample, with_edges};
use search::{candidates, smallest};
use slide::{hardly_seen, settle};
use target::{Target, rms_mm, share};

use crate::output::verdict::Verdict;
use crate::robot::feasibility;
use crate::robot::posture::PlannedPosture;
use crate::run::job::Job;
use crate::run::postprocessing::verdict_on;
use weldpath_method::geometry::cloud::{Merged, PointCloud, View};
use weldpath_method::geometry::surface::Surface;
use weldpath_method::model::{downsampling, normals, orientation, reconstruction};
use weldpath_method::weld::program::Waypoint;

/// Motion about the middle of the part that is looked for, mm; tests hold 36 mm with 20 degrees, on a fillet 47 with 15.
pub const RANGE_MM: f64 = 50.0;
/// The same for its rotation about any axis, degrees.
pub(crate) const RANGE_DEG: f64 = 20.0;
/// Farther than this beyond the range a round or repeated part is likely to be mistaken for itself.
const SLACK: f64 = 1.5;
/// Points of the model in the fine alignment, and the largest distances of a pair in it, mm, one round after another.
const FINE_POINTS: usize = 6000;
const FINE_GATES_MM: [f32; 3] = [8.0, 4.0, 2.5];
/// How near a point of the model has to come to the new cloud to count as found, mm.
const FOUND_MM: f32 = 1.5;
/// Least share of the model that has to be found.
const LEAST_FOUND: f64 = 0.7;
/// Least agreement of two normals that may be the same surface.
const MIN_NORMAL_DOT: f32 = 0.7;
/// Difference in the share found that tells nothing.
const NEARLY: f64 = 0.03;

/// How the part has moved.
#[derive(Debug, Clone)]
pub struct Refit {
    /// From where the part was to where it is, base frame, mm.
    pub new_from_old: Isometry3<f64>,
    /// Share of the model about the welds that lies on the new scan, 0..1.
    pub found: f64,
    /// Root mean square distance of that share from the new surface, mm.
    pub rms_mm: f64,
    /// How far the middle of the part went, mm.
    pub moved_mm: f64,
    /// How far it turned, degrees.
    pub turned_deg: f64,
    /// Whether the scan leaves a direction unknown, along which the smallest motion was taken.
    pub unknown: bool,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Why the program cannot be moved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// Nothing to go by.
    #[error("the saved {what}; plan it again, and keep the whole folder")]
    Saved {
        /// What is wrong with it.
        what: &'static str,
    },
    /// The part is not where it is looked for.
    #[error(
        "the part was not found in the new scan: at best {:.0} % of the saved model around its welds matches \
         the scan, but {:.0} % is needed. It is searched within {RANGE_MM:.0} mm and {RANGE_DEG:.0} degrees \
         of where it was",
        100.0 * found, 100.0 * LEAST_FOUND
    )]
    NotFound {
        /// The best share.
        found: f64,
    },
    /// Several places fit, and none of them is where it was.
    #[error(
        "the new scan does not show how far the part moved in one direction ({motion}): positions \
         {spread_mm:.0} mm apart fit equally well. Scan the ends of the part too"
    )]
    Ambiguous {
        /// The motion, in words.
        motion: String,
        /// Distance between places of a weld point, mm.
        spread_mm: f64,
    },
}

/// One cloud of all views, thinned, as the planner does it.
pub fn cloud(views: &[View]) -> PointCloud {
    let patches = normals::of_views(views, &normals::NormalsConfig::default());
    let registration =
        reconstruction::register(views, &patches, &reconstruction::ReconstructionConfig::default());
    let merged = Merged::new(views, &registration.base_from_camera);
    let scale = downsampling::Scale::of(&merged, &patches, &downsampling::VoxelConfig::default());
    let mut voxels = downsampling::voxel_grid(&merged, scale.edge_mm, scale.occupancy());
    if !views.iter().all(View::tells_orientation) {
        let oriented = orientation::seen(&voxels, !merged.normals.is_empty());
        voxels.turn(oriented.normals);
    }
    voxels.cloud
}

/// Finds where the part of `program` and `model` is in the cloud `new`.
///
/// # Errors
/// If the saved files hold nothing to go by, or the part is not found.
pub fn refit(program: &[Waypoint], model: &PointCloud, new: &PointCloud) -> Result<Refit, Error> {
    let welds: Vec<Point3<f64>> = program.iter().filter(|w| w.weld).map(|w| w.position_mm).collect();
    if welds.is_empty() {
        return Err(Error::Saved { what: "program has no weld" });
    }
    let part = Part::new(model, &welds);
    if part.surface.len() < 50 {
        return Err(Error::Saved { what: "model has no surface around the welds of its program" });
    }
    let target = Target::new(&with_edges(new), 0.0);
    let many = sample(&part.surface, FINE_POINTS);
    let mut all = sample(&part.edges, FINE_POINTS / 3);
    all.extend(&many);
    // What hardly moved needs no search, which other surfaces may lead astray.
    let starts = std::iter::once(Isometry3::identity()).chain(candidates(&part, new));
    let finals = starts.map(|start| {
        let pose = align(&all, &target, &start, &part.centre, &FINE_GATES_MM);
        (share(&many, &target, &pose, FOUND_MM), pose)
    });
    let near: Vec<_> = finals.filter(|(_, pose)| is_near(pose, &part.centre)).collect();
    let Some(mut pose) = smallest(&near, &part.welds) else { return Err(Error::NotFound { found: 0.0 }) };
    let found = share(&many, &target, &pose, FOUND_MM);
    if found < LEAST_FOUND {
        return Err(Error::NotFound { found });
    }
    let (mut warnings, mut known) = (Vec::new(), true);
    for axis in hardly_seen(&part, &target, &pose) {
        let settled = settle(&part, &target, &pose, &axis)?;
        pose = settled.pose;
        known &= settled.known;
        // Edges that do not decide would drag the part along the motion.
        if known {
            pose = align(&all, &target, &pose, &part.centre, &FINE_GATES_MM[1..]);
        }
        warnings.extend(settled.warning);
    }
    let fine = Target::new(new, 0.0);
    let found = share(&many, &fine, &pose, FOUND_MM);
    if found < LEAST_FOUND || !is_near(&pose, &part.centre) {
        return Err(Error::NotFound { found });
    }
    let fit = describe(found, pose, &part, rms_mm(&many, &fine, &pose), warnings);
    Ok(Refit { unknown: !known, ..fit })
}

/// What torch and arm say of the moved program on the new scan, and how the arm stands along it. What the saved plan was
/// checked for holds no longer.
pub fn checked(program: &[Waypoint], new: &PointCloud, job: &Job) -> (Verdict, Option<PlannedPosture>) {
    let work = Surface::of(new);
    let report = job.feasibility().map(|setup| feasibility::assess_as_it_is(program, &work, &setup));
    let verdict = verdict_on(program, &work, job, report.as_ref(), Vec::new());
    (verdict, report.and_then(|report| report.posture))
}

/// The program where the part is now.
///
/// ```
/// use nalgebra::{Isometry3, Point3, UnitQuaternion};
/// use weldpath_job::run::refit::moved;
/// use weldpath_method::weld::program::{Kind, Waypoint};
///
/// let at = |x_mm| Waypoint {
///     position_mm: Point3::new(x_mm, 0.0, 0.0),
///     base_from_torch: UnitQuaternion::identity(),
///     feed_mm_s: 8.0,
///     weld: true,
///     seam: Some(1),
///     kind: Kind::Weld,
///     dwell_s: None,
/// };
/// let program = [at(0.0), at(10.0)];
/// let new_from_old = Isometry3::translation(0.0, 5.0, 0.0);
/// assert_eq!(moved(&program, &new_from_old)[1].position_mm, Point3::new(10.0, 5.0, 0.0));
/// ```
pub fn moved(program: &[Waypoint], new_from_old: &Isometry3<f64>) -> Vec<Waypoint> {
    let moved = |waypoint: &Waypoint| Waypoint {
        position_mm: new_from_old * waypoint.position_mm,
        base_from_torch: new_from_old.rotation * waypoint.base_from_torch,
        ..*waypoint
    };
    program.iter().map(moved).collect()
}

fn is_near(pose: &Isometry3<f64>, centre: &Point3<f64>) -> bool {
    let moved_mm = (pose * centre - centre).norm();
    moved_mm < SLACK * RANGE_MM && pose.rotation.angle().to_degrees() < SLACK * RANGE_DEG
}

fn describe(found: f64, pose: Isometry3<f64>, part: &Part, rms_mm: f64, mut warnings: Vec<String>) -> Refit {
    let moved_mm = (pose * part.centre - part.centre).norm();
    let turned_deg = pose.rotation.angle().to_degrees();
    if moved_mm > RANGE_MM || turned_deg > RANGE_DEG {
        warnings.push(format!(
            "the part moved by {moved_mm:.0} mm and {turned_deg:.0} degrees, more than {RANGE_MM:.0} mm and \
             {RANGE_DEG:.0} degrees: look at the result before it is run"
        ));
    }
    Refit { new_from_old: pose, found, rms_mm, moved_mm, turned_deg, unknown: false, warnings }
}
