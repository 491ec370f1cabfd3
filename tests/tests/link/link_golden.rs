//! Version 4 of the wire, byte by byte, and what all versions share with version 1: Hello and its refusals. The files in
//! `golden` are never edited: a later version adds one beside them.
//!
//! Each line of it is a name, the payload (message without checksum) and the whole frame, in hex; docs/protocol.md
//! shows the same bytes.

use std::collections::BTreeMap;
use std::fmt::Debug;

use heapless::Vec as Bounded;
use serde::{Serialize, de::DeserializeOwned};
use weldpath_core::interlock::{ArcPhase, Cause, Fault, State};
use weldpath_core::wire::frame::{CRC32, Received, decode, encode};
use weldpath_core::wire::*;
use weldpath_tests::arm::{frame_of as frame_of_actual, told};

const GOLDEN: &str = include_str!("../../golden/wire_v4.txt");
const FIRST: &str = include_str!("../../golden/wire_v1.txt");
/// Written by a program in Python that knows docs/robot-port.md only.
const PORT: &str = include_str!("../../golden/port_v2.txt");
const PROTOCOL: &str = include_str!("../../../docs/protocol.md");

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn pose() -> WirePose {
    WirePose { position_um: [123_456, -7, 2_000_000], orientation_q15: [23_170, 0, -23_170, 0] }
}

fn waypoint(index: i32) -> WireWaypoint {
    let position_um = [1_000 * index, -500, 250_000];
    WireWaypoint {
        pose: WirePose { position_um, ..WirePose::IDENTITY },
        feed_um_s: 10_000,
        weld: index % 2 == 1,
    }
}

/// Spelled out, for golden bytes do not follow a default.
fn limits() -> Limits {
    Limits {
        ring: 512,
        reach_um: 3_000_000,
        max_step_um: 100_000,
        min_half_turn_cos_q15: 28_377,
        min_step_um: 50,
        max_feed_um_s: 250_000,
        manual_feed_um_s: 25_000,
        accel_um_s2: 500_000,
        tick_us: 2_000,
        silence_ms: 200,
        max_turn_mrad_s: 3_142,
        corner_um_s: 5_000,
        corner_mrad_s: 350,
        retrace_um_s: 5_000,
        near_um: 2_000,
        near_mrad: 35,
        port: true,
        jog: JogLimits {
            step_um: 1_000,
            speed_um_s: 100_000,
            turn_mrad_s: 1_000,
            least_um: [-1_500_000, -1_500_000, 0],
            most_um: [1_500_000, 1_500_000, 2_000_000],
            confidence_permille: 200,
        },
    }
}

fn hand() -> Hand {
    Hand {
        palm_um: [-20_000, 200_000, 15_000],
        direction_q15: [0, 0, -32_767],
        normal_q15: [0, -32_767, 0],
        grab_permille: 20,
        pinch_permille: 950,
        confidence_permille: 1000,
        extended: 0b1_1100,
    }
}

fn ack() -> Ack {
    Ack { path: 3, next: 8, sack: 0b101, limit: 76 }
}

fn commands() -> Vec<(&'static str, Command)> {
    let jog = WireJog {
        start: pose(),
        box_center_um: [0, 200_000, 0],
        box_size_um: [100_000, 100_000, 80_000],
        steer_right: false,
        base_from_sensor_q15: [23_170, 23_170, 0, 0],
    };
    let begin = Begin {
        path: 3,
        total: 300,
        chunk: 4,
        streamed: false,
        reach_um: 2_000_000,
        max_step_um: 20_000,
        min_half_turn_cos_q15: 32_000,
        arc: true,
        times: ProcessTimes {
            pre_flow_ms: 300,
            strike_ms: 2_000,
            crater_fill_ms: 400,
            burn_back_ms: 60,
            post_flow_ms: 700,
        },
    };
    let points = [[0, 0, 0], [1_200, -1_200, 30]].map(|um| Offset { um });
    let patch = WirePatch {
        radius_um: 4_800,
        threshold_milli: 60_000,
        points: Bounded::from_slice(&points).expect("two points"),
    };
    vec![
        ("get-limits", Command::GetLimits),
        ("set-tool", Command::SetTool { tool: pose() }),
        ("set-jog", Command::SetJog(jog)),
        ("hand-frame", Command::HandFrame(WireHandFrame { time_ms: 1_234, left: Some(hand()), right: None })),
        ("score", Command::Score(patch)),
        ("begin", Command::Begin(begin)),
        ("commit", Command::Commit { path: 3, digest: 0x89AB_CDEF }),
        ("abort", Command::Abort { path: 3 }),
        ("arc-arm", Command::ArcArm { armed: true }),
        ("start", Command::Start { path: 3 }),
        ("hold", Command::Hold),
        ("stop", Command::Stop),
        ("resume", Command::Resume { path: 3, changes: 7, back_um: 5_000 }),
        ("reset", Command::Reset),
        ("subscribe", Command::Subscribe { every: 1 }),
    ]
}

