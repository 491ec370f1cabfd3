//! Corners strung into chains: order, direction, closed loops (ours).
//!
//! A trace starts at the best supported corner and walks along its line in both directions, from one averaged corner to
//! the next, while direction and both faces agree. It ends at a junction by itself, because there a face changes, and it
//! is closed when it comes back to its start.

use super::obstruction;
use super::{Chain, ChainLink, InsideCorner};
use crate::geometry::grid::Grid;
use nalgebra::{Point3, Vector3};

/// How traces walk, in voxels and degrees. The defaults were chosen on the simulated scans.
#[derive(Debug, Clone, Copy)]
pub struct TraceConfig {
    /// Step along the line, voxels.
    pub step_voxels: f32,
    /// Farthest step that is tried where corners are missing, in steps.
    pub longest_step: usize,
    /// Farthest that a corner may lie beside the trace, voxels.
    pub beside_voxels: f32,
    /// Largest change of direction over a step, degrees.
    pub turn_deg: f32,
    /// Largest change of a face's normal over a step, degrees.
    pub tilt_deg: f32,
    /// Shortest seam, voxels.
    pub shortest_voxels: f32,
    /// The same where it goes on round a corner of a longer one, as at the end of a rib, voxels.
    pub shortest_end_voxels: f32,
}

impl Default for TraceConfig {
    fn default() -> Self {
        Self {
            step_voxels: 1.7,
            longest_step: 4,
            beside_voxels: 1.2,
            turn_deg: 18.0,
            tilt_deg: 22.0,
            shortest_voxels: 12.0,
            // As many steps as make the least number of stations of a refined seam.
            shortest_end_voxels: 7.65,
        }
    }
}

impl TraceConfig {
    /// For what is too short or too scattered to be offered.
    pub(crate) fn faint(&self) -> Self {
        Self { shortest_voxels: self.shortest_end_voxels, ..self.blurred() }
    }

    /// For valleys whose faces blend into each other: single corners there scatter and lean with where they were fitted.
    pub fn blurred(&self) -> Self {
        Self { step_voxels: 2.5, beside_voxels: 2.5, turn_deg: 30.0, tilt_deg: 40.0, ..*self }
    }
}

// All chosen on the simulated scans.

/// Corners that support each other lie within this, voxels; and fewer of them begin no trace.
const SUPPORT_VOXELS: f32 = 3.0;
const LEAST_SUPPORT: usize = 4;
/// Half length of the stretch whose corners are averaged to a link, in steps: neighbouring links share some.
const HALF_STEPS: f32 = 0.75;
/// Fewer corners make no link.
const LEAST_CORNERS: usize = 2;
/// Share of its last turn by which a trace is expected to turn on.
const TURNS_ON: f32 = 0.5;
/// Least advance of a trace, in steps.
const LEAST_ADVANCE: f32 = 0.3;
/// A trace is home this near to its start, in steps, in about its direction, after more than so many links.
const HOME_STEPS: f32 = 1.01;
const HOME_LINKS: usize = 6;
/// Cosine of directions that count as one.
const SAME_DIRECTION: f32 = 0.8;
/// Corners belong to a chain within this share of so many steps of a link; steps below a voxel count as one.
const CLAIM_STEPS: f32 = 2.5;
const CLAIM_SHARE: f32 = 0.6;
/// A ghost has less than this share of another chain's corners to a link, and runs beside it for most of its links within
/// this distance, voxels.
const GHOST_SHARE: f32 = 0.6;
const GHOST_VOXELS: f32 = 5.0;
/// The same for the other side of a round wall, which is seen at a slant over its rim, if at all: between 0.48, the inside of
/// a pipe that came out 1.5 degrees off, and 0.30, one that no two views saw. The other side of a flat wall is never a ghost.
const ROUND_GHOST_SHARE: f32 = 0.4;
/// Links beyond one for every corner that no trace needs.
const SPARE_LINKS: usize = 16;

