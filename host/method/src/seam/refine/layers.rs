//! The foot of a step on the raw points (ours): the plane of the lower layer, and where the upper one ends.
//!
//! Seam coordinates are those of the lower layer as the first face and the side of the step, taken as square to it, as the
//! second. The edge is where the density of the upper layer falls to half.

use super::beside::{Beside, beside, near_path};
use super::face::{self, FacePoint, FitQuality, Scratch};
use super::frame::Frame;
use super::path::Path;
use super::station::MeasuredStation;
use super::stretch::Stretch;
use super::windows::Windows;
use super::{RefineConfig, Refined};
use crate::geometry::statistics::{median, robust_deviation};
use crate::seam::input::RawScan;
use crate::seam::trace::Chain;
use crate::seam::trace::step::{ROOM_HEIGHTS, StepConfig};
use nalgebra::Point3;

// All chosen on the simulated scans.

/// Stations put to each end of an open path in every round.
const ADDED: usize = 2;
/// Noise, as a share of the step, below which the layers that one camera shows are the stairs of its quantised depth; those of
/// several do not lie in each other.
const QUANTISED: f32 = 0.02;
/// Least height of points of the upper layer, in least heights of a step.
const UPPER_SHARE: f32 = 0.7;
/// Half thickness of a layer, standard deviations of its points, and the least of it, voxels.
const LAYER_DEVIATIONS: f32 = 3.0;
const LEAST_LAYER_VOXELS: f32 = 0.05;
/// Stations on either side whose points tell the height of the upper layer at one.
const LEVEL_STATIONS: usize = 3;
/// Sine of the angle between a ray and the layers, below which it says little of where the upper one ends: 12 degrees.
const LEAST_RISE: f32 = 0.2;
/// How far out of the step the upper layer's points are kept, as a share of the strip.
const OUT_SHARE: f32 = 0.5;
/// Width of the strips in which points of the lower layer are counted, next to the step and at the end of its room, and
/// how far from the step the first begins, voxels; and how many times more the first may hold.
const ROOM_STRIP_VOXELS: f32 = 2.0;
const ROOM_FROM_VOXELS: f32 = 1.0;
const ROOM_FALL: usize = 2;
/// Part of the upper layer next to its edge that does not count for its density, voxels.
const EDGE_VOXELS: f64 = 1.5;
/// Fewer points show no edge.
const LEAST_POINTS: usize = 25;
/// Margin beyond the edge within which points are counted: standard deviations of the points, and at least this, voxels.
const MARGIN_DEVIATIONS: f64 = 2.0;
const MARGIN_VOXELS: f64 = 0.4;
/// Points of the upper layer are counted from so many standard deviations below it on, and from its middle on. Of a side as
/// dense as the layer 2.055 deviations are then counted for an end of the layer, and 0.798: the mean of a normal deviation
/// beyond the bound, less the bound, over the share of the layer that is counted. The ratio of the second to their difference.
const LOW_DEVIATIONS: f64 = 2.0;
const SIDE_SHARE: f64 = 0.798 / (2.055 - 0.798);
/// Rounds of counting and moving the edge.
const EDGE_ROUNDS: usize = 8;
/// Points this near to the step, as a share of the strip, and no farther above it than this many heights, tell that a
/// layer is there.
const PRESENT_SHARE: f64 = 0.7;
const PRESENT_HEIGHTS: f64 = 2.0;

/// A chain of feet of steps on the raw points; `None` where these show no step.
pub(crate) fn refine(
    scan: &RawScan,
    chain: &Chain,
    voxel_mm: f32,
    sizes: &RefineConfig,
    config: &StepConfig,
) -> Option<Refined> {
    let mut path = Path::along(chain, sizes.step * voxel_mm)?;
    let mut refined = None;
    for _ in 0..sizes.rounds {
        path.extend(ADDED);
        let reach_mm = (config.height.1 + config.strip) * voxel_mm;
        let near = near_path(scan.index, &path.frames, reach_mm);
        let points = beside(scan.merged, &near, path.line(), reach_mm);
        let layers = Layers::new(scan, &points, voxel_mm, config)?;
        let views = scan.merged.cameras_mm.len();
        let windows = Windows::new(layers.points(&points, scan, &path), &path, sizes.half * voxel_mm, views);
        let stations: Vec<Option<MeasuredStation>> =
            (0..path.frames.len()).map(|k| layers.station(&windows, &path, k)).collect();
        let stretch = Stretch {
            path: &path,
            inside: 0..stations.len(),
            stations: &stations,
            both_seen_mm: windows.both_seen_mm(|_| true),
            half_mm: windows.half_mm,
            voxel_mm,
        };
        let outcome = stretch.smoothed([layers.strip_mm, layers.height_mm], near, sizes.gap)?;
        path = Path::of(&outcome);
        refined = Some(outcome);
    }
    refined
}

