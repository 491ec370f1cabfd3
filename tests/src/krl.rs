//! Runs KRL: the statements that weldpath writes, from KUKA's reference for system programmers, on a robot that only
//! remembers.
//!
//! Shares no code with the emitter. A module is a .src and a .dat of one name; lines for the submit interpreter are in a
//! file `*_sps.txt`. Whatever is not known is an error. It has a clock, the submit interpreter, interrupts, and can be
//! stopped at any step.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::robot::{self, Held, STEP_S, Step, Stop, Text, about, name, number, require};

/// Longest name.
const NAME: usize = 24;
/// Longest line.
const LINE: usize = 255;
/// Fastest speed of the TCP, m/s: more is a slip of unit.
const FASTEST_M_S: f64 = 2.0;

/// What happened.
#[derive(Debug, Clone, PartialEq)]
pub struct Ran {
    /// Moves to points and joints; the move to where the robot stands is none.
    pub done: robot::Ran,
    /// Outputs as they were switched, and waits in s, in order.
    pub events: Vec<Event>,
    /// Whether it ended in `HALT`.
    pub halted: bool,
}

/// An output, or time passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// An output changed.
    Out(u32, bool),
    /// `WAIT SEC`, when it is over.
    Wait(f64),
    /// A move, by its place in the steps.
    Move(usize),
}

type Frame = [f64; 6];

/// What was loaded.
#[derive(Default)]
pub struct Memory {
    points: BTreeMap<(String, String), Frame>,
    /// Module and what it does.
    routines: BTreeMap<String, (String, Vec<Op>)>,
    /// Lines of the submit interpreter.
    submit: Vec<Op>,
    held: Held,
}

enum Op {
    /// Jumps where the condition does not hold.
    Unless(Expression, usize),
    Jump(usize),
    Flag(usize, Expression),
    Out(u32, Expression),
    Line(String),
}

enum Expression {
    Is(bool),
    Not(Box<Self>),
    And(Box<Self>, Box<Self>),
    Or(Box<Self>, Box<Self>),
    In,
    Out(u32),
    Flag(usize),
    /// `$TIMER[1]>`, ms.
    Timer(f64),
    /// `$PRO_ACT`, `$ALARM_STOP`, `$STOPMESS`.
    State(usize),
}

const STATES: [&str; 3] = ["$PRO_ACT", "$ALARM_STOP", "$STOPMESS"];

/// What the digital inputs read as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inputs {
    /// All the same.
    All(bool),
    /// High so many steps after the output of the arc became high, as long as it is.
    Source(u32),
}

/// What KUKA's documents that were seen do not settle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reading {
    /// `$ALARM_STOP` is TRUE at an emergency stop, not FALSE.
    pub alarm_reversed: bool,
    /// An interrupt whose condition came true while the program stood is run when it goes on, not lost.
    pub edges_kept: bool,
}

impl Reading {
    /// The two that let a program weld.
    pub const BOTH: [Self; 2] =
        [Self { alarm_reversed: false, edges_kept: false }, Self { alarm_reversed: false, edges_kept: true }];
}

/// What a stop does. Second hand all: outputs keep their state, the submit interpreter runs on.
///
/// Columns: `$PRO_ACT`, an emergency stop, `$STOPMESS`, whether the program can go on.
const STOPS: [(Stop, bool, bool, bool, bool); 4] = [
    (Stop::Pause, false, false, false, true),
    (Stop::Protective, false, false, true, true),
    (Stop::Emergency, false, true, true, true),
    (Stop::Program, false, false, false, false),
];

/// Loads the modules and runs the one called `entry`. Output `arc` starts the arc; every input reads as `input`.
///
/// # Errors
/// The first rule of the language that is broken.
pub fn run(files: &[Text], entry: &str, arc: u32, input: bool) -> Result<Ran, String> {
    run_with(files, entry, arc, input, &Held::new())
}

/// The same on a controller that has these frames, by number.
///
/// # Errors
/// As of [`run`].
pub fn run_with(files: &[Text], entry: &str, arc: u32, input: bool, held: &Held) -> Result<Ran, String> {
    let memory = Memory { held: held.clone(), ..Memory::load(files)? };
    let mut robot = Robot::new(&memory, entry, arc, Inputs::All(input), Reading::BOTH[0])?;
    for _ in 0..10_000_000 {
        robot.step()?;
        let halted = robot.halts > 2;
        if robot.ended || halted {
            require(!robot.out(arc), || "the arc is left burning".into())?;
            return Ok(Ran { done: robot.done, events: robot.events, halted });
        }
        if robot.halted() {
            robot.resume();
        }
    }
    Err("a program that does not end".into())
}

