//! A folder of depth images with a camera trajectory instead of a `scan.json`: Redwood `.log` and TUM text files.
//!
//! Redwood: three integers, then `base_from_camera` as a 4x4 matrix, for each image in the order of the names. TUM: a
//! line `time x y z qx qy qz qw` for each image in the order of time, or many more than images, whose names are then their
//! times. Lengths are metres in both. Intrinsics come from Open3D's `camera_intrinsic.json`, if it is there.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;
use rayon::prelude::*;
use serde::Deserialize;

use super::camera::{Camera, Distortion, Rays};
use super::depth::{self, PRIMESENSE};
use super::transform::{Fault, from_quaternion, from_rows};
use super::units::Unit;
use super::{CloudFrame, Error, Options, Scan, direction, manifest, name_of, read_at_most, read_file};
use crate::geometry::cloud::View;

/// Bytes of a trajectory at most: poses of a camera that ran for hours.
const MOST_BYTES: u64 = 16 << 20;
/// Folder of the images, where they do not lie beside the trajectory.
pub(super) const IMAGES: &str = "depth";
const HELP: &str = "Write a scan.json that names the views and their poses, or give one file";

/// Reads the depth images of `folder` (or of its `depth/`) with the trajectory beside them.
pub(super) fn read_folder(folder: &Path, options: &Options) -> Result<Scan, Error> {
    let images = match sorted(folder, &["png"])? {
        images if images.is_empty() => sorted(&folder.join(IMAGES), &["png"]).unwrap_or_default(),
        images => images,
    };
    if images.is_empty() {
        let problem = format!("there is neither a {} nor a depth image", manifest::NAME);
        return Err(Error::malformed(folder, "folder", problem, HELP));
    }
    let unit = Unit::chosen(options.units).unwrap_or(Unit::Metre);
    let overruled = (unit != Unit::Metre).then(|| "--units overrules the metres of trajectories".to_owned());
    let (file, poses) = trajectory(folder, unit)?;
    let poses = matched(poses, &images, &file)?;
    let (camera, assumed) = camera(folder, &images[0], options)?;
    let rays = Rays::new(camera);
    let read: Vec<_> = images.par_iter().zip(poses).map(|(image, pose)| view(image, &rays, pose)).collect();
    let views = read.into_iter().collect::<Result<Vec<View>, Error>>()?;
    let (views, blind): (Vec<_>, Vec<_>) = views.into_iter().partition(|view| !view.points_mm.is_empty());
    if views.is_empty() {
        return Err(Error::empty(folder, "no depth image has a reading"));
    }
    let left_out = blind.iter().map(|view| format!("{} sees nothing and is left out", view.name));
    let warnings = overruled.into_iter().chain(assumed).chain(left_out).collect();
    check_direction(&views, &file)?;
    let notes = vec![format!("{} camera poses from {}", images.len(), file.display())];
    let inputs = std::iter::once(file).chain(images).collect();
    let scan = Scan::of(views, CloudFrame::Unknown, folder);
    Ok(Scan { notes, warnings, inputs, ..scan })
}

/// Open3D's name of a file with intrinsics.
const INTRINSICS: &str = "camera_intrinsic.json";
/// A TUM benchmark has this list of its images, and 5000 counts to a metre.
const TUM_LIST: &str = "depth.txt";
const TUM_SCALE_M: f64 = 1.0 / 5000.0;

/// What Open3D writes: a 3x3 matrix, column by column.
#[derive(Deserialize)]
struct Intrinsics {
    width: u32,
    height: u32,
    intrinsic_matrix: [f64; 9],
}

/// The camera, and what is assumed of it. What the user says of it goes before what lies in the folder.
fn camera(folder: &Path, image: &Path, options: &Options) -> Result<(Camera, Option<String>), Error> {
    let usual_m = if folder.join(TUM_LIST).is_file() { TUM_SCALE_M } else { PRIMESENSE.depth_scale_m };
    let depth_scale_m = options.depth_scale_m.unwrap_or(usual_m);
    if let Some(intrinsics) = &options.intrinsics {
        return Ok((depth::given(intrinsics, &read_file(image)?, depth_scale_m, image)?, None));
    }
    let file = folder.join(INTRINSICS);
    if !file.is_file() {
        return Ok((Camera { depth_scale_m, ..PRIMESENSE }, Some(depth::assumed_camera())));
    }
    let help = "It needs width, height and intrinsic_matrix, nine numbers column by column";
    let bad = |place: String, problem: String| Error::malformed(&file, place, problem, help);
    let read: Intrinsics = serde_json::from_slice(&read_at_most(&file, super::SETTINGS_BYTES)?)
        .map_err(|e| bad(format!("line {}, column {}", e.line(), e.column()), e.to_string()))?;
    let [fx, _, _, _, fy, _, cx, cy, _] = read.intrinsic_matrix;
    let distortion = Distortion::default();
    let camera = Camera { width: read.width, height: read.height, fx, fy, cx, cy, depth_scale_m, distortion };
    match camera.fault() {
        Some((field, problem)) => Err(bad(field.into(), problem)),
        None => Ok((camera, None)),
    }
}

