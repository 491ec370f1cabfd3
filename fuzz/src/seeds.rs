//! Small valid inputs of every target, made here: mutation starts from them.

/// Corners of a patch, metres.
const XYZ: [[f32; 3]; 4] = [[0.1, 0.2, 0.5], [0.3, -0.2, 0.6], [-0.1, 0.05, 0.7], [0.0, 0.1, 0.55]];

fn records(big_endian: bool) -> Vec<u8> {
    let bytes = |c: &f32| if big_endian { c.to_be_bytes() } else { c.to_le_bytes() };
    XYZ.iter().flatten().flat_map(bytes).collect()
}

fn rows(separator: &str) -> Vec<u8> {
    XYZ.iter().flat_map(|p| (p.map(|c| c.to_string()).join(separator) + "\n").into_bytes()).collect()
}

fn ply(format: &str, faces: bool, data: &[u8]) -> Vec<u8> {
    let faces = if faces { "element face 2\nproperty list uchar int vertex_indices\n" } else { "" };
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let head = format!("ply\nformat {format} 1.0\nelement vertex 4\n{xyz}{faces}end_header\n");
    [head.as_bytes(), data].concat()
}

/// A cloud of four points.
pub fn ascii_ply() -> Vec<u8> {
    ply("ascii", false, &rows(" "))
}

fn pcd(kind: &str, data: &[u8]) -> Vec<u8> {
    let head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\n";
    [format!("{head}VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA {kind}\n").as_bytes(), data].concat()
}

/// Columns packed as LZF runs without a match.
fn compressed() -> Vec<u8> {
    let columns: Vec<u8> = (0..3).flat_map(|k| XYZ.iter().flat_map(move |p| p[k].to_le_bytes())).collect();
    let packed: Vec<u8> = columns.chunks(16).flat_map(|run| [&[15], run].concat()).collect();
    let sizes = [(packed.len() as u32).to_le_bytes(), (columns.len() as u32).to_le_bytes()].concat();
    [sizes, packed].concat()
}

fn binary_stl() -> Vec<u8> {
    let facet = [vec![0; 12], records(false)[..36].to_vec(), vec![0; 2]].concat();
    [vec![b' '; 80], 2_u32.to_le_bytes().to_vec(), facet.clone(), facet].concat()
}

/// A 16-bit depth image of a slope.
pub fn depth_png(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let counts: Vec<u8> = (0..width * height).flat_map(|i| ((i % 900) as u16).to_be_bytes()).collect();
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&counts));
    assert!(written.is_ok(), "memory takes every image");
    bytes
}

const SCAN_JSON: &str = r#"{"units":"m","camera":{"width":64,"height":48,"fx":60.0,"fy":60.0,"cx":31.5,"cy":23.5,
"depth_scale_m":0.0005},"flange_from_camera":[[1,0,0,0.01],[0,1,0,0.02],[0,0,1,0.03],[0,0,0,1]],"views":[{"depth":
"depth.png","base_from_flange":[0.1,0.2,0.3,0.4,0.5,0.6]},{"cloud":"little.ply","frame":"base","camera_m":[0.1,0.2,1.3]}]}"#;

const JOB: &str = "input = \"scan\"\nunits = \"mm\"\n[path]\nstandoff_mm = 12\npoints = 120\n[weave]\nshape = \"sine\"\n\
[arc]\noutput = 3\n[tool]\nflange_from_tcp_mm = [0, -50, 300]\nflange_from_tcp_rotation_rad = [0, 0.5, 0]\n\
payload_kg = 2.1\n[robot]\nmodel = \"ur10e\"\n[torch_body]\nneck_deg = 22\n[[pass]]\nout_mm = 1\n[[seam]]\nid = 2\n";

const PATH_JSON: &str = r#"{"format":"weldpath-program","version":1,"frame":"base","waypoints":[
{"base_from_torch_wxyz":[1.0,0.0,0.0,0.0],"feed_mm_s":150.0,"kind":"air","position_mm":[0.0,0.0,120.0],"seam":null,"weld":false},
{"base_from_torch_wxyz":[1.0,0.0,0.0,0.0],"feed_mm_s":8.0,"kind":"weld","position_mm":[0.0,0.0,20.0],"seam":1,"weld":true,"dwell_s":0.5}]}"#;

const HANDS: &str = "time_ms,hand,palm_x_mm,palm_y_mm,palm_z_mm,direction_x,direction_y,direction_z,normal_x,normal_y,normal_z,\
grab,pinch,extended,confidence\n0,left,0,200,0,0,0,-1,0,-1,0,0,0,11111,1\n10,right,1,2,3,0,0,-1,0,-1,0,1,0.5,10000,0.5\n";