fn from_host() -> Vec<(&'static str, FromHost)> {
    let hello = Hello { version: 4, schema: 0x1234_5678, nonce: 0xCAFE_F00D };
    let chunk = Chunk {
        path: 3,
        first: 8,
        waypoints: Bounded::from_slice(&[waypoint(8), waypoint(9)]).expect("two waypoints"),
    };
    let attach = Attach { hello, former: 0x0BAD_F00D, path: 3, digest: 0x89AB_CDEF };
    let mut messages = vec![
        ("hello", FromHost { session: 0, message: HostMessage::Hello(hello) }),
        ("chunk", in_session(HostMessage::Chunk(chunk))),
        ("ping", in_session(HostMessage::Ping(Ping { count: 5, echo: 100_000, token: 50_000 }))),
        ("fault-seen", in_session(HostMessage::FaultSeen { number: 2 })),
        ("attach", FromHost { session: 0, message: HostMessage::Attach(attach) }),
    ];
    let controls = (1..).zip(commands());
    messages.extend(
        controls
            .map(|(request, (name, command))| (name, in_session(HostMessage::Control { request, command }))),
    );
    messages
}

fn in_session(message: HostMessage) -> FromHost {
    FromHost { session: 0x0BAD_CAFE, message }
}

fn answers() -> Vec<(&'static str, Answer)> {
    let refused = Answer::Refused;
    vec![
        ("done", Answer::Done),
        ("refused-state", refused(Refusal::State(State::Running))),
        ("refused-moving", refused(Refusal::Moving)),
        ("refused-path", refused(Refusal::Path)),
        ("refused-not-enabled", refused(Refusal::NotEnabled)),
        ("refused-e-stop", refused(Refusal::EStop)),
        ("refused-too-long", refused(Refusal::TooLong { capacity: 512 })),
        ("refused-incomplete", refused(Refusal::Incomplete { next: 296 })),
        ("refused-digest", refused(Refusal::Digest { computed: 1 })),
        ("refused-stale", refused(Refusal::Stale { changes: 9 })),
        ("refused-not-resumable", refused(Refusal::NotResumable(Cause::ArcLost))),
        ("refused-value", refused(Refusal::Value(Field::Back))),
        ("refused-away", refused(Refusal::Away { distance_um: 170_000, turn_mrad: 12 })),
        ("refused-pose-unknown", refused(Refusal::PoseUnknown)),
        ("refused-robot", refused(Refusal::Robot)),
        ("refused-no-tool", refused(Refusal::NoTool)),
        ("refused-tool", refused(Refusal::Value(Field::Tool))),
        ("refused-too-fast", refused(Refusal::TooFast { at: 7 })),
        ("refused-arc-barred", refused(Refusal::ArcBarred)),
        ("refused-not-manual", refused(Refusal::NotManual)),
        ("limits", Answer::Limits(limits())),
        (
            "pose",
            Answer::Pose(WireCameraPose {
                pose: pose(),
                actual: Some(WirePose { position_um: [123_000, 0, 2_000_000], ..pose() }),
                region: 2,
                capture: true,
                clutch: false,
                time_ms: 200_000,
            }),
        ),
        (
            "edge-score",
            Answer::EdgeScore(WireEdgeScore {
                neighbours: 32,
                intensity_ppm: 213_000,
                ratio_milli: 41_250,
                edge: true,
            }),
        ),
    ]
}

