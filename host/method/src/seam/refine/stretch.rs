//! From single stations to one smooth seam (ours): what is trusted of them, the stretch that holds together, the curve.

use super::Refined;
use super::path::{Path, PathPoint, frames, nearest, resampled};
use super::smooth::Samples;
use super::station::MeasuredStation;
use crate::geometry::statistics::{DEVIATION_OF_MEDIAN, median};
use crate::model::normals::CORRELATED_POINTS;
use nalgebra::Vector3;
use std::ops::Range;

// All chosen on the simulated scans.

/// Fewer trusted stations are no seam.
const LEAST_STATIONS: usize = 6;
/// Weight of a station whose points are all on one side of it, along the seam.
const ONE_SIDED: f64 = 0.03;
/// Half lengths of the window that the validation of a curve leaves out at a time: stations nearer share points.
const BLOCK_HALVES: f32 = 2.0;
/// Part of a window's length in which its points weigh most.
const FULL_WEIGHT: f32 = 0.6;
/// Least number of points of a face, as a share of what its stations usually have.
const FAIR_SHARE: f64 = 0.25;
/// Farthest that a station may be from the path, voxels.
const FAR_VOXELS: f64 = 3.3;
/// Neighbours to each side whose median a station is held to; how far it may be off, standard deviations; and at least
/// that far, voxels.
const NEIGHBOURS: usize = 4;
const OFF_DEVIATIONS: f64 = 5.0;
const OFF_VOXELS: f64 = 0.3;
/// A seam this short, in steps, is not trimmed.
const LEAST_STEPS: f32 = 3.0;

/// The stations of a path as they were measured.
pub(super) struct Stretch<'a> {
    pub(super) path: &'a Path,
    pub(super) stations: &'a [Option<MeasuredStation>],
    /// Stations that may belong to the seam.
    pub(super) inside: Range<usize>,
    /// Where along an open path both faces were seen, mm; none of a loop.
    pub(super) both_seen_mm: Option<Range<f32>>,
    /// Half length of the window of a station, mm.
    pub(super) half_mm: f32,
    pub(super) voxel_mm: f32,
}

/// The part of a stretch that holds together.
struct Kept<'a> {
    /// First station of the path.
    from: usize,
    stations: &'a [Option<MeasuredStation>],
    /// Which of them are trusted.
    good: Vec<bool>,
}

/// What is smoothed: places, both normals, and what a station weighs.
struct Rows {
    places: Vec<[f64; 3]>,
    normals: Vec<[f64; 6]>,
    weights: Vec<f64>,
}

