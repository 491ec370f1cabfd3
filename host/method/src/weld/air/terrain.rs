//! The scan as a map of heights: what is free below the safe level, and what is not (ours).
//!
//! Columns of some 6 mm along `up`. A scan shows faces and no backs, so everything below the highest scanned point of a
//! column is solid. A column without a scanned point was not seen: nothing below the highest scanned point of all is
//! free there, except where the torch is on a weld or on the way to it anyway, and above that.
//!
//! The torch is a set of [`Ball`]s that covers it. For every size of ball the map holds how low its centre may be over
//! each cell, so that a pose costs one look-up a ball. Cells are taken whole: distances come out too small, never too large.

use std::collections::HashMap;

use nalgebra::{Point3, UnitVector3, Vector3};
use rayon::prelude::*;

use super::{TorchPlace, up};
use crate::geometry::surface::Surface;
use crate::weld::SeamPath;
use weldpath_core::path::interpolation::position_between;
use weldpath_core::rotation::Arc;

/// A piece of the torch: a ball in the torch frame, whose origin is the tip of the wire, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// Its centre.
    pub centre_mm: Vector3<f64>,
    /// Its radius.
    pub radius_mm: f64,
}

/// Edge of a cell on common parts; more where the map would have too many, or the clearance spans too many.
const CELL_MM: f64 = 6.0;
const MOST_CELLS: f64 = 16_384.0;
const CELLS_IN_REACH: f64 = 16.0;
/// Between poses that are looked at no part of the torch goes farther, mm; half of it is added to the clearance.
pub(super) const STEP_MM: f64 = 6.0;
/// Radii are rounded up to multiples of this, so that few sizes are left.
const RADIUS_STEP_MM: f64 = 2.0;
/// A cell that was not seen counts as a gap in the scan if at least this many of its eight neighbours were seen.
const NEIGHBOURS_OF_GAP: usize = 6;
/// Distance between marks of [`Known`], mm: less than a cell.
pub(super) const MARK_MM: f64 = 5.0;

/// What the torch stays clear of between seams, and the way up.
#[derive(Debug)]
pub struct Terrain<'a> {
    pub(super) work: &'a Surface,
    pub(super) up: UnitVector3<f64>,
    /// Of all scanned points and seams, along `up`.
    pub(super) highest_mm: f64,
    pub(super) clearance_mm: f64,
    /// None where only the safe level is used.
    pub(super) map: Option<Map>,
}

impl<'a> Terrain<'a> {
    /// Under the air moves between `paths` over `work`. The torch is covered by `torch`; without it nothing below the
    /// safe level is free.
    pub fn new<'p>(
        work: &'a Surface,
        paths: impl IntoIterator<Item = &'p SeamPath, IntoIter: Clone>,
        clearance_mm: f64,
        torch: Option<&[Ball]>,
    ) -> Self {
        let points = paths.into_iter().flat_map(|path| &path.points);
        let up = up(points.clone());
        let seams = points.map(|point| point.position_mm);
        let highest_mm =
            work.in_base_mm().chain(seams).map(|p| up.dot(&p.coords)).fold(f64::NEG_INFINITY, f64::max);
        let map = torch
            .filter(|_| !work.is_empty())
            .map(|torch| Map::new(work, up, highest_mm, clearance_mm, torch));
        Self { work, up, highest_mm, clearance_mm, map }
    }
}

/// Heights over a plane across `up`.
#[derive(Debug)]
pub(super) struct Map {
    up: UnitVector3<f64>,
    across: [Vector3<f64>; 2],
    /// Corner of the first cell, in the plane.
    low_mm: [f64; 2],
    cell_mm: f64,
    cells: [usize; 2],
    highest_mm: f64,
    clearance_mm: f64,
    /// Highest scanned point of each cell; minus infinity where nothing was seen.
    seen_mm: Vec<f32>,
    /// Squared distances across `up` from a cell to those beside it in its row; its own stands in the middle.
    aside_mm2: Vec<f32>,
    balls: Vec<(Vector3<f64>, usize)>,
    sizes: Vec<Size>,
}

/// The map for one size of ball.
#[derive(Debug)]
struct Size {
    radius_mm: f64,
    /// Least height of a centre over each cell that keeps the clearance from what was seen.
    floor_mm: Vec<f32>,
    /// Whether the ball may reach a column that was not seen.
    unseen: Vec<bool>,
}

