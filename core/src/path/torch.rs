//! Torch frame along the seam, and its stand-off (paper II-F, text before eq. (18)).
//!
//! Lengths are millimetres, directions are in the robot base frame.
//! Departure: the paper's `m` is an average of chords and need not be normal to `n`; we keep the part of it that is.

use crate::{Direction, Orientation, Point, Vector, math};

/// The travel direction is too short or parallel to the normal: no torch frame exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Degenerate;

/// Shortest travel that still has a direction, mm.
const MIN_TRAVEL_MM: f32 = 1e-4;

/// Columns `o = m × n`, `m`, `n` of the paper, right-handed; `normal` points out of the work.
///
/// ```
/// use weldpath_core::path::torch::{Degenerate, orientation};
/// use weldpath_core::{Direction, Vector};
///
/// let up = Direction::new_unchecked(Vector::z());
/// let base_from_torch = orientation(up, &Vector::new(5.0, 0.0, 0.1)).unwrap();
/// assert!((base_from_torch * Vector::y() - Vector::x()).norm() < 1e-6, "m is the part of the travel across n");
/// assert_eq!(orientation(up, &Vector::z()), Err(Degenerate));
/// ```
pub fn orientation(normal: Direction, travel_mm: &Vector) -> Result<Orientation, Degenerate> {
    let n = normal.into_inner();
    let along_mm = travel_mm - n * n.dot(travel_mm);
    // Against the travel itself: the rounding of a parallel one is no direction.
    let least_mm = MIN_TRAVEL_MM.max(1e-5 * math::norm(travel_mm));
    let m = math::direction(&along_mm, least_mm).ok_or(Degenerate)?.into_inner();
    Ok(crate::rotation::from_basis(&m.cross(&n), &m, &n))
}

/// Travel direction at `index`: the sum of the chords between the points within `window` of it, mm.
///
/// The paper averages the nearest chords; a sum of chords is the chord of the ends. Near the ends of the path the window
/// is cut, so every path of two distinct points or more has a travel direction everywhere.
pub fn travel_mm(path: &[Point], index: usize, window: usize) -> Result<Vector, Degenerate> {
    let reach = window.max(1);
    let last = path.len().checked_sub(1).ok_or(Degenerate)?;
    let before = path.get(index.saturating_sub(reach)).ok_or(Degenerate)?;
    let after = path.get(index.saturating_add(reach).min(last)).ok_or(Degenerate)?;
    let chord_mm = after - before;
    (index <= last && math::norm(&chord_mm) > MIN_TRAVEL_MM).then_some(chord_mm).ok_or(Degenerate)
}

/// Tip of the wire `standoff_mm` off the work: `p + d n`, `n` out of the work.
pub fn stand_off(point: &Point, normal: Direction, standoff_mm: f32) -> Point {
    point + normal.into_inner() * standoff_mm
}

#[cfg(test)]
mod tests {
    use super::*;

    fn up() -> Direction {
        Direction::new_unchecked(Vector::z())
    }

    #[test]
    fn the_columns_are_o_m_n_and_right_handed() {
        let q = orientation(up(), &Vector::new(0.0, 3.0, 1.0)).expect("a frame");
        let close = |a: Vector, b: Vector| (a - b).norm() < 1e-6;
        assert!(close(q * Vector::x(), Vector::x()), "o = m × n = y × z");
        assert!(close(q * Vector::y(), Vector::y()));
        assert!(close(q * Vector::z(), Vector::z()));
    }

    #[test]
    fn travel_along_the_normal_makes_no_frame() {
        assert_eq!(orientation(up(), &Vector::new(0.0, 0.0, 5.0)), Err(Degenerate));
        assert_eq!(orientation(up(), &Vector::zeros()), Err(Degenerate));
    }

    #[test]
    fn one_waypoint_makes_no_travel_and_two_do() {
        let path = [Point::origin(), Point::new(2.0, 0.0, 0.0)];
        assert_eq!(travel_mm(&path[..1], 0, 3), Err(Degenerate));
        assert_eq!(travel_mm(&path, 0, 3), Ok(Vector::new(2.0, 0.0, 0.0)));
        assert_eq!(travel_mm(&path, 1, usize::MAX), Ok(Vector::new(2.0, 0.0, 0.0)));
        assert_eq!(travel_mm(&path, 2, 1), Err(Degenerate));
    }

    #[test]
    fn stand_off_leaves_the_work() {
        assert_eq!(stand_off(&Point::new(1.0, 2.0, 3.0), up(), 12.0), Point::new(1.0, 2.0, 15.0));
    }
}
