//! What is measured of a refined seam (ours): kind of joint, fit-up, how well it was seen, and whether it may be a contact only.

pub mod coverage;
pub mod dimension;
pub mod fitup;
pub mod grip;
pub mod joint;
pub mod resting;
