//! Scores of single points (paper II-E): how much of an edge each is, and the paper's own seams from them alone.

pub mod edges;
pub mod paper;
mod sparse;
