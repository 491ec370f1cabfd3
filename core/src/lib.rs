//! weldpath-core: the algorithms that run on the host and, unchanged, on the torch-side microcontroller.
//!
//! After Zhou et al., *Path Planning with Automatic Seam Extraction over Point Cloud Models for Robotic
//! Arc Welding*. `no_std`, no allocation, no `unsafe`; capacities are const generics, functions take slices.
//! Lengths are millimetres, angles radians, times seconds; the frame is the robot base unless a name says otherwise.
//!
//! | paper | module |
//! |---|---|
//! | II-B, Alg. 1 | [`gesture`] |
//! | II-E, eqs. (11)-(17) | [`seam`] |
//! | II-F, eqs. (18)-(19) | [`path::interpolation`], [`rotation`] |
//! | not in the paper | [`wire`], [`sender`], [`pendant`], [`tasks`], [`interlock`] |
//!
//! Eqs. (1)-(10) and (20)-(22) are the host's. ARCHITECTURE.md has a row for every equation: the function, how it departs
//! from the paper, and what uses it. The host's default takes eqs. (11) and (12) for its seams and leaves (13)-(17) to the
//! paper's way, the pendant and the report.
#![no_std]
#![forbid(unsafe_code)]

pub mod geometry;
pub mod gesture;
pub mod interlock;
pub mod math;
pub mod path;
pub mod pendant;
pub mod rotation;
pub mod seam;
pub mod sender;
pub mod tasks;
pub mod wire;

pub use geometry::{Direction, Orientation, Point, Vector};
