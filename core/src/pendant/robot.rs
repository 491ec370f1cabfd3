//! The robot and its tool; of one at the port what it was told, what it says, and whether that is fresh and near enough.
//!
//! Everything runs on the ticks of the frames sent: an answer is as old as the frame that it gives back, so that silence,
//! delay and repetition are one thing; what was recorded in another session gives back another nonce.

use super::jog::Jogging;
use super::place::Place;
use super::ring::turn_mrad;
use super::{Pendant, Slots};
use crate::interlock::{ArcPhase, Cause, Event};
use crate::path::TorchPose;
use crate::wire::frame::Received;
use crate::wire::port::{self, Actual, Drives};
use crate::wire::{self, WirePose};

/// What the port has to keep to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortConfig {
    /// Ticks after which an answer is late.
    pub late_ticks: u16,
    /// Farthest from the set-point, µm.
    pub off_um: u32,
    /// Turned farthest from the set-point, mrad.
    pub off_mrad: u32,
    /// Farthest from the set-point while the arc burns, for longer than `weld_off_ticks`, µm.
    pub weld_off_um: u32,
    /// Turned farthest from the set-point while the arc burns, for longer than `weld_off_ticks`, mrad.
    pub weld_off_mrad: u32,
    /// How long it may be farther from a weld, ticks.
    pub weld_off_ticks: u16,
}

impl Default for PortConfig {
    /// 5 ticks: docs/robot-port.md has the budget of a line of 460,800 baud. In the air 10 mm and 10 degrees: an arm that
    /// lags by 30 ms is 7.5 mm behind at 250 mm/s. While welding 2 mm and 2 degrees for 100 ms: that arm is 1.5 mm behind
    /// at 50 mm/s, and sets out and stops within 100 ms.
    fn default() -> Self {
        Self {
            late_ticks: 5,
            off_um: 10_000,
            off_mrad: 175,
            weld_off_um: 2_000,
            weld_off_mrad: 35,
            weld_off_ticks: 50,
        }
    }
}

/// A robot that moved farther than this, µm, moves: ten times what encoders shake.
const MOVED_UM: f32 = 200.0;
/// Set-points that are farther than this from where they were, µm, ask for motion.
const ASKED_UM: f32 = 50.0;
/// A robot that has not moved although its set-points went so far, µm ...
const LEFT_UM: f32 = 500.0;
/// ... and that has heard of it for so many ticks stands still.
const LEFT_TICKS: i32 = 50;
/// How often that is looked at, ticks.
const LOOK_TICKS: u32 = 8;

/// What bears the torch or, in its place, the camera.
#[derive(Debug, Clone)]
pub(super) struct Robot {
    /// None until a session has set one.
    pub(super) tool: Option<Tool>,
    /// If one is fitted.
    pub(super) port: Option<Monitor>,
    pub(super) place: Place,
    pub(super) jogging: Jogging,
}

/// What is on the flange, both ways.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tool {
    pub(super) flange_from_torch: WirePose,
    torch_from_flange: WirePose,
}

impl Tool {
    /// The flange itself.
    const NONE: Self = Self { flange_from_torch: WirePose::IDENTITY, torch_from_flange: WirePose::IDENTITY };

    /// None if the orientation is no unit quaternion.
    pub(super) fn new(flange_from_torch: WirePose) -> Option<Self> {
        Some(Self { flange_from_torch, torch_from_flange: inverted(&flange_from_torch)? })
    }
}

impl Robot {
    pub(super) fn new(port: Option<Monitor>) -> Self {
        Self { tool: None, port, place: Place::UNKNOWN, jogging: Jogging::default() }
    }

    /// Another tool, or none, from now on.
    pub(super) fn carry(&mut self, tool: Option<Tool>) {
        self.tool = tool;
        if let Some(port) = &mut self.port {
            port.retool(&tool.unwrap_or(Tool::NONE).flange_from_torch);
        }
    }

    /// Where the flange is to be, for the torch to be there.
    pub(super) fn flange(&self, torch: &WirePose) -> Option<WirePose> {
        compose(torch, &self.tool.as_ref().unwrap_or(&Tool::NONE).torch_from_flange)
    }

    /// Why motion must stop, if a robot is fitted and something moves it: it follows the path, or hands.
    fn trouble(&mut self, follows: bool, welds: bool) -> Option<Cause> {
        let port = self.port.as_mut()?;
        port.forget_late();
        let commanded = if follows { Some(&self.place.commanded) } else { self.jogging.commanded.as_ref() };
        let Some(commanded) = commanded else {
            port.rest();
            return None;
        };
        port.trouble(commanded, welds)
    }

