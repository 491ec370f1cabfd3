//! Seams to which the torch does not get (ours): corners of a bore, the inside of a closed section, the foot inside a narrow pipe.
//! They are listed, and welded only if the job names them.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::{Unit, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::robot::feasibility::torch::Torch;
use crate::run::job::Job;
use weldpath_method::cancellation::go_on;
use weldpath_method::geometry::surface::Surface;
use weldpath_method::pipeline::Plan;
use weldpath_method::weld::{PathPoint, SeamPath};

/// Places along a seam at which the torch is tried.
const PLACES: usize = 15;
/// Angles by which it is leaned from the bisector of the faces, degrees: in a right corner to within 5 degrees of either.
const WORK_DEG: [f64; 9] = [0.0, 10.0, -10.0, 20.0, -20.0, 30.0, -30.0, 40.0, -40.0];
/// Angles by which it is leaned along the travel, degrees: more is not welded with.
const TRAVEL_DEG: [f64; 5] = [0.0, 20.0, -20.0, 40.0, -40.0];
/// Turns about its own axis, of a torch that is not straight.
const TURNS: usize = 8;
/// So deep in what was scanned it still fits, mm: the noise of a scan, and what an angle between two of these gives ...
const FITS_MM: f64 = 1.0;
/// ... and where the job says nothing of the torch, what a slimmer nozzle or a little more wire gives.
const SLIMMER_MM: f64 = 4.0;
/// Share of the places at which it must fit.
const LEAST_SHARE: f64 = 0.5;

/// Ids of the seams along which the job's torch fits nowhere on more than half of the length, at no work angle and no turn;
/// none if it is so with all: then it is the torch that is wrong, and its collisions say so.
pub fn inside(plan: &Plan, job: &Job) -> Arc<BTreeSet<usize>> {
    let torch = job.torch_body();
    // Not first asked for on the threads below: one that waits for its own work would take another place, and ask again.
    let work = plan.surface();
    let deep_mm = FITS_MM + if job.torch_body.is_some() { 0.0 } else { SLIMMER_MM };
    plan.remembered(format!("{torch:?} {deep_mm}"), || {
        let is_inside = |path: &&SeamPath| share_that_fits(path, work, &torch, deep_mm) < LEAST_SHARE;
        let inside: BTreeSet<usize> = plan.paths.par_iter().filter(is_inside).map(|path| path.seam).collect();
        if inside.len() < plan.paths.len() { inside } else { BTreeSet::new() }
    })
}

fn share_that_fits(path: &SeamPath, work: &Surface, torch: &Torch, deep_mm: f64) -> f64 {
    let places = PLACES.min(path.points.len());
    // In the middle of as many equal stretches, so that the ends count no more than they are long.
    let at = |k: usize| &path.points[(2 * k + 1) * path.points.len() / (2 * places)];
    let fitting = (0..places).filter(|k| fits(at(*k), work, torch, deep_mm)).count();
    if places == 0 { 1.0 } else { fitting as f64 / places as f64 }
}

fn fits(point: &PathPoint, work: &Surface, torch: &Torch, deep_mm: f64) -> bool {
    let about = |axis: Unit<Vector3<f64>>, deg: f64| UnitQuaternion::from_axis_angle(&axis, deg.to_radians());
    let turns = if torch.neck_deg == 0.0 { 1 } else { TURNS };
    TRAVEL_DEG.iter().any(|travel_deg| {
        WORK_DEG.iter().any(|work_deg| {
            go_on();
            let leaned = about(Vector3::y_axis(), *work_deg) * about(Vector3::x_axis(), *travel_deg);
            (0..turns).any(|turn| {
                let turn = about(Vector3::z_axis(), 360.0 * turn as f64 / turns as f64);
                let base_from_torch = point.base_from_torch * leaned * turn;
                torch.fits(work, &point.position_mm, &base_from_torch, deep_mm)
            })
        })
    })
}
