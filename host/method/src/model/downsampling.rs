//! Voxel grid (paper II-D, text after eq. (10)): even density after the views are merged.
//!
//! Exact centroids. Voxels with few points are dropped, which removes flying pixels and outliers.

use crate::geometry::cloud::{Merged, PointCloud};
use crate::geometry::grid::Grid;
use crate::geometry::statistics::median;
use crate::model::denoising::BilateralConfig;
use crate::model::normals::cells::{Cells, Sums};
use crate::model::normals::{Patches, pointwise};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// How the voxel grid is laid: the larger of two lengths.
#[derive(Debug, Clone, Copy)]
pub struct VoxelConfig {
    /// Edge of a voxel in mean spacings of a view; the paper's "multiple of the average distance".
    pub spacings: f32,
    /// Edge of a voxel that resolves the plate edges and bevels of arc welding, mm, if that is more.
    pub feature_mm: f32,
    /// The same on small work, as a share of its extent.
    pub share_of_extent: f32,
}

impl Default for VoxelConfig {
    fn default() -> Self {
        Self { spacings: 1.3, feature_mm: 1.2, share_of_extent: 1.0 / 120.0 }
    }
}

/// Which voxels are kept: those that hold enough points to be no flying pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Occupancy {
    /// Points of a voxel that is kept whatever surrounds it.
    pub least: u32,
    /// Points of a voxel and its neighbours on a face that few views saw, or that they saw at a slant. It is known by its even
    /// spread: a voxel is kept, too, that holds what its neighbours do.
    pub least_around: f32,
}

impl Occupancy {
    /// Every voxel that holds so many points, and no other.
    pub fn of(least: u32) -> Self {
        Self { least, least_around: f32::INFINITY }
    }
}

/// Sizes that follow from the data.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Edge of a voxel, mm.
    pub edge_mm: f32,
    /// Points that a voxel must hold.
    pub least: u32,
    /// Mean spacing of a view's points, mm.
    pub spacing_mm: f32,
    /// Noise of the points, mm.
    pub noise_mm: f32,
    /// Whether cameras looked from several sides, so that a face that one of them saw is thin beside others.
    from_sides: bool,
    /// Which of the lengths decided `edge_mm`.
    pub how: &'static str,
}

impl Scale {
    /// Derives the sizes from the views' patches and the extent of the cloud.
    pub fn of(merged: &Merged, patches: &[Patches], config: &VoxelConfig) -> Self {
        let middle = |f: fn(&Patches) -> f32| median(&mut patches.iter().map(f).collect::<Vec<_>>());
        let (spacing_mm, noise_mm) = (middle(|p| p.spacing_mm), middle(|p| p.noise_mm));
        let small_mm = config.share_of_extent * extent_mm(merged);
        let sizes = [
            (config.spacings * spacing_mm, "1.3 x mean spacing"),
            if small_mm < config.feature_mm {
                (small_mm, "extent / 120")
            } else {
                (config.feature_mm, "what resolves plate edges and bevels")
            },
        ];
        let (edge_mm, how) = sizes.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((1.0, "fixed"));
        let edge_mm = edge_mm.max(1e-3);
        // A voxel of a surface that one view saw holds about this many points. Of a cloud that was merged or thinned elsewhere
        // they lie in no rows, and the nearest says little of how many there are: they are counted.
        let usual = if merged.cameras_unknown {
            merged.points_mm.len() as f32 / centroids(&merged.points_mm, edge_mm).len().max(1) as f32
        } else {
            (edge_mm / spacing_mm.max(LEAST_SPACING_MM)).powi(2) * (merged.cameras_mm.len() as f32).sqrt()
        };
        let least = if usual > 4.5 {
            3
        } else if usual > 3.0 {
            2
        } else {
            1
        };
        Self { edge_mm, least, spacing_mm, noise_mm, from_sides: is_from_sides(merged), how }
    }

    /// Which voxels of this size are kept.
    pub fn occupancy(&self) -> Occupancy {
        let of_one_view = (self.edge_mm / self.spacing_mm.max(LEAST_SPACING_MM)).powi(2);
        let least_around = if self.from_sides {
            LEAST_AROUND.max(CROSSED * AT_A_SLANT * of_one_view)
        } else if of_one_view < THIN_POINTS {
            LEAST_AROUND
        } else {
            f32::INFINITY
        };
        Occupancy { least: self.least, least_around }
    }

