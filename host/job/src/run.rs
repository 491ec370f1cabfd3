//! A run as a user asks for it: the job with its settings, the seams selected, what is made of a plan, and a saved program
//! laid over a part that has moved.

pub mod access;
pub mod job;
pub mod kept;
pub mod planning;
pub mod postprocessing;
pub mod refit;
pub mod resuming;
pub mod selection;
pub mod verdict;
