//! A folder of depth images with a camera trajectory instead of a `scan.json`: Redwood `.log` and TUM text files.
//!
//! Open3D's JSON of a trajectory holds the other way round, `camera_from_base`, column by column.
//!
//! Redwood: three integers, then `base_from_camera` as a 4x4 matrix, for each image in the order of the names. TUM: a
//! line `time x y z qx qy qz qw` for each image in the order of time, or many more than images, whose names are then their
//! times. Lengths are metres in both. Intrinsics come from the JSON of a camera in the folder, if one is there.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;
use rayon::prelude::*;
use serde_json::Value;

use super::camera::{Camera, Rays};
use super::depth::{self, PRIMESENSE};
use super::direction::Trial;
use super::memory::Limit;
use super::misreading::{self, Reading, Told};
use super::transform::{Fault, from_quaternion, from_rows};
use super::units::Unit;
use super::{
    CloudFrame, Error, Options, Scan, direction, intrinsics, manifest, name_of, read_at_most, read_file,
};
use crate::geometry::cloud::View;

/// Bytes of a trajectory at most: poses of a camera that ran for hours.
const MOST_BYTES: u64 = 16 << 20;
/// Folder of the images, where they do not lie beside the trajectory.
pub(super) const IMAGES: &str = "depth";
const HELP: &str = "Write a scan.json that names the views and their poses, or give one file";

/// Reads the depth images of `folder` (or of its `depth/`) with the trajectory beside them.
pub(super) fn read_folder(folder: &Path, options: &Options) -> Result<Scan, Error> {
    super::foreign::refuse_folder(folder)?;
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
    let read: Vec<_> =
        images.par_iter().zip(poses).map(|(image, pose)| view(image, &rays, pose, options.memory)).collect();
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

/// A TUM benchmark has this list of its images, and 5000 counts to a metre.
const TUM_LIST: &str = "depth.txt";
const TUM_SCALE_M: f64 = 1.0 / 5000.0;

/// The camera, and what is assumed of it. What the user says of it goes before what lies in the folder.
fn camera(folder: &Path, image: &Path, options: &Options) -> Result<(Camera, Option<String>), Error> {
    let usual_m = if folder.join(TUM_LIST).is_file() { TUM_SCALE_M } else { PRIMESENSE.depth_scale_m };
    let depth_scale_m = options.depth_scale_m.unwrap_or(usual_m);
    if let Some(intrinsics) = &options.intrinsics {
        return Ok((
            depth::given(intrinsics, &read_file(image, options.memory)?, depth_scale_m, image)?,
            None,
        ));
    }
    let Some((file, value)) = intrinsics_in(folder)? else {
        return Ok((Camera { depth_scale_m, ..PRIMESENSE }, Some(depth::assumed_camera())));
    };
    let bad = |(place, problem): (&str, String), help: &str| Error::malformed(&file, place, problem, help);
    let size_px = depth::size_px(&read_file(image, options.memory)?, image)?;
    let camera = intrinsics::parse(&value, size_px, depth_scale_m)
        .map_err(|(problem, help)| bad(("camera", problem), help))?;
    match camera.fault() {
        Some(fault) => Err(bad(fault, "Give the intrinsics of the depth stream in pixels")),
        None => Ok((camera, None)),
    }
}

/// The file with a camera, by its name: `camera_intrinsic.json`, `intrinsic.json`, `calibration.json` and the like.
fn intrinsics_in(folder: &Path) -> Result<Option<(PathBuf, Value)>, Error> {
    let named = |path: &PathBuf| {
        let name = name_of(path).to_lowercase();
        ["intrinsic", "calib", "camera"].iter().any(|word| name.contains(word))
    };
    let mut files: Vec<PathBuf> = sorted(folder, &["json"])?.into_iter().filter(named).collect();
    files.sort_by_key(|path| !name_of(path).to_lowercase().contains("intrinsic"));
    let Some(file) = files.into_iter().next() else { return Ok(None) };
    let value = json(&file)?;
    Ok(Some((file, value)))
}

fn json(file: &Path) -> Result<Value, Error> {
    let bytes = read_at_most(file, MOST_BYTES)?;
    serde_json::from_slice(&bytes).map_err(|e| {
        let place = format!("line {}, column {}", e.line(), e.column());
        Error::malformed(file, place, e.to_string(), "Export it again, or write a scan.json")
    })
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
        Some(_) => Ok(()),
        None => check_reading(views, &poses, file),
    }
}

