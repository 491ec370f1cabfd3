//! What the pendant insists on before and while anything moves: where the torch is, who is alive, how fast, and what the
//! power source says. Each rule is one that findings on an earlier version showed to be missing.

use weldpath_core::interlock::{Cause, Fault, State};
use weldpath_core::pendant::{self, Tick};
use weldpath_core::wire::{
    self, Answer, AttachRefusal, Command, Field, Hand, HostMessage, PendantMessage, Ping, ProcessTimes,
    Q15_ONE, Refusal, Telemetry, WireHandFrame, WireJog, WirePose, WireWaypoint,
};
use weldpath_tests::bench::{Bench, NONCE};
use weldpath_tests::world;

fn at(position_um: [i32; 3]) -> WirePose {
    WirePose { position_um, ..WirePose::IDENTITY }
}

/// A straight path along x from `x_um` on, 1 mm steps.
fn line(x_um: i32, total: u32, feed_um_s: u32, weld: bool) -> Vec<WireWaypoint> {
    let waypoint = |k: u32| WireWaypoint { pose: at([x_um + k as i32 * 1_000, 0, 200_000]), feed_um_s, weld };
    (0..total).map(waypoint).collect()
}

fn arm() -> Command {
    Command::ArcArm { armed: true }
}

fn start() -> Command {
    Command::Start { path: 1 }
}

fn resume(bench: &Bench) -> Command {
    Command::Resume { path: 1, changes: bench.pendant.telemetry().changes, back_um: 0 }
}

fn running(path: &[WireWaypoint]) -> Bench {
    let mut bench = Bench::enabled();
    bench.load(1, path);
    assert_eq!(bench.command(arm()), Answer::Done);
    assert_eq!(bench.command(start()), Answer::Done);
    bench
}

/// Running into the middle of a seam, the arc on.
fn welding() -> Bench {
    let mut bench = running(&line(0, 300, 50_000, true));
    bench.lively_ticks(300);
    assert!(bench.lively_tick().outputs.arc);
    bench
}

fn not_enabled() -> Answer {
    Answer::Refused(Refusal::NotEnabled)
}

// Position.

#[test]
fn after_power_on_nobody_knows_where_the_torch_is_until_the_operator_says_so() {
    let mut bench = Bench::enabled();
    let path = line(0, 20, 50_000, false);
    bench.load(1, &path);
    assert_eq!(bench.command(Command::Begin(world::begin(2, &path, false))), Answer::Done);
    let fresh = Bench::enabled();
    assert_eq!(fresh.pendant.torch(), None);
    let mut bench = fresh;
    bench.panel.confirm = true;
    bench.lively_ticks(5);
    assert_eq!(bench.pendant.torch(), None, "without a path there is no place to confirm");
    bench.panel.confirm = false;
    begin_and_send(&mut bench, &path);
    bench.grip();
    assert_eq!(bench.command(start()), Answer::Refused(Refusal::PoseUnknown));
    bench.confirm();
    assert_eq!(bench.command(start()), Answer::Done);
}

/// Loads without anybody confirming.
fn begin_and_send(bench: &mut Bench, path: &[WireWaypoint]) {
    assert_eq!(bench.command(Command::Begin(world::begin(1, path, false))), Answer::Done);
    (0..path.len().div_ceil(4)).for_each(|number| drop(bench.chunk(1, path, number)));
    let digest = wire::path_digest(path).expect("short");
    assert_eq!(bench.command(Command::Commit { path: 1, digest }), Answer::Done);
}

#[test]
fn a_path_that_begins_elsewhere_is_loaded_and_its_start_refused_with_the_distance() {
    let mut bench = Bench::enabled();
    bench.load(1, &line(0, 20, 50_000, false));
    let away = |x_um: i32, path: u16, bench: &mut Bench| {
        let waypoints = line(x_um, 20, 50_000, false);
        assert_eq!(bench.command(Command::Begin(world::begin(path, &waypoints, false))), Answer::Done);
        (0..5).for_each(|number| drop(bench.chunk(path, &waypoints, number)));
        let digest = wire::path_digest(&waypoints).expect("short");
        assert_eq!(bench.command(Command::Commit { path, digest }), Answer::Done, "accepted anywhere");
        bench.grip();
        bench.command(Command::Start { path })
    };
    let refused = Answer::Refused(Refusal::Away { distance_um: 1_851_000, turn_mrad: 0 });
    assert_eq!(away(1_851_000, 2, &mut bench), refused);
    let refused = Answer::Refused(Refusal::Away { distance_um: 2_001, turn_mrad: 0 });
    assert_eq!(away(2_001, 3, &mut bench), refused);
    assert_eq!(away(2_000, 4, &mut bench), Answer::Done);
}

#[test]
fn an_e_stop_makes_the_pose_unknown_and_a_hold_does_not() {
    let mut bench = welding();
    bench.panel.e_stop = true;
    bench.lively_ticks(50);
    assert_eq!(bench.pendant.torch(), None);
    assert_eq!(bench.pendant.telemetry().pins & Telemetry::POSE_KNOWN, 0);
    let mut bench = welding();
    assert_eq!(bench.command(Command::Hold), Answer::Done);
    assert!(bench.until(State::Held, 300));
    assert!(bench.pendant.torch().is_some());
}

