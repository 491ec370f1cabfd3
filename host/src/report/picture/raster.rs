//! The points of a view as an image: nearest first, coloured by height, shaded by their normals, transparent elsewhere.

use super::super::colour::on_ramp;
use super::super::content::Scene;
use super::{HEIGHT, Projection, WIDTH};
use nalgebra::Vector3;
use weldpath_method::geometry::cloud::PointCloud;

/// Pixels of the image per px of the picture.
const FINE: f64 = 1.25;
/// Largest square of a point, pixels.
const LARGEST: f64 = 12.0;

/// More pixels than a point may lie outside without being put there, which changes nothing.
const OUTSIDE: f64 = 65536.0;

struct Image {
    width: usize,
    height: usize,
    toward_mm: Vec<f64>,
    rgba: Vec<[u8; 4]>,
}

/// Colour of each point before it is shaded, 0..255: by height, and paler away from the work.
pub(super) fn colours(model: &PointCloud, scene: &Scene) -> Vec<[f32; 3]> {
    let [low, high] = scene.heights_mm;
    let of = |i: usize| {
        let v = model.in_base_mm(i) - scene.centre_mm;
        // Points beside the work are drawn paler, as on the page.
        let plain = 0.75 * ((v.norm() / scene.radius_mm - 1.1) / 0.4).clamp(0.0, 1.0);
        let [r, g, b] = on_ramp((scene.up.dot(&v) - low) / (high - low)).map(f64::from);
        [(r, 196.0), (g, 204.0), (b, 214.0)].map(|(c, grey)| ((1.0 - plain) * c + plain * grey) as f32)
    };
    (0..model.len()).map(of).collect()
}

/// A PNG of the model as `projection` shows it, in `colours`; every point is a square of about `size_mm`.
pub(super) fn png(
    model: &PointCloud,
    colours: &[[f32; 3]],
    projection: &Projection,
    size_mm: f64,
) -> Vec<u8> {
    let (width, height) = ((WIDTH * FINE) as usize, (HEIGHT * FINE) as usize);
    let mut image = Image {
        width,
        height,
        toward_mm: vec![f64::NEG_INFINITY; width * height],
        rgba: vec![[0; 4]; width * height],
    };
    let size = (1.3 * size_mm * projection.px_per_mm * FINE).clamp(1.0, LARGEST);
    let toward: Vector3<f32> = projection.toward.cast();
    for (i, colour) in colours.iter().enumerate() {
        let (place, toward_mm) = projection.place(&model.in_base_mm(i));
        let facing = model.normals.get(i).map_or(1.0, |n| n.dot(&toward).abs());
        let [r, g, b] = colour.map(|c| (c * (0.45 + 0.55 * facing)) as u8);
        image.square(place.coords.into(), size, toward_mm, [r, g, b, 255]);
    }
    image.encode().unwrap_or_default()
}

impl Image {
    fn square(&mut self, [x, y]: [f64; 2], size: f64, toward_mm: f64, colour: [u8; 4]) {
        let pixels = size.round() as i64;
        let span = |c: f64, end: usize| {
            // Cast instead of `round`, which is a function call here; coordinates far outside saturate.
            let from = (c * FINE - 0.5 * size + 0.5 + OUTSIDE) as i64 - OUTSIDE as i64;
            let pixel = |at: i64| at.clamp(0, end as i64) as usize;
            pixel(from)..pixel(from + pixels)
        };
        for row in span(y, self.height) {
            for k in span(x, self.width).map(|column| row * self.width + column) {
                if toward_mm > self.toward_mm[k] {
                    (self.toward_mm[k], self.rgba[k]) = (toward_mm, colour);
                }
            }
        }
    }

    fn encode(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        encoder.write_header()?.write_image_data(self.rgba.as_flattened())?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearer_point_hides_the_one_behind() {
        let mut image =
            Image { width: 8, height: 8, toward_mm: vec![f64::NEG_INFINITY; 64], rgba: vec![[0; 4]; 64] };
        image.square([2.0, 2.0], 3.0, 1.0, [1, 1, 1, 255]);
        image.square([2.0, 2.0], 3.0, 0.5, [2, 2, 2, 255]);
        image.square([-50.0, 2.0], 3.0, 9.0, [3, 3, 3, 255]);
        let of = |value: u8| image.rgba.iter().filter(|c| c[0] == value).count();
        assert_eq!((of(1), of(2), of(3), of(0)), (9, 0, 0, 55));
    }
}
