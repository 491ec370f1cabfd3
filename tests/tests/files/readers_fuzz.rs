//! Damaged files of every kind: cut off, with flipped bits, with huge counts, filled with NaN, joined from two.
//!
//! Each ends in points or in an error that names the file; never in a panic, and never in more memory than a small
//! multiple of what the file could hold.

use std::path::Path;

use proptest::prelude::*;
use proptest::sample::Index;
use weldpath::input;
use weldpath::input::{Error, Options, Scan, Units};

const XYZ: [[f32; 3]; 4] = [[0.1, 0.2, 0.5], [0.3, -0.2, 0.6], [-0.1, 0.05, 0.7], [0.0, 0.1, 0.55]];

fn records(big_endian: bool) -> Vec<u8> {
    let bytes = |c: &f32| if big_endian { c.to_be_bytes() } else { c.to_le_bytes() };
    XYZ.iter().flatten().flat_map(bytes).collect()
}

fn rows(separator: &str) -> Vec<u8> {
    XYZ.iter().flat_map(|p| (p.map(|c| c.to_string()).join(separator) + "\n").into_bytes()).collect()
}

fn ply(format: &str, faces: bool, data: Vec<u8>) -> Vec<u8> {
    let faces = if faces { "element face 2\nproperty list uchar int vertex_indices\n" } else { "" };
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let head =
        format!("ply\nformat {format} 1.0\ncomment unit m\nelement vertex 4\n{xyz}{faces}end_header\n");
    [head.into_bytes(), data].concat()
}

fn pcd(kind: &str, data: Vec<u8>) -> Vec<u8> {
    let head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\n";
    let tail = format!("VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA {kind}\n");
    [head.as_bytes(), tail.as_bytes(), &data].concat()
}

fn compressed() -> Vec<u8> {
    let columns: Vec<u8> = (0..3).flat_map(|k| XYZ.iter().flat_map(move |p| p[k].to_le_bytes())).collect();
    let packed: Vec<u8> = columns.chunks(16).flat_map(|run| [&[15], run].concat()).collect();
    let sizes = [(packed.len() as u32).to_le_bytes(), (columns.len() as u32).to_le_bytes()].concat();
    [sizes, packed].concat()
}

fn stl() -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend(2u32.to_le_bytes());
    for _ in 0..2 {
        bytes.extend([0u8; 12]);
        bytes.extend(&records(false)[..36]);
        bytes.extend([0; 2]);
    }
    bytes
}

fn png() -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 640, 480);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let counts: Vec<u8> = (0..640 * 480u32).flat_map(|i| ((i % 900) as u16).to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&counts).unwrap();
    bytes
}

fn npy() -> Vec<u8> {
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (4, 3), }";
    let padded = format!("{header:<117}\n");
    [&b"\x93NUMPY\x01\0"[..], &(padded.len() as u16).to_le_bytes(), padded.as_bytes(), &records(false)]
        .concat()
}

fn vtk(kind: &str, points: Vec<u8>, faces: &[u8]) -> Vec<u8> {
    let head = format!("# vtk DataFile Version 3.0\nby hand\n{kind}\nDATASET POLYDATA\nPOINTS 4 float\n");
    [head.as_bytes(), &points, faces].concat()
}

/// A valid file of every kind.
fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let faces: Vec<u8> = [[0, 1, 2], [0, 2, 3]]
        .iter()
        .flat_map(|t: &[i32; 3]| [vec![3u8], t.iter().flat_map(|i| i.to_le_bytes()).collect()].concat())
        .collect();
    let facet =
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -1 -2 -3\n";
    vec![
        ("little.ply", ply("binary_little_endian", false, records(false))),
        ("big.ply", ply("binary_big_endian", false, records(true))),
        ("mesh.ply", ply("binary_little_endian", true, [records(false), faces].concat())),
        ("ascii.ply", ply("ascii", true, [rows(" "), b"3 0 1 2\n3 0 2 3\n".to_vec()].concat())),
        ("binary.pcd", pcd("binary", records(false))),
        ("ascii.pcd", pcd("ascii", rows(" "))),
        ("compressed.pcd", pcd("binary_compressed", compressed())),
        ("cloud.csv", [b"x,y,z\n".to_vec(), rows(",")].concat()),
        ("cloud.xyz", rows(" ")),
        ("binary.stl", stl()),
        ("ascii.stl", format!("solid a\n{facet}{facet}endsolid a\n").into_bytes()),
        ("mesh.obj", obj.into()),
        ("depth.png", png()),
        ("cloud.npy", npy()),
        ("text.vtk", vtk("ASCII", rows(" "), b"\nPOLYGONS 1 4\n3 0 1 2\n")),
        (
            "binary.vtk",
            vtk("BINARY", records(true), b"\nPOLYGONS 1 4\n\0\0\0\x03\0\0\0\0\0\0\0\x01\0\0\0\x02"),
        ),
    ]
}

