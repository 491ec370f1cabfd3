//! A rigid transform in the forms in which people have one: matrix, rotation vector, quaternion, or a calibration's file.
//!
//! The order of a quaternion is never guessed: a bare list of seven numbers is refused.

mod matrix;

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use serde_json::Value;

use super::units::Unit;
use super::{Error, read_at_most};

/// How far the 3x3 part may be from a rotation, or a quaternion from length 1: numbers with three decimals.
const RIGID: f64 = 2e-3;
/// No rotation vector is longer, not even in degrees.
const MOST_TURN_RAD: f64 = 1000.0;
/// A calibration is not larger than this, bytes.
const LARGEST_FILE: usize = 1 << 16;

/// What is wrong, and a way out.
pub(super) type Fault = (String, &'static str);

const FORMS: &str = "Give a 4x4 matrix row by row, [x, y, z, rx, ry, rz] with a rotation vector in rad, or \
                     {\"xyz\": [..], \"quaternion_xyzw\": [..]} (or \"quaternion_wxyz\", \"rotation_vector_rad\")";

#[derive(Deserialize)]
#[serde(untagged)]
enum Form {
    Matrix([[f64; 4]; 4]),
    Flat([f64; 16]),
    Vector([f64; 6]),
    Named(Named),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Named {
    xyz: [f64; 3],
    quaternion_xyzw: Option<[f64; 4]>,
    quaternion_wxyz: Option<[f64; 4]>,
    rotation_vector_rad: Option<[f64; 3]>,
}

/// The transform in mm; its translation is in `unit`.
pub(super) fn parse(value: &Value, unit: Unit) -> Result<Isometry3<f64>, Fault> {
    if value.as_array().is_some_and(|list| list.len() == 7) {
        let problem = "seven numbers do not say where the quaternion's w is".into();
        return Err((problem, "Write {\"xyz\": [..], \"quaternion_xyzw\": [..]} or \"quaternion_wxyz\""));
    }
    let form: Form =
        serde_json::from_value(value.clone()).map_err(|_| ("not a form of a transform".into(), FORMS))?;
    match form {
        Form::Matrix(rows) => from_rows(&rows, unit),
        Form::Flat(n) => {
            let row = |k: usize| [n[4 * k], n[4 * k + 1], n[4 * k + 2], n[4 * k + 3]];
            from_rows(&[row(0), row(1), row(2), row(3)], unit)
        }
        Form::Vector([x, y, z, rx, ry, rz]) => from_vector([x, y, z], [rx, ry, rz], unit),
        Form::Named(named) => from_named(&named, unit),
    }
}

fn from_named(named: &Named, unit: Unit) -> Result<Isometry3<f64>, Fault> {
    match (named.quaternion_xyzw, named.quaternion_wxyz, named.rotation_vector_rad) {
        (Some(xyzw), None, None) => from_quaternion(named.xyz, xyzw, unit),
        (None, Some([w, x, y, z]), None) => from_quaternion(named.xyz, [x, y, z, w], unit),
        (None, None, Some(vector)) => from_vector(named.xyz, vector, unit),
        _ => Err(("its rotation is given more than once, or not at all".into(), FORMS)),
    }
}

fn from_vector(at: [f64; 3], vector: [f64; 3], unit: Unit) -> Result<Isometry3<f64>, Fault> {
    let vector = Vector3::from(vector);
    if vector.amax() > MOST_TURN_RAD {
        return Err(("its last three numbers are a rotation vector in rad".into(), FORMS));
    }
    Ok(rigid(at, UnitQuaternion::from_scaled_axis(vector), unit))
}

pub(super) fn from_quaternion(
    at: [f64; 3],
    [x, y, z, w]: [f64; 4],
    unit: Unit,
) -> Result<Isometry3<f64>, Fault> {
    let quaternion = Quaternion::new(w, x, y, z);
    if (quaternion.norm() - 1.0).abs() > RIGID {
        return Err((
            format!("the quaternion has length {:.4}", quaternion.norm()),
            "Its length is 1: check the numbers",
        ));
    }
    Ok(rigid(at, UnitQuaternion::from_quaternion(quaternion), unit))
}

pub(super) fn from_rows(rows: &[[f64; 4]; 4], unit: Unit) -> Result<Isometry3<f64>, Fault> {
    let column = [rows[0][3], rows[1][3], rows[2][3], rows[3][3]];
    if column == [0.0, 0.0, 0.0, 1.0] && rows[3] != column {
        let problem = format!("it is written column by column: its last row is {:?}", rows[3]);
        return Err((problem, "Transpose it: the position is the last column, and the last row 0 0 0 1"));
    }
    if rows[3].iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(a, b)| (a - b).abs() > 1e-9) {
        return Err((
            format!("the last row is {:?}, not 0 0 0 1", rows[3]),
            "The matrix is written row by row",
        ));
    }
    let rotation = Matrix3::from_fn(|r, c| rows[r][c]);
    let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
    if off.is_nan() || off > RIGID {
        return Err((
            format!("its 3x3 part is not a rotation: R^T R differs from 1 by {off:.2e}"),
            "Check that no scale is in it and that no row is missing",
        ));
    }
    if rotation.determinant() < 0.0 {
        let problem = "its 3x3 part is a reflection: determinant -1".into();
        return Err((problem, "Check the handedness of the axes"));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    Ok(rigid([rows[0][3], rows[1][3], rows[2][3]], rotation, unit))
}

fn rigid(at: [f64; 3], rotation: UnitQuaternion<f64>, unit: Unit) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(Vector3::from(at) * unit.mm()), rotation)
}