/// Chains, best supported first.
#[derive(Debug, Default)]
pub struct Traced {
    /// Those that are long enough to be seams.
    pub chains: Vec<Chain>,
    /// Those that may be the end of one, round a corner.
    pub short: Vec<Chain>,
}

/// All chains; `model` is what may stand in their way.
pub fn trace(corners: &[InsideCorner], model: &Grid, voxel_mm: f32, config: &TraceConfig) -> Traced {
    let positions: Vec<_> = corners.iter().map(|c| c.position).collect();
    let grid = Grid::new(&positions, SUPPORT_VOXELS * voxel_mm);
    let mut tracer = Tracer { corners, grid, model, used: vec![false; corners.len()], voxel_mm, config };
    let mut seeds: Vec<(usize, usize)> = (0..corners.len()).map(|k| (tracer.support(k), k)).collect();
    seeds.sort_unstable_by(|a, b| b.cmp(a));
    let mut traced = Traced::default();
    for (support, seed) in seeds {
        if support < LEAST_SUPPORT || tracer.used[seed] {
            continue;
        }
        let chain = tracer.grow(seed);
        let length_voxels = chain.length_mm() / voxel_mm;
        if length_voxels < config.shortest_end_voxels || is_ghost(&chain, &traced.chains, voxel_mm) {
            continue;
        }
        if length_voxels >= config.shortest_voxels { &mut traced.chains } else { &mut traced.short }
            .push(chain);
    }
    traced
}

/// Whether a weak chain runs along a strong one: the same corner seen a second time, with a lip for a face.
fn is_ghost(chain: &Chain, others: &[Chain], voxel_mm: f32) -> bool {
    let density = |c: &Chain| c.support as f32 / c.links.len() as f32;
    let behind_share = if is_flat(chain) { 0.0 } else { ROUND_GHOST_SHARE };
    others.iter().any(|other| {
        let share = density(chain) / density(other);
        let beside = |a: &ChainLink, b: &ChainLink| {
            (a.position - b.position).norm() < GHOST_VOXELS * voxel_mm
                && a.direction.dot(&b.direction).abs() > SAME_DIRECTION
                && share < if is_behind(a, b) { behind_share } else { GHOST_SHARE }
        };
        let shadowed = chain.links.iter().filter(|a| other.links.iter().any(|b| beside(a, b))).count();
        2 * shadowed > chain.links.len()
    })
}

/// Whether both faces keep their directions from end to end, as those of a rib do.
fn is_flat(chain: &Chain) -> bool {
    let (Some(first), Some(last)) = (chain.links.first(), chain.links.last()) else { return false };
    (0..2).all(|k| first.faces[k].dot(&last.faces[k]) > SAME_DIRECTION)
}

/// Whether a face of `a` is the other side of the wall that is a face of `b`.
fn is_behind(a: &ChainLink, b: &ChainLink) -> bool {
    let apart = a.position - b.position;
    let backs = |face: &Vector3<f32>, other: &Vector3<f32>| {
        face.dot(other) < -SAME_DIRECTION && face.dot(&apart) > 0.0
    };
    a.faces.iter().any(|face| b.faces.iter().any(|other| backs(face, other)))
}

/// The corners of a cloud while chains are traced through them.
struct Tracer<'a> {
    corners: &'a [InsideCorner],
    grid: Grid,
    model: &'a Grid,
    used: Vec<bool>,
    voxel_mm: f32,
    config: &'a TraceConfig,
}

