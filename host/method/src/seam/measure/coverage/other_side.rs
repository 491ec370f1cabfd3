//! T joints of which one side was seen: whether a second seam is behind the upright plate, no view tells.
//!
//! In cross-sections of a seam between two faces, either may be the front of an upright plate. It is one if what stands there does
//! not reach far back, and the other face goes on behind it; where nothing is seen behind it, it is one if it stands on a face that
//! lies level. It was seen from one side if next to its foot behind there is neither a point of its back nor one of the other face.
//! Millimetres along three axes: behind the front, up it, along the seam.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{FEWEST, HEIGHT_MM, Viewpoint, away, viewpoint};
use crate::geometry::cloud::Merged;
use crate::geometry::grid::Grid;
use crate::seam::{Joint, Seam, Station};

/// A seam at an upright plate whose other side no view saw.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OneSided {
    /// [`Seam::id`].
    pub seam: usize,
    /// Normal of the plate's unseen side, out of the material.
    pub face: Vector3<f64>,
    /// From where that side and the foot before it would be seen.
    pub view: Viewpoint,
}

// All chosen on the simulated scans; lengths in mm.

/// Cross-sections of a seam that are looked at.
const SECTIONS: usize = 12;
/// What reaches back farther is no plate.
const THICKEST_MM: f32 = 40.0;
/// The thickness of a plate whose top was not seen.
const USUAL_MM: f32 = 10.0;
/// Half the length along the seam that a cross-section stands for.
const HALF_MM: f32 = 4.0;
/// Where the other face is sought behind the plate, and how far apart.
const BEHIND_MM: std::ops::RangeInclusive<f32> = 8.0..=160.0;
const STEP_MM: f32 = 8.0;
/// Heights of the back next to its foot, and the width of the other face before it.
const FOOT_MM: std::ops::Range<f32> = 3.0..15.0;
const BEFORE_MM: f32 = 10.0;
/// Top points with more between them are of two things.
const APART_MM: f32 = 6.0;
/// No plate is followed higher.
const HIGHEST_MM: f32 = 300.0;
/// A back that was seen has one point for so many of the front, over the same heights.
const BACK_ONE_OF: usize = 6;
/// Cosine from which on directions are alike, and how far a second seam may be beside a cross-section.
const ALIKE: f64 = 0.8;
const LEVEL: f64 = 0.7;
/// Of so many points about a place on a plane, so many lie on it.
const FLAT: [usize; 2] = [10, 7];
/// So near to an end of a seam another one goes on round a corner.
const CORNER_MM: f64 = 15.0;
const BESIDE_MM: f64 = 6.0;

/// The seams of whose T only one side was seen; none if it is not known where the cameras stood.
pub fn one_sided(seams: &[Seam], merged: &Merged, grid: &Grid, cameras_known: bool) -> Vec<OneSided> {
    let of_plates = |joint| matches!(joint, Joint::Fillet | Joint::Branch);
    let is_asked = |seam: &&Seam| of_plates(seam.joint) && seam.contact.is_none() && !seam.drawn;
    let asked = seams.iter().filter(|seam| cameras_known && is_asked(seam));
    asked.filter_map(|seam| (0..2).find_map(|web| of_seam(seam, web, seams, merged, grid))).collect()
}

/// The same of one seam, if its face `web` is the front of a plate.
fn of_seam(seam: &Seam, web: usize, seams: &[Seam], merged: &Merged, grid: &Grid) -> Option<OneSided> {
    let step = (seam.stations.len() / SECTIONS).max(1);
    let sections: Vec<Section> =
        seam.stations.iter().step_by(step).map(|station| Section::of(station, web, merged, grid)).collect();
    let most = |count: usize| 2 * count > sections.len();
    let hidden: Vec<&Section> = sections.iter().filter(|section| section.hides_its_foot()).collect();
    let is_upright = || {
        let behind = sections.iter().filter(|section| section.other_goes_on()).count();
        behind > 1 || behind == 0 && most(sections.iter().filter(|section| section.stands_level()).count())
    };
    if !most(hidden.len()) || !is_flat(&sections) || goes_round(seam, web, seams) || !is_upright() {
        return None;
    }
    let alone = hidden.iter().filter(|section| !seams.iter().any(|other| section.has_behind(other))).count();
    let middle = hidden[hidden.len() / 2];
    let back = middle.back();
    let view = || viewpoint::best(&back, web, grid, merged);
    most(alone).then(|| OneSided { seam: seam.id, face: back.faces[web], view: view() })
}

