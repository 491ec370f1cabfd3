//! Where the work may rest on a table and not be welded to it (ours): nothing that is seen below tells.
//!
//! A table reaches farther than what stands on it, or the picture ends before it does. What is upright on a face that may be one is a web,
//! as nothing thin stands by itself; what lies on it may be a plate of the joint or the work.

use crate::seam::input::Input;
use crate::seam::refine::frame::Frame;
use crate::seam::trace::support::{self, Support};
use crate::seam::unwelded::Unwelded;
use crate::seam::{Contact, Seam, WhyUnwelded};
use nalgebra::{Point3, Vector3};

/// Points of what lies on the table are sought within this of a plane across the seam, voxels: a row of them is there.
const STRIP_VOXELS: f32 = 1.0;
/// Its top is sought as far inward as it is high, and this much farther, voxels.
const TOP_VOXELS: f32 = 3.0;
/// Cosine within which a point faces as the table does.
const FACING: f32 = 0.9;

/// Marks the seams most of which run along what may be a table: the support of a cloud that one view shows.
pub(crate) fn mark_resting(seams: &mut [Seam], table: &Support, input: &Input) {
    let mut resting = resting(seams, table, input);
    if resting.is_empty() {
        return;
    }
    if table.surrounds(input.scene) {
        resting.iter_mut().for_each(|seam| seam.mark_contact(Contact::Table));
    } else if table.leaves_pictures(&input.scan) {
        mark_flat(resting, table, input);
    }
}

/// Marks the seams most of which run along what lies on a plane that may be a table as well as a plate of the work, where the support
/// of the cloud is not `known`, or is the floor.
pub(crate) fn mark_lying(seams: &mut [Seam], known: Option<&Support>, input: &Input) {
    if !seams.iter().any(|seam| seems_to_lie(seam, input)) {
        return;
    }
    let Some(table) = support::possible(input.scene, known) else { return };
    mark_flat(resting(seams, &table, input), &table, input);
}

/// Whether something lies on one of the faces in the middle of a seam.
fn seems_to_lie(seam: &Seam, input: &Input) -> bool {
    let Some(station) = seam.stations.get(seam.stations.len() / 2) else { return false };
    let Frame { position, faces: [a, b], .. } = Frame::of(station, &input.scan.merged.origin_mm);
    [(a, b), (b, a)].into_iter().any(|(face, wall)| {
        let plane = Support::of_face(face, &position, input.scene.edge_mm);
        is_wide(&tops(&plane, input), &plane, &position, &wall, input.scene.edge_mm)
    })
}

/// Takes those of the seams out most of which run along a table that is shown: corners that were too blurred to be told from others, and
/// that their faces have put on it. Where all do, and no camera tells whether the picture ends before the table, it may be a plate
/// of the work: what is upright on it stays.
pub(crate) fn take_feet(seams: &mut Vec<Seam>, table: Option<&Support>, input: &Input) -> Vec<Unwelded> {
    let Some(table) = table.filter(|_| input.scan.has_whole_views()) else { return Vec::new() };
    let may_be_plate = !input.scan.cameras_known && seams.iter().all(|seam| rests(seam, table, input));
    let tops = if may_be_plate { tops(table, input) } else { Vec::new() };
    let is_foot =
        |seam: &mut Seam| rests(seam, table, input) && (!may_be_plate || lies(seam, &tops, table, input));
    let feet = seams.extract_if(.., is_foot);
    feet.map(|seam| Unwelded::of(&seam, WhyUnwelded::Table, String::new())).collect()
}

/// The seams most of which run along a plane.
fn resting<'a>(seams: &'a mut [Seam], table: &Support, input: &Input) -> Vec<&'a mut Seam> {
    seams.iter_mut().filter(|seam| rests(seam, table, input)).collect()
}

/// Whether most of a seam runs along a plane.
fn rests(seam: &Seam, table: &Support, input: &Input) -> bool {
    most(seam, input, |frame| wall(frame, table).is_some())
}

/// Whether more than half of a seam's stations are such.
fn most(seam: &Seam, input: &Input, is_such: impl Fn(&Frame) -> bool) -> bool {
    let frames = seam.stations.iter().map(|station| Frame::of(station, &input.scan.merged.origin_mm));
    2 * frames.filter(|frame| is_such(frame)).count() > seam.stations.len()
}

/// Marks those of the seams on a table most of which run along what lies on it, and does not stand upright.
fn mark_flat(resting: Vec<&mut Seam>, table: &Support, input: &Input) {
    let tops = tops(table, input);
    let lying = resting.into_iter().filter(|seam| lies(seam, &tops, table, input));
    lying.for_each(|seam| seam.mark_contact(Contact::Table));
}

/// Whether most of a seam runs along what lies on the table.
fn lies(seam: &Seam, tops: &[Point3<f32>], table: &Support, input: &Input) -> bool {
    most(seam, input, |frame| {
        wall(frame, table)
            .is_some_and(|wall| is_wide(tops, table, &frame.position, &wall, input.scene.edge_mm))
    })
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
