//! The robot port in virtual time: an arm that follows, one that is late, off, stopped or lost, and a line that loses frames.

use weldpath_core::interlock::{Cause, State};
use weldpath_core::path::TorchPose;
use weldpath_core::pendant::{Config, PortConfig, SetPoint, Tick};
use weldpath_core::wire::frame::Received;
use weldpath_core::wire::port::{Actual, ActualDeframer, Drives, SetPointDeframer, WireSetPoint};
use weldpath_core::wire::{
    Answer, Command, Field, Hand, Q15_ONE, Refusal, Telemetry, WireHandFrame, WireJog, WirePose, WireWaypoint,
};
use weldpath_tests::adversary::{Faults, Line, Random};
use weldpath_tests::arm::{Arm, Limits, frame_of, told};
use weldpath_tests::bench::Bench;
use weldpath_tests::world;

use crate::link_rules::hand;

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
        let mut cell = Self { bench, arm, bytes: ActualDeframer::new(), delay: Some(0), under_way, path: 1 };
        assert_eq!(cell.set_tool(WirePose::IDENTITY), Answer::Done);
        cell
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
        if let Some(answer) = self.arm.take(&told(&frame)) {
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

    fn set_tool(&mut self, tool: WirePose) -> Answer {
        self.bench.command(Command::SetTool { tool })
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
    let (mut sent, mut executed, mut farthest_um) = (Vec::new(), Vec::new(), 0.0_f32);
    while cell.bench.pendant.path().is_some() {
        let tick = cell.tick();
        if let Some(SetPoint { pose, .. }) = tick.set_point {
            executed.push(pose);
            sent.extend(tick.robot.and_then(|frame| frame.pose));
            farthest_um = farthest_um.max(cell.arm.pose().distance_um(&pose));
        }
    }
    assert!(executed.len() > 1_000);
    assert_eq!(sent, executed);
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
fn a_robot_that_falls_silent_holds_after_five_ticks() {
    let mut cell = Cell::welding();
    cell.delay = None;
    let ticks = cell.arc_goes_off(100);
    assert_eq!(ticks, 6, "5 ticks may pass");
    assert_eq!(cell.seen().cause, Some(Cause::RobotSilent));
    cell.ticks(200);
    assert_eq!(cell.seen().state, State::Held);
}

#[test]
fn a_robot_that_answers_late_holds_and_one_within_the_limit_does_not() {
    for (delay, holds) in [(0, false), (1, false), (4, false), (5, true), (10, true)] {
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
    assert!(held.is_some_and(|ticks| ticks <= 6), "{held:?}");
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
    assert_eq!(cell.set_tool(tool), Answer::Done);
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
    let mut sent = std::collections::HashMap::new();
    let mut arm_bytes = SetPointDeframer::new();
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
        sent.insert((frame.session, frame.tick), frame);
        out.send(now_us, &told(&frame));
        while let Some(bytes) = out.arrived(now_us + 1_999) {
            for byte in bytes {
                let Some(Received::Payload(payload)) = arm_bytes.push(byte) else { continue };
                let Some(frame) = WireSetPoint::from_bytes(payload) else { continue };
                arrived += 1;
                altered += u64::from(sent.get(&(frame.session, frame.tick)) != Some(&frame));
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
fn an_answer_of_another_version_session_or_end_or_to_a_frame_never_sent_is_none() {
    let path = line(20, 50_000);
    let mut cell = Cell::loaded(&path, &path[0].pose);
    let good = cell.arm.actual();
    let wrong = [
        Actual { session: good.session.wrapping_add(1), ..good },
        Actual { heard: good.heard.wrapping_add(9), ..good },
        Actual { robot: 0, ..good },
        Actual { robot: good.robot.wrapping_add(2), ..good },
        Actual { sequence: good.sequence.wrapping_sub(1), ..good },
    ];
    for bad in wrong {
        let before = cell.seen().robot.expect("heard");
        cell.hear(&frame_of(&Actual { error_um: 77, ..bad }));
        assert_eq!(cell.seen().robot, Some(before), "{bad:?}");
    }
    cell.hear(&frame_of(&Actual { error_um: 77, ..good }));
    assert_eq!(cell.seen().robot.map(|robot| robot.error_um), Some(77));
}

#[test]
fn answers_recorded_a_boot_a_session_or_a_wrap_of_sixteen_bits_earlier_start_nothing() {
    let path = line(20, 50_000);
    // What a robot answered in another session, and 65,536 frames ago in this one.
    let mut cell = Cell::loaded(&path, &path[0].pose);
    let ancient = frame_of(&cell.arm.actual());
    cell.delay = None;
    for _ in 0..65_536 {
        let _ = cell.bench.lively_tick();
    }
    cell.hear(&ancient);
    assert_eq!(cell.seen().robot, None);
    assert_eq!(cell.start(), Answer::Refused(Refusal::Robot));
    // A boot and a session earlier: everything that was answered there, at the same ticks here.
    let mut earlier = Cell::new(&path[0].pose);
    for _ in 0..200 {
        let _ = earlier.bench.tick();
    }
    earlier.bench.open(5);
    assert_eq!(earlier.set_tool(WirePose::IDENTITY), Answer::Done);
    let mut later = Cell::new(&path[0].pose);
    later.delay = None;
    for _ in 0..500 {
        let _ = earlier.tick();
        let _ = later.bench.lively_tick();
        later.hear(&earlier.arm.answer());
        assert_eq!(later.seen().robot, None);
    }
    assert!(earlier.seen().robot.is_some());
}

#[test]
fn one_lost_answer_on_the_slowest_line_does_not_drop_the_arc() {
    // A line of 460,800 baud, and a bridge that takes all that docs/robot-port.md's budget allows.
    const BYTE_US: u64 = 22;
    const BRIDGE_US: u64 = 5_800;
    let mut cell = Cell::welding();
    let (mut to_robot, mut to_pendant) =
        (std::collections::VecDeque::new(), std::collections::VecDeque::new());
    let (mut now_us, mut answers, mut lost) = (0_u64, 0_u32, 0);
    for _ in 0..2_000 {
        now_us += 2_000;
        while to_pendant.front().is_some_and(|(at_us, _)| *at_us <= now_us) {
            let (_, bytes): (u64, Vec<u8>) = to_pendant.pop_front().expect("there is one");
            cell.hear(&bytes);
        }
        let tick = cell.bench.lively_tick();
        let bytes = told(&tick.robot.expect("fitted"));
        to_robot.push_back((now_us + BYTE_US * bytes.len() as u64, bytes));
        let (at_us, bytes) = to_robot.pop_front().expect("there is one");
        let answer = cell.arm.take(&bytes).expect("an answer");
        answers += 1;
        if answers % 40 == 0 {
            lost += 1;
        } else {
            to_pendant.push_back((at_us + BRIDGE_US + BYTE_US * answer.len() as u64, answer));
        }
        assert_eq!(cell.seen().state, State::Running, "{lost} lost: {:?}", cell.seen().cause);
    }
    assert!(lost >= 49);
}

/// Ticks with the arc on until it is off, of a robot that is `aside_um` beside the weld from now on.
fn beside_the_weld(aside_um: i32, turned_mrad: f64) -> Option<u32> {
    let mut cell = Cell::welding();
    let half = turned_mrad * 0.5e-3;
    let turn = [half.cos(), half.sin(), 0.0, 0.0].map(|c| (c * f64::from(Q15_ONE)).round() as i16);
    (1..=400).find(|_| {
        let tick = cell.bench.lively_tick();
        let mut actual = {
            let _ = cell.arm.follow(&tick.robot.expect("fitted"));
            cell.arm.actual()
        };
        actual.pose.position_um[1] += aside_um;
        actual.pose.orientation_q15 = turn;
        actual.error_um = 0;
        cell.hear(&frame_of(&actual));
        !tick.outputs.arc
    })
}

#[test]
fn a_weld_beside_the_joint_is_held_at_two_millimetres_or_two_degrees() {
    assert_eq!(beside_the_weld(1_500, 0.0), None);
    let late = beside_the_weld(2_300, 0.0).expect("held");
    assert!((50..56).contains(&late), "{late} ticks");
    assert!(beside_the_weld(9_900, 0.0).is_some_and(|ticks| ticks < 56));
    assert_eq!(beside_the_weld(0, 30.0), None);
    assert!(beside_the_weld(0, 38.0).is_some_and(|ticks| ticks < 56));
    assert!(beside_the_weld(0, 170.0).is_some_and(|ticks| ticks < 56));
    assert!(beside_the_weld(10_100, 0.0).is_some_and(|ticks| ticks < 5));
}

#[test]
fn a_frozen_robot_is_noticed_by_its_standing_still() {
    // 5 mm/s: 2 mm off the set-point would take 400 ms and 100 more.
    for (feed_um_s, most_ticks) in [(5_000, 70), (20_000, 60), (2_000, 150)] {
        let path = line(40, feed_um_s);
        let mut cell = Cell::running(&path);
        cell.ticks(600);
        assert!(cell.tick().outputs.arc);
        let frozen = cell.arm.actual().pose;
        let ticks = (1..=400).find(|_| {
            let tick = cell.bench.lively_tick();
            let _ = cell.arm.follow(&tick.robot.expect("fitted"));
            let actual = Actual { pose: frozen, error_um: 0, ..cell.arm.actual() };
            cell.hear(&frame_of(&actual));
            !tick.outputs.arc
        });
        assert_eq!(cell.seen().cause, Some(Cause::RobotOff));
        assert!(ticks.is_some_and(|ticks| ticks <= most_ticks), "{feed_um_s} um/s: {ticks:?}");
    }
}

#[test]
fn a_robot_that_stops_by_itself_has_no_set_points_run_on_ahead_of_it() {
    let mut cell = Cell::welding();
    cell.arm.drives = Drives::Stopped;
    let _ = cell.tick();
    let last = cell.tick();
    for _ in 0..100 {
        let tick = cell.tick();
        assert!(!tick.motion && !tick.outputs.arc);
        assert_eq!(tick.robot.and_then(|frame| frame.pose), last.robot.and_then(|frame| frame.pose));
    }
    assert_eq!(cell.seen().state, State::Held);
    assert_eq!(cell.seen().cause, Some(Cause::RobotDrives));
}

#[test]
fn what_the_robot_says_of_its_error_counts_before_a_start() {
    let path = line(20, 50_000);
    let mut cell = Cell::loaded(&path, &path[0].pose);
    let _ = cell.bench.lively_tick();
    let actual = Actual { error_um: 2_500, ..cell.arm.actual() };
    let heard = cell.seen().tick;
    cell.hear(&frame_of(&Actual { heard, ..actual }));
    assert!(matches!(cell.start(), Answer::Refused(Refusal::Away { distance_um: 2_500, .. })));
}

/// Hands that push the camera one way, as fast as frames may come, for so many ticks; the last tick and whether all
/// frames were taken.
fn pushed(cell: &mut Cell, ticks: u32, clock_ms: &mut u32) -> (Tick, bool) {
    let (mut last, mut taken) = (cell.tick(), true);
    for k in 0..ticks {
        *clock_ms += 2;
        if k % 5 == 0 {
            let hands = WireHandFrame {
                time_ms: *clock_ms,
                left: Some(hand([150_000, 200_000, 0], 1000)),
                right: None,
            };
            taken &= matches!(cell.bench.command(Command::HandFrame(hands)), Answer::Pose(_));
        }
        last = cell.tick();
    }
    (last, taken)
}

/// Hands guide the camera, and it moves.
fn guided() -> (Cell, u32) {
    let start = WirePose { position_um: [300_000, 0, 400_000], ..WirePose::IDENTITY };
    let mut cell = Cell::new(&start);
    cell.bench.panel.manual = true;
    cell.bench.panel.enable = false;
    cell.ticks(3);
    cell.bench.panel.enable = true;
    cell.ticks(3);
    assert_eq!(cell.bench.command(Command::SetJog(jog(&start))), Answer::Done);
    let mut clock_ms = 0;
    let (last, taken) = pushed(&mut cell, 300, &mut clock_ms);
    assert!(taken && last.motion, "{:?}", cell.seen());
    assert!(cell.arm.pose().distance_um(&start) > 20_000.0, "{:?}", cell.arm.pose());
    (cell, clock_ms)
}

#[test]
fn hands_are_taken_off_a_robot_that_is_silent_stopped_off_or_stands_still_until_a_new_grip() {
    type Trouble = fn(&mut Cell);
    let troubles: [(Trouble, Cause, u32); 4] = [
        (|cell| cell.delay = None, Cause::RobotSilent, 8),
        (|cell| cell.arm.drives = Drives::Stopped, Cause::RobotDrives, 3),
        (
            |cell| {
                let mut aside = cell.arm.pose();
                aside.position_um[1] += 15_000;
                cell.arm.put(&aside);
            },
            Cause::RobotOff,
            3,
        ),
        (|cell| cell.arm.jammed = true, Cause::RobotOff, 80),
    ];
    for (trouble, cause, most_ticks) in troubles {
        let (mut cell, mut clock_ms) = guided();
        trouble(&mut cell);
        let ticks = (1..=100).find(|_| !pushed(&mut cell, 1, &mut clock_ms).0.motion);
        assert!(ticks.is_some_and(|ticks| ticks <= most_ticks), "{cause:?}: {ticks:?}");
        assert_eq!((cell.seen().state, cell.seen().cause), (State::Disabled, Some(cause)));
        // All well again: not before a new grip.
        (cell.delay, cell.arm.drives, cell.arm.jammed) = (Some(0), Drives::Following, false);
        let (last, taken) = pushed(&mut cell, 50, &mut clock_ms);
        assert!(!taken && !last.motion && last.robot.is_some_and(|frame| frame.pose.is_none()));
        cell.bench.panel.enable = false;
        cell.ticks(2);
        cell.bench.panel.enable = true;
        cell.ticks(2);
        let (last, taken) = pushed(&mut cell, 50, &mut clock_ms);
        assert!(taken && last.motion, "{cause:?}");
        assert_eq!(cell.seen().cause, None);
    }
}

#[test]
fn the_camera_is_never_commanded_farther_ahead_of_the_robot_than_it_stops_in() {
    let (mut cell, mut clock_ms) = guided();
    // A robot that goes at a fifth of what hands ask for.
    cell.arm.limit(20.0);
    let mut ahead_um = 0.0_f32;
    for _ in 0..2_000 {
        let (tick, taken) = pushed(&mut cell, 1, &mut clock_ms);
        assert!(taken && tick.motion, "it is waited for: {:?}", cell.seen().cause);
        if let Some(pose) = tick.robot.and_then(|frame| frame.pose) {
            ahead_um = ahead_um.max(pose.distance_um(&cell.arm.pose()));
        }
    }
    // From 100 mm/s with 500 mm/s^2 it stops in 10 mm.
    assert!((5_000.0..8_300.0).contains(&ahead_um), "{ahead_um}");
}

#[test]
fn a_camera_pose_carries_where_the_robot_is_and_not_where_it_was_sent() {
    let (mut cell, clock_ms) = guided();
    let hands =
        WireHandFrame { time_ms: clock_ms + 2, left: Some(hand([150_000, 200_000, 0], 1000)), right: None };
    let Answer::Pose(camera) = cell.bench.command(Command::HandFrame(hands)) else { panic!("a pose") };
    let actual = camera.actual.expect("a port is fitted");
    assert!(actual.distance_um(&cell.arm.pose()) < 100.0);
    assert!(actual.distance_um(&camera.pose) > 500.0, "the robot lags");
}

#[test]
fn the_workspace_bounds_the_camera_and_the_flange_that_bears_it() {
    // The camera 100 mm behind the flange on its way, and 100 mm ahead of it.
    for along_um in [-100_000, 100_000] {
        let tool = WirePose { position_um: [along_um, 0, 0], ..WirePose::IDENTITY };
        let start = WirePose { position_um: [1_300_000, 0, 400_000], ..WirePose::IDENTITY };
        let mut cell = Cell::new(&after(&start, &inverse(&tool)));
        assert_eq!(cell.set_tool(tool), Answer::Done);
        cell.bench.panel.manual = true;
        cell.bench.panel.enable = false;
        cell.ticks(3);
        cell.bench.panel.enable = true;
        cell.ticks(5);
        assert_eq!(cell.bench.command(Command::SetJog(jog(&start))), Answer::Done);
        let (mut clock_ms, mut farthest_um) = (0, 0);
        for _ in 0..1_500 {
            let (tick, _) = pushed(&mut cell, 1, &mut clock_ms);
            let Some(flange) = tick.robot.and_then(|frame| frame.pose) else { continue };
            let camera = after(&flange, &tool);
            farthest_um = farthest_um.max(camera.position_um[0]).max(flange.position_um[0]);
        }
        // A step of the hand short of the bound, at most.
        assert!((1_498_900..=1_500_001).contains(&farthest_um), "{farthest_um}");
    }
}

#[test]
fn a_fitted_port_asks_for_the_tool_of_this_session_before_anything_moves() {
    let path = line(20, 50_000);
    let mut cell = Cell::loaded(&path, &path[0].pose);
    assert_eq!(cell.seen().tool, Some(WirePose::IDENTITY));
    // Another host: what was set before it came is not its own.
    cell.bench.panel.enable = false;
    for _ in 0..200 {
        let _ = cell.bench.tick();
    }
    cell.bench.open(99);
    assert_eq!(cell.seen().tool, None);
    cell.bench.load(1, &path);
    cell.ticks(5);
    let hands = Command::HandFrame(WireHandFrame { time_ms: 0, left: None, right: None });
    let arm = Command::ArcArm { armed: true };
    for command in [arm.clone(), Command::Start { path: 1 }, Command::SetJog(jog(&path[0].pose)), hands] {
        assert_eq!(cell.bench.command(command), Answer::Refused(Refusal::NoTool));
    }
    assert_eq!(cell.set_tool(WirePose::IDENTITY), Answer::Done);
    assert_eq!(cell.bench.command(arm), Answer::Done);
    cell.ticks(5);
    assert_eq!(cell.start(), Answer::Done);
}

#[test]
fn a_tool_that_is_none_is_refused_for_what_it_is() {
    let mut cell = Cell::new(&WirePose::IDENTITY);
    let long = WirePose { position_um: [0, 0, 2_000_001], ..WirePose::IDENTITY };
    let no_rotation = WirePose { orientation_q15: [0; 4], ..WirePose::IDENTITY };
    assert_eq!(cell.set_tool(long), Answer::Refused(Refusal::Value(Field::Tool)));
    assert_eq!(cell.set_tool(no_rotation), Answer::Refused(Refusal::Value(Field::Orientation)));
    assert_eq!(cell.seen().tool, Some(WirePose::IDENTITY), "the old one holds");
    let longest = WirePose { position_um: [0, 0, 2_000_000], ..WirePose::IDENTITY };
    assert_eq!(cell.set_tool(longest), Answer::Done);
}

fn jog(start: &WirePose) -> WireJog {
    WireJog {
        start: *start,
        box_center_um: [0, 200_000, 0],
        box_size_um: [100_000; 3],
        steer_right: false,
        base_from_sensor_q15: WirePose::IDENTITY.orientation_q15,
    }
}

/// A hand anywhere in front of the sensor.
fn any_hand(random: &mut Random) -> Hand {
    hand([0; 3].map(|_: i32| random.below(400_000) as i32 - 200_000), 1000)
}

/// Anything that a host may say, at any time.
fn anything(cell: &Cell, path: &[WireWaypoint], clock_ms: u32, random: &mut Random) -> Command {
    let (seen, half) = (cell.seen(), 0.2_f64);
    let turned = [half.cos(), 0.0, half.sin(), 0.0].map(|c| (c * f64::from(Q15_ONE)).round() as i16);
    let orientation_q15 = if random.chance(0.5) { turned } else { WirePose::IDENTITY.orientation_q15 };
    let loaded = seen.load.map_or(0, |load| load.path);
    match random.below(16) {
        0..=2 => {
            let position_um = [0; 3].map(|_: i32| random.below(700_000) as i32 - 350_000);
            Command::SetTool { tool: WirePose { position_um, orientation_q15 } }
        }
        3 => Command::SetJog(jog(&seen.robot.map_or(path[0].pose, |robot| robot.pose))),
        4..=7 => Command::HandFrame(WireHandFrame {
            time_ms: clock_ms,
            left: Some(any_hand(random)),
            right: random.chance(0.3).then(|| any_hand(random)),
        }),
        8 => Command::ArcArm { armed: random.chance(0.7) },
        9 => Command::Start { path: loaded },
        10 => Command::Hold,
        11 => Command::Stop,
        12 => Command::Resume { path: loaded, changes: seen.changes, back_um: random.below(20_000) as u32 },
        13 => Command::Abort { path: loaded },
        14 => Command::Reset,
        _ => Command::Subscribe { every: 5 },
    }
}

/// `a_from_c` of `a_from_b` and `b_from_c`.
fn after(a_from_b: &WirePose, b_from_c: &WirePose) -> WirePose {
    let (first, second) = (a_from_b.to_pose().expect("a pose"), b_from_c.to_pose().expect("a pose"));
    let position_mm = first.position_mm + first.orientation * second.position_mm.coords;
    WirePose::from_pose(&TorchPose { position_mm, orientation: first.orientation * second.orientation })
        .expect("near enough")
}

fn inverse(pose: &WirePose) -> WirePose {
    let pose = pose.to_pose().expect("a pose");
    let orientation = pose.orientation.conjugate();
    let position_mm = (orientation * -pose.position_mm.coords).into();
    WirePose::from_pose(&TorchPose { position_mm, orientation }).expect("near enough")
}

/// Angle between two poses, mrad, by the quaternions' scalar product.
fn turned_mrad(a: &WirePose, b: &WirePose) -> f64 {
    let dot: f64 =
        a.orientation_q15.into_iter().zip(b.orientation_q15).map(|(a, b)| f64::from(a) * f64::from(b)).sum();
    let norm = |q: &WirePose| q.orientation_q15.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt();
    2e3 * (dot.abs() / norm(a) / norm(b)).min(1.0).acos()
}

/// What the wire's grid makes of a torch at the end of a tool of 600 mm: um and mrad.
const GRAIN: (f32, f64) = (100.0, 1.0);

#[test]
fn whatever_a_host_says_in_whatever_state_no_set_point_jumps_while_motion_is_enabled() {
    let path = line(120, 50_000);
    let limits = config();
    let tick_s = limits.tick_us as f32 * 1e-6;
    // The documented step of a tick, of a path or by hands: um and mrad.
    let most = (
        limits.max_feed_um_s.max(limits.jog.speed_um_s) as f32 * tick_s,
        f64::from(limits.max_turn_mrad_s.max(limits.jog.turn_mrad_s) as f32 * tick_s),
    );
    let (mut states, mut jogged, mut tools) = (std::collections::BTreeMap::new(), 0, [0; 2]);
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let mut cell = Cell::loaded(&path, &path[0].pose);
        let mut before: Option<(WirePose, WirePose)> = None;
        for k in 0..1_500_u32 {
            if random.chance(0.01) {
                cell.bench.panel.enable = !cell.bench.panel.enable;
            }
            if random.chance(0.003) {
                cell.bench.panel.manual = !cell.bench.panel.manual;
            }
            if random.chance(0.05) {
                // Wherever it stands, the robot may be brought to where a path begins.
                let seen = cell.seen();
                if seen.state == State::Ready {
                    cell.arm.put(&after(&path[0].pose, &inverse(&seen.tool.expect("it was set"))));
                }
                if seen.state == State::Idle && !cell.bench.panel.manual && cell.bench.panel.enable {
                    cell.path = cell.path.wrapping_add(1);
                    cell.bench.load(cell.path, &path);
                    before = None;
                }
            }
            if random.chance(0.2) {
                let command = anything(&cell, &path, 2 * k, &mut random);
                let is_tool = matches!(command, Command::SetTool { .. });
                let jogs = matches!(command, Command::HandFrame(_));
                let answer = cell.bench.command(command);
                tools[0] += usize::from(is_tool && answer == Answer::Done);
                tools[1] += usize::from(is_tool && answer != Answer::Done);
                jogged += usize::from(jogs && matches!(answer, Answer::Pose(_)));
            }
            let tick = cell.tick();
            let seen = cell.seen();
            *states.entry(format!("{:?}", seen.state)).or_insert(0) += 1;
            let tool = seen.tool.expect("it was set");
            let frame = tick.robot.expect("fitted");
            let torch = frame.pose.filter(|_| frame.motion).map(|flange| after(&flange, &tool));
            if let (Some((torch_before, tool_before)), Some(torch)) = (&before, &torch) {
                let step_um = torch_before.distance_um(torch);
                let turn_mrad = turned_mrad(torch_before, torch);
                assert_eq!(*tool_before, tool, "seed {seed}, tick {k}: another tool while motion is enabled");
                assert!(
                    step_um < most.0 + GRAIN.0 && turn_mrad < most.1 + GRAIN.1,
                    "seed {seed}, tick {k}: {step_um} um, {turn_mrad} mrad"
                );
            }
            before = torch.map(|torch| (torch, tool));
        }
    }
    println!("ticks in states {states:?}; {jogged} hand frames; tools taken and refused {tools:?}");
    assert!(states.len() >= 5 && states.values().all(|ticks| *ticks > 50), "{states:?}");
    assert!(jogged > 500 && tools[0] > 50 && tools[1] > 50, "{jogged} {tools:?}");
}

#[test]
fn a_tool_is_taken_neither_on_the_way_nor_where_a_path_waits_to_go_on() {
    let mut cell = Cell::welding();
    let other = WirePose { position_um: [0, 0, 100_000], ..WirePose::IDENTITY };
    assert_eq!(cell.set_tool(other), Answer::Refused(Refusal::Moving));
    assert_eq!(cell.bench.command(Command::Hold), Answer::Done);
    assert_eq!(cell.set_tool(other), Answer::Refused(Refusal::Moving));
    cell.ticks(300);
    assert_eq!(cell.seen().state, State::Held);
    assert_eq!(cell.set_tool(other), Answer::Refused(Refusal::State(State::Held)));
    assert_eq!(cell.seen().tool, Some(WirePose::IDENTITY));
    // Whoever goes on with the path has its tool.
    let seen = cell.seen();
    let former = weldpath_tests::bench::NONCE;
    cell.bench.panel.enable = false;
    for _ in 0..200 {
        let _ = cell.bench.tick();
    }
    let digest = weldpath_core::wire::path_digest(&line(300, 50_000)).expect("short");
    let answer = cell.bench.attach(5, former, seen.load.expect("loaded").path, digest);
    assert!(matches!(answer, weldpath_core::wire::PendantMessage::HelloAck(_)), "{answer:?}");
    assert_eq!(cell.seen().tool, Some(WirePose::IDENTITY));
}
