//! The paper's section III, measured again: fitness over iterations, F1 over the threshold before and after the filter, RMSE,
//! run time, interaction time; each beside what the paper reports.
//!
//! The cylinder is the pipe of `fixtures/`; the Y shape and the 500 mm V butt are simulated, seed 1, as the fixtures were.
//! The scans are ours, not the paper's: what is compared is the method, not the workpiece.

mod chart;
mod page;
mod published;
mod runtime;
mod threshold;

use std::path::{Path, PathBuf};

use serde::Serialize;

use weldpath_core::pendant::JOG_LIMITS;
use weldpath_files::File;
use weldpath_job::output::csv;
use weldpath_job::output::frame::PathFrame;
use weldpath_job::output::summary::Source;
use weldpath_job::run::job::Job;
use weldpath_job::run::postprocessing;
use weldpath_job::run::postprocessing::postprocess;
use weldpath_method::input;
use weldpath_method::pipeline::{self, Plan};
use weldpath_pendant::teleop;
use weldpath_pendant::teleop::{Twin, generator};
use weldpath_sim::evaluation;
use weldpath_sim::evaluation::{PathSet, Score, Target, Truth, paper_rmse, score};
use weldpath_sim::simulation;
use weldpath_sim::simulation::{Part, Request};

/// Where the pieces come from, and how often the run time is measured.
#[derive(Debug, Clone)]
pub struct Options {
    /// The folder `fixtures/` of the repository.
    pub fixtures: PathBuf,
    /// Runs per row of the run-time table; the paper's is 20.
    pub runs: usize,
}

