//! `path.script`: the program in URScript, for Universal Robots controllers.
//!
//! The dialect's rules: metres and rotation vectors, joints in rad; tool z points into the work, so the torch frame is
//! turned half round `m`; blend radii stay below half of the shorter neighbouring segment, and are 0 at the end of every
//! weld and wherever the torch stands; a rotation vector is the representative nearest to the one before, so that
//! component-wise readers see no jump.
//!
//! Arc and gas are low while no program runs (run-state action 1). A thread ends the program when it finds them low amid
//! a weld: after a stop the weld is neither struck again nor run along without an arc.

use std::fmt::Write;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::moves::{self, Move, Switch, TooLong};
use super::{Dialect, Joints, NO_SAFETY_FUNCTION, ProgramSetup, UNCHECKED_MOVE};
use crate::robot::arc::WeldingArc;
use crate::robot::frame::FrameSource;
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

/// Values of the global `weldpath_on`: what has to be on, for the thread that watches it.
const GAS: u8 = 1;
const ARC: u8 = 2;
const ESTABLISHED: u8 = 3;

/// The whole script: one function, `weldpath`.
fn script(waypoints: &[Waypoint], setup: &ProgramSetup) -> String {
    let mut script = Script { text: String::new(), previous_rad: None, frame: None };
    let joints = setup.joints(Dialect::Ur, waypoints.len());
    script.text.push_str("def weldpath():\n");
    script.head(setup, joints.as_ref());
    script.watch(&setup.arc);
    script.opening(setup);
    let moves = setup.moves(waypoints);
    for (i, one) in moves.iter().enumerate() {
        let next = moves.get(i + 1).and_then(|next| next.then);
        match joints.as_ref().filter(|_| i == 0) {
            Some(joints) => script.begin(joints, one),
            None => script.move_to(i == 0, one),
        }
        script.after(one, next, &setup.arc);
    }
    if let Some(end_deg) = joints.and_then(|joints| joints.end_deg) {
        script.by_joints(end_deg);
    }
    script.text.push_str("end\n");
    script.text
}

struct Script {
    text: String,
    previous_rad: Option<Vector3<f64>>,
    /// The feature, or the variable, that poses are relative to.
    frame: Option<String>,
}

