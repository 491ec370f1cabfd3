//! Below the voxel: each station of a seam is the intersection of the two faces fitted to raw points beside it (ours).
//!
//! Raw points, because the bilateral filter rounds corners. Seam coordinates, because a straight window would bend a curved
//! seam. Heights are fitted over a window along the seam, the root itself left out, and the fits are intersected in the
//! cross-section; the stations are then smoothed as stiffly as cross-validation allows.

pub mod beside;
pub mod expected;
pub mod face;
pub mod overlap;
pub mod smooth;
pub mod stretch;

use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::geometry::statistics::median;
use crate::seam::refine::beside::{Beside, Frame, beside, near_path};
use crate::seam::refine::smooth::{Curve, Samples};
use crate::seam::trace::chain::Chain;
use face::{Fit, Reach, Sample, Scratch};
use nalgebra::{Matrix2, Point3, Rotation3, Vector2, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// Sizes, in voxels unless named otherwise.
#[derive(Debug, Clone, Copy)]
pub struct Config {
    /// Distance of stations.
    pub step: f32,
    /// Half length of the window along the seam.
    pub half: f32,
    /// Strip beside the root that is left out.
    pub root: f32,
    /// The same where the faces meet at less than 75 degrees: there is a gap, or a root face.
    pub acute_root: f32,
    /// Farthest from the seam that points are used.
    pub reach: f32,
    /// The same on curved faces.
    pub curved_reach: f32,
    /// Longest stretch without points that is bridged.
    pub gap: f32,
    /// Rounds of fit and re-projection.
    pub rounds: usize,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            step: 1.7,
            half: 8.3,
            root: 0.85,
            acute_root: 1.85,
            reach: 11.7,
            curved_reach: 8.3,
            gap: 6.7,
            rounds: 3,
        }
    }
}

/// Faces that meet at less leave a gap or a root face between them, degrees.
pub const ACUTE_DEG: f32 = 75.0;
/// Share of the farthest reach below which a face counts as narrow.
pub const NARROW: f32 = 0.93;

/// Height off the tangent plane up to which a face's curvature is looked for, voxels; the least that counts, as the
/// coefficient of `u²`, 1/mm; and over how much of the window it is averaged along the seam.
const WIDE_GATE: f32 = 2.5;
const CURVED: f64 = 1e-3;
const BEND_WIDTH: f64 = 0.9;

/// Where the air between the faces is looked at for walls that end a seam: height off both faces and distance from the
/// seam, voxels; and the share of the usual number of points of a face that makes a wall.
const WALL_FROM: f32 = 2.5;
const WALL_TO: f32 = 7.0;
const WALL_SHARE: f64 = 0.25;

/// A refined seam.
#[derive(Debug, Clone)]
pub struct Refined {
    /// Stations at equal steps.
    pub frames: Vec<Frame>,
    /// Distance of stations, mm.
    pub step_mm: f32,
    /// Whether the last station is followed by the first.
    pub closed: bool,
    /// Which stations were measured, not bridged.
    pub measured: Vec<bool>,
    /// Noise of the points about the faces, mm.
    pub sigma_mm: f64,
    /// Standard deviation of the smoothed position across the seam from the points' noise alone, mm.
    pub scatter_mm: f64,
    /// Standard deviation of the smoothed face normals, rad.
    pub tilt_rad: f64,
    /// Distance that points of each face reach from the seam, mm.
    pub reach_mm: [f32; 2],
    /// Length of the window of a station, mm.
    pub window_mm: f32,
    /// Effective number of free parameters of the smoothed curve, per coordinate.
    pub freedom: f64,
    /// Per station and face: share of each view in the fit.
    pub view_share: Vec<[Vec<f32>; 2]>,
    /// The raw points that lie near enough to matter.
    pub near: Vec<u32>,
}

impl Refined {
    /// Cuts an open or closed seam to some of its stations.
    pub fn keep(&mut self, stations: Range<usize>) {
        let whole = stations.len() == self.frames.len();
        self.frames = self.frames[stations.clone()].to_vec();
        self.measured = self.measured[stations.clone()].to_vec();
        self.view_share = self.view_share[stations].to_vec();
        self.closed &= whole;
    }
}

