//! The robot port in virtual time: an arm that follows, one that is late, off, stopped or lost, and a line that loses frames.

use weldpath_core::interlock::{Cause, State};
use weldpath_core::path::TorchPose;
use weldpath_core::pendant::{Config, PortConfig, SetPoint, Tick};
use weldpath_core::wire::frame::{Received, decode, encode};
use weldpath_core::wire::port::{Actual, ActualDeframer, Drives, MAX_SET_POINT_FRAME};
use weldpath_core::wire::{
    Answer, Command, Field, Hand, Q15_ONE, Refusal, Telemetry, WireHandFrame, WireJog, WirePose, WireWaypoint,
};
use weldpath_tests::adversary::{Faults, Line, Random};
use weldpath_tests::arm::{Arm, Limits};
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
