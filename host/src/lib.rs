//! weldpath: from scans of a workpiece to the motion of a welding torch.
//!
//! [`pipeline`] is the whole method on one page; `scan` reads what a camera saw; [`toolpath`] is what comes out.
//! Millimetres, radians, seconds; robot base frame unless a name says otherwise; transforms are `to_from`.
#![forbid(unsafe_code)]

pub mod cloud;
pub mod comparison;
pub mod coverage;
pub mod denoising;
pub mod downsampling;
#[cfg(unix)]
pub mod emulator;
pub mod evaluation;
pub mod export;
pub mod feasibility;
pub mod grid;
pub mod job;
pub mod link;
pub mod normals;
pub mod orientation;
pub mod pipeline;
pub mod postprocessing;
pub mod reconstruction;
pub mod refit;
pub mod report;
pub mod scan;
pub mod seam;
pub mod selection;
pub mod serial;
pub mod simulation;
pub mod teleop;
pub mod toolpath;