/// Whether the plate keeps its direction, as the wall of a pipe does not.
fn is_flat(sections: &[Section]) -> bool {
    let normals = || sections.iter().map(|section| section.station.faces[section.web]);
    normals().all(|normal| normals().all(|other| normal.dot(&other) > ALIKE))
}

/// Whether the plate goes on round an outside corner at an end of its seam, as the wall of a box does.
fn goes_round(seam: &Seam, web: usize, seams: &[Seam]) -> bool {
    let ends = [(seam.stations.first(), -1.0), (seam.stations.last(), 1.0)];
    let is_wall = |other: &&Seam| other.id != seam.id && other.length_mm() > f64::from(THICKEST_MM);
    ends.into_iter().filter_map(|(end, sense)| Some((end?, sense))).any(|(end, sense)| {
        let turns = |station: &Station| {
            (station.position_mm - end.position_mm).norm() < CORNER_MM
                && station.faces.iter().any(|face| {
                    face.dot(&(end.tangent * sense)) > ALIKE && face.dot(&end.faces[web]).abs() < 1.0 - ALIKE
                })
        };
        seams.iter().filter(is_wall).any(|other| other.stations.iter().any(turns))
    })
}

/// A cross-section of a seam, with the face `web` taken for the front of an upright plate.
struct Section<'a> {
    station: &'a Station,
    web: usize,
    /// Unit, behind the front, up it, and along the seam.
    axes: [Vector3<f32>; 3],
    place: Point3<f32>,
    grid: &'a Grid,
    /// How far back what stands there reaches; none if its top was not seen.
    thickness_mm: Option<f32>,
}

impl<'a> Section<'a> {
    fn of(station: &'a Station, web: usize, merged: &Merged, grid: &'a Grid) -> Self {
        let (behind, up) = (-away(station, 1 - web), away(station, web));
        let axes = [behind, up, station.tangent].map(|axis| axis.cast());
        let place = (station.position_mm - merged.origin_mm.coords).cast();
        let section = Self { station, web, axes, place, grid, thickness_mm: None };
        Self { thickness_mm: section.top_mm(), ..section }
    }

    fn at(&self, behind_mm: f32, up_mm: f32) -> Point3<f32> {
        self.place + self.axes[0] * behind_mm + self.axes[1] * up_mm
    }

    /// Points about a place, by how far behind the front and up they are.
    fn about(&self, place: Point3<f32>, radius_mm: f32, mut visit: impl FnMut(f32, f32)) {
        self.grid.within(&place, radius_mm, |slot, _| {
            let offset = self.grid.point(slot) - self.place;
            let [behind, up, along] = self.axes.map(|axis| axis.dot(&offset));
            if along.abs() < HALF_MM {
                visit(behind, up);
            }
        });
    }

    fn is_near(&self, behind_mm: f32, up_mm: f32) -> bool {
        let mut count = 0;
        self.about(self.at(behind_mm, up_mm), HALF_MM, |_, up| {
            count += usize::from((up - up_mm).abs() < HEIGHT_MM as f32);
        });
        count >= FEWEST
    }

