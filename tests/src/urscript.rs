//! Runs URScript: the few statements that weldpath writes, from the vendor's manual, on a robot that only remembers.
//!
//! Shares no code with the emitter: it parses text and turns rotation vectors into matrices by Rodrigues' formula.
//! Whatever it does not know is an error.

use nalgebra::{Matrix3, Vector3};

/// What the robot did, in order.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// `set_tcp`: position in m and rotation vector.
    Tcp([f64; 6]),
    /// `set_payload`: kg and centre in m.
    Payload(f64, [f64; 3]),
    /// `set_standard_digital_out`.
    Out(u8, bool),
    /// Time passed standing still, s.
    Sleep(f64),
    /// `movej`, `movel` or `movep` to a pose.
    Move(Move),
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
    let lines: Vec<&str> =
        script.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')).collect();
    let (&first, body) = lines.split_first().ok_or("empty script")?;
    if first != "def weldpath():" {
        return Err(format!("starts with {first:?}"));
    }
    let mut robot = Robot { input, waited_s: None, events: vec![] };
    let end = robot.block(body, 0)?;
    match body.len() - end {
        0 => Ok(robot.events),
        more => Err(format!("{more} lines after the function")),
    }
}

struct Robot {
    input: bool,
    /// The one variable that scripts of weldpath have.
    waited_s: Option<f64>,
    events: Vec<Event>,
}

impl Robot {
    /// Runs from line `at` to the `end` of its block; returns the line after that.
    fn block(&mut self, lines: &[&str], mut at: usize) -> Result<usize, String> {
        loop {
            let line = *lines.get(at).ok_or("a block without end")?;
            if line == "end" {
                return Ok(at + 1);
            }
            at = if let Some(condition) = line.strip_prefix("while ") {
                self.repeat(condition, lines, at + 1)?
            } else if let Some(condition) = line.strip_prefix("if ") {
                if self.holds(condition)? { self.block(lines, at + 1)? } else { skip(lines, at + 1)? }
            } else {
                self.statement(line)?;
                at + 1
            };
            if self.events.last() == Some(&Event::Halt) {
                return Ok(lines.len());
            }
        }
    }

    fn repeat(&mut self, condition: &str, lines: &[&str], body: usize) -> Result<usize, String> {
        for _ in 0..100_000 {
            if !self.holds(condition)? {
                return skip(lines, body);
            }
            let after = self.block(lines, body)?;
            if self.events.last() == Some(&Event::Halt) {
                return Ok(after);
            }
        }
        Err("a loop that does not end".into())
    }

    fn holds(&self, condition: &str) -> Result<bool, String> {
        let unknown = || format!("unknown condition {condition:?}");
        let inner = condition.strip_prefix('(').and_then(|c| c.strip_suffix("):")).ok_or_else(unknown)?;
        if let Some(rest) = inner.strip_prefix("get_standard_digital_in(") {
            let channel = rest.strip_suffix(") == False").ok_or_else(unknown)?;
            channel_number(channel)?;
            return Ok(!self.input);
        }
        let limit = number(inner.strip_prefix("waited_s > ").ok_or_else(unknown)?)?;
        Ok(self.waited_s.ok_or("waited_s is read before it is set")? > limit)
    }

    fn statement(&mut self, line: &str) -> Result<(), String> {
        if let Some(value) = line.strip_prefix("waited_s = ") {
            let before = self.waited_s;
            self.waited_s = Some(match value.strip_prefix("waited_s + ") {
                Some(step) => before.ok_or("waited_s is read before it is set")? + number(step)?,
                None => number(value)?,
            });
            return Ok(());
        }
        if line == "halt" {
            self.events.push(Event::Halt);
            return Ok(());
        }
        let (name, rest) = line.split_once('(').ok_or_else(|| format!("unknown statement {line:?}"))?;
        let inner = rest.strip_suffix(')').ok_or_else(|| format!("no closing bracket in {line:?}"))?;
        self.call(name, &arguments(inner)).map_err(|why| format!("{line:?}: {why}"))
    }

    fn call(&mut self, name: &str, arguments: &[String]) -> Result<(), String> {
        let event = match (name, arguments) {
            ("set_tcp", [pose]) => Event::Tcp(list(pose, "p[")?),
            ("set_payload", [mass, centre]) => Event::Payload(number(mass)?, list(centre, "[")?),
            ("set_standard_digital_out", [channel, state]) => {
                Event::Out(channel_number(channel)?, boolean(state)?)
            }
            ("sleep", [time]) if number(time)? > 0.0 => Event::Sleep(number(time)?),
            ("movej" | "movel", [pose, a, v]) => Event::Move(a_move(name, pose, a, v, "r=0")?),
            ("movep", [pose, a, v, r]) => Event::Move(a_move(name, pose, a, v, r)?),
            ("popup", [_, ..]) => return Ok(()),
            _ => return Err("unknown call".into()),
        };
        self.events.push(event);
        Ok(())
    }
}

fn a_move(command: &str, pose: &str, a: &str, v: &str, r: &str) -> Result<Move, String> {
    let named = |text: &str, name: &str| number(text.strip_prefix(name).ok_or(format!("no {name}"))?);
    let [x, y, z, rx, ry, rz] = list(pose, "p[")?;
    let (acceleration, speed, blend_m) = (named(a, "a=")?, named(v, "v=")?, named(r, "r=")?);
    if acceleration <= 0.0 || speed <= 0.0 || blend_m < 0.0 {
        return Err("acceleration and speed are above 0, a blend radius is not below".into());
    }
    let (position_m, rotation_rad) = (Vector3::new(x, y, z), Vector3::new(rx, ry, rz));
    Ok(Move { command: command.into(), position_m, rotation_rad, speed, blend_m })
}

/// The line after the `end` of the block that begins at `at`.
fn skip(lines: &[&str], mut at: usize) -> Result<usize, String> {
    let mut depth = 1;
    while depth > 0 {
        let line = *lines.get(at).ok_or("a block without end")?;
        depth += i32::from(line.ends_with(':')) - i32::from(line == "end");
        at += 1;
    }
    Ok(at)
}

/// Splits at commas outside brackets and quotes.
fn arguments(inner: &str) -> Vec<String> {
    let (mut parts, mut depth, mut quoted) = (vec![String::new()], 0, false);
    for c in inner.chars() {
        match c {
            '"' => quoted = !quoted,
            '[' => depth += 1,
            ']' => depth -= 1,
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
