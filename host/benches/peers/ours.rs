//! Our side of the comparison with other libraries: writes the clouds for all, and measures the same stages.
//!
//! `ours write DIR POINTS` makes the files that every peer reads; `ours run DIR` prints one JSON line per stage: milliseconds
//! of each run, and what shows that the same work was done; `ours whole DIR` is the whole method alone, for its peak memory;
//! `ours linear DIR` are the stages whose cost per point should not grow. `run.py` and `scaling.py` call them.

use std::path::{Path, PathBuf};
use std::time::Instant;

use nalgebra::{Isometry3, Matrix4, Point3, Translation3, Vector3};
use rustix::time::{ClockId, clock_gettime};
use serde_json::{Value, json};
use weldpath::geometry::cloud::{PointCloud, View};
use weldpath::geometry::grid::Grid;
use weldpath::geometry::grid::sweep::Around;
use weldpath::input;
use weldpath::model::denoising;
use weldpath::model::denoising::bilateral;
use weldpath::model::downsampling;
use weldpath::model::normals;
use weldpath::model::normals::pointwise;
use weldpath::model::reconstruction;
use weldpath::model::reconstruction::{pair, register};
use weldpath::pipeline;
use weldpath::seam::score::edges;

/// Edge of the voxels that are compared, mm.
const VOXEL_MM: f32 = 1.0;
fn main() {
    let words: Vec<String> = std::env::args().filter(|word| word != "--bench").collect();
    let [_, what, dir, rest @ ..] = &words[..] else { return };
    let dir = PathBuf::from(dir);
    let threads = std::env::var("RAYON_NUM_THREADS").map_or(1, |n| n.parse().expect("a number of threads"));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    // With one thread the work stays on the caller's.
    let pool = if threads == 1 { pool.use_current_thread() } else { pool };
    pool.build_global().expect("the first pool");
    match what.as_str() {
        "write" => write(&dir, rest[0].parse().expect("a number of points")),
        "whole" => whole(&dir),
        "linear" => {
            let (cloud, radius_mm) = (read(&dir, "butt"), radius_mm(&dir));
            linear(&dir, &cloud, radius_mm);
            edge_score(&dir, &cloud, radius_mm);
        }
        _ => {
            let (cloud, radius_mm) = (read(&dir, "butt"), radius_mm(&dir));
            linear(&dir, &cloud, radius_mm);
            bilateral_of_thinned(&dir);
            edge_score(&dir, &cloud, radius_mm);
            icp(&dir);
            registration(&dir);
        }
    }
}

/// Points of a cloud in a pair at most: more, and some peers take minutes.
const MOST_OF_A_PAIR: usize = 300_000;

/// The clouds as PLY, PCD and bare floats; the pair with the normals that every ICP is given, and its true motion.
fn write(dir: &Path, points: usize) {
    let put = |name: &str, bytes: Vec<u8>| std::fs::write(dir.join(name), bytes).expect("it is written");
    let mut cloud = clouds::butt_joint(points);
    put("butt.ply", clouds::ply(&cloud));
    put("butt.pcd", clouds::pcd(&cloud));
    put("butt.f32", bytes(cloud.iter().map(|p| p.coords)));
    // A corner at whole mm: voxels that begin there and voxels that begin at the origin are the same.
    cloud[0] = Point3::from([0, 1, 2].map(|k| cloud.iter().map(|p| p[k]).fold(0.0, f32::min).floor()));
    put("cornered.f32", bytes(cloud.iter().map(|p| p.coords)));
    let pair = clouds::pipe_pair(points.min(MOST_OF_A_PAIR));
    for (name, points) in [("target", &pair.target), ("source", &pair.source)] {
        put(&format!("{name}.f32"), bytes(points.iter().map(|p| p.coords)));
    }
    put("target_normals.f32", bytes(normals_of(&pair.target).into_iter()));
    let to = pair.target_from_source.to_homogeneous();
    let count = pair.source.len() as f64;
    let centre = pair.source.iter().map(|p| p.coords.cast::<f64>()).sum::<Vector3<f64>>() / count;
    let meta = json!({
        "radius_mm": clouds::radius_mm(points), "pair_points": count as u64, "centre_mm": centre.as_slice(),
        "cameras_mm": { "target": pair.cameras_mm[0].as_slice(), "source": pair.cameras_mm[1].as_slice() },
        "target_from_source": rows(&to),
    });
    put("meta.json", meta.to_string().into_bytes());
}

