//! Runs KRL: the statements that weldpath writes, from KUKA's reference for system programmers, on a robot that only
//! remembers.
//!
//! Shares no code with the emitter. A module is a .src and a .dat of one name; whatever is not known is an error.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::robot::{Step, Text, about, name, number, require};

/// Longest name.
const NAME: usize = 24;
/// Longest line.
const LINE: usize = 255;
/// Fastest speed of the TCP, m/s: more is a slip of unit.
const FASTEST_M_S: f64 = 2.0;

/// What happened beside the moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Ran {
    /// Moves to points; the move to where the robot stands is none.
    pub steps: Vec<Step>,
    /// Outputs as they were switched, and waits in s, in order.
    pub events: Vec<Event>,
    /// Whether it ended in `HALT`.
    pub halted: bool,
}

/// An output, or time passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// `$OUT[n]=`.
    Out(u32, bool),
    /// `WAIT SEC`.
    Wait(f64),
    /// A move, by its place in the steps.
    Move(usize),
}

type Frame = [f64; 6];

#[derive(Default)]
struct Memory {
    points: BTreeMap<(String, String), Frame>,
    /// Module and lines.
    routines: BTreeMap<String, (String, Vec<String>)>,
}

/// Loads the modules and runs the one called `entry`. Output `arc` starts the arc; every input reads as `input`.
///
/// # Errors
/// The first rule of the language that is broken.
pub fn run(files: &[Text], entry: &str, arc: u32, input: bool) -> Result<Ran, String> {
    let mut memory = Memory::default();
    for (file, text) in files {
        let (module, kind) = file.split_once('.').ok_or_else(|| format!("{file} has no extension"))?;
        name(module, NAME)?;
        let other = if kind == "src" { "dat" } else { "src" };
        let partner = format!("{module}.{other}");
        require(files.iter().any(|(name, _)| *name == partner), || format!("{partner} is missing"))?;
        let lines = lines(text).map_err(|why| format!("{file}: {why}"))?;
        let loaded = if kind == "src" { memory.source(module, &lines) } else { memory.data(module, &lines) };
        loaded.map_err(|why| format!("{file}: {why}"))?;
    }
    let mut robot = Robot::new(&memory, arc, input);
    robot.call(entry, 0)?;
    require(!robot.out(arc), || "the arc is left burning".into())?;
    Ok(Ran { steps: robot.steps, events: robot.events, halted: robot.halted })
}

/// Without header lines and comments; folds are closed.
fn lines(text: &str) -> Result<Vec<String>, String> {
    let mut folds = 0;
    let mut kept = vec![];
    for line in text.lines() {
        require(line.len() <= LINE, || format!("a line of {} characters", line.len()))?;
        folds += i32::from(line.starts_with(";FOLD")) - i32::from(line.starts_with(";ENDFOLD"));
        require(folds >= 0, || "ENDFOLD without FOLD".into())?;
        let code = line.split(';').next().unwrap_or_default().trim();
        if !code.is_empty() && !code.starts_with('&') {
            kept.push(code.to_owned());
        }
    }
    require(folds == 0, || "a fold without ENDFOLD".into())?;
    Ok(kept)
}

impl Memory {
    fn data(&mut self, module: &str, lines: &[String]) -> Result<(), String> {
        let [first, inner @ .., last] = lines else { return Err("empty".into()) };
        require(*first == format!("DEFDAT {module} PUBLIC"), || format!("begins with {first:?}"))?;
        require(last == "ENDDAT", || "ENDDAT is missing".into())?;
        for line in inner.iter().filter(|line| *line != "EXT BAS (BAS_COMMAND :IN,REAL :IN)") {
            let declared = line.strip_prefix("DECL FRAME ").and_then(|rest| rest.split_once('='));
            let (point, value) = declared.ok_or_else(|| format!("no declaration: {line:?}"))?;
            name(point, NAME)?;
            let again = self.points.insert((module.into(), point.into()), frame(value)?);
            require(again.is_none(), || format!("{point} is declared twice"))?;
        }
        Ok(())
    }

