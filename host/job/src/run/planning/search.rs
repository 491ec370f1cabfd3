//! What decides which seams are found in a scan, and the search itself, which is given nothing else.

use std::fmt::Debug;
use std::sync::Arc;

use crate::run::job::Job;
use crate::run::job::touch::TouchSettings;
use crate::run::kept::{self, Digest, Key};
use crate::run::verdict;
use weldpath_method::geometry::cloud::View;
use weldpath_method::input::{CloudFrame, Scan};
use weldpath_method::pipeline::touch::{self, Touch};
use weldpath_method::pipeline::{self, Observer, Plan, PlanError};

/// Said of a scan whose cameras nobody knows.
const UNUSED_CALIBRATION: &str = "the calibration is not used: it is unknown where the camera was, or whether the coordinates are in the \
     robot's base frame";

/// All that a job says of how seams are found. The search knows no job: what is not here cannot change what it finds, and
/// what is here is in its key.
#[derive(Debug, Clone)]
pub struct Search {
    /// Without the background, which is part of the scan.
    config: pipeline::Config,
    touches: Vec<Touch>,
    /// What is said of settings that do not apply.
    unused: Option<&'static str>,
}

/// The key of what this program finds in a scan if it is told this.
fn key(scan: Key, told: &impl Debug) -> Key {
    let mut digest = Digest::default();
    digest.shown(&kept::program());
    digest.key(scan);
    digest.shown(told);
    digest.end()
}

impl Search {
    /// As the job says it of a scan in this frame.
    pub fn new(job: &Job, frame: CloudFrame) -> Self {
        let mut config = job.pipeline();
        let mut unused = None;
        if frame != CloudFrame::Base {
            // Coordinates that are not the robot's have no error in its base frame.
            config.merge.anchor = None;
            unused = config.merge.calibration.take().map(|_| UNUSED_CALIBRATION);
        }
        Self { config, touches: job.touches.iter().map(TouchSettings::touch).collect(), unused }
    }

    /// The key of what is found in the scan that has the key `scan`.
    pub fn key(&self, scan: Key) -> Key {
        key(scan, self)
    }

    /// The same of its views merged.
    pub(super) fn merge_key(&self, scan: Key) -> Key {
        key(scan, &(self.config.method, &self.config.merge))
    }

    /// The same of the seams that show without asking.
    pub(super) fn survey_key(&self, scan: Key) -> Key {
        key(scan, &(self.config.method, &self.config.merge, &self.config.search))
    }

    /// What the pipeline is told of a scan.
    pub(super) fn config(&self, scan: &Scan) -> pipeline::Config {
        let mut config = self.config.clone();
        config.search.exclusion.background = Arc::clone(&scan.background);
        config
    }

    /// Whether the scan is planned a second time, elsewhere.
    pub(super) fn is_touched(&self) -> bool {
        !self.touches.is_empty()
    }

    /// All seams of a scan.
    ///
    /// # Errors
    /// If there is none, or the observer wants no more.
    pub fn run(&self, scan: &Scan, observer: &mut dyn Observer) -> Result<Plan, PlanError> {
        let config = self.config(scan);
        let mut plan = pipeline::plan(&scan.views, &config, observer)?;
        if self.is_touched() {
            plan = self.touched(&plan, scan, config, observer)?;
        }
        Ok(self.with_words_of(scan, plan))
    }

    /// With what the scan itself gives to say.
    pub(super) fn with_words_of(&self, scan: &Scan, mut plan: Plan) -> Plan {
        let unused = self.unused.map(str::to_owned);
        plan.said.warnings.splice(0..0, scan.warnings.iter().cloned().chain(unused));
        verdict::lower_confidence(&mut plan, scan);
        plan
    }

    /// The plan of the same scan where the tip touched it: all poses are moved, and it is planned anew, so that everything which
    /// hangs on places says the same.
    fn touched(
        &self,
        plan: &Plan,
        scan: &Scan,
        mut config: pipeline::Config,
        observer: &mut dyn Observer,
    ) -> Result<Plan, PlanError> {
        if scan.frame == CloudFrame::Camera {
            return Err(touch::Error::NoBaseFrame.into());
        }
        let touched = touch::fit(plan, &self.touches)?;
        let moved = |view: &View| View {
            base_from_camera: touched.base_from_planned * view.base_from_camera,
            ..view.clone()
        };
        let views: Vec<View> = scan.views.iter().map(moved).collect();
        config.search.exclusion.background = scan.background.iter().map(moved).collect();
        let mut plan = pipeline::plan(&views, &config, observer)?;
        touched.settle(&mut plan);
        Ok(plan)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn key_of(text: &str, frame: CloudFrame) -> Key {
        let job = Job::parse(text, Path::new("job.toml")).unwrap();
        Search::new(&job, frame).key(Digest::default().end())
    }

    #[test]
    fn what_the_pipeline_is_told_is_in_the_key_and_how_seams_are_welded_is_not() {
        let plain = key_of("", CloudFrame::Base);
        for text in [
            "[path]\nfeed_mm_s = 5\nstandoff_mm = 12",
            "formats = [\"abb\"]",
            "accept = [\"units\"]",
            "[order]\nsequence = \"found\"",
            "[[seam]]\nnear_mm = [1, 2, 3]\npath.direction = \"reverse\"",
            "[robot]\nmodel = \"ur10e\"",
            "[selection]\nseams = [1]",
            "[weave]\nshape = \"sine\"",
            "[arc]\noutput = 3",
        ] {
            assert_eq!(plain, key_of(text, CloudFrame::Base), "{text}");
        }
        for text in [
            "method = \"paper\"",
            "method = \"paper\"\nratio_threshold = 60",
            "[scan]\nanchor = \"first\"",
            "[[exclude.half_space]]\nat_mm = [0, 0, 1]\ntoward = [0, 0, 1]",
            "[exclude]\nboxes_mm = [[[0, 0, 0], [1, 1, 1]]]",
            "[exclude]\nboxes_mm = [[[0, 0, 0], [1, 1, 1.0000001]]]",
            "[[touch]]\nat_mm = [1, 2, 3]",
            "[[ask]]\nbetween_mm = [[0, 0, 0], [10, 0, 0]]",
        ] {
            assert_ne!(plain, key_of(text, CloudFrame::Base), "{text}");
        }
        assert_ne!(plain, key_of("", CloudFrame::Camera), "the anchor does not apply");
    }
}
