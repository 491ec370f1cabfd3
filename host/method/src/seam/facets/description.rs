//! A strand of pieces as a seam: stations, joint, what is measured of it.

use super::corner::{ALIKE_COSINE, Piece};
use super::strand::Strand;
use crate::geometry::mesh::{Mesh, Side};
use crate::seam::measure::dimension::{Dimension, Quantity, Value};
use crate::seam::measure::joint::{self, CrossSection};
use crate::seam::{ErrorParts, Joint, Seam, Station};
use nalgebra::{Isometry3, Point3, Vector3};

/// Largest distance of stations, mm.
const STATION_MM: f64 = 2.0;
/// How far a face is followed from the seam, mm; bevels of thick plates farther.
const REACH_MM: f64 = 14.0;
const BEVEL_REACH_MM: f64 = 42.0;
const BEVEL_DEG: f64 = 75.0;
/// Step in which it is followed, and how far it may bend away in one, mm.
const STRIDE_MM: f64 = 0.5;
const BEND_MM: f64 = 0.25;
/// Error of the position and of the torch that even an exact mesh leaves: the rounding of the path, mm and degrees.
const FLOOR_MM: f64 = 0.01;
const FLOOR_DEG: f64 = 0.1;
/// What is taken from the confidence if something stands in the torch's way all along.
const BLOCKED: f64 = 0.3;

/// The seam of a strand.
pub(super) fn seam(mesh: &Mesh, strand: &Strand, base_from_mesh: &Isometry3<f64>) -> Seam {
    let stations = stations(strand);
    let section = section(mesh, strand, &stations);
    let (joint, reason) = joint::classify(&section, strand.closed);
    let to_base = |s: &Station| Station {
        position_mm: base_from_mesh * s.position_mm,
        tangent: base_from_mesh * s.tangent,
        faces: s.faces.map(|n| base_from_mesh * n),
    };
    let (position_mm, orientation_deg) = expected(mesh, strand);
    let (blocked, warnings) = blocked(strand);
    Seam {
        id: 0,
        joint,
        reason: format!("{reason}, from the facets of the mesh"),
        stations: stations.iter().map(to_base).collect(),
        closed: strand.closed,
        confidence: 1.0 - BLOCKED * blocked,
        expected_error_mm: position_mm,
        relative_error_mm: position_mm,
        fit_error: crate::seam::FitError::default(),
        error_parts: ErrorParts::of_noise(position_mm),
        expected_error_deg: orientation_deg,
        base_error_mm: f64::NAN,
        base_error_deg: f64::NAN,
        contact: None,
        drawn: false,
        dimensions: dimensions(joint, &section, position_mm),
        warnings,
    }
}

/// The frame at each piece's ends is the mean of those that meet there, and its own half-way along the shorter of the two:
/// strips of a curved face then turn the torch steadily.
fn stations(strand: &Strand) -> Vec<Station> {
    let pieces = &strand.pieces;
    let count = pieces.len();
    let neighbour = |k: usize, ahead: bool| match (strand.closed, ahead) {
        (true, true) => Some(&pieces[(k + 1) % count]),
        (true, false) => Some(&pieces[(k + count - 1) % count]),
        (false, true) => pieces.get(k + 1),
        (false, false) => k.checked_sub(1).map(|k| &pieces[k]),
    };
    let mut stations = Vec::new();
    for (k, piece) in pieces.iter().enumerate() {
        let (before, after) = (neighbour(k, false), neighbour(k, true));
        let from = before.map_or(piece.ends[0], |b| nalgebra::center(&b.ends[1], &piece.ends[0]));
        let to = after.map_or(piece.ends[1], |a| nalgebra::center(&a.ends[0], &piece.ends[1]));
        let length = (to - from).norm();
        let steps = (length / STATION_MM).ceil().max(1.0);
        for step in 0..steps as usize + usize::from(after.is_none()) {
            let u = length * step as f64 / steps;
            let toward = |other: Option<&Piece>, away_mm: f64| {
                let other = other?;
                let zone = 0.5 * piece.length_mm().min(other.length_mm());
                (away_mm < zone).then(|| (*other, 0.5 * (1.0 - away_mm / zone)))
            };
            let mixed = toward(before, u).or_else(|| toward(after, length - u));
            let (other, share) = mixed.unwrap_or((*piece, 0.0));
            let blend = |own: Vector3<f64>, other: Vector3<f64>| {
                (own * (1.0 - share) + other * share).try_normalize(1e-6).unwrap_or(own)
            };
            let tangent = blend(piece.along, other.along);
            let square = |n: Vector3<f64>| (n - tangent * n.dot(&tangent)).try_normalize(1e-6).unwrap_or(n);
            // A ring may come back with its faces on the other hand.
            let swapped = piece.normals[0].dot(&other.normals[0]) < piece.normals[0].dot(&other.normals[1]);
            let theirs = |face: usize| other.normals[if swapped { 1 - face } else { face }];
            let faces = [0, 1].map(|face| square(blend(piece.normals[face], theirs(face))));
            stations.push(Station {
                position_mm: from + (to - from) * (u / length.max(1e-9)),
                tangent,
                faces,
            });
        }
    }
    stations
}

