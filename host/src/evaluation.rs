//! How good a path is, as the paper's section III measures it.

mod truth;

pub use truth::{Truth, TruthSeam};
