//! `weldpath stream`: a planned program into the pendant, and the weld under the operator's keys.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use weldpath::files::reading;
use weldpath::output::frame::PathFrame;
use weldpath::output::json;
use weldpath::pendant::link::program;
use weldpath::pendant::link::program::Upload;
use weldpath::pendant::link::rest::Rest;
use weldpath::pendant::link::{
    Error, Event, Former, HELLO_PATIENCE, Link, REPLY_PATIENCE, cause_words, fault_words, refusal_words,
    rest, saved, state_words,
};
use weldpath::pendant::teleop;
use weldpath::run::job::Job;
use weldpath::weld::program::Waypoint;
use weldpath_core::interlock::State;
use weldpath_core::wire::{
    self, Answer, Command, Field, Firmware, ProcessTimes, Refusal, Telemetry, WirePose,
};

use super::folder::settle;
use super::keys::{CTRL_C, Keys};
use super::port::{Port, lost, set_tool};
use super::{Exit, Failure, print, progress};

/// Load a planned program into the pendant and weld it
///
/// Keys: Enter start, h or space hold, r resume, s or Ctrl-C stop. They work on a terminal at once; from a pipe they
/// are read as they come, and the weld starts by itself as soon as the enabling switch is held. Whatever happens to
/// this program, the pendant holds with the arc off when it has not heard from it for 200 ms.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder that `weldpath plan` wrote, or its path.json
    #[arg(value_name = "DIR|path.json")]
    program: PathBuf,
    #[command(flatten)]
    port: Port,
    /// On resume go back along the path by this much first, arc off: the overlap
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true)]
    back_mm: f64,
    /// Move without striking the arc
    #[arg(long)]
    no_arc: bool,
    /// Go on with the path that the pendant still holds, after this program or its computer was lost
    #[arg(long)]
    resume: bool,
    /// Weld only from this waypoint of path.json on, counted from 0, with a lead-in along the torch
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    from_waypoint: Option<usize>,
    /// Weld only from this distance along the path on, with a lead-in along the torch
    #[arg(long, value_name = "MM", conflicts_with_all = ["resume", "from_waypoint"], allow_negative_numbers = true)]
    from_mm: Option<f64>,
    /// If the torch is not where the path begins: go there slowly first, off the work along the torch, with the arc barred
    #[arg(long, conflicts_with = "resume")]
    approach: bool,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// The path's id: the first of a session.
const PATH: u16 = 1;
/// Farthest way back, mm.
const MOST_BACK_MM: f64 = 1000.0;
/// What to do where the torch is elsewhere.
const WAY_THERE: &str = "bring it there and press confirm at the pendant, or let --approach go there";
const TURN: Duration = Duration::from_millis(20);

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if !(0.0..=MOST_BACK_MM).contains(&args.back_mm) {
        return Err(Failure::new(
            Exit::Usage,
            format!("--back-mm is {}, not 0 to {MOST_BACK_MM}", args.back_mm),
        ));
    }
    let job = job(&args.program)?;
    // What moves is a robot, in its own base.
    let base = job.as_ref().map(|job| job.program_setup().frame.robot_base()).unwrap_or_default();
    let part = part(args, base.of(&read(&args.program)?))?;
    let planned = &part.waypoints;
    let times = process_times(job.as_ref());
    let tool = job.as_ref().map(tool).transpose()?.flatten();
    let kept = saved::place(&args.program);
    let link = if args.resume { attach(args, &kept)? } else { args.port.open()? };
    match (args.resume, tool) {
        (true, _) => same_tool(&link, tool)?,
        (false, Some(tool)) => set_tool(&link, tool)?,
        // Without a robot at the port nobody needs it; with one the pendant says what is missing.
        (false, None) => {}
    }
    let limits = link.pendant().limits;
    if !args.quiet {
        print(&format!("{}\n", firmware_words(&link.pendant().firmware)))?;
    }
    let upload = |program: &[Waypoint], count: &dyn Fn(usize) -> usize| {
        let upload = program::upload(program, &limits).map_err(|error| {
            Failure::new(Exit::Unfinished, error.counted(count))
                .hint("plan again with what the pendant can do; nothing was sent")
        })?;
        let origin = upload.origin.iter().map(|index| count(*index)).collect();
        Ok(Upload { times, origin, ..upload })
    };
    let path = upload(planned, &|index| part.whole(index))?;
    if args.resume {
        let mut weld = Weld::new(args, &link, &path, PATH, Keys::new());
        weld.go_on(&kept)?;
        return weld.watch();
    }
    let (mut id, mut keys) = (PATH, Keys::new());
    if args.approach
        && let Some(way) = way_to(&link, planned)?
    {
        // All of it lies before the first waypoint.
        let way = upload(&way, &|_| part.at)?;
        let mut approach = Weld::new(args, &link, &way, id, keys);
        approach.say("approach, slowly, with the arc barred:")?;
        approach.load()?;
        approach.wait_and_start()?;
        approach.watch()?;
        keys = approach.keys;
        id += 1;
    }
    let mut weld = Weld::new(args, &link, &path, id, keys);
    weld.load()?;
    weld.keep_session(&kept)?;
    weld.wait_and_start()?;
    weld.watch()
}

