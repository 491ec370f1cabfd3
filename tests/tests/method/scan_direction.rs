//! A hand-eye transform or poses given the wrong way round are named, and the same numbers under the right name are read.

use serde_json::{Value, json};
use std::path::Path;
use weldpath::files::File;
use weldpath::input::{Options, Scan, read};
use weldpath::simulation::{Part, Pose, Request, files, simulate};
use weldpath_tests::scans::Shared;

use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};

/// A simulated scan whose scan.json went through `change`.
fn changed(part: Part, pose: Pose, change: impl Fn(&mut Value)) -> Result<Scan, String> {
    static SCANS: Shared<String, Vec<File>> = Shared::new();
    let request = Request { pose, width: 320, height: 240, ..Request::new(part, 4) };
    let scan = SCANS.get(format!("{part} {pose}"), || files(&simulate(&request).unwrap()).unwrap());
    let folder = tempfile::tempdir().unwrap();
    for file in scan {
        std::fs::write(folder.path().join(&file.name), &file.bytes).unwrap();
    }
    let file = folder.path().join("scan.json");
    let mut scan: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    change(&mut scan);
    std::fs::write(&file, scan.to_string()).unwrap();
    read(Path::new(&file), &Options::default()).map_err(|e| e.to_string())
}

fn matrix(value: &Value) -> Isometry3<f64> {
    let at = |r: usize, c: usize| value[r][c].as_f64().unwrap();
    let shift = Vector3::new(at(0, 3), at(1, 3), at(2, 3));
    Isometry3::from_parts(shift.into(), UnitQuaternion::from_matrix(&Matrix3::from_fn(at)))
}

fn inverted_matrix(value: &Value) -> Value {
    let inverse = matrix(value).inverse().to_homogeneous();
    json!((0..4).map(|r| (0..4).map(|c| inverse[(r, c)]).collect::<Vec<_>>()).collect::<Vec<_>>())
}

fn inverted_pose(value: &Value) -> Value {
    let n: Vec<f64> = value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let pose = Isometry3::new(Vector3::new(n[0], n[1], n[2]), Vector3::new(n[3], n[4], n[5])).inverse();
    let (t, r) = (pose.translation.vector, pose.rotation.scaled_axis());
    json!([t.x, t.y, t.z, r.x, r.y, r.z])
}

fn invert_hand_eye(scan: &mut Value) {
    scan["flange_from_camera"] = inverted_matrix(&scan["flange_from_camera"]);
}

fn invert_poses(scan: &mut Value) {
    for view in scan["views"].as_array_mut().unwrap() {
        view["base_from_flange"] = inverted_pose(&view["base_from_flange"]);
    }
}

const SCANS: [(Part, Pose); 3] =
    [(Part::Pipe, Pose::Flat), (Part::Fillet, Pose::Tilted), (Part::Corner, Pose::Vertical)];

#[test]
fn the_right_way_round_draws_no_complaint() {
    for (part, pose) in SCANS {
        let scan = changed(part, pose, |_| {}).unwrap();
        assert!(!scan.warnings.iter().any(|w| w.contains("inverted")), "{part}: {:?}", scan.warnings);
    }
}

#[test]
fn an_inverted_hand_eye_transform_is_named_and_read_under_its_right_name() {
    for (part, pose) in SCANS {
        let error = changed(part, pose, invert_hand_eye).unwrap_err();
        assert!(
            error.contains("is it camera_from_flange?") && !error.contains("base_from_flange"),
            "{part}: {error}"
        );
        let renamed = changed(part, pose, |scan| {
            invert_hand_eye(scan);
            let value = scan.as_object_mut().unwrap().remove("flange_from_camera").unwrap();
            scan["camera_from_flange"] = value;
        });
        assert_same(&renamed.unwrap(), &changed(part, pose, |_| {}).unwrap());
    }
}

#[test]
fn inverted_poses_are_named_and_read_under_their_right_name() {
    for (part, pose) in SCANS {
        let error = changed(part, pose, invert_poses).unwrap_err();
        assert!(
            error.contains("is it flange_from_base?") && !error.contains("camera_from_flange"),
            "{part}: {error}"
        );
        let renamed = changed(part, pose, |scan| {
            invert_poses(scan);
            for view in scan["views"].as_array_mut().unwrap() {
                let value = view.as_object_mut().unwrap().remove("base_from_flange").unwrap();
                view["flange_from_base"] = value;
            }
        });
        assert_same(&renamed.unwrap(), &changed(part, pose, |_| {}).unwrap());
    }
}

#[test]
fn both_inverted_are_named_both() {
    for (part, pose) in SCANS {
        let both = |scan: &mut Value| {
            invert_hand_eye(scan);
            invert_poses(scan);
        };
        let error = changed(part, pose, both).unwrap_err();
        assert!(error.contains("is it camera_from_flange and flange_from_base?"), "{part}: {error}");
    }
}

#[test]
fn a_hand_eye_transform_inverted_under_the_other_name_is_named_too() {
    let error = changed(Part::Pipe, Pose::Flat, |scan| {
        let value = scan.as_object_mut().unwrap().remove("flange_from_camera").unwrap();
        scan["camera_from_flange"] = value;
    })
    .unwrap_err();
    assert!(
        error.contains("when camera_from_flange is inverted") && error.contains("is it flange_from_camera?"),
        "{error}"
    );
}

fn assert_same(a: &Scan, b: &Scan) {
    assert_eq!(a.views.len(), b.views.len());
    for (a, b) in a.views.iter().zip(&b.views) {
        let apart = a.base_from_camera.inverse() * b.base_from_camera;
        assert!(apart.translation.vector.norm() < 0.01 && apart.rotation.angle() < 1e-5);
    }
}