    /// The frame of this tick, if a port is fitted. `torch`: where the path has it, if it does.
    pub(super) fn command(
        &mut self,
        torch: Option<&WirePose>,
        tick: u32,
        motion: bool,
        arc: bool,
    ) -> Option<port::WireSetPoint> {
        let torch = torch.or(self.jogging.commanded.as_ref());
        let pose = torch.and_then(|torch| self.flange(torch));
        let port = self.port.as_mut()?;
        port.tick = tick;
        let heard = port.answered.as_ref().map(|answered| &answered.actual);
        Some(port::WireSetPoint {
            lost: port.missed,
            session: port.session,
            tick,
            robot: heard.map_or(0, |actual| actual.robot),
            heard: heard.map_or(0, |actual| actual.sequence),
            pose,
            motion,
            arc,
        })
    }
}

/// The port's state.
#[derive(Debug, Clone, Default)]
pub(super) struct Monitor {
    config: PortConfig,
    session: u32,
    /// Of the newest frame sent.
    tick: u32,
    answered: Option<Answered>,
    /// Nonce and sequence of the newest answer taken, late or not.
    last: (u32, u32),
    missed: u16,
    /// Ticks for which the robot has been too far from a weld.
    off_ticks: u16,
    last_move: Option<LastMove>,
}

#[derive(Debug, Clone, Copy)]
struct Answered {
    actual: Actual,
    torch: WirePose,
}

/// When the robot was last seen to move.
#[derive(Debug, Clone, Copy)]
struct LastMove {
    torch: WirePose,
    commanded: WirePose,
    /// Of the last frame before the set-points went on from `commanded`.
    tick: u32,
}

impl Monitor {
    pub(super) fn new(config: PortConfig, session: u32) -> Self {
        Self { config, session, ..Self::default() }
    }

    /// Answers to frames of another session count no more.
    pub(super) fn open(&mut self, session: u32) {
        self.session = session;
        self.answered = None;
    }

    /// The newest answer, if it is not late.
    fn fresh(&self) -> Option<&Answered> {
        let age = |answered: &&Answered| self.tick.wrapping_sub(answered.actual.heard);
        self.answered.as_ref().filter(|answered| age(answered) < u32::from(self.config.late_ticks))
    }

    /// Where the torch is.
    pub(super) fn torch(&self) -> Option<WirePose> {
        self.fresh().map(|answered| answered.torch)
    }

    /// How far it says that it is from where it was to be, µm.
    pub(super) fn error_um(&self) -> u32 {
        self.fresh().map_or(0, |answered| answered.actual.error_um)
    }

    /// Whether it answers and its drives follow.
    pub(super) fn is_ready(&self) -> bool {
        self.fresh().is_some_and(|answered| answered.actual.drives == Drives::Following)
    }

    /// What it says of itself.
    pub(super) fn report(&self) -> Option<wire::Robot> {
        let Answered { actual, torch } = self.fresh()?;
        let lost = actual.lost.wrapping_add(self.missed);
        Some(wire::Robot { pose: *torch, error_um: actual.error_um, drives: actual.drives, lost })
    }

    /// Why a torch that has to be at `commanded` must stop. Once a tick while something moves it.
    fn trouble(&mut self, commanded: &WirePose, welds: bool) -> Option<Cause> {
        let Some(&Answered { actual, torch }) = self.fresh() else { return Some(Cause::RobotSilent) };
        if actual.drives != Drives::Following {
            return Some(Cause::RobotDrives);
        }
        let off_um = torch.distance_um(commanded).max(actual.error_um as f32);
        let off_mrad = turn_mrad(&torch, commanded);
        let beyond = |um: u32, mrad: u32| off_um > um as f32 || off_mrad > mrad as f32;
        let beside = welds && beyond(self.config.weld_off_um, self.config.weld_off_mrad);
        self.off_ticks = if beside { self.off_ticks.saturating_add(1) } else { 0 };
        let off = beyond(self.config.off_um, self.config.off_mrad)
            || self.off_ticks > self.config.weld_off_ticks
            || self.stands_still(&torch, actual.heard, commanded);
        off.then_some(Cause::RobotOff)
    }

