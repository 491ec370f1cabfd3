//! E57 by the crate of that name: each scan in the file is a view, seen from the origin of its own frame. Metres.

use std::io::Cursor;
use std::path::Path;

use e57::{CartesianCoordinate, E57Reader, PointCloud};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::raw::{Positions, Raw};
use super::units::Unit;
use super::{CloudFrame, Error, Options, Scan, name_of, records, view_of};
use crate::geometry::cloud::View;

/// A point needs at least a bit in its packet: this many points to a byte.
const POINTS_PER_BYTE: usize = 8;

/// Reads all scans of a file.
pub(super) fn read(bytes: Vec<u8>, path: &Path, options: &Options) -> Result<Scan, Error> {
    let available = bytes.len();
    let bad = |e: e57::Error| {
        Error::malformed(
            path,
            "E57 data",
            e.to_string(),
            "The file is cut off or damaged: copy or export it again",
        )
    };
    let mut reader = E57Reader::new(Cursor::new(bytes)).map_err(bad)?;
    let unit = Unit::chosen(options.units).unwrap_or(Unit::Metre);
    let mut scan = Scan::of(Vec::new(), CloudFrame::Unknown, path);
    scan.notes.push(format!("units: {} (E57 is in metres)", unit.name()));
    if unit != Unit::Metre {
        scan.warnings.push("--units overrules the metres of E57".into());
    }
    for (k, cloud) in reader.pointclouds().iter().enumerate() {
        let possible = available.saturating_mul(POINTS_PER_BYTE);
        let count = records::check_count(cloud.records, 1, possible, "points", format!("scan {k}"), path)?;
        options.memory.hold(path, available, "points", count as u64, 24 + 12)?;
        let mut points = Vec::new();
        let mut simple = reader.pointcloud_simple(cloud).map_err(bad)?;
        simple.apply_pose(false);
        for point in simple.take(count) {
            if let CartesianCoordinate::Valid { x, y, z } = point.map_err(bad)?.cartesian {
                points.push(Point3::new(x, y, z));
            }
        }
        match view(points, cloud, k, unit, path, &mut scan.notes)? {
            Some(view) => scan.views.push(view),
            None => scan.warnings.push(format!("scan {k} of the file holds no point and is left out")),
        }
    }
    if scan.views.is_empty() {
        return Err(Error::empty(path, "none of its scans has a point"));
    }
    Ok(scan)
}

/// One scan as a view; its frame's origin is the scanner where the file has a pose for it.
fn view(
    points: Vec<Point3<f64>>,
    cloud: &PointCloud,
    k: usize,
    unit: Unit,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Option<View>, Error> {
    let mut raw = Raw::from(Positions::Double(points));
    match raw.clean(path, notes) {
        Err(Error::Empty { .. }) => return Ok(None),
        other => other?,
    }
    let pose = pose(cloud, unit).map_err(|problem| {
        Error::malformed(path, format!("scan {k}, pose"), problem, "Export the file again, or as PLY")
    })?;
    let middle = raw.extent().middle;
    let origin = pose.map(|_| Vector3::zeros());
    let mut view = view_of(raw, origin, middle, unit.mm(), name_of(path));
    view.name = cloud.name.clone().unwrap_or_else(|| format!("{}#{k}", view.name));
    if let Some(pose) = pose {
        view.base_from_camera = pose;
    }
    Ok(Some(view))
}

/// Pose of the scanner in the file's frame, mm.
fn pose(cloud: &PointCloud, unit: Unit) -> Result<Option<Isometry3<f64>>, String> {
    let Some(transform) = &cloud.transform else { return Ok(None) };
    let (q, t) = (&transform.rotation, &transform.translation);
    let rotation = Quaternion::new(q.w, q.x, q.y, q.z);
    if (rotation.norm() - 1.0).abs() > 2e-3 {
        return Err(format!("the quaternion has length {:.4}", rotation.norm()));
    }
    let at_mm = Vector3::new(t.x, t.y, t.z) * unit.mm();
    Ok(Some(Isometry3::from_parts(Translation3::from(at_mm), UnitQuaternion::from_quaternion(rotation))))
}

#[cfg(test)]
mod tests {
    use super::super::read_bytes;
    use super::*;
    use e57::{E57Writer, Record, RecordValue, Transform, Translation};

    /// Two scans of 300 points, the second with a pose, written by the crate's own writer.
    fn written() -> (Vec<u8>, Vec<[f64; 3]>) {
        let truth: Vec<[f64; 3]> = (0..300)
            .map(|i| [f64::from(i % 20) * 0.01, f64::from(i / 20) * 0.01, 0.4 + f64::from(i) * 1e-4])
            .collect();
        let mut buffer = Cursor::new(Vec::new());
        let mut writer = E57Writer::new(&mut buffer, "file").unwrap();
        for k in 0..2 {
            let prototype = vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64];
            let mut cloud = writer.add_pointcloud(&format!("scan-{k}"), prototype).unwrap();
            if k == 1 {
                // Half a turn about x, then 1, 2, 3 m.
                let rotation = e57::Quaternion { w: 0.0, x: 1.0, y: 0.0, z: 0.0 };
                cloud.set_transform(Some(Transform {
                    rotation,
                    translation: Translation { x: 1.0, y: 2.0, z: 3.0 },
                }));
            }
            for p in &truth {
                cloud.add_point(p.map(RecordValue::Double).to_vec()).unwrap();
            }
            cloud.finalize().unwrap();
        }
        writer.finalize().unwrap();
        drop(writer);
        (buffer.into_inner(), truth)
    }

    fn read(bytes: Vec<u8>) -> Result<Scan, Error> {
        read_bytes(bytes, Path::new("part.e57"), &Options::default())
    }

    #[test]
    fn what_the_writer_of_the_crate_wrote_is_read_with_its_poses_in_millimetres() {
        let (bytes, truth) = written();
        let scan = read(bytes).unwrap();
        assert_eq!(scan.views.len(), 2);
        assert_eq!([scan.views[0].camera_known, scan.views[1].camera_known], [false, true]);
        for (i, [x, y, z]) in truth.iter().enumerate() {
            let at = |k: usize| scan.views[k].base_from_camera * scan.views[k].points_mm[i].cast::<f64>();
            assert!((at(0) - Point3::new(x * 1e3, y * 1e3, z * 1e3)).norm() < 1e-3);
            assert!(
                (at(1) - Point3::new(1000.0 + x * 1e3, 2000.0 - y * 1e3, 3000.0 - z * 1e3)).norm() < 1e-3
            );
        }
    }

    #[test]
    fn a_file_that_is_cut_off_is_refused() {
        let (bytes, _) = written();
        for cut in [9, 48, 1000, bytes.len() / 2, bytes.len() - 1] {
            let error = read(bytes[..cut].to_vec()).unwrap_err().to_string();
            assert!(error.contains("part.e57"), "{error}");
        }
    }
}
