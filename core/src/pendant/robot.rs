//! The robot at the port: what it was told, what it says, and whether that is fresh and near enough.
//!
//! Everything runs on the sequence numbers of the frames sent: an answer is as old as the frame that it answers, so that
//! silence, delay and repetition are one thing.

use super::ring::turn_mrad;
use super::{Pendant, SetPoint, Slots};
use crate::interlock::{Cause, Event, State};
use crate::path::TorchPose;
use crate::wire::frame::Received;
use crate::wire::port::{self, Actual, Drives};
use crate::wire::{Robot, WirePose};

/// What the port has to keep to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortConfig {
    /// Ticks after which an answer is late.
    pub late_ticks: u16,
    /// Farthest from the set-point, µm.
    pub off_um: u32,
    /// Turned farthest from the set-point, mrad.
    pub off_mrad: u32,
}

impl Default for PortConfig {
    /// 3 ticks; 10 mm and 10 degrees: an arm that lags by 30 ms is 7.5 mm behind at 250 mm/s.
    fn default() -> Self {
        Self { late_ticks: 3, off_um: 10_000, off_mrad: 175 }
    }
}

/// The port's state.
#[derive(Debug, Clone)]
pub(super) struct Monitor {
    config: PortConfig,
    sequence: u16,
    answered: Option<Answered>,
    missed: u16,
}

#[derive(Debug, Clone, Copy)]
struct Answered {
    actual: Actual,
    torch: WirePose,
}

impl Monitor {
    pub(super) const fn new(config: PortConfig) -> Self {
        Self { config, sequence: 0, answered: None, missed: 0 }
    }

    /// The newest answer, if it is not late.
    fn fresh(&self) -> Option<&Answered> {
        let age = |answered: &&Answered| self.sequence.wrapping_sub(answered.actual.heard);
        self.answered.as_ref().filter(|answered| age(answered) < self.config.late_ticks)
    }

    /// Where the torch is.
    pub(super) fn torch(&self) -> Option<WirePose> {
        self.fresh().map(|answered| answered.torch)
    }

    /// Whether it answers and its drives follow.
    pub(super) fn is_ready(&self) -> bool {
        self.fresh().is_some_and(|answered| answered.actual.drives == Drives::Following)
    }

    /// What it says of itself.
    pub(super) fn report(&self) -> Option<Robot> {
        let Answered { actual, torch } = self.fresh()?;
        let lost = actual.lost.wrapping_add(self.missed);
        Some(Robot { pose: *torch, error_um: actual.error_um, drives: actual.drives, lost })
    }

    /// Why a torch that has to be at `commanded` must stop.
    fn trouble(&self, commanded: &WirePose) -> Option<Cause> {
        let Some(answered) = self.fresh() else { return Some(Cause::RobotSilent) };
        let distance_um = answered.torch.distance_um(commanded).max(answered.actual.error_um as f32);
        let off = distance_um > self.config.off_um as f32
            || turn_mrad(&answered.torch, commanded) > self.config.off_mrad as f32;
        match answered.actual.drives {
            Drives::Following => off.then_some(Cause::RobotOff),
            Drives::Off | Drives::Stopped => Some(Cause::RobotDrives),
        }
    }

    /// An answer counts if it is newer than the last and answers a frame that was sent.
    fn take(&mut self, actual: Actual, tool: &WirePose) {
        let newer = |last: &Answered| actual.sequence.wrapping_sub(last.actual.sequence) as i16 > 0;
        let sent = self.sequence.wrapping_sub(actual.heard) as i16 >= 0;
        let passed = self.answered.as_ref().is_none_or(newer);
        let torch = actual.pose.is_unit().then(|| compose(&actual.pose, tool)).flatten();
        let (true, true, Some(torch)) = (actual.version == port::VERSION && sent, passed, torch) else {
            return;
        };
        let gap = self.answered.map_or(1, |last| actual.sequence.wrapping_sub(last.actual.sequence));
        // A robot that starts anew counts from anywhere: no gap of its is more than was sent meanwhile.
        self.missed = self.missed.wrapping_add(gap.saturating_sub(1));
        self.answered = Some(Answered { actual, torch });
    }

    /// Where the torch is with another tool.
    pub(super) fn retool(&mut self, tool: &WirePose) {
        let torch = |answered: Answered| {
            compose(&answered.actual.pose, tool).map(|torch| Answered { torch, ..answered })
        };
        self.answered = self.answered.and_then(torch);
    }

    /// A late robot may have started anew, and then counts from the beginning.
    fn forget_late(&mut self) {
        if self.fresh().is_none() {
            self.answered = None;
        }
    }
}

impl<const RING: usize, S: Slots> Pendant<RING, S> {
    /// Takes what a delimiter completed on the robot's line.
    pub fn receive_robot(&mut self, received: Received<'_>) {
        let (Received::Payload(payload), Some(robot)) = (received, &mut self.robot) else { return };
        if let Ok(actual) = Actual::decode(payload) {
            robot.take(actual, &self.tool);
        }
    }

    /// Holds if the robot is late, off or without drives. Before the frame of this tick is sent.
    pub(super) fn watch_robot(&mut self) {
        let Some(robot) = &mut self.robot else { return };
        robot.forget_late();
        if self.interlock.state() != State::Running {
            return;
        }
        if let Some(cause) = robot.trouble(&self.pose) {
            self.fire_own(Event::Robot(cause));
        }
    }

    /// The frame of this tick, if a port is fitted.
    pub(super) fn command_robot(
        &mut self,
        set_point: Option<&SetPoint>,
        motion: bool,
        arc: bool,
    ) -> Option<port::WireSetPoint> {
        let torch = set_point.map(|at| at.pose).or(self.jogged());
        let pose = torch.and_then(|pose| compose(&pose, &self.torch_from_flange));
        let robot = self.robot.as_mut()?;
        robot.sequence = robot.sequence.wrapping_add(1);
        let (sequence, tick) = (robot.sequence, self.ticks);
        Some(port::WireSetPoint { version: port::VERSION, sequence, tick, pose, motion, arc })
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
        let request = pendant.requests.last.wrapping_add(1);
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
        let (count, echo) = (pendant.life.count.wrapping_add(1), pendant.ticks);
        let _ = say(pendant, HostMessage::Ping(Ping { count, echo, token: 0 }));
        let told = pendant.tick(&Panel { enable, ..Panel::default() }).robot.expect("fitted");
        let [x, y, z] = FIRST.position_um;
        let standing = WirePose { position_um: [x + along_um, y, z], ..FIRST };
        let actual = Actual {
            version: port::VERSION,
            sequence: told.sequence,
            heard: told.sequence,
            lost: 0,
            pose: told.pose.unwrap_or(standing),
            error_um: 0,
            drives: Drives::Following,
        };
        let monitor = pendant.robot.as_mut().expect("fitted");
        monitor.take(actual, &WirePose::IDENTITY);
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
            assert_eq!(pendant.finished, Some(path));
        }
    }
}
