//! From a scan, or one cloud or mesh, to the torch paths of its seams.
//!
//! `cargo run --release -p weldpath --example plan_a_cloud -- fixtures/pipe`

use weldpath::{Job, Run, input};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let run = planned(&std::env::args().nth(1).unwrap_or("fixtures/pipe".into()))?;
    run.verdict().lines().iter().for_each(|line| println!("{line}"));
    for path in run.paths()? {
        println!("seam {}: {} points, {:.1} mm", path.seam, path.points.len(), path.length_mm());
    }
    Ok(())
}

pub(crate) fn planned(scan: &str) -> Result<Run, Box<dyn std::error::Error>> {
    let scan = input::read(scan.as_ref(), &input::Options::default())?;
    Ok(weldpath::plan(&scan, &Job::default(), &mut ())?)
}