impl Script {
    fn line(&mut self, line: impl std::fmt::Display) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.text, "  {line}");
    }

    fn head(&mut self, setup: &ProgramSetup, joints: Option<&Joints>) {
        let frame = if setup.frame.source == FrameSource::RobotBase { "robot base frame, " } else { "" };
        self.line(format_args!("# weldpath: {frame}metres, rotation vectors; tool z points into the work."));
        let mut own = vec![
            "Never run on a controller: try it in URSim first, then slowly, with the arc off.".into(),
            NO_SAFETY_FUNCTION.into(),
            format!(
                "Outputs of arc and gas ({}) are low while the program is stopped or paused (action 1), and are left \
                 low, with that action.",
                outputs(&setup.arc).map(|n| n.to_string()).collect::<Vec<_>>().join(", ")
            ),
            "Not verified: what an output does when a paused program resumes, and whether action 1 outlives \
             the program."
                .into(),
            "A program that is stopped during a weld ends on resume; the rest of the weld is another program.".into(),
            setup.arc_remark().into(),
        ];
        own.push(if setup.arc.established_input.is_none() {
            "An output that switches on again when a paused program resumes would strike the arc, undetected \
             without that input: do not resume during a weld, stop the program."
                .into()
        } else {
            "An output that switches on again when a paused program resumes would continue an interrupted \
             strike: do not resume there, stop the program."
                .into()
        });
        own.extend(setup.frame.remark(&pose(&setup.frame.robot_from_frame)));
        if let Some(name) = setup.frame.name() {
            own.push(format!(
                "Run it from a program of the pendant: only there is the feature {name} known."
            ));
        }
        own.extend(Joints::remarks(joints));
        for remark in setup.head(&own, REMARK) {
            self.line(format_args!("# {remark}"));
        }
    }

    /// The thread that ends the program where something is off that has to be on. It neither moves nor waits for a
    /// person before it ends the program: the main program may be moving meanwhile.
    fn watch(&mut self, arc: &WeldingArc) {
        self.line("global weldpath_on = 0");
        self.line("thread weldpath_watch():");
        self.line("  while (True):");
        let after_stop = "The program was stopped during a weld. Check the seam, then run another program.";
        let outputs = [arc.gas_output.map(|gas| (GAS, gas)), Some((ARC, arc.output))];
        for (level, output) in outputs.into_iter().flatten() {
            self.unless(level, format_args!("get_standard_digital_out({output})"), after_stop, arc);
        }
        if let Some(input) = arc.established_input {
            self.unless(
                ESTABLISHED,
                format_args!("get_standard_digital_in({input})"),
                "The arc went out.",
                arc,
            );
        }
        self.line("    sync()");
        self.line("  end");
        self.line("end");
    }

    fn unless(&mut self, level: u8, signal: impl std::fmt::Display, message: &str, arc: &WeldingArc) {
        self.line(format_args!("    if (weldpath_on >= {level}):"));
        self.line(format_args!("      if ({signal} == False):"));
        self.give_up("        ", message, false, arc);
        self.line("      end");
        self.line("    end");
    }

    /// Everything off, a message, the end. `blocking` waits for a person first.
    fn give_up(&mut self, indent: &str, message: &str, blocking: bool, arc: &WeldingArc) {
        self.line(format_args!("{indent}weldpath_on = 0"));
        for output in outputs(arc) {
            self.line(format_args!("{indent}set_standard_digital_out({output}, False)"));
        }
        let blocking = if blocking { "True" } else { "False" };
        self.line(format_args!("{indent}textmsg(\"weldpath: {message}\")"));
        self.line(format_args!(
            "{indent}popup(\"{message}\", title=\"weldpath\", error=True, blocking={blocking})"
        ));
        self.line(format_args!("{indent}halt"));
    }

    fn opening(&mut self, setup: &ProgramSetup) {
        for output in outputs(&setup.arc) {
            self.line(format_args!("set_runstate_standard_digital_output_to_value({output}, 1)"));
            self.switch(Some(output), false);
        }
        self.line("weldpath_watcher = run weldpath_watch()");
        match setup.written_tool() {
            Some(tool) => {
                let tcp = written(tool.flange_from_tcp_mm, tool.flange_from_tcp_rotation_rad);
                self.line(format_args!("set_tcp({tcp})"));
                let [x, y, z] = tool.payload_centre_mm.map(metres);
                self.line(format_args!("set_payload({}, [{x}, {y}, {z}])", tool.payload_kg));
            }
            None => match setup.tool_source.name() {
                Some(name) => {
                    self.line(format_args!("# TCP {name} and its payload have to be set on the controller."))
                }
                None => self.line("# TCP and payload: as set on the controller; the job file has no [tool]."),
            },
        }
        self.frame = match &setup.frame.source {
            FrameSource::RobotBase => None,
            FrameSource::Held(held) => Some(held.to_string()),
            FrameSource::Program { .. } => {
                self.line(format_args!("weldpath_frame = {}", pose(&setup.frame.robot_from_frame)));
                Some("weldpath_frame".into())
            }
        };
    }

    /// To the first point by joints: from home, or, where there is none, after a person agreed.
    fn begin(&mut self, joints: &Joints, first: &Move) {
        match joints.home_deg {
            Some(home_deg) => self.by_joints(home_deg),
            None => self.line(format_args!(
                "popup(\"{UNCHECKED_MOVE} Continue moves the arm.\", title=\"weldpath\", warning=True, \
                 blocking=True)"
            )),
        }
        self.by_joints(joints.first_deg);
        self.previous_rad = Some(rotation_vector(&first.base_from_tool, None));
    }

    fn by_joints(&mut self, joints_deg: [f64; 6]) {
        let joints = joints_deg.map(|deg| decimal(deg.to_radians())).join(", ");
        self.line(format_args!("movej([{joints}], a=0.5, v=0.25)"));
    }

    fn move_to(&mut self, first: bool, one: &Move) {
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
    }

    /// What happens where a move ends; `next` is what happens at the end of the move after it.
    fn after(&mut self, one: &Move, next: Option<Switch>, arc: &WeldingArc) {
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
        if arc.gas_output.is_some() {
            self.switch(arc.gas_output, true);
            self.on(GAS);
        }
    }

    /// From here on the thread ends the program where this, or what came before it, is off. An output that was just
    /// switched may read as it was until the next cycle.
    fn on(&mut self, level: u8) {
        if level > 0 {
            self.line("sync()");
        }
        self.line(format_args!("weldpath_on = {level}"));
    }

    /// Standing at the start of the seam: gas flows first, then the arc is struck and waited for.
    fn arc_on(&mut self, arc: &WeldingArc) {
        if arc.gas_output.is_some() {
            self.sleep(arc.gas_preflow_s);
        }
        self.switch(Some(arc.output), true);
        self.on(ARC);
        // Without a valve of ours the power source opens its own when it is started.
        let own_preflow_s = if arc.gas_output.is_none() { arc.gas_preflow_s } else { 0.0 };
        match arc.established_input {
            Some(input) => {
                self.wait_for(input, arc.strike_s + own_preflow_s, arc);
                self.on(ESTABLISHED);
            }
            None => self.sleep(arc.strike_s + own_preflow_s),
        }
    }

    fn wait_for(&mut self, input: u8, timeout_s: f64, arc: &WeldingArc) {
        self.line("waited_s = 0.0");
        self.line(format_args!("while (get_standard_digital_in({input}) == False):"));
        self.line("  sleep(0.01)");
        self.line("  waited_s = waited_s + 0.01");
        self.line(format_args!("  if (waited_s > {timeout_s}):"));
        self.give_up("    ", "The arc did not establish.", true, arc);
        self.line("  end");
        self.line("end");
    }

    fn arc_off(&mut self, arc: &WeldingArc) {
        self.sleep(arc.crater_s);
        self.on(0);
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
        let pose = written(one.position_mm.coords.into(), rotation_rad.into());
        match &self.frame {
            Some(frame) => format!("pose_trans({frame}, {pose})"),
            None => pose,
        }
    }
}