/// Distance out of the upper layer's edge, and height over the lower layer.
fn out_and_up(p: &Beside) -> (f32, f32) {
    if p.face == 0 { (p.u, p.h) } else { (p.h, p.u) }
}

/// How far out a ray of a camera goes for each millimetre up; none of one that grazes the layers.
fn slope(frame: &Frame, camera_mm: &Point3<f32>) -> Option<f32> {
    let ray = camera_mm - frame.position;
    let [up, out] = frame.faces.map(|face| ray.dot(&face));
    (up > LEAST_RISE * ray.norm()).then(|| out / up)
}

/// Where the two layers of a step are, mm.
struct Layers {
    /// Of the upper over the lower one.
    height_mm: f32,
    /// Half thickness within which points are of a layer.
    half_mm: f32,
    /// Width of either layer that is looked at.
    strip_mm: f32,
    voxel_mm: f32,
}

impl Layers {
    /// By the points beside a path; `None` if these are of no upper layer, or the lower one has no room.
    fn new(scan: &RawScan, points: &[Beside], voxel_mm: f32, config: &StepConfig) -> Option<Self> {
        let v = voxel_mm;
        let inside = |p: &&Beside| (-config.strip * v..-v).contains(&out_and_up(p).0);
        let heights = points.iter().filter(inside).map(|p| out_and_up(p).1);
        let mut heights: Vec<f32> = heights.filter(|up| *up > UPPER_SHARE * config.height.0 * v).collect();
        if heights.is_empty() {
            return None;
        }
        let height_mm = median(&mut heights);
        // No wider than the noise: the side of a plate that was sampled would pass for more of its top.
        let mut misses: Vec<f32> = heights.iter().map(|up| (up - height_mm).abs()).collect();
        let noise_mm = robust_deviation(&mut misses);
        if scan.is_one_view() && noise_mm < QUANTISED * height_mm {
            return None;
        }
        let half_mm = (LAYER_DEVIATIONS * noise_mm).clamp(LEAST_LAYER_VOXELS * v, config.layer * v);
        let layers = Self { height_mm, half_mm, strip_mm: config.strip * v, voxel_mm };
        layers.has_room(points).then_some(layers)
    }

    fn is_lower(&self, p: &Beside) -> bool {
        out_and_up(p).1.abs() < self.half_mm
    }

    /// Whether the lower layer goes on far enough to be more than an edge of its own.
    fn has_room(&self, points: &[Beside]) -> bool {
        let v = self.voxel_mm;
        let floor = |low: f32, high: f32| {
            let lower = points.iter().filter(|p| self.is_lower(p));
            lower.filter(|p| (low..high).contains(&out_and_up(p).0)).count()
        };
        let room = (ROOM_HEIGHTS * self.height_mm).min(self.strip_mm);
        let next = floor(v, (ROOM_FROM_VOXELS + ROOM_STRIP_VOXELS) * v);
        ROOM_FALL * floor(room - ROOM_STRIP_VOXELS * v, room) >= next
    }

    /// The points of the lower layer outside, and of the upper one about its edge, sorted along the seam.
    ///
    /// A camera errs along its ray: a point that it puts too high, it puts too near to itself as well, which is out where it looks
    /// at the side. Each point of the upper layer is put where its ray meets the layer.
    fn points(&self, points: &[Beside], scan: &RawScan, path: &Path) -> [Vec<Beside>; 2] {
        let (v, strip_mm) = (self.voxel_mm, self.strip_mm);
        let levels_mm = self.levels_mm(points, path);
        let lower = points.iter().filter(|p| self.is_lower(p)).filter_map(|p| {
            let (out, up) = out_and_up(p);
            let mine = (v..strip_mm).contains(&out);
            mine.then_some(Beside { face: 0, u: out, h: up, incidence_cos: 1.0, ..*p })
        });
        let upper = points.iter().filter_map(|p| {
            let (out, up) = out_and_up(p);
            let station = path.station_at(p.s);
            let over = up - levels_mm[station];
            let slope = if scan.cameras_known {
                slope(&path.frames[station], &scan.merged.cameras_mm[usize::from(p.view)])
            } else {
                Some(0.0)
            };
            let out = out - over * slope?;
            let mine = over.abs() < self.half_mm && (-strip_mm..OUT_SHARE * strip_mm).contains(&out);
            mine.then_some(Beside { face: 1, u: up, h: out, incidence_cos: 1.0, ..*p })
        });
        let mut layers = [lower.collect::<Vec<_>>(), upper.collect::<Vec<_>>()];
        layers.iter_mut().for_each(|points| points.sort_unstable_by(|a, b| a.s.total_cmp(&b.s)));
        layers
    }

