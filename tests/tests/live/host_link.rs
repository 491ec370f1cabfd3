//! The command against a pendant: loading, holding and resuming under damage, a host that dies, refusals, and scanning.

use std::convert::Infallible;
use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use nalgebra::{Isometry3, Point3, UnitQuaternion};
use weldpath::output::frame::PathFrame;
use weldpath::output::json;
use weldpath::pendant::link::{Error, Link};
use weldpath::pendant::serial;
use weldpath::pendant::serial::Line;
use weldpath::pendant::teleop;
use weldpath::pendant::teleop::{Setup, Twin, generator, recording};
use weldpath::simulation;
use weldpath::simulation::{Part, Request};
use weldpath::weld::program::{Kind, Waypoint};
use weldpath_core::interlock::State;
use weldpath_core::pendant::JOG_LIMITS;
use weldpath_core::wire::frame::{self, Received};
use weldpath_core::wire::{
    self, FromHost, FromPendant, HelloAck, HelloRefusal, HelloRefused, HostDeframer, HostMessage,
    PendantMessage,
};
use weldpath_tests::adversary::Random;
use weldpath_tests::command::{Running, ends_well, weldpath};
use weldpath_tests::in_process::InProcess;
use weldpath_tests::shared_data;
use weldpath_tests::world::RING;

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

/// `weldpath stream` of [`program`], with more arguments.
fn command(pendant: &InProcess, folder: &Path, more: &[&str]) -> Command {
    std::fs::write(folder.join("path.json"), json::write(&program(), PathFrame::Base)).unwrap();
    let mut command = weldpath();
    command.args(["stream", "--port", &pendant.port]).args(more).arg(folder);
    command
}

fn stream(pendant: &InProcess, folder: &Path) -> Running {
    Running::start(&mut command(pendant, folder, &["--back-mm", "2"]))
}

/// Ready, then gripped: running.
fn grip(pendant: &InProcess) {
    pendant.wait_for("the load", |seen| seen.state == State::Ready);
    pendant.enable(true);
}

/// Asserts a good end and gives what was said.
fn ended_well(host: Running) -> String {
    let ended = host.end();
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    assert!(ended.said.contains("finished"), "{}", ended.said);
    ended.said
}

#[test]
fn a_program_is_loaded_held_resumed_and_finished_over_a_pty_that_damages_bytes() {
    let (pendant, folder) = (InProcess::on_pty(1e-3).unwrap(), tempfile::tempdir().unwrap());
    let mut host = stream(&pendant, folder.path());
    grip(&pendant);
    pendant.wait_for("the weld", |seen| seen.arc && seen.segment >= 20);
    host.press(b"h");
    let held = pendant.wait_for("the hold", |seen| seen.state == State::Held);
    assert!(!held.arc);
    host.wait_for(&["hold was asked for; r resumes"]);
    pendant.grip();
    std::thread::sleep(Duration::from_millis(200));
    host.press(b"r");
    pendant.wait_for("the arc again", |seen| seen.arc && seen.segment + 3 >= held.segment);
    assert!(ended_well(host).contains("loaded 6"));
    assert!(pendant.seen().segment >= 62, "the way home is a part of it");
}

#[test]
fn without_the_arc_the_whole_program_is_moved_and_no_arc_ever_struck() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let host = Running::start(&mut command(&pendant, folder.path(), &["--no-arc"]));
    grip(&pendant);
    ended_well(host);
    let seen = pendant.seen();
    assert!(seen.segment >= 62 && seen.arc_on_tick == 0 && !seen.arc, "{seen:?}");
}

#[test]
fn a_program_longer_than_the_ring_is_streamed_and_moved_to_its_end() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let count = 2 * RING + 100;
    let line: Vec<Waypoint> = (0..count)
        .map(|k| Waypoint {
            position_mm: Point3::new(300.0 + 0.5 * k as f64, 0.0, 100.0),
            base_from_torch: UnitQuaternion::identity(),
            feed_mm_s: 200.0,
            weld: true,
            seam: Some(1),
            kind: Kind::Weld,
            dwell_s: None,
        })
        .collect();
    let file = folder.path().join("long.json");
    std::fs::write(&file, json::write(&line, PathFrame::Base)).unwrap();
    let host = Running::start(weldpath().args(["stream", "--port", &pendant.port]).arg(&file));
    pendant.wait_for("half a ring", |seen| seen.state == State::Loading);
    pendant.enable(true);
    let said = ended_well(host);
    assert!(said.contains(&format!("streaming {count} waypoints")), "{said}");
    assert_eq!(pendant.seen().segment as usize, count - 2, "the last segment");
}