/// Refuses images in another order than that of their poses, and depths of another unit, where trying shows it.
fn check_reading(views: &[View], poses: &[Isometry3<f64>], file: &Path) -> Result<(), Error> {
    let names: Vec<String> = views.iter().map(|view| view.name.clone()).collect();
    let readings = |_: &Trial| {
        let mut all = misreading::orders(&names, poses);
        for (scale, words) in [(0.1, "a tenth of what was assumed"), (10.0, "ten times what was assumed")] {
            let says = format!("each step of the images is {words}");
            let reading =
                Reading::new(says, "Say with --depth-scale-m how many metres a step is", poses.to_vec());
            all.push(Reading { scale, ..reading });
        }
        all
    };
    match misreading::told(views, poses, readings) {
        Told::One { problem, help } => Err(Error::malformed(file, "poses", problem, help)),
        Told::Several { problem } => Err(Error::malformed(file, "poses", problem, HELP)),
        Told::Agree | Told::None { .. } => Ok(()),
    }
}

fn view(image: &Path, rays: &Rays, base_from_camera: Isometry3<f64>, limit: Limit) -> Result<View, Error> {
    let points_mm = depth::points_mm(&read_file(image, limit)?, rays, image, limit)?;
    Ok(View {
        name: name_of(image),
        points_mm,
        normals: Vec::new(),
        base_from_camera,
        camera_known: true,
        mesh: None,
        picture: rays.picture(),
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
    let mut files = sorted(folder, &["log", "txt", "json"])?;
    files.retain(|path| !LISTS.contains(&name_of(path).as_str()));
    // Other JSON beside the images is of everything.
    files.retain(|path| !is_json(path) || name_of(path).contains("trajectory"));
    let named =
        |path: &PathBuf| ["trajectory", "groundtruth"].iter().any(|word| name_of(path).contains(word));
    files.sort_by_key(|path| !named(path));
    let mut refused = None;
    for file in files {
        let read = if is_json(&file) {
            open3d_poses(&json(&file)?, &file, unit)
        } else {
            let bytes = read_at_most(&file, MOST_BYTES)?;
            poses(&String::from_utf8_lossy(&bytes), &file, unit)
        };
        match read {
            Ok(poses) if !poses.is_empty() => return Ok((file, poses)),
            Ok(_) => {}
            Err(error) => {
                refused.get_or_insert(error);
            }
        }
    }
    let none = "depth images, but no poses: no .log, .txt or trajectory.json is there that holds any";
    Err(refused.unwrap_or_else(|| Error::malformed(folder, "folder", none, HELP)))
}

fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

/// Open3D's `PinholeCameraTrajectory`: of each camera `extrinsic`, sixteen numbers column by column.
fn open3d_poses(value: &Value, file: &Path, unit: Unit) -> Result<Vec<Stamped>, Error> {
    let bad = |place: String, problem: String, help: &str| Error::malformed(file, place, problem, help);
    let help = "It needs parameters[].extrinsic, sixteen numbers column by column, as Open3D writes its trajectories";
    let cameras = value["parameters"].as_array();
    let cameras = cameras.ok_or_else(|| bad("parameters".into(), "the list is missing".into(), help))?;
    let pose = |(i, camera): (usize, &Value)| {
        let place = || format!("parameters[{i}].extrinsic");
        let numbers: Option<[f64; 16]> = serde_json::from_value(camera["extrinsic"].clone()).ok();
        let all = numbers.ok_or_else(|| bad(place(), "it has not sixteen numbers".into(), help))?;
        let rows = std::array::from_fn(|r| std::array::from_fn(|c| all[4 * c + r]));
        let camera_from_base =
            from_rows(&rows, unit).map_err(|(problem, help)| bad(place(), problem, help))?;
        Ok((None, camera_from_base.inverse()))
    };
    cameras.iter().enumerate().map(pose).collect()
}

/// Whether numbers may be a line of poses: no length is as large as this, but seconds since 1970 are, in TUM's first column.
fn is_pose(row: &[f64]) -> bool {
    const MOST: f64 = 1e9;
    let numbers = if row.len() == TUM_COLUMNS { &row[1..] } else { row };
    row.iter().all(|number| number.is_finite()) && numbers.iter().all(|number| number.abs() < MOST)
}

/// Time, position and quaternion.
const TUM_COLUMNS: usize = 8;

fn poses(text: &str, file: &Path, unit: Unit) -> Result<Vec<Stamped>, Error> {
    let mut rows = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let row: Result<Vec<f64>, _> = line.split_ascii_whitespace().map(str::parse).collect();
        match row {
            Ok(row) if is_pose(&row) => rows.push((i + 1, row)),
            _ => return Err(Error::malformed(file, format!("line {}", i + 1), "not a row of numbers", HELP)),
        }
    }
    let tum = rows.first().is_some_and(|(_, row)| row.len() == TUM_COLUMNS);
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
        let write = |text: &str| std::fs::write(folder.path().join("camera_intrinsic.json"), text).unwrap();
        assert!(
            camera(folder.path(), Path::new("0.png"), &Options::default()).unwrap().1.is_some(),
            "without a file the camera is assumed, and said"
        );
        let image = folder.path().join("0.png");
        let mut png = Vec::new();
        let mut encoder = png::Encoder::new(&mut png, 8, 6);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.write_header().unwrap().write_image_data(&[0; 96]).unwrap();
        std::fs::write(&image, png).unwrap();
        write(r#"{"width": 8, "height": 6, "intrinsic_matrix": [500, 0, 0, 0, 510, 0, 4, 3, 1]}"#);
        let (read, assumed) = camera(folder.path(), &image, &Options::default()).unwrap();
        assert_eq!((read.fx, read.fy, read.cx, read.cy, assumed), (500.0, 510.0, 4.0, 3.0, None));
        write(r#"{"width": 8, "height": 6, "intrinsic_matrix": [0, 0, 0, 0, 510, 0, 4, 3, 1]}"#);
        assert!(camera(folder.path(), &image, &Options::default()).unwrap_err().to_string().contains("fx"));
        write("{");
        assert!(
            camera(folder.path(), &image, &Options::default())
                .unwrap_err()
                .to_string()
                .contains("camera_intrinsic.json")
        );
    }

    #[test]
    fn redwood_and_tum_say_the_same() {
        // A quarter turn about z, then 1, 2, 3 m.
        let redwood = read("0 0 1\n0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n").unwrap();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let tum = read(&format!("# time x y z q\n1305031102.1611 1 2 3 0 0 {half} {half}\n")).unwrap();
        let point = nalgebra::Point3::new(10.0, 0.0, 0.0);
        for pose in [redwood[0], tum[0]] {
            assert!((pose * point - nalgebra::Point3::new(1000.0, 2010.0, 3000.0)).norm() < 1e-9);
        }
    }

    #[test]
    fn a_trajectory_of_open3d_says_where_the_base_is_seen_from_the_camera() {
        // The inverse of the pose of the test above, column by column.
        let value = serde_json::json!({"class_name": "PinholeCameraTrajectory", "parameters": [
            {"extrinsic": [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, -2, 1, -3, 1]}]});
        let file = Path::new("trajectory.json");
        let read = open3d_poses(&value, file, Unit::Metre).unwrap();
        let at = read[0].1 * nalgebra::Point3::new(10.0, 0.0, 0.0);
        assert!((at - nalgebra::Point3::new(1000.0, 2010.0, 3000.0)).norm() < 1e-9, "{at}");
        let wrong = serde_json::json!({"parameters": [{"extrinsic": [1, 2]}]});
        let error = open3d_poses(&wrong, file, Unit::Metre).unwrap_err().to_string();
        assert!(error.contains("trajectory.json") && error.contains("parameters[0]"), "{error}");
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
