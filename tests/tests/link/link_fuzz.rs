//! Hostile input: bytes without sense, and sense of every kind behind a correct checksum.
//!
//! Built with overflow checks and bounds checks on, so a panic anywhere in core fails the test. After every input the
//! pendant has to be in a legal state: no arc outside Running or without the switch, the load inside its limits.

use heapless::Vec as Bounded;
use weldpath_core::interlock::State;
use weldpath_core::sender::{self, Sender};
use weldpath_core::wire::frame::{decode, encode};
use weldpath_core::wire::*;
use weldpath_tests::adversary::Random;
use weldpath_tests::bench::Bench;
use weldpath_tests::world::{RING, begin, winding_path};

/// Mostly small numbers, often extremes.
fn number(random: &mut Random) -> u32 {
    match random.below(6) {
        0 => u32::MAX - random.below(4) as u32,
        1 => 1 << random.below(32),
        2 => random.bits() as u32,
        _ => random.below(20) as u32,
    }
}

fn word(random: &mut Random) -> i16 {
    [0, 1, -1, Q15_ONE, -Q15_ONE, i16::MIN, random.bits() as i16][random.below(7) as usize]
}

fn pose(random: &mut Random) -> WirePose {
    let position_um = [0; 3].map(|_: i32| number(random) as i32);
    let orientation_q15 = if random.chance(0.7) {
        WirePose::IDENTITY.orientation_q15
    } else {
        [0; 4].map(|_: i16| word(random))
    };
    WirePose { position_um, orientation_q15 }
}

fn hand(random: &mut Random) -> Hand {
    Hand {
        palm_um: [0; 3].map(|_: i32| number(random) as i32),
        direction_q15: [0; 3].map(|_: i16| word(random)),
        normal_q15: [0; 3].map(|_: i16| word(random)),
        grab_permille: number(random) as u16,
        pinch_permille: number(random) as u16,
        confidence_permille: number(random) as u16,
        extended: number(random) as u8,
    }
}

fn chunk(random: &mut Random, path: &[WireWaypoint], load: Option<Ack>) -> Chunk {
    let ack = load.unwrap_or(Ack { path: number(random) as u16, next: 0, sack: 0, limit: 0 });
    let ahead = if random.chance(0.5) { 0 } else { 4 * random.below(20) as u32 };
    let first = if random.chance(0.8) { ack.next.wrapping_add(ahead) } else { number(random) };
    let from = (first as usize).min(path.len());
    let len = if random.chance(0.9) { 4 } else { random.below(9) as usize };
    let mut waypoints: Bounded<WireWaypoint, MAX_CHUNK> = path[from..].iter().take(len).copied().collect();
    if random.chance(0.002) {
        let at = random.below(8) as usize;
        if let Some(waypoint) = waypoints.get_mut(at) {
            *waypoint =
                WireWaypoint { pose: pose(random), feed_um_s: number(random), weld: random.chance(0.5) };
        }
    }
    let path = if random.chance(0.95) { ack.path } else { number(random) as u16 };
    Chunk { path, first, waypoints }
}

fn command(random: &mut Random, seen: &Telemetry, path: &[WireWaypoint]) -> Command {
    let id = seen.load.map_or(number(random) as u16, |load| load.path);
    match random.below(16) {
        0 => Command::GetLimits,
        1 => Command::SetTool { tool: pose(random) },
        2 => Command::SetJog(WireJog {
            start: pose(random),
            box_center_um: pose(random).position_um,
            box_size_um: [0; 3].map(|_: u32| number(random)),
            steer_right: random.chance(0.5),
            base_from_sensor_q15: pose(random).orientation_q15,
        }),
        3 => Command::HandFrame(WireHandFrame {
            time_ms: number(random),
            left: random.chance(0.5).then(|| hand(random)),
            right: random.chance(0.5).then(|| hand(random)),
        }),
        4 => Command::Score(WirePatch {
            radius_um: number(random),
            threshold_milli: number(random),
            points: (0..random.below(65)).map(|_| Offset { um: [0; 3].map(|_: i16| word(random)) }).collect(),
        }),
        5 | 6 => odd_begin(random, path),
        7 => {
            let digest = if random.chance(0.7) { path_digest(path).unwrap_or(0) } else { number(random) };
            Command::Commit { path: id, digest }
        }
        8 => Command::Abort { path: id },
        9 => Command::ArcArm { armed: random.chance(0.9) },
        10 | 11 => Command::Start { path: id },
        12 => [Command::Hold, Command::Stop][random.below(2) as usize].clone(),
        13 => {
            let changes = if random.chance(0.8) { seen.changes } else { number(random) as u16 };
            Command::Resume { path: id, changes, back_um: number(random) }
        }
        14 => Command::Reset,
        _ => Command::Subscribe { every: number(random) as u16 },
    }
}

