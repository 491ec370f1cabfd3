//! Which side of a shell is air.
//!
//! Facets are turned alike over the edges that two of them share. What then encloses a volume has it inside. An open shell is
//! looked at from outside: the side from which more is seen is air; where that says too little, the way it was wound is
//! believed; a sheet without thickness has air on both sides.

use super::{Mesh, Side};
use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;

/// Rays from each place that is looked at, and places on a shell.
const RAYS: usize = 32;
const PLACES: usize = 160;
/// A side from which so many times as many rays leave as from the other is air.
const CLEARLY: f64 = 3.0;
/// Share of the area that must be wound alike for the winding to be believed.
const ALIKE: f64 = 0.95;
/// A shell is closed if the volume and area of it fit together: a sheet that is folded flat encloses nothing.
const LEAST_THICKNESS: f64 = 1e-6;

/// Evenly spread unit directions (Fibonacci's spiral).
pub fn directions(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |k| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let (sin, cos) = (golden * k as f64).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vector3::new(r * cos, r * sin, z)
    })
}

/// A connected part of the mesh.
struct Shell {
    /// Its facets, and whether each is turned over so that all face one way.
    facets: Vec<(u32, bool)>,
    closed: bool,
    /// No edge at which it turns sharply.
    smooth: bool,
}

/// The sides of all facets of a mesh.
pub(super) fn sides(mesh: &Mesh) -> Vec<Side> {
    let mut sides = vec![Side::Both; mesh.facets.len()];
    for shell in shells(mesh) {
        let Some(front) = front(mesh, &shell) else { continue };
        for &(facet, turned) in &shell.facets {
            sides[facet as usize] = if front != turned { Side::Front } else { Side::Back };
        }
    }
    sides
}

/// Whether air is on the side of the normals of a shell's facets, once they are turned alike; none where it is on both.
fn front(mesh: &Mesh, shell: &Shell) -> Option<bool> {
    let sign = |turned: bool| if turned { -1.0 } else { 1.0 };
    let area: f64 = shell.facets.iter().map(|&(f, _)| mesh.area_mm2(f)).sum();
    let volume: f64 = shell
        .facets
        .iter()
        .map(|&(f, turned)| {
            let [a, b, c] = mesh.corners(f).map(|p| p - mesh.vertices[0]);
            sign(turned) * a.dot(&b.cross(&c)) / 6.0
        })
        .sum();
    if shell.closed && volume.abs() > LEAST_THICKNESS * area * mesh.diagonal_mm() {
        return Some(volume > 0.0);
    }
    if shell.smooth {
        return None;
    }
    let [front, back] = seen(mesh, shell, area);
    let wound: f64 =
        shell.facets.iter().filter(|(_, turned)| !turned).map(|&(f, _)| mesh.area_mm2(f)).sum::<f64>() / area;
    match () {
        _ if front > CLEARLY * back => Some(true),
        _ if back > CLEARLY * front => Some(false),
        _ if wound >= ALIKE => Some(true),
        _ if wound <= 1.0 - ALIKE => Some(false),
        _ => Some(front >= back),
    }
}

/// How many rays leave from either side of a shell.
fn seen(mesh: &Mesh, shell: &Shell, area: f64) -> [f64; 2] {
    let off_mm = 4.0 * mesh.weld_mm;
    let far = 2.0 * mesh.diagonal_mm();
    let mut seen = [0.0, 0.0];
    let mut covered = 0.0;
    let mut next = 0;
    for &(facet, turned) in &shell.facets {
        covered += mesh.area_mm2(facet) / area * PLACES as f64;
        let normal = mesh.normals[facet as usize] * if turned { -1.0 } else { 1.0 };
        let [a, b, c] = mesh.corners(facet);
        while (next as f64) + 0.5 < covered && next < PLACES {
            let (u, v) = ((next as f64 * 0.754_877_666).fract(), (next as f64 * 0.569_840_291).fract());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            let at: Point3<f64> = a + (b - a) * u + (c - a) * v;
            for (k, outward) in [normal, -normal].iter().enumerate() {
                let free = |d: &Vector3<f64>| {
                    d.dot(outward) > 0.0 && mesh.tree.is_free(&(at + outward * off_mm), d, far)
                };
                seen[k] += directions(RAYS).filter(free).count() as f64;
            }
            next += 1;
        }
    }
    seen
}

/// The shells of a mesh: facets that are joined by edges of two.
fn shells(mesh: &Mesh) -> Vec<Shell> {
    let mut edges_of: Vec<Vec<u32>> = vec![Vec::new(); mesh.facets.len()];
    for (k, edge) in mesh.edges.iter().enumerate() {
        edge.facets.iter().for_each(|&f| edges_of[f as usize].push(k as u32));
    }
    let mut turned: Vec<Option<bool>> = vec![None; mesh.facets.len()];
    let mut shells = Vec::new();
    for seed in 0..mesh.facets.len() as u32 {
        if turned[seed as usize].is_some() {
            continue;
        }
        turned[seed as usize] = Some(false);
        let mut shell = Shell { facets: vec![(seed, false)], closed: true, smooth: true };
        let mut next = 0;
        while let Some(&(f, own)) = shell.facets.get(next) {
            next += 1;
            for &k in &edges_of[f as usize] {
                let edge = &mesh.edges[k as usize];
                let &[a, b] = edge.facets.as_slice() else {
                    shell.closed = false;
                    continue;
                };
                let g = if a == f { b } else { a };
                shell.smooth &= mesh.turn_deg(edge, f, g) < super::SMOOTH_DEG;
                if turned[g as usize].is_none() {
                    let alike = runs_forward(mesh, edge.ends, f) != runs_forward(mesh, edge.ends, g);
                    turned[g as usize] = Some(own == alike);
                    shell.facets.push((g, own == alike));
                }
            }
        }
        // What most of it says comes first: turned is less than half.
        shells.push(shell);
    }
    shells
}

/// Whether a facet runs from the first to the second end of an edge.
fn runs_forward(mesh: &Mesh, [a, b]: [u32; 2], facet: u32) -> bool {
    let [p, q, r] = mesh.facets[facet as usize];
    [[p, q], [q, r], [r, p]].contains(&[a, b])
}