#[derive(Debug, Clone)]
enum Damage {
    Cut(Index),
    Flip(Index, u8),
    Put(Index, Vec<u8>),
    Insert(Index, Vec<u8>),
    Repeat(Index, Index),
    Nan(Index),
    HugeNumber(Index, String),
}

fn damage() -> impl Strategy<Value = Damage> {
    let numbers =
        ["4000000000", "18446744073709551615", "-1", "0", "1e999", "nan", "99999999", "x", "", "1e38"];
    prop_oneof![
        any::<Index>().prop_map(Damage::Cut),
        (any::<Index>(), 0..8u8).prop_map(|(at, bit)| Damage::Flip(at, bit)),
        (any::<Index>(), prop::collection::vec(any::<u8>(), 1..6)).prop_map(|(at, b)| Damage::Put(at, b)),
        (any::<Index>(), prop::collection::vec(any::<u8>(), 1..6)).prop_map(|(at, b)| Damage::Insert(at, b)),
        (any::<Index>(), any::<Index>()).prop_map(|(a, b)| Damage::Repeat(a, b)),
        any::<Index>().prop_map(Damage::Nan),
        (any::<Index>(), prop::sample::select(numbers.map(String::from).to_vec()))
            .prop_map(|(at, number)| Damage::HugeNumber(at, number)),
    ]
}

fn apply(bytes: &mut Vec<u8>, damage: &Damage) {
    if bytes.is_empty() {
        return;
    }
    let n = bytes.len();
    match damage {
        Damage::Cut(at) => bytes.truncate(at.index(n)),
        Damage::Flip(at, bit) => bytes[at.index(n)] ^= 1 << bit,
        Damage::Put(at, put) => {
            let at = at.index(n);
            let end = (at + put.len()).min(n);
            bytes[at..end].copy_from_slice(&put[..end - at]);
        }
        Damage::Insert(at, put) => drop(bytes.splice(at.index(n)..at.index(n), put.iter().copied())),
        Damage::Repeat(a, b) => {
            let (from, to) = (a.index(n).min(b.index(n)), a.index(n).max(b.index(n)));
            let part = bytes[from..to].to_vec();
            bytes.extend(part);
        }
        Damage::Nan(from) => bytes[from.index(n)..]
            .chunks_exact_mut(4)
            .for_each(|c| c.copy_from_slice(&f32::NAN.to_le_bytes())),
        Damage::HugeNumber(at, number) => replace_number(bytes, *at, number),
    }
}

/// Replaces one of the numbers that stand in the file as text.
fn replace_number(bytes: &mut Vec<u8>, at: Index, number: &str) {
    let is_start = |i: &usize| bytes[*i].is_ascii_digit() && (*i == 0 || !bytes[*i - 1].is_ascii_digit());
    let starts: Vec<usize> = (0..bytes.len().min(1500)).filter(is_start).collect();
    if starts.is_empty() {
        return;
    }
    let start = starts[at.index(starts.len())];
    let digits = bytes[start..].iter().take_while(|b| b.is_ascii_digit()).count();
    bytes.splice(start..start + digits, number.bytes());
}

fn points_or_an_error_that_names(name: &str, read: Result<Scan, input::Error>) {
    match read {
        Ok(scan) => {
            assert!(!scan.views.is_empty());
            for view in &scan.views {
                assert!(!view.points_mm.is_empty());
                assert!(view.points_mm.iter().all(|p| p.coords.iter().all(|c| c.is_finite())), "{name}");
                assert!(view.normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-3), "{name}");
                let pose = view.base_from_camera.to_homogeneous();
                assert!(pose.iter().all(|c| c.is_finite()), "{name}");
            }
        }
        Err(error) => assert!(error.to_string().contains(name), "{error}"),
    }
}

