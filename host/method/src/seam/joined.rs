//! Seams of small voxels and of larger ones as one list (ours).
//!
//! A camera rounds corners over some millimetres, and its waves break them up: a neighbourhood that lies within the rounding shows
//! a ramp between the faces, or nothing that lasts. A larger one reaches beyond it. So larger voxels look at the corners that small
//! ones see, and have the say where they see one clearly longer, or sharper.

use super::refine::frame::Frame;
use super::trace::support::Support;
use super::{Found, Seam, Station, Unwelded, WhyUnwelded, ordering};
use nalgebra::{Point3, Vector3};

/// Two lines are of one corner this near to each other, larger voxels: half of what a neighbourhood of theirs reaches. A ramp ends
/// as far from the corner.
const NEAR_VOXELS: f64 = 3.0;
/// Cosine of tangents that run alike, and of torches in one corner: a web has another on its other side.
pub(super) const ALONG: f64 = 0.8;
pub(super) const ONE_TORCH: f64 = 0.5;
/// What is clearly longer is so by this factor.
pub(crate) const CLEARLY: f64 = 1.5;
/// What is sharper is so by this angle through the air, degrees: what a face may turn from one link of a chain to the next.
pub(super) const SHARPER_DEG: f64 = 20.0;
/// Included angle up to which larger voxels have seams to add, degrees: what is wider may be the edge of a rounding that is wider
/// than they are.
const WIDE_DEG: f64 = 115.0;

impl Found {
    /// Corners that are seen and are not sure enough to be seams, mm.
    pub(crate) fn unsure_mm(&self) -> f64 {
        let is_unsure = |line: &&Unwelded| matches!(line.reason, WhyUnwelded::Unsure | WhyUnwelded::Rounded);
        self.unwelded.iter().filter(is_unsure).map(Unwelded::length_mm).sum()
    }

    /// Whether roundings are seen that are wider than a neighbourhood.
    pub(crate) fn is_rounded(&self) -> bool {
        self.unwelded.iter().any(|line| line.reason == WhyUnwelded::Rounded)
    }

    /// What `larger` voxels show better goes in the place of what is shown here, given the edges of both, of the larger ones first.
    pub(crate) fn join(&mut self, larger: Self, origin_mm: &Point3<f64>, [larger_mm, voxel_mm]: [f64; 2]) {
        let near_mm = NEAR_VOXELS * larger_mm;
        // Waves may hide a table from small voxels.
        if self.table.is_none()
            && let Some(table) = &larger.table
        {
            self.rest(table, origin_mm);
            self.table = larger.table;
        }
        let larger = larger.seams;
        let (mut better, mut is_worse): (Vec<Seam>, _) = (Vec::new(), vec![false; self.seams.len()]);
        for mut seam in larger.into_iter().filter(|seam| !seam.is_wide() && self.is_seen(seam, near_mm)) {
            let of_it: Vec<usize> = (0..self.seams.len())
                .filter(|&k| !is_worse[k] && self.seams[k].is_of(&seam, near_mm))
                .collect();
            let small = of_it.iter().map(|&k| &self.seams[k]);
            let length_mm: f64 = small.clone().map(Seam::length_mm).sum();
            let is_sharper =
                small.clone().all(|small| small.included_deg() - seam.included_deg() > SHARPER_DEG);
            let contact = small.clone().find_map(|small| small.contact);
            // What small voxels tell from a contact is none.
            let is_contact = seam.contact.is_some() && contact.is_none() && !of_it.is_empty();
            if is_contact || (!is_sharper && seam.length_mm() < CLEARLY * length_mm) {
                continue;
            }
            of_it.iter().for_each(|&k| is_worse[k] = true);
            contact.into_iter().for_each(|contact| seam.mark_contact(contact));
            better.push(seam);
        }
        if better.is_empty() {
            return;
        }
        self.tell_anew(&better, near_mm, voxel_mm);
        let mut is_worse = is_worse.into_iter();
        self.seams.retain(|_| !is_worse.next().unwrap_or(false));
        for seam in better {
            let is_taken = |station: &Station| self.seams.iter().any(|other| other.holds(station, near_mm));
            let free = seam.stretches(is_taken);
            self.seams.extend(free);
        }
        ordering::order(&mut self.seams);
    }

