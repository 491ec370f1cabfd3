//! What the page shows of a run beyond its plan: raw points, the work of the filter, edge scores, spacing.
//!
//! Clouds are thinned to an even sample here, so that nothing large is kept.

use super::histogram::Histogram;
use super::points::{Frame, Sample, border_number, even_sample, surface_number};
use super::ratio;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use weldpath_core::seam::RatioThreshold;
use weldpath_method::geometry::cloud::{Merged, PointCloud};
use weldpath_method::geometry::grid::Grid;
use weldpath_method::pipeline::Evidence;
use weldpath_method::seam::segmentation::{SeenSurface, Segmentation};
use weldpath_method::seam::{SurfaceModel, Unwelded};

/// Most points of the model and of the raw scan in the page.
const MODEL_POINTS: usize = 300_000;
const RAW_POINTS: usize = 100_000;
/// Distances to the nearest neighbour in the histogram of the spacing.
const SPACING_SAMPLE: usize = 4000;
/// A raw point takes normal and intensity from the nearest point of the model within this distance, in voxels.
const NEAR_VOXELS: f32 = 3.0;
/// The frame of the points reaches beyond the model by this share of its diagonal.
const MARGIN: f32 = 0.1;
/// A camera farther away than this is not drawn: nobody told us where it stood.
const FARTHEST_CAMERA_MM: f32 = 2e4;
/// Largest ratio in its histogram.
const RATIO_HIGH: f64 = 120.0;

/// What the page shows of a run beyond its plan.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Recording {
    pub(super) clouds: Option<Clouds>,
    /// Positions of the cameras, mm, base frame; empty if they are unknown.
    pub(super) cameras_mm: Vec<Point3<f64>>,
    /// What looked like a seam and is none that could be welded, in words.
    pub(super) rejected: Vec<String>,
    /// Inside corners that are seen and are no seams.
    pub(super) unwelded: Vec<Unwelded>,
    /// What surfaces the model shows, by their numbers.
    pub(super) surfaces: Vec<SeenSurface>,
    pub(super) intensity: Histogram,
    pub(super) ratio: Histogram,
    pub(super) spacing_mm: Histogram,
}

/// Thinned clouds, and of how many points they are a sample.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Clouds {
    pub(super) frame: Frame,
    pub(super) model: Vec<Sample>,
    pub(super) model_of: usize,
    pub(super) raw: Vec<Sample>,
    pub(super) raw_of: usize,
}

impl Clouds {
    /// The sample of the model.
    pub(super) fn model(&self) -> PointCloud {
        PointCloud {
            origin_mm: self.frame.origin_mm,
            points_mm: self.model.iter().map(|s| s.position_mm).collect(),
            normals: self.model.iter().map(|s| s.normal).collect(),
        }
    }
}

impl Recording {
    /// Keeps a sample of what there is to see.
    pub fn of(evidence: &Evidence) -> Self {
        let Evidence { merged, raw: index, voxels, model, intensity, .. } = *evidence;
        let surface = SurfaceModel { voxels, cloud: model, index: evidence.index, asymmetries: &[] };
        let anew = evidence.segmentation.is_none().then(|| Segmentation::of(&surface));
        let segmentation = evidence.segmentation.or(anew.as_ref());
        let places = segmentation.map(|found| found.places(&surface, merged, intensity)).unwrap_or_default();
        let frame = Frame::around(model.origin_mm, &model.points_mm, MARGIN);
        let raw_of = merged.points_mm.len();
        let mut raw_picks: Vec<usize> = even_sample(raw_of, RAW_POINTS).collect();
        raw_picks.retain(|&i| frame.holds(&merged.points_mm[i]));
        let model_sample = |k: usize| {
            let (position_mm, normal) = (model.points_mm[k], model.normals[k]);
            Sample {
                position_mm,
                normal,
                moved_mm: normal.dot(&(voxels.cloud.points_mm[k] - position_mm)),
                intensity: intensity.get(k).copied().unwrap_or(0.0),
                view: voxels.view.get(k).copied().unwrap_or(0),
                surface: surface_number(places[k].surface),
                border: border_number(places[k].border),
            }
        };
        let picks: Vec<usize> = even_sample(model.len(), MODEL_POINTS).collect();
        let model_samples: Vec<Sample> = picks.into_par_iter().map(model_sample).collect();
        let raw = raw_samples(&raw_picks, merged, &model_samples, voxels.edge_mm);
        Self {
            clouds: Some(Clouds { frame, model: model_samples, model_of: model.len(), raw, raw_of }),
            cameras_mm: cameras_mm(merged),
            rejected: evidence.rejected.to_vec(),
            unwelded: evidence.unwelded.to_vec(),
            surfaces: segmentation.map(Segmentation::surfaces).unwrap_or_default(),
            intensity: Histogram::between(0.0, 0.5, intensity.iter().copied()),
            ratio: Histogram::between(
                RatioThreshold::FLOOR.into(),
                RATIO_HIGH,
                ratio::sampled(evidence).into_iter(),
            ),
            spacing_mm: Histogram::of_lengths(spacings_mm(merged, index, voxels.edge_mm)),
        }
    }
}

