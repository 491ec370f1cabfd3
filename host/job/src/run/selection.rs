//! Which of the seams that were found are welded: by id, by the nearest place, by a box. Applied after the plan, so
//! that ids and what is found do not depend on it.

use nalgebra::Point3;

use crate::run::job::quantity::WithinMm;
use crate::run::job::{SeamSettings, Selection};
use weldpath_method::weld::SeamPath;

/// Why nothing is selected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// An id that no seam has.
    #[error("there is no seam {id}; the seams are {}", list(known))]
    UnknownId {
        /// What was asked for.
        id: usize,
        /// What there is.
        known: Vec<usize>,
    },
    /// No seam is anywhere near the place.
    #[error(
        "the seam nearest to {place} is seam {nearest}, {away_mm} mm away: that is another place, or another frame"
    )]
    NothingNear {
        /// The place, mm.
        place: String,
        /// The nearest of the seams.
        nearest: usize,
        /// How far it is, whole mm.
        away_mm: u64,
    },
    /// Every seam that is chosen is switched off by a `[[seam]]` of its own.
    #[error("weld = false switches every seam off: none is left to weld")]
    NoneLeft,
    /// No seam is left.
    #[error("no seam has half of its points in the region of interest; seam {nearest} comes nearest to it")]
    OutsideRegion {
        /// The seam with the largest share in it, or the first.
        nearest: usize,
    },
}

fn list(ids: &[usize]) -> String {
    ids.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")
}

/// The paths that pass everything in `selection`, in their order.
pub fn select(paths: &[SeamPath], selection: &Selection) -> Result<Vec<SeamPath>, Error> {
    selection.seams.iter().try_for_each(|&id| known(paths, id).map(drop))?;
    let by_id = |path: &&SeamPath| selection.seams.is_empty() || selection.seams.contains(&path.seam);
    let mut chosen: Vec<&SeamPath> = paths.iter().filter(by_id).collect();
    if let Some(region) = &selection.roi_mm {
        let inside = |path: &SeamPath| share(path, |p| region.contains(p));
        let nearest = chosen.iter().copied().max_by(|a, b| inside(a).total_cmp(&inside(b)));
        chosen.retain(|path| inside(path) >= 0.5);
        if let (true, Some(nearest)) = (chosen.is_empty(), nearest) {
            return Err(Error::OutsideRegion { nearest: nearest.seam });
        }
    }
    if let Some(place) = selection.near_mm {
        let near_mm = place.point_mm();
        let nearest = chosen
            .iter()
            .copied()
            .min_by(|a, b| distance_mm(a, &near_mm).total_cmp(&distance_mm(b, &near_mm)));
        if let Some(path) = nearest {
            refuse_far(path, &near_mm, FARTHEST_NEAR_MM)?;
        }
        chosen = nearest.into_iter().collect();
    }
    Ok(chosen.into_iter().cloned().collect())
}

/// A place that is pointed at lies within this of its seam, mm: what a hand, or a click in a picture, misses by.
const FARTHEST_NEAR_MM: f64 = 200.0;

fn refuse_far(path: &SeamPath, place_mm: &Point3<f64>, within_mm: f64) -> Result<(), Error> {
    let away_mm = distance_mm(path, place_mm);
    if away_mm <= within_mm {
        return Ok(());
    }
    let place = format!("({}, {}, {})", place_mm.x, place_mm.y, place_mm.z);
    Err(Error::NothingNear { place, nearest: path.seam, away_mm: away_mm as u64 })
}

/// `id`, if a seam has it.
fn known(paths: &[SeamPath], id: usize) -> Result<usize, Error> {
    let known: Vec<usize> = paths.iter().map(|path| path.seam).collect();
    if known.contains(&id) { Ok(id) } else { Err(Error::UnknownId { id, known }) }
}

/// Id of the seam nearest to a place, mm; none without seams.
///
/// # Errors
/// If that seam is farther away than `within_mm`.
fn nearest(paths: &[SeamPath], place_mm: &Point3<f64>, within_mm: f64) -> Result<Option<usize>, Error> {
    let away = |path: &&SeamPath| distance_mm(path, place_mm);
    let Some(path) = paths.iter().min_by(|a, b| away(a).total_cmp(&away(b))) else { return Ok(None) };
    refuse_far(path, place_mm, within_mm).map(|()| Some(path.seam))
}