/// Where the camera is that a file with its transform is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mount {
    /// On the flange: `flange_from_camera`.
    Flange,
    /// Beside the robot: `base_from_camera`.
    Stand,
}

/// The camera's transform in mm from a calibration's file: of easy_handeye (ROS 1) and easy_handeye2 (ROS 2), which are metres, or
/// a matrix of OpenCV's FileStorage or of Zivid.
pub(super) fn of_file(file: &Path, mount: Mount) -> Result<Isometry3<f64>, Error> {
    let bytes = read_at_most(file, super::SETTINGS_BYTES)?;
    let bad = |problem: String, help: &str| Error::malformed(file, "calibration", problem, help);
    if bytes.len() > LARGEST_FILE {
        return Err(bad(format!("{} bytes are too many for a calibration", bytes.len()), HANDEYE));
    }
    let fault = |(problem, help): Fault| bad(problem, help);
    let value = value(&bytes).map_err(|problem| bad(problem, HANDEYE))?;
    if let Some(matrix) = matrix::of(&value) {
        return matrix.map_err(fault);
    }
    let saved: Saved = serde_json::from_value(value).map_err(|error| bad(error.to_string(), HANDEYE))?;
    let parameters = saved.parameters.unwrap_or_default();
    let is_stand = saved.eye_on_hand.or(parameters.eye_on_hand) == Some(false)
        || parameters.calibration_type.as_deref() == Some("eye_on_base");
    let is_flange = saved.eye_on_hand.or(parameters.eye_on_hand) == Some(true)
        || parameters.calibration_type.as_deref() == Some("eye_in_hand");
    if is_stand && mount == Mount::Flange {
        let problem = "it is of a camera that stands beside the robot (eye on base)".into();
        let help = "Leave flange_from_camera out, and name this file as \"base_from_camera\" in each view";
        return Err(bad(problem, help));
    }
    if is_flange && mount == Mount::Stand {
        let problem = "it is of a camera on the flange (eye on hand)".into();
        return Err(bad(
            problem,
            "Name it as \"flange_from_camera\", and give each view its \"base_from_flange\"",
        ));
    }
    match (saved.transformation, saved.transform) {
        (Some(t), None) => {
            from_quaternion([t.x, t.y, t.z], [t.qx, t.qy, t.qz, t.qw], Unit::Metre).map_err(fault)
        }
        (None, Some(Transform { translation: t, rotation: q })) => {
            from_quaternion([t.x, t.y, t.z], [q.x, q.y, q.z, q.w], Unit::Metre).map_err(fault)
        }
        _ => Err(bad("it holds no transform in a known form".into(), HANDEYE)),
    }
}

const HANDEYE: &str = "Give the file that easy_handeye or easy_handeye2 saved, a 4x4 matrix of OpenCV's FileStorage or of \
                       Zivid, or the transform itself";

#[cfg(feature = "yaml")]
fn value(bytes: &[u8]) -> Result<Value, String> {
    let first_line = |text: String| text.lines().next().unwrap_or_default().to_owned();
    serde_saphyr::from_slice(&matrix::plain_yaml(bytes)).map_err(|error| first_line(error.to_string()))
}

/// JSON, of which every file is YAML, is all that this build reads.
#[cfg(not(feature = "yaml"))]
fn value(bytes: &[u8]) -> Result<Value, String> {
    serde_json::from_slice(bytes)
        .map_err(|error| format!("no JSON, and YAML needs the feature `yaml`: {error}"))
}

/// Where a hand-eye transform is a file's name, the file beside `scan.json`.
pub(super) fn file_beside(path: &Path, name: &str) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).join(name)
}

/// Both layouts; ROS 1 has its parameters at the top or below `parameters`.
#[derive(Deserialize)]
struct Saved {
    #[serde(default)]
    parameters: Option<Parameters>,
    #[serde(default)]
    eye_on_hand: Option<bool>,
    #[serde(default)]
    transformation: Option<Transformation>,
    #[serde(default)]
    transform: Option<Transform>,
}

#[derive(Default, Deserialize)]
struct Parameters {
    #[serde(default)]
    eye_on_hand: Option<bool>,
    #[serde(default)]
    calibration_type: Option<String>,
}