/// What an honest host would say next: else the fuzzer would never get beyond loading.
fn honest(seen: &Telemetry, path: &[WireWaypoint], fresh: u16) -> Command {
    let id = seen.load.map_or(1, |load| load.path);
    match seen.state {
        State::Loading if seen.load.is_some_and(|load| load.next == path.len() as u32) => {
            Command::Commit { path: id, digest: path_digest(path).unwrap_or(0) }
        }
        State::Loading | State::Ready if seen.pins & Telemetry::ARMED == 0 => Command::ArcArm { armed: true },
        State::Loading | State::Ready => Command::Start { path: id },
        State::Held => Command::Resume { path: id, changes: seen.changes, back_um: 0 },
        State::Idle | State::Disabled => Command::Begin(begin(fresh, path, true)),
        State::Fault => Command::Reset,
        _ => Command::GetLimits,
    }
}

fn odd_begin(random: &mut Random, path: &[WireWaypoint]) -> Command {
    let mut begin = begin(number(random) as u16, path, true);
    match random.below(12) {
        0 => begin.total = number(random),
        1 => begin.chunk = number(random) as u8,
        2 => begin.reach_um = number(random),
        3 => begin.max_step_um = number(random),
        4 => begin.min_half_turn_cos_q15 = word(random),
        5 => begin.streamed = false,
        _ => {}
    }
    Command::Begin(begin)
}

fn message(random: &mut Random, bench: &mut Bench, path: &[WireWaypoint]) -> FromHost {
    let seen = bench.pendant.telemetry();
    let session = if random.chance(0.99) { bench.session } else { number(random) };
    let message = match random.below(20) {
        0 => HostMessage::Hello(Hello { version: VERSION, schema: SCHEMA, nonce: random.below(3) as u32 }),
        1 => {
            bench.pings = bench.pings.wrapping_add(1);
            // One from far ahead that counts would silence the honest ones for good.
            let count =
                if random.chance(0.9) { bench.pings } else { bench.pings.wrapping_sub(number(random) >> 1) };
            let echo = if random.chance(0.9) { seen.tick } else { number(random) };
            HostMessage::Ping(Ping { count, echo, token: number(random) })
        }
        2 => HostMessage::FaultSeen { number: number(random) as u16 },
        3..=9 => {
            bench.request =
                bench.request.wrapping_add(u16::from(session == bench.session && random.chance(0.95)));
            let idle = matches!(seen.state, State::Disabled | State::Idle | State::Fault);
            let wild = random.chance(if idle { 0.5 } else { 0.03 });
            let command =
                if wild { command(random, &seen, path) } else { honest(&seen, path, bench.request) };
            HostMessage::Control { request: bench.request, command }
        }
        _ => HostMessage::Chunk(chunk(random, path, seen.load)),
    };
    FromHost { session, message }
}

fn check(bench: &mut Bench) {
    let tick = bench.tick();
    let seen = bench.pendant.telemetry();
    let allowed = seen.state == State::Running && bench.panel.enable && !bench.panel.e_stop;
    assert!(!tick.outputs.arc || allowed, "{seen:?}");
    if let Some(load) = seen.load {
        assert!(load.next <= load.limit && load.limit - load.next <= RING as u32, "{load:?}");
        assert!(seen.segment <= load.next && seen.alpha_q24 <= 1 << 24, "{seen:?}");
    }
    assert!(bench.pendant.speed_um_s() <= 250_000.0);
    for _ in 0..4 {
        if let Some(frame) = bench.pendant.transmit() {
            let mut out = [0; MAX_PENDANT_FRAME];
            assert!(encode(&frame, &mut out).is_ok(), "every message fits: {frame:?}");
        }
    }
}

fn pull_at_pins(random: &mut Random, bench: &mut Bench) {
    bench.panel.e_stop = random.chance(0.001);
    let counts = bench.pendant.telemetry().pins & Telemetry::ENABLED != 0;
    bench.panel.enable = if counts { random.chance(0.995) } else { !bench.panel.enable };
    bench.panel.local_reset = random.chance(0.2);
    bench.panel.manual ^= random.chance(0.002);
    bench.panel.confirm = random.chance(0.2);
    bench.panel.defect = random.chance(0.0005).then_some(weldpath_core::interlock::Fault::Channels);
}

/// After silence another host may open a session.
fn next_host(bench: &mut Bench, nonce: u32) {
    let PendantMessage::HelloAck(ack) = bench.hello(nonce) else { panic!("silent and standing") };
    (bench.session, bench.request, bench.pings) = (session_id(ack.boot, nonce), 0, 0);
}

