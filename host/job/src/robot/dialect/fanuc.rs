//! `NAME.ls`: the program as a TP listing, for FANUC controllers with ArcTool.
//!
//! The dialect's rules: millimetres; W, P, R in degrees about the fixed x, y and z; speeds in whole mm/sec or, where
//! the feed is not whole, in whole cm/min; a blend is a share of the deceleration (`CNT0` to `CNT100`) and `FINE` arrives;
//! numbered lines and positions; program names of at most 36 characters (8 before R-30iA), remarks of 32, a comment of 16.
//! CONFIG of a point: wrist, elbow, front, and the turns of joints 1, 4 and 6. Wrist and turns by the rule of a public
//! post-processor (robodk_postprocessors, Fanuc_R30iA); elbow and front by the stance, not verified.

use std::fmt::Write;
use std::ops::Range;

use nalgebra::{Isometry3, UnitQuaternion};

use super::moves::{Move, Switch, TooLong, decimal, euler_zyx_deg, parts};
use super::{Dialect, Joints, NO_SAFETY_FUNCTION, ProgramSetup, Stance, part_name};
use crate::robot::frame::{FrameSource, ToolSource};
use crate::robot::tool::Tool;
use weldpath_files::File;
use weldpath_method::weld::program::Waypoint;

/// Most positions of one program: with a line for each, their numbers keep four digits.
const MOST_MOVES: usize = 4000;
/// Time in which the robot comes to a stop from any weld speed, s; `CNT` is a share of it. Assumed, not measured:
/// with it a blend stays below half a segment on a robot that decelerates as fast or faster.
const DECELERATION_S: f64 = 0.2;
/// A remark of a TP program has at most 32 characters.
const REMARK: usize = 32;
/// User frame of every position where the job names none: the robot's world frame.
const WORLD: u32 = 0;

/// Where no stance is known: wrist not flipped, elbow up, in front, no turns.
const UNKNOWN: &str = "N U T, 0, 0, 0";

/// One program, or a main program and its parts.
pub fn write(waypoints: &[Waypoint], setup: &ProgramSetup) -> Result<Vec<File>, TooLong> {
    let moves = setup.moves(waypoints);
    let parts = parts(&moves, MOST_MOVES, "FANUC TP")?;
    let name = &setup.name;
    let joints = setup.joints(Dialect::Fanuc, waypoints.len());
    let mut opening = opening(setup, joints.as_ref());
    let part = |run| Part { setup, moves: &moves, joints: joints.as_ref(), run };
    if let [] | [_] = parts.as_slice() {
        let whole = part(0..moves.len());
        opening.extend(whole.motions());
        return Ok(vec![program(name, &opening, &whole.positions())]);
    }
    let names: Vec<String> = (0..parts.len()).map(|i| part_name(name, i)).collect();
    opening.extend(names.iter().map(|part| format!("  CALL {}", part.to_uppercase())));
    let mut files = vec![program(name, &opening, "")];
    for (name, run) in names.iter().zip(&parts) {
        let part = part(run.clone());
        files.push(program(name, &part.motions(), &part.positions()));
    }
    Ok(files)
}

fn program(name: &str, lines: &[String], positions: &str) -> File {
    let mut text = format!(
        "/PROG  {}\n/ATTR\nOWNER\t\t= MNEDITOR;\nCOMMENT\t\t= \"weldpath\";\nPROTECT\t\t= READ_WRITE;\n\
         TCD:  STACK_SIZE\t= 0,\n      TASK_PRIORITY\t= 50,\n      TIME_SLICE\t= 0,\n\
         \x20     BUSY_LAMP_OFF\t= 0,\n      ABORT_REQUEST\t= 0,\n      PAUSE_REQUEST\t= 0;\n\
         DEFAULT_GROUP\t= 1,*,*,*,*;\nCONTROL_CODE\t= 00000000 00000000;\n\
         /APPL\n  ARC Welding Equipment : 1,*,*,*,*;\n/MN\n",
        name.to_uppercase()
    );
    for (i, line) in lines.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{:4}:{line} ;", i + 1);
    }
    File::new(format!("{name}.ls"), format!("{text}/POS\n{positions}/END\n"))
}

