//! Run time of the whole chain, from the files of a scan to the files of a program, on the 500 mm V butt.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use super::Error;
use weldpath_job::output::summary::Source;
use weldpath_job::run::job::Job;
use weldpath_job::run::postprocessing::postprocess;
use weldpath_method::{input, pipeline};
use weldpath_sim::simulation;
use weldpath_sim::simulation::{Part, Pose, Request};

/// Length of the seam, mm.
const LENGTH_MM: f64 = 500.0;

/// One row of the paper's Table II.
#[derive(Debug, Serialize)]
pub struct Row {
    /// How the piece lies.
    pub pose: &'static str,
    /// Views of the scan.
    pub views: usize,
    /// Runs.
    pub runs: usize,
    /// Mean, ms.
    pub mean_ms: f64,
    /// Fastest and slowest, ms.
    pub range_ms: [f64; 2],
    /// Length that was found over the mean run time.
    pub speed_mm_s: f64,
    /// Length of the seams that were found, mm; 0 if none was.
    pub found_mm: f64,
}

/// Four poses, from one view and from six.
pub(super) fn table(runs: usize, home: &Path, begin: &mut dyn FnMut(&str)) -> Result<Vec<Row>, Error> {
    let poses = [
        ("flat", Pose::Flat),
        ("tilted", Pose::Tilted),
        ("horizontal", Pose::Horizontal),
        ("vertical", Pose::Vertical),
    ];
    let mut rows = Vec::new();
    for views in [1, 6] {
        for (name, pose) in poses {
            begin(&format!("V butt, {name}, {views} views"));
            let folder = home.join(format!("{name}{views}"));
            let request = Request {
                pose,
                views: Some(views),
                length_mm: Some(LENGTH_MM),
                ..Request::new(Part::ButtV, 1)
            };
            simulation::write(&simulation::simulate(&request)?, &folder)?;
            rows.push(row(name, views, runs, &folder)?);
        }
    }
    Ok(rows)
}

fn row(pose: &'static str, views: usize, runs: usize, folder: &Path) -> Result<Row, Error> {
    let (mut times, mut found_mm) = (Vec::new(), 0.0);
    for _ in 0..runs.max(1) {
        let begin = Instant::now();
        found_mm = run(folder)?;
        times.push(1e3 * begin.elapsed().as_secs_f64());
    }
    let mean_ms = times.iter().sum::<f64>() / times.len() as f64;
    let range_ms =
        [times.iter().copied().fold(f64::INFINITY, f64::min), times.iter().copied().fold(0.0, f64::max)];
    Ok(Row {
        pose,
        views,
        runs: times.len(),
        mean_ms,
        range_ms,
        speed_mm_s: 1e3 * found_mm / mean_ms,
        found_mm,
    })
}

/// Reads, plans and makes all files, without writing them; the length that was found.
fn run(folder: &Path) -> Result<f64, Error> {
    let job = Job::default();
    let scan = input::read(folder, &input::Options::default())?;
    let Ok(plan) = pipeline::plan(&scan.views, &job.pipeline(), &mut ()) else { return Ok(0.0) };
    let output = postprocess(&plan, &job, Source::default());
    let paths = output.map(|output| output.paths).unwrap_or_default();
    Ok(paths.iter().map(weldpath_method::weld::SeamPath::length_mm).sum())
}