/// Refines a chain; `None` if too little of it is supported by raw points, which are indexed by `raw`.
pub fn refine(merged: &Merged, raw: &Grid, chain: &Chain, voxel_mm: f32, config: &Config) -> Option<Refined> {
    let mut path = Path::new(chain, config.step * voxel_mm)?;
    let reach_mm = config.reach * voxel_mm;
    let mut near = Vec::new();
    let mut refined = None;
    for round in 0..config.rounds {
        let added = if round == 0 { 2 } else { 4 };
        path.extend(added);
        if round < 2 {
            near = near_path(raw, &path.frames, reach_mm + 4.0 * voxel_mm);
        }
        let section = Section::new(merged, &near, &path, voxel_mm, config, round);
        let stations = section.stations(&path);
        let inside = section.before_walls(&stations, &path, added);
        let outcome = stretch::smoothed(&path, &stations, inside, &section, voxel_mm, config)?;
        path = Path { frames: outcome.frames.clone(), step_mm: outcome.step_mm, closed: path.closed };
        refined = Some(outcome);
    }
    refined.map(|refined| Refined { near, ..refined })
}

/// Stations at equal steps.
pub(super) struct Path {
    pub(super) frames: Vec<Frame>,
    pub(super) step_mm: f32,
    pub(super) closed: bool,
}

impl Path {
    /// A chain, lightly smoothed, at about `step_mm`.
    pub(super) fn new(chain: &Chain, step_mm: f32) -> Option<Self> {
        let rows: Vec<[f64; 9]> = chain
            .links
            .iter()
            .map(|l| {
                let (p, [a, b]) = (l.position, l.faces);
                [p.x, p.y, p.z, a.x, a.y, a.z, b.x, b.y, b.z].map(f64::from)
            })
            .collect();
        let (rows, step_mm) = resampled(&rows, chain.closed, step_mm);
        let weights = vec![1.0; rows.len()];
        let samples =
            Samples { values: &rows, weights: &weights, step_mm: f64::from(step_mm), closed: chain.closed };
        let frames = frames(&samples.smooth(Curve::Spline(3e2)), chain.closed)?;
        Some(Self { frames, step_mm, closed: chain.closed })
    }

    /// Continues an open path, bending on as it bends, to find where the seam ends.
    pub(super) fn extend(&mut self, stations: usize) {
        if self.closed {
            return;
        }
        let after = onward(&self.frames, self.step_mm, stations);
        let reversed: Vec<Frame> = self.frames.iter().rev().map(Frame::reversed).collect();
        let before = onward(&reversed, self.step_mm, stations);
        let before = before.iter().rev().map(Frame::reversed);
        self.frames = before.chain(self.frames.iter().copied()).chain(after).collect();
    }
}

/// Frames after the last of an open path, each turned against the one before as the path turns at its end.
fn onward(frames: &[Frame], step_mm: f32, stations: usize) -> Vec<Frame> {
    const LOOK_BACK: usize = 6;
    let (Some(last), Some(earlier)) =
        (frames.last().copied(), frames.len().checked_sub(1 + LOOK_BACK).and_then(|k| frames.get(k)))
    else {
        return Vec::new();
    };
    let turn = Rotation3::rotation_between(&earlier.tangent, &last.tangent).unwrap_or_default();
    let (step, half) = (turn.powf(1.0 / LOOK_BACK as f32), turn.powf(0.5 / LOOK_BACK as f32));
    let mut frame = last;
    let mut after = Vec::with_capacity(stations);
    for _ in 0..stations {
        let position = frame.position + half * frame.tangent * step_mm;
        frame = Frame { position, tangent: step * frame.tangent, faces: frame.faces.map(|n| step * n) };
        after.push(frame);
    }
    after
}