/// Release and commit of the pendant's firmware.
fn firmware_words(firmware: &Firmware) -> String {
    let [major, minor, patch] = firmware.version;
    match firmware.build {
        0 => format!("pendant: firmware {major}.{minor}.{patch}, of no known commit"),
        build => format!("pendant: firmware {major}.{minor}.{patch}, commit {build:08x}"),
    }
}

/// What of the program is to be welded.
fn part(args: &Args, planned: Vec<Waypoint>) -> Result<Rest, Failure> {
    let part = match (args.from_waypoint, args.from_mm) {
        (Some(at), _) => rest::from_waypoint(&planned, at),
        (_, Some(at_mm)) => rest::from_mm(&planned, at_mm),
        _ => return Ok(Rest::all(planned)),
    };
    part.map_err(|error| Failure::new(Exit::Usage, error))
}

/// The job beside the program; none is one that leaves all to its defaults.
fn job(program: &Path) -> Result<Option<Job>, Failure> {
    let folder = if program.is_dir() { program } else { program.parent().unwrap_or(Path::new("")) };
    let file = folder.join("job.toml");
    if !file.exists() {
        return Ok(None);
    }
    Job::read(&file).map(Some).map_err(|error| Failure::new(Exit::Input, error))
}

/// `flange_from_torch`, if the job says it.
fn tool(job: &Job) -> Result<Option<WirePose>, Failure> {
    let Some(tool) = job.tool() else { return Ok(None) };
    let tool = teleop::wire_pose(&tool.flange_from_torch());
    tool.map(Some).ok_or_else(|| Failure::new(Exit::Input, "[tool] of the job is too far from the flange"))
}

/// The path that is held was loaded for a tool: with another the torch would be elsewhere.
fn same_tool(link: &Link, tool: Option<WirePose>) -> Result<(), Failure> {
    let end = Instant::now() + HELLO_PATIENCE;
    while Instant::now() < end {
        let Some(Event::Telemetry(state)) = link.next(TURN).map_err(lost)? else { continue };
        if state.tool == tool {
            return Ok(());
        }
        let why = "the pendant holds the path with another tool than that of the job beside the program";
        return Err(Failure::new(Exit::Input, why)
            .hint("give the [tool] with which it was loaded, or start again with --from-mm"));
    }
    Err(Failure::new(Exit::Pendant, "the pendant does not report its tool"))
}

/// The job's times, if there is a job; else the pendant's usual ones.
fn process_times(job: Option<&Job>) -> ProcessTimes {
    let Some(arc) = job.map(Job::arc) else { return ProcessTimes::default() };
    let ms = |s: f64| (s * 1000.0).round().clamp(0.0, f64::from(u16::MAX)) as u16;
    ProcessTimes {
        pre_flow_ms: ms(arc.gas_preflow_s),
        strike_ms: ms(arc.strike_s),
        crater_fill_ms: ms(arc.crater_s),
        post_flow_ms: ms(arc.gas_postflow_s),
        ..ProcessTimes::default()
    }
}