    fn source(&mut self, module: &str, lines: &[String]) -> Result<(), String> {
        let mut open: Option<(String, Vec<String>)> = None;
        for line in lines {
            let local = line.strip_prefix("GLOBAL DEF ").or(line.strip_prefix("DEF "));
            match (local, &mut open) {
                (Some(rest), None) => {
                    let called = rest.strip_suffix("()").ok_or_else(|| format!("no () in {line:?}"))?;
                    name(called, NAME)?;
                    open = Some((called.into(), vec![]));
                }
                (Some(_), Some((called, _))) => return Err(format!("END of {called} is missing")),
                (None, Some(_)) if line == "END" => {
                    let (called, body) = open.take().expect("matched");
                    let again = self.routines.insert(called.clone(), (module.into(), body));
                    require(again.is_none(), || format!("{called} is declared twice"))?;
                }
                (None, Some((_, body))) => body.push(line.clone()),
                (None, None) => return Err(format!("{line:?} outside a routine")),
            }
        }
        require(open.is_none(), || "END is missing".into())?;
        let own = self.routines.get(module).is_some_and(|(of, _)| of == module);
        require(own, || format!("no DEF {module}"))
    }
}

/// `{X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0}`: all six, in any order.
fn frame(text: &str) -> Result<Frame, String> {
    let inner =
        text.strip_prefix('{').and_then(|t| t.strip_suffix('}')).ok_or(format!("no frame: {text:?}"))?;
    let mut values = [None; 6];
    for item in inner.split(',') {
        let (key, value) = item.trim().split_once(' ').ok_or_else(|| format!("no component: {item:?}"))?;
        let index = ["X", "Y", "Z", "A", "B", "C"].iter().position(|known| *known == key);
        let place = values.get_mut(index.ok_or_else(|| format!("unknown component {key}"))?).expect("six");
        require(place.is_none(), || format!("{key} is given twice"))?;
        *place = Some(number(value)?);
    }
    let all: Option<Vec<f64>> = values.into_iter().collect();
    all.and_then(|all| all.try_into().ok()).ok_or_else(|| format!("a component is missing in {text:?}"))
}

struct Robot<'a> {
    memory: &'a Memory,
    arc: u32,
    input: bool,
    outputs: BTreeMap<u32, bool>,
    /// `$BASE`, tool, `$ORI_TYPE` and `BAS(#INITMOV,0)`, in the order of [`PREPARATIONS`].
    prepared: [bool; 4],
    moved: bool,
    speed_m_s: Option<f64>,
    blend_mm: Option<f64>,
    /// In which depth of calls the last move stands.
    motion_depth: usize,
    /// `$TIMER[1]`, ms, while it runs.
    timer_ms: Option<f64>,
    steps: Vec<Step>,
    events: Vec<Event>,
    halted: bool,
}

/// What has to stand before the first motion.
const PREPARATIONS: [&str; 4] = ["$BASE", "$TOOL", "$ORI_TYPE", "INITMOV"];

impl<'a> Robot<'a> {
    fn new(memory: &'a Memory, arc: u32, input: bool) -> Self {
        Self {
            memory,
            arc,
            input,
            outputs: BTreeMap::new(),
            prepared: [false; 4],
            moved: false,
            speed_m_s: None,
            blend_mm: None,
            motion_depth: 0,
            timer_ms: None,
            steps: vec![],
            events: vec![],
            halted: false,
        }
    }

    fn out(&self, channel: u32) -> bool {
        self.outputs.get(&channel).copied().unwrap_or(false)
    }

    fn call(&mut self, called: &str, depth: usize) -> Result<(), String> {
        require(depth < 10, || "calls without end".into())?;
        let (module, body) =
            self.memory.routines.get(called).ok_or_else(|| format!("{called} is not declared"))?;
        self.block(module, body, depth)
    }

