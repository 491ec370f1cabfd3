//! The second cue (ours): a step between two parallel layers, for a plate on a plate whose side nobody saw.
//!
//! Seen from above, or sampled through, a thin plate's edge is no inside corner. It is where an upper layer ends and a
//! lower one goes on. The seam is the foot of that edge; the side face is taken as square to the layers, and the edge is
//! where the density of the upper layer falls to half, which noise along the surface does not move.

use super::InsideCorner;
use crate::geometry::cloud::PointCloud;
use crate::geometry::grid::Grid;
use crate::geometry::plane::Moments;
use crate::geometry::statistics::median;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Sizes, in voxels. The defaults were chosen on the simulated scans.
#[derive(Debug, Clone, Copy)]
pub struct StepConfig {
    /// Radius of the surroundings in which the upper layer must end.
    pub radius: f32,
    /// Half thickness of a layer.
    pub layer: f32,
    /// Least and largest height of a step.
    pub height: (f32, f32),
    /// Width of the strip of the upper layer, and of the lower one, by which the edge and its foot are measured.
    pub strip: f32,
}

impl Default for StepConfig {
    fn default() -> Self {
        Self { radius: 6.0, layer: 1.2, height: (2.0, 12.0), strip: 8.0 }
    }
}

impl StepConfig {
    /// How far the foot of a step is at most from a point that shows it, voxels: first onto the point's layer, then out to the edge
    /// and down.
    pub(crate) fn reach_voxels(&self) -> f32 {
        self.layer + EDGE_VOXELS.hypot(self.height.1)
    }

    /// The same for layers as even as those of a model: the lower the noise, the thinner the sheet whose edge shows.
    pub(crate) fn for_layers_of(&self, model: &StepModel) -> Self {
        let StepModel { grid, voxel_mm, .. } = model;
        let layers = Layers::of(model, self);
        let every = (grid.len() / SCATTER_SAMPLE).max(1);
        let scatter = |slot| layers.scatter_mm(slot);
        let mut scatter_mm: Vec<f32> =
            (0..grid.len()).into_par_iter().step_by(every).filter_map(scatter).collect();
        if scatter_mm.is_empty() {
            return *self;
        }
        let layer = LAYER_DEVIATIONS * median(&mut scatter_mm) / *voxel_mm;
        let layer = layer.clamp(LEAST_LAYER.min(self.layer), self.layer);
        let least = self.height.0 * layer / self.layer;
        Self { layer, height: (least, self.height.1), ..*self }
    }
}

/// Standard deviations in the half thickness of a layer; the least of it, voxels, since a voxel at an edge holds points of both
/// layers and lies between them; and at so many points it is asked how a layer scatters.
const LAYER_DEVIATIONS: f32 = 3.0;
const LEAST_LAYER: f32 = 0.4;
const SCATTER_SAMPLE: usize = 2000;
/// Surroundings in which that is asked, voxels: wide enough to show the scatter, and flat on a tube.
const SCATTER_VOXELS: f32 = 3.0;
/// A step lower than this, voxels, may be one surface that two views put at two heights: there the lower layer goes on under the
/// upper one, with no less than this share of its points.
const GHOST_HEIGHT_VOXELS: f32 = 2.0;
const GHOST_SHARE: f32 = 0.5;

/// Least shift of a layer's centre from a point at its edge, as a share of the radius; 0.42 on a straight edge.
const ASYMMETRY: f32 = 0.2;
/// The same before a point was moved onto its thin layer, which is dear: its noise may have hidden half of the shift.
const LIKELY_ASYMMETRY: f32 = 0.5 * ASYMMETRY;
/// Least room on the lower layer, in heights of the step: less would melt that layer's own edge.
pub(crate) const ROOM_HEIGHTS: f32 = 2.5;
// The rest was chosen on the simulated scans.

/// Cells in which the model is looked up, voxels.
const CELL_VOXELS: f32 = 4.0;
/// Cosine of normals of one layer, and of the next one below it.
const SAME_LAYER: f32 = 0.8;
const PARALLEL: f32 = 0.9;
/// Slope against a layer up to which a point is of it: steeper is another face.
const STEEP: f32 = 0.3;
/// Fewer points make no layer; shorter sums of normals have no direction.
const LEAST_POINTS: f32 = 8.0;
const LEAST_NORMAL: f32 = 1e-3;
/// The edge is sought in a strip of this half width across it, and is no farther from a point beside it, voxels.
const EDGE_STRIP_VOXELS: f32 = 0.8;
const EDGE_VOXELS: f32 = 3.0;
/// Room on the lower layer: this many points within this radius, voxels.
const ROOM_VOXELS: f32 = 1.5;
const ROOM_POINTS: usize = 2;
/// The lower layer is sought about an axis this far beyond the edge, within this radius of it, which a ball holds whose
/// radius exceeds it by the second, voxels.
const BEYOND_VOXELS: f32 = 4.0;
const BESIDE_VOXELS: f32 = 3.0;
const BALL_VOXELS: f32 = 3.5;
/// So many points within this range of depths, voxels, are a layer; a few above it are noise.
const DENSE_POINTS: usize = 8;
const DENSE_VOXELS: f32 = 0.7;

