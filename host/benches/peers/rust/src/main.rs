//! kiddo and threecrate: files, index, neighbours, ICP. usage: peers DIR

use std::path::Path;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Rotation3, Vector3};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use threecrate_algorithms::registration::icp_point_to_plane_detailed;
use threecrate_core::{Point3f, PointCloud, Vector3f};

fn floats(path: &Path) -> Vec<[f32; 3]> {
    let bytes = std::fs::read(path).expect("the file is there");
    let one = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    bytes.chunks_exact(12).map(|b| [one(b), one(&b[4..]), one(&b[8..])]).collect()
}

fn cpu_ms() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

fn stage<T>(peer: &str, name: &str, mut work: impl FnMut() -> T, check: impl Fn(&T) -> Value) {
    let begin = cpu_ms();
    let mut made = work();
    let runs = if cpu_ms() - begin > 3000.0 { 1 } else { 3 };
    let mut took = Vec::new();
    for _ in 0..runs {
        let begin = cpu_ms();
        made = work();
        took.push(cpu_ms() - begin);
    }
    println!("{}", json!({ "peer": peer, "stage": name, "cpu_ms": took, "check": check(&made) }));
}

fn main() {
    let dir = std::env::args().nth(1).expect("usage: peers DIR");
    let dir = Path::new(&dir);
    let meta: Value = serde_json::from_slice(&std::fs::read(dir.join("meta.json")).expect("meta.json")).expect("JSON");
    let radius = meta["radius_mm"].as_f64().expect("a radius") as f32;
    let points = floats(&dir.join("butt.f32"));
    for kind in ["ply", "pcd"] {
        let path = dir.join(format!("butt.{kind}"));
        let load = || threecrate_io::read_point_cloud(&path).map(|cloud| cloud.len()).expect("it is read");
        stage("threecrate", &format!("load {kind}"), load, |n| json!({ "points": n }));
    }
    type Tree = ImmutableKdTree<f32, 3>;
    let build = || Tree::new_from_slice(&points).expect("a tree");
    stage("kiddo", "index", build, |_| Value::Null);
    let tree = build();
    let near = |q| tree.query(q).within::<SquaredEuclidean<f32>>(radius * radius).unsorted().execute().len();
    let search = || points.iter().map(near).sum::<usize>();
    stage("kiddo", "radius neighbours", search, |n| json!({ "neighbours": *n as f64 / points.len() as f64 }));
    icp(dir, &meta);
}

fn icp(dir: &Path, meta: &Value) {
    let cloud = |name| PointCloud::from_points(floats(&dir.join(name)).into_iter().map(Point3f::from).collect::<Vec<_>>());
    let (source, target) = (cloud("source.f32"), cloud("target.f32"));
    let normals: Vec<Vector3f> = floats(&dir.join("target_normals.f32")).into_iter().map(Vector3f::from).collect();
    let truth = Matrix4::from_fn(|r, c| meta["target_from_source"][r][c].as_f64().expect("a matrix"));
    let centre = Point3::from(
        source.points.iter().map(|p| p.coords.cast::<f64>()).sum::<Vector3<f64>>() / source.points.len() as f64,
    );
    let align = || {
        icp_point_to_plane_detailed(&source, &target, &normals, Isometry3::identity(), 100, Some(5.0), 1e-7)
            .expect("it converges")
            .transformation
            .to_homogeneous()
            .cast::<f64>()
    };
    let error = |found: &Matrix4<f64>| {
        let turn = |m: &Matrix4<f64>| -> Matrix3<f64> { m.fixed_view::<3, 3>(0, 0).into_owned() };
        let angle = Rotation3::from_matrix(&(turn(found) * turn(&truth).transpose())).angle().to_degrees();
        let apart = found.transform_point(&centre) - truth.transform_point(&centre);
        json!({ "error_deg": angle, "error_mm": apart.norm() })
    };
    stage("threecrate", "icp, given normals", align, error);
}
