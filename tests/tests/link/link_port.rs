//! The robot port in virtual time: an arm that follows, one that is late, off, stopped or lost, and a line that loses frames.

use weldpath_core::interlock::{Cause, State};
use weldpath_core::pendant::{Config, PortConfig, SetPoint, Tick};
use weldpath_core::wire::frame::{Received, decode, encode};
use weldpath_core::wire::port::{Actual, ActualDeframer, Drives, MAX_SET_POINT_FRAME};
use weldpath_core::wire::{Answer, Command, Q15_ONE, Refusal, Telemetry, WirePose, WireWaypoint};
use weldpath_tests::adversary::{Faults, Line, Random};
use weldpath_tests::arm::{Arm, Limits};
use weldpath_tests::bench::Bench;
use weldpath_tests::world;

fn config() -> Config {
    Config { port: Some(PortConfig::default()), ..world::config() }
}

fn line(total: u32, feed_um_s: u32) -> Vec<WireWaypoint> {
    let at = |k: u32| {
        let position_um = [400_000 + k as i32 * 1_000, 0, 200_000];
        WireWaypoint { pose: WirePose { position_um, ..WirePose::IDENTITY }, feed_um_s, weld: true }
    };
    (0..total).map(at).collect()
}

/// A pendant, its host and its robot.
struct Cell {
    bench: Bench,
    arm: Arm,
    bytes: ActualDeframer,
    /// Whether the arm's answers arrive, and after how many ticks.
    delay: Option<usize>,
    under_way: std::collections::VecDeque<Vec<u8>>,
    /// Id of the path loaded last.
    path: u16,
}

impl Cell {
    fn new(start: &WirePose) -> Self {
        let (bench, arm) = (Bench::with(&config()), Arm::at(start, Limits::default(), 3));
        let under_way = std::collections::VecDeque::new();
        Self { bench, arm, bytes: ActualDeframer::new(), delay: Some(0), under_way, path: 1 }
    }

    /// Loaded, gripped, and the robot heard.
    fn loaded(path: &[WireWaypoint], start: &WirePose) -> Self {
        let mut cell = Self::new(start);
        cell.bench.load(1, path);
        cell.ticks(5);
        cell
    }

    fn running(path: &[WireWaypoint]) -> Self {
        let mut cell = Self::loaded(path, &path[0].pose);
        assert_eq!(cell.bench.command(Command::ArcArm { armed: true }), Answer::Done);
        assert_eq!(cell.bench.command(Command::Start { path: 1 }), Answer::Done);
        cell
    }

    fn tick(&mut self) -> Tick {
        let tick = self.bench.lively_tick();
        let frame = tick.robot.expect("a port is fitted");
        let mut out = [0; MAX_SET_POINT_FRAME];
        let length = encode(&frame, &mut out).expect("fits");
        if let Some(answer) = self.arm.take(&out[..length]) {
            self.under_way.push_back(answer);
        }
        while self.delay.is_some_and(|delay| self.under_way.len() > delay) {
            let answer = self.under_way.pop_front().expect("there is one");
            self.hear(&answer);
        }
        tick
    }

    fn hear(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if let Some(received) = self.bytes.push(byte) {
                self.bench.pendant.receive_robot(received);
            }
        }
    }

    fn ticks(&mut self, count: u32) {
        for _ in 0..count {
            let _ = self.tick();
        }
    }

    fn start(&mut self) -> Answer {
        self.bench.command(Command::Start { path: 1 })
    }

    fn seen(&self) -> Telemetry {
        self.bench.pendant.telemetry()
    }

    /// Welds until the arc burns and the torch is on its way.
    fn welding() -> Self {
        let mut cell = Self::running(&line(300, 50_000));
        cell.ticks(400);
        assert!(cell.tick().outputs.arc);
        cell
    }

    /// Ticks until the arc is off.
    fn arc_goes_off(&mut self, limit: u32) -> u32 {
        (1..=limit).find(|_| !self.tick().outputs.arc).expect("the arc goes off")
    }
}

