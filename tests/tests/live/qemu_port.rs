//! The real firmware with a robot port: set-points to an arm model in a process of its own, and back what it does.
//!
//! The emulated board allows its robot 250 ticks, as the emulator's clock runs on while this machine is busy; three are held
//! in virtual time (`link_port.rs`).

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command as Process, Stdio};

use weldpath_core::interlock::{Cause, State};
use weldpath_core::wire::{Answer, Command, Refusal, Telemetry, WirePose, WireWaypoint};
use weldpath_tests::qemu::operator::{GRIPPED, RELEASED, acknowledge, begin};
use weldpath_tests::qemu::{Client, Machine, Panel, Wire, firmware};

/// The arm's process; ended with the test.
struct Arm(Child);

impl Arm {
    fn start(socket: &Path, x_um: i32) -> Self {
        let child = Process::new(env!("CARGO_BIN_EXE_arm"))
            .arg(socket)
            .arg(format!("{x_um},0,200000"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("starts");
        Self(child)
    }

    fn say(&mut self, order: &str) {
        writeln!(self.0.stdin.as_mut().expect("piped"), "{order}").expect("listens");
    }

    /// What it saw, once the emulator has gone.
    fn end(mut self) -> String {
        let mut said = String::new();
        self.0.stdout.take().expect("piped").read_to_string(&mut said).expect("text");
        said
    }
}

impl Drop for Arm {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Steps of 1 mm at 4 mm/s: an answer that is late by all that the emulated board allows is 2 mm behind, and the robot
/// not off by what a weld allows.
fn line(total: i32) -> Vec<WireWaypoint> {
    let at = |k: i32| {
        let position_um = [400_000 + k * 1_000, 0, 200_000];
        WireWaypoint {
            pose: WirePose { position_um, ..WirePose::IDENTITY },
            feed_um_s: 4_000,
            weld: (2..total - 2).contains(&k),
        }
    };
    (0..total).map(at).collect()
}

fn load(client: &mut Client, panel: &Panel, path: &[WireWaypoint]) {
    acknowledge(client, panel, RELEASED).expect("no fault");
    client.load(begin(1, path), path).expect("loads");
    let tool = WirePose::IDENTITY;
    assert_eq!(client.ask(Command::SetTool { tool }).expect("asked"), Answer::Done);
    panel.set(GRIPPED).expect("gripped");
    client.wait_for_state(|state| state.pins & Telemetry::ENABLED != 0).expect("enabled");
}

fn start(client: &mut Client) -> Answer {
    assert_eq!(client.ask(Command::ArcArm { armed: true }).expect("asked"), Answer::Done);
    client.ask(Command::Start { path: 1 }).expect("asked")
}

#[test]
fn an_arm_of_its_own_process_follows_the_weld_and_a_silent_one_starts_nothing() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let (machine, panel, socket) = Machine::boot_with_port(&program, Wire::Socket).expect("boots");
    let mut client = Client::new(machine.open_link().expect("opens"));
    client.connect(0x77).expect("a session");
    let arm = Command::ArcArm { armed: true };
    assert_eq!(client.ask(arm).expect("asked"), Answer::Refused(Refusal::NoTool), "the flange is no torch");
    let path = line(60);
    load(&mut client, &panel, &path);
    assert_eq!(start(&mut client), Answer::Refused(Refusal::Robot), "fitted, and nobody there");
    let arm = Arm::start(&socket, 400_000);
    client.wait_for_state(|state| state.robot.is_some()).expect("the arm is heard");
    assert_eq!(start(&mut client), Answer::Done);
    let mut resumed = 0;
    loop {
        let state = client.wait_for_state(|s| s.finished == Some(1) || s.state == State::Held).expect("ends");
        if state.finished == Some(1) {
            break;
        }
        // On a busy machine host or arm may be silent for too long: gripped anew, and on from there.
        assert!(
            matches!(state.cause, Some(Cause::Silence | Cause::RobotSilent | Cause::RobotOff)),
            "{state:?}"
        );
        resumed += 1;
        assert!(resumed < 20, "{state:?}");
        panel.set(RELEASED).expect("released");
        client.wait_for_state(|state| state.pins & Telemetry::ENABLE == 0).expect("released");
        panel.set(GRIPPED).expect("gripped");
        let held = client
            .wait_for_state(|s| s.pins & Telemetry::ENABLED != 0 && s.robot.is_some())
            .expect("enabled");
        assert_eq!(client.ask(Command::ArcArm { armed: true }).expect("asked"), Answer::Done);
        let resume = Command::Resume { path: 1, changes: held.changes, back_um: 0 };
        // What the arm says may be old, and it away from where it was to be by then: once more.
        if client.ask(resume).expect("asked") == Answer::Done {
            client.wait_for_state(|state| state.changes != held.changes).expect("goes on");
        }
    }
    // The arm follows with a lag, and what it says is on its way for as long as this machine is busy.
    let last = path.last().expect("some").pose;
    let arrived = |state: &Telemetry| state.robot.is_some_and(|robot| robot.pose.distance_um(&last) < 500.0);
    client.wait_for_state(arrived).expect("the arm settles at the end of the path");
    drop(machine);
    let said = arm.end();
    println!("{said}");
    let jump_mm: f64 = said.trim().rsplit(' ').next().and_then(|n| n.parse().ok()).expect("a figure");
    assert!(jump_mm <= 2.0, "{said}");
}

/// Why the weld holds after the arm was given this order in the midst of it.
fn cause_after(program: &Path, order: &str) -> Option<Cause> {
    let (machine, panel, socket) = Machine::boot_with_port(program, Wire::Socket).expect("boots");
    let mut client = Client::new(machine.open_link().expect("opens"));
    client.connect(0x78).expect("a session");
    let mut arm = Arm::start(&socket, 400_000);
    load(&mut client, &panel, &line(100));
    client.wait_for_state(|state| state.robot.is_some()).expect("the arm is heard");
    assert_eq!(start(&mut client), Answer::Done);
    client.wait_for_state(|state| state.segment >= 5 || state.state == State::Held).expect("moves");
    arm.say(order);
    client.wait_for_state(|state| state.state == State::Held).expect("holds").cause
}

#[test]
fn an_arm_that_stops_or_falls_silent_holds_the_weld_and_says_why() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    for (order, cause) in [("stop", Cause::RobotDrives), ("mute", Cause::RobotSilent)] {
        // On a busy machine host or arm may be silent by themselves: then once more.
        let busy = |seen: &Option<Cause>| {
            *seen != Some(cause) && matches!(seen, Some(Cause::Silence | Cause::RobotSilent))
        };
        let seen = (0..5).map(|_| cause_after(&program, order)).find(|seen| !busy(seen));
        assert_eq!(seen.flatten(), Some(cause), "after {order}");
    }
}