#[test]
fn a_pendant_behind_a_tcp_port_is_one_like_any_other() {
    let (pendant, folder) = (InProcess::on_tcp().unwrap(), tempfile::tempdir().unwrap());
    assert!(pendant.port.starts_with("127.0.0.1:"));
    let host = stream(&pendant, folder.path());
    grip(&pendant);
    pendant.wait_for("the arc", |seen| seen.arc);
    ended_well(host);
}

/// What `stty` says of a terminal's settings.
fn settings(terminal: &str) -> String {
    let said = Command::new("stty").args(["-g", "-F", terminal]).output().expect("coreutils' stty");
    assert!(said.status.success(), "{said:?}");
    String::from_utf8(said.stdout).unwrap()
}

#[test]
fn at_a_terminal_single_keys_start_hold_resume_and_stop_and_it_is_given_back_as_it_was() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let (mut keyboard, terminal) = serialport::TTYPort::pair().unwrap();
    let name = serialport::SerialPort::name(&terminal).unwrap();
    let cooked = Command::new("stty").args(["-F", &name, "sane"]).status().unwrap();
    assert!(cooked.success());
    let before = settings(&name);
    let keys = File::options().read(true).write(true).open(&name).unwrap();
    let mut host = Running::with_keys_from(&mut command(&pendant, folder.path(), &[]), Stdio::from(keys));
    host.wait_for(&["waiting for the enabling switch"]);
    assert_ne!(settings(&name), before, "keys come at once and unseen");
    pendant.enable(true);
    // A terminal means an operator: nothing moves before Enter.
    host.wait_for(&["Enter starts"]);
    assert_eq!(pendant.seen().state, State::Ready);
    keyboard.write_all(b"\r").unwrap();
    pendant.wait_for("the weld", |seen| seen.arc && seen.segment >= 5);
    for hold in [b"h", b" "] {
        keyboard.write_all(hold).unwrap();
        pendant.wait_for("the hold", |seen| seen.state == State::Held);
        host.wait_for(&["hold was asked for; r resumes"]);
        pendant.grip();
        std::thread::sleep(Duration::from_millis(200));
        keyboard.write_all(b"r").unwrap();
        pendant.wait_for("the arc again", |seen| seen.arc);
    }
    const CTRL_C: u8 = 3;
    keyboard.write_all(&[CTRL_C]).unwrap();
    let ended = host.end();
    assert_eq!(ended.code, Some(7), "{}", ended.said);
    assert!(ended.said.contains("stop was asked for"), "{}", ended.said);
    assert_eq!(settings(&name), before);
}

#[test]
fn the_exit_code_says_what_became_of_a_stream() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let ends = |arguments: &[&str], code: i32, part: &str| {
        let ended = Running::start(weldpath().arg("stream").args(arguments)).end();
        assert_eq!(ended.code, Some(code), "{arguments:?}: {}", ended.said);
        assert!(ended.said.contains(part), "{arguments:?}: {}", ended.said);
    };
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_string()
    };
    let far = |feed_mm_s, x| {
        let at = |y| Waypoint {
            position_mm: Point3::new(x, y, 0.0),
            base_from_torch: UnitQuaternion::identity(),
            feed_mm_s,
            weld: false,
            seam: None,
            kind: Kind::Air,
            dwell_s: None,
        };
        json::write(&[at(0.0), at(10.0)], PathFrame::Base)
    };
    let (port, good) = (pendant.port.as_str(), file("good.json", &json::write(&program(), PathFrame::Base)));
    ends(&["--port", port, "--back-mm=-1", &good], 2, "--back-mm");
    ends(&["--port", port], 2, "path.json");
    ends(&["--port", port, "no/such/folder"], 4, "no/such/folder");
    ends(&["--port", port, &file("broken.json", "{\"waypoints\":")], 4, "broken.json");
    ends(&["--port", "unix:/no/such/socket", &good], 6, "/no/such/socket");
    ends(&["--port", "tcp://localhost:4000", &good], 2, "write localhost:4000 without tcp://, as host:port");
    ends(&["--port", port, &file("far.json", &far(50.0, 9e6))], 7, "reach");
    ends(&["--port", port, &file("fast.json", &far(9e4, 400.0))], 7, "mm/s");
    let mut early = stream(&pendant, folder.path());
    pendant.wait_for("the load", |seen| seen.state == State::Ready);
    early.press(b"s");
    let ended = early.end();
    assert_eq!(ended.code, Some(7), "{}", ended.said);
    assert!(ended.said.contains("nothing moved"), "{}", ended.said);
}