/// The pose of a transform.
fn pose(transform: &Isometry3<f64>) -> String {
    written(transform.translation.vector.into(), transform.rotation.scaled_axis().into())
}

/// A place and a rotation vector as the language writes a pose.
fn written(position_mm: [f64; 3], rotation_rad: [f64; 3]) -> String {
    let ([x, y, z], [rx, ry, rz]) = (position_mm.map(metres), rotation_rad.map(decimal));
    format!("p[{x}, {y}, {z}, {rx}, {ry}, {rz}]")
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

/// Outputs of the arc and the gas.
fn outputs(arc: &WeldingArc) -> impl Iterator<Item = u8> {
    [Some(arc.output), arc.gas_output].into_iter().flatten()
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
            frame: Default::default(),
            tool_source: Default::default(),
            tool_number: 1,
            weld_schedule: 1,
            weld_procedure: None,
            welddata_unit: Default::default(),
            tool: None,
            arc,
            posture: None,
            remarks: vec![],
        };
        let script = script(&seam, &setup);
        assert!(!script.contains(", True)"), "{script}");
    }

    #[test]
    fn half_a_turn_does_not_flip_its_axis() {
        let about = |angle| UnitQuaternion::from_scaled_axis(Vector3::x() * angle);
        let before = rotation_vector(&about(PI - 0.01), None);
        let after = rotation_vector(&about(PI + 0.01), Some(before));
        assert!((after - Vector3::x() * (PI + 0.01)).norm() < 1e-9);
    }
}
