//! `model.ply`: points and normals, binary little endian, base frame, mm. Any point-cloud viewer opens it.
//!
//! [`read`] takes back what [`write()`] wrote, normals and all; clouds from elsewhere are read by the scan readers.

use nalgebra::{Point3, Vector3};

use super::frame::PathFrame;
use weldpath_method::geometry::cloud::PointCloud;

/// Beyond this a single-precision millimetre is coarser than a micrometre, and `double` is written.
const SINGLE_PRECISION_MM: f64 = 8192.0;

/// The whole file, in the coordinates of `frame`.
pub fn write(cloud: &PointCloud, frame: PathFrame) -> Vec<u8> {
    let double = (0..cloud.len()).any(|i| cloud.in_base_mm(i).coords.amax() > SINGLE_PRECISION_MM);
    let mut bytes = header(cloud, if double { "double" } else { "float" }, frame).into_bytes();
    bytes.reserve(cloud.len() * if double { 36 } else { 24 });
    for i in 0..cloud.len() {
        for value_mm in cloud.in_base_mm(i).iter() {
            if double {
                bytes.extend(value_mm.to_le_bytes());
            } else {
                bytes.extend((*value_mm as f32).to_le_bytes());
            }
        }
        if has_normals(cloud) {
            bytes.extend(cloud.normals[i].iter().flat_map(|value| value.to_le_bytes()));
        }
    }
    bytes
}

/// A cloud early in the pipeline may not have its normals yet: then the file has none.
fn header(cloud: &PointCloud, number: &str, frame: PathFrame) -> String {
    let whose = match frame {
        PathFrame::Base => "robot base frame",
        PathFrame::Camera => "the camera's frame",
        PathFrame::Unknown => "the scan's own frame",
    };
    let mut lines = vec!["ply".to_owned(), "format binary_little_endian 1.0".to_owned()];
    lines.push(format!("comment weldpath: {whose}, millimetres"));
    lines.push(format!("element vertex {}", cloud.len()));
    lines.extend(["x", "y", "z"].map(|name| format!("property {number} {name}")));
    if has_normals(cloud) {
        lines.extend(["nx", "ny", "nz"].map(|name| format!("property float {name}")));
    }
    lines.push("end_header\n".to_owned());
    lines.join("\n")
}

fn has_normals(cloud: &PointCloud) -> bool {
    cloud.normals.len() == cloud.len()
}

/// Why a file is not one of [`write()`]'s.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("not a model.ply of weldpath ({0}); plan again, or copy the file anew")]
pub struct Error(String);

/// Reads what [`write()`] wrote, with its normals. Points are kept relative to the first one.
pub fn read(bytes: &[u8]) -> Result<PointCloud, Error> {
    let other = |what: &str| Error(what.into());
    let marker = b"end_header\n";
    let end = bytes.windows(marker.len()).take(MOST_HEADER_BYTES).position(|w| w == marker);
    let end = end.ok_or_else(|| other("it has no header"))? + marker.len();
    let header = std::str::from_utf8(&bytes[..end]).map_err(|_| other("its header is not text"))?;
    let stated = |line: &str| header.lines().any(|l| l == line);
    let double = stated("property double x");
    let known = stated("format binary_little_endian 1.0") && stated("property float nz");
    let count = header.lines().find_map(|line| line.strip_prefix("element vertex ")?.parse::<usize>().ok());
    let (true, Some(count)) = (known, count) else { return Err(other("its header is another one")) };
    let place_bytes = if double { 24 } else { 12 };
    let rows = bytes[end..].chunks_exact(place_bytes + 12);
    if rows.len() != count || !rows.remainder().is_empty() {
        return Err(Error(format!("it holds {} points, its header says {count}", rows.len())));
    }
    let single = |row: &[u8]| -> Vec<f64> {
        row.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))).collect()
    };
    let place = |row: &[u8]| match double {
        true => {
            row[..24].chunks_exact(8).filter_map(|b| Some(f64::from_le_bytes(b.try_into().ok()?))).collect()
        }
        false => single(&row[..12]),
    };
    let mut cloud = PointCloud::default();
    for (k, row) in rows.enumerate() {
        let (p, n) = (place(row), single(&row[place_bytes..]));
        if p.iter().chain(&n).any(|value| !value.is_finite()) {
            return Err(Error(format!("point {k} is not a number")));
        }
        let p = Point3::from_slice(&p);
        if k == 0 {
            cloud.origin_mm = p;
        }
        cloud.points_mm.push(Point3::from((p - cloud.origin_mm).cast()));
        cloud.normals.push(Vector3::from_column_slice(&n).cast());
    }
    Ok(cloud)
}

/// The header of [`write()`] is a tenth of this.
const MOST_HEADER_BYTES: usize = 4096;

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(origin_mm: f64) -> PointCloud {
        PointCloud {
            origin_mm: Point3::new(origin_mm, 0.0, 0.0),
            points_mm: vec![Point3::new(0.125, 2.0, 3.0); 4],
            normals: vec![Vector3::new(0.0, 0.6, 0.8); 4],
        }
    }

    fn split(bytes: &[u8]) -> (String, &[u8]) {
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        (String::from_utf8(bytes[..end].to_vec()).unwrap(), &bytes[end..])
    }

    #[test]
    fn the_body_holds_what_the_header_declares() {
        let bytes = write(&cloud(0.0), PathFrame::Base);
        let (header, body) = split(&bytes);
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
        assert!(header.contains("element vertex 4\n"));
        let properties = header.matches("property float ").count();
        assert_eq!(properties, 6);
        assert_eq!(body.len(), 4 * 4 * properties);
        let values: Vec<f32> =
            body.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!(values[6..12], [0.125, 2.0, 3.0, 0.0, 0.6, 0.8]);
    }

    #[test]
    fn far_from_the_origin_no_digit_is_lost() {
        let bytes = write(&cloud(1e8), PathFrame::Base);
        let (header, body) = split(&bytes);
        assert!(header.contains("property double x\n"));
        assert_eq!(body.len(), 4 * 36);
        assert_eq!(f64::from_le_bytes(body[..8].try_into().unwrap()), 1e8 + 0.125);
    }

    #[test]
    fn an_empty_cloud_is_a_valid_file() {
        let bytes = write(&PointCloud::default(), PathFrame::Base);
        assert!(split(&bytes).0.contains("element vertex 0\n"));
        assert!(split(&bytes).1.is_empty());
    }

    #[test]
    fn a_model_read_back_is_the_model() {
        for origin_mm in [0.0, 500_000.25] {
            let back = read(&write(&cloud(origin_mm), PathFrame::Base)).unwrap();
            assert_eq!(back.len(), 4);
            assert!((back.in_base_mm(3) - cloud(origin_mm).in_base_mm(3)).norm() < 1e-6);
            assert_eq!(back.normals, cloud(origin_mm).normals);
        }
    }

    #[test]
    fn what_is_no_model_is_refused() {
        let good = write(&cloud(0.0), PathFrame::Base);
        let text = |from: &str, to: &str| {
            let at = good.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
            [&good[..at], to.as_bytes(), &good[at + from.len()..]].concat()
        };
        let mut not_a_number = good.clone();
        let end = not_a_number.len();
        not_a_number[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
        for (bytes, why) in [
            (Vec::new(), "no header"),
            (good[..good.len() - 1].to_vec(), "header says 4"),
            (text("vertex 4", "vertex 99999999999999"), "header says"),
            (text("little", "big"), "another"),
            (not_a_number, "point 3"),
        ] {
            assert!(read(&bytes).unwrap_err().to_string().contains(why), "{why}");
        }
    }
}
