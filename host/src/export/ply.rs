//! `model.ply`: points and normals, binary little endian, base frame, mm. Any point-cloud viewer opens it.

use crate::cloud::PointCloud;

/// Beyond this a single-precision millimetre is coarser than a micrometre, and `double` is written.
const SINGLE_PRECISION_MM: f64 = 8192.0;

/// The whole file.
pub fn write(cloud: &PointCloud) -> Vec<u8> {
    let double = (0..cloud.len()).any(|i| cloud.in_base_mm(i).coords.amax() > SINGLE_PRECISION_MM);
    let mut bytes = header(cloud, if double { "double" } else { "float" }).into_bytes();
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
fn header(cloud: &PointCloud, number: &str) -> String {
    let mut lines = vec!["ply".to_owned(), "format binary_little_endian 1.0".to_owned()];
    lines.push("comment weldpath: robot base frame, millimetres".to_owned());
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector3};

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
        let bytes = write(&cloud(0.0));
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
        let bytes = write(&cloud(1e8));
        let (header, body) = split(&bytes);
        assert!(header.contains("property double x\n"));
        assert_eq!(body.len(), 4 * 36);
        assert_eq!(f64::from_le_bytes(body[..8].try_into().unwrap()), 1e8 + 0.125);
    }

    #[test]
    fn an_empty_cloud_is_a_valid_file() {
        let bytes = write(&PointCloud::default());
        assert!(split(&bytes).0.contains("element vertex 0\n"));
        assert!(split(&bytes).1.is_empty());
    }
}
