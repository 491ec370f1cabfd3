//! `NAME.src`, `NAME.dat` and `NAME_sps.txt`: the program in KRL, for KUKA controllers.
//!
//! The dialect's rules: millimetres; A, B, C in degrees about z, the turned y, the twice turned x; `$VEL.CP` in m/s;
//! linear moves to FRAMEs, which need no status and turn; corners are cut by `C_DIS` with `$APO.CDIS` below half a
//! segment, and a move without it arrives; names have at most 24 characters.
//!
//! Outputs keep their state when a program stops. So the program switches flags, and lines for the submit interpreter
//! join them with the state of the program: a stop puts arc and gas out for good, and an interrupt ends the program when
//! it goes on. The flags are switched by two routines at the end of the main module: the place to put ARCON and ARCOFF
//! of ArcTech instead.

use std::fmt::Write;

use nalgebra::{Isometry3, UnitQuaternion};

use super::moves::{Move, Switch, TooLong, decimal, euler_zyx_deg, parts};
use super::{Dialect, Joints, NO_SAFETY_FUNCTION, ProgramSetup, UNCHECKED_MOVE, part_name};
use crate::robot::arc::WeldingArc;
use crate::robot::frame::{FrameSource, ProgramFrame};
use weldpath_files::File;
use weldpath_method::weld::program::Waypoint;

/// Most points of one module. KUKA publishes no limit; pendants' editors become slow beyond a few thousand lines.
const MOST_MOVES: usize = 1500;
/// Time in which the submit interpreter has switched an output, s. Assumed: some of its cycles of 12 ms.
const SUBMIT_S: f64 = 0.1;
/// Speed of the joint moves: unknown ground.
const FIRST_PERCENT: u32 = 10;

/// Longest line of a remark: a screen of the pendant.
const REMARK: usize = 100;
/// The interrupt that ends a broken weld. KUKA's own programs use 3.
const INTERRUPT: u32 = 20;

/// Flags that program and submit interpreter share. Any five that the cell does not use.
mod flag {
    /// The program wants the arc.
    pub(super) const ARC: u32 = 901;
    /// The program wants gas.
    pub(super) const GAS: u32 = 902;
    /// A weld has begun, and what it began with has to stay on.
    pub(super) const WELD: u32 = 903;
    /// The input of the established arc has to stay on.
    pub(super) const ESTABLISHED: u32 = 904;
    /// The weld is broken; it flickers, so that the interrupt sees an edge after any stop.
    pub(super) const BROKEN: u32 = 905;
}

/// One module, or a main module and its parts; the lines for the submit interpreter.
pub fn write(waypoints: &[Waypoint], setup: &ProgramSetup) -> Result<Vec<File>, TooLong> {
    let moves = setup.moves(waypoints);
    let parts = parts(&moves, MOST_MOVES, "KRL")?;
    let name = &setup.name;
    let joints = setup.joints(Dialect::Kuka, waypoints.len());
    let submit = File::new(format!("{name}_sps.txt"), indented(&submit(setup)));
    if let [] | [_] = parts.as_slice() {
        let body = motions(name, &moves, 0, joints.as_ref());
        return Ok(vec![source(name, &main(setup, joints.as_ref(), &body)), data(name, &moves), submit]);
    }
    let names: Vec<String> = (0..parts.len()).map(|i| part_name(name, i)).collect();
    let calls: String = names.iter().map(|part| format!("{part}()\n")).collect();
    let mut files = vec![source(name, &main(setup, joints.as_ref(), &calls)), data(name, &[]), submit];
    for (part, run) in names.iter().zip(&parts) {
        let moves = moves.get(run.clone()).unwrap_or_default();
        let body = motions(name, moves, run.start, joints.as_ref());
        files.push(source(part, &format!("DEF {part}()\n{body}END\n")));
        files.push(data(part, moves));
    }
    Ok(files)
}

fn source(name: &str, body: &str) -> File {
    File::new(format!("{name}.src"), format!("&ACCESS RVP\n&REL 1\n{}", indented(body)))
}

