//! The tool at the flange, as every robot controller wants to know it.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

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

impl Tool {
    /// The torch frame of a program in the flange's, mm: its n, out of the work, where the tool's z points into it.
    pub fn flange_from_torch(&self) -> Isometry3<f64> {
        self.flange_from_tcp() * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI)
    }

    /// The tip in the flange's frame, mm.
    pub(crate) fn flange_from_tcp(&self) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(self.flange_from_tcp_rotation_rad));
        Isometry3::from_parts(Translation3::from(self.flange_from_tcp_mm), rotation)
    }
}