#[test]
fn sense_of_every_kind_behind_a_right_checksum_leaves_a_legal_state() {
    let mut random = Random::new(21);
    let path = winding_path(&mut random, 700);
    let mut bench = Bench::enabled();
    let (mut messages, mut moved, mut sessions) = (0_u64, 0_u64, 0_u64);
    for _ in 0..2_000_000 {
        let frame = message(&mut random, &mut bench, &path);
        let _ = bench.frame(&frame);
        messages += 1;
        if random.chance(0.3) {
            pull_at_pins(&mut random, &mut bench);
            check(&mut bench);
            moved += u64::from(bench.pendant.speed_um_s() > 0.0);
        }
        if random.chance(1e-5) {
            (0..300).for_each(|_| check(&mut bench));
            next_host(&mut bench, messages as u32);
            sessions += 1;
        }
    }
    println!("{messages} messages, {sessions} sessions, {moved} ticks of motion");
    assert!(moved > 100_000 && sessions > 3, "the fuzzer gets to where it matters: {moved} {sessions}");
}

#[test]
fn damaged_payloads_behind_a_right_checksum_leave_a_legal_state() {
    let mut random = Random::new(22);
    let path = winding_path(&mut random, 700);
    let mut bench = Bench::enabled();
    let mut decoded = 0_u64;
    for round in 0..3_000_000_u32 {
        let frame = message(&mut random, &mut bench, &path);
        let mut out = [0; MAX_HOST_FRAME];
        let len = encode(&frame, &mut out).expect("fits");
        let mut payload = cobs::decode_vec(&out[1..len - 1]).expect("our own frame");
        payload.truncate(payload.len() - 4);
        for _ in 0..random.below(4) {
            let at = random.below(payload.len() as u64) as usize;
            payload[at] = [0, 0x7F, 0x80, 0xFF, random.bits() as u8][random.below(5) as usize];
        }
        if random.chance(0.1) {
            payload.truncate(random.below(payload.len() as u64) as usize);
        }
        decoded += u64::from(decode::<FromHost>(&payload).is_ok());
        let _ = bench.payload(&payload);
        if round % 8 == 0 {
            check(&mut bench);
        }
    }
    println!("3000000 payloads, {decoded} of them messages");
    assert!(decoded > 500_000);
}

#[test]
fn bytes_without_sense_leave_a_legal_state() {
    let mut random = Random::new(23);
    let mut bench = Bench::enabled();
    for _ in 0..300_000 {
        let len = random.below(200) as usize;
        let zeros = random.chance(0.5);
        let bytes: Vec<u8> =
            (0..len).map(|_| if zeros && random.chance(0.05) { 0 } else { random.bits() as u8 }).collect();
        let _ = bench.bytes(&bytes);
        check(&mut bench);
    }
    assert_eq!(bench.pendant.state(), State::Idle);
}

#[test]
fn a_sender_survives_any_pendant() {
    let mut random = Random::new(24);
    let path = winding_path(&mut random, 700);
    let mut sender = Sender::new(&sender::Config { chunk: 4, window: 17 });
    let (mut now_us, mut session) = (0, 0);
    for round in 0..1_000_000_u64 {
        if round % 1_000 == 0 {
            sender.open(round as u32);
            session = session_id(1, round as u32);
            let limits = Limits { ring: number(&mut random), ..limits() };
            let ack = HelloAck {
                version: VERSION,
                nonce: round as u32,
                boot: 1,
                tick: 7,
                request: 0,
                firmware: Firmware::default(),
                limits,
            };
            let _ = sender.receive(FromPendant { session, message: PendantMessage::HelloAck(ack) }, now_us);
            assert!(sender.load(begin(1, &path, true), &path));
        }
        now_us += random.below(5_000);
        for _ in 0..random.below(4) {
            if let Some(FromHost { message: HostMessage::Chunk(chunk), .. }) = sender.poll(now_us, &path) {
                let from = chunk.first as usize;
                assert_eq!(chunk.waypoints, path[from..from + chunk.waypoints.len()]);
            }
        }
        let message = pendant_message(&mut random);
        let _ = sender.receive(FromPendant { session, message }, now_us);
    }
}

fn limits() -> Limits {
    let Answer::Limits(limits) = Bench::enabled().command(Command::GetLimits) else { panic!("limits") };
    limits
}

fn pendant_message(random: &mut Random) -> PendantMessage {
    let ack = Ack { path: 1, next: number(random), sack: random.bits() as u16, limit: number(random) };
    match random.below(6) {
        0 | 1 => PendantMessage::Reply { request: random.below(4) as u16, answer: Answer::Done },
        2 => PendantMessage::Pong { token: number(random), tick: number(random) },
        3 => PendantMessage::FaultReport {
            number: number(random) as u16,
            fault: weldpath_core::interlock::Fault::Digest,
        },
        _ => PendantMessage::Ack(ack),
    }
}
