//! Every stage of the pipeline alone, by number of points and threads: `cargo bench -p weldpath --bench stages`.
//!
//! The cloud is a V butt joint of fixed size, so more points are denser points, and radii shrink with the spacing.
//! `item/s` is points per second of wall time; `max alloc` of the rows with one thread is what the stage holds at most.

use std::fmt;
use std::hint::black_box;

use divan::{AllocProfiler, Bencher, counter::ItemsCount};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use weldpath::geometry::cloud::{Merged, PointCloud, View};
use weldpath::geometry::grid::Grid;
use weldpath::geometry::grid::sweep::Around;
use weldpath::input;
use weldpath::model::denoising;
use weldpath::model::denoising::bilateral;
use weldpath::model::downsampling;
use weldpath::model::downsampling::{Occupancy, voxel_grid};
use weldpath::model::normals;
use weldpath::model::normals::pointwise;
use weldpath::model::reconstruction;
use weldpath::model::reconstruction::register;
use weldpath::pipeline;
use weldpath::seam;
use weldpath::seam::score::edges;

#[global_allocator]
static ALLOCATIONS: AllocProfiler = AllocProfiler::system();

/// Number of points and of threads.
#[derive(Debug, Clone, Copy)]
struct Case(usize, usize);

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "1e{}, {} thread{}", self.0.ilog10(), self.1, if self.1 > 1 { "s" } else { "" })
    }
}

const CASES: [Case; 6] = [
    Case(10_000, 1),
    Case(10_000, 2),
    Case(100_000, 1),
    Case(100_000, 2),
    Case(1_000_000, 1),
    Case(1_000_000, 2),
];
/// For the stages whose cost per point should not depend on the number of points.
const LINEAR: [Case; 8] = {
    let c = CASES;
    [c[0], c[1], c[2], c[3], c[4], c[5], Case(10_000_000, 1), Case(10_000_000, 2)]
};

fn main() {
    // With one thread the work stays on the caller's, which is the one whose allocations are counted.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global();
    alone.expect("the first pool");
    divan::Divan::from_args().sample_count(7).sample_size(1).main();
}