/// Lines of a block stand three columns to the right of its first.
fn indented(text: &str) -> String {
    let (mut lines, mut depth) = (String::new(), 0usize);
    for line in text.lines() {
        let word = line.split(' ').next().unwrap_or_default();
        let closes = matches!(word, "ENDIF" | "ENDWHILE" | "ENDLOOP" | "ELSE");
        depth = depth.saturating_sub(usize::from(closes));
        lines.extend(std::iter::repeat_n("   ", depth).chain([line, "\n"]));
        depth += usize::from(matches!(word, "IF" | "WHILE" | "LOOP" | "ELSE"));
    }
    lines
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

fn main(setup: &ProgramSetup, joints: Option<&Joints>, body: &str) -> String {
    let name = &setup.name;
    let home = joints.and_then(|joints| joints.end_deg).map(by_joints).unwrap_or_default();
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
         INTERRUPT DECL {INTERRUPT} WHEN $FLAG[{}]==TRUE DO {name}_lost()\n\
         INTERRUPT ON {INTERRUPT}\n\
         {}\
         {}\
         $IPO_MODE=#BASE\n\
         $ORI_TYPE=#VAR\n\
         BAS(#VEL_PTP,{FIRST_PERCENT})\n\
         PTP $AXIS_ACT\n\
         {body}\
         {home}\
         END\n\
         {}{}{}",
        remarks(setup, joints),
        flags_off(),
        flag::BROKEN,
        tool(setup),
        base(&setup.frame),
        arc_on(name, &setup.arc),
        arc_off(name, &setup.arc),
        lost(name)
    )
}

fn remarks(setup: &ProgramSetup, joints: Option<&Joints>) -> String {
    let name = &setup.name;
    let mut own = vec![
        NO_SAFETY_FUNCTION.into(),
        format!(
            "Needs the lines of {name}_sps.txt in the submit interpreter: they switch arc and gas by flags {} to {}.",
            flag::ARC,
            flag::BROKEN
        ),
        "A stop puts arc and gas out; one during a weld ends the program on resume. Not verified.".into(),
        setup.arc_remark().into(),
    ];
    own.extend(setup.frame.remark(&frame_of(&setup.frame.robot_from_frame)));
    own.extend(Joints::remarks(joints));
    comments(&setup.head(&own, REMARK))
}

fn comments(lines: &[String]) -> String {
    lines.iter().map(|line| format!("; {line}\n")).collect()
}

/// Lines for the loop of SPS.SUB. Once a stop has taken the flags back only the program sets them again.
fn submit(setup: &ProgramSetup) -> String {
    let (name, arc) = (&setup.name, &setup.arc);
    let (gas, established) = (arc.gas_output.map(number), arc.established_input.map(number));
    let mut text = comments(&[
        format!("Written by weldpath, for {name}. Never run on a controller."),
        "Put these lines into the endless loop of SPS.SUB (KRC:\\R1\\System), fold USER PLC, once for all"
            .into(),
        "programs of weldpath with the same [arc]. Edit the flags if the cell uses them.".into(),
        NO_SAFETY_FUNCTION.into(),
        "Second hand, not verified: $PRO_ACT is TRUE while a program runs, $ALARM_STOP is TRUE while there"
            .into(),
        "is no emergency stop, outputs keep their state at a stop. Were $ALARM_STOP the other way round,"
            .into(),
        "there would be no arc at all.".into(),
    ]);
    let out = off(&[flag::ARC, flag::GAS]);
    text.push_str(&format!("IF NOT $PRO_ACT OR NOT $ALARM_STOP OR $STOPMESS THEN\n{out}ENDIF\n"));
    let begun = if gas.is_some() { flag::GAS } else { flag::ARC };
    let mut broken = format!("($FLAG[{}] AND NOT $FLAG[{begun}])", flag::WELD);
    if let Some(input) = established {
        broken.push_str(&format!(" OR ($FLAG[{}] AND NOT $IN[{input}])", flag::ESTABLISHED));
    }
    text.push_str(&format!(
        "IF {broken} THEN\n{out}$FLAG[{0}]=$PRO_ACT AND NOT $FLAG[{0}]\nELSE\n$FLAG[{0}]=FALSE\nENDIF\n",
        flag::BROKEN
    ));
    text.push_str(&format!("$OUT[{}]=$FLAG[{}]\n", number(arc.output), flag::ARC));
    if let Some(gas) = gas {
        text.push_str(&format!("$OUT[{gas}]=$FLAG[{}]\n", flag::GAS));
    }
    text
}

fn flags_off() -> String {
    off(&[flag::WELD, flag::ESTABLISHED, flag::ARC, flag::GAS])
}

fn off(flags: &[u32]) -> String {
    flags.iter().map(|flag| format!("$FLAG[{flag}]=FALSE\n")).collect()
}

/// Everything off, for good: pressing start again does not weld on.
fn give_up() -> String {
    flags_off() + "LOOP\nHALT\nENDLOOP\n"
}

/// The interrupt's routine: it never goes back to the weld.
fn lost(name: &str) -> String {
    format!(
        "GLOBAL DEF {name}_lost()\n\
         ; The program was stopped during a weld, or the arc went out. Check the seam, then run another program.\n\
         BRAKE F\n\
         {}\
         END\n",
        give_up()
    )
}

fn tool(setup: &ProgramSetup) -> String {
    let Some(tool) = setup.written_tool() else {
        let why = if setup.tool_source.is_held() { "" } else { "; the job file has no [tool]" };
        return format!("; Tool of the controller{why}.\nBAS(#TOOL,{})\n", setup.tool_number);
    };
    let [cx, cy, cz] = tool.payload_centre_mm.map(decimal::<3>);
    format!(
        "$TOOL={}\n\
         $LOAD={{M {},CM {{X {cx},Y {cy},Z {cz},A 0,B 0,C 0}},J {{X 0,Y 0,Z 0}}}}\n",
        frame_of(&tool.flange_from_tcp()),
        tool.payload_kg
    )
}

/// Poses count in `$BASE`, which stands in the world frame.
fn base(frame: &ProgramFrame) -> String {
    match (&frame.source, frame.number()) {
        (FrameSource::RobotBase, _) if frame.is_all_one() => {
            "; The scan's base frame is the robot's root.\n$BASE=$ROBROOT\n".into()
        }
        (FrameSource::RobotBase, _) => "$BASE=$ROBROOT\n".into(),
        (_, Some(number)) => format!("BAS(#BASE,{number})\n"),
        _ => {
            let typed = frame_of(&frame.robot_from_frame).replacen('{', "{FRAME: ", 1);
            format!("$BASE=$ROBROOT:{typed}\n")
        }
    }
}

fn frame_of(transform: &Isometry3<f64>) -> String {
    frame(transform.translation.vector.into(), &transform.rotation)
}

/// Speeds and blend radii are set where they change. `from` is the place of the first move in the whole program.
fn motions(name: &str, moves: &[Move], from: usize, joints: Option<&Joints>) -> String {
    let (mut text, mut speed, mut blend) = (String::new(), String::new(), String::new());
    if let Some(joints) = joints.filter(|_| from == 0) {
        text.push_str(&match joints.home_deg {
            Some(home_deg) => by_joints(home_deg),
            None => format!("; {UNCHECKED_MOVE} Start moves the arm.\nHALT\n"),
        });
    }
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
        let first = from + i == 0;
        match joints.filter(|_| first) {
            Some(joints) => text.push_str(&by_joints(joints.first_deg)),
            None => {
                let command = if first { "PTP" } else { "LIN" };
                // Writing to a String cannot fail.
                let _ = writeln!(text, "{command} XP{}{}", i + 1, if blended { " C_DIS" } else { "" });
            }
        }
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

fn by_joints(joints_deg: [f64; 6]) -> String {
    let [a1, a2, a3, a4, a5, a6] = joints_deg.map(decimal::<4>);
    format!("PTP {{A1 {a1},A2 {a2},A3 {a3},A4 {a4},A5 {a5},A6 {a6}}}\n")
}

/// Flags are not known to stop the advance run, so a wait of no time does.
const ARRIVED: &str = "WAIT SEC 0\n";

fn arc_on(name: &str, arc: &WeldingArc) -> String {
    let set = |flag| format!("$FLAG[{flag}]=TRUE\n");
    let mut text = format!(
        "GLOBAL DEF {name}_arc_on()\n\
         ; Edit: by {name}_sps.txt flag {} starts the power source at $OUT[{1}]; or ARCON of ArcTech.\n{ARRIVED}",
        flag::ARC,
        number(arc.output)
    );
    if arc.gas_output.is_some() {
        text.push_str(&(set(flag::GAS) + &set(flag::WELD) + &wait(arc.gas_preflow_s) + &set(flag::ARC)));
    } else {
        text.push_str(&(set(flag::ARC) + &set(flag::WELD)));
    }
    // Without a valve of ours the power source opens its own when it is started.
    let own_preflow_s = if arc.gas_output.is_none() { arc.gas_preflow_s } else { 0.0 };
    let strike_s = arc.strike_s + own_preflow_s;
    match arc.established_input {
        Some(input) => {
            text.push_str(&wait_for(number(input), number(arc.output), strike_s));
            text.push_str(&set(flag::ESTABLISHED));
        }
        None => text.push_str(&format!(
            "{}; Without its lines the submit interpreter does not switch the output.\nIF NOT $OUT[{}] THEN\n{}ENDIF\n",
            wait(strike_s.max(SUBMIT_S)),
            number(arc.output),
            give_up()
        )),
    }
    text + "END\n"
}

/// Where no arc comes within the time, everything is off and stays so. Without its lines in the submit interpreter the
/// output does not come either.
fn wait_for(input: u32, output: u32, timeout_s: f64) -> String {
    format!(
        "$TIMER[1]=0\n$TIMER_STOP[1]=FALSE\n\
         WHILE NOT $IN[{input}] OR NOT $OUT[{output}]\n\
         IF $TIMER[1]>{} THEN\n\
         {}\
         ENDIF\n\
         WAIT SEC 0.012\n\
         ENDWHILE\n\
         $TIMER_STOP[1]=TRUE\n",
        (timeout_s * 1e3).round(),
        give_up()
    )
}

fn arc_off(name: &str, arc: &WeldingArc) -> String {
    let off = |flag| format!("$FLAG[{flag}]=FALSE\n");
    let mut text = format!("GLOBAL DEF {name}_arc_off()\n; Edit: or ARCOFF of ArcTech.\n{ARRIVED}");
    text.push_str(&wait(arc.crater_s));
    text.push_str(&(off(flag::ESTABLISHED) + &off(flag::WELD) + &off(flag::ARC)));
    text.push_str(&wait(arc.gas_postflow_s.max(SUBMIT_S)));
    text + &off(flag::GAS) + "END\n"
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