/// Id of the seam that a `[[seam]]` of the job names; none without seams.
///
/// # Errors
/// If no seam has its id, or is where it says.
pub fn named(paths: &[SeamPath], own: &SeamSettings) -> Result<Option<usize>, Error> {
    match (own.id, own.near_mm) {
        (Some(id), _) => known(paths, id).map(Some),
        (None, Some(place)) => {
            let within_mm = own.within_mm.map_or(FARTHEST_NEAR_MM, WithinMm::get);
            nearest(paths, &place.point_mm(), within_mm)
        }
        (None, None) => Ok(None),
    }
}

fn share(path: &SeamPath, holds: impl Fn(&Point3<f64>) -> bool) -> f64 {
    let inside = path.points.iter().filter(|point| holds(&point.position_mm)).count();
    inside as f64 / path.points.len().max(1) as f64
}

fn distance_mm(path: &SeamPath, place_mm: &Point3<f64>) -> f64 {
    path.points.iter().map(|p| (p.position_mm - place_mm).norm()).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use weldpath_method::weld::{PathPoint, Process};

    /// Seams 1, 2, 3 along x at y = 0, 100, 200 mm.
    fn paths() -> Vec<SeamPath> {
        let at = |x, y| PathPoint {
            s_mm: x,
            position_mm: Point3::new(x, y, 0.0),
            base_from_torch: UnitQuaternion::identity(),
            process: Process::default(),
        };
        let line = |seam| (0..10).map(|i| at(f64::from(i), 100.0 * (seam as f64 - 1.0))).collect();
        (1..=3).map(|seam| SeamPath { seam, points: line(seam) }).collect()
    }

    fn chosen(selection: Selection) -> Result<Vec<usize>, Error> {
        select(&paths(), &selection).map(|paths| paths.iter().map(|path| path.seam).collect())
    }

    #[test]
    fn all_seams_are_welded_when_nothing_is_said() {
        assert_eq!(chosen(Selection::default()), Ok(vec![1, 2, 3]));
    }

    #[test]
    fn ids_choose_and_an_unknown_one_is_refused_with_the_list() {
        assert_eq!(chosen(Selection { seams: vec![3, 1], ..Default::default() }), Ok(vec![1, 3]));
        let error = chosen(Selection { seams: vec![1, 9], ..Default::default() }).unwrap_err();
        assert_eq!(error.to_string(), "there is no seam 9; the seams are 1, 2, 3");
    }

    #[test]
    fn near_takes_the_one_nearest_seam() {
        let near_mm = "5,140,20".parse().ok();
        assert_eq!(chosen(Selection { near_mm, ..Default::default() }), Ok(vec![2]));
        let seams = vec![1, 3];
        assert_eq!(chosen(Selection { near_mm, seams, ..Default::default() }), Ok(vec![3]));
    }

    #[test]
    fn a_place_far_from_every_seam_is_refused_with_the_distance() {
        let near = |text: &str| Selection { near_mm: text.parse().ok(), ..Default::default() };
        let error = chosen(near("9000,0,0")).unwrap_err().to_string();
        assert!(error.contains("(9000, 0, 0)") && error.contains("seam 1, 8991 mm away"), "{error}");
        assert_eq!(chosen(near("4,0,200")), Ok(vec![1]));
        assert!(chosen(near("4,0,201")).is_err());
        let far = Some("0,500,0".parse().unwrap());
        assert!(named(&paths(), &SeamSettings { near_mm: far, ..Default::default() }).is_err());
    }

    #[test]
    fn settings_of_a_seam_may_say_how_near_it_is() {
        let own = |within_mm: Option<f64>| SeamSettings {
            near_mm: Some("4,104,0".parse().unwrap()),
            within_mm: within_mm.map(|mm| mm.try_into().unwrap()),
            ..Default::default()
        };
        for within_mm in [None, Some(4.5)] {
            assert_eq!(named(&paths(), &own(within_mm)), Ok(Some(2)));
        }
        let error = named(&paths(), &own(Some(3.5))).unwrap_err().to_string();
        assert!(error.contains("nearest to (4, 104, 0) is seam 2, 4 mm away"), "{error}");
    }

    #[test]
    fn a_region_takes_the_seams_that_lie_in_it_by_half() {
        let region = |text: &str| Selection { roi_mm: text.parse().ok(), ..Default::default() };
        assert_eq!(chosen(region("-1,-1,-1..5,101,1")), Ok(vec![1, 2]));
        assert_eq!(chosen(region("-1,99,-1..2,101,1")), Err(Error::OutsideRegion { nearest: 2 }));
    }
}