/// Two plates at a right angle, points a unit apart.
fn corner() -> Vec<u8> {
    let plate = |i: u8, j: u8| [[i, j, 0], [i, 0, j]];
    let points = (0..40).flat_map(|i| (0..20).flat_map(move |j| plate(i, j)));
    [vec![5], points.flatten().collect()].concat()
}

/// A kind of array, a pose, and the points of that corner or depths about as far.
fn arrays(kind: u8) -> Vec<u8> {
    let pose = [0.1f32, 0.2, 0.3, 0.4, 0.5, 0.6];
    let points: Vec<f32> = corner()[1..].iter().map(|c| 0.5 + f32::from(*c) / 1000.0).collect();
    let numbers = pose.iter().chain(&points).flat_map(|number| number.to_le_bytes());
    std::iter::once(kind).chain(numbers).collect()
}

/// A `scan.json` whose hand-eye transform is in a file.
pub const BY_FILE: &str = r#"{"units": "m", "flange_from_camera": "eye.yml",
"views": [{"cloud": "little.ply", "base_from_flange": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]}]}"#;

const HAND_EYE: &str = "%YAML:1.0\n---\nT: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   \
data: [ 1, 0, 0, 10, 0, 1, 0, 20, 0, 0, 1, 30, 0, 0, 0, 1 ]\n";

fn npy(shape: &str) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}");
    let padded = format!("{header:<117}\n");
    [&b"\x93NUMPY\x01\0"[..], &[padded.len() as u8, 0], padded.as_bytes(), &records(false)[..24]].concat()
}

fn vtk(kind: &str, points: &[u8]) -> Vec<u8> {
    let head = format!("# vtk DataFile Version 3.0\nby hand\n{kind}\nDATASET POLYDATA\nPOINTS 3 float\n");
    [head.as_bytes(), points, b"\nPOLYGONS 1 4\n3 0 1 2\n"].concat()
}

/// The seeds of a target; each is taken by its reader.
pub fn of(target: &str) -> Vec<Vec<u8>> {
    let faces: Vec<u8> = [[0, 1, 2], [0, 2, 3]]
        .iter()
        .flat_map(|t: &[i32; 3]| [vec![3_u8], t.iter().flat_map(|i| i.to_le_bytes()).collect()].concat())
        .collect();
    let facet =
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -1 -2 -3 -4\n";
    match target {
        "ply" => vec![
            ascii_ply(),
            ply("binary_little_endian", false, &records(false)),
            ply("binary_big_endian", false, &records(true)),
            ply("binary_little_endian", true, &[records(false), faces].concat()),
            ply("ascii", true, &[rows(" "), b"3 0 1 2\n3 0 2 3\n".to_vec()].concat()),
        ],
        "pcd" => vec![
            pcd("ascii", &rows(" ")),
            pcd("binary", &records(false)),
            pcd("binary_compressed", &compressed()),
        ],
        "text" => vec![
            rows(" "),
            [b"x_mm,y_mm,z_mm\n".to_vec(), rows(",")].concat(),
            b"z;x;y\n-3;1,5;2\n1;2;3\n".into(),
        ],
        "stl" => vec![binary_stl(), format!("solid a\n{facet}endsolid a\n").into_bytes()],
        "obj" => vec![obj.into()],
        "npy" => vec![npy("2, 3"), npy("1, 2, 3")],
        "vtk" => vec![
            vtk("ASCII", b"0.1 0.2 0.5 0.3 -0.2 0.6 -0.1 0.05 0.7\n"),
            vtk("BINARY", &records(true)[..36]),
        ],
        "hand_eye" => vec![
            HAND_EYE.into(),
            "FloatMatrix:\n  Data: [[1, 0, 0, 9], [0, 1, 0, 8], [0, 0, 1, 70], [0, 0, 0, 1]]\n".into(),
        ],
        "png" => vec![depth_png(640, 480), depth_png(64, 48)],
        "scan_json" => vec![SCAN_JSON.into()],
        "job" => vec![JOB.into(), b"".to_vec()],
        "path_json" => vec![PATH_JSON.into()],
        "hands" => vec![HANDS.into()],
        "arrays" => (0..4).map(arrays).collect(),
        "plan" => vec![corner()],
        // The shortest of messages: a number of its kind, and fields of one byte.
        _ => (0..12).map(|kind| vec![kind, 1, 0, 0, 0, 0, 0, 0]).collect(),
    }
}
