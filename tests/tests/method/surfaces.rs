//! The surfaces that a scan is taken apart into, and their borders, against the solids that were scanned.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use weldpath::geometry::grid::Grid;
use weldpath::pipeline::{Config, Evidence, Observer, plan};
use weldpath::seam::SurfaceModel;
use weldpath::seam::segmentation::{Border, Place, SeenSurface, SurfaceShape};
use weldpath::simulation::{Noise, Part, Request, Scene, SensorErrors, stage};
use weldpath_tests::scans::{read, shared};

/// Nothing was chosen on it.
const SEED: u64 = 47;

/// What a scan was taken apart into: points of its model, in the base frame, and what they are.
#[derive(Default)]
struct Taken {
    points_mm: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    places: Vec<Place>,
    surfaces: Vec<SeenSurface>,
}

impl Observer for Taken {
    fn evidence(&mut self, evidence: &Evidence) {
        let Evidence { merged, voxels, model, index, intensity, .. } = *evidence;
        let segmentation = evidence.segmentation.expect("a scan");
        let surface = SurfaceModel { voxels, cloud: model, index, asymmetries: &[] };
        self.points_mm = (0..model.len()).map(|k| model.in_base_mm(k)).collect();
        self.normals = model.normals.iter().map(|normal| normal.cast()).collect();
        self.places = segmentation.places(&surface, merged, intensity);
        self.surfaces = segmentation.surfaces();
    }
}

fn taken(part: Part, noise: Noise, sensor: SensorErrors) -> (Taken, Scene) {
    let request = Request { noise, sensor, ..Request::new(part, SEED) };
    let mut taken = Taken::default();
    // A box alone has no seam, and its surfaces all the same.
    let _ = plan(&read(shared(&request)).views, &Config::default(), &mut taken);
    assert!(!taken.places.is_empty(), "{part}");
    (taken, stage(&request).expect("a scene").scene)
}

/// A flat side of a solid: its normal and its level, in steps that tell sides apart.
type Side = [i32; 4];

impl Taken {
    /// The flat side that each point was seen on; none where nothing is, or no such side.
    fn sides(&self, scene: &Scene) -> Vec<Option<Side>> {
        const OVER_MM: f64 = 3.0;
        let side = |(p, n): (&Point3<f64>, &Vector3<f64>)| {
            let from = p + n * OVER_MM;
            let hit = scene.cast(from, -n).filter(|hit| hit.distance < 2.0 * OVER_MM)?;
            let level_mm = hit.normal.dot(&(from - n * hit.distance).coords);
            let [x, y, z] = [0, 1, 2].map(|k| (20.0 * hit.normal[k]).round() as i32);
            Some([x, y, z, level_mm.round() as i32])
        };
        self.points_mm.iter().zip(&self.normals).map(side).collect()
    }
}

/// Of pairs, the share that has the commonest second of its first.
fn agreeing<A: std::hash::Hash + Eq + Copy, B: std::hash::Hash + Eq>(
    pairs: impl Iterator<Item = (A, B)>,
) -> f64 {
    let mut counts: HashMap<A, HashMap<B, usize>> = HashMap::new();
    for (first, second) in pairs {
        *counts.entry(first).or_default().entry(second).or_default() += 1;
    }
    let all: usize = counts.values().flat_map(HashMap::values).sum();
    let most: usize = counts.values().filter_map(|of| of.values().max()).sum();
    most as f64 / all as f64
}

#[test]
fn surfaces_are_the_sides_of_what_was_scanned_pure_and_whole() {
    // A web that another crosses has two surfaces on each of its sides.
    for (part, least_whole) in
        [(Part::Fillet, 0.97), (Part::Lap, 0.97), (Part::Box, 0.97), (Part::Cruciform, 0.9)]
    {
        let (taken, scene) = taken(part, Noise::Mid, SensorErrors::default());
        let sides = taken.sides(&scene);
        let both = || {
            let known = taken.places.iter().zip(&sides);
            known.filter_map(|(place, side)| Some((place.surface?, (*side)?)))
        };
        let (pure, whole) = (agreeing(both()), agreeing(both().map(|(surface, side)| (side, surface))));
        let known = both().count() as f64 / taken.places.len() as f64;
        println!(
            "{part}: {:.1} % of a surface, {:.1} % pure, {:.1} % whole",
            100.0 * known,
            100.0 * pure,
            100.0 * whole
        );
        assert!(known > 0.95 && pure > 0.97 && whole > least_whole, "{part}");
    }
}

#[test]
fn a_pipe_is_one_cylinder_of_its_radius() {
    let (taken, _) = taken(Part::Pipe, Noise::Mid, SensorErrors::default());
    let count = |k: usize| taken.places.iter().filter(|place| place.surface == Some(k as u16)).count();
    let round = taken.surfaces.iter().enumerate().filter_map(|(k, surface)| match surface.shape {
        SurfaceShape::Cylinder { radius_mm } => Some((count(k), f64::from(radius_mm))),
        _ => None,
    });
    let (_, found_mm) = round.max_by_key(|(count, _)| *count).expect("a cylinder");
    let request = Request { noise: Noise::Mid, ..Request::new(Part::Pipe, SEED) };
    let params = &shared(&request).truth.params;
    let radius_mm = params["r"];
    assert!((found_mm - radius_mm).abs() < 0.2, "{found_mm} mm, true {radius_mm} mm");
}

#[test]
fn corners_are_told_inside_from_outside() {
    for (part, sensor) in [
        (Part::Fillet, SensorErrors::default()),
        (Part::Box, SensorErrors::default()),
        (Part::Fillet, SensorErrors { waves_mm: 0.8, ..SensorErrors::default() }),
    ] {
        let (taken, scene) = taken(part, Noise::Mid, sensor);
        let sides = taken.sides(&scene);
        let near: Vec<Point3<f32>> = taken.points_mm.iter().map(|p| p.cast()).collect();
        let grid = Grid::new(&near, 5.0);
        let (mut right, mut wrong) = (0, 0);
        for (k, place) in taken.places.iter().enumerate().filter(|(k, _)| k % 7 == 0) {
            let (Some(border @ (Border::Inside | Border::Outside)), Some(own)) = (place.border, sides[k])
            else {
                continue;
            };
            // The sum over points of another side beside it of their height over its own.
            let normal = |side: Side| Vector3::new(side[0], side[1], side[2]).cast::<f64>().normalize();
            let mut height_mm = 0.0;
            grid.within(&near[k], 5.0, |slot, _| {
                let other = grid.index(slot);
                if sides[other].is_some_and(|side| normal(side).dot(&normal(own)) < 0.5) {
                    height_mm += normal(own).dot(&(taken.points_mm[other] - taken.points_mm[k]));
                }
            });
            if height_mm != 0.0 {
                *(if (height_mm > 0.0) == (border == Border::Inside) { &mut right } else { &mut wrong }) += 1;
            }
        }
        println!("{part}: {right} right, {wrong} wrong");
        assert!(right > 100 && wrong * 20 < right, "{part}: {right} right, {wrong} wrong");
    }
}
