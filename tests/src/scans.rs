//! Scans of simulated workpieces, planned and scored as the command does it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

use nalgebra::Point3;
use weldpath::evaluation::{Options, PathSet, Score, Truth, score};
use weldpath::input::{self, Scan};
use weldpath::output::csv;
use weldpath::output::frame::PathFrame;
use weldpath::output::verdict::Verdict;
use weldpath::pipeline::Plan;
use weldpath::run::job::Job;
use weldpath::run::planning;
use weldpath::run::postprocessing::{Output, postprocess};
use weldpath::simulation::{Format, MeshRequest, Noise, Request, SensorErrors, Simulated, simulate, write};

/// Corners of a triangle, mm.
pub type Triangle = [Point3<f64>; 3];

/// Triangles of a box between two of its corners, mm.
pub fn block(low: [f64; 3], high: [f64; 3]) -> Vec<Triangle> {
    let corner = |k: usize| Point3::from([0, 1, 2].map(|axis| [low, high][k >> axis & 1][axis]));
    // Each side by its corners, counter-clockwise from outside; bit 0 of a corner is x, bit 1 y, bit 2 z.
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| t.map(corner)).collect()
}

/// A scan of a mesh with an everyday camera from its usual distance.
pub fn of_mesh(name: &str, triangles: Vec<Triangle>, views: usize, seed: u64) -> MeshRequest {
    MeshRequest {
        name: name.into(),
        triangles,
        welds: None,
        views,
        noise: Noise::Mid,
        seed,
        size_px: [640, 480],
        distance_mm: None,
        format: Format::Png,
        cell: None,
        sensor: SensorErrors::default(),
    }
}

/// What several tests look at, made once for each key and kept until the last of them has ended.
pub struct Shared<K, V: 'static>(Mutex<BTreeMap<K, &'static OnceLock<V>>>);

impl<K: Ord, V> Shared<K, V> {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self(Mutex::new(BTreeMap::new()))
    }

    /// What belongs to this key; while one test makes it, others that want it wait.
    pub fn get(&self, key: K, make: impl FnOnce() -> V) -> &'static V {
        // A test that failed left the list whole.
        let mut slots = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let slot = *slots.entry(key).or_insert_with(|| Box::leak(Box::default()));
        drop(slots);
        slot.get_or_init(make)
    }
}

impl<K: Ord, V> Default for Shared<K, V> {
    fn default() -> Self {
        Self::new()
    }
}

/// The simulated scan of a request that several tests make.
///
/// # Panics
/// If there is no such scan.
pub fn shared(request: &Request) -> &'static Simulated {
    static SCANS: Shared<String, Simulated> = Shared::new();
    SCANS.get(format!("{request:?}"), || simulate(request).expect("a scan"))
}

/// Written to a folder and read from it.
///
/// # Panics
/// If either fails.
pub fn read(simulated: &Simulated) -> Scan {
    let folder = tempfile::tempdir().expect("a folder");
    write(simulated, folder.path()).expect("a folder");
    input::read(folder.path(), &input::Options::default()).expect("a scan")
}

/// A simulated scan, written and read, and what is true of it.
///
/// # Panics
/// If there is no such scan.
pub fn scanned(request: &Request) -> (Scan, Truth) {
    let simulated = simulate(request).expect("a scan");
    (read(&simulated), simulated.truth)
}

/// All seams of a plan, as they stand in `path.csv`, against the truth.
///
/// # Panics
/// If they cannot be read back.
pub fn scored(plan: &Plan, truth: &Truth) -> Score {
    let csv = csv::write(&plan.paths, PathFrame::Base);
    let paths = PathSet::parse(csv.as_ref(), Path::new("path.csv")).expect("path.csv is read back");
    score(&paths, truth, &Options::default())
}

/// What a plan of a scan came to.
pub struct Outcome {
    /// The plan, selected or not.
    pub plan: Plan,
    /// All files, and what they say.
    pub output: Output,
    /// Of `path.csv` against the truth; none where nothing is welded.
    pub score: Option<Score>,
}

impl Outcome {
    /// Of a scan whose truth is known.
    ///
    /// # Panics
    /// If it has no plan at all.
    pub fn of(scan: &Scan, truth: &Truth, job: &Job) -> Self {
        let plan =
            planning::plan(scan, job, &mut ()).unwrap_or_else(|error| panic!("{}: {error}", truth.name));
        let (output, score) = written(&plan, scan, truth, job);
        Self { plan, output, score }
    }

    /// What is said of it.
    pub fn verdict(&self) -> &Verdict {
        self.output.summary.verdict()
    }
}

/// All files of a plan, and the score of its `path.csv`; none where nothing is welded.
///
/// # Panics
/// If the job does not go with the plan.
pub fn written(plan: &Plan, scan: &Scan, truth: &Truth, job: &Job) -> (Output, Option<Score>) {
    let output = postprocess(plan, job, planning::source(scan, job)).expect("files");
    let csv = output.files.iter().find(|file| file.name == "path.csv").expect("path.csv");
    let paths = PathSet::parse(&csv.bytes, Path::new("path.csv")).ok();
    let score = paths.map(|paths| score(&paths, truth, &Options::default()));
    (output, score)
}

/// Plans a simulated scan as the text of a job says.
///
/// # Panics
/// If it cannot be read or has no plan at all.
pub fn planned(simulated: &Simulated, job: &str) -> Outcome {
    let job = Job::parse(job, Path::new("job.toml")).expect("a job");
    Outcome::of(&read(simulated), &simulated.truth, &job)
}
