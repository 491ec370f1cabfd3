//! Chains that go on in each other (ours): a trace may stop where corners are missing, and begin anew beyond, and a weld
//! goes on round the end of a rib.

use super::obstruction;
use super::{Chain, ChainLink};
use crate::geometry::grid::Grid;
use nalgebra::Vector3;

// All chosen on the simulated scans.

/// Farthest gap and overlap between two ends, and farthest that they may lie beside each other, voxels.
const GAP_VOXELS: f32 = 8.0;
const OVERLAP_VOXELS: f32 = 8.0;
const BESIDE_VOXELS: f32 = 1.5;
/// Links of the second chain that are not this far past the end of the first lie beside it, voxels.
const PAST_VOXELS: f32 = 0.5;
/// Cosines of the largest change of direction and of a face.
const SAME_DIRECTION: f32 = 0.95;
const SAME_FACE: f32 = 0.9;

/// Farthest that the ends of two chains may be from each other across the corner round which a weld goes, voxels: each
/// stops where the other's wall comes into the radius of a fit.
const CORNER_VOXELS: f32 = 6.0;
/// Farthest that one end may be off the face that both share, voxels, and cosine of directions between which is a corner.
const OFF_FACE_VOXELS: f32 = 1.0;
const CORNER_TURNS: f32 = 0.8;

/// All chains, those joined that continue each other with free air between them.
pub fn joined(mut chains: Vec<Chain>, model: &Grid, voxel_mm: f32) -> Vec<Chain> {
    let mut k = 0;
    while k < chains.len() {
        let next = (k + 1..chains.len())
            .find_map(|j| Some((j, either_way(&chains[k], &chains[j], model, voxel_mm)?)));
        match next {
            Some((j, whole)) => {
                chains.swap_remove(j);
                chains[k] = whole;
            }
            None => k += 1,
        }
    }
    chains
}

/// Those of the `short` chains that begin or end where a long one does, round a corner and on a face of both: too short to
/// be a seam by themselves, they are the end of one.
pub(crate) fn round_corners(mut short: Vec<Chain>, long: &[Chain], voxel_mm: f32) -> Vec<Chain> {
    let ends_of = |c: &Chain| [c.links.first().copied(), c.links.last().copied()].into_iter().flatten();
    let ends: Vec<ChainLink> = long.iter().filter(|c| !c.closed).flat_map(ends_of).collect();
    short.retain(|c| ends_of(c).any(|a| ends.iter().any(|b| meet_round_corner(&a, b, voxel_mm))));
    short
}

fn meet_round_corner(a: &ChainLink, b: &ChainLink, voxel_mm: f32) -> bool {
    let apart = b.position - a.position;
    let is_shared = |face: &Vector3<f32>| {
        face.dot(&apart).abs() < OFF_FACE_VOXELS * voxel_mm && b.faces.iter().any(|f| face.dot(f) > SAME_FACE)
    };
    apart.norm() < CORNER_VOXELS * voxel_mm
        && a.direction.dot(&b.direction).abs() < CORNER_TURNS
        && a.faces.iter().any(is_shared)
}

fn either_way(a: &Chain, b: &Chain, model: &Grid, voxel_mm: f32) -> Option<Chain> {
    if a.closed || b.closed {
        return None;
    }
    let (back_a, back_b) = (reversed(a), reversed(b));
    let pairs = [(a, b), (a, &back_b), (&back_a, b), (&back_a, &back_b)];
    pairs.into_iter().find_map(|(first, second)| end_to_end(first, second, model, voxel_mm))
}

fn reversed(chain: &Chain) -> Chain {
    let links = chain.links.iter().rev().map(|l| ChainLink { direction: -l.direction, ..*l }).collect();
    Chain { links, ..chain.clone() }
}