impl Memory {
    /// # Errors
    /// The first rule of the language that is broken.
    pub fn load(files: &[Text]) -> Result<Self, String> {
        let mut memory = Self::default();
        for (file, text) in files {
            let lines = lines(text).map_err(|why| format!("{file}: {why}"))?;
            if file.ends_with("_sps.txt") {
                memory.submit = compile(&lines).map_err(|why| format!("{file}: {why}"))?;
                continue;
            }
            let (module, kind) = file.split_once('.').ok_or_else(|| format!("{file} has no extension"))?;
            name(module, NAME)?;
            let other = if kind == "src" { "dat" } else { "src" };
            let partner = format!("{module}.{other}");
            require(files.iter().any(|(name, _)| *name == partner), || format!("{partner} is missing"))?;
            let loaded =
                if kind == "src" { memory.source(module, &lines) } else { memory.data(module, &lines) };
            loaded.map_err(|why| format!("{file}: {why}"))?;
        }
        Ok(memory)
    }
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
                    let again = self.routines.insert(called.clone(), (module.into(), compile(&body)?));
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
    six(text, ["X", "Y", "Z", "A", "B", "C"])
}

fn six(text: &str, keys: [&str; 6]) -> Result<[f64; 6], String> {
    let inner =
        text.strip_prefix('{').and_then(|t| t.strip_suffix('}')).ok_or(format!("no frame: {text:?}"))?;
    let mut values = [None; 6];
    for item in inner.split(',') {
        let (key, value) = item.trim().split_once(' ').ok_or_else(|| format!("no component: {item:?}"))?;
        let index = keys.iter().position(|known| *known == key);
        let place = values.get_mut(index.ok_or_else(|| format!("unknown component {key}"))?).expect("six");
        require(place.is_none(), || format!("{key} is given twice"))?;
        *place = Some(number(value)?);
    }
    let all: Option<Vec<f64>> = values.into_iter().collect();
    all.and_then(|all| all.try_into().ok()).ok_or_else(|| format!("a component is missing in {text:?}"))
}

/// `IF`, `ELSE`, `WHILE` and `LOOP` as jumps.
fn compile(lines: &[String]) -> Result<Vec<Op>, String> {
    let mut ops = vec![];
    let end = block(lines, 0, &mut ops, None)?;
    require(end == lines.len(), || format!("{:?} closes nothing", lines[end - 1]))?;
    Ok(ops)
}

/// Reads from line `at` until what closes the block, `ELSE` included; returns the line after that.
fn block(lines: &[String], mut at: usize, ops: &mut Vec<Op>, close: Option<&str>) -> Result<usize, String> {
    while let Some(line) = lines.get(at) {
        at += 1;
        let start = ops.len();
        if Some(line.as_str()) == close || (close == Some("ENDIF") && line == "ELSE") {
            return Ok(at);
        } else if let Some(condition) = line.strip_prefix("IF ") {
            let condition = expression(condition.strip_suffix(" THEN").ok_or("IF without THEN")?)?;
            ops.push(Op::Jump(0));
            at = block(lines, at, ops, Some("ENDIF"))?;
            let mut otherwise = ops.len();
            if lines[at - 1] == "ELSE" {
                ops.push(Op::Jump(0));
                otherwise = ops.len();
                at = block(lines, at, ops, Some("ENDIF"))?;
                ops[otherwise - 1] = Op::Jump(ops.len());
            }
            ops[start] = Op::Unless(condition, otherwise);
        } else if let Some(condition) = line.strip_prefix("WHILE ") {
            let condition = expression(condition)?;
            ops.push(Op::Jump(0));
            at = block(lines, at, ops, Some("ENDWHILE"))?;
            ops.push(Op::Jump(start));
            ops[start] = Op::Unless(condition, ops.len());
        } else if line == "LOOP" {
            at = block(lines, at, ops, Some("ENDLOOP"))?;
            ops.push(Op::Jump(start));
        } else {
            ops.push(simple(line)?);
        }
    }
    match close {
        Some(close) => Err(format!("{close} is missing")),
        None => Ok(at),
    }
}

