//! Runs RAPID: the declarations and instructions that weldpath writes, from ABB's technical reference (RAPID, Arc), on
//! a robot that only remembers.
//!
//! Shares no code with the emitter. What it does not know, what is declared twice, not at all, or with another type's
//! shape, is an error.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::robot::{Frame, Held, Ran, Step, Text, name, number, require};

/// Longest name.
const NAME: usize = 32;
/// Longest line: the editor of the pendant shows no more of it.
const LINE: usize = 250;
/// Zones of every controller and their radius at the TCP, mm.
const ZONES: [(&str, f64); 7] =
    [("z0", 0.3), ("z1", 1.0), ("z5", 5.0), ("z10", 10.0), ("z15", 15.0), ("z20", 20.0), ("z50", 50.0)];
/// Words that cannot be names.
const RESERVED: [&str; 12] = [
    "module",
    "endmodule",
    "proc",
    "endproc",
    "const",
    "pers",
    "local",
    "task",
    "if",
    "for",
    "while",
    "return",
];

/// A constant's value.
#[derive(Debug, Clone, PartialEq)]
enum Value {
    Number(f64),
    Bool(bool),
    Text(String),
    List(Vec<Value>),
}

struct Declared {
    kind: String,
    module: String,
    local: bool,
    value: Value,
}

/// Everything that was loaded.
#[derive(Default)]
struct Memory {
    names: BTreeMap<(String, String), Declared>,
    procedures: BTreeMap<String, (String, Vec<String>)>,
    held: Held,
}

/// Loads the modules and calls `entry`.
///
/// # Errors
/// The first rule of the language that is broken.
pub fn run(modules: &[Text], entry: &str) -> Result<Ran, String> {
    run_with(modules, entry, &Held::new())
}

/// The same on a controller that has these work objects, and any tool.
///
/// # Errors
/// As of [`run`].
pub fn run_with(modules: &[Text], entry: &str, held: &Held) -> Result<Ran, String> {
    let mut memory = Memory { held: held.clone(), ..Memory::default() };
    for (_, text) in modules {
        memory.load(text)?;
    }
    let mut robot = Robot { memory: &memory, ran: Ran::default(), burning: false, configuration: [true; 2] };
    robot.call(entry, 0)?;
    require(!robot.burning, || "the arc is left burning".into())?;
    require(robot.configuration == [true; 2], || "ConfJ or ConfL is left off".into())?;
    Ok(robot.ran)
}

impl Memory {
    fn load(&mut self, text: &str) -> Result<(), String> {
        if let Some(long) = text.lines().find(|line| line.len() > LINE) {
            return Err(format!("a line of {} characters", long.len()));
        }
        let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('!'));
        let module = lines.next().and_then(|line| line.strip_prefix("MODULE ")).ok_or("no MODULE")?;
        name(module, NAME)?;
        let mut open: Option<(String, Vec<String>)> = None;
        while let Some(line) = lines.next() {
            match (line, &mut open) {
                ("ENDMODULE", None) => {
                    return require(lines.next().is_none(), || "text after ENDMODULE".into());
                }
                ("ENDPROC", Some(_)) => {
                    let (called, body) = open.take().expect("matched");
                    let again = self.procedures.insert(called.to_lowercase(), (module.into(), body));
                    require(again.is_none(), || format!("{called} is declared twice"))?;
                }
                (line, Some((_, body))) if !line.starts_with("PROC") && line != "ENDMODULE" => {
                    body.push(line.strip_suffix(';').ok_or_else(|| format!("no ; after {line:?}"))?.into());
                }
                (line, None) => match line.strip_prefix("PROC ") {
                    Some(rest) => {
                        let called = rest.strip_suffix("()").ok_or_else(|| format!("no () in {line:?}"))?;
                        name(called, NAME)?;
                        open = Some((called.into(), vec![]));
                    }
                    None => self.declare(module, line)?,
                },
                (line, Some(_)) => return Err(format!("{line:?} in a procedure: ENDPROC is missing")),
            }
        }
        Err("ENDMODULE is missing".into())
    }

    fn declare(&mut self, module: &str, line: &str) -> Result<(), String> {
        let line = line.strip_suffix(';').ok_or_else(|| format!("no ; after {line:?}"))?;
        let (left, right) = line.split_once(":=").ok_or_else(|| format!("no := in {line:?}"))?;
        let words: Vec<&str> = left.split_whitespace().collect();
        let (local, words) = match words.split_first() {
            Some((&"LOCAL", rest)) => (true, rest),
            _ => (false, words.as_slice()),
        };
        let [storage @ ("CONST" | "PERS"), kind, called] = words else {
            return Err(format!("no declaration: {line:?}"));
        };
        name(called, NAME)?;
        require(!RESERVED.contains(&called.to_lowercase().as_str()), || format!("{called} is reserved"))?;
        let persistent = ["tooldata", "wobjdata", "seamdata", "welddata"].contains(kind);
        require(persistent == (*storage == "PERS"), || format!("{kind} cannot be {storage}"))?;
        let value = value(right)?;
        shape(kind, &value).map_err(|why| format!("{called}: {why}"))?;
        let scope = if local { module.to_lowercase() } else { String::new() };
        let declared = Declared { kind: (*kind).into(), module: module.into(), local, value };
        let again = self.names.insert((scope, called.to_lowercase()), declared);
        require(again.is_none(), || format!("{called} is declared twice"))
    }

    fn find(&self, module: &str, called: &str, kind: &str) -> Result<&Value, String> {
        let scopes = [module.to_lowercase(), String::new()];
        let found = scopes.into_iter().find_map(|scope| self.names.get(&(scope, called.to_lowercase())));
        let found = found.ok_or_else(|| format!("{called} is not declared"))?;
        require(found.kind == kind, || format!("{called} is {}, not {kind}", found.kind))?;
        require(!found.local || found.module == module, || format!("{called} is of another module"))?;
        Ok(&found.value)
    }
}

