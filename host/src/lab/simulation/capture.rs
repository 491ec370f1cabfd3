//! One depth image: the camera's lines of sight cast into the scene, and the sensor's errors laid over what they meet.

use super::camera::{Camera, DepthImage, Seen};
use super::noise::{self, Noise};
use super::random::Stream;
use super::scene::Scene;
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

impl Camera {
    /// One depth image of `scene` from `base_from_camera`. The same seed and view give the same image.
    pub fn capture(
        &self,
        scene: &Scene,
        base_from_camera: &Isometry3<f64>,
        noise: Noise,
        seed: u64,
        view: u64,
    ) -> DepthImage {
        let seen = self.look(scene, base_from_camera, noise, &Stream::new(seed, "jitter", view));
        noise::image(self, &seen, noise, seed, view)
    }

    /// First surfaces, each along a line of sight that is off by the lateral jitter of the sensor.
    fn look(&self, scene: &Scene, pose: &Isometry3<f64>, noise: Noise, jitter: &Stream) -> Vec<Option<Seen>> {
        let origin = Point3::from(pose.translation.vector);
        let jitter_px = noise.model().jitter_rad * self.focal_px;
        let width = self.width as usize;
        let pixel = |i: usize| {
            let mut random = jitter.at(i as u64);
            let column = (i % width) as f64 + jitter_px * random.gaussian();
            let row = (i / width) as f64 + jitter_px * random.gaussian();
            let direction = pose.rotation * self.ray(column, row);
            let hit = scene.cast(origin, direction)?;
            let incidence = -hit.normal.dot(&direction) / direction.norm();
            Some(Seen { depth_mm: hit.distance, incidence })
        };
        (0..width * self.height as usize).into_par_iter().map(pixel).collect()
    }
}