fn run<T: Send>(bencher: Bencher, case: Case, work: impl Fn() -> T + Sync + Send) {
    let bencher = bencher.counter(ItemsCount::new(case.0));
    if case.1 == 1 {
        return bencher.bench_local(|| black_box(work()));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(case.1).build().expect("a pool");
    bencher.bench_local(|| pool.install(|| black_box(work())));
}

/// What the stages read, of `points` points.
struct Prepared {
    points: Vec<Point3<f32>>,
    radius_mm: f32,
    grid: Grid,
}

fn prepared(case: Case) -> Prepared {
    let (points, radius_mm) = (clouds::butt_joint(case.0), clouds::radius_mm(case.0));
    let grid = Grid::new(&points, radius_mm);
    Prepared { points, radius_mm, grid }
}

fn view(points_mm: Vec<Point3<f32>>) -> View {
    let camera = Isometry3::translation(250.0, 0.0, 600.0);
    let points_mm = points_mm.into_iter().map(|p| p - camera.translation.vector.cast::<f32>()).collect();
    View {
        name: "view".into(),
        points_mm,
        normals: Vec::new(),
        base_from_camera: camera,
        camera_known: true,
        mesh: None,
        picture: None,
    }
}

#[divan::bench(args = LINEAR)]
fn load_ply(bencher: Bencher, case: Case) {
    let file = tempfile::NamedTempFile::with_suffix(".ply").expect("a file");
    std::fs::write(file.path(), clouds::ply(&clouds::butt_joint(case.0))).expect("it is written");
    run(bencher, case, || input::points(file.path()).expect("it is read"));
}

#[divan::bench(args = LINEAR)]
fn voxel_centroids(bencher: Bencher, case: Case) {
    let points = clouds::butt_joint(case.0);
    run(bencher, case, || downsampling::centroids(&points, 1.0));
}

#[divan::bench(args = LINEAR)]
fn spatial_index(bencher: Bencher, case: Case) {
    let (points, radius_mm) = (clouds::butt_joint(case.0), clouds::radius_mm(case.0));
    run(bencher, case, || Grid::new(&points, radius_mm));
}

#[divan::bench(args = CASES)]
fn voxel_grid_with_normals(bencher: Bencher, case: Case) {
    let views = [view(clouds::butt_joint(case.0))];
    let merged = Merged::new(&views, &[views[0].base_from_camera]);
    run(bencher, case, || voxel_grid(&merged, 1.2, Occupancy::of(1)));
}

#[divan::bench(args = CASES)]
fn neighbourhoods(bencher: Bencher, case: Case) {
    let Prepared { radius_mm, grid, .. } = prepared(case);
    let count = |slot: usize, around: &Around<0>| {
        around.from(grid.point(slot)).map(|e| e.inside(radius_mm)).sum::<u32>()
    };
    run(bencher, case, || grid.sweep(radius_mm, [], count));
}

#[divan::bench(args = CASES)]
fn normals_of_points(bencher: Bencher, case: Case) {
    let Prepared { radius_mm, grid, .. } = prepared(case);
    run(bencher, case, || pointwise::within(&grid, radius_mm));
}

#[divan::bench(args = CASES)]
fn normals_of_a_view(bencher: Bencher, case: Case) {
    let view = view(clouds::butt_joint(case.0));
    run(bencher, case, || normals::estimate(&view, &normals::NormalsConfig::default()));
}

#[divan::bench(args = CASES)]
fn icp_of_two_views(bencher: Bencher, case: Case) {
    let pair = clouds::pipe_pair(case.0);
    let seen = |(points, camera): (Vec<Point3<f32>>, Vector3<f64>)| View {
        name: "view".into(),
        points_mm: points.iter().map(|p| (p.cast::<f64>() - camera).cast()).collect(),
        normals: Vec::new(),
        base_from_camera: Translation3::from(camera).into(),
        camera_known: true,
        mesh: None,
        picture: None,
    };
    let [first, second] = pair.cameras_mm;
    let views = [(pair.target, first), (pair.source, second)].map(seen);
    let patches = normals::of_views(&views, &normals::NormalsConfig::default());
    let config = reconstruction::ReconstructionConfig { prior_mm: f64::INFINITY, ..Default::default() };
    run(bencher, case, || register(&views, &patches, &config));
}

#[divan::bench(args = CASES)]
fn bilateral_filter(bencher: Bencher, case: Case) {
    let Prepared { points, radius_mm, .. } = prepared(case);
    let normals = vec![Vector3::z(); points.len()];
    let cloud = PointCloud { points_mm: points, normals, ..PointCloud::default() };
    let config = denoising::BilateralConfig { radius_mm, distance_mm: 0.5 * radius_mm, height_mm: 0.6 };
    run(bencher, case, || bilateral(&cloud, &config));
}

#[divan::bench(args = CASES)]
fn edge_intensity(bencher: Bencher, case: Case) {
    let Prepared { radius_mm, grid, .. } = prepared(case);
    run(bencher, case, || edges::asymmetries(&grid, radius_mm));
}

#[divan::bench(args = CASES)]
fn edge_score(bencher: Bencher, case: Case) {
    let Prepared { radius_mm, grid, .. } = prepared(case);
    run(bencher, case, || {
        let intensity: Vec<f32> = edges::asymmetries(&grid, radius_mm).iter().map(Vector3::norm).collect();
        let gradients = edges::gradients(&grid, radius_mm, &intensity);
        edges::tensors(&grid, radius_mm, &gradients)
    });
}

#[divan::bench(args = CASES)]
fn seam(bencher: Bencher, case: Case) {
    let views = [view(clouds::butt_joint(case.0))];
    let merged = Merged::new(&views, &[views[0].base_from_camera]);
    let patches = normals::of_views(&views, &normals::NormalsConfig::default());
    let scale = downsampling::Scale::of(&merged, &patches, &downsampling::VoxelConfig::default());
    let voxels = voxel_grid(&merged, scale.edge_mm, scale.occupancy());
    let model = bilateral(&voxels.cloud, &scale.bilateral());
    let raw = Grid::new(&merged.points_mm, pipeline::RAW_CELL_MM);
    let reach_mm = seam::INDEX_VOXELS * scale.edge_mm;
    let index = Grid::new(&model.points_mm, reach_mm);
    let scan = seam::RawScan {
        merged: &merged,
        excluded: None,
        index: &raw,
        registration: None,
        view_names: vec!["view"],
        pictures: vec![None],
        cameras_known: true,
        table_shown: false,
    };
    let asymmetries = edges::asymmetries(&index, reach_mm);
    let model =
        seam::SurfaceModel { voxels: &voxels, cloud: &model, index: &index, asymmetries: &asymmetries };
    run(bencher, case, || {
        let input = seam::Input::new(scan.clone(), model, &voxels, seam::Cues::default());
        seam::extraction::find(&input, &Default::default()).seams
    });
}

#[divan::bench(args = CASES)]
fn whole_plan(bencher: Bencher, case: Case) {
    let views = [view(clouds::butt_joint(case.0))];
    run(bencher, case, || pipeline::plan(&views, &pipeline::Config::default(), &mut ()).is_ok());
}
