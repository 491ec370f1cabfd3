//! `NAME.src` and `NAME.dat`: the program in KRL, for KUKA controllers.
//!
//! The dialect's rules: millimetres; A, B, C in degrees about z, the turned y, the twice turned x; `$VEL.CP` in m/s;
//! linear moves to FRAMEs, which need no status and turn; corners are cut by `C_DIS` with `$APO.CDIS` below half a
//! segment, and a move without it arrives; names have at most 24 characters. The arc is switched by two routines at
//! the end of the main module, by digital outputs: the place to put ARCON and ARCOFF of ArcTech instead.

use std::fmt::Write;

use nalgebra::UnitQuaternion;

use super::moves::{
    Move, Switch, TooLong, decimal, euler_zyx_deg, moves, parts, rotation_vector_to_euler_zyx_deg,
};
use super::{ProgramSetup, part_name};
use crate::robot::arc::WeldingArc;
use crate::robot::tool::Tool;
use weldpath_files::File;
use weldpath_method::weld::program::Waypoint;

/// Most points of one module. KUKA publishes no limit; pendants' editors become slow beyond a few thousand lines.
const MOST_MOVES: usize = 1500;
/// Speed of the first, joint move: unknown ground.
const FIRST_PERCENT: u32 = 10;

/// One module, or a main module and its parts.
pub fn write(waypoints: &[Waypoint], setup: &ProgramSetup) -> Result<Vec<File>, TooLong> {
    let moves = moves(waypoints);
    let parts = parts(&moves, MOST_MOVES, "KRL")?;
    let name = &setup.name;
    if let [] | [_] = parts.as_slice() {
        return Ok(vec![source(name, &main(setup, &motions(name, &moves, true))), data(name, &moves)]);
    }
    let names: Vec<String> = (0..parts.len()).map(|i| part_name(name, i)).collect();
    let calls: String = names.iter().map(|part| format!("{part}()\n")).collect();
    let mut files = vec![source(name, &main(setup, &calls)), data(name, &[])];
    for (i, (part, run)) in names.iter().zip(&parts).enumerate() {
        let run = moves.get(run.clone()).unwrap_or_default();
        files.push(source(part, &format!("DEF {part}()\n{}END\n", motions(name, run, i == 0))));
        files.push(data(part, run));
    }
    Ok(files)
}

fn source(name: &str, body: &str) -> File {
    File::new(format!("{name}.src"), format!("&ACCESS RVP\n&REL 1\n{body}"))
}

/// The points; in the main module of a divided program there are none.
fn data(name: &str, moves: &[Move]) -> File {
    let mut text = format!(
        "&ACCESS RVP\n&REL 1\nDEFDAT {name} PUBLIC\n\
         ;FOLD EXTERNAL DECLARATIONS\nEXT BAS (BAS_COMMAND :IN,REAL :IN)\n;ENDFOLD\n"
    );
    for (i, a_move) in moves.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "DECL FRAME XP{}={}",
            i + 1,
            frame(a_move.position_mm.coords.into(), &a_move.base_from_tool)
        );
    }
    File::new(format!("{name}.dat"), text + "ENDDAT\n")
}

fn main(setup: &ProgramSetup, body: &str) -> String {
    let name = &setup.name;
    format!(
        "DEF {name}()\n\
         ; Written by weldpath. Never run on a controller: try it in KUKA.Sim or T1 first.\n\
         ; Edit: tool, base, and the two arc routines below.\n\
         {}\
         ;FOLD INI\n\
         GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM()\n\
         INTERRUPT ON 3\n\
         BAS(#INITMOV,0)\n\
         ;ENDFOLD (INI)\n\
         {}\
         ; The scan's base frame is the robot's root.\n\
         $BASE=$ROBROOT\n\
         $IPO_MODE=#BASE\n\
         $ORI_TYPE=#VAR\n\
         BAS(#VEL_PTP,{FIRST_PERCENT})\n\
         {name}_arc_off()\n\
         PTP $AXIS_ACT\n\
         {body}\
         END\n\
         {}{}",
        remarks(setup),
        tool(setup),
        arc_on(name, &setup.arc),
        arc_off(name, &setup.arc)
    )
}

/// Remarks in the head, of lines that the pendant shows whole.
fn remarks(setup: &ProgramSetup) -> String {
    setup.remark_lines(76).iter().map(|remark| format!("; {remark}\n")).collect()
}