    fn block(&mut self, module: &str, lines: &[String], depth: usize) -> Result<(), String> {
        let mut at = 0;
        while let Some(line) = lines.get(at).filter(|_| !self.halted) {
            at += 1;
            let Some((open, close)) =
                BLOCKS.iter().find(|(open, _)| line == open || line.starts_with(&format!("{open} ")))
            else {
                self.statement(module, line, depth).map_err(|why| format!("{line:?}: {why}"))?;
                continue;
            };
            let end = end_of(lines, at, open, close)?;
            let body = &lines[at..end];
            self.repeat(module, line, body, depth)?;
            at = end + 1;
        }
        Ok(())
    }

    fn repeat(&mut self, module: &str, line: &str, body: &[String], depth: usize) -> Result<(), String> {
        if let Some(condition) = line.strip_prefix("IF ") {
            let condition = condition.strip_suffix(" THEN").ok_or("IF without THEN")?;
            return if self.holds(condition)? { self.block(module, body, depth) } else { Ok(()) };
        }
        for _ in 0..10_000 {
            let goes_on = line.strip_prefix("WHILE ").map_or(Ok(true), |condition| self.holds(condition))?;
            if !goes_on || self.halted {
                return Ok(());
            }
            self.block(module, body, depth)?;
        }
        Err("a loop without end".into())
    }

    fn holds(&self, condition: &str) -> Result<bool, String> {
        if let Some(input) = condition.strip_prefix("NOT $IN") {
            index(input)?;
            return Ok(!self.input);
        }
        if let Some(output) = condition.strip_prefix("$OUT") {
            return Ok(self.out(index(output)?));
        }
        let limit =
            condition.strip_prefix("$TIMER[1]>").ok_or_else(|| format!("unknown condition {condition}"))?;
        Ok(self.timer_ms.ok_or("$TIMER[1] does not run")? > number(limit)?)
    }

    fn statement(&mut self, module: &str, line: &str, depth: usize) -> Result<(), String> {
        if let Some(rest) = line.strip_prefix("PTP ").or(line.strip_prefix("LIN ")) {
            self.motion_depth = depth;
            return self.motion(module, rest, line.starts_with("PTP"));
        }
        if let Some(time) = line.strip_prefix("WAIT SEC ") {
            let time_s = number(time)?;
            require(time_s > 0.0, || "no time".into())?;
            self.timer_ms = self.timer_ms.map(|ms| ms + time_s * 1e3);
            // Waits of the arc routines are not the weld's.
            if let Some(step) = self.steps.last_mut().filter(|_| depth == self.motion_depth) {
                step.dwell_s += time_s;
            }
            self.events.push(Event::Wait(time_s));
            return Ok(());
        }
        if let Some((variable, value)) = line.split_once('=').filter(|_| line.starts_with('$')) {
            return self.assign(variable, value);
        }
        if let Some(arguments) = line.strip_prefix("BAS(#").and_then(|rest| rest.strip_suffix(')')) {
            return self.basic(arguments);
        }
        match line {
            "HALT" => self.halted = true,
            "INTERRUPT ON 3" | "GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM()" => {}
            _ => return self.call(line.strip_suffix("()").ok_or("unknown statement")?, depth + 1),
        }
        Ok(())
    }

    fn basic(&mut self, arguments: &str) -> Result<(), String> {
        let (command, value) = arguments.split_once(',').ok_or("BAS takes two arguments")?;
        let value = number(value)?;
        match command {
            "INITMOV" => self.prepared[3] = true,
            "TOOL" => {
                require(value.fract() == 0.0 && (1.0..=16.0).contains(&value), || format!("tool {value}"))?;
                self.prepared[1] = true;
            }
            "VEL_PTP" => require((0.0..=100.0).contains(&value), || format!("{value} %"))?,
            _ => return Err("unknown command of BAS".into()),
        }
        Ok(())
    }

