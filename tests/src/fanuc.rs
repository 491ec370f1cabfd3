//! Reads FANUC TP listings (.ls) section by section, from the operator's manual for ArcTool, and follows them on a robot
//! that only remembers.
//!
//! Shares no code with the emitter; whatever is not known is an error.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::robot::{Frame, Held, Ran, Step, Text, about, name, number, require};

/// Longest name since R-30iA.
const NAME: usize = 36;
/// Longest remark and comment.
const REMARK: usize = 32;
const COMMENT: usize = 16;
/// Longest line.
const LINE: usize = 254;
/// In which a robot is taken to stop, s: `CNT100` begins to turn half that way before the corner.
const DECELERATION_S: f64 = 0.2;
/// The sections, in their order.
const SECTIONS: [&str; 6] = ["/PROG", "/ATTR", "/APPL", "/MN", "/POS", "/END"];
/// What a program with arc instructions needs.
const APPLICATION: &str = "ARC Welding Equipment : 1,*,*,*,*;";
/// Longest text of `MESSAGE`.
const MESSAGE: usize = 24;

struct Program {
    lines: Vec<String>,
    positions: BTreeMap<u32, Position>,
}

struct Position {
    frame: u32,
    tool: u32,
    place: Place,
}

enum Place {
    Pose { position_mm: Vector3<f64>, base_from_tool: Matrix3<f64>, configuration: Configuration },
    Joints([f64; 6]),
}

/// How the arm stands at a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Configuration {
    /// `F`, not `N`.
    pub flipped: bool,
    /// `U`, not `D`.
    pub up: bool,
    /// `T`, not `B`.
    pub front: bool,
    /// Of joints 1, 4 and 6.
    pub turns: [i8; 3],
}

/// Loads the programs and runs `entry`.
///
/// # Errors
/// The first rule that is broken.
pub fn run(files: &[Text], entry: &str) -> Result<(Ran, Vec<Configuration>), String> {
    run_with(files, entry, &Held::new())
}

/// The same on a controller that has these user frames, by number.
///
/// # Errors
/// As of [`run`].
pub fn run_with(files: &[Text], entry: &str, held: &Held) -> Result<(Ran, Vec<Configuration>), String> {
    let mut programs = BTreeMap::new();
    for (file, text) in files {
        let (called, program) = parse(text).map_err(|why| format!("{file}: {why}"))?;
        let own = file.to_uppercase() == format!("{called}.LS");
        require(own, || format!("{file} holds {called}"))?;
        programs.insert(called, program);
    }
    let mut robot = Robot {
        programs: &programs,
        ran: Ran::default(),
        configurations: vec![],
        burning: None,
        frame: None,
        tool: None,
        held: held.clone(),
        registers: BTreeMap::new(),
    };
    robot.call(entry, 0)?;
    require(robot.burning.is_none(), || "the arc is left burning".into())?;
    Ok((robot.ran, robot.configurations))
}

fn parse(text: &str) -> Result<(String, Program), String> {
    if let Some(long) = text.lines().find(|line| line.len() > LINE) {
        return Err(format!("a line of {} characters", long.len()));
    }
    let mut sections: Vec<(&str, Vec<&str>)> = vec![];
    for line in text.lines() {
        match (line.starts_with('/'), sections.last_mut()) {
            (true, _) => sections.push((line, vec![])),
            (false, Some((_, lines))) => lines.push(line),
            (false, None) => return Err("text before /PROG".into()),
        }
    }
    let heads: Vec<&str> =
        sections.iter().map(|(line, _)| line.split_whitespace().next().unwrap_or_default()).collect();
    if let Some(missing) = SECTIONS.iter().find(|section| !heads.contains(section)) {
        return Err(format!("{missing} is missing"));
    }
    require(heads == SECTIONS, || format!("sections in the order {heads:?}"))?;
    let called = sections[0].0.strip_prefix("/PROG").unwrap_or_default().trim();
    name(called, NAME)?;
    require(called == called.to_uppercase(), || format!("{called} is not in capitals"))?;
    attributes(&sections[1].1)?;
    let application: Vec<&str> = sections[2].1.iter().map(|line| line.trim()).collect();
    require(application == [APPLICATION], || format!("/APPL says {application:?}"))?;
    let program = Program { lines: numbered(&sections[3].1)?, positions: positions(&sections[4].1)? };
    Ok((called.to_owned(), program))
}