/// A model in which steps are looked for.
pub struct StepModel {
    grid: Grid,
    /// By slot.
    normals: Vec<Vector3<f32>>,
    voxel_mm: f32,
}

impl StepModel {
    /// Of a cloud in voxels of this size.
    pub fn new(cloud: &PointCloud, voxel_mm: f32) -> Self {
        let grid = Grid::new(&cloud.points_mm, CELL_VOXELS * voxel_mm);
        let normals = grid.by_slot(&cloud.normals);
        Self { grid, normals, voxel_mm }
    }
}

/// Corners at the feet of the steps in a model.
pub fn corners(model: &StepModel, config: &StepConfig) -> Vec<InsideCorner> {
    corners_beside(model, config, |_| true)
}

/// The same of the points that are `asked`.
pub(crate) fn corners_beside(
    model: &StepModel,
    config: &StepConfig,
    asked: impl Fn(&Point3<f32>) -> bool + Sync,
) -> Vec<InsideCorner> {
    let (grid, layers) = (&model.grid, Layers::of(model, config));
    let slots = (0..grid.len()).into_par_iter().filter(|&slot| asked(&grid.point(slot)));
    slots.filter_map(|slot| layers.step(slot)).collect()
}

/// The layers of a model, asked for where they end.
struct Layers<'a> {
    grid: &'a Grid,
    /// By slot.
    normals: &'a [Vector3<f32>],
    voxel_mm: f32,
    config: &'a StepConfig,
}

impl<'a> Layers<'a> {
    fn of(model: &'a StepModel, config: &'a StepConfig) -> Self {
        let StepModel { grid, normals, voxel_mm } = model;
        Self { grid, normals, voxel_mm: *voxel_mm, config }
    }

    /// The foot of the step beside a point of an upper layer.
    fn step(&self, slot: usize) -> Option<InsideCorner> {
        let v = self.voxel_mm;
        let mut at = self.grid.point(slot);
        let mut normal = self.layers_normal(&at, &self.normals[slot])?;
        if self.is_thin() {
            self.way_out(&at, &normal, LIKELY_ASYMMETRY)?;
            at = self.on_layer(at, &mut normal)?;
        }
        let out = self.way_out(&at, &normal, ASYMMETRY)?;
        let along = normal.cross(&out);
        let mut edge = 0.0f32;
        self.layer(&at, &normal, self.config.radius * v, |d| {
            if d.dot(&along).abs() < EDGE_STRIP_VOXELS * v {
                edge = edge.max(d.dot(&out));
            }
        });
        if edge > EDGE_VOXELS * v {
            return None;
        }
        let height = self.height(&at, &normal, &out, edge)?;
        let room = at + out * (edge + ROOM_HEIGHTS * height) - normal * height;
        let mut floor = 0;
        self.layer(&room, &normal, ROOM_VOXELS * v, |_| floor += 1);
        if height < GHOST_HEIGHT_VOXELS * v {
            let under = at + out * (edge - ROOM_HEIGHTS * height.max(ROOM_VOXELS * v)) - normal * height;
            let mut hidden = 0;
            self.layer(&under, &normal, ROOM_VOXELS * v, |_| hidden += 1);
            if hidden as f32 >= GHOST_SHARE * floor as f32 {
                return None;
            }
        }
        (floor >= ROOM_POINTS).then(|| InsideCorner {
            position: at + out * edge - normal * height,
            direction: along,
            faces: [normal, out],
            share: 1.0,
        })
    }