// The switch.

#[test]
fn the_switch_is_gripped_anew_after_a_session_a_begin_and_every_hold_but_not_after_commit() {
    let path = line(0, 300, 50_000, true);
    let mut bench = Bench::enabled();
    begin_and_send(&mut bench, &path);
    assert_eq!(bench.command(start()), not_enabled(), "Begin");
    bench.grip();
    bench.confirm();
    bench.lively_ticks(10);
    assert_eq!(bench.command(start()), Answer::Done);
    bench.lively_ticks(100);
    assert_eq!(bench.command(Command::Hold), Answer::Done);
    assert!(bench.until(State::Held, 300));
    let go = resume(&bench);
    assert_eq!(bench.command(go.clone()), not_enabled(), "a hold");
    bench.grip();
    assert_eq!(bench.command(go), Answer::Done);
    bench.ticks(400);
    bench.hello(NONCE + 1);
    assert_eq!(bench.pendant.state(), State::Disabled, "a session");

    let long = line(0, 600, 50_000, false);
    let mut bench = Bench::enabled();
    assert_eq!(bench.command(Command::Begin(world::begin(1, &long, true))), Answer::Done);
    (0..128).for_each(|number| drop(bench.chunk(1, &long, number)));
    bench.grip();
    bench.confirm();
    assert_eq!(bench.command(start()), Answer::Done);
    while bench.pendant.telemetry().load.is_some_and(|load| load.next < 600) {
        let load = bench.pendant.telemetry().load.expect("loading");
        if load.next + 4 <= load.limit {
            drop(bench.chunk(1, &long, load.next as usize / 4));
        }
        let _ = bench.lively_tick();
    }
    let digest = wire::path_digest(&long).expect("short");
    assert_eq!(bench.command(Command::Commit { path: 1, digest }), Answer::Done);
    bench.lively_ticks(10);
    assert_eq!(bench.pendant.state(), State::Running, "Commit of a running stream");
    assert!(bench.pendant.telemetry().pins & Telemetry::ENABLED != 0);
}

#[test]
fn arming_in_held_needs_a_fresh_grip_is_dropped_on_release_and_strikes_nothing_before_a_resume() {
    let mut bench = welding();
    assert_eq!(bench.command(Command::Hold), Answer::Done);
    assert!(bench.until(State::Held, 300));
    assert_eq!(bench.command(arm()), not_enabled());
    bench.grip();
    assert_eq!(bench.command(arm()), Answer::Done);
    bench.lively_ticks(200);
    assert!(!bench.lively_tick().outputs.arc, "before Resume");
    bench.grip();
    let go = resume(&bench);
    assert_eq!(bench.command(go), Answer::Done);
    assert!(!(0..400).any(|_| bench.lively_tick().outputs.arc), "released and gripped: disarmed");
}

// Signs of life.

/// Ticks until the torch no longer runs; `each` is what comes over the line before each of them.
fn runs_on(bench: &mut Bench, mut each: impl FnMut(&mut Bench)) -> u32 {
    for tick in 0..2_000 {
        if bench.pendant.state() != State::Running {
            return tick;
        }
        each(bench);
        let _ = bench.tick();
    }
    u32::MAX
}

const LIMIT_TICKS: u32 = 101;

fn ping(bench: &Bench, ahead: u32, tick: u32) -> HostMessage {
    HostMessage::Ping(Ping { count: bench.pings.wrapping_add(ahead), echo: tick, token: 0 })
}

#[test]
fn repetition_a_recorded_ping_keeps_no_arc_burning() {
    let mut bench = welding();
    let recorded = ping(&bench, 1, bench.pendant.telemetry().tick);
    let ticks = runs_on(&mut bench, |bench| drop(bench.say(recorded.clone())));
    assert!(ticks <= LIMIT_TICKS, "{ticks}");
    assert!(bench.pendant.telemetry().counters.stale > 90);
}

#[test]
fn delay_a_ping_is_as_old_as_the_time_that_it_brings_back() {
    let mut bench = welding();
    let behind = 60;
    let mut count = 0;
    let from = bench.pendant.telemetry().tick;
    // Every ping is on its way for 120 ms, then the host dies: what is still under way buys no time.
    let ticks = runs_on(&mut bench, |bench| {
        let now = bench.pendant.telemetry().tick;
        if now < from + 200 {
            count += 1;
            drop(bench.say(ping(bench, count, now - behind)));
        } else if now - behind < from + 200 {
            count += 1;
            drop(bench.say(ping(bench, count, from + 199 - behind)));
        }
    });
    assert!(ticks <= 200 - behind + LIMIT_TICKS, "{ticks}");
    let mut bench = welding();
    let mut count = 0;
    let ticks = runs_on(&mut bench, |bench| {
        count += 1;
        let late = bench.pendant.telemetry().tick - 101;
        drop(bench.say(ping(bench, count, late)));
    });
    assert!(ticks <= LIMIT_TICKS, "later than the limit: {ticks}");
}

