//! 16-bit depth images: each count that is not 0 becomes a point in front of a pinhole camera.
//!
//! All readings are kept, near or far: what is noise or background is for later stages to say.

use std::io::Cursor;
use std::path::Path;

use nalgebra::{Isometry3, Point3};
use png::{BitDepth, ColorType, Decoder};
use serde::Deserialize;

use super::{Error, Scan, fast, name_of};
use crate::cloud::View;

/// Pinhole intrinsics, in pixels, and the size of a count.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(super) struct Camera {
    pub width: u32,
    pub height: u32,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    /// Metres per count.
    pub depth_scale_m: f64,
}

/// What a 640x480 image without intrinsics is taken for: the PrimeSense default of Open3D.
pub(super) const PRIMESENSE: Camera =
    Camera { width: 640, height: 480, fx: 525.0, fy: 525.0, cx: 319.5, cy: 239.5, depth_scale_m: 0.001 };

/// Deflate grows its input by at most this (zlib's technical details).
const DEFLATE_GROWTH: u64 = 1032;

/// What a focal length or an image's centre can be, in pixels.
const PIXELS: std::ops::RangeInclusive<f64> = 1.0..=1e6;

impl Camera {
    /// The first field that no camera can have, and why.
    pub(super) fn fault(&self) -> Option<(&'static str, String)> {
        let focal = [("fx", self.fx), ("fy", self.fy)].into_iter().find(|(_, v)| !PIXELS.contains(v));
        let centre =
            [("cx", self.cx), ("cy", self.cy)].into_iter().find(|(_, v)| !PIXELS.contains(&v.abs().max(1.0)));
        if let Some((name, value)) = focal.or(centre) {
            Some((name, format!("{value} is no number of pixels that a lens could have")))
        } else if !(self.depth_scale_m.is_finite() && self.depth_scale_m > 0.0) {
            Some(("depth_scale_m", format!("{} is not above 0", self.depth_scale_m)))
        } else if self.depth_scale_m > 0.1 {
            Some((
                "depth_scale_m",
                format!("{} m per count is too coarse for any scanner", self.depth_scale_m),
            ))
        } else {
            None
        }
    }
}

/// The points of a depth image, mm, in the camera's frame: x right, y down, z forward.
pub(super) fn points_mm(bytes: &[u8], camera: &Camera, path: &Path) -> Result<Vec<Point3<f32>>, Error> {
    let counts = counts(bytes, camera, path)?;
    let mm_per_count = camera.depth_scale_m * 1000.0;
    let column = |u: u32| ((f64::from(u) - camera.cx) / camera.fx) as f32;
    let columns: Vec<f32> = (0..camera.width).map(column).collect();
    let mut points = Vec::with_capacity(counts.len() / 2);
    for (v, row) in counts.chunks_exact(2 * columns.len()).enumerate() {
        let y = ((v as f64 - camera.cy) / camera.fy) as f32;
        for (pixel, x) in row.chunks_exact(2).zip(&columns) {
            let count = u16::from_be_bytes([pixel[0], pixel[1]]);
            if count > 0 {
                let z = (f64::from(count) * mm_per_count) as f32;
                points.push(Point3::new(x * z, y * z, z));
            }
        }
    }
    Ok(points)
}

/// The image as PNG stores it: two bytes a pixel, the high one first.
fn counts(bytes: &[u8], camera: &Camera, path: &Path) -> Result<Vec<u8>, Error> {
    let damaged = |e: png::DecodingError| {
        Error::malformed(
            path,
            "PNG data",
            e.to_string(),
            "The image is cut off or damaged: copy or export it again",
        )
    };
    let mut decoder = Decoder::new(Cursor::new(bytes));
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(damaged)?;
    if (header.color_type, header.bit_depth) != (ColorType::Grayscale, BitDepth::Sixteen) {
        let found = format!("the image is {:?} with {:?} bits", header.color_type, header.bit_depth);
        let help = "A depth image is 16-bit greyscale; a colour picture of the depth has lost it";
        return Err(Error::malformed(path, "PNG header", found, help));
    }
    if (header.width, header.height) != (camera.width, camera.height) {
        let problem = format!(
            "the image is {}x{}, the camera {}x{}",
            header.width, header.height, camera.width, camera.height
        );
        let help = "Give the intrinsics of the depth stream in scan.json, not those of the colour stream";
        return Err(Error::malformed(path, "PNG header", problem, help));
    }
    let pixels = u64::from(header.width) * u64::from(header.height);
    let most = (bytes.len() as u64).saturating_mul(DEFLATE_GROWTH);
    fast::check_count(pixels, 2, usize::try_from(most).unwrap_or(usize::MAX), "pixels", "PNG header", path)?;
    let mut reader = decoder.read_info().map_err(damaged)?;
    let mut counts = vec![0; 2 * pixels as usize];
    reader.next_frame(&mut counts).map_err(damaged)?;
    Ok(counts)
}

/// A depth image alone, with nothing that says what camera took it.
pub(super) fn read_single(bytes: &[u8], path: &Path) -> Result<Scan, Error> {
    let points_mm = points_mm(bytes, &PRIMESENSE, path)?;
    if points_mm.is_empty() {
        return Err(Error::empty(path, "every pixel is 0, the mark of no reading"));
    }
    let view = View {
        name: name_of(path),
        points_mm,
        normals: Vec::new(),
        base_from_camera: Isometry3::identity(),
        camera_known: true,
    };
    Ok(Scan {
        views: vec![view],
        notes: vec!["frame: the camera's, since no pose is given".into()],
        warnings: vec![assumed_camera()],
        inputs: vec![path.into()],
    })
}

/// The warning that goes with [`PRIMESENSE`].
pub(super) fn assumed_camera() -> String {
    let Camera { fx, cx, cy, depth_scale_m, .. } = PRIMESENSE;
    format!(
        "no intrinsics are given: taken are those of a PrimeSense camera (f {fx}, c {cx} {cy}, {depth_scale_m} m per \
         count); sizes are wrong if it was another, so write a scan.json with its `camera`"
    )
}
