//! The second cue (ours): a step between two parallel layers, for a plate on a plate whose side nobody saw.
//!
//! Seen from above, or sampled through, a thin plate's edge is no inside corner. It is where an upper layer ends and a
//! lower one goes on. The seam is the foot of that edge; the side face is taken as square to the layers, and the edge is
//! where the density of the upper layer falls to half, which noise along the surface does not move.

use crate::geometry::cloud::{Merged, PointCloud};
use crate::geometry::grid::Grid;
use crate::seam::refine::beside::{Beside, beside, near_path};
use crate::seam::refine::face::{self, Fit, Sample};
use crate::seam::refine::stretch;
use crate::seam::refine::{self, Path, Refined, Section, Station, cross_section};
use crate::seam::trace::chain::Chain;
use crate::seam::trace::corner::Corner;
use nalgebra::{Point3, Vector2, Vector3};
use rayon::prelude::*;

/// Sizes, in voxels.
#[derive(Debug, Clone, Copy)]
pub struct Config {
    /// Radius of the surroundings in which the upper layer must end.
    pub radius: f32,
    /// Half thickness of a layer.
    pub layer: f32,
    /// Least and largest height of a step.
    pub height: (f32, f32),
    /// Width of the strip of the upper layer, and of the lower one, by which the edge and its foot are measured.
    pub strip: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { radius: 6.0, layer: 1.2, height: (2.0, 12.0), strip: 8.0 }
    }
}

/// Least shift of a layer's centre from a point at its edge, as a share of the radius; 0.42 on a straight edge.
const ASYMMETRY: f32 = 0.2;
/// Least room on the lower layer, in heights of the step: less would melt that layer's own edge.
const ROOM_HEIGHTS: f32 = 2.5;
/// Noise, as a share of the step, below which a camera's layers are the stairs of its quantised depth.
const QUANTISED: f32 = 0.02;

/// Corners at the feet of steps in a model whose points are indexed by `grid`.
pub fn corners(model: &PointCloud, grid: &Grid, voxel_mm: f32, config: &Config) -> Vec<Corner> {
    let scene = Scene { grid, normals: &grid.by_slot(&model.normals), voxel_mm, config };
    (0..grid.len()).into_par_iter().filter_map(|slot| scene.step(slot)).collect()
}

struct Scene<'a> {
    grid: &'a Grid,
    /// By slot.
    normals: &'a [Vector3<f32>],
    voxel_mm: f32,
    config: &'a Config,
}

impl Scene<'_> {
    /// The foot of the step beside a point of an upper layer.
    fn step(&self, slot: usize) -> Option<Corner> {
        let v = self.voxel_mm;
        let at = self.grid.point(slot);
        let normal = self.layers_normal(&at, &self.normals[slot])?;
        let out = self.way_out(&at, &normal)?;
        let along = normal.cross(&out);
        let mut edge = 0.0f32;
        self.layer(&at, &normal, self.config.radius * v, |d| {
            if d.dot(&along).abs() < 0.8 * v {
                edge = edge.max(d.dot(&out));
            }
        });
        if edge > 3.0 * v {
            return None;
        }
        let height = self.height(&at, &normal, &out, edge)?;
        let room = at + out * (edge + ROOM_HEIGHTS * height) - normal * height;
        let mut floor = 0;
        self.layer(&room, &normal, 1.5 * v, |_| floor += 1);
        (floor >= 2).then(|| Corner {
            position: at + out * edge - normal * height,
            direction: along,
            faces: [normal, out],
            share: 1.0,
        })
    }

    /// Offsets of the points of the layer through a place.
    fn layer(
        &self,
        at: &Point3<f32>,
        normal: &Vector3<f32>,
        radius_mm: f32,
        mut each: impl FnMut(Vector3<f32>),
    ) {
        self.grid.within(at, radius_mm, |other, _| {
            let d = self.grid.point(other) - at;
            if d.dot(normal).abs() < self.config.layer * self.voxel_mm
                && self.normals[other].dot(normal) > 0.8
            {
                each(d);
            }
        });
    }

    /// Mean normal of the layer: next to its edge the normals of single points lean out.
    fn layers_normal(&self, at: &Point3<f32>, normal: &Vector3<f32>) -> Option<Vector3<f32>> {
        let mut sum = Vector3::zeros();
        let layer = self.config.layer * self.voxel_mm;
        self.grid.within(at, self.config.radius * self.voxel_mm, |other, _| {
            let (d, n) = (self.grid.point(other) - at, self.normals[other]);
            // Steeper than one in two is another face.
            if d.dot(normal).abs() < layer + 0.3 * d.norm() && n.dot(normal) > 0.8 {
                sum += n;
            }
        });
        sum.try_normalize(1e-3)
    }

    /// Unit direction in which the layer ends here.
    fn way_out(&self, at: &Point3<f32>, normal: &Vector3<f32>) -> Option<Vector3<f32>> {
        let radius = self.config.radius * self.voxel_mm;
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        self.layer(at, normal, radius, |d| {
            sum += d;
            count += 1.0;
        });
        let shift = (sum - normal * sum.dot(normal)) / count;
        (count >= 8.0 && shift.norm() > ASYMMETRY * radius).then(|| -shift.normalize())
    }

    /// How far below the next parallel layer beyond the edge lies.
    fn height(&self, at: &Point3<f32>, normal: &Vector3<f32>, out: &Vector3<f32>, edge: f32) -> Option<f32> {
        let v = self.voxel_mm;
        let (least, most) = (self.config.height.0 * v, self.config.height.1 * v);
        let middle = at + out * (edge + 4.0 * v) - normal * (0.5 * most);
        let mut depths = Vec::new();
        self.grid.within(&middle, (0.5 * most).hypot(3.5 * v), |other, _| {
            let d = self.grid.point(other) - at;
            let aside = (d - normal * d.dot(normal)) - out * (edge + 4.0 * v);
            let depth = -d.dot(normal);
            if aside.norm() < 3.0 * v
                && (least..most).contains(&depth)
                && self.normals[other].dot(normal) > 0.9
            {
                depths.push(depth);
            }
        });
        depths.sort_unstable_by(f32::total_cmp);
        // The uppermost layer that is there at all: a few points above it are noise.
        let first = depths.windows(8).find(|w| w[7] - w[0] < 0.7 * v)?[0];
        let layer: Vec<f32> =
            depths.into_iter().filter(|d| (first..first + 2.0 * self.config.layer * v).contains(d)).collect();
        Some(layer.iter().sum::<f32>() / layer.len() as f32)
    }
}

