//! Instructions that three small fixed cases take, counted by valgrind: no noise, so a slower kernel shows at once.
//!
//! Held to `instructions.txt` within 3 %, keyed by the compiler's version, in the release profile. Another profile, a compiler
//! that is not in the file, and a machine without valgrind print a line and hold nothing; the lines printed are what the file takes.

use std::process::Command;

use nalgebra::{Isometry3, Vector3};
use weldpath::geometry::cloud::{PointCloud, View};
use weldpath::geometry::grid::Grid;
use weldpath::model::denoising::{BilateralConfig, bilateral};
use weldpath::pipeline;
use weldpath::seam::score::edges;

const BASELINE: &str = include_str!("instructions.txt");
const CASES: [&str; 3] = ["edge_scores", "bilateral_filter", "whole_plan"];
const POINTS: usize = 10_000;
/// Share by which a count may exceed its baseline.
const SLACK: f64 = 0.03;

/// The first word of `rustc --version` that is a version.
fn compiler() -> Option<String> {
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    let said = Command::new(rustc).arg("--version").output().ok()?;
    Some(String::from_utf8(said.stdout).ok()?.split_whitespace().nth(1)?.to_string())
}

/// Instructions of one ignored test of this file as a process of its own.
fn instructions(case: &str) -> Option<f64> {
    let this = std::env::current_exe().expect("the test itself");
    let run = Command::new("valgrind")
        .args(["--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"])
        .arg(this)
        .args(["--ignored", "--exact", "--test-threads=1", &format!("instructions::{case}")])
        .output()
        .ok()?;
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{case} under valgrind: {said}");
    let (_, count) = said
        .lines()
        .find_map(|line| line.split_once("I refs:"))
        .or_else(|| said.lines().find_map(|line| line.split_once("I   refs:")))?;
    count.trim().replace(',', "").parse().ok()
}

fn baseline(compiler: &str, case: &str) -> Option<f64> {
    let words = BASELINE.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    let mut known = words.filter(|w| w.len() == 3 && w[0] == compiler && w[1] == case);
    known.next()?[2].parse().ok()
}

#[test]
fn no_case_takes_more_instructions_than_it_did() {
    if cfg!(debug_assertions) {
        println!("skipped: counted in the release profile");
        return;
    }
    let (Some(nothing), Some(compiler)) = (instructions("nothing"), compiler()) else {
        println!("skipped: valgrind or rustc is not here");
        return;
    };
    for case in CASES {
        let count = instructions(case).expect("valgrind counts") - nothing;
        println!("{compiler} {case} {count}");
        match baseline(&compiler, case) {
            Some(known) => {
                assert!(count <= known * (1.0 + SLACK), "{case}: {count} instructions, {known} before");
            }
            None => println!("not held: {compiler} is not in instructions.txt"),
        }
    }
}

/// What every case does before it begins.
fn prepared() -> (PointCloud, f32) {
    // Valgrind runs one case to a process; should several run in one, the first pool serves all.
    let _ = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global();
    let points_mm = clouds::butt_joint(POINTS);
    let normals = vec![Vector3::z(); POINTS];
    (PointCloud { points_mm, normals, ..PointCloud::default() }, clouds::radius_mm(POINTS))
}

#[test]
#[ignore = "counted by another test"]
fn nothing() {
    prepared();
}

#[test]
#[ignore = "counted by another test"]
fn edge_scores() {
    let (cloud, radius_mm) = prepared();
    let grid = Grid::new(&cloud.points_mm, radius_mm);
    let intensity: Vec<f32> = edges::asymmetries(&grid, radius_mm).iter().map(Vector3::norm).collect();
    let gradients = edges::gradients(&grid, radius_mm, &intensity);
    assert_eq!(edges::tensors(&grid, radius_mm, &gradients).len(), POINTS);
}

#[test]
#[ignore = "counted by another test"]
fn bilateral_filter() {
    let (cloud, radius_mm) = prepared();
    let config = BilateralConfig { radius_mm, distance_mm: radius_mm / 3.0, height_mm: 0.6 };
    assert_eq!(bilateral(&cloud, &config).len(), POINTS);
}

#[test]
#[ignore = "counted by another test"]
fn whole_plan() {
    let (cloud, _) = prepared();
    let camera = Isometry3::translation(250.0, 0.0, 600.0);
    let seen = cloud.points_mm.iter().map(|p| p - camera.translation.vector.cast::<f32>()).collect();
    let view = View {
        mesh: None,
        picture: None,
        name: "view".into(),
        points_mm: seen,
        normals: Vec::new(),
        base_from_camera: camera,
        camera_known: true,
    };
    // So thin a cloud may hold no seam that is sure: what counts is the way there.
    let _ = pipeline::plan(&[view], &pipeline::Config::default(), &mut ());
}
