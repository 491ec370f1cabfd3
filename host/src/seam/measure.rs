//! What is measured of a refined seam (ours): kind of joint, fit-up, and how well it was seen.

pub mod coverage;
pub mod dimension;
pub mod fitup;
pub mod joint;