fn telemetry() -> Telemetry {
    Telemetry {
        tick: 100_000,
        state: State::Held,
        changes: 7,
        cause: Some(Cause::Silence),
        fault: None,
        arc: ArcPhase::PostFlow,
        pins: Telemetry::ENABLE | Telemetry::ENABLED | Telemetry::GAS | Telemetry::POSE_KNOWN,
        finished: Some(2),
        load: Some(ack()),
        segment: 5,
        alpha_q24: 1 << 23,
        speed_um_s: 0,
        pose: pose(),
        counters: Counters {
            framing: 1,
            crc: 200,
            oversize: 3,
            unread: 4,
            overrun: 5,
            duplicate: 6,
            stale: 7,
        },
        robot: Some(Robot { pose: pose(), error_um: 900, drives: port::Drives::Following, lost: 1 }),
        tool: Some(WirePose { position_um: [-1, 0, 350_000], ..WirePose::IDENTITY }),
    }
}

fn from_pendant() -> Vec<(&'static str, FromPendant)> {
    let hello = HelloAck {
        version: 4,
        nonce: 0xCAFE_F00D,
        boot: 77,
        tick: 100_000,
        request: 9,
        firmware: Firmware { version: [0, 1, 2], build: 0x8214_8b7f },
        limits: limits(),
    };
    let refused = |why| PendantMessage::HelloRefused(HelloRefused { nonce: 0xCAFE_F00D, why });
    let chunk = |why| PendantMessage::ChunkRefused(ChunkRefused { path: 3, first: 8, at: 1, why });
    let sample = Sample { tick: 100_000, segment: 5, alpha_q24: 1 << 23, pose: pose(), arc: true };
    let mut messages = vec![
        ("hello-ack", PendantMessage::HelloAck(hello)),
        ("hello-refused-version", refused(HelloRefusal::Version { host: 1, pendant: 2 })),
        ("hello-refused-schema", refused(HelloRefusal::Schema { host: 2, pendant: 3 })),
        ("hello-refused-busy", refused(HelloRefusal::Busy)),
        ("ack", PendantMessage::Ack(ack())),
        ("chunk-refused-feed", chunk(ChunkRefusal::Feed)),
        ("chunk-refused-credit", chunk(ChunkRefusal::Credit { limit: 76 })),
        ("chunk-refused-turn", chunk(ChunkRefusal::Turn)),
        ("pong", PendantMessage::Pong { token: 50_000, tick: 100_000 }),
        ("fault-report", PendantMessage::FaultReport { number: 2, fault: Fault::EStop }),
        ("telemetry", PendantMessage::Telemetry(telemetry())),
        ("samples", PendantMessage::Samples(Bounded::from_slice(&[sample]).expect("one sample"))),
        ("no-session", PendantMessage::NoSession { boot: 77 }),
        ("unread", PendantMessage::Unread(Unreadable::Trailing)),
        (
            "attach-refused-session",
            PendantMessage::AttachRefused { nonce: 0xCAFE_F00D, why: AttachRefusal::Session },
        ),
        (
            "attach-refused-state",
            PendantMessage::AttachRefused { nonce: 0xCAFE_F00D, why: AttachRefusal::State(State::Idle) },
        ),
    ];
    messages.extend(
        (1..)
            .zip(answers())
            .map(|(request, (name, answer))| (name, PendantMessage::Reply { request, answer })),
    );
    messages
        .into_iter()
        .map(|(name, message)| (name, FromPendant { session: 0x0BAD_CAFE, message }))
        .collect()
}

fn frame_of<M: Serialize>(message: &M) -> Vec<u8> {
    let mut out = [0; 600];
    let len = encode(message, &mut out).expect("fits");
    out[..len].to_vec()
}

fn payload_of(frame: &[u8]) -> Vec<u8> {
    let mut deframer = weldpath_core::wire::frame::Deframer::<600>::new();
    let mut payload = None;
    for &byte in frame {
        if let Some(Received::Payload(bytes)) = deframer.push(byte) {
            payload = Some(bytes.to_vec());
        }
    }
    payload.expect("a frame")
}

fn lines<M: Serialize>(messages: &[(&str, M)]) -> Vec<String> {
    let line = |(name, message): &(&str, M)| {
        let frame = frame_of(message);
        format!("{name} {} {}", hex(&payload_of(&frame)), hex(&frame))
    };
    messages.iter().map(line).collect()
}

#[test]
fn every_message_of_version_4_has_its_golden_bytes() {
    let now: Vec<String> = lines(&from_host()).into_iter().chain(lines(&from_pendant())).collect();
    let golden: Vec<&str> = GOLDEN.lines().collect();
    assert_eq!(now, golden, "\nwhole file now:\n{}\n", now.join("\n"));
}