    /// Height of the upper layer at each station; that of all where too little of it is there.
    fn levels_mm(&self, points: &[Beside], path: &Path) -> Vec<f32> {
        let mut heights_mm = vec![Vec::new(); path.frames.len()];
        for p in points {
            let (out, up) = out_and_up(p);
            if (-self.strip_mm..-self.voxel_mm).contains(&out) && (up - self.height_mm).abs() < self.half_mm {
                heights_mm[path.station_at(p.s)].push(up);
            }
        }
        let level = |k: usize| {
            let around = k.saturating_sub(LEVEL_STATIONS)..(k + LEVEL_STATIONS + 1).min(heights_mm.len());
            let mut near: Vec<f32> = heights_mm[around].concat();
            if near.len() < LEAST_POINTS { self.height_mm } else { median(&mut near) }
        };
        (0..heights_mm.len()).map(level).collect()
    }

    /// The foot of the edge at one station: the lower layer's plane, and where the upper layer ends.
    fn station(&self, windows: &Windows, path: &Path, k: usize) -> Option<MeasuredStation> {
        let s = k as f32 * path.step_mm;
        let strip = f64::from(self.strip_mm);
        let (lower, upper) = (windows.samples(0, s), windows.samples(1, s));
        let floor = face::fit(&lower, 0.0, f64::from(windows.half_mm), &mut Scratch::default())?;
        let sigma = floor.quality.sigma;
        let edge = self.edge_mm(&upper, sigma)?;
        let (low, high) = upper.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.d), h.max(p.d)));
        // The side is square to the layers by assumption.
        let side = FitQuality { sigma, support: (low, high), slope_variance: 0.0 };
        let frame = &path.frames[k];
        let axes = frame.cross_section();
        let (up, out) = (axes.flat(&frame.faces[0]), axes.flat(&frame.faces[1]));
        let across = out * edge + up * (floor.offset + floor.slope * edge);
        let normals = [(up - out * floor.slope).normalize(), (out + up * floor.slope).normalize()];
        let level = |points: &[FacePoint], near: &dyn Fn(&FacePoint) -> bool| {
            points.iter().filter(|p| p.d.abs() < f64::from(path.step_mm) && near(p)).count()
        };
        let height = f64::from(self.height_mm);
        let present = [
            level(&lower, &|p| p.u < PRESENT_SHARE * strip),
            level(&upper, &|p| p.h > -PRESENT_SHARE * strip && p.u < PRESENT_HEIGHTS * height),
        ];
        let view_share = [windows.view_share(0, s), windows.view_share(1, s)];
        Some(MeasuredStation { across, normals, quality: [floor.quality, side], present, view_share })
    }

    /// Where the upper layer ends, out of the step. The side of the plate, where it is seen, adds points to the layer at its very
    /// edge: those no deeper than the layer's noise. The higher the points that are counted, the fewer are of the side, in a
    /// ratio that normal noise gives: from two such counts follows where the layer ends without them.
    fn edge_mm(&self, upper: &[FacePoint], sigma: f64) -> Option<f64> {
        let inside = |p: &&FacePoint| (-f64::from(self.strip_mm)..-self.inner_mm()).contains(&p.h);
        let mean = |value: &dyn Fn(&FacePoint) -> f64| {
            let rows = || upper.iter().filter(inside);
            rows().map(|p| p.w * value(p)).sum::<f64>() / rows().map(|p| p.w).sum::<f64>()
        };
        let level = mean(&|p| p.u);
        let deviation = mean(&|p| (p.u - level).powi(2)).sqrt();
        if deviation < f64::from(LEAST_LAYER_VOXELS * self.voxel_mm) {
            return self.edge_of(upper, sigma);
        }
        let above = |least: f64| {
            let counted: Vec<FacePoint> = upper.iter().filter(|p| p.u > least).copied().collect();
            self.edge_of(&counted, sigma)
        };
        let (low, middle) = (above(level - LOW_DEVIATIONS * deviation)?, above(level)?);
        Some(middle - SIDE_SHARE * (low - middle))
    }

    fn inner_mm(&self) -> f64 {
        EDGE_VOXELS * f64::from(self.voxel_mm)
    }

    /// Where some points end, out of the step: so that beyond lies as much of them as there is, at their density inside.
    fn edge_of(&self, upper: &[FacePoint], sigma: f64) -> Option<f64> {
        let (strip, voxel) = (f64::from(self.strip_mm), f64::from(self.voxel_mm));
        let sum = |low: f64, high: f64| -> f64 {
            upper.iter().filter(|p| (low..high).contains(&p.h)).map(|p| p.w).sum()
        };
        let inner = self.inner_mm();
        let density = sum(-strip, -inner) / (strip - inner);
        if upper.len() < LEAST_POINTS || density <= 0.0 {
            return None;
        }
        // Counting noise grows with the margin, which need only be as wide as the points' own noise.
        let margin = (MARGIN_DEVIATIONS * sigma).max(MARGIN_VOXELS * voxel);
        let beyond = f64::from(OUT_SHARE) * strip;
        let moved = |edge: f64, _| edge - margin + sum(edge - margin, beyond) / density;
        Some((0..EDGE_ROUNDS).fold(0.0, moved))
    }
}