/// Raw points, and whether cameras saw them: the depth of a camera has noise, unless it is quantised.
pub struct Scan<'a> {
    /// All raw points.
    pub merged: &'a Merged,
    /// Their spatial index.
    pub raw: &'a Grid,
    /// Whether they are from cameras, not from a model.
    pub of_cameras: bool,
}

/// A chain of such corners on the raw points.
pub fn refine(
    scan: &Scan,
    chain: &Chain,
    voxel_mm: f32,
    sizes: &refine::Config,
    config: &Config,
) -> Option<Refined> {
    let merged = scan.merged;
    let mut path = Path::new(chain, sizes.step * voxel_mm)?;
    let mut refined = None;
    for _ in 0..sizes.rounds {
        path.extend(2);
        let reach_mm = (config.height.1 + config.strip) * voxel_mm;
        let near = near_path(scan.raw, &path.frames, reach_mm);
        let points = beside(merged, &near, &path.frames, path.closed, path.step_mm, reach_mm);
        let (section, height_mm) = layers(scan, &points, &path, voxel_mm, sizes, config)?;
        let stations: Vec<Option<Station>> = (0..path.frames.len())
            .map(|k| station(&section, &path, k, height_mm, voxel_mm, config))
            .collect();
        let all = 0..stations.len();
        let outcome = stretch::smoothed(&path, &stations, all, &section, voxel_mm, sizes)?;
        path = Path { frames: outcome.frames.clone(), step_mm: outcome.step_mm, closed: path.closed };
        refined = Some(outcome);
    }
    refined
}

/// Distance out of the upper layer's edge, and height over the lower layer.
fn out_and_up(p: &Beside) -> (f32, f32) {
    if p.face == 0 { (p.u, p.h) } else { (p.h, p.u) }
}

