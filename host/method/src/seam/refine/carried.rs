//! Directions across a curve as angles about it (ours): in axes that are carried along it without turning about it, a flat face or a
//! round wall keeps its angle, however the curve bends. In fixed axes its normal turns, and a curve stiff enough to hide the noise of
//! a short arc would not follow it.

use nalgebra::{Rotation3, Unit, Vector2, Vector3};
use std::f64::consts::{PI, TAU};

/// Shorter vectors have no direction.
const LEAST_LENGTH: f64 = 1e-9;

/// Two unit directions across a curve, square to each other.
type Axes = [Vector3<f64>; 2];

/// Axes at the places of a curve; those of a loop come round to themselves.
pub(super) fn axes(places: &[[f64; 3]], closed: bool) -> Option<Vec<Axes>> {
    let n = places.len();
    let place = |k: usize| Vector3::from(places[k]);
    let tangent = |k: usize| {
        let (from, to) =
            if closed { ((k + n - 1) % n, (k + 1) % n) } else { (k.saturating_sub(1), (k + 1).min(n - 1)) };
        Unit::try_new(place(to) - place(from), LEAST_LENGTH)
    };
    let tangents = (0..n).map(tangent).collect::<Option<Vec<_>>>()?;
    let start = tangents.first()?;
    let side = Vector3::ith_axis(start.iamin()).cross(start).normalize();
    let carried = |side: &Vector3<f64>, tangent: &Vector3<f64>| {
        (side - tangent * tangent.dot(side)).try_normalize(LEAST_LENGTH)
    };
    let mut sides = vec![side];
    for tangent in &tangents[1..] {
        sides.push(carried(&sides[sides.len() - 1], tangent)?);
    }
    let twist = if closed {
        let round = carried(&sides[n - 1], start)?;
        round.cross(&side).dot(start).atan2(round.dot(&side))
    } else {
        0.0
    };
    let axes = tangents.into_iter().zip(sides).enumerate().map(|(k, (tangent, side))| {
        let side = Rotation3::from_axis_angle(&tangent, twist * k as f64 / n as f64) * side;
        [side, tangent.cross(&side)]
    });
    Some(axes.collect())
}

/// Angles of two directions about a curve, rad: without jumps, whatever they are counted from.
pub(super) fn angles(axes: &[Axes], directions: &[[Vector3<f64>; 2]]) -> Vec<[f64; 2]> {
    let flat = |k: usize, way: usize| axes[k].map(|axis| axis.dot(&directions[k][way]));
    let mean = [0, 1].map(|way| {
        let sum = (0..axes.len()).map(|k| Vector2::from(flat(k, way))).sum::<Vector2<f64>>();
        sum.y.atan2(sum.x)
    });
    let angle = |k: usize, way: usize| {
        let [x, y] = flat(k, way);
        mean[way] + (y.atan2(x) - mean[way] + PI).rem_euclid(TAU) - PI
    };
    (0..axes.len()).map(|k| [angle(k, 0), angle(k, 1)]).collect()
}

/// The direction across a curve at this angle about it.
pub(super) fn direction(axes: &Axes, angle: f64) -> Vector3<f64> {
    axes[0] * angle.cos() + axes[1] * angle.sin()
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: usize = 60;

    fn turned(k: usize) -> (f64, f64) {
        (TAU * k as f64 / COUNT as f64).sin_cos()
    }

    /// Angles of a direction along a curve, over the first of them, rad.
    fn turns(places: &[[f64; 3]], closed: bool, way: impl Fn(usize) -> Vector3<f64>) -> Vec<f64> {
        let axes = axes(places, closed).expect("a curve");
        let ways: Vec<[Vector3<f64>; 2]> = (0..places.len()).map(|k| [way(k), -way(k)]).collect();
        let angles = angles(&axes, &ways);
        for (k, angles) in angles.iter().enumerate() {
            let back = angles.map(|angle| direction(&axes[k], angle));
            assert!(back[0].dot(&way(k).normalize()) > 0.999 && (back[0] + back[1]).norm() < 1e-9, "{k}");
        }
        angles.iter().map(|both| both[0] - angles[0][0]).collect()
    }

    #[test]
    fn plate_and_wall_along_an_arc_keep_their_angles() {
        let places: Vec<[f64; 3]> =
            (0..COUNT / 2).map(turned).map(|(sin, cos)| [40.0 * cos, 40.0 * sin, 5.0]).collect();
        let inward = |k: usize| Vector3::new(-turned(k).1, -turned(k).0, 0.0);
        // At its ends the tangent is that of a chord.
        for turn in [turns(&places, false, |_| Vector3::z()), turns(&places, false, inward)].concat() {
            assert!(turn.abs() < 1e-9, "{turn}");
        }
    }

    #[test]
    fn axes_of_a_loop_that_is_not_flat_come_round_to_themselves() {
        let wavy = |k: usize| {
            let (sin, cos) = turned(k);
            Vector3::new(40.0 * cos, 40.0 * sin, 12.0 * (2.0 * cos * cos - 1.0) + 6.0 * sin * cos)
        };
        let places: Vec<[f64; 3]> = (0..COUNT).map(|k| wavy(k).into()).collect();
        let axes = axes(&places, true).expect("a loop");
        let step = |k: usize| axes[k][0].angle(&axes[(k + 1) % COUNT][0]);
        let longest = (0..COUNT - 1).map(step).fold(0.0, f64::max);
        assert!(step(COUNT - 1) < 1.5 * longest, "{} after at most {longest}", step(COUNT - 1));
        let out = |k: usize| Vector3::new(turned(k).1, turned(k).0, 0.0);
        let turns = turns(&places, true, out);
        let jump = turns.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        assert!(jump < 0.2, "{jump} rad from one place to the next");
    }

    #[test]
    fn places_that_are_one_have_no_axes() {
        assert!(axes(&[[1.0; 3]; 5], false).is_none());
    }
}