#[test]
fn wrong_order_an_overtaken_ping_counts_for_nothing_and_harms_nothing() {
    let mut bench = welding();
    let tick = bench.pendant.telemetry().tick;
    drop(bench.say(ping(&bench, 2, tick)));
    let stale = bench.pendant.telemetry().counters.stale;
    drop(bench.say(ping(&bench, 1, tick)));
    assert_eq!(bench.pendant.telemetry().counters.stale, stale + 1);
    bench.pings += 2;
    bench.lively_ticks(300);
    assert_eq!(bench.pendant.state(), State::Running);
}

#[test]
fn insertion_an_echo_from_the_future_or_of_another_start_is_no_life() {
    for ahead in [1, 1_000, u32::MAX / 2] {
        let mut bench = welding();
        let mut count = 0;
        let ticks = runs_on(&mut bench, |bench| {
            count += 1;
            let echo = bench.pendant.telemetry().tick.wrapping_add(ahead);
            drop(bench.say(ping(bench, count, echo)));
        });
        assert!(ticks <= LIMIT_TICKS, "{ahead}: {ticks}");
    }
}

#[test]
fn deletion_pings_that_vanish_for_less_than_the_limit_do_not_matter() {
    let mut bench = welding();
    for _ in 0..10 {
        bench.ticks(90);
        let _ = bench.lively_tick();
        assert_eq!(bench.pendant.state(), State::Running);
    }
}

#[test]
fn masquerade_neither_chunk_nor_control_nor_another_session_is_a_sign_of_life() {
    let path = line(0, 300, 50_000, true);
    let mut bench = welding();
    let ticks = runs_on(&mut bench, |bench| drop(bench.chunk(1, &path, 3)));
    assert!(ticks <= LIMIT_TICKS, "a repeated chunk: {ticks}");
    let mut bench = welding();
    let repeated = HostMessage::Control { request: bench.request, command: start() };
    let ticks = runs_on(&mut bench, |bench| drop(bench.say(repeated.clone())));
    assert!(ticks <= LIMIT_TICKS, "a repeated command: {ticks}");
    let mut bench = welding();
    let ticks = runs_on(&mut bench, |bench| {
        let _ = bench.command(Command::GetLimits);
    });
    assert!(ticks <= LIMIT_TICKS, "fresh commands: {ticks}");
    let mut bench = welding();
    let ticks = runs_on(&mut bench, |bench| {
        let session = std::mem::replace(&mut bench.session, 77);
        let _ = bench.ping();
        bench.session = session;
    });
    assert!(ticks <= LIMIT_TICKS, "another session's pings: {ticks}");
}

// Limits.

/// A torch that stays in place and turns by 30 degrees a step, as fast as the feed says.
fn spin() -> Vec<WireWaypoint> {
    let waypoint = |k: u32| {
        let half = f64::from(k) * 15_f64.to_radians();
        let q15 = [half.cos(), 0.0, half.sin(), 0.0].map(|c| (c * f64::from(Q15_ONE)).round() as i16);
        let pose = WirePose { position_um: [500_000, 0, 200_000], orientation_q15: q15 };
        WireWaypoint { pose, feed_um_s: 250_000, weld: false }
    };
    (0..60).map(waypoint).collect()
}

fn angle_rad(a: &WirePose, b: &WirePose) -> f64 {
    let chord2: f64 = a
        .orientation_q15
        .iter()
        .zip(b.orientation_q15)
        .map(|(a, b)| f64::from(*a) - f64::from(b))
        .map(|d| d * d)
        .sum();
    4.0 * (0.5 * chord2.sqrt() / f64::from(Q15_ONE)).asin()
}

#[test]
fn no_torch_turns_faster_than_it_may_and_turns_up_to_speed_within_its_acceleration() {
    let mut bench = running(&spin());
    let (mut last, mut fastest, mut speeds) = (None::<WirePose>, 0.0_f64, Vec::new());
    while bench.pendant.path().is_some() {
        let Some(now) = bench.lively_tick().set_point.map(|at| at.pose) else { continue };
        if let Some(last) = last {
            speeds.push(angle_rad(&last, &now) / 0.002);
        }
        last = Some(now);
    }
    // Half the wire's grid of 3e-5 rad in 2 ms is 0.03 rad/s.
    fastest = speeds.iter().copied().fold(fastest, f64::max);
    let limit = f64::from(pendant::Config::default().max_turn_mrad_s) * 1e-3;
    assert!(fastest > 0.9 * limit && fastest <= limit + 0.05, "{fastest} rad/s of {limit}");
    // Over 20 ms, so that the grid counts for little.
    let accel = speeds.windows(11).map(|w| (w[10] - w[0]).abs() / 0.02).fold(0.0, f64::max);
    let most = f64::from(pendant::Config::default().turn_accel_mrad_s2) * 1e-3;
    assert!(accel <= 1.1 * most + 5.0, "{accel} rad/s2 of {most}");
}

