//! Seams of small voxels and of larger ones as one list (ours).
//!
//! A camera rounds corners over some millimetres, and its waves break them up: a neighbourhood that lies within the rounding shows
//! a ramp between the faces, or nothing that lasts. A larger one reaches beyond it. So larger voxels look at the corners that small
//! ones see, and have the say where they see one clearly longer, or sharper.

use super::{Contact, Found, Seam, Station, Unwelded, WhyUnwelded, ordering};
use nalgebra::Point3;

/// Two lines are of one corner this near to each other, larger voxels: half of what a neighbourhood of theirs reaches. A ramp ends
/// as far from the corner.
const NEAR_VOXELS: f64 = 3.0;
/// Cosine of tangents that run alike, and of torches in one corner: a web has another on its other side.
const ALONG: f64 = 0.8;
const ONE_TORCH: f64 = 0.5;
/// What is clearly longer is so by this factor.
pub(crate) const CLEARLY: f64 = 1.5;
/// What is sharper is so by this angle through the air, degrees: what a face may turn from one link of a chain to the next.
const SHARPER_DEG: f64 = 20.0;
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

    /// What the `larger` voxels, of this edge, show better goes in the place of what is shown here; `voxel_mm` is the edge of those
    /// that it was found in.
    pub(crate) fn join(&mut self, larger: Vec<Seam>, larger_mm: f64, voxel_mm: f64) {
        let near_mm = NEAR_VOXELS * larger_mm;
        let (mut better, mut is_worse): (Vec<Seam>, _) = (Vec::new(), vec![false; self.seams.len()]);
        for seam in larger.into_iter().filter(|seam| !seam.is_wide() && self.is_seen(seam, near_mm)) {
            let of_it: Vec<usize> =
                (0..self.seams.len()).filter(|&k| !is_worse[k] && self.seams[k].is_of(&seam, near_mm)).collect();
            let small = of_it.iter().map(|&k| &self.seams[k]);
            let length_mm: f64 = small.clone().map(Seam::length_mm).sum();
            let is_sharper =
                small.clone().all(|small| small.included_deg() - seam.included_deg() > SHARPER_DEG);
            let contact: Option<Contact> = small.clone().find_map(|small| small.contact);
            let is_contact = seam.contact.is_some() && contact.is_none() && !of_it.is_empty();
            if is_contact || (!is_sharper && seam.length_mm() < CLEARLY * length_mm) {
                continue;
            }
            of_it.iter().for_each(|&k| is_worse[k] = true);
            better.extend(contact.into_iter().fold(Some(seam), |seam, contact| {
                let mut seam = seam?;
                seam.mark_contact(contact);
                Some(seam)
            }));
        }
        let mut is_worse = is_worse.into_iter();
        self.seams.retain(|_| !is_worse.next().unwrap_or(false));
        for seam in better {
            let is_taken =
                |station: &Station| self.seams.iter().any(|other| other.holds(station, near_mm));
            let free = seam.stretches(is_taken);
            self.seams.extend(free);
        }
        ordering::order(&mut self.seams);
        self.tell_anew(near_mm, voxel_mm);
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

    /// Of the corners that are no seams, what is not beside those that are now.
    fn tell_anew(&mut self, near_mm: f64, voxel_mm: f64) {
        let (seams, mut gone) = (&self.seams, Vec::new());
        let is_free = |p: &Point3<f64>| {
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
    fn holds(&self, other: &Station, near_mm: f64) -> bool {
        self.stations.iter().any(|station| {
            (station.position_mm - other.position_mm).norm() < near_mm
                && station.tangent.dot(&other.tangent).abs() > ALONG
                && station.torch().dot(&other.torch()) > ONE_TORCH
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
