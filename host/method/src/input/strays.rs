//! Readings far from all others: a reflection, a hole in the floor, a pixel that a camera invents.
//!
//! Every grid is laid over the box of the points, and its cells grow with that box: one pixel at 30 m would thin the work to
//! nothing. What is dropped is so far off that no part of a weld, nor what it rests on, can be there.

use nalgebra::{Point3, Vector3};

use super::repeated::retain;

/// Points that tell where most are.
const SAMPLE: usize = 4096;
/// Share of them on each end of an axis that says nothing of where most are: more strays than that are no strays.
const END_SHARE: usize = 10;
/// How far a point may be from the box of the middle four fifths, in diagonals of that box. The rest of an even surface is
/// within an eighth of one; a table of which a camera looks at one end, within one.
const FAR_DIAGONALS: f32 = 3.0;

/// Drops the points that are far from all others, and says so; normals, where there are any, go with their points.
pub(super) fn drop_far(points: &mut Vec<Point3<f32>>, normals: &mut Vec<Vector3<f32>>) -> Option<String> {
    let (low, high) = middle(points);
    let diagonal_mm = (high - low).norm();
    if diagonal_mm.is_nan() || diagonal_mm <= 0.0 {
        return None;
    }
    let margin = Vector3::repeat(FAR_DIAGONALS * diagonal_mm);
    let (low, high) = (low - margin, high + margin);
    let near = |p: &Point3<f32>| (0..3).all(|k| (low[k]..=high[k]).contains(&p[k]));
    if points.iter().all(near) {
        return None;
    }
    let keep: Vec<bool> = points.iter().map(near).collect();
    let before = points.len();
    retain(points, &keep);
    if normals.len() == before {
        retain(normals, &keep);
    }
    let (dropped, margin_mm) = (before - points.len(), FAR_DIAGONALS * diagonal_mm);
    Some(format!("dropped {dropped} of {before} points more than {margin_mm:.0} mm from where most are"))
}

/// Corners of the box that holds the middle four fifths of the points on each axis.
fn middle(points: &[Point3<f32>]) -> (Point3<f32>, Point3<f32>) {
    let step = points.len().div_ceil(SAMPLE).max(1);
    let ends = [0, 1, 2].map(|axis| {
        let mut along: Vec<f32> = points.iter().step_by(step).map(|p| p[axis]).collect();
        along.sort_unstable_by(f32::total_cmp);
        let cut = along.len() / END_SHARE;
        let at = |k: usize| along.get(k).copied().unwrap_or(f32::NAN);
        [at(cut), at(along.len().saturating_sub(1 + cut))]
    });
    (Point3::from(ends.map(|[low, _]| low)), Point3::from(ends.map(|[_, high]| high)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_metres_off_goes_and_the_corner_of_the_table_stays() {
        // A table of 400 by 300 mm at half a metre.
        let table = |i: usize| Point3::new((i % 200) as f32 * 2.0, (i / 200) as f32 * 2.0, 500.0);
        let mut points: Vec<_> = (0..30_000).map(table).collect();
        points.push(Point3::new(0.0, 0.0, 1200.0));
        let kept = points.clone();
        for z_mm in [5e3, 1e4, 6e4] {
            points.insert(7_000, Point3::new(-0.4 * z_mm, 0.3 * z_mm, z_mm));
        }
        let mut normals: Vec<Vector3<f32>> = points.iter().map(|p| p.coords).collect();
        let note = drop_far(&mut points, &mut normals).expect("a note");
        assert!(note.starts_with("dropped 3 of 30004 points more than 1"), "{note}");
        assert_eq!(points, kept);
        assert!(points.iter().zip(&normals).all(|(p, n)| p.coords == *n), "normals stay with their points");
        assert_eq!(drop_far(&mut points, &mut normals), None);
    }

    #[test]
    fn a_cloud_without_extent_is_left_alone() {
        assert_eq!(drop_far(&mut Vec::new(), &mut Vec::new()), None);
        let mut one_place = vec![Point3::new(1.0, 2.0, 3.0); 50];
        one_place.push(Point3::new(9e3, 0.0, 0.0));
        assert_eq!(drop_far(&mut one_place, &mut Vec::new()), None);
        assert_eq!(one_place.len(), 51);
    }
}
