//! Edge scores on bounded neighbourhoods (paper II-E).
//!
//! The four steps of the paper, each a function over slices: [`neighbourhood`] (eq. (11)), [`intensity()`] (eq. (12)),
//! [`gradient()`] (eq. (13)) and [`tensor`] (eqs. (14)-(17)). [`Patch`] runs them over a few points by brute force, for
//! the microcontroller; the host runs the same functions over a spatial index.
//! Offsets are millimetres from the point in question; every score is dimensionless and free of scale.

pub mod gradient;
pub mod intensity;
pub mod neighbourhood;
mod patch;
pub mod tensor;

pub use gradient::gradient;
pub use intensity::intensity;
pub use neighbourhood::{Ball, Neighbourhood};
pub use patch::{EdgeScore, Patch};
pub use tensor::{RatioThreshold, Tensor};
