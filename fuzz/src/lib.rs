//! What is held against hostile bytes: one function for every reader, and for the plan of small clouds.
//!
//! Each takes any bytes and panics only for a fault of weldpath's: a panic of its own, an error that does not name the
//! file, or something read that is not what its reader promises. `cargo fuzz` drives them guided by coverage, `mutate`
//! on a stable compiler by chance, and the tests of the workspace with the inputs that once failed.

pub mod seeds;

use std::path::Path;

use nalgebra::{Isometry3, Point3};
use weldpath::geometry::cloud::View;
use weldpath::input::{self, Error, Options, Scan};
use weldpath::output::json;
use weldpath::pendant::teleop::recording;
use weldpath::pipeline::{self, Config};
use weldpath::run::job::Job;
use weldpath::{CameraPose, Coordinates, PosedViews, RawCloud, RawView, Transform, Units};
use weldpath_core::wire::frame::{self, Deframer, Received};
use weldpath_core::wire::{FromHost, FromPendant};

/// A function that takes any bytes, by its name.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: [Target; 16] = [
    ("ply", ply),
    ("pcd", pcd),
    ("text", text),
    ("stl", stl),
    ("obj", obj),
    ("png", png),
    ("npy", npy),
    ("vtk", vtk),
    ("hand_eye", hand_eye),
    ("scan_json", scan_json),
    ("job", job),
    ("path_json", path_json),
    ("hands", hands),
    ("wire", wire),
    ("arrays", arrays),
    ("plan", plan),
];

/// Points of a view, or an error that names the file.
fn hold(name: &str, result: Result<Scan, Error>) {
    match result {
        Ok(scan) => {
            assert!(!scan.views.is_empty() && scan.views.iter().all(|view| !view.points_mm.is_empty()));
            let finite = |view: &View| view.points_mm.iter().all(|p| p.iter().all(|c| c.is_finite()));
            assert!(scan.views.iter().all(finite), "a point is not finite");
        }
        Err(error) => assert!(error.to_string().contains(name), "{error}"),
    }
}

/// With the camera that a depth image alone needs, whose lens distorts.
fn read(bytes: &[u8], name: &str) {
    let intrinsics = "525,525,319.5,239.5,0.1,-0.2,0.001,0.002,0.05".parse().ok();
    let options = Options { intrinsics, ..Options::default() };
    hold(name, input::read_bytes(bytes.to_vec(), Path::new(name), &options));
}

/// A PLY file.
pub fn ply(bytes: &[u8]) {
    read(bytes, "hostile.ply");
}

/// A PCD file.
pub fn pcd(bytes: &[u8]) {
    read(bytes, "hostile.pcd");
}

/// XYZ, CSV and their like.
pub fn text(bytes: &[u8]) {
    read(bytes, "hostile.csv");
}

/// An STL file, of either kind.
pub fn stl(bytes: &[u8]) {
    read(bytes, "hostile.stl");
}

/// An OBJ file.
pub fn obj(bytes: &[u8]) {
    read(bytes, "hostile.obj");
}

/// An array of NumPy.
pub fn npy(bytes: &[u8]) {
    read(bytes, "hostile.npy");
}

/// A legacy VTK file.
pub fn vtk(bytes: &[u8]) {
    read(bytes, "hostile.vtk");
}

/// A hand-eye transform in a file of its own, beside a `scan.json` that is as it should be.
pub fn hand_eye(bytes: &[u8]) {
    let Ok(folder) = tempfile::Builder::new().prefix("hostile").tempdir() else { return };
    let files = [
        ("little.ply", seeds::ascii_ply()),
        ("scan.json", seeds::BY_FILE.into()),
        ("eye.yml", bytes.to_vec()),
    ];
    if files.iter().all(|(name, bytes)| std::fs::write(folder.path().join(name), bytes).is_ok()) {
        hold("hostile", input::read(folder.path(), &Options::default()));
    }
}

/// A depth image.
pub fn png(bytes: &[u8]) {
    read(bytes, "hostile.png");
}

/// A `scan.json` beside a depth image and a cloud that are as they should be.
pub fn scan_json(bytes: &[u8]) {
    let Ok(folder) = tempfile::Builder::new().prefix("hostile").tempdir() else { return };
    let files = [("depth.png", seeds::depth_png(64, 48)), ("little.ply", seeds::ascii_ply())];
    let written = files.iter().all(|(name, bytes)| std::fs::write(folder.path().join(name), bytes).is_ok());
    if written && std::fs::write(folder.path().join("scan.json"), bytes).is_ok() {
        hold("hostile", input::read(folder.path(), &Options::default()));
    }
}

/// A job file: what is taken is written again and read as the same.
pub fn job(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    match Job::parse(text, Path::new("hostile.toml")) {
        Ok(job) => {
            let again = Job::parse(&job.to_toml(), Path::new("again.toml")).expect("a written job is one");
            assert_eq!(again.to_toml(), job.to_toml());
        }
        Err(error) => assert!(error.to_string().contains("hostile.toml"), "{error}"),
    }
}

/// A program for the pendant: what is taken is written again and read as the same.
pub fn path_json(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok((program, frame)) = json::read(text) {
        let (again, same) = json::read(&json::write(&program, frame)).expect("a written program is one");
        assert_eq!((again.len(), same), (program.len(), frame));
    }
}