/// Cross-section of the seam, as the scan's would be.
fn section(mesh: &Mesh, strand: &Strand, stations: &[Station]) -> CrossSection {
    const SECTIONS: usize = 9;
    let n = stations.len() as f64;
    let mean = |k: usize| stations.iter().map(|s| s.faces[k]).sum::<Vector3<f64>>() / n;
    let total: f64 = strand.length_mm();
    let cosine =
        strand.pieces.iter().map(|p| p.normals[0].dot(&p.normals[1]) * p.length_mm()).sum::<f64>() / total;
    let opening_deg = 180.0 - cosine.clamp(-1.0, 1.0).acos().to_degrees();
    let most_mm = if opening_deg < BEVEL_DEG { BEVEL_REACH_MM } else { REACH_MM };
    let mut pieces: Vec<&Piece> = strand.pieces.iter().collect();
    pieces.sort_by(|a, b| b.length_mm().total_cmp(&a.length_mm()));
    pieces.truncate(SECTIONS);
    let mut section = CrossSection {
        opening_deg: opening_deg as f32,
        short: [false; 2],
        reach_mm: [most_mm as f32; 2],
        beyond: [None; 2],
        steadiness: [mean(0).norm() as f32, mean(1).norm() as f32],
    };
    for k in 0..2 {
        let mut looks: Vec<(f64, Option<Vector3<f64>>)> =
            pieces.iter().map(|piece| followed(mesh, piece, k, most_mm)).collect();
        looks.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (reach_mm, beyond) = looks[looks.len() / 2];
        section.reach_mm[k] = reach_mm as f32;
        section.short[k] = reach_mm < most_mm;
        section.beyond[k] = beyond.map(|b| b.cast());
    }
    section
}

/// How far face `k` goes on from the middle of a piece, and the normal of what begins there: along this face's, the other's
/// and the bisector.
fn followed(mesh: &Mesh, piece: &Piece, k: usize, most_mm: f64) -> (f64, Option<Vector3<f64>>) {
    let mut normal = piece.normals[k];
    let mut at = piece.middle();
    let other = piece.normals[1 - k];
    let mut into = (other - normal * other.dot(&normal)).normalize();
    let mut reach_mm = 0.0;
    while reach_mm < most_mm {
        let Some((place, there)) = step_on(mesh, &(at + into * STRIDE_MM), &normal) else {
            // The first strides may lie over a gap.
            if reach_mm > 2.0 * STRIDE_MM {
                break;
            }
            at += into * STRIDE_MM;
            reach_mm += STRIDE_MM;
            continue;
        };
        (at, normal) = (place, there);
        into = (into - normal * into.dot(&normal)).normalize();
        reach_mm += STRIDE_MM;
    }
    let bisector = (piece.normals[0] + piece.normals[1]).normalize();
    let beyond = (reach_mm < most_mm).then(|| beyond(mesh, &at, &into, &normal)).flatten();
    (reach_mm, beyond.map(|b| Vector3::new(b.dot(&piece.normals[k]), b.dot(&other), b.dot(&bisector))))
}