fn simple(line: &str) -> Result<Op, String> {
    let closes = ["ENDIF", "ENDWHILE", "ENDLOOP", "ELSE"].contains(&line);
    require(!closes, || format!("{line} closes nothing"))?;
    if let Some((flag, value)) = line.strip_prefix("$FLAG").and_then(|rest| rest.split_once('=')) {
        return Ok(Op::Flag(flag_number(flag)?, expression(value)?));
    }
    if let Some((output, value)) = line.strip_prefix("$OUT").and_then(|rest| rest.split_once('=')) {
        return Ok(Op::Out(index(output)?, expression(value)?));
    }
    Ok(Op::Line(line.into()))
}

/// Words with `NOT`, `AND`, `OR` and brackets; `NOT` binds closest, then `AND`.
fn expression(text: &str) -> Result<Expression, String> {
    let spaced = text.replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let (all, rest) = either(&words)?;
    require(rest.is_empty(), || format!("{text:?} goes on after an expression"))?;
    Ok(all)
}

type Parsed<'a> = Result<(Expression, &'a [&'a str]), String>;

fn either<'a>(words: &'a [&'a str]) -> Parsed<'a> {
    joined(words, "OR", both, Expression::Or)
}

fn both<'a>(words: &'a [&'a str]) -> Parsed<'a> {
    joined(words, "AND", atom, Expression::And)
}

/// What `inner` reads, once or with a word between.
fn joined<'a>(
    words: &'a [&'a str],
    word: &str,
    inner: fn(&'a [&'a str]) -> Parsed<'a>,
    join: fn(Box<Expression>, Box<Expression>) -> Expression,
) -> Parsed<'a> {
    let (mut left, mut rest) = inner(words)?;
    while let Some((_, more)) = rest.split_first().filter(|(next, _)| **next == word) {
        let (right, after) = inner(more)?;
        (left, rest) = (join(Box::new(left), Box::new(right)), after);
    }
    Ok((left, rest))
}

