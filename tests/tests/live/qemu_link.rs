//! The real firmware on an emulated serial line: a path under noise, a host that dies, resets, strangers, and answers.

use std::io;
use std::time::{Duration, Instant};

use nalgebra::{Point3, UnitQuaternion};
use weldpath::pendant::link::program::upload;
use weldpath::pendant::teleop::{self, Twin};
use weldpath::weld::program;
use weldpath::weld::program::Kind;
use weldpath_core::interlock::{Cause, Fault, State};
use weldpath_core::pendant::{Config, JOG_LIMITS, set_point};
use weldpath_core::sender::Notice;
use weldpath_core::wire::{
    self, Answer, Begin, Command, FromHost, Hand, Hello, HelloRefusal, HostMessage, Offset, Q15_ONE, Sample,
    Telemetry, WireHandFrame, WireJog, WirePatch, WirePose, WireWaypoint, frame,
};
use weldpath_tests::adversary::Random;
use weldpath_tests::qemu::operator::{GRIPPED, RELEASED, acknowledge, begin, grip};
use weldpath_tests::qemu::{Broken, Client, Machine, PATIENCE, Panel, Seen, Wire, firmware};

fn connected(wire: Wire, damage: f64) -> Option<(Machine, Panel, Client)> {
    let program = firmware("weldpath-firmware")?;
    let (machine, panel) = Machine::boot(&program, wire).expect("boots");
    let mut client = Client::new(machine.open_link().expect("opens"));
    client.damage(damage);
    client.connect(0x1234).expect("a session");
    Some((machine, panel, client))
}

/// Part of a circle, the torch turning with it: 2 mm steps at 50 mm/s, welded from the fifth to the fifth last.
fn curve(total: usize) -> Vec<WireWaypoint> {
    let waypoint = |k: usize| {
        let angle = k as f64 * 0.02;
        let position_um =
            [500e3 + 100e3 * angle.cos(), 100e3 * angle.sin(), 200e3].map(|um| um.round() as i32);
        let half = 0.5 * angle;
        let q15 = [half.cos(), 0.0, 0.0, half.sin()].map(|c| (c * f64::from(Q15_ONE)).round() as i16);
        let pose = WirePose { position_um, orientation_q15: q15 };
        WireWaypoint { pose, feed_um_s: 50_000, weld: (5..total - 5).contains(&k) }
    };
    (0..total).map(waypoint).collect()
}

/// Loads the path, grips the enabling switch, arms and starts.
fn start(client: &mut Client, panel: &Panel, path: &[WireWaypoint]) -> io::Result<()> {
    start_announced(client, panel, begin(7, path), path)
}

fn start_announced(
    client: &mut Client,
    panel: &Panel,
    begin: Begin,
    path: &[WireWaypoint],
) -> io::Result<()> {
    acknowledge(client, panel, RELEASED)?;
    client.load(begin, path)?;
    grip(client, panel)?;
    panel.confirm()?;
    client.wait_for_state(|state| state.pins & Telemetry::POSE_KNOWN != 0)?;
    assert_eq!(client.ask(Command::Subscribe { every: 5 })?, Answer::Done);
    assert_eq!(client.ask(Command::ArcArm { armed: true })?, Answer::Done);
    assert_eq!(client.ask(Command::Start { path: 7 })?, Answer::Done);
    Ok(())
}

fn assert_on_path(samples: &[Sample], path: &[WireWaypoint]) {
    for sample in samples {
        let segment = sample.segment as usize;
        let to = path.get(segment + 1).unwrap_or(&path[segment]);
        let planned = set_point(&path[segment].pose, &to.pose, sample.alpha_q24);
        assert_eq!(Some(sample.pose), planned, "equal integers at {sample:?}");
    }
}

