//! One depth image: the camera's lines of sight cast into the scene, and the sensor's errors laid over what they meet.

use super::camera::{Camera, DepthImage, Seen};
use super::noise::{self, Imaging};
use super::random::Stream;
use super::scene::Scene;
use super::sensor;
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

impl Camera {
    /// One depth image of `scene` from `base_from_camera`. The same seed and view give the same image.
    pub fn capture(
        &self,
        scene: &Scene,
        base_from_camera: &Isometry3<f64>,
        imaging: &Imaging,
        seed: u64,
        view: u64,
    ) -> DepthImage {
        let seen = self.look(scene, base_from_camera, imaging, &Stream::new(seed, "jitter", view));
        let seen = imaging.errors.matched(seen, self.width as usize);
        noise::image(self, &seen, imaging, seed, view)
    }

    /// First surfaces, each along a line of sight that is off by the lateral jitter of the sensor.
    fn look(
        &self,
        scene: &Scene,
        pose: &Isometry3<f64>,
        imaging: &Imaging,
        jitter: &Stream,
    ) -> Vec<Option<Seen>> {
        let origin = Point3::from(pose.translation.vector);
        let jitter_px = imaging.noise.model().jitter_rad * self.focal_px;
        let filled_mm = imaging.errors.interreflection_mm;
        let width = self.width as usize;
        let pixel = |i: usize| {
            let mut random = jitter.at(i as u64);
            let column = (i % width) as f64 + jitter_px * random.gaussian();
            let row = (i / width) as f64 + jitter_px * random.gaussian();
            let direction = pose.rotation * self.ray(column, row);
            let hit = scene.cast(origin, direction)?;
            let incidence = -hit.normal.dot(&direction) / direction.norm();
            let lit = if filled_mm == 0.0 {
                0.0
            } else {
                sensor::lit_by_others(scene, origin + direction * hit.distance, &hit.normal)
            };
            Some(Seen { depth_mm: hit.distance - filled_mm * lit, incidence })
        };
        (0..width * self.height as usize).into_par_iter().map(pixel).collect()
    }
}
