//! How far the work reaches, so that a picture can show the whole of it: what stands out of a table about the seams.

use nalgebra::{Point3, Vector3};
use weldpath_method::geometry::statistics::percentile;
use weldpath_method::pipeline::Plan;

/// Points of the model that are looked at.
const SAMPLED: usize = 20_000;
/// What lies in the lowest part of the heights, this share of them, is a table.
const LYING: f64 = 0.06;
/// The work reaches this many times as far as its seams from their middle, at most.
const ABOUT: f64 = 1.7;
/// Percentiles of the points along an axis between which there are no strays.
const WITHOUT_STRAYS: [f64; 2] = [0.5, 99.5];
/// Directions whose outermost places stand for all of them.
const DIRECTIONS: u32 = 160;

/// The outermost places of the work, mm, base frame: of its seams, from the lowest to the greatest of `heights_mm` along `up` over
/// `centre_mm`, and of the model about them. Of a run without seams, a ball of `radius_mm`.
pub(super) fn outline(
    plan: &Plan,
    centre_mm: Point3<f64>,
    radius_mm: f64,
    up: Vector3<f64>,
    heights_mm: [f64; 2],
) -> Vec<Point3<f64>> {
    let [low, high] = heights_mm;
    let upright = |v: Vector3<f64>| heights_mm.map(|height| v + up * (height - v.dot(&up)));
    let stations = plan.seams.iter().flat_map(|seam| &seam.stations);
    let seams: Vec<Vector3<f64>> = stations.flat_map(|s| upright(s.position_mm - centre_mm)).collect();
    if seams.is_empty() {
        return directions().map(|toward| centre_mm + toward * radius_mm).collect();
    }
    let reach_mm = seams.iter().map(Vector3::norm).fold(0.0, f64::max);
    let stands = |v: &Vector3<f64>| v.dot(&up) > low + LYING * (high - low) && v.norm() < ABOUT * reach_mm;
    let every = plan.model.len().div_ceil(SAMPLED).max(1);
    let model = (0..plan.model.len()).step_by(every).map(|k| plan.model.in_base_mm(k) - centre_mm);
    let near: Vec<Vector3<f64>> = model.filter(stands).collect();
    let bounds = [0, 1, 2].map(|axis| {
        let along: Vec<f64> = near.iter().map(|v| v[axis]).collect();
        WITHOUT_STRAYS.map(|percent| percentile(&along, percent).unwrap_or_default())
    });
    let is_kept =
        |v: &&Vector3<f64>| bounds.iter().zip(v.iter()).all(|([least, most], v)| (least..=most).contains(&v));
    let all: Vec<Vector3<f64>> = seams.iter().chain(near.iter().filter(is_kept)).copied().collect();
    let outermost = directions()
        .filter_map(|toward| all.iter().max_by(|a, b| toward.dot(a).total_cmp(&toward.dot(b))).copied());
    outermost.map(|v| centre_mm + v).collect()
}

/// Unit vectors spread evenly (a Fibonacci lattice).
fn directions() -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..DIRECTIONS).map(move |k| {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(DIRECTIONS);
        let (sin, cos) = (golden * f64::from(k)).sin_cos();
        let aside = (1.0 - z * z).sqrt();
        Vector3::new(aside * cos, aside * sin, z)
    })
}
