//! Round members: pipe on plate, disc on plate, branch pipe on a main pipe (saddle).

use super::{Draw, TrueSeam, TrueStation, Workpiece, ring};
use crate::lab::simulation::rotation::sin_cos_deg;
use crate::lab::simulation::solid::{Convex, Solid};
use nalgebra::{Point3, Vector3};

/// Wall of the pipes, mm.
const WALL: f64 = 5.0;

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

/// A branch pipe that stands on a thicker one lying along x.
pub(super) fn saddle(draw: &mut Draw) -> Workpiece {
    let main = draw.between("R", 55.0, 62.0);
    let radius = draw.between("r", 29.0, 36.0);
    let height = draw.between("H", 50.0, 57.0);
    let lift = nalgebra::Isometry3::translation(0.0, 0.0, main);
    let top = 2.0 * main + height;
    let tube = Solid::from(Convex::upright_cylinder(radius, [0.0; 2], main, top))
        .without(Convex::upright_cylinder(radius - WALL, [0.0; 2], main, top + 1.0));
    let solids = vec![Convex::cylinder(main, -150.0, 150.0).moved(&lift).into(), tube];
    let seam = saddle_seam(main, radius);
    let views = ring(6, -60.0, 45.0, 350.0, Point3::new(0.0, 0.0, 2.0 * main));
    Workpiece::new(solids, vec![seam], views)
}

/// Where the branch meets the main pipe, resampled to a station every millimetre or so.
fn saddle_seam(main: f64, radius: f64) -> TrueSeam {
    let height = |y: f64| (main * main - y * y).sqrt();
    let at = |turn: f64| {
        let (sin, cos) = sin_cos_deg(360.0 * turn);
        let (x, y) = (radius * cos, radius * sin);
        let z = height(y);
        let apex = Point3::new(x, y, main + z);
        let faces = [Vector3::new(cos, sin, 0.0), Vector3::new(0.0, y / main, z / main)];
        let tangent = Vector3::new(-y, x, -y * x / z).normalize();
        TrueStation { apex, root: apex, tangent, faces }
    };
    let fine: Vec<TrueStation> = (0..7200).map(|i| at(f64::from(i) / 7200.0)).collect();
    let mut lengths = vec![0.0];
    for pair in fine.windows(2) {
        lengths.push(lengths[lengths.len() - 1] + (pair[1].apex - pair[0].apex).norm());
    }
    let total = lengths[fine.len() - 1] + (fine[0].apex - fine[fine.len() - 1].apex).norm();
    let count = total.round();
    let station = |i: usize| {
        let s = total * i as f64 / count;
        fine[lengths.partition_point(|l| *l < s).min(fine.len() - 1)]
    };
    let stations = (0..count as usize).map(station).collect();
    TrueSeam { name: "saddle".into(), closed: true, required: true, stations }
}
