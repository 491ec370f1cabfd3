//! Reads a `path.json` and fills in poses between its waypoints, eqs. (18) and (19), as the pendant does.
//!
//! `cargo run --release -p weldpath --example densify_a_path -- out/path.json`

use std::error::Error;

use weldpath::output::json;
use weldpath::weld::program::{Kind, Waypoint};
use weldpath_core::path::TorchPose;
use weldpath_core::path::interpolation::{Pitch, densify_by_pitch};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or("out/path.json".into());
    for (seam, poses) in densified(&std::fs::read_to_string(path)?, 0.5)?.iter().enumerate() {
        for TorchPose { position_mm: p, orientation: q } in poses {
            println!("{seam},{},{},{},{},{},{},{}", p.x, p.y, p.z, q.w, q.i, q.j, q.k);
        }
    }
    Ok(())
}

/// The welds of a program one after the other, each with a pose every `pitch_mm` at least.
pub(crate) fn densified(program: &str, pitch_mm: f32) -> Result<Vec<Vec<TorchPose>>, Box<dyn Error>> {
    let waypoints = json::read(program)?;
    let pitch = Pitch::new(pitch_mm).ok_or("a pitch is above 0 mm")?;
    let runs = waypoints.chunk_by(|a, b| a.kind == b.kind && a.seam == b.seam);
    let welds = runs.filter(|run| run[0].kind == Kind::Weld);
    Ok(welds
        .map(|weld| densify_by_pitch(&weld.iter().map(pose).collect::<Vec<_>>(), pitch).collect())
        .collect())
}

/// In single precision, as core computes.
fn pose(waypoint: &Waypoint) -> TorchPose {
    TorchPose { position_mm: waypoint.position_mm.cast(), orientation: waypoint.base_from_torch.cast() }
}