#[test]
fn a_hold_that_nobody_is_left_to_end_ends_the_command() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let mut host = stream(&pendant, folder.path());
    grip(&pendant);
    pendant.wait_for("the weld", |seen| seen.arc);
    host.close_keys();
    pendant.enable(false);
    let ended = host.end();
    assert_eq!(ended.code, Some(7), "{}", ended.said);
    assert!(ended.said.contains("the enabling switch was released"), "{}", ended.said);
    assert!(!pendant.seen().arc);
}

#[test]
fn a_host_that_is_killed_leaves_the_arc_off_within_the_silence_limit_and_the_torch_held() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let host = stream(&pendant, folder.path());
    grip(&pendant);
    pendant.wait_for("the weld", |seen| seen.arc && seen.segment >= 10);
    host.kill();
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
    host.press(b"s");
    let ended = host.end();
    assert_eq!(ended.code, Some(7), "{}", ended.said);
    assert!(ended.said.contains("stop was asked for"), "{}", ended.said);
    assert!(!pendant.wait_for("the abort", |seen| seen.state == State::Disabled).arc);
}

#[test]
fn a_signal_that_ends_the_host_stops_the_weld_first() {
    for signal in ["INT", "TERM"] {
        let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
        let host = stream(&pendant, folder.path());
        grip(&pendant);
        pendant.wait_for("the weld", |seen| seen.arc);
        host.signal(signal);
        let ended = host.end();
        assert_eq!(ended.code, Some(7), "{}", ended.said);
        assert!(ended.said.contains("stop was asked for"), "not by silence: {}", ended.said);
        assert!(!pendant.wait_for("the abort", |seen| seen.state == State::Disabled).arc);
    }
}

/// What a device at the other end does with the frames of a host; bytes that it says whenever the host is quiet.
fn device(mut stream: UnixStream, answers: impl Fn(FromHost) -> Option<FromPendant>, noise: &[u8]) {
    stream.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    let mut bytes = HostDeframer::new();
    loop {
        let mut byte = [0];
        let got = match stream.read(&mut byte) {
            Ok(1) => byte[0],
            Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {
                if stream.write_all(noise).is_err() {
                    return;
                }
                continue;
            }
            _ => return,
        };
        let Some(Received::Payload(payload)) = bytes.push(got) else { continue };
        let Some(message) = frame::decode(payload).ok().and_then(&answers) else { continue };
        let mut out = [0; wire::MAX_PENDANT_FRAME];
        let length = frame::encode(&message, &mut out).unwrap();
        if stream.write_all(&out[..length]).is_err() {
            return;
        }
    }
}

fn at_the_other_end(
    answers: impl Fn(FromHost) -> Option<FromPendant> + Send + 'static,
    noise: &'static [u8],
) -> Line {
    let (ours, theirs) = UnixStream::pair().unwrap();
    thread::spawn(move || device(theirs, answers, noise));
    ours.set_read_timeout(Some(serial::READ_TIMEOUT)).unwrap();
    Line { reader: Box::new(ours.try_clone().unwrap()), writer: Box::new(ours) }
}

/// A pendant that opens a session, its acknowledgement changed by `change`, answers pings, and nothing else.
fn opens(change: impl Fn(FromPendant) -> FromPendant + Send + 'static) -> Line {
    let limits = weldpath_core::pendant::Config::default().limits(512);
    let answers = move |FromHost { session, message }: FromHost| match message {
        HostMessage::Hello(hello) => {
            let (version, nonce, firmware) = (wire::VERSION, hello.nonce, wire::Firmware::default());
            let ack = HelloAck { version, nonce, boot: 7, tick: 1, request: 0, firmware, limits };
            let session = wire::session_id(7, nonce);
            Some(change(FromPendant { session, message: PendantMessage::HelloAck(ack) }))
        }
        HostMessage::Ping(ping) => {
            Some(FromPendant { session, message: PendantMessage::Pong { token: ping.token, tick: 1 } })
        }
        _ => None,
    };
    at_the_other_end(answers, &[])
}

