//! What of a model is a surface: its points without those that stand alone.

use crate::geometry::cloud::PointCloud;
use crate::geometry::grid::Grid;
use crate::geometry::statistics::median;
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

const CELL_MM: f32 = 8.0;

/// The points of a model that are a surface, in cells.
#[derive(Debug, Clone)]
pub struct Surface {
    /// Where the grid's coordinates begin.
    pub origin_mm: Point3<f64>,
    /// The points.
    pub grid: Grid,
    /// Box around them, from the origin; of no points the low corner is above the high one.
    pub corners_mm: [Point3<f32>; 2],
}

impl Surface {
    /// That of a model.
    pub fn of(model: &PointCloud) -> Self {
        Self::new(model.origin_mm, &surface(&model.points_mm), CELL_MM)
    }

    /// Of points relative to an origin, all of which are taken, in cells of this size.
    pub fn new(origin_mm: Point3<f64>, points_mm: &[Point3<f32>], cell_mm: f32) -> Self {
        let [low, high] = [f32::INFINITY, f32::NEG_INFINITY].map(|v| Point3::from(Vector3::repeat(v)));
        let corners_mm = points_mm.iter().fold([low, high], |[low, high], p| [low.inf(p), high.sup(p)]);
        Self { origin_mm, grid: Grid::new(points_mm, cell_mm), corners_mm }
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.grid.is_empty()
    }

    /// The points in the base frame, mm.
    pub fn in_base_mm(&self) -> impl Iterator<Item = Point3<f64>> + Clone + '_ {
        (0..self.grid.len()).map(|slot| self.origin_mm + self.grid.point(slot).coords.cast::<f64>())
    }

    /// How far along a unit vector the box around the points reaches from a place, along one axis of the frame; 0 if it is
    /// behind, and without end where the vector does not lead along that axis.
    pub(crate) fn reach_mm(
        &self,
        from_mm: &Point3<f64>,
        along: &Vector3<f64>,
        axis: usize,
        margin_mm: f64,
    ) -> f64 {
        if along[axis].abs() <= 1e-6 || self.is_empty() {
            return f64::INFINITY;
        }
        let wall_mm = self.origin_mm[axis] + f64::from(self.corners_mm[usize::from(along[axis] > 0.0)][axis]);
        let ahead_mm = (wall_mm - from_mm[axis]) * along[axis].signum() + margin_mm;
        (ahead_mm / along[axis].abs()).max(0.0)
    }

    /// Whether no point lies ahead of a place within `radius_mm` of the ray along a unit vector.
    pub(crate) fn is_free(&self, from_mm: &Point3<f64>, along: &Vector3<f64>, radius_mm: f64) -> bool {
        let length_mm =
            (0..3).map(|axis| self.reach_mm(from_mm, along, axis, radius_mm)).fold(f64::INFINITY, f64::min);
        if !length_mm.is_finite() {
            return true;
        }
        let from = from_mm - self.origin_mm.coords;
        let pieces = (length_mm / (2.0 * radius_mm).max(1.0)).ceil() as usize;
        let half_mm = 0.5 * length_mm / pieces.max(1) as f64;
        (0..pieces).all(|k| {
            let middle = from + along * (half_mm * (2 * k + 1) as f64);
            let mut free = true;
            self.grid.within(&middle.cast(), half_mm.hypot(radius_mm) as f32, |slot, _| {
                let offset = self.grid.point(slot).cast::<f64>() - from;
                let ahead = offset.dot(along);
                free &= ahead <= 0.0 || (offset - along * ahead).norm_squared() > radius_mm * radius_mm;
            });
            free
        })
    }
}

/// A point of a surface has so many others ...
const NEIGHBOURS: usize = 6;
/// ... within so many times the distance in which half of all points have them: of strays all over a box one in thousands has.
const SPREAD: f32 = 4.0;
/// Or it lies, where a scan is thin, in a plane with twice as many, up to this share of how far they reach, and most of
/// these do so, too: of strays one in forty lies so, and none with most of its nearest; a plane that is seen ten times as
/// thinly with a noise of 1 mm does.
const FLAT_SHARE: f32 = 0.07;
/// No scan resolves less, mm.
const LEAST_REACH_MM: f32 = 0.1;
/// So many points show how dense a scan is, and fewer are no scan.
const SAMPLED: usize = 500;

/// The points that do not stand alone.
fn surface(points_mm: &[Point3<f32>]) -> Vec<Point3<f32>> {
    if points_mm.len() < SAMPLED {
        return points_mm.to_vec();
    }
    let reach_mm = (SPREAD * spacing_mm(points_mm)).max(LEAST_REACH_MM);
    let grid = Grid::new(points_mm, reach_mm / 3f32.sqrt());
    let dense = dense(&grid, reach_mm);
    let slots = || (0..grid.len()).into_par_iter();
    let near = |slot: usize| nearest(&grid, &grid.point(slot), 2 * NEIGHBOURS);
    let points = |slots: &[usize]| slots.iter().map(|slot| grid.point(*slot)).collect::<Vec<_>>();
    let holds: Vec<bool> = slots().map(|slot| dense[slot] || lies_flat(&points(&near(slot)))).collect();
    let among_its_like = |slot: usize| near(slot).iter().filter(|other| holds[**other]).count() > NEIGHBOURS;
    let kept = |slot: &usize| dense[*slot] || (holds[*slot] && among_its_like(*slot));
    slots().filter(kept).map(|slot| grid.point(slot)).collect()
}