/// A literal: number, TRUE, FALSE, "text" or a list of them in brackets.
fn value(text: &str) -> Result<Value, String> {
    let text = text.trim();
    if let Some(inner) = text.strip_prefix('[') {
        let inner = inner.strip_suffix(']').ok_or_else(|| format!("no ] in {text:?}"))?;
        return arguments(inner)?.iter().map(|item| value(item)).collect::<Result<_, _>>().map(Value::List);
    }
    match text {
        "TRUE" => Ok(Value::Bool(true)),
        "FALSE" => Ok(Value::Bool(false)),
        _ if text.len() > 1 && text.starts_with('"') && text.ends_with('"') => Ok(Value::Text(text.into())),
        _ => number(text).map(Value::Number),
    }
}

/// Splits at the commas outside brackets.
fn arguments(text: &str) -> Result<Vec<String>, String> {
    let (mut parts, mut depth) = (vec![String::new()], 0_i32);
    for c in text.chars() {
        depth += i32::from(c == '[') - i32::from(c == ']');
        require(depth >= 0, || format!("brackets in {text:?}"))?;
        match (c, parts.last_mut()) {
            (',', _) if depth == 0 => parts.push(String::new()),
            (c, Some(last)) => last.push(c),
            _ => {}
        }
    }
    require(depth == 0, || format!("brackets in {text:?}"))?;
    Ok(parts)
}

/// The records of the reference: `n` a number, `b` a boolean, `t` text, in lists.
fn shape(kind: &str, value: &Value) -> Result<(), String> {
    const POSE: &str = "[[nnn][nnnn]]";
    const ARC: &str = "[nnnnnnnnn]";
    let wanted = match kind {
        "robtarget" => "[[nnn][nnnn][nnnn][nnnnnn]]".to_owned(),
        "tooldata" => format!("[b{POSE}[n[nnn][nnnn]nnn]]"),
        "wobjdata" => format!("[bbt{POSE}{POSE}]"),
        "seamdata" => format!("[nn{ARC}nnnnn{ARC}nn{ARC}nn{ARC}n]"),
        "welddata" => format!("[nn{ARC}{ARC}]"),
        "speeddata" => "[nnnn]".to_owned(),
        "zonedata" => "[bnnnnnn]".to_owned(),
        _ => return Err(format!("unknown type {kind}")),
    };
    let found = letters(value);
    require(found == wanted, || format!("a {kind} is {wanted}, not {found}"))?;
    quaternions(kind, value)
}

fn letters(value: &Value) -> String {
    match value {
        Value::Number(_) => "n".into(),
        Value::Bool(_) => "b".into(),
        Value::Text(_) => "t".into(),
        Value::List(list) => format!("[{}]", list.iter().map(letters).collect::<String>()),
    }
}

