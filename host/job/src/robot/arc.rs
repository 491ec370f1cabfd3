//! How the arc is switched: outputs and inputs of the robot controller, and the times of the weld's start and end.

/// How the arc is switched.
#[derive(Debug, Clone, PartialEq)]
pub struct WeldingArc {
    /// Digital output that starts the power source.
    pub output: u8,
    /// Digital output of the gas valve, where the power source does not open it itself.
    pub gas_output: Option<u8>,
    /// Digital input that is high while the arc burns, where there is one.
    pub established_input: Option<u8>,
    /// Gas before the arc, s.
    pub gas_preflow_s: f64,
    /// Time for the arc to establish: waited out, or, with an input, the time-out, s.
    pub strike_s: f64,
    /// Standing still at the end to fill the crater, s.
    pub crater_s: f64,
    /// Gas after the arc, s.
    pub gas_postflow_s: f64,
}
