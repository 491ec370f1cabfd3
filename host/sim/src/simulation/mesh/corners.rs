//! Inside corners of a mesh: along edges of facets, where another facet makes an inside corner with one of them.

use super::super::scene::Scene;
use super::super::workpiece::{TrueSeam, TrueStation};
use super::faces;
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// Distance of stations, mm.
const STEP_MM: f64 = 1.0;
/// Corners shorter than this are not welds, mm.
const SHORTEST_MM: f64 = 6.0;
/// Runs go on into each other where their ends are so near and turn less than this, in cosine (31 degrees: a tube of
/// twelve strips).
const JOIN_MM: f64 = 1.5;
const SMOOTH: f64 = 0.857;
/// Vertices nearer than this are one, as are stations half a step apart, mm.
const SAME_MM: f64 = 1e-3;

/// The inside corners of the mesh as seams.
pub(super) fn seams(triangles: &[[Point3<f64>; 3]], part: &Scene) -> Vec<TrueSeam> {
    let mut taken = Taken::default();
    let runs = edges(triangles).into_iter().flat_map(|ends| runs(ends, part, &mut taken)).collect();
    let length_mm = |run: &[TrueStation]| run.len() as f64 * STEP_MM;
    let long = joined(runs).into_iter().filter(|run| length_mm(run) >= SHORTEST_MM).enumerate();
    let seam = |(i, stations): (usize, Vec<TrueStation>)| {
        let gap_mm = (stations[0].apex - stations[stations.len() - 1].apex).norm();
        let closed = stations.len() > 8 && gap_mm < 2.0 * JOIN_MM;
        TrueSeam { name: format!("corner {}", i + 1), closed, required: true, stations }
    };
    long.map(seam).collect()
}

fn cell(place: &Point3<f64>, size_mm: f64) -> [i64; 3] {
    place.coords.map(|c| (c / size_mm).round() as i64).into()
}

/// Each edge once, in the order of the file.
fn edges(triangles: &[[Point3<f64>; 3]]) -> Vec<[Point3<f64>; 2]> {
    let mut known = std::collections::HashSet::new();
    let sides = triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
    let is_new = |ends: &[Point3<f64>; 2]| {
        let [a, b] = ends.map(|p| cell(&p, SAME_MM));
        known.insert([a.min(b), a.max(b)])
    };
    sides.filter(is_new).collect()
}

/// Stations that are there already: overlapping edges tell the same corner more than once.
#[derive(Default)]
struct Taken(HashMap<[i64; 3], Vec<TrueStation>>);

impl Taken {
    fn is_new(&self, station: &TrueStation) -> bool {
        let [x, y, z] = cell(&station.apex, STEP_MM);
        let around = |k: i64| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
        let mut near = (0..27).filter_map(|k| self.0.get(&around(k))).flatten();
        !near.any(|other| {
            (other.apex - station.apex).norm() < 0.5 * STEP_MM
                && other.torch().dot(&station.torch()) > SMOOTH
                && other.tangent.dot(&station.tangent).abs() > SMOOTH
        })
    }

    fn add(&mut self, run: &[TrueStation]) {
        for station in run {
            self.0.entry(cell(&station.apex, STEP_MM)).or_default().push(*station);
        }
    }
}

/// The stretches of an edge along which two faces make an inside corner; both sides of an edge may be one.
fn runs(ends: [Point3<f64>; 2], part: &Scene, taken: &mut Taken) -> Vec<Vec<TrueStation>> {
    let along = ends[1] - ends[0];
    let Some(tangent) = along.try_normalize(SAME_MM) else { return Vec::new() };
    let count = (along.norm() / STEP_MM).ceil().max(1.0);
    let mut open: Vec<Vec<TrueStation>> = Vec::new();
    let mut done = Vec::new();
    for k in 0..count as usize {
        let apex = ends[0] + along * ((k as f64 + 0.5) / count);
        let here = faces::corners(part, &apex, &tangent);
        let stations = here.into_iter().map(|faces| TrueStation { apex, root: apex, tangent, faces });
        let mut stations: Vec<TrueStation> = stations.filter(|s| taken.is_new(s)).collect();
        for mut run in std::mem::take(&mut open) {
            let last = run[run.len() - 1];
            match stations.iter().position(|s| s.torch().dot(&last.torch()) > SMOOTH) {
                Some(at) => {
                    run.push(stations.swap_remove(at));
                    open.push(run);
                }
                None => done.push(run),
            }
        }
        open.extend(stations.into_iter().map(|station| vec![station]));
    }
    done.extend(open);
    done.iter().for_each(|run| taken.add(run));
    done
}

/// Runs strung together end to end.
fn joined(mut runs: Vec<Vec<TrueStation>>) -> Vec<Vec<TrueStation>> {
    let mut seams = Vec::new();
    while let Some(mut seam) = runs.pop() {
        for _ in 0..2 {
            while let Some((k, turned)) = next(&seam, &runs) {
                let mut run = runs.swap_remove(k);
                if turned {
                    run.reverse();
                    run.iter_mut().for_each(|station| station.tangent = -station.tangent);
                }
                seam.extend(run);
            }
            seam.reverse();
            seam.iter_mut().for_each(|station| station.tangent = -station.tangent);
        }
        seams.push(seam);
    }
    seams
}

/// The run that goes on from the end of a seam, and whether it has to be turned round.
fn next(seam: &[TrueStation], runs: &[Vec<TrueStation>]) -> Option<(usize, bool)> {
    let last = seam.last()?;
    let goes_on = |station: &TrueStation, tangent: Vector3<f64>| {
        (station.apex - last.apex).norm() < JOIN_MM
            && tangent.dot(&last.tangent) > SMOOTH
            && station.torch().dot(&last.torch()) > SMOOTH
    };
    runs.iter().enumerate().find_map(|(k, run)| {
        let (first, end) = (run.first()?, run.last()?);
        if goes_on(first, first.tangent) {
            Some((k, false))
        } else {
            goes_on(end, -end.tangent).then_some((k, true))
        }
    })
}
