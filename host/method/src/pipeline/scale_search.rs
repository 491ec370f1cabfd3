//! Seams sought in voxels of one size, and in larger ones until some show (ours; the paper has one size, typed by hand).

use super::config::{Method, SearchConfig, Wishes};
use super::result::{PlanError, no_seam};
use super::stages::Stages;
use crate::geometry::cloud::{Merged, PointCloud, View};
use crate::geometry::grid::Grid;
use crate::geometry::mesh::Mesh;
use crate::model::denoising;
use crate::model::downsampling;
use crate::model::downsampling::{Scale, Voxels};
use crate::model::orientation::{self, Orientation};
use crate::model::reconstruction::Registration;
use crate::seam::asked::{self, Answer, Shared};
use crate::seam::drawn;
use crate::seam::joined::CLEARLY;
use crate::seam::score::{edges, paper};
use crate::seam::segmentation::Segmentation;
use crate::seam::surfaces::Surfaces;
use crate::seam::trace::support;
use crate::seam::{Cues, Found, INDEX_VOXELS, Input, RawScan, Seam, SurfaceModel, extraction};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

// All chosen on the simulated scans and on scans of other people.

/// Seams shorter than this, in voxels, ask for larger ones, and so do corners that are not sure enough to be seams, together.
const WEAK_VOXELS: f64 = 22.0;
/// The smaller of the larger voxels, in multiples of the first, and the largest, which still resolves thick plates, mm.
const COARSER: f32 = 1.8;
const COARSEST_MM: f32 = 3.0;
/// Sizes by less than this factor apart are one.
const ANOTHER_SIZE: f32 = 1.1;
/// How far from a corner its surfaces are looked up, voxels.
const SIDED_VOXELS: f32 = 12.0;
/// Fewer voxels than this cannot make two faces.
const MIN_POINTS: usize = 40;

/// Registered views, in which seams are sought.
#[derive(Clone, Copy)]
pub(super) struct ScaleSearch<'a> {
    pub views: &'a [View],
    /// What is work.
    pub merged: &'a Merged,
    /// What is excluded: no seam is sought in it, but it is in the way.
    pub excluded: Option<&'a Merged>,
    /// Spatial index of its points.
    pub raw: &'a Grid,
    pub registration: &'a Registration,
    pub method: Method,
    pub config: &'a SearchConfig,
}

/// What one size of voxels showed.
#[derive(Clone)]
pub(super) struct ScaleResult {
    pub scale: Scale,
    pub model: Arc<Model>,
    pub found: Found,
    /// The flat faces of the model, where they were asked for.
    surfaces: Arc<Surfaces>,
    /// Its surfaces, where the corners between them were asked for.
    pub segmentation: Option<Arc<Segmentation>>,
    cues: Cues,
}

/// The thinned and filtered cloud, and what is known of its neighbourhoods.
pub(super) struct Model {
    pub voxels: Voxels,
    pub cloud: PointCloud,
    /// Spatial index of the cloud.
    pub index: Grid,
    asymmetries: Vec<Vector3<f32>>,
    /// Where something is excluded: all that was scanned, first what is above.
    whole: Option<(Voxels, PointCloud)>,
    /// Where no camera tells the sides: what was found of them.
    oriented: Option<Orientation>,
    /// Whether the table is in a cloud of unknown cameras.
    table_shown: bool,
}

impl Model {
    fn surface(&self) -> SurfaceModel<'_> {
        let Self { voxels, cloud, index, asymmetries, .. } = self;
        SurfaceModel { voxels, cloud, index, asymmetries }
    }

    /// All that was scanned, thinned, before the filter and after it.
    pub(super) fn scene(&self) -> (&Voxels, &PointCloud) {
        self.whole.as_ref().map_or((&self.voxels, &self.cloud), |(voxels, cloud)| (voxels, cloud))
    }
}