/// A pose nearer in time than this belongs to an image, s.
const SAME_TIME_S: f64 = 0.02;

/// One pose for each image: by time where the images' names are times, else in their order.
fn matched(poses: Vec<Stamped>, images: &[PathBuf], file: &Path) -> Result<Vec<Isometry3<f64>>, Error> {
    let time = |image: &PathBuf| image.file_stem()?.to_str()?.parse::<f64>().ok();
    let times: Option<Vec<f64>> = images.iter().map(time).collect();
    let stamps: Option<Vec<f64>> = poses.iter().map(|pose| pose.0).collect();
    match (times, stamps) {
        (Some(times), Some(stamps)) if poses.len() != images.len() => {
            let nearest = |time: f64| {
                let apart = |k: &usize| (stamps[*k] - time).abs();
                (0..stamps.len())
                    .min_by(|a, b| apart(a).total_cmp(&apart(b)))
                    .filter(|k| apart(k) <= SAME_TIME_S)
            };
            let pose = |(time, image): (&f64, &PathBuf)| match nearest(*time) {
                Some(k) => Ok(poses[k].1),
                None => {
                    let problem = format!("no pose within {SAME_TIME_S} s of image {}", name_of(image));
                    Err(Error::malformed(file, "times", problem, HELP))
                }
            };
            times.iter().zip(images).map(pose).collect()
        }
        _ if poses.len() == images.len() => Ok(poses.into_iter().map(|pose| pose.1).collect()),
        _ => {
            let problem = format!("{} poses for {} depth images", poses.len(), images.len());
            Err(Error::malformed(file, "end of file", problem, HELP))
        }
    }
}

/// Refuses poses that fit much better when they are inverted.
fn check_direction(views: &[View], file: &Path) -> Result<(), Error> {
    let poses: Vec<Isometry3<f64>> = views.iter().map(|view| view.base_from_camera).collect();
    match direction::better(views, &poses, &Isometry3::identity()) {
        Some(found) if found.invert_poses && found.times() >= direction::REFUSED => {
            let problem = format!(
                "the views agree {:.0} times better when its poses are inverted ({:.1} mm apart instead of {:.1} mm): are \
                 they camera_from_base?",
                found.times(),
                found.better_mm,
                found.given_mm
            );
            let help =
                "Invert them, or write a scan.json with \"flange_from_base\" and an identity as hand-eye";
            Err(Error::malformed(file, "poses", problem, help))
        }
        _ => Ok(()),
    }
}

fn view(image: &Path, rays: &Rays, base_from_camera: Isometry3<f64>) -> Result<View, Error> {
    let points_mm = depth::points_mm(&read_file(image)?, rays, image)?;
    Ok(View {
        name: name_of(image),
        points_mm,
        normals: Vec::new(),
        base_from_camera,
        camera_known: true,
        mesh: None,
    })
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

/// Lists of other things in a TUM folder.
const LISTS: [&str; 4] = [TUM_LIST, "rgb.txt", "accelerometer.txt", "associations.txt"];

/// A pose and its time, s, where the file has one.
type Stamped = (Option<f64>, Isometry3<f64>);

/// The first file that is a trajectory; names with `trajectory` or `groundtruth` come first.
fn trajectory(folder: &Path, unit: Unit) -> Result<(PathBuf, Vec<Stamped>), Error> {
    let mut files = sorted(folder, &["log", "txt"])?;
    files.retain(|path| !LISTS.contains(&name_of(path).as_str()));
    let named =
        |path: &PathBuf| ["trajectory", "groundtruth"].iter().any(|word| name_of(path).contains(word));
    files.sort_by_key(|path| !named(path));
    let mut refused = None;
    for file in files {
        match poses(&String::from_utf8_lossy(&read_at_most(&file, MOST_BYTES)?), &file, unit) {
            Ok(poses) if !poses.is_empty() => return Ok((file, poses)),
            Ok(_) => {}
            Err(error) => {
                refused.get_or_insert(error);
            }
        }
    }
    let none = "depth images, but no poses: no .log or .txt is there that holds any";
    Err(refused.unwrap_or_else(|| Error::malformed(folder, "folder", none, HELP)))
}

fn poses(text: &str, file: &Path, unit: Unit) -> Result<Vec<Stamped>, Error> {
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
        let time = chunk[0].1.first().copied().filter(|_| tum);
        let pose = if tum { tum_pose(&chunk[0].1, unit) } else { redwood_pose(chunk, unit) };
        pose.map(|pose| (time, pose))
            .map_err(|(problem, help)| Error::malformed(file, format!("line {}", chunk[0].0), problem, help))
    };
    rows.chunks(if tum { 1 } else { 5 }).map(read).collect()
}

