//! Measuring the method itself: a simulator with exact truth, scores against it, and the paper's section III again.

pub mod comparison;
pub mod evaluation;
pub mod simulation;
pub mod suite;
