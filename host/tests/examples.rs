//! The examples, each run on a fixture.
#![allow(dead_code, reason = "each example has a main of its own")]

use std::path::{Path, PathBuf};

use nalgebra::Point3;
use weldpath::{input, pipeline};

#[path = "../examples/densify_a_path.rs"]
mod densify_a_path;
#[path = "../examples/plan_a_cloud.rs"]
mod plan_a_cloud;
#[path = "../examples/stages_in_a_row.rs"]
mod stages_in_a_row;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures").join(name)
}

#[test]
fn a_cloud_is_planned_in_twenty_lines() {
    let run = plan_a_cloud::planned(&fixture("lap").to_string_lossy()).unwrap();
    let points: usize = run.paths().unwrap().iter().map(|path| path.points.len()).sum();
    assert!(points > 50, "{points}");
    let source = include_str!("../examples/plan_a_cloud.rs");
    assert!(source.lines().count() <= 20, "{} lines", source.lines().count());
}

#[test]
fn stages_in_a_row_find_the_edges_that_the_seams_lie_on() {
    let views = input::read(&fixture("fillet"), &input::Options::default()).unwrap().views;
    let edges = stages_in_a_row::edge_points(&views);
    let plan = pipeline::plan(&views, &pipeline::Config::default(), &mut ()).unwrap();
    assert!(edges.len() < plan.model.len() / 3, "{} of {}", edges.len(), plan.model.len());
    let off_mm = |place: &Point3<f64>| edges.iter().map(|p| (p - place).norm()).fold(f64::INFINITY, f64::min);
    let points: Vec<_> = plan.paths.iter().flat_map(|path| &path.points).collect();
    let near = points.iter().filter(|point| off_mm(&point.position_mm) < 3.0).count();
    assert!(near * 10 > points.len() * 9, "{near} of {} path points lie near an edge point", points.len());
}

#[test]
fn a_program_is_densified_between_its_own_waypoints() {
    let corner = |kind: &str, at: [f64; 3]| {
        format!(
            r#"{{"kind":"{kind}","seam":1,"weld":{},"feed_mm_s":8.0,"position_mm":{at:?},"base_from_torch_wxyz":[0.0,1.0,0.0,0.0]}}"#,
            kind == "weld"
        )
    };
    let waypoints = [
        corner("approach", [0.0, 0.0, 50.0]),
        corner("weld", [0.0, 0.0, 0.0]),
        corner("weld", [10.0, 0.0, 0.0]),
        corner("weld", [10.0, 5.0, 0.0]),
        corner("retract", [10.0, 5.0, 50.0]),
    ]
    .join(",");
    let program =
        format!(r#"{{"format":"weldpath-program","version":1,"frame":"base","waypoints":[{waypoints}]}}"#);
    let welds = densify_a_path::densified(&program, 20).unwrap();
    let [poses] = welds.as_slice() else { panic!("{} welds", welds.len()) };
    assert_eq!(poses.len(), 41, "two segments of 20 steps, and the last waypoint");
    assert!(poses.windows(2).all(|pair| (pair[1].position_mm - pair[0].position_mm).norm() < 0.501));
    assert_eq!(poses[20].position_mm, nalgebra::Point3::new(10.0, 0.0, 0.0));
    assert_eq!(poses[40].position_mm, nalgebra::Point3::new(10.0, 5.0, 0.0));
}
