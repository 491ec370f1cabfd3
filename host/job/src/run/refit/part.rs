//! The saved part as patches: its surface about the welds and, where a surface ends, its edges, which face out of it.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::MIN_NORMAL_DOT;
use weldpath_method::geometry::cloud::PointCloud;
use weldpath_method::geometry::grid::Grid;
use weldpath_method::model::reconstruction::spread_over_normals;

/// The model counts this far from the welds, mm: both plates' edges of common parts.
const ABOUT_WELDS_MM: f64 = 40.0;
/// Neighbours of an edge are looked for within this, mm.
const EDGE_REACH_MM: f32 = 4.0;
/// Least distance of their centroid, in reaches, at an edge: a half disc has 0.42, a whole one 0.
const EDGE: f32 = 0.3;
/// Where beyond an edge there is looked for what lies behind it, mm: the middle and radius of a ball.
const BEYOND_MM: f32 = 14.0;
const BEYOND_RADIUS_MM: f32 = 10.0;
/// What lies beyond an edge nearer to its plane than this, mm, is more of the same surface.
const SAME_PLANE_MM: f32 = 1.5;

/// A place on a surface and its normal, or on an edge and the way out of the surface there; base frame.
pub(super) type Patch = (Point3<f64>, Vector3<f64>);

/// The model about the welds.
pub(super) struct Part {
    pub(super) surface: Vec<Patch>,
    pub(super) edges: Vec<Patch>,
    pub(super) centre: Point3<f64>,
    pub(super) welds: Vec<Point3<f64>>,
}

impl Part {
    pub(super) fn new(model: &PointCloud, welds: &[Point3<f64>]) -> Self {
        let local: Vec<Point3<f32>> =
            welds.iter().map(|p| Point3::from((p - model.origin_mm).cast())).collect();
        let grid = Grid::new(&local, ABOUT_WELDS_MM as f32);
        let near = |p: &Point3<f32>| grid.nearest(p, ABOUT_WELDS_MM as f32, |_| true).is_some();
        let whole = with_edges(model);
        let (mut surface, mut edges) = (Vec::new(), Vec::new());
        for k in (0..whole.len()).filter(|&k| near(&whole.points_mm[k])) {
            let patch = (whole.in_base_mm(k), whole.normals[k].cast());
            if k < model.len() { surface.push(patch) } else { edges.push(patch) }
        }
        let welds = welds.iter().step_by(welds.len().div_ceil(200).max(1)).copied().collect();
        let sum: Vector3<f64> = surface.iter().map(|(p, _)| p.coords).sum();
        Self { centre: Point3::from(sum / surface.len().max(1) as f64), surface, edges, welds }
    }
}

/// So many patches, taken in turn from every direction that they face.
pub(super) fn sample(patches: &[Patch], count: usize) -> Vec<Patch> {
    let normals = patches.iter().map(|(_, n)| n.cast());
    spread_over_normals(normals, count).into_iter().map(|(k, _)| patches[k as usize]).collect()
}

/// At most about `count` of the patches, evenly.
pub(super) fn strided(patches: &[Patch], count: usize) -> Vec<Patch> {
    patches.iter().step_by(patches.len().div_ceil(count).max(1)).copied().collect()
}

/// The cloud and, behind its points, its edges once more, with the direction out of the surface as their normal.
pub(super) fn with_edges(cloud: &PointCloud) -> PointCloud {
    let grid = Grid::new(&cloud.points_mm, EDGE_REACH_MM);
    let edge = |k: usize| {
        let (p, n) = (cloud.points_mm[k], cloud.normals[k]);
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        grid.within(&p, EDGE_REACH_MM, |slot, _| {
            if cloud.normals[grid.index(slot)].dot(&n) > MIN_NORMAL_DOT {
                sum += grid.point(slot) - p;
                count += 1.0;
            }
        });
        let centroid = sum / f32::max(count, 1.0);
        let out = -(centroid - n * n.dot(&centroid));
        if count <= 4.0 || out.norm() <= EDGE * EDGE_REACH_MM {
            return None;
        }
        let out = out.normalize();
        is_end(&grid, &p, &n, &out).then_some((p, out))
    };
    let edges: Vec<_> = (0..cloud.len()).into_par_iter().filter_map(edge).collect();
    let mut all = cloud.clone();
    for (p, out) in edges {
        all.points_mm.push(p);
        all.normals.push(out);
    }
    all
}

/// Whether a surface ends at an edge because something else was seen behind it: neither the rim of a picture, beyond which
/// nothing was seen, nor a hole or a shadow, beyond which the surface goes on.
fn is_end(grid: &Grid, p: &Point3<f32>, n: &Vector3<f32>, out: &Vector3<f32>) -> bool {
    let (mut other, mut same) = (false, false);
    grid.within(&(p + out * BEYOND_MM), BEYOND_RADIUS_MM, |slot, _| {
        let on_plane = n.dot(&(grid.point(slot) - p)).abs() < SAME_PLANE_MM;
        same |= on_plane;
        other |= !on_plane;
    });
    other && !same
}