/// How far the neighbours of half of all points reach.
fn spacing_mm(points_mm: &[Point3<f32>]) -> f32 {
    let grid = Grid::new(points_mm, CELL_MM);
    let reach_mm = |k: usize| {
        let point = points_mm[k * points_mm.len() / SAMPLED];
        nearest(&grid, &point, NEIGHBOURS).last().map_or(0.0, |far| (grid.point(*far) - point).norm())
    };
    median(&mut (0..SAMPLED).into_par_iter().map(reach_mm).collect::<Vec<f32>>())
}

/// Whether each slot has its neighbours within reach.
fn dense(grid: &Grid, reach_mm: f32) -> Vec<bool> {
    let mut crowded = vec![false; grid.len()];
    // Points of one cell are within reach of each other, and most of a scan is told so.
    if grid.cell_mm() * 3f32.sqrt() <= reach_mm * 1.001 {
        let full = grid.occupied().map(|(_, slots)| slots).filter(|slots| slots.len() > NEIGHBOURS);
        full.for_each(|slots| crowded[slots].fill(true));
    }
    let neighbours = |slot: usize| {
        let mut others = 0;
        grid.within(&grid.point(slot), reach_mm, |_, _| others += 1);
        others
    };
    let is_dense = |(slot, crowded): (usize, &bool)| *crowded || neighbours(slot) > NEIGHBOURS;
    crowded.par_iter().enumerate().map(is_dense).collect()
}

/// Whether a point, the first, lies in a plane with its nearest.
fn lies_flat(near: &[Point3<f32>]) -> bool {
    let Some(far) = near.last().filter(|_| near.len() > NEIGHBOURS) else { return false };
    let mean = near.iter().map(|p| p.coords).sum::<Vector3<f32>>() / near.len() as f32;
    let spread: Matrix3<f32> = near.iter().map(|p| p.coords - mean).map(|d| d * d.transpose()).sum();
    let mut widths: [f32; 3] = spread.symmetric_eigenvalues().into();
    widths.sort_by(f32::total_cmp);
    let [across, along, _] = widths.map(|width| (width.max(0.0) / near.len() as f32).sqrt());
    let reach = (far - near[0]).norm();
    // Of a disc the width is half of the reach: a stray over a dense patch makes a line with it, and no plane.
    across < FLAT_SHARE * reach && along > 0.25 * reach
}

/// The slots of a point and the `others` nearest to it, the nearest first; fewer if not so many are within a metre.
fn nearest(grid: &Grid, point: &Point3<f32>, others: usize) -> Vec<usize> {
    let mut reach_mm = 0.25 * CELL_MM;
    loop {
        let mut found: Vec<(f32, usize)> = Vec::new();
        grid.within(point, reach_mm, |slot, squared_mm2| found.push((squared_mm2, slot)));
        if found.len() > others || reach_mm > 1e3 {
            let by_distance = |a: &(f32, usize), b: &(f32, usize)| a.0.total_cmp(&b.0);
            if found.len() > others + 1 {
                found.select_nth_unstable_by(others, by_distance);
                found.truncate(others + 1);
            }
            found.sort_by(by_distance);
            return found.into_iter().map(|(_, slot)| slot).collect();
        }
        reach_mm *= 2.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_that_is_seen_ten_times_as_thinly_as_the_part_is_a_wall_and_strays_are_none() {
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        let part = |i: usize| Point3::new((i % 150) as f32, (i / 150) as f32, 0.0);
        let dense: Vec<Point3<f32>> = (0..150 * 150).map(part).collect();
        let table: Vec<Point3<f32>> = (0..900)
            .map(|i| {
                let at = |k: usize, noise: f32| 12.0 * k as f32 + 6.0 * noise;
                Point3::new(200.0 + at(i % 30, random()), at(i / 30, random()), 0.6 * random())
            })
            .collect();
        let strays: Vec<Point3<f32>> = (0..450)
            .map(|_| Point3::new(300.0 * random() - 80.0, 300.0 * random(), 20.0 + 280.0 * random()))
            .collect();
        let kept = surface(&[dense.clone(), table, strays].concat());
        let of = |is: fn(&&Point3<f32>) -> bool| kept.iter().filter(is).count();
        assert_eq!(of(|p| p.x < 190.0 && p.z < 10.0), dense.len());
        assert!(of(|p| p.x > 199.0 && p.z < 10.0) > 850, "{}", of(|p| p.x > 199.0 && p.z < 10.0));
        assert!(of(|p| p.z > 15.0) < 5, "{}", of(|p| p.z > 15.0));
    }

    #[test]
    fn many_equal_points_are_looked_through_at_once() {
        let begun = std::time::Instant::now();
        let places = [Point3::origin(), Point3::new(30.0, 0.0, 0.0)];
        let kept = surface(&places.map(|place| vec![place; 100_000]).concat());
        assert_eq!(kept.len(), 200_000);
        assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
    }
}