/// Where the torch is on its welds and on the ways to them, although nothing was seen there: for each size of ball the
/// least height in a column.
#[derive(Debug)]
pub(super) struct Known(Vec<HashMap<[i64; 2], f64>>);

impl Map {
    fn new(work: &Surface, up: UnitVector3<f64>, highest_mm: f64, clearance_mm: f64, torch: &[Ball]) -> Self {
        let first = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let first = (first - up.into_inner() * up.dot(&first)).normalize();
        let across = [first, up.cross(&first)];
        let radius_mm = |ball: &Ball| (ball.radius_mm / RADIUS_STEP_MM).ceil() * RADIUS_STEP_MM;
        let mut radii_mm: Vec<f64> = torch.iter().map(radius_mm).collect();
        radii_mm.sort_unstable_by(f64::total_cmp);
        radii_mm.dedup();
        let size = |ball: &Ball| radii_mm.partition_point(|known| *known < radius_mm(ball));
        let balls = torch.iter().map(|ball| (ball.centre_mm, size(ball))).collect();
        let places = || work.in_base_mm().map(|p| across.map(|axis| axis.dot(&p.coords)));
        let (mut low_mm, mut high_mm) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for place in places() {
            for axis in 0..2 {
                low_mm[axis] = low_mm[axis].min(place[axis]);
                high_mm[axis] = high_mm[axis].max(place[axis]);
            }
        }
        let reach_mm = radii_mm.last().copied().unwrap_or(0.0) + clearance_mm + 0.5 * STEP_MM;
        let sides_mm = [0, 1].map(|axis| high_mm[axis] - low_mm[axis] + 2.0 * reach_mm);
        let least_mm = (sides_mm[0] * sides_mm[1] / MOST_CELLS).sqrt().max(reach_mm / CELLS_IN_REACH);
        let cell_mm = least_mm.max(CELL_MM);
        let margin_mm = reach_mm + 2.0 * cell_mm;
        let cells = [0, 1].map(|axis| {
            ((high_mm[axis] - low_mm[axis] + 2.0 * margin_mm) / cell_mm).ceil().max(1.0) as usize
        });
        let mut map = Self {
            up,
            across,
            low_mm: low_mm.map(|low| low - margin_mm),
            cell_mm,
            cells,
            highest_mm,
            clearance_mm,
            seen_mm: vec![f32::NEG_INFINITY; cells[0] * cells[1]],
            aside_mm2: Vec::new(),
            balls,
            sizes: Vec::new(),
        };
        for p in work.in_base_mm() {
            if let Some(cell) = map.cell(&p) {
                map.seen_mm[cell] = map.seen_mm[cell].max(up.dot(&p.coords) as f32);
            }
        }
        map.close_gaps();
        let widest = (reach_mm / cell_mm) as i64 + 1;
        map.aside_mm2 = (-widest..=widest)
            .map(|away| map.apart_mm([away.unsigned_abs() as usize, 0]).powi(2) as f32)
            .collect();
        map.sizes = radii_mm.into_par_iter().map(|radius_mm| map.size(radius_mm)).collect();
        map
    }

    /// Column of a place, of its own plane.
    fn column(&self, p: &Point3<f64>) -> [i64; 2] {
        let at = |axis: usize| (self.across[axis].dot(&p.coords) - self.low_mm[axis]) / self.cell_mm;
        [at(0).floor() as i64, at(1).floor() as i64]
    }

    fn cell(&self, p: &Point3<f64>) -> Option<usize> {
        self.index(self.column(p))
    }

    fn index(&self, column: [i64; 2]) -> Option<usize> {
        let [x, y] =
            [0, 1].map(|axis| usize::try_from(column[axis]).ok().filter(|at| *at < self.cells[axis]));
        Some(y? * self.cells[0] + x?)
    }