fn golden_payloads() -> BTreeMap<&'static str, Vec<u8>> {
    golden_of(GOLDEN)
}

fn golden_of(golden: &'static str) -> BTreeMap<&'static str, Vec<u8>> {
    let unhex = |text: &str| {
        (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).expect("hex")).collect()
    };
    let entry = |line: &'static str| {
        let mut words = line.split(' ');
        (words.next().expect("name"), unhex(words.next().expect("payload")))
    };
    golden.lines().map(entry).collect()
}

fn reads_back<M: DeserializeOwned + PartialEq + Debug>(messages: &[(&'static str, M)]) {
    let golden = golden_payloads();
    for (name, message) in messages {
        assert_eq!(decode::<M>(&golden[name]).as_ref(), Ok(message), "{name}");
    }
}

#[test]
fn the_golden_bytes_decode_to_their_messages() {
    reads_back(&from_host());
    reads_back(&from_pendant());
}

/// Line of a golden file by its name: the payload.
fn payload_in<'g>(golden: &'g str, name: &str) -> &'g str {
    word_in(golden, name, 1)
}

/// The frame.
fn frame_in<'g>(golden: &'g str, name: &str) -> &'g str {
    word_in(golden, name, 2)
}

fn word_in<'g>(golden: &'g str, name: &str, word: usize) -> &'g str {
    let words = golden.lines().map(|line| line.split(' ').collect::<Vec<_>>());
    words.into_iter().find(|words| words[0] == name).map(|words| words[word]).expect("in the file")
}

#[test]
fn hello_and_its_refusals_have_in_all_versions_the_layout_of_version_1() {
    let hello = Hello { version: 1, schema: 0x1234_5678, nonce: 0xCAFE_F00D };
    let hello = FromHost { session: 0, message: HostMessage::Hello(hello) };
    assert_eq!(hex(&payload_of(&frame_of(&hello))), payload_in(FIRST, "hello"));
    let refused = |why| {
        let message = PendantMessage::HelloRefused(HelloRefused { nonce: 0xCAFE_F00D, why });
        hex(&payload_of(&frame_of(&FromPendant { session: 0x0BAD_CAFE, message })))
    };
    let version = HelloRefusal::Version { host: 2, pendant: 1 };
    assert_eq!(
        refused(version),
        payload_in(FIRST, "hello-refused-version"),
        "what an old pendant says to this host"
    );
    let schema = HelloRefusal::Schema { host: 2, pendant: 1 };
    assert_eq!(refused(schema), payload_in(FIRST, "hello-refused-schema"));
    assert_eq!(refused(HelloRefusal::Busy), payload_in(FIRST, "hello-refused-busy"));
}

#[test]
fn an_old_host_is_refused_with_both_versions() {
    let mut pendant =
        weldpath_core::pendant::Pendant::<64>::new(&weldpath_core::pendant::Config::default(), 1)
            .expect("a sound configuration");
    let payload: Vec<u8> = golden_of(FIRST)["hello"].clone();
    let weldpath_core::pendant::Action::Send(answer) = pendant.receive(Received::Payload(&payload)) else {
        panic!("no answer")
    };
    let why = HelloRefusal::Version { host: 1, pendant: 4 };
    assert_eq!(answer.message, PendantMessage::HelloRefused(HelloRefused { nonce: 0xCAFE_F00D, why }));
}

#[test]
fn the_schema_number_is_the_checksum_of_the_golden_payloads() {
    let mut all = Vec::new();
    for line in GOLDEN.lines() {
        let name = line.split(' ').next().expect("name");
        all.extend_from_slice(&golden_payloads()[name]);
    }
    assert_eq!(SCHEMA, CRC32.checksum(&all), "{:#010x}", CRC32.checksum(&all));
}

#[test]
fn the_protocol_document_shows_the_golden_bytes() {
    for line in GOLDEN.lines() {
        let mut words = line.split(' ');
        let (name, payload) = (words.next().expect("name"), words.next().expect("payload"));
        let row = format!("| `{name}` | `{payload}` |");
        assert!(PROTOCOL.contains(&row), "docs/protocol.md lacks:\n{row}");
    }
    let rows =
        PROTOCOL.lines().filter(|line| line.starts_with("| `") && line.matches('`').count() == 4).count();
    assert_eq!(rows, GOLDEN.lines().count(), "the document shows other bytes beside the golden ones");
    let ping = GOLDEN.lines().find(|line| line.starts_with("ping ")).and_then(|line| line.split(' ').nth(2));
    assert!(
        PROTOCOL.contains(ping.expect("the ping's frame")),
        "docs/protocol.md lacks the frame of the ping"
    );
    assert!(
        PROTOCOL.contains(&format!("{SCHEMA:#010x}")),
        "docs/protocol.md lacks the schema number {SCHEMA:#010x}"
    );
}

