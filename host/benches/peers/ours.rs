//! Our side of the comparison with other libraries: writes the clouds for all, and measures the same stages.
//!
//! `ours write DIR POINTS` makes the files that every peer reads; `ours run DIR POINTS` prints one JSON line per stage: CPU
//! milliseconds of each run, and what shows that the same work was done. `run.py` calls both.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3, Vector3};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use weldpath::cloud::{PointCloud, View};
use weldpath::denoising::{self, bilateral};
use weldpath::grid::{self, Grid, sweep::Around};
use weldpath::normals::{self, Patches, pointwise};
use weldpath::pipeline;
use weldpath::reconstruction::{Config, register};
use weldpath::scan;
use weldpath::seam::edges;

#[path = "../clouds.rs"]
mod clouds;

/// Edge of the voxels that are compared, mm.
const VOXEL_MM: f32 = 1.0;

fn main() {
    let words: Vec<String> = std::env::args().filter(|word| word != "--bench").collect();
    let [_, what, dir, points] = &words[..] else { return };
    let (dir, points) = (PathBuf::from(dir), points.parse().expect("a number of points"));
    let threads = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global();
    threads.expect("the first pool");
    match what.as_str() {
        "write" => write(&dir, points),
        _ => measure(&dir, points),
    }
}

/// The clouds as PLY, PCD and bare floats; the pair with the normals that every ICP is given, and its true motion.
fn write(dir: &Path, points: usize) {
    let put = |name: &str, bytes: Vec<u8>| std::fs::write(dir.join(name), bytes).expect("it is written");
    let cloud = clouds::butt_joint(points);
    put("butt.ply", clouds::ply(&cloud));
    put("butt.pcd", clouds::pcd(&cloud));
    put("butt.f32", bytes(cloud.iter().map(|p| p.coords)));
    let pair = clouds::pipe_pair(points);
    for (name, points) in [("target", &pair.target), ("source", &pair.source)] {
        put(&format!("{name}.f32"), bytes(points.iter().map(|p| p.coords)));
        put(&format!("{name}_normals.f32"), bytes(normals_of(points).into_iter()));
    }
    let to = pair.target_from_source.to_homogeneous();
    let matrix: Vec<Vec<f64>> = to.row_iter().map(|row| row.iter().copied().collect()).collect();
    let meta =
        json!({ "radius_mm": clouds::radius_mm(points), "voxel_mm": VOXEL_MM, "target_from_source": matrix });
    put("meta.json", meta.to_string().into_bytes());
}

fn bytes(vectors: impl Iterator<Item = Vector3<f32>>) -> Vec<u8> {
    vectors.flat_map(|v| [v.x, v.y, v.z]).flat_map(f32::to_le_bytes).collect()
}

/// Normals over about 30 neighbours, in the order of the points.
fn normals_of(points: &[Point3<f32>]) -> Vec<Vector3<f32>> {
    let radius_mm = 6.4 * normals::mean_spacing_mm(points);
    let grid = Grid::new(points, radius_mm);
    in_order(&grid, pointwise::within(&grid, radius_mm))
}

fn in_order<T: Copy>(grid: &Grid, by_slot: Vec<T>) -> Vec<T> {
    let mut out = by_slot.clone();
    by_slot.into_iter().enumerate().for_each(|(slot, value)| out[grid.index(slot)] = value);
    out
}

/// CPU time of this process, ms.
fn cpu_ms() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

/// Runs `work` once to warm up and three times for the record.
fn stage<T>(name: &str, mut work: impl FnMut() -> T, check: impl Fn(&T) -> Value) {
    let mut made = work();
    let mut took = Vec::new();
    for _ in 0..3 {
        let begin = cpu_ms();
        made = work();
        took.push(cpu_ms() - begin);
    }
    println!("{}", json!({ "peer": "weldpath", "stage": name, "cpu_ms": took, "check": check(&made) }));
}

fn measure(dir: &Path, points: usize) {
    let (cloud, radius_mm) = (clouds::butt_joint(points), clouds::radius_mm(points));
    let n = points as f64;
    for kind in ["ply", "pcd"] {
        let path = dir.join(format!("butt.{kind}"));
        stage(
            &format!("load {kind}"),
            || scan::points(&path).expect("it is read"),
            |p| json!({ "points": p.len() }),
        );
    }
    stage("voxel grid", || grid::centroids(&cloud, VOXEL_MM), |v| json!({ "voxels": v.len() }));
    stage("index", || Grid::new(&cloud, radius_mm), |_| Value::Null);
    let grid = Grid::new(&cloud, radius_mm);
    let count = |slot: usize, around: &Around<0>| {
        around.from(grid.point(slot)).map(|e| e.inside(radius_mm)).sum::<u32>()
    };
    let mean =
        |counts: &Vec<u32>| json!({ "neighbours": counts.iter().map(|c| f64::from(*c)).sum::<f64>() / n });
    stage("radius neighbours", || grid.sweep(radius_mm, [], count), mean);
    let normals = || {
        let grid = Grid::new(&cloud, radius_mm);
        in_order(&grid, pointwise::within(&grid, radius_mm))
    };
    stage("normals", normals, |found| json!({ "plate_error_deg": plate_error_deg(&cloud, found) }));
    let normals = vec![Vector3::z(); points];
    let model = PointCloud { points_mm: cloud.clone(), normals, ..PointCloud::default() };
    let config = denoising::Config { radius_mm, distance_mm: radius_mm / 3.0, height_mm: 0.6 };
    let roughness = |c: &PointCloud| json!({ "plate_rms_mm": plate_rms_mm(&cloud, &c.points_mm) });
    stage("bilateral", || bilateral(&model, &config), roughness);
    stage("edge intensity", || edges::asymmetries(&Grid::new(&cloud, radius_mm), radius_mm), |_| Value::Null);
    edge_score(&cloud, radius_mm);
    icp(points);
    whole(dir);
}