    /// How far back the top reaches that begins at the front's upper end.
    fn top_mm(&self) -> Option<f32> {
        let mut end_mm = FOOT_MM.start;
        while end_mm < HIGHEST_MM && self.is_near(0.0, end_mm + HALF_MM) {
            end_mm += HALF_MM;
        }
        let mut tops = Vec::new();
        self.about(self.at(0.5 * THICKEST_MM, end_mm), 0.5 * THICKEST_MM + HALF_MM, |behind, up| {
            if behind > HEIGHT_MM as f32 && (up - end_mm).abs() < 2.0 * HALF_MM {
                tops.push(behind);
            }
        });
        tops.sort_by(f32::total_cmp);
        let mut reach_mm = 0.0;
        for &top_mm in &tops {
            if top_mm - reach_mm > APART_MM {
                break;
            }
            reach_mm = top_mm;
        }
        (tops.len() >= FEWEST && reach_mm > 0.0).then_some(reach_mm)
    }

    /// Whether it is a plate, next to whose foot behind there is neither a point of its back nor one of the other face.
    fn hides_its_foot(&self) -> bool {
        let thickness_mm = self.thickness_mm.unwrap_or(USUAL_MM);
        if thickness_mm > THICKEST_MM - HALF_MM {
            return false;
        }
        let (mut front, mut back, mut other) = (0, 0, 0);
        let last_mm = thickness_mm + BEFORE_MM;
        self.about(self.at(0.5 * last_mm, 0.0), last_mm.max(FOOT_MM.end) + HALF_MM, |behind, up| {
            let (high, within) = (FOOT_MM.contains(&up), (HEIGHT_MM as f32..last_mm).contains(&behind));
            front += usize::from(high && behind.abs() < HEIGHT_MM as f32);
            back += usize::from(high && within);
            other += usize::from(within && up.abs() < HEIGHT_MM as f32);
        });
        let few = FEWEST.max(front / BACK_ONE_OF);
        front >= FEWEST && back < few && other < few
    }

    /// Whether the other face goes on behind the plate.
    fn other_goes_on(&self) -> bool {
        let steps = ((BEHIND_MM.end() - BEHIND_MM.start()) / STEP_MM) as usize;
        let is_on = |behind_mm: f32| {
            let (mut on, mut all) = (0, 0);
            self.about(self.at(behind_mm, 0.0), HALF_MM, |_, up| {
                on += usize::from(up.abs() < HEIGHT_MM as f32);
                all += 1;
            });
            on >= FEWEST && FLAT[0] * on > FLAT[1] * all
        };
        (0..=steps).any(|k| is_on(BEHIND_MM.start() + STEP_MM * k as f32))
    }

    /// Whether what stands there is thin, and stands on a face that lies level, z up.
    fn stands_level(&self) -> bool {
        let [front, other] = [self.web, 1 - self.web].map(|face| self.station.faces[face].z);
        self.thickness_mm.is_some() && other > LEVEL && front.abs() < LEVEL
    }

    /// Whether a seam is at the foot behind.
    fn has_behind(&self, other: &Seam) -> bool {
        let front = self.station.faces[self.web];
        let is_foot = |station: &Station| {
            let offset = station.position_mm - self.station.position_mm;
            let [behind, up, along] = self.axes.map(|axis| axis.cast::<f64>().dot(&offset));
            (1.0..f64::from(THICKEST_MM)).contains(&behind)
                && up.abs() < BESIDE_MM
                && along.abs() < BESIDE_MM
                && station.faces.iter().any(|face| face.dot(&front) < -ALIKE)
        };
        other.stations.iter().any(is_foot)
    }

    /// The foot behind, as a seam would have it.
    fn back(&self) -> Station {
        let behind_mm = f64::from(self.thickness_mm.unwrap_or(USUAL_MM));
        let mut back = *self.station;
        back.position_mm += self.axes[0].cast::<f64>() * behind_mm;
        back.faces[self.web] = -back.faces[self.web];
        back
    }
}