/// What stands before the first move. The tool is set on the pendant: a listing cannot hold it.
fn opening(setup: &ProgramSetup, joints: Option<&Joints>) -> Vec<String> {
    let mut lines = vec!["  !weldpath, never run on a robot".to_owned()];
    lines.push(format!("  !Edit {} and CONFIG", weld_instruction(setup, "Start")));
    let mut own = vec![NO_SAFETY_FUNCTION.into()];
    own.push("Check on the controller: Arc enable, weld restart (Resume). Not verified.".into());
    let [x, y, z, w, p, r] = xyzwpr(&setup.frame.robot_from_frame);
    own.extend(setup.frame.remark(&format!("X {x} Y {y} Z {z} W {w} P {p} R {r}")));
    own.extend(Joints::remarks(joints));
    if joints.is_some() {
        own.push("CONFIG: U/D and T/B are not verified.".into());
    }
    lines.extend(setup.head(&own, REMARK).into_iter().map(|remark| format!("  !{remark}")));
    let registers = [
        (setup.frame.register(), "UFRAME", user_frame(setup), Some(setup.frame.robot_from_frame)),
        (
            setup.tool_source.register(),
            "UTOOL",
            setup.tool_number,
            setup.tool.as_ref().map(Tool::flange_from_tcp),
        ),
    ];
    for (register, kind, number, transform) in registers {
        if let (Some(register), Some(transform)) = (register, transform) {
            lines.extend(by_register(register, kind, number, &transform));
        }
    }
    let number = setup.tool_number;
    match (&setup.tool_source, &setup.tool) {
        (ToolSource::Register { .. }, _) => {}
        (ToolSource::Held(_), _) => lines.push(format!("  !UTOOL {number} of the controller")),
        (ToolSource::Usual, None) => lines.push(format!("  !UTOOL {number} as on the pendant")),
        (ToolSource::Usual, Some(tool)) => {
            let [x, y, z] = tool.flange_from_tcp_mm.map(decimal::<1>);
            let [w, p, r] = wpr_deg(&tool.flange_from_tcp().rotation).map(decimal::<2>);
            lines.push(format!("  !Set UTOOL {number}, mm and degrees"));
            lines.extend([format!("  !X {x} W {w}"), format!("  !Y {y} P {p}"), format!("  !Z {z} R {r}")]);
        }
    }
    lines.push(format!("  UFRAME_NUM={}", user_frame(setup)));
    lines.push(format!("  UTOOL_NUM={}", setup.tool_number));
    lines
}

/// Of the positions.
fn user_frame(setup: &ProgramSetup) -> u32 {
    match setup.frame.source {
        FrameSource::Program { number, .. } => number.unwrap_or(WORLD),
        _ => setup.frame.number().unwrap_or(WORLD),
    }
}

/// Sets a user frame or tool. A register has no single numbers before it holds a position, so it first takes the robot's.
fn by_register(register: u32, kind: &str, number: u32, transform: &Isometry3<f64>) -> Vec<String> {
    let values = xyzwpr(transform).into_iter().enumerate();
    let values = values.map(|(i, value)| match value.strip_prefix('-') {
        Some(value) => format!("  PR[{register},{}]=(-{value})", i + 1),
        None => format!("  PR[{register},{}]={value}", i + 1),
    });
    let first =
        [format!("  !Overwrites PR[{register}] and {kind} {number}"), format!("  PR[{register}]=LPOS")];
    first.into_iter().chain(values).chain([format!("  {kind}[{number}]=PR[{register}]")]).collect()
}

/// mm and degrees.
fn xyzwpr(transform: &Isometry3<f64>) -> [String; 6] {
    let [x, y, z] = <[f64; 3]>::from(transform.translation.vector).map(decimal::<3>);
    let [w, p, r] = wpr_deg(&transform.rotation).map(decimal::<4>);
    [x, y, z, w, p, r]
}