/// A session that goes on with the path of the one that was kept.
fn attach(args: &Args, kept: &Path) -> Result<Link, Failure> {
    let former = saved::read(kept).map_err(|error| {
        Failure::new(Exit::Input, format!("cannot read {}: {error}", kept.display()))
            .hint("`weldpath stream` writes it before it starts; --from-mm or --from-waypoint need none")
    })?;
    args.port.attach(former)
}

/// A slow way from where the torch is said to be to where the program begins; none if it is there or nobody knows.
fn way_to(link: &Link, planned: &[Waypoint]) -> Result<Option<Vec<Waypoint>>, Failure> {
    let (end, limits) = (Instant::now() + HELLO_PATIENCE, &link.pendant().limits);
    while Instant::now() < end {
        let Some(Event::Telemetry(state)) = link.next(TURN).map_err(lost)? else { continue };
        let told = state.robot.map(|robot| robot.pose).or((!limits.port).then_some(state.pose));
        let known = state.pins & Telemetry::POSE_KNOWN != 0;
        let (Some(pose), true, Some(first)) = (told, known, planned.first()) else { continue };
        if pose.distance_um(&WirePose::IDENTITY) > limits.reach_um as f32 {
            let why = "the pendant says that the torch is farther from the base than its own reach";
            return Err(Failure::new(Exit::Unfinished, why).hint("check the robot's pose and the tool"));
        }
        let [w, i, j, k] = pose.orientation_q15.map(f64::from);
        let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k));
        let [x, y, z] = pose.position_um.map(|um| f64::from(um) * 1e-3);
        let here = Isometry3::from_parts(Translation3::new(x, y, z), rotation);
        let away_mm = (here.translation.vector - first.position_mm.coords).norm();
        let turned_rad = here.rotation.angle_to(&first.base_from_torch);
        let near =
            away_mm * 1e3 <= f64::from(limits.near_um) && turned_rad * 1e3 <= f64::from(limits.near_mrad);
        return Ok((!near).then(|| rest::approach(&here, planned)));
    }
    Err(Failure::new(Exit::Unfinished, "it is not known where the torch is, so no approach can be planned")
        .hint("bring the torch to where the path begins and press confirm at the pendant"))
}

fn read(program: &Path) -> Result<Vec<Waypoint>, Failure> {
    let file = if program.is_dir() { program.join("path.json") } else { program.into() };
    settle(file.parent().unwrap_or(Path::new("")))?;
    let cannot = |why: String| {
        Failure::new(Exit::Input, format!("cannot read {}: {why}", file.display()))
            .hint("`weldpath plan` writes path.json")
    };
    let text = reading::text(&file, reading::MOST_RESULT).map_err(|error| cannot(error.to_string()))?;
    let (program, frame) = json::read(&text).map_err(|error| cannot(error.to_string()))?;
    if frame == PathFrame::Camera {
        let why = format!("{} is in the camera's frame: no robot can follow it", file.display());
        return Err(Failure::new(Exit::Input, why).hint("plan a scan.json with poses"));
    }
    Ok(program)
}

/// One program on its way.
struct Weld<'a> {
    args: &'a Args,
    link: &'a Link,
    upload: &'a Upload,
    path: u16,
    keys: Keys,
    bar: ProgressBar,
    state: Option<Telemetry>,
    /// Count of state changes when the state was told last.
    said: Option<u16>,
    /// The operator has ended it.
    stopped: bool,
    /// When its start was asked for; none if it goes on with what another host began.
    started: Option<Instant>,
}

impl<'a> Weld<'a> {
    fn new(args: &'a Args, link: &'a Link, upload: &'a Upload, path: u16, keys: Keys) -> Self {
        let template = "{bar:32} {pos}/{len} waypoints {elapsed:>4}, {eta} left {msg}";
        let bar = progress::bar(args.quiet || !keys.is_terminal(), upload.waypoints.len() as u64, template);
        Self { args, link, upload, path, keys, bar, state: None, said: None, stopped: false, started: None }
    }

