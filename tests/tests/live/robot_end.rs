//! The robot port attacked by `tests/robot_end.py`, which was written from docs/robot-port.md alone by somebody who had not
//! seen the code: answers that are old, of another session, damaged or none; a robot that stops, freezes, lags or is
//! elsewhere; before a start, under the arc and under hands. With the real firmware, in QEMU.

use std::io::{BufRead, BufReader, Lines, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command as Process, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use weldpath_core::interlock::{Cause, State};
use weldpath_core::wire::{
    Answer, Begin, Command, Hand, ProcessTimes, Refusal, Telemetry, WireHandFrame, WireJog, WirePose,
    WireWaypoint,
};
use weldpath_tests::qemu::operator::{RELEASED, acknowledge, begin, grip};
use weldpath_tests::qemu::{Client, Machine, Panel, Wire, firmware};

const FIRST: WirePose = WirePose { position_um: [400_000, 0, 200_000], ..WirePose::IDENTITY };

/// The robot's end in its process; ended with the test.
struct RobotEnd {
    child: Child,
    orders: ChildStdin,
    said: Lines<BufReader<ChildStdout>>,
}

impl RobotEnd {
    fn start(socket: &Path, options: &[&str]) -> Self {
        let mut child = Process::new("python3")
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/robot_end.py"))
            .arg(socket)
            .arg("400000,0,200000")
            .args(["--seed", "7"])
            .args(options)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python3");
        let orders = child.stdin.take().expect("piped");
        let said = BufReader::new(child.stdout.take().expect("piped")).lines();
        Self { child, orders, said }
    }

    fn say(&mut self, order: &str) {
        writeln!(self.orders, "{order}").expect("listens");
    }

    fn report(&mut self) -> Value {
        self.say("report");
        let line = self.said.next().expect("a report").expect("text");
        serde_json::from_str(&line).expect("JSON")
    }
}

impl Drop for RobotEnd {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The pendant, its host and operator, and the robot's end.
struct Cell {
    client: Client,
    panel: Panel,
    end: RobotEnd,
    path: u16,
    _machine: Machine,
}

impl Cell {
    fn boot(program: &Path, nonce: u32, options: &[&str]) -> Self {
        let (machine, panel, socket) = Machine::boot_with_port(program, Wire::Socket).expect("boots");
        let mut client = Client::new(machine.open_link().expect("opens"));
        client.connect(nonce).expect("a session");
        let end = RobotEnd::start(&socket, options);
        let mut cell = Self { client, panel, end, path: 0, _machine: machine };
        acknowledge(&mut cell.client, &cell.panel, RELEASED).expect("no fault");
        assert_eq!(cell.ask(Command::SetTool { tool: WirePose::IDENTITY }), Answer::Done);
        cell.client.wait_for_state(|state| state.robot.is_some()).expect("the robot is heard");
        cell
    }

    fn ask(&mut self, command: Command) -> Answer {
        self.client.ask(command).expect("asked")
    }

    fn run(&mut self, ms: u64) {
        self.client.run_for(Duration::from_millis(ms), true).expect("runs");
    }

    fn grip(&mut self) {
        grip(&mut self.client, &self.panel).expect("gripped");
    }

    /// A weld of 100 mm at 4 mm/s: an answer that is late by all that the emulated board allows is 2 mm behind.
    fn load(&mut self) {
        let at = |k: i32| {
            let position_um = [400_000 + k * 1_000, 0, 200_000];
            let pose = WirePose { position_um, ..FIRST };
            WireWaypoint { pose, feed_um_s: 4_000, weld: (1..99).contains(&k) }
        };
        let path: Vec<_> = (0..100).map(at).collect();
        self.path += 1;
        let times = ProcessTimes { pre_flow_ms: 0, ..ProcessTimes::default() };
        let begin = Begin { times, ..begin(self.path, &path) };
        self.client.load(begin, &path).expect("loads");
        self.grip();
    }

    fn start(&mut self) -> Answer {
        self.ask(Command::ArcArm { armed: true });
        self.ask(Command::Start { path: self.path })
    }

    /// All well again, the robot where the set-points are, and on.
    fn resume(&mut self) {
        for _ in 0..20 {
            self.end.say("good");
            let held = self.client.wait_for_state(|state| state.state == State::Held).expect("holds");
            let [x, y, z] = held.pose.position_um;
            self.end.say(&format!("put {x},{y},{z}"));
            self.grip();
            self.client.wait_for_state(|state| state.robot.is_some()).expect("heard");
            self.run(100);
            self.ask(Command::ArcArm { armed: true });
            let changes = self.client.telemetry.expect("a state").changes;
            if self.ask(Command::Resume { path: self.path, changes, back_um: 0 }) == Answer::Done {
                return;
            }
        }
        panic!("it does not go on: {:?}", self.client.telemetry);
    }
}

/// What a robot's end may say in place of what is true.
const LIES: [&str; 15] = [
    "mute",
    "old-session",
    "future",
    "stale",
    "frozen-sequence 9",
    "version 1",
    "drives 7",
    "nan-like",
    "far",
    "bad-crc",
    "garbage",
    "truncated",
    "flip",
    "huge",
    "zeros",
];
/// The emulated board allows an answer 500 ms, and more.
const LATE_MS: u64 = 700;

#[test]
fn no_answer_that_is_old_damaged_or_of_another_session_lets_a_path_start() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let recorded = folder.path().join("recorded");
    let recorded = recorded.to_str().expect("text");
    // What was answered in another session and boot, in which a path was started.
    let mut earlier = Cell::boot(&program, 0x51, &["--record", recorded]);
    earlier.load();
    assert_eq!(earlier.start(), Answer::Done);
    earlier.run(500);
    drop(earlier);
    let mut cell = Cell::boot(&program, 0x52, &["--replay", recorded]);
    cell.load();
    for lie in LIES.into_iter().chain(["replay"]) {
        cell.end.say(lie);
        // Until the last true answer is late; then for longer than one that is believed would count.
        cell.client.wait_for_state(|state| state.robot.is_none()).expect("the truth grows old");
        let end = Instant::now() + Duration::from_millis(LATE_MS);
        while Instant::now() < end {
            cell.run(20);
            assert_eq!(cell.client.telemetry.expect("a state").robot, None, "{lie} is believed");
        }
        assert_eq!(cell.start(), Answer::Refused(Refusal::Robot), "after {lie}");
        cell.end.say("good");
        cell.client.wait_for_state(|state| state.robot.is_some()).expect("heard again");
    }
    // Somebody else speaks beside the robot's end, with another nonce and from elsewhere; and every answer comes twice.
    for beside in ["other-robot", "doubled"] {
        cell.end.say(beside);
        cell.run(LATE_MS);
        let robot = cell.client.wait_for_state(|state| state.robot.is_some()).expect("heard").robot;
        assert!(robot.is_some_and(|robot| robot.pose.distance_um(&FIRST) < 100.0), "{beside}: {robot:?}");
        cell.end.say("good");
    }
    let report = cell.end.report();
    println!("{report}");
    for none in ["motion", "arc", "jumps", "altered"] {
        assert_eq!(report[none], 0, "{none}: {report}");
    }
    assert_eq!(cell.start(), Answer::Done, "and the true answers do");
}

#[test]
fn a_robot_that_fails_under_the_arc_is_held_with_the_cause_and_no_set_point_jumps() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let mut cell = Cell::boot(&program, 0x53, &[]);
    cell.load();
    assert_eq!(cell.start(), Answer::Done);
    let trouble = [
        ("stop", Cause::RobotDrives),
        ("off", Cause::RobotDrives),
        ("freeze", Cause::RobotOff),
        ("aside 2600", Cause::RobotOff),
        ("aside 9900", Cause::RobotOff),
        ("aside 12000", Cause::RobotOff),
        ("mute", Cause::RobotSilent),
        ("late 60", Cause::RobotSilent),
        ("old-session", Cause::RobotSilent),
        ("bad-crc", Cause::RobotSilent),
        ("nonce", Cause::RobotSilent),
    ];
    for (order, cause) in trouble {
        // On a busy machine a host or a robot may be silent by themselves: then once more.
        for attempt in 0.. {
            assert!(attempt < 5, "{order}");
            let burning = |state: &Telemetry| state.pins & Telemetry::ARC != 0;
            let seen = cell.client.wait_for_state(|s| burning(s) || s.state == State::Held).expect("goes on");
            if burning(&seen) {
                cell.run(150);
                cell.end.say(order);
            }
            let begun = Instant::now();
            let held = cell.client.wait_for_state(|s| s.state == State::Held).expect("holds");
            let busy = |cause: Option<Cause>| {
                matches!(cause, Some(Cause::Silence | Cause::RobotSilent | Cause::ArcLost))
            };
            let (came, took) = (held.cause, begun.elapsed());
            cell.resume();
            if came == Some(cause) {
                println!("{order}: {cause:?} after {} ms", took.as_millis());
                break;
            }
            assert!(busy(came), "{order}: {came:?}, not {cause:?}");
        }
    }
    let report = cell.end.report();
    println!("{report}");
    assert!(report["frames"].as_u64() > Some(5_000), "{report}");
    for none in ["jumps", "altered"] {
        assert_eq!(report[none], 0, "{none}: {report}");
    }
}

