//! The number of threads changes how long a plan takes, and nothing else.

use std::path::Path;

use nalgebra::Isometry3;
use weldpath::geometry::cloud::View;
use weldpath::input;
use weldpath::pipeline::{self, Config, Plan};

fn planned(views: &[View], threads: usize) -> Plan {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(|| pipeline::plan(views, &Config::default(), &mut ())).expect("a seam")
}

/// Model, seams and torch paths are equal to the last bit.
fn assert_same(name: &str, views: &[View]) {
    let alone = planned(views, 1);
    for threads in [2, 5] {
        let plan = planned(views, threads);
        assert!(alone.model.points_mm == plan.model.points_mm, "{name}: points, {threads} threads");
        assert!(alone.model.normals == plan.model.normals, "{name}: normals, {threads} threads");
        assert_eq!(alone.seams.len(), plan.seams.len(), "{name}");
        for (a, b) in alone.seams.iter().zip(&plan.seams) {
            assert!(a.stations == b.stations, "{name}: seam {}, {threads} threads", a.id);
        }
    }
}

#[test]
fn a_scan_of_several_views_is_planned_alike_by_any_number_of_threads() {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/lap");
    assert_same("lap", &input::read(&fixture, &input::Options::default()).expect("a scan").views);
}

#[test]
fn so_is_a_lone_cloud_in_random_order_whose_camera_nobody_knows() {
    let view = View {
        name: "cloud".into(),
        points_mm: clouds::butt_joint(120_000),
        normals: Vec::new(),
        base_from_camera: Isometry3::identity(),
        camera_known: false,
        mesh: None,
        picture: None,
    };
    assert_same("butt joint", &[view]);
}
