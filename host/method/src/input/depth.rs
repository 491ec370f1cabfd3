//! 16-bit depth images: each count becomes a point in front of a pinhole camera, but 0 and the largest, which cameras write
//! where they have no reading.
//!
//! All other readings are kept, near or far: what is noise or background is for later stages to say.

use std::io::Cursor;
use std::path::Path;

use nalgebra::{Isometry3, Point3};
use png::{BitDepth, ColorType, Decoder};

use super::camera::{Camera, Distortion, Intrinsics, Rays};
use super::memory::Limit;
use super::{CloudFrame, Error, Options, Scan, name_of, records, steps};
use crate::geometry::cloud::View;

/// What the images of a folder without intrinsics are taken for: the PrimeSense default of Open3D.
pub(super) const PRIMESENSE: Camera = Camera {
    width: 640,
    height: 480,
    fx: 525.0,
    fy: 525.0,
    cx: 319.5,
    cy: 239.5,
    depth_scale_m: 0.001,
    distortion: Distortion { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, k4: 0.0, k5: 0.0, k6: 0.0 },
};

/// Deflate grows its input by at most this (zlib's technical details).
const DEFLATE_GROWTH: u64 = 1032;

/// In memory: the count, the same without lone readings, the depth, and the point that it becomes.
const PIXEL_BYTES: u64 = 2 + 2 + 4 + 12;

/// The points of a depth image, mm, in the camera's frame: x right, y down, z forward.
pub(super) fn points_mm(
    bytes: &[u8],
    rays: &Rays,
    path: &Path,
    limit: Limit,
) -> Result<Vec<Point3<f32>>, Error> {
    Ok(points_of(&counts(bytes, &rays.camera, path, limit)?, rays))
}

/// The same of its counts, row by row; there are as many as the camera has pixels.
pub(super) fn points_of(counts: &[u16], rays: &Rays) -> Vec<Point3<f32>> {
    let camera = &rays.camera;
    let (slopes, mm_per_count) = (rays.slopes(), camera.depth_scale_m * 1000.0);
    let mut points = Vec::with_capacity(counts.len());
    let width = camera.width as usize;
    let depths = steps::restored(counts, width, 1.0 / camera.fx);
    for (row, depths) in depths.chunks_exact(width).enumerate() {
        for (column, &depth) in depths.iter().enumerate() {
            let [x, y] = slopes.at(column, row);
            if depth > 0.0 && x.is_finite() {
                let z = (f64::from(depth) * mm_per_count) as f32;
                points.push(Point3::new(x * z, y * z, z));
            }
        }
    }
    points
}

/// What a camera saw in its own frame, which is that of the base until a pose is known.
pub(super) fn view(name: String, points_mm: Vec<Point3<f32>>, rays: &Rays) -> View {
    View {
        name,
        points_mm,
        normals: Vec::new(),
        base_from_camera: Isometry3::identity(),
        camera_known: true,
        mesh: None,
        picture: rays.picture(),
    }
}

/// Depths of an image in counts, row by row.
fn counts(bytes: &[u8], camera: &Camera, path: &Path, limit: Limit) -> Result<Vec<u16>, Error> {
    let damaged = |e: png::DecodingError| damaged(&e, path);
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
    records::check_count(
        pixels,
        2,
        usize::try_from(most).unwrap_or(usize::MAX),
        "pixels",
        "PNG header",
        path,
    )?;
    limit.hold(path, bytes.len(), "pixels", pixels, PIXEL_BYTES + camera.ray_bytes())?;
    let mut reader = decoder.read_info().map_err(damaged)?;
    let mut counts = vec![0; 2 * pixels as usize];
    reader.next_frame(&mut counts).map_err(damaged)?;
    // PNG stores the high byte first.
    Ok(counts.chunks_exact(2).map(|pixel| u16::from_be_bytes([pixel[0], pixel[1]])).collect())
}

/// Columns and rows of an image, from its header.
pub(super) fn size_px(bytes: &[u8], path: &Path) -> Result<[u32; 2], Error> {
    let mut decoder = Decoder::new(Cursor::new(bytes));
    let header = decoder.read_header_info().map_err(|e| damaged(&e, path))?;
    Ok([header.width, header.height])
}

fn damaged(error: &png::DecodingError, path: &Path) -> Error {
    let help = "The image is cut off or damaged: copy or export it again";
    Error::malformed(path, "PNG data", error.to_string(), help)
}

/// The camera of images that come without, as the user gave it.
pub(super) fn given(
    intrinsics: &Intrinsics,
    bytes: &[u8],
    depth_scale_m: f64,
    path: &Path,
) -> Result<Camera, Error> {
    let camera = Camera::new(size_px(bytes, path)?, intrinsics, depth_scale_m);
    let help = "Give those of the depth stream with --intrinsics fx,fy,cx,cy[,k1,k2,p1,p2,k3]";
    match camera.fault() {
        Some((field, problem)) => Err(Error::malformed(path, field, problem, help)),
        None => Ok(camera),
    }
}

/// A depth image alone; what camera took it the user has to say.
pub(super) fn read_single(bytes: &[u8], path: &Path, options: &Options) -> Result<Scan, Error> {
    let Some(intrinsics) = &options.intrinsics else {
        let help = "Give them with --intrinsics fx,fy,cx,cy[,k1,k2,p1,p2,k3], or write a scan.json with its `camera`";
        return Err(Error::malformed(
            path,
            "PNG",
            "a depth image does not store its camera's intrinsics",
            help,
        ));
    };
    let depth_scale_m = options.depth_scale_m.unwrap_or(PRIMESENSE.depth_scale_m);
    let camera = given(intrinsics, bytes, depth_scale_m, path)?;
    let rays = Rays::new(camera);
    let mut scan = single(points_mm(bytes, &rays, path, options.memory)?, &rays, path)?;
    if options.depth_scale_m.is_none() {
        let words =
            "each step of the depth image is read as 1 mm; if it is another, say so with --depth-scale-m";
        scan.warnings.push(words.into());
    }
    Ok(scan)
}

