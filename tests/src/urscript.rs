//! Runs URScript: the few statements that weldpath writes, from the vendor's manual, on a robot that only remembers.
//!
//! Shares no code with the emitter: it parses text and turns rotation vectors into matrices by Rodrigues' formula.
//! Whatever it does not know is an error. It has a clock, one thread beside the program, and can be stopped at any step.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use crate::robot::{Frame, Held, STEP_S, Stop};

/// What the robot did, in order.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// `set_tcp`: position in m and rotation vector.
    Tcp([f64; 6]),
    /// `set_payload`: kg and centre in m.
    Payload(f64, [f64; 3]),
    /// `set_standard_digital_out`.
    Out(u8, bool),
    /// `set_runstate_standard_digital_output_to_value`.
    Action(u8, u8),
    /// Time passed standing still, s.
    Sleep(f64),
    /// `movej`, `movel` or `movep` to a pose.
    Move(Move),
    /// `movej` to joints, rad.
    Joints([f64; 6]),
    /// A person is asked, and waited for.
    Asked,
    /// `halt`.
    Halt,
}

/// One move.
#[derive(Debug, Clone, PartialEq)]
pub struct Move {
    /// `movej`, `movel` or `movep`.
    pub command: String,
    /// m.
    pub position_m: Vector3<f64>,
    /// Rotation vector, rad.
    pub rotation_rad: Vector3<f64>,
    /// m/s or, for `movej`, rad/s.
    pub speed: f64,
    /// m.
    pub blend_m: f64,
}

impl Move {
    /// Base from tool, by Rodrigues' formula.
    pub fn rotation(&self) -> Matrix3<f64> {
        let angle = self.rotation_rad.norm();
        if angle < 1e-12 {
            return Matrix3::identity();
        }
        let k = (self.rotation_rad / angle).cross_matrix();
        Matrix3::identity() + k * angle.sin() + k * k * (1.0 - angle.cos())
    }
}

/// Runs the function `weldpath`; every digital input reads as `input`. A program that does not end is an error.
pub fn run(script: &str, input: bool) -> Result<Vec<Event>, String> {
    run_with(script, input, &Held::new())
}

/// The same from a program of a pendant whose installation has these features.
///
/// # Errors
/// As of [`run`].
pub fn run_with(script: &str, input: bool, features: &Held) -> Result<Vec<Event>, String> {
    let program = Program::parse_with(script, features)?;
    let mut robot = Robot::new(&program, Inputs::All(input));
    for _ in 0..10_000_000 {
        if robot.ended() {
            return Ok(robot.events);
        }
        robot.step()?;
    }
    Err("a program that does not end".into())
}

/// A script, understood.
#[derive(Debug, Default)]
pub struct Program {
    main: Vec<Op>,
    threads: BTreeMap<String, Vec<Op>>,
    /// Names of variables.
    variables: Vec<String>,
    globals: Vec<usize>,
    /// Poses that have a name.
    frames: Held,
}

#[derive(Debug, Clone, PartialEq)]
enum Op {
    Set(usize, f64),
    Add(usize, f64),
    Jump(usize),
    /// Jumps where the condition does not hold.
    Unless(Condition, usize),
    Run(String),
    Sync,
    Note,
    Do(Event),
}

#[derive(Debug, Clone, PartialEq)]
enum Condition {
    True,
    InputIsLow(u8),
    OutputIsLow(u8),
    Above(usize, f64),
    AtLeast(usize, f64),
}

impl Program {
    /// # Errors
    /// The first line that is no URScript that weldpath writes.
    pub fn parse(script: &str) -> Result<Self, String> {
        Self::parse_with(script, &Held::new())
    }