    fn neighbours([x, y]: [i64; 2]) -> impl Iterator<Item = [i64; 2]> {
        (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| [x + dx, y + dy]))
    }

    /// Gaps of one cell are as high as what surrounds them.
    fn close_gaps(&mut self) {
        let seen_mm = self.seen_mm.clone();
        for (cell, height_mm) in
            self.seen_mm.iter_mut().enumerate().filter(|(_, height)| height.is_infinite())
        {
            let [x, y] = [(cell % self.cells[0]) as i64, (cell / self.cells[0]) as i64];
            let inside = |[x, y]: &[i64; 2]| {
                (0..self.cells[0] as i64).contains(x) && (0..self.cells[1] as i64).contains(y)
            };
            let around = Self::neighbours([x, y]).filter(inside);
            let around = around.map(|[x, y]| seen_mm[y as usize * self.cells[0] + x as usize]);
            let (count, highest) = around
                .filter(|height| height.is_finite())
                .fold((0, f32::NEG_INFINITY), |(count, highest), height| (count + 1, highest.max(height)));
            if count >= NEIGHBOURS_OF_GAP {
                *height_mm = highest;
            }
        }
    }

    /// Least distance, across `up`, between places in cells this far apart.
    fn apart_mm(&self, cells: [usize; 2]) -> f64 {
        let [x, y] = cells.map(|count| count.saturating_sub(1) as f64);
        x.hypot(y) * self.cell_mm
    }

    fn size(&self, radius_mm: f64) -> Size {
        let reach_mm = radius_mm + self.clearance_mm + 0.5 * STEP_MM;
        let (near, far) = (self.rows_within(radius_mm), self.rows_within(reach_mm));
        let mut size = Size {
            radius_mm,
            floor_mm: vec![f32::NEG_INFINITY; self.seen_mm.len()],
            unseen: vec![false; self.seen_mm.len()],
        };
        for (cell, height_mm) in self.seen_mm.iter().enumerate() {
            if height_mm.is_finite() {
                self.stamp(cell, &far, &mut size.floor_mm, |floor, rise| {
                    *floor = floor.max(height_mm + rise)
                });
            } else {
                self.stamp(cell, &near, &mut size.unseen, |unseen, _| *unseen = true);
            }
        }
        size
    }

    /// For rows that are 0, 1, ... cells away: how high a ball's surface is over its middle, for cells 0, 1, ... to a side.
    fn rows_within(&self, reach_mm: f64) -> Vec<Vec<f32>> {
        let rise = |apart_mm: f64| (reach_mm * reach_mm - apart_mm * apart_mm).max(0.0).sqrt() as f32;
        let within = |row: usize| {
            (0..)
                .map(move |x| self.apart_mm([x, row]))
                .take_while(|apart| *apart <= reach_mm)
                .map(rise)
                .collect()
        };
        (0..).map(within).take_while(|row: &Vec<f32>| !row.is_empty()).collect()
    }

    /// Applies `put` to all cells about one, with the rise of the ball there.
    fn stamp<T>(&self, cell: usize, rows: &[Vec<f32>], to: &mut [T], put: impl Fn(&mut T, f32)) {
        let [nx, ny] = self.cells;
        let (x, y) = (cell % nx, cell / nx);
        for (away, rises) in rows.iter().enumerate() {
            let below = (away > 0).then(|| y.checked_sub(away)).flatten();
            for row in below.into_iter().chain(Some(y + away).filter(|row| *row < ny)) {
                let row = &mut to[row * nx..(row + 1) * nx];
                row[x..].iter_mut().zip(rises).for_each(|(cell, rise)| put(cell, *rise));
                row[..x].iter_mut().rev().zip(rises.iter().skip(1)).for_each(|(cell, rise)| put(cell, *rise));
            }
        }
    }

    /// How many balls cover the torch.
    pub(super) fn balls(&self) -> usize {
        self.balls.len()
    }

    /// Centre of a ball at a pose.
    pub(super) fn centre_mm(&self, ball: usize, pose: &TorchPlace) -> Point3<f64> {
        pose.tip_mm + pose.base_from_torch * self.balls[ball].0
    }

    /// The farthest that a part of the torch is from its tip.
    pub(super) fn lever_mm(&self) -> f64 {
        self.balls.iter().map(|(centre_mm, _)| centre_mm.norm()).fold(0.0, f64::max)
    }

    /// Whether a ball with its centre there keeps the clearance from everything seen.
    pub(super) fn is_clear(&self, ball: usize, centre_mm: &Point3<f64>) -> bool {
        let floor_mm = &self.sizes[self.balls[ball].1].floor_mm;
        let height_mm = self.up.dot(&centre_mm.coords);
        self.cell(centre_mm).is_none_or(|cell| height_mm >= f64::from(floor_mm[cell]))
    }

    /// Whether a ball with its centre there is in no place that was not seen.
    pub(super) fn is_known(&self, ball: usize, centre_mm: &Point3<f64>, known: &Known) -> bool {
        let size = self.balls[ball].1;
        let Size { radius_mm, unseen, .. } = &self.sizes[size];
        self.up.dot(&centre_mm.coords) >= self.highest_mm + radius_mm
            || self.cell(centre_mm).is_some_and(|cell| !unseen[cell])
            || known.holds(self, size, centre_mm)
    }

    /// Radius of a ball, mm.
    pub(super) fn radius_mm(&self, ball: usize) -> f64 {
        self.sizes[self.balls[ball].1].radius_mm
    }

    /// Edge of a cell, mm.
    pub(super) fn cell_mm(&self) -> f64 {
        self.cell_mm
    }

    /// Distance of a ball's centre from what was seen, mm; no more than where it keeps the clearance.
    pub(super) fn distance_mm(&self, ball: usize, centre_mm: &Point3<f64>) -> f64 {
        let reach_mm = self.radius_mm(ball) + self.clearance_mm + 0.5 * STEP_MM;
        let ([x, y], height_mm) = (self.column(centre_mm), self.up.dot(&centre_mm.coords) as f32);
        let cells = ((reach_mm / self.cell_mm) as i64 + 1).min(self.aside_mm2.len() as i64 / 2);
        let within = |at: i64, axis: usize| at.clamp(0, self.cells[axis] as i64);
        let [from, to] = [x - cells, x + cells + 1].map(|at| within(at, 0) as usize);
        let aside_mm2 =
            self.aside_mm2.iter().skip((self.aside_mm2.len() as i64 / 2 + from as i64 - x).max(0) as usize);
        let row = |row: i64| {
            let seen_mm = &self.seen_mm[row as usize * self.cells[0]..][from..to.max(from)];
            let away_mm2 = |(seen, aside): (&f32, &f32)| aside + (height_mm - seen).max(0.0).powi(2);
            let least = seen_mm.iter().zip(aside_mm2.clone()).map(away_mm2).fold(f32::INFINITY, f32::min);
            least + (self.apart_mm([0, row.abs_diff(y) as usize]) as f32).powi(2)
        };
        let rows = within(y - cells, 1)..within(y + cells + 1, 1);
        f64::from(rows.map(row).fold(f32::INFINITY, f32::min)).sqrt().min(reach_mm)
    }
}

