//! What hangs on the robot: the dialects in which a program is written, and whether an arm can run it.

pub mod dialect;
pub mod feasibility;
