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
//! | II-F, eqs. (18)-(19) | [`path`] |
//! | not in the paper | [`wire`], [`sender`], [`pendant`], [`tasks`], [`interlock`] |
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
