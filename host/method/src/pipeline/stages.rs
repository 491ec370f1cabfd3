//! The stages of a plan as they pass: who watches them, and how long each took.

use super::result::PlanError;
use crate::cancellation::Worker;
use crate::geometry::cloud::{Merged, PointCloud};
use crate::geometry::grid::Grid;
use crate::model::downsampling::Voxels;
use crate::seam::Unwelded;
use crate::seam::segmentation::Segmentation;
use std::borrow::Cow;
use std::sync::Arc;
use std::time::Instant;

/// What the seams were sought in, for those who draw it.
#[derive(Debug, Clone, Copy)]
pub struct Evidence<'a> {
    /// All registered views, raw.
    pub merged: &'a Merged,
    /// Spatial index of its points.
    pub raw: &'a Grid,
    /// The thinned cloud, before the filter.
    pub voxels: &'a Voxels,
    /// The same after it, in the same order.
    pub model: &'a PointCloud,
    /// Spatial index of the model.
    pub index: &'a Grid,
    /// Edge intensity of each point of the model.
    pub intensity: &'a [f32],
    /// Its surfaces, where they were asked for.
    pub segmentation: Option<&'a Segmentation>,
    /// What looked like a seam and is none that could be welded: each with its place and why.
    pub rejected: &'a [String],
    /// Inside corners that are seen and are no seams.
    pub unwelded: &'a [Unwelded],
}

/// Sees every stage as it finishes; `()` is an observer that does nothing.
pub trait Observer {
    /// A stage begins; `name` is the name of its module.
    fn stage(&mut self, name: &'static str) {
        let _ = name;
    }
    /// The cloud after a stage.
    fn cloud(&mut self, stage: &'static str, cloud: &PointCloud) {
        let _ = (stage, cloud);
    }
    /// What seams were searched in, whether or not any was found: called once, when the size of the voxels is settled.
    fn evidence(&mut self, evidence: &Evidence) {
        let _ = evidence;
    }
    /// Whether nobody waits for the plan any more; asked between stages and about twenty times a second, on the thread that
    /// asked for the plan.
    fn is_done(&self) -> bool {
        false
    }
}

impl Observer for () {}

/// Wall time of each stage, seconds.
pub(super) type Times = Vec<(Cow<'static, str>, f64)>;

/// A step that is done, and how long the stages up to it took.
pub struct Step<T> {
    done: Arc<T>,
    times: Times,
}

impl<T> Clone for Step<T> {
    fn clone(&self) -> Self {
        Self { done: Arc::clone(&self.done), times: self.times.clone() }
    }
}

/// The stages that have passed, and who watches them.
pub struct Stages<'a> {
    pub(super) observer: &'a mut dyn Observer,
    pub(super) times: Times,
    worker: Worker,
}

impl<'a> Stages<'a> {
    /// None has passed.
    pub fn new(observer: &'a mut dyn Observer) -> Self {
        Self { observer, times: Times::new(), worker: Worker::default() }
    }

    /// Does the work of a stage, and tells the observer before. It unwinds if the observer wants no more, as
    /// [`cancellation`](crate::cancellation) says.
    pub fn stage<T: Send>(&mut self, name: &'static str, work: impl FnOnce() -> T + Send) -> T {
        self.observer.stage(name);
        self.time(name, work)
    }

    /// Does the work of a part of one; it unwinds, too.
    pub(super) fn time<T: Send>(&mut self, stage: &'static str, work: impl FnOnce() -> T + Send) -> T {
        let (begin, observer) = (Instant::now(), &*self.observer);
        let done = self.worker.run(|| observer.is_done(), work);
        let spent = begin.elapsed().as_secs_f64();
        match self.times.iter_mut().find(|(name, _)| name == stage) {
            Some((_, total)) => *total += spent,
            None => self.times.push((stage.into(), spent)),
        }
        done
    }

    /// Whether the plan is still wanted.
    pub(super) fn go_on(&self) -> Result<(), PlanError> {
        if self.observer.is_done() { Err(PlanError::GivenUp) } else { Ok(()) }
    }

    /// A step that was kept, or else its work, which is kept.
    pub(super) fn keep<T>(
        &mut self,
        kept: &mut Option<Step<T>>,
        work: impl FnOnce(&mut Self) -> Result<T, PlanError>,
    ) -> Result<Arc<T>, PlanError> {
        if let Some(Step { done, times }) = kept {
            self.times.clone_from(times);
            return Ok(Arc::clone(done));
        }
        let done = Arc::new(work(self)?);
        *kept = Some(Step { done: Arc::clone(&done), times: self.times.clone() });
        Ok(done)
    }
}
