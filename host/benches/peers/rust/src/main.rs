//! kiddo and threecrate: files, index, neighbours, ICP. usage: peers DIR

use std::path::Path;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Isometry3;
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use threecrate_algorithms::registration::{ICPResult, icp_point_to_plane_detailed};
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

/// Runs `work` once to warm up and three times for the record, or only once where a run takes long. The stages named in the
/// variable SKIP, separated by semicolons, are left out.
fn stage<T>(peer: &str, name: &str, mut work: impl FnMut() -> T, check: impl Fn(&T) -> Value) {
    if std::env::var("SKIP").is_ok_and(|skip| skip.split(';').any(|stage| stage == name)) {
        return;
    }
    let mut took = Vec::new();
    let made = loop {
        let begin = cpu_ms();
        let made = work();
        took.push(cpu_ms() - begin);
        if took.len() == 4 || took[0] > 1000.0 {
            break made;
        }
    };
    let warm = usize::from(took.len() > 1);
    println!("{}", json!({ "peer": peer, "stage": name, "cpu_ms": took[warm..], "check": check(&made) }));
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
    icp(dir);
}

fn icp(dir: &Path) {
    let cloud = |name| PointCloud::from_points(floats(&dir.join(name)).into_iter().map(Point3f::from).collect::<Vec<_>>());
    let (source, target) = (cloud("source.f32"), cloud("target.f32"));
    let normals: Vec<Vector3f> = floats(&dir.join("target_normals.f32")).into_iter().map(Vector3f::from).collect();
    let align = || {
        icp_point_to_plane_detailed(&source, &target, &normals, Isometry3::identity(), 100, Some(5.0), 1e-7)
            .expect("it converges")
    };
    let found = |made: &ICPResult| {
        let pose = made.transformation.to_homogeneous();
        let rows: Vec<Vec<f32>> = pose.row_iter().map(|row| row.iter().copied().collect()).collect();
        json!({ "pose": rows, "iterations": made.iterations })
    };
    stage("threecrate", "icp, given normals", align, found);
}
