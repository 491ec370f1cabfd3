//! The two faces of a mesh that make an inside corner along a line.

use super::super::facet::Facet;
use super::super::scene::Scene;
use nalgebra::{Point3, Vector3};

/// A facet belongs to a line that its plane comes so near, mm: lists of welds are rounded, bodies that touch leave gaps.
const NEAR_MM: f64 = 0.5;
/// How far from the line a face must be there, mm: beyond the strips that some modellers leave at a foot.
const BESIDE_MM: f64 = 1.5;
/// Least cosine between a face and the other one's normal: 3 degrees from going straight on.
const INSIDE: f64 = 0.05;
/// Largest cosine between a face's normal and the line.
const ALONG: f64 = 0.1;

/// Pairs of face normals, out of the material, that make an inside corner with free air between them at `place`, on a
/// line along the unit vector `tangent`.
pub(super) fn corners(scene: &Scene, place: &Point3<f64>, tangent: &Vector3<f64>) -> Vec<[Vector3<f64>; 2]> {
    let reach: Vec<&Facet> = scene.facets_near(place, 2.0 * BESIDE_MM);
    let beside: Vec<(Vector3<f64>, Vector3<f64>)> =
        reach.iter().flat_map(|facet| sides(facet, place, tangent)).collect();
    let mut found: Vec<[Vector3<f64>; 2]> = Vec::new();
    for (k, (normal, away)) in beside.iter().enumerate() {
        for (other, other_away) in &beside[k + 1..] {
            let inside = away.dot(other) > INSIDE && other_away.dot(normal) > INSIDE;
            let known = found.iter().any(|[a, b]| is_same([a, b], [normal, other]));
            if inside && !known && is_air(&reach, place, &(normal + other)) {
                found.push([*normal, *other]);
            }
        }
    }
    found
}

/// Normal of a facet through the line, and the directions in which it leads away from it.
fn sides(facet: &Facet, place: &Point3<f64>, tangent: &Vector3<f64>) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let across = facet.normal - tangent * tangent.dot(&facet.normal);
    let height_mm = facet.normal.dot(&(place - facet.corners[0]));
    let through = facet.normal.dot(tangent).abs() < ALONG && height_mm.abs() < NEAR_MM;
    let Some(normal) = across.try_normalize(1e-6).filter(|_| through) else { return Vec::new() };
    let away = normal.cross(tangent);
    let leads = |away: &Vector3<f64>| facet.distance(&(place + away * BESIDE_MM)) < NEAR_MM;
    [away, -away].into_iter().filter(leads).map(|away| (normal, away)).collect()
}

fn is_same(a: [&Vector3<f64>; 2], b: [&Vector3<f64>; 2]) -> bool {
    const ALIKE: f64 = 0.99;
    let alike = |k: usize, l: usize| a[0].dot(b[k]) > ALIKE && a[1].dot(b[l]) > ALIKE;
    alike(0, 1) || alike(1, 0)
}

/// Whether nothing is in the way between the faces.
fn is_air(reach: &[&Facet], place: &Point3<f64>, bisector: &Vector3<f64>) -> bool {
    let Some(out) = bisector.try_normalize(1e-6) else { return false };
    // Half of the least opening between faces at this distance.
    let clear_mm = 0.25 * bisector.norm() * BESIDE_MM;
    reach.iter().all(|facet| facet.distance(&(place + out * BESIDE_MM)) > clear_mm.min(0.3))
}