    /// The same cloud in voxels `factor` times as large.
    pub(crate) fn coarser(&self, factor: f32) -> Self {
        Self { edge_mm: self.edge_mm * factor, ..*self }
    }

    /// Widths of the bilateral filter for these voxels.
    pub fn bilateral(&self) -> BilateralConfig {
        BilateralConfig {
            radius_mm: RADIUS_VOXELS * self.edge_mm,
            distance_mm: DISTANCE_VOXELS * self.edge_mm,
            height_mm: (HEIGHT_NOISES * self.noise_mm).max(LEAST_HEIGHT_VOXELS * self.edge_mm),
        }
    }
}

/// Points of one view in a voxel up to which faces of a merged cloud, or of a single view, are judged by their even spread, too.
/// Pixels lie in rows and columns: with fewer, less than a quarter of the voxels of a face that is looked at straight hold two by two.
const THIN_POINTS: f32 = 2.25;
/// Voxels of those about one that a plane crosses, at least; and the least cosine between the normal of such a face and the way to its
/// cameras, and so the share of points that a view puts on it. What flies between near and far lies along the rays.
const CROSSED: f32 = 9.0;
const AT_A_SLANT: f32 = 0.3;
/// Cosine between the ways to cameras that look from several sides, 45 degrees: from one side all see the same faces.
const ONE_SIDE: f32 = 0.7;
/// A spacing this small is none to divide by, mm.
const LEAST_SPACING_MM: f32 = 1e-6;
/// Share of the points of its fullest neighbour that a voxel of one surface holds: of the one or two points that a voxel
/// of a thin surface expects, half is the least that is not none, and what flies off a dense surface is less.
const EVEN_SHARE: f32 = 0.5;
/// Points in a voxel and its 26 neighbours, of which a plane crosses nine or more: one in every second of these. What one
/// view sees at 60 degrees to the normal is as thin, and flying pixels, strewn along rays, are thinner.
const LEAST_AROUND: f32 = 5.0;

/// Neighbourhoods reach this far, voxels, and a wall that is thinner has both its sides in one. So many points of the other side,
/// whose normals have at most this cosine with that of a point, are no noise.
const BACK_VOXELS: f32 = 4.0;
const LEAST_BACKS: usize = 4;
const OPPOSITE: f32 = -0.5;

/// Radius of the bilateral filter, and deviation of its weight by distance, voxels. Chosen on the simulated scans; the paper
/// gives none.
pub(crate) const RADIUS_VOXELS: f32 = 3.0;
/// See [`RADIUS_VOXELS`].
pub(crate) const DISTANCE_VOXELS: f32 = 1.5;
/// Deviation of its weight by height, in deviations of the points' noise.
pub(crate) const HEIGHT_NOISES: f32 = 1.7;
/// The least of it, voxels.
const LEAST_HEIGHT_VOXELS: f32 = 0.05;

/// Diagonal of the box that holds the middle four fifths of the points on each axis, mm: free of outliers.
fn extent_mm(merged: &Merged) -> f32 {
    let step = (merged.points_mm.len() / 20_000).max(1);
    let span = |axis: usize| {
        let mut v: Vec<f32> = merged.points_mm.iter().step_by(step).map(|p| p[axis]).collect();
        v.sort_unstable_by(f32::total_cmp);
        let cut = v.len() / 10;
        v.get(v.len().saturating_sub(1 + cut)).unwrap_or(&0.0) - v.get(cut).unwrap_or(&0.0)
    };
    Vector3::new(span(0), span(1), span(2)).norm()
}

/// Whether cameras are known to have looked at the middle of a cloud, two of them from different sides.
fn is_from_sides(merged: &Merged) -> bool {
    // Positions are about the middle of the cloud.
    let ways: Vec<_> = merged.cameras_mm.iter().filter_map(|at| at.coords.try_normalize(1.0)).collect();
    let apart = |k: usize| ways[..k].iter().any(|other| other.dot(&ways[k]) < ONE_SIDE);
    !merged.cameras_unknown && (1..ways.len()).any(apart)
}

/// A thinned cloud.
#[derive(Debug, Clone, Default)]
pub struct Voxels {
    /// One point per voxel, with the normal of its surroundings.
    pub cloud: PointCloud,
    /// Points in each voxel.
    pub count: Vec<f32>,
    /// Direction from each point to the cameras that saw it.
    pub toward_camera: Vec<Vector3<f32>>,
    /// View that most of each voxel's points are of.
    pub view: Vec<u16>,
    /// Edge of a voxel, mm.
    pub edge_mm: f32,
}

