//! The readers on real files that others made: every cloud, mesh and depth frame is read, with the count of its header.
//!
//! Ignored where `shared/data` does not lie beside the checkout. `--nocapture` prints what was decided for each file.

use std::path::{Path, PathBuf};

use weldpath::input;
use weldpath::input::{Options, Scan};
use weldpath_tests::shared_data;

fn files(folder: &Path, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if path.is_dir() {
            found.extend(files(&path, extensions));
        } else if extensions.contains(&extension.as_str()) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Images without a camera are taken for those of the PrimeSense that most of them are from.
fn read(path: &Path) -> Scan {
    let intrinsics = Some("525,525,319.5,239.5".parse().unwrap());
    let options = Options { intrinsics, ..Options::default() };
    input::read(path, &options).unwrap_or_else(|error| panic!("{error}"))
}

/// The number after a key of the header.
fn in_header(path: &Path, key: &str) -> usize {
    let bytes = std::fs::read(path).unwrap();
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(2000)]).into_owned();
    head.lines().find_map(|line| line.strip_prefix(key)?.trim().parse().ok()).unwrap()
}

/// Sum over the notes of the points that were dropped, each of which must state of how many: all, or what those before left.
fn dropped(scan: &Scan, total: usize) -> usize {
    let counts = scan.notes.iter().filter_map(|note| note.split_once("dropped "));
    counts.fold(0, |before, (_, text)| {
        let words: Vec<&str> = text.split(' ').collect();
        let [dropped, of] = [words[0], words[2]].map(|word| word.parse::<usize>().unwrap());
        assert!(of == total || of == total - before, "{text}");
        before + dropped
    })
}

fn print(path: &Path, scan: &Scan) {
    let view = &scan.views[0];
    println!("{:7} {} | {:?} | {:?}", view.points_mm.len(), path.display(), scan.notes, scan.warnings);
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn every_real_cloud_has_the_points_of_its_header() {
    let real = shared_data("real");
    for path in files(&real, &["pcd", "ply"]) {
        let scan = read(&path);
        print(&path, &scan);
        let pcd = path.extension().is_some_and(|e| e == "pcd");
        let total = in_header(&path, if pcd { "POINTS " } else { "element vertex " });
        let sampled = scan.notes.iter().any(|note| note.starts_with("mesh of "));
        assert!(
            sampled || scan.views[0].points_mm.len() + dropped(&scan, total) == total,
            "{}",
            path.display()
        );
        assert!(scan.views[0].points_mm.iter().all(|p| p.coords.iter().all(|c| c.is_finite())));
    }
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn every_real_mesh_and_depth_frame_is_read() {
    let real = shared_data("real");
    for path in files(&real, &["stl", "obj", "png"]) {
        let scan = read(&path);
        print(&path, &scan);
        let view = &scan.views[0];
        assert!(view.points_mm.len() > 1000, "{}", path.display());
        assert!(view.normals.is_empty() || view.normals.len() == view.points_mm.len());
    }
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn neighbourhoods_of_csv_points_are_read() {
    let real = shared_data("real");
    for name in ["1264.csv", "1278.csv"] {
        let path = real.join("blackhorsewu+CoboWeld/src/coboweld_core/src/script").join(name);
        let rows = std::fs::read_to_string(&path).unwrap().lines().count() - 1;
        let scan = read(&path);
        print(&path, &scan);
        assert_eq!(scan.views[0].points_mm.len(), rows);
    }
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn every_simulated_scan_has_a_view_for_each_pose() {
    let scans = shared_data("scans");
    for path in files(&scans, &["json"]).into_iter().filter(|path| path.ends_with("scan.json")) {
        let views = std::fs::read_to_string(&path).unwrap().matches("base_from_flange").count();
        let scan = read(path.parent().unwrap());
        print(&path, &scan);
        assert_eq!((scan.views.len(), scan.warnings.len()), (views, 0), "{}", path.display());
        assert_eq!(scan.inputs.len(), views + 1);
    }
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn a_folder_of_depth_frames_takes_its_redwood_trajectory() {
    let real = shared_data("real");
    let folder = real.join("isl-org+Open3D/examples/TestData/RGBD");
    let scan = read(&folder);
    assert_eq!(scan.views.len(), 5);
    let first = &scan.views[0].base_from_camera.translation.vector;
    assert!((first.z - 2_126.480_018).abs() < 1e-3 && (first.x + 310.579_970).abs() < 1e-3, "{first}");
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn clouds_of_known_frame_and_unit_are_taken_as_such() {
    let real = shared_data("real");
    for (path, camera_known) in [
        ("blackhorsewu+CoboWeld/src/coboweld_core/src/script/nodownsample.pcd", true),
        ("blackhorsewu+CoboWeld/src/coboweld_core/src/script/3mmvoxel.pcd", true),
        ("romi-lab+robotic-sealing/seam_tracking/T-Joint/RGB_D_PCD/pc0001.pcd", true),
        ("PointCloudLibrary+pcl/test/table_scene_mug_stereo_textured.pcd", true),
        ("pengrui-rio+welding-robot/pointcloud_dataset/driver_test_cloud.pcd", false),
        ("pengrui-rio+welding-robot/pointcloud_dataset/Thu_Apr_2_10_14_30/3_frame.pcd", true),
        ("abhinand4as+weld_seam_ros2/assets/lap_joint_test.pcd", false),
        ("abhinand4as+weld_seam_ros2/assets/lap_joint_with_table.pcd", false),
    ] {
        let scan = read(&real.join(path));
        assert_eq!(scan.views[0].camera_known, camera_known, "{path}");
        assert!(scan.notes.iter().any(|note| note.starts_with("units: metres")), "{path}: {:?}", scan.notes);
    }
    let cad = read(&real.join("romi-lab+robotic-sealing/seam_tracking/T-Joint/Model_STL/T1.STL"));
    assert!(cad.notes.iter().any(|note| note.starts_with("units: millimetres")), "{:?}", cad.notes);
}

#[test]
fn a_depth_image_alone_is_read_with_its_camera_and_refused_without() {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures/pipe");
    let image = fixture.join("view_000.png");
    let error = input::read(&image, &Options::default()).unwrap_err().to_string();
    assert!(error.contains("view_000.png") && error.contains("--intrinsics"), "{error}");

    let intrinsics = Some("600,600,319.5,239.5".parse().unwrap());
    let alone = input::read(&image, &Options { intrinsics, ..Options::default() }).unwrap();
    let scan = input::read(&fixture, &Options::default()).unwrap();
    // scan.json says 0.05 mm a count, where an image alone is read as 1 mm.
    let of_scan: Vec<_> = scan.views[0].points_mm.iter().map(|p| p * 20.0).collect();
    assert_eq!(alone.views[0].points_mm.len(), of_scan.len());
    let apart = alone.views[0].points_mm.iter().zip(&of_scan).map(|(a, b)| (a - b).norm() / b.coords.norm());
    assert!(apart.fold(0.0, f32::max) < 1e-6);
    assert!(alone.warnings.iter().any(|warning| warning.contains("1 mm")), "{:?}", alone.warnings);

    let said = Options { intrinsics, depth_scale_m: Some(0.000_05), ..Options::default() };
    let said = input::read(&image, &said).unwrap();
    assert_eq!(said.views[0].points_mm, scan.views[0].points_mm);
    assert!(said.warnings.is_empty(), "{:?}", said.warnings);
}
