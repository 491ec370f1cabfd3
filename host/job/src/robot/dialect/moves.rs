//! The moves of a program as every robot dialect needs them: tool poses, where the arc is switched, how far a corner
//! may be cut, and where a long program may be divided.
//!
//! Robots hold the tool's z out of the torch, into the work: the torch frame is turned half round `m`.

use std::ops::Range;

use nalgebra::{Point3, Quaternion, UnitQuaternion};

use weldpath_method::weld::program::Waypoint;

/// Share of the shorter neighbouring segment that a blend may use; at one half controllers report an overlap or
/// shorten it themselves.
const BLEND_SHARE: f64 = 0.4;
/// How far a blend may leave a corner, mm.
const BLEND_DEVIATION_MM: f64 = 0.1;
/// Longest blend radius, mm.
const BLEND_LIMIT_MM: f64 = 5.0;

/// What is done standing at the end of a move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Switch {
    /// The arc is struck.
    On,
    /// The arc is put out.
    Off,
}

/// One move, to a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move {
    /// Tip of the wire, mm, base frame.
    pub position_mm: Point3<f64>,
    /// Tool z into the work.
    pub base_from_tool: UnitQuaternion<f64>,
    /// On the way here, mm/s.
    pub feed_mm_s: f64,
    /// Whether the arc burns on the way here.
    pub welding: bool,
    /// Radius within which the corner here may be cut, mm; 0 arrives and stands.
    pub blend_mm: f64,
    /// How long the torch stands here with the arc burning, s; a move without it passes if it may.
    pub dwell_s: Option<f64>,
    /// What follows the arrival.
    pub then: Option<Switch>,
    /// [`weldpath_method::seam::Seam::id`]; none in the air.
    pub seam: Option<usize>,
}

/// A seam that no single program of a dialect can hold, and that must not be divided while the arc burns.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("seam {seam} has {moves} points; a {dialect} program of weldpath holds {limit}")]
pub struct TooLong {
    /// [`weldpath_method::seam::Seam::id`].
    pub seam: usize,
    /// Moves that belong together.
    pub moves: usize,
    /// Most moves of one program.
    pub limit: usize,
    /// Of which robot.
    pub dialect: &'static str,
}

impl Move {
    /// The time to wait here, if any.
    pub(crate) fn wait_s(&self) -> Option<f64> {
        self.dwell_s.filter(|&dwell_s| dwell_s > 0.0)
    }
}

/// One move to each waypoint.
pub fn moves(waypoints: &[Waypoint]) -> Vec<Move> {
    let burns = |i: usize| {
        let (from, to) = (i.checked_sub(1).and_then(|i| waypoints.get(i)), waypoints.get(i));
        matches!((from, to), (Some(a), Some(b)) if a.weld && b.weld && a.seam == b.seam)
    };
    let one = |(i, here): (usize, &Waypoint)| {
        let (before, after) = (burns(i), burns(i + 1));
        let neighbours = || Some((waypoints.get(i.checked_sub(1)?)?, waypoints.get(i + 1)?));
        let blend_mm = match neighbours() {
            Some((from, to)) if before && after && here.dwell_s.is_none() => blend_mm(from, here, to),
            _ => 0.0,
        };
        Move {
            position_mm: here.position_mm,
            base_from_tool: into_work(&here.base_from_torch),
            feed_mm_s: here.feed_mm_s,
            welding: before,
            blend_mm,
            dwell_s: here.dwell_s,
            then: match (before, after) {
                (false, true) => Some(Switch::On),
                (true, false) => Some(Switch::Off),
                _ => None,
            },
            seam: here.seam,
        }
    };
    waypoints.iter().enumerate().map(one).collect()
}

/// Divides `moves` into as few runs of at most `limit` as may be, each beginning where no arc burns.
pub fn parts(moves: &[Move], limit: usize, dialect: &'static str) -> Result<Vec<Range<usize>>, TooLong> {
    let mut parts: Vec<Range<usize>> = vec![];
    let mut begin = 0;
    for i in 0..moves.len() {
        let undivided = moves.get(i + 1).is_some_and(|next| next.welding);
        if undivided {
            continue;
        }
        let run = begin..i + 1;
        begin = i + 1;
        if run.len() > limit {
            let seam = moves.get(i).and_then(|last| last.seam).unwrap_or(0);
            return Err(TooLong { seam, moves: run.len(), limit, dialect });
        }
        match parts.last_mut() {
            Some(part) if part.len() + run.len() <= limit => part.end = run.end,
            _ => parts.push(run),
        }
    }
    Ok(parts)
}

/// `R Rot(m, 180°)`: columns `(-o, m, -n)`, so that z points into the work.
fn into_work(base_from_torch: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    base_from_torch * UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 1.0, 0.0))
}

/// Largest blend radius that neither overlaps its neighbours nor leaves a corner by more than 0.1 mm: a parabola that
/// starts `r` before a turn by `φ` passes it at `r/2 sin(φ/2)`.
fn blend_mm(before: &Waypoint, here: &Waypoint, after: &Waypoint) -> f64 {
    let into = here.position_mm - before.position_mm;
    let out = after.position_mm - here.position_mm;
    let half_turn = (0.5 * into.angle(&out)).sin().max(1e-9);
    (BLEND_SHARE * into.norm().min(out.norm())).min(2.0 * BLEND_DEVIATION_MM / half_turn).min(BLEND_LIMIT_MM)
}