/// The moves of one program; its positions are numbered from 1, home stands after the points.
struct Part<'a> {
    setup: &'a ProgramSetup,
    /// Of all parts.
    moves: &'a [Move],
    joints: Option<&'a Joints<'a>>,
    /// Which of them are in this part.
    run: Range<usize>,
}

impl Part<'_> {
    fn moves(&self) -> &[Move] {
        self.moves.get(self.run.clone()).unwrap_or_default()
    }

    /// Home before the first point, if this is the first part and there is a home.
    fn begins_deg(&self) -> Option<[f64; 6]> {
        self.joints.filter(|_| self.run.start == 0)?.home_deg
    }

    fn ends_deg(&self) -> Option<[f64; 6]> {
        self.joints.filter(|_| self.run.end == self.moves.len())?.end_deg
    }

    fn motions(&self) -> Vec<String> {
        let mut lines = vec![];
        let home = format!("J P[{}] 10% FINE", self.run.len() + 1);
        if self.begins_deg().is_some() {
            lines.push(home.clone());
        } else if self.joints.is_some() && self.run.start == 0 {
            lines.extend(["  MESSAGE[NEXT MOVE NOT CHECKED]".to_owned(), "  PAUSE".to_owned()]);
        }
        for (i, a_move) in self.moves().iter().enumerate() {
            let point = i + 1;
            if self.run.start + i == 0 {
                lines.push(format!("J P[{point}] 10% FINE"));
            } else {
                lines.push(format!("L P[{point}] {} {}", speed(a_move.feed_mm_s), termination(a_move)));
            }
            if a_move.then == Some(Switch::On) {
                lines.push(format!("  {}", weld_instruction(self.setup, "Start")));
            }
            if let Some(wait_s) = a_move.wait_s() {
                lines.push(format!("  WAIT {}(sec)", decimal::<2>(wait_s)));
            }
            if a_move.then == Some(Switch::Off) {
                lines.push(format!("  {}", weld_instruction(self.setup, "End")));
            }
        }
        if self.ends_deg().is_some() {
            lines.push(home);
        }
        lines
    }

    fn positions(&self) -> String {
        let numbers = [user_frame(self.setup), self.setup.tool_number];
        let mut text = String::new();
        for (i, a_move) in self.moves().iter().enumerate() {
            let (point, index) = (i + 1, self.run.start + i);
            let stance = self.joints.and_then(|joints| joints.stances.get(index));
            text.push_str(&match stance.filter(|_| index == 0) {
                Some(stance) => joint_position(point, numbers, stance.joints_deg),
                None => position(point, numbers, &stance.map_or(UNKNOWN.to_owned(), config), a_move),
            });
        }
        if let Some(home_deg) = self.begins_deg().or(self.ends_deg()) {
            text.push_str(&joint_position(self.run.len() + 1, numbers, home_deg));
        }
        text
    }
}

/// With a weld procedure, as newer controllers have it, or by the schedule alone.
fn weld_instruction(setup: &ProgramSetup, which: &str) -> String {
    match setup.weld_procedure {
        Some(procedure) => format!("Weld {which}[{procedure},{}]", setup.weld_schedule),
        None => format!("Arc {which}[{}]", setup.weld_schedule),
    }
}

/// `F` or `N`, `U` or `D`, `T` or `B`, and the turns.
fn config(stance: &Stance) -> String {
    let [j1, _, _, j4, j5, j6] = stance.joints_deg;
    let wrist = if j5 >= 0.0 { 'F' } else { 'N' };
    let elbow = if stance.elbow_up { 'U' } else { 'D' };
    let facing = if stance.front { 'T' } else { 'B' };
    let [j1, j4, j6] = [j1, j4, j6].map(turns);
    format!("{wrist} {elbow} {facing}, {j1}, {j4}, {j6}")
}

/// Whole turns of a joint: 0 between -180 and 180 degrees, neither included.
fn turns(joint_deg: f64) -> i32 {
    let turns = ((joint_deg.abs() + 180.0) / 360.0).floor() as i32;
    if joint_deg < 0.0 { -turns } else { turns }
}