fn rows(matrix: &Matrix4<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

/// The points of a file of bare floats.
fn read(dir: &Path, name: &str) -> Vec<Point3<f32>> {
    let bytes = std::fs::read(dir.join(format!("{name}.f32"))).expect("`ours write` was run");
    let one = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    bytes.chunks_exact(12).map(|b| Point3::new(one(b), one(&b[4..]), one(&b[8..]))).collect()
}

fn meta(dir: &Path) -> Value {
    let text = std::fs::read(dir.join("meta.json")).expect("`ours write` was run");
    serde_json::from_slice(&text).expect("JSON")
}

fn radius_mm(dir: &Path) -> f32 {
    meta(dir)["radius_mm"].as_f64().expect("a radius") as f32
}

fn bytes(vectors: impl Iterator<Item = Vector3<f32>>) -> Vec<u8> {
    vectors.flat_map(|v| [v.x, v.y, v.z]).flat_map(f32::to_le_bytes).collect()
}

/// Normals over about 30 neighbours, in the order of the points.
fn normals_of(points: &[Point3<f32>]) -> Vec<Vector3<f32>> {
    let radius_mm = 6.4 * normals::mean_spacing_mm(points);
    let grid = Grid::new(points, radius_mm);
    grid.by_point(&pointwise::within(&grid, radius_mm))
}

/// CPU time of this process, ms.
fn cpu_ms() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

/// Runs `work` once to warm up and three times for the record, or only once where a run takes long. The stages named in the
/// variable SKIP, separated by semicolons, are left out.
fn stage<T>(name: &str, points: usize, mut work: impl FnMut() -> T, check: impl Fn(&T) -> Value) {
    const LONG_MS: f64 = 1000.0;
    if std::env::var("SKIP").is_ok_and(|skip| skip.split(';').any(|stage| stage == name)) {
        return;
    }
    let (mut cpu, mut wall) = (Vec::new(), Vec::new());
    let made = loop {
        let (begin, wall_begin) = (cpu_ms(), Instant::now());
        let made = work();
        cpu.push(cpu_ms() - begin);
        wall.push(wall_begin.elapsed().as_secs_f64() * 1e3);
        if cpu.len() == 4 || cpu[0] > LONG_MS {
            break made;
        }
    };
    let warm = usize::from(cpu.len() > 1);
    println!(
        "{}",
        json!({ "peer": "weldpath", "stage": name, "points": points, "cpu_ms": cpu[warm..], "wall_ms": wall[warm..],
                "check": check(&made) })
    );
}

/// The stages whose cost per point should not depend on the number of points.
fn linear(dir: &Path, cloud: &[Point3<f32>], radius_mm: f32) {
    let points = cloud.len();
    for kind in ["ply", "pcd"] {
        let path = dir.join(format!("butt.{kind}"));
        let load = || input::points(&path).expect("it is read");
        stage(&format!("load {kind}"), points, load, |p| json!({ "points": p.len() }));
    }
    let voxels = |v: &Vec<Point3<f32>>| json!({ "voxels": v.len(), "mean_z_mm": mean_z_mm(v) });
    let cornered = read(dir, "cornered");
    stage("voxel grid", points, || downsampling::centroids(&cornered, VOXEL_MM), voxels);
    drop(cornered);
    stage("index", points, || Grid::new(cloud, radius_mm), |_| Value::Null);
    let grid = Grid::new(cloud, radius_mm);
    let count = |slot: usize, around: &Around<0>| {
        around.from(grid.point(slot)).map(|e| e.inside(radius_mm)).sum::<u32>()
    };
    let mean = |counts: &Vec<u32>| json!({ "neighbours": counts.iter().map(|c| f64::from(*c)).sum::<f64>() / points as f64 });
    stage("radius neighbours", points, || grid.sweep(radius_mm, [], count), mean);
    drop(grid);
    let normals = || {
        let grid = Grid::new(cloud, radius_mm);
        grid.by_point(&pointwise::within(&grid, radius_mm))
    };
    stage("normals", points, normals, |found| json!({ "plate_error_deg": plate_error_deg(cloud, found) }));
    let normals = vec![Vector3::z(); points];
    let model = PointCloud { points_mm: cloud.to_vec(), normals, ..PointCloud::default() };
    let config = denoising::BilateralConfig { radius_mm, distance_mm: radius_mm / 2.0, height_mm: 0.6 };
    let roughness = |c: &PointCloud| json!({ "plate_rms_mm": plate_rms_mm(cloud, &c.points_mm) });
    stage("bilateral", points, || bilateral(&model, &config), roughness);
    let intensity = || edges::asymmetries(&Grid::new(cloud, radius_mm), radius_mm);
    stage("edge intensity", points, intensity, |_| Value::Null);
}

/// The bilateral filter with the composed method's input and widths, where it ran.
fn bilateral_of_thinned(dir: &Path) {
    if dir.join("thinned.f32").exists() {
        let cloud = with_normals(dir, "thinned");
        let config = denoising::BilateralConfig { radius_mm: 3.75, distance_mm: 1.875, height_mm: 0.6 };
        let moved = |to: &PointCloud| {
            let squares =
                to.points_mm.iter().zip(&cloud.points_mm).map(|(a, b)| f64::from((a - b).norm_squared()));
            json!({ "moved_rms_mm": (squares.sum::<f64>() / cloud.len() as f64).sqrt() })
        };
        stage("bilateral, thinned", cloud.len(), || bilateral(&cloud, &config), moved);
    }
}

/// Radius of the edge score of the composed method, mm.
const SCORE_RADIUS_MM: f32 = 5.0;

/// Intensity, gradient, tensor and ratio: of the cloud that the composed method scored, where it ran.
fn edge_score(dir: &Path, cloud: &[Point3<f32>], radius_mm: f32) {
    let scored = dir.join("scored.f32").exists().then(|| read(dir, "scored"));
    let (cloud, radius_mm) = scored.as_deref().map_or((cloud, radius_mm), |scored| (scored, SCORE_RADIUS_MM));
    let score = || {
        let grid = Grid::new(cloud, radius_mm);
        let intensity: Vec<f32> = edges::asymmetries(&grid, radius_mm).iter().map(Vector3::norm).collect();
        let gradients = edges::gradients(&grid, radius_mm, &intensity);
        let ratios = edges::tensors(&grid, radius_mm, &gradients).iter().map(|t| t.ratio()).collect();
        (intensity, ratios)
    };
    let medians = |(intensity, _): &(Vec<f32>, Vec<f32>)| json!({ "intensity": median(intensity) });
    stage("edge score", cloud.len(), score, medians);
}

/// A cloud of the pair with the normals that are given.
fn with_normals(dir: &Path, name: &str) -> PointCloud {
    let normals = read(dir, &format!("{name}_normals")).iter().map(|n| n.coords).collect();
    PointCloud { normals, ..bare(read(dir, name)) }
}

/// A cloud of the pair without normals.
fn bare(points_mm: Vec<Point3<f32>>) -> PointCloud {
    PointCloud { points_mm, ..PointCloud::default() }
}

/// One gate, points and normals given; ends with steps as small as those at which small_gicp is told to.
fn icp(dir: &Path) {
    let (source, target) = (bare(read(dir, "source")), with_normals(dir, "target"));
    let config = pair::PairConfig { gates_mm: vec![5.0], ..pair::PairConfig::default() };
    let align = || pair::align(&source, &target, &Isometry3::identity(), &config);
    stage("icp, given normals", source.len(), align, found);
}

/// What is said of an alignment, for the runner to compare with the truth and with a peer's.
fn found(alignment: &pair::Alignment) -> Value {
    json!({ "pose": rows(&alignment.target_from_source.to_homogeneous()), "iterations": alignment.iterations })
}

/// Two gates: on the voxels of 2 mm and the normals of a peer, where it ran; and as the pipeline does it, from raw points,
/// robust and from both sides.
fn registration(dir: &Path) {
    if dir.join("thin_source.f32").exists() {
        let (source, target) = (bare(read(dir, "thin_source")), with_normals(dir, "thin_target"));
        let align = || pair::align(&source, &target, &Isometry3::identity(), &pair::PairConfig::default());
        stage("icp, voxels of 2 mm", source.len(), align, found);
    }
    let meta = meta(dir);
    let views = ["target", "source"].map(|name| seen_from(read(dir, name), &meta["cameras_mm"][name]));
    let points = views[0].points_mm.len();
    let config = reconstruction::ReconstructionConfig {
        prior_mm: f64::INFINITY,
        gates_mm: vec![5.0, 1.5],
        ..reconstruction::ReconstructionConfig::default()
    };
    let of_pipeline =
        || register(&views, &normals::of_views(&views, &normals::NormalsConfig::default()), &config);
    let pose = |r: &reconstruction::Registration| {
        let corrections = [0, 1].map(|k| r.base_from_camera[k] * views[k].base_from_camera.inverse());
        json!({ "pose": rows(&(corrections[0].inverse() * corrections[1]).to_homogeneous()) })
    };
    stage("registration", points, of_pipeline, pose);
}

/// Points of the base frame as a view of a camera at a place.
fn seen_from(points: Vec<Point3<f32>>, camera_mm: &Value) -> View {
    let camera_mm = Vector3::from_fn(|k, _| camera_mm[k].as_f64().expect("a place"));
    View {
        name: "view".into(),
        points_mm: points.iter().map(|p| (p.cast::<f64>() - camera_mm).cast()).collect(),
        normals: Vec::new(),
        base_from_camera: Translation3::from(camera_mm).into(),
        camera_known: true,
        mesh: None,
        picture: None,
    }
}

/// The whole method on the V butt joint, from the file.
fn whole(dir: &Path) {
    let path = dir.join("butt.ply");
    let plan = || {
        let scan = input::read(&path, &input::Options::default()).expect("it is read");
        pipeline::plan(&scan.views, &pipeline::Config::default(), &mut ()).ok()
    };
    // The faces meet 1.7 mm below the root. In 10 000 points there is no seam that can be welded.
    let error = |plan: &Option<pipeline::Plan>| {
        let Some(stations) = plan.as_ref().map(|plan| &plan.seams[0].stations) else { return Value::Null };
        let sum: f64 = stations.iter().map(|s| s.position_mm.y.powi(2)).sum();
        let across_rms_mm = (sum / stations.len() as f64).sqrt();
        json!({ "across_rms_mm": across_rms_mm, "peak_mib": peak_mib() })
    };
    let points = input::points(&path).expect("it is read").len();
    stage("whole method", points, plan, error);
}

/// The most memory that this process held, MiB; 0 where the system does not tell.
fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = |line: &str| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<f64>().ok();
    status.lines().find_map(kib).unwrap_or(0.0) / 1024.0
}

fn mean_z_mm(points: &[Point3<f32>]) -> f64 {
    points.iter().map(|p| f64::from(p.z)).sum::<f64>() / points.len() as f64
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