/// Rows `position, ...` at equal steps of the position's arc length.
pub(super) fn resampled(rows: &[[f64; 9]], closed: bool, step_mm: f32) -> (Vec<[f64; 9]>, f32) {
    let mut rows = rows.to_vec();
    if closed {
        rows.push(rows[0]);
    }
    let place = |r: &[f64; 9]| Vector3::new(r[0], r[1], r[2]);
    let mut at = vec![0.0];
    for w in rows.windows(2) {
        at.push(at[at.len() - 1] + (place(&w[1]) - place(&w[0])).norm());
    }
    let length = at[at.len() - 1];
    let steps = ((length / f64::from(step_mm)).round() as usize).max(4);
    let mut out = Vec::with_capacity(steps + 1);
    let mut k = 0;
    for i in 0..steps + usize::from(!closed) {
        let s = length * i as f64 / steps as f64;
        while k + 2 < rows.len() && at[k + 1] < s {
            k += 1;
        }
        let share = ((s - at[k]) / (at[k + 1] - at[k]).max(1e-12)).clamp(0.0, 1.0);
        out.push(std::array::from_fn(|d| rows[k][d] * (1.0 - share) + rows[k + 1][d] * share));
    }
    (out, (length / steps as f64) as f32)
}

/// Frames of rows `position, face, face`, the tangent by central differences.
pub(super) fn frames(rows: &[[f64; 9]], closed: bool) -> Option<Vec<Frame>> {
    let n = rows.len();
    let place = |k: usize| Point3::new(rows[k][0] as f32, rows[k][1] as f32, rows[k][2] as f32);
    let vector =
        |k: usize, d: usize| Vector3::new(rows[k][d] as f32, rows[k][d + 1] as f32, rows[k][d + 2] as f32);
    (0..n)
        .map(|k| {
            // At an end the parabola through the last three keeps the tangent of a curved seam.
            let onward = |a: usize, b: usize, c: usize| (place(b) - place(a)) * 4.0 - (place(c) - place(a));
            let tangent = match (closed, k) {
                (true, _) => place((k + 1) % n) - place((k + n - 1) % n),
                (false, 0) if n > 2 => onward(0, 1, 2),
                (false, _) if k + 1 == n && n > 2 => -onward(k, k - 1, k - 2),
                _ => place((k + 1).min(n - 1)) - place(k.saturating_sub(1)),
            };
            Frame::new(place(k), tangent, [vector(k, 3), vector(k, 6)])
        })
        .collect()
}

/// The raw points of a path in its coordinates, by face and along the seam.
pub(super) struct Section {
    /// Sorted along the seam.
    points: [Vec<Beside>; 2],
    /// Coefficient of `u²` per face and station.
    bend: [Vec<f64>; 2],
    /// Where points stand in the air between the faces: along the seam, sorted.
    walls: Vec<f32>,
    pub(super) reach_mm: [f32; 2],
    pub(super) half_mm: f32,
    inner_mm: f32,
    length_mm: f32,
    closed: bool,
    views: usize,
}

/// What one station measured: correction across the seam, face normals in the cross-section, fits.
pub(super) struct Station {
    pub(super) across: Vector2<f64>,
    pub(super) normals: [Vector2<f64>; 2],
    pub(super) fits: [Fit; 2],
    /// Points of each face next to the seam and level with the station.
    pub(super) present: [usize; 2],
    pub(super) view_share: [Vec<f32>; 2],
}

