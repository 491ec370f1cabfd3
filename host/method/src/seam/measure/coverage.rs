//! How well each seam was seen, and from where to scan again (not in the paper).
//!
//! Along every seam, and beyond its ends, each of the two faces is looked at in bins of 5 mm: how many points lie on it, and
//! how steeply the cameras saw it. Beyond an end a face that is missing may simply not be there: it counts as unseen only if
//! no camera saw through the place where it would be. Millimetres, base frame.

mod other_side;
mod sight;
mod viewpoint;

use std::sync::OnceLock;

use nalgebra::{Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::geometry::polyline::arc_lengths;
use crate::geometry::statistics::median;
use crate::seam::{Seam, Station};
pub use other_side::{OneSided, one_sided};
use serde::{Deserialize, Serialize};
use sight::{Panorama, Visibility};
pub use viewpoint::Viewpoint;

/// Why a stretch should be scanned again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// A face has hardly a point.
    Unseen,
    /// A face was seen, but only at more than 72 degrees from its normal.
    Grazing,
    /// The seam ends where a face was not seen: nobody knows whether it goes on.
    OpenEnd,
}

impl Fault {
    /// Name in `summary.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unseen => "face-unseen",
            Self::Grazing => "grazing",
            Self::OpenEnd => "open-end",
        }
    }
}

/// A stretch of a seam that was seen badly.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// [`Seam::id`].
    pub seam: usize,
    /// Why.
    pub fault: Fault,
    /// Distance along the seam where it begins, mm; negative before the seam's start.
    pub from_mm: f64,
    /// Where it ends; beyond the seam's length after its end.
    pub to_mm: f64,
    /// Normal of the face that was seen badly, out of the material.
    pub face: Vector3<f64>,
    /// From where to scan again.
    pub view: Viewpoint,
}

// All chosen on the simulated scans; lengths in mm.

/// Length of a bin along the seam.
const BIN_MM: f64 = 5.0;
/// The band of a face that counts, from the seam.
const BAND_MM: std::ops::Range<f64> = 1.0..10.0;
/// Farther off a face no point belongs to it.
const HEIGHT_MM: f64 = 1.6;
/// Fewer points on a bin's band are none.
const FEWEST: usize = 6;
/// Cosine of the steepest angle from the normal that shows a face well.
const LEAST_COSINE: f64 = 0.31;
/// Shorter stretches are not told.
const SHORTEST_MM: f64 = 10.0;
/// How far an end is followed.
const BEYOND_MM: f64 = 150.0;
/// One of so many of the usual points is few; and one of so many of the fewest, of one view, shows that it looked.
const FEW_ONE_OF: usize = 4;
const LOOKED_ONE_OF: usize = 2;
/// Where beyond an end the first bin is, in bins: the one at the end itself still has points of the end.
const FIRST_BIN: f64 = 1.5;
/// Distances from the seam at which a camera may have seen through where a face would be, mm.
const THROUGH_MM: [f64; 3] = [3.0, 6.0, 9.0];
/// Good stations within a bad run that do not end it.
const GOOD_WITHIN: usize = 2;

/// Stretches of all seams that were seen badly; none if it is not known where the cameras stood. `grid` indexes the points
/// of `merged`.
pub fn gaps(seams: &[Seam], merged: &Merged, grid: &Grid, cameras_known: bool) -> Vec<Gap> {
    if !cameras_known || seams.is_empty() {
        return Vec::new();
    }
    let scan = Survey { merged, grid, sights: OnceLock::new() };
    seams.par_iter().flat_map_iter(|seam| scan.gaps_of(seam)).collect()
}

/// The raw points, ready to be asked.
struct Survey<'a> {
    merged: &'a Merged,
    grid: &'a Grid,
    /// Made when an end is in doubt.
    sights: OnceLock<Panorama>,
}

/// What is known of a face in one bin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FaceView {
    Well,
    Grazing,
    Not,
}