impl ScaleSearch<'_> {
    /// The raw scan, as the search for seams reads it.
    pub(super) fn raw_scan(&self) -> RawScan<'_> {
        RawScan {
            merged: self.merged,
            excluded: self.excluded,
            index: self.raw,
            registration: Some(self.registration),
            view_names: self.views.iter().map(|view| view.name.as_str()).collect(),
            pictures: self.views.iter().map(|view| view.picture).collect(),
            cameras_known: self.cameras_known(),
            table_shown: false,
        }
    }

    pub(super) fn cameras_known(&self) -> bool {
        self.views.iter().all(|view| view.camera_known)
    }

    /// The mesh that is the scan, and its pose.
    fn mesh(&self) -> Option<(&Mesh, &Isometry3<f64>)> {
        let [view] = self.views else { return None };
        Some((view.mesh.as_deref()?, self.registration.base_from_camera.first()?))
    }

    /// Tries larger voxels than `first` until seams show; the size with clearly the most of them.
    pub(super) fn best(&self, first: &Scale, stages: &mut Stages) -> Result<ScaleResult, PlanError> {
        let coarser = coarser(first);
        let steps = self.raw_scan().has_whole_views() || coarser.is_empty();
        let mut best = self.at(first, Cues { steps, blurred: false }, stages)?;
        let mut settled = self.settles(&best);
        for (k, scale) in coarser.iter().enumerate() {
            if settled {
                break;
            }
            // What is rounded looks like a step.
            let cues = Cues { steps: !best.found.is_rounded(), blurred: k + 1 == coarser.len() };
            stages.go_on()?;
            // Where larger voxels are too few, those before them have the last word.
            let Ok(result) = self.at(scale, cues, stages) else { break };
            settled = self.settles(&result);
            if result.length_mm() > CLEARLY * best.length_mm() {
                best = result;
            }
        }
        stages.go_on()?;
        Ok(best)
    }

    /// Looks at corners that are not sure in larger voxels, too. What one view alone shows of them is no better there: its ripples and
    /// the curl of its silhouettes become faces.
    pub(super) fn look_again(&self, result: &mut ScaleResult, stages: &mut Stages) -> Result<(), PlanError> {
        if !self.raw_scan().is_seen_from_several() {
            return Ok(());
        }
        for scale in &coarser(&result.scale) {
            if !result.is_unsure() {
                break;
            }
            // An edge is as sharp in small voxels: larger ones have corners to add.
            let Ok(larger) = self.at(scale, Cues::default(), stages) else { break };
            let edges_mm = [scale, &result.scale].map(|scale| f64::from(scale.edge_mm));
            result.found.join(larger.found, &self.merged.origin_mm, edges_mm);
            stages.go_on()?;
        }
        Ok(())
    }

    /// Tells the corners between the surfaces of a scan that made no seam.
    pub(super) fn tell_borders(&self, result: &mut ScaleResult, stages: &mut Stages) {
        // The facets of a mesh show all corners that it has.
        if self.method != Method::Weldpath || self.mesh().is_some() {
            return;
        }
        let ScaleResult { model, found, surfaces, segmentation, .. } = result;
        stages.time("seam", || {
            let surface = model.surface();
            let segmented = Segmentation::with(&surface, surfaces);
            let is_sided = |place: &Point3<f32>| match &model.oriented {
                Some(oriented) => {
                    surface.nearest(place, SIDED_VOXELS).is_some_and(|point| !oriented.unknown[point])
                }
                None => true,
            };
            found.mark_radii(&surface);
            found.tell_borders(&segmented, &surface, &self.config.seam.trace, is_sided);
            *segmentation = Some(Arc::new(segmented));
        });
    }

    /// Grants the wishes; in words those that cannot be granted, of seams and of lines.
    pub(super) fn grant(
        &self,
        wishes: &Wishes,
        result: &mut ScaleResult,
        stages: &mut Stages,
    ) -> (Vec<String>, Vec<String>) {
        let grant = || {
            let is_kept = |seam: &Seam| !wishes.kept_back.iter().any(|place| seam.is_at(place));
            result.found.seams.retain(is_kept);
            (self.ask(&wishes.asked, result), self.draw(&wishes.drawn, result))
        };
        if wishes.asked.is_empty() && wishes.drawn.is_empty() {
            stages.time("seam", grant)
        } else {
            stages.stage("asked", grant)
        }
    }

    /// Puts the seams that were asked for behind those that were found: the numbers of these stay as they are. Says of those that
    /// are not there why.
    fn ask(&self, asked: &[Vec<Point3<f64>>], result: &mut ScaleResult) -> Vec<String> {
        let (mut unmet, shared) = (Vec::new(), Shared::default());
        for places_mm in asked {
            let input = self.input(result);
            let answer = match asked::find(&input, &shared, places_mm, &result.found.seams, &self.config.seam)
            {
                Answer::Found(seam) => {
                    result.sided(*seam).map_or_else(Answer::Nothing, |seam| Answer::Found(seam.into()))
                }
                answer => answer,
            };
            unmet.extend(result.take(places_mm, answer));
        }
        unmet
    }

    /// Puts the lines that were drawn behind all seams that were found. Says of those that the scan does not bear why.
    fn draw(&self, drawn: &[Vec<Point3<f64>>], result: &mut ScaleResult) -> Vec<String> {
        let mut undrawn = Vec::new();
        for places_mm in drawn {
            let drawn = drawn::draw(&self.input(result), places_mm, &result.found.seams);
            match drawn.and_then(|seam| result.sided(seam)) {
                Ok(seam) => {
                    let reason = format!("{}, between {}", seam.reason, ends(places_mm));
                    result.push(Seam { reason, ..seam });
                }
                Err(why) => undrawn.push(format!("no seam is drawn between {}: {why}", ends(places_mm))),
            }
        }
        undrawn
    }

    /// What seams of one size of voxels are sought in.
    fn input<'b>(&'b self, result: &'b ScaleResult) -> Input<'b> {
        let scan = RawScan { table_shown: result.model.table_shown, ..self.raw_scan() };
        let (model, scene) = (result.model.surface(), result.model.scene().0);
        Input::new(scan, model, scene, result.cues)
    }

    /// Seams in voxels of one size.
    fn at(&self, scale: &Scale, cues: Cues, stages: &mut Stages) -> Result<ScaleResult, PlanError> {
        let model = self.model(scale, stages);
        stages.go_on()?;
        if model.cloud.len() < MIN_POINTS {
            let count = model.cloud.len();
            let reason =
                format!("{count} voxels are too few for two faces; at least {MIN_POINTS} are needed");
            return Err(no_seam(reason));
        }
        let (mut found, surfaces) = stages.stage("seam", || match self.method {
            Method::Weldpath => {
                let scan = RawScan { table_shown: model.table_shown, ..self.raw_scan() };
                let cues = Cues { steps: cues.steps || model.table_shown, ..cues };
                let input = Input::new(scan, model.surface(), model.scene().0, cues);
                let found = match self.mesh() {
                    Some((mesh, pose)) => extraction::find_in_mesh(&input, mesh, pose),
                    None => extraction::find(&input, &self.config.seam),
                };
                (found, input.into_surfaces())
            }
            Method::Paper => {
                (paper::find(&model.surface(), self.config.ratio_threshold), Surfaces::default())
            }
        });
        if let Some(oriented) = &model.oriented {
            found.only_oriented(oriented, &model.surface());
        }
        let (model, surfaces) = (Arc::new(model), Arc::new(surfaces));
        Ok(ScaleResult { scale: *scale, model, found, surfaces, segmentation: None, cues })
    }

    /// The cloud thinned to voxels of one size, filtered, and indexed.
    fn model(&self, scale: &Scale, stages: &mut Stages) -> Model {
        let mut voxels = stages.stage("downsampling", || {
            downsampling::voxel_grid(self.merged, scale.edge_mm, scale.occupancy())
        });
        // Sides and the table are told from all that was scanned, seams are sought in the work alone.
        let work = voxels.cloud.len();
        if let Some(excluded) = self.excluded {
            voxels.append(downsampling::voxel_grid(excluded, scale.edge_mm, scale.occupancy()));
        }
        if self.method != Method::Weldpath {
            voxels.fit_around_points(scale.bilateral().radius_mm);
        }
        let orientation_unknown = !self.views.iter().all(View::tells_orientation);
        // The filter moves points along their normals, whichever way these face: neither it nor what follows from places
        // alone need wait to be told.
        let looked =
            || orientation_unknown.then(|| orientation::seen(&voxels, !self.merged.normals.is_empty()));
        let filtered = || {
            let mut cloud = denoising::bilateral(&voxels.cloud, &scale.bilateral());
            let excluded = cloud.split_off(work);
            let reach_mm = INDEX_VOXELS * voxels.edge_mm;
            let index = Grid::new(&cloud.points_mm, reach_mm);
            let asymmetries = edges::asymmetries(&index, reach_mm);
            (cloud, excluded, index, asymmetries)
        };
        let (mut oriented, (mut cloud, mut excluded, index, asymmetries)) =
            stages.stage("denoising", || rayon::join(looked, filtered));
        if let Some(oriented) = &mut oriented {
            voxels.turn(oriented.normals.clone());
            excluded.normals = oriented.normals.split_off(work);
            oriented.unknown.truncate(work);
            cloud.normals.clone_from(&oriented.normals);
        }
        let table_shown = orientation_unknown && support::is_table_shown(&voxels);
        let whole = self.excluded.map(|_| {
            let mut all = cloud.clone();
            all.append(excluded);
            let work = voxels.first(work);
            (std::mem::replace(&mut voxels, work), all)
        });
        let model = Model { voxels, cloud, index, asymmetries, whole, oriented, table_shown };
        let (thinned, filtered) = model.scene();
        stages.observer.cloud("downsampling", &thinned.cloud);
        stages.observer.cloud("denoising", filtered);
        model
    }

    /// Whether larger voxels have nothing to add. Views that show a whole scene without a seam at their own scale
    /// show none.
    fn settles(&self, result: &ScaleResult) -> bool {
        if self.method == Method::Weldpath && self.mesh().is_some() {
            return true;
        }
        if result.found.seams.is_empty() {
            self.raw_scan().has_whole_views()
        } else {
            self.method != Method::Weldpath || !result.is_weak()
        }
    }
}

