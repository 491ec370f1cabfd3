//! Counts the instructions of the pendant's work, in QEMU with `-icount shift=10`; `docs/cost.md` holds the figures.
//!
//! Prints `name<TAB>instructions` per line on the semihosting console and ends the emulator.
#![no_std]
#![no_main]

use core::hint::black_box;

use cortex_m_semihosting::{debug, hprintln};
use static_cell::ConstStaticCell;
use weldpath_core::gesture::{Attitude, CameraPose, CaptureGesture, Config, Fingers, HandFrame, Steering};
use weldpath_core::path::TorchPose;
use weldpath_core::path::interpolation::Segment;
use weldpath_core::pendant::{self, Panel, Pendant, PortConfig, Slot};
use weldpath_core::seam::{Ball, RatioThreshold};
use weldpath_core::tasks::Workspace;
use weldpath_core::wire::frame;
use weldpath_core::wire::port::{self, ActualDeframer};
use weldpath_core::wire::{
    self, Begin, Chunk, Command, FromHost, Hello, HostDeframer, HostMessage, MAX_CHUNK, MAX_HOST_FRAME,
    MAX_PATCH, Offset, Ping, ProcessTimes, WirePose, WireWaypoint,
};
use weldpath_core::{Orientation, Point, Vector, rotation};
use weldpath_firmware::board::Stopwatch;
use weldpath_firmware::torch::{RING, TICK_HZ};

#[cortex_m_rt::entry]
fn main() -> ! {
    let watch = Stopwatch::start();
    set_points(&watch);
    gestures(&watch);
    edge_scores(&watch);
    link(&watch, None);
    link(&watch, Some(PortConfig::default()));
    debug::exit(debug::EXIT_SUCCESS);
    loop {
        cortex_m::asm::wfi();
    }
}

fn print(name: &str, instructions: u32) {
    hprintln!("{}\t{}", name, instructions);
}

/// Mean over `runs` of `work`, whose result is kept from being optimised away.
fn mean<T>(watch: &Stopwatch, runs: u32, mut work: impl FnMut(u32) -> T) -> u32 {
    let total: u32 = (0..runs).map(|run| watch.instructions(|| black_box(work(black_box(run))))).sum();
    total / runs
}

/// 2 mm segments at 50 mm/s: 20 set-points each.
#[inline(never)]
fn set_points(watch: &Stopwatch) {
    let pose = |k: u32| {
        let orientation = rotation::from_rotation_vector(&Vector::new(0.0, 0.05 * k as f32, 3.0));
        TorchPose { position_mm: Point::new(400.0 + 2.0 * k as f32, 20.0, 300.0), orientation }
    };
    let mut segment = Segment::new(&pose(0), &pose(1));
    let set_up = mean(watch, 10, |run| segment = Segment::new(&pose(run), &pose(run + 1)));
    let poses = mean(watch, 20, |run| segment.at(run as f32 * 0.05));
    let endpoints = mean(watch, 10, |run| (pose(run), pose(run + 1)));
    print("set-point, mean with its share of the segment", poses + (set_up - endpoints) / 20);
}

#[inline(never)]
fn gestures(watch: &Stopwatch) {
    let start =
        CameraPose { position_mm: Point::new(400.0, 0.0, 300.0), orientation: Orientation::identity() };
    let frame = |run: u32, palm_mm: Point| {
        let tilt = run as f32 * 0.01;
        let (direction, normal) = (Vector::new(tilt, 0.1, -1.0), Vector::new(0.0, -1.0, tilt));
        let attitude = Attitude::from_direction_and_normal(&direction, &normal)?;
        HandFrame::new(u64::from(run) * 9000, palm_mm, attitude, 0.1, 0.9, Fingers::ALL)
    };
    for (name, palm_mm) in [
        ("gesture frame, rotation", Point::new(0.0, 200.0, 0.0)),
        ("gesture frame, linear", Point::new(90.0, 200.0, 0.0)),
    ] {
        let (mut steering, mut capture) = (Steering::new(Config::default()), CaptureGesture::default());
        let mut camera = start;
        let instructions = mean(watch, 100, |run| {
            let hand = frame(run, black_box(palm_mm));
            camera = steering.follow(hand.as_ref(), &camera).target;
            capture.observe(hand.as_ref(), u64::from(run) * 9000)
        });
        print(name, instructions);
        black_box(camera);
    }
}