impl Survey<'_> {
    fn gaps_of(&self, seam: &Seam) -> Vec<Gap> {
        let arcs = arcs_mm(seam);
        let mut gaps = Vec::new();
        let of_face = |face| seam.stations.iter().map(|station| self.counts(station, face)).collect();
        let counts: [Vec<Vec<usize>>; 2] = [0, 1].map(of_face);
        let least = [0, 1].map(|face| least(&counts[face]));
        for face in 0..2 {
            let stations = seam.stations.iter().zip(&counts[face]);
            let seen: Vec<FaceView> =
                stations.map(|(station, count)| self.judged(count, station, face, least[face])).collect();
            for (fault, bad) in [(Fault::Unseen, FaceView::Not), (Fault::Grazing, FaceView::Grazing)] {
                for (first, last) in runs(&seen, bad) {
                    if arcs[last] - arcs[first] >= SHORTEST_MM {
                        let middle = &seam.stations[(first + last) / 2];
                        gaps.push(self.gap(seam.id, fault, [arcs[first], arcs[last]], middle, face));
                    }
                }
            }
            if !seam.closed {
                gaps.extend(self.open_ends(seam, face, least, arcs.last().copied().unwrap_or(0.0)));
            }
        }
        gaps.sort_by(|a, b| a.from_mm.total_cmp(&b.from_mm));
        gaps
    }

    fn gap(&self, seam: usize, fault: Fault, span_mm: [f64; 2], middle: &Station, face: usize) -> Gap {
        let view = viewpoint::best(middle, face, self.grid, self.merged);
        Gap { seam, fault, from_mm: span_mm[0], to_mm: span_mm[1], face: middle.faces[face], view }
    }

    /// Where a seam ends, but one face goes on and nobody saw whether the other does.
    fn open_ends(&self, seam: &Seam, face: usize, least: [usize; 2], length_mm: f64) -> Vec<Gap> {
        let beyond = |end: Ending| {
            let open_mm = self.open_mm(&end, face, least);
            let middle = end.beyond(0.5 * open_mm);
            let span_mm = if end.sense < 0.0 { [-open_mm, 0.0] } else { [length_mm, length_mm + open_mm] };
            (open_mm >= SHORTEST_MM).then(|| self.gap(seam.id, Fault::OpenEnd, span_mm, &middle, face))
        };
        Ending::both(seam).into_iter().flatten().filter_map(beyond).collect()
    }

    /// How far beyond an end the other face goes on while this one is neither seen nor seen through, mm.
    fn open_mm(&self, end: &Ending, face: usize, least: [usize; 2]) -> f64 {
        let mut open_mm = 0.0;
        let mut at_mm = FIRST_BIN * BIN_MM;
        while at_mm <= BEYOND_MM {
            let here = end.beyond(at_mm);
            let goes_on = self.seen(&here, face, least[face]) == FaceView::Not
                && self.seen(&here, 1 - face, least[1 - face]) != FaceView::Not;
            if !goes_on || self.seen_through(&here, face) {
                break;
            }
            open_mm = at_mm;
            at_mm += BIN_MM;
        }
        open_mm
    }

    /// Whether a camera saw what lies behind the place where the face would be.
    fn seen_through(&self, station: &Station, face: usize) -> bool {
        let away = away(station, face);
        THROUGH_MM.into_iter().any(|off_mm| {
            let place = self.local(&(station.position_mm + away * off_mm));
            self.sights.get_or_init(|| Panorama::new(self.merged)).any(&place, Visibility::Through)
        })
    }

    fn local(&self, place_mm: &Point3<f64>) -> Point3<f32> {
        (place_mm - self.merged.origin_mm.coords).cast()
    }

    /// How the cameras saw the band of a face at a station.
    fn seen(&self, station: &Station, face: usize, least: usize) -> FaceView {
        self.judged(&self.counts(station, face), station, face, least)
    }

    /// The same, with the points that each view has there.
    fn judged(&self, count: &[usize], station: &Station, face: usize, least: usize) -> FaceView {
        if count.iter().sum::<usize>() < least {
            return FaceView::Not;
        }
        let (place, normal) = (self.local(&station.position_mm), station.faces[face].cast::<f32>());
        let cosine = |k: usize| f64::from((self.merged.cameras_mm[k] - place).normalize().dot(&normal));
        let seeing = (0..count.len()).filter(|&k| count[k] >= FEWEST / LOOKED_ONE_OF);
        let best = seeing.map(cosine).fold(0.0, f64::max);
        if best < LEAST_COSINE { FaceView::Grazing } else { FaceView::Well }
    }

    /// Points of each view on the band of a face at a station.
    fn counts(&self, station: &Station, face: usize) -> Vec<usize> {
        let (normal, away) = (station.faces[face].cast::<f32>(), away(station, face).cast::<f32>());
        let along = station.tangent.cast::<f32>();
        let place = self.local(&station.position_mm);
        let mut count = vec![0usize; self.merged.cameras_mm.len()];
        let middle = place + away * (0.5 * (BAND_MM.start + BAND_MM.end)) as f32;
        self.grid.within(&middle, (0.5 * (BAND_MM.end - BAND_MM.start)).hypot(BIN_MM) as f32, |slot, _| {
            let offset = self.grid.point(slot) - place;
            let on_face = offset.dot(&normal).abs() < HEIGHT_MM as f32;
            let in_band = BAND_MM.contains(&f64::from(offset.dot(&away)));
            if on_face && in_band && f64::from(offset.dot(&along).abs()) < 0.5 * BIN_MM {
                count[usize::from(self.merged.view[self.grid.index(slot)])] += 1;
            }
        });
        count
    }
}

