//! A good scan draws no coverage warning; what does is tested beside the code.

use std::path::Path;
use weldpath::pipeline::{Config, Plan, plan};
use weldpath::scan::{Options, Scan, read};

fn fixture(name: &str) -> Scan {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    read(&root.join("fixtures").join(name), &Options::default()).unwrap()
}

fn planned(scan: &Scan) -> Plan {
    plan(&scan.views, &Config::default(), &mut ()).unwrap()
}

#[test]
fn a_good_scan_draws_no_coverage_warning() {
    for name in ["fillet", "butt-v", "lap"] {
        assert_eq!(planned(&fixture(name)).coverage, [], "{name}");
    }
}

#[test]
fn the_corner_inside_a_pipe_is_seen_in_part_and_said_to_go_on() {
    let plan = planned(&fixture("pipe"));
    let open: Vec<usize> = plan.seams.iter().filter(|seam| !seam.closed).map(|seam| seam.id).collect();
    assert!(!plan.coverage.is_empty(), "the truth of the inner ring is hidden for the most part");
    assert!(plan.coverage.iter().all(|gap| open.contains(&gap.seam)), "{:?}", plan.coverage);
}
