//! Root opening of a seam (ours): how far apart the two faces begin.
//!
//! Near the root the points of each face are counted by their distance from the line in which the faces meet. Where a
//! face begins, its density rises from nothing to that of the face; half way up is the edge, to a fraction of the
//! spacing. Faces that touch begin within a spacing of the line, so an opening below that cannot be told from none.

use nalgebra::{Point3, Vector3};

use crate::cloud::PointCloud;
use crate::grid::Grid;
use crate::seam::{Seam, Station};

/// Faces are looked at this far from the line, mm.
const REACH_MM: f64 = 8.0;
/// From here on a face has its full density, mm.
const FULL_FROM_MM: f64 = 4.0;
/// Steps of the count, mm.
const BIN_MM: f64 = 0.1;
/// Half width of the window that smooths it, bins.
const WINDOW: usize = 4;
/// Fewer points in the window of a full face tell nothing.
const LEAST_POINTS: f64 = 20.0;

/// Width of the opening between the faces of a seam, mm, if they begin farther apart than `resolution_mm`, the spacing
/// of the model. None where they meet, or where too little of them is seen.
pub fn root_opening_mm(seam: &Seam, model: &PointCloud, resolution_mm: f64) -> Option<f64> {
    let stations: Vec<Point3<f32>> =
        seam.stations.iter().map(|s| Point3::from((s.position_mm - model.origin_mm).cast())).collect();
    let grid = Grid::new(&stations, REACH_MM as f32);
    let mut counts = [vec![0.0; (REACH_MM / BIN_MM) as usize], vec![0.0; (REACH_MM / BIN_MM) as usize]];
    for (k, p) in model.points_mm.iter().enumerate() {
        let Some((slot, _)) = grid.nearest(p, REACH_MM as f32, |_| true) else { continue };
        if let Some((face, u_mm)) =
            beside(&model.in_base_mm(k), &seam.stations[grid.index(slot)], resolution_mm)
        {
            let bin = (u_mm / BIN_MM) as usize;
            counts[face].get_mut(bin).into_iter().for_each(|count| *count += 1.0);
        }
    }
    let [a, b] = [begin_mm(&counts[0])?, begin_mm(&counts[1])?];
    let cosine = mean_cosine(&seam.stations);
    let opening_mm = (a * a + b * b - 2.0 * a * b * cosine).max(0.0).sqrt();
    (a.max(b) > resolution_mm).then_some(opening_mm)
}

/// Unit vectors from the line into each face.
fn into_faces(station: &Station) -> Option<[Vector3<f64>; 2]> {
    let into = |k: usize| {
        let along = station.tangent.cross(&station.faces[k]).try_normalize(1e-6)?;
        Some(if along.dot(&station.faces[1 - k]) < 0.0 { -along } else { along })
    };
    Some([into(0)?, into(1)?])
}

/// The face on which a point lies, and its distance from the line along that face, mm.
fn beside(p: &Point3<f64>, station: &Station, resolution_mm: f64) -> Option<(usize, f64)> {
    let offset_mm = p - station.position_mm;
    let into = into_faces(station)?;
    let height_mm = [0, 1].map(|k| offset_mm.dot(&station.faces[k]).abs());
    let face = usize::from(height_mm[1] < height_mm[0]);
    let u_mm = offset_mm.dot(&into[face]);
    (height_mm[face] < 0.6 * resolution_mm && u_mm >= 0.0).then_some((face, u_mm))
}

/// Where the count rises to half of what it is on the full face, mm.
fn begin_mm(counts: &[f64]) -> Option<f64> {
    let smooth: Vec<f64> = (0..counts.len())
        .map(|k| {
            let near = &counts[k.saturating_sub(WINDOW)..(k + WINDOW + 1).min(counts.len())];
            near.iter().sum::<f64>() / near.len() as f64
        })
        .collect();
    let from = (FULL_FROM_MM / BIN_MM) as usize;
    let mut full = smooth.get(from..)?.to_vec();
    full.sort_by(f64::total_cmp);
    let half = 0.5 * full.get(full.len() / 2)?;
    if 2.0 * half * (2 * WINDOW + 1) as f64 <= LEAST_POINTS {
        return None;
    }
    let begin = smooth[..from].iter().rposition(|count| *count < half).map_or(0, |k| k + 1);
    Some(begin as f64 * BIN_MM)
}

fn mean_cosine(stations: &[Station]) -> f64 {
    let cosines = stations.iter().filter_map(into_faces).map(|[a, b]| a.dot(&b));
    cosines.sum::<f64>() / stations.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seam::Joint;

    /// A V groove of 60 degrees along x, 200 mm, bevels seen from `gap_mm` apart upward, points every 0.8 mm or so.
    fn groove(gap_mm: f64) -> (Seam, PointCloud) {
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let faces = [Vector3::new(0.0, -cos, sin), Vector3::new(0.0, cos, sin)];
        let station = |k: i32| Station {
            position_mm: Point3::new(f64::from(k), 0.0, 0.0),
            tangent: Vector3::x(),
            faces,
        };
        let seam = Seam {
            id: 1,
            joint: Joint::ButtV,
            reason: String::new(),
            stations: (0..=200).map(station).collect(),
            closed: false,
            confidence: 1.0,
            expected_error_mm: 0.0,
            expected_error_deg: 0.0,
            warnings: vec![],
        };
        let mut model = PointCloud::default();
        for k in 0..20_000 {
            // The golden ratio spreads points evenly without a grid.
            let (x, u) = (f64::from(k) * 0.01, (f64::from(k) * 0.618_033_988_75).fract() * 12.0);
            let side = if k % 2 == 0 { 1.0 } else { -1.0 };
            let p = Point3::new(x, side * u * sin, u * cos);
            if p.y.abs() >= 0.5 * gap_mm {
                model.points_mm.push(p.cast());
                model.normals.push(Vector3::z());
            }
        }
        (seam, model)
    }

    #[test]
    fn an_open_root_is_measured_to_a_fraction_of_the_spacing() {
        for gap_mm in [1.5, 2.0, 3.0] {
            let (seam, model) = groove(gap_mm);
            let opening_mm = root_opening_mm(&seam, &model, 0.8).unwrap();
            assert!((opening_mm - gap_mm).abs() < 0.25, "{opening_mm} mm for {gap_mm} mm");
        }
    }

    #[test]
    fn a_closed_root_and_an_empty_model_have_no_opening() {
        let (seam, model) = groove(0.0);
        assert_eq!(root_opening_mm(&seam, &model, 0.8), None);
        assert_eq!(root_opening_mm(&seam, &PointCloud::default(), 0.8), None);
    }
}
