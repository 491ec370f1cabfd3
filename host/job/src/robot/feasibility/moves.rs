//! The poses of a program's straight moves, close enough for the joints to be followed from one to the next.

use nalgebra::{Point3, UnitQuaternion};

use weldpath_core::path::interpolation::position_between;
use weldpath_core::rotation::Arc;
use weldpath_method::weld::program::Waypoint;

/// Neighbouring poses are at most this far apart, mm ...
const STEP_MM: f64 = 10.0;
/// ... and turned by at most this, rad (5 degrees).
const STEP_RAD: f64 = 0.0873;

/// One pose on the way to a waypoint; the last of them is the waypoint itself.
pub(super) struct Station {
    pub waypoint: usize,
    pub tip_mm: Point3<f64>,
    pub base_from_torch: UnitQuaternion<f64>,
    /// From the pose before, at the feed of the move; 0 at the first pose and where the tip stands still.
    pub time_s: f64,
}

/// All poses of a program. The move to the first waypoint is a joint motion and not looked at.
pub(super) fn stations(waypoints: &[Waypoint]) -> Vec<Station> {
    let mut stations = Vec::new();
    for (waypoint, here) in waypoints.iter().enumerate() {
        let before = waypoint.checked_sub(1).map_or(here, |k| &waypoints[k]);
        let way_mm = (here.position_mm - before.position_mm).norm();
        let turn_rad = before.base_from_torch.angle_to(&here.base_from_torch);
        let steps = (way_mm / STEP_MM).max(turn_rad / STEP_RAD).ceil().max(1.0);
        let turn = Arc::between(&before.base_from_torch, &here.base_from_torch);
        for k in 1..=steps as usize {
            let share = k as f64 / steps;
            stations.push(Station {
                waypoint,
                tip_mm: position_between(&before.position_mm, &here.position_mm, share),
                base_from_torch: turn.slerp(share),
                time_s: way_mm / here.feed_mm_s / steps,
            });
        }
    }
    stations
}