    fn say(&self, text: &str) -> Result<(), Failure> {
        if self.args.quiet { Ok(()) } else { self.bar.suspend(|| print(&format!("{text}\n"))) }
    }

    /// Sends the path until it is there, or, if it is longer than the ring, until the ring is half full.
    fn load(&mut self) -> Result<(), Failure> {
        let begin = self.upload.begin(self.path, &self.link.pendant().limits);
        let prefilled = self.link.pendant().limits.ring / 2 + u32::from(begin.chunk);
        let began = Instant::now();
        self.bar.set_message("loading");
        self.link.load(begin, self.upload.waypoints.clone()).map_err(lost)?;
        let mut got_on = Instant::now();
        loop {
            self.stop_if_asked()?;
            match self.next()? {
                Some(Event::Loaded) => break,
                Some(Event::Progress(ack)) if begin.streamed && ack.next >= prefilled => break,
                Some(Event::Progress(_)) => got_on = Instant::now(),
                _ if got_on.elapsed() > REPLY_PATIENCE => {
                    let why = format!(
                        "the pendant accepts no more of the path: nothing was acknowledged for {} s",
                        REPLY_PATIENCE.as_secs()
                    );
                    return Err(Failure::new(Exit::Pendant, why).hint(Error::NoReply.hint()));
                }
                _ => {}
            }
        }
        let (total, took_s) = (begin.total, began.elapsed().as_secs_f64());
        let how = if begin.streamed { "streaming" } else { "loaded" };
        let weld_s = self.upload.time_s();
        self.say(&format!(
            "{how} {total} waypoints, {took_s:.2} s; they take {weld_s:.1} s, without the arc's times"
        ))
    }

    /// What a later host needs to go on, before anything moves. A path that is longer than the ring is not gone on with.
    fn keep_session(&self, kept: &Path) -> Result<(), Failure> {
        let digest = wire::path_digest(&self.upload.waypoints).unwrap_or(0);
        let former = Former { nonce: self.link.nonce(), path: self.path, digest };
        saved::keep(kept, &former)
            .map_err(|error| Failure::new(Exit::Output, format!("cannot write {}: {error}", kept.display())))
    }

    /// Attached to a held path: waits for the switch, gripped anew, and resumes with the overlap.
    fn go_on(&mut self, kept: &Path) -> Result<(), Failure> {
        let cannot =
            |error: std::io::Error| Failure::new(Exit::Input, format!("{}: {error}", kept.display()));
        let former = saved::read(kept).map_err(cannot)?;
        if wire::path_digest(&self.upload.waypoints) != Some(former.digest) {
            let why = "the program is not the one that the pendant holds: it was planned again";
            return Err(Failure::new(Exit::Input, why).hint("plan as before, or --from-mm with the new plan"));
        }
        self.path = former.path;
        self.keep_session(kept)?;
        let (mut told, mut entered) = (None, !self.keys.is_terminal());
        loop {
            self.next()?;
            let Some(state) = self.state else { continue };
            let place = self.place(&state);
            let wanted = if state.state != State::Held {
                format!("the pendant is {}: nothing to continue with", state_words(state.state))
            } else if state.pins & Telemetry::ENABLED == 0 {
                format!("{place}; waiting for the enabling switch (released first, then held)")
            } else if !entered {
                format!("{place}; Enter continues, s ends")
            } else {
                match self.resume()? {
                    Answer::Refused(why) => refusal_words(why),
                    _ => return self.say(&format!("going on from there, {} mm back", self.args.back_mm)),
                }
            };
            if told.as_ref() != Some(&wanted) {
                self.say(&wanted)?;
                told = Some(wanted);
            }
            match self.keys.next() {
                Some(b'\n' | b'\r' | b'r') => entered = true,
                Some(b's' | CTRL_C) => {
                    self.ask(Command::Abort { path: self.path })?;
                    return Err(Failure::new(Exit::Unfinished, "ended; weld the rest with --from-mm"));
                }
                _ => {}
            }
        }
    }