/// Points that a bin of a face must have: a quarter of what its bins usually have on this seam.
fn least(counts: &[Vec<usize>]) -> usize {
    let mut totals: Vec<usize> = counts.iter().map(|count| count.iter().sum()).collect();
    FEWEST.max(median(&mut totals) / FEW_ONE_OF)
}

/// Across the seam, along a face, away from the seam: where the other face's positive side is.
fn away(station: &Station, face: usize) -> Vector3<f64> {
    let across = station.tangent.cross(&station.faces[face]).normalize();
    if across.dot(&station.faces[1 - face]) >= 0.0 { across } else { -across }
}

/// An end of a seam, and how the seam bends there.
struct Ending {
    station: Station,
    /// 1 at the last station, -1 at the first.
    sense: f64,
    /// Rotation vector per mm beyond the end.
    bend: Vector3<f64>,
}

/// The bend is that of so much of the seam, mm.
const BEND_MM: f64 = 25.0;

impl Ending {
    fn both(seam: &Seam) -> [Option<Self>; 2] {
        let stations = || seam.stations.iter();
        [Self::of(stations(), -1.0), Self::of(stations().rev(), 1.0)]
    }

    /// From the end inward.
    fn of<'a>(mut inward: impl Iterator<Item = &'a Station>, sense: f64) -> Option<Self> {
        let end = *inward.next()?;
        let away_mm = |station: &Station| (station.position_mm - end.position_mm).norm();
        let inner = inward.find(|station| away_mm(station) >= BEND_MM)?;
        let turn = UnitQuaternion::rotation_between(&inner.tangent, &end.tangent)?;
        Some(Self { station: end, sense, bend: turn.scaled_axis() / away_mm(inner) })
    }

    /// Where the seam would be so far beyond the end, bent on as it was.
    fn beyond(&self, by_mm: f64) -> Station {
        let turn = |share: f64| UnitQuaternion::from_scaled_axis(self.bend * (share * by_mm));
        let Station { position_mm, tangent, faces } = self.station;
        let position_mm = position_mm + turn(0.5) * tangent * (self.sense * by_mm);
        Station { position_mm, tangent: turn(1.0) * tangent, faces: faces.map(|n| turn(1.0) * n) }
    }
}

/// Distance along the seam of each station, mm.
fn arcs_mm(seam: &Seam) -> Vec<f64> {
    arc_lengths(&seam.stations, |a, b| (b.position_mm - a.position_mm).norm())
}

/// First and last index of each run of `wanted`; [`GOOD_WITHIN`] good stations within a run do not end it.
fn runs(seen: &[FaceView], wanted: FaceView) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for i in (0..seen.len()).filter(|&i| seen[i] == wanted) {
        match runs.last_mut() {
            Some((_, last)) if i <= *last + GOOD_WITHIN + 1 => *last = i,
            _ => runs.push((i, i)),
        }
    }
    runs
}