impl Section {
    fn new(merged: &Merged, near: &[u32], path: &Path, voxel_mm: f32, config: &Config, round: usize) -> Self {
        let most_mm = config.reach * voxel_mm;
        // Nothing farther along and off a face is used.
        let reach_mm = most_mm.hypot(WIDE_GATE * voxel_mm);
        let all = beside(merged, near, &path.frames, path.closed, path.step_mm, reach_mm);
        let mut cosines: Vec<f32> = path.frames.iter().map(|f| f.faces[0].dot(&f.faces[1])).collect();
        let opening_deg = 180.0 - median(&mut cosines).clamp(-1.0, 1.0).acos().to_degrees();
        let root_mm = voxel_mm * if opening_deg < ACUTE_DEG { config.acute_root } else { config.root };
        let gate_mm = voxel_mm * (1.7 - 0.35 * round as f32).max(1.0);
        let scale = Reach { from_mm: root_mm, inner_mm: 5.4 * voxel_mm, most_mm };
        let in_air =
            |p: &&Beside| p.u > 0.0 && p.h > WALL_FROM * voxel_mm && p.u.hypot(p.h) < WALL_TO * voxel_mm;
        let mut walls: Vec<f32> = all.iter().filter(in_air).map(|p| p.s).collect();
        walls.sort_unstable_by(f32::total_cmp);
        let mut section = Self {
            points: [Vec::new(), Vec::new()],
            bend: [Vec::new(), Vec::new()],
            walls,
            reach_mm: [0.0; 2],
            half_mm: config.half * voxel_mm,
            inner_mm: scale.inner_mm,
            length_mm: path.step_mm * path.frames.len() as f32,
            closed: path.closed,
            views: merged.cameras_mm.len(),
        };
        let of_face = |face: usize| {
            let mine = |p: &&Beside| {
                usize::from(p.face) == face
                    && p.h.abs() < gate_mm.max(WIDE_GATE * voxel_mm)
                    && p.u > root_mm
                    && p.u < most_mm
                    && p.incidence_cos > 0.1
            };
            let mut wide: Vec<Beside> = all.iter().filter(mine).copied().collect();
            let flat: Vec<Beside> = wide.iter().filter(|p| p.h.abs() < gate_mm).copied().collect();
            let reach_mm = face::reach(&flat, &scale);
            wide.retain(|p| p.u < reach_mm);
            wide.sort_unstable_by(|a, b| a.s.total_cmp(&b.s));
            (wide, reach_mm)
        };
        let (first, second) = rayon::join(|| of_face(0), || of_face(1));
        for (face, (points, reach_mm)) in [first, second].into_iter().enumerate() {
            (section.points[face], section.reach_mm[face]) = (points, reach_mm);
            // Bevels are flat across, and too narrow to tell curvature from the rounding of their lips.
            let bevel = opening_deg < ACUTE_DEG && reach_mm < NARROW * most_mm;
            let mut bend = vec![0.0; path.frames.len()];
            if !bevel {
                bend = section.bends(path, face);
            }
            let curved = bend.iter().any(|b| b.abs() > CURVED);
            // A gate about the tangent plane would cut the far points of a curved face, and flatten it.
            let last = bend.len() - 1;
            section.points[face].retain(|p| {
                let station = ((p.s / path.step_mm).round().max(0.0) as usize).min(last);
                (p.h - bend[station] as f32 * p.u * p.u).abs() < gate_mm
            });
            section.bend[face] = if curved { section.bends(path, face) } else { bend };
        }
        if section.bend.iter().flatten().any(|b| b.abs() > CURVED) {
            let limit = config.curved_reach * voxel_mm;
            section.points.iter_mut().for_each(|points| points.retain(|p| p.u < limit));
        }
        section
    }

    /// Points of two layers, sorted along the seam, instead of points of two faces that meet in it.
    pub(super) fn of_layers(
        points: [Vec<Beside>; 2],
        path: &Path,
        reach_mm: [f32; 2],
        half_mm: f32,
        views: usize,
    ) -> Self {
        Self {
            points,
            bend: [Vec::new(), Vec::new()],
            walls: Vec::new(),
            reach_mm,
            half_mm,
            inner_mm: f32::MAX,
            length_mm: path.step_mm * path.frames.len() as f32,
            closed: path.closed,
            views,
        }
    }

    /// Points of a face within the window about `s`, with their distance along the seam from it.
    fn window(&self, face: usize, s: f32) -> impl Iterator<Item = (&Beside, f32)> {
        let points = &self.points[face];
        let about = move |shift: f32| {
            let from = points.partition_point(|p| p.s <= s + shift - self.half_mm);
            let to = points.partition_point(|p| p.s < s + shift + self.half_mm);
            points[from..to.max(from)].iter().map(move |p| (p, p.s - shift - s))
        };
        let round = if self.closed { &[0.0, -1.0, 1.0][..] } else { &[0.0] };
        round.iter().flat_map(move |turn| about(turn * self.length_mm))
    }

