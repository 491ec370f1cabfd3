use super::*;
use crate::geometry::cloud::PointCloud;
use crate::model::downsampling::Voxels;

type Rows = Vec<(Point3<f32>, Vector3<f32>)>;

/// Voxels of 1 mm, each seen by one camera far above, and what they are.
struct Model {
    voxels: Voxels,
    index: Grid,
    merged: Merged,
}

impl Model {
    fn new(rows: &[(Point3<f32>, Vector3<f32>)]) -> Self {
        let (points_mm, normals): (Vec<_>, _) = rows.iter().copied().unzip();
        let merged = Merged {
            points_mm: points_mm.clone(),
            view: vec![0; rows.len()],
            cameras_mm: vec![Point3::new(0.0, 0.0, 1000.0)],
            ..Merged::default()
        };
        let index = Grid::new(&points_mm, 4.0);
        let cloud = PointCloud { points_mm, normals, ..PointCloud::default() };
        let voxels = Voxels { cloud, view: vec![0; rows.len()], edge_mm: 1.0, ..Voxels::default() };
        Self { voxels, index, merged }
    }

    fn surface(&self) -> SurfaceModel<'_> {
        let Self { voxels, index, .. } = self;
        SurfaceModel { voxels, cloud: &voxels.cloud, index, asymmetries: &[] }
    }

    fn segmentation(&self) -> (Segmentation, Vec<Place>) {
        let found = Segmentation::of(&self.surface());
        let places = found.places(&self.surface(), &self.merged, &[]);
        (found, places)
    }
}

/// A level square of so many mm about a place.
fn level([x, y, z]: [f32; 3], side_mm: i32) -> Rows {
    let half = side_mm / 2;
    let at = |k: i32, l: i32| (Point3::new(x + k as f32, y + l as f32, z), Vector3::z());
    (-half..=half).flat_map(|k| (-half..=half).map(move |l| at(k, l))).collect()
}

/// An upright tube about z, from one height to another; its normals face out.
fn tube(radius_mm: f32, heights_mm: std::ops::RangeInclusive<i32>) -> Rows {
    let count = (std::f32::consts::TAU * radius_mm) as i32;
    let at = |k: i32, z: i32| {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / count as f32).sin_cos();
        (Point3::new(radius_mm * cos, radius_mm * sin, z as f32), Vector3::new(cos, sin, 0.0))
    };
    heights_mm.flat_map(|z| (0..count).map(move |k| at(k, z))).collect()
}

/// Of the points that are chosen, the share at such a border.
fn share(rows: &Rows, places: &[Place], border: Border, chosen: impl Fn(&Point3<f32>) -> bool) -> f32 {
    let chosen: Vec<_> = rows.iter().zip(places).filter(|((p, _), _)| chosen(p)).collect();
    let at = chosen.iter().filter(|(_, place)| place.border == Some(border)).count();
    at as f32 / chosen.len() as f32
}

#[test]
fn a_tube_on_a_plate_is_a_cylinder_and_a_plane_that_meet_inside() {
    let plate = level([0.0; 3], 100).into_iter().filter(|(p, _)| p.x.hypot(p.y) > 20.5);
    let rows: Rows = plate.chain(tube(20.0, 1..=40)).collect();
    let model = Model::new(&rows);
    let (found, places) = model.segmentation();
    let shapes: Vec<SurfaceShape> = found.surfaces().iter().map(|surface| surface.shape).collect();
    let [SurfaceShape::Plane, SurfaceShape::Cylinder { radius_mm }] = shapes[..] else {
        panic!("{shapes:?}")
    };
    assert!((radius_mm - 20.0).abs() < 0.05, "{radius_mm}");
    let foot = |p: &Point3<f32>| (p.x.hypot(p.y) - 20.0).abs() < 1.5 && p.z < 1.5;
    assert!(share(&rows, &places, Border::Inside, foot) > 0.9);
    let rim = |p: &Point3<f32>| p.x.abs().max(p.y.abs()) > 49.5;
    assert!(share(&rows, &places, Border::Unseen, rim) > 0.9, "the picture ends there");
    let between = |p: &Point3<f32>| p.z == 0.0 && p.x.hypot(p.y) > 26.0 && p.x.abs().max(p.y.abs()) < 44.0;
    assert_eq!(rows.iter().zip(&places).filter(|((p, _), q)| between(p) && q.border.is_some()).count(), 0);
    let lines = found.lines(&model.surface(), &TraceConfig::default(), |_| true);
    assert_eq!(lines.len(), 1);
    assert!(lines[0].closed);
    for link in &lines[0].links {
        let off_mm = (link.position.coords.xy().norm() - 20.0).hypot(link.position.z);
        assert!(off_mm < 0.4, "{off_mm}");
    }
}

