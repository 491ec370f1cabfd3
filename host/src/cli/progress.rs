//! What the user sees, and what is kept, while a plan is made.

use std::io::IsTerminal;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use weldpath::files::File;
use weldpath::geometry::cloud::PointCloud;
use weldpath::output::frame::PathFrame;
use weldpath::output::ply;
use weldpath::pipeline::{Evidence, Observer};
use weldpath::report::Recording;
use weldpath::run::planning::PASSED;

use super::tell;

/// Moves a bar on a terminal, says elsewhere which stage takes long, and collects what is asked for: the cloud after every
/// stage, what the report shows.
pub(super) struct Progress {
    bar: ProgressBar,
    still: Option<StillThere>,
    began: Instant,
    stages: Option<Vec<File>>,
    recording: Option<Recording>,
    has_begun: bool,
}

impl Progress {
    /// No bar when quiet or when standard error is not a terminal.
    pub(super) fn new(quiet: bool, dump_stages: bool, report: bool) -> Self {
        let bar = bar(quiet, 100, "{bar:24} {elapsed:>4} {msg}");
        let recording = report.then(Recording::default);
        let still = (!quiet).then(|| StillThere::new(bar.clone()));
        let stages = dump_stages.then(Vec::new);
        Self { bar, still, began: Instant::now(), stages, recording, has_begun: false }
    }

    /// Whether a stage has begun.
    pub(super) fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Hands over what the report shows, if one is wanted.
    pub(super) fn take_recording(&mut self) -> Option<Recording> {
        self.recording.as_mut().map(std::mem::take)
    }

    /// Takes the bar away and hands over the collected clouds, and what the report shows.
    pub(super) fn finish(mut self) -> (Vec<File>, Option<Recording>) {
        drop(self.still.take());
        self.bar.finish_and_clear();
        (self.stages.unwrap_or_default(), self.recording)
    }
}

/// No stage is silent for longer.
const SILENT: Duration = Duration::from_millis(1900);

/// Tells that a stage goes on: the clock of the bar on a terminal, a line elsewhere.
struct StillThere {
    stages: Option<Sender<&'static str>>,
    thread: Option<JoinHandle<()>>,
}

impl StillThere {
    fn new(bar: ProgressBar) -> Self {
        let (stages, begun) = channel::<&'static str>();
        let tell = move || {
            let (mut stage, mut since) = ("scan", Instant::now());
            let mut told = since;
            loop {
                match begun.recv_timeout(SILENT.saturating_sub(told.elapsed())) {
                    Ok(next) if next == stage => {}
                    Ok(next) => (stage, since, told) = (next, Instant::now(), Instant::now()),
                    Err(RecvTimeoutError::Timeout) => {
                        told = Instant::now();
                        match bar.is_hidden() {
                            true => tell(&format!("{stage}: {:.0} s", since.elapsed().as_secs_f64())),
                            false => bar.tick(),
                        }
                    }
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            }
        };
        // Without a thread there is silence.
        let thread = std::thread::Builder::new().name("progress".into()).spawn(tell).ok();
        Self { stages: Some(stages), thread }
    }

    fn stage(&self, name: &'static str) {
        // The thread lives as long as its sender.
        let _ = self.stages.as_ref().map(|stages| stages.send(name));
    }
}

impl Drop for StillThere {
    fn drop(&mut self) {
        drop(self.stages.take());
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// What is left if the rest takes as long as usual.
fn left(elapsed: Duration, passed_percent: u64) -> String {
    match passed_percent {
        0 => String::new(),
        passed => {
            let left_s = elapsed.as_secs_f64() * (100.0 / passed as f64 - 1.0);
            format!(", about {left_s:.0} s left")
        }
    }
}

/// A bar of `length` on a terminal; none when quiet or when standard error is not one.
pub(super) fn bar(quiet: bool, length: u64, template: &str) -> ProgressBar {
    let shown = !quiet && std::io::stderr().is_terminal();
    let bar = if shown { ProgressBar::new(length) } else { ProgressBar::hidden() };
    let style = ProgressStyle::with_template(template).unwrap_or(bar.style());
    bar.set_style(style);
    bar
}

impl Observer for Progress {
    fn stage(&mut self, name: &'static str) {
        self.has_begun = true;
        self.still.iter().for_each(|still| still.stage(name));
        // A finer scale begins some stages again: the bar does not go back.
        let usual = PASSED.iter().find(|(stage, _)| *stage == name).map_or(0, |(_, percent)| *percent);
        let passed = usual.max(self.bar.position());
        self.bar.set_position(passed);
        self.bar.set_message(format!("{name}{}", left(self.began.elapsed(), passed)));
        self.bar.tick();
    }

    fn cloud(&mut self, stage: &'static str, cloud: &PointCloud) {
        if let Some(stages) = &mut self.stages {
            let name = format!("stages/{:02}-{stage}.ply", stages.len() + 1);
            stages.push(File::new(name, ply::write(cloud, PathFrame::Unknown)));
        }
    }

    fn evidence(&mut self, evidence: &Evidence) {
        if let Some(recording) = &mut self.recording {
            *recording = Recording::of(evidence);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_follows_from_the_share_that_has_passed() {
        assert_eq!(left(Duration::from_secs(2), 0), "");
        assert_eq!(left(Duration::from_secs(3), 60), ", about 2 s left");
        assert!(PASSED.windows(2).all(|w| w[0].1 < w[1].1), "no stage takes the bar back");
    }
}