#[test]
fn a_session_whose_version_or_id_is_another_is_none() {
    assert!(Link::open(opens(|ack| ack)).is_ok());
    let old = opens(|ack| match ack.message {
        PendantMessage::HelloAck(old) => {
            FromPendant { message: PendantMessage::HelloAck(HelloAck { version: 1, ..old }), ..ack }
        }
        _ => ack,
    });
    assert!(matches!(Link::open(old).err(), Some(Error::Version { host: wire::VERSION, pendant: 1 })));
    let wrong = opens(|ack| FromPendant { session: ack.session ^ 1, ..ack });
    assert!(matches!(Link::open(wrong).err(), Some(Error::NoAnswer(_))));
}

#[test]
fn a_pendant_that_speaks_and_does_not_answer_ends_a_command_after_five_seconds() {
    let link = Link::open(opens(|ack| ack)).unwrap();
    let asked = std::time::Instant::now();
    assert!(matches!(link.ask(wire::Command::GetLimits), Err(Error::NoReply)));
    assert!((5..8).contains(&asked.elapsed().as_secs()), "{:?}", asked.elapsed());
}

#[test]
fn bytes_that_are_no_frames_are_counted_and_the_first_of_them_shown() {
    let error = Link::open(at_the_other_end(|_| None, b"$GPGGA,1")).err().unwrap();
    let said = error.to_string();
    assert!(said.contains("bytes came that are no frames, first 24 47 50 47 47 41 2c 31"), "{said}");
    assert!(error.hint().contains("another device"), "{}", error.hint());
    // A frame of another version: its checksum is right.
    let mut frame_of_another = [0; 64];
    let length = frame::encode(&(0_u32, 200_u8, 7_u8), &mut frame_of_another).unwrap();
    let bytes: &'static [u8] = frame_of_another[..length].to_vec().leak();
    let error = Link::open(at_the_other_end(|_| None, bytes)).err().unwrap();
    assert!(error.to_string().contains("frames came that are no messages of protocol version"), "{error}");
}

#[test]
fn a_second_host_is_refused_and_the_first_goes_on() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let first = stream(&pendant, folder.path());
    pendant.wait_for("the load", |seen| seen.state == State::Ready);
    let second = stream(&pendant, folder.path()).end();
    assert_eq!(second.code, Some(6));
    assert!(second.said.contains("busy"), "{}", second.said);
    pendant.enable(true);
    ended_well(first);
}

/// A pendant of another version.
fn answer_with_version(mut stream: UnixStream, version: u16) {
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
    let line = |stream: UnixStream| {
        stream.set_read_timeout(Some(serial::READ_TIMEOUT)).unwrap();
        Line { reader: Box::new(stream.try_clone().unwrap()), writer: Box::new(stream) }
    };
    let (ours, theirs) = UnixStream::pair().unwrap();
    thread::spawn(move || answer_with_version(theirs, 9));
    let error = Link::open(line(ours)).err().unwrap();
    assert!(matches!(error, Error::Version { host: wire::VERSION, pendant: 9 }), "{error}");
    let (ours, _theirs) = UnixStream::pair().unwrap();
    assert!(matches!(Link::open(line(ours)).err(), Some(Error::NoAnswer(_))));
    let (ours, theirs) = UnixStream::pair().unwrap();
    drop(theirs);
    assert!(matches!(Link::open(line(ours)).err(), Some(Error::Line(_))));
}

#[test]
fn monitor_listens_and_leaves_the_pendant_as_it_is() {
    let pendant = InProcess::on_socket().unwrap();
    let arguments = ["monitor", "--port", &pendant.port, "--count", "3", "--json"];
    let said = ends_well(weldpath().args(arguments));
    let reports: Vec<serde_json::Value> =
        said.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(reports.len(), 3);
    assert!(reports.iter().all(|report| report["state"] == "Disabled"));
    assert_eq!(reports[0]["pose"]["orientation_q15"], serde_json::json!([32767, 0, 0, 0]), "numbers");
    assert_eq!(pendant.seen().heard_tick, 0, "it said nothing");
}

fn request() -> Request {
    Request { views: Some(6), ..Request::new(Part::ButtV, 1) }
}

/// A recording that is made to capture from the poses of a simulated scan, and those poses.
fn made() -> (Setup, Vec<wire::WireHandFrame>, Vec<Isometry3<f64>>) {
    let poses = simulation::stage(&request()).unwrap().base_from_camera;
    let setup = Setup {
        base_from_camera: poses[0],
        box_center_mm: [0.0, 200.0, 0.0],
        box_mm: 100.0,
        steer_right: false,
    };
    let frames = generator::recording(&setup, &poses).unwrap();
    (setup, frames, poses)
}