/// Largest address space that this process ever had, kB; only Linux tells.
fn peak_kb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status
        .lines()
        .find_map(|line| line.strip_prefix("VmPeak:")?.trim().strip_suffix(" kB")?.trim().parse().ok())
}

/// With the camera that an image alone needs, whose lens distorts.
fn options(units: Units) -> Options {
    let intrinsics = Some("525,525,319.5,239.5,0.1,-0.2,0.001,0.002,0.05".parse().expect("a lens"));
    Options { units, intrinsics, ..Options::default() }
}

#[test]
fn undamaged_files_of_every_kind_are_read() {
    for (name, bytes) in seeds() {
        let scan = input::read_bytes(bytes, Path::new(name), &options(Units::Auto));
        points_or_an_error_that_names(name, Ok(scan.unwrap_or_else(|e| panic!("{e}"))));
    }
}

/// The least number of cases; `PROPTEST_CASES` asks for more.
fn config(cases: u32) -> ProptestConfig {
    let default = ProptestConfig::default();
    ProptestConfig { cases: default.cases.max(cases), failure_persistence: None, ..default }
}

proptest! {
    #![proptest_config(config(3000))]

    #[test]
    fn a_damaged_file_gives_points_or_an_error_that_names_it(
        which in any::<Index>(),
        damages in prop::collection::vec(damage(), 1..4),
        units in prop::sample::select(vec![Units::Auto, Units::Metres, Units::Millimetres]),
    ) {
        let seeds = seeds_once();
        let (name, bytes) = &seeds[which.index(seeds.len())];
        let mut bytes = bytes.clone();
        damages.iter().for_each(|damage| apply(&mut bytes, damage));
        let before = peak_kb();
        points_or_an_error_that_names(name, input::read_bytes(bytes, Path::new(name), &options(units)));
        if let (Some(before), Some(after)) = (before, peak_kb()) {
            prop_assert!(after - before < 500_000, "{name} took {} kB", after - before);
        }
    }
}

/// What a scan holds and says, or why it was refused.
fn told(scan: Result<Scan, Error>) -> Result<impl PartialEq + std::fmt::Debug, String> {
    let Scan { views, notes, warnings, .. } = scan.map_err(|error| error.to_string())?;
    let bits = views.iter().flat_map(|view| &view.points_mm).map(|p| [p.x, p.y, p.z].map(f32::to_bits));
    let frames = views.iter().map(|view| (view.base_from_camera, view.camera_known));
    Ok((bits.collect::<Vec<_>>(), frames.collect::<Vec<_>>(), notes, warnings))
}

/// Files of many pieces, and one whose header is long.
fn long_seeds() -> Vec<(&'static str, Vec<u8>)> {
    const POINTS: usize = 9000;
    let double = |i: usize| [0.25 * i as f64, -0.5, (i % 7) as f64].map(f64::to_le_bytes).concat();
    let fields = ["y", "x", "z"].map(|axis| format!("property double {axis}\n")).concat();
    let head = format!("ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\n{fields}end_header\n");
    let long = format!("# .PCD\n{}", "# a comment\n".repeat(1400));
    vec![
        ("long.ply", [head.into_bytes(), (0..POINTS).flat_map(double).collect()].concat()),
        ("long.pcd", [long.into_bytes(), pcd("binary", records(false))].concat()),
    ]
}

