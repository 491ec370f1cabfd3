//! The paper's intensity ratio, for its histogram: at a sample of the model's points, since a picture needs no more.

use super::points::even_sample;
use nalgebra::Vector3;
use rayon::prelude::*;
use weldpath_core::seam::{Tensor, gradient};
use weldpath_method::pipeline::Evidence;
use weldpath_method::seam::INDEX_VOXELS;

/// Points in the histogram.
const SAMPLE: usize = 1000;
/// Points of the sample are taken in groups of neighbouring points, which share neighbours and gradients: this many in each.
const CLUMP: usize = 16;

/// `Tr³/Det` of about [`SAMPLE`] points.
pub(super) fn sampled(evidence: &Evidence) -> Vec<f32> {
    let Evidence { voxels, model, index: grid, intensity, .. } = *evidence;
    if intensity.len() != model.len() {
        return Vec::new();
    }
    let radius_mm = INDEX_VOXELS * voxels.edge_mm;
    let search = |slot: usize, found: &mut Vec<(usize, f32)>| {
        found.clear();
        grid.within(&grid.point(slot), radius_mm, |other, d2| {
            found.extend((other != slot).then_some((other, d2)));
        });
    };
    let near = |slot: usize| {
        let mut found = Vec::new();
        search(slot, &mut found);
        found
    };
    let gradient_at = |slot: usize, found: &mut Vec<(usize, f32)>| -> Vector3<f32> {
        search(slot, found);
        let (at, own) = (grid.point(slot), intensity[grid.index(slot)]);
        gradient(found.iter().map(|&(k, _)| (grid.point(k) - at, intensity[grid.index(k)] - own)))
    };
    let ratios = |clump: usize| -> Vec<f32> {
        let own = CLUMP * clump..(CLUMP * (clump + 1)).min(grid.len());
        let around: Vec<_> = own.clone().map(near).collect();
        let mut slots: Vec<usize> = around.iter().flatten().map(|n| n.0).chain(own.clone()).collect();
        slots.sort_unstable();
        slots.dedup();
        let mut found = Vec::new();
        let gradients: Vec<Vector3<f32>> = slots.iter().map(|&slot| gradient_at(slot, &mut found)).collect();
        let at = |slot: usize| slots.binary_search(&slot).ok().and_then(|k| gradients.get(k));
        let ratio = |(slot, near): (usize, &Vec<(usize, f32)>)| {
            let near = near.iter().filter_map(|&(k, d2)| Some((d2, at(k)?)));
            Some(Tensor::smoothed(at(slot)?, near.collect::<Vec<_>>()).ratio())
        };
        own.zip(&around).filter_map(ratio).collect()
    };
    let clumps: Vec<usize> = even_sample(grid.len().div_ceil(CLUMP), SAMPLE / CLUMP).collect();
    clumps.into_par_iter().flat_map_iter(ratios).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use weldpath_method::geometry::cloud::{Merged, PointCloud};
    use weldpath_method::geometry::grid::Grid;
    use weldpath_method::model::downsampling::Voxels;
    use weldpath_method::seam::SurfaceModel;
    use weldpath_method::seam::score::{edges, paper};

    #[test]
    fn ratios_of_a_sample_are_those_of_the_papers_method() {
        let bump = |k: usize| {
            let (x, y) = ((k % 40) as f32, (k / 40) as f32);
            Point3::new(x, y, 0.3 * (0.7 * x).sin() * (0.4 * y).cos())
        };
        let points_mm: Vec<_> = (0..960).map(bump).collect();
        let cloud = PointCloud { points_mm, normals: vec![Vector3::z(); 960], ..PointCloud::default() };
        let toward_camera = vec![Vector3::z(); 960];
        let voxels = Voxels { cloud: cloud.clone(), edge_mm: 1.0, toward_camera, ..Voxels::default() };
        let (merged, model) = (&Merged::default(), &cloud);
        let grid = Grid::new(&cloud.points_mm, 4.0);
        let asymmetries = &edges::asymmetries(&grid, 4.0);
        let surface = SurfaceModel { voxels: &voxels, cloud: model, index: &grid, asymmetries };
        let intensity = &edges::score(&surface).intensity;
        let mut ours = sampled(&Evidence {
            merged,
            raw: &grid,
            voxels: &voxels,
            model,
            index: &grid,
            intensity,
            segmentation: None,
            rejected: &[],
            unwelded: &[],
        });
        let mut theirs: Vec<f32> = paper::tensors(model, 1.0).iter().map(|t| t.ratio()).collect();
        ours.sort_by(f32::total_cmp);
        theirs.sort_by(f32::total_cmp);
        assert_eq!(ours.len(), theirs.len(), "fewer points than the sample: all of them");
        for (a, b) in ours.iter().zip(&theirs) {
            assert!((a - b).abs() <= 1e-2 * b, "{a} {b}");
        }
    }
}
