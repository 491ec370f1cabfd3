//! The command against a pendant: loading, holding and resuming under damage, a host that dies, refusals, and scanning.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Output, Stdio};
use std::thread;
use std::time::Duration;

use nalgebra::{Point3, UnitQuaternion};
use weldpath::export::json;
use weldpath::link::{Error, Link};
use weldpath::serial::{self, Line};
use weldpath::simulation::{self, Format, Noise, Part, Pose, Request};
use weldpath::teleop::{self, Setup, generator, recording};
use weldpath::toolpath::program::{Kind, Waypoint};
use weldpath_core::interlock::State;
use weldpath_core::wire::frame::{self, Received};
use weldpath_core::wire::{
    self, FromHost, FromPendant, HelloRefusal, HelloRefused, HostDeframer, HostMessage, PendantMessage,
};
use weldpath_tests::command::weldpath;
use weldpath_tests::in_process::InProcess;
use weldpath_tests::shared_data;

/// A seam of 60 mm in steps of 1 mm, welded at 20 mm/s, with its approach and a long way home through the air.
fn program() -> Vec<Waypoint> {
    let at = |x: f64, z: f64, kind, feed_mm_s| Waypoint {
        dwell_s: None,
        position_mm: Point3::new(400.0 + x, 0.0, z),
        base_from_torch: UnitQuaternion::identity(),
        feed_mm_s,
        weld: kind == Kind::Weld,
        seam: (kind != Kind::Air).then_some(1),
        kind,
    };
    let mut program = vec![at(0.0, 50.0, Kind::Approach, 150.0), at(0.0, 0.0, Kind::Weld, 100.0)];
    program.extend((1..=60).map(|x| at(f64::from(x), 0.0, Kind::Weld, 20.0)));
    program.extend([at(60.0, 50.0, Kind::Retract, 100.0), at(-200.0, 50.0, Kind::Air, 200.0)]);
    program
}

fn stream(pendant: &InProcess, folder: &Path) -> Child {
    std::fs::write(folder.join("path.json"), json::write(&program())).unwrap();
    let arguments = ["stream", "--port", &pendant.port, "--back-mm", "2"];
    weldpath().args(arguments).arg(folder).stdin(Stdio::piped()).spawn().unwrap()
}

fn press(child: &mut Child, key: &[u8]) {
    child.stdin.as_mut().unwrap().write_all(key).unwrap();
}

fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Ready, then gripped: running.
fn grip(pendant: &InProcess) {
    pendant.wait_for("the load", |seen| seen.state == State::Ready);
    pendant.enable(true);
}

#[test]
fn a_program_is_loaded_held_resumed_and_finished_over_a_pty_that_damages_bytes() {
    let (pendant, folder) = (InProcess::on_pty(1e-3).unwrap(), tempfile::tempdir().unwrap());
    let mut host = stream(&pendant, folder.path());
    grip(&pendant);
    pendant.wait_for("the weld", |seen| seen.arc && seen.segment >= 20);
    press(&mut host, b"h");
    let held = pendant.wait_for("the hold", |seen| seen.state == State::Held);
    assert!(!held.arc);
    // The host has to have heard of it too.
    thread::sleep(Duration::from_millis(300));
    press(&mut host, b"r");
    pendant.wait_for("the arc again", |seen| seen.arc && seen.segment + 3 >= held.segment);
    let output = host.wait_with_output().unwrap();
    let said = text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    for part in ["loaded 6", "hold was asked for", "finished"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert!(pendant.seen().segment >= 62, "the way home is a part of it");
}

#[test]
fn a_host_that_is_killed_leaves_the_arc_off_within_the_silence_limit_and_the_torch_held() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let mut host = stream(&pendant, folder.path());
    grip(&pendant);
    pendant.wait_for("the weld", |seen| seen.arc && seen.segment >= 10);
    host.kill().unwrap();
    host.wait().unwrap();
    let held = pendant.wait_for("the hold", |seen| seen.state == State::Held);
    let silent = held.arc_off_tick - held.heard_tick;
    assert!((1..=101).contains(&silent), "200 ms and a tick of 2 ms: {held:?}");
}

#[test]
fn stop_ends_the_weld_for_good_and_says_so_by_its_exit_code() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let mut host = stream(&pendant, folder.path());
    grip(&pendant);
    pendant.wait_for("the weld", |seen| seen.arc);
    press(&mut host, b"s");
    let output = host.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(7), "{}", text(&output));
    assert!(text(&output).contains("stop was asked for"), "{}", text(&output));
    assert!(!pendant.wait_for("the abort", |seen| seen.state == State::Idle).arc);
}

#[test]
fn a_second_host_is_refused_and_the_first_goes_on() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let first = stream(&pendant, folder.path());
    pendant.wait_for("the load", |seen| seen.state == State::Ready);
    let second = stream(&pendant, folder.path()).wait_with_output().unwrap();
    assert_eq!(second.status.code(), Some(6));
    assert!(text(&second).contains("busy"), "{}", text(&second));
    pendant.enable(true);
    let first = first.wait_with_output().unwrap();
    assert_eq!(first.status.code(), Some(0), "{}", text(&first));
}

/// A pendant of another version.
fn answer_with_version(mut stream: std::os::unix::net::UnixStream, version: u16) {
    let mut bytes = HostDeframer::new();
    let mut byte = [0];
    while stream.read_exact(&mut byte).is_ok() {
        let Some(Received::Payload(payload)) = bytes.push(byte[0]) else { continue };
        let Ok(FromHost { message: HostMessage::Hello(hello), .. }) = frame::decode(payload) else {
            continue;
        };
        let why = HelloRefusal::Version { host: hello.version, pendant: version };
        let message = PendantMessage::HelloRefused(HelloRefused { nonce: hello.nonce, why });
        let mut out = [0; wire::MAX_PENDANT_FRAME];
        let length = frame::encode(&FromPendant { session: 0, message }, &mut out).unwrap();
        stream.write_all(&out[..length]).unwrap();
    }
}

