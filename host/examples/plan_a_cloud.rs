//! From a scan, or one cloud or mesh, to the torch paths of its seams as CSV.
//!
//! `cargo run --release -p weldpath --example plan_a_cloud -- fixtures/pipe`

use std::path::Path;

use weldpath::output::{csv, frame::PathFrame};
use weldpath::{input, pipeline};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let input = std::env::args().nth(1).unwrap_or("fixtures/pipe".into());
    print!("{}", planned(Path::new(&input))?);
    Ok(())
}

pub(crate) fn planned(input: &Path) -> Result<String, Box<dyn std::error::Error>> {
    let scan = input::read(input, &input::Options::default())?;
    let plan = pipeline::plan(&scan.views, &pipeline::Config::default(), &mut ())?;
    Ok(csv::write(&plan.paths, PathFrame::from(scan.frame)))
}
