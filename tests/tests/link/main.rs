//! The link in virtual time: protocol, faults, limits; what the firmware costs and what it cannot do.

mod bring_up;
mod firmware_cost;
mod firmware_proofs;
mod gesture_recordings;
mod link_damage;
mod link_directed;
mod link_faults;
mod link_fuzz;
mod link_golden;
mod link_model;
mod link_port;
mod link_rules;
mod link_timing;
