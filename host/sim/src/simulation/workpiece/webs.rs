//! Webs on a base plate: T joint, Y of three webs, cross of two, a block and a rib tacked on.

use super::{Draw, Request, TrueSeam, Workpiece, around};
use crate::simulation::request::{FILLET_MM, TACK_MM, Tacks};
use crate::simulation::rotation::{about, sin_cos_deg};
use crate::simulation::solid::{Convex, Solid};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// A T joint whose web leans, by the angle between plate and web on the camera's side, and may stand off the plate.
pub(super) fn fillet(draw: &mut Draw, request: &Request) -> Workpiece {
    let plate = draw.between_or("T", [8.0, 10.0], request.thickness_mm);
    let web = draw.between_or("t", [7.0, 9.0], request.thickness_mm);
    let angle_deg = draw.given("angle_deg", request.angle_deg.unwrap_or(90.0));
    let gap = request.root_opening_mm.map_or(0.0, |gap| draw.given("gap", gap));
    let half = 0.5 * request.length_mm.unwrap_or(FILLET_MM);
    let (sin, cos) = sin_cos_deg(angle_deg);
    let (front, back) = (-0.5 * web / sin, 0.5 * web / sin);
    let lean = |height: f64| -cos / sin * height;
    let profile = [
        [front + lean(gap), plate + gap],
        [back + lean(gap), plate + gap],
        [back + lean(80.0), plate + 80.0],
        [front + lean(80.0), plate + 80.0],
    ];
    let base = Convex::cuboid([-half, -80.0, 0.0], [half, 80.0, plate]);
    let face = Vector3::new(0.0, -sin, -cos);
    let seam = |name, y, wall, required| {
        let end = |x| Point3::new(x, y, plate);
        TrueSeam::straight(name, end(-half), end(half), [Vector3::z(), wall], required)
            .with_opening(Vector3::new(0.0, lean(gap), gap))
    };
    let seams = vec![seam("right", front, face, true), seam("left", back, -face, false)];
    let target = Point3::new(0.0, front - 5.0, plate + 15.0);
    let far = 100.0 + 0.95 * (2.0 * half);
    let places =
        [[-65.0, 50.0, far], [-115.0, 45.0, far], [-45.0, 55.0, far], [-85.0, 32.0, far], [-98.0, 63.0, far]];
    // The cameras stay about the bisector of the joint.
    let places = places.map(|[azimuth, elevation, far]| [azimuth, elevation + 0.5 * (angle_deg - 90.0), far]);
    let mut solids = vec![base.into(), Convex::prism(&profile, -half, half).into()];
    if let Some(tacks) = request.tacks {
        let root = [front, plate];
        solids.extend(beads(draw, &tacks, half, root, [-cos, sin]));
    }
    Workpiece::new(solids, seams, around(target, &places))
}

/// Tacks of triangular section whose root is at `root` in (y, z), on the plate towards -y and up the web along `up`.
fn beads(draw: &mut Draw, tacks: &Tacks, half: f64, root: [f64; 2], up: [f64; 2]) -> Vec<Solid> {
    let leg = draw.given("tack_leg", tacks.leg_mm);
    let [y, z] = root;
    let section = [[y - leg, z], root, [y + leg * up[0], z + leg * up[1]]];
    let step = 2.0 * half / tacks.count as f64;
    let bead = |i: usize| {
        let middle = step * (i as f64 + 0.5 + draw.random.between(-0.1, 0.1)) - half;
        let reach = 0.5 * draw.random.between(TACK_MM[0], TACK_MM[1]);
        Convex::prism(&section, middle - reach, middle + reach).into()
    };
    (0..tacks.count).map(bead).collect()
}

/// Three webs at 120 degrees on a plate; the cameras stand in front of two of the three pockets.
pub(super) fn branch(draw: &mut Draw, weak: bool) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let web = draw.between("t", 7.0, 9.0);
    let turn_deg = draw.between("a0", -20.0, 20.0);
    let (reach, height) = (110.0, 60.0);
    let mut solids: Vec<Solid> = vec![Convex::cuboid([-130.0, -130.0, 0.0], [130.0, 130.0, plate]).into()];
    let mut seams = Vec::new();
    for k in 0..3 {
        let azimuth_deg = turn_deg + [150.0, -90.0, 30.0][k];
        let low = [0.0, -0.5 * web, plate];
        solids.push(turned(&Convex::cuboid(low, [reach, 0.5 * web, plate + height]), azimuth_deg).into());
        seams.extend(pocket(k, azimuth_deg, 120.0, web, [reach, plate, height], k < 2));
    }
    let target = Point3::new(0.0, -10.0, plate + 20.0);
    // Neighbours in azimuth share upright faces, across the web between the pockets, too.
    let good = [
        [-116.0, 47.0, 360.0],
        [-152.0, 55.0, 380.0],
        [-54.0, 47.0, 370.0],
        [-32.0, 52.0, 380.0],
        [-102.0, 53.0, 360.0],
        [-69.0, 60.0, 390.0],
        [-137.0, 42.0, 370.0],
        [-44.0, 46.0, 370.0],
    ];
    // Views 0 and 1 look into different pockets and have only the base plate in common.
    let bad = [
        [-155.0, 50.0, 380.0],
        [-23.0, 50.0, 380.0],
        [177.0, 42.0, 370.0],
        [-48.0, 45.0, 370.0],
        [-133.0, 42.0, 390.0],
        [2.0, 44.0, 380.0],
    ];
    let places: &[[f64; 3]] = if weak { &bad } else { &good };
    let turned: Vec<[f64; 3]> = places.iter().map(|p| [p[0] + turn_deg, p[1], p[2]]).collect();
    Workpiece::new(solids, seams, around(target, &turned))
}

