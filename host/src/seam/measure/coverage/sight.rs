//! What each camera measured in which direction: whether it saw a place, something before it, or through it.

use std::collections::HashMap;

use nalgebra::{Point3, Unit, Vector3};

use crate::geometry::cloud::Merged;

/// Edge of a cell of directions, as a tangent: 2.4 mm at 300 mm.
const CELL: f32 = 0.008;
/// Readings that are kept at least: several to a cell of a depth image.
const READINGS: usize = 300_000;
/// What is so much nearer or farther is something else, mm.
const APART_MM: f32 = 5.0;

/// What a camera knows of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sight {
    /// A surface at the place.
    At,
    /// A surface behind it: nothing is there.
    Through,
    /// A surface before it, or nothing measured in that direction.
    Hidden,
}

/// One camera's nearest and farthest reading in each direction, mm.
struct Camera {
    at_mm: Point3<f32>,
    axes: [Vector3<f32>; 3],
    depths_mm: HashMap<(i32, i32), [f32; 2]>,
}

/// All cameras of a scan.
pub(super) struct Sights(Vec<Camera>);

impl Sights {
    pub(super) fn new(merged: &Merged) -> Self {
        let mut sums = vec![(Vector3::zeros(), 0usize); merged.cameras_mm.len()];
        for (p, &view) in merged.points_mm.iter().zip(&merged.view) {
            let sum = &mut sums[usize::from(view)];
            *sum = (sum.0 + (p - merged.cameras_mm[usize::from(view)]), sum.1 + 1);
        }
        let cameras = merged.cameras_mm.iter().zip(&sums).map(|(at_mm, (sum, _))| Camera::new(*at_mm, sum));
        let mut sights = Self(cameras.collect());
        let step = (merged.points_mm.len() / READINGS).max(1);
        for (p, &view) in merged.points_mm.iter().zip(&merged.view).step_by(step) {
            sights.0[usize::from(view)].add(p);
        }
        sights
    }

    /// Whether any camera knows this of a place.
    pub(super) fn any(&self, place: &Point3<f32>, sight: Sight) -> bool {
        self.0.iter().any(|camera| camera.sight(place) == sight)
    }
}

impl Camera {
    fn new(at_mm: Point3<f32>, toward: &Vector3<f32>) -> Self {
        let axis = Unit::try_new(*toward, 1e-6).unwrap_or(Vector3::z_axis()).into_inner();
        let mut least = Vector3::zeros();
        least[axis.iamin()] = 1.0;
        let right = axis.cross(&least).normalize();
        Self { at_mm, axes: [right, axis.cross(&right), axis], depths_mm: HashMap::new() }
    }

    /// Cell of a direction and distance along the axis; none behind the camera.
    fn cell(&self, place: &Point3<f32>) -> Option<((i32, i32), f32)> {
        let ray = place - self.at_mm;
        let [u, v, depth] = self.axes.map(|axis| axis.dot(&ray));
        let cell = |c: f32| (c / depth / CELL).floor() as i32;
        (depth > 1.0).then(|| ((cell(u), cell(v)), depth))
    }

    fn add(&mut self, point: &Point3<f32>) {
        if let Some((cell, depth)) = self.cell(point) {
            let known = self.depths_mm.entry(cell).or_insert([depth, depth]);
            *known = [known[0].min(depth), known[1].max(depth)];
        }
    }

    fn sight(&self, place: &Point3<f32>) -> Sight {
        let known = self.cell(place).and_then(|(cell, depth)| Some((self.depths_mm.get(&cell)?, depth)));
        match known {
            Some(([nearest, _], depth)) if *nearest > depth + APART_MM => Sight::Through,
            Some(([_, farthest], depth)) if *farthest > depth - APART_MM => Sight::At,
            _ => Sight::Hidden,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn before_a_wall_is_seen_through_on_it_is_at_and_behind_it_is_hidden() {
        let wall = |i: usize| Point3::new((i % 100) as f32 - 50.0, (i / 100) as f32 - 50.0, 300.0);
        let merged = Merged {
            points_mm: (0..10_000).map(wall).collect(),
            view: vec![0; 10_000],
            cameras_mm: vec![Point3::origin()],
            ..Merged::default()
        };
        let sights = Sights::new(&merged);
        for (z, expected) in [(250.0, Sight::Through), (299.0, Sight::At), (350.0, Sight::Hidden)] {
            assert!(sights.any(&Point3::new(3.0, 4.0, z), expected), "{z}");
        }
        assert!(sights.any(&Point3::new(200.0, 4.0, 250.0), Sight::Hidden), "beside what was measured");
        assert!(sights.any(&Point3::new(0.0, 0.0, -50.0), Sight::Hidden), "behind the camera");
    }
}
