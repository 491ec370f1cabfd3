//! A simulated scan as a folder: `scan.json`, one file per view, `truth.json`. Metres, as scanners write them.

use super::request::{Error, Format};
use super::{Camera, DepthImage, Simulated};
use serde::Serialize;
use std::io;
use std::path::Path;
use weldpath_files::{File, Writer};

/// Metres per millimetre.
const M_PER_MM: f64 = 1e-3;

#[derive(Serialize)]
struct ScanFile {
    units: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    camera: Option<CameraEntry>,
    flange_from_camera: [[f64; 4]; 4],
    views: Vec<ViewEntry>,
}

#[derive(Serialize)]
struct CameraEntry {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    depth_scale_m: f64,
}

#[derive(Serialize)]
struct ViewEntry {
    #[serde(skip_serializing_if = "Option::is_none")]
    depth: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cloud: Option<String>,
    base_from_flange: [f64; 6],
}

/// Writes `scan` into `folder`, which is made if need be: all of it, or nothing.
pub fn write(scan: &Simulated, folder: &Path) -> Result<(), Error> {
    Writer::new(folder).write(&files(scan)?)?;
    Ok(())
}

/// `scan` as the files of a folder.
pub fn files(scan: &Simulated) -> Result<Vec<File>, Error> {
    let made = |name: String, bytes: io::Result<Vec<u8>>| match bytes {
        Ok(bytes) => Ok(File::new(name, bytes)),
        Err(source) => Err(Error::Encode { name, source }),
    };
    let views = scan.views.iter().enumerate().map(|(i, view)| {
        let bytes = match scan.format {
            Format::Png => png_bytes(&view.image),
            Format::Ply => Ok(ply_bytes(&view.image, &scan.camera)),
        };
        made(view_name(scan.format, i), bytes)
    });
    let lists = [
        made("truth.json".into(), json_bytes(&scan.truth, false)),
        made("scan.json".into(), json_bytes(&scan_file(scan), true)),
    ];
    views.chain(lists).collect()
}

fn view_name(format: Format, i: usize) -> String {
    format!("view_{i:03}.{format}")
}

fn scan_file(scan: &Simulated) -> ScanFile {
    let camera = &scan.camera;
    let matrix = scan.flange_from_camera.to_homogeneous();
    let unit = |row: usize, column: usize| if row < 3 && column == 3 { M_PER_MM } else { 1.0 };
    let entry = |row, column| super::rotation::round_to(matrix[(row, column)] * unit(row, column), 1e-12);
    let view = |(i, view): (usize, &super::SimulatedView)| {
        let pose = view.base_from_flange;
        let [x, y, z]: [f64; 3] =
            pose.position_mm.map(|v| super::rotation::round_to(v * M_PER_MM, 1e-9)).into();
        let [rx, ry, rz]: [f64; 3] = pose.rotation_rad.into();
        let name = view_name(scan.format, i);
        let (depth, cloud) = match scan.format {
            Format::Png => (Some(name), None),
            Format::Ply => (None, Some(name)),
        };
        ViewEntry { depth, cloud, base_from_flange: [x, y, z, rx, ry, rz] }
    };
    ScanFile {
        units: "m",
        camera: (scan.format == Format::Png).then_some(CameraEntry {
            width: camera.width,
            height: camera.height,
            fx: camera.focal_px,
            fy: camera.focal_px,
            cx: camera.centre_px[0],
            cy: camera.centre_px[1],
            depth_scale_m: camera.depth_scale_mm * M_PER_MM,
        }),
        flange_from_camera: std::array::from_fn(|row| std::array::from_fn(|column| entry(row, column))),
        views: scan.views.iter().enumerate().map(view).collect(),
    }
}

fn json_bytes(value: &impl Serialize, pretty: bool) -> io::Result<Vec<u8>> {
    let text = if pretty { serde_json::to_vec_pretty(value) } else { serde_json::to_vec(value) };
    let mut bytes = text.map_err(io::Error::other)?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// 16-bit grey; rows filtered and packed the same way everywhere.
fn png_bytes(image: &DepthImage) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width, image.height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    // The noise of a camera packs no better with more work: the highest level takes 17 times as long for 2 %.
    encoder.set_filter(png::Filter::Adaptive);
    encoder.set_deflate_compression(png::DeflateCompression::Level(3));
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    let samples: Vec<u8> = image.counts.iter().flat_map(|count| count.to_be_bytes()).collect();
    writer.write_image_data(&samples).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)?;
    Ok(bytes)
}

/// Points with a reading, single precision, metres.
fn ply_bytes(image: &DepthImage, camera: &Camera) -> Vec<u8> {
    let points = image.points_mm(camera);
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        points.len()
    );
    let coordinates = points.iter().flat_map(|p| [p.x, p.y, p.z]);
    let body = coordinates.flat_map(|x| ((x * M_PER_MM) as f32).to_le_bytes());
    header.into_bytes().into_iter().chain(body).collect()
}
