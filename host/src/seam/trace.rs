//! Corners fitted to the best scored points, and strung together to chains (ours).

pub mod chain;
pub mod corner;
pub mod loops;
pub mod obstruction;
pub mod splice;
pub mod step;
pub mod support;
