//! weldpath: from scans of a workpiece to the motion of a welding torch.
//!
//! [`pipeline`] is the whole method on one page; [`input`] reads what a camera saw; [`weld`] is what comes out.
//! Millimetres, radians, seconds; robot base frame unless a name says otherwise; transforms are `to_from`.
#![forbid(unsafe_code)]

pub mod files;
pub mod geometry;
pub mod input;
pub mod lab;
pub mod model;
pub mod output;
pub mod pendant;
pub mod pipeline;
pub mod report;
pub mod robot;
pub mod run;
pub mod seam;
pub mod weld;
