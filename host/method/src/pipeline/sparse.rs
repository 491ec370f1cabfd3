//! Whether the points lie too far apart for the faces beside a seam.

use nalgebra::Point3;

use crate::geometry::grid::Grid;

/// Rows of points that a face beside a seam has to show: of clean right-angled corners with points 2, 4 and 6 mm apart all
/// were found where both faces had five rows or more, and half of those with three or four.
const ROWS: f32 = 5.0;
/// A face as narrow as this beside a weld is common, mm: the leg of an angle, the edge of a rib.
const NARROW_MM: f32 = 10.0;
/// Points that are asked for their neighbours.
const ASKED: usize = 1000;

/// What to say of points that are so far apart that common faces do not show; none where they are near enough.
pub(super) fn words(work: &Grid) -> Option<String> {
    let spacing_mm = spacing_mm(work)?;
    (ROWS * spacing_mm > NARROW_MM).then(|| {
        format!(
            "the points are {spacing_mm:.1} mm apart, and a face beside a seam needs {ROWS:.0} rows of them: \
             a face narrower than {:.0} mm is not found, a wider one only where the points are evenly \
             spaced; for faces of {NARROW_MM:.0} mm scan with points at most {:.0} mm apart",
            ROWS * spacing_mm,
            NARROW_MM / ROWS
        )
    })
}

/// Median distance to the fourth nearest point, mm: that of the rows of a grid, and 1.08 times as much where as many points
/// are strewn at random.
fn spacing_mm(points: &Grid) -> Option<f32> {
    const FOURTH: usize = 3;
    let step = points.len().div_ceil(ASKED).max(1);
    let mut found: Vec<f32> = Vec::new();
    for slot in (0..points.len()).step_by(step) {
        let at = points.point(slot);
        found.extend(fourth_mm(points, slot, &at, FOURTH));
    }
    found.sort_unstable_by(f32::total_cmp);
    found.get(found.len() / 2).copied()
}

fn fourth_mm(points: &Grid, slot: usize, at: &Point3<f32>, fourth: usize) -> Option<f32> {
    /// As far as cells are worth walking.
    const DOUBLINGS: usize = 6;
    let mut near: Vec<f32> = Vec::new();
    let mut radius_mm = points.cell_mm();
    for _ in 0..DOUBLINGS {
        near.clear();
        points.within(at, radius_mm, |other, squared| {
            if other != slot {
                near.push(squared);
            }
        });
        if near.len() > fourth {
            let (_, squared, _) = near.select_nth_unstable_by(fourth, f32::total_cmp);
            return Some(squared.sqrt());
        }
        radius_mm *= 2.0;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(step_mm: f32) -> Grid {
        let points: Vec<_> = (0..3600)
            .map(|i| Point3::new((i % 60) as f32 * step_mm, (i / 60) as f32 * step_mm, 0.0))
            .collect();
        Grid::new(&points, 3.0)
    }

    #[test]
    fn rows_six_millimetres_apart_are_named_and_rows_of_one_are_not() {
        let said = words(&sheet(6.0)).expect("far apart");
        assert!(said.contains("6.0 mm apart") && said.contains("narrower than 30 mm"), "{said}");
        assert!(said.contains("at most 2 mm apart"), "{said}");
        assert_eq!(words(&sheet(1.0)), None);
        assert_eq!(words(&Grid::new(&[Point3::origin()], 3.0)), None);
    }
}