#[test]
fn every_set_point_reaches_the_robot_once_and_the_robot_follows_it() {
    let path = line(100, 50_000);
    let mut cell = Cell::running(&path);
    let (mut told, mut executed, mut farthest_um) = (Vec::new(), Vec::new(), 0.0_f32);
    while cell.bench.pendant.path().is_some() {
        let tick = cell.tick();
        if let Some(SetPoint { pose, .. }) = tick.set_point {
            executed.push(pose);
            told.extend(tick.robot.and_then(|frame| frame.pose));
            farthest_um = farthest_um.max(cell.arm.pose().distance_um(&pose));
        }
    }
    assert!(executed.len() > 1_000);
    assert_eq!(told, executed);
    // An arm with a lag of 12 ms is 0.6 mm behind at 50 mm/s.
    assert!((400.0..700.0).contains(&farthest_um), "{farthest_um}");
    assert_eq!(cell.seen().finished, Some(1));
    assert!(cell.arm.farthest_jump_mm < 0.2 && cell.arm.arc_frames > 500);
}

#[test]
fn a_port_that_is_fitted_and_silent_or_without_drives_starts_nothing() {
    let path = line(20, 50_000);
    let mut cell = Cell::loaded(&path, &path[0].pose);
    cell.delay = None;
    cell.ticks(10);
    assert_eq!(cell.start(), Answer::Refused(Refusal::Robot));
    assert_eq!(cell.seen().robot, None);
    cell.delay = Some(0);
    cell.arm.drives = Drives::Off;
    cell.ticks(10);
    assert_eq!(cell.start(), Answer::Refused(Refusal::Robot));
    cell.arm.drives = Drives::Following;
    cell.ticks(10);
    assert_eq!(cell.start(), Answer::Done);
}

#[test]
fn the_actual_pose_decides_over_start_and_resume_and_nobody_can_confirm_another() {
    let path = line(300, 50_000);
    let away = WirePose { position_um: [400_000, 5_000, 200_000], ..WirePose::IDENTITY };
    let mut cell = Cell::loaded(&path, &away);
    let Answer::Refused(Refusal::Away { distance_um, .. }) = cell.start() else { panic!("it jumps") };
    assert!((4_900..5_100).contains(&distance_um), "{distance_um}");
    cell.bench.panel.confirm = true;
    cell.ticks(3);
    assert!(matches!(cell.start(), Answer::Refused(Refusal::Away { .. })));
    let half = 1.5_f64.to_radians();
    let q15 = [half.cos(), half.sin(), 0.0, 0.0].map(|c| (c * f64::from(Q15_ONE)).round() as i16);
    cell.arm.put(&WirePose { orientation_q15: q15, ..path[0].pose });
    cell.ticks(3);
    let Answer::Refused(Refusal::Away { turn_mrad, .. }) = cell.start() else { panic!("3 degrees off") };
    assert!((50..55).contains(&turn_mrad), "{turn_mrad}");
    cell.arm.put(&path[0].pose);
    cell.ticks(3);
    assert_eq!(cell.start(), Answer::Done);
    cell.ticks(200);
    assert_eq!(cell.bench.command(Command::Hold), Answer::Done);
    cell.ticks(200);
    assert_eq!(cell.seen().state, State::Held);
    cell.bench.panel.enable = false;
    cell.ticks(2);
    cell.bench.panel.enable = true;
    cell.ticks(2);
    cell.arm.put(&away);
    cell.ticks(3);
    let resume = Command::Resume { path: 1, changes: cell.seen().changes, back_um: 0 };
    assert!(matches!(cell.bench.command(resume), Answer::Refused(Refusal::Away { .. })));
}

#[test]
fn a_robot_that_falls_silent_holds_after_three_ticks() {
    let mut cell = Cell::welding();
    cell.delay = None;
    let ticks = cell.arc_goes_off(100);
    assert_eq!(ticks, 4, "3 ticks may pass");
    assert_eq!(cell.seen().cause, Some(Cause::RobotSilent));
    cell.ticks(200);
    assert_eq!(cell.seen().state, State::Held);
}

#[test]
fn a_robot_that_answers_late_holds_and_one_within_the_limit_does_not() {
    for (delay, holds) in [(0, false), (1, false), (2, false), (3, true), (10, true)] {
        let mut cell = Cell::welding();
        cell.delay = Some(delay);
        cell.ticks(100);
        assert_eq!(cell.seen().cause, holds.then_some(Cause::RobotSilent), "{delay} ticks");
    }
}

