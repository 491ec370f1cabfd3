//! A list of welds in a part's frame, as the files `weld_vectors.json` of YCJ0815/weld-robot hold them.

use super::super::scene::Scene;
use super::super::workpiece::{TrueSeam, TrueStation};
use super::faces;
use nalgebra::{Point3, Vector3};
use serde::Deserialize;

/// A straight weld.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListedWeld {
    /// Where it begins, mm.
    pub start_mm: Point3<f64>,
    /// Where it ends, mm.
    pub end_mm: Point3<f64>,
    /// Direction of the torch, out of the work; may lean along the travel.
    pub torch: Vector3<f64>,
}

#[derive(Deserialize)]
struct List {
    welds: Vec<Entry>,
}

#[derive(Deserialize)]
struct Entry {
    start: End,
    end: End,
}

#[derive(Deserialize)]
struct End {
    xyz: [f64; 3],
    pose: [f64; 3],
}

impl ListedWeld {
    /// Reads a list: `{"welds": [{"start": {"xyz": [mm], "pose": [torch direction]}, "end": ...}]}`.
    ///
    /// # Errors
    /// Says what is not as it should be, and where.
    pub fn list(bytes: &[u8]) -> Result<Vec<Self>, serde_json::Error> {
        let list: List = serde_json::from_slice(bytes)?;
        let weld = |entry: &Entry| Self {
            start_mm: entry.start.xyz.into(),
            end_mm: entry.end.xyz.into(),
            torch: entry.start.pose.into(),
        };
        Ok(list.welds.iter().map(weld).collect())
    }

    /// The torch without its lean along the travel.
    fn upright(&self) -> Option<Vector3<f64>> {
        let along = (self.end_mm - self.start_mm).try_normalize(1e-9)?;
        (self.torch - along * along.dot(&self.torch)).try_normalize(1e-6)
    }
}

/// Shorter pieces are not welds but the way round the end of a rib, mm.
const SHORTEST_MM: f64 = 6.0;

/// The welds as seams with a station in the middle of every millimetre. Where the mesh has an inside corner, its faces
/// tell the torch: some lists hold it along one face.
pub(super) fn seams(welds: &[ListedWeld], part: &Scene) -> Vec<TrueSeam> {
    let long = |(_, weld): &(usize, &ListedWeld)| (weld.end_mm - weld.start_mm).norm() >= SHORTEST_MM;
    welds.iter().enumerate().filter(long).filter_map(|(i, weld)| seam(i, weld, part)).collect()
}

fn seam(i: usize, weld: &ListedWeld, part: &Scene) -> Option<TrueSeam> {
    let along = weld.end_mm - weld.start_mm;
    let (tangent, listed) = (along.try_normalize(1e-9)?, weld.upright()?);
    // Without faces beside it the torch stands for both.
    let mut faces = [listed; 2];
    let count = along.norm().floor();
    let place = |k: usize| weld.start_mm + along * ((k as f64 + 0.5) / count);
    let bisected = |k: usize| {
        let nearest = |[a, b]: &[Vector3<f64>; 2]| (a + b).normalize().dot(&listed);
        let found = faces::corners(part, &place(k), &tangent);
        found.into_iter().max_by(|a, b| nearest(a).total_cmp(&nearest(b)))
    };
    // From the middle outwards: at its ends a weld runs into other faces.
    let middle = count as usize / 2;
    if let Some(found) = (0..=middle)
        .flat_map(|d| [middle - d, middle + d])
        .find_map(|k| (k < count as usize).then(|| bisected(k)).flatten())
    {
        faces = found;
    }
    let station = |k: usize| TrueStation { apex: place(k), root: place(k), tangent, faces };
    let stations = (0..count as usize).map(station).collect();
    Some(TrueSeam { name: format!("weld {}", i + 1), closed: false, required: true, stations })
}
