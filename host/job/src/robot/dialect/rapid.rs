//! `NAME.mod`: the program in RAPID, for ABB controllers with the Arc option (ArcWare).
//!
//! The dialect's rules: millimetres and quaternions w, x, y, z; welds are `ArcLStart`, `ArcL`, `ArcLEnd`, whose speed
//! stands in welddata; zones reach over less than half a segment, and `fine` begins and ends every seam; names have at
//! most 32 characters and are declared once; linear moves take the robot's nearest configuration (`ConfL\Off`), which
//! the joints of the first point begin; external axes are not used (9E9).

use std::fmt::Write;
use std::ops::Range;

use nalgebra::{Isometry3, UnitQuaternion};

use super::moves::{Move, Switch, TooLong, decimal, parts};
use super::{Dialect, Joints, NO_SAFETY_FUNCTION, ProgramSetup, UNCHECKED_MOVE, WelddataUnit, part_name};
use crate::robot::frame::FrameSource;
use weldpath_files::File;
use weldpath_method::weld::program::Waypoint;

/// Most robtargets of one module. The controller has no published limit: ours, so that its editor stays usable.
const MOST_MOVES: usize = 5000;
/// Zones that every controller knows, and the radius in which they leave the path, mm; largest first.
const ZONES_MM: [(&str, f64); 3] = [("z5", 5.0), ("z1", 1.0), ("z0", 0.3)];
/// The controller's own tool, where the job names none: a module that names a missing tool is not loaded, which is
/// safer than one that moves the flange along the seam.
const TOOL: &str = "tWeldGun";
/// No arc data of ours: the power source's schedule, if there is one, and nothing else.
const NO_ARC: &str = "[0,0,0,0,0,0,0,0,0]";

/// Longest line of a remark: the controller's editor shows no more.
const REMARK: usize = 76;

/// One module, or a main module and its parts.
pub fn write(waypoints: &[Waypoint], setup: &ProgramSetup) -> Result<Vec<File>, TooLong> {
    let moves = setup.moves(waypoints);
    let parts = parts(&moves, MOST_MOVES, "RAPID")?;
    let numbers = Numbers::new(&moves);
    let joints = setup.joints(Dialect::Abb, waypoints.len());
    let writer = Writer { setup, numbers: &numbers, joints: joints.as_ref(), moves: &moves };
    let file = |name: &str, text: String| File::new(format!("{name}.mod"), text);
    if let [] | [_] = parts.as_slice() {
        return Ok(vec![file(&setup.name, writer.module())]);
    }
    let mut files = vec![file(&setup.name, writer.main(parts.len()))];
    for (index, part) in parts.iter().enumerate() {
        let name = part_name(&setup.name, index);
        let run = moves.get(part.clone()).unwrap_or_default();
        let body = targets(run) + &procedure(&format!("{name}_run"), &writer.instructions(part));
        files.push(file(&name, format!("MODULE {name}\n{body}ENDMODULE\n")));
    }
    Ok(files)
}

/// Speeds and zones that are declared once and named at every move.
struct Numbers {
    air_mm_s: Vec<f64>,
    weld_mm_s: Vec<f64>,
    /// Where even z0 would reach over half a segment.
    short_mm: Option<f64>,
}

impl Numbers {
    fn new(moves: &[Move]) -> Self {
        let of = |welding: bool| {
            let mut feeds: Vec<f64> =
                moves.iter().filter(|m| m.welding == welding).map(|m| rounded(m.feed_mm_s)).collect();
            feeds.sort_by(f64::total_cmp);
            feeds.dedup();
            feeds
        };
        let short = moves.iter().map(|m| m.blend_mm).filter(|&mm| mm > 0.0 && zone(mm).is_none());
        Self { air_mm_s: of(false), weld_mm_s: of(true), short_mm: short.min_by(f64::total_cmp) }
    }

