//! Commands: executed at most once, in order, with the reply kept for those who ask again.

use super::ring::Slots;
use super::robot::Tool;
use super::session::Requests;
use super::{Action, Pendant, Task};
use crate::interlock::{ArcTimes, ArcTimesMs, Event, Refused, State};
use crate::wire::{
    Answer, Begin, Command, Field, Hand, JogLimits, PendantMessage, ProcessTimes, Refusal, WireHandFrame,
    WireJog, WirePatch, WirePose,
};

impl<const RING: usize, S: Slots> Pendant<RING, S> {
    /// The same number again gets the kept reply; only the next number is executed; any other is old and ignored.
    pub(super) fn control(&mut self, request: u16, command: Command) -> Action {
        if request == self.host.requests.last {
            let again =
                self.host.requests.reply.map(|answer| self.send(PendantMessage::Reply { request, answer }));
            return again.unwrap_or(Action::Idle);
        }
        if request != self.host.requests.last.wrapping_add(1) {
            return Action::Idle;
        }
        self.host.requests = Requests { last: request, reply: None };
        match self.execute(command) {
            Ok(Executed::Now(answer)) => self.reply(answer),
            Ok(Executed::Later(task)) => Action::Perform { request, task },
            Err(why) => self.reply(Answer::Refused(why)),
        }
    }

    pub(super) fn reply(&mut self, answer: Answer) -> Action {
        self.host.requests.reply = Some(answer);
        self.send(PendantMessage::Reply { request: self.host.requests.last, answer })
    }

    fn execute(&mut self, command: Command) -> Result<Executed, Refusal> {
        match command {
            Command::GetLimits => return Ok(Executed::Now(Answer::Limits(self.limits))),
            Command::SetJog(jog) => return self.set_jog(jog),
            Command::HandFrame(hands) => return self.hand_frame(hands),
            Command::Score(patch) => return self.while_standing(Task::Score(checked_patch(patch)?)),
            Command::SetTool { tool } => self.set_tool(&tool)?,
            Command::Begin(begin) => self.begin(&begin)?,
            Command::Commit { path, digest } => self.commit(path, digest)?,
            Command::Abort { path } => {
                self.path.named(path)?;
                self.ask(Event::Abort)?;
            }
            Command::ArcArm { armed } => self.arm(armed)?,
            Command::Start { path } => self.start(path)?,
            Command::Hold => self.ask(Event::Hold)?,
            Command::Stop => self.ask(Event::Stop)?,
            Command::Resume { path, changes, back_um } => self.resume(path, changes, back_um)?,
            Command::Reset => self.ask(Event::Reset)?,
            Command::Subscribe { every } => self.report.subscribe(every),
        }
        Ok(Executed::Now(Answer::Done))
    }

    fn set_jog(&mut self, jog: WireJog) -> Result<Executed, Refusal> {
        let jog = checked_jog(jog, &self.limits.jog)?;
        self.allows(&Moving::Camera(jog.start))?;
        Ok(Executed::Later(Task::Jog(jog, self.limits.jog)))
    }

    fn hand_frame(&mut self, hands: WireHandFrame) -> Result<Executed, Refusal> {
        self.allows(&Moving::Hands)?;
        let hands = checked_hands(hands)?;
        let time_ms = (u64::from(self.ticks) * u64::from(self.config.tick_us) / 1000) as u32;
        let anew = !core::mem::replace(&mut self.robot.jogging.begun, true);
        let from = self.robot.jog_from();
        Ok(Executed::Later(Task::HandFrame { hands, time_ms, anew, from }))
    }

    fn arm(&mut self, armed: bool) -> Result<(), Refusal> {
        if armed {
            self.allows(&Moving::Arc)?;
        }
        if armed && (!self.config.can_weld || self.path.begin().is_some_and(|begin| !begin.arc)) {
            return Err(Refusal::ArcBarred);
        }
        self.ask(Event::Arm(armed))
    }

    fn while_standing(&self, task: Task) -> Result<Executed, Refusal> {
        if self.stands() { Ok(Executed::Later(task)) } else { Err(Refusal::Moving) }
    }