impl Tracer<'_> {
    /// Corners near a corner that continue it.
    fn support(&self, k: usize) -> usize {
        let c = &self.corners[k];
        let link = ChainLink::from(c);
        let mut count = 0;
        self.grid.within(&c.position, SUPPORT_VOXELS * self.voxel_mm, |slot, _| {
            count += usize::from(self.agrees(&self.corners[self.grid.index(slot)], &link).is_some());
        });
        count
    }

    /// A corner turned to agree with a link, if it can be.
    fn agrees(&self, c: &InsideCorner, link: &ChainLink) -> Option<ChainLink> {
        let sign = c.direction.dot(&link.direction).signum();
        let direction = c.direction * sign;
        if direction.dot(&link.direction) < self.config.turn_deg.to_radians().cos() {
            return None;
        }
        let tilt = self.config.tilt_deg.to_radians().cos();
        let fits = |a: usize, b: usize| link.faces[0].dot(&c.faces[a]).min(link.faces[1].dot(&c.faces[b]));
        let (straight, swapped) = (fits(0, 1), fits(1, 0));
        let faces = if straight >= swapped { c.faces } else { [c.faces[1], c.faces[0]] };
        (straight.max(swapped) > tilt).then_some(ChainLink { position: c.position, direction, faces })
    }

    /// The average of the corners about a place ahead that agree with the link.
    fn average(&self, ahead: &Point3<f32>, link: &ChainLink) -> Option<ChainLink> {
        let half = HALF_STEPS * self.config.step_voxels * self.voxel_mm;
        let beside = self.config.beside_voxels * self.voxel_mm;
        let (mut place, mut direction, mut faces, mut count) =
            (Vector3::zeros(), Vector3::zeros(), [Vector3::zeros(); 2], 0);
        self.grid.within(ahead, half.hypot(beside), |slot, _| {
            let Some(c) = self.agrees(&self.corners[self.grid.index(slot)], link) else { return };
            let d = c.position - ahead;
            let along = d.dot(&link.direction);
            if along.abs() > half || (d - link.direction * along).norm() > beside {
                return;
            }
            // Slide each corner along its own line to the cross-section ahead.
            place += d - c.direction * (along / c.direction.dot(&link.direction));
            direction += c.direction;
            faces[0] += c.faces[0];
            faces[1] += c.faces[1];
            count += 1;
        });
        (count >= LEAST_CORNERS).then(|| {
            let position = ahead + place / count as f32;
            ChainLink { position, direction: direction.normalize(), faces: faces.map(|f| f.normalize()) }
        })
    }

    /// The chain through a corner, both ways.
    fn grow(&mut self, seed: usize) -> Chain {
        let c = self.corners[seed];
        let raw = ChainLink::from(&c);
        let start = self.average(&c.position, &raw).unwrap_or(raw);
        let mut chain = Chain { links: vec![start], ..Chain::default() };
        self.walk(&mut chain, &[]);
        if !chain.closed {
            let mut back = Chain::default();
            back.links.push(ChainLink { direction: -start.direction, ..start });
            self.walk(&mut back, &chain.links);
            let reversed = back.links.iter().skip(1).rev();
            let turned = reversed.map(|l| ChainLink { direction: -l.direction, ..*l });
            chain.links = turned.chain(chain.links.iter().copied()).collect();
        }
        let mine = self.claim(&chain);
        chain.support = mine.len();
        chain.share = mine.iter().map(|&k| self.corners[k].share).sum::<f32>() / mine.len().max(1) as f32;
        chain
    }

    /// Walks on from the last link until nothing agrees or the start comes round.
    fn walk(&self, chain: &mut Chain, ahead_of: &[ChainLink]) {
        let step = self.config.step_voxels * self.voxel_mm;
        let limit = self.corners.len() + SPARE_LINKS;
        while chain.links.len() < limit {
            let Some(last) = chain.links.last().copied() else { return };
            let Some(link) = self.next(chain, &last, step) else { return };
            if (link.position - last.position).dot(&last.direction) < LEAST_ADVANCE * step {
                return;
            }
            let first = chain.links[0];
            let home = (link.position - first.position).norm() < HOME_STEPS * step
                && link.direction.dot(&first.direction) > SAME_DIRECTION;
            if home && chain.links.len() > HOME_LINKS {
                chain.closed = ahead_of.is_empty();
                return;
            }
            let met = |l: &ChainLink| {
                (l.position - link.position).norm() < step
                    && l.direction.dot(&link.direction) < -SAME_DIRECTION
            };
            if ahead_of.iter().any(met) {
                return;
            }
            chain.links.push(link);
        }
    }

    /// The nearest link ahead of the last one that is not taken and to which the air is free.
    fn next(&self, chain: &Chain, last: &ChainLink, step: f32) -> Option<ChainLink> {
        let bend = chain.links.iter().rev().nth(1).map_or(last.direction, |before| {
            // Look ahead along the curve: the direction turns on as it turned before.
            (last.direction + (last.direction - before.direction) * TURNS_ON).normalize()
        });
        (1..=self.config.longest_step).find_map(|k| {
            let ahead = last.position + bend * (step * k as f32);
            let probe = ChainLink { direction: bend, ..*last };
            self.average(&ahead, &probe).filter(|l| {
                !self.taken(&l.position)
                    && !obstruction::blocked(
                        self.model,
                        self.voxel_mm,
                        &last.position,
                        &l.position,
                        &last.faces,
                    )
            })
        })
    }

    /// Whether all corners about a place belong to chains.
    fn taken(&self, place: &Point3<f32>) -> bool {
        let mut free = false;
        let mut any = false;
        self.grid.within(place, self.voxel_mm, |slot, _| {
            any = true;
            free |= !self.used[self.grid.index(slot)];
        });
        any && !free
    }

    /// Marks the corners beside a chain as used, and returns them.
    fn claim(&mut self, chain: &Chain) -> Vec<usize> {
        let reach = CLAIM_STEPS * self.config.step_voxels.max(1.0) * self.voxel_mm * CLAIM_SHARE;
        let mut mine = Vec::new();
        for link in &chain.links {
            self.grid.within(&link.position, reach, |slot, _| {
                let k = self.grid.index(slot);
                if !self.used[k] && self.agrees(&self.corners[k], link).is_some() {
                    mine.push(k);
                }
            });
        }
        mine.sort_unstable();
        mine.dedup();
        mine.iter().for_each(|&k| self.used[k] = true);
        mine
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along x at `y_mm`, on the floor, with a wall that faces `wall`, and so many corners to a link.
    fn foot(y_mm: f32, wall: Vector3<f32>, corners_to_a_link: usize) -> Chain {
        let link = |k: usize| ChainLink {
            position: Point3::new(2.0 * k as f32, y_mm, 0.0),
            direction: Vector3::x(),
            faces: [Vector3::z(), wall],
        };
        Chain { links: (0..20).map(link).collect(), support: 20 * corners_to_a_link, ..Chain::default() }
    }

    #[test]
    fn the_worse_seen_side_of_a_thin_rib_is_no_ghost_of_the_other() {
        let strong = [foot(0.0, Vector3::y(), 6)];
        assert!(!is_ghost(&foot(-5.0, -Vector3::y(), 2), &strong, 1.2), "5 mm behind, facing away");
        assert!(is_ghost(&foot(-1.0, Vector3::y(), 2), &strong, 1.2), "the same wall again");
        assert!(is_ghost(&foot(1.0, -Vector3::y(), 2), &strong, 1.2), "a face in front that looks back");
        // The inside of a tube's wall turns as it goes.
        let inside = |corners_to_a_link| {
            let mut chain = foot(-5.0, -Vector3::y(), corners_to_a_link);
            for (k, link) in chain.links.iter_mut().enumerate() {
                let turn_rad = 0.05 * k as f32;
                link.faces[1] = Vector3::new(turn_rad.sin(), -turn_rad.cos(), 0.0);
            }
            chain
        };
        assert!(is_ghost(&inside(2), &strong, 1.2) && !is_ghost(&inside(3), &strong, 1.2));
    }
}
