//! Seams of a mesh, from its facets (ours): the lines in which two faces meet at an inside corner, to the precision of the
//! file.
//!
//! Faces meet in an edge of one body, where one body stands on another or near it, or where bodies overlap. All are treated
//! alike: a line in which the planes of two faces cut, and along it the question whether both faces are there and the wedge
//! between them is air that can be seen from outside. Which bodies the modeller drew as one does not matter.

mod corner;
mod description;
mod meeting;
mod strand;

use crate::cancellation::go_on;
use crate::geometry::mesh::Mesh;
use crate::seam::ordering::{mark_branches, order};
use crate::seam::{Found, Seam};
use nalgebra::Isometry3;
use rayon::prelude::*;

/// Bodies up to so far apart touch, mm.
const GAP_MM: f64 = 0.5;
/// Faces that open to less or more are no inside corner, degrees: a crack, or one surface with a bend.
const OPENING_DEG: [f64; 2] = [20.0, 155.0];
/// Shorter seams are named, not offered, mm: four times the leg of a fillet of 1.5 mm (AWS D1.1 asks for as much).
const SHORTEST_MM: f64 = 6.0;
/// Shorter ones are rounding of the mesh, mm.
const LEAST_MM: f64 = 2.0;
/// Ends of seams so near meet in a junction, mm.
const JUNCTION_MM: f64 = 1.0;

/// All seams of a mesh in the order of the weld.
pub fn find(mesh: &Mesh, base_from_mesh: &Isometry3<f64>) -> Found {
    let meetings = meeting::meetings(mesh);
    let pieces: Vec<corner::Piece> = meetings
        .par_iter()
        .flat_map_iter(|meeting| {
            go_on();
            corner::pieces(mesh, meeting)
        })
        .collect();
    let mut strands = strand::strands(strand::once(pieces));
    strands.retain(strand::Strand::is_seen);
    let (long, short): (Vec<_>, Vec<_>) =
        strands.into_iter().partition(|strand| strand.length_mm() >= SHORTEST_MM);
    let mut seams: Vec<Seam> = long
        .par_iter()
        .map(|strand| {
            go_on();
            description::seam(mesh, strand, base_from_mesh)
        })
        .collect();
    mark_branches(&mut seams, JUNCTION_MM);
    order(&mut seams);
    let reason =
        "the mesh has no inside corner, in one body or where bodies touch, that can be seen from outside"
            .into();
    Found { seams, reason, warnings: left_out(&short, base_from_mesh), ..Found::default() }
}

/// A word on the corners that are too short to weld.
fn left_out(short: &[strand::Strand], base_from_mesh: &Isometry3<f64>) -> Vec<String> {
    const NAMED: usize = 4;
    let short: Vec<_> = short.iter().filter(|strand| strand.length_mm() >= LEAST_MM).collect();
    let place = |strand: &&strand::Strand| {
        let at = base_from_mesh * strand.pieces[strand.pieces.len() / 2].middle();
        format!("{:.1} mm at {:.0},{:.0},{:.0}", strand.length_mm(), at.x, at.y, at.z)
    };
    let places: Vec<String> = short.iter().take(NAMED).map(place).collect();
    let more = if short.len() > NAMED { ", ..." } else { "" };
    let warning = format!(
        "{} inside corners shorter than {SHORTEST_MM:.0} mm are not offered: {}{more}",
        short.len(),
        places.join(", ")
    );
    if short.is_empty() { Vec::new() } else { vec![warning] }
}

#[cfg(test)]
mod tests;
