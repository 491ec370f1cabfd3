//! Two faces along a path, fitted in one cross-section after another, and the walls that end them (ours).

use super::beside::{Beside, beside};
use super::face::{self, Scratch};
use super::path::Path;
use super::reach::{self, Reach};
use super::rounding::{Extent, Rounding};
use super::station::{MeasuredStation, Meeting};
use super::windows::Windows;
use super::{ACUTE_DEG, NARROW, RefineConfig};
use crate::geometry::cloud::Merged;
use crate::geometry::statistics::{median, robust_deviation};
use crate::seam::input::RawScan;
use rayon::prelude::*;
use std::ops::Range;

// All chosen on the simulated scans.

/// Height off a face up to which points count in the first round, how much less in each later one, and the least of it,
/// voxels.
const GATE_VOXELS: f32 = 1.7;
const GATE_SHRINKS_VOXELS: f32 = 0.35;
const LEAST_GATE_VOXELS: f32 = 1.0;
/// What is left out more where a face is rounded beside the root, and how much farther it then goes on at least, voxels.
const LEFT_OUT_VOXELS: [f32; 3] = [1.5, 3.0, 4.5];
const GAINED_VOXELS: f32 = 1.5;
/// Reach of a face that ends soon, in inner parts.
const SOON: f32 = 1.3;
/// Cosine of incidence below which a point tells nothing of a face.
const LEAST_INCIDENCE: f32 = 0.1;

/// Height off the tangent plane up to which a face's curvature is looked for, voxels; the least that counts, as the
/// coefficient of `u²`, 1/mm; and over how much of the window it is averaged along the seam.
const WIDE_GATE: f32 = 2.5;
const CURVED: f64 = 1e-3;
const BEND_WIDTH: f64 = 0.9;
/// Fewer stations with a curvature tell nothing; and deviations from their mean, beside the least deviation, 1/mm, within
/// which it is noise.
const LEAST_BENDS: usize = 5;
const BEND_NOISE: f64 = 2.5e-4;
const BEND_DEVIATIONS: f64 = 2.5;
/// A curvature this small is none to divide by, 1/mm.
const LEAST_BEND: f64 = 1e-12;

/// Standard deviations within which a point lies on a fitted face.
const ON_FACE_DEVIATIONS: f64 = 4.0;

/// Where the air between the faces is looked at for walls that end a seam: height off both faces and distance from the
/// seam, voxels; and the share of the usual number of points of a face that makes a wall.
const WALL_FROM: f32 = 2.5;
const WALL_TO: f32 = 7.0;
const WALL_SHARE: f64 = 0.25;
/// Stations inward of those that were put to an end among which a wall may be.
const WALL_ZONE: usize = 2;
/// Points of a face that tell whether it is even.
const SAMPLE: usize = 5000;

/// The raw points of the two faces beside a path.
pub(super) struct FaceSections {
    pub(super) windows: Windows,
    /// Coefficient of `u²` per face and station, 1/mm.
    bend: [Vec<f64>; 2],
    /// Where points stand in the air between the faces: along the seam, sorted, mm.
    walls: Vec<f32>,
    /// How far each face reaches from the seam, mm.
    pub(super) reach_mm: [f32; 2],
    /// What is not known of each face's height at the root because of what lifts it there, mm.
    pub(super) lift_unknown_mm: [f64; 2],
    /// Part of a face next to the seam, mm.
    inner_mm: f32,
}

/// Which points are of a face, mm.
struct Gates {
    /// Height off the face.
    height_mm: f32,
    /// The same while curvature is looked for.
    wide_mm: f32,
    reach: Reach,
    /// Whether the faces meet at less than [`ACUTE_DEG`].
    acute: bool,
    voxel_mm: f32,
    /// Whether the path is near enough to the seam to tell what lifts the faces beside it.
    near: bool,
    /// Whether several cameras saw the faces, and which saw what. From one side alone, and in a cloud that was merged and
    /// smoothed elsewhere, what bends beside a root is as likely the work's own shape.
    by_camera: bool,
}

