//! What is scanned and is no work (ours): the places that the user names, and what was there before the work.
//!
//! Millimetres, base frame. Its points take part in the registration, since what stands still while the camera moves ties the
//! views down as the work does, and in the choice of sizes, so that these do not hang on what is left out. They are dropped
//! before the voxels in which seams are sought; the model that torch and air moves are held against keeps them.

use super::RAW_CELL_MM;
use super::background::Background;
use super::config::{MergeConfig, Method};
use super::merged::MergedViews;
use super::result::{Parameter, PlanError, no_seam};
use super::scale_search::ScaleResult;
use super::stages::{Evidence, Observer};
use crate::geometry::cloud::{Merged, View};
use crate::geometry::grid::Grid;
use crate::seam::{Found, Seam};
use nalgebra::{Point3, UnitVector3};
use rayon::prelude::*;
use std::sync::Arc;

/// What is no work.
#[derive(Debug, Clone, Default)]
pub struct Exclusion {
    /// Least and greatest corner of boxes.
    pub boxes: Vec<[Point3<f64>; 2]>,
    /// All that lies beyond planes.
    pub half_spaces: Vec<HalfSpace>,
    /// What was there before; empty if nothing is known of it.
    pub background: Arc<[View]>,
}

/// All that lies beyond a plane.
#[derive(Debug, Clone, Copy)]
pub struct HalfSpace {
    /// A place on the plane.
    pub at_mm: Point3<f64>,
    /// From the plane into what is excluded.
    pub toward: UnitVector3<f64>,
}

impl Exclusion {
    fn is_empty(&self) -> bool {
        self.boxes.is_empty() && self.half_spaces.is_empty() && self.background.is_empty()
    }

    /// Whether a place is in a box or beyond a plane, their surfaces included.
    fn names(&self, p: &Point3<f64>) -> bool {
        let in_box = |[low, high]: &[Point3<f64>; 2]| (0..3).all(|k| (low[k]..=high[k]).contains(&p[k]));
        self.boxes.iter().any(in_box)
            || self.half_spaces.iter().any(|half| (p - half.at_mm).dot(&half.toward) >= 0.0)
    }
}

/// What is work of all that was scanned, the `whole` of its functions.
pub(super) struct Scene {
    /// What stays and what is left out; none where nothing is excluded.
    parts: Option<[Merged; 2]>,
    exclusion: Exclusion,
    background: Option<Background>,
    /// Points in boxes and beyond planes, and points on the background alone.
    counts: [usize; 2],
}

impl Scene {
    /// Parts the points.
    ///
    /// # Errors
    /// If none is left.
    pub(super) fn new(
        merged: &MergedViews,
        exclusion: &Exclusion,
        method: Method,
        merge: &MergeConfig,
    ) -> Result<Self, PlanError> {
        let MergedViews { cloud: whole, scale, .. } = merged;
        let mut scene = Self { parts: None, exclusion: exclusion.clone(), background: None, counts: [0; 2] };
        if exclusion.is_empty() {
            return Ok(scene);
        }
        let background = (!exclusion.background.is_empty())
            .then(|| Background::new(&exclusion.background, merged, method, merge))
            .transpose()?;
        let origin_mm = whole.origin_mm;
        let named = |p: &Point3<f32>| exclusion.names(&(origin_mm + p.coords.cast::<f64>()));
        let mut leave: Vec<bool> = whole.points_mm.par_iter().map(named).collect();
        let count = |leave: &[bool]| leave.iter().filter(|leaves| **leaves).count();
        scene.counts[0] = count(&leave);
        if let Some(background) = &background {
            background.mark(whole, scale, &mut leave);
        }
        scene.counts[1] = count(&leave) - scene.counts[0];
        scene.background = background;
        let all = whole.points_mm.len();
        if scene.counts.iter().sum::<usize>() == all {
            return Err(no_seam(scene.reason(whole, "nothing of the scan is left".into())));
        }
        scene.parts = Some(whole.parted(&leave));
        Ok(scene)
    }

    /// The points in which seams are sought.
    pub(super) fn work<'a>(&'a self, whole: &'a Merged) -> &'a Merged {
        self.parts.as_ref().map_or(whole, |[work, _]| work)
    }

    /// The others; none where nothing is excluded.
    pub(super) fn excluded(&self) -> Option<&Merged> {
        self.parts.as_ref().map(|[_, excluded]| excluded)
    }

    /// Shows the observer all that was scanned; edges were looked for in the work alone.
    pub(super) fn show(
        &self,
        merged: &Merged,
        result: &ScaleResult,
        raw: &Grid,
        observer: &mut dyn Observer,
    ) {
        let ScaleResult { model, found, .. } = result;
        let (voxels, cloud) = model.scene();
        let of_work = Evidence {
            merged,
            raw,
            voxels,
            model: cloud,
            index: &model.index,
            intensity: &found.intensity,
            segmentation: result.segmentation.as_deref(),
            rejected: &found.warnings,
            unwelded: &found.unwelded,
        };
        if self.parts.is_none() {
            return observer.evidence(&of_work);
        }
        let raw = &Grid::new(&merged.points_mm, RAW_CELL_MM);
        let index = &Grid::new(&cloud.points_mm, model.index.cell_mm());
        let mut intensity = found.intensity.clone();
        intensity.resize(cloud.len(), 0.0);
        observer.evidence(&Evidence { raw, index, intensity: &intensity, segmentation: None, ..of_work });
    }

