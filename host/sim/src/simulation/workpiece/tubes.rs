//! Tubes on a plate that no single cylinder makes: a square one with round corners, and a pipe bend.

use super::round::WALL;
use super::{Draw, TrueSeam, TrueStation, Workpiece, ring};
use crate::simulation::rotation::{about, from_columns, sin_cos_deg};
use crate::simulation::solid::{Convex, Solid};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Radius of a square tube's corners, outside and inside, mm.
const CORNER_MM: [f64; 2] = [6.0, 2.0];

/// A square tube with round corners that stands on a plate.
pub(super) fn square_tube(draw: &mut Draw) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let half = draw.between("half_side", 25.0, 35.0);
    let height = draw.between("H", 45.0, 60.0);
    let turn_deg = draw.between("turn_deg", 0.0, 90.0);
    let frame = Isometry3::from_parts(Translation3::identity(), about(Vector3::z(), turn_deg));
    let mut solids: Vec<Solid> = vec![Convex::cuboid([-100.0, -100.0, 0.0], [100.0, 100.0, plate]).into()];
    solids.extend(rounded_tube(half, [plate, plate + height]).iter().map(|part| part.moved(&frame)));
    let centre = Point3::new(0.0, 0.0, plate);
    let seams = tube_seams("tube", centre, half).map(|seam| seam.moved(&frame));
    Workpiece::new(solids, seams.to_vec(), ring(6, -60.0, 46.0, 350.0, centre + Vector3::z() * 10.0))
}

/// The tube about z between two heights.
pub(super) fn rounded_tube(half: f64, [low, high]: [f64; 2]) -> Vec<Solid> {
    let wall = CORNER_MM[0] - CORNER_MM[1];
    let bore = rounded_prism(half - wall, CORNER_MM[1], [low - 1.0, high + 1.0]);
    let hollowed =
        |body: Convex| bore.iter().fold(Solid::from(body), |solid, cut| solid.without(cut.clone()));
    rounded_prism(half, CORNER_MM[0], [low, high]).into_iter().map(hollowed).collect()
}

/// Convex bodies that together fill a square prism with round corners.
fn rounded_prism(half: f64, corner: f64, [low, high]: [f64; 2]) -> Vec<Convex> {
    let centre = half - corner;
    let slab = |x: f64, y: f64| Convex::cuboid([-x, -y, low], [x, y, high]);
    let post = |[x, y]: [f64; 2]| Convex::upright_cylinder(corner, [x * centre, y * centre], low, high);
    let corners = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
    [slab(half, centre), slab(centre, half)].into_iter().chain(corners.map(post)).collect()
}

/// The foot of a square tube, outside and inside; the cameras are placed to see the outside.
pub(super) fn tube_seams(name: &str, foot: Point3<f64>, half: f64) -> [TrueSeam; 2] {
    let wall = CORNER_MM[0] - CORNER_MM[1];
    let inner = rounded_square("tube inside", foot, [half - wall, CORNER_MM[1]], -1.0);
    [rounded_square(name, foot, [half, CORNER_MM[0]], 1.0), TrueSeam { required: false, ..inner }]
}

/// A square of this half side and radius of corners, counter-clockwise from the middle of its side at +x; the wall faces `outwards`
/// (1) or inwards (-1).
fn rounded_square(name: &str, foot: Point3<f64>, [half, corner]: [f64; 2], outwards: f64) -> TrueSeam {
    let straight = half - corner;
    let (arc, quarter) = (FRAC_PI_2 * corner, 2.0 * straight + FRAC_PI_2 * corner);
    TrueSeam::closed(name, |turn| {
        let side = (4.0 * turn).floor();
        let along = (4.0 * turn - side) * quarter;
        // Of this quarter: half a side, the corner, half of the next side.
        let round = ((along - straight) / arc).clamp(0.0, 1.0);
        let before = along.min(straight);
        let after = (along - straight - arc).max(0.0);
        let (sin, cos) = sin_cos_deg(90.0 * round);
        let flat = Vector3::new(straight + corner * cos - after, before + corner * sin, 0.0);
        let turned = about(Vector3::z(), 90.0 * side);
        let out = turned * Vector3::new(cos, sin, 0.0);
        let apex = foot + turned * flat;
        let faces = [out * outwards, Vector3::z()];
        TrueStation { apex, root: apex, tangent: Vector3::z().cross(&out), faces }
    })
}

/// Cylinders that a bend of 90 degrees is made of: at this radius they leave the torus by less than 0.01 mm.
const BEND_STEPS: u32 = 60;

/// A pipe bend of 90 degrees whose straight leg stands on a plate; its upper end looks along +x.
pub(super) fn elbow(draw: &mut Draw) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let radius = draw.between("r", 20.0, 26.0);
    let bend = draw.between("R", 62.0, 72.0);
    // Without it the bend would hide its inner side's foot from every camera.
    let leg = draw.between("leg", 15.0, 25.0);
    let foot = Point3::new(0.0, 0.0, plate);
    let upright = Solid::from(Convex::upright_cylinder(radius, [0.0; 2], plate, plate + leg))
        .without(Convex::upright_cylinder(radius - WALL, [0.0; 2], plate - 1.0, plate + leg + 1.0));
    let mut solids = vec![Convex::cuboid([-90.0, -90.0, 0.0], [90.0, 90.0, plate]).into(), upright];
    solids.extend((0..=BEND_STEPS).map(|i| bend_piece(i, radius, bend, foot + Vector3::z() * leg)));
    let seams = vec![
        TrueSeam::circle("outer", foot, radius, true, true),
        TrueSeam::circle("inner", foot, radius - WALL, false, false),
    ];
    Workpiece::new(solids, seams, ring(6, -60.0, 44.0, 350.0, foot + Vector3::new(5.0, 0.0, 15.0)))
}

/// One of the cylinders, tangent to the bend's axis after `i` steps; the first is upright. They meet midway.
fn bend_piece(i: u32, radius: f64, bend: f64, foot: Point3<f64>) -> Solid {
    let step_deg = 90.0 / f64::from(BEND_STEPS);
    let at = |steps: f64| {
        let (sin, cos) = sin_cos_deg(step_deg * steps);
        (foot + Vector3::new(1.0 - cos, 0.0, sin) * bend, Vector3::new(sin, 0.0, cos))
    };
    let steps = f64::from(i);
    let (touch, along) = at(steps);
    let frame = Isometry3::from_parts(
        Translation3::from(touch.coords),
        from_columns(along, Vector3::y(), along.cross(&Vector3::y())),
    );
    // The longest side of a half step is the bend's outer one.
    let (sin, cos) = sin_cos_deg(0.5 * step_deg);
    let reach = (bend + radius) * sin / cos;
    let ((from, back), (to, ahead)) =
        (at((steps - 0.5).max(0.0)), at((steps + 0.5).min(f64::from(BEND_STEPS))));
    let bore = Convex::cylinder(radius - WALL, -2.0 * reach, 2.0 * reach).moved(&frame);
    let outside = Convex::cylinder(radius, -reach, reach).moved(&frame);
    Solid::from(outside.clipped(from, -back).clipped(to, ahead)).without(bore)
}