    /// Standard deviation of the layer through a point, about its plane.
    fn scatter_mm(&self, slot: usize) -> Option<f32> {
        let (at, normal) = (self.grid.point(slot), &self.normals[slot]);
        let mut moments = Moments::default();
        self.layer(&at, normal, SCATTER_VOXELS * self.voxel_mm, |d| moments.add(d));
        (moments.count >= LEAST_POINTS).then(|| moments.plane().variance_mm2.max(0.0).sqrt())
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
                && self.normals[other].dot(normal) > SAME_LAYER
            {
                each(d);
            }
        });
    }

    /// Whether the layers are so near to each other that their points and normals have to be told apart.
    fn is_thin(&self) -> bool {
        self.config.height.0 < GHOST_HEIGHT_VOXELS
    }

    /// Mean normal of the layer: next to its edge the normals of single points lean out.
    fn layers_normal(&self, at: &Point3<f32>, normal: &Vector3<f32>) -> Option<Vector3<f32>> {
        let mut sum = Vector3::zeros();
        self.around(at, normal, STEEP, |n| sum += n);
        sum.try_normalize(LEAST_NORMAL)
    }

    /// A point moved onto its thin layer, whose normal is set: a point that is low by its noise would take points of the next layer
    /// for its own, and next to a step a third of the normals around lean out, which moves a mean and not a median.
    fn on_layer(&self, at: Point3<f32>, normal: &mut Vector3<f32>) -> Option<Point3<f32>> {
        let median_normal = |at: &Point3<f32>, normal: &Vector3<f32>, slope: f32| {
            let mut around = [const { Vec::new() }; 3];
            self.around(at, normal, slope, |n| {
                around.iter_mut().zip(n.iter()).for_each(|(component, value)| component.push(*value));
            });
            Vector3::from(around.map(|mut component| median(&mut component))).try_normalize(LEAST_NORMAL)
        };
        *normal = median_normal(&at, normal, STEEP)?;
        let (mut sum, mut count) = (0.0, 0.0);
        self.layer(&at, normal, SCATTER_VOXELS * self.voxel_mm, |d| {
            sum += d.dot(normal);
            count += 1.0;
        });
        let at = at + *normal * (sum / f32::max(count, 1.0));
        *normal = median_normal(&at, normal, 0.0)?;
        Some(at)
    }

    /// Normals about a place, of the layer and of what rises from it by no more than this slope.
    fn around(
        &self,
        at: &Point3<f32>,
        normal: &Vector3<f32>,
        slope: f32,
        mut each: impl FnMut(&Vector3<f32>),
    ) {
        let layer = self.config.layer * self.voxel_mm;
        self.grid.within(at, self.config.radius * self.voxel_mm, |other, _| {
            let (d, n) = (self.grid.point(other) - at, self.normals[other]);
            if d.dot(normal).abs() < layer + slope * d.norm() && n.dot(normal) > SAME_LAYER {
                each(&n);
            }
        });
    }

    /// Unit direction in which the layer ends here, if its centre is off by this share of the radius.
    fn way_out(&self, at: &Point3<f32>, normal: &Vector3<f32>, asymmetry: f32) -> Option<Vector3<f32>> {
        let radius = self.config.radius * self.voxel_mm;
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        self.layer(at, normal, radius, |d| {
            sum += d;
            count += 1.0;
        });
        let shift = (sum - normal * sum.dot(normal)) / count;
        (count >= LEAST_POINTS && shift.norm() > asymmetry * radius).then(|| -shift.normalize())
    }

    /// How far below the next parallel layer beyond the edge lies.
    fn height(&self, at: &Point3<f32>, normal: &Vector3<f32>, out: &Vector3<f32>, edge: f32) -> Option<f32> {
        let v = self.voxel_mm;
        let (least, most) = (self.config.height.0 * v, self.config.height.1 * v);
        let middle = at + out * (edge + BEYOND_VOXELS * v) - normal * (0.5 * most);
        let mut depths = Vec::new();
        self.grid.within(&middle, (0.5 * most).hypot(BALL_VOXELS * v), |other, _| {
            let d = self.grid.point(other) - at;
            let aside = (d - normal * d.dot(normal)) - out * (edge + BEYOND_VOXELS * v);
            let depth = -d.dot(normal);
            if aside.norm() < BESIDE_VOXELS * v
                && (least..most).contains(&depth)
                && self.normals[other].dot(normal) > PARALLEL
            {
                depths.push(depth);
            }
        });
        depths.sort_unstable_by(f32::total_cmp);
        // The uppermost layer that is there at all: a few points above it are noise.
        let first = depths.windows(DENSE_POINTS).find(|w| w[DENSE_POINTS - 1] - w[0] < DENSE_VOXELS * v)?[0];
        let layer: Vec<f32> =
            depths.into_iter().filter(|d| (first..first + 2.0 * self.config.layer * v).contains(d)).collect();
        Some(layer.iter().sum::<f32>() / layer.len() as f32)
    }
}