#[test]
fn a_path_under_noise_is_loaded_started_held_resumed_and_finished_as_planned() {
    let Some((_machine, panel, mut client)) = connected(Wire::Pty, 1e-3) else { return };
    let path = curve(100);
    start(&mut client, &panel, &path).unwrap();
    client.wait_for_state(|state| state.segment >= 20).unwrap();
    panel.wait_for(|seen| matches!(seen, Seen::Outputs { arc: true, motion: true, .. })).unwrap();
    assert_eq!(client.ask(Command::Hold).unwrap(), Answer::Done);
    let held = client.wait_for_state(|state| state.state == State::Held).unwrap();
    assert_eq!((held.cause, held.speed_um_s), (Some(Cause::Hold), 0));
    panel.wait_for(|seen| matches!(seen, Seen::Outputs { arc: false, motion: false, .. })).unwrap();
    resume(&mut client, &panel, 3_000);
    finish(&mut client, &panel);
    let Telemetry { counters, pose, .. } = client.telemetry.unwrap();
    println!("{} samples; pendant counted {counters:?}", client.samples.len());
    assert!(client.samples.len() > 100);
    // Samples may be lost, the last ones too; the state that says finished has the last pose.
    assert_eq!(Some(pose), set_point(&path[98].pose, &path[99].pose, 1 << 24));
    assert_on_path(&client.samples, &path);
    panel.send(b'?').unwrap();
    let stack = panel.wait_for(|seen| matches!(seen, Seen::Stack(_))).unwrap();
    assert!(matches!(stack, Seen::Stack(1..=4096)), "{stack:?}");
}

/// A zigzag weave that stands for 0.3 s on its sides.
fn weave() -> Vec<program::Waypoint> {
    let at = |k: u32| program::Waypoint {
        position_mm: Point3::new(
            400.0 + 2.0 * f64::from(k),
            if k.is_multiple_of(2) { -3.0 } else { 3.0 },
            100.0,
        ),
        base_from_torch: UnitQuaternion::identity(),
        feed_mm_s: 20.0,
        weld: (1..11).contains(&k),
        seam: Some(1),
        kind: Kind::Weld,
        dwell_s: (2..10).contains(&k).then_some(0.3),
    };
    (0..12).map(at).collect()
}

#[test]
fn a_weave_with_dwell_stands_on_the_planned_integers_for_as_long_as_it_says() {
    let Some((_machine, panel, mut client)) = connected(Wire::Pty, 0.0) else { return };
    let limits = Config::default().limits(512);
    let upload = upload(&weave(), &limits).unwrap();
    let path = &upload.waypoints;
    start_announced(&mut client, &panel, upload.begin(7, &limits), path).unwrap();
    finish(&mut client, &panel);
    assert_on_path(&client.samples, path);
    let slow: Vec<u32> = (0..path.len() as u32).filter(|k| path[*k as usize].feed_um_s < 1_000).collect();
    assert_eq!(slow.len(), 8);
    let mut stood = 0;
    for segment in slow {
        let on_it = || client.samples.iter().filter(|sample| sample.segment == segment);
        let ticks = on_it().map(|sample| sample.tick);
        let span = ticks.clone().max().zip(ticks.min()).map_or(0, |(last, first)| last.wrapping_sub(first));
        // Samples may be lost, and a hold takes its time.
        stood += u32::from(span >= 120 && on_it().any(|sample| sample.arc));
    }
    assert!(stood >= 4, "it was seen to stand at {stood} of 8 places");
}

/// Until path 7 is finished, resumed where the pendant held by itself.
fn finish(client: &mut Client, panel: &Panel) {
    let begun = Instant::now();
    loop {
        assert!(begun.elapsed() < PATIENCE, "{:?}", client.telemetry);
        let state =
            client.wait_for_state(|state| state.finished == Some(7) || state.state == State::Held).unwrap();
        if state.finished == Some(7) {
            return;
        }
        // On a busy machine this host may itself be silent for too long.
        assert_eq!(state.cause, Some(Cause::Silence));
        resume(client, panel, 0);
    }
}

fn resume(client: &mut Client, panel: &Panel, back_um: u32) {
    grip(client, panel).unwrap();
    let held = client.wait_for_state(|state| state.state == State::Held).unwrap();
    assert_eq!(client.ask(Command::ArcArm { armed: true }).unwrap(), Answer::Done);
    let resume = Command::Resume { path: 7, changes: held.changes, back_um };
    assert_eq!(client.ask(resume).unwrap(), Answer::Done);
    client.wait_for_state(|state| state.changes != held.changes).unwrap();
}