impl ScaleResult {
    /// Takes what became of a wish for a seam; the words if it is not met.
    fn take(&mut self, places_mm: &[Point3<f64>], answer: Answer) -> Option<String> {
        let ends = ends(places_mm);
        match answer {
            Answer::Found(seam) => {
                let reason = format!("{}; asked for between {ends}", seam.reason);
                self.push(Seam { reason, ..*seam });
                None
            }
            Answer::Known(id) => {
                let words = format!(
                    "the seam that was asked for between {ends} is seam {id}, which is found without asking"
                );
                self.found.warnings.push(words);
                None
            }
            Answer::Nothing(why) => {
                Some(format!("no seam is added between {ends}, where one was asked for: {why}"))
            }
        }
    }

    /// Puts a seam behind all others, with a number of its own.
    fn push(&mut self, seam: Seam) {
        let id = self.found.seams.iter().map(|seam| seam.id).max().unwrap_or(0) + 1;
        self.found.seams.push(Seam { id, ..seam });
    }

    /// A seam, if it is known on which side of its faces the air is; as sure as that is.
    ///
    /// # Errors
    /// In words, if it is not.
    fn sided(&self, seam: Seam) -> Result<Seam, String> {
        let Some(oriented) = &self.model.oriented else { return Ok(seam) };
        let mut one = Found { seams: vec![seam], ..Found::default() };
        one.only_oriented(oriented, &self.model.surface());
        one.seams.pop().ok_or(one.reason)
    }