fn attributes(lines: &[&str]) -> Result<(), String> {
    let value = |key: &str| {
        let line = lines.iter().find(|line| line.trim_start().starts_with(key));
        let line = line.ok_or_else(|| format!("{key} is missing"))?;
        line.split_once('=').map(|(_, value)| value.trim()).ok_or_else(|| format!("no = in {line:?}"))
    };
    let comment = value("COMMENT")?.strip_suffix(';').unwrap_or_default().trim_matches('"');
    require(comment.len() <= COMMENT, || format!("a comment of {} characters", comment.len()))?;
    require(value("DEFAULT_GROUP")? == "1,*,*,*,*;", || "another motion group".into())?;
    require(value("PROTECT")? == "READ_WRITE;", || "protection".into())?;
    value("CONTROL_CODE").map(drop)
}

/// `   7:L P[2] 8mm/sec CNT50 ;`: numbered from 1 without a gap, ended by a semicolon.
fn numbered(lines: &[&str]) -> Result<Vec<String>, String> {
    let mut read = vec![];
    for (i, line) in lines.iter().enumerate() {
        let (count, rest) = line.split_once(':').ok_or_else(|| format!("no number: {line:?}"))?;
        require(count.trim().parse() == Ok(i + 1) && i < 9999, || {
            format!("line {} is numbered {count}", i + 1)
        })?;
        let code = rest.strip_suffix(';').ok_or_else(|| format!("no ; after {line:?}"))?.trim();
        require(!code.contains(';'), || format!("a ; amid {line:?}"))?;
        if let Some(remark) = code.strip_prefix('!') {
            require(remark.len() <= REMARK, || format!("a remark of {} characters", remark.len()))?;
        } else {
            read.push(code.to_owned());
        }
    }
    Ok(read)
}

fn positions(lines: &[&str]) -> Result<BTreeMap<u32, Position>, String> {
    let text = lines.join("\n");
    let mut positions = BTreeMap::new();
    for block in text.split("};").map(str::trim).filter(|block| !block.is_empty()) {
        let (head, body) = block.split_once('{').ok_or_else(|| format!("no {{ in {block:?}"))?;
        let point = index(head, "P")?;
        let position = position(body).map_err(|why| format!("P[{point}]: {why}"))?;
        require(positions.insert(point, position).is_none(), || format!("P[{point}] is given twice"))?;
    }
    let numbers: Vec<u32> = positions.keys().copied().collect();
    let gap = numbers.iter().zip(1..).find(|(number, expected)| *number != expected);
    require(gap.is_none(), || format!("position number {gap:?}"))?;
    Ok(positions)
}

fn position(body: &str) -> Result<Position, String> {
    let rest = body.trim().strip_prefix("GP1:").ok_or("no GP1")?;
    let joints = rest.contains("J1 =");
    let (head, rest) = if joints {
        let at = rest.find("J1 =").unwrap_or_default();
        (&rest[..at], &rest[at..])
    } else {
        rest.split_once("CONFIG : '").ok_or("no CONFIG")?
    };
    let head: Vec<&str> = head.split(',').map(str::trim).collect();
    let count = |text: Option<&&str>, key: &str| {
        let value = text.and_then(|t| t.split_once(" : ")).filter(|(k, _)| *k == key);
        value.and_then(|(_, v)| v.parse::<u32>().ok()).ok_or_else(|| format!("no {key}"))
    };
    let (frame, tool) = (count(head.first(), "UF")?, count(head.get(1), "UT")?);
    if joints {
        let wanted = ["J1", "J2", "J3", "J4", "J5", "J6"].map(|joint| (joint, "deg"));
        return Ok(Position { frame, tool, place: Place::Joints(components(rest, wanted)?) });
    }
    let (configuration, values) = rest.split_once("',").ok_or("CONFIG is not closed")?;
    let wanted = [("X", "mm"), ("Y", "mm"), ("Z", "mm"), ("W", "deg"), ("P", "deg"), ("R", "deg")];
    let [x, y, z, w, p, r] = components(values, wanted)?;
    // About the fixed x, then the fixed y, then the fixed z.
    let base_from_tool = about(2, r) * (about(1, p) * about(0, w));
    let configuration = config(configuration)?;
    let place = Place::Pose { position_mm: Vector3::new(x, y, z), base_from_tool, configuration };
    Ok(Position { frame, tool, place })
}

fn components(values: &str, wanted: [(&str, &str); 6]) -> Result<[f64; 6], String> {
    let items: Vec<&str> = values.split(',').map(str::trim).collect();
    require(items.len() == 6, || format!("{} components", items.len()))?;
    let mut six = [0.0; 6];
    for (((key, unit), item), value) in wanted.iter().zip(items).zip(&mut six) {
        let (found, rest) = item.split_once('=').ok_or_else(|| format!("no = in {item:?}"))?;
        require(found.trim() == *key, || format!("{found} where {key} belongs"))?;
        let digits = rest.trim().strip_suffix(unit).ok_or_else(|| format!("{key} is not in {unit}"))?;
        require(digits.contains('.'), || format!("{key} has no point"))?;
        *value = number(digits)?;
    }
    Ok(six)
}