#[test]
fn manual_mode_is_25_mm_s_and_welds_nothing_that_is_faster() {
    let mut bench = Bench::enabled();
    bench.panel.manual = true;
    bench.load(1, &line(0, 40, 26_000, true));
    assert_eq!(bench.command(arm()), Answer::Done);
    assert_eq!(bench.command(start()), Answer::Refused(Refusal::TooFast { at: 0 }));
    assert_eq!(bench.command(Command::ArcArm { armed: false }), Answer::Done);
    assert_eq!(bench.command(start()), Answer::Done, "a dry run is slower");
    let fastest = (0..300).map(|_| {
        let _ = bench.lively_tick();
        bench.pendant.speed_um_s()
    });
    let fastest = fastest.fold(0.0, f32::max);
    assert!((24_900.0..=25_000.0).contains(&fastest), "{fastest}");
    let mut bench = Bench::enabled();
    bench.panel.manual = true;
    bench.load(1, &line(0, 40, 25_000, true));
    assert_eq!(bench.command(arm()), Answer::Done);
    assert_eq!(bench.command(start()), Answer::Done);
}

#[test]
fn a_stream_that_grows_too_fast_for_manual_mode_holds_before_it_welds() {
    let mut path = line(0, 600, 20_000, true);
    path[300..].iter_mut().for_each(|waypoint| waypoint.feed_um_s = 40_000);
    let mut bench = Bench::enabled();
    bench.panel.manual = true;
    assert_eq!(bench.command(Command::Begin(world::begin(1, &path, true))), Answer::Done);
    (0..70).for_each(|number| drop(bench.chunk(1, &path, number)));
    bench.grip();
    bench.confirm();
    assert_eq!(bench.command(arm()), Answer::Done);
    assert_eq!(bench.command(start()), Answer::Done);
    (70..128).for_each(|number| drop(bench.chunk(1, &path, number)));
    let (mut faster, mut ticks) = (0, 0);
    while bench.pendant.state() == State::Running && ticks < 20_000 {
        let tick = bench.lively_tick();
        ticks += 1;
        faster += u32::from(tick.outputs.arc && tick.set_point.is_some_and(|at| at.segment > 300));
    }
    assert_eq!((bench.pendant.telemetry().cause, faster), (Some(Cause::ManualFeed), 0));
}

#[test]
fn turning_the_key_while_running_holds() {
    for manual in [true, false] {
        let mut bench = Bench::enabled();
        bench.panel.manual = !manual;
        bench.load(1, &line(0, 300, 20_000, true));
        assert_eq!(bench.command(start()), Answer::Done);
        bench.lively_ticks(100);
        bench.panel.manual = manual;
        let _ = bench.lively_tick();
        assert_eq!(bench.pendant.telemetry().cause, Some(Cause::Key));
    }
}

/// Way and ticks that set-points go on after `what` at 250 mm/s; whether motion stays enabled in that time.
fn stops(what: impl Fn(&mut Bench)) -> (f64, u32, bool) {
    let mut bench = running(&line(0, 500, 250_000, false));
    bench.lively_ticks(400);
    assert!(bench.pendant.speed_um_s() > 249_000.0);
    let place = |tick: &Tick| tick.set_point.map_or(0.0, |at| f64::from(at.pose.position_um[0]) * 1e-3);
    let from = place(&bench.lively_tick());
    what(&mut bench);
    let (mut to, mut ticks, mut enabled) = (from, 0, false);
    loop {
        let tick = bench.lively_tick();
        if tick.set_point.is_none() || bench.pendant.speed_um_s() == 0.0 {
            return (to - from, ticks, enabled);
        }
        (to, ticks, enabled) = (place(&tick), ticks + 1, enabled || tick.motion);
    }
}

#[test]
fn a_released_switch_stops_the_set_points_as_fast_as_an_e_stop_and_drops_motion_at_once() {
    let (e_stop_mm, e_stop_ticks, e_stop_motion) = stops(|bench| bench.panel.e_stop = true);
    let (disable_mm, disable_ticks, disable_motion) = stops(|bench| bench.panel.enable = false);
    assert!(e_stop_mm <= 6.0 && disable_mm <= 6.0, "{e_stop_mm} and {disable_mm} mm");
    assert_eq!((disable_ticks, disable_motion), (e_stop_ticks, e_stop_motion));
    assert!(!disable_motion);
    let (hold_mm, _, hold_motion) = stops(|bench| {
        let _ = bench.command(Command::Hold);
    });
    assert!(hold_mm > 50.0 && hold_motion, "a hold is a controlled stop: {hold_mm} mm");
    println!("250 mm/s: E-stop {e_stop_mm:.2} mm, switch {disable_mm:.2} mm, hold {hold_mm:.2} mm");
}

#[test]
fn a_switch_released_while_a_hold_decelerates_stops_hard() {
    let (both_mm, ..) = stops(|bench| {
        let _ = bench.command(Command::Hold);
        bench.panel.enable = false;
    });
    assert!(both_mm <= 6.0, "{both_mm} mm");
}

