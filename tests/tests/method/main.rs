//! From scans to seams and torch paths: fixtures, simulated scans, scans of others.

#[path = "../../../host/benches/clouds/mod.rs"]
#[allow(dead_code)]
mod clouds;

mod accuracy;
mod air_moves;
mod asking;
mod base_frame;
mod base_frame_algebra;
mod calibration;
mod corners;
mod coverage;
mod drawing;
mod edges;
mod evaluation;
mod exclusion;
mod feasibility;
mod few_views;
mod fit_up;
mod fixtures;
mod instructions;
mod kept;
mod merged_clouds;
mod paper_comparison;
mod pieces;
mod planned;
mod real_data;
mod refit;
mod scan_direction;
mod strays;
mod threads;
mod touch;
mod welding;