    /// The same where these features are known.
    ///
    /// # Errors
    /// As of [`Self::parse`].
    pub fn parse_with(script: &str, features: &Held) -> Result<Self, String> {
        let lines: Vec<&str> =
            script.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')).collect();
        let (&first, body) = lines.split_first().ok_or("empty script")?;
        if first != "def weldpath():" {
            return Err(format!("starts with {first:?}"));
        }
        let mut program = Self { frames: features.clone(), ..Self::default() };
        let mut main = vec![];
        let end = program.block(body, 0, &mut main, None)?;
        program.main = main;
        match body.len() - end {
            0 => Ok(program),
            more => Err(format!("{more} lines after the function")),
        }
    }

    /// Reads from line `at` to the `end` of its block; returns the line after that. `thread`: within one.
    fn block(
        &mut self,
        lines: &[&str],
        mut at: usize,
        ops: &mut Vec<Op>,
        thread: Option<&str>,
    ) -> Result<usize, String> {
        loop {
            let line = *lines.get(at).ok_or("a block without end")?;
            at += 1;
            if line == "end" {
                return Ok(at);
            }
            if let Some(called) = line.strip_prefix("thread ") {
                let called = called.strip_suffix("():").ok_or_else(|| format!("no thread: {line:?}"))?;
                let mut body = vec![];
                at = self.block(lines, at, &mut body, Some(called))?;
                self.threads.insert(called.into(), body);
                continue;
            }
            let repeats = line.starts_with("while ");
            if let Some(condition) = line.strip_prefix("while ").or(line.strip_prefix("if ")) {
                let start = ops.len();
                let condition = self.condition(condition)?;
                ops.push(Op::Jump(0));
                at = self.block(lines, at, ops, thread)?;
                if repeats {
                    ops.push(Op::Jump(start));
                }
                ops[start] = Op::Unless(condition, ops.len());
            } else {
                let op = self.statement(line, thread).map_err(|why| format!("{line:?}: {why}"))?;
                ops.push(op);
            }
        }
    }

    fn variable(&mut self, name: &str) -> usize {
        self.variables.iter().position(|known| known == name).unwrap_or_else(|| {
            self.variables.push(name.into());
            self.variables.len() - 1
        })
    }

    fn condition(&mut self, condition: &str) -> Result<Condition, String> {
        let unknown = || format!("unknown condition {condition:?}");
        let inner = condition.strip_prefix('(').and_then(|c| c.strip_suffix("):")).ok_or_else(unknown)?;
        if inner == "True" {
            return Ok(Condition::True);
        }
        let signal = |kind: &str| {
            let rest = inner.strip_prefix(kind)?;
            Some(rest.strip_suffix(") == False").ok_or_else(unknown).and_then(channel_number))
        };
        if let Some(channel) = signal("get_standard_digital_in(") {
            return Ok(Condition::InputIsLow(channel?));
        }
        if let Some(channel) = signal("get_standard_digital_out(") {
            return Ok(Condition::OutputIsLow(channel?));
        }
        if let Some((name, limit)) = inner.split_once(" >= ") {
            return Ok(Condition::AtLeast(self.variable(name), number(limit)?));
        }
        let (name, limit) = inner.split_once(" > ").ok_or_else(unknown)?;
        Ok(Condition::Above(self.variable(name), number(limit)?))
    }

    fn statement(&mut self, line: &str, thread: Option<&str>) -> Result<Op, String> {
        if let Some((name, value)) = line.split_once(" = p[") {
            let pose = list(&format!("p[{value}"), "p[")?;
            self.frames.insert(name.into(), frame(pose));
            return Ok(Op::Note);
        }
        if let Some((name, value)) = line.split_once(" = ").filter(|(name, _)| !name.contains('(')) {
            return self.assignment(name, value, thread);
        }
        if line == "halt" {
            return Ok(Op::Do(Event::Halt));
        }
        let (name, rest) = line.split_once('(').ok_or("unknown statement")?;
        let inner = rest.strip_suffix(')').ok_or("no closing bracket")?;
        let mut arguments = arguments(inner);
        if let Some(pose) = arguments.first_mut().filter(|pose| pose.starts_with("pose_trans(")) {
            *pose = self.pose_trans(pose)?;
        }
        call(name, &arguments)
    }