/// Angles in degrees about z, the turned y and the twice turned x (KUKA's A, B, C); read backwards, about the fixed
/// x, y and z (FANUC's W, P, R). Where the middle one is a right angle only one of the others counts: x is then 0.
pub(crate) fn euler_zyx_deg(q: &UnitQuaternion<f64>) -> [f64; 3] {
    let m = q.to_rotation_matrix().into_inner();
    let level = m[(0, 0)].hypot(m[(1, 0)]);
    let about_y = (-m[(2, 0)]).atan2(level);
    let [about_z, about_x] = if level > 1e-9 {
        [m[(1, 0)].atan2(m[(0, 0)]), m[(2, 1)].atan2(m[(2, 2)])]
    } else {
        [(-m[(0, 1)]).atan2(m[(1, 1)]), 0.0]
    };
    [about_z, about_y, about_x].map(f64::to_degrees)
}

/// A number with so many decimals, and no minus before zero.
pub(crate) fn decimal<const PLACES: usize>(value: f64) -> String {
    let per_unit = 10_f64.powi(PLACES as i32);
    format!("{:.PLACES$}", (value * per_unit).round() / per_unit + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use std::f64::consts::FRAC_PI_2;
    use weldpath_method::weld::program::Kind;

    fn straight(seams: usize, points: usize) -> Vec<Waypoint> {
        let at = |seam: usize, i: usize| Waypoint {
            position_mm: Point3::new(i as f64, 10.0 * seam as f64, 0.0),
            base_from_torch: UnitQuaternion::identity(),
            feed_mm_s: 8.0,
            dwell_s: None,
            weld: (1..=points).contains(&i),
            seam: Some(seam),
            kind: if (1..=points).contains(&i) { Kind::Weld } else { Kind::Approach },
        };
        (1..=seams).flat_map(|seam| (0..points + 2).map(move |i| at(seam, i))).collect()
    }

    #[test]
    fn the_arc_is_struck_and_put_out_once_on_every_seam() {
        let moves = moves(&straight(3, 4));
        let switches: Vec<Switch> = moves.iter().filter_map(|m| m.then).collect();
        assert_eq!(switches, [Switch::On, Switch::Off].repeat(3));
        assert!(moves.iter().all(|m| (m.blend_mm > 0.0) == (m.welding && m.then.is_none())));
        assert_eq!(moves.iter().filter(|m| m.welding).count(), 3 * 3);
    }

    #[test]
    fn where_the_torch_stands_no_corner_is_cut() {
        let mut waypoints = straight(1, 5);
        waypoints[3].dwell_s = Some(0.0);
        let moves = moves(&waypoints);
        assert!(moves[2].blend_mm > 0.0 && moves[3].blend_mm == 0.0);
        assert_eq!((moves[3].dwell_s, moves[3].wait_s()), (Some(0.0), None));
    }

    #[test]
    fn seams_of_one_point_or_side_by_side_strike_no_arc_between_them() {
        assert!(moves(&straight(1, 1)).iter().all(|m| m.then.is_none()));
        let joined: Vec<Waypoint> = straight(2, 2).into_iter().filter(|w| w.weld).collect();
        assert_eq!(moves(&joined).iter().map(|m| m.welding).collect::<Vec<_>>(), [false, true, false, true]);
    }

    #[test]
    fn parts_cover_all_moves_and_never_begin_under_the_arc() {
        let moves = moves(&straight(5, 10));
        for limit in [11, 12, 24, 25, 60, 1000] {
            let parts = parts(&moves, limit, "test").unwrap();
            assert_eq!(parts.first().unwrap().start, 0);
            assert_eq!(parts.last().unwrap().end, moves.len());
            assert!(parts.windows(2).all(|w| w[0].end == w[1].start));
            assert!(parts.iter().all(|part| part.len() <= limit && !moves[part.start].welding));
        }
        let refused = parts(&moves, 9, "test").unwrap_err();
        assert_eq!((refused.seam, refused.moves, refused.limit), (1, 10, 9));
        assert!(parts(&[], 9, "test").unwrap().is_empty());
    }

    #[test]
    fn euler_angles_turned_one_after_the_other_are_the_rotation() {
        let about = |axis, deg: f64| UnitQuaternion::from_axis_angle(&axis, deg.to_radians());
        for i in 0..400 {
            let t = f64::from(i);
            let q = match i % 4 {
                0 => UnitQuaternion::from_euler_angles(t, FRAC_PI_2, 0.3 * t),
                1 => UnitQuaternion::from_euler_angles(t, -FRAC_PI_2, 0.3 * t),
                _ => UnitQuaternion::from_euler_angles(0.7 * t, 1.3 * t, 2.9 * t),
            };
            let [z, y, x] = euler_zyx_deg(&q);
            let back =
                about(Vector3::z_axis(), z) * about(Vector3::y_axis(), y) * about(Vector3::x_axis(), x);
            assert!(back.angle_to(&q) < 1e-7, "{i}: {z} {y} {x}");
            assert!(y.abs() <= 90.0);
        }
    }

    #[test]
    fn the_tool_points_into_the_work_along_the_same_travel() {
        let torch = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.0);
        let tool = into_work(&torch);
        assert!((tool * Vector3::z() + torch * Vector3::z()).norm() < 1e-12);
        assert!((tool * Vector3::y() - torch * Vector3::y()).norm() < 1e-12);
        assert!((tool * Vector3::x() + torch * Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn zero_has_no_sign() {
        assert_eq!(decimal::<3>(-0.0004), "0.000");
        assert_eq!(decimal::<2>(-1.234), "-1.23");
    }
}
