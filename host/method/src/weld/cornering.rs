//! Corners of a path (ours): passed as they are, stopped at, or rounded by an arc.
//!
//! A corner is a turn of more than 30 degrees at one point, as for the uniform spacing. Both ways out keep the pose at
//! every other point.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::resampling::{arc_lengths_mm, keep_signs, runs_between_corners};
use super::{PathPoint, SeamPath, at, between};

/// What happens at a corner: a turn of more than 30 degrees at one point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "CornerWay")]
pub enum Cornering {
    /// The controller's own blend.
    #[default]
    Pass,
    /// The torch stops exactly there.
    Stop,
    /// An arc of `corner_radius_mm`.
    Blend,
}

/// Largest distance between an arc and its chords, mm.
const SAGITTA_MM: f64 = 0.02;

/// Treats every corner between the ends. A blend is an arc of `radius_mm` that touches both sides; it uses at most half of the
/// shorter side.
pub fn corner(path: &SeamPath, corner: Cornering, radius_mm: f64) -> SeamPath {
    if path.points.len() < 3 {
        return path.clone();
    }
    match corner {
        Cornering::Pass => path.clone(),
        Cornering::Stop => stop(path),
        Cornering::Blend => blend(path, radius_mm),
    }
}

fn stop(path: &SeamPath) -> SeamPath {
    let mut points = path.points.clone();
    for (_, k) in runs_between_corners(&path.points) {
        if k + 1 < path.points.len() {
            points[k].process.dwell_s = points[k].process.dwell_s.or(Some(0.0));
        }
    }
    path.with(points)
}

fn blend(path: &SeamPath, radius_mm: f64) -> SeamPath {
    let runs = runs_between_corners(&path.points);
    let s_mm = arc_lengths_mm(&path.points);
    let length_mm = |&(a, b): &(usize, usize)| s_mm[b] - s_mm[a];
    let mut points: Vec<PathPoint> = Vec::new();
    let mut from_mm = s_mm[0];
    let whole: Vec<PathPoint> =
        path.points.iter().zip(&s_mm).map(|(p, &s_mm)| PathPoint { s_mm, ..*p }).collect();
    for pair in runs.windows(2) {
        let k = pair[0].1;
        let half_mm = 0.5 * length_mm(&pair[0]).min(length_mm(&pair[1]));
        let Some(arc) = arc(&whole, k, radius_mm, half_mm) else { continue };
        let to_mm = s_mm[k] - arc.tangent_mm;
        points.extend(whole.iter().filter(|p| p.s_mm >= from_mm && p.s_mm < to_mm - 1e-9));
        points.extend(arc.points);
        from_mm = s_mm[k] + arc.tangent_mm + 1e-9;
    }
    points.extend(whole.iter().filter(|p| p.s_mm >= from_mm));
    let lengths = arc_lengths_mm(&points);
    points.iter_mut().zip(lengths).for_each(|(point, s_mm)| point.s_mm = s_mm);
    keep_signs(&mut points);
    path.with(points)
}

/// An arc in place of a corner.
struct Rounding {
    /// From where it touches a side to the corner, mm.
    tangent_mm: f64,
    points: Vec<PathPoint>,
}