    /// Of all its seams, mm.
    fn length_mm(&self) -> f64 {
        self.found.seams.iter().map(Seam::length_mm).sum()
    }

    /// Whether corners show that are not sure enough to be seams.
    fn is_unsure(&self) -> bool {
        self.found.unsure_mm() > WEAK_VOXELS * f64::from(self.scale.edge_mm)
    }

    /// Whether only scraps show, as of a blurred valley in voxels that are too small.
    fn is_weak(&self) -> bool {
        let longest_mm = self.found.seams.iter().map(Seam::length_mm).fold(0.0, f64::max);
        longest_mm < WEAK_VOXELS * f64::from(self.scale.edge_mm)
    }
}

/// Both ends of a line, in words.
fn ends(places_mm: &[Point3<f64>]) -> String {
    let place = |p: &Point3<f64>| format!("{:.0},{:.0},{:.0}", p.x, p.y, p.z);
    [places_mm.first(), places_mm.last()].map(|p| p.map(place).unwrap_or_default()).join(" and ")
}

/// The larger voxels that are tried until seams show: blurred or quantised clouds show theirs only in these.
fn coarser(first: &Scale) -> Vec<Scale> {
    let mut scales = vec![*first];
    let edges_mm = [COARSER * first.edge_mm, COARSEST_MM];
    for edge_mm in edges_mm.into_iter().filter(|edge| *edge <= COARSEST_MM) {
        if scales.last().is_some_and(|last| edge_mm > ANOTHER_SIZE * last.edge_mm) {
            scales.push(first.coarser(edge_mm / first.edge_mm));
        }
    }
    scales.split_off(1)
}