impl Known {
    pub(super) fn new(map: &Map) -> Self {
        Self(vec![HashMap::new(); map.sizes.len()])
    }

    /// The torch is at `pose` anyway.
    pub(super) fn mark(&mut self, map: &Map, pose: &TorchPlace) {
        for ball in 0..map.balls() {
            let next = (ball + 1).min(map.balls() - 1);
            let (from_mm, to_mm) = (map.centre_mm(ball, pose), map.centre_mm(next, pose));
            let smaller = map.balls[ball].1.min(map.balls[next].1);
            let steps = ((to_mm - from_mm).norm() / MARK_MM).ceil().max(1.0);
            for k in 0..steps as usize {
                let place = from_mm + (to_mm - from_mm) * (k as f64 / steps);
                let (column, height_mm) = (map.column(&place), map.up.dot(&place.coords));
                // Where one ball fits, every smaller one fits.
                for size in &mut self.0[..=smaller] {
                    size.entry(column).and_modify(|least| *least = least.min(height_mm)).or_insert(height_mm);
                }
            }
        }
    }

    /// Whether the torch is there, give or take a cell, or lower in the same column.
    fn holds(&self, map: &Map, size: usize, centre_mm: &Point3<f64>) -> bool {
        let height_mm = map.up.dot(&centre_mm.coords) + 0.5 * map.cell_mm;
        Map::neighbours(map.column(centre_mm))
            .any(|column| self.0[size].get(&column).is_some_and(|least| *least <= height_mm))
    }
}

/// The poses of the straight move from `from` to `to`, close enough for nothing to fit between; the first is `from`.
pub(super) fn swept(
    from: &TorchPlace,
    to: &TorchPlace,
    lever_mm: f64,
    step_mm: f64,
) -> impl Iterator<Item = TorchPlace> + use<> {
    let (from, to) = (*from, *to);
    let way_mm = (to.tip_mm - from.tip_mm).norm();
    let turn_mm = from.base_from_torch.angle_to(&to.base_from_torch) * lever_mm;
    let steps = ((way_mm + turn_mm) / step_mm).ceil().max(1.0);
    let turn = Arc::between(&from.base_from_torch, &to.base_from_torch);
    (0..=steps as usize).map(move |k| {
        let share = k as f64 / steps;
        TorchPlace {
            tip_mm: position_between(&from.tip_mm, &to.tip_mm, share),
            base_from_torch: turn.slerp(share),
        }
    })
}