fn atom<'a>(words: &'a [&'a str]) -> Parsed<'a> {
    let (&word, rest) = words.split_first().ok_or("an expression ends early")?;
    if word == "NOT" {
        let (inner, rest) = atom(rest)?;
        return Ok((Expression::Not(Box::new(inner)), rest));
    }
    if word == "(" {
        let (inner, rest) = either(rest)?;
        let Some((&")", rest)) = rest.split_first() else { return Err("a bracket is not closed".into()) };
        return Ok((inner, rest));
    }
    let found = if let Some(index_text) = word.strip_prefix("$IN") {
        index(index_text)?;
        Expression::In
    } else if let Some(index_text) = word.strip_prefix("$OUT") {
        Expression::Out(index(index_text)?)
    } else if let Some(index_text) = word.strip_prefix("$FLAG") {
        Expression::Flag(flag_number(index_text)?)
    } else if let Some(limit) = word.strip_prefix("$TIMER[1]>") {
        Expression::Timer(number(limit)?)
    } else if let Some(state) = STATES.iter().position(|state| *state == word) {
        Expression::State(state)
    } else {
        Expression::Is(boolean(word).map_err(|_| format!("unknown condition {word}"))?)
    };
    Ok((found, rest))
}

const FLAGS: usize = 1024;

fn flag_number(text: &str) -> Result<usize, String> {
    let number = index(text)? as usize;
    require(number <= FLAGS, || format!("flag {number}"))?;
    Ok(number)
}

/// What the arm does beside the program.
#[derive(Debug, Clone, Copy, Default)]
struct Motion {
    steps: u32,
    welds: bool,
}

/// A robot that runs a module, step by step.
#[derive(Clone)]
pub struct Robot<'a> {
    memory: &'a Memory,
    arc: u32,
    inputs: Inputs,
    reading: Reading,
    outputs: BTreeMap<u32, bool>,
    flags: [bool; FLAGS + 1],
    /// Routine, and where in it.
    calls: Vec<(&'a str, usize)>,
    /// A wait that is not over: steps, and its time, s.
    waits: (u32, f64),
    motion: Motion,
    /// Flag, routine, and whether it is on.
    interrupt: Option<(usize, &'a str, bool)>,
    interrupted: bool,
    pending: bool,
    /// `$PRO_ACT`, emergency stop, `$STOPMESS`.
    states: [bool; 3],
    /// Steps for which the output of the arc has been high.
    burning: u32,
    /// Between the arc routines.
    along: bool,
    welded: bool,
    ended: bool,
    /// `HALT` in a row without a motion between.
    halts: u32,
    position_mm: Option<Vector3<f64>>,
    base: robot::Frame,
    /// `$BASE`, tool, `$ORI_TYPE` and `BAS(#INITMOV,0)`, in the order of [`PREPARATIONS`].
    prepared: [bool; 4],
    moved: bool,
    speed_m_s: Option<f64>,
    blend_mm: Option<f64>,
    /// In which depth of calls the last move stands.
    motion_depth: usize,
    /// `$TIMER[1]`, ms, while it runs.
    timer_ms: Option<f64>,
    remembers: bool,
    done: robot::Ran,
    events: Vec<Event>,
}

/// What has to stand before the first motion.
const PREPARATIONS: [&str; 4] = ["$BASE", "$TOOL", "$ORI_TYPE", "INITMOV"];

impl<'a> Robot<'a> {
    /// Before the first step of the module `entry`.
    ///
    /// # Errors
    /// There is none.
    pub fn new(
        memory: &'a Memory,
        entry: &str,
        arc: u32,
        inputs: Inputs,
        reading: Reading,
    ) -> Result<Self, String> {
        let entry = memory.routines.get_key_value(entry).ok_or_else(|| format!("{entry} is not declared"))?;
        Ok(Self {
            memory,
            arc,
            inputs,
            reading,
            outputs: BTreeMap::new(),
            flags: [false; FLAGS + 1],
            calls: vec![(entry.0, 0)],
            waits: (0, 0.0),
            motion: Motion::default(),
            interrupt: None,
            interrupted: false,
            pending: false,
            states: [true, false, false],
            burning: 0,
            along: false,
            welded: false,
            ended: false,
            halts: 0,
            position_mm: None,
            base: robot::Frame::base(),
            prepared: [false; 4],
            moved: false,
            speed_m_s: None,
            blend_mm: None,
            motion_depth: 0,
            timer_ms: None,
            remembers: true,
            done: robot::Ran::default(),
            events: vec![],
        })
    }

    /// A copy that keeps no events.
    pub fn copy(&self, reading: Reading) -> Self {
        let mut copy = self.clone();
        (copy.reading, copy.remembers) = (reading, false);
        copy
    }

    /// Level of an output.
    pub fn out(&self, channel: u32) -> bool {
        self.outputs.get(&channel).copied().unwrap_or(false)
    }

    /// Whether it moved along a weld in the last step.
    pub fn welded(&self) -> bool {
        self.welded
    }

    /// Whether the program is over.
    pub fn ended(&self) -> bool {
        self.ended
    }

    /// Whether it stands at a `HALT`, or was stopped.
    pub fn halted(&self) -> bool {
        !self.states[0]
    }

    /// The arc goes out: the power source has to be started again.
    pub fn lose_arc(&mut self) {
        self.burning = 0;
    }

    /// Stops the program.
    pub fn stop(&mut self, stop: Stop) {
        let row = STOPS.iter().find(|(known, ..)| *known == stop).expect("all are there");
        self.states = [row.1, row.2, row.3];
        self.ended = !row.4;
        self.welded = false;
    }

    /// A person lets it go on.
    pub fn resume(&mut self) {
        self.states = [true, false, false];
    }

    /// 10 ms of the program, then a cycle of the submit interpreter, then the interrupts.
    pub fn step(&mut self) -> Result<(), String> {
        self.welded = false;
        let runs = self.states[0] && !self.ended;
        if runs {
            self.timer_ms = self.timer_ms.map(|ms| ms + STEP_S * 1e3);
            self.advance()?;
            if self.motion.steps > 0 && self.states[0] {
                self.motion.steps -= 1;
                self.welded = self.motion.welds;
            }
        }
        let before = self.interrupt.is_some_and(|(flag, ..)| self.flags[flag]);
        let mut at = 0;
        let memory = self.memory;
        while let Some(op) = memory.submit.get(at) {
            at = self.jump(op, at + 1, true)?;
        }
        self.burning = if self.out(self.arc) { self.burning + 1 } else { 0 };
        self.interrupts(before);
        Ok(())
    }

    fn interrupts(&mut self, before: bool) {
        let Some((flag, routine, true)) = self.interrupt else { return };
        let runs = self.states[0] && !self.ended;
        let rises = self.flags[flag] && !before;
        self.pending |= rises && !runs && self.reading.edges_kept;
        if runs && (rises || self.pending) && !self.interrupted {
            (self.pending, self.interrupted) = (false, true);
            self.waits = (0, 0.0);
            self.calls.push((routine, 0));
        }
    }

    fn advance(&mut self) -> Result<(), String> {
        for _ in 0..10_000 {
            if self.waits.0 > 0 {
                self.waits.0 -= 1;
                if self.waits.0 == 0 {
                    self.waited();
                }
                return Ok(());
            }
            if self.motion.steps > 0 && !self.interrupted {
                return Ok(());
            }
            let depth = self.calls.len();
            let Some((called, at)) = self.calls.last_mut() else {
                self.ended = true;
                return Ok(());
            };
            let memory = self.memory;
            let (module, ops) = &memory.routines[*called];
            let Some(op) = ops.get(*at) else {
                self.along |= called.ends_with("_arc_on");
                self.calls.pop();
                continue;
            };
            *at += 1;
            let next = *at;
            if let Op::Line(line) = op {
                self.statement(module, line, depth - 1).map_err(|why| format!("{line:?}: {why}"))?;
            } else {
                let to = self.jump(op, next, false)?;
                self.calls[depth - 1].1 = to;
            }
            if !self.states[0] {
                return Ok(());
            }
        }
        Err("a loop without end".into())
    }

    fn waited(&mut self) {
        let (_, time_s) = self.waits;
        let depth = self.calls.len().saturating_sub(1);
        // Waits of the arc routines are not the weld's.
        if let Some(step) = self.done.steps.last_mut().filter(|_| depth == self.motion_depth) {
            step.dwell_s += time_s;
        }
        self.note(Event::Wait(time_s));
    }

    fn note(&mut self, event: Event) {
        if self.remembers {
            self.events.push(event);
        }
    }

    /// Does what is no line; where it goes on. Only the submit interpreter may switch outputs.
    fn jump(&mut self, op: &Op, next: usize, submit: bool) -> Result<usize, String> {
        match op {
            Op::Unless(condition, to) => return Ok(if self.holds(condition)? { next } else { *to }),
            Op::Jump(to) => return Ok(*to),
            Op::Flag(flag, value) => self.flags[*flag] = self.holds(value)?,
            Op::Out(output, value) => {
                require(submit, || format!("$OUT[{output}] would keep its state at a stop"))?;
                let (before, on) = (self.out(*output), self.holds(value)?);
                self.outputs.insert(*output, on);
                if before != on {
                    self.note(Event::Out(*output, on));
                }
            }
            Op::Line(line) => return Err(format!("{line:?} in the submit interpreter")),
        }
        Ok(next)
    }

    fn holds(&self, expression: &Expression) -> Result<bool, String> {
        Ok(match expression {
            Expression::Is(value) => *value,
            Expression::Not(inner) => !self.holds(inner)?,
            Expression::And(a, b) => self.holds(a)? && self.holds(b)?,
            Expression::Or(a, b) => self.holds(a)? || self.holds(b)?,
            Expression::In => match self.inputs {
                Inputs::All(level) => level,
                Inputs::Source(delay) => self.burning > delay,
            },
            Expression::Out(output) => self.out(*output),
            Expression::Flag(flag) => self.flags[*flag],
            Expression::Timer(limit) => self.timer_ms.ok_or("$TIMER[1] does not run")? > *limit,
            Expression::State(0) => self.states[0] && !self.ended,
            Expression::State(1) => self.states[1] == self.reading.alarm_reversed,
            Expression::State(_) => self.states[2],
        })
    }

    fn statement(&mut self, module: &str, line: &str, depth: usize) -> Result<(), String> {
        if let Some(rest) = line.strip_prefix("PTP ").or(line.strip_prefix("LIN ")) {
            self.motion_depth = depth;
            return self.motion(module, rest, line.starts_with("PTP"));
        }
        if let Some(time) = line.strip_prefix("WAIT SEC ") {
            let time_s = number(time)?;
            require(time_s >= 0.0, || "no time".into())?;
            if time_s > 0.0 {
                self.waits = ((time_s / STEP_S - 1e-6).ceil().max(1.0) as u32, time_s);
            }
            return Ok(());
        }
        if let Some((variable, value)) = line.split_once('=').filter(|_| line.starts_with('$')) {
            return self.assign(variable, value);
        }
        if let Some(arguments) = line.strip_prefix("BAS(#").and_then(|rest| rest.strip_suffix(')')) {
            return self.basic(arguments);
        }
        if let Some(rest) = line.strip_prefix("INTERRUPT DECL 20 WHEN $FLAG") {
            let (flag, routine) = rest.split_once("==TRUE DO ").ok_or("no condition")?;
            self.interrupt = Some((flag_number(flag)?, self.routine(routine)?, false));
            return Ok(());
        }
        match line {
            "HALT" => {
                (self.states[0], self.halts) = (false, self.halts + 1);
                self.done.asked.push(self.done.steps.len());
            }
            "INTERRUPT ON 20" => self.interrupt.as_mut().ok_or("interrupt 20 is not declared")?.2 = true,
            "BRAKE F" => {
                require(self.interrupted, || "BRAKE outside an interrupt".into())?;
                self.motion = Motion::default();
            }
            "INTERRUPT ON 3" | "GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM()" => {}
            _ => {
                require(depth < 10, || "calls without end".into())?;
                let called = self.routine(line)?;
                self.along &= !called.ends_with("_arc_off");
                self.calls.push((called, 0));
            }
        }
        Ok(())
    }

    fn routine(&self, call: &str) -> Result<&'a str, String> {
        let called = call.strip_suffix("()").ok_or("unknown statement")?;
        let found = self.memory.routines.get_key_value(called);
        found.map(|(called, _)| called.as_str()).ok_or_else(|| format!("{called} is not declared"))
    }

    fn basic(&mut self, arguments: &str) -> Result<(), String> {
        let (command, value) = arguments.split_once(',').ok_or("BAS takes two arguments")?;
        let value = number(value)?;
        match command {
            "INITMOV" => self.prepared[3] = true,
            "BASE" => {
                let held = self.memory.held.get(&value.to_string());
                self.base = *held.ok_or_else(|| format!("nobody has set base {value}"))?;
                self.prepared[0] = true;
            }
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
                self.base = match value.strip_prefix("$ROBROOT:{FRAME: ") {
                    Some(typed) => {
                        let [x, y, z, a, b, c] = frame(&format!("{{{typed}"))?;
                        robot::Frame { origin_mm: Vector3::new(x, y, z), axes: rotation(a, b, c) }
                    }
                    None => {
                        require(value == "$ROBROOT" || value == "$NULLFRAME", || format!("base {value}"))?;
                        robot::Frame::base()
                    }
                };
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
            _ => return Err("unknown variable".into()),
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
        self.halts = 0;
        if joint && rest.starts_with('{') {
            let joints_deg = six(rest, ["A1", "A2", "A3", "A4", "A5", "A6"])?;
            require(!self.out(self.arc), || "joints under the arc".into())?;
            self.done.joints.push((self.done.steps.len(), joints_deg));
            (self.motion, self.position_mm) = (Motion { steps: 100, welds: false }, None);
            return Ok(());
        }
        let (point, blended) = match rest.split_once(' ') {
            Some((point, "C_DIS")) if !joint => (point, true),
            None => (rest, false),
            _ => return Err("unknown approximation".into()),
        };
        let frame = self.memory.points.get(&(module.to_owned(), point.to_owned()));
        let [x, y, z, a, b, c] = *frame.ok_or_else(|| format!("{point} is not in the .dat"))?;
        let speed_m_s = self.speed_m_s.ok_or("$VEL.CP is not set")?;
        let blend_mm = if blended { self.blend_mm.ok_or("$APO.CDIS is not set")? } else { 0.0 };
        let (position_mm, base_from_tool) = self.base.of(Vector3::new(x, y, z), rotation(a, b, c));
        let way_mm = self.position_mm.filter(|_| !joint).map(|from| (position_mm - from).norm());
        let time_s = way_mm.map_or(1.0, |way_mm| way_mm / (speed_m_s * 1e3));
        self.motion = Motion { steps: (time_s / STEP_S).ceil().max(1.0) as u32, welds: self.along };
        self.position_mm = Some(position_mm);
        self.note(Event::Move(self.done.steps.len()));
        self.done.steps.push(Step {
            position_mm,
            base_from_tool,
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