    /// Why there is no seam, with what was left out.
    pub(super) fn reason(&self, whole: &Merged, reason: String) -> String {
        match self.words(whole) {
            Some(words) => format!("{reason}; {words}"),
            None => reason,
        }
    }

    fn words(&self, whole: &Merged) -> Option<String> {
        let all = whole.points_mm.len();
        let [named, before] = self.counts;
        let on_background = if self.background.is_some() {
            format!(", and {before} lie on the background")
        } else {
            String::new()
        };
        (!self.exclusion.is_empty())
            .then(|| format!("[exclude] covers {named} of {all} points{on_background}"))
    }

    /// What the user should know.
    pub(super) fn warning(&self) -> Option<String> {
        let nothing = self.background.is_some() && self.counts == [0, 0];
        nothing.then(|| {
            "no point of the scan lies on the background: was it scanned in the same frame, with the same \
             hand-eye transform?"
                .into()
        })
    }

    /// What was left out, for the summary.
    pub(super) fn derived(&self, whole: &Merged) -> Vec<Parameter> {
        let count: usize = self.counts.iter().sum();
        let row = |how| Parameter { name: "excluded_points".into(), value: count as f64, how };
        self.words(whole)
            .map(row)
            .into_iter()
            .chain(self.background.as_ref().map(Background::derived))
            .collect()
    }

    /// Cuts from the seams what is excluded: two faces that end beside a box are followed into it. Seams of a mesh come from
    /// facets, which are not parted, and are cut by the background, too; work that stands on it has its seams close to it.
    pub(super) fn trim(&self, found: &mut Found, views: &[View]) {
        if self.exclusion.is_empty() {
            return;
        }
        let background = self.background.as_ref().filter(|_| views.iter().any(|view| view.mesh.is_some()));
        let is_out = |p: &Point3<f64>| {
            self.exclusion.names(p) || background.is_some_and(|background| background.holds(p))
        };
        let left = |seam: &Seam| seam.stretches(|station| is_out(&station.position_mm));
        found.seams = found.seams.iter().flat_map(left).collect();
        (1..).zip(&mut found.seams).for_each(|(id, seam)| seam.id = id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seam::Station;
    use nalgebra::Vector3;

    /// A straight seam along x from 0 to 100 mm, a station every millimetre.
    fn seam() -> Seam {
        let station = |k: i32| Station {
            position_mm: Point3::new(f64::from(k), 0.0, 0.0),
            tangent: Vector3::x(),
            faces: [Vector3::y(), Vector3::z()],
        };
        Seam::through((0..=100).map(station).collect())
    }

    #[test]
    fn a_box_holds_its_surface_and_a_half_space_its_plane_and_what_is_beyond() {
        let half = HalfSpace { at_mm: Point3::new(0.0, 0.0, 5.0), toward: -Vector3::z_axis() };
        let exclusion = Exclusion {
            boxes: vec![[Point3::new(1.0, 1.0, 10.0), Point3::new(2.0, 3.0, 20.0)]],
            half_spaces: vec![half],
            ..Exclusion::default()
        };
        for p in [[1.0, 1.0, 10.0], [2.0, 3.0, 20.0], [9.0, 9.0, 5.0], [-7.0, 2.0, -100.0]] {
            assert!(exclusion.names(&Point3::from(p)), "{p:?}");
        }
        for p in [[0.9, 1.0, 10.0], [1.5, 3.1, 15.0], [9.0, 9.0, 5.1]] {
            assert!(!exclusion.names(&Point3::from(p)), "{p:?}");
        }
        assert!(!Exclusion::default().names(&Point3::origin()));
    }

    #[test]
    fn a_seam_is_cut_where_it_is_out_and_short_ends_are_dropped() {
        let lengths = |out: fn(f64) -> bool, closed: bool| -> Vec<f64> {
            let left = Seam { closed, ..seam() }.stretches(|station| out(station.position_mm.x));
            left.iter().map(Seam::length_mm).collect()
        };
        assert_eq!(lengths(|_| false, false), [100.0]);
        assert_eq!(lengths(|x| x > 40.5, false), [40.0]);
        assert_eq!(lengths(|x| (40.5..59.5).contains(&x), false), [40.0, 40.0]);
        assert_eq!(lengths(|x| (4.5..59.5).contains(&x), false), [40.0], "4 mm are no seam");
        assert!(lengths(|_| true, false).is_empty());
        let ring = Seam { closed: true, ..seam() };
        let ring = ring.stretches(|station| (40.5..59.5).contains(&station.position_mm.x));
        assert!(
            ring.len() == 1 && !ring[0].closed && ring[0].stations.len() == 82,
            "one stretch over its start"
        );
    }
}
