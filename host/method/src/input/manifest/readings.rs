//! Other ways in which the poses and depths of a manifest may have been meant: each is tried where the views disagree.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde_json::Value;

use super::{Entry, Manifest};
use crate::geometry::cloud::View;
use crate::input::direction::Trial;
use crate::input::misreading::{self, Reading};
use crate::input::transform;
use crate::input::units::Unit;

/// Other ways to read the poses, the hand-eye transform and the depths of these views.
pub(super) fn readings(
    manifest: &Manifest,
    unit: Unit,
    hand_eye: Isometry3<f64>,
    views: &[View],
    trial: &Trial,
) -> Vec<Reading> {
    let given: Vec<Isometry3<f64>> = views.iter().map(|view| view.base_from_camera).collect();
    let names: Vec<String> = views.iter().map(|view| view.name.clone()).collect();
    let mut all = misreading::orders(&names, &given);
    let eye = if manifest.flange_from_camera.is_some() { "flange_from_camera" } else { "camera_from_flange" };
    // As the flange is, and with another hand-eye transform.
    let flange: Vec<Isometry3<f64>> = given.iter().map(|camera| camera * hand_eye.inverse()).collect();
    let with_eye = |eye: Isometry3<f64>| flange.iter().map(|pose| pose * eye).collect::<Vec<_>>();
    let at_mm = hand_eye.translation.vector.norm();
    if at_mm > 0.0 && at_mm < LEAST_MOUNT_MM {
        let in_metres =
            Isometry3::from_parts((hand_eye.translation.vector * 1000.0).into(), hand_eye.rotation);
        let write = format!("Multiply the translation of {eye} by 1000: it is in `units`, as the poses are");
        all.push(Reading::new(format!("the translation of {eye} is in metres"), write, with_eye(in_metres)));
    }
    let turned = Isometry3::from_parts(hand_eye.translation, hand_eye.rotation.inverse());
    let write = format!("Write the matrix of {eye} row by row");
    all.push(Reading::new(format!("the rotation of {eye} is transposed"), write, with_eye(turned)));
    let half = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    let write =
        "Save the images as the camera sees them, or turn its intrinsics and hand-eye transform with them";
    all.push(Reading::new("the images are turned by 180 degrees", write, with_eye(hand_eye * half)));
    all.extend(readings_of_depths(manifest, &given));
    all.extend(readings_of_poses(manifest, unit, hand_eye, &flange, trial));
    all
}

/// Other ways to read poses that are the camera's own, and the depths of these views.
pub(super) fn readings_of_cameras(manifest: &Manifest, key: &str, views: &[View]) -> Vec<Reading> {
    let given: Vec<Isometry3<f64>> = views.iter().map(|view| view.base_from_camera).collect();
    let names: Vec<String> = views.iter().map(|view| view.name.clone()).collect();
    let mut all = misreading::orders(&names, &given);
    let other = |of: &dyn Fn(&Isometry3<f64>) -> Isometry3<f64>| given.iter().map(of).collect::<Vec<_>>();
    let inverted = key == "camera_from_base";
    let transposed = other(&|pose| {
        let written = if inverted { pose.inverse() } else { *pose };
        let read = Isometry3::from_parts(written.translation, written.rotation.inverse());
        if inverted { read.inverse() } else { read }
    });
    let says = format!("the rotations of {key} are transposed");
    all.push(Reading::new(says, "Write the matrices row by row", transposed));
    let half = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let write = match inverted {
        false => "Turn each pose's camera: base_from_camera @ diag(1, -1, -1, 1)",
        true => "Turn each pose's camera: diag(1, -1, -1, 1) @ camera_from_base",
    };
    let says =
        "the poses are of a camera whose y points up and whose z points back, as OpenGL's and Blender's";
    all.push(Reading::new(says, write, other(&|pose| pose * half)));
    for (times, is, should) in [(1000.0, "metres", "millimetres"), (0.001, "millimetres", "metres")] {
        let moved = |pose: &Isometry3<f64>| {
            Isometry3::from_parts((pose.translation.vector * times).into(), pose.rotation)
        };
        let says = format!("the positions of the poses are in {is} and not in {should}");
        let write = "Positions of poses are in `units`: convert them, or say the unit that they are in";
        all.push(Reading::new(says, write, other(&moved)));
    }
    all.extend(readings_of_depths(manifest, &given));
    all
}

/// Other metres in one step of the images.
fn readings_of_depths(manifest: &Manifest, given: &[Isometry3<f64>]) -> Vec<Reading> {
    let Some(camera) = &manifest.camera else { return Vec::new() };
    let scaled = |scale: f64| {
        let depth_scale_m = camera.depth_scale_m * scale;
        let says = format!("each step of the images is {depth_scale_m} m");
        let write = format!("Write \"depth_scale_m\": {depth_scale_m} in `camera`");
        Reading { scale: scale as f32, ..Reading::new(says, write, given.to_vec()) }
    };
    [0.1, 10.0].map(scaled).into()
}

/// Nearer to the flange no camera is, mm.
const LEAST_MOUNT_MM: f64 = 5.0;