// The process.

#[test]
fn the_times_of_the_arc_are_the_paths_own_and_bounded() {
    let path = line(0, 30, 50_000, true);
    let mut bench = Bench::enabled();
    for times in [
        ProcessTimes { pre_flow_ms: 10_001, ..world::times() },
        ProcessTimes { strike_ms: 9, ..world::times() },
        ProcessTimes { strike_ms: 5_001, ..world::times() },
        ProcessTimes { crater_fill_ms: 5_001, ..world::times() },
        ProcessTimes { burn_back_ms: 1_001, ..world::times() },
        ProcessTimes { post_flow_ms: 30_001, ..world::times() },
    ] {
        let begin = wire::Begin { times, ..world::begin(1, &path, false) };
        assert_eq!(
            bench.command(Command::Begin(begin)),
            Answer::Refused(Refusal::Value(Field::Time)),
            "{times:?}"
        );
    }
    let mut gas = Vec::new();
    for (id, pre_flow_ms) in [(1, 100), (2, 600)] {
        let times = ProcessTimes { pre_flow_ms, ..world::times() };
        let begin = wire::Begin { times, ..world::begin(id, &path, false) };
        assert_eq!(bench.command(Command::Begin(begin)), Answer::Done);
        (0..8).for_each(|number| drop(bench.chunk(id, &path, number)));
        let digest = wire::path_digest(&path).expect("short");
        assert_eq!(bench.command(Command::Commit { path: id, digest }), Answer::Done);
        bench.grip();
        bench.confirm();
        assert_eq!(bench.command(arm()), Answer::Done);
        assert_eq!(bench.command(Command::Start { path: id }), Answer::Done);
        gas.push((0..500).filter(|_| !bench.lively_tick().outputs.arc).take(400).count().min(400));
        let before = gas.pop().expect("counted");
        gas.push(before);
        assert!(bench.until(State::Idle, 2_000));
    }
    assert!(gas[1] >= gas[0], "{gas:?}");
}

#[test]
fn the_arc_strikes_after_the_paths_own_gas_time() {
    for pre_flow_ms in [20, 100, 600] {
        let path = line(0, 30, 50_000, true);
        let mut bench = Bench::enabled();
        let times = ProcessTimes { pre_flow_ms, ..world::times() };
        let begin = wire::Begin { times, ..world::begin(1, &path, false) };
        assert_eq!(bench.command(Command::Begin(begin)), Answer::Done);
        (0..8).for_each(|number| drop(bench.chunk(1, &path, number)));
        let digest = wire::path_digest(&path).expect("short");
        assert_eq!(bench.command(Command::Commit { path: 1, digest }), Answer::Done);
        bench.grip();
        bench.confirm();
        assert_eq!(bench.command(arm()), Answer::Done);
        assert_eq!(bench.command(start()), Answer::Done);
        let struck = (1..1_000).find(|_| bench.lively_tick().outputs.arc).expect("it strikes");
        let expected = u32::from(pre_flow_ms) / 2;
        assert!((expected..=expected + 2).contains(&struck), "{pre_flow_ms} ms: after {struck} ticks");
    }
}

#[test]
fn an_arc_is_barred_on_a_path_that_says_so() {
    let mut bench = Bench::enabled();
    let path = line(0, 8, 50_000, false);
    let begin = wire::Begin { arc: false, ..world::begin(1, &path, false) };
    assert_eq!(bench.command(Command::Begin(begin)), Answer::Done);
    (0..2).for_each(|number| drop(bench.chunk(1, &path, number)));
    bench.grip();
    assert_eq!(bench.command(arm()), Answer::Refused(Refusal::ArcBarred));
    let welded = line(0, 8, 50_000, true);
    let begin = wire::Begin { path: 2, ..begin };
    assert_eq!(bench.command(Command::Begin(begin)), Answer::Done);
    let refused = bench.chunk(2, &welded, 0);
    let barred =
        matches!(refused, PendantMessage::ChunkRefused(no) if no.why == wire::ChunkRefusal::ArcBarred);
    assert!(barred, "{refused:?}");
}

#[test]
fn a_board_on_its_fall_back_clock_loads_and_moves_and_arms_no_arc() {
    let mut bench = Bench::with(&pendant::Config { can_weld: false, ..world::config() });
    bench.load(1, &line(0, 8, 20_000, true));
    assert_eq!(bench.command(arm()), Answer::Refused(Refusal::ArcBarred));
    assert_eq!(bench.command(start()), Answer::Done);
    assert!(!(0..300).any(|_| bench.lively_tick().outputs.arc));
}

/// Ticks of current, with no arc asked for, until a fault.
fn stray(bench: &mut Bench, limit: u32) -> Option<u32> {
    (1..=limit).find(|_| {
        let _ = bench.ping();
        bench.panel.established = true;
        let _ = bench.pendant.tick(&bench.panel);
        bench.pendant.telemetry().fault == Some(Fault::Current)
    })
}