#[test]
fn the_made_recording_captures_six_views_through_all_regions_with_clutch_and_loss() {
    let (setup, frames, _) = made();
    let pendant = InProcess::on_socket().unwrap();
    let link = Link::open(serial::open(&pendant.port.parse().unwrap(), 115_200).unwrap()).unwrap();
    pendant.manual(true);
    pendant.grip();
    pendant.wait_for("the switch", |seen| seen.state == State::Idle);
    let session =
        teleop::play(&frames, &setup, &link.pendant().limits.jog, teleop::Pace::Recorded, |command| {
            link.ask(command)
        })
        .unwrap();
    assert_eq!((session.captures.len(), session.agreed), (6, Some(session.frames)));
    assert!(session.latency.iter().all(|motion| motion.len() > 100), "over 100 actions each");
    assert!(session.clutched >= 30 && session.lost >= 20);
}

/// In virtual time, as the pendant moves the camera by its own clock and a busy machine delays frames.
#[test]
fn frames_that_come_as_they_were_recorded_lead_the_camera_to_where_they_are_meant_to() {
    let (setup, frames, poses) = made();
    let mut twin = Twin::new(&setup.jog().unwrap(), &JOG_LIMITS);
    let answer = |command| match command {
        wire::Command::HandFrame(frame) => Ok::<_, Infallible>(twin.answer(&frame, frame.time_ms)),
        _ => Ok(wire::Answer::Done),
    };
    let session = teleop::play(&frames, &setup, &JOG_LIMITS, teleop::Pace::Answers, answer).unwrap();
    assert_eq!(session.captures.len(), 6);
    for ((_, captured), pose) in session.captures.iter().zip(&poses) {
        assert!((captured.translation.vector - pose.translation.vector).norm() < 0.5);
        assert!(captured.rotation.angle_to(&pose.rotation) < 0.02);
    }
}