impl Gates {
    fn new(scan: &Merged, path: &Path, voxel_mm: f32, config: &RefineConfig, round: usize) -> Self {
        let cameras_known = !scan.cameras_unknown;
        let mut cosines: Vec<f32> = path.frames.iter().map(|f| f.faces[0].dot(&f.faces[1])).collect();
        let opening_deg = 180.0 - median(&mut cosines).clamp(-1.0, 1.0).acos().to_degrees();
        let acute = opening_deg < ACUTE_DEG;
        let shrunk = (GATE_VOXELS - GATE_SHRINKS_VOXELS * round as f32).max(LEAST_GATE_VOXELS);
        let height_mm = voxel_mm * shrunk;
        let from_mm = voxel_mm * if acute { config.acute_root } else { config.root };
        let reach = Reach {
            from_mm,
            begins_mm: from_mm,
            inner_mm: config.inner * voxel_mm,
            most_mm: config.reach * voxel_mm,
            // Where it is not known what hides what, a face may end anywhere.
            is_side: cameras_known && (ACUTE_DEG..180.0 - ACUTE_DEG).contains(&opening_deg),
        };
        let wide_mm = height_mm.max(WIDE_GATE * voxel_mm);
        let by_camera = cameras_known && scan.cameras_mm.len() > 1;
        Self { height_mm, wide_mm, reach, acute, voxel_mm, near: round > 0, by_camera }
    }

    /// The points of a face, sorted along the seam, how far it reaches, and what lifts it beside the root.
    fn of_face(&self, all: &[Beside], face: usize) -> (Vec<Beside>, f32, Rounding) {
        let mine = |p: &&Beside| {
            usize::from(p.face) == face
                && p.h.abs() < self.wide_mm
                && p.u > self.reach.from_mm
                && p.u < self.reach.most_mm
                && p.incidence_cos > LEAST_INCIDENCE
        };
        let mut wide: Vec<Beside> = all.iter().filter(mine).copied().collect();
        let flat: Vec<Beside> = wide.iter().filter(|p| p.h.abs() < self.height_mm).copied().collect();
        let (from_mm, reach_mm, rounding) = self.true_part(flat);
        wide.retain(|p| p.u < reach_mm && p.u > from_mm);
        wide.iter_mut().for_each(|p| p.h -= rounding.lift(p.u));
        wide.sort_unstable_by(|a, b| a.s.total_cmp(&b.s));
        (wide, reach_mm, rounding)
    }

    /// Where a face begins to be itself and how far it then reaches, mm, and what lifts it beside the root.
    ///
    /// What is lifted beside the root seems to bend away from what it is there, and to end soon: the lift is taken off first.
    /// A path that is not near the seam yet cannot tell the lift; it only tells where the face goes on for longer.
    fn true_part(&self, mut flat: Vec<Beside>) -> (f32, f32, Rounding) {
        let from_mm = self.reach.from_mm;
        let ends_mm = reach::ends(&flat, &self.reach);
        let narrow = self.acute || ends_mm < NARROW * self.reach.most_mm;
        let reach_mm = reach::reach(&flat, &self.reach);
        let mut rounding = Rounding::default();
        if !self.by_camera {
            return (from_mm, reach_mm, rounding);
        }
        if self.near {
            let extent = Extent {
                from_mm,
                reach_mm: if narrow { reach_mm } else { ends_mm },
                voxel_mm: self.voxel_mm,
            };
            rounding = Rounding::of(&flat, &extent, self.height_mm, narrow);
        }
        if rounding.is_none() {
            let longest = if narrow { (from_mm, reach_mm) } else { self.longest(&flat, reach_mm) };
            return (longest.0, longest.1, rounding);
        }
        flat.iter_mut().for_each(|p| p.h -= rounding.lift(p.u));
        (rounding.until_mm, reach_mm.max(reach::reach(&flat, &self.reach)), rounding)
    }

    /// Where a face begins and ends that reaches so far, or farther once more of it is left out beside the root. What is
    /// rounded in its inner part ends soon behind it.
    fn longest(&self, flat: &[Beside], reach_mm: f32) -> (f32, f32) {
        let mut best = (self.reach.from_mm, reach_mm);
        if reach_mm > SOON * self.reach.inner_mm {
            return best;
        }
        for voxels in LEFT_OUT_VOXELS {
            let aside_mm = voxels * self.voxel_mm;
            let (from_mm, inner_mm) = (self.reach.from_mm + aside_mm, self.reach.inner_mm + aside_mm);
            let reach_mm = reach::reach(flat, &Reach { from_mm, inner_mm, ..self.reach });
            if reach_mm > best.1 + GAINED_VOXELS * self.voxel_mm {
                best = (from_mm, reach_mm);
            }
        }
        best
    }

    /// Bevels are flat across, and too narrow to tell curvature from the rounding of their lips.
    fn is_bevel(&self, reach_mm: f32) -> bool {
        self.acute && reach_mm < NARROW * self.reach.most_mm
    }
}

