//! `path.script`: the program in URScript, for Universal Robots controllers.
//!
//! The dialect's rules: metres and rotation vectors; tool z points into the work, so the torch frame is turned half
//! round `m`; blend radii stay below half of the shorter neighbouring segment, and are 0 at the end of every weld and
//! wherever the torch stands; a rotation
//! vector is the representative nearest to the one before, so that component-wise readers see no jump.

use std::fmt::Write;

use nalgebra::{UnitQuaternion, Vector3};

use super::ProgramSetup;
use super::moves::{self, Move, Switch, TooLong, moves};
use crate::robot::arc::WeldingArc;
use weldpath_files::File;
use weldpath_method::weld::program::Waypoint;

/// Acceleration of every straight move, m/s².
const ACCELERATION_M_S2: f64 = 0.5;

/// Longest line of a remark: a screen of the pendant.
const REMARK: usize = 100;

/// `path.script`, whatever the program's name; it is never divided.
///
/// # Errors
/// None: a script may be of any length.
pub fn write(waypoints: &[Waypoint], setup: &ProgramSetup) -> Result<Vec<File>, TooLong> {
    Ok(vec![File::new("path.script", script(waypoints, setup))])
}

/// The whole script: one function, `weldpath`.
fn script(waypoints: &[Waypoint], setup: &ProgramSetup) -> String {
    let mut script = Script { text: String::new(), previous_rad: None };
    script.text.push_str("def weldpath():\n");
    script.line("# weldpath: robot base frame, metres, rotation vectors; tool z points into the work.");
    script.opening(setup);
    let moves = moves(waypoints);
    for (i, one) in moves.iter().enumerate() {
        let next = moves.get(i + 1).and_then(|next| next.then);
        script.one(i == 0, one, next, &setup.arc);
    }
    script.text.push_str("end\n");
    script.text
}

struct Script {
    text: String,
    previous_rad: Option<Vector3<f64>>,
}

impl Script {
    fn line(&mut self, line: impl std::fmt::Display) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.text, "  {line}");
    }

    fn opening(&mut self, setup: &ProgramSetup) {
        for remark in setup.remark_lines(REMARK) {
            self.line(format_args!("# {remark}"));
        }
        match &setup.tool {
            Some(tool) => {
                let [x, y, z] = tool.flange_from_tcp_mm.map(metres);
                let [rx, ry, rz] = tool.flange_from_tcp_rotation_rad.map(decimal);
                self.line(format_args!("set_tcp(p[{x}, {y}, {z}, {rx}, {ry}, {rz}])"));
                let [x, y, z] = tool.payload_centre_mm.map(metres);
                self.line(format_args!("set_payload({}, [{x}, {y}, {z}])", tool.payload_kg));
            }
            None => self.line("# TCP and payload: as set on the controller; the job file has no [tool]."),
        }
        self.switch(Some(setup.arc.output), false);
        self.switch(setup.arc.gas_output, false);
    }

    /// One move, and what happens where it ends; `next` is what happens at the end of the move after it.
    fn one(&mut self, first: bool, one: &Move, next: Option<Switch>, arc: &WeldingArc) {
        let pose = self.pose(one);
        let speed = metres(one.feed_mm_s);
        if one.welding {
            let radius = metres((one.blend_mm * 1e3).floor() / 1e3);
            self.line(format_args!("movep({pose}, a={ACCELERATION_M_S2}, v={speed}, r={radius})"));
        } else if first {
            self.line(format_args!("movej({pose}, a=0.5, v=0.25)"));
        } else {
            self.line(format_args!("movel({pose}, a={ACCELERATION_M_S2}, v={speed})"));
        }
        if next == Some(Switch::On) {
            self.gas_on(one.seam, arc);
        }
        if one.then == Some(Switch::On) {
            self.arc_on(arc);
        }
        if one.welding || one.then.is_some() {
            self.sleep(one.dwell_s.unwrap_or(0.0));
        }
        if one.then == Some(Switch::Off) {
            self.arc_off(arc);
        }
    }

    fn gas_on(&mut self, seam: Option<usize>, arc: &WeldingArc) {
        if let Some(seam) = seam {
            self.line(format_args!("# seam {seam}"));
        }
        self.switch(arc.gas_output, true);
    }

    /// Standing at the start of the seam: gas flows first, then the arc is struck and waited for.
    fn arc_on(&mut self, arc: &WeldingArc) {
        if arc.gas_output.is_some() {
            self.sleep(arc.gas_preflow_s);
        }
        self.switch(Some(arc.output), true);
        // Without a valve of ours the power source opens its own when it is started.
        let own_preflow_s = if arc.gas_output.is_none() { arc.gas_preflow_s } else { 0.0 };
        match arc.established_input {
            Some(input) => self.wait_for(input, arc.strike_s + own_preflow_s, arc),
            None => self.sleep(arc.strike_s + own_preflow_s),
        }
    }

    fn wait_for(&mut self, input: u8, timeout_s: f64, arc: &WeldingArc) {
        self.line("waited_s = 0.0");
        self.line(format_args!("while (get_standard_digital_in({input}) == False):"));
        self.line("  sleep(0.01)");
        self.line("  waited_s = waited_s + 0.01");
        self.line(format_args!("  if (waited_s > {timeout_s}):"));
        for output in [Some(arc.output), arc.gas_output].into_iter().flatten() {
            self.line(format_args!("    set_standard_digital_out({output}, False)"));
        }
        self.line("    popup(\"The arc did not establish.\", title=\"weldpath\", error=True, blocking=True)");
        self.line("    halt");
        self.line("  end");
        self.line("end");
    }

    fn arc_off(&mut self, arc: &WeldingArc) {
        self.sleep(arc.crater_s);
        self.switch(Some(arc.output), false);
        self.sleep(arc.gas_postflow_s);
        self.switch(arc.gas_output, false);
    }

    fn switch(&mut self, output: Option<u8>, on: bool) {
        if let Some(output) = output {
            let state = if on { "True" } else { "False" };
            self.line(format_args!("set_standard_digital_out({output}, {state})"));
        }
    }

    fn sleep(&mut self, time_s: f64) {
        if time_s > 0.0 {
            self.line(format_args!("sleep({time_s})"));
        }
    }

    fn pose(&mut self, one: &Move) -> String {
        let rotation_rad = rotation_vector(&one.base_from_tool, self.previous_rad);
        self.previous_rad = Some(rotation_rad);
        let [x, y, z] = <[f64; 3]>::from(one.position_mm.coords).map(metres);
        let [rx, ry, rz] = <[f64; 3]>::from(rotation_rad).map(decimal);
        format!("p[{x}, {y}, {z}, {rx}, {ry}, {rz}]")
    }
}

