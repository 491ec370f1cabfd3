//! The points of one file as they stand in it: its own unit, its own frame, nothing dropped yet.

use std::ops::Range;
use std::path::Path;

use nalgebra::{Point3, RealField, Vector3};
use rayon::prelude::*;

use super::Error;
use super::extent::Extent;
use super::units::Unit;
use crate::geometry::grid::rows::SHARE;

/// Coordinates in the precision of the file, so that a cloud far from the origin keeps what the file knew.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Positions {
    Single(Vec<Point3<f32>>),
    Double(Vec<Point3<f64>>),
}

/// What a reader found in a file.
#[derive(Debug, Clone)]
pub(super) struct Raw {
    pub positions: Positions,
    /// Vertex indices of a mesh, all in range; empty for a cloud.
    pub triangles: Vec<[usize; 3]>,
    /// The unit, if the file states it.
    pub unit: Option<Unit>,
    /// Where the file says that the camera stood (PCD `VIEWPOINT`, `camera` of a PLY), file units.
    pub viewpoint: Option<Vector3<f64>>,
    /// Whether the file has a camera of its own: the `camera` of a PLY.
    pub names_camera: bool,
    pub notes: Vec<String>,
    /// One per position where the file has normals, of any length, in the axes of the file; otherwise empty.
    pub normals: Vec<Vector3<f32>>,
}

/// Coordinates beyond this, in any unit, are as unusable as an infinite one.
pub(super) const FARTHEST: f64 = 1e9;

impl From<Positions> for Raw {
    fn from(positions: Positions) -> Self {
        Self {
            positions,
            triangles: Vec::new(),
            unit: None,
            viewpoint: None,
            names_camera: false,
            notes: Vec::new(),
            normals: Vec::new(),
        }
    }
}

impl Positions {
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Single(points) => points.len(),
            Self::Double(points) => points.len(),
        }
    }

    pub(super) fn at(&self, i: usize) -> Vector3<f64> {
        match self {
            Self::Single(points) => points[i].coords.cast(),
            Self::Double(points) => points[i].coords,
        }
    }

    /// At most `limit` points, one from each of as many equal stretches of the file. Its place in the stretch follows the
    /// golden ratio: a fixed step would fall in with rows, or with surfaces that take turns.
    pub(super) fn sample(&self, limit: usize) -> Vec<Vector3<f64>> {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let n = self.len();
        let stretch = n.div_ceil(limit).max(1);
        let within = |i: usize| ((i as f64 * GOLDEN).fract() * stretch as f64) as usize;
        (0..n.div_ceil(stretch)).map(|i| self.at((i * stretch + within(i)).min(n - 1))).collect()
    }

    /// Relative to `origin` and in mm; the subtraction is done in double precision.
    pub(super) fn relative_mm(self, origin: Vector3<f64>, mm_per_unit: f64) -> Vec<Point3<f32>> {
        let to_mm = |p: Vector3<f64>| Point3::from(((p - origin) * mm_per_unit).cast::<f32>());
        match self {
            Self::Single(mut points) => {
                points.par_iter_mut().for_each(|p| *p = to_mm(p.coords.cast()));
                points
            }
            Self::Double(points) => points.into_iter().map(|p| to_mm(p.coords)).collect(),
        }
    }
}

impl Raw {
    /// Drops what is no reading: coordinates that are not finite, and exact zeros where there is more than one.
    /// A mesh keeps its vertices, since triangles refer to them by index.
    pub(super) fn clean(&mut self, path: &Path, notes: &mut Vec<String>) -> Result<(), Error> {
        let total = self.positions.len();
        if self.triangles.is_empty() {
            if self.normals.len() != total {
                self.normals.clear();
            }
            let (unusable, zeros) = match &mut self.positions {
                Positions::Single(points) => drop_unusable(points, &mut self.normals),
                Positions::Double(points) => drop_unusable(points, &mut self.normals),
            };
            note_dropped(unusable, "without finite coordinates", total, notes);
            note_dropped(zeros, "at exactly (0, 0, 0), the mark of no reading", total, notes);
            if self.positions.len() == 0 {
                let reason = match total {
                    0 => "the count is 0".into(),
                    _ => format!("of {total}, {unusable} are not finite and {zeros} are exactly (0, 0, 0)"),
                };
                return Err(Error::empty(path, reason));
            }
        }
        Ok(())
    }

    /// Some of the points of a cloud, one after the other, and what is known of the whole.
    pub(super) fn part(&self, points: &Range<usize>) -> Self {
        let positions = match &self.positions {
            Positions::Single(all) => Positions::Single(all[points.clone()].to_vec()),
            Positions::Double(all) => Positions::Double(all[points.clone()].to_vec()),
        };
        let normals = self.normals.get(points.clone()).unwrap_or_default().to_vec();
        Self { positions, normals, triangles: Vec::new(), notes: Vec::new(), ..*self }
    }

    pub(super) fn extent(&self) -> Extent {
        let sample = self.positions.sample(1024);
        let axis = |k: usize| {
            let mut along: Vec<f64> = sample.iter().map(|p| p[k]).filter(|c| c.is_finite()).collect();
            along.sort_unstable_by(f64::total_cmp);
            let cut = along.len() / 100;
            match (along.get(cut), along.get(along.len() / 2), along.iter().nth_back(cut)) {
                (Some(low), Some(middle), Some(high)) => (*middle, high - low),
                _ => (0.0, 0.0),
            }
        };
        let axes = [axis(0), axis(1), axis(2)];
        let diagonal = Vector3::from(axes.map(|(_, span)| span)).norm();
        let spacing = diagonal / (2.0 * self.positions.len().max(1) as f64).sqrt();
        Extent { middle: Vector3::from(axes.map(|(middle, _)| middle)), diagonal, spacing }
    }
}

/// Drops what is no reading and counts it: (not finite, exactly zero).
fn drop_unusable<T: RealField + Copy + Sync>(
    points: &mut Vec<Point3<T>>,
    normals: &mut Vec<Vector3<f32>>,
) -> (usize, usize) {
    let farthest = nalgebra::convert(FARTHEST);
    // False for NaN, too.
    let usable = |p: &Point3<T>| (p.x.abs() <= farthest) & (p.y.abs() <= farthest) & (p.z.abs() <= farthest);
    let zero = |p: &Point3<T>| (p.x == T::zero()) & (p.y == T::zero()) & (p.z == T::zero());
    let count = |share: &[Point3<T>]| {
        let both = |(a, b), p| (a + usize::from(!usable(p)), b + usize::from(zero(p)));
        share.iter().fold((0, 0), both)
    };
    let (unusable, mut zeros) =
        points.par_chunks(SHARE).map(count).reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    if zeros < 2 {
        zeros = 0;
    }
    if unusable + zeros > 0 {
        let stays = |p: &Point3<T>| usable(p) && (zeros == 0 || !zero(p));
        let mut of_normals = points.iter().map(stays);
        normals.retain(|_| of_normals.next().unwrap_or(false));
        points.retain(stays);
    }
    (unusable, zeros)
}

fn note_dropped(count: usize, what: &str, total: usize, notes: &mut Vec<String>) {
    if count > 0 {
        notes.push(format!("dropped {count} of {total} points {what}"));
    }
}