/// The arc about the corner at point `k`, no more than `most_mm` from it along either side. It touches the chords from
/// its ends to the corner: exact on straight sides, and to the sagitta on curved ones.
fn arc(points: &[PathPoint], k: usize, radius_mm: f64, most_mm: f64) -> Option<Rounding> {
    let corner = points[k];
    let sides =
        |reach_mm: f64| Some((at(points, corner.s_mm - reach_mm)?, at(points, corner.s_mm + reach_mm)?));
    let directions = |reach_mm: f64| {
        let (a, b) = sides(reach_mm)?;
        let back = (a.position_mm - corner.position_mm).try_normalize(1e-9)?;
        let on = (b.position_mm - corner.position_mm).try_normalize(1e-9)?;
        Some((back, on))
    };
    let (back, on) = directions(radius_mm.min(most_mm))?;
    let half_opening = 0.5 * back.angle(&on);
    let tangent_mm = (radius_mm / half_opening.tan()).min(most_mm);
    let (a, b) = sides(tangent_mm)?;
    let (back, on) = directions(tangent_mm)?;
    let half_opening = 0.5 * back.angle(&on);
    let radius_mm = tangent_mm * half_opening.tan();
    let turn = std::f64::consts::PI - 2.0 * half_opening;
    let step = 2.0 * (1.0 - (SAGITTA_MM / radius_mm).min(0.5)).acos();
    let count = (turn / step).ceil().clamp(2.0, 180.0) as usize;
    let inward = (back + on).try_normalize(1e-9)?;
    let centre = corner.position_mm + inward * (radius_mm / half_opening.sin());
    let outward = -inward;
    let across = (on - back).try_normalize(1e-9)?;
    let place = |j: usize| {
        let angle = turn * (j as f64 / count as f64 - 0.5);
        let position_mm = centre + (outward * angle.cos() + across * angle.sin()) * radius_mm;
        PathPoint { position_mm, ..between(&a, &b, j as f64 / count as f64) }
    };
    Some(Rounding { tangent_mm, points: (0..=count).map(place).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::Process;
    use nalgebra::{Point3, UnitQuaternion, Vector3};
    use std::f64::consts::FRAC_PI_2;

    /// 30 mm along x, then 20 mm along y, in steps of 1 mm; the torch turns with the travel.
    fn bend() -> SeamPath {
        let at = |s: f64| PathPoint {
            s_mm: s,
            position_mm: Point3::new(s.min(30.0), (s - 30.0).max(0.0), 0.0),
            base_from_torch: UnitQuaternion::from_axis_angle(
                &Vector3::z_axis(),
                if s > 30.0 { FRAC_PI_2 } else { 0.0 },
            ),
            process: Process::default(),
        };
        SeamPath { seam: 1, points: (0..=50).map(|i| at(f64::from(i))).collect() }
    }

    #[test]
    fn a_blended_corner_is_an_arc_that_touches_both_sides() {
        let round = corner(&bend(), Cornering::Blend, 4.0);
        let centre = Point3::new(26.0, 4.0, 0.0);
        for p in &round.points {
            let q = p.position_mm;
            let on_arc = q.x > 26.0 && q.y < 4.0;
            let off_mm =
                if on_arc { ((q - centre).norm() - 4.0).abs() } else { q.y.abs().min((q.x - 30.0).abs()) };
            assert!(off_mm < 1e-9, "{q} is {off_mm} mm off");
        }
        assert!((round.length_mm() - (26.0 + 16.0 + 2.0 * std::f64::consts::PI)).abs() < 0.03);
        for w in round.points.windows(2) {
            let step = w[1].position_mm - w[0].position_mm;
            assert!(step.norm() > 1e-6 && (w[1].s_mm - w[0].s_mm - step.norm()).abs() < 1e-9);
        }
        for w in round.points.windows(3) {
            let turn = (w[1].position_mm - w[0].position_mm).angle(&(w[2].position_mm - w[1].position_mm));
            assert!(turn < 0.25, "no corner is left");
        }
    }

    #[test]
    fn the_torch_turns_evenly_along_the_arc() {
        let round = corner(&bend(), Cornering::Blend, 4.0);
        let turns = round.points.windows(2).map(|w| w[0].base_from_torch.angle_to(&w[1].base_from_torch));
        assert!(turns.into_iter().all(|turn| turn < 0.25));
    }

    #[test]
    fn a_radius_too_large_uses_half_of_the_shorter_side() {
        let round = corner(&bend(), Cornering::Blend, 500.0);
        let ends = [round.points[0].position_mm, round.points[round.points.len() - 1].position_mm];
        assert_eq!(ends, [Point3::new(0.0, 0.0, 0.0), Point3::new(30.0, 20.0, 0.0)]);
        assert!(round.points.iter().any(|p| (p.position_mm - Point3::new(20.0, 0.0, 0.0)).norm() < 1e-9));
    }

    #[test]
    fn stopping_marks_the_corner_alone() {
        let stopped = corner(&bend(), Cornering::Stop, 0.0);
        let stops: Vec<_> = stopped.points.iter().filter(|p| p.process.dwell_s.is_some()).collect();
        assert_eq!(stops.len(), 1);
        assert_eq!(
            (stops[0].position_mm, stops[0].process.dwell_s),
            (Point3::new(30.0, 0.0, 0.0), Some(0.0))
        );
    }

    #[test]
    fn treating_corners_twice_changes_nothing_more() {
        for way in [Cornering::Pass, Cornering::Stop, Cornering::Blend] {
            let once = corner(&bend(), way, 4.0);
            assert_eq!(corner(&once, way, 4.0).points, once.points);
        }
    }
}
