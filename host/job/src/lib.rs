//! From a scan and a job to a robot program with a verdict: what a user asks for ([`run`]), the robot that does it
//! ([`robot`]), and the files that say it ([`output`]).
#![forbid(unsafe_code)]

pub mod output;
pub mod robot;
pub mod run;