/// `N U T, 0, 0, 0`: wrist, arm, front or back, and the turns of axes 1, 4 and 6.
fn config(text: &str) -> Result<Configuration, String> {
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let [letters, turns @ ..] = parts.as_slice() else { return Err("an empty CONFIG".into()) };
    let letters: Vec<&str> = letters.split(' ').collect();
    let known = [["N", "F"], ["U", "D"], ["T", "B"]];
    let right = letters.len() == 3 && letters.iter().zip(known).all(|(letter, both)| both.contains(letter));
    require(right, || format!("CONFIG {text:?}"))?;
    let turned: Vec<i8> = turns.iter().filter_map(|turn| turn.parse().ok()).collect();
    let turns = turned.try_into().map_err(|_| format!("turns in CONFIG {text:?}"))?;
    Ok(Configuration { flipped: letters[0] == "F", up: letters[1] == "U", front: letters[2] == "T", turns })
}

struct Robot<'a> {
    programs: &'a BTreeMap<String, Program>,
    ran: Ran,
    /// Of the moves to poses.
    configurations: Vec<Configuration>,
    /// The schedule with which the arc was struck.
    burning: Option<u32>,
    frame: Option<u32>,
    tool: Option<u32>,
    held: Held,
    /// Position registers that hold a position.
    registers: BTreeMap<u32, [f64; 6]>,
}