    fn assign(&mut self, variable: &str, value: &str) -> Result<(), String> {
        match variable {
            "$BASE" => {
                require(value == "$ROBROOT" || value == "$NULLFRAME", || format!("base {value}"))?;
                self.prepared[0] = true;
            }
            "$TOOL" => {
                frame(value)?;
                self.prepared[1] = true;
            }
            "$ORI_TYPE" => {
                require(value == "#VAR", || format!("orientation {value}"))?;
                self.prepared[2] = true;
            }
            "$LOAD" => require(value.starts_with("{M ") && value.ends_with("}}"), || "no load".into())?,
            "$IPO_MODE" => require(value == "#BASE", || format!("mode {value}"))?,
            "$VEL.CP" => {
                let speed = number(value)?;
                require(speed > 0.0 && speed <= FASTEST_M_S, || format!("{speed} m/s"))?;
                self.speed_m_s = Some(speed);
            }
            "$APO.CDIS" => {
                let blend = number(value)?;
                require(blend > 0.0, || format!("radius {blend}"))?;
                self.blend_mm = Some(blend);
            }
            "$TIMER[1]" => self.timer_ms = Some(number(value)?),
            "$TIMER_STOP[1]" => drop(boolean(value)?),
            _ => {
                let output = index(variable.strip_prefix("$OUT").ok_or("unknown variable")?)?;
                let on = boolean(value)?;
                self.outputs.insert(output, on);
                self.events.push(Event::Out(output, on));
            }
        }
        Ok(())
    }

    fn motion(&mut self, module: &str, rest: &str, joint: bool) -> Result<(), String> {
        if let Some(missing) = PREPARATIONS.iter().zip(self.prepared).find(|(_, done)| !done) {
            return Err(format!("{} is not set before the first motion", missing.0));
        }
        if joint && rest == "$AXIS_ACT" {
            self.moved = true;
            return Ok(());
        }
        require(self.moved, || "the first motion is not PTP to where the robot stands".into())?;
        let (point, blended) = match rest.split_once(' ') {
            Some((point, "C_DIS")) if !joint => (point, true),
            None => (rest, false),
            _ => return Err("unknown approximation".into()),
        };
        let frame = self.memory.points.get(&(module.to_owned(), point.to_owned()));
        let [x, y, z, a, b, c] = *frame.ok_or_else(|| format!("{point} is not in the .dat"))?;
        let speed_m_s = self.speed_m_s.ok_or("$VEL.CP is not set")?;
        let blend_mm = if blended { self.blend_mm.ok_or("$APO.CDIS is not set")? } else { 0.0 };
        self.events.push(Event::Move(self.steps.len()));
        self.steps.push(Step {
            position_mm: Vector3::new(x, y, z),
            base_from_tool: rotation(a, b, c),
            speed_mm_s: (!joint).then_some(speed_m_s * 1e3),
            stops: !blended,
            dwell_s: 0.0,
            blend_mm,
            burning: self.out(self.arc),
        });
        Ok(())
    }
}

/// Turned by A about z, then by B about the new y, then by C about the newer x.
fn rotation(a: f64, b: f64, c: f64) -> Matrix3<f64> {
    about(2, a) * about(1, b) * about(0, c)
}

const BLOCKS: [(&str, &str); 3] = [("IF", "ENDIF"), ("WHILE", "ENDWHILE"), ("LOOP", "ENDLOOP")];

fn end_of(lines: &[String], from: usize, open: &str, close: &str) -> Result<usize, String> {
    let mut depth = 1;
    for (at, line) in lines.iter().enumerate().skip(from) {
        depth += i32::from(line == open || line.starts_with(&format!("{open} "))) - i32::from(line == close);
        if depth == 0 {
            return Ok(at);
        }
    }
    Err(format!("{close} is missing"))
}

/// `[7]`.
fn index(text: &str) -> Result<u32, String> {
    let inner =
        text.strip_prefix('[').and_then(|t| t.strip_suffix(']')).ok_or(format!("no index: {text:?}"))?;
    let index = inner.parse().map_err(|_| format!("no index: {text:?}"))?;
    require((1..=4096).contains(&index), || format!("{index} is not 1 to 4096"))?;
    Ok(index)
}

fn boolean(text: &str) -> Result<bool, String> {
    match text {
        "TRUE" => Ok(true),
        "FALSE" => Ok(false),
        _ => Err(format!("no boolean: {text:?}")),
    }
}