impl Voxels {
    /// Takes normals out of the material where no camera tells the sides: they are seen from where they point.
    pub fn turn(&mut self, normals: Vec<Vector3<f32>>) {
        self.toward_camera.clone_from(&normals);
        self.cloud.normals = normals;
    }

    /// Joins voxels of the same size about the same origin.
    pub fn append(&mut self, mut other: Self) {
        self.cloud.append(other.cloud);
        self.count.append(&mut other.count);
        self.toward_camera.append(&mut other.toward_camera);
        self.view.append(&mut other.view);
    }

    /// Which voxels of fewer than `least` points lie along the rays, or on the far side of a wall that is thinner than a neighbourhood
    /// and better seen on its near side: in the neighbourhoods of both they would pass for its scatter.
    fn doubtful(&self, least: f32) -> Vec<bool> {
        let is_thin = |k: usize| self.count[k] < least;
        let dense: Vec<usize> = (0..self.cloud.len()).filter(|&k| !is_thin(k)).collect();
        let places: Vec<Point3<f32>> = dense.iter().map(|&k| self.cloud.points_mm[k]).collect();
        let reach_mm = BACK_VOXELS * self.edge_mm;
        let grid = Grid::new(&places, reach_mm);
        let is_doubtful = |k: usize| {
            if !is_thin(k) {
                return false;
            }
            let (place, normal) = (self.cloud.points_mm[k], self.cloud.normals[k]);
            if normal.dot(&self.toward_camera[k]) < AT_A_SLANT {
                return true;
            }
            let mut behind = 0;
            grid.within(&place, reach_mm, |slot, _| {
                let faces_away = self.cloud.normals[dense[grid.index(slot)]].dot(&normal) < OPPOSITE;
                let is_behind = normal.dot(&(grid.point(slot) - place)) < 0.0;
                behind += usize::from(faces_away && is_behind);
            });
            behind >= LEAST_BACKS
        };
        (0..self.cloud.len()).into_par_iter().map(is_doubtful).collect()
    }

    /// Those that are kept, by their index.
    fn retain(&mut self, is_kept: impl Fn(usize) -> bool) {
        fn retain<T: Copy>(all: &mut Vec<T>, is_kept: &impl Fn(usize) -> bool) {
            *all = all.iter().enumerate().filter(|(k, _)| is_kept(*k)).map(|(_, one)| *one).collect();
        }
        retain(&mut self.cloud.points_mm, &is_kept);
        retain(&mut self.cloud.normals, &is_kept);
        retain(&mut self.count, &is_kept);
        retain(&mut self.toward_camera, &is_kept);
        retain(&mut self.view, &is_kept);
    }

    /// The first `count` of them.
    pub fn first(&self, count: usize) -> Self {
        let mut cloud = self.cloud.clone();
        cloud.split_off(count);
        let count = count.min(self.count.len());
        Self {
            cloud,
            count: self.count[..count].to_vec(),
            toward_camera: self.toward_camera[..count].to_vec(),
            view: self.view[..count].to_vec(),
            edge_mm: self.edge_mm,
        }
    }

    /// Takes as each point's normal that of its neighbours within `radius_mm`, as the paper does, toward its cameras.
    pub(crate) fn fit_around_points(&mut self, radius_mm: f32) {
        let grid = Grid::new(&self.cloud.points_mm, radius_mm);
        let normals = grid.by_point(&pointwise::within(&grid, radius_mm));
        let faced = normals.iter().zip(&self.toward_camera).map(|(normal, toward)| facing(*normal, toward));
        self.cloud.normals = faced.collect();
    }
}

/// Centroids of the occupied voxels of finite `points`, in the order of the voxels along x, then y, then z: where
/// [`voxel_grid`] puts its points.
///
/// Voxels have an edge of `edge_mm`, or more where their table would outgrow the points.
pub fn centroids(points: &[Point3<f32>], edge_mm: f32) -> Vec<Point3<f32>> {
    let cells = Cells::new(points, edge_mm);
    (0..cells.len()).map(|k| cells.centroid(k)).collect()
}

