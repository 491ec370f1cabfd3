//! What a run leaves behind: one file per format, written whole or not at all. Formats: `docs/formats.md`.

pub mod arm;
mod base_frame;
pub mod csv;
pub mod feasibility;
pub mod frame;
pub mod json;
pub mod ply;
pub mod summary;
pub mod verdict;
pub mod views;
