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
    for name in ["fillet", "pipe", "butt-v", "lap"] {
        let plan = planned(&fixture(name));
        assert_eq!(plan.coverage, [], "{name}");
    }
}