/// The points of the lower layer outside, and of the upper one about its edge, and the height between them, mm.
fn layers(
    scan: &Scan,
    points: &[Beside],
    path: &Path,
    voxel_mm: f32,
    sizes: &refine::Config,
    config: &Config,
) -> Option<(Section, f32)> {
    let v = voxel_mm;
    let inside = |p: &&Beside| (-config.strip * v..-v).contains(&out_and_up(p).0);
    let heights = points.iter().filter(inside).map(|p| out_and_up(p).1);
    let mut heights: Vec<f32> = heights.filter(|up| *up > 0.7 * config.height.0 * v).collect();
    if heights.is_empty() {
        return None;
    }
    let height_mm = crate::geometry::statistics::median(&mut heights);
    // No wider than the noise: the side of a plate that was sampled would pass for more of its top.
    let mut misses: Vec<f32> = heights.iter().map(|up| (up - height_mm).abs()).collect();
    let noise_mm = 1.4826 * crate::geometry::statistics::median(&mut misses);
    if scan.of_cameras && noise_mm < QUANTISED * height_mm {
        return None;
    }
    let layer = (3.0 * noise_mm).clamp(0.05 * v, config.layer * v);
    let is_lower = |p: &&Beside| out_and_up(p).1.abs() < layer;
    let floor = |low: f32, high: f32| {
        points.iter().filter(is_lower).filter(|p| (low..high).contains(&out_and_up(p).0)).count()
    };
    let room = (ROOM_HEIGHTS * height_mm).min(config.strip * v);
    if 2 * floor(room - 2.0 * v, room) < floor(v, 3.0 * v) {
        return None;
    }
    let lower = points.iter().filter(is_lower).filter_map(|p| {
        let (out, up) = out_and_up(p);
        let mine = (v..config.strip * v).contains(&out);
        mine.then_some(Beside { face: 0, u: out, h: up, incidence_cos: 1.0, ..*p })
    });
    let upper = points.iter().filter_map(|p| {
        let (out, up) = out_and_up(p);
        let mine =
            (up - height_mm).abs() < layer && (-config.strip * v..0.5 * config.strip * v).contains(&out);
        mine.then_some(Beside { face: 1, u: up, h: out, incidence_cos: 1.0, ..*p })
    });
    let mut layers = [lower.collect::<Vec<_>>(), upper.collect::<Vec<_>>()];
    layers.iter_mut().for_each(|points| points.sort_unstable_by(|a, b| a.s.total_cmp(&b.s)));
    let reach_mm = [config.strip * v, height_mm];
    Some((
        Section::of_layers(layers, path, reach_mm, sizes.half * v, scan.merged.cameras_mm.len()),
        height_mm,
    ))
}

/// The foot of the edge at one station: the lower layer's plane, and where the upper layer ends.
fn station(
    section: &Section,
    path: &Path,
    k: usize,
    height_mm: f32,
    voxel_mm: f32,
    config: &Config,
) -> Option<Station> {
    let s = k as f32 * path.step_mm;
    let strip = f64::from(config.strip * voxel_mm);
    let lower = section.samples(0, s);
    let floor = face::fit(&lower, 0.0, f64::from(section.half_mm), &mut face::Scratch::default())?;
    let upper: Vec<Sample> = section.samples(1, s);
    // Density inside, away from the edge; then the edge that leaves as much of it as there is.
    let sum = |low: f64, high: f64| -> f64 {
        upper.iter().filter(|p| (low..high).contains(&p.h)).map(|p| p.w).sum()
    };
    let inner = 1.5 * f64::from(voxel_mm);
    let density = sum(-strip, -inner) / (strip - inner);
    if upper.len() < 25 || density <= 0.0 {
        return None;
    }
    // Counting noise grows with the margin, which need only be as wide as the points' own noise.
    let margin = (2.0 * floor.sigma).max(0.4 * f64::from(voxel_mm));
    let edge = (0..8).fold(0.0, |edge, _| edge - margin + sum(edge - margin, 0.5 * strip) / density);
    let count = (density * margin).max(1.0);
    let (low, high) = upper.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.d), h.max(p.d)));
    let side = Fit {
        offset: edge,
        sigma: floor.sigma,
        weight: density * strip,
        support: (low, high),
        offset_variance: (margin / count.sqrt() / floor.sigma).powi(2),
        ..Fit::default()
    };
    let frame = &path.frames[k];
    let (o, n) = cross_section(frame);
    let flat = |v: &Vector3<f32>| Vector2::new(f64::from(v.dot(&o)), f64::from(v.dot(&n)));
    let (up, out) = (flat(&frame.faces[0]), flat(&frame.faces[1]));
    let across = out * edge + up * (floor.offset + floor.slope * edge);
    let normals = [(up - out * floor.slope).normalize(), (out + up * floor.slope).normalize()];
    let level = |points: &[Sample], near: &dyn Fn(&Sample) -> bool| {
        points.iter().filter(|p| p.d.abs() < f64::from(path.step_mm) && near(p)).count()
    };
    let present = [
        level(&lower, &|p| p.u < 0.7 * strip),
        level(&upper, &|p| p.h > -0.7 * strip && p.u < 2.0 * f64::from(height_mm)),
    ];
    let view_share = [section.view_share(0, s), section.view_share(1, s)];
    Some(Station { across, normals, fits: [floor, side], present, view_share })
}