/// Of the vectors of one rotation, `(angle + 2πk) axis`, the one nearest to `previous_rad`; else the shortest.
fn rotation_vector(q: &UnitQuaternion<f64>, previous_rad: Option<Vector3<f64>>) -> Vector3<f64> {
    let shortest = q.scaled_axis();
    let Some(previous) = previous_rad else { return shortest };
    // The identity has every axis: it continues the previous one.
    let axis = shortest.try_normalize(1e-9).or_else(|| previous.try_normalize(1e-9));
    let Some(axis) = axis else { return shortest };
    let turns = ((previous.dot(&axis) - shortest.dot(&axis)) / std::f64::consts::TAU).round();
    shortest + axis * (turns * std::f64::consts::TAU)
}

/// A length in mm as metres, to 10 nm.
fn metres(length_mm: f64) -> String {
    decimal(length_mm / 1e3)
}

fn decimal(value: f64) -> String {
    moves::decimal::<8>(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};
    use weldpath_method::weld::program::Kind;

    #[test]
    fn a_rotation_vector_is_the_same_rotation_and_near_its_predecessor() {
        let axis = Vector3::new(0.3, -0.5, 0.9).normalize();
        let mut previous = None;
        for i in 0..200 {
            let q = UnitQuaternion::from_scaled_axis(axis * (0.05 * f64::from(i)));
            let v = rotation_vector(&q, previous);
            assert!(UnitQuaternion::from_scaled_axis(v).angle_to(&q) < 1e-6);
            if let Some(previous) = previous {
                let step: Vector3<f64> = v - previous;
                assert!(step.norm() < 0.051, "step {i} jumps by {}", step.norm());
            }
            previous = Some(v);
        }
        assert!(previous.unwrap().norm() > TAU, "wound on, not wrapped");
    }

    #[test]
    fn a_seam_of_one_point_strikes_no_arc() {
        let at = |z: f64, kind| Waypoint {
            position_mm: nalgebra::Point3::new(0.0, 0.0, z),
            base_from_torch: UnitQuaternion::identity(),
            feed_mm_s: 10.0,
            weld: kind == Kind::Weld,
            seam: Some(1),
            kind,
            dwell_s: None,
        };
        let seam = [at(9.0, Kind::Approach), at(0.0, Kind::Weld), at(9.0, Kind::Retract)];
        let arc = WeldingArc {
            output: 0,
            gas_output: Some(1),
            established_input: None,
            gas_preflow_s: 0.1,
            strike_s: 0.1,
            crater_s: 0.1,
            gas_postflow_s: 0.1,
        };
        let setup = ProgramSetup {
            name: "weldpath".into(),
            tool_number: 1,
            weld_schedule: 1,
            tool: None,
            arc,
            posture: None,
            remarks: vec![],
        };
        let script = script(&seam, &setup);
        assert!(!script.contains("True"), "{script}");
    }

    #[test]
    fn half_a_turn_does_not_flip_its_axis() {
        let about = |angle| UnitQuaternion::from_scaled_axis(Vector3::x() * angle);
        let before = rotation_vector(&about(PI - 0.01), None);
        let after = rotation_vector(&about(PI + 0.01), Some(before));
        assert!((after - Vector3::x() * (PI + 0.01)).norm() < 1e-9);
    }
}
