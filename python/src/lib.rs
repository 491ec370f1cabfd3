//! `_weldpath`, the private half of the Python package: arrays cross as bytes of a stated type, in C order; settings and results as
//! JSON. What a user sees is `python/package/weldpath/`.
//!
//! Lengths are millimetres unless a name says otherwise; robot base frame; transforms are `to_from`.

mod arrays;
mod errors;
mod running;
mod stages;

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use weldpath::robot::dialect::Dialect;
use weldpath::run::planning::{self, Allowed};
use weldpath::{CameraPose, Job, PosedViews, RawCloud, RawView, Transform, input};

use arrays::{bytes_of, coordinates, triples};
use errors::{job_error, of_plan, python};
use running::run;

/// A job: every setting of a run.
#[pyclass(frozen, name = "Job", module = "weldpath._weldpath")]
struct PyJob {
    job: Job,
    allowed: Allowed,
}

#[pymethods]
impl PyJob {
    /// From a file or from settings as JSON, with others as JSON on top.
    #[new]
    fn new(
        file: Option<PathBuf>,
        settings: Option<&str>,
        overrides: &str,
        allow_outside: bool,
        memory_mb: Option<u64>,
    ) -> PyResult<Self> {
        let mut value = match &file {
            Some(path) => {
                let job = Job::read(path).map_err(|error| job_error(&error))?;
                toml::Value::try_from(job).map_err(python::<errors::JobError>)?
            }
            None => serde_json::from_str(settings.unwrap_or("{}")).map_err(python::<errors::JobError>)?,
        };
        let overrides: toml::Value = serde_json::from_str(overrides).map_err(python::<errors::JobError>)?;
        lay_over(&mut value, overrides);
        let text = toml::to_string(&value).map_err(python::<errors::JobError>)?;
        let path = file.unwrap_or_else(|| "job".into());
        let job = Job::parse(&text, &path).map_err(|error| job_error(&error))?;
        Ok(Self { job, allowed: Allowed::new(allow_outside, memory_mb) })
    }
}

impl PyJob {
    fn options(&self) -> input::Options {
        planning::options(&self.job, self.allowed)
    }
}

/// Tables are joined, and what is accepted is added; all else is replaced.
fn lay_over(below: &mut toml::Value, above: toml::Value) {
    match (below, above) {
        (toml::Value::Table(below), toml::Value::Table(above)) => {
            for (key, value) in above {
                match (below.get_mut(&key), value) {
                    (Some(toml::Value::Array(own)), toml::Value::Array(more)) if key == "accept" => {
                        own.extend(more)
                    }
                    (Some(own), value) => lay_over(own, value),
                    (None, value) => drop(below.insert(key, value)),
                }
            }
        }
        (below, above) => *below = above,
    }
}

/// What was read.
#[pyclass(frozen, name = "Scan", module = "weldpath._weldpath")]
struct PyScan {
    scan: Arc<input::Scan>,
}

#[pymethods]
impl PyScan {
    /// Per view: name, points (bytes of f32, mm, the view's own frame), pose (bytes of f64, 4 x 4 row by row).
    fn views<'py>(&self, py: Python<'py>) -> Vec<(String, Bound<'py, PyBytes>, Bound<'py, PyBytes>)> {
        let view = |view: &weldpath::geometry::cloud::View| {
            let points = view.points_mm.iter().flat_map(|p| [p.x, p.y, p.z]);
            let points = bytes_of(py, points.map(f32::to_le_bytes));
            (view.name.clone(), points, arrays::matrix(py, &view.base_from_camera))
        };
        self.scan.views.iter().map(view).collect()
    }

    /// How it was understood, and what speaks against it.
    fn notes(&self) -> (Vec<String>, Vec<String>) {
        (self.scan.notes.clone(), self.scan.warnings.clone())
    }
}