/// A rotation whose quaternion is not normalised stops the program.
fn quaternions(kind: &str, value: &Value) -> Result<(), String> {
    let four = |value: &Value| numbers::<4>(value).ok();
    let Value::List(list) = value else { return Ok(()) };
    let found: Vec<[f64; 4]> = match kind {
        "robtarget" => list.get(1).and_then(four).into_iter().collect(),
        "tooldata" | "wobjdata" => list
            .iter()
            .filter_map(|pose| if let Value::List(pose) = pose { pose.get(1).and_then(four) } else { None })
            .collect(),
        _ => return Ok(()),
    };
    for q in found {
        let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        require((norm - 1.0).abs() < 1e-6, || format!("quaternion of norm {norm}"))?;
    }
    Ok(())
}

fn numbers<const N: usize>(value: &Value) -> Result<[f64; N], String> {
    let Value::List(list) = value else { return Err("no list".into()) };
    let found: Vec<f64> =
        list.iter().filter_map(|v| if let Value::Number(n) = v { Some(*n) } else { None }).collect();
    found.try_into().map_err(|_| format!("not {N} numbers"))
}

fn item(value: &Value, index: usize) -> Result<&Value, String> {
    match value {
        Value::List(list) => list.get(index).ok_or_else(|| format!("no item {index}")),
        _ => Err("no list".into()),
    }
}

struct Robot<'a> {
    memory: &'a Memory,
    ran: Ran,
    burning: bool,
    /// Whether `ConfJ` and `ConfL` hold the robot to the configuration of the target.
    configuration: [bool; 2],
}