#[test]
fn a_host_that_dies_mid_path_leaves_the_arc_off_within_200_ms_and_a_tick() {
    let Some((_machine, panel, mut client)) = connected(Wire::Socket, 0.0) else { return };
    start(&mut client, &panel, &curve(200)).unwrap();
    let before = client.wait_for_state(|state| state.segment >= 20).unwrap();
    panel.wait_for(|seen| matches!(seen, Seen::Outputs { arc: true, motion: true, .. })).unwrap();
    // From here on the host only listens. What it sent last was heard at the latest when the next state was told.
    let silent = Instant::now();
    let heard_by = loop {
        assert!(silent.elapsed() < PATIENCE, "no state after tick {}", before.tick);
        client.run_for(Duration::from_millis(5), false).unwrap();
        let now: Telemetry = client.telemetry.unwrap();
        if now.tick > before.tick {
            break now.tick;
        }
    };
    let Seen::Outputs { tick: off, .. } = panel
        .wait_for(|seen| matches!(seen, Seen::Outputs { arc: false, tick, .. } if *tick > before.tick))
        .unwrap()
    else {
        unreachable!("only outputs were asked for")
    };
    assert!(off.saturating_sub(heard_by) <= 101, "arc off at {off}, last byte at {heard_by} or before");
    client.run_for(Duration::from_millis(1000), false).unwrap();
    let held = client.telemetry.unwrap();
    assert_eq!((held.state, held.cause, held.speed_um_s), (State::Held, Some(Cause::Silence), 0));
}

#[test]
fn after_a_reset_mid_path_nothing_moves_until_a_new_session() {
    let Some((mut machine, panel, mut client)) = connected(Wire::Socket, 0.0) else { return };
    start(&mut client, &panel, &curve(200)).unwrap();
    client.wait_for_state(|state| state.segment >= 20).unwrap();
    panel.wait_for(|seen| matches!(seen, Seen::Outputs { arc: true, motion: true, .. })).unwrap();
    machine.tell("system_reset").unwrap();
    panel.wait_for(|seen| *seen == Seen::AllOff).unwrap();
    panel.set(GRIPPED).unwrap();
    client
        .wait_for("the loss", |_, notice| matches!(notice, Notice::SessionLost { .. }).then_some(()))
        .unwrap();
    client.run_for(Duration::from_millis(300), true).unwrap();
    let boot = client.connect(0x5678).unwrap();
    acknowledge(&mut client, &panel, GRIPPED).unwrap();
    let state = client.wait_for_state(|state| state.load.is_none()).unwrap();
    assert!(matches!(state.state, State::Disabled | State::Idle), "{state:?}");
    assert_ne!(boot, 0);
    let seen_motion = panel.wait_for_within(Duration::from_millis(200), |seen| {
        matches!(seen, Seen::Outputs { motion: true, .. } | Seen::Outputs { arc: true, .. })
    });
    assert!(seen_motion.is_err(), "{seen_motion:?}");
}

#[test]
fn a_second_host_is_refused_while_the_first_is_alive_and_a_wrong_version_by_both_numbers() {
    let Some((_machine, _panel, mut client)) = connected(Wire::Socket, 0.0) else { return };
    let mut hello = |version, nonce| {
        let hello = Hello { version, schema: wire::SCHEMA, nonce };
        let mut bytes = [0; 64];
        let message = FromHost { session: 0, message: HostMessage::Hello(hello) };
        let length = frame::encode(&message, &mut bytes).unwrap();
        client.write(&mut bytes[..length]).unwrap();
        client.wait_for_refusal(nonce).unwrap()
    };
    assert_eq!(hello(wire::VERSION, 0x9999), HelloRefusal::Busy);
    let version = HelloRefusal::Version { host: 99, pendant: wire::VERSION };
    assert_eq!(hello(99, 0xaaaa), version);
    assert_eq!(client.ask(Command::ArcArm { armed: false }).unwrap(), Answer::Done, "the first host goes on");
}

/// The same integers from pendant and host, for every command.
fn assert_agree(client: &mut Client, commands: impl Iterator<Item = Command>) -> u32 {
    let mut twin = Twin::default();
    let mut count = 0;
    for command in commands {
        let answer = client.ask(command.clone()).unwrap();
        let expected = match (&command, &answer) {
            (Command::SetJog(jog), _) => {
                twin = Twin::new(jog, &JOG_LIMITS);
                Answer::Done
            }
            // By the pendant's own clock, which its answer tells.
            (Command::HandFrame(hands), Answer::Pose(pose)) => twin.answer(hands, pose.time_ms),
            (Command::Score(patch), _) => twin.score(patch),
            (other, answer) => panic!("{other:?}: {answer:?}"),
        };
        assert_eq!(answer, expected);
        count += 1;
    }
    count
}