fn raw_samples(picks: &[usize], merged: &Merged, model: &[Sample], edge_mm: f32) -> Vec<Sample> {
    let points: Vec<Point3<f32>> = model.iter().map(|s| s.position_mm).collect();
    let grid = Grid::new(&points, 2.0 * edge_mm);
    let sample = |&i: &usize| {
        let position_mm = merged.points_mm[i];
        let near = grid.nearest(&position_mm, NEAR_VOXELS * edge_mm, |_| true);
        let like = near.map(|(slot, _)| model[grid.index(slot)]);
        Sample {
            position_mm,
            normal: like.map_or(Vector3::zeros(), |s| s.normal),
            moved_mm: 0.0,
            intensity: like.map_or(0.0, |s| s.intensity),
            view: merged.view[i],
            surface: like.map_or(0, |s| s.surface),
            border: like.map_or(0, |s| s.border),
        }
    };
    picks.par_iter().map(sample).collect()
}

fn cameras_mm(merged: &Merged) -> Vec<Point3<f64>> {
    let near = merged.cameras_mm.iter().filter(|c| c.coords.norm() < FARTHEST_CAMERA_MM);
    near.map(|c| merged.origin_mm + c.coords.cast::<f64>()).collect()
}

/// Distances from a sample of the first view's points to the nearest distinct one.
fn spacings_mm(merged: &Merged, index: &Grid, edge_mm: f32) -> Vec<f32> {
    let is_first = |i: usize| merged.view[i] == 0;
    let of_first: Vec<usize> = (0..merged.points_mm.len()).into_par_iter().filter(|&i| is_first(i)).collect();
    let nearest_mm = |k: usize| {
        let point = &merged.points_mm[of_first[k]];
        let other = |slot: usize| is_first(index.index(slot)) && index.point(slot) != *point;
        index.nearest(point, 8.0 * edge_mm, other).map(|(_, d2)| d2.sqrt())
    };
    let picks: Vec<usize> = even_sample(of_first.len(), SPACING_SAMPLE).collect();
    picks.into_par_iter().filter_map(nearest_mm).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use weldpath_method::model::downsampling::Voxels;

    #[test]
    fn a_sample_is_even_and_without_repetition() {
        for (count, most) in [(0, 10), (7, 10), (1000, 10), (1001, 10), (299_999, 300)] {
            let picks: Vec<usize> = even_sample(count, most).collect();
            assert!(picks.windows(2).all(|w| w[0] < w[1]) && picks.iter().all(|&i| i < count));
            assert!(picks.len() == count.min(most), "{count}: {}", picks.len());
        }
    }

    #[test]
    fn the_recording_tells_what_the_filter_moved_and_which_view_saw_it() {
        let at = |k: usize| Point3::new((k % 20) as f32, (k / 20) as f32, 0.0);
        let points_mm: Vec<_> = (0..400).map(at).collect();
        let normals = vec![Vector3::z(); 400];
        let model = PointCloud { origin_mm: Point3::origin(), points_mm: points_mm.clone(), normals };
        let raised: Vec<_> = points_mm.iter().map(|p| p + Vector3::z() * 0.2).collect();
        let cloud = PointCloud { points_mm: raised.clone(), ..model.clone() };
        let view: Vec<u16> = (0..400).map(|k| u16::from(k >= 200)).collect();
        let voxels = Voxels { cloud, view: view.clone(), edge_mm: 1.0, ..Voxels::default() };
        let cameras_mm = vec![Point3::new(0.0, 0.0, 300.0), Point3::new(0.0, 0.0, 1e5)];
        let merged = Merged { points_mm: raised, view, cameras_mm, ..Merged::default() };
        let evidence = Evidence {
            merged: &merged,
            raw: &Grid::new(&merged.points_mm, 5.0),
            voxels: &voxels,
            model: &model,
            index: &Grid::new(&model.points_mm, 4.0),
            intensity: &[0.3; 400],
            segmentation: None,
            rejected: &["an inside corner".into()],
            unwelded: &[],
        };
        let recording = Recording::of(&evidence);
        let clouds = recording.clouds.unwrap();
        assert_eq!((clouds.model.len(), clouds.raw.len()), (400, 400));
        for (k, sample) in clouds.model.iter().enumerate() {
            assert!((sample.moved_mm - 0.2).abs() < 1e-6);
            assert_eq!(sample.view, u16::from(k >= 200), "point {k}");
        }
        assert_eq!(recording.rejected, ["an inside corner"]);
        assert_eq!(recording.cameras_mm.len(), 1, "a camera of unknown place is not drawn");
        let spacing = spacings_mm(&merged, evidence.raw, 1.0);
        assert!(spacing.len() == 200 && spacing.iter().all(|mm| (mm - 1.0).abs() < 1e-5));
    }
}