#[test]
fn current_that_flows_although_the_arc_is_off_is_a_fault_that_only_the_button_clears() {
    // 20 ms are tolerated here.
    let mut bench = Bench::enabled();
    assert_eq!(stray(&mut bench, 100), Some(11));
    assert_eq!(bench.pendant.state(), State::Fault);
    bench.panel.established = false;
    assert_eq!(bench.command(Command::Reset), Answer::Refused(Refusal::EStop));
    bench.panel.local_reset = true;
    let _ = bench.lively_tick();
    assert_eq!(bench.pendant.telemetry().fault, None);
    let mut bench = running(&line(0, 300, 50_000, false));
    bench.lively_ticks(100);
    assert_eq!(stray(&mut bench, 100), Some(11), "on the way through the air");
    assert!(bench.until(State::Fault, 300));
}

#[test]
fn a_crater_that_is_cut_short_is_not_finished_and_may_be_welded_over() {
    let path = line(0, 20, 50_000, true);
    let filling = || {
        let mut bench = running(&path);
        let crater =
            |bench: &Bench| bench.pendant.telemetry().arc == weldpath_core::interlock::ArcPhase::CraterFill;
        assert!((0..3_000).any(|_| {
            let _ = bench.lively_tick();
            crater(&bench)
        }));
        bench.panel.enable = false;
        bench.lively_ticks(100);
        let seen = bench.pendant.telemetry();
        assert_eq!((seen.state, seen.finished), (State::Held, None));
        bench.grip();
        bench
    };
    let mut bench = filling();
    let go = resume(&bench);
    assert_eq!(bench.command(go), Answer::Done);
    assert!(bench.until(State::Idle, 500));
    assert_eq!(bench.pendant.telemetry().finished, None, "passed, not welded");
    let mut bench = filling();
    assert_eq!(bench.command(arm()), Answer::Done);
    let changes = bench.pendant.telemetry().changes;
    assert_eq!(bench.command(Command::Resume { path: 1, changes, back_um: 3_000 }), Answer::Done);
    assert!(bench.until(State::Idle, 3_000));
    assert_eq!(bench.pendant.telemetry().finished, Some(1));
}

#[test]
fn a_resume_while_gas_still_flows_goes_back_all_the_same() {
    let path = line(0, 60, 20_000, true);
    let mut bench = Bench::enabled();
    // Half a second of gas after the arc.
    let begin = wire::Begin { times: ProcessTimes::default(), ..world::begin(1, &path, false) };
    assert_eq!(bench.command(Command::Begin(begin)), Answer::Done);
    (0..path.len().div_ceil(4)).for_each(|number| drop(bench.chunk(1, &path, number)));
    let digest = wire::path_digest(&path).expect("short");
    assert_eq!(bench.command(Command::Commit { path: 1, digest }), Answer::Done);
    bench.grip();
    bench.confirm();
    assert_eq!(bench.command(arm()), Answer::Done);
    assert_eq!(bench.command(start()), Answer::Done);
    bench.lively_ticks(800);
    assert_eq!(bench.command(Command::Hold), Answer::Done);
    assert!(bench.until(State::Held, 100));
    bench.grip();
    let held = bench.pendant.telemetry();
    assert_eq!(held.arc, weldpath_core::interlock::ArcPhase::PostFlow);
    assert_eq!(bench.command(arm()), Answer::Done);
    let back = Command::Resume { path: 1, changes: held.changes, back_um: 2_000 };
    assert_eq!(bench.command(back), Answer::Done);
    let strikes = |bench: &mut Bench| Some(bench.lively_tick()).filter(|tick| tick.outputs.arc);
    let struck = (0..1_000).find_map(|_| strikes(&mut bench)).and_then(|tick| tick.set_point);
    let from_um = struck.expect("the arc again").pose.position_um[0];
    assert!((1_999..=2_001).contains(&(held.pose.position_um[0] - from_um)), "{held:?}, {from_um}");
}

// Going on after a lost host.

