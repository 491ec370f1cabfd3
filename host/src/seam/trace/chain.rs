//! Corners strung into seams: order, direction, closed loops (ours; the paper does not say how edge points are ordered).
//!
//! A trace starts at the best supported corner and walks along its line in both directions, from one averaged corner to
//! the next, while direction and both faces agree. It ends at a junction by itself, because there a face changes, and it
//! is closed when it comes back to its start.

use crate::geometry::grid::Grid;
use crate::seam::trace::corner::Corner;
use crate::seam::trace::obstruction;
use nalgebra::{Point3, Vector3};

/// How traces walk, in voxels and degrees.
#[derive(Debug, Clone, Copy)]
pub struct Config {
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
}

impl Default for Config {
    fn default() -> Self {
        Self {
            step_voxels: 1.7,
            longest_step: 4,
            beside_voxels: 1.2,
            turn_deg: 18.0,
            tilt_deg: 22.0,
            shortest_voxels: 12.0,
        }
    }
}

impl Config {
    /// For valleys whose faces blend into each other: single corners there scatter and lean with where they were fitted.
    pub fn blurred(&self) -> Self {
        Self { step_voxels: 2.5, beside_voxels: 2.5, turn_deg: 30.0, tilt_deg: 40.0, ..*self }
    }
}

/// An ordered run of corners. The first of `faces` is the same face all along.
#[derive(Debug, Clone, Default)]
pub struct Chain {
    /// In order.
    pub links: Vec<Link>,
    /// Whether the last is followed by the first.
    pub closed: bool,
    /// Number of corners that support it.
    pub support: usize,
    /// Mean share of the points about its corners that lie on the two faces.
    pub share: f32,
}

/// One averaged corner of a chain.
#[derive(Debug, Clone, Copy)]
pub struct Link {
    /// On the line, mm.
    pub position: Point3<f32>,
    /// Unit, along the chain.
    pub direction: Vector3<f32>,
    /// Unit normals of the faces.
    pub faces: [Vector3<f32>; 2],
}

impl Chain {
    /// Length along the links, mm.
    pub fn length_mm(&self) -> f32 {
        self.links.windows(2).map(|w| (w[1].position - w[0].position).norm()).sum()
    }
}

/// All chains, best supported first; `model` is what may stand in their way.
pub fn trace(corners: &[Corner], model: &Grid, voxel_mm: f32, config: &Config) -> Vec<Chain> {
    let positions: Vec<_> = corners.iter().map(|c| c.position).collect();
    let grid = Grid::new(&positions, 3.0 * voxel_mm);
    let mut tracer = Tracer { corners, grid, model, used: vec![false; corners.len()], voxel_mm, config };
    let mut seeds: Vec<(usize, usize)> = (0..corners.len()).map(|k| (tracer.support(k), k)).collect();
    seeds.sort_unstable_by(|a, b| b.cmp(a));
    let mut chains = Vec::new();
    for (support, seed) in seeds {
        if support < 4 || tracer.used[seed] {
            continue;
        }
        let chain = tracer.grow(seed);
        if chain.length_mm() >= config.shortest_voxels * voxel_mm && !is_ghost(&chain, &chains, voxel_mm) {
            chains.push(chain);
        }
    }
    chains
}

/// Whether a weak chain runs along a strong one: the same corner seen a second time, with a lip for a face.
fn is_ghost(chain: &Chain, others: &[Chain], voxel_mm: f32) -> bool {
    let density = |c: &Chain| c.support as f32 / c.links.len() as f32;
    let beside = |a: &Link, b: &Link| {
        (a.position - b.position).norm() < 5.0 * voxel_mm && a.direction.dot(&b.direction).abs() > 0.8
    };
    others.iter().filter(|o| density(chain) < 0.6 * density(o)).any(|other| {
        let shadowed = chain.links.iter().filter(|a| other.links.iter().any(|b| beside(a, b))).count();
        2 * shadowed > chain.links.len()
    })
}

struct Tracer<'a> {
    corners: &'a [Corner],
    grid: Grid,
    model: &'a Grid,
    used: Vec<bool>,
    voxel_mm: f32,
    config: &'a Config,
}

