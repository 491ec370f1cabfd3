//! Points and what lies around them: clouds and views, and the spatial index that every stage asks.

pub mod cloud;
pub mod grid;
pub mod mesh;
