//! Arrays as bytes, little-endian and in C order, as numpy hands them over and takes them back.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use weldpath::Coordinates;

/// Rows of three numbers.
pub(crate) fn triples<const N: usize, T: Copy>(bytes: &[u8], number: impl Fn([u8; N]) -> T) -> Vec<[T; 3]> {
    let numbers = bytes.as_chunks::<N>().0;
    numbers.as_chunks::<3>().0.iter().map(|row| row.map(&number)).collect()
}

pub(crate) fn coordinates(bytes: &[u8], double: bool) -> Coordinates {
    match double {
        true => Coordinates::Double(triples(bytes, f64::from_le_bytes)),
        false => Coordinates::Single(triples(bytes, f32::from_le_bytes)),
    }
}

pub(crate) fn bytes_of<'py, const N: usize>(
    py: Python<'py>,
    numbers: impl Iterator<Item = [u8; N]>,
) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &numbers.flatten().collect::<Vec<u8>>())
}

/// Rows x, y, z as f64.
pub(crate) fn vectors<'py>(py: Python<'py>, rows: impl Iterator<Item = Vector3<f64>>) -> Bound<'py, PyBytes> {
    bytes_of(py, rows.flat_map(|row| [row.x, row.y, row.z]).map(f64::to_le_bytes))
}

/// Rows x, y, z, w as f64.
pub(crate) fn quaternions<'py>(
    py: Python<'py>,
    rows: impl Iterator<Item = UnitQuaternion<f64>>,
) -> Bound<'py, PyBytes> {
    bytes_of(py, rows.flat_map(|q| [q.i, q.j, q.k, q.w]).map(f64::to_le_bytes))
}

/// 4 x 4, row by row, as f64.
pub(crate) fn matrix<'py>(py: Python<'py>, pose: &Isometry3<f64>) -> Bound<'py, PyBytes> {
    let matrix = pose.to_homogeneous().transpose();
    bytes_of(py, matrix.iter().copied().map(f64::to_le_bytes))
}
