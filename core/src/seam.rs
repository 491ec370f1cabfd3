//! Edge scores on bounded neighbourhoods (paper II-E).
//!
//! The four steps of the paper, each a function over slices: [`neighbourhood`] (eq. (11)), [`intensity()`] (eq. (12)),
//! [`gradient()`] (eq. (13)) and [`tensor`] (eqs. (14)-(17)). [`Patch`] runs them over a few points by brute force, for
//! the microcontroller, and the host's report runs them over a sample of the model.
//!
//! For a whole cloud the host computes eqs. (12), (13) and (17) separately, eight neighbours at a time
//! (`weldpath::seam::score::edges`); the test `every_step_is_that_of_core` there holds the two equal. By default it finds
//! seams by eq. (12) and the sign of the asymmetry alone, never by eqs. (13)-(17): ARCHITECTURE.md says what uses which.
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
