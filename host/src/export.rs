//! What a run leaves behind: one file per format, written whole or not at all. Formats: `docs/formats.md`.

pub mod csv;
pub mod directory;
pub mod fanuc;
pub mod feasibility;
pub mod json;
pub mod krl;
pub mod moves;
pub mod ply;
pub mod rapid;
pub mod robot;
pub mod ros;
pub mod summary;
pub mod urscript;