    /// The rule for every message that can move a set-point, or have one followed; docs/protocol.md has it as a table.
    ///
    /// A robot at the port goes where its flange has to be: without a tool that would be where the torch has to be; and
    /// one that is silent or does not follow goes nowhere.
    fn allows(&self, what: &Moving) -> Result<(), Refusal> {
        if self.robot.port.is_some() && self.robot.tool.is_none() && *what != Moving::Tool {
            return Err(Refusal::NoTool);
        }
        match what {
            // It moves every set-point: only where none may be followed, nor a held path gone on with.
            Moving::Tool if !self.stands() || self.robot.jogging.begun => return Err(Refusal::Moving),
            Moving::Tool if self.state() == State::Held => return Err(Refusal::State(State::Held)),
            Moving::Tool | Moving::Arc => return Ok(()),
            Moving::Camera(_) if !self.stands() => return Err(Refusal::Moving),
            Moving::Camera(_) => {}
            Moving::Hands => self.may_jog()?,
            Moving::Path(event) => {
                self.interlock.step(*event, &self.inputs()).2.map_err(|refused| self.refusal(refused))?;
            }
        }
        if self.robot.port.as_ref().is_some_and(|robot| !robot.is_ready()) {
            return Err(Refusal::Robot);
        }
        match what {
            Moving::Camera(start) if self.robot.port.is_some() => self.robot.check_near(start, &self.limits),
            Moving::Path(_) => self.check_place().and_then(|()| self.check_speed()),
            _ => Ok(()),
        }
    }

    /// In manual with the arc armed everything to be welded has to be slow enough: it is refused, never welded slower.
    fn check_speed(&self) -> Result<(), Refusal> {
        let feed_um_s = self.limits.manual_feed_um_s;
        let bound = self.panel.manual && self.interlock.is_armed();
        let faster = bound.then(|| self.path.ring.faster_weld(self.path.drive.segment, feed_um_s)).flatten();
        faster.map_or(Ok(()), |at| Err(Refusal::TooFast { at }))
    }

    fn ask(&mut self, event: Event) -> Result<(), Refusal> {
        self.fire(event).map_err(|refused| self.refusal(refused))
    }

    fn refusal(&self, refused: Refused) -> Refusal {
        match refused {
            Refused::State(state) => Refusal::State(state),
            Refused::NotEnabled => Refusal::NotEnabled,
            Refused::EStop => Refusal::EStop,
            Refused::NotResumable(cause) => Refusal::NotResumable(cause),
            Refused::TooFast => Refusal::TooFast { at: self.path.drive.segment },
        }
    }

    fn set_tool(&mut self, tool: &WirePose) -> Result<(), Refusal> {
        self.allows(&Moving::Tool)?;
        checked_pose(*tool)?;
        if tool.distance_um(&WirePose::IDENTITY) > LONGEST_TOOL_UM {
            return Err(Refusal::Value(Field::Tool));
        }
        let tool = Tool::new(*tool).ok_or(Refusal::Value(Field::Orientation))?;
        self.robot.carry(Some(tool));
        self.report.hurry();
        Ok(())
    }

    fn begin(&mut self, begin: &Begin) -> Result<(), Refusal> {
        self.path.check(begin, &self.limits)?;
        let times = self.arc_times(&begin.times).ok_or(Refusal::Value(Field::Time))?;
        self.ask(Event::Begin)?;
        self.interlock = self.interlock.timed(times);
        self.path.open(begin);
        Ok(())
    }

    /// The path's times, with the board's own of what is no matter of the weld.
    fn arc_times(&self, times: &ProcessTimes) -> Option<ArcTimes> {
        let ms = ArcTimesMs {
            pre_flow: times.pre_flow_ms,
            strike: times.strike_ms,
            crater_fill: times.crater_fill_ms,
            burn_back: times.burn_back_ms,
            post_flow: times.post_flow_ms,
            ..self.config.arc
        };
        ArcTimes::new(&ms, self.config.tick_us)
    }

