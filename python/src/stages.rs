//! Stages of the method one by one: the paper's quantities as arrays, for those who study it.

use nalgebra::{Point3, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use weldpath::geometry::cloud::PointCloud;
use weldpath::geometry::grid::Grid;
use weldpath::model::denoising::{self, BilateralConfig};
use weldpath::model::normals::pointwise;
use weldpath::model::normals::{self, NormalsConfig};
use weldpath::model::reconstruction::{self, ReconstructionConfig};
use weldpath::seam::score::edges;

use crate::PyScan;
use crate::arrays::{bytes_of, matrix, triples};
use crate::running::run;

fn points(bytes: &[u8]) -> Vec<Point3<f32>> {
    triples(bytes, f32::from_le_bytes).into_iter().map(Point3::from).collect()
}

/// From the order of the grid's slots to that of the points.
fn in_order<T: Clone + Default>(grid: &Grid, of_slots: &[T]) -> Vec<T> {
    let mut all = vec![T::default(); of_slots.len()];
    for (slot, value) in of_slots.iter().enumerate() {
        all[grid.index(slot)] = value.clone();
    }
    all
}

fn rows<'py>(py: Python<'py>, vectors: &[Vector3<f32>]) -> Bound<'py, PyBytes> {
    bytes_of(py, vectors.iter().flat_map(|v| [v.x, v.y, v.z]).map(f32::to_le_bytes))
}

/// Eq. (9): a unit normal for each point (f4), its sign arbitrary.
#[pyfunction]
fn estimate_normals<'py>(py: Python<'py>, points_mm: &[u8], radius_mm: f32) -> PyResult<Bound<'py, PyBytes>> {
    let points = points(points_mm);
    let normals = run(py, None, None, |_| {
        let grid = Grid::new(&points, radius_mm);
        in_order(&grid, &pointwise::within(&grid, radius_mm))
    })?;
    Ok(rows(py, &normals))
}

/// Eq. (10): points (f4) moved along their normals.
#[pyfunction]
fn bilateral<'py>(
    py: Python<'py>,
    points_mm: &[u8],
    normals: &[u8],
    widths_mm: [f32; 3],
) -> PyResult<Bound<'py, PyBytes>> {
    let [radius_mm, distance_mm, height_mm] = widths_mm;
    let normals = triples(normals, f32::from_le_bytes).into_iter().map(Vector3::from).collect();
    let cloud = PointCloud { origin_mm: Point3::origin(), points_mm: points(points_mm), normals };
    let config = BilateralConfig { radius_mm, distance_mm, height_mm };
    let filtered = run(py, None, None, |_| denoising::bilateral(&cloud, &config))?;
    Ok(bytes_of(py, filtered.points_mm.iter().flat_map(|p| [p.x, p.y, p.z]).map(f32::to_le_bytes)))
}

/// Eqs. (11)-(17) of each point: intensity, gradient (rows of 3), and the ratio Tr³/Det of the smoothed tensor, all f4.
#[pyfunction]
fn edge_scores<'py>(py: Python<'py>, points_mm: &[u8], radius_mm: f32) -> PyResult<[Bound<'py, PyBytes>; 3]> {
    let points = points(points_mm);
    let (intensity, gradients, ratios) = run(py, None, None, |_| {
        let grid = Grid::new(&points, radius_mm);
        let intensity: Vec<f32> = edges::asymmetries(&grid, radius_mm).iter().map(|a| a.norm()).collect();
        let gradients = edges::gradients(&grid, radius_mm, &intensity);
        let ratios: Vec<f32> =
            edges::tensors(&grid, radius_mm, &gradients).iter().map(|tensor| tensor.ratio()).collect();
        (in_order(&grid, &intensity), in_order(&grid, &gradients), in_order(&grid, &ratios))
    })?;
    let numbers = |values: &[f32]| bytes_of(py, values.iter().copied().map(f32::to_le_bytes));
    Ok([numbers(&intensity), rows(py, &gradients), numbers(&ratios)])
}

/// Eqs. (2)-(8): the pose of each view's camera, put right against the others (4 x 4 row by row, f8), and eq. (20) after it.
#[pyfunction]
fn register<'py>(py: Python<'py>, scan: &PyScan) -> PyResult<Vec<(Bound<'py, PyBytes>, Option<f64>)>> {
    let views = &scan.scan.views;
    let registration = run(py, None, None, |_| {
        let patches = normals::of_views(views, &NormalsConfig::default());
        reconstruction::register(views, &patches, &ReconstructionConfig::default())
    })?;
    let fitness = |k: usize| {
        registration.fitness.get(k).and_then(|all| all.last()).copied().filter(|share| share.is_finite())
    };
    let poses = registration.base_from_camera.iter().enumerate();
    Ok(poses.map(|(k, pose)| (matrix(py, pose), fitness(k))).collect())
}

pub(crate) fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(estimate_normals, module)?)?;
    module.add_function(wrap_pyfunction!(bilateral, module)?)?;
    module.add_function(wrap_pyfunction!(edge_scores, module)?)?;
    module.add_function(wrap_pyfunction!(register, module)?)
}
