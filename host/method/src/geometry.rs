//! Points and what lies around them: clouds and views, the spatial index that every stage asks, planes through points, tables, the
//! row of point-to-plane registration, and statistics.

pub mod cloud;
pub(crate) mod columns;
pub(crate) mod depth_map;
pub mod grid;
pub mod mesh;
pub mod plane;
pub mod point_to_plane;
pub mod polyline;
pub mod statistics;
pub mod surface;
pub mod table;
