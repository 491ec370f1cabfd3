//! Reads `poses.json` and `poses.yaml` as ROS's tools read a geometry_msgs/PoseArray: every field by its name, none
//! beyond those of the message.

use nalgebra::{Matrix3, Vector3};
use serde_json::{Map, Value};

use crate::robot::{number, require};

/// A pose: m, and the tool's axes in the columns.
pub type Pose = (Vector3<f64>, Matrix3<f64>);

/// `poses.json`: the frame and the poses.
///
/// # Errors
/// The first rule of the message that is broken.
pub fn json(text: &str) -> Result<(String, Vec<Pose>), String> {
    message(&serde_json::from_str(text).map_err(|error| error.to_string())?)
}

/// `poses.yaml`: the same.
///
/// # Errors
/// The first rule that is broken.
pub fn yaml(text: &str) -> Result<(String, Vec<Pose>), String> {
    message(&tree(text)?)
}

/// Nesting by two spaces, `- ` for entries, `{a: 1}` for flow maps, comments: YAML's forms that weldpath writes.
fn tree(text: &str) -> Result<Value, String> {
    let (mut header, mut poses) = (Map::new(), vec![]);
    let mut section = "";
    for line in text.lines().map(|line| line.split(" #").next().unwrap_or_default().trim_end()) {
        match line {
            "" => {}
            comment if comment.starts_with('#') => {}
            "header:" | "poses:" => section = line,
            entry => {
                let (key, value) = entry.split_once(": ").ok_or_else(|| format!("no key: {entry:?}"))?;
                match (section, key) {
                    ("header:", "  frame_id") => drop(header.insert("frame_id".into(), value.into())),
                    ("poses:", "- position") => {
                        poses.push(Map::from_iter([("position".into(), flow(value)?)]))
                    }
                    ("poses:", "  orientation") => {
                        let pose: &mut Map<_, _> = poses.last_mut().ok_or("orientation before a position")?;
                        pose.insert("orientation".into(), flow(value)?);
                    }
                    _ => return Err(format!("unknown key or indentation: {entry:?}")),
                }
            }
        }
    }
    let poses = poses.into_iter().map(Value::Object).collect();
    Ok(Value::Object(Map::from_iter([
        ("header".into(), Value::Object(header)),
        ("poses".into(), Value::Array(poses)),
    ])))
}

fn flow(text: &str) -> Result<Value, String> {
    let inner =
        text.strip_prefix('{').and_then(|t| t.strip_suffix('}')).ok_or(format!("no map: {text:?}"))?;
    let pair = |item: &str| {
        let (key, value) = item.trim().split_once(": ").ok_or_else(|| format!("no pair: {item:?}"))?;
        Ok((key.to_owned(), Value::from(number(value)?)))
    };
    inner.split(',').map(pair).collect::<Result<Map<_, _>, String>>().map(Value::Object)
}

fn message(value: &Value) -> Result<(String, Vec<Pose>), String> {
    let [header, poses] = fields(value, ["header", "poses"])?;
    let [frame] = fields(header, ["frame_id"])?;
    let frame = frame.as_str().ok_or("frame_id is no string")?;
    let poses = poses.as_array().ok_or("poses is no list")?;
    let poses = poses.iter().enumerate();
    let read = poses.map(|(i, value)| pose(value).map_err(|why| format!("pose {i}: {why}")));
    Ok((frame.to_owned(), read.collect::<Result<_, _>>()?))
}

fn pose(value: &Value) -> Result<Pose, String> {
    let [position, orientation] = fields(value, ["position", "orientation"])?;
    let [px, py, pz] = numbers(position, ["x", "y", "z"])?;
    let [x, y, z, w] = numbers(orientation, ["x", "y", "z", "w"])?;
    let norm = (x * x + y * y + z * z + w * w).sqrt();
    require((norm - 1.0).abs() < 1e-6, || format!("quaternion of norm {norm}"))?;
    let rotation = Matrix3::new(
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - z * w),
        2.0 * (x * z + y * w),
        2.0 * (x * y + z * w),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - x * w),
        2.0 * (x * z - y * w),
        2.0 * (y * z + x * w),
        1.0 - 2.0 * (x * x + y * y),
    );
    Ok((Vector3::new(px, py, pz), rotation))
}

/// Exactly these fields.
fn fields<'a, const N: usize>(value: &'a Value, names: [&str; N]) -> Result<[&'a Value; N], String> {
    let map = value.as_object().ok_or_else(|| format!("no map: {value}"))?;
    if let Some(unknown) = map.keys().find(|key| !names.contains(&key.as_str())) {
        return Err(format!("unknown field {unknown}"));
    }
    let found: Vec<&Value> = names
        .iter()
        .map(|name| map.get(*name).ok_or(format!("no field {name}")))
        .collect::<Result<_, _>>()?;
    found.try_into().map_err(|_| "as many as names".into())
}

fn numbers<const N: usize>(value: &Value, names: [&str; N]) -> Result<[f64; N], String> {
    let found = fields(value, names)?;
    let mut numbers = [0.0; N];
    for (number, field) in numbers.iter_mut().zip(found) {
        *number = field.as_f64().ok_or_else(|| format!("no number: {field}"))?;
    }
    Ok(numbers)
}