#[test]
fn a_robot_that_fails_under_hands_is_taken_out_of_them_until_a_new_grip() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let mut cell = Cell::boot(&program, 0x54, &[]);
    cell.panel.manual(true).expect("turned");
    let trouble = [
        ("stop", Cause::RobotDrives),
        ("freeze", Cause::RobotOff),
        ("aside 12000", Cause::RobotOff),
        ("mute", Cause::RobotSilent),
    ];
    for (order, cause) in trouble {
        cell.end.say("good");
        cell.end.say("put 400000,0,200000");
        cell.run(200);
        cell.grip();
        cell.client.wait_for_state(|state| state.robot.is_some()).expect("heard");
        assert_eq!(cell.ask(Command::SetJog(jog())), Answer::Done, "before {order}");
        let (guided, last) = guide(&mut cell, 400);
        let moved_um = last.robot.map_or(0.0, |robot| robot.pose.distance_um(&FIRST));
        let moves = last.pins & Telemetry::MOTION != 0 && moved_um > 2_000.0;
        assert!(moves, "{order}: {moved_um} um by {guided} frames, {last:?}");
        cell.end.say(order);
        let (_, last) = guide(&mut cell, 900);
        assert_eq!((last.state, last.cause), (State::Disabled, Some(cause)), "after {order}");
        assert_eq!(last.pins & Telemetry::MOTION, 0, "after {order}");
    }
    let report = cell.end.report();
    println!("{report}");
    for none in ["jumps", "altered", "arc"] {
        assert_eq!(report[none], 0, "{none}: {report}");
    }
    assert!(report["ahead_mm"].as_f64() < Some(12.0), "{report}");
}

fn jog() -> WireJog {
    WireJog {
        start: FIRST,
        box_center_um: [0, 200_000, 0],
        box_size_um: [100_000; 3],
        steer_right: false,
        base_from_sensor_q15: WirePose::IDENTITY.orientation_q15,
    }
}

/// Hands push the camera upward for so long; frames that were taken, and the last state.
fn guide(cell: &mut Cell, ms: u64) -> (usize, Telemetry) {
    let (begun, mut taken) = (Instant::now(), 0);
    while begun.elapsed() < Duration::from_millis(ms) {
        let left = Hand {
            palm_um: [150_000, 200_000, 0],
            direction_q15: [0, 0, -32_767],
            normal_q15: [0, -32_767, 0],
            grab_permille: 0,
            pinch_permille: 0,
            confidence_permille: 1000,
            extended: 0b1_1111,
        };
        let time_ms = begun.elapsed().as_millis() as u32;
        let hands = WireHandFrame { time_ms, left: Some(left), right: None };
        taken += usize::from(matches!(cell.ask(Command::HandFrame(hands)), Answer::Pose(_)));
        cell.run(10);
    }
    (taken, cell.client.wait_for_state(|_| true).expect("a state"))
}
