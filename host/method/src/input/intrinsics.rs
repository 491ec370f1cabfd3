//! A camera from the JSON of another tool: Open3D's, RealSense's (as pyrealsense2 names its fields) and Azure Kinect's, either the
//! parameters of a stream or the raw calibration that the device holds.

use serde_json::Value;

use super::camera::{Camera, Distortion};

/// What is wrong, and a way out.
type Fault = (String, &'static str);

const HELP: &str = "Read are Open3D's (width, height, intrinsic_matrix column by column), RealSense's (width, height, fx, fy, \
                    ppx, ppy, model, coeffs) and Azure Kinect's (fx, fy, cx, cy, k1 to k6, p1, p2, or its raw calibration); or \
                    give them with --intrinsics";

/// The camera of a file's JSON, for images of this size.
pub(super) fn parse(value: &Value, size_px: [u32; 2], depth_scale_m: f64) -> Result<Camera, Fault> {
    // Several streams in one file: that of the depth.
    let of_depth = ["depth", "depth_intrinsics", "intrinsics", "intrinsic"];
    let inner = of_depth.iter().find_map(|key| value.get(key).filter(|inner| inner.is_object()));
    let value = inner.unwrap_or(value);
    let (own, focal, centre, distortion) = if let Some(cameras) =
        value.pointer("/CalibrationInformation/Cameras")
    {
        return azure_raw(cameras, size_px, depth_scale_m);
    } else if let Some(matrix) = value.get("intrinsic_matrix") {
        let [fx, _, _, _, fy, _, cx, cy, _] = open3d_matrix(matrix)?;
        (size(value), [fx, fy], [cx, cy], Distortion::default())
    } else if value.get("ppx").is_some() {
        (size(value), numbers(value, ["fx", "fy"])?, numbers(value, ["ppx", "ppy"])?, realsense_lens(value)?)
    } else if value.get("fx").is_some() {
        (size(value), numbers(value, ["fx", "fy"])?, numbers(value, ["cx", "cy"])?, azure_lens(value))
    } else {
        return Err(("it holds no camera in a known form".into(), HELP));
    };
    let [width, height] = own.unwrap_or(size_px);
    Ok(Camera {
        width,
        height,
        fx: focal[0],
        fy: focal[1],
        cx: centre[0],
        cy: centre[1],
        depth_scale_m,
        distortion,
    })
}

fn number(value: &Value, key: &str) -> Option<f64> {
    value.get(key)?.as_f64()
}

fn numbers<const N: usize>(value: &Value, keys: [&str; N]) -> Result<[f64; N], Fault> {
    let missing = keys.iter().find(|key| number(value, key).is_none());
    match missing {
        Some(key) => Err((format!("{key} is missing or no number"), HELP)),
        None => Ok(keys.map(|key| number(value, key).unwrap_or_default())),
    }
}

fn size(value: &Value) -> Option<[u32; 2]> {
    let side = |key: &str| u32::try_from(value.get(key)?.as_u64()?).ok();
    Some([side("width")?, side("height")?])
}

/// Nine numbers column by column.
fn open3d_matrix(matrix: &Value) -> Result<[f64; 9], Fault> {
    let nine: Option<[f64; 9]> = serde_json::from_value(matrix.clone()).ok();
    nine.ok_or_else(|| ("intrinsic_matrix has not nine numbers".into(), HELP))
}

/// Both spellings: `distortion.brown_conrady` of Python, and the words of the viewer.
fn realsense_lens(value: &Value) -> Result<Distortion, Fault> {
    let coefficients: Vec<f64> =
        value.get("coeffs").and_then(|list| serde_json::from_value(list.clone()).ok()).unwrap_or_default();
    if coefficients.iter().all(|c| *c == 0.0) {
        return Ok(Distortion::default());
    }
    let model = value.get("model").and_then(Value::as_str).unwrap_or_default().to_lowercase();
    if model.contains("inverse") || !model.contains("brown") {
        let problem = format!("the lens is described by {model:?}, which is not read");
        return Err((
            problem,
            "The depth stream comes rectified, with coefficients of 0: give the intrinsics of that one",
        ));
    }
    let [k1, k2, p1, p2, k3] = coefficients[..] else {
        return Err((format!("coeffs has {} numbers, not 5", coefficients.len()), HELP));
    };
    Ok(Distortion { k1, k2, p1, p2, k3, ..Distortion::default() })
}

/// OpenCV's rational model, as the sensor SDK hands it out.
fn azure_lens(value: &Value) -> Distortion {
    let of = |key: &str| number(value, key).unwrap_or_default();
    let [k1, k2, k3, k4, k5, k6] = ["k1", "k2", "k3", "k4", "k5", "k6"].map(of);
    Distortion { k1, k2, p1: of("p1"), p2: of("p2"), k3, k4, k5, k6 }
}

/// Modes of the depth sensor: the side of its whole image, what is cut off at the left and at the top, and what is left, px
/// (Azure Kinect Sensor SDK).
const AZURE_MODES: [(f64, [f64; 2], [u32; 2]); 4] = [
    (512.0, [96.0, 90.0], [320, 288]),
    (1024.0, [192.0, 180.0], [640, 576]),
    (512.0, [0.0, 0.0], [512, 512]),
    (1024.0, [0.0, 0.0], [1024, 1024]),
];

/// The raw calibration: parameters as shares of the sensor's side, in the order cx, cy, fx, fy, k1 to k6, codx, cody, p2, p1.
fn azure_raw(cameras: &Value, size_px: [u32; 2], depth_scale_m: f64) -> Result<Camera, Fault> {
    let is_depth = |camera: &&Value| {
        camera.get("Location").and_then(Value::as_str) == Some("CALIBRATION_CameraLocationD0")
    };
    let depth = cameras.as_array().and_then(|all| all.iter().find(is_depth));
    let list = depth.and_then(|camera| camera.pointer("/Intrinsics/ModelParameters"));
    let list: Option<Vec<f64>> = list.and_then(|list| serde_json::from_value(list.clone()).ok());
    let [cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, codx, cody, p2, p1] = list.unwrap_or_default()[..] else {
        return Err(("its depth camera (D0) has not 14 ModelParameters".into(), HELP));
    };
    if codx != 0.0 || cody != 0.0 {
        return Err(("its centre of distortion is not that of the image".into(), HELP));
    }
    let mode = AZURE_MODES.iter().find(|mode| mode.2 == size_px);
    let Some((side, [left, top], [width, height])) = mode.copied() else {
        let problem =
            format!("the image is {}x{}, which is not a depth mode of Azure Kinect", size_px[0], size_px[1]);
        return Err((problem, "Give depth images as they come, not those moved into the colour camera"));
    };
    let distortion = Distortion { k1, k2, p1, p2, k3, k4, k5, k6 };
    let centre = |share: f64, cut: f64| share * side - cut - 0.5;
    let (fx, fy, cx, cy) = (fx * side, fy * side, centre(cx, left), centre(cy, top));
    Ok(Camera { width, height, fx, fy, cx, cy, depth_scale_m, distortion })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(value: &Value) -> Result<Camera, Fault> {
        parse(value, [640, 576], 0.001)
    }

    #[test]
    fn three_makers_describe_one_camera() {
        let azure = json!({"CalibrationInformation": {"Cameras": [
            {"Location": "CALIBRATION_CameraLocationPV0", "Intrinsics": {"ModelParameters": []}},
            {"Location": "CALIBRATION_CameraLocationD0", "Intrinsics": {"ModelParameters":
                [0.5, 0.5, 0.4921875, 0.4921875, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]}}]}});
        for value in [
            json!({"width": 640, "height": 576, "intrinsic_matrix": [504, 0, 0, 0, 504, 0, 319.5, 331.5, 1]}),
            json!({"width": 640, "height": 576, "fx": 504, "fy": 504, "ppx": 319.5, "ppy": 331.5,
                "model": "distortion.inverse_brown_conrady", "coeffs": [0, 0, 0, 0, 0]}),
            json!({"depth": {"width": 640, "height": 576, "fx": 504, "fy": 504, "cx": 319.5, "cy": 331.5}}),
            azure,
        ] {
            let read = read(&value).unwrap();
            assert_eq!((read.width, read.height), (640, 576), "{value}");
            assert_eq!((read.fx, read.fy, read.cx, read.cy), (504.0, 504.0, 319.5, 331.5), "{value}");
            assert_eq!((read.distortion, read.fault()), (Distortion::default(), None), "{value}");
        }
    }

    #[test]
    fn coefficients_go_where_each_maker_has_them() {
        let realsense = json!({"fx": 500, "fy": 500, "ppx": 320, "ppy": 240, "model": "distortion.brown_conrady",
            "coeffs": [0.1, 0.2, 0.01, 0.02, 0.3]});
        let lens = read(&realsense).unwrap().distortion;
        assert_eq!(
            lens,
            Distortion { k1: 0.1, k2: 0.2, p1: 0.01, p2: 0.02, k3: 0.3, ..Distortion::default() }
        );
        let azure = json!({"fx": 500, "fy": 500, "cx": 320, "cy": 240, "k1": 0.1, "k6": 0.6, "p2": 0.02});
        let lens = read(&azure).unwrap().distortion;
        assert_eq!(lens, Distortion { k1: 0.1, k6: 0.6, p2: 0.02, ..Distortion::default() });
    }

    #[test]
    fn what_is_not_understood_is_named() {
        for (value, part) in [
            (json!({"a": 1}), "known form"),
            (json!({"intrinsic_matrix": [1, 2]}), "nine numbers"),
            (json!({"fx": 500, "fy": "a", "cx": 1, "cy": 1}), "fy is missing"),
            (
                json!({"fx": 1, "fy": 1, "ppx": 1, "ppy": 1, "model": "distortion.inverse_brown_conrady", "coeffs": [1, 0, 0, 0, 0]}),
                "inverse_brown_conrady",
            ),
            (
                json!({"fx": 1, "fy": 1, "ppx": 1, "ppy": 1, "model": "distortion.brown_conrady", "coeffs": [1]}),
                "not 5",
            ),
        ] {
            assert!(read(&value).is_err_and(|(problem, _)| problem.contains(part)), "{value}");
        }
        let raw = json!({"CalibrationInformation": {"Cameras": [{"Location": "CALIBRATION_CameraLocationD0",
            "Intrinsics": {"ModelParameters": [0.5, 0.5, 0.5, 0.5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]}}]}});
        assert!(parse(&raw, [1280, 720], 0.001).is_err_and(|(problem, _)| problem.contains("1280x720")));
    }
}