/// `a` continued by `b`, if `b` begins where `a` ends.
fn end_to_end(a: &Chain, b: &Chain, model: &Grid, voxel_mm: f32) -> Option<Chain> {
    let (end, start) = (a.links.last()?, b.links.first()?);
    let ahead = |l: &ChainLink| (l.position - end.position).dot(&end.direction);
    let way = start.position - end.position;
    let beside = (way - end.direction * ahead(start)).norm();
    let near = ahead(start) < GAP_VOXELS * voxel_mm
        && ahead(start) > -OVERLAP_VOXELS * voxel_mm
        && beside < BESIDE_VOXELS * voxel_mm;
    let fits = |k: usize, l: usize| end.faces[0].dot(&start.faces[k]).min(end.faces[1].dot(&start.faces[l]));
    let swapped = fits(1, 0) > fits(0, 1);
    let same = end.direction.dot(&start.direction) > SAME_DIRECTION && fits(0, 1).max(fits(1, 0)) > SAME_FACE;
    if !near || !same || obstruction::blocked(model, voxel_mm, &end.position, &start.position, &end.faces) {
        return None;
    }
    let rest: Vec<ChainLink> =
        b.links.iter().skip_while(|l| ahead(l) < PAST_VOXELS * voxel_mm).copied().collect();
    let turned = |l: ChainLink| if swapped { ChainLink { faces: [l.faces[1], l.faces[0]], ..l } } else { l };
    let support = a.support + b.support;
    let part = |c: &Chain| c.share * c.support as f32 / support.max(1) as f32;
    Some(Chain {
        links: a.links.iter().copied().chain(rest.into_iter().map(turned)).collect(),
        closed: false,
        support,
        share: part(a) + part(b),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    fn fillet(from_mm: f32, to_mm: f32) -> Chain {
        let link = |k: usize| ChainLink {
            position: Point3::new(from_mm + 2.0 * k as f32, 0.0, 0.0),
            direction: Vector3::x(),
            faces: [Vector3::y(), Vector3::z()],
        };
        let links: Vec<ChainLink> = (0..=((to_mm - from_mm) / 2.0) as usize).map(link).collect();
        Chain { support: 3 * links.len(), links, share: 0.9, ..Chain::default() }
    }

    #[test]
    fn two_halves_of_a_fillet_are_one_whichever_way_they_run() {
        for second in [fillet(46.0, 90.0), reversed(&fillet(46.0, 90.0)), fillet(36.0, 90.0)] {
            let one = joined(vec![fillet(0.0, 40.0), second], &Grid::default(), 1.2);
            assert_eq!(one.len(), 1);
            let xs: Vec<f32> = one[0].links.iter().map(|l| l.position.x).collect();
            let monotone = xs.windows(2).all(|w| w[1] > w[0]) || xs.windows(2).all(|w| w[1] < w[0]);
            assert!(monotone, "{xs:?}");
            assert!((one[0].length_mm() - 90.0).abs() < 1.0);
        }
    }

    #[test]
    fn a_wall_between_them_keeps_them_apart() {
        let wall: Vec<Point3<f32>> =
            (0..400).map(|k| Point3::new(43.0, (k % 20) as f32, (k / 20) as f32)).collect();
        assert_eq!(joined(vec![fillet(0.0, 40.0), fillet(46.0, 90.0)], &Grid::new(&wall, 4.0), 1.2).len(), 2);
    }

    #[test]
    fn a_short_chain_counts_where_it_goes_round_the_end_of_a_long_one() {
        // Across the end of a rib whose side the long one runs along: on the plate, 4 mm beyond and to the rib's side.
        let end = |at: Point3<f32>| {
            let link = |k: usize| ChainLink {
                position: at - Vector3::y() * (2.0 * k as f32),
                direction: -Vector3::y(),
                faces: [Vector3::x(), Vector3::z()],
            };
            Chain { links: (0..6).map(link).collect(), ..Chain::default() }
        };
        let kept = |short: Chain| round_corners(vec![short], &[fillet(0.0, 40.0)], 1.2).len();
        assert_eq!(kept(end(Point3::new(43.0, -3.0, 0.0))), 1);
        assert_eq!(kept(end(Point3::new(43.0, -30.0, 0.0))), 0, "far from any end");
        assert_eq!(kept(end(Point3::new(20.0, -3.0, 0.0))), 0, "beside the middle of the long one");
        assert_eq!(kept(end(Point3::new(43.0, -3.0, 4.0))), 0, "on another level");
        assert_eq!(kept(fillet(44.0, 54.0)), 0, "straight on there is no corner");
    }
}