    /// The next event, with what every stage has to do about it done.
    fn next(&mut self) -> Result<Option<Event>, Failure> {
        let event = self.link.next(TURN).map_err(|error| self.gone(error))?;
        match &event {
            Some(Event::Telemetry(state)) => self.state = Some(*state),
            Some(Event::Progress(ack)) if self.said.is_none() => self.bar.set_position(ack.next.into()),
            Some(Event::LoadRefused(why)) => {
                let failure =
                    Failure::new(Exit::Unfinished, format!("path refused: {}", refusal_words(*why)));
                return Err(failure.hint("the pendant is as it was before"));
            }
            Some(Event::ChunkRefused(refused)) => {
                let index =
                    (refused.first as usize + usize::from(refused.at)).min(self.upload.origin.len() - 1);
                let (at, why) = (self.upload.origin[index], refused.why);
                let message = format!("waypoint {at} of the program (counted from 0) refused: {why:?}");
                return Err(Failure::new(Exit::Unfinished, message));
            }
            Some(Event::Fault(fault)) => self.say(&format!("fault: {}", fault_words(*fault)))?,
            _ => {}
        }
        Ok(event)
    }

    fn gone(&self, error: weldpath::pendant::link::Error) -> Failure {
        let place = self.state.map(|state| format!("; last known {}", self.place(&state)));
        let failure = lost(error);
        Failure { message: format!("{}{}", failure.message, place.unwrap_or_default()), ..failure }
    }

    /// Where the torch is, in the program's own count.
    fn place(&self, state: &Telemetry) -> String {
        let at = self.upload.origin.get(state.segment as usize).copied().unwrap_or(0);
        format!("{} at waypoint {at} of the program", state_words(state.state))
    }

    fn stop_if_asked(&mut self) -> Result<(), Failure> {
        match self.keys.next() {
            Some(b's' | CTRL_C) => {
                self.ask(Command::Abort { path: self.path })?;
                Err(Failure::new(Exit::Unfinished, "stopped before the start; nothing moved"))
            }
            _ => Ok(()),
        }
    }

    fn ask(&self, command: Command) -> Result<Answer, Failure> {
        self.link.ask(command).map_err(|error| self.gone(error))
    }

    /// Until the enabling switch is held and, on a terminal, Enter is pressed.
    fn wait_and_start(&mut self) -> Result<(), Failure> {
        let mut told = None;
        let mut entered = !self.keys.is_terminal();
        loop {
            self.next()?;
            let Some(state) = self.state else { continue };
            let enabled = state.pins & Telemetry::ENABLED != 0;
            let wanted = match state.fault {
                Some(fault) => format!("waiting: {}", fault_words(fault)),
                None if !enabled => "waiting for the enabling switch (released first, then held)".into(),
                None if !entered => "Enter starts; s ends".into(),
                None => match self.start()? {
                    None => return Ok(()),
                    Some(refused @ Refusal::Away { .. }) => {
                        format!("{}; {WAY_THERE}", refusal_words(refused))
                    }
                    Some(refused) => refusal_words(refused),
                },
            };
            if told.as_ref() != Some(&wanted) {
                self.say(&wanted)?;
                told = Some(wanted);
            }
            match self.keys.next() {
                Some(b'\n' | b'\r') => entered = true,
                Some(b's' | CTRL_C) => {
                    self.ask(Command::Abort { path: self.path })?;
                    return Err(Failure::new(Exit::Unfinished, "stopped before the start; nothing moved"));
                }
                _ => {}
            }
        }
    }

    /// Why it did not start, if it did not.
    fn start(&mut self) -> Result<Option<Refusal>, Failure> {
        self.arm()?;
        self.bar.set_message("h hold, r resume, s stop");
        self.started = Some(Instant::now());
        match self.ask(Command::Start { path: self.path })? {
            Answer::Refused(why) => Ok(Some(why)),
            _ => Ok(None),
        }
    }

    fn welds(&self) -> bool {
        self.upload.waypoints.iter().any(|waypoint| waypoint.weld)
    }

    fn arm(&self) -> Result<(), Failure> {
        self.ask(Command::ArcArm { armed: !self.args.no_arc && self.welds() }).map(drop)
    }

