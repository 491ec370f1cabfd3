//! Measuring the method itself: the suite of simulated scans, and the paper's section III again.
#![forbid(unsafe_code)]

pub mod comparison;
pub mod suite;