fn tool(setup: &ProgramSetup) -> String {
    let Some(Tool { flange_from_tcp_mm, flange_from_tcp_rotation_rad, payload_kg, payload_centre_mm }) =
        setup.tool
    else {
        return format!(
            "; Tool of the controller; the job file has no [tool].\nBAS(#TOOL,{})\n",
            setup.tool_number
        );
    };
    let [a, b, c] = rotation_vector_to_euler_zyx_deg(flange_from_tcp_rotation_rad).map(decimal::<4>);
    let [x, y, z] = flange_from_tcp_mm.map(decimal::<3>);
    let [cx, cy, cz] = payload_centre_mm.map(decimal::<3>);
    format!(
        "$TOOL={{X {x},Y {y},Z {z},A {a},B {b},C {c}}}\n\
         $LOAD={{M {payload_kg},CM {{X {cx},Y {cy},Z {cz},A 0,B 0,C 0}},J {{X 0,Y 0,Z 0}}}}\n"
    )
}

/// Speeds and blend radii are set where they change.
fn motions(name: &str, moves: &[Move], opens: bool) -> String {
    let (mut text, mut speed, mut blend) = (String::new(), String::new(), String::new());
    for (i, a_move) in moves.iter().enumerate() {
        let now = decimal::<6>(a_move.feed_mm_s / 1e3);
        if now != speed {
            text.push_str(&format!("$VEL.CP={now}\n"));
            speed = now;
        }
        let blended = a_move.blend_mm > 0.0;
        let radius = decimal::<3>((a_move.blend_mm * 1e3).floor() / 1e3);
        if blended && radius != blend {
            text.push_str(&format!("$APO.CDIS={radius}\n"));
            blend = radius;
        }
        let command = if opens && i == 0 { "PTP" } else { "LIN" };
        let _ = writeln!(text, "{command} XP{}{}", i + 1, if blended { " C_DIS" } else { "" });
        if a_move.then == Some(Switch::On) {
            text.push_str(&format!("{name}_arc_on()\n"));
        }
        text.push_str(&wait(a_move.dwell_s.unwrap_or(0.0)));
        if a_move.then == Some(Switch::Off) {
            text.push_str(&format!("{name}_arc_off()\n"));
        }
    }
    text
}

fn arc_on(name: &str, arc: &WeldingArc) -> String {
    let mut text = format!(
        "GLOBAL DEF {name}_arc_on()\n; Edit: $OUT[{}] starts the power source; or ARCON of ArcTech.\n",
        number(arc.output)
    );
    if let Some(gas) = arc.gas_output {
        text.push_str(&format!("$OUT[{}]=TRUE\n{}", number(gas), wait(arc.gas_preflow_s)));
    }
    text.push_str(&format!("$OUT[{}]=TRUE\n", number(arc.output)));
    // Without a valve of ours the power source opens its own when it is started.
    let own_preflow_s = if arc.gas_output.is_none() { arc.gas_preflow_s } else { 0.0 };
    let strike_s = arc.strike_s + own_preflow_s;
    match arc.established_input {
        Some(input) => text.push_str(&wait_for(name, number(input), strike_s)),
        None => text.push_str(&wait(strike_s)),
    }
    text + "END\n"
}

/// Where no arc comes within the time, everything is off and stays so: pressing start again does not weld on.
fn wait_for(name: &str, input: u32, timeout_s: f64) -> String {
    format!(
        "$TIMER[1]=0\n$TIMER_STOP[1]=FALSE\n\
         WHILE NOT $IN[{input}]\n\
         IF $TIMER[1]>{} THEN\n\
         {name}_arc_off()\n\
         LOOP\n\
         HALT\n\
         ENDLOOP\n\
         ENDIF\n\
         WAIT SEC 0.012\n\
         ENDWHILE\n\
         $TIMER_STOP[1]=TRUE\n",
        (timeout_s * 1e3).round()
    )
}

fn arc_off(name: &str, arc: &WeldingArc) -> String {
    let mut text = format!("GLOBAL DEF {name}_arc_off()\n; Edit: or ARCOFF of ArcTech.\n");
    text.push_str(&format!("IF $OUT[{}] THEN\n{}ENDIF\n", number(arc.output), wait(arc.crater_s)));
    text.push_str(&format!("$OUT[{}]=FALSE\n", number(arc.output)));
    if let Some(gas) = arc.gas_output {
        let gas = number(gas);
        text.push_str(&format!(
            "IF $OUT[{gas}] THEN\n{}ENDIF\n$OUT[{gas}]=FALSE\n",
            wait(arc.gas_postflow_s)
        ));
    } else {
        text.push_str(&wait(arc.gas_postflow_s));
    }
    text + "END\n"
}

/// KUKA counts from 1 what the job counts from 0.
fn number(channel: u8) -> u32 {
    u32::from(channel) + 1
}

fn wait(time_s: f64) -> String {
    if time_s > 0.0 { format!("WAIT SEC {time_s}\n") } else { String::new() }
}

fn frame(position_mm: [f64; 3], base_from_tool: &UnitQuaternion<f64>) -> String {
    let [x, y, z] = position_mm.map(decimal::<3>);
    let [a, b, c] = euler_zyx_deg(base_from_tool).map(decimal::<4>);
    format!("{{X {x},Y {y},Z {z},A {a},B {b},C {c}}}")
}
