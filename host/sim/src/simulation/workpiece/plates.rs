//! Two plates that meet: lap and corner joints. And pieces without a seam: a plate with a hole, a block.

use super::{Draw, Request, TrueSeam, Workpiece, around, ring};
use crate::simulation::solid::{Convex, Solid};
use nalgebra::{Point3, Vector3};

/// The edge of a plate on another plate, or a little above it.
pub(super) fn lap(draw: &mut Draw, request: &Request) -> Workpiece {
    let lower = draw.between_or("T", [7.0, 9.0], request.thickness_mm);
    let upper = draw.between_or("T2", [7.0, 9.0], request.thickness_mm);
    let gap = request.root_opening_mm.map_or(0.0, |gap| draw.given("gap", gap));
    let half = 0.5 * request.length_mm.unwrap_or(300.0);
    let solids = vec![
        Convex::cuboid([-half, -75.0, 0.0], [half, 40.0, lower]).into(),
        Convex::cuboid([-half, 0.0, lower + gap], [half, 75.0, lower + gap + upper]).into(),
    ];
    let end = |x| Point3::new(x, 0.0, lower);
    let seam = TrueSeam::straight("lap", end(-half), end(half), [Vector3::z(), -Vector3::y()], true)
        .with_opening(Vector3::z() * gap);
    let far = 60.0 + 0.95 * (2.0 * half);
    let places =
        [[-70.0, 51.0, far], [-112.0, 47.0, far], [-55.0, 54.0, far], [-88.0, 38.0, far], [-76.0, 64.0, far]];
    Workpiece::new(solids, vec![seam], around(Point3::new(0.0, -5.0, lower), &places))
}

/// The outside corner of an upright plate and a flat one that touch along an edge.
pub(super) fn corner(draw: &mut Draw, length_mm: Option<f64>) -> Workpiece {
    let thick = draw.between("T", 8.0, 10.0);
    let half = 0.5 * length_mm.unwrap_or(250.0);
    let height = 100.0;
    let solids = vec![
        Convex::cuboid([-half, -thick, 0.0], [half, 0.0, height]).into(),
        Convex::cuboid([-half, 0.0, height], [half, 120.0, height + thick]).into(),
    ];
    let seam = |name, wall: Vector3<f64>, floor: Vector3<f64>, required| {
        let end = |x| Point3::new(x, 0.0, height);
        TrueSeam::straight(name, end(-half), end(half), [wall, floor], required)
    };
    let (y, z) = (Vector3::y(), Vector3::z());
    let seams = vec![seam("outside", -y, z, true), seam("inside", y, -z, false)];
    let far = 65.0 + 1.1 * (2.0 * half);
    let places = [
        [-68.0, 44.0, far],
        [-110.0, 38.0, far],
        [-52.0, 48.0, far],
        [-80.0, 60.0, far],
        [-100.0, 30.0, far],
    ];
    Workpiece::new(solids, seams, around(Point3::new(0.0, 0.0, height), &places))
}

/// A plate with two holes: rims and outer edges, but nothing to weld.
pub(super) fn plate(draw: &mut Draw) -> Workpiece {
    let thick = draw.between("T", 8.0, 12.0);
    let large = draw.between("r", 22.0, 30.0);
    let body = Solid::from(Convex::cuboid([-130.0, -90.0, 0.0], [130.0, 90.0, thick]))
        .without(Convex::upright_cylinder(large, [50.0, 10.0], -1.0, thick + 1.0))
        .without(Convex::upright_cylinder(9.0, [-70.0, -30.0], -1.0, thick + 1.0));
    let views = ring(6, -70.0, 48.0, 360.0, Point3::new(0.0, 0.0, thick));
    Workpiece::new(vec![body], Vec::new(), views)
}

/// A block on the table: its foot is a concave corner, but not of the piece.
pub(super) fn block(draw: &mut Draw) -> Workpiece {
    let height = draw.between("H", 50.0, 80.0);
    let body = Convex::cuboid([-70.0, -45.0, 0.0], [70.0, 45.0, height]);
    Workpiece::new(vec![body.into()], Vec::new(), ring(6, -50.0, 48.0, 360.0, Point3::new(0.0, 0.0, 30.0)))
}
