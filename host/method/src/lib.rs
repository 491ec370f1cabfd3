//! The method: from views of a workpiece to a torch path along each of its seams. [`pipeline`] is the method on one page.
//!
//! Millimetres, radians, seconds; robot base frame unless a name says otherwise; transforms are `to_from`.
#![forbid(unsafe_code)]

pub mod cancellation;
pub mod geometry;
pub mod input;
pub mod model;
pub mod pipeline;
pub mod seam;
pub mod weld;
