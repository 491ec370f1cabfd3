//! What hangs on the robot: the dialects in which a program is written, and whether an arm can run it.

pub mod arc;
pub mod dialect;
pub mod feasibility;
pub mod frame;
pub mod posture;
pub mod tool;
