//! What a robot did, whichever language it was told in, and the rules that hold for all of them.
//!
//! The interpreters of the dialects share this form and nothing of the emitters.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use weldpath::robot::dialect::Dialect;
use weldpath::robot::posture::{PlannedPosture, ProgramEnd, Stance};
use weldpath::run::job::Job;
use weldpath::run::postprocessing::{Output, postprocess};
use weldpath::weld::program::Waypoint;

use crate::plans;

/// Welds that stop at corners, dwell, weave and leave gaps.
pub const WOVEN: &str = r#"
[path]
corner = "stop"
start_dwell_s = 0.4
[weave]
shape = "zigzag"
amplitude_mm = 3
wavelength_mm = 6
dwell_left_s = 0.25
[stitch]
pattern = "stitches"
length_mm = 20
pitch_mm = 40
"#;

/// Length of a step of the interpreters that have a clock, s.
pub const STEP_S: f64 = 0.01;

/// How a person, or the controller, stops a running program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// By the pendant; it goes on where it was.
    Pause,
    /// By the controller, as after a collision; it goes on once a person has unlocked it.
    Protective,
    /// By the button; the program is over.
    Emergency,
    /// By the pendant, for good.
    Program,
}

impl Stop {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Pause, Self::Protective, Self::Emergency, Self::Program];

    /// Whether the same program can go on.
    pub fn resumes(self) -> bool {
        matches!(self, Self::Pause | Self::Protective)
    }
}

/// A frame in the robot's own base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// mm.
    pub origin_mm: Vector3<f64>,
    /// Columns: its axes.
    pub axes: Matrix3<f64>,
}

impl Frame {
    /// The base itself.
    pub fn base() -> Self {
        Self { origin_mm: Vector3::zeros(), axes: Matrix3::identity() }
    }

    /// A place and a rotation in it, in the base.
    pub fn of(&self, position_mm: Vector3<f64>, rotation: Matrix3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        (self.origin_mm + self.axes * position_mm, self.axes * rotation)
    }
}

/// Frames that a person has set on the controller, by name or number.
pub type Held = BTreeMap<String, Frame>;

/// A file of a program: its name and its text.
pub type Text = (String, String);

/// One move.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// mm, base frame.
    pub position_mm: Vector3<f64>,
    /// Columns: the tool's axes in the base frame.
    pub base_from_tool: Matrix3<f64>,
    /// None where the move is one of the joints.
    pub speed_mm_s: Option<f64>,
    /// Whether the robot stands at the end of it.
    pub stops: bool,
    /// Where the corner may be cut, mm.
    pub blend_mm: f64,
    /// How long it stands at the end of it, arc on, s.
    pub dwell_s: f64,
    /// Whether the arc burns on the way.
    pub burning: bool,
}

/// What a program did.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Ran {
    /// Moves to poses.
    pub steps: Vec<Step>,
    /// Moves to joints, degrees, and how many steps came before each.
    pub joints: Vec<(usize, [f64; 6])>,
    /// Where a person was asked and waited for: how many steps came before.
    pub asked: Vec<usize>,
}

/// Whether `ran` begins and ends by joints as [`standing`] says, and is the plan otherwise.
///
/// # Errors
/// The first rule that is broken.
pub fn check_standing(
    ran: &Ran,
    waypoints: &[Waypoint],
    stances: &[Stance],
    home: bool,
    tolerance: &Tolerance,
) -> Result<(), String> {
    let first = stances[0].joints_deg;
    let last = ran.steps.len();
    let wanted = if home { vec![(0, HOME_DEG), (0, first), (last, HOME_DEG)] } else { vec![(0, first)] };
    let near = |a: &(usize, [f64; 6]), b: &(usize, [f64; 6])| {
        a.0 == b.0 && a.1.iter().zip(b.1).all(|(a, b)| (a - b).abs() < 1e-4)
    };
    let same = ran.joints.len() == wanted.len() && ran.joints.iter().zip(&wanted).all(|(a, b)| near(a, b));
    require(same, || format!("joints {:?}, not {wanted:?}", ran.joints))?;
    let asked: &[usize] = if home { &[] } else { &[0] };
    require(ran.asked == asked, || format!("asks at {:?}, not at {asked:?}", ran.asked))?;
    let reached = Step {
        position_mm: waypoints[0].position_mm.coords,
        base_from_tool: tool(&waypoints[0]),
        speed_mm_s: None,
        stops: true,
        blend_mm: 0.0,
        dwell_s: 0.0,
        burning: false,
    };
    let steps: Vec<Step> = [reached].into_iter().chain(ran.steps.iter().cloned()).collect();
    check(&steps, waypoints, tolerance)
}