impl Robot<'_> {
    fn call(&mut self, called: &str, depth: usize) -> Result<(), String> {
        require(depth < 10, || "calls without end".into())?;
        let program = self.programs.get(called).ok_or_else(|| format!("{called} does not exist"))?;
        let mut lines = program.lines.iter();
        lines.try_for_each(|line| self.line(program, line, depth).map_err(|why| format!("{line:?}: {why}")))
    }

    fn line(&mut self, program: &Program, line: &str, depth: usize) -> Result<(), String> {
        let schedule = |rest: &str| {
            let number = index(rest, "")?;
            require((1..=32).contains(&number), || format!("schedule {number}"))?;
            Ok::<u32, String>(number)
        };
        let weld = |rest: &str| {
            let inner = rest.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
            let (procedure, schedule) =
                inner.and_then(|inner| inner.split_once(',')).ok_or("no procedure")?;
            let number = |text: &str| text.parse::<u32>().map_err(|_| format!("no number: {text:?}"));
            Ok::<u32, String>(1000 * number(procedure)? + number(schedule)?)
        };
        // With a procedure, or by the schedule alone: the end has to say the same.
        let data = |which: &str| {
            let with = line.strip_prefix(&format!("Weld {which}")).map(weld);
            with.or_else(|| line.strip_prefix(&format!("Arc {which}")).map(schedule)).transpose()
        };
        if let Some(number) = data("Start")? {
            require(self.burning.is_none(), || "the arc burns already".into())?;
            require(self.ran.steps.last().is_some_and(|step| step.stops), || "struck on the move".into())?;
            self.burning = Some(number);
        } else if let Some(number) = data("End")? {
            require(self.burning == Some(number), || "the arc does not burn, or with other data".into())?;
            self.burning = None;
        } else if let Some(number) = line.strip_prefix("UFRAME_NUM=") {
            self.frame = Some(number.parse().map_err(|_| "no number")?);
        } else if let Some(number) = line.strip_prefix("UTOOL_NUM=") {
            self.tool = Some(number.parse().map_err(|_| "no number")?);
        } else if let Some(rest) = line.strip_prefix("PR[") {
            self.register(rest)?;
        } else if let Some(rest) = line.strip_prefix("UFRAME[") {
            let (number, register) = rest.split_once("]=").ok_or("no value")?;
            let [x, y, z, w, p, r] = self.registers[&index(register, "PR")?];
            let axes = about(2, r) * about(1, p) * about(0, w);
            self.held.insert(number.into(), Frame { origin_mm: Vector3::new(x, y, z), axes });
        } else if let Some(rest) = line.strip_prefix("UTOOL[") {
            let (_, register) = rest.split_once("]=").ok_or("no value")?;
            let known = self.registers.contains_key(&index(register, "PR")?);
            require(known, || "a register that nobody set".into())?;
        } else if let Some(time) = line.strip_prefix("WAIT ") {
            let time_s = number(time.strip_suffix("(sec)").ok_or("WAIT without (sec)")?)?;
            require(time_s > 0.0, || "no time".into())?;
            let step = self.ran.steps.last_mut().filter(|step| step.stops).ok_or("WAIT on the move")?;
            step.dwell_s += time_s;
        } else if let Some(called) = line.strip_prefix("CALL ") {
            self.call(called, depth + 1)?;
        } else if let Some(text) = line.strip_prefix("MESSAGE[") {
            let text = text.strip_suffix(']').ok_or("MESSAGE is not closed")?;
            require(text.len() <= MESSAGE, || format!("a message of {} characters", text.len()))?;
        } else if line == "PAUSE" {
            self.ran.asked.push(self.ran.steps.len());
        } else {
            self.motion(program, line)?;
        }
        Ok(())
    }

    /// `PR[10]=LPOS`, or one of its numbers.
    fn register(&mut self, rest: &str) -> Result<(), String> {
        let (which, value) = rest.split_once("]=").ok_or("no value")?;
        let Some((register, component)) = which.split_once(',') else {
            require(value == "LPOS", || format!("{value} where LPOS belongs"))?;
            self.registers.insert(which.parse().map_err(|_| "no register")?, [f64::NAN; 6]);
            return Ok(());
        };
        let register = register.parse().map_err(|_| "no register")?;
        let six = self.registers.get_mut(&register).ok_or("the register holds no position yet")?;
        let component: usize = component.parse().map_err(|_| "no component")?;
        let value = match value.strip_prefix("(-").and_then(|value| value.strip_suffix(')')) {
            Some(value) => -number(value)?,
            None => number(value)?,
        };
        *six.get_mut(component.wrapping_sub(1)).ok_or("components are 1 to 6")? = value;
        Ok(())
    }

    fn motion(&mut self, program: &Program, line: &str) -> Result<(), String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [kind @ ("J" | "L"), point, speed, termination] = words.as_slice() else {
            return Err("unknown instruction".into());
        };
        let point = index(point, "P")?;
        let position = program.positions.get(&point).ok_or_else(|| format!("P[{point}] has no position"))?;
        require(Some(position.frame) == self.frame, || "the position is in another user frame".into())?;
        require(Some(position.tool) == self.tool, || "the position is of another tool".into())?;
        let speed_mm_s = if *kind == "J" { percent(speed)? } else { Some(linear(speed)?) };
        let share = match termination.strip_prefix("CNT") {
            Some(value) => Some(whole(value, 0, 100)?),
            None => require(*termination == "FINE", || format!("{termination}?")).map(|()| None)?,
        };
        let turn_mm = 0.5 * speed_mm_s.unwrap_or(0.0) * DECELERATION_S;
        let (position_mm, base_from_tool, configuration) = match position.place {
            Place::Pose { position_mm, base_from_tool, configuration } => {
                let frame = match position.frame {
                    0 => Frame::base(),
                    number => *self.held.get(&number.to_string()).ok_or("nobody has set the user frame")?,
                };
                let (position_mm, base_from_tool) = frame.of(position_mm, base_from_tool);
                (position_mm, base_from_tool, configuration)
            }
            Place::Joints(joints_deg) => {
                let safe = *kind == "J" && self.burning.is_none() && share.is_none();
                require(safe, || "joints on a linear move, under the arc or on the fly".into())?;
                self.ran.joints.push((self.ran.steps.len(), joints_deg));
                return Ok(());
            }
        };
        self.configurations.push(configuration);
        self.ran.steps.push(Step {
            position_mm,
            base_from_tool,
            speed_mm_s,
            stops: share.is_none(),
            dwell_s: 0.0,
            blend_mm: share.map_or(0.0, |share| f64::from(share) / 100.0 * turn_mm),
            burning: self.burning.is_some(),
        });
        Ok(())
    }
}

fn percent(speed: &str) -> Result<Option<f64>, String> {
    whole(speed.strip_suffix('%').ok_or("a joint move has its speed in %")?, 1, 100).map(|_| None)
}

fn linear(speed: &str) -> Result<f64, String> {
    if let Some(value) = speed.strip_suffix("mm/sec") {
        return whole(value, 1, 2000).map(f64::from);
    }
    let value = speed.strip_suffix("cm/min").ok_or("a linear move has its speed in mm/sec or cm/min")?;
    whole(value, 1, 12000).map(|cm_min| f64::from(cm_min) * 10.0 / 60.0)
}

fn whole(text: &str, least: u32, most: u32) -> Result<u32, String> {
    let value = text.parse().map_err(|_| format!("{text:?} is no whole number"))?;
    require((least..=most).contains(&value), || format!("{value} is not {least} to {most}"))?;
    Ok(value)
}

/// `P[7]` with the letter `P`.
fn index(text: &str, letter: &str) -> Result<u32, String> {
    let inner =
        text.trim().strip_prefix(letter).and_then(|t| t.strip_prefix('[')).and_then(|t| t.strip_suffix(']'));
    inner.and_then(|digits| digits.parse().ok()).ok_or_else(|| format!("no {letter}[number]: {text:?}"))
}