#[test]
fn a_recorded_answer_keeps_nothing_moving() {
    let mut cell = Cell::welding();
    let recorded = cell.arm.answer();
    cell.hear(&recorded);
    cell.delay = None;
    let held = (0..50).find(|_| {
        cell.hear(&recorded);
        !cell.tick().outputs.arc
    });
    assert!(held.is_some_and(|ticks| ticks <= 4), "{held:?}");
}

#[test]
fn a_robot_that_is_off_by_the_limit_or_whose_drives_stop_holds_with_the_cause() {
    let mut cell = Cell::welding();
    let mut aside = cell.arm.pose();
    aside.position_um[1] += 12_000;
    cell.arm.put(&aside);
    assert!(cell.arc_goes_off(5) <= 2);
    assert_eq!(cell.seen().cause, Some(Cause::RobotOff));
    let mut cell = Cell::welding();
    cell.arm.drives = Drives::Stopped;
    assert!(cell.arc_goes_off(5) <= 2);
    assert_eq!(cell.seen().cause, Some(Cause::RobotDrives));
}

#[test]
fn the_tool_is_between_the_flange_and_the_torch() {
    let path = line(60, 50_000);
    let half = 0.3_f64;
    let q15 = [half.cos(), 0.0, half.sin(), 0.0].map(|c| (c * f64::from(Q15_ONE)).round() as i16);
    let tool = WirePose { position_um: [10_000, -20_000, 350_000], orientation_q15: q15 };
    let mut cell = Cell::new(&path[0].pose);
    assert_eq!(cell.bench.command(Command::SetTool { tool }), Answer::Done);
    cell.bench.load(1, &path);
    cell.ticks(5);
    let Answer::Refused(Refusal::Away { distance_um, .. }) = cell.start() else {
        panic!("the flange is no torch")
    };
    assert!((340_000..361_000).contains(&distance_um), "{distance_um}");
    // The flange where the torch is at the first waypoint: base_from_torch = base_from_flange * flange_from_torch.
    let (sin, cos) = (2.0 * half).sin_cos();
    let [tx, ty, tz] = tool.position_um.map(f64::from);
    // flange = torch * tool^-1; the torch is not turned, so the flange is turned by the tool's inverse about y.
    let turned = [cos * tx - sin * tz, ty, sin * tx + cos * tz];
    let at = path[0].pose.position_um.map(f64::from);
    let position_um = [0, 1, 2].map(|axis| (at[axis] - turned[axis]).round() as i32);
    let flange = WirePose { position_um, orientation_q15: [q15[0], 0, -q15[2], 0] };
    cell.arm.put(&flange);
    cell.ticks(5);
    assert_eq!(cell.start(), Answer::Done);
    let told = (0..20).find_map(|_| cell.tick().robot.and_then(|frame| frame.pose)).expect("a set-point");
    assert!(told.distance_um(&flange) < 30.0, "{told:?} is not {flange:?}");
}

#[test]
fn both_ends_count_what_is_lost_on_the_line() {
    let path = line(100, 50_000);
    let mut cell = Cell::running(&path);
    let mut dropped = 0_u16;
    for k in 0..600 {
        let tick = cell.bench.lively_tick();
        let frame = tick.robot.expect("fitted");
        if k % 10 == 3 {
            dropped += 1;
            continue;
        }
        assert!(cell.arm.follow(&frame));
        let answer = cell.arm.answer();
        if k % 10 == 6 {
            dropped += 1;
            continue;
        }
        cell.hear(&answer);
    }
    assert_eq!(cell.seen().robot.map(|robot| robot.lost), Some(dropped));
    assert_eq!(cell.seen().state, State::Running, "one frame at a time is no reason to hold");
}