    /// Whether the set-points went on and the robot, which has heard of it, did not move. Looked at now and then.
    fn stands_still(&mut self, torch: &WirePose, heard: u32, commanded: &WirePose) -> bool {
        if !self.tick.is_multiple_of(LOOK_TICKS) {
            return false;
        }
        let now = LastMove { torch: *torch, commanded: *commanded, tick: self.tick };
        let last = self.last_move.get_or_insert(now);
        if torch.distance_um(&last.torch) > MOVED_UM {
            *last = now;
            return false;
        }
        let left_um = commanded.distance_um(&last.commanded);
        if left_um < ASKED_UM {
            last.tick = self.tick;
        }
        left_um > LEFT_UM && heard.wrapping_sub(last.tick) as i32 >= LEFT_TICKS
    }

    /// Nothing moves it.
    fn rest(&mut self) {
        self.off_ticks = 0;
        self.last_move = None;
    }

    /// An answer counts if it is newer than the last and answers a frame of this session that was sent.
    fn take(&mut self, actual: Actual, tool: &WirePose) {
        let sent = actual.session == self.session && self.tick.wrapping_sub(actual.heard) as i32 >= 0;
        let (robot, sequence) = self.last;
        let gap = if actual.robot == robot { actual.sequence.wrapping_sub(sequence) } else { 1 };
        let ahead = (1..=MOST_AHEAD).contains(&gap);
        // While one end is heard another has no say.
        let speaks = actual.robot != 0 && (actual.robot == robot || self.answered.is_none());
        let near = actual.pose.position_um.iter().all(|um| um.unsigned_abs() <= FARTHEST_UM);
        let torch = (near && actual.pose.is_unit()).then(|| compose(&actual.pose, tool)).flatten();
        let (true, Some(torch)) = (sent && ahead && speaks, torch) else { return };
        if self.answered.is_some() {
            self.missed = self.missed.wrapping_add(gap.saturating_sub(1) as u16);
        }
        self.last = (actual.robot, actual.sequence);
        self.answered = Some(Answered { actual, torch });
    }

    /// Where the torch is with another tool.
    pub(super) fn retool(&mut self, tool: &WirePose) {
        let torch = |answered: Answered| {
            compose(&answered.actual.pose, tool).map(|torch| Answered { torch, ..answered })
        };
        self.answered = self.answered.and_then(torch);
    }

    /// A late robot may have started anew, and then has another nonce and counts from the beginning.
    fn forget_late(&mut self) {
        if self.fresh().is_none() {
            self.answered = None;
        }
    }
}

/// No robot's flange is farther from its base along an axis, µm.
const FARTHEST_UM: u32 = 10_000_000;

/// A count that is farther ahead of another is behind it.
const MOST_AHEAD: u32 = i32::MAX as u32;

impl<const RING: usize, S: Slots> Pendant<RING, S> {
    /// Takes what a delimiter completed on the robot's line.
    pub fn receive_robot(&mut self, received: Received<'_>) {
        let (Received::Payload(payload), Some(port)) = (received, &mut self.robot.port) else { return };
        if let Some(actual) = Actual::from_bytes(payload) {
            let tool = self.robot.tool.as_ref().unwrap_or(&Tool::NONE);
            port.take(actual, &tool.flange_from_torch);
        }
    }

    /// Holds, or takes the camera out of the hands, if the robot is late, off or without drives. Before the frame of this
    /// tick is sent.
    pub(super) fn watch_robot(&mut self) {
        let (follows, welds) = (self.follows(), self.interlock.arc_phase() == ArcPhase::On);
        let Some(cause) = self.robot.trouble(follows, welds) else { return };
        if cause == Cause::RobotDrives {
            // It stands, or stops by itself: nothing goes on ahead of it.
            self.path.drive.speed_um_s = 0.0;
        }
        self.fire_own(Event::Robot(cause));
    }
}

/// `a_from_b` and `b_from_c` make `a_from_c`; none if the sum is too far away or an orientation no unit quaternion.
/// Nothing is asked of a pose that stays as it is.
#[inline(never)]
pub(super) fn compose(a_from_b: &WirePose, b_from_c: &WirePose) -> Option<WirePose> {
    if b_from_c.is_identity() {
        return Some(*a_from_b);
    }
    let (first, second) = (a_from_b.to_pose()?, b_from_c.to_pose()?);
    WirePose::from_pose(&TorchPose {
        position_mm: first.position_mm + first.orientation * second.position_mm.coords,
        orientation: first.orientation * second.orientation,
    })
}