#[test]
fn another_host_goes_on_with_a_held_path_of_one_that_was_lost() {
    let path = line(0, 300, 50_000, true);
    let digest = wire::path_digest(&path).expect("short");
    let mut bench = welding();
    let busy = bench.attach(1, NONCE, 1, digest);
    assert_eq!(busy, PendantMessage::AttachRefused { nonce: 1, why: AttachRefusal::Busy });
    bench.ticks(300);
    assert_eq!(bench.pendant.telemetry().cause, Some(Cause::Silence));
    for (former, id, digest, why) in [
        (NONCE + 1, 1, digest, AttachRefusal::Session),
        (NONCE, 2, digest, AttachRefusal::Path),
        (NONCE, 1, digest ^ 1, AttachRefusal::Path),
    ] {
        assert_eq!(bench.attach(1, former, id, digest), PendantMessage::AttachRefused { nonce: 1, why });
    }
    let stale = Command::Resume { path: 1, changes: bench.pendant.telemetry().changes, back_um: 0 };
    bench.grip();
    let PendantMessage::HelloAck(ack) = bench.attach(1, NONCE, 1, digest) else { panic!("refused") };
    assert_eq!((ack.nonce, ack.request), (1, bench.request), "the numbers go on");
    let old = bench.say(HostMessage::Control { request: bench.request + 1, command: stale.clone() });
    let refused =
        matches!(&old, pendant::Action::Send(no) if matches!(no.message, PendantMessage::NoSession { .. }));
    assert!(refused, "what the lost host still had on the line: {old:?}");
    bench.session = wire::session_id(1, 1);
    bench.pings = 0;
    assert_eq!(
        bench.command(stale),
        Answer::Refused(Refusal::Stale { changes: bench.pendant.telemetry().changes })
    );
    let go = resume(&bench);
    assert_eq!(bench.command(go.clone()), not_enabled(), "gripped anew after the re-attach");
    bench.grip();
    let before = bench.pendant.torch().expect("known");
    assert_eq!(bench.command(arm()), Answer::Done);
    assert_eq!(bench.command(go), Answer::Done);
    let first = (0..10).find_map(|_| bench.lively_tick().set_point).expect("a set-point");
    assert!(first.pose.distance_um(&before) < 100.0, "no jump");
    assert!((0..2_000).any(|_| bench.lively_tick().outputs.arc));
    assert!(bench.until(State::Idle, 6_000));
    assert_eq!(bench.pendant.telemetry().finished, Some(1));
}

#[test]
fn there_is_nothing_to_go_on_with_where_nothing_is_held() {
    let path = line(0, 300, 50_000, true);
    let digest = wire::path_digest(&path).expect("short");
    let mut bench = Bench::enabled();
    bench.load(1, &path);
    bench.ticks(300);
    let why = AttachRefusal::State(State::Ready);
    assert_eq!(bench.attach(1, NONCE, 1, digest), PendantMessage::AttachRefused { nonce: 1, why });
}

#[test]
fn a_restart_in_place_of_a_resume_never_jumps() {
    let path = line(0, 300, 50_000, true);
    let mut bench = welding();
    bench.ticks(400);
    bench.hello(NONCE + 1);
    bench.session = wire::session_id(1, NONCE + 1);
    (bench.request, bench.pings) = (0, 0);
    begin_and_send(&mut bench, &path);
    bench.grip();
    let Answer::Refused(Refusal::Away { distance_um, .. }) = bench.command(start()) else {
        panic!("it jumps")
    };
    assert!(distance_um > 10_000, "{distance_um}");
}

// Hands.

pub(crate) fn hand(palm_um: [i32; 3], confidence_permille: u16) -> Hand {
    Hand {
        palm_um,
        direction_q15: [0, 0, -Q15_ONE],
        normal_q15: [0, -Q15_ONE, 0],
        grab_permille: 0,
        pinch_permille: 0,
        confidence_permille,
        extended: 31,
    }
}

fn jog() -> WireJog {
    WireJog {
        start: at([400_000, 0, 300_000]),
        box_center_um: [0, 200_000, 0],
        box_size_um: [100_000; 3],
        steer_right: false,
        base_from_sensor_q15: [23_170, 23_170, 0, 0],
    }
}

/// A frame with the hand far to the right; where the camera goes, or why it does not.
fn push(bench: &mut Bench, workshop: &mut Workshop, time_ms: u32, confidence: u16) -> Answer {
    let hands = WireHandFrame { time_ms, left: Some(hand([150_000, 200_000, 0], confidence)), right: None };
    workshop.ask(bench, Command::HandFrame(hands))
}

/// Does the tasks that the pendant leaves to its board.
#[derive(Default)]
struct Workshop {
    tasks: weldpath_core::tasks::Tasks,
    workspace: Box<weldpath_core::tasks::Workspace>,
}