    fn commit(&mut self, path: u16, digest: u32) -> Result<(), Refusal> {
        self.path.named(path)?;
        if !self.path.ring.is_complete() {
            return Err(Refusal::Incomplete { next: self.path.ring.next() });
        }
        let computed = self.path.ring.digest();
        if computed != digest {
            self.fire_own(Event::BadDigest);
            return Err(Refusal::Digest { computed });
        }
        self.path.ring.seal();
        self.ask(Event::Committed)
    }

    fn start(&mut self, path: u16) -> Result<(), Refusal> {
        self.path.named(path)?;
        self.allows(&Moving::Path(Event::Start))?;
        self.ask(Event::Start)?;
        // Where the robot has to be until the first set-point says more: before, this was the end of another path.
        if let Some(first) = self.path.first() {
            self.robot.place.commanded = first;
        }
        self.path.drive.started = true;
        Ok(())
    }

    fn resume(&mut self, path: u16, changes: u16, back_um: u32) -> Result<(), Refusal> {
        self.path.named(path)?;
        let now = self.report.changes;
        if self.state() == State::Held && changes != now {
            return Err(Refusal::Stale { changes: now });
        }
        if back_um as f32 > self.path.kept_um() {
            return Err(Refusal::Value(Field::Back));
        }
        self.allows(&Moving::Path(Event::Resume))?;
        // A crater that was cut short is welded over from before it, or stays short.
        self.path.drive.rewelds = back_um > 0;
        self.ask(Event::Resume)?;
        self.path.drive.back_um = back_um as f32;
        Ok(())
    }
}

/// What a message would move, or have followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Moving {
    /// The torch on the flange.
    Tool,
    /// The place that hands start from.
    Camera(WirePose),
    /// The camera, by hands.
    Hands,
    /// The torch along the path, by Start or Resume.
    Path(Event),
    /// Nothing yet: the arc for the next of those.
    Arc,
}

#[allow(clippy::large_enum_variant, reason = "no allocator to box with; it lives for one call")]
enum Executed {
    Now(Answer),
    Later(Task),
}

fn checked_pose(pose: WirePose) -> Result<WirePose, Refusal> {
    if pose.is_unit() { Ok(pose) } else { Err(Refusal::Value(Field::Orientation)) }
}

/// Longest tool, µm: from the flange to the tip of a torch, or to a camera.
const LONGEST_TOOL_UM: f32 = 2_000_000.0;

/// Edges of an interaction box, µm: what a hand can tell apart, and what an arm can reach across.
const BOX_UM: core::ops::RangeInclusive<u32> = 20_000..=1_000_000;
/// Farthest middle of the box from the sensor, along an axis, µm.
const BOX_CENTER_UM: i32 = 1_000_000;

fn checked_jog(jog: WireJog, limits: &JogLimits) -> Result<WireJog, Refusal> {
    checked_pose(jog.start)?;
    checked_pose(WirePose { position_um: [0; 3], orientation_q15: jog.base_from_sensor_q15 })?;
    let near = |um: &i32| (-BOX_CENTER_UM..=BOX_CENTER_UM).contains(um);
    let fits = jog.box_size_um.iter().all(|um| BOX_UM.contains(um)) && jog.box_center_um.iter().all(near);
    if !fits {
        return Err(Refusal::Value(Field::Size));
    }
    let bounds = limits.least_um.into_iter().zip(limits.most_um);
    let inside =
        jog.start.position_um.iter().zip(bounds).all(|(um, (least, most))| (least..=most).contains(um));
    if inside { Ok(jog) } else { Err(Refusal::Value(Field::Workspace)) }
}

fn checked_hands(hands: WireHandFrame) -> Result<WireHandFrame, Refusal> {
    let sound = |hand: &Hand| hand.grab_permille <= 1000 && hand.pinch_permille <= 1000 && hand.extended < 32;
    if [&hands.left, &hands.right].into_iter().flatten().all(sound) {
        Ok(hands)
    } else {
        Err(Refusal::Value(Field::Count))
    }
}

fn checked_patch(patch: WirePatch) -> Result<WirePatch, Refusal> {
    if patch.radius_um == 0 {
        return Err(Refusal::Value(Field::Size));
    }
    if patch.points.is_empty() { Err(Refusal::Value(Field::Count)) } else { Ok(patch) }
}