impl Stretch<'_> {
    /// Stations without outliers, in one stretch, smoothed to a seam whose faces reach so far and whose raw points are
    /// `near`; gaps of up to `gap` voxels are bridged.
    pub(super) fn smoothed(&self, reach_mm: [f32; 2], near: Vec<u32>, gap: f32) -> Option<Refined> {
        let path = self.path;
        let kept = self.kept((gap * self.voxel_mm / path.step_mm) as usize)?;
        let Rows { places, normals, weights } = self.rows(&kept);
        let step_mm = f64::from(path.step_mm);
        let block_mm = f64::from(BLOCK_HALVES * self.half_mm);
        let line = Samples { values: &places, weights: &weights, step_mm, closed: path.closed };
        let tilt = Samples { values: &normals, weights: &weights, step_mm, closed: path.closed };
        let curve = line.stiffest(block_mm);
        let smooth_places = line.smooth(curve);
        let freedom = curve.freedom(path.closed, step_mm * places.len() as f64, step_mm);
        let smooth_normals = tilt.smooth(tilt.stiffest(block_mm));
        let points = smooth_places.iter().zip(&smooth_normals).map(path_point).collect();
        let points = self.trimmed(points, kept.from as f32 * path.step_mm);
        let (points, new_step_mm) = resampled(&points, path.closed, path.step_mm);
        let frames = frames(&points, path.closed)?;
        let quality = || kept.stations.iter().flatten().flat_map(|s| s.quality);
        let tilts = quality().map(|q| q.sigma * (f64::from(CORRELATED_POINTS) * q.slope_variance).sqrt());
        Some(Refined {
            step_mm: new_step_mm,
            closed: path.closed,
            measured: kept.measured(frames.len()),
            sigma_mm: median(&mut quality().map(|q| q.sigma).collect::<Vec<_>>()),
            scatter_mm: kept.scatter_mm(&smooth_places, &places),
            tilt_rad: median(&mut tilts.collect::<Vec<_>>()),
            reach_mm,
            lift_unknown_mm: [0.0; 2],
            window_mm: 2.0 * self.half_mm * FULL_WEIGHT,
            freedom,
            view_share: kept.view_share(frames.len()),
            near,
            frames,
        })
    }

    /// The longest stretch of trusted stations with gaps of at most so many.
    fn kept(&self, longest_gap: usize) -> Option<Kept<'_>> {
        let mut good = trusted(&present(self.stations), self.voxel_mm);
        good.iter_mut().enumerate().for_each(|(k, g)| *g &= self.inside.contains(&k));
        let (from, to) = if self.path.closed { (0, good.len()) } else { longest_run(&good, longest_gap)? };
        let kept = Kept { from, stations: &self.stations[from..to], good: good[from..to].to_vec() };
        (kept.good.iter().filter(|g| **g).count() >= LEAST_STATIONS).then_some(kept)
    }

    /// The stations in the axes of the cloud; those that are not trusted weigh nothing.
    fn rows(&self, kept: &Kept) -> Rows {
        let n = kept.stations.len();
        let mut rows = Rows {
            places: Vec::with_capacity(n),
            normals: Vec::with_capacity(n),
            weights: Vec::with_capacity(n),
        };
        for (k, station) in kept.stations.iter().enumerate() {
            let frame = &self.path.frames[kept.from + k];
            let axes = frame.cross_section();
            let (place, [a, b]) = match station {
                Some(s) if kept.good[k] => (axes.lifted(&s.across), s.normals.map(|n| axes.lifted(&n))),
                _ => (Vector3::zeros(), frame.faces.map(|f| f.cast())),
            };
            let p = frame.position.coords.cast::<f64>() + place;
            rows.places.push([p.x, p.y, p.z]);
            rows.normals.push([a.x, a.y, a.z, b.x, b.y, b.z]);
            let weight = station.as_ref().map_or(0.0, |s| self.weight(s));
            rows.weights.push(if kept.good[k] { weight } else { 0.0 });
        }
        rows
    }

    /// Full where points lie on both sides along the seam, less toward its ends.
    fn weight(&self, station: &MeasuredStation) -> f64 {
        if self.path.closed {
            return 1.0;
        }
        let sides = station.quality.iter().map(|q| q.support.1.min(-q.support.0));
        let balance = sides.fold(f64::MAX, f64::min);
        (balance / f64::from(self.half_mm)).clamp(0.0, 1.0).powi(2).max(ONE_SIDED)
    }

    /// Points of an open seam, the first of which is at `start_mm` along it, cut to where both faces were seen.
    fn trimmed(&self, points: Vec<PathPoint>, start_mm: f32) -> Vec<PathPoint> {
        let Some(seen_mm) = &self.both_seen_mm else { return points };
        let last = points.len() - 1;
        let at = |s: f32| ((s - start_mm) / self.path.step_mm).clamp(0.0, last as f32);
        let (from, to) = (at(seen_mm.start), at(seen_mm.end));
        if to - from < LEAST_STEPS {
            return points;
        }
        let between = |at: f32| {
            let k = (at as usize).min(last - 1);
            PathPoint::mixed(&points[k], &points[k + 1], f64::from(at - k as f32))
        };
        let inner = points[from.floor() as usize + 1..to.ceil() as usize].to_vec();
        std::iter::once(between(from)).chain(inner).chain([between(to)]).collect()
    }
}

fn path_point((p, n): (&[f64; 3], &[f64; 6])) -> PathPoint {
    let faces = [Vector3::new(n[0], n[1], n[2]), Vector3::new(n[3], n[4], n[5])];
    PathPoint { position_mm: Vector3::from(*p), faces }
}

