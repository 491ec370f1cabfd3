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
/// Nearer than this there is nothing before a camera, mm; and shorter vectors have no direction.
const NEAREST_MM: f32 = 1.0;
const LEAST_LENGTH: f32 = 1e-6;

/// What a camera knows of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Visibility {
    /// A surface at the place.
    At,
    /// A surface behind it: nothing is there.
    Through,
    /// A surface before it, or nothing measured in that direction.
    Hidden,
}

/// One camera's nearest and farthest reading in each direction, mm.
struct CameraView {
    at_mm: Point3<f32>,
    axes: [Vector3<f32>; 3],
    depths_mm: HashMap<(i32, i32), [f32; 2]>,
}

/// All cameras of a scan.
pub(super) struct Panorama(Vec<CameraView>);

impl Panorama {
    pub(super) fn new(merged: &Merged) -> Self {
        let mut sums = vec![(Vector3::zeros(), 0usize); merged.cameras_mm.len()];
        for (p, &view) in merged.points_mm.iter().zip(&merged.view) {
            let sum = &mut sums[usize::from(view)];
            *sum = (sum.0 + (p - merged.cameras_mm[usize::from(view)]), sum.1 + 1);
        }
        let cameras =
            merged.cameras_mm.iter().zip(&sums).map(|(at_mm, (sum, _))| CameraView::new(*at_mm, sum));
        let mut sights = Self(cameras.collect());
        let step = (merged.points_mm.len() / READINGS).max(1);
        for (p, &view) in merged.points_mm.iter().zip(&merged.view).step_by(step) {
            sights.0[usize::from(view)].add(p);
        }
        sights
    }

    /// Whether any camera knows this of a place.
    pub(super) fn any(&self, place: &Point3<f32>, sight: Visibility) -> bool {
        self.0.iter().any(|camera| camera.sight(place) == sight)
    }
}

impl CameraView {
    fn new(at_mm: Point3<f32>, toward: &Vector3<f32>) -> Self {
        let axis = Unit::try_new(*toward, LEAST_LENGTH).unwrap_or(Vector3::z_axis()).into_inner();
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
        (depth > NEAREST_MM).then(|| ((cell(u), cell(v)), depth))
    }

    fn add(&mut self, point: &Point3<f32>) {
        if let Some((cell, depth)) = self.cell(point) {
            let known = self.depths_mm.entry(cell).or_insert([depth, depth]);
            *known = [known[0].min(depth), known[1].max(depth)];
        }
    }

    fn sight(&self, place: &Point3<f32>) -> Visibility {
        let known = self.cell(place).and_then(|(cell, depth)| Some((self.depths_mm.get(&cell)?, depth)));
        match known {
            Some(([nearest, _], depth)) if *nearest > depth + APART_MM => Visibility::Through,
            Some(([_, farthest], depth)) if *farthest > depth - APART_MM => Visibility::At,
            _ => Visibility::Hidden,
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
        let sights = Panorama::new(&merged);
        for (z, expected) in
            [(250.0, Visibility::Through), (299.0, Visibility::At), (350.0, Visibility::Hidden)]
        {
            assert!(sights.any(&Point3::new(3.0, 4.0, z), expected), "{z}");
        }
        assert!(sights.any(&Point3::new(200.0, 4.0, 250.0), Visibility::Hidden), "beside what was measured");
        assert!(sights.any(&Point3::new(0.0, 0.0, -50.0), Visibility::Hidden), "behind the camera");
    }
}