    /// `pose_trans(frame, p[...])`: the pose in the base, written out.
    fn pose_trans(&self, call: &str) -> Result<String, String> {
        let inner = call.strip_prefix("pose_trans(").and_then(|rest| rest.strip_suffix(')'));
        let (name, pose) =
            inner.and_then(|inner| inner.split_once(", ")).ok_or("two poses are transformed")?;
        let known = self.frames.get(name).ok_or_else(|| format!("no feature {name}"))?;
        let inner = frame(list(pose, "p[")?);
        let (position_mm, axes) = known.of(inner.origin_mm, inner.axes);
        let turned = nalgebra::Rotation3::from_matrix_unchecked(axes).scaled_axis();
        let [x, y, z] = <[f64; 3]>::from(position_mm / 1e3);
        Ok(format!("p[{x}, {y}, {z}, {}, {}, {}]", turned.x, turned.y, turned.z))
    }

    fn assignment(&mut self, name: &str, value: &str, thread: Option<&str>) -> Result<Op, String> {
        if let Some(called) = value.strip_prefix("run ") {
            let called = called.strip_suffix("()").ok_or("no call after run")?;
            let known = self.threads.contains_key(called);
            return if known { Ok(Op::Run(called.into())) } else { Err(format!("no thread {called}")) };
        }
        let (global, name) = name.strip_prefix("global ").map_or((false, name), |name| (true, name));
        let variable = self.variable(name);
        if global && thread.is_none() {
            self.globals.push(variable);
        }
        if thread.is_some() && !self.globals.contains(&variable) {
            return Err(format!("{name} is not global: the program would not see it"));
        }
        match value.strip_prefix(&format!("{name} + ")) {
            Some(step) => Ok(Op::Add(variable, number(step)?)),
            None => Ok(Op::Set(variable, number(value)?)),
        }
    }
}

fn call(name: &str, arguments: &[String]) -> Result<Op, String> {
    let event = match (name, arguments) {
        ("set_tcp", [pose]) => Event::Tcp(list(pose, "p[")?),
        ("set_payload", [mass, centre]) => Event::Payload(number(mass)?, list(centre, "[")?),
        ("set_standard_digital_out", [channel, state]) => {
            Event::Out(channel_number(channel)?, boolean(state)?)
        }
        ("set_runstate_standard_digital_output_to_value", [channel, action]) => {
            let action: u8 = action.parse().map_err(|_| format!("no action: {action:?}"))?;
            if action > 4 {
                return Err(format!("action {action} is not known here"));
            }
            Event::Action(channel_number(channel)?, action)
        }
        ("sleep", [time]) if number(time)? > 0.0 => Event::Sleep(number(time)?),
        ("movej", [joints, a, v]) if joints.starts_with('[') => {
            positive(a, "a=")?;
            positive(v, "v=")?;
            Event::Joints(list(joints, "[")?)
        }
        ("movej" | "movel", [pose, a, v]) => Event::Move(a_move(name, pose, a, v, "r=0")?),
        ("movep", [pose, a, v, r]) => Event::Move(a_move(name, pose, a, v, r)?),
        ("popup", [_, title, kind, blocking]) => {
            let kinds = ["error=True", "warning=True"];
            let known = title.starts_with("title=") && kinds.contains(&kind.as_str());
            match (known, blocking.strip_prefix("blocking=").map(boolean)) {
                (true, Some(Ok(true))) => Event::Asked,
                (true, Some(Ok(false))) => return Ok(Op::Note),
                _ => return Err("unknown popup".into()),
            }
        }
        ("textmsg", [_]) => return Ok(Op::Note),
        ("sync", [nothing]) if nothing.is_empty() => return Ok(Op::Sync),
        _ => return Err("unknown call".into()),
    };
    Ok(Op::Do(event))
}

/// What the digital inputs read as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inputs {
    /// All the same.
    All(bool),
    /// High so many steps after the output `arc` became high, as long as it is.
    Source {
        /// Output that starts the power source.
        arc: u8,
        /// Steps.
        delay: u32,
    },
}