/// The points of one image without a pose.
pub(super) fn single(points_mm: Vec<Point3<f32>>, rays: &Rays, path: &Path) -> Result<Scan, Error> {
    if points_mm.is_empty() {
        return Err(Error::empty(path, "every pixel is 0 or 65535, the marks of no reading"));
    }
    let mut scan = Scan::of(vec![view(name_of(path), points_mm, rays)], CloudFrame::Camera, path);
    scan.notes.push("frame: the camera's, since no pose is given".into());
    Ok(scan)
}

/// The warning that goes with [`PRIMESENSE`], of a folder of images.
pub(super) fn assumed_camera() -> String {
    let Camera { fx, cx, cy, depth_scale_m, .. } = PRIMESENSE;
    format!(
        "no intrinsics are given: those of a PrimeSense camera are assumed (f {fx}, c {cx} {cy}, \
         {depth_scale_m} m per count); sizes are wrong if it was another camera, so give them with \
         --intrinsics"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera {
        width: 3,
        height: 2,
        fx: 2.0,
        fy: 4.0,
        cx: 1.0,
        cy: 0.5,
        depth_scale_m: 0.0005,
        ..PRIMESENSE
    };

    fn png(width: u32, height: u32, color: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        bytes
    }

    fn grey(counts: &[u16; 6]) -> Vec<u8> {
        let data: Vec<u8> = counts.iter().flat_map(|c| c.to_be_bytes()).collect();
        png(3, 2, ColorType::Grayscale, BitDepth::Sixteen, &data)
    }

    #[test]
    fn a_count_becomes_a_point_on_the_ray_of_its_pixel() {
        let image = grey(&[65535, 0, 1000, 65534, 0, 1]);
        let points = points_mm(&image, &Rays::new(CAMERA), Path::new("d.png"), Limit::default()).unwrap();
        let expected = [[250.0, -62.5, 500.0], [-16383.5, 4095.875, 32767.0], [0.25, 0.0625, 0.5]];
        assert_eq!(points, expected.map(Point3::from));
    }

    #[test]
    fn a_distorted_image_of_a_wall_is_a_wall() {
        let distortion =
            Distortion { k1: -0.2, k2: 0.05, p1: 0.001, p2: -0.002, k3: 0.01, ..Distortion::default() };
        let camera = Camera { fx: 3.0, fy: 3.0, distortion, ..CAMERA };
        let points =
            points_mm(&grey(&[1000; 6]), &Rays::new(camera), Path::new("d.png"), Limit::default()).unwrap();
        for (k, p) in points.iter().enumerate() {
            assert_eq!(p.z, 500.0);
            // Shown again by the lens, the point falls on its pixel.
            let (x, y) = (f64::from(p.x / p.z), f64::from(p.y / p.z));
            let r2 = x * x + y * y;
            let radial = 1.0 - 0.2 * r2 + 0.05 * r2.powi(2) + 0.01 * r2.powi(3);
            let column = 3.0 * (x * radial + 0.002 * x * y - 0.002 * (r2 + 2.0 * x * x)) + 1.0;
            let row = 3.0 * (y * radial + 0.001 * (r2 + 2.0 * y * y) - 0.004 * x * y) + 0.5;
            assert!((column - (k % 3) as f64).abs() < 1e-6 && (row - (k / 3) as f64).abs() < 1e-6, "{k}");
        }
    }

    #[test]
    fn images_that_hold_no_depth_are_refused() {
        let refused = |bytes: &[u8], camera: &Camera, problem: &str| {
            let error = points_mm(bytes, &Rays::new(*camera), Path::new("d.png"), Limit::default())
                .unwrap_err()
                .to_string();
            assert!(error.contains("d.png") && error.contains(problem), "{error}");
        };
        refused(&png(3, 2, ColorType::Grayscale, BitDepth::Eight, &[0; 6]), &CAMERA, "Eight bits");
        refused(&png(3, 2, ColorType::Rgb, BitDepth::Sixteen, &[0; 36]), &CAMERA, "Rgb");
        refused(&grey(&[1; 6]), &Camera { width: 4, ..CAMERA }, "the image is 3x2, the camera 4x2");
        let whole = grey(&[1, 2, 3, 4, 5, 6]);
        refused(&whole[..whole.len() - 20], &CAMERA, "PNG data");
        let mut huge = whole.clone();
        huge[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff]);
        huge[29..33].copy_from_slice(&0x7f08_8c67u32.to_be_bytes());
        refused(&huge, &Camera { width: 65535, height: 65535, ..CAMERA }, "PNG");
    }

    #[test]
    fn a_camera_that_cannot_be_is_named_by_its_field() {
        assert_eq!(CAMERA.fault(), None);
        for (camera, field) in [
            (Camera { fx: 0.0, ..CAMERA }, "fx"),
            (Camera { fy: f64::NAN, ..CAMERA }, "fy"),
            (Camera { cx: f64::INFINITY, ..CAMERA }, "cx"),
            (Camera { distortion: Distortion { k2: f64::NAN, ..Distortion::default() }, ..CAMERA }, "k2"),
            (Camera { depth_scale_m: -1.0, ..CAMERA }, "depth_scale_m"),
            (Camera { depth_scale_m: 1.0, ..CAMERA }, "depth_scale_m"),
        ] {
            assert_eq!(camera.fault().map(|(field, _)| field), Some(field));
        }
    }
}