#[test]
fn the_frames_of_the_robot_port_have_their_golden_bytes_and_no_others_are_read() {
    let set_point = port::WireSetPoint {
        lost: 3,
        session: 0x0BAD_CAFE,
        tick: 100_000,
        robot: 0xCAFE_F00D,
        heard: 4_711,
        pose: Some(pose()),
        motion: true,
        arc: true,
    };
    let none = port::WireSetPoint {
        lost: 0,
        tick: 100_001,
        robot: 0,
        heard: 0,
        pose: None,
        motion: false,
        arc: false,
        ..set_point
    };
    let actual = port::Actual {
        drives: port::Drives::Following,
        lost: 2,
        robot: 0xCAFE_F00D,
        sequence: 4_712,
        session: 0x0BAD_CAFE,
        heard: 100_000,
        pose: pose(),
        error_um: 600,
    };
    let stopped = port::Actual {
        drives: port::Drives::Stopped,
        lost: u16::MAX,
        sequence: u32::MAX,
        heard: u32::MAX,
        error_um: 0,
        ..actual
    };
    for (name, frame) in [("set-point", set_point), ("set-point-none", none)] {
        assert_eq!(hex(&told(&frame)), frame_in(PORT, name));
        assert_eq!(port::WireSetPoint::from_bytes(&golden_of(PORT)[name]), Some(frame));
    }
    for (name, frame) in [("actual", actual), ("actual-stopped", stopped)] {
        assert_eq!(hex(&frame_of_actual(&frame)), frame_in(PORT, name));
        assert_eq!(port::Actual::from_bytes(&golden_of(PORT)[name]), Some(frame));
    }
    // Another version, length, flag or state of drives.
    for (at, byte) in [(0, 1), (0, 3), (1, 8), (1, 3)] {
        let (mut to, mut back) = (golden_of(PORT)["set-point"].clone(), golden_of(PORT)["actual"].clone());
        (to[at], back[at]) = (byte, byte);
        assert_eq!(port::WireSetPoint::from_bytes(&to).is_none(), (at, byte) != (1, 3), "{at} {byte}");
        assert_eq!(port::Actual::from_bytes(&back), None, "{at} {byte}");
    }
    let payload = &golden_of(PORT)["set-point"];
    assert_eq!(port::Actual::from_bytes(payload), None);
    assert_eq!(port::WireSetPoint::from_bytes(&payload[1..]), None);
}

#[test]
fn the_largest_messages_fit_their_buffers_exactly() {
    let position_um = [i32::MIN; 3];
    let pose = WirePose { position_um, orientation_q15: [i16::MIN; 4] };
    let waypoints = Bounded::from_slice(&[WireWaypoint { pose, feed_um_s: u32::MAX, weld: true }; MAX_CHUNK])
        .expect("full");
    let chunk = HostMessage::Chunk(Chunk { path: u16::MAX, first: u32::MAX, waypoints });
    let points = Bounded::from_slice(&[Offset { um: [-1; 3] }; MAX_PATCH]).expect("full");
    let score = Command::Score(WirePatch { radius_um: u32::MAX, threshold_milli: u32::MAX, points });
    let score = HostMessage::Control { request: u16::MAX, command: score };
    let host =
        [chunk, score].map(|message| payload_of(&frame_of(&FromHost { session: u32::MAX, message })).len());
    assert_eq!(host.into_iter().max(), Some(MAX_FROM_HOST));
    let sample = Sample { tick: u32::MAX, segment: u32::MAX, alpha_q24: u32::MAX, pose, arc: true };
    let samples = PendantMessage::Samples(Bounded::from_slice(&[sample; MAX_SAMPLES]).expect("full"));
    let samples = payload_of(&frame_of(&FromPendant { session: u32::MAX, message: samples }));
    assert_eq!(samples.len(), MAX_FROM_PENDANT);
}