/// `b_from_a` of `a_from_b`.
#[inline(never)]
pub(super) fn inverted(a_from_b: &WirePose) -> Option<WirePose> {
    let pose = a_from_b.to_pose()?;
    let orientation = pose.orientation.conjugate();
    WirePose::from_pose(&TorchPose {
        position_mm: (orientation * -pose.position_mm.coords).into(),
        orientation,
    })
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use crate::pendant::{Action, Config, Panel};
    use crate::wire::{
        self, Answer, Begin, Chunk, Command, FromHost, FromPendant, Hello, HostMessage, PendantMessage, Ping,
        ProcessTimes, WireWaypoint,
    };

    const NONCE: u32 = 7;
    const FIRST: WirePose = WirePose { position_um: [400_000, 0, 200_000], ..WirePose::IDENTITY };

    fn fitted() -> Pendant<64> {
        let config = Config { port: Some(PortConfig::default()), ..Config::default() };
        let mut pendant = Pendant::new(&config, 1).expect("sound");
        let _ = pendant.tick(&Panel::default());
        let hello = Hello { version: wire::VERSION, schema: wire::SCHEMA, nonce: NONCE };
        assert!(matches!(say(&mut pendant, HostMessage::Hello(hello)), Some(PendantMessage::HelloAck(_))));
        assert_eq!(command(&mut pendant, Command::SetTool { tool: WirePose::IDENTITY }), Answer::Done);
        pendant
    }

    fn say(pendant: &mut Pendant<64>, message: HostMessage) -> Option<PendantMessage> {
        match pendant.handle(FromHost { session: wire::session_id(1, NONCE), message }) {
            Action::Send(FromPendant { message, .. }) => Some(message),
            _ => None,
        }
    }

    fn command(pendant: &mut Pendant<64>, command: Command) -> Answer {
        let request = pendant.host.requests.last.wrapping_add(1);
        match say(pendant, HostMessage::Control { request, command }) {
            Some(PendantMessage::Reply { answer, .. }) => answer,
            other => panic!("no reply but {other:?}"),
        }
    }

    /// Two waypoints in steps of 5 mm, from so far along x.
    fn load(pendant: &mut Pendant<64>, path: u16, along_um: i32) {
        let at = |k: i32| {
            let [x, y, z] = FIRST.position_um;
            let pose = WirePose { position_um: [x + along_um + k * 5_000, y, z], ..FIRST };
            WireWaypoint { pose, feed_um_s: 20_000, weld: false }
        };
        let waypoints = [at(0), at(1)];
        let begin = Begin {
            path,
            total: 2,
            chunk: 4,
            streamed: false,
            reach_um: 1_000_000,
            max_step_um: 10_000,
            min_half_turn_cos_q15: 30_000,
            arc: false,
            times: ProcessTimes::default(),
        };
        assert_eq!(command(pendant, Command::Begin(begin)), Answer::Done);
        let chunk = Chunk { path, first: 0, waypoints: waypoints.into_iter().collect() };
        assert!(matches!(say(pendant, HostMessage::Chunk(chunk)), Some(PendantMessage::Ack(_))));
        let digest = wire::path_digest(&waypoints).expect("short");
        assert_eq!(command(pendant, Command::Commit { path, digest }), Answer::Done);
        lively_tick(pendant, false, along_um);
        lively_tick(pendant, true, along_um);
    }

    /// One tick with a ping before and a robot's answer from so far along x after it.
    fn lively_tick(pendant: &mut Pendant<64>, enable: bool, along_um: i32) {
        let (count, echo) = (pendant.host.session.expect("open").count.wrapping_add(1), pendant.ticks);
        let _ = say(pendant, HostMessage::Ping(Ping { count, echo, token: 0 }));
        let told = pendant.tick(&Panel { enable, ..Panel::default() }).robot.expect("fitted");
        let [x, y, z] = FIRST.position_um;
        let standing = WirePose { position_um: [x + along_um, y, z], ..FIRST };
        let actual = Actual {
            robot: 1,
            sequence: told.tick,
            session: told.session,
            heard: told.tick,
            lost: 0,
            pose: told.pose.unwrap_or(standing),
            error_um: 0,
            drives: Drives::Following,
        };
        let port = pendant.robot.port.as_mut().expect("fitted");
        port.take(actual, &WirePose::IDENTITY);
    }

    #[test]
    fn a_start_compares_the_robot_with_its_own_path_and_not_with_where_another_ended() {
        let mut pendant = fitted();
        // The first path after power-on, and one that begins 100 mm from where that ended.
        for (path, along_um) in [(1, 0), (2, 100_000)] {
            load(&mut pendant, path, along_um);
            assert_eq!(command(&mut pendant, Command::Start { path }), Answer::Done);
            for _ in 0..400 {
                lively_tick(&mut pendant, true, along_um);
                assert_eq!(pendant.interlock.cause(), None, "path {path}");
            }
            assert_eq!(pendant.path.finished, Some(path));
        }
    }
}