impl FaceSections {
    /// Of the points `near` a path, in the given round of fits.
    pub(super) fn new(
        scan: &RawScan,
        near: &[u32],
        path: &Path,
        voxel_mm: f32,
        config: &RefineConfig,
        round: usize,
    ) -> Self {
        let gates = Gates::new(scan.merged, path, voxel_mm, config, round);
        // Nothing farther along and off a face is used.
        let all = beside(scan.merged, near, path.line(), gates.reach.most_mm.hypot(WIDE_GATE * voxel_mm));
        let (first, second) = rayon::join(|| gates.of_face(&all, 0), || gates.of_face(&all, 1));
        let reach_mm = [first.1, second.1];
        let half_mm = config.half * voxel_mm;
        let mut sections = Self {
            windows: Windows::new([first.0, second.0], path, half_mm, scan.merged.cameras_mm.len()),
            bend: [Vec::new(), Vec::new()],
            walls: walls(&all, voxel_mm),
            reach_mm,
            lift_unknown_mm: [first.2.unknown_mm, second.2.unknown_mm],
            inner_mm: gates.reach.inner_mm,
        };
        for face in 0..2 {
            sections.find_bend(path, face, &gates);
        }
        if gates.by_camera && round + 1 == config.rounds {
            for face in 0..2 {
                let unknown = &mut sections.lift_unknown_mm[face];
                *unknown =
                    unknown.hypot(uneven_mm(&sections.windows.points[face], &sections.bend[face], path));
            }
        }
        if sections.bend.iter().flatten().any(|b| b.abs() > CURVED) {
            let limit = config.curved_reach * voxel_mm;
            sections.windows.points.iter_mut().for_each(|points| points.retain(|p| p.u < limit));
        }
        sections
    }

    /// Finds how a face bends across the seam, and drops the points that are off it.
    fn find_bend(&mut self, path: &Path, face: usize, gates: &Gates) {
        let mut bend = vec![0.0; path.frames.len()];
        if !gates.is_bevel(self.reach_mm[face]) {
            bend = bends(&self.windows, path, face);
        }
        let curved = bend.iter().any(|b| b.abs() > CURVED);
        // A gate about the tangent plane would cut the far points of a curved face, and flatten it.
        self.windows.points[face]
            .retain(|p| (p.h - bend[path.station_at(p.s)] as f32 * p.u * p.u).abs() < gates.height_mm);
        self.bend[face] = if curved { bends(&self.windows, path, face) } else { bend };
    }

    /// What every station of the path measures; none where a face has too few points.
    pub(super) fn stations(&self, path: &Path) -> Vec<Option<MeasuredStation>> {
        (0..path.frames.len())
            .into_par_iter()
            .map_init(Scratch::default, |scratch, k| self.station(path, k, scratch))
            .collect()
    }

    fn station(&self, path: &Path, k: usize, scratch: &mut Scratch) -> Option<MeasuredStation> {
        let s = k as f32 * path.step_mm;
        let samples = [self.windows.samples(0, s), self.windows.samples(1, s)];
        let half = f64::from(self.windows.half_mm);
        let fits = [
            face::fit(&samples[0], self.bend[0][k], half, scratch)?,
            face::fit(&samples[1], self.bend[1][k], half, scratch)?,
        ];
        // A station beside which either face has (almost) no points is beyond the end of the seam.
        let beside = f64::from(path.step_mm);
        let inner = f64::from(self.inner_mm);
        let present = |f: usize| {
            let fit = &fits[f];
            let on = |p: &&face::FacePoint| {
                let height = fit.offset + p.u * (fit.slope + fit.bend * p.u);
                let off = (p.h - height).abs();
                p.d.abs() < beside && p.u < inner && off < ON_FACE_DEVIATIONS * fit.quality.sigma
            };
            samples[f].iter().filter(on).count()
        };
        let present = [present(0), present(1)];
        let Meeting { across, normals } = Meeting::of(&path.frames[k], &fits)?;
        let view_share = [self.windows.view_share(0, s), self.windows.view_share(1, s)];
        Some(MeasuredStation { across, normals, quality: fits.map(|f| f.quality), present, view_share })
    }

    /// Where along an open path both faces have points next to the seam, mm.
    pub(super) fn both_seen_mm(&self) -> Option<Range<f32>> {
        self.windows.both_seen_mm(|p| p.u < self.inner_mm)
    }