    /// Until the path is finished or cannot be.
    fn watch(&mut self) -> Result<(), Failure> {
        let began = Instant::now();
        loop {
            if let Some(key) = self.keys.next() {
                self.key(key)?;
            }
            let event = self.next()?;
            let (Some(Event::Telemetry(_)), Some(state)) = (event, self.state) else { continue };
            self.bar.set_position(state.segment.into());
            if state.finished == Some(self.path) {
                self.bar.finish_and_clear();
                let took_s = began.elapsed().as_secs_f64();
                self.was_played()?;
                return self
                    .say(&format!("finished, {took_s:.1} s; the pendant is {}", state_words(state.state)));
            }
            self.told_of(&state)?;
            self.ended(&state)?;
        }
    }

    /// No path takes less than its moves at their feeds.
    fn was_played(&self) -> Result<(), Failure> {
        let least_s = 0.9 * self.upload.time_s();
        let took_s = self.started.map(|started| started.elapsed().as_secs_f64());
        let Some(took_s) = took_s.filter(|took_s| *took_s < least_s) else { return Ok(()) };
        let why = format!(
            "the pendant reports after {took_s:.1} s that the path is finished, but its moves alone take \
             {:.1} s: it was not executed",
            self.upload.time_s()
        );
        Err(Failure::new(Exit::Unfinished, why)
            .hint("look at the work and at the robot before anything else"))
    }

    fn told_of(&mut self, state: &Telemetry) -> Result<(), Failure> {
        // Not by the state: of a hold right after a resume only the second may reach this host.
        if self.said.replace(state.changes) == Some(state.changes) {
            return Ok(());
        }
        let why = state.cause.map(|cause| format!(": {}", cause_words(cause))).unwrap_or_default();
        let key = if state.state == State::Held { "; r resumes, s ends" } else { "" };
        self.say(&format!("{}{why}{key}", self.place(state)))
    }

    /// A hold that cannot be left, or that nobody is there to leave, ends the command.
    fn ended(&mut self, state: &Telemetry) -> Result<(), Failure> {
        let final_hold =
            state.cause.is_some_and(|cause| !cause.is_resumable()) || self.keys.have_ended() || self.stopped;
        let over = match state.state {
            State::Fault => true,
            State::Held => final_hold,
            State::Disabled | State::Idle => state.load.is_none(),
            _ => false,
        };
        if !over {
            return Ok(());
        }
        let why = match (state.fault, state.cause) {
            (Some(fault), _) => format!(": {}", fault_words(fault)),
            (_, Some(cause)) => format!(": {}", cause_words(cause)),
            _ => String::new(),
        };
        if state.state == State::Held {
            self.ask(Command::Abort { path: self.path })?;
        }
        self.bar.finish_and_clear();
        let message = format!("the weld was not finished: {}{why}", self.place(state));
        Err(Failure::new(Exit::Unfinished, message).hint("the arc is off and the torch has stopped"))
    }

    fn key(&mut self, key: u8) -> Result<(), Failure> {
        let answer = match key {
            b'h' | b' ' => self.ask(Command::Hold)?,
            b's' | CTRL_C => {
                self.stopped = true;
                self.ask(Command::Stop)?
            }
            b'r' => self.resume()?,
            _ => return Ok(()),
        };
        match answer {
            Answer::Refused(why) => self.say(&format!("refused: {}", refusal_words(why))),
            _ => Ok(()),
        }
    }

    fn resume(&mut self) -> Result<Answer, Failure> {
        let Some(held) = self.state.filter(|state| state.state == State::Held) else {
            return Ok(Answer::Refused(Refusal::State(
                self.state.map_or(State::Disabled, |state| state.state),
            )));
        };
        self.arm()?;
        let back_um = (self.args.back_mm * 1000.0).round() as u32;
        let resume = |back_um| self.ask(Command::Resume { path: self.path, changes: held.changes, back_um });
        match resume(back_um)? {
            // There is not so much path behind the torch: it goes on from where it stands.
            Answer::Refused(Refusal::Value(Field::Back)) => resume(0),
            answer => Ok(answer),
        }
    }
}