    pub(super) fn samples(&self, face: usize, s: f32) -> Vec<Sample> {
        let half = f64::from(self.half_mm);
        let sample = |(p, d): (&Beside, f32)| {
            let d = f64::from(d);
            let taper = 1.0 - (d.abs() / half).powi(3).min(1.0);
            // At grazing incidence jitter along the surface shows as depth.
            let seen = f64::from(p.incidence_cos * 2.0).min(1.0);
            Sample { d, u: f64::from(p.u), h: f64::from(p.h), w: (taper * taper + 1e-3) * seen }
        };
        self.window(face, s).map(sample).collect()
    }

    /// Curvature across the seam per station, smoothed along it and dropped where it is not significant.
    fn bends(&self, path: &Path, face: usize) -> Vec<f64> {
        let n = path.frames.len();
        let raw: Vec<Option<f64>> = (0..n)
            .into_par_iter()
            .map_init(Scratch::default, |scratch, k| {
                let mut samples = self.samples(face, k as f32 * path.step_mm);
                samples.iter_mut().for_each(|s| s.w = 1.0);
                face::bend(&samples, scratch)
            })
            .collect();
        if raw.iter().flatten().count() < 5 {
            return vec![0.0; n];
        }
        let width = BEND_WIDTH * f64::from(self.half_mm);
        // By how far one station is beyond the other, from `1 - n` on.
        let falloff: Vec<f64> = (1..2 * n)
            .map(|beyond| {
                let mut d = (beyond as f64 - n as f64) * f64::from(path.step_mm);
                if self.closed {
                    let l = f64::from(self.length_mm);
                    d = (d + 1.5 * l).rem_euclid(l) - 0.5 * l;
                }
                (-0.5 * (d / width).powi(2)).exp()
            })
            .collect();
        let smooth: Vec<f64> = (0..n)
            .map(|k| {
                let (mut sum, mut weights) = (0.0, 0.0);
                for (value, w) in raw.iter().zip(&falloff[n - 1 - k..]) {
                    let Some(value) = value else { continue };
                    sum += w * value;
                    weights += w;
                }
                sum / weights
            })
            .collect();
        let mut misses: Vec<f64> =
            raw.iter().zip(&smooth).filter_map(|(r, s)| Some((r.as_ref()? - s).abs())).collect();
        let deviation = 1.4826 * median(&mut misses) + 2.5e-4;
        let keep = |b: f64| b * (1.0 - (2.5 * deviation / b.abs().max(1e-12)).powi(2)).max(0.0);
        smooth.into_iter().map(keep).collect()
    }

    fn stations(&self, path: &Path) -> Vec<Option<Station>> {
        (0..path.frames.len())
            .into_par_iter()
            .map_init(Scratch::default, |scratch, k| self.station(path, k, scratch))
            .collect()
    }

    fn station(&self, path: &Path, k: usize, scratch: &mut Scratch) -> Option<Station> {
        let s = k as f32 * path.step_mm;
        let samples = [self.samples(0, s), self.samples(1, s)];
        let half = f64::from(self.half_mm);
        let fits = [
            face::fit(&samples[0], self.bend[0][k], half, scratch)?,
            face::fit(&samples[1], self.bend[1][k], half, scratch)?,
        ];
        // A station beside which either face has (almost) no points is beyond the end of the seam.
        let beside = f64::from(path.step_mm);
        let inner = f64::from(self.inner_mm);
        let present = |f: usize| {
            let fit = &fits[f];
            let on = |p: &&Sample| {
                let height = fit.offset + p.u * (fit.slope + fit.bend * p.u);
                p.d.abs() < beside && p.u < inner && (p.h - height).abs() < 4.0 * fit.sigma
            };
            samples[f].iter().filter(on).count()
        };
        let present = [present(0), present(1)];
        let frame = &path.frames[k];
        let (across, normals) = intersect(frame, &fits)?;
        let view_share = [self.view_share(0, s), self.view_share(1, s)];
        Some(Station { across, normals, fits, present, view_share })
    }