/// Thins a cloud to one point per voxel of `edge_mm` that is kept.
pub fn voxel_grid(merged: &Merged, edge_mm: f32, occupancy: Occupancy) -> Voxels {
    let cells = Cells::new(&merged.points_mm, edge_mm);
    let given = given_normals(merged, &cells);
    let kept = kept(&cells, occupancy);
    let points_mm: Vec<Point3<f32>> = kept.par_iter().map(|&k| cells.centroid(k)).collect();
    let sums = cells.sums();
    let sights = sights(merged, &cells, &kept, &points_mm);
    let normals = if given.is_empty() || merged.normals_estimated {
        let found = kept.par_chunks(2).map(|two| {
            let [one, other] = [two[0], two[two.len() - 1]].map(|k| cells.window(k, &sums, 1));
            Sums::scatter([&one, &other]).map(|fit| fit.normal())
        });
        let mut normals = found.collect::<Vec<_>>().into_flattened();
        normals.truncate(kept.len());
        if given.is_empty() {
            normals.iter_mut().zip(&sights).for_each(|(n, seen)| *n = facing(*n, &seen.toward));
        } else {
            normals.iter_mut().zip(&kept).for_each(|(n, &k)| *n = facing(*n, &given[k]));
        }
        normals
    } else {
        kept.iter().map(|&k| given[k]).collect()
    };
    let mut voxels = Voxels {
        cloud: PointCloud { origin_mm: merged.origin_mm, points_mm, normals },
        count: kept.iter().map(|&k| cells.moments[k].count).collect(),
        toward_camera: sights.iter().map(|seen| seen.toward).collect(),
        view: sights.iter().map(|seen| seen.most.0).collect(),
        edge_mm: cells.cell_mm(),
    };
    if occupancy.least > 1 && is_from_sides(merged) {
        let doubtful = voxels.doubtful(occupancy.least as f32);
        voxels.retain(|k| !doubtful[k]);
    }
    voxels
}

/// The voxels that are kept.
fn kept(cells: &Cells, occupancy: Occupancy) -> Vec<usize> {
    let least = occupancy.least as f32;
    let holds = |k: usize| cells.moments[k].count;
    let is_kept = |&k: &usize| {
        if holds(k) >= least {
            return true;
        }
        if occupancy.least_around.is_infinite() {
            return false;
        }
        let (mut sum, mut most) = (0.0, 0.0f32);
        cells.for_each_around(k, 1, |other| {
            sum += holds(other);
            most = most.max(holds(other));
        });
        sum >= occupancy.least_around && holds(k) >= EVEN_SHARE * most
    };
    (0..cells.len()).into_par_iter().filter(is_kept).collect()
}

fn facing(normal: Vector3<f32>, toward: &Vector3<f32>) -> Vector3<f32> {
    if normal.dot(toward) < 0.0 { -normal } else { normal }
}

fn direction(sum: &Vector3<f32>) -> Vector3<f32> {
    sum.try_normalize(1e-6).unwrap_or_else(Vector3::z)
}

/// Mean of the given normals of each voxel's points; empty if none are given.
fn given_normals(merged: &Merged, cells: &Cells) -> Vec<Vector3<f32>> {
    if merged.normals.is_empty() {
        return Vec::new();
    }
    let mut sums = vec![Vector3::zeros(); cells.len()];
    cells.of_point.iter().zip(&merged.normals).for_each(|(&k, normal)| sums[k as usize] += normal);
    sums.iter().map(direction).collect()
}

/// From where a voxel was seen.
#[derive(Debug, Clone, Copy, Default)]
struct VoxelView {
    /// Directions to the cameras of its points: their sum, at last their mean.
    toward: Vector3<f32>,
    /// The view whose points are being counted.
    latest: (u16, u32),
    /// The view that most points are of.
    most: (u16, u32),
}

impl VoxelView {
    fn add(&mut self, view: u16, place: &Point3<f32>, cameras_mm: &[Point3<f32>]) {
        if self.latest.0 != view {
            self.end(place, cameras_mm);
            self.latest = (view, 0);
        }
        self.latest.1 += 1;
    }

    /// Adds the points of the latest view.
    fn end(&mut self, place: &Point3<f32>, cameras_mm: &[Point3<f32>]) {
        let (view, count) = self.latest;
        if count > 0 {
            self.toward += (cameras_mm[usize::from(view)] - place).normalize() * count as f32;
        }
        if count > self.most.1 {
            self.most = self.latest;
        }
    }
}

