//! What the library promises, listed by type, and that no array brings it down.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3};
use proptest::prelude::*;
use weldpath::files::File;
use weldpath::geometry::cloud::{PointCloud, View};
use weldpath::input::memory::{Bound, Limit};
use weldpath::input::{Intrinsics, Options};
use weldpath::output::summary::Summary;
use weldpath::output::verdict::{ReasonId, State, Verdict};
use weldpath::pipeline::PlanError;
use weldpath::robot::dialect::Dialect;
use weldpath::seam::Seam;
use weldpath::weld::SeamPath;
use weldpath::weld::program::Waypoint;
use weldpath::{
    CameraPose, Coordinates, Error, Job, Observer, PosedViews, RawCloud, RawView, Run, Scan, Transform,
    Units, Withheld, input,
};

type Read<T> = Result<T, input::Error>;

/// A line that no longer compiles is a break for users: it belongs in CHANGELOG.md.
#[test]
fn the_promise_by_its_types() {
    let _: fn(&Path, &Options) -> Read<Scan> = input::read;
    let _: fn(u64) -> Limit = Limit::of_mb;
    let _: fn(Coordinates) -> RawCloud = RawCloud::new;
    let _: fn(RawCloud, Vec<[f32; 3]>) -> Read<RawCloud> = RawCloud::with_normals;
    let _: fn(RawCloud, Vec<[usize; 3]>) -> Read<RawCloud> = RawCloud::with_triangles;
    let _: fn(RawCloud, &str, &Options) -> Read<Scan> = RawCloud::read;
    let _: fn(Vec<u16>, [u32; 2], &Intrinsics, f64) -> Read<RawView> = RawView::of_depth;
    let _: fn(&[f32], [u32; 2], &Intrinsics) -> Read<RawView> = RawView::of_depth_m;
    let _: fn(RawCloud) -> RawView = RawView::of_cloud;
    let _: fn(RawView, CameraPose) -> RawView = RawView::posed;
    let _: fn(PosedViews, &Options) -> Read<Scan> = PosedViews::read;
    let _: fn(&Path) -> Result<Job, weldpath::run::job::Error> = Job::read;
    let _: fn(&str, &Path) -> Result<Job, weldpath::run::job::Error> = Job::parse;
    let _: fn(&Scan, &Job, &mut dyn Observer) -> Result<Run, Error> = weldpath::plan;
    let _: fn(&Run) -> &Verdict = Run::verdict;
    let _: fn(&Run) -> &Summary = Run::summary;
    let _: fn(&Run) -> &Job = Run::job;
    let _: fn(&Run) -> &[Seam] = Run::seams;
    let _: fn(&Run) -> &PointCloud = Run::model;
    let _: fn(&Run) -> Result<&[SeamPath], Withheld> = Run::paths;
    let _: for<'a> fn(&'a Run, &[ReasonId]) -> Result<&'a [Waypoint], Withheld> = Run::program;
    let _: for<'a> fn(&'a Run, &[ReasonId]) -> Result<Vec<&'a File>, Withheld> = Run::program_files;
    let _: fn(&Run, &[Dialect], &mut dyn Observer) -> Result<Run, Error> = Run::for_robots;
    let _: fn(&Run) -> Vec<File> = Run::files;
    let _: fn(&Run) -> Vec<u8> = Run::report;
    let _: fn(&Run, &Path, bool) -> Result<(), weldpath::files::Error> = Run::write;
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures").join(name)
}

fn run_of(name: &str, job: &str) -> Run {
    let scan = input::read(&fixture(name), &Options::default()).unwrap();
    weldpath::plan(&scan, &Job::parse(job, Path::new("job.toml")).unwrap(), &mut ()).unwrap()
}

#[test]
fn a_program_is_handed_out_to_who_confirms_each_reason() {
    let run = run_of("lap", "");
    assert_eq!(run.verdict().state, State::Check);
    let open: Vec<ReasonId> = run.verdict().reasons.iter().map(|reason| reason.id).collect();
    let Err(Withheld::Unconfirmed(left)) = run.program(&[]) else { panic!("handed out") };
    assert!(left.iter().all(|id| open.contains(id)) && left.len() > 1, "{left:?}");
    assert!(matches!(run.program(&left[1..]), Err(Withheld::Unconfirmed(one)) if one == left[..1]));
    assert!(run.program(&left).is_ok_and(|program| program.len() > 100));
    let other = run.for_robots(&[Dialect::Kuka], &mut ()).unwrap();
    let names: Vec<&str> =
        other.program_files(&left).unwrap().iter().map(|file| file.name.as_str()).collect();
    assert!(names.contains(&"weldpath.src") && !names.contains(&"path.script"), "{names:?}");
}