impl Workshop {
    fn ask(&mut self, bench: &mut Bench, command: Command) -> Answer {
        bench.request = bench.request.wrapping_add(1);
        let action = match bench.say(HostMessage::Control { request: bench.request, command }) {
            pendant::Action::Perform { request, task } => {
                let answer = self.tasks.perform(&task, &mut self.workspace);
                bench.pendant.answer(request, answer)
            }
            other => other,
        };
        match action {
            pendant::Action::Send(frame) => match frame.message {
                PendantMessage::Reply { answer, .. } => answer,
                other => panic!("{other:?}"),
            },
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn hands_move_the_camera_only_while_enabled_in_manual_and_with_nothing_loaded() {
    let (mut bench, mut shop) = (Bench::enabled(), Workshop::default());
    assert_eq!(shop.ask(&mut bench, Command::SetJog(jog())), Answer::Done);
    assert_eq!(push(&mut bench, &mut shop, 0, 1000), Answer::Refused(Refusal::NotManual));
    bench.panel.manual = true;
    bench.panel.enable = false;
    let _ = bench.lively_tick();
    assert_eq!(push(&mut bench, &mut shop, 10, 1000), not_enabled());
    bench.panel.enable = true;
    let _ = bench.lively_tick();
    assert!(matches!(push(&mut bench, &mut shop, 20, 1000), Answer::Pose(_)));
    bench.panel.e_stop = true;
    let _ = bench.lively_tick();
    assert_eq!(push(&mut bench, &mut shop, 30, 1000), Answer::Refused(Refusal::State(State::Fault)));
    let (mut bench, mut shop) = (Bench::enabled(), Workshop::default());
    bench.panel.manual = true;
    bench.load(1, &line(0, 8, 20_000, false));
    let loaded = Answer::Refused(Refusal::State(State::Ready));
    assert_eq!(push(&mut bench, &mut shop, 0, 1000), loaded);
}

/// Pushes for 250 ticks with a sensor whose clock runs `fast` times as fast; how far the camera comes, mm.
fn pushed_mm(fast: u32, confidence: u16) -> f64 {
    let (mut bench, mut shop) = (Bench::enabled(), Workshop::default());
    bench.panel.manual = true;
    assert_eq!(shop.ask(&mut bench, Command::SetJog(jog())), Answer::Done);
    let mut last = at([400_000, 0, 300_000]);
    for tick in 0..250 {
        let _ = bench.lively_tick();
        let Answer::Pose(pose) = push(&mut bench, &mut shop, fast * 2 * tick, confidence) else {
            panic!("refused")
        };
        last = pose.pose;
    }
    f64::from(last.distance_um(&at([400_000, 0, 300_000]))) * 1e-3
}

#[test]
fn the_pendants_clock_bounds_the_cameras_speed_whatever_the_sensors_says() {
    for fast in [1, 3, 100] {
        let mm = pushed_mm(fast, 1000);
        assert!(
            (48.0..=50.0).contains(&mm),
            "100 mm/s for half a second: {mm} mm, clock {fast} times as fast"
        );
    }
}

#[test]
fn a_hand_that_the_sensor_is_not_sure_of_is_no_hand() {
    let level = pendant::JOG_LIMITS.confidence_permille;
    assert_eq!(pushed_mm(1, level - 1), 0.0);
    assert!(pushed_mm(1, level) > 40.0);
}

#[test]
fn the_camera_stays_in_its_workspace_and_starts_nowhere_else() {
    let (mut bench, mut shop) = (Bench::enabled(), Workshop::default());
    bench.panel.manual = true;
    let edge = pendant::JOG_LIMITS.most_um[0];
    let start = at([edge - 10_000, 0, 300_000]);
    assert_eq!(shop.ask(&mut bench, Command::SetJog(WireJog { start, ..jog() })), Answer::Done);
    let mut farthest = 0;
    for tick in 0..250 {
        let _ = bench.lively_tick();
        let Answer::Pose(pose) = push(&mut bench, &mut shop, 2 * tick, 1000) else { panic!("refused") };
        farthest = farthest.max(pose.pose.position_um[0]);
    }
    assert!((edge - 1..=edge + 1).contains(&farthest), "{farthest}");
    let outside = WireJog { start: at([edge + 1, 0, 300_000]), ..jog() };
    let refused = |field| Answer::Refused(Refusal::Value(field));
    assert_eq!(shop.ask(&mut bench, Command::SetJog(outside)), refused(Field::Workspace));
    for bad in [
        WireJog { box_size_um: [0, 100_000, 100_000], ..jog() },
        WireJog { box_size_um: [u32::MAX; 3], ..jog() },
        WireJog { box_center_um: [i32::MIN, 0, 0], ..jog() },
    ] {
        assert_eq!(shop.ask(&mut bench, Command::SetJog(bad)), refused(Field::Size));
    }
}

#[test]
fn a_target_is_dropped_when_the_switch_is_let_go() {
    let (mut bench, mut shop) = (Bench::enabled(), Workshop::default());
    bench.panel.manual = true;
    assert_eq!(shop.ask(&mut bench, Command::SetJog(jog())), Answer::Done);
    let mut pushed = |bench: &mut Bench, time_ms: u32| match push(bench, &mut shop, time_ms, 1000) {
        Answer::Pose(pose) => pose.pose,
        other => panic!("{other:?}"),
    };
    let mut before = at([0; 3]);
    for tick in 0..50 {
        let _ = bench.lively_tick();
        before = pushed(&mut bench, 2 * tick);
    }
    bench.grip();
    let first = pushed(&mut bench, 120);
    assert_eq!(first, before, "the first frame after it only says where the hand is");
    let _ = bench.lively_tick();
    assert_ne!(pushed(&mut bench, 122), first, "the next moves the camera");
}

// Defects.

#[test]
fn broken_channels_and_outputs_stop_like_an_e_stop() {
    for defect in [Fault::Channels, Fault::Readback] {
        let mut bench = welding();
        bench.panel.defect = Some(defect);
        let tick = bench.lively_tick();
        assert!(!tick.outputs.arc && !tick.outputs.gas && !tick.motion);
        assert_eq!(bench.pendant.telemetry().fault, Some(defect));
        bench.panel.defect = None;
        bench.lively_ticks(100);
        assert_eq!(bench.command(Command::Reset), Answer::Refused(Refusal::EStop));
        assert_eq!(bench.pendant.torch(), None);
    }
}