    fn declarations(&self, setup: &ProgramSetup) -> String {
        let (name, mut text) = (&setup.name, String::new());
        for (i, feed) in self.air_mm_s.iter().enumerate() {
            let _ = writeln!(text, "  CONST speeddata {name}_v{}:=[{feed},90,1000,1000];", i + 1);
        }
        for (i, feed) in self.weld_mm_s.iter().enumerate() {
            let arc = format!("[{},0,0,0,0,0,0,0,0]", setup.weld_schedule);
            let speed = weld_speed(*feed, setup.welddata_unit);
            let _ = writeln!(text, "  PERS welddata {name}_w{}:=[{speed},0,{arc},{NO_ARC}];", i + 1);
        }
        if let Some(short_mm) = self.short_mm {
            let mm = decimal::<3>((short_mm * 1e3).floor() / 1e3);
            let _ = writeln!(text, "  CONST zonedata {name}_z:=[FALSE,{mm},{mm},{mm},0.1,{mm},0.1];");
        }
        text
    }

    fn speed(&self, name: &str, feed_mm_s: f64, welding: bool) -> String {
        let (feeds, letter) = if welding { (&self.weld_mm_s, 'w') } else { (&self.air_mm_s, 'v') };
        let index = feeds.iter().position(|&feed| feed == rounded(feed_mm_s)).unwrap_or(0);
        format!("{name}_{letter}{}", index + 1)
    }
}

/// A speed, mm/s, in the steps in which speeds are declared: a weave has hundreds that nearly agree, and each is
/// welddata to be edited.
fn rounded(feed_mm_s: f64) -> f64 {
    if feed_mm_s < 1.0 { feed_mm_s } else { (feed_mm_s * 20.0).round() / 20.0 }
}

/// As the controller reads it.
fn weld_speed(feed_mm_s: f64, unit: WelddataUnit) -> String {
    match unit {
        WelddataUnit::MmS => feed_mm_s.to_string(),
        WelddataUnit::InMin => decimal::<4>(feed_mm_s * 60.0 / 25.4),
    }
}

/// The largest zone that every controller knows within `blend_mm`.
fn zone(blend_mm: f64) -> Option<&'static str> {
    ZONES_MM.iter().find(|(_, radius_mm)| *radius_mm <= blend_mm).map(|(name, _)| *name)
}

fn procedure(name: &str, body: &str) -> String {
    format!("  PROC {name}()\n{body}  ENDPROC\n")
}

fn tool(setup: &ProgramSetup) -> String {
    let Some(tool) = setup.written_tool() else {
        if let Some(name) = setup.tool_source.name() {
            return format!("  ! Tool: {name} of the controller.\n");
        }
        return format!("  ! Tool: {TOOL} of the controller; the job file has no [tool].\n");
    };
    let [at, turned] = pose(&tool.flange_from_tcp());
    // A load of no mass, or whose centre is the flange's own, is refused.
    let mass_kg = tool.payload_kg.max(0.001);
    let mut centre_mm = tool.payload_centre_mm;
    if centre_mm == [0.0; 3] {
        centre_mm = [0.0, 0.0, 0.001];
    }
    format!(
        "  PERS tooldata {}_tool:=[TRUE,[{at},{turned}],[{mass_kg},{},[1,0,0,0],0,0,0]];\n",
        setup.name,
        vector(centre_mm)
    )
}

/// Every pose once, in the order in which it is reached.
fn targets(moves: &[Move]) -> String {
    let mut text = String::new();
    for (i, a_move) in moves.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "  LOCAL CONST robtarget p{}:=[{},{},[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];",
            i + 1,
            vector(a_move.position_mm.coords.into()),
            quaternion(&a_move.base_from_tool)
        );
    }
    text
}

/// What the instructions of all modules need.
struct Writer<'a> {
    setup: &'a ProgramSetup,
    numbers: &'a Numbers,
    joints: Option<&'a Joints<'a>>,
    /// Of all modules.
    moves: &'a [Move],
}

