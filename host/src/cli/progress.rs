//! What the user sees, and what is kept, while a plan is made.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};
use weldpath::cloud::PointCloud;
use weldpath::export::directory::File;
use weldpath::export::ply;
use weldpath::pipeline::Observer;

/// Stages of a multi-view scan, reading and writing included; a bar that is wrong by one still tells the way.
const USUAL_STAGES: u64 = 8;

/// Moves a bar on a terminal, and collects the cloud after every stage if it was asked for.
pub(super) struct Progress {
    bar: ProgressBar,
    stages: Option<Vec<File>>,
}

impl Progress {
    /// No bar when quiet or when standard error is not a terminal.
    pub(super) fn new(quiet: bool, dump_stages: bool) -> Self {
        let shown = !quiet && std::io::stderr().is_terminal();
        let bar = if shown { ProgressBar::new(USUAL_STAGES) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{bar:24} {elapsed:>4} {msg}").unwrap_or(bar.style());
        bar.set_style(style);
        Self { bar, stages: dump_stages.then(Vec::new) }
    }

    /// Takes the bar away and hands over the collected clouds.
    pub(super) fn finish(self) -> Vec<File> {
        self.bar.finish_and_clear();
        self.stages.unwrap_or_default()
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
}