/// What an output of action 1 does when a paused program goes on: the manuals do not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resumed {
    /// It stays low until the program sets it.
    StaysLow,
    /// It is again what the program had set.
    ComesBack,
}

impl Resumed {
    /// Both readings.
    pub const BOTH: [Self; 2] = [Self::StaysLow, Self::ComesBack];
}

/// Whether an output falls at a stop, by its action, and the source.
///
/// Script directory, `set_runstate_standard_digital_output_to_value`: 0 preserves, 1 is low when the program is not
/// running, 2 is high then, 3 is high when it runs and low when it is stopped, 4 is low when it ends unscheduled, which
/// a protective stop or a fault causes. User manual, I/O set-up: low when not running is low when stopped or paused.
const FALLS: [(u8, Stop, bool, &str); 12] = [
    (0, Stop::Pause, false, "script directory"),
    (0, Stop::Protective, false, "script directory"),
    (0, Stop::Emergency, false, "script directory; the circuit must cut the source"),
    (0, Stop::Program, false, "script directory"),
    (1, Stop::Pause, true, "user manual, I/O set-up"),
    (1, Stop::Protective, true, "script directory: an unscheduled end"),
    (1, Stop::Emergency, true, "script directory: an unscheduled end"),
    (1, Stop::Program, true, "script directory"),
    (4, Stop::Pause, false, "script directory: not an end"),
    (4, Stop::Protective, true, "script directory"),
    (4, Stop::Emergency, true, "script directory"),
    (4, Stop::Program, false, "script directory: a scheduled end"),
];

fn falls(action: u8, stop: Stop) -> bool {
    let row = FALLS.iter().find(|(known, at, ..)| (*known, *at) == (action, stop));
    row.map_or(action == 3, |(_, _, falls, _)| *falls)
}

#[derive(Debug, Clone, Copy, Default)]
struct Output {
    level: bool,
    /// What the program set last.
    set: bool,
    action: u8,
}

#[derive(Debug, Clone, Copy, Default)]
struct Thread {
    at: usize,
    /// Steps that the last statement still takes.
    busy: u32,
    /// Whether it moves along a weld meanwhile.
    welds: bool,
}

/// A robot that runs a script, step by step.
#[derive(Debug, Clone)]
pub struct Robot<'a> {
    program: &'a Program,
    inputs: Inputs,
    main: Thread,
    other: Option<(&'a [Op], Thread)>,
    variables: Vec<Option<f64>>,
    outputs: [Output; 8],
    /// Steps for which the arc's output has been high.
    burning: u32,
    position_m: Option<Vector3<f64>>,
    welded: bool,
    ended: bool,
    paused: Option<Resumed>,
    remembers: bool,
    events: Vec<Event>,
}

impl<'a> Robot<'a> {
    /// Before its first step.
    pub fn new(program: &'a Program, inputs: Inputs) -> Self {
        Self {
            program,
            inputs,
            main: Thread::default(),
            other: None,
            variables: vec![None; program.variables.len()],
            outputs: [Output::default(); 8],
            burning: 0,
            position_m: None,
            welded: false,
            ended: false,
            paused: None,
            remembers: true,
            events: vec![],
        }
    }

    /// A copy that keeps no events.
    pub fn copy(&self) -> Self {
        Self { events: vec![], remembers: false, variables: self.variables.clone(), ..*self }
    }

    /// Whether the program is over.
    pub fn ended(&self) -> bool {
        self.ended
    }

    /// Level of an output.
    pub fn out(&self, channel: u8) -> bool {
        self.outputs[usize::from(channel)].level
    }

    /// Whether it moved along a weld in the last step.
    pub fn welded(&self) -> bool {
        self.welded
    }

    /// Whether the input of the established arc is high, or would be, were there one.
    pub fn established(&self) -> bool {
        match self.inputs {
            Inputs::All(level) => level,
            Inputs::Source { delay, .. } => self.burning > delay,
        }
    }

