//! Torch frame along the seam (paper II-F, text before eq. (18)).
//!
//! Lengths are millimetres, directions are in the robot base frame.
//! Departure: the paper's `m` is an average of chords and need not be normal to `n`; we keep the part of it that is.

use crate::{Direction, Orientation, Vector, math};

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
}