impl Kept<'_> {
    /// The station that is nearest to one of `count` resampled ones.
    fn nearest(&self, k: usize, count: usize) -> usize {
        nearest(k, count, self.stations.len())
    }

    /// Which of `count` resampled stations were measured.
    fn measured(&self, count: usize) -> Vec<bool> {
        (0..count).map(|k| self.good[self.nearest(k, count)]).collect()
    }

    /// Median distance of the trusted places from the smooth curve, mm.
    fn scatter_mm(&self, curve: &[[f64; 3]], places: &[[f64; 3]]) -> f64 {
        let mut misses: Vec<f64> = curve
            .iter()
            .zip(places)
            .zip(&self.good)
            .filter(|(_, g)| **g)
            .map(|((a, b), _)| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt())
            .collect();
        median(&mut misses)
    }

    /// Shares of the views at `count` resampled stations: those of the nearest that has any.
    fn view_share(&self, count: usize) -> Vec<[Vec<f32>; 2]> {
        let share = |k: usize| {
            let old = self.nearest(k, count);
            let beside = |by: usize| old.checked_sub(by).into_iter().chain([old + by]);
            let mut near = (0..self.stations.len()).flat_map(beside);
            let near = near.find_map(|j| self.stations.get(j)?.as_ref());
            near.map(|s| s.view_share.clone()).unwrap_or_default()
        };
        (0..count).map(share).collect()
    }
}

/// Stations that have a fair share of points on both faces; the rest is beyond the end of the seam, or in a gap.
fn present(stations: &[Option<MeasuredStation>]) -> Vec<Option<&MeasuredStation>> {
    let usual = |f: usize| {
        let mut counts: Vec<f64> = stations.iter().flatten().map(|s| s.present[f] as f64).collect();
        median(&mut counts)
    };
    let least = [FAIR_SHARE * usual(0), FAIR_SHARE * usual(1)];
    let fair = |s: &&MeasuredStation| {
        s.present[0] as f64 >= least[0].max(1.0) && s.present[1] as f64 >= least[1].max(1.0)
    };
    stations.iter().map(|s| s.as_ref().filter(fair)).collect()
}

/// Stations whose correction is near that of their neighbours.
fn trusted(stations: &[Option<&MeasuredStation>], voxel_mm: f32) -> Vec<bool> {
    let far = FAR_VOXELS * f64::from(voxel_mm);
    let mut good: Vec<bool> =
        stations.iter().map(|s| s.as_ref().is_some_and(|s| s.across.norm() < far)).collect();
    for axis in 0..2 {
        let index: Vec<usize> = (0..good.len()).filter(|&k| good[k]).collect();
        let value: Vec<f64> = index.iter().map(|&k| stations[k].map_or(0.0, |s| s.across[axis])).collect();
        let about = |k: usize| k.saturating_sub(NEIGHBOURS)..(k + NEIGHBOURS + 1).min(value.len());
        let running = (0..value.len()).map(|k| median(&mut value[about(k)].to_vec()));
        let misses: Vec<f64> = value.iter().zip(running).map(|(v, r)| (v - r).abs()).collect();
        let usual = OFF_DEVIATIONS * DEVIATION_OF_MEDIAN * median(&mut misses.clone());
        let limit = (OFF_VOXELS * f64::from(voxel_mm)).max(usual);
        for (&k, miss) in index.iter().zip(misses) {
            good[k] &= miss <= limit;
        }
    }
    good
}

/// The longest stretch of good stations whose gaps are at most `gap` stations long.
pub(super) fn longest_run(good: &[bool], gap: usize) -> Option<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for k in (0..good.len()).filter(|&k| good[k]) {
        match runs.last_mut() {
            Some(run) if k - run.1 <= gap + 1 => run.1 = k,
            _ => runs.push((k, k)),
        }
    }
    runs.into_iter().map(|(a, b)| (a, b + 1)).max_by_key(|(a, b)| b - a)
}
