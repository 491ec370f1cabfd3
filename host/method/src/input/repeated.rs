//! Points that stand in a file over and over: a sensor's mark of no reading, or a file made to take long.
//!
//! Searches of neighbours cost the square of how many points share one place. Scans repeat some places a few times, where
//! views were merged or a converter rounded; those stay as they are.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

/// A place keeps at most this many of its points.
const MOST_AT_A_PLACE: u32 = 64;
/// Points that are looked at first, and how many of them have to be at one place to look at all: some thousandth of them.
const LOOKED_AT: usize = 4096;
const SUSPECT: usize = 4;

/// Drops what a place has beyond [`MOST_AT_A_PLACE`], and says so; normals, where there are any, go with their points.
pub(super) fn thin(points: &mut Vec<Point3<f32>>, normals: &mut Vec<Vector3<f32>>) -> Option<String> {
    if !suspect(points) {
        return None;
    }
    let mut seen: HashMap<[u32; 3], u32> = HashMap::new();
    let keep: Vec<bool> = points
        .iter()
        .map(|point| {
            let count = seen.entry(place(point)).or_default();
            *count += 1;
            *count <= MOST_AT_A_PLACE
        })
        .collect();
    let before = points.len();
    retain(points, &keep);
    if normals.len() == before {
        retain(normals, &keep);
    }
    let dropped = before - points.len();
    (dropped > 0).then(|| {
        format!(
            "dropped {dropped} of {before} points at places that hold more than {MOST_AT_A_PLACE} of them"
        )
    })
}

/// Keeps the items whose flags say so.
pub(super) fn retain<T>(items: &mut Vec<T>, keep: &[bool]) {
    let mut kept = keep.iter();
    items.retain(|_| kept.next().copied().unwrap_or(true));
}

/// Whether one place holds a good share of the points.
fn suspect(points: &[Point3<f32>]) -> bool {
    let step = points.len().div_ceil(LOOKED_AT).max(1);
    let mut sample: Vec<[u32; 3]> = points.iter().step_by(step).map(place).collect();
    sample.sort_unstable();
    sample
        .chunk_by(|a, b| a == b)
        .any(|same| same.len() >= SUSPECT && same.len() * step > MOST_AT_A_PLACE as usize)
}

fn place(point: &Point3<f32>) -> [u32; 3] {
    [point.x.to_bits(), point.y.to_bits(), point.z.to_bits()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_place_with_most_of_the_points_is_thinned_and_the_others_stay() {
        let other = |i: usize| Point3::new(i as f32, 0.5, 1.0);
        let mut points: Vec<_> =
            (0..10_000).map(|i| if i % 2 == 0 { Point3::new(1.0, 2.0, 3.0) } else { other(i) }).collect();
        let mut normals: Vec<Vector3<f32>> = points.iter().map(|p| p.coords).collect();
        let note = thin(&mut points, &mut normals).unwrap();
        assert!(note.contains("dropped 4936 of 10000"), "{note}");
        assert_eq!(points.len(), 5064);
        assert!(points.iter().zip(&normals).all(|(p, n)| p.coords == *n), "normals stay with their points");
    }

    #[test]
    fn places_that_are_repeated_a_few_times_stay_as_they_are() {
        let mut points: Vec<_> = (0..40_000).map(|i| Point3::new((i / 8) as f32, 0.0, 1.0)).collect();
        let before = points.clone();
        assert_eq!(thin(&mut points, &mut Vec::new()), None);
        assert_eq!(points, before);
        assert_eq!(thin(&mut vec![Point3::origin(); 64], &mut Vec::new()), None);
    }
}