/// How exact a dialect is.
#[derive(Debug, Clone, Copy)]
pub struct Tolerance {
    /// Position, mm.
    pub position_mm: f64,
    /// Rotation, rad.
    pub rotation_rad: f64,
    /// Speed, mm/s.
    pub speed_mm_s: f64,
}

/// Whether `steps` are the plan; the first rule that is broken is named.
pub fn check(steps: &[Step], waypoints: &[Waypoint], tolerance: &Tolerance) -> Result<(), String> {
    require(steps.len() == waypoints.len(), || format!("{} moves, not {}", steps.len(), waypoints.len()))?;
    for (i, (step, waypoint)) in steps.iter().zip(waypoints).enumerate() {
        pose(step, waypoint, tolerance).map_err(|why| format!("move {i} {why}"))?;
        let speed_off = step.speed_mm_s.map_or(0.0, |speed| (speed - waypoint.feed_mm_s).abs());
        require(speed_off <= tolerance.speed_mm_s, || format!("move {i} has speed {:?}", step.speed_mm_s))?;
        require(step.speed_mm_s.is_some() || i == 0, || format!("move {i} is a joint move"))?;
        let welding = welds(waypoints, i);
        require(step.burning == welding, || format!("move {i}: arc {}, welding {welding}", step.burning))?;
        blend(steps, waypoints, i)?;
    }
    Ok(())
}

fn welds(waypoints: &[Waypoint], i: usize) -> bool {
    i > 0
        && waypoints
            .get(i)
            .is_some_and(|to| to.weld && waypoints[i - 1].weld && to.seam == waypoints[i - 1].seam)
}

fn pose(step: &Step, waypoint: &Waypoint, tolerance: &Tolerance) -> Result<(), String> {
    let away_mm = (step.position_mm - waypoint.position_mm.coords).norm();
    require(away_mm < tolerance.position_mm, || format!("ends {away_mm} mm away"))?;
    let turned_rad = (step.base_from_tool - tool(waypoint)).norm() / std::f64::consts::SQRT_2;
    require(turned_rad < tolerance.rotation_rad, || format!("is turned by {turned_rad} rad"))
}

/// Tool (x, y, z) = (-o, m, -n).
pub fn tool(waypoint: &Waypoint) -> Matrix3<f64> {
    let torch: Matrix3<f64> = waypoint.base_from_torch.to_rotation_matrix().into_inner();
    Matrix3::from_columns(&[-torch.column(0), torch.column(1).into(), -torch.column(2)])
}

/// Amid a seam the robot does not stop and cuts no corner beyond half a segment; elsewhere it arrives.
fn blend(steps: &[Step], waypoints: &[Waypoint], i: usize) -> Result<(), String> {
    let step = &steps[i];
    let between = welds(waypoints, i) && welds(waypoints, i + 1);
    let dwell_s = waypoints[i].dwell_s;
    let waits = (step.dwell_s - dwell_s.unwrap_or(0.0)).abs();
    let starts = !welds(waypoints, i) && welds(waypoints, i + 1);
    require(!(between || starts) || waits < 0.006, || format!("move {i} waits for {} s", step.dwell_s))?;
    let goes_on = between && dwell_s.is_none();
    if !goes_on {
        return require(step.stops, || format!("move {i} does not arrive"));
    }
    require(!step.stops, || format!("move {i} stops amid the seam"))?;
    let segment_mm = |a: usize, b: usize| (steps[b].position_mm - steps[a].position_mm).norm();
    let shorter_mm = segment_mm(i - 1, i).min(segment_mm(i, i + 1));
    require(step.blend_mm < 0.5 * shorter_mm, || {
        format!("move {i}: blend {} of {shorter_mm} mm", step.blend_mm)
    })
}

/// Ok, or the broken rule in words.
pub fn require(condition: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if condition { Ok(()) } else { Err(what()) }
}

/// The rotation by `deg` about the base axis 0, 1 or 2.
pub fn about(axis: usize, deg: f64) -> Matrix3<f64> {
    let (sin, cos) = deg.to_radians().sin_cos();
    let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut m = Matrix3::identity();
    (m[(j, j)], m[(j, k)], m[(k, j)], m[(k, k)]) = (cos, -sin, sin, cos);
    m
}

