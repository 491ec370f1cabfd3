//! The tool at the flange, as every robot controller wants to know it.

/// What the controller has to know about the tool.
#[derive(Debug, Clone, PartialEq)]
pub struct Tool {
    /// Tip of the wire in the flange's frame, mm.
    pub flange_from_tcp_mm: [f64; 3],
    /// Rotation vector of the same transform, rad; z points out of the torch, into the work.
    pub flange_from_tcp_rotation_rad: [f64; 3],
    /// Mass at the flange, kg.
    pub payload_kg: f64,
    /// Centre of that mass in the flange's frame, mm.
    pub payload_centre_mm: [f64; 3],
}