impl Tracer<'_> {
    /// Corners near a corner that continue it.
    fn support(&self, k: usize) -> usize {
        let c = &self.corners[k];
        let link = Link { position: c.position, direction: c.direction, faces: c.faces };
        let mut count = 0;
        self.grid.within(&c.position, 3.0 * self.voxel_mm, |slot, _| {
            count += usize::from(self.agrees(&self.corners[self.grid.index(slot)], &link).is_some());
        });
        count
    }

    /// A corner turned to agree with a link, if it can be.
    fn agrees(&self, c: &Corner, link: &Link) -> Option<Link> {
        let sign = c.direction.dot(&link.direction).signum();
        let direction = c.direction * sign;
        if direction.dot(&link.direction) < self.config.turn_deg.to_radians().cos() {
            return None;
        }
        let tilt = self.config.tilt_deg.to_radians().cos();
        let fits = |a: usize, b: usize| link.faces[0].dot(&c.faces[a]).min(link.faces[1].dot(&c.faces[b]));
        let (straight, swapped) = (fits(0, 1), fits(1, 0));
        let faces = if straight >= swapped { c.faces } else { [c.faces[1], c.faces[0]] };
        (straight.max(swapped) > tilt).then_some(Link { position: c.position, direction, faces })
    }

    /// The average of the corners about a place ahead that agree with the link.
    fn average(&self, ahead: &Point3<f32>, link: &Link) -> Option<(Link, usize)> {
        let half = 0.75 * self.config.step_voxels * self.voxel_mm;
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
        (count >= 2).then(|| {
            let position = ahead + place / count as f32;
            (Link { position, direction: direction.normalize(), faces: faces.map(|f| f.normalize()) }, count)
        })
    }

    fn grow(&mut self, seed: usize) -> Chain {
        let c = self.corners[seed];
        let raw = Link { position: c.position, direction: c.direction, faces: c.faces };
        let start = self.average(&c.position, &raw).map_or(raw, |(link, _)| link);
        let mut chain = Chain { links: vec![start], ..Chain::default() };
        self.walk(&mut chain, &[]);
        if !chain.closed {
            let mut back = Chain::default();
            back.links.push(Link { direction: -start.direction, ..start });
            self.walk(&mut back, &chain.links);
            let reversed = back.links.iter().skip(1).rev();
            let turned = reversed.map(|l| Link { direction: -l.direction, ..*l });
            chain.links = turned.chain(chain.links.iter().copied()).collect();
        }
        let mine = self.claim(&chain);
        chain.support = mine.len();
        chain.share = mine.iter().map(|&k| self.corners[k].share).sum::<f32>() / mine.len().max(1) as f32;
        chain
    }

    /// Walks on from the last link until nothing agrees or the start comes round.
    fn walk(&self, chain: &mut Chain, ahead_of: &[Link]) {
        let step = self.config.step_voxels * self.voxel_mm;
        let limit = self.corners.len() + 16;
        while chain.links.len() < limit {
            let Some(last) = chain.links.last().copied() else { return };
            let bend = chain.links.iter().rev().nth(1).map_or(last.direction, |before| {
                // Look ahead along the curve: the direction turns on as it turned before.
                (last.direction + (last.direction - before.direction) * 0.5).normalize()
            });
            let next = (1..=self.config.longest_step).find_map(|k| {
                let ahead = last.position + bend * (step * k as f32);
                let probe = Link { direction: bend, ..last };
                self.average(&ahead, &probe).filter(|(l, _)| {
                    let way = (&last.position, &l.position);
                    !self.taken(&l.position)
                        && !obstruction::blocked(self.model, self.voxel_mm, way.0, way.1, &last.faces)
                })
            });
            let Some((link, _)) = next else { return };
            if (link.position - last.position).dot(&last.direction) < 0.3 * step {
                return;
            }
            let first = chain.links[0];
            let home = (link.position - first.position).norm() < 1.01 * step
                && link.direction.dot(&first.direction) > 0.8;
            if home && chain.links.len() > 6 {
                chain.closed = ahead_of.is_empty();
                return;
            }
            if ahead_of.iter().any(|l| {
                (l.position - link.position).norm() < step && l.direction.dot(&link.direction) < -0.8
            }) {
                return;
            }
            chain.links.push(link);
        }
    }

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
        let reach = 2.5 * self.config.step_voxels.max(1.0) * self.voxel_mm * 0.6;
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