/// Reads the input that a job names.
#[pyfunction]
fn read(py: Python<'_>, job: &PyJob, threads: Option<usize>) -> PyResult<PyScan> {
    let scan = run(py, threads, None, |_| planning::read(&job.job, job.allowed))?
        .map_err(python::<errors::InputError>)?;
    Ok(PyScan { scan: Arc::new(scan) })
}

/// A cloud or a mesh: coordinates are f4 or f8 as `double` says, normals f4, indices of triangles i8.
#[pyclass(frozen, name = "RawCloud", module = "weldpath._weldpath")]
struct PyRawCloud {
    cloud: RawCloud,
}

#[pymethods]
impl PyRawCloud {
    #[new]
    fn new(points: &[u8], double: bool, normals: Option<&[u8]>, triangles: Option<&[u8]>) -> PyResult<Self> {
        let mut cloud = RawCloud::new(coordinates(points, double));
        if let Some(normals) = normals {
            cloud = cloud
                .with_normals(triples(normals, f32::from_le_bytes))
                .map_err(python::<errors::InputError>)?;
        }
        if let Some(triangles) = triangles {
            let indices =
                triples(triangles, |bytes| usize::try_from(i64::from_le_bytes(bytes)).unwrap_or(usize::MAX));
            cloud = cloud.with_triangles(indices).map_err(python::<errors::InputError>)?;
        }
        Ok(Self { cloud })
    }
}

/// What a camera saw from one pose.
#[pyclass(frozen, name = "RawView", module = "weldpath._weldpath")]
struct PyRawView {
    view: RawView,
}

#[pymethods]
impl PyRawView {
    #[staticmethod]
    fn of_cloud(cloud: &PyRawCloud) -> Self {
        Self { view: RawView::of_cloud(cloud.cloud.clone()) }
    }

    /// Counts of 16 bits with a scale, or metres as f4 without one.
    #[staticmethod]
    fn of_depth(
        depth: &[u8],
        width: u32,
        height: u32,
        intrinsics: Vec<f64>,
        scale_m: Option<f64>,
    ) -> PyResult<Self> {
        let intrinsics = input::Intrinsics::try_from(intrinsics).map_err(python::<errors::InputError>)?;
        let size_px = [width, height];
        let view = match scale_m {
            Some(scale_m) => {
                let counts = depth.as_chunks().0.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect();
                RawView::of_depth(counts, size_px, &intrinsics, scale_m)
            }
            None => {
                let depth_m: Vec<f32> =
                    depth.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
                RawView::of_depth_m(&depth_m, size_px, &intrinsics)
            }
        };
        Ok(Self { view: view.map_err(python::<errors::InputError>)? })
    }

    /// With its pose, 4 x 4 row by row in the unit of the scan, by the name of its transform.
    fn posed(&self, name: &str, pose: [[f64; 4]; 4]) -> PyResult<Self> {
        let pose = Transform::Matrix(pose);
        let pose = match name {
            "base_from_camera" => CameraPose::BaseFromCamera(pose),
            "camera_from_base" => CameraPose::CameraFromBase(pose),
            "base_from_flange" => CameraPose::BaseFromFlange(pose),
            "flange_from_base" => CameraPose::FlangeFromBase(pose),
            "base_from_tcp" => CameraPose::BaseFromTcp(pose),
            other => return Err(python::<errors::InputError>(format!("no pose is called {other}"))),
        };
        Ok(Self { view: self.view.clone().posed(pose) })
    }

    fn named(&self, name: String) -> Self {
        Self { view: self.view.clone().named(name) }
    }
}

/// The scan that a file with this cloud is.
#[pyfunction]
fn read_cloud(py: Python<'_>, cloud: &PyRawCloud, name: &str, job: &PyJob) -> PyResult<PyScan> {
    let read = || {
        let scan = cloud.cloud.clone().read(name, &job.options())?;
        planning::over_background(scan, &job.job, job.allowed)
    };
    let scan = run(py, None, None, |_| read())?.map_err(python::<errors::InputError>)?;
    Ok(PyScan { scan: Arc::new(scan) })
}