    /// Value of a variable.
    pub fn value_of(&self, name: &str) -> Option<f64> {
        let index = self.program.variables.iter().position(|known| known == name)?;
        self.variables[index]
    }

    /// The arc goes out: the power source has to be started again.
    pub fn lose_arc(&mut self) {
        self.burning = 0;
    }

    /// Stops the program.
    pub fn stop(&mut self, stop: Stop, resumed: Resumed) {
        self.ended = !stop.resumes();
        self.paused = Some(resumed);
        self.welded = false;
        for output in &mut self.outputs {
            output.level &= !falls(output.action, stop);
        }
    }

    /// A person lets it go on.
    pub fn resume(&mut self) {
        let comes_back = self.paused.take() == Some(Resumed::ComesBack);
        for output in &mut self.outputs {
            match output.action {
                1 if comes_back => output.level = output.set,
                3 => output.level = true,
                _ => {}
            }
        }
    }

    /// 10 ms.
    pub fn step(&mut self) -> Result<(), String> {
        self.welded = false;
        if !self.ended && self.paused.is_none() {
            let (mut main, other) = (self.main, self.other);
            self.ended |= self.advance(&self.program.main, &mut main)?;
            self.main = main;
            if let (Some((ops, mut thread)), false) = (other, self.ended) {
                let over = self.advance(ops, &mut thread)?;
                self.other = (!over).then_some((ops, thread));
            }
        }
        if let Inputs::Source { arc, .. } = self.inputs {
            self.burning = if self.out(arc) { self.burning + 1 } else { 0 };
        }
        Ok(())
    }

    /// One step of a thread; whether it is over.
    fn advance(&mut self, ops: &'a [Op], thread: &mut Thread) -> Result<bool, String> {
        for _ in 0..10_000 {
            if thread.busy > 0 {
                thread.busy -= 1;
                self.welded |= thread.welds;
                return Ok(false);
            }
            thread.welds = false;
            let Some(op) = ops.get(thread.at) else { return Ok(true) };
            thread.at += 1;
            self.op(op, thread)?;
            if self.ended {
                return Ok(true);
            }
        }
        Err("a loop that does not end".into())
    }

    fn op(&mut self, op: &'a Op, thread: &mut Thread) -> Result<(), String> {
        match op {
            Op::Set(variable, value) => self.variables[*variable] = Some(*value),
            Op::Add(variable, value) => {
                let before = self.value(*variable)?;
                self.variables[*variable] = Some(before + value);
            }
            Op::Jump(to) => thread.at = *to,
            Op::Unless(condition, to) => {
                if !self.holds(condition)? {
                    thread.at = *to;
                }
            }
            Op::Run(called) => {
                if self.other.is_some() {
                    return Err("a second thread".into());
                }
                let ops: Option<&'a Vec<Op>> = self.program.threads.get(called);
                self.other = ops.map(|ops| (ops.as_slice(), Thread::default()));
            }
            Op::Sync => thread.busy = 1,
            Op::Note => {}
            Op::Do(event) => self.event(event, thread),
        }
        Ok(())
    }

    fn value(&self, variable: usize) -> Result<f64, String> {
        let unset = || format!("{} is read before it is set", self.program.variables[variable]);
        self.variables[variable].ok_or_else(unset)
    }

    fn holds(&self, condition: &Condition) -> Result<bool, String> {
        Ok(match *condition {
            Condition::True => true,
            Condition::InputIsLow(_) => !self.established(),
            Condition::OutputIsLow(channel) => !self.out(channel),
            Condition::Above(variable, limit) => self.value(variable)? > limit,
            Condition::AtLeast(variable, limit) => self.value(variable)? >= limit,
        })
    }