/// Two webs that cross at right angles: four pockets, each with two feet and one upright seam.
pub(super) fn cruciform(draw: &mut Draw) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let web = draw.between("t", 7.0, 9.0);
    let (reach, height) = (100.0, 60.0);
    let mut solids: Vec<Solid> = vec![Convex::cuboid([-130.0, -130.0, 0.0], [130.0, 130.0, plate]).into()];
    let mut seams = Vec::new();
    for (k, azimuth_deg) in [0.0, 90.0, 180.0, 270.0].into_iter().enumerate() {
        let low = [0.0, -0.5 * web, plate];
        solids.push(turned(&Convex::cuboid(low, [reach, 0.5 * web, plate + height]), azimuth_deg).into());
        seams.extend(pocket(k, azimuth_deg, 90.0, web, [reach, plate, height], true));
    }
    // Two views to a pocket; neighbours in the list share a pocket or a web.
    let places = [-57.0, -33.0, 33.0, 57.0, 123.0, 147.0, 213.0, 237.0].map(|azimuth| [azimuth, 43.0, 360.0]);
    Workpiece::new(solids, seams, around(Point3::new(0.0, 0.0, plate + 20.0), &places))
}

/// The seams of the pocket that a web at `azimuth_deg` shares with the next one, `opening_deg` further on.
fn pocket(
    k: usize,
    azimuth_deg: f64,
    opening_deg: f64,
    web: f64,
    [reach, plate, height]: [f64; 3],
    required: bool,
) -> [TrueSeam; 3] {
    let direction = |deg: f64| {
        let (sin, cos) = sin_cos_deg(deg);
        Vector3::new(cos, sin, 0.0)
    };
    let (first, second) = (direction(azimuth_deg), direction(azimuth_deg + opening_deg));
    let (sin, cos) = sin_cos_deg(0.5 * opening_deg);
    // The two faces meet on the pocket's bisector.
    let meet = Point3::origin() + direction(azimuth_deg + 0.5 * opening_deg) * (0.5 * web / sin);
    let length = reach - 0.5 * web * cos / sin;
    let (face_a, face_b) = (direction(azimuth_deg + 90.0), direction(azimuth_deg + opening_deg - 90.0));
    let foot = meet + Vector3::z() * plate;
    let up = Vector3::z();
    [
        TrueSeam::straight(&format!("foot{k}a"), foot + first * length, foot, [face_a, up], required),
        TrueSeam::straight(&format!("foot{k}b"), foot, foot + second * length, [face_b, up], required),
        TrueSeam::straight(&format!("vert{k}"), foot, foot + up * height, [face_a, face_b], required),
    ]
}

/// A square block and a rib on a plate; the cameras stand at one corner and see two sides of the block, one of the rib.
pub(super) fn tacked(draw: &mut Draw, weak: bool) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let rib_deg = draw.between("rib_deg", -10.0, 10.0);
    let (side, height) = (30.0, 70.0);
    let block = Convex::cuboid([50.0 - side, -side, plate], [50.0 + side, side, plate + height]);
    let rib_frame =
        Isometry3::from_parts(Translation3::new(-80.0, 0.0, 0.0), about(Vector3::z(), 90.0 + rib_deg));
    let rib = Convex::cuboid([-60.0, -4.0, plate], [60.0, 4.0, plate + height]).moved(&rib_frame);
    let base = Convex::cuboid([-150.0, -110.0, 0.0], [150.0, 110.0, plate]);

    let corner = |x: f64, y: f64| Point3::new(50.0 + side * x, side * y, plate);
    let (x, y, up) = (Vector3::x(), Vector3::y(), Vector3::z());
    let mut seams = vec![
        TrueSeam::straight("tube-y", corner(-1.0, -1.0), corner(1.0, -1.0), [-y, up], true),
        TrueSeam::straight("tube+x", corner(1.0, -1.0), corner(1.0, 1.0), [x, up], true),
        TrueSeam::straight("tube+y", corner(1.0, 1.0), corner(-1.0, 1.0), [y, up], false),
        TrueSeam::straight("tube-x", corner(-1.0, 1.0), corner(-1.0, -1.0), [-x, up], false),
    ];
    for (name, side, required) in [("rib+", -4.0, true), ("rib-", 4.0, false)] {
        let end = |x| Point3::new(x, side, plate);
        let foot = TrueSeam::straight(name, end(-60.0), end(60.0), [y * (side / 4.0), up], required);
        seams.push(foot.moved(&rib_frame));
    }
    let target = Point3::new(10.0, -10.0, plate + 15.0);
    // Good: the anchor sees three directions of faces. Weak: it looks along x and is blind to the faces along it.
    let good = [
        [-48.0, 45.0, 370.0],
        [-35.0, 48.0, 350.0],
        [-72.0, 50.0, 370.0],
        [-20.0, 42.0, 360.0],
        [-60.0, 48.0, 350.0],
        [-42.0, 62.0, 370.0],
    ];
    let bad = [
        [2.0, 47.0, 360.0],
        [-30.0, 45.0, 350.0],
        [-85.0, 46.0, 370.0],
        [-20.0, 54.0, 370.0],
        [18.0, 45.0, 370.0],
        [-62.0, 47.0, 360.0],
    ];
    let solids = vec![base.into(), block.into(), rib.into()];
    let places: &[[f64; 3]] = if weak { &bad } else { &good };
    Workpiece::new(solids, seams, around(target, places))
}

fn turned(body: &Convex, azimuth_deg: f64) -> Convex {
    let rotation: UnitQuaternion<f64> = about(Vector3::z(), azimuth_deg);
    body.moved(&Isometry3::from_parts(Translation3::identity(), rotation))
}