impl OneSided {
    /// A sentence that says so, and from where to look.
    pub fn words(&self) -> String {
        format!(
            "one side seen: no view shows the other side of the upright plate, where a second seam may be; add one from behind it, with {}",
            self.view.words()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::seam;
    use super::*;

    /// Points 1 mm apart on a part of a plane, along x from -100 to 100 mm.
    fn strip(from: i32, to: i32, place: impl Fn(f32) -> [f32; 2]) -> Vec<Point3<f32>> {
        let row = |x: i32| (from..to).map(move |k| (x, k as f32 + 0.5));
        let at = |(x, across): (i32, f32)| {
            let [y, z] = place(across);
            Point3::new(x as f32, y, z)
        };
        (-100..=100).flat_map(row).map(at).collect()
    }

    /// A base plate (z = 0) and a web from y = 0 back to -`thick_mm`, 40 mm high; of the plate behind, what lies farther back than
    /// this; and whether the web's back was seen.
    fn t_joint(thick_mm: i32, plate_from_mm: i32, back: bool) -> Merged {
        let base = strip(0, 60, |across| [across, 0.0]);
        let behind = strip(plate_from_mm, 120, |across| [-across, 0.0]);
        let front = strip(0, 40, |up| [0.0, up]);
        let top = strip(0, thick_mm, |across| [-across, 40.0]);
        let back = if back { strip(0, 40, |up| [-thick_mm as f32, up]) } else { Vec::new() };
        let points_mm = [base, behind, front, top, back].concat();
        let view = vec![0; points_mm.len()];
        Merged { points_mm, view, cameras_mm: vec![Point3::new(0.0, 250.0, 250.0)], ..Merged::default() }
    }

    fn said(seams: &[Seam], merged: &Merged) -> Vec<OneSided> {
        one_sided(seams, merged, &Grid::new(&merged.points_mm, 5.0), true)
    }

    /// The seam at the web's front, and the one at its back.
    fn both(thick_mm: f64) -> [Seam; 2] {
        let mut back = Seam { id: 2, ..seam(100) };
        for station in &mut back.stations {
            station.position_mm.y = -thick_mm;
            station.faces[1] = -Vector3::y();
        }
        [seam(100), back]
    }

    #[test]
    fn a_plate_whose_foot_behind_is_in_its_shadow_is_named_with_a_view_from_behind() {
        for plate_from_mm in [50, 120] {
            let found = said(&[seam(100)], &t_joint(8, plate_from_mm, false));
            let [one] = found.as_slice() else { panic!("{found:?}") };
            assert_eq!((one.seam, one.face), (1, -Vector3::y()));
            assert!(one.view.position_mm.y < -50.0 && one.view.position_mm.z > 50.0, "{one:?}");
            assert!(one.view.direction.y > 0.3 && one.view.direction.z < -0.3, "{one:?}");
            assert!(one.words().starts_with("one side seen: ") && one.words().contains("camera near"));
        }
    }

    #[test]
    fn nothing_is_said_of_what_was_seen_behind_or_is_no_plate() {
        let of_one = |merged: &Merged| said(&[seam(100)], merged);
        assert_eq!(of_one(&t_joint(8, 8, false)), [], "the other face is seen from the foot on");
        assert_eq!(of_one(&t_joint(8, 50, true)), [], "the back is seen");
        assert_eq!(of_one(&t_joint(80, 100, false)), [], "a block");
        assert_eq!(said(&both(8.0), &t_joint(8, 50, false)), [], "both sides are seams");
        let dark = t_joint(8, 50, false);
        let unknown = one_sided(&[seam(100)], &dark, &Grid::new(&dark.points_mm, 5.0), false);
        assert_eq!(unknown, [], "nobody knows where the camera stood");
        for joint in [Joint::Lap, Joint::ButtV, Joint::Corner, Joint::Pipe] {
            assert_eq!(said(&[Seam { joint, ..seam(100) }], &dark), [], "{}", joint.name());
        }
    }

    #[test]
    fn the_wall_of_a_box_is_no_plate_of_a_t() {
        let mut wall = Seam { id: 2, ..seam(100) };
        for station in &mut wall.stations {
            // From the end of the first seam back, with a face that looks along it.
            station.position_mm = Point3::new(100.0, -100.0 - station.position_mm.x, 0.0);
            (station.tangent, station.faces[1]) = (-Vector3::y(), Vector3::x());
        }
        assert_eq!(said(&[seam(100), wall], &t_joint(8, 50, false)), []);
    }
}