/// Welds over a robot's line with these faults; set-points that arrived altered, and ticks of arc outside Running.
fn under(faults: Faults, seed: u64, frames: u64) -> (u64, u64, u64) {
    let path = line(300, 20_000);
    let mut cell = Cell::running(&path);
    let (mut out, mut back) = (Line::new(faults, 460_800, seed), Line::new(faults, 460_800, seed + 1));
    let mut told = std::collections::HashMap::new();
    let mut arm_bytes = weldpath_core::wire::port::SetPointDeframer::new();
    let (mut altered, mut stray, mut arrived, mut now_us) = (0, 0, 0, 0_u64);
    let mut random = Random::new(seed);
    while out.sent() < frames {
        now_us += 2_000;
        while let Some(bytes) = back.arrived(now_us) {
            cell.hear(&bytes);
        }
        let tick = cell.bench.lively_tick();
        stray += u64::from(tick.outputs.arc && cell.bench.pendant.state() != State::Running);
        let frame = tick.robot.expect("fitted");
        told.insert((frame.sequence, frame.tick), frame);
        let mut bytes = [0; MAX_SET_POINT_FRAME];
        let length = encode(&frame, &mut bytes).expect("fits");
        out.send(now_us, &bytes[..length]);
        while let Some(bytes) = out.arrived(now_us + 1_999) {
            for byte in bytes {
                let Some(Received::Payload(payload)) = arm_bytes.push(byte) else { continue };
                let Ok(frame) = decode::<weldpath_core::wire::port::WireSetPoint>(payload) else { continue };
                arrived += 1;
                altered += u64::from(told.get(&(frame.sequence, frame.tick)) != Some(&frame));
                if cell.arm.follow(&frame) {
                    back.send(now_us + 1_000, &cell.arm.answer());
                }
            }
        }
        operate(&mut cell, &path, &mut random);
    }
    (altered, stray, arrived)
}

/// Grips, resumes and starts over, as an operator would.
fn operate(cell: &mut Cell, path: &[WireWaypoint], random: &mut Random) {
    let seen = cell.seen();
    cell.bench.panel.enable = seen.pins & Telemetry::ENABLED != 0 || !cell.bench.panel.enable;
    if seen.pins & Telemetry::ENABLED == 0 || random.chance(0.5) {
        return;
    }
    match seen.state {
        State::Held => {
            let _ = cell.bench.command(Command::ArcArm { armed: true });
            let _ = cell.bench.command(Command::Resume {
                path: seen.load.map_or(0, |l| l.path),
                changes: seen.changes,
                back_um: 0,
            });
        }
        State::Idle => {
            cell.path = cell.path.wrapping_add(1);
            cell.arm.put(&path[0].pose);
            cell.bench.load(cell.path, path);
        }
        State::Ready => {
            let _ = cell.bench.command(Command::ArcArm { armed: true });
            let _ = cell.bench.command(Command::Start { path: seen.load.map_or(0, |l| l.path) });
        }
        _ => {}
    }
}

const CLEAN: Faults =
    Faults { byte_error: 0.0, byte_drop: 0.0, frame_drop: 0.0, frame_double: 0.0, frame_late: 0.0 };

fn table(frames: u64) {
    for (name, faults) in [
        ("clean", CLEAN),
        ("byte error 1e-3", Faults { byte_error: 1e-3, ..CLEAN }),
        ("byte drop 1e-3", Faults { byte_drop: 1e-3, ..CLEAN }),
        ("frame drop 5 %", Faults { frame_drop: 0.05, ..CLEAN }),
        ("duplicate 10 %", Faults { frame_double: 0.1, ..CLEAN }),
        ("reorder 10 %", Faults { frame_late: 0.1, ..CLEAN }),
    ] {
        let (altered, stray, arrived) = under(faults, 7, frames);
        println!(
            "robot port, {name}: {frames} frames, {arrived} arrived, {altered} altered, {stray} ticks of stray arc"
        );
        assert_eq!((altered, stray), (0, 0), "{name}");
        assert!(arrived > frames / 2, "{name}: {arrived}");
    }
}

#[test]
fn faults_of_the_robots_line_alter_no_set_point_and_leave_no_arc() {
    table(100_000);
}

/// On demand: `cargo test -p weldpath-tests --release --test link link_port -- --ignored --nocapture`.
#[test]
#[ignore = "six million frames"]
fn faults_of_the_robots_line_over_a_million_frames_each() {
    table(1_000_000);
}

#[test]
fn an_answer_of_another_version_or_to_a_frame_never_sent_is_none() {
    let path = line(20, 50_000);
    let mut cell = Cell::loaded(&path, &path[0].pose);
    cell.delay = None;
    cell.ticks(10);
    let good = cell.arm.actual();
    for bad in [Actual { version: 2, ..good }, Actual { heard: good.heard.wrapping_add(9), ..good }] {
        let mut out = [0; 64];
        let length = encode(&bad, &mut out).expect("fits");
        cell.hear(&out[..length]);
        assert_eq!(cell.seen().robot, None, "{bad:?}");
    }
}