    /// Takes for contacts with this table the seams of which it is a face; `origin_mm` is that of the scan.
    fn rest(&mut self, table: &Support, origin_mm: &Point3<f64>) {
        let is_on = |station: &&Station| {
            let frame = Frame::of(station, origin_mm);
            frame.faces.iter().any(|face| table.is_face(face, &frame.position))
        };
        let rests = |seam: &mut Seam| 2 * seam.stations.iter().filter(is_on).count() > seam.stations.len();
        for seam in self.seams.extract_if(.., rests) {
            let line = Unwelded::of(&seam, WhyUnwelded::Table, String::new());
            self.unwelded.push(Unwelded { words: line.in_words(), ..line });
        }
        (1..).zip(&mut self.seams).for_each(|(id, seam)| seam.id = id);
    }

    /// Whether half of a seam runs along corners that are shown here, and not on the table.
    fn is_seen(&self, seam: &Seam, near_mm: f64) -> bool {
        let near = |p: &Point3<f64>, line: &Unwelded| line.line_mm.iter().any(|q| (p - q).norm() < near_mm);
        let is_on = |station: &&Station, on_table: bool| {
            let lines = self.unwelded.iter().filter(|line| (line.reason == WhyUnwelded::Table) == on_table);
            lines.into_iter().any(|line| near(&station.position_mm, line))
        };
        let stations = || seam.stations.iter();
        let on_table = stations().filter(|station| is_on(station, true)).count();
        let shown = stations().filter(|station| {
            is_on(station, false) || self.seams.iter().any(|other| other.holds(station, near_mm))
        });
        let shown = shown.count();
        2 * shown >= seam.stations.len() && shown > on_table
    }

    /// Of the corners that are no seams, what is not beside these that are now.
    fn tell_anew(&mut self, seams: &[Seam], near_mm: f64, voxel_mm: f64) {
        let mut gone = Vec::new();
        let is_free = |p: &Point3<f64>, _: &Vector3<f64>| {
            let near = |station: &Station| (station.position_mm - p).norm() < near_mm;
            !seams.iter().any(|seam| seam.stations.iter().any(near))
        };
        let left = |line: Unwelded| {
            let mut left = line.stretches(voxel_mm, is_free);
            let is_whole = left.iter().any(|stretch| stretch.line_mm.len() == line.line_mm.len());
            if !is_whole {
                left.iter_mut().for_each(|stretch| stretch.words = stretch.in_words());
                gone.push(line.words);
            }
            left
        };
        self.unwelded = std::mem::take(&mut self.unwelded).into_iter().flat_map(left).collect();
        self.warnings.retain(|words| !gone.contains(words));
    }
}

impl Seam {
    /// Whether most of it is in the corner of another.
    fn is_of(&self, other: &Self, near_mm: f64) -> bool {
        2 * self.stations.iter().filter(|station| other.holds(station, near_mm)).count() > self.stations.len()
    }

    /// Whether a station of another seam is in its corner.
    pub(super) fn holds(&self, other: &Station, near_mm: f64) -> bool {
        let Some(torch) = other.bisector() else { return false };
        self.stations.iter().any(|station| {
            (station.position_mm - other.position_mm).norm() < near_mm
                && station.tangent.dot(&other.tangent).abs() > ALONG
                && station.bisector().is_some_and(|own| own.dot(&torch) > ONE_TORCH)
        })
    }

    fn is_wide(&self) -> bool {
        self.included_deg() > WIDE_DEG
    }