/// 64 points about a corner, 32 neighbours each.
#[inline(never)]
fn edge_scores(watch: &Stopwatch) {
    static WORKSPACE: ConstStaticCell<Workspace> = ConstStaticCell::new(Workspace::empty());
    let patch = WORKSPACE.take();
    let offset = |k: i16| {
        let (x, v) = (k % 8 * 1000, k / 16 * 1000 + 500);
        Offset { um: if (k / 8) % 2 == 0 { [x, v, 10 * k] } else { [x, 10 * k, v] } }
    };
    let points = (0..MAX_PATCH as i16).map(offset).collect();
    let wanted = black_box(wire::WirePatch { radius_um: 20_000, threshold_milli: 53_000, points });
    let (Some(ball), Some(threshold)) = (Ball::new(20.0, Ball::LEAST), RatioThreshold::new(53.0)) else {
        return;
    };
    let search = watch.instructions(|| patch.find(&wanted, &ball));
    let measured = watch.instructions(|| patch.measure());
    let scores = mean(watch, MAX_PATCH as u32, |k| patch.score(k as usize, threshold));
    print("edge score of 32 neighbours, lists given", measured / MAX_PATCH as u32 + scores);
    print("whole patch with its search", search + measured + scores * MAX_PATCH as u32);
}

/// A path loaded and followed.
#[inline(never)]
fn link(watch: &Stopwatch, port: Option<PortConfig>) {
    static SLOTS: [ConstStaticCell<[Slot; RING]>; 2] =
        [const { ConstStaticCell::new([Slot::EMPTY; RING]) }; 2];
    let slots = SLOTS[usize::from(port.is_some())].take();
    let (bytes, told) = (ActualDeframer::new(), [0; port::SET_POINT_FRAME]);
    let mut robot = RobotEnd { sequence: 0, heard: None, bytes, told };
    let config = pendant::Config { tick_us: 1_000_000 / TICK_HZ, port, ..pendant::Config::default() };
    let Some(mut pendant) = Pendant::<RING, _>::with_slots(&config, 1, slots.as_mut_slice()) else {
        return;
    };
    let mut host = Host { session: 0, requests: 0, deframer: HostDeframer::new() };
    host.say(
        &mut pendant,
        HostMessage::Hello(Hello { version: wire::VERSION, schema: wire::SCHEMA, nonce: 2 }),
    );
    host.session = wire::session_id(1, 2);
    let released = Panel::default();
    let gripped = Panel { enable: true, ..released };
    host.command(&mut pendant, Command::SetTool { tool: WirePose::IDENTITY });
    host.command(&mut pendant, Command::Begin(begin()));
    let chunks = TOTAL / MAX_CHUNK as u32;
    let bytes: u32 = (0..chunks).map(|k| host.chunk(watch, &mut pendant, k)).sum();
    if port.is_none() {
        print("received chunk of 8 waypoints", bytes / chunks);
    }
    let digest = digest();
    host.command(&mut pendant, Command::Commit { path: 1, digest });
    let confirmed = Panel { confirm: true, ..gripped };
    for panel in [&released, &gripped, &confirmed] {
        let answer = robot.answer();
        robot.tick(&mut pendant, panel, &answer);
    }
    let answer = robot.answer();
    robot.hear(&mut pendant, &answer);
    host.command(&mut pendant, Command::Start { path: 1 });
    let (mut moved, mut ticks) = (0, 0);
    for run in 0..1000_u32 {
        if run.is_multiple_of(50) {
            let echo = pendant.telemetry().tick;
            host.say(&mut pendant, HostMessage::Ping(Ping { count: run + 1, echo, token: run }));
        }
        let answer = robot.answer();
        ticks += watch.instructions(|| moved += u32::from(robot.tick(&mut pendant, &gripped, &answer)));
    }
    // 63 segments of 2 mm at 50 mm/s are 1260 ticks and the ramp: all of them moved, or the figure means nothing.
    if moved == 1000 {
        let name = match port {
            None => "whole tick while moving, interlock and speed plan included",
            Some(_) => "the same with a robot port, both frames included",
        };
        print(name, ticks / 1000);
    }
}

/// The robot's end of its line; nobody there without a port.
struct RobotEnd {
    sequence: u32,
    heard: Option<port::WireSetPoint>,
    bytes: ActualDeframer,
    told: [u8; port::SET_POINT_FRAME],
}