    /// Stations up to the walls that an open path ran into while `added` stations were put to each end.
    pub(super) fn before_walls(
        &self,
        stations: &[Option<MeasuredStation>],
        path: &Path,
        added: usize,
    ) -> Range<usize> {
        let n = stations.len();
        let all = 0..n;
        if path.closed || self.walls.is_empty() {
            return all;
        }
        let mut usual: Vec<f64> =
            stations.iter().flatten().map(|s| 0.5 * (s.present[0] + s.present[1]) as f64).collect();
        let least = WALL_SHARE * median(&mut usual);
        let is_wall = |k: usize| {
            let s = k as f32 * path.step_mm;
            let from = self.walls.partition_point(|w| *w < s - path.step_mm);
            let to = self.walls.partition_point(|w| *w <= s + path.step_mm);
            (to - from) as f64 > least
        };
        let zone = (added + WALL_ZONE).min(n / 2);
        let first = (0..zone).rev().find(|&k| is_wall(k)).unwrap_or(0);
        let last = (n - zone..n).find(|&k| is_wall(k)).unwrap_or(n - 1);
        first..last + 1
    }
}

/// How far apart the near half of a face and all of it put the face at the root, mm: a plane's agree, whatever rounds a corner lifts
/// what is near it.
fn uneven_mm(points: &[Beside], bend: &[f64], path: &Path) -> f64 {
    let step = points.len() / SAMPLE + 1;
    let flat = points.iter().step_by(step).map(|p| {
        let u = f64::from(p.u);
        (u, f64::from(p.h) - bend[path.station_at(p.s)] * u * u)
    });
    let mut flat: Vec<(f64, f64)> = flat.collect();
    flat.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let near = &flat[..flat.len() / 2];
    let [Some(all), Some(near)] = [reach::at_root_mm(&flat), reach::at_root_mm(near)] else { return 0.0 };
    (near - all).abs()
}

/// Where points stand in the air between the faces, along the seam, sorted, mm.
fn walls(all: &[Beside], voxel_mm: f32) -> Vec<f32> {
    let in_air = |p: &&Beside| p.u > 0.0 && p.h > WALL_FROM * voxel_mm && p.u.hypot(p.h) < WALL_TO * voxel_mm;
    let mut walls: Vec<f32> = all.iter().filter(in_air).map(|p| p.s).collect();
    walls.sort_unstable_by(f32::total_cmp);
    walls
}

/// Curvature of a face across the seam per station, smoothed along it and dropped where it is not significant.
fn bends(windows: &Windows, path: &Path, face: usize) -> Vec<f64> {
    let n = path.frames.len();
    let raw: Vec<Option<f64>> = (0..n)
        .into_par_iter()
        .map_init(Scratch::default, |scratch, k| {
            let mut samples = windows.samples(face, k as f32 * path.step_mm);
            samples.iter_mut().for_each(|s| s.w = 1.0);
            face::bend(&samples, scratch)
        })
        .collect();
    if raw.iter().flatten().count() < LEAST_BENDS {
        return vec![0.0; n];
    }
    let smooth = averaged(&raw, windows, path.step_mm);
    let mut misses: Vec<f64> =
        raw.iter().zip(&smooth).filter_map(|(r, s)| Some((r.as_ref()? - s).abs())).collect();
    let deviation = robust_deviation(&mut misses) + BEND_NOISE;
    let keep = |b: f64| b * (1.0 - (BEND_DEVIATIONS * deviation / b.abs().max(LEAST_BEND)).powi(2)).max(0.0);
    smooth.into_iter().map(keep).collect()
}

/// Means of the values of neighbouring stations, weighted by a Gaussian of their distance.
fn averaged(raw: &[Option<f64>], windows: &Windows, step_mm: f32) -> Vec<f64> {
    let n = raw.len();
    let width = BEND_WIDTH * f64::from(windows.half_mm);
    // By how far one station is beyond the other, from `1 - n` on.
    let falloff: Vec<f64> = (1..2 * n)
        .map(|beyond| {
            let d = windows.apart_mm(beyond as f64 - n as f64, step_mm);
            (-0.5 * (d / width).powi(2)).exp()
        })
        .collect();
    let mean = |k: usize| {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (value, w) in raw.iter().zip(&falloff[n - 1 - k..]) {
            let Some(value) = value else { continue };
            sum += w * value;
            weights += w;
        }
        sum / weights
    };
    (0..n).map(mean).collect()
}