    /// Rows of an open seam, the first of which is at `start_mm` along it, cut to where both faces have points.
    pub(super) fn trim(&self, rows: Vec<[f64; 9]>, start_mm: f32, step_mm: f32) -> Vec<[f64; 9]> {
        let near = |f: usize| self.points[f].iter().filter(|p| p.u < self.inner_mm).map(|p| p.s);
        let (mut low, mut high) = (f32::MIN, f32::MAX);
        for f in 0..2 {
            // A few points beyond the end are noise.
            let all: Vec<f32> = near(f).collect();
            let spare = (all.len() / 200).min(12);
            if let (Some(first), Some(last)) = (all.get(spare), all.get(all.len().saturating_sub(1 + spare)))
            {
                low = low.max(*first);
                high = high.min(*last);
            }
        }
        let last = rows.len() - 1;
        let at = |s: f32| ((s - start_mm) / step_mm).clamp(0.0, last as f32);
        let (from, to) = (at(low), at(high));
        if to - from < 3.0 {
            return rows;
        }
        let between = |at: f32| {
            let k = (at as usize).min(last - 1);
            let share = f64::from(at - k as f32);
            std::array::from_fn(|d| rows[k][d] * (1.0 - share) + rows[k + 1][d] * share)
        };
        let inner = rows[from.floor() as usize + 1..to.ceil() as usize].to_vec();
        std::iter::once(between(from)).chain(inner).chain([between(to)]).collect()
    }

    /// Stations up to the walls that an open path ran into while `added` stations were put to each end.
    fn before_walls(&self, stations: &[Option<Station>], path: &Path, added: usize) -> Range<usize> {
        let n = stations.len();
        let all = 0..n;
        if self.closed || self.walls.is_empty() {
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
        let zone = (added + 2).min(n / 2);
        let first = (0..zone).rev().find(|&k| is_wall(k)).unwrap_or(0);
        let last = (n - zone..n).find(|&k| is_wall(k)).unwrap_or(n - 1);
        first..last + 1
    }

    pub(super) fn view_share(&self, face: usize, s: f32) -> Vec<f32> {
        let mut share = vec![0.0; self.views];
        for (p, _) in self.window(face, s) {
            share[usize::from(p.view)] += 1.0;
        }
        let total: f32 = share.iter().sum::<f32>().max(1.0);
        share.iter().map(|v| v / total).collect()
    }
}

/// Axes of the cross-section: `o = m × n`, `n`.
pub(super) fn cross_section(frame: &Frame) -> (Vector3<f32>, Vector3<f32>) {
    let n = frame.bisector();
    (frame.tangent.cross(&n), n)
}

/// Where two fitted faces meet in the cross-section, and their normals there.
fn intersect(frame: &Frame, fits: &[Fit; 2]) -> Option<(Vector2<f64>, [Vector2<f64>; 2])> {
    let (o, n) = cross_section(frame);
    let flat = |v: &Vector3<f32>| Vector2::new(f64::from(v.dot(&o)), f64::from(v.dot(&n)));
    let into = frame.into_faces().map(|v| flat(&v));
    let off = frame.faces.map(|v| flat(&v));
    let mut x = Vector2::zeros();
    let mut rows = [Vector2::zeros(); 2];
    for _ in 0..3 {
        let mut miss = Vector2::zeros();
        for k in 0..2 {
            let u = x.dot(&into[k]);
            let f = &fits[k];
            miss[k] = x.dot(&off[k]) - (f.offset + f.slope * u + f.bend * u * u);
            rows[k] = off[k] - into[k] * (f.slope + 2.0 * f.bend * u);
        }
        x -= Matrix2::from_rows(&[rows[0].transpose(), rows[1].transpose()]).try_inverse()? * miss;
    }
    Some((x, [rows[0].try_normalize(1e-9)?, rows[1].try_normalize(1e-9)?]))
}
