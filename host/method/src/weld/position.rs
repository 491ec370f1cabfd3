//! Welding positions (ISO 6947: PA, PB, PC, PD, PE, PF, PG), from the torch, the travel and gravity.
//!
//! The slope is the angle of the travel to the horizontal. A weld steeper than 45 degrees is PF if it climbs and PG if
//! it falls. Else the rotation counts: how far the torch axis `n` stands above the horizontal plane, 90 degrees for a
//! flat weld (PA), 45 for a fillet on a level plate (PB), 0 for a horizontal weld on a wall (PC), -45 (PD) and -90
//! (PE) overhead. The nearest is named; PB and PD are positions of fillets and are not given to butt welds.

use std::fmt;

use nalgebra::UnitVector3;
use serde::Serialize;

use super::{PathPoint, SeamPath};

/// A main position of ISO 6947.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Position {
    /// Flat.
    PA,
    /// Horizontal vertical: a fillet on a level plate.
    PB,
    /// Horizontal, on a wall.
    PC,
    /// Horizontal overhead: a fillet under a level plate.
    PD,
    /// Overhead.
    PE,
    /// Vertical up.
    PF,
    /// Vertical down.
    PG,
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        fmt::Debug::fmt(self, f)
    }
}

/// Positions along the way with the rotation that each has, degrees.
const FILLET: [(Position, f64); 5] = [
    (Position::PA, 90.0),
    (Position::PB, 45.0),
    (Position::PC, 0.0),
    (Position::PD, -45.0),
    (Position::PE, -90.0),
];
const BUTT: [(Position, f64); 3] = [(Position::PA, 90.0), (Position::PC, 0.0), (Position::PE, -90.0)];
/// A stretch shorter than this share of the seam is not named.
const LEAST_SHARE: f64 = 0.05;

/// The positions in which a path is welded, in the order in which they come; a butt weld is never PB or PD.
pub fn positions(path: &SeamPath, up: UnitVector3<f64>, butt: bool) -> Vec<Position> {
    let steps: Vec<(Position, f64)> = path
        .points
        .windows(2)
        .filter_map(|w| Some((of_step(&w[0], &w[1], up, butt)?, step_mm(&w[0], &w[1]))))
        .collect();
    let whole_mm: f64 = steps.iter().map(|(_, mm)| mm).sum();
    let mut stretches: Vec<(Position, f64)> = Vec::new();
    for (position, mm) in steps {
        match stretches.last_mut() {
            Some((last, sum_mm)) if *last == position => *sum_mm += mm,
            _ => stretches.push((position, mm)),
        }
    }
    stretches.retain(|(_, mm)| *mm >= LEAST_SHARE * whole_mm);
    let mut named: Vec<Position> = stretches.into_iter().map(|(position, _)| position).collect();
    named.dedup();
    named
}

fn step_mm(a: &PathPoint, b: &PathPoint) -> f64 {
    (b.position_mm - a.position_mm).norm()
}

fn of_step(a: &PathPoint, b: &PathPoint, up: UnitVector3<f64>, butt: bool) -> Option<Position> {
    let travel = (b.position_mm - a.position_mm).try_normalize(1e-9)?;
    let climb = up.dot(&travel);
    if climb.abs() > std::f64::consts::FRAC_1_SQRT_2 {
        return Some(if climb > 0.0 { Position::PF } else { Position::PG });
    }
    let rotation_deg = up.dot(&a.out_of_work()).clamp(-1.0, 1.0).asin().to_degrees();
    let away = |(_, deg): &&(Position, f64)| (rotation_deg - deg).abs();
    let names: &[(Position, f64)] = if butt { &BUTT } else { &FILLET };
    names.iter().min_by(|a, b| away(a).total_cmp(&away(b))).map(|(position, _)| *position)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weld::Process;
    use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
    use std::f64::consts::TAU;

    fn point(p: Vector3<f64>, travel: Vector3<f64>, out: Vector3<f64>) -> PathPoint {
        let n = out.normalize();
        let m = (travel - n * n.dot(&travel)).normalize();
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[m.cross(&n), m, n]));
        PathPoint {
            s_mm: 0.0,
            position_mm: Point3::from(p),
            base_from_torch: UnitQuaternion::from_rotation_matrix(&axes),
            process: Process::default(),
        }
    }

    fn line(travel: [f64; 3], out: [f64; 3]) -> SeamPath {
        let (travel, out) = (Vector3::from(travel), Vector3::from(out));
        SeamPath { seam: 1, points: (0..5).map(|k| point(travel * f64::from(k), travel, out)).collect() }
    }

    #[test]
    fn the_main_positions_are_those_of_the_standard() {
        for (travel, out, butt, expected) in [
            ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], true, Position::PA),
            ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], false, Position::PA),
            ([1.0, 0.0, 0.0], [0.0, 1.0, 1.0], false, Position::PB),
            ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], true, Position::PC),
            ([1.0, 0.0, 0.0], [0.0, 1.0, -1.0], false, Position::PD),
            ([1.0, 0.0, 0.0], [0.0, 0.0, -1.0], true, Position::PE),
            ([0.0, 0.0, 1.0], [1.0, 1.0, 0.0], false, Position::PF),
            ([0.0, 0.0, -1.0], [1.0, 0.0, 0.0], true, Position::PG),
            ([1.0, 0.0, 0.2], [0.0, 0.2, 1.0], true, Position::PA),
        ] {
            assert_eq!(
                positions(&line(travel, out), Vector3::z_axis(), butt),
                [expected],
                "{travel:?} {out:?}"
            );
        }
    }

    #[test]
    fn a_ring_on_a_level_plate_is_one_position_and_a_ring_on_a_wall_is_several() {
        let ring = |axis: Vector3<f64>, x: Vector3<f64>| {
            let y = axis.cross(&x);
            let at = |k: i32| {
                let angle = TAU * f64::from(k) / 72.0;
                let radial = x * angle.cos() + y * angle.sin();
                point(radial * 30.0, y * angle.cos() - x * angle.sin(), radial + axis)
            };
            SeamPath { seam: 1, points: (0..=72).map(at).collect() }
        };
        let up = Vector3::z_axis();
        assert_eq!(positions(&ring(Vector3::z(), Vector3::x()), up, false), [Position::PB]);
        // From the top of a pipe that stands out of a wall, round its side, and back.
        let on_wall = positions(&ring(Vector3::x(), Vector3::z()), up, false);
        assert_eq!(on_wall, [Position::PB, Position::PG, Position::PD, Position::PF, Position::PB]);
    }
}
