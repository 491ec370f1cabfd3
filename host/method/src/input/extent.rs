//! Place and size of a cloud, from which its unit and its frame are guessed.

use nalgebra::Vector3;

/// Where a cloud lies and how large it is, in the unit of its file, not swayed by a few stray points.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Extent {
    /// Median of each coordinate.
    pub middle: Vector3<f64>,
    /// Diagonal of the box that holds the middle 98 % along each axis.
    pub diagonal: f64,
    /// Rough distance between neighbours: that of as many points spread over a square with this diagonal.
    pub spacing: f64,
}