/// The output of a plan of two seams, made by `job`.
///
/// # Panics
/// If the job is refused.
pub fn output(job: &str) -> Output {
    let job = Job::parse(job, std::path::Path::new("job.toml")).expect("a job");
    postprocess(&plans::pipe_and_bend(), &job, Default::default()).expect("seams")
}

/// Home of [`standing`], degrees.
pub const HOME_DEG: [f64; 6] = [10.0, -90.0, 80.5, 0.0, -45.25, 0.0];

/// A program whose arm has made-up joints at each waypoint, in the counting of `dialect`: its files, its waypoints, and
/// those joints. With `home` it begins and ends there.
///
/// # Panics
/// If the job is refused.
pub fn standing(job: &str, dialect: Dialect, home: bool) -> (Vec<Text>, Vec<Waypoint>, Vec<Stance>) {
    standing_as(job, dialect, Some(dialect), home)
}

/// [`standing`], with joints in the counting of another.
///
/// # Panics
/// If the job is refused.
pub fn standing_as(
    job: &str,
    dialect: Dialect,
    counted_by: Option<Dialect>,
    home: bool,
) -> (Vec<Text>, Vec<Waypoint>, Vec<Stance>) {
    let waypoints = output(job).program.waypoints;
    let stances: Vec<Stance> = (0..waypoints.len()).map(stance).collect();
    let mut setup = Job::parse(job, std::path::Path::new("job.toml")).expect("a job").program_setup();
    setup.posture = Some(PlannedPosture {
        counted_by: counted_by.and_then(Dialect::maker),
        stances: stances.clone(),
        home_deg: home.then_some(HOME_DEG),
        end: if home { ProgramEnd::Home } else { ProgramEnd::Stay },
    });
    let files = dialect.write(&waypoints, &setup).expect("a program");
    let texts = files.into_iter().map(|file| (file.name, String::from_utf8(file.bytes).expect("text")));
    (texts.collect(), waypoints, stances)
}

/// Turns of both signs, both wrists, both elbows, both faces.
fn stance(i: usize) -> Stance {
    let t = (i % 20) as f64;
    let joints_deg = [-185.0 + 3.0 * t, -70.0 + t, 60.0, 170.0 + 2.0 * t, 5.0 - 2.0 * t, 400.0 - 30.0 * t];
    Stance { joints_deg, front: !i.is_multiple_of(3), elbow_up: i % 4 != 1 }
}

/// The files of `output` whose names end so.
///
/// # Panics
/// If there is none.
pub fn texts(output: &Output, ends: &[&str]) -> Vec<Text> {
    let wanted = output.files.iter().filter(|file| ends.iter().any(|end| file.name.ends_with(end)));
    let texts: Vec<Text> = wanted
        .map(|file| (file.name.clone(), String::from_utf8(file.bytes.clone()).expect("text")))
        .collect();
    assert!(!texts.is_empty(), "no {ends:?}");
    texts
}

/// Every mutation `(from, to, why)`, at the first place where it fits, is refused for the reason given.
///
/// # Panics
/// If one passes, or fits nowhere, or is refused for another reason.
pub fn refuses(
    good: &[Text],
    mutations: &[(&str, &str, &str)],
    check: impl Fn(&[Text]) -> Result<(), String>,
) {
    check(good).expect("the program itself is right");
    let mut wrong = vec![];
    for (from, to, why) in mutations {
        let mut files = good.to_vec();
        let place = files.iter_mut().find(|(_, text)| text.contains(from));
        let (_, text) = place.unwrap_or_else(|| panic!("{from:?} is in no file"));
        *text = text.replacen(from, to, 1);
        match check(&files) {
            Err(refusal) if refusal.contains(why) => {}
            other => wrong.push(format!("{from:?} -> {to:?}: {other:?}, not {why}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The number that `text` is, if it is one and finite.
///
/// # Errors
/// Anything else.
pub fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text.trim().parse().map_err(|_| format!("no number: {text:?}"))?;
    require(value.is_finite(), || format!("not finite: {text:?}"))?;
    Ok(value)
}

/// Whether `name` has a letter first, then letters, digits and underscores, and no more characters than `most`.
///
/// # Errors
/// The rule that it breaks.
pub fn name(name: &str, most: usize) -> Result<(), String> {
    require(name.len() <= most, || format!("{name:?} has more than {most} characters"))?;
    let letters = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    require(letters && name.starts_with(|c: char| c.is_ascii_alphabetic()), || format!("{name:?} is no name"))
}
