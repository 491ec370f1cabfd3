//! A folder of depth images with a camera trajectory instead of a `scan.json`: Redwood `.log` and TUM text files.
//!
//! Redwood: three integers, then `base_from_camera` as a 4x4 matrix, for each image in the order of the names. TUM: a
//! line `time x y z qx qy qz qw` for each image, in the order of time. Lengths are metres in both.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion};
use rayon::prelude::*;

use super::depth::{self, PRIMESENSE};
use super::{Error, Scan, manifest, name_of, read_file};
use crate::cloud::View;

const HELP: &str = "Write a scan.json that names the views and their poses, or give one file";

/// Reads the depth images of `folder` (or of its `depth/`) with the trajectory beside them.
pub(super) fn read_folder(folder: &Path) -> Result<Scan, Error> {
    let images = match sorted(folder, &["png"])? {
        images if images.is_empty() => sorted(&folder.join("depth"), &["png"]).unwrap_or_default(),
        images => images,
    };
    if images.is_empty() {
        let problem = format!("there is neither a {} nor a depth image", manifest::NAME);
        return Err(Error::malformed(folder, "folder", problem, HELP));
    }
    let (file, poses) = trajectory(folder)?;
    if poses.len() != images.len() {
        let problem = format!("{} poses for {} depth images", poses.len(), images.len());
        return Err(Error::malformed(&file, "end of file", problem, HELP));
    }
    let read: Vec<_> = images.par_iter().zip(poses).map(|(image, pose)| view(image, pose)).collect();
    let views = read.into_iter().collect::<Result<Vec<View>, Error>>()?;
    let (views, blind): (Vec<_>, Vec<_>) = views.into_iter().partition(|view| !view.points_mm.is_empty());
    if views.is_empty() {
        return Err(Error::empty(folder, "no depth image has a reading"));
    }
    let left_out = blind.iter().map(|view| format!("{} sees nothing and is left out", view.name));
    let warnings = std::iter::once(depth::assumed_camera()).chain(left_out).collect();
    let notes = vec![format!("{} camera poses from {}", images.len(), file.display())];
    Ok(Scan { views, notes, warnings, inputs: std::iter::once(file).chain(images).collect() })
}

fn view(image: &Path, base_from_camera: Isometry3<f64>) -> Result<View, Error> {
    let points_mm = depth::points_mm(&read_file(image)?, &PRIMESENSE, image)?;
    Ok(View { name: name_of(image), points_mm, normals: Vec::new(), base_from_camera, camera_known: true })
}

/// Files of a folder with one of these extensions, in the order of their names.
fn sorted(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>, Error> {
    let help = "Check that it can be listed";
    let entries =
        std::fs::read_dir(folder).map_err(|source| Error::Io { path: folder.into(), source, help })?;
    let wanted = |path: &PathBuf| {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        extensions.iter().any(|e| extension.eq_ignore_ascii_case(e))
    };
    let mut files: Vec<PathBuf> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(wanted).collect();
    files.sort();
    Ok(files)
}

/// The first file that is a trajectory; names with `trajectory` or `groundtruth` come first.
fn trajectory(folder: &Path) -> Result<(PathBuf, Vec<Isometry3<f64>>), Error> {
    let mut files = sorted(folder, &["log", "txt"])?;
    let named =
        |path: &PathBuf| ["trajectory", "groundtruth"].iter().any(|word| name_of(path).contains(word));
    files.sort_by_key(|path| !named(path));
    let Some(file) = files.into_iter().next() else {
        return Err(Error::malformed(
            folder,
            "folder",
            "depth images, but no poses: no .log or .txt is there",
            HELP,
        ));
    };
    let bytes = read_file(&file)?;
    let poses = poses(&String::from_utf8_lossy(&bytes), &file)?;
    Ok((file, poses))
}

fn poses(text: &str, file: &Path) -> Result<Vec<Isometry3<f64>>, Error> {
    let mut rows = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let row: Result<Vec<f64>, _> = line.split_ascii_whitespace().map(str::parse).collect();
        match row {
            Ok(row) if row.iter().all(|v| v.abs() < 1e9) => rows.push((i + 1, row)),
            _ => return Err(Error::malformed(file, format!("line {}", i + 1), "not a row of numbers", HELP)),
        }
    }
    let tum = rows.first().is_some_and(|(_, row)| row.len() == 8);
    let read = |chunk: &[(usize, Vec<f64>)]| {
        let pose = if tum { tum_pose(&chunk[0].1) } else { redwood_pose(chunk) };
        pose.map_err(|problem| Error::malformed(file, format!("line {}", chunk[0].0), problem, HELP))
    };
    rows.chunks(if tum { 1 } else { 5 }).map(read).collect()
}

/// Unlike scalars in a file, a rotation has a rule: unit length, or orthonormal rows.
const RIGID: f64 = 2e-3;

fn tum_pose(row: &[f64]) -> Result<Isometry3<f64>, String> {
    let [_, x, y, z, qx, qy, qz, qw] = row else { return Err(format!("{} numbers, not 8", row.len())) };
    let rotation = Quaternion::new(*qw, *qx, *qy, *qz);
    if (rotation.norm() - 1.0).abs() > RIGID {
        return Err(format!("the quaternion has length {:.4}", rotation.norm()));
    }
    let at_mm = Translation3::new(x * 1000.0, y * 1000.0, z * 1000.0);
    Ok(Isometry3::from_parts(at_mm, UnitQuaternion::from_quaternion(rotation)))
}

fn redwood_pose(chunk: &[(usize, Vec<f64>)]) -> Result<Isometry3<f64>, String> {
    let rows: Vec<&[f64]> = chunk.iter().map(|(_, row)| row.as_slice()).collect();
    let [[_, _, _], [r00, r01, r02, x], [r10, r11, r12, y], [r20, r21, r22, z], [0.0, 0.0, 0.0, 1.0]] =
        rows[..]
    else {
        return Err("not three integers and a 4x4 matrix with the last row 0 0 0 1".into());
    };
    let rotation = Matrix3::new(*r00, *r01, *r02, *r10, *r11, *r12, *r20, *r21, *r22);
    let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
    if off > RIGID || rotation.determinant() < 0.0 {
        return Err(format!("the 3x3 part is not a rotation (off by {off:.2e})"));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    Ok(Isometry3::from_parts(Translation3::new(x * 1000.0, y * 1000.0, z * 1000.0), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Isometry3<f64>>, Error> {
        poses(text, Path::new("trajectory.log"))
    }

    #[test]
    fn redwood_and_tum_say_the_same() {
        // A quarter turn about z, then 1, 2, 3 m.
        let redwood = read("0 0 1\n0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n").unwrap();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let tum = read(&format!("# time x y z q\n12.5 1 2 3 0 0 {half} {half}\n")).unwrap();
        let point = nalgebra::Point3::new(10.0, 0.0, 0.0);
        for pose in [redwood[0], tum[0]] {
            assert!((pose * point - nalgebra::Point3::new(1000.0, 2010.0, 3000.0)).norm() < 1e-9);
        }
    }

    #[test]
    fn errors_name_the_line() {
        for (text, place) in [
            ("0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n", "line 1"),
            ("0 0 1\n2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "not a rotation"),
            ("1 2 3 4 0 0 0 2\n", "length 2"),
            ("\n1 2 x\n", "line 2"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains("trajectory.log") && error.contains(place), "{error}");
        }
    }
}
