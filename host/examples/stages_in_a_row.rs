//! Stages of one's own choice one after the other, instead of `pipeline::plan`: from views to the points that lie on edges.
//!
//! Every stage is a function from values to a value, so one of them may be left out, repeated or replaced by your own.
//!
//! `cargo run --release -p weldpath --example stages_in_a_row -- fixtures/pipe`

use std::path::Path;

use nalgebra::Point3;
use weldpath::geometry::cloud::{Merged, PointCloud, View};
use weldpath::geometry::grid::Grid;
use weldpath::model::downsampling::{Scale, voxel_grid};
use weldpath::model::{denoising, normals, reconstruction};
use weldpath::{input, pipeline};
use weldpath_core::seam::intensity;

/// Radius in which a point's neighbours count, voxels.
const REACH_VOXELS: f32 = 4.0;
/// Eq. (12) is 0 amid a face and 0.21 where two faces meet at a right angle.
const EDGE: f32 = 0.13;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let input = std::env::args().nth(1).unwrap_or("fixtures/pipe".into());
    let scan = input::read(Path::new(&input), &input::Options::default())?;
    for [x, y, z] in edge_points(&scan.views).iter().map(|point| <[f64; 3]>::from(point.coords)) {
        println!("{x:.3},{y:.3},{z:.3}");
    }
    Ok(())
}

/// Points on edges, mm, base frame.
pub(crate) fn edge_points(views: &[View]) -> Vec<Point3<f64>> {
    let (model, voxel_mm) = model(views);
    let radius_mm = REACH_VOXELS * voxel_mm;
    let index = Grid::new(&model.points_mm, radius_mm);
    let on_edge = |&i: &usize| {
        let centre = model.points_mm[i];
        let mut offsets_mm = Vec::new();
        index.within(&centre, radius_mm, |slot, _| {
            if index.index(slot) != i {
                offsets_mm.push(index.point(slot) - centre);
            }
        });
        intensity(offsets_mm, radius_mm) > EDGE
    };
    (0..model.len()).filter(on_edge).map(|i| model.in_base_mm(i)).collect()
}

/// Registered, merged, thinned and filtered views, and the edge of their voxels.
fn model(views: &[View]) -> (PointCloud, f32) {
    let config = pipeline::Config::default();
    let patches = normals::of_views(views, &config.merge.normals);
    let registration = reconstruction::register(views, &patches, &config.merge.reconstruction);
    let merged = Merged::new(views, &registration.base_from_camera);
    let scale = Scale::of(&merged, &patches, &config.merge.downsampling);
    let voxels = voxel_grid(&merged, scale.edge_mm, scale.occupancy());
    (denoising::bilateral(&voxels.cloud, &scale.bilateral()), scale.edge_mm)
}