    fn event(&mut self, event: &Event, thread: &mut Thread) {
        let steps = |time_s: f64| (time_s / STEP_S - 1e-6).ceil().max(1.0) as u32;
        match event {
            Event::Out(channel, on) => {
                let output = &mut self.outputs[usize::from(*channel)];
                (output.set, output.level) = (*on, *on);
            }
            Event::Action(channel, action) => {
                let output = &mut self.outputs[usize::from(*channel)];
                output.action = *action;
                output.level |= *action == 3;
            }
            Event::Sleep(time_s) => thread.busy = steps(*time_s),
            Event::Move(one) => {
                let way_m = self.position_m.map(|from| (one.position_m - from).norm());
                let joint = one.command == "movej";
                thread.busy = steps(way_m.filter(|_| !joint).map_or(1.0, |way_m| way_m / one.speed));
                thread.welds = one.command == "movep";
                self.position_m = Some(one.position_m);
            }
            Event::Joints(_) => (thread.busy, self.position_m) = (steps(1.0), None),
            Event::Asked => thread.busy = steps(0.1),
            Event::Halt => self.ended = true,
            Event::Tcp(_) | Event::Payload(..) => {}
        }
        if self.remembers {
            self.events.push(event.clone());
        }
    }
}

fn positive(text: &str, name: &str) -> Result<f64, String> {
    let value = number(text.strip_prefix(name).ok_or(format!("no {name}"))?)?;
    if value > 0.0 { Ok(value) } else { Err(format!("{name} is above 0")) }
}

fn a_move(command: &str, pose: &str, a: &str, v: &str, r: &str) -> Result<Move, String> {
    let [x, y, z, rx, ry, rz] = list(pose, "p[")?;
    positive(a, "a=")?;
    let speed = positive(v, "v=")?;
    let blend_m = number(r.strip_prefix("r=").ok_or("no r=")?)?;
    if blend_m < 0.0 {
        return Err("a blend radius is not below 0".into());
    }
    let (position_m, rotation_rad) = (Vector3::new(x, y, z), Vector3::new(rx, ry, rz));
    Ok(Move { command: command.into(), position_m, rotation_rad, speed, blend_m })
}

/// Of a position in m and a rotation vector.
fn frame([x, y, z, rx, ry, rz]: [f64; 6]) -> Frame {
    let pose = Move {
        command: String::new(),
        position_m: Vector3::new(x, y, z),
        rotation_rad: Vector3::new(rx, ry, rz),
        speed: 0.0,
        blend_m: 0.0,
    };
    Frame { origin_mm: pose.position_m * 1e3, axes: pose.rotation() }
}

/// Splits at commas outside brackets and quotes.
fn arguments(inner: &str) -> Vec<String> {
    let (mut parts, mut depth, mut quoted) = (vec![String::new()], 0, false);
    for c in inner.chars() {
        match c {
            '"' => quoted = !quoted,
            '[' | '(' => depth += 1,
            ']' | ')' => depth -= 1,
            ',' if depth == 0 && !quoted => {
                parts.push(String::new());
                continue;
            }
            _ => {}
        }
        parts.last_mut().expect("never empty").push(c);
    }
    parts.into_iter().map(|part| part.trim().to_owned()).collect()
}

fn list<const N: usize>(text: &str, open: &str) -> Result<[f64; N], String> {
    let inner =
        text.strip_prefix(open).and_then(|t| t.strip_suffix(']')).ok_or(format!("no list: {text}"))?;
    let numbers = inner.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
    numbers.try_into().map_err(|n: Vec<f64>| format!("{} numbers instead of {N}", n.len()))
}

fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| format!("no number: {text:?}"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("not finite: {text:?}")) }
}

fn channel_number(text: &str) -> Result<u8, String> {
    let channel = text.parse().map_err(|_| format!("no channel: {text:?}"))?;
    if channel < 8 { Ok(channel) } else { Err(format!("channels are 0 to 7, not {channel}")) }
}

fn boolean(text: &str) -> Result<bool, String> {
    match text {
        "True" => Ok(true),
        "False" => Ok(false),
        _ => Err(format!("no boolean: {text:?}")),
    }
}
