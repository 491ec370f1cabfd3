//! Scenes: several parts apart on the table, and a part held in a vise.

use super::tubes::{rounded_tube, tube_seams};
use super::{Draw, TrueSeam, Workpiece, ring};
use crate::simulation::rotation::about;
use crate::simulation::solid::{Convex, Solid};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

/// A T joint, its plate's middle at the origin: half its length, half its plate's width, height of its web.
const TEE_MM: [f64; 3] = [60.0, 40.0, 35.0];

/// Plate and web along x, seen from both sides.
fn tee(plate: f64, web: f64) -> (Vec<Solid>, Vec<TrueSeam>) {
    let [half, wide, high] = TEE_MM;
    let solids = vec![
        Convex::cuboid([-half, -wide, 0.0], [half, wide, plate]).into(),
        Convex::cuboid([-half, -0.5 * web, plate], [half, 0.5 * web, plate + high]).into(),
    ];
    let seam = |name, side: f64| {
        let end = |x| Point3::new(x, 0.5 * web * side, plate);
        TrueSeam::straight(name, end(-half), end(half), [Vector3::y() * side, Vector3::z()], true)
    };
    (solids, vec![seam("right", -1.0), seam("left", 1.0)])
}

/// Turned about z and set down at (x, y).
fn set_down(
    (solids, seams): (Vec<Solid>, Vec<TrueSeam>),
    turn_deg: f64,
    [x, y]: [f64; 2],
) -> (Vec<Solid>, Vec<TrueSeam>) {
    let frame = Isometry3::from_parts(Translation3::new(x, y, 0.0), about(Vector3::z(), turn_deg));
    let solids = solids.iter().map(|solid| solid.moved(&frame)).collect();
    (solids, seams.iter().map(|seam| seam.moved(&frame)).collect())
}

/// A T joint, a boss and a square tube, each on a plate of its own, 20 mm or more apart.
pub(super) fn several(draw: &mut Draw) -> Workpiece {
    let plate = draw.between("T", 7.0, 10.0);
    let web = draw.between("t", 6.0, 9.0);
    let radius = draw.between("r", 18.0, 25.0);
    let half = draw.between("half_side", 18.0, 24.0);
    let turns_deg = [("turn1", 12.0), ("turn2", 20.0), ("turn3", 20.0)];
    let turns_deg = turns_deg.map(|(name, most)| draw.between(name, -most, most));
    let centre = Point3::new(0.0, 0.0, plate);
    let base = || Solid::from(Convex::cuboid([-45.0, -45.0, 0.0], [45.0, 45.0, plate]));
    let post = Convex::upright_cylinder(radius, [0.0; 2], plate, plate + 20.0).into();
    let boss = (vec![base(), post], vec![TrueSeam::circle("boss", centre, radius, true, true)]);
    let mut walls = vec![base()];
    walls.extend(rounded_tube(half, [plate, plate + 35.0]));
    let tube = (walls, tube_seams("tube", centre, half).to_vec());
    let parts = [
        set_down(tee(plate, web), turns_deg[0], [0.0, -85.0]),
        set_down(boss, turns_deg[1], [-85.0, 60.0]),
        set_down(tube, turns_deg[2], [85.0, 60.0]),
    ];
    let (solids, seams): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
    // Six views see both sides of every web; from farther off than one part needs.
    let views = ring(6, -60.0, 50.0, 430.0, Point3::new(0.0, -10.0, plate));
    Workpiece::new(solids.concat(), seams.concat(), views)
}

/// A T joint whose plate is held along both edges by jaws that rise above it.
pub(super) fn vise(draw: &mut Draw) -> Workpiece {
    let plate = draw.between("T", 8.0, 10.0);
    let web = draw.between("t", 6.0, 9.0);
    let rise = draw.between("jaws", 5.0, 10.0);
    // So far the plate's underside is above the vise's bed, on which the jaws stand.
    let bed = 15.0;
    let wide = TEE_MM[1];
    let (mut solids, seams) = tee(plate, web);
    let jaw = |low: f64, high: f64| Convex::cuboid([-75.0, low, -bed], [75.0, high, plate + rise]).into();
    let vise = [
        jaw(-wide - 30.0, -wide),
        jaw(wide, wide + 30.0),
        Convex::cuboid([-70.0, -wide - 60.0, -bed - 25.0], [70.0, wide + 60.0, -bed]).into(),
    ];
    let holding = vise.len();
    solids.extend(vise);
    let views = ring(6, -60.0, 48.0, 340.0, Point3::new(0.0, 0.0, plate + 5.0));
    Workpiece { holding, ..Workpiece::new(solids, seams, views) }
}