fn tum_pose(row: &[f64], unit: Unit) -> Result<Isometry3<f64>, Fault> {
    let [_, x, y, z, qx, qy, qz, qw] = row else {
        return Err((format!("{} numbers, not 8", row.len()), HELP));
    };
    from_quaternion([*x, *y, *z], [*qx, *qy, *qz, *qw], unit)
}

fn redwood_pose(chunk: &[(usize, Vec<f64>)], unit: Unit) -> Result<Isometry3<f64>, Fault> {
    let no_matrix = || ("not three integers and a 4x4 matrix".to_owned(), HELP);
    let [(_, head), rows @ ..] = chunk else { return Err(no_matrix()) };
    let rows: Vec<[f64; 4]> = rows
        .iter()
        .map(|(_, row)| row.as_slice().try_into())
        .collect::<Result<_, _>>()
        .map_err(|_| no_matrix())?;
    match (head.len(), <[[f64; 4]; 4]>::try_from(rows)) {
        (3, Ok(matrix)) => from_rows(&matrix, unit),
        _ => Err(no_matrix()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Isometry3<f64>>, Error> {
        Ok(poses(text, Path::new("trajectory.log"), Unit::Metre)?.into_iter().map(|pose| pose.1).collect())
    }

    #[test]
    fn images_named_by_their_time_take_the_pose_of_that_time() {
        let text = "10.00 1 0 0 0 0 0 1\n10.01 2 0 0 0 0 0 1\n10.02 3 0 0 0 0 0 1\n10.50 4 0 0 0 0 0 1\n";
        let file = Path::new("groundtruth.txt");
        let names = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let x = |images: &[&str]| -> Result<Vec<f64>, Error> {
            let poses = matched(poses(text, file, Unit::Metre).unwrap(), &names(images), file)?;
            Ok(poses.iter().map(|pose| pose.translation.x).collect())
        };
        assert_eq!(x(&["depth/10.0118.png", "depth/10.507.png"]).unwrap(), [2000.0, 4000.0]);
        assert_eq!(x(&["a.png", "b.png", "c.png", "d.png"]).unwrap(), [1000.0, 2000.0, 3000.0, 4000.0]);
        assert!(x(&["10.2.png"]).unwrap_err().to_string().contains("10.2.png"));
        assert!(x(&["a.png"]).unwrap_err().to_string().contains("4 poses for 1"));
    }

    #[test]
    fn intrinsics_of_open3d_are_read_column_by_column() {
        let folder = tempfile::tempdir().unwrap();
        let write = |text: &str| std::fs::write(folder.path().join(INTRINSICS), text).unwrap();
        assert!(
            camera(folder.path(), Path::new("0.png"), &Options::default()).unwrap().1.is_some(),
            "without a file the camera is assumed, and said"
        );
        write(r#"{"width": 8, "height": 6, "intrinsic_matrix": [500, 0, 0, 0, 510, 0, 4, 3, 1]}"#);
        let (read, assumed) = camera(folder.path(), Path::new("0.png"), &Options::default()).unwrap();
        assert_eq!((read.fx, read.fy, read.cx, read.cy, assumed), (500.0, 510.0, 4.0, 3.0, None));
        write(r#"{"width": 8, "height": 6, "intrinsic_matrix": [0, 0, 0, 0, 510, 0, 4, 3, 1]}"#);
        assert!(
            camera(folder.path(), Path::new("0.png"), &Options::default())
                .unwrap_err()
                .to_string()
                .contains("fx")
        );
        write("{");
        assert!(
            camera(folder.path(), Path::new("0.png"), &Options::default())
                .unwrap_err()
                .to_string()
                .contains(INTRINSICS)
        );
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
