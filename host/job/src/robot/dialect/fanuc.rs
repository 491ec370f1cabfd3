//! `NAME.ls`: the program as a TP listing, for FANUC controllers with ArcTool.
//!
//! The dialect's rules: millimetres; W, P, R in degrees about the fixed x, y and z; speeds in whole mm/sec or, where
//! the feed is not whole, in whole cm/min; a blend is a share of the deceleration (`CNT0` to `CNT100`) and `FINE` arrives;
//! numbered lines and positions; program names of at most 36 characters (8 before R-30iA), remarks of 32, a comment of 16.

use std::fmt::Write;

use nalgebra::UnitQuaternion;

use super::moves::{
    Move, Switch, TooLong, decimal, euler_zyx_deg, moves, parts, rotation_vector_to_euler_zyx_deg,
};
use super::{ProgramSetup, part_name};
use weldpath_files::File;
use weldpath_method::weld::program::Waypoint;

/// Most positions of one program: with a line for each, their numbers keep four digits.
const MOST_MOVES: usize = 4000;
/// Time in which the robot comes to a stop from any weld speed, s; `CNT` is a share of it. Assumed, not measured:
/// with it a blend stays below half a segment on a robot that decelerates as fast or faster.
const DECELERATION_S: f64 = 0.2;
/// A remark of a TP program has at most 32 characters.
const REMARK: usize = 32;
/// User frame of every position: the robot's world frame.
const FRAME: u32 = 0;

/// One program, or a main program and its parts.
pub fn write(waypoints: &[Waypoint], setup: &ProgramSetup) -> Result<Vec<File>, TooLong> {
    let moves = moves(waypoints);
    let parts = parts(&moves, MOST_MOVES, "FANUC TP")?;
    let name = &setup.name;
    let mut opening = opening(setup);
    if let [] | [_] = parts.as_slice() {
        opening.extend(motions(setup, &moves, true));
        return Ok(vec![program(name, &opening, &positions(setup, &moves))]);
    }
    let names: Vec<String> = (0..parts.len()).map(|i| part_name(name, i)).collect();
    opening.extend(names.iter().map(|part| format!("  CALL {}", part.to_uppercase())));
    let mut files = vec![program(name, &opening, "")];
    for (i, (part, run)) in names.iter().zip(&parts).enumerate() {
        let run = moves.get(run.clone()).unwrap_or_default();
        files.push(program(part, &motions(setup, run, i == 0), &positions(setup, run)));
    }
    Ok(files)
}

fn program(name: &str, lines: &[String], positions: &str) -> File {
    let mut text = format!(
        "/PROG  {}\n/ATTR\nOWNER\t\t= MNEDITOR;\nCOMMENT\t\t= \"weldpath\";\nPROTECT\t\t= READ_WRITE;\n\
         TCD:  STACK_SIZE\t= 0,\n      TASK_PRIORITY\t= 50,\n      TIME_SLICE\t= 0,\n\
         \x20     BUSY_LAMP_OFF\t= 0,\n      ABORT_REQUEST\t= 0,\n      PAUSE_REQUEST\t= 0;\n\
         DEFAULT_GROUP\t= 1,*,*,*,*;\nCONTROL_CODE\t= 00000000 00000000;\n/MN\n",
        name.to_uppercase()
    );
    for (i, line) in lines.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{:4}:{line} ;", i + 1);
    }
    File::new(format!("{name}.ls"), format!("{text}/POS\n{positions}/END\n"))
}

/// What stands before the first move. The tool is set on the pendant: a listing cannot hold it.
fn opening(setup: &ProgramSetup) -> Vec<String> {
    let mut lines = vec!["  !weldpath, never run on a robot".to_owned()];
    lines.push(format!("  !Edit Arc Start[{}] and CONFIG", setup.weld_schedule));
    lines.extend(setup.remark_lines(REMARK).into_iter().map(|remark| format!("  !{remark}")));
    if let Some(tool) = &setup.tool {
        let [x, y, z] = tool.flange_from_tcp_mm.map(decimal::<1>);
        let [r, p, w] = rotation_vector_to_euler_zyx_deg(tool.flange_from_tcp_rotation_rad).map(decimal::<2>);
        lines.push(format!("  !Set UTOOL {}, mm and degrees", setup.tool_number));
        lines.extend([format!("  !X {x} W {w}"), format!("  !Y {y} P {p}"), format!("  !Z {z} R {r}")]);
    } else {
        lines.push(format!("  !UTOOL {} as on the pendant", setup.tool_number));
    }
    lines.push(format!("  UFRAME_NUM={FRAME}"));
    lines.push(format!("  UTOOL_NUM={}", setup.tool_number));
    lines
}

fn motions(setup: &ProgramSetup, moves: &[Move], opens: bool) -> Vec<String> {
    let mut lines = vec![];
    for (i, a_move) in moves.iter().enumerate() {
        let point = i + 1;
        if opens && i == 0 {
            lines.push(format!("J P[{point}] 10% FINE"));
        } else {
            lines.push(format!("L P[{point}] {} {}", speed(a_move.feed_mm_s), termination(a_move)));
        }
        if a_move.then == Some(Switch::On) {
            lines.push(format!("  Arc Start[{}]", setup.weld_schedule));
        }
        if let Some(wait_s) = a_move.wait_s() {
            lines.push(format!("  WAIT {}(sec)", decimal::<2>(wait_s)));
        }
        if a_move.then == Some(Switch::Off) {
            lines.push(format!("  Arc End[{}]", setup.weld_schedule));
        }
    }
    lines
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

fn positions(setup: &ProgramSetup, moves: &[Move]) -> String {
    let mut text = String::new();
    for (i, a_move) in moves.iter().enumerate() {
        text.push_str(&position(i + 1, setup.tool_number, a_move));
    }
    text
}

fn position(point: usize, tool: u32, a_move: &Move) -> String {
    let [x, y, z] = <[f64; 3]>::from(a_move.position_mm.coords).map(decimal::<3>);
    let [w, p, r] = wpr_deg(&a_move.base_from_tool).map(decimal::<4>);
    format!(
        "P[{point}]{{\n   GP1:\n\tUF : {FRAME}, UT : {tool},\t\tCONFIG : 'N U T, 0, 0, 0',\n\
         \tX = {x:>9}  mm,\tY = {y:>9}  mm,\tZ = {z:>9}  mm,\n\
         \tW = {w:>9} deg,\tP = {p:>9} deg,\tR = {r:>9} deg\n}};\n"
    )
}

/// About the fixed x, y and z: the angles about z, turned y and twice turned x, read backwards.
fn wpr_deg(q: &UnitQuaternion<f64>) -> [f64; 3] {
    let [r, p, w] = euler_zyx_deg(q);
    [w, p, r]
}