fn readings_of_poses(
    manifest: &Manifest,
    unit: Unit,
    hand_eye: Isometry3<f64>,
    flange: &[Isometry3<f64>],
    trial: &Trial,
) -> Vec<Reading> {
    let mut all = Vec::new();
    let posed = |key: fn(&Entry) -> &Option<Value>| -> Option<Vec<&Value>> {
        manifest.views.iter().map(|entry| key(entry).as_ref()).collect()
    };
    let (key, values) = if let Some(values) = posed(|entry| &entry.base_from_flange) {
        ("base_from_flange", values)
    } else if let Some(values) = posed(|entry| &entry.base_from_tcp) {
        ("base_from_tcp", values)
    } else if let Some(values) = posed(|entry| &entry.flange_from_base) {
        ("flange_from_base", values)
    } else {
        return all;
    };
    let of_unit = unit.mm();
    if key == "base_from_flange" {
        let cameras = |mm: f64| -> Vec<Isometry3<f64>> {
            flange.iter().map(|pose| pose * misreading::along_z(-mm) * hand_eye).collect()
        };
        let length_mm = misreading::tool(trial, &cameras);
        let says = format!(
            "the poses are those of a tool's tip, about {length_mm:.0} mm out along z if it stands straight out, not of the \
             flange"
        );
        let write = format!(
            "Rename `base_from_flange` to `base_from_tcp`, and write the TCP that is set, \
             \"flange_from_tcp\": [0, 0, {}, 0, 0, 0] or near it for a tool that stands straight out; \
             otherwise all six numbers of the controller, because the views do not show its sideways offset \
             or tilt",
            length_mm / of_unit
        );
        all.push(Reading::new(says, write, cameras(length_mm)));
    }
    all.extend(readings_of_values(manifest, unit, hand_eye, key, &values));
    all
}

/// What the numbers of the poses may mean instead.
fn readings_of_values(
    manifest: &Manifest,
    unit: Unit,
    hand_eye: Isometry3<f64>,
    key: &str,
    values: &[&Value],
) -> Vec<Reading> {
    let mut all = Vec::new();
    let tcp = manifest.flange_from_tcp.as_ref().and_then(|tcp| transform::parse(tcp, unit).ok());
    let camera = |pose: Isometry3<f64>| match key {
        "flange_from_base" => pose.inverse() * hand_eye,
        "base_from_tcp" => pose * tcp.unwrap_or_default().inverse() * hand_eye,
        _ => pose * hand_eye,
    };
    let mut push = |says: &str, write: String, poses: Option<Vec<Isometry3<f64>>>| {
        let cameras = poses.map(|poses| poses.into_iter().map(camera).collect());
        all.extend(cameras.map(|cameras| Reading::new(says, write, cameras)));
    };
    let pose =
        |[x, y, z]: [f64; 3], turn| Isometry3::from_parts((Vector3::new(x, y, z) * unit.mm()).into(), turn);
    if let Some(all_six) = values.iter().map(|value| six_numbers(value)).collect::<Option<Vec<_>>>() {
        for k in 0..misreading::angles([0.0; 3]).len() {
            let read = |[x, y, z, a, b, c]: [f64; 6]| pose([x, y, z], misreading::angles([a, b, c])[k].1);
            let poses: Vec<_> = all_six.iter().copied().map(read).collect();
            let (at, turn) = (all_six[0], poses[0].rotation.scaled_axis());
            let write = format!(
                "Write rotation vectors in rad: views[0] then has \"{key}\": [{}, {}, {}, {:.6}, {:.6}, {:.6}]",
                at[0], at[1], at[2], turn.x, turn.y, turn.z
            );
            push(misreading::angles([0.0; 3])[k].0, write, Some(poses));
        }
    }
    for [is, other] in [["quaternion_xyzw", "quaternion_wxyz"], ["quaternion_wxyz", "quaternion_xyzw"]] {
        let renamed = |value: &&Value| {
            let mut named = value.as_object()?.clone();
            let quaternion = named.remove(is)?;
            named.insert(other.into(), quaternion);
            transform::parse(&Value::Object(named), unit).ok()
        };
        let says = format!("w is {} in the quaternions", if is.ends_with("xyzw") { "first" } else { "last" });
        push(&says, format!("Rename {is} to {other}"), values.iter().map(renamed).collect());
    }
    let transposed = |value: &&Value| {
        value.as_array().filter(|rows| matches!(rows.len(), 4 | 16))?;
        let read = transform::parse(value, unit).ok()?;
        Some(Isometry3::from_parts(read.translation, read.rotation.inverse()))
    };
    let says = format!("the rotations of {key} are transposed");
    push(&says, "Write the matrices row by row".into(), values.iter().map(transposed).collect());
    all
}

/// A place and three angles, however they are written.
fn six_numbers(value: &Value) -> Option<[f64; 6]> {
    if let Ok(six) = serde_json::from_value(value.clone()) {
        return Some(six);
    }
    let three = |key: &str| serde_json::from_value::<[f64; 3]>(value.get(key)?.clone()).ok();
    let ([x, y, z], [a, b, c]) = (three("xyz")?, three("rotation_vector_rad")?);
    Some([x, y, z, a, b, c])
}
