//! The method on one page: the paper's Fig. 1 from views to torch paths.

pub mod background;
pub mod calibration;
mod config;
pub mod exclusion;
mod merged;
mod reconstruction;
mod result;
mod scale_search;
mod sparse;
mod stages;
mod survey;
pub mod tacks;
pub mod touch;

use self::exclusion::Scene;
use self::reconstruction::Reconstruction;
use crate::cancellation::unless_given_up;
use crate::geometry::cloud::View;
use crate::geometry::grid::Grid;
use crate::seam::Found;
use crate::seam::measure::coverage;
use crate::weld::SeamPath;
use rayon::prelude::*;

pub use self::config::{Config, MergeConfig, Method, RATIO_THRESHOLD, SearchConfig, Wishes};
pub use self::merged::MergedViews;
pub use self::result::{Derivation, Parameter, Plan, PlanError, Remarks};
pub use self::stages::{Evidence, Observer, Stages, Step};
pub use self::survey::Survey;
pub use crate::model::agreement::{HandEyeError, Misfit, ViewReport};
pub use crate::model::base_frame::{
    Anchor, BaseFrame, Calibration, CameraFinding, CellAccuracy, HandEyeCorrection,
};
pub use crate::model::camera::CameraErrors;

/// Cells in which the raw points are looked up, mm: what seams and their surroundings ask for is a few times as large.
pub const RAW_CELL_MM: f32 = 5.0;

/// From views to torch paths: the paper's Fig. 1 step by step.
///
/// ```
/// use std::path::Path;
/// use weldpath_method::{input, pipeline};
///
/// // A level plate of 40 by 40 mm and nothing on it: no seam, and a reason why.
/// let rows = (0..1600).map(|i| format!("{} {} {}\n", i % 40, i / 40, 0.001 * f64::from(i % 7)));
/// let bytes = rows.collect::<String>().into_bytes();
/// let options = input::Options { units: input::Units::Millimetres, ..Default::default() };
/// let scan = input::read_bytes(bytes, Path::new("plate.xyz"), &options)?;
/// let planned = pipeline::plan(&scan.views, &pipeline::Config::default(), &mut ());
/// assert!(planned.unwrap_err().to_string().starts_with("no seam found: "));
/// # Ok::<(), input::Error>(())
/// ```
pub fn plan(views: &[View], config: &Config, observer: &mut dyn Observer) -> Result<Plan, PlanError> {
    plan_from(&mut Kept::default(), views, config, observer)
}

/// As [`plan`], from the steps that an earlier plan of the same views left in `kept`; it leaves its own there, even if it fails.
/// A step may be kept as long as its settings and those of the steps before it are the same.
pub fn plan_from(
    kept: &mut Kept,
    views: &[View],
    config: &Config,
    observer: &mut dyn Observer,
) -> Result<Plan, PlanError> {
    // What is merged already needs them no more, and whoever kept it may have let them go.
    if kept.merged.is_none() {
        check(views)?;
    }
    let stages = &mut Stages::new(observer);
    unless_given_up(|| steps(kept, views, config, stages)).unwrap_or(Err(PlanError::GivenUp))
}

/// Refuses views that no reader makes; whoever fills them in by hand may.
fn check(views: &[View]) -> Result<(), PlanError> {
    let wrong = |view: usize, problem: String| Err(PlanError::NoView { view, problem });
    if views.is_empty() {
        return wrong(0, "there is none".into());
    }
    if views.len() > usize::from(u16::MAX) {
        return wrong(views.len(), format!("a plan can use at most {} views", u16::MAX));
    }
    for (k, view) in views.iter().enumerate() {
        let View { points_mm, normals, base_from_camera: pose, .. } = view;
        if points_mm.is_empty() {
            return wrong(k, "it has no point".into());
        }
        if !normals.is_empty() && normals.len() != points_mm.len() {
            return wrong(k, format!("{} normals for {} points", normals.len(), points_mm.len()));
        }
        let is_finite = points_mm.par_iter().all(|point| point.iter().all(|c| c.is_finite()));
        let is_posed = pose.to_homogeneous().iter().all(|number| number.is_finite());
        if !is_finite || !is_posed {
            return wrong(k, "a coordinate or its pose is not finite".into());
        }
    }
    Ok(())
}

fn steps(kept: &mut Kept, views: &[View], config: &Config, stages: &mut Stages) -> Result<Plan, PlanError> {
    let Config { method, merge, search, wishes } = config;

    let merged = stages.keep(&mut kept.merged, |stages| {
        let reconstruction = Reconstruction::new(views, *method, merge, stages)?; // II-C, eqs. (1)-(9), (20)
        Ok(MergedViews::new(reconstruction, &merge.downsampling, stages))
    })?;
    let survey = stages.keep(&mut kept.survey, |stages| {
        let scene = stages.time("exclusion", || Scene::new(&merged, &search.exclusion, *method, merge))?;
        let raw = stages.time("index", || Grid::new(&scene.work(&merged.cloud).points_mm, RAW_CELL_MM));
        let sought = merged.search(&scene, &raw, *method, search);
        let (result, ground) = tacks::sought_without(&sought, &merged.scale, stages)?; // II-D, II-E, eqs. (10)-(17)
        Ok(Survey { scene, raw, ground, result })
    })?;

    let sought = survey.search(&merged, *method, search);
    let mut result = survey.result.clone();
    let (unmet, undrawn) = sought.grant(wishes, &mut result, stages);
    survey.scene.trim(&mut result.found, &merged.views);
    survey.scene.show(&merged.cloud, &result, sought.raw, stages.observer);
    if result.found.seams.is_empty() {
        if let Some(words) = sparse::words(&survey.raw) {
            return Err(PlanError::TooSparse { reason: survey.scene.reason(&merged.cloud, words) });
        }
        let reason = [vec![result.found.reason], unmet, undrawn].concat().join("; ");
        return Err(result::no_seam(survey.scene.reason(&merged.cloud, reason)));
    }
    let seams = &result.found.seams;
    let paths = stages.stage("toolpath", || seams.iter().map(SeamPath::along).collect()); // II-F
    let gaps = || coverage::gaps(seams, sought.merged, sought.raw, sought.cameras_known());
    let coverage = stages.time("coverage", gaps);
    let one_sided = coverage::one_sided(seams, sought.merged, sought.raw, sought.cameras_known());
    let tacks = survey.tacks(seams);
    let said = Remarks { warnings: survey.warnings(&merged, &result, &tacks, &coverage), unmet, undrawn };
    let derived = survey.derived(&merged, &result, &stages.times);
    let model = result.model.scene().1.clone();
    let Found { seams, unwelded, .. } = result.found;
    Ok(Plan { model, seams, unwelded, paths, coverage, one_sided, tacks, derived, said, ..Plan::default() })
}

/// The steps of a plan that the next one may go on from; they are as large as the scan.
#[derive(Clone, Default)]
pub struct Kept {
    /// Depends on [`Config::method`] and [`Config::merge`].
    pub merged: Option<Step<MergedViews>>,
    /// Depends on [`Config::search`] as well.
    pub survey: Option<Step<Survey>>,
}
