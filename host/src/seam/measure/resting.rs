//! Where the work may rest on a table and not be welded to it (ours): one view shows nothing below.
//!
//! A table reaches farther than what stands on it, or the picture ends before it does. What is upright on a face that the picture cuts off is a
//! web, as nothing thin stands by itself; what lies on it may be a plate of the joint or the work.

use crate::seam::input::Input;
use crate::seam::refine::frame::Frame;
use crate::seam::trace::support::Support;
use crate::seam::{Contact, Seam};
use nalgebra::{Point3, Vector3};

/// Points of what lies on the table are sought within this of a plane across the seam, voxels: a row of them is there.
const STRIP_VOXELS: f32 = 1.0;
/// Its top is sought as far inward as it is high, and this much farther, voxels.
const TOP_VOXELS: f32 = 3.0;
/// Cosine within which a point faces as the table does.
const FACING: f32 = 0.9;

/// Marks the seams most of which run along what may be a table.
pub fn mark_resting(seams: &mut [Seam], table: &Support, input: &Input) {
    let most = |seam: &Seam, is_such: &dyn Fn(&Frame) -> bool| {
        let frames = seam.stations.iter().map(|station| Frame::of(station, &input.scan.merged.origin_mm));
        2 * frames.filter(is_such).count() > seam.stations.len()
    };
    let rests = |seam: &&mut Seam| most(seam, &|frame| wall(frame, table).is_some());
    let resting: Vec<&mut Seam> = seams.iter_mut().filter(rests).collect();
    if resting.is_empty() {
        return;
    }
    let surrounds = table.surrounds(input.scene);
    let camera = input.scan.camera();
    if !surrounds && camera.is_none_or(|pose| !table.leaves_picture(input.scene, &pose)) {
        return;
    }
    let tops = tops(table, input);
    for seam in resting {
        let lies = |frame: &Frame| {
            wall(frame, table)
                .is_some_and(|wall| is_wide(&tops, table, &frame.position, &wall, input.scene.edge_mm))
        };
        if surrounds || most(seam, &lies) {
            seam.mark_contact(Contact::Table);
        }
    }
}

/// Normal of the face that meets the table at a station, if one of its two faces is the table.
fn wall(frame: &Frame, table: &Support) -> Option<Vector3<f32>> {
    let [a, b] = frame.faces;
    [(a, b), (b, a)].into_iter().find(|(face, _)| table.is_face(face, &frame.position)).map(|(_, wall)| wall)
}

/// What faces up over the table.
fn tops(table: &Support, input: &Input) -> Vec<Point3<f32>> {
    let cloud = &input.scene.cloud;
    let both = cloud.points_mm.iter().zip(&cloud.normals);
    let over = |p: &Point3<f32>, n: &Vector3<f32>| {
        n.dot(&table.normal) > FACING && table.height_mm(p) > table.clear_mm
    };
    both.filter(|(p, n)| over(p, n)).map(|(p, _)| *p).collect()
}

/// Whether behind a wall there is a top at least as wide as it is high.
fn is_wide(
    tops: &[Point3<f32>],
    table: &Support,
    at: &Point3<f32>,
    wall: &Vector3<f32>,
    voxel_mm: f32,
) -> bool {
    let Some(along) = wall.cross(&table.normal).try_normalize(f32::EPSILON) else { return false };
    let inward = along.cross(&table.normal);
    tops.iter().any(|p| {
        let from = p - at;
        let beyond_mm = inward.dot(&from) - table.height_mm(p);
        (0.0..TOP_VOXELS * voxel_mm).contains(&beyond_mm) && along.dot(&from).abs() < STRIP_VOXELS * voxel_mm
    })
}