/// Intensity, gradient, tensor and ratio.
fn edge_score(cloud: &[Point3<f32>], radius_mm: f32) {
    let score = || {
        let grid = Grid::new(cloud, radius_mm);
        let intensity: Vec<f32> = edges::asymmetries(&grid, radius_mm).iter().map(Vector3::norm).collect();
        let gradients = edges::gradients(&grid, radius_mm, &intensity);
        let ratios = edges::tensors(&grid, radius_mm, &gradients).iter().map(|t| t.ratio()).collect();
        (intensity, ratios)
    };
    let medians = |(intensity, ratios): &(Vec<f32>, Vec<f32>)| json!({ "intensity": median(intensity), "ratio": median(ratios) });
    stage("edge score", score, medians);
}

/// The pair as two views of nothing but points with the given normals, without a prior; then as scans, from raw points.
fn icp(points: usize) {
    let pair = clouds::pipe_pair(points);
    let seen = |points: &[Point3<f32>]| View {
        name: "view".into(),
        points_mm: points.to_vec(),
        normals: Vec::new(),
        base_from_camera: Isometry3::identity(),
        camera_known: true,
    };
    let views = [seen(&pair.target), seen(&pair.source)];
    let raw = Config {
        prior_mm: f64::INFINITY,
        gates_mm: vec![5.0],
        iterations: 100,
        sample: points,
        ..Config::default()
    };
    let given = [&pair.target, &pair.source].map(|points| given_normals(points));
    let truth = &pair.target_from_source;
    let centre = Point3::from(
        pair.source.iter().map(|p| p.coords.cast::<f64>()).sum::<Vector3<f64>>() / points as f64,
    );
    let error = |found: &Isometry3<f64>| {
        let turn = (found.rotation * truth.rotation.inverse()).angle().to_degrees();
        json!({ "error_deg": turn, "error_mm": (found * centre - truth * centre).norm() })
    };
    let pose = |r: &weldpath::reconstruction::Registration| {
        error(&(r.base_from_camera[0].inverse() * r.base_from_camera[1]))
    };
    stage("icp, given normals", || register(&views, &given, &raw), pose);
    let chain = Config { prior_mm: f64::INFINITY, gates_mm: vec![5.0, 1.5], ..Config::default() };
    let from_raw = || register(&views, &normals::of_views(&views, &normals::Config::default()), &chain);
    stage("registration", from_raw, pose);
}

/// Every point a patch of its own.
fn given_normals(points: &[Point3<f32>]) -> Patches {
    let n = points.len();
    let cloud =
        PointCloud { points_mm: points.to_vec(), normals: normals_of(points), ..PointCloud::default() };
    let spacing_mm = normals::mean_spacing_mm(points);
    let (ones, small) = (vec![1.0; n], vec![1e-9; n]);
    Patches {
        cloud,
        variance_mm2: vec![0.09; n],
        tilt_variance: small,
        count: ones,
        cell_mm: spacing_mm,
        spacing_mm,
        noise_mm: 0.3,
    }
}

/// The whole method on the V butt joint, from the file.
fn whole(dir: &Path) {
    let path = dir.join("butt.ply");
    let plan = || {
        let scan = scan::read(&path, &scan::Options::default()).expect("it is read");
        pipeline::plan(&scan.views, &pipeline::Config::default(), &mut ()).expect("there is a seam")
    };
    // The faces meet 1.7 mm below the root.
    let error = |plan: &pipeline::Plan| {
        let sum: f64 = plan.seams[0].stations.iter().map(|s| s.position_mm.y.powi(2)).sum();
        json!({ "seams": plan.seams.len(), "across_rms_mm": (sum / plan.seams[0].stations.len() as f64).sqrt() })
    };
    stage("whole method", plan, error);
}

/// Whether a point lies on a plate, clear of groove and edges.
fn on_plate(p: &Point3<f32>) -> bool {
    (20.0..95.0).contains(&p.y.abs())
}

fn plate_error_deg(cloud: &[Point3<f32>], normals: &[Vector3<f32>]) -> f64 {
    let on = cloud.iter().zip(normals).filter(|(p, _)| on_plate(p));
    let angles: Vec<f64> = on.map(|(_, n)| f64::from(n.x.hypot(n.y).atan2(n.z.abs()).to_degrees())).collect();
    angles.iter().sum::<f64>() / angles.len() as f64
}

fn plate_rms_mm(cloud: &[Point3<f32>], moved: &[Point3<f32>]) -> f64 {
    let on: Vec<f64> =
        cloud.iter().zip(moved).filter(|(p, _)| on_plate(p)).map(|(_, m)| f64::from(m.z).powi(2)).collect();
    (on.iter().sum::<f64>() / on.len() as f64).sqrt()
}

fn median(values: &[f32]) -> f32 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f32::total_cmp);
    sorted[sorted.len() / 2]
}