#[test]
fn a_block_ends_in_outside_corners_and_a_plate_over_a_floor_in_an_edge() {
    // A block of 40 x 40 x 30 mm, of which the camera sees the top and one side; the floor is 80 mm below.
    let side = (-20..=20).flat_map(|x| (1..=30).map(move |d| (x as f32, d as f32)));
    let side = side.map(|(x, d)| (Point3::new(x, 20.0, -d), Vector3::y()));
    let rows: Rows =
        level([0.0; 3], 40).into_iter().chain(side).chain(level([0.0, 0.0, -80.0], 140)).collect();
    let (_, places) = Model::new(&rows).segmentation();
    let corner = |p: &Point3<f32>| p.y > 18.5 && p.z > -1.5 && p.x.abs() < 15.0;
    assert!(share(&rows, &places, Border::Outside, corner) > 0.9);
    let edge = |p: &Point3<f32>| p.z == 0.0 && p.x > 19.5 && p.y.abs() < 15.0;
    assert!(share(&rows, &places, Border::Edge, edge) > 0.9, "the floor shows beside it");
}

#[test]
fn where_something_nearer_stands_before_a_surface_it_is_hidden() {
    // Under a plate 60 mm over it the floor has a hole, which the camera sees 6 % larger than the plate.
    let hole = |p: &Point3<f32>| p.x.abs().max(p.y.abs()) < 21.3;
    let floor = level([0.0; 3], 120).into_iter().filter(|(p, _)| !hole(p));
    let rows: Rows = floor.chain(level([0.0, 0.0, 60.0], 40)).collect();
    let (_, places) = Model::new(&rows).segmentation();
    let rim = |p: &Point3<f32>| p.z == 0.0 && (21.3..22.5).contains(&p.x) && p.y.abs() < 15.0;
    assert!(share(&rows, &places, Border::Hidden, rim) > 0.9);
}

#[test]
fn a_bend_goes_on_and_a_sheet_on_another_steps() {
    // A quarter of a tube of 15 mm radius, and a plane on from its crest.
    let quarter = tube(15.0, 0..=60).into_iter().filter(|(p, _)| p.x >= 0.0 && p.y >= 0.0);
    let flat = (1..=40).flat_map(|x| (0..=60).map(move |z| (x as f32, z as f32)));
    let flat = flat.map(|(x, z)| (Point3::new(-x, 15.0, z), Vector3::y()));
    let rows: Rows = quarter.chain(flat).collect();
    let (found, places) = Model::new(&rows).segmentation();
    assert_eq!(found.surfaces().len(), 2);
    // Where exactly one becomes the other nobody sees: within 8.5 mm of the crest the tube lies within 2.4 mm of the plane,
    // what a flat face takes in.
    let tangent = rows.iter().zip(&places).filter(|(_, place)| place.border == Some(Border::Tangent));
    let across_mm: Vec<f32> = tangent.map(|((p, _), _)| p.x).collect();
    assert!(across_mm.len() > 60 && across_mm.iter().all(|x| (-2.0..8.5).contains(x)), "{across_mm:?}");
    let corner =
        |place: &Place| matches!(place.border, Some(Border::Inside | Border::Outside | Border::Step));
    let corners: Vec<_> = rows.iter().zip(&places).filter(|(_, place)| corner(place)).collect();
    assert!(corners.is_empty(), "{corners:?}");
    // A sheet of 1.5 mm on a plate.
    let sheet = level([0.0, 0.0, 1.5], 40);
    let plate = level([0.0; 3], 100).into_iter().filter(|(p, _)| p.x.abs().max(p.y.abs()) > 20.5);
    let rows: Rows = plate.chain(sheet).collect();
    let model = Model::new(&rows);
    let (found, places) = model.segmentation();
    let side = |p: &Point3<f32>| p.z > 1.0 && p.x > 19.5 && p.y.abs() < 15.0;
    assert!(share(&rows, &places, Border::Step, side) > 0.9);
    let lines = found.lines(&model.surface(), &TraceConfig::default(), |_| true);
    let length_mm: f32 = lines.iter().map(Chain::length_mm).sum();
    assert!((130.0..170.0).contains(&length_mm), "{length_mm} mm of 160 mm");
    assert!(lines.iter().flat_map(|line| &line.links).all(|link| link.position.z.abs() < 0.2));
}