    /// Angle between its faces through the air, the mean along it, degrees.
    pub(super) fn included_deg(&self) -> f64 {
        let angle = |station: &Station| station.faces[0].angle(&station.faces[1]);
        180.0 - (self.stations.iter().map(angle).sum::<f64>() / self.stations.len() as f64).to_degrees()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along x at y = `across_mm`, between the level face and one at an angle to it; the air is above, and before it.
    fn seam(from_mm: f64, to_mm: f64, across_mm: f64, included_deg: f64) -> Seam {
        let (sin, cos) = included_deg.to_radians().sin_cos();
        let station = |k: i32| Station {
            position_mm: Point3::new(from_mm + 2.0 * f64::from(k), across_mm, 0.0),
            tangent: Vector3::x(),
            // A face that rises from y = 0 to negative y, seen from positive y.
            faces: [Vector3::z(), Vector3::new(0.0, sin, -cos)],
        };
        Seam::through((0..=((to_mm - from_mm) / 2.0) as i32).map(station).collect())
    }

    fn line(from_mm: f64, to_mm: f64, reason: WhyUnwelded) -> Unwelded {
        Unwelded::of(&seam(from_mm, to_mm, 3.0, 90.0), reason, "a line".into())
    }

    fn joined(small: Vec<Seam>, unwelded: Vec<Unwelded>, larger: Seam) -> Found {
        let mut found = Found { seams: small, unwelded, ..Found::default() };
        found.join(Found { seams: vec![larger], ..Found::default() }, &Point3::origin(), [2.0, 1.0]);
        found
    }

    fn lengths_mm(found: &Found) -> Vec<f64> {
        found.seams.iter().map(Seam::length_mm).collect()
    }

    #[test]
    fn a_corner_in_pieces_is_whole_in_larger_voxels_and_told_no_more() {
        let lines = vec![line(40.0, 100.0, WhyUnwelded::Unsure), line(130.0, 200.0, WhyUnwelded::Unsure)];
        let found = joined(vec![seam(0.0, 40.0, 0.0, 90.0)], lines, seam(0.0, 100.0, 1.0, 90.0));
        assert_eq!(lengths_mm(&found), [100.0]);
        assert_eq!(found.unwelded.len(), 1);
        assert!((found.unwelded[0].length_mm() - 70.0).abs() < 1e-9);
    }

    #[test]
    fn small_voxels_keep_what_larger_ones_show_no_better() {
        let fine = || vec![seam(0.0, 80.0, 0.0, 90.0)];
        assert_eq!(lengths_mm(&joined(fine(), vec![], seam(0.0, 100.0, 1.0, 80.0))), [80.0]);
        // On the other side of a web of 2 mm, and in a corner that nothing shows in small voxels.
        let mut behind = seam(0.0, 100.0, -2.0, 90.0);
        behind.stations.iter_mut().for_each(|station| station.faces[1] = -station.faces[1]);
        assert_eq!(lengths_mm(&joined(fine(), vec![], behind)), [80.0]);
        assert_eq!(lengths_mm(&joined(fine(), vec![], seam(0.0, 200.0, 50.0, 90.0))), [80.0]);
        let table = vec![line(0.0, 200.0, WhyUnwelded::Table)];
        assert_eq!(lengths_mm(&joined(vec![], table, seam(0.0, 200.0, 0.0, 90.0))), [0.0; 0]);
    }

    #[test]
    fn where_larger_voxels_see_the_table_nothing_is_welded() {
        // The level face of these is the table; the faces of the third are upright.
        let mut upright = seam(0.0, 80.0, 40.0, 90.0);
        upright.stations.iter_mut().for_each(|station| station.faces[0] = Vector3::x());
        let table = Support::of_face(Vector3::z(), &Point3::origin(), 1.0);
        let larger = || Found { table: Some(table), ..Found::default() };
        let mut found =
            Found { seams: vec![seam(0.0, 80.0, 4.0, 90.0), upright.clone()], ..Found::default() };
        found.join(larger(), &Point3::origin(), [2.0, 1.0]);
        assert_eq!((lengths_mm(&found).len(), found.seams[0].id), (1, 1));
        assert_eq!(found.unwelded[0].reason, WhyUnwelded::Table);
        assert!(found.unwelded[0].words.contains("80 mm"), "{}", found.unwelded[0].words);
        // Small voxels that show a table themselves know where it is.
        let own = Some(Support::of_face(Vector3::z(), &Point3::new(0.0, 0.0, -50.0), 1.0));
        let mut found = Found { seams: vec![seam(0.0, 80.0, 4.0, 90.0)], table: own, ..Found::default() };
        found.join(larger(), &Point3::origin(), [2.0, 1.0]);
        assert_eq!(lengths_mm(&found), [80.0]);
    }

    #[test]
    fn a_sharper_corner_takes_the_place_of_the_edge_of_its_rounding_and_no_wide_one_does() {
        let ramp = || vec![seam(0.0, 80.0, 4.0, 140.0)];
        let found = joined(ramp(), vec![], seam(0.0, 80.0, 0.0, 90.0));
        assert!((found.seams[0].included_deg() - 90.0).abs() < 1e-6 && found.seams.len() == 1);
        let unsure = vec![line(0.0, 200.0, WhyUnwelded::Unsure)];
        assert_eq!(lengths_mm(&joined(ramp(), unsure, seam(0.0, 200.0, 0.0, 150.0))), [80.0]);
    }
}
