//! A depth camera: what it sees from a pose, with the errors of a structured-light or stereo sensor.
//!
//! Depth is the coordinate along the optical axis, as in a depth image; x to the right, y down. Millimetres.

use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// Pinhole camera, with radial distortion where it has any.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length along columns and rows, pixels.
    pub focal_px: f64,
    /// Column and row of the optical axis, pixels; pixel centres are whole numbers.
    pub centre_px: [f64; 2],
    /// Millimetres per count of the depth image.
    pub depth_scale_mm: f64,
    /// First radial coefficient of Brown-Conrady.
    pub k1: f64,
}

/// Nearest and farthest depth the camera reports, mm.
pub const RANGE_MM: [f64; 2] = [100.0, 900.0];

/// Counts per pixel, row by row; 0 where there is no reading.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Depth in units of [`Camera::depth_scale_mm`].
    pub counts: Vec<u16>,
    /// Depths beyond what a count can say, mm by pixel; their counts are saturated.
    pub beyond_mm: BTreeMap<usize, f64>,
}

/// The surface in one pixel before the sensor's own errors.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Depth, mm.
    pub(super) depth_mm: f64,
    /// Cosine of the angle between line of sight and normal.
    pub(super) incidence: f64,
}

impl Camera {
    /// A camera of 56 degrees field of view, 71 degrees from a width of 1280 on; 0.05 mm per count.
    pub fn with_size(width: u32, height: u32) -> Self {
        let ratio = if width >= 1280 { 900.0 / 1280.0 } else { 600.0 / 640.0 };
        Self {
            width,
            height,
            focal_px: f64::from(width) * ratio,
            centre_px: [0.5 * (f64::from(width) - 1.0), 0.5 * (f64::from(height) - 1.0)],
            depth_scale_mm: 0.05,
            k1: 0.0,
        }
    }

    /// Line of sight through a place in the image, with a depth of 1.
    pub fn ray(&self, column_px: f64, row_px: f64) -> Vector3<f64> {
        let x = (column_px - self.centre_px[0]) / self.focal_px;
        let y = (row_px - self.centre_px[1]) / self.focal_px;
        let straight = self.straightening(x * x + y * y);
        Vector3::new(x * straight, y * straight, 1.0)
    }

    /// What a distorted place in the image, at this squared distance from the axis, is to be multiplied by.
    fn straightening(&self, squared: f64) -> f64 {
        let step = |scale: f64| 1.0 / (1.0 + self.k1 * squared * scale * scale);
        // Each step divides what is left by more than 1 / (2 k1 r^2), which is 3 for the strongest lens that may be asked for.
        if self.k1 == 0.0 { 1.0 } else { (0..30).fold(1.0, |scale, _| step(scale)) }
    }

    /// Column and row of a point in the camera frame, if it is in the image.
    pub fn project(&self, point_mm: &Point3<f64>) -> Option<[f64; 2]> {
        let (x, y) = (point_mm.x / point_mm.z, point_mm.y / point_mm.z);
        let bent = self.focal_px * (1.0 + self.k1 * (x * x + y * y));
        let (column, row) = (bent * x + self.centre_px[0], bent * y + self.centre_px[1]);
        let inside = point_mm.z > 0.0
            && (0.0..f64::from(self.width)).contains(&column)
            && (0.0..f64::from(self.height)).contains(&row);
        inside.then_some([column, row])
    }
}

impl DepthImage {
    /// Points in the camera frame, mm, row by row, where there is a reading.
    pub fn points_mm(&self, camera: &Camera) -> Vec<Point3<f64>> {
        let width = self.width as usize;
        let point = |(i, &count): (usize, &u16)| {
            let counted_mm = f64::from(count) * camera.depth_scale_mm;
            let depth_mm = self.beyond_mm.get(&i).copied().unwrap_or(counted_mm);
            Point3::from(camera.ray((i % width) as f64, (i / width) as f64) * depth_mm)
        };
        self.counts.iter().enumerate().filter(|(_, count)| **count > 0).map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::noise::Noise;
    use super::super::rotation::about;
    use super::super::scene::Scene;
    use super::*;
    use nalgebra::Isometry3;

    fn table(height_mm: f64) -> Scene {
        Scene::new(Vec::new(), height_mm)
    }

    fn looking_down(height_mm: f64) -> Isometry3<f64> {
        Isometry3::from_parts(nalgebra::Translation3::new(10.0, 20.0, height_mm), about(Vector3::x(), 180.0))
    }

    #[test]
    fn a_camera_without_noise_sees_a_table_at_its_height() {
        let camera = Camera::with_size(64, 48);
        let image = camera.capture(&table(40.0), &looking_down(440.0), &Noise::None.into(), 1, 0);
        assert_eq!(image.counts, vec![8000; 64 * 48]);
        for point in image.points_mm(&camera) {
            assert!(((looking_down(440.0) * point).z - 40.0).abs() < 1e-9);
        }
    }

    #[test]
    fn noise_grows_with_the_square_of_the_depth() {
        let camera = Camera::with_size(320, 240);
        let spread_mm = |depth_mm: f64| {
            let image = camera.capture(&table(0.0), &looking_down(depth_mm), &Noise::Mid.into(), 3, 0);
            let near = |c: &&u16| (f64::from(**c) * 0.05 - depth_mm).abs() < 5.0;
            let errors: Vec<f64> =
                image.counts.iter().filter(near).map(|c| f64::from(*c) * 0.05 - depth_mm).collect();
            (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
        };
        let (near_mm, far_mm) = (spread_mm(350.0), spread_mm(500.0));
        assert!((0.30..0.45).contains(&near_mm), "{near_mm}");
        let growth = far_mm / near_mm;
        assert!((growth - (500.0_f64 / 350.0).powi(2)).abs() < 0.15, "{growth}");
    }

    #[test]
    fn beyond_the_range_there_is_no_reading() {
        let camera = Camera::with_size(64, 48);
        let image = camera.capture(&table(0.0), &looking_down(1000.0), &Noise::None.into(), 1, 0);
        assert!(image.counts.iter().all(|c| *c == 0));
    }
}
