//! Loops whose last stretch shows no corners (ours): edge points fade where the faces open, as on the flanks of a saddle.
//!
//! A chain whose ends look at each other along one arc, in keeping with its own curvature, is closed by that arc; the raw
//! points beside it then tell whether the seam is there.

use super::obstruction;
use super::{Chain, ChainLink};
use crate::geometry::grid::Grid;
use nalgebra::Vector3;

// All chosen on the simulated scans.

/// Longest stretch that is closed, as a share of the chain.
const LONGEST_SHARE: f32 = 0.25;
/// Fewer links have no curvature to go by.
const LEAST_LINKS: usize = 12;
/// Largest turn over half the stretch, and largest difference between its halves, degrees.
const HALF_TURN_DEG: f32 = 60.0;
const UNEVEN_DEG: f32 = 25.0;
/// Factor within which the stretch must bend as the chain does, and what is allowed besides, degrees.
const BEND_FACTOR: f32 = 2.5;
const SLACK_DEG: f32 = 15.0;
/// Largest change of a face's normal besides the turn, degrees.
const FACE_DEG: f32 = 35.0;

/// Shorter sums of face normals, and slopes of the arc, mm, have no direction.
const LEAST_NORMAL: f32 = 1e-3;
const LEAST_SLOPE_MM: f32 = 1e-6;

/// The chain closed by an arc from its last link to its first, if it asks for one.
pub fn closed(chain: &Chain, model: &Grid, voxel_mm: f32, step_mm: f32) -> Option<Chain> {
    let (first, last) = (chain.links.first()?, chain.links.last()?);
    let way = first.position - last.position;
    let length = chain.length_mm();
    if chain.closed || chain.links.len() < LEAST_LINKS || way.norm() > LONGEST_SHARE * length {
        return None;
    }
    let turns = [angle_deg(&last.direction, &way), angle_deg(&way, &first.direction)];
    let turn = turns[0] + turns[1];
    let usual: f32 = chain.links.windows(2).map(|w| angle_deg(&w[0].direction, &w[1].direction)).sum::<f32>()
        * way.norm()
        / length;
    let even = turns[0].max(turns[1]) < HALF_TURN_DEG && (turns[0] - turns[1]).abs() < UNEVEN_DEG;
    let bends_alike = turn < BEND_FACTOR * usual + SLACK_DEG && usual < BEND_FACTOR * turn + SLACK_DEG;
    let same_faces = (0..2).all(|k| angle_deg(&first.faces[k], &last.faces[k]) < turn + FACE_DEG);
    if !(even && bends_alike && same_faces) {
        return None;
    }
    let arc = arc(last, first, &way, step_mm)?;
    let around: Vec<&ChainLink> = std::iter::once(last).chain(&arc).chain([first]).collect();
    let free = around
        .windows(2)
        .all(|w| !obstruction::blocked(model, voxel_mm, &w[0].position, &w[1].position, &w[0].faces));
    free.then(|| Chain {
        links: chain.links.iter().copied().chain(arc).collect(),
        closed: true,
        ..chain.clone()
    })
}

fn angle_deg(a: &Vector3<f32>, b: &Vector3<f32>) -> f32 {
    a.angle(b).to_degrees()
}

/// Links on the cubic that leaves one link and arrives at the other in their directions.
fn arc(from: &ChainLink, to: &ChainLink, way: &Vector3<f32>, step_mm: f32) -> Option<Vec<ChainLink>> {
    let size = way.norm();
    let count = (size / step_mm).round().max(1.0) as usize;
    (1..count)
        .map(|k| {
            let t = k as f32 / count as f32;
            let (t2, t3) = (t * t, t * t * t);
            let (leave, arrive) = (from.direction * size, to.direction * size);
            let offset = leave * (t3 - 2.0 * t2 + t) + way * (3.0 * t2 - 2.0 * t3) + arrive * (t3 - t2);
            let slope = leave * (3.0 * t2 - 4.0 * t + 1.0)
                + way * (6.0 * t - 6.0 * t2)
                + arrive * (3.0 * t2 - 2.0 * t);
            let face = |k: usize| (from.faces[k] * (1.0 - t) + to.faces[k] * t).try_normalize(LEAST_NORMAL);
            Some(ChainLink {
                position: from.position + offset,
                direction: slope.try_normalize(LEAST_SLOPE_MM)?,
                faces: [face(0)?, face(1)?],
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// A fillet about a tube of 30 mm, open from `gap_deg` before its end.
    fn ring(gap_deg: f32) -> Chain {
        let link = |deg: f32| {
            let (sin, cos) = deg.to_radians().sin_cos();
            let out = Vector3::new(cos, sin, 0.0);
            ChainLink {
                position: Point3::origin() + out * 30.0,
                direction: Vector3::new(-sin, cos, 0.0),
                faces: [Vector3::z(), out],
            }
        };
        let count = ((360.0 - gap_deg) / 4.0) as usize;
        Chain { links: (0..=count).map(|k| link(4.0 * k as f32)).collect(), ..Chain::default() }
    }

    #[test]
    fn a_ring_that_lacks_40_degrees_is_closed_on_its_circle() {
        let chain = closed(&ring(40.0), &Grid::default(), 1.2, 2.0).expect("a loop");
        assert!(chain.closed);
        let worst = chain.links.iter().map(|l| (l.position.coords.norm() - 30.0).abs()).fold(0.0, f32::max);
        assert!(worst < 0.2, "{worst} mm off the circle");
    }

    #[test]
    fn a_half_ring_and_a_line_stay_open() {
        assert!(closed(&ring(180.0), &Grid::default(), 1.2, 2.0).is_none());
        let mut line = ring(40.0);
        for (k, link) in line.links.iter_mut().enumerate() {
            (link.position, link.direction) = (Point3::new(2.0 * k as f32, 0.0, 0.0), Vector3::x());
        }
        assert!(closed(&line, &Grid::default(), 1.2, 2.0).is_none());
    }

    #[test]
    fn nothing_is_closed_through_a_wall() {
        let wall: Vec<Point3<f32>> =
            (0..400).map(|k| Point3::new(20.0 + (k % 20) as f32, -10.0, (k / 20) as f32)).collect();
        assert!(closed(&ring(40.0), &Grid::new(&wall, 4.0), 1.2, 2.0).is_none());
    }
}