/// The surface at a place, if it is near and little turned.
fn step_on(mesh: &Mesh, at: &Point3<f64>, normal: &Vector3<f64>) -> Option<(Point3<f64>, Vector3<f64>)> {
    let mut nearest: Option<(f64, Vector3<f64>)> = None;
    let above = at + normal * BEND_MM;
    mesh.tree.any_hit(&above, &-normal, 2.0 * BEND_MM, |hit| {
        let facet = mesh.normals[hit.facet as usize];
        let facet = if facet.dot(normal) < 0.0 { -facet } else { facet };
        let nearer = nearest.is_none_or(|(best, _)| (hit.t - BEND_MM).abs() < (best - BEND_MM).abs());
        if facet.dot(normal) > ALIKE_COSINE && nearer {
            nearest = Some((hit.t, facet));
        }
        false
    });
    nearest.map(|(t, facet)| (above - normal * t, facet))
}

/// Normal of the surface that begins where a face ends, of those there the one that faces most along it.
fn beyond(mesh: &Mesh, at: &Point3<f64>, into: &Vector3<f64>, normal: &Vector3<f64>) -> Option<Vector3<f64>> {
    let around = Vector3::repeat(2.0 * STRIDE_MM);
    let mut best: Option<Vector3<f64>> = None;
    let lip = at + into * STRIDE_MM;
    mesh.tree.in_box(&(lip - around), &(lip + around), |facet| {
        let own = mesh.normals[facet as usize];
        let out = match mesh.sides[facet as usize] {
            Side::Front => own,
            Side::Back => -own,
            Side::Both if own.dot(into) < 0.0 => -own,
            Side::Both => own,
        };
        let better = best.is_none_or(|b| out.dot(into) > b.dot(into));
        if out.dot(normal).abs() < 0.9 && out.dot(into) > 0.2 && better {
            best = Some(out);
        }
    });
    best
}

fn dimensions(joint: Joint, section: &CrossSection, error_mm: f64) -> Vec<Dimension> {
    let row = |quantity, value: f32, uncertainty| Dimension {
        quantity,
        value: Ok(Value { value: f64::from(value), uncertainty }),
    };
    match joint {
        Joint::ButtV => vec![row(Quantity::IncludedAngle, section.opening_deg, FLOOR_DEG)],
        Joint::Lap => {
            let short = usize::from(section.short[1]);
            vec![row(Quantity::SheetThickness, section.reach_mm[short], STRIDE_MM.max(error_mm))]
        }
        _ => Vec::new(),
    }
}

/// Expected error of position and torch: the sag of chords of a curve, the tolerance of the mesh.
fn expected(mesh: &Mesh, strand: &Strand) -> (f64, f64) {
    let pairs = strand.pieces.windows(2);
    let bends = pairs.map(|w| {
        let turn = w[0].along.dot(&w[1].along).clamp(-1.0, 1.0).acos();
        (w[0].length_mm().min(w[1].length_mm()) * turn / 8.0, turn.to_degrees())
    });
    let (count, sag_mm, turn_deg) =
        bends.fold((0.0, 0.0, 0.0), |(n, sag, turn), bend| (n + 1.0, sag + bend.0, turn + bend.1));
    let n = f64::max(count, 1.0);
    // Root mean square of a parabola over its height; a normal is exact at the middle of each strip.
    let position_mm = ((0.73 * sag_mm / n).powi(2) + mesh.weld_mm.powi(2) + FLOOR_MM.powi(2)).sqrt();
    (position_mm, FLOOR_DEG + 0.1 * turn_deg / n)
}

/// Share of the length on which something stands in the torch's way, and a word on it.
fn blocked(strand: &Strand) -> (f64, Vec<String>) {
    let blocked = || strand.pieces.iter().filter_map(|p| Some((p.blocked_mm?, p.length_mm())));
    let share = blocked().map(|(_, length)| length).sum::<f64>() / strand.length_mm();
    let nearest = blocked().map(|(mm, _)| mm).fold(f64::INFINITY, f64::min);
    let warning = format!(
        "along the bisector of the faces the work itself is in the torch's way, {nearest:.0} mm from the \
         seam, on {:.0} % of the length: lean the torch",
        100.0 * share
    );
    (share, if share > 0.0 { vec![warning] } else { Vec::new() })
}