/// A recording of hands: its times never run back.
pub fn hands(bytes: &[u8]) {
    let Ok(file) = tempfile::NamedTempFile::with_prefix("hostile") else { return };
    if std::fs::write(file.path(), bytes).is_ok() {
        match recording::read(file.path()) {
            Ok(frames) => assert!(frames.windows(2).all(|pair| pair[0].time_ms <= pair[1].time_ms)),
            Err(error) => assert!(error.to_string().contains("hostile"), "{error}"),
        }
    }
}

/// Bytes on the wire, and behind a checksum that is right.
pub fn wire(bytes: &[u8]) {
    let mut deframer = Deframer::<600>::new();
    for byte in bytes {
        if let Some(Received::Payload(payload)) = deframer.push(*byte) {
            messages(payload);
        }
    }
    messages(bytes);
}

/// A message that is understood is sent and understood again as the same.
fn messages(payload: &[u8]) {
    let mut out = [0; 1200];
    if let Ok(message) = frame::decode::<FromHost>(payload) {
        let length = frame::encode(&message, &mut out).expect("it came from fewer bytes");
        let mut deframer = Deframer::<600>::new();
        let received = out[..length].iter().any(|byte| match deframer.push(*byte) {
            Some(Received::Payload(again)) => frame::decode::<FromHost>(again) == Ok(message.clone()),
            _ => false,
        });
        assert!(received, "{message:?}");
    }
    // The other end's messages must not harm the host either.
    let _ = frame::decode::<FromPendant>(payload);
}

/// Points that a plan takes at most: a few seconds.
const MOST_POINTS: usize = 4000;

/// Arrays as a library user hands them over, in single precision: after a byte that says what they are, a pose of six numbers,
/// then points or depths. What is read is planned.
pub fn arrays(bytes: &[u8]) {
    let Some((kind, bytes)) = bytes.split_first() else { return };
    let numbers: Vec<f32> = bytes.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect();
    let Some((pose, rest)) = numbers.split_first_chunk::<6>() else { return };
    let rest = &rest[..rest.len().min(3 * MOST_POINTS)];
    let points = rest.as_chunks::<3>().0;
    let cloud = || RawCloud::new(Coordinates::Single(points.to_vec()));
    let posed =
        |view: RawView| view.posed(CameraPose::BaseFromCamera(Transform::Vector(pose.map(f64::from))));
    let units = [Units::Auto, Units::Metres, Units::Millimetres][usize::from(kind >> 2) % 3];
    let options = Options { units, ..Options::default() };
    let read = match kind & 3 {
        0 => cloud().read("cloud", &options),
        1 => {
            // Of neighbours, and one corner that is not there now and then.
            let triangles =
                (0..points.len()).map(|k| [k, k + 1, k + 2]).take(points.len().saturating_sub(2)).collect();
            cloud().with_triangles(triangles).and_then(|mesh| mesh.read("mesh", &options))
        }
        2 => {
            let views = vec![posed(RawView::of_cloud(cloud())); 2];
            PosedViews { views, ..PosedViews::default() }.read(&options)
        }
        _ => {
            const WIDTH: usize = 16;
            let depths = &rest[..rest.len() / WIDTH * WIDTH];
            let Ok(intrinsics) = "16,16,8,6".parse() else { return };
            let size_px = [WIDTH as u32, (depths.len() / WIDTH) as u32];
            let view = RawView::of_depth_m(depths, size_px, &intrinsics).map(posed);
            view.and_then(|view| PosedViews { views: vec![view], ..PosedViews::default() }.read(&options))
        }
    };
    match read {
        Err(error) => assert!(error.to_string().contains(". "), "no way out: {error}"),
        Ok(scan) => {
            if let Ok(run) = weldpath::plan(&scan, &Job::default(), &mut ()) {
                assert!(run.seams().iter().all(|seam| seam.length_mm().is_finite()));
                let points = run.paths().into_iter().flatten().flat_map(|path| &path.points);
                assert!(points.flat_map(|point| point.position_mm.iter()).all(|c| c.is_finite()));
            }
        }
    }
}

/// The whole pipeline on a cloud of three bytes a point: coordinates of 0 to 255 tenths of a millimetre or millimetres.
pub fn plan(bytes: &[u8]) {
    let Some((scale, bytes)) = bytes.split_first() else { return };
    let unit_mm = [0.1, 1.0, 10.0, 1e-3][usize::from(scale & 3)];
    let point = |c: &[u8]| Point3::new(f32::from(c[0]), f32::from(c[1]), f32::from(c[2]) - 400.0) * unit_mm;
    let points_mm: Vec<Point3<f32>> = bytes.chunks_exact(3).take(MOST_POINTS).map(point).collect();
    if points_mm.is_empty() {
        return;
    }
    let view = View {
        mesh: None,
        picture: None,
        name: "hostile".into(),
        points_mm,
        normals: Vec::new(),
        base_from_camera: Isometry3::identity(),
        camera_known: scale & 4 != 0,
    };
    if let Ok(plan) = pipeline::plan(&[view], &Config::default(), &mut ()) {
        for seam in &plan.seams {
            assert!(seam.length_mm().is_finite() && seam.expected_error_mm >= 0.0, "seam {}", seam.id);
        }
        let finite = |path: &weldpath::weld::SeamPath| {
            path.points.iter().all(|p| p.position_mm.iter().all(|c| c.is_finite()))
        };
        assert!(plan.paths.iter().all(finite), "a path point is not finite");
    }
}