/// Speeds of a linear move are whole numbers: cm/min is the finer of the units.
fn speed(feed_mm_s: f64) -> String {
    if feed_mm_s.fract() == 0.0 && feed_mm_s >= 1.0 {
        format!("{feed_mm_s}mm/sec")
    } else {
        format!("{}cm/min", (feed_mm_s * 6.0).round().max(1.0))
    }
}

/// `CNT100` begins the next move when the robot begins to decelerate, at half the way that this takes from the corner.
fn termination(a_move: &Move) -> String {
    if a_move.blend_mm <= 0.0 {
        return "FINE".into();
    }
    let full_mm = 0.5 * a_move.feed_mm_s * DECELERATION_S;
    format!("CNT{}", (100.0 * a_move.blend_mm / full_mm).floor().clamp(0.0, 100.0))
}

fn position(point: usize, [frame, tool]: [u32; 2], config: &str, a_move: &Move) -> String {
    let [x, y, z] = <[f64; 3]>::from(a_move.position_mm.coords).map(decimal::<3>);
    let [w, p, r] = wpr_deg(&a_move.base_from_tool).map(decimal::<4>);
    format!(
        "P[{point}]{{\n   GP1:\n\tUF : {frame}, UT : {tool},\t\tCONFIG : '{config}',\n\
         \tX = {x:>9}  mm,\tY = {y:>9}  mm,\tZ = {z:>9}  mm,\n\
         \tW = {w:>9} deg,\tP = {p:>9} deg,\tR = {r:>9} deg\n}};\n"
    )
}

fn joint_position(point: usize, [frame, tool]: [u32; 2], joints_deg: [f64; 6]) -> String {
    let [j1, j2, j3, j4, j5, j6] = joints_deg.map(decimal::<4>);
    format!(
        "P[{point}]{{\n   GP1:\n\tUF : {frame}, UT : {tool},\n\
         \tJ1 = {j1:>9} deg,\tJ2 = {j2:>9} deg,\tJ3 = {j3:>9} deg,\n\
         \tJ4 = {j4:>9} deg,\tJ5 = {j5:>9} deg,\tJ6 = {j6:>9} deg\n}};\n"
    )
}

/// About the fixed x, y and z: the angles about z, turned y and twice turned x, read backwards.
fn wpr_deg(q: &UnitQuaternion<f64>) -> [f64; 3] {
    let [r, p, w] = euler_zyx_deg(q);
    [w, p, r]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rule of robodk_postprocessors' Fanuc_R30iA, told anew: whole turns are taken off, toward zero, until the
    /// joint is between -180 and 180 degrees, neither included; the wrist is `F` from J5 = 0 up.
    fn public_rule(joints_deg: [f64; 6]) -> String {
        let turns = |mut deg: f64| {
            let (mut turns, sign) = (0, if deg < 0.0 { -1 } else { 1 });
            while deg * f64::from(sign) >= 180.0 {
                (deg, turns) = (deg - 360.0 * f64::from(sign), turns + sign);
            }
            turns
        };
        let wrist = if joints_deg[4].is_sign_negative() { 'N' } else { 'F' };
        format!("{wrist}, {}, {}, {}", turns(joints_deg[0]), turns(joints_deg[3]), turns(joints_deg[5]))
    }

    #[test]
    fn wrist_and_turns_follow_the_public_rule() {
        let mut state = 1_u64;
        let mut degrees = || {
            // Knuth's multiplier: any joints within two turns and a half.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5) * 1800.0
        };
        let edges = [-540.0, -180.0, -179.999, 179.999, 180.0, 539.999].map(|deg| [deg; 6]);
        let any = (0..1000).map(|_| std::array::from_fn(|_| degrees())).collect::<Vec<[f64; 6]>>();
        for joints_deg in edges.into_iter().chain(any) {
            let stance = Stance { joints_deg, front: true, elbow_up: true };
            assert_eq!(config(&stance).replace(" U T", ""), public_rule(joints_deg), "{joints_deg:?}");
            let behind = Stance { front: false, elbow_up: false, ..stance };
            assert_eq!(config(&behind).replace(" D B", ""), public_rule(joints_deg));
        }
    }
}