/// The scan that a `scan.json` with these views is.
#[pyfunction]
fn read_views(
    py: Python<'_>,
    views: Vec<PyRef<'_, PyRawView>>,
    flange_from_camera: Option<[[f64; 4]; 4]>,
    flange_from_tcp: Option<[[f64; 4]; 4]>,
    job: &PyJob,
) -> PyResult<PyScan> {
    let raw = PosedViews {
        views: views.iter().map(|view| view.view.clone()).collect(),
        flange_from_camera: flange_from_camera.map(Transform::Matrix),
        flange_from_tcp: flange_from_tcp.map(Transform::Matrix),
    };
    let read = || planning::over_background(raw.read(&job.options())?, &job.job, job.allowed);
    let scan = run(py, None, None, |_| read())?.map_err(python::<errors::InputError>)?;
    Ok(PyScan { scan: Arc::new(scan) })
}

/// What was found, and what may be done with it.
#[pyclass(frozen, name = "Run", module = "weldpath._weldpath")]
struct PyRun {
    run: weldpath::Run,
}

/// Seam, positions, quaternions, and whether the arc burns, of a pass.
type Pass<'py> = (usize, Bound<'py, PyBytes>, Bound<'py, PyBytes>, Vec<bool>);
/// Kind, whether the arc burns, seam, feed in mm/s, and dwell in s of a waypoint.
type Move = (&'static str, bool, Option<usize>, f64, Option<f64>);

#[pymethods]
impl PyRun {
    /// The content of `summary.json`.
    fn summary(&self) -> String {
        self.run.summary().to_json()
    }

    /// `job.toml`: every setting, with its defaults.
    fn job(&self) -> String {
        self.run.job().to_toml()
    }

    /// Per seam: id, whether it is closed, its stations' positions, tangents and the normals of its two faces (bytes of f64).
    fn seams<'py>(&self, py: Python<'py>) -> Vec<(usize, bool, [Bound<'py, PyBytes>; 4])> {
        let seam = |seam: &weldpath::seam::Seam| {
            let stations = &seam.stations;
            let arrays = [
                arrays::vectors(py, stations.iter().map(|station| station.position_mm.coords)),
                arrays::vectors(py, stations.iter().map(|station| station.tangent)),
                arrays::vectors(py, stations.iter().map(|station| station.faces[0])),
                arrays::vectors(py, stations.iter().map(|station| station.faces[1])),
            ];
            (seam.id, seam.closed, arrays)
        };
        self.run.seams().iter().map(seam).collect()
    }

    /// Per pass: seam, positions (bytes of f64, mm), quaternions x y z w (bytes of f64), whether the arc burns.
    fn paths<'py>(&self, py: Python<'py>) -> PyResult<Vec<Pass<'py>>> {
        let paths = self.run.paths().map_err(|withheld| errors::withheld(py, &withheld))?;
        let path = |path: &weldpath::weld::SeamPath| {
            let positions = arrays::vectors(py, path.points.iter().map(|point| point.position_mm.coords));
            let turns = arrays::quaternions(py, path.points.iter().map(|point| point.base_from_torch));
            let weld = path.points.iter().map(|point| point.process.weld).collect();
            (path.seam, positions, turns, weld)
        };
        Ok(paths.iter().map(path).collect())
    }

    /// The program: positions, quaternions x y z w (bytes of f64), and the rest of each waypoint.
    fn program<'py>(
        &self,
        py: Python<'py>,
        confirm: Vec<String>,
    ) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyBytes>, Vec<Move>)> {
        let confirmed = errors::reasons(&confirm)?;
        let waypoints = self.run.program(&confirmed).map_err(|withheld| errors::withheld(py, &withheld))?;
        let positions = arrays::vectors(py, waypoints.iter().map(|waypoint| waypoint.position_mm.coords));
        let turns = arrays::quaternions(py, waypoints.iter().map(|waypoint| waypoint.base_from_torch));
        use weldpath::weld::program::Kind;
        let kind = |kind: Kind| match kind {
            Kind::Air => "air",
            Kind::Approach => "approach",
            Kind::Weld => "weld",
            Kind::Retract => "retract",
        };
        let moves = waypoints.iter().map(|w| (kind(w.kind), w.weld, w.seam, w.feed_mm_s, w.dwell_s));
        Ok((positions, turns, moves.collect()))
    }

    /// The files of the robots' programs by name.
    fn program_files<'py>(&self, py: Python<'py>, confirm: Vec<String>) -> PyResult<Bound<'py, PyDict>> {
        let confirmed = errors::reasons(&confirm)?;
        let files = self.run.program_files(&confirmed).map_err(|withheld| errors::withheld(py, &withheld))?;
        let all = PyDict::new(py);
        for file in files {
            all.set_item(&file.name, PyBytes::new(py, &file.bytes))?;
        }
        Ok(all)
    }

    /// Points of the model (bytes of f64, mm) and their normals (bytes of f32).
    fn model<'py>(&self, py: Python<'py>) -> (Bound<'py, PyBytes>, Bound<'py, PyBytes>) {
        let model = self.run.model();
        let points = arrays::vectors(py, (0..model.len()).map(|i| model.in_base_mm(i).coords));
        let normals = model.normals.iter().flat_map(|n| [n.x, n.y, n.z]);
        (points, bytes_of(py, normals.map(f32::to_le_bytes)))
    }

    /// The page with the 3-D picture.
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let page = run(py, None, None, |_| self.run.report())?;
        Ok(PyBytes::new(py, &page))
    }

    /// Writes every file of the run to a folder, all or none.
    fn write(&self, py: Python<'_>, folder: PathBuf, overwrite: bool) -> PyResult<()> {
        run(py, None, None, |_| self.run.write(&folder, overwrite))?.map_err(python::<errors::OutputError>)
    }

    /// The same run with its program for other robots.
    fn for_robots(&self, py: Python<'_>, robots: Vec<String>, threads: Option<usize>) -> PyResult<Self> {
        let robots = robots.iter().map(|name| errors::robot(name)).collect::<PyResult<Vec<Dialect>>>()?;
        let other = run(py, threads, None, |mut observer| self.run.for_robots(&robots, &mut observer))?;
        Ok(Self { run: other.map_err(|error| of_plan(&error))? })
    }
}