#[test]
fn of_a_refused_run_there_is_no_path_and_no_program() {
    // Of a scan in its camera's frame nobody knows where the robot is.
    let lens = "300,300,160,120".parse().unwrap();
    let view = RawView::of_depth(corner(), [320, 240], &lens, 0.0001).unwrap();
    let scan = PosedViews { views: vec![view], ..PosedViews::default() }.read(&Options::default()).unwrap();
    let Ok(run) = weldpath::plan(&scan, &Job::default(), &mut ()) else { panic!("no seam in a corner") };
    assert_eq!(run.verdict().state, State::Refused, "{:?}", run.verdict());
    assert!(!run.seams().is_empty());
    assert!(matches!(run.paths(), Err(Withheld::Refused(_))));
    assert!(matches!(run.program(ReasonId::ALL), Err(Withheld::Refused(_))));
    assert!(run.files().iter().all(|file| file.name != "path.script" && file.name != "path.json"));
}

/// Depths in tenths of a millimetre of two faces that meet at 90 degrees in a line down the picture, 500 mm away.
fn corner() -> Vec<u16> {
    let depth = |k: u32| {
        let slope = (f64::from(k % 320) - 160.0).abs() / 300.0;
        // z + |x| = 500 along the ray x = slope * z.
        (5000.0 / (1.0 + slope)).round() as u16
    };
    (0..320 * 240).map(depth).collect()
}

#[test]
fn views_that_no_reader_makes_are_refused_by_number() {
    let view = |points_mm: Vec<Point3<f32>>| View {
        name: "by hand".into(),
        points_mm,
        normals: Vec::new(),
        base_from_camera: Isometry3::identity(),
        camera_known: true,
        mesh: None,
        picture: None,
    };
    let good = view(vec![Point3::new(0.0, 0.0, 1.0)]);
    let refused = |views: &[View], at: usize, part: &str| match weldpath::pipeline::plan(
        views,
        &Default::default(),
        &mut (),
    ) {
        Err(PlanError::NoView { view, problem }) => {
            assert!(view == at && problem.contains(part), "{problem}")
        }
        other => panic!("{other:?}"),
    };
    refused(&[], 0, "none");
    refused(&[good.clone(), view(Vec::new())], 1, "no point");
    refused(&[view(vec![Point3::new(f32::NAN, 0.0, 1.0)])], 0, "not finite");
    refused(&[View { normals: vec![Default::default(); 2], ..good }], 0, "2 normals for 1 points");
}

#[test]
fn the_limit_of_memory_is_that_of_each_reading() {
    let points: Vec<[f32; 3]> = (0..1_100_000).map(|i| [i as f32 * 1e-4, (i % 1000) as f32, 0.5]).collect();
    let read = |memory: Limit| {
        RawCloud::new(Coordinates::Single(points.clone()))
            .read("points", &Options { memory, ..Options::default() })
    };
    let small = || match read(Limit::of_mb(64)) {
        Err(input::Error::TooLarge { bound, most_mb, .. }) => (bound, most_mb),
        other => panic!("{:?}", other.map(|scan| scan.notes)),
    };
    assert_eq!(small(), (Bound::Memory, 64));
    assert!(read(Limit::of_mb(1000)).is_ok());
    assert_eq!(small(), (Bound::Memory, 64));
}

/// Numbers of all kinds, and of the size of a workpiece.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -300.0..300.0, 1 => any::<f64>(), 1 => Just(0.0), 1 => (-3..3).prop_map(f64::from)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn no_array_brings_it_down(
        points in prop::collection::vec(prop::array::uniform3(number()), 0..60),
        pose in prop::array::uniform6(number()),
        triangles in prop::collection::vec(prop::array::uniform3(0usize..60), 0..4),
        depths in prop::collection::vec(prop_oneof![any::<f32>(), 0.2f32..2.0], 48),
        scale in prop_oneof![Just(0.001), any::<f64>()],
        kind in 0..4,
    ) {
        let options = Options { units: [Units::Auto, Units::Metres, Units::Millimetres][points.len() % 3], ..Options::default() };
        let cloud = || RawCloud::new(Coordinates::Double(points.clone()));
        let intrinsics: Intrinsics = "8,8,4,3".parse().unwrap();
        let pose = CameraPose::BaseFromCamera(Transform::Vector(pose));
        let scan = match kind {
            0 => cloud().read("cloud", &options),
            1 => cloud().with_triangles(triangles).and_then(|mesh| mesh.read("mesh", &options)),
            2 => PosedViews { views: vec![RawView::of_cloud(cloud()).posed(pose); 2], ..PosedViews::default() }.read(&options),
            _ => {
                let counts = depths.iter().map(|z| (z * 1000.0) as u16).collect();
                let views = [RawView::of_depth_m(&depths, [8, 6], &intrinsics), RawView::of_depth(counts, [8, 6], &intrinsics, scale)];
                let views = views.into_iter().filter_map(Result::ok).map(|view| view.posed(pose)).collect();
                PosedViews { views, ..PosedViews::default() }.read(&options)
            }
        };
        if let Ok(scan) = scan {
            let _ = weldpath::plan(&scan, &Job::default(), &mut ());
        }
    }
}
