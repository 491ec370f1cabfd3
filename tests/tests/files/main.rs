//! What is read and written: readers, robot programs, outputs, messages.

mod errors;
mod fanuc;
mod formats;
mod frames;
mod fuzz_regressions;
mod golden_programs;
mod krl;
mod mistakes;
mod outputs;
mod outputs_killed;
mod rapid;
mod readers;
mod readers_fuzz;
mod reports;
mod resume;
mod ros;
mod urscript;
