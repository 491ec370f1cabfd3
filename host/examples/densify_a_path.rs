//! Reads a `path.json` and fills in poses between its waypoints, eqs. (18) and (19), as the pendant does.
//!
//! `cargo run --release -p weldpath --example densify_a_path -- out/path.json`

use std::error::Error;

use weldpath::output::json;
use weldpath::weld::program::{Kind, Waypoint};
use weldpath_core::path::TorchPose;
use weldpath_core::path::interpolation::densify;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or("out/path.json".into());
    for (seam, poses) in densified(&std::fs::read_to_string(path)?, 4)?.iter().enumerate() {
        for TorchPose { position_mm: p, orientation: q } in poses {
            println!("{seam},{},{},{},{},{},{},{}", p.x, p.y, p.z, q.w, q.i, q.j, q.k);
        }
    }
    Ok(())
}

/// The welds of a program one after the other, each with `per_segment` poses from waypoint to waypoint.
pub(crate) fn densified(program: &str, per_segment: u16) -> Result<Vec<Vec<TorchPose>>, Box<dyn Error>> {
    let (waypoints, _) = json::read(program)?;
    let runs = waypoints.chunk_by(|a, b| a.kind == b.kind && a.seam == b.seam);
    let welds = runs.filter(|run| run[0].kind == Kind::Weld);
    Ok(welds.map(|weld| densify(&weld.iter().map(pose).collect::<Vec<_>>(), per_segment).collect()).collect())
}

/// In single precision, as core computes.
fn pose(waypoint: &Waypoint) -> TorchPose {
    TorchPose { position_mm: waypoint.position_mm.cast(), orientation: waypoint.base_from_torch.cast() }
}