impl Gap {
    /// A sentence that names the stretch, what is wrong with it, and from where to scan again.
    pub fn words(&self) -> String {
        let n = self.face;
        let face = format!("the face with normal ({:.2}, {:.2}, {:.2})", n.x, n.y, n.z);
        let (from, to, seam) = (self.from_mm, self.to_mm, self.seam);
        let what = match self.fault {
            Fault::Unseen => format!("seam {seam}, from {from:.0} to {to:.0} mm: {face} was hardly seen"),
            Fault::Grazing => {
                format!("seam {seam}, from {from:.0} to {to:.0} mm: {face} was seen at grazing angles only")
            }
            Fault::OpenEnd if from < 0.0 => format!(
                "seam {seam}, for {:.0} mm before its start: {face} was not seen, so the seam may begin earlier",
                -from
            ),
            Fault::OpenEnd => {
                let beyond = to - from;
                format!(
                    "seam {seam}, for {beyond:.0} mm beyond its end: {face} was not seen, so the seam may go on"
                )
            }
        };
        format!("{what}; add a view with {}", self.view.words())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A base plate (z = 0) and a web (y = 0) along x from -100 to 100 mm, 1 mm apart, as one camera sees them; `keep`
    /// says which points it measured. `behind` adds what it sees of a wall 80 mm behind the web where the web is missing.
    fn merged(keep: impl Fn(&Point3<f32>) -> bool, behind: bool) -> Merged {
        let grid = |place: fn(f32, f32) -> Point3<f32>| {
            (-100..=100).flat_map(move |i| (0..60).map(move |j| place(i as f32, j as f32)))
        };
        let mut points_mm: Vec<Point3<f32>> = grid(|x, y| Point3::new(x, y + 0.5, 0.0)).collect();
        points_mm.extend(grid(|x, z| Point3::new(x, 0.0, z + 0.5)));
        points_mm.retain(keep);
        if behind {
            points_mm.extend(
                (0..200).flat_map(|i| (0..140).map(move |j| Point3::new(i as f32, -80.0, j as f32 - 100.0))),
            );
        }
        let view = vec![0; points_mm.len()];
        Merged { points_mm, view, cameras_mm: vec![Point3::new(0.0, 250.0, 250.0)], ..Merged::default() }
    }

    fn found(seam: Seam, merged: &Merged, cameras_known: bool) -> Vec<Gap> {
        gaps(&[seam], merged, &Grid::new(&merged.points_mm, 5.0), cameras_known)
    }

    pub(super) fn seam(to_mm: i32) -> Seam {
        let station = |x: i32| Station {
            position_mm: Point3::new(f64::from(x), 0.0, 0.0),
            tangent: Vector3::x(),
            faces: [Vector3::z(), Vector3::y()],
        };
        Seam::through((-100..=to_mm).step_by(2).map(station).collect())
    }

    #[test]
    fn a_corner_that_was_seen_all_along_has_no_gap() {
        assert_eq!(found(seam(100), &merged(|_| true, false), true), []);
        let dark = merged(|p| p.y > 0.0, false);
        assert_eq!(
            found(seam(100), &dark, false),
            [],
            "nothing is said if nobody knows where the cameras stood"
        );
    }

    #[test]
    fn a_stretch_of_a_face_without_points_is_named_to_within_a_bin() {
        let holed = merged(|p| p.y > 0.0 || !(-20.0..40.0).contains(&p.x), false);
        let found = found(seam(100), &holed, true);
        let [gap] = found.as_slice() else { panic!("{found:?}") };
        assert_eq!((gap.fault, gap.face), (Fault::Unseen, Vector3::y()));
        assert!((gap.from_mm - 80.0).abs() <= BIN_MM && (gap.to_mm - 140.0).abs() <= BIN_MM, "{gap:?}");
        assert!(
            gap.view.direction.y < -0.5 && gap.view.direction.z < -0.2,
            "it looks onto both faces: {gap:?}"
        );
        assert!(gap.words().starts_with("seam 1, from ") && gap.words().contains("camera near"));
    }

    #[test]
    fn an_end_is_open_only_if_nobody_saw_through_where_the_face_would_be() {
        let short = |p: &Point3<f32>| p.y > 0.0 || p.x < 40.0;
        let open = found(seam(40), &merged(short, false), true);
        let [gap] = open.as_slice() else { panic!("{open:?}") };
        assert_eq!(gap.fault, Fault::OpenEnd);
        assert!((gap.from_mm - 140.0).abs() < 1e-9 && gap.to_mm > 180.0, "{gap:?}");
        assert_eq!(
            found(seam(40), &merged(short, true), true),
            [],
            "the web ends there: the wall behind was seen"
        );
    }

    #[test]
    fn a_face_seen_along_itself_is_grazing() {
        let mut low = merged(|_| true, false);
        low.cameras_mm = vec![Point3::new(0.0, 400.0, 40.0)];
        let found = found(seam(100), &low, true);
        assert!(found.iter().all(|gap| gap.fault == Fault::Grazing && gap.face == Vector3::z()), "{found:?}");
        assert_eq!(found.len(), 1);
    }
}