#[test]
fn gestures_make_the_same_camera_poses_on_pendant_and_host() {
    let Some((_machine, panel, mut client)) = connected(Wire::Socket, 0.0) else { return };
    acknowledge(&mut client, &panel, RELEASED).unwrap();
    panel.manual(true).unwrap();
    grip(&mut client, &panel).unwrap();
    let mut random = Random::new(3);
    let start = WirePose { position_um: [400_000, 0, 300_000], orientation_q15: [0, Q15_ONE, 0, 0] };
    let jog = WireJog {
        start,
        box_center_um: [0, 200_000, 0],
        box_size_um: [100_000; 3],
        steer_right: false,
        base_from_sensor_q15: teleop::BASE_FROM_SENSOR_Q15,
    };
    let mut palm = [0.0, 200.0, 0.0];
    let frames = (0..300).map(|k: u32| {
        palm = palm.map(|mm: f64| mm + 20.0 * (random.unit() - 0.5));
        let unit = |x: f64, y: f64, z: f64| {
            [x, y, z].map(|c| (c / x.hypot(y).hypot(z) * f64::from(Q15_ONE)).round() as i16)
        };
        let tilt = (f64::from(k) * 0.05).sin();
        let hand = Hand {
            palm_um: palm.map(|mm| (mm * 1000.0) as i32),
            direction_q15: unit(0.3 * tilt, 0.2, -1.0),
            normal_q15: unit(0.1, -1.0, tilt),
            grab_permille: if k % 50 > 45 { 900 } else { 0 },
            pinch_permille: if k % 40 > 20 { 900 } else { 0 },
            confidence_permille: 1000,
            extended: 31,
        };
        let left = (k % 60 != 59).then_some(hand);
        Command::HandFrame(WireHandFrame { time_ms: k * 9, left, right: Some(hand) })
    });
    assert_eq!(assert_agree(&mut client, std::iter::once(Command::SetJog(jog)).chain(frames)), 301);
}

#[test]
fn edge_scores_are_the_same_on_pendant_and_host() {
    let Some((_machine, panel, mut client)) = connected(Wire::Socket, 0.0) else { return };
    let mut random = Random::new(5);
    let patches = (0..40).map(|k| {
        let bend = f64::from(k % 4) * 0.5;
        let mut point = || {
            let (x, y) = (random.unit() * 10.0 - 5.0, random.unit() * 10.0 - 5.0);
            let z = bend * x.abs() + 0.2 * (random.unit() - 0.5);
            Offset { um: [x, y, z].map(|mm| (mm * 1000.0) as i16) }
        };
        let points = std::iter::once(Offset { um: [0; 3] }).chain((0..63).map(|_| point())).collect();
        Command::Score(WirePatch { radius_um: 2_000 + 100 * k as u32, threshold_milli: 53_000, points })
    });
    assert_eq!(assert_agree(&mut client, patches), 40);
    panel.send(b'?').unwrap();
    let stack = panel.wait_for(|seen| matches!(seen, Seen::Stack(_))).unwrap();
    assert!(matches!(stack, Seen::Stack(1..=4096)), "{stack:?}");
}

#[test]
fn a_hung_tick_drops_the_arc_by_its_charge_pump_within_10_ms() {
    // On a busy host the emulator's clock goes on while it has no processor: the least of some tries is the pump's own time.
    let mut least_us = u32::MAX;
    for _ in 0..5 {
        let Some((_machine, panel, mut client)) = connected(Wire::Socket, 0.0) else { return };
        start(&mut client, &panel, &curve(200)).unwrap();
        let on = |state: &Telemetry| state.pins & Telemetry::ARC != 0;
        let state = client.wait_for_state(|state| on(state) || state.state == State::Held).unwrap();
        if !on(&state) {
            // This host was silent for too long before the arc burned.
            continue;
        }
        panel.send(b'$').unwrap();
        let dropped = panel.wait_for(|seen| matches!(seen, Seen::PumpsDropped { .. })).unwrap();
        let Seen::PumpsDropped { after_us } = dropped else { unreachable!("only that was asked for") };
        least_us = least_us.min(after_us);
        if least_us <= 10_000 {
            break;
        }
    }
    assert!((6_000..=10_000).contains(&least_us), "{least_us} us");
}

#[test]
fn contacts_that_contradict_each_other_and_outputs_that_do_not_follow_are_faults() {
    for (what, fault) in [
        (Broken::EStop, Fault::EStop),
        (Broken::Enable, Fault::Channels),
        (Broken::Readback, Fault::Readback),
    ] {
        let Some((_machine, panel, mut client)) = connected(Wire::Socket, 0.0) else { return };
        acknowledge(&mut client, &panel, RELEASED).unwrap();
        grip(&mut client, &panel).unwrap();
        panel.break_contact(what, true).unwrap();
        client.wait_for_state(|state| state.fault == Some(fault)).unwrap();
    }
}