/// From where each of the `kept` voxels, whose points are at `places`, was seen.
///
/// Points come view by view, so a voxel's are counted until one of another view comes: a direction a view, not a point.
fn sights(merged: &Merged, cells: &Cells, kept: &[usize], places: &[Point3<f32>]) -> Vec<VoxelView> {
    let mut at = vec![u32::MAX; cells.len()];
    kept.iter().zip(0..).for_each(|(&k, own)| at[k] = own);
    let cameras_mm = &merged.cameras_mm;
    let of_share = |share: usize| {
        let cells_of = |share: usize| (share * cells.shares.cells).min(cells.len());
        let of = |share: usize| kept.partition_point(|k| *k < cells_of(share));
        let (first, places) = (of(share), &places[of(share)..of(share + 1)]);
        let mut sights = vec![VoxelView::default(); places.len()];
        cells.shares.visit(share, |i| {
            let k = at[cells.of_point[i] as usize].wrapping_sub(first as u32) as usize;
            if let (Some(sight), Some(place)) = (sights.get_mut(k), places.get(k)) {
                sight.add(merged.view[i], place, cameras_mm);
            }
        });
        for (sight, place) in sights.iter_mut().zip(places) {
            sight.end(place, cameras_mm);
            sight.toward = direction(&sight.toward);
        }
        sights
    };
    let shares = cells.len().div_ceil(cells.shares.cells);
    (0..shares).into_par_iter().flat_map_iter(of_share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_tells_which_view_saw_most_of_it_and_where_the_cameras_are() {
        // Three points of the first view, two of the second and two of the third, all in one voxel.
        let view = vec![0, 0, 0, 1, 1, 2, 2];
        let cameras_mm = [[0.0, 0.0, 100.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0]].map(Point3::from).to_vec();
        let merged = Merged { points_mm: vec![Point3::origin(); 7], view, cameras_mm, ..Merged::default() };
        let voxels = voxel_grid(&merged, 1.0, Occupancy::of(1));
        assert_eq!(voxels.view, [0]);
        assert!((voxels.toward_camera[0] - Vector3::new(2.0, 2.0, 3.0).normalize()).norm() < 1e-6);
    }

    #[test]
    fn a_centroid_is_the_mean_of_its_voxel_and_no_other() {
        // Voxels are laid from the lowest corner, which is the first point.
        let near = |x: f32, y: f32| [[0.0, 0.0], [0.5, 0.25], [0.25, 0.5]].map(|[u, v]| [x + u, y + v, 7.0]);
        let voxels = [near(0.0, 0.0), near(2.0, 0.0), near(1.0, 3.0)];
        let points: Vec<Point3<f32>> = voxels.into_iter().rev().flatten().map(Point3::from).collect();
        let expected = [[0.25, 0.25, 7.0], [2.25, 0.25, 7.0], [1.25, 3.25, 7.0]].map(Point3::from);
        let found = centroids(&points, 1.0);
        assert_eq!(found.len(), 3);
        assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).norm() < 1e-6), "{found:?}");
        assert!(centroids(&[], 1.0).is_empty());
    }

    #[test]
    fn a_thin_surface_is_kept_and_what_flies_off_a_dense_one_is_not() {
        // A point to a voxel on the left, four on the right, and single ones 3 and 8 mm above the middle of each.
        let (mut thin, mut dense) = (Vec::new(), Vec::new());
        for k in 0..100u8 {
            let (x, y) = (f32::from(k % 10) + 0.5, f32::from(k / 10) + 0.5);
            thin.push(Point3::new(x, y, 0.5));
            let quarters = [[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]];
            dense.extend(quarters.map(|[u, v]| Point3::new(20.0 + x + u, y + v, 0.5)));
        }
        let strays = [[5.5, 5.5, 3.5], [5.5, 5.5, 8.5], [25.5, 5.5, 1.5], [25.5, 5.5, 8.5]].map(Point3::from);
        let points_mm = [vec![Point3::origin()], thin, dense, strays.to_vec()].concat();
        let merged = Merged {
            view: vec![0; points_mm.len()],
            cameras_mm: vec![Point3::new(0.0, 0.0, 300.0)],
            points_mm,
            ..Merged::default()
        };
        let kept = |occupancy| {
            let voxels = voxel_grid(&merged, 1.0, occupancy).cloud.points_mm;
            let on =
                |from: f32| voxels.iter().filter(|p| p.x > from && p.x < from + 15.0 && p.z < 1.0).count();
            (on(0.0), on(15.0), voxels.iter().filter(|p| p.z > 1.0).count())
        };
        assert_eq!(kept(Occupancy::of(3)), (0, 100, 0));
        let (thin, dense, strays) = kept(Occupancy { least: 3, least_around: LEAST_AROUND });
        // Three corners of the thin surface hold four points with their neighbours, which is too few; the fourth has the origin.
        assert_eq!((thin, dense, strays), (97, 100, 0));
    }
}