#[test]
fn another_version_is_refused_with_both_numbers_and_a_silent_line_after_two_seconds() {
    let line = |stream: std::os::unix::net::UnixStream| {
        stream.set_read_timeout(Some(serial::READ_TIMEOUT)).unwrap();
        Line { reader: Box::new(stream.try_clone().unwrap()), writer: Box::new(stream) }
    };
    let (ours, theirs) = std::os::unix::net::UnixStream::pair().unwrap();
    thread::spawn(move || answer_with_version(theirs, 9));
    let error = Link::open(line(ours)).err().unwrap();
    assert!(matches!(error, Error::Version { host: wire::VERSION, pendant: 9 }), "{error}");
    let (ours, _theirs) = std::os::unix::net::UnixStream::pair().unwrap();
    assert!(matches!(Link::open(line(ours)).err(), Some(Error::NoAnswer)));
    let (ours, theirs) = std::os::unix::net::UnixStream::pair().unwrap();
    drop(theirs);
    assert!(matches!(Link::open(line(ours)).err(), Some(Error::Line(_))));
}

#[test]
fn monitor_listens_and_leaves_the_pendant_as_it_is() {
    let pendant = InProcess::on_socket().unwrap();
    let output =
        weldpath().args(["monitor", "--port", &pendant.port, "--count", "3", "--json"]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let reports: Vec<serde_json::Value> =
        text(&output).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(reports.len(), 3);
    assert!(reports.iter().all(|report| report["state"] == "Disabled"));
    assert_eq!(pendant.seen().heard_tick, 0, "it said nothing");
}

fn request() -> Request {
    Request {
        part: Part::ButtV,
        pose: Pose::Flat,
        views: Some(6),
        noise: Noise::Mid,
        seed: 1,
        width: 640,
        height: 480,
        weak: false,
        format: Format::Png,
        angle_deg: None,
        length_mm: None,
    }
}

#[test]
fn the_made_recording_captures_six_views_through_all_regions_with_clutch_and_loss() {
    let poses = simulation::stage(&request()).unwrap().base_from_camera;
    let setup = Setup {
        base_from_camera: poses[0],
        box_center_mm: [0.0, 200.0, 0.0],
        box_mm: 100.0,
        steer_right: false,
    };
    let frames = generator::recording(&setup, &poses).unwrap();
    let pendant = InProcess::on_socket().unwrap();
    let link = Link::open(serial::open(&pendant.port.parse().unwrap(), 115_200).unwrap()).unwrap();
    let session = teleop::play(&frames, &setup, |command| link.ask(command)).unwrap();
    assert_eq!((session.captures.len(), session.agreed), (6, session.frames));
    assert!(session.latency.iter().all(|motion| motion.len() > 100), "over 100 actions each");
    assert!(session.clutched >= 30 && session.lost >= 20);
    for ((_, captured), pose) in session.captures.iter().zip(&poses) {
        assert!((captured.translation.vector - pose.translation.vector).norm() < 0.5);
        assert!(captured.rotation.angle_to(&pose.rotation) < 0.02);
    }
}

/// A palm's place in tenths of a millimetre, and the fingers.
type Palm = ([i32; 3], u8);

#[test]
fn compressed_recordings_hold_the_same_hands_as_the_derived_tables() {
    let folder = "real/leapmotion+leapjs-playback/recorder/recordings";
    for name in ["wave", "confidence-74fps", "rollAndPitchWithEntry", "HandSplay-110fps"] {
        let Some(compressed) = shared_data(&format!("{folder}/{name}.json.lz")) else { return };
        let Some(table) = shared_data(&format!("real/derived/leap/{name}.csv")) else { return };
        let seen = |frames: Vec<wire::HandFrame>| -> Vec<_> {
            let hands = frames.into_iter().flat_map(|f| [f.left, f.right]);
            hands.flatten().map(|h| (h.palm_um.map(|um| (um + 50).div_euclid(100)), h.extended)).collect()
        };
        let (leap, csv) = (recording::read(&compressed).unwrap(), recording::read(&table).unwrap());
        let (leap, csv) = (seen(leap), seen(csv));
        assert!(leap.len() > 100);
        assert_eq!(leap.len(), csv.len(), "{name}");
        let near =
            |(a, b): (&Palm, &Palm)| a.1 == b.1 && a.0.iter().zip(b.0).all(|(a, b)| (a - b).abs() <= 1);
        assert!(leap.iter().zip(&csv).all(near), "{name}");
    }
}

#[test]
fn on_wave_the_camera_turns_no_more_than_the_hand_over_the_link() {
    let file = "real/leapmotion+leapjs-playback/recorder/recordings/wave.json.lz";
    let Some(file) = shared_data(file) else { return };
    let poses = simulation::stage(&request()).unwrap().base_from_camera;
    let setup = Setup {
        base_from_camera: poses[0],
        box_center_mm: [74.0, 188.0, 40.0],
        box_mm: 100.0,
        steer_right: true,
    };
    let pendant = InProcess::on_socket().unwrap();
    let link = Link::open(serial::open(&pendant.port.parse().unwrap(), 115_200).unwrap()).unwrap();
    let frames = recording::read(&file).unwrap();
    let session = teleop::play(&frames, &setup, |command| link.ask(command)).unwrap();
    assert!(session.latency[0].len() > 100, "rotation throughout");
    assert!(session.largest_turn_rad > 0.0 && session.largest_turn_rad.to_degrees() < 7.35);
    assert_eq!(session.agreed, session.frames);
}