proptest! {
    #![proptest_config(config(1000))]

    #[test]
    fn a_damaged_file_read_piece_by_piece_tells_what_its_bytes_tell(
        which in any::<Index>(),
        damages in prop::collection::vec(damage(), 0..3),
    ) {
        static SEEDS: std::sync::OnceLock<Vec<(&str, Vec<u8>)>> = std::sync::OnceLock::new();
        let in_pieces = |(name, _): &(&str, _)| name.ends_with(".ply") || name.ends_with(".pcd");
        let seeds = SEEDS.get_or_init(|| seeds().into_iter().filter(in_pieces).chain(long_seeds()).collect());
        let (name, bytes) = &seeds[which.index(seeds.len())];
        let mut bytes = bytes.clone();
        damages.iter().for_each(|damage| apply(&mut bytes, damage));
        // A scan.json under any name is read with the files beside it, or not at all.
        prop_assume!(!bytes.trim_ascii_start().starts_with(b"{"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        let options = options(Units::Auto);
        prop_assert_eq!(told(input::read(&path, &options)), told(input::read_bytes(bytes, &path, &options)));
    }
}

fn seeds_once() -> &'static [(&'static str, Vec<u8>)] {
    static SEEDS: std::sync::OnceLock<Vec<(&str, Vec<u8>)>> = std::sync::OnceLock::new();
    SEEDS.get_or_init(seeds)
}

const SCAN_JSON: &str = r#"{ "units": "m",
  "camera": { "width": 640, "height": 480, "fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5, "depth_scale_m": 0.0005 },
  "flange_from_camera": [[1, 0, 0, 0.01], [0, 1, 0, 0.02], [0, 0, 1, 0.03], [0, 0, 0, 1]],
  "views": [ { "depth": "depth.png", "base_from_flange": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6] },
             { "cloud": "little.ply", "base_from_flange": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6] },
             { "cloud": "binary.pcd", "frame": "base", "camera_m": [0.1, 0.2, 1.3] } ] }"#;

proptest! {
    #![proptest_config(config(100))]

    #[test]
    fn a_damaged_scan_json_gives_views_or_an_error_that_names_a_file(
        damages in prop::collection::vec(damage(), 1..3),
    ) {
        let folder = tempfile::Builder::new().prefix("fuzzed-scan").tempdir().unwrap();
        for (name, bytes) in seeds_once() {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        let mut json = SCAN_JSON.as_bytes().to_vec();
        damages.iter().for_each(|damage| apply(&mut json, damage));
        std::fs::write(folder.path().join("scan.json"), json).unwrap();
        points_or_an_error_that_names("fuzzed-scan", input::read(folder.path(), &Options::default()));
    }

    #[test]
    fn a_damaged_folder_of_another_tool_gives_views_or_an_error_that_names_a_file(
        which in 0..3usize,
        damages in prop::collection::vec(damage(), 1..3),
    ) {
        let folder = tempfile::Builder::new().prefix("fuzzed-scan").tempdir().unwrap();
        let (_, image) = seeds_once().iter().find(|(name, _)| *name == "depth.png").unwrap();
        std::fs::write(folder.path().join("depth.png"), image).unwrap();
        let mut files = OF_OTHERS.map(|(name, text)| (name, text.as_bytes().to_vec()));
        damages.iter().for_each(|damage| apply(&mut files[which].1, damage));
        for (name, bytes) in files {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        // One of the three is read through the scan.json, the others beside the images.
        let input = if which == 2 { folder.path().join("by-file.json") } else { folder.path().into() };
        let scan_json = r#"{"units": "m", "camera": {"width": 640, "height": 480, "fx": 600, "fy": 600, "cx": 319.5, "cy": 239.5,
            "depth_scale_m": 0.001}, "flange_from_camera": "eye.yml",
            "views": [{"depth": "depth.png", "base_from_flange": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]}]}"#;
        std::fs::write(folder.path().join("by-file.json"), scan_json).unwrap();
        points_or_an_error_that_names("fuzzed-scan", input::read(&input, &Options::default()));
    }
}

/// A camera, a trajectory and a hand-eye transform as other tools write them.
const OF_OTHERS: [(&str, &str); 3] = [
    (
        "intrinsic.json",
        r#"{"width": 640, "height": 480, "intrinsic_matrix": [600, 0, 0, 0, 600, 0, 319.5, 239.5, 1]}"#,
    ),
    (
        "trajectory.json",
        r#"{"parameters": [{"extrinsic": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.1, 0.2, 0.3, 1]}]}"#,
    ),
    (
        "eye.yml",
        "%YAML:1.0\n---\nT: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   \
         data: [ 1, 0, 0, 10, 0, 1, 0, 20, 0, 0, 1, 30, 0, 0, 0, 1 ]\n",
    ),
];