impl Writer<'_> {
    fn module(&self) -> String {
        let name = &self.setup.name;
        let run = procedure(&format!("{name}_run"), &self.instructions(&(0..self.moves.len())));
        format!("MODULE {name}\n{}{}{run}ENDMODULE\n", self.declarations(), targets(self.moves))
    }

    fn main(&self, parts: usize) -> String {
        let name = &self.setup.name;
        let calls: String = (0..parts).map(|i| format!("    {}_run;\n", part_name(name, i))).collect();
        let run = procedure(&format!("{name}_run"), &calls);
        format!("MODULE {name}\n{}{run}ENDMODULE\n", self.declarations())
    }

    fn declarations(&self) -> String {
        let setup = self.setup;
        let (name, arc) = (&setup.name, &setup.arc);
        let mut text = format!(
            "  ! Written by weldpath. Call {name}_run. Never run on a controller: try it in RobotStudio first.\n\
             \x20 ! Edit: tool, work object{}, seam data, weld data.\n",
            if setup.frame.is_all_one() { " (identity: the scan's base frame is wobj0)" } else { "" }
        );
        let mut own = vec![NO_SAFETY_FUNCTION.into()];
        own.push(
            "Check in the Arc configuration: weld error recovery and arc process restart. Not verified."
                .into(),
        );
        own.push(match setup.welddata_unit {
            WelddataUnit::MmS => {
                "Speeds of welddata are mm/s: check that the Arc units are SI (US units are inch a minute)."
                    .into()
            }
            WelddataUnit::InMin => {
                "Speeds of welddata are inch a minute: check that the Arc units are US.".into()
            }
        });
        let [at, turned] = pose(&setup.frame.robot_from_frame);
        own.extend(setup.frame.remark(&format!("[{at},{turned}]")));
        if !setup.frame.is_all_one() {
            own.push("The robot's base has to be the world frame: a work object stands in that one.".into());
        }
        own.extend(Joints::remarks(self.joints));
        for remark in setup.head(&own, REMARK) {
            // Writing to a String cannot fail.
            let _ = writeln!(text, "  ! {remark}");
        }
        text.push_str(&tool(setup));
        if setup.frame.name().is_none() {
            let user = match setup.frame.source {
                FrameSource::RobotBase => "[0,0,0],[1,0,0,0]".to_owned(),
                _ => format!("{at},{turned}"),
            };
            let _ = writeln!(
                text,
                "  PERS wobjdata {name}_wobj:=[FALSE,TRUE,\"\",[{user}],[[0,0,0],[1,0,0,0]]];"
            );
        }
        let _ = writeln!(
            text,
            "  PERS seamdata {name}_seam:=[0,{},{NO_ARC},0,0,0,0,0,{NO_ARC},0,{},{NO_ARC},0,0,{NO_ARC},{}];",
            arc.gas_preflow_s, arc.crater_s, arc.gas_postflow_s
        );
        text + &self.numbers.declarations(setup)
    }

    /// Of the moves in `run`; the first part begins the program, and the last one ends it.
    fn instructions(&self, run: &Range<usize>) -> String {
        let mut text = String::new();
        if run.start == 0 {
            text.push_str(&self.opening());
        }
        for (i, index) in run.clone().enumerate() {
            let Some(a_move) = self.moves.get(index) else { break };
            let next = self.moves.get(index + 1);
            let by_joints = self.joints.filter(|_| index == 0);
            if let Some(joints) = by_joints {
                text.push_str(&self.by_joints(joints.first_deg));
            }
            if by_joints.is_none() || a_move.then.is_some() {
                text.push_str(&self.instruction(a_move, next, i, index == 0));
            }
            // At the very end the crater is filled as seamdata says.
            if let Some(wait_s) = a_move.wait_s().filter(|_| a_move.then != Some(Switch::Off)) {
                text.push_str(&format!("    WaitTime {wait_s};\n"));
            }
        }
        if run.end == self.moves.len() {
            if let Some(end_deg) = self.joints.and_then(|joints| joints.end_deg) {
                text.push_str(&self.by_joints(end_deg));
            }
            text.push_str("    ConfL\\On;\n    ConfJ\\On;\n");
        }
        text
    }

    /// Home, or, where there is none but the first move is by joints, a stop until a person starts again.
    fn opening(&self) -> String {
        let mut text = "    ConfJ\\Off;\n    ConfL\\Off;\n    SingArea\\Off;\n".to_owned();
        match self.joints.map(|joints| joints.home_deg) {
            Some(Some(home_deg)) => text.push_str(&self.by_joints(home_deg)),
            Some(None) => {
                text.push_str(&format!(
                    "    TPWrite \"{UNCHECKED_MOVE} Start moves the arm.\";\n    Stop;\n"
                ));
            }
            None => {}
        }
        text
    }

    fn by_joints(&self, joints_deg: [f64; 6]) -> String {
        let joints = joints_deg.map(decimal::<4>).join(",");
        let first_mm_s = self.moves.first().map_or(0.0, |first| first.feed_mm_s);
        let speed = self.numbers.speed(&self.setup.name, first_mm_s, false);
        format!("    MoveAbsJ [[{joints}],[9E9,9E9,9E9,9E9,9E9,9E9]],{speed},fine,{};\n", self.frame())
    }

    fn frame(&self) -> String {
        let name = &self.setup.name;
        let tool = match (self.setup.written_tool(), self.setup.tool_source.name()) {
            (Some(_), _) => format!("{name}_tool"),
            (None, Some(held)) => held.to_owned(),
            (None, None) => TOOL.to_owned(),
        };
        let work_object = self.setup.frame.name().map_or_else(|| format!("{name}_wobj"), str::to_owned);
        format!("{tool}\\WObj:={work_object}")
    }

    fn instruction(&self, a_move: &Move, next: Option<&Move>, index: usize, joint: bool) -> String {
        let (name, numbers, frame) = (&self.setup.name, self.numbers, self.frame());
        let point = index + 1;
        let zone = match zone(a_move.blend_mm) {
            Some(zone) => zone.to_owned(),
            None if a_move.blend_mm > 0.0 => format!("{name}_z"),
            None => "fine".to_owned(),
        };
        // The speed beside welddata holds only while a program is stepped through without the arc.
        let stepped = numbers.speed(name, numbers.air_mm_s.first().copied().unwrap_or(0.0), false);
        let weld = |feed_mm_s| format!("{name}_seam,{}", numbers.speed(name, feed_mm_s, true));
        match (a_move.welding, a_move.then) {
            (false, Some(Switch::On)) => {
                let first_mm_s = next.map_or(a_move.feed_mm_s, |next| next.feed_mm_s);
                let (speed, weld) = (numbers.speed(name, a_move.feed_mm_s, false), weld(first_mm_s));
                format!("    ArcLStart p{point},{speed},{weld},fine,{frame};\n")
            }
            (true, Some(Switch::Off)) => {
                format!("    ArcLEnd p{point},{stepped},{},fine,{frame};\n", weld(a_move.feed_mm_s))
            }
            (true, _) => format!("    ArcL p{point},{stepped},{},{zone},{frame};\n", weld(a_move.feed_mm_s)),
            (false, _) => {
                let command = if joint { "MoveJ" } else { "MoveL" };
                let speed = numbers.speed(name, a_move.feed_mm_s, false);
                format!("    {command} p{point},{speed},fine,{frame};\n")
            }
        }
    }
}

/// Place and rotation.
fn pose(transform: &Isometry3<f64>) -> [String; 2] {
    [vector(transform.translation.vector.into()), quaternion(&transform.rotation)]
}

fn vector(v: [f64; 3]) -> String {
    format!("[{}]", v.map(decimal::<4>).join(","))
}

fn quaternion(q: &UnitQuaternion<f64>) -> String {
    format!("[{}]", [q.w, q.i, q.j, q.k].map(decimal::<8>).join(","))
}
