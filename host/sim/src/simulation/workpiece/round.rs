//! Round members: pipe, disc and boss on a plate, branch pipe on a main pipe (saddle).

use super::{Draw, TrueSeam, TrueStation, Workpiece, ring};
use crate::simulation::rotation::{from_columns, sin_cos_deg};
use crate::simulation::solid::{Convex, Solid};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

/// Wall of the pipes, mm.
pub(super) const WALL: f64 = 5.0;

/// A pipe that stands on a plate.
pub(super) fn pipe(draw: &mut Draw) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let radius = draw.between("r", 40.0, 48.0);
    let height = draw.between("H", 65.0, 75.0);
    let top = plate + height;
    let tube = Solid::from(Convex::upright_cylinder(radius, [0.0; 2], plate, top))
        .without(Convex::upright_cylinder(radius - WALL, [0.0; 2], plate - 1.0, top + 1.0));
    let centre = Point3::new(0.0, 0.0, plate);
    let seams = vec![
        TrueSeam::circle("outer", centre, radius, true, true),
        TrueSeam::circle("inner", centre, radius - WALL, false, false),
    ];
    let base = Convex::cuboid([-110.0, -110.0, 0.0], [110.0, 110.0, plate]);
    Workpiece::new(vec![base.into(), tube], seams, ring(6, -60.0, 46.0, 370.0, centre + Vector3::z() * 15.0))
}

/// A disc on a plate: a lap joint that closes on itself.
pub(super) fn round_lap(draw: &mut Draw) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let disc = draw.between("T2", 7.0, 10.0);
    let radius = draw.between("r", 50.0, 65.0);
    let centre = Point3::new(0.0, 0.0, plate);
    let solids = vec![
        Convex::cuboid([-110.0, -110.0, 0.0], [110.0, 110.0, plate]).into(),
        Convex::upright_cylinder(radius, [0.0; 2], plate, plate + disc).into(),
    ];
    let seam = TrueSeam::circle("rim", centre, radius, true, true);
    Workpiece::new(solids, vec![seam], ring(6, -60.0, 46.0, 360.0, centre))
}

/// A boss, a low solid cylinder, on a plate.
pub(super) fn boss(draw: &mut Draw) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let radius = draw.between("r", 18.0, 28.0);
    let height = draw.between("H", 15.0, 25.0);
    let centre = Point3::new(0.0, 0.0, plate);
    let solids = vec![
        Convex::cuboid([-80.0, -80.0, 0.0], [80.0, 80.0, plate]).into(),
        Convex::upright_cylinder(radius, [0.0; 2], plate, plate + height).into(),
    ];
    let seam = TrueSeam::circle("boss", centre, radius, true, true);
    Workpiece::new(solids, vec![seam], ring(6, -60.0, 46.0, 320.0, centre))
}

/// A branch pipe on a thicker one lying along x, at `angle_deg` between their axes, upright if not given.
pub(super) fn saddle(draw: &mut Draw, angle_deg: Option<f64>) -> Workpiece {
    let main = draw.between("R", 55.0, 62.0);
    let radius = draw.between("r", 29.0, 36.0);
    let height = draw.between("H", 50.0, 57.0);
    let angle_deg = angle_deg.map_or(90.0, |asked| draw.given("angle_deg", asked));
    let (sin, cos) = sin_cos_deg(angle_deg);
    // The branch's axis leans towards +x and starts on the main pipe's.
    let axis = Vector3::new(cos, 0.0, sin);
    let across = Vector3::new(sin, 0.0, -cos);
    let frame = Isometry3::from_parts(
        Translation3::new(0.0, 0.0, main),
        from_columns(axis, across, axis.cross(&across)),
    );
    let length = (main + height + radius * cos) / sin;
    let tube = Solid::from(Convex::cylinder(radius, 0.0, length).moved(&frame))
        .without(Convex::cylinder(radius - WALL, 0.0, length + 1.0).moved(&frame));
    let lift = Isometry3::translation(0.0, 0.0, main);
    let solids = vec![Convex::cylinder(main, -150.0, 150.0).moved(&lift).into(), tube];
    let seam = saddle_seam(main, radius, [axis, across]);
    // Cameras look into the narrowest place between the pipes along its bisector.
    let views = ring(6, -60.0, 0.5 * angle_deg, 350.0, Point3::new(main * cos, 0.0, 2.0 * main));
    Workpiece::new(solids, vec![seam], views)
}

/// Where a branch of this `axis` meets the main pipe; `across` it in the plane of both.
fn saddle_seam(main: f64, radius: f64, [axis, across]: [Vector3<f64>; 2]) -> TrueSeam {
    TrueSeam::closed("saddle", |turn| {
        let (sin, cos) = sin_cos_deg(360.0 * turn);
        let wall = across * cos + Vector3::y() * sin;
        // Along the axis to where the distance from the main pipe's axis is its radius.
        let (y, foot) = (radius * sin, radius * wall.z);
        let z = (main * main - y * y).sqrt();
        let apex = Point3::new(0.0, 0.0, main) + wall * radius + axis * ((z - foot) / axis.z);
        let faces = [wall, Vector3::new(0.0, y / main, z / main)];
        // Counter-clockwise seen from above.
        TrueStation { apex, root: apex, tangent: faces[1].cross(&faces[0]).normalize(), faces }
    })
}