#[derive(Deserialize)]
struct Transformation {
    x: f64,
    y: f64,
    z: f64,
    qx: f64,
    qy: f64,
    qz: f64,
    qw: f64,
}

#[derive(Deserialize)]
struct Transform {
    translation: Xyz,
    rotation: Xyzw,
}

#[derive(Deserialize)]
struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Deserialize)]
struct Xyzw {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// A third of a turn about (1, 1, 1) carries x to y, y to z, z to x.
    fn carries_axes_round(transform: &Isometry3<f64>) -> bool {
        let turned = (transform.rotation * Vector3::x() - Vector3::y()).norm();
        let moved = transform.translation.vector - Vector3::new(10.0, -20.0, 30.0);
        turned < 1e-6 && moved.norm() < 1e-6
    }

    #[test]
    fn every_form_says_the_same() {
        let third = 2.0 * std::f64::consts::FRAC_PI_3 / 3f64.sqrt();
        for value in [
            json!([[0, 0, 1, 0.01], [1, 0, 0, -0.02], [0, 1, 0, 0.03], [0, 0, 0, 1]]),
            json!([0, 0, 1, 0.01, 1, 0, 0, -0.02, 0, 1, 0, 0.03, 0, 0, 0, 1]),
            json!([0.01, -0.02, 0.03, third, third, third]),
            json!({"xyz": [0.01, -0.02, 0.03], "quaternion_xyzw": [0.5, 0.5, 0.5, 0.5]}),
            json!({"xyz": [0.01, -0.02, 0.03], "quaternion_wxyz": [-0.5, -0.5, -0.5, -0.5]}),
            json!({"xyz": [0.01, -0.02, 0.03], "rotation_vector_rad": [third, third, third]}),
        ] {
            assert!(carries_axes_round(&parse(&value, Unit::Metre).unwrap()), "{value}");
        }
    }

    #[test]
    fn the_two_orders_of_a_quaternion_differ_and_no_order_is_guessed() {
        let xyzw = parse(&json!({"xyz": [0, 0, 0], "quaternion_xyzw": [1, 0, 0, 0]}), Unit::Metre).unwrap();
        let wxyz = parse(&json!({"xyz": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}), Unit::Metre).unwrap();
        assert!(wxyz.rotation.angle() < 1e-9 && xyzw.rotation.angle() > 3.0);
        for (value, word) in [
            (json!([0, 0, 0, 1, 0, 0, 0]), "w is"),
            (json!({"xyz": [0, 0, 0], "quaternion": [1, 0, 0, 0]}), "form"),
            (json!({"xyz": [0, 0, 0]}), "not at all"),
            (json!({"xyz": [0, 0, 0], "quaternion_xyzw": [1, 1, 0, 0]}), "length 1.4142"),
            (json!([0, 0, 0, 9000, 0, 0]), "rotation vector"),
            (json!("a"), "form"),
        ] {
            let (problem, _) = parse(&value, Unit::Metre).unwrap_err();
            assert!(problem.contains(word), "{value}: {problem}");
        }
    }

    fn saved(text: &str) -> Result<Isometry3<f64>, Error> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("handeye.yaml");
        std::fs::write(&file, text).unwrap();
        of_file(&file, Mount::Flange)
    }

    #[test]
    fn easy_handeye_is_read_in_both_layouts_of_ros_1_and_in_that_of_ros_2() {
        let one =
            "transformation:\n  qw: 0.5\n  qx: 0.5\n  qy: 0.5\n  qz: 0.5\n  x: 0.01\n  y: -0.02\n  z: 0.03\n";
        let flat =
            format!("eye_on_hand: true\nrobot_effector_frame: tool0\ntracking_base_frame: camera\n{one}");
        let nested =
            format!("parameters:\n  eye_on_hand: true\n  move_group: manipulator\n  namespace: /a/\n{one}");
        let two = "parameters:\n  name: demo\n  calibration_type: eye_in_hand\n  robot_effector_frame: tool0\n\
                   transform:\n  translation: {x: 0.01, y: -0.02, z: 0.03}\n  rotation:\n    x: 0.5\n    y: 0.5\n    z: 0.5\n    w: 0.5\n";
        for text in [flat.as_str(), nested.as_str(), two] {
            assert!(carries_axes_round(&saved(text).unwrap()), "{text}");
        }
        for (text, word) in [
            (nested.replace("true", "false"), "eye on base"),
            (two.replace("eye_in_hand", "eye_on_base"), "\"base_from_camera\" in each view"),
            (two.replace("w: 0.5", "w: 3"), "length"),
            ("parameters:\n  name: demo\n".into(), "no transform"),
            ("transformation: 3\n".into(), "handeye.yaml"),
            ("a: [".into(), "handeye.yaml"),
            ("# much\n".repeat(20_000), "too many"),
        ] {
            let error = saved(&text).unwrap_err().to_string();
            assert!(error.contains(word), "{text:.60}: {error}");
        }
    }
}
