//! Scans of simulated workpieces with exact truth, and how far a plan is from a truth.
#![forbid(unsafe_code)]

pub mod evaluation;
pub mod simulation;
