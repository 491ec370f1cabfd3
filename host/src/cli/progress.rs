//! What the user sees, and what is kept, while a plan is made.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};
use weldpath::cloud::PointCloud;
use weldpath::export::directory::File;
use weldpath::export::ply;
use weldpath::pipeline::{Evidence, Observer};
use weldpath::report::Recording;

/// Stages of a multi-view scan, reading and writing included; a bar that is wrong by one still tells the way.
const USUAL_STAGES: u64 = 8;

/// Moves a bar on a terminal, and collects what is asked for: the cloud after every stage, what the report shows.
pub(super) struct Progress {
    bar: ProgressBar,
    stages: Option<Vec<File>>,
    recording: Option<Recording>,
}

impl Progress {
    /// No bar when quiet or when standard error is not a terminal.
    pub(super) fn new(quiet: bool, dump_stages: bool, report: bool) -> Self {
        let shown = !quiet && std::io::stderr().is_terminal();
        let bar = if shown { ProgressBar::new(USUAL_STAGES) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{bar:24} {elapsed:>4} {msg}").unwrap_or(bar.style());
        bar.set_style(style);
        Self { bar, stages: dump_stages.then(Vec::new), recording: report.then(Recording::default) }
    }

    /// Takes the bar away and hands over the collected clouds, and what the report shows.
    pub(super) fn finish(self) -> (Vec<File>, Option<Recording>) {
        self.bar.finish_and_clear();
        (self.stages.unwrap_or_default(), self.recording)
    }
}

impl Observer for Progress {
    fn stage(&mut self, name: &'static str) {
        if self.bar.position() + 1 >= USUAL_STAGES {
            self.bar.inc_length(1);
        }
        self.bar.inc(1);
        self.bar.set_message(name);
        self.bar.tick();
    }

    fn cloud(&mut self, stage: &'static str, cloud: &PointCloud) {
        if let Some(stages) = &mut self.stages {
            let name = format!("stages/{:02}-{stage}.ply", stages.len() + 1);
            stages.push(File::new(name, ply::write(cloud)));
        }
    }

    fn evidence(&mut self, evidence: &Evidence) {
        if let Some(recording) = &mut self.recording {
            *recording = Recording::of(evidence);
        }
    }
}