impl Robot<'_> {
    fn call(&mut self, called: &str, depth: usize) -> Result<(), String> {
        require(depth < 10, || "calls without end".into())?;
        let procedure = self.memory.procedures.get(&called.to_lowercase());
        let (module, body) = procedure.ok_or_else(|| format!("{called} is not declared"))?;
        body.iter().try_for_each(|line| self.instruction(module, line, depth))
    }

    fn instruction(&mut self, module: &str, line: &str, depth: usize) -> Result<(), String> {
        if let Some(time) = line.strip_prefix("WaitTime ") {
            let time_s = number(time)?;
            let step = self.ran.steps.last_mut().filter(|step| step.stops).ok_or("WaitTime on the move")?;
            step.dwell_s += time_s;
            return require(time_s > 0.0, || "no time".into());
        }
        match line {
            "ConfJ\\Off" => self.configuration[0] = false,
            "ConfL\\Off" => self.configuration[1] = false,
            "SingArea\\Off" => {}
            "ConfJ\\On" => self.configuration[0] = true,
            "ConfL\\On" => self.configuration[1] = true,
            "Stop" => self.ran.asked.push(self.ran.steps.len()),
            _ => match line.split_once(' ') {
                None => self.call(line, depth + 1)?,
                Some(("TPWrite", text)) => {
                    let quoted = text.len() > 1 && text.starts_with('"') && text.ends_with('"');
                    require(quoted && text.len() <= 82, || format!("TPWrite {text}"))?;
                }
                Some(("MoveAbsJ", rest)) => {
                    self.by_joints(module, rest).map_err(|why| format!("{line:?}: {why}"))?;
                }
                Some((command, rest)) => {
                    let step = self.motion(module, command, &arguments(rest)?);
                    let step = step.map_err(|why| format!("{line:?}: {why}"))?;
                    self.ran.steps.push(step);
                }
            },
        }
        Ok(())
    }

    /// `MoveAbsJ` of a jointtarget that is written out.
    fn by_joints(&mut self, module: &str, rest: &str) -> Result<(), String> {
        let arguments = arguments(rest)?;
        let [target, speed, zone, frame] = arguments.as_slice() else {
            return Err(format!("{} arguments", arguments.len()));
        };
        let target = value(target)?;
        require(letters(&target) == "[[nnnnnn][nnnnnn]]", || "no jointtarget".into())?;
        require(numbers::<6>(item(&target, 1)?)? == [9e9; 6], || "an external axis moves".into())?;
        self.memory.find(module, speed, "speeddata")?;
        require(zone == "fine" && !self.burning, || "joints under the arc or on the fly".into())?;
        self.frame(module, frame)?;
        self.ran.joints.push((self.ran.steps.len(), numbers::<6>(item(&target, 0)?)?));
        Ok(())
    }

    fn motion(&mut self, module: &str, command: &str, arguments: &[String]) -> Result<Step, String> {
        let arc = command.starts_with("Arc");
        let (point, speed, weld, zone, frame) = match arguments {
            [point, speed, zone, frame] if !arc => (point, speed, None, zone, frame),
            [point, speed, seam, weld, zone, frame] if arc => {
                self.memory.find(module, seam, "seamdata")?;
                (point, speed, Some(weld), zone, frame)
            }
            _ => return Err(format!("{} arguments", arguments.len())),
        };
        let frame = self.frame(module, frame)?;
        let speed = item(self.memory.find(module, speed, "speeddata")?, 0)?;
        let weld = weld.map(|weld| self.memory.find(module, weld, "welddata")).transpose()?;
        let weld_speed = weld.map(|weld| item(weld, 0)).transpose()?;
        let burning = self.arc(command)?;
        let stops = zone == "fine";
        require(stops || burning && command == "ArcL", || format!("{zone} where the robot has to arrive"))?;
        let (Value::Number(speed_mm_s), true) = (weld_speed.filter(|_| burning).unwrap_or(speed), true)
        else {
            return Err("a speed is a number".into());
        };
        require(*speed_mm_s > 0.0, || format!("speed {speed_mm_s}"))?;
        let (position_mm, base_from_tool) = self.target(module, point)?;
        let (position_mm, base_from_tool) = frame.of(position_mm, base_from_tool);
        let joint = command == "MoveJ";
        require(!self.configuration[usize::from(!joint)], || "the configuration is not free".into())?;
        let speed_mm_s = (!joint).then_some(*speed_mm_s);
        let blend_mm = if stops { 0.0 } else { self.zone(module, zone)? };
        Ok(Step { position_mm, base_from_tool, speed_mm_s, stops, dwell_s: 0.0, blend_mm, burning })
    }

    /// Whether the arc burns on the way of `command`; after it as the command says.
    fn arc(&mut self, command: &str) -> Result<bool, String> {
        let (before, after) = match command {
            "MoveJ" | "MoveL" => (false, false),
            "ArcLStart" => (false, true),
            "ArcL" => (true, true),
            "ArcLEnd" => (true, false),
            _ => return Err(format!("unknown instruction {command}")),
        };
        require(before == self.burning, || format!("{command} while the arc is {}", self.burning))?;
        self.burning = after;
        Ok(before)
    }

    fn frame(&self, module: &str, frame: &str) -> Result<Frame, String> {
        let (tool, work_object) = frame.split_once("\\WObj:=").ok_or("no work object")?;
        if tool != "tWeldGun" && self.memory.held.is_empty() {
            let robot_holds = item(self.memory.find(module, tool, "tooldata")?, 0)?;
            require(*robot_holds == Value::Bool(true), || "the robot does not hold the tool".into())?;
        }
        if let Some(held) = self.memory.held.get(work_object) {
            return Ok(*held);
        }
        let place = self.memory.find(module, work_object, "wobjdata")?;
        let identity = value("[[0,0,0],[1,0,0,0]]")?;
        require(*item(place, 4)? == identity, || "an object frame beside the user frame".into())?;
        let (origin_mm, axes) = pose(item(place, 3)?)?;
        Ok(Frame { origin_mm, axes })
    }

    fn zone(&self, module: &str, zone: &str) -> Result<f64, String> {
        if let Some((_, radius)) = ZONES.iter().find(|(known, _)| *known == zone) {
            return Ok(*radius);
        }
        match item(self.memory.find(module, zone, "zonedata")?, 1)? {
            Value::Number(radius) if *radius > 0.0 => Ok(*radius),
            other => Err(format!("zone {other:?}")),
        }
    }

    fn target(&self, module: &str, point: &str) -> Result<(Vector3<f64>, Matrix3<f64>), String> {
        let target = self.memory.find(module, point, "robtarget")?;
        let external = numbers::<6>(item(target, 3)?)?;
        require(external == [9e9; 6], || "an external axis moves".into())?;
        pose(target)
    }
}

/// Place and quaternion, the first two items.
fn pose(pose: &Value) -> Result<(Vector3<f64>, Matrix3<f64>), String> {
    let position = numbers::<3>(item(pose, 0)?)?;
    let [w, x, y, z] = numbers::<4>(item(pose, 1)?)?;
    let rotate = |v: Vector3<f64>| {
        let u = Vector3::new(x, y, z);
        v + 2.0 * w * u.cross(&v) + 2.0 * u.cross(&u.cross(&v))
    };
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()].map(rotate);
    Ok((Vector3::from(position), Matrix3::from_columns(&axes)))
}