/// Plans a scan.
#[pyfunction]
fn plan(
    py: Python<'_>,
    scan: &PyScan,
    job: &PyJob,
    threads: Option<usize>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<PyRun> {
    let planned =
        run(py, threads, progress, |mut observer| weldpath::plan(&scan.scan, &job.job, &mut observer))?;
    Ok(PyRun { run: planned.map_err(|error| of_plan(&error))? })
}

/// The command `weldpath`; its exit code.
#[pyfunction]
fn command(py: Python<'_>, arguments: Vec<std::ffi::OsString>) -> u8 {
    py.detach(|| weldpath::cli::start(arguments))
}

#[pymodule]
fn _weldpath(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<PyJob>()?;
    module.add_class::<PyScan>()?;
    module.add_class::<PyRawCloud>()?;
    module.add_class::<PyRawView>()?;
    module.add_class::<PyRun>()?;
    module.add_function(wrap_pyfunction!(read, module)?)?;
    module.add_function(wrap_pyfunction!(read_cloud, module)?)?;
    module.add_function(wrap_pyfunction!(read_views, module)?)?;
    module.add_function(wrap_pyfunction!(plan, module)?)?;
    module.add_function(wrap_pyfunction!(command, module)?)?;
    stages::add(module)?;
    errors::add(py, module)
}