/// Why the comparison was not made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A fixture or a simulated scan cannot be read.
    #[error(transparent)]
    Scan(#[from] input::Error),
    /// A truth cannot be read.
    #[error(transparent)]
    Truth(#[from] evaluation::Error),
    /// A scan cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] simulation::Error),
    /// No seam where there must be one.
    #[error("{piece}: {source}")]
    Plan {
        /// Name of the piece.
        piece: String,
        /// Why.
        source: pipeline::PlanError,
    },
    /// A plan leads to no files.
    #[error(transparent)]
    Files(#[from] postprocessing::Error),
    /// No place for the simulated scans.
    #[error("no temporary folder: {0}")]
    Temporary(std::io::Error),
    /// The interaction cannot be simulated.
    #[error("the hand-guided tour of the camera cannot be made")]
    Hands,
}

/// Everything that was measured.
#[derive(Debug, Serialize)]
pub struct Comparison {
    /// One per piece of the paper: cylinder, Y shape.
    pub fitness: Vec<Fitness>,
    /// The same pieces.
    pub f1: Vec<threshold::Curves>,
    /// The same pieces, then the other fixtures.
    pub rmse: Vec<Accuracy>,
    /// Four poses, from one view and from six.
    pub runtime: Vec<runtime::Row>,
    /// Straight motions, then rotation.
    pub interaction: Vec<Interaction>,
}

/// Fitness of all views but the first, before and after each iteration: the mean.
#[derive(Debug, Serialize)]
pub struct Fitness {
    /// Name of the piece.
    pub piece: String,
    /// From iteration 0.
    pub values: Vec<f64>,
}

/// One row of the paper's Table I.
#[derive(Debug, Serialize)]
pub struct Accuracy {
    /// Name of the piece.
    pub piece: String,
    /// Points along the seams as they were found.
    pub detected: usize,
    /// Points after interpolation.
    pub interpolated: usize,
    /// RMSE of the lateral distance, mm; what `weldpath evaluate` prints.
    pub rmse_mm: Option<f64>,
    /// RMSE of the orientation, degrees; the same.
    pub rmse_deg: Option<f64>,
    /// The paper's own RMSE of `m_i - g_i`, mm, of the worst seam: along the seam as well as across it.
    pub paper_rmse_mm: Option<f64>,
}

/// Time from a hand frame to the camera's new pose.
#[derive(Debug, Serialize)]
pub struct Interaction {
    /// What the hand asks for.
    pub motion: &'static str,
    /// Frames.
    pub frames: usize,
    /// Mean, ms.
    pub mean_ms: f64,
}

/// A piece with its truth.
struct Piece {
    name: String,
    scan: input::Scan,
    truth: Truth,
}

/// Measures everything; `begin` is told what is being done.
pub fn measure(settings: &Options, begin: &mut dyn FnMut(&str)) -> Result<Comparison, Error> {
    let home = tempfile::tempdir().map_err(Error::Temporary)?;
    let mut pieces = vec![
        fixture("cylinder (fixtures/pipe)", &settings.fixtures.join("pipe"))?,
        simulated("Y-shaped (simulated)", &Request::new(Part::Branch, 1), &home.path().join("branch"))?,
    ];
    for name in ["fillet", "lap", "butt-v"] {
        pieces.push(fixture(name, &settings.fixtures.join(name))?);
    }
    let (mut fitness, mut f1, mut rmse) = (Vec::new(), Vec::new(), Vec::new());
    for (k, piece) in pieces.iter().enumerate() {
        begin(&piece.name);
        let plan = planned(&piece.name, &piece.scan)?;
        if k < 2 {
            fitness.push(Fitness { piece: piece.name.clone(), values: mean_fitness(&plan) });
            f1.push(threshold::curves(piece, &plan));
        }
        rmse.push(accuracy(piece, &plan)?);
    }
    let runtime = runtime::table(settings.runs, home.path(), begin)?;
    begin("interaction");
    Ok(Comparison { fitness, f1, rmse, runtime, interaction: interaction()? })
}

impl Comparison {
    /// `paper.html` and `paper.md` with their figures, and `paper.json` with every number.
    pub fn files(&self) -> Vec<File> {
        page::files(self)
    }
}

fn fixture(name: &str, folder: &Path) -> Result<Piece, Error> {
    let scan = input::read(folder, &input::Options::default())?;
    Ok(Piece { name: name.into(), scan, truth: Truth::read(&folder.join("truth.json"))? })
}

fn simulated(name: &str, request: &Request, folder: &Path) -> Result<Piece, Error> {
    simulation::write(&simulation::simulate(request)?, folder)?;
    fixture(name, folder)
}

fn planned(piece: &str, scan: &input::Scan) -> Result<Plan, Error> {
    let not_planned = |source| Error::Plan { piece: piece.into(), source };
    pipeline::plan(&scan.views, &Job::default().pipeline(), &mut ()).map_err(not_planned)
}

fn mean_fitness(plan: &Plan) -> Vec<f64> {
    let moving = || plan.derived.views.iter().skip(1);
    let iterations = moving().map(|view| view.fitness_per_iteration.len()).max().unwrap_or(0);
    let at = |k: usize| {
        let values = moving().filter_map(|view| view.fitness_per_iteration.get(k));
        values.sum::<f64>() / moving().count() as f64
    };
    (0..iterations).map(at).collect()
}

/// The default job's path, as `weldpath plan` writes it and `weldpath evaluate` reads it.
fn accuracy(piece: &Piece, plan: &Plan) -> Result<Accuracy, Error> {
    let output = postprocess(plan, &Job::default(), Source::default())?;
    let paths = PathSet::parse(csv::write(&output.paths, PathFrame::Base).as_bytes(), Path::new("path.csv"))?;
    let Score { rmse_mm, rmse_deg, .. } = score(&paths, &piece.truth, &evaluation::Options::default());
    let lines =
        plan.paths.iter().map(|path| path.points.iter().map(|p| p.position_mm.coords).collect::<Vec<_>>());
    let literal = |line: Vec<nalgebra::Vector3<f64>>| {
        let against = piece.truth.seams.iter().filter_map(|seam| paper_rmse(&line, seam, Target::Apex));
        against.reduce(f64::min)
    };
    Ok(Accuracy {
        piece: piece.name.clone(),
        detected: plan.seams.iter().map(|seam| seam.stations.len()).sum(),
        interpolated: output.paths.iter().map(|path| path.points.len()).sum(),
        rmse_mm,
        rmse_deg,
        paper_rmse_mm: lines.filter_map(literal).reduce(f64::max),
    })
}

/// A made recording of hands, answered as the pendant answers it, on this machine: sensor, link and robot are not in it.
fn interaction() -> Result<Vec<Interaction>, Error> {
    let stage = simulation::stage(&Request::new(Part::Fillet, 1))?;
    let setup = teleop::Setup {
        base_from_camera: stage.base_from_camera[0],
        box_center_mm: [0.0, 200.0, 0.0],
        box_mm: 100.0,
        steer_right: false,
    };
    let frames = generator::recording(&setup, &stage.base_from_camera).ok_or(Error::Hands)?;
    let mut twin = Twin::new(&setup.jog().ok_or(Error::Hands)?, &JOG_LIMITS);
    let answer = |command| match command {
        weldpath_core::wire::Command::HandFrame(frame) => Ok(twin.answer(&frame, frame.time_ms)),
        _ => Ok::<_, std::convert::Infallible>(weldpath_core::wire::Answer::Done),
    };
    let session = teleop::play(&frames, &setup, &JOG_LIMITS, teleop::Pace::Answers, answer)
        .map_err(|_| Error::Hands)?;
    let row = |motion, latency: &[std::time::Duration]| Interaction {
        motion,
        frames: latency.len(),
        mean_ms: 1e3 * latency.iter().map(std::time::Duration::as_secs_f64).sum::<f64>()
            / latency.len().max(1) as f64,
    };
    let straight: Vec<_> = session.latency[1..].concat();
    Ok(vec![row("straight motion", &straight), row("rotation", &session.latency[0])])
}
