//! Where a face was not seen, the warning names the stretch and a view that shows it; a good scan draws none.

use nalgebra::{Point3, Vector3};
use std::path::Path;
use weldpath::coverage::{Fault, Gap};
use weldpath::pipeline::{Config, Plan, plan};
use weldpath::scan::{Options, Scan, read};

fn fixture(name: &str) -> Scan {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    read(&root.join("fixtures").join(name), &Options::default()).unwrap()
}

fn planned(scan: &Scan) -> Plan {
    plan(&scan.views, &Config::default(), &mut ()).unwrap()
}

/// What no view sees any more once the readings on one face beyond a place along the seam are gone.
fn blinded(scan: &mut Scan, good: &Plan, face: usize, beyond: f64) -> (Point3<f64>, Vector3<f64>) {
    let stations = &good.seams[0].stations;
    let cut = stations[(beyond * stations.len() as f64) as usize];
    let (normal, other) = (cut.faces[face], cut.faces[1 - face]);
    for view in &mut scan.views {
        let pose = view.base_from_camera;
        view.points_mm.retain(|p| {
            let offset = pose * p.cast::<f64>() - cut.position_mm;
            // Kinematic poses are off by a few mm; the face reaches far above the other one.
            let on_face = offset.dot(&normal).abs() < 7.0 && offset.dot(&other) > 2.0;
            !(on_face && offset.dot(&cut.tangent) > 0.0)
        });
    }
    (cut.position_mm, normal)
}

#[test]
fn a_good_scan_draws_no_coverage_warning() {
    for name in ["fillet", "pipe", "butt-v", "lap"] {
        let plan = planned(&fixture(name));
        assert_eq!(plan.coverage, [], "{name}");
    }
}

#[test]
fn a_face_unseen_on_the_rest_of_a_seam_is_named_with_a_view_that_would_show_it() {
    let mut scan = fixture("fillet");
    let good = planned(&scan);
    let web = (0..2).min_by(|&a, &b| upright(&good, a).total_cmp(&upright(&good, b))).unwrap();
    let (cut_mm, normal) = blinded(&mut scan, &good, web, 0.6);
    let bad = planned(&scan);
    let gaps: Vec<&Gap> = bad.coverage.iter().filter(|gap| gap.face.dot(&normal) > 0.95).collect();
    let reached =
        |gap: &&&Gap| ((gap.view.position_mm - cut_mm).norm() < 700.0) && gap.to_mm - gap.from_mm > 20.0;
    let gap = gaps.iter().find(reached).unwrap_or_else(|| panic!("{:?}\n{:?}", bad.coverage, bad.seams));
    assert!(matches!(gap.fault, Fault::OpenEnd | Fault::Unseen));
    let seen_at = -gap.view.direction.dot(&normal);
    assert!(seen_at > 0.4, "the camera looks onto the face: cosine {seen_at}");
    let words = gap.words();
    assert!(words.contains("seam ") && words.contains("camera near"), "{words}");
    assert!(bad.warnings.contains(&words));
}

/// How much a face of the first seam looks up.
fn upright(plan: &Plan, face: usize) -> f64 {
    plan.seams[0].stations[0].faces[face].z
}

#[test]
fn a_view_that_was_left_out_is_asked_for_again() {
    // A web seen from both sides: without the views from one side the seam there is gone, or its web face is unseen.
    let mut scan = fixture("pipe");
    let all = planned(&scan);
    let around = all.seams.iter().find(|seam| seam.closed).expect("the pipe's seam is closed");
    scan.views.truncate(2);
    let few = planned(&scan);
    let longest = few.seams.iter().map(|seam| seam.length_mm()).fold(0.0, f64::max);
    assert!(longest < 0.95 * around.length_mm(), "two views do not see all round");
    assert!(!few.coverage.is_empty(), "{:?}", few.warnings);
    let centre = around.stations.iter().map(|s| s.position_mm.coords).sum::<Vector3<f64>>()
        / around.stations.len() as f64;
    for gap in &few.coverage {
        assert!(
            (gap.view.position_mm.coords - centre).norm() < 800.0 && gap.view.direction.z < 0.0,
            "{gap:?}"
        );
    }
}