type Frame = heapless::Vec<u8, { port::ACTUAL_FRAME }>;

impl RobotEnd {
    /// The answer to the newest set-point: exactly there. Empty without one.
    #[inline(never)]
    fn answer(&mut self) -> Frame {
        let Some(heard) = self.heard else { return Frame::new() };
        self.sequence = self.sequence.wrapping_add(1);
        let actual = port::Actual {
            // A nonce has hardly ever a byte of zero.
            robot: 0x5eed_c0de,
            sequence: self.sequence,
            session: heard.session,
            heard: heard.tick,
            lost: 0,
            pose: heard.pose.unwrap_or(waypoint(0).pose),
            error_um: 600,
            drives: port::Drives::Following,
        };
        let mut bytes = [0; port::ACTUAL_FRAME];
        actual.write(&mut bytes);
        Frame::from_slice(&bytes).unwrap_or_default()
    }

    #[inline(never)]
    fn hear(&mut self, pendant: &mut Lent, answer: &[u8]) {
        let mut rest = answer;
        while !rest.is_empty() {
            let received;
            (received, rest) = self.bytes.feed(rest);
            if let Some(received) = received {
                pendant.receive_robot(received);
            }
        }
    }

    /// A tick as the board does it; whether a set-point came of it.
    #[inline(never)]
    fn tick(&mut self, pendant: &mut Lent, panel: &Panel, answer: &[u8]) -> bool {
        self.hear(pendant, answer);
        let tick = pendant.tick(panel);
        if let Some(told) = &tick.robot {
            told.write(black_box(&mut self.told));
        }
        self.heard = tick.robot;
        tick.set_point.is_some()
    }
}

const TOTAL: u32 = 64;

fn begin() -> Begin {
    Begin {
        path: 1,
        total: TOTAL,
        chunk: MAX_CHUNK as u8,
        streamed: false,
        reach_um: 1_000_000,
        max_step_um: 10_000,
        min_half_turn_cos_q15: 32_000,
        arc: true,
        times: ProcessTimes::default(),
    }
}

fn waypoint(k: u32) -> WireWaypoint {
    let position_um = [400_000 + 2_000 * k as i32, 1_000, 200_000];
    let pose = WirePose { position_um, orientation_q15: [32_767, 0, 0, 8 * k as i16] };
    WireWaypoint { pose, feed_um_s: 50_000, weld: false }
}

#[inline(never)]
fn digest() -> u32 {
    let path: [WireWaypoint; TOTAL as usize] = core::array::from_fn(|k| waypoint(k as u32));
    wire::path_digest(&path).unwrap_or_default()
}

/// The messages of a host, encoded as on the line.
struct Host {
    session: u32,
    requests: u16,
    deframer: HostDeframer,
}

type Lent = Pendant<RING, &'static mut [Slot]>;

impl Host {
    #[inline(never)]
    fn say(&mut self, pendant: &mut Lent, message: HostMessage) {
        let mut bytes = [0; MAX_HOST_FRAME];
        let length = frame::encode(&FromHost { session: self.session, message }, &mut bytes).unwrap_or(0);
        self.hear(pendant, &bytes[..length]);
    }

    #[inline(never)]
    fn hear(&mut self, pendant: &mut Lent, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let received;
            (received, rest) = self.deframer.feed(rest);
            if let Some(received) = received {
                let _ = black_box(pendant.receive(received));
            }
        }
    }

    fn command(&mut self, pendant: &mut Lent, command: Command) {
        self.requests += 1;
        self.say(pendant, HostMessage::Control { request: self.requests, command });
    }

    /// Instructions from the chunk's first byte to its acknowledgement.
    #[inline(never)]
    fn chunk(&mut self, watch: &Stopwatch, pendant: &mut Lent, k: u32) -> u32 {
        let first = k * MAX_CHUNK as u32;
        let waypoints = (first..first + MAX_CHUNK as u32).map(waypoint).collect();
        let message = HostMessage::Chunk(Chunk { path: 1, first, waypoints });
        let mut bytes = [0; MAX_HOST_FRAME];
        let length = frame::encode(&FromHost { session: self.session, message }, &mut bytes).unwrap_or(0);
        watch.instructions(|| self.hear(pendant, black_box(&bytes[..length])))
    }
}