/// A palm's place in tenths of a millimetre, and the fingers.
type Palm = ([i32; 3], u8);

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn compressed_recordings_hold_the_same_hands_as_the_derived_tables() {
    let folder = "real/leapmotion+leapjs-playback/recorder/recordings";
    for name in ["wave", "confidence-74fps", "rollAndPitchWithEntry", "HandSplay-110fps"] {
        let compressed = shared_data(&format!("{folder}/{name}.json.lz"));
        let table = shared_data(&format!("real/derived/leap/{name}.csv"));
        let seen = |frames: Vec<wire::WireHandFrame>| -> Vec<_> {
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
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn on_wave_the_camera_turns_no_more_than_the_hand_over_the_link() {
    let file = "real/leapmotion+leapjs-playback/recorder/recordings/wave.json.lz";
    let file = shared_data(file);
    let poses = simulation::stage(&request()).unwrap().base_from_camera;
    let setup = Setup {
        base_from_camera: poses[0],
        box_center_mm: [74.0, 188.0, 40.0],
        box_mm: 100.0,
        steer_right: true,
    };
    let pendant = InProcess::on_socket().unwrap();
    let link = Link::open(serial::open(&pendant.port.parse().unwrap(), 115_200).unwrap()).unwrap();
    pendant.manual(true);
    pendant.grip();
    pendant.wait_for("the switch", |seen| seen.state == State::Idle);
    let frames = recording::read(&file).unwrap();
    let session =
        teleop::play(&frames, &setup, &link.pendant().limits.jog, teleop::Pace::Recorded, |command| {
            link.ask(command)
        })
        .unwrap();
    assert!(session.latency[0].len() > 100, "rotation throughout");
    assert!(session.largest_turn_rad > 0.0 && session.largest_turn_rad.to_degrees() < 7.35);
    assert_eq!(session.agreed, Some(session.frames));
}

#[test]
fn a_path_that_begins_elsewhere_is_not_started_and_the_operator_told_how_far_it_is() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    pendant.confirms(false);
    let mut host = Running::start(&mut command(&pendant, folder.path(), &[]));
    grip(&pendant);
    host.wait_for(&["press confirm at the pendant"]);
    pendant.confirms(true);
    ended_well(host);
    // The torch is at the program's end now, 200 mm from where it begins.
    pendant.confirms(false);
    pendant.enable(false);
    let mut host = Running::start(&mut command(&pendant, folder.path(), &[]));
    grip(&pendant);
    host.wait_for(&["200.0 mm and 0.0 degrees from where it has to be"]);
    host.press(b"s");
    assert_eq!(host.end().code, Some(7));
    // With the slow way there, the arc barred, it needs no confirmation.
    pendant.enable(false);
    let struck = pendant.seen().arc_on_tick;
    let mut host = Running::start(&mut command(&pendant, folder.path(), &["--approach"]));
    host.wait_for(&["approach, slowly, with the arc barred"]);
    grip(&pendant);
    host.wait_for(&["finished"]);
    assert_eq!(pendant.seen().arc_on_tick, struck, "no arc on the approach");
    pendant.wait_for("the weld's load", |seen| seen.state == State::Ready);
    pendant.grip();
    ended_well(host);
    assert!(pendant.seen().jump_um < 2_000.0, "{:?}", pendant.seen());
}

/// Kills the host at a random moment of a weld, goes on with it, and looks for jumps and strikes that nobody asked for.
fn killed_and_resumed(seed: u64) {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let mut random = Random::new(seed);
    // The silence limit takes 4 mm more: the hold is still on the seam.
    let at = 2 + random.below(50) as u32;
    let host = stream(&pendant, folder.path());
    grip(&pendant);
    pendant.wait_for("the weld", |seen| seen.segment >= at && seen.arc_on_tick > 0);
    thread::sleep(Duration::from_micros(random.below(60_000)));
    host.kill();
    let held = pendant.wait_for("the hold", |seen| seen.state == State::Held);
    let mut host = Running::start(&mut command(&pendant, folder.path(), &["--resume", "--back-mm", "2"]));
    host.wait_for(&["waiting for the enabling switch"]);
    thread::sleep(Duration::from_millis(300));
    let waiting = pendant.seen();
    assert_eq!(
        (waiting.state, waiting.arc_on_tick),
        (State::Held, held.arc_on_tick),
        "seed {seed}: no strike"
    );
    pendant.grip();
    ended_well(host);
    let seen = pendant.seen();
    assert!(seen.jump_um <= 2_000.0, "seed {seed}: a jump of {} um", seen.jump_um);
    assert!(seen.arc_on_tick > held.arc_on_tick, "seed {seed}: welded on");
    assert!(seen.segment >= 62, "seed {seed}: to the end");
    let (at, jump_um) = (held.segment, seen.jump_um);
    // The seam runs along x.
    let overlap_um = held.pose.position_um[0] - seen.arc_on_pose.position_um[0];
    println!("seed {seed}: held in segment {at}, overlap {overlap_um} um, farthest step {jump_um:.0} um");
    assert!((1_900..=2_100).contains(&overlap_um), "seed {seed}: an overlap of {overlap_um} um");
}

#[test]
fn a_host_killed_at_five_random_moments_of_a_weld_is_gone_on_with() {
    (1..=5).for_each(killed_and_resumed);
}

/// On demand: `cargo test -p weldpath-tests --test live host_link -- --ignored fifty`.
#[test]
#[ignore = "two minutes"]
fn a_host_killed_at_fifty_random_moments_of_a_weld_is_gone_on_with() {
    (1..=50).for_each(killed_and_resumed);
}

#[test]
fn a_pendant_that_remembers_nothing_is_given_the_rest_with_a_lead_in() {
    let (pendant, folder) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    let ended = Running::start(&mut command(&pendant, folder.path(), &["--resume"])).end();
    assert_eq!(ended.code, Some(4), "{}", ended.said);
    assert!(ended.said.contains("stream.session.json"), "{}", ended.said);
    let host = Running::start(&mut command(&pendant, folder.path(), &["--from-waypoint", "40"]));
    grip(&pendant);
    ended_well(host);
    let seen = pendant.seen();
    assert!(seen.segment >= 22 && seen.segment < 40, "the rest only: {seen:?}");
    let ended = Running::start(&mut command(&pendant, folder.path(), &["--resume"])).end();
    assert_eq!(ended.code, Some(6), "{}", ended.said);
    assert!(ended.said.contains("nothing to continue with"), "{}", ended.said);
    let ended = Running::start(&mut command(&pendant, folder.path(), &["--from-mm", "9999"])).end();
    assert_eq!(ended.code, Some(2), "{}", ended.said);
}
