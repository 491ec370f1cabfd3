//! The link, case by case: what came late, twice, from another session or another host, and what was never valid.

use weldpath_core::interlock::{Cause, Fault, State};
use weldpath_core::pendant::{self, ALPHA_ONE, Action, Task};
use weldpath_core::wire::{
    self, Answer, Chunk, ChunkRefusal, Command, Field, FromHost, Hello, HelloRefusal, HostMessage, Offset,
    PendantMessage, Q15_ONE, Refusal, Unreadable, WireCameraPose, WireHandFrame, WirePatch, WirePose,
    WireWaypoint,
};
use weldpath_tests::adversary::{Faults, Random};
use weldpath_tests::bench::{Bench, NONCE};
use weldpath_tests::world::{self, Events, World, winding_path};

/// A straight path along x, 1 mm steps, 50 mm/s.
fn straight(total: u32, weld: bool) -> Vec<WireWaypoint> {
    let at = |index: u32| {
        let position_um = [index as i32 * 1_000, 0, 200_000];
        WireWaypoint { pose: WirePose { position_um, ..WirePose::IDENTITY }, feed_um_s: 50_000, weld }
    };
    (0..total).map(at).collect()
}

fn running(waypoints: &[WireWaypoint]) -> Bench {
    let mut bench = Bench::enabled();
    bench.load(1, waypoints);
    assert_eq!(bench.command(Command::ArcArm { armed: true }), Answer::Done);
    assert_eq!(bench.command(Command::Start { path: 1 }), Answer::Done);
    bench
}

fn held(waypoints: &[WireWaypoint]) -> Bench {
    let mut bench = running(waypoints);
    bench.lively_ticks(200);
    assert_eq!(bench.command(Command::Hold), Answer::Done);
    assert!(bench.until(State::Held, 500));
    bench.grip();
    bench
}

fn changes(bench: &Bench) -> u16 {
    bench.pendant.telemetry().changes
}

fn resume(bench: &Bench) -> Command {
    Command::Resume { path: 1, changes: changes(bench), back_um: 0 }
}

#[test]
fn a_late_frame_of_an_old_session_moves_nothing() {
    let mut bench = held(&straight(100, true));
    let old = FromHost {
        session: bench.session,
        message: HostMessage::Control { request: bench.request + 1, command: resume(&bench) },
    };
    bench.ticks(102);
    assert!(matches!(bench.hello(NONCE + 1), PendantMessage::HelloAck(_)));
    assert_eq!(bench.pendant.path(), None, "the path went with its session");
    let Action::Send(refused) = bench.frame(&old) else { panic!("no answer") };
    assert_eq!((refused.session, refused.message), (old.session, PendantMessage::NoSession { boot: 1 }));
    bench.ticks(10);
    assert_eq!(
        (bench.pendant.state(), bench.pendant.speed_um_s()),
        (State::Disabled, 0.0),
        "to be gripped anew"
    );
}

#[test]
fn a_path_id_used_again_after_a_reset_takes_no_chunk_of_its_predecessor() {
    let path = straight(8, false);
    let mut bench = Bench::enabled();
    assert_eq!(bench.command(Command::Begin(world::begin(1, &path, false))), Answer::Done);
    let chunk = Chunk { path: 1, first: 0, waypoints: heapless::Vec::from_slice(&path[..4]).expect("4") };
    let old = FromHost { session: bench.session, message: HostMessage::Chunk(chunk) };

    bench.pendant = pendant::Pendant::new(&world::config(), 2).expect("sound");
    bench.session = wire::session_id(2, NONCE);
    bench.request = 0;
    bench.hello(NONCE);
    assert_eq!(bench.command(Command::Begin(world::begin(1, &path, false))), Answer::Done);
    assert!(matches!(bench.frame(&old), Action::Send(answer) if answer.session == old.session));
    assert_eq!(bench.pendant.telemetry().load.map(|load| load.next), Some(0));
}

#[test]
fn a_path_id_is_not_taken_twice_in_a_session() {
    let path = straight(8, false);
    let mut bench = Bench::enabled();
    for (id, answer) in [(5, Answer::Done), (5, refused_path()), (4, refused_path()), (6, Answer::Done)] {
        assert_eq!(bench.command(Command::Begin(world::begin(id, &path, false))), answer, "{id}");
    }
}

fn refused_path() -> Answer {
    Answer::Refused(Refusal::Path)
}

#[test]
fn request_numbers_and_path_ids_wrap_and_each_request_is_executed_once() {
    let path = straight(8, false);
    let mut bench = Bench::enabled();
    for round in 0..140_000_u32 {
        let command = Command::Begin(world::begin(round as u16, &path, false));
        assert_eq!(bench.command(command.clone()), Answer::Done, "round {round}");
        // Executed again it would be refused: the id is no longer new.
        let again = bench.reply(HostMessage::Control { request: bench.request, command: command.clone() });
        assert_eq!(again, PendantMessage::Reply { request: bench.request, answer: Answer::Done });
        let older = HostMessage::Control { request: bench.request.wrapping_sub(1), command };
        assert_eq!(bench.say(older), Action::Idle, "an old number is ignored");
    }
}

#[test]
fn a_path_nine_times_the_ring_is_followed_whole() {
    let mut world = World::new(Faults::default(), Events::default(), 3);
    world.operates = false;
    world.connect();
    assert!(world.run_until(1_000, |world| world.host.limits().is_some()));
    world.operates = true;
    let path = winding_path(&mut Random::new(5), 9 * world::RING as u32);
    world.load(path, true);
    assert!(world.run_until(300_000, |world| world.counts.finished == 1));
    let counts = world.counts;
    assert_eq!(
        (counts.altered, counts.lost, counts.doubled, counts.stray_arc, counts.rough),
        (0, 0, 0, 0, 0)
    );
    assert_eq!(counts.segments, 9 * world::RING as u64 - 2, "every segment was entered once after the first");
}

#[test]
fn a_storm_of_hellos_changes_nothing_and_keeps_no_dead_host_alive() {
    let mut bench = running(&straight(300, true));
    bench.lively_ticks(100);
    let before = changes(&bench);
    for nonce in 0..1_000 {
        let PendantMessage::HelloRefused(refused) = bench.hello(nonce) else { panic!("accepted") };
        assert_eq!((refused.nonce, refused.why), (nonce, HelloRefusal::Busy));
    }
    assert_eq!((bench.pendant.state(), changes(&bench)), (State::Running, before));
    for _ in 0..101 {
        assert!(
            matches!(bench.hello(NONCE), PendantMessage::HelloAck(_)),
            "a repeated Hello is answered again"
        );
        let _ = bench.hello(7);
        let _ = bench.tick();
    }
    assert_eq!(bench.pendant.telemetry().cause, Some(Cause::Silence));
}

#[test]
fn a_reply_lost_ten_times_is_given_again_and_the_command_executed_once() {
    let mut bench = Bench::enabled();
    bench.load(1, &straight(100, true));
    let before = changes(&bench);
    let request = bench.request + 1;
    for _ in 0..10 {
        let reply = bench.reply(HostMessage::Control { request, command: Command::Start { path: 1 } });
        assert_eq!(reply, PendantMessage::Reply { request, answer: Answer::Done });
        let _ = bench.tick();
    }
    assert_eq!((bench.pendant.state(), changes(&bench)), (State::Running, before.wrapping_add(1)));
}

#[test]
fn a_start_that_comes_again_after_a_hold_starts_nothing() {
    let mut bench = Bench::enabled();
    bench.load(1, &straight(100, true));
    assert_eq!(bench.command(Command::Start { path: 1 }), Answer::Done);
    let start = HostMessage::Control { request: bench.request, command: Command::Start { path: 1 } };
    bench.lively_ticks(50);
    assert_eq!(bench.command(Command::Hold), Answer::Done);
    assert!(bench.until(State::Held, 500));
    assert_eq!(bench.say(start), Action::Idle);
    bench.ticks(5);
    assert_eq!(bench.pendant.state(), State::Held);
}

#[test]
fn a_wrong_version_is_refused_with_both_numbers() {
    let mut bench = Bench::enabled();
    let hello = Hello { version: 9, schema: wire::SCHEMA, nonce: 3 };
    let PendantMessage::HelloRefused(refused) = bench.reply(HostMessage::Hello(hello)) else {
        panic!("accepted")
    };
    assert_eq!(refused.why, HelloRefusal::Version { host: 9, pendant: wire::VERSION });
    let hello = Hello { version: wire::VERSION, schema: 1, nonce: 3 };
    let PendantMessage::HelloRefused(refused) = bench.reply(HostMessage::Hello(hello)) else {
        panic!("accepted")
    };
    assert_eq!(refused.why, HelloRefusal::Schema { host: 1, pendant: wire::SCHEMA });
}

#[test]
fn a_second_host_waits_until_the_first_is_silent_and_the_torch_stands() {
    let mut bench = running(&straight(300, true));
    bench.lively_ticks(200);
    let mut silent = 0;
    while let PendantMessage::HelloRefused(refused) = bench.hello(99) {
        assert_eq!(refused.why, HelloRefusal::Busy);
        let _ = bench.tick();
        silent += 1;
    }
    assert!(silent >= 100, "{silent} ticks");
    assert_eq!((bench.pendant.speed_um_s(), bench.pendant.path()), (0.0, None));
}

/// A way to spoil a waypoint, and the refusal it deserves.
type Spoiler = (fn(&mut WireWaypoint), ChunkRefusal);

const SPOILERS: [Spoiler; 9] = [
    (|w| w.pose.position_um[2] = 3_000_001, ChunkRefusal::Reach),
    (|w| w.pose.position_um = [i32::MIN; 3], ChunkRefusal::Reach),
    (|w| w.pose.orientation_q15 = [0; 4], ChunkRefusal::Orientation),
    (|w| w.pose.orientation_q15 = [Q15_ONE; 4], ChunkRefusal::Orientation),
    (|w| w.feed_um_s = 0, ChunkRefusal::Feed),
    (|w| w.feed_um_s = 250_001, ChunkRefusal::Feed),
    (|w| w.pose.position_um[1] = 150_000, ChunkRefusal::StepTooLong),
    (|w| w.pose.orientation_q15 = [0, Q15_ONE, 0, 0], ChunkRefusal::Turn),
    (|w| w.pose.position_um[0] -= 1_000, ChunkRefusal::StepTooShort),
];

#[test]
fn an_invalid_waypoint_at_any_place_of_a_chunk_is_named_and_nothing_of_the_chunk_stored() {
    for (spoil, why) in SPOILERS {
        for at in 0..4 {
            let mut path = straight(12, false);
            spoil(&mut path[4 + at]);
            let mut bench = Bench::enabled();
            assert_eq!(bench.command(Command::Begin(world::begin(1, &path, false))), Answer::Done);
            let _ = bench.chunk(1, &path, 0);
            let PendantMessage::ChunkRefused(refused) = bench.chunk(1, &path, 1) else {
                panic!("{why:?} at {at}")
            };
            assert_eq!((refused.path, refused.first, refused.why), (1, 4, why));
            assert_eq!(usize::from(refused.at), at, "{why:?}");
            assert_eq!(bench.pendant.telemetry().fault, Some(Fault::Waypoint));
            bench.ticks(10);
            assert_eq!((bench.pendant.state(), bench.pendant.path()), (State::Fault, None));
        }
    }
}

#[test]
fn the_step_between_two_chunks_is_checked_whichever_comes_first() {
    for order in [[0, 1], [1, 0]] {
        let mut path = straight(8, false);
        path.iter_mut().skip(4).for_each(|waypoint| waypoint.pose.position_um[1] = 150_000);
        let mut bench = Bench::enabled();
        assert_eq!(bench.command(Command::Begin(world::begin(1, &path, false))), Answer::Done);
        assert!(matches!(bench.chunk(1, &path, order[0]), PendantMessage::Ack(_)));
        let PendantMessage::ChunkRefused(refused) = bench.chunk(1, &path, order[1]) else { panic!("stored") };
        assert_eq!((refused.why, refused.first), (ChunkRefusal::StepTooLong, 4 * order[1] as u32));
    }
}

#[test]
fn chunks_off_the_grid_or_of_another_path_are_refused_without_a_fault() {
    let path = straight(10, false);
    let mut bench = Bench::enabled();
    assert_eq!(bench.command(Command::Begin(world::begin(1, &path, false))), Answer::Done);
    let cases = [
        (1, 1, 4, ChunkRefusal::Index),
        (1, 0, 3, ChunkRefusal::Index),
        (1, 0, 0, ChunkRefusal::Index),
        (1, 8, 4, ChunkRefusal::Index),
        (1, 12, 4, ChunkRefusal::Index),
        (1, u32::MAX - 3, 4, ChunkRefusal::Index),
        (2, 0, 4, ChunkRefusal::Path),
    ];
    for (id, first, len, why) in cases {
        let waypoints = heapless::Vec::from_slice(&path[..len]).expect("4 at most");
        let message = HostMessage::Chunk(Chunk { path: id, first, waypoints });
        let PendantMessage::ChunkRefused(refused) = bench.reply(message) else { panic!("stored") };
        assert_eq!(refused.why, why, "{first} {len}");
    }
    assert_eq!(bench.pendant.state(), State::Loading);
}

#[test]
fn a_chunk_beyond_the_credit_limit_is_not_stored() {
    let path = straight(2_000, false);
    let mut bench = Bench::enabled();
    assert_eq!(bench.command(Command::Begin(world::begin(1, &path, true))), Answer::Done);
    let PendantMessage::ChunkRefused(refused) = bench.chunk(1, &path, 17) else { panic!("beyond the map") };
    assert_eq!(refused.why, ChunkRefusal::Credit { limit: 68 });
    for number in 0..128 {
        assert!(matches!(bench.chunk(1, &path, number), PendantMessage::Ack(_)));
    }
    let PendantMessage::ChunkRefused(refused) = bench.chunk(1, &path, 128) else { panic!("beyond the ring") };
    assert_eq!(refused.why, ChunkRefusal::Credit { limit: 512 });
    let PendantMessage::Ack(ack) = bench.chunk(1, &path, 0) else { panic!("a duplicate is acknowledged") };
    assert_eq!((ack.next, ack.limit), (512, 512));
}

#[test]
fn the_selective_ack_map_shows_what_came_out_of_order() {
    let path = straight(40, false);
    let mut bench = Bench::enabled();
    assert_eq!(bench.command(Command::Begin(world::begin(1, &path, false))), Answer::Done);
    for (number, next, sack) in [(1, 0, 0b1), (4, 0, 0b1001), (2, 0, 0b1011), (0, 12, 0b1), (3, 20, 0)] {
        let PendantMessage::Ack(ack) = bench.chunk(1, &path, number) else { panic!("refused") };
        assert_eq!((ack.next, ack.sack), (next, sack), "after chunk {number}");
    }
}

#[test]
fn a_wrong_digest_or_a_missing_waypoint_is_no_path() {
    let path = straight(8, false);
    let mut bench = Bench::enabled();
    assert_eq!(bench.command(Command::Begin(world::begin(1, &path, false))), Answer::Done);
    let _ = bench.chunk(1, &path, 0);
    let digest = wire::path_digest(&path).expect("short");
    let early = bench.command(Command::Commit { path: 1, digest });
    assert_eq!(early, Answer::Refused(Refusal::Incomplete { next: 4 }));
    let _ = bench.chunk(1, &path, 1);
    let wrong = bench.command(Command::Commit { path: 1, digest: digest ^ 1 });
    assert_eq!(wrong, Answer::Refused(Refusal::Digest { computed: digest }));
    assert_eq!(bench.pendant.telemetry().fault, Some(Fault::Digest));
    assert_eq!(bench.command(Command::Start { path: 1 }), refused_path());
}

#[test]
fn a_path_that_cannot_fit_is_refused_at_begin() {
    let mut bench = Bench::enabled();
    let begin = world::begin(1, &straight(513, false), false);
    assert_eq!(bench.command(Command::Begin(begin)), Answer::Refused(Refusal::TooLong { capacity: 512 }));
    let value = |field| Answer::Refused(Refusal::Value(field));
    let cases = [
        (wire::Begin { total: 1, ..begin }, Field::Count),
        (wire::Begin { chunk: 0, ..begin }, Field::Chunk),
        (wire::Begin { chunk: 9, ..begin }, Field::Chunk),
        (wire::Begin { reach_um: u32::MAX, ..begin }, Field::Reach),
        (wire::Begin { max_step_um: u32::MAX, ..begin }, Field::Step),
        (wire::Begin { min_half_turn_cos_q15: -1, ..begin }, Field::Turn),
    ];
    for (begin, field) in cases {
        assert_eq!(bench.command(Command::Begin(begin)), value(field));
    }
    assert_eq!(bench.pendant.state(), State::Idle);
}

#[test]
fn an_underrun_stops_on_the_path_before_its_end_with_the_arc_off() {
    let path = straight(2_000, true);
    let mut bench = Bench::enabled();
    assert_eq!(bench.command(Command::Begin(world::begin(1, &path, true))), Answer::Done);
    let early = bench.command(Command::Start { path: 1 });
    assert_eq!(early, Answer::Refused(Refusal::State(State::Loading)), "less than half of the ring");
    (0..64).for_each(|number| drop(bench.chunk(1, &path, number)));
    bench.grip();
    bench.confirm();
    assert_eq!(bench.command(Command::ArcArm { armed: true }), Answer::Done);
    assert_eq!(bench.command(Command::Start { path: 1 }), Answer::Done);
    let mut last = None;
    for _ in 0..4_000 {
        let tick = bench.lively_tick();
        let stops = matches!(bench.pendant.state(), State::Holding | State::Held);
        assert!(!(stops && tick.outputs.arc), "the arc is off as soon as it stops");
        last = tick.set_point.or(last);
    }
    let seen = bench.pendant.telemetry();
    assert_eq!((seen.state, seen.cause), (State::Held, Some(Cause::Underrun)));
    bench.grip();
    let last = last.expect("it moved");
    assert!((253..=254).contains(&last.segment), "{last:?}");
    assert_eq!(bench.command(Command::ArcArm { armed: true }), Answer::Done);
    (64..70).for_each(|number| drop(bench.chunk(1, &path, number)));
    let go = resume(&bench);
    assert_eq!(bench.command(go), Answer::Done, "never an automatic resume, but an asked one");
    assert_eq!(bench.pendant.state(), State::Running);
}

#[test]
fn resume_goes_back_with_the_arc_off_and_welds_over_the_end() {
    let mut bench = held(&straight(300, true));
    let place =
        |alpha: wire::Telemetry| f64::from(alpha.segment) + f64::from(alpha.alpha_q24) / f64::from(ALPHA_ONE);
    let from = place(bench.pendant.telemetry());
    assert!(from > 7.0, "{from}");
    assert_eq!(bench.command(Command::ArcArm { armed: true }), Answer::Done);
    let too_far = Command::Resume { path: 1, changes: changes(&bench), back_um: 300_000 };
    assert_eq!(bench.command(too_far), Answer::Refused(Refusal::Value(Field::Back)));
    let back = Command::Resume { path: 1, changes: changes(&bench), back_um: 5_000 };
    assert_eq!(bench.command(back), Answer::Done);
    let mut least = from;
    let mut lit_at = None;
    for _ in 0..1_500 {
        let tick = bench.lively_tick();
        let now = place(bench.pendant.telemetry());
        least = least.min(now);
        if tick.outputs.arc && lit_at.is_none() {
            lit_at = Some(now);
        }
    }
    assert!((least - (from - 5.0)).abs() < 0.01, "5 mm back from {from}, came to {least}");
    assert_eq!(
        lit_at.map(|at| (at - least).abs() < 0.01),
        Some(true),
        "struck where the way back ended: {lit_at:?}"
    );
    assert!(place(bench.pendant.telemetry()) > from, "and welds on");
}

#[test]
fn a_resume_upon_stale_telemetry_is_refused() {
    let mut bench = held(&straight(300, true));
    let stale = Command::Resume { path: 1, changes: changes(&bench).wrapping_sub(1), back_um: 0 };
    assert_eq!(bench.command(stale), Answer::Refused(Refusal::Stale { changes: changes(&bench) }));
    let go = resume(&bench);
    assert_eq!(bench.command(go), Answer::Done);
    let lit = (0..300).any(|_| bench.lively_tick().outputs.arc);
    assert!(!lit, "the arc has to be armed again after a hold");
}

#[test]
fn a_stop_is_for_good() {
    let mut bench = running(&straight(300, true));
    bench.lively_ticks(100);
    assert_eq!(bench.command(Command::Stop), Answer::Done);
    assert!(bench.until(State::Held, 500));
    let go = resume(&bench);
    assert_eq!(bench.command(go), Answer::Refused(Refusal::NotResumable(Cause::Stop)));
    assert_eq!(bench.command(Command::Abort { path: 1 }), Answer::Done);
    assert_eq!(bench.pendant.state(), State::Disabled, "to be gripped anew after a hold");
}

#[test]
fn an_e_stop_is_reset_at_the_pendant_only_and_the_switch_gripped_anew() {
    let mut bench = running(&straight(300, true));
    bench.lively_ticks(100);
    bench.panel.e_stop = true;
    let tick = bench.lively_tick();
    assert!(!tick.outputs.arc && !tick.outputs.gas);
    bench.panel.e_stop = false;
    bench.lively_ticks(100);
    assert_eq!(bench.pendant.speed_um_s(), 0.0);
    assert_eq!(bench.command(Command::Reset), Answer::Refused(Refusal::EStop));
    bench.lively_ticks(100);
    bench.panel.local_reset = true;
    let _ = bench.lively_tick();
    assert_eq!(bench.pendant.state(), State::Disabled, "held all the time: does not count");
    bench.panel.enable = false;
    let _ = bench.lively_tick();
    bench.panel.enable = true;
    let _ = bench.lively_tick();
    assert_eq!(bench.pendant.state(), State::Idle);
}

#[test]
fn a_switch_held_at_power_on_does_not_enable() {
    let mut pendant = world::pendant(1);
    let panel = pendant::Panel { enable: true, ..pendant::Panel::default() };
    for _ in 0..100 {
        let _ = pendant.tick(&panel);
    }
    assert_eq!(pendant.state(), State::Disabled);
}

#[test]
fn a_load_needs_no_switch_but_motion_does() {
    let mut bench = Bench::enabled();
    bench.panel.enable = false;
    let _ = bench.lively_tick();
    bench.load(1, &straight(100, true));
    bench.panel.enable = false;
    let _ = bench.lively_tick();
    assert_eq!(bench.command(Command::Start { path: 1 }), Answer::Refused(Refusal::NotEnabled));
    bench.panel.enable = true;
    let _ = bench.lively_tick();
    assert_eq!(bench.command(Command::Start { path: 1 }), Answer::Done);
}

#[test]
fn no_arc_within_the_strike_time_and_a_lost_arc_are_stops() {
    for (loses, cause) in [(false, Cause::StrikeTimeout), (true, Cause::ArcLost)] {
        let mut bench = running(&straight(300, true));
        for tick in 0..400 {
            let arc = bench.lively_tick().outputs.arc;
            bench.panel.established = arc && loses && tick < 100;
        }
        let seen = bench.pendant.telemetry();
        assert_eq!((seen.state, seen.cause), (State::Held, Some(cause)));
        assert_eq!(seen.segment > 0, loses, "without an arc it does not leave the start");
    }
}

#[test]
fn manual_mode_bounds_the_speed_whatever_the_path_says() {
    let config = pendant::Config { max_feed_um_s: 500_000, min_step_um: 100, ..world::config() };
    let mut path = straight(500, false);
    path.iter_mut().for_each(|waypoint| waypoint.feed_um_s = 500_000);
    for (manual, fastest) in [(false, 500_000.0), (true, 25_000.0)] {
        let mut bench = Bench::with(&config);
        bench.panel.manual = manual;
        bench.load(1, &path);
        assert_eq!(bench.command(Command::Start { path: 1 }), Answer::Done);
        let mut most = 0.0_f32;
        (0..2_000).for_each(|_| {
            let _ = bench.lively_tick();
            most = most.max(bench.pendant.speed_um_s());
        });
        assert!(most <= fastest && most > 0.99 * fastest, "{most}");
    }
    let fast = pendant::Config { manual_feed_um_s: 250_001, ..world::config() };
    assert!(pendant::Pendant::<64>::new(&fast, 1).is_none());
}

#[test]
fn gestures_and_scores_are_answered_only_while_nothing_moves() {
    let hands = WireHandFrame { time_ms: 0, left: None, right: None };
    let points = heapless::Vec::from_slice(&[Offset { um: [0; 3] }]).expect("one");
    let patch = WirePatch { radius_um: 4_000, threshold_milli: 60_000, points };
    let mut bench = running(&straight(300, true));
    for command in [Command::HandFrame(hands), Command::Score(patch.clone())] {
        assert_eq!(bench.command(command), Answer::Refused(Refusal::Moving));
    }
    let mut bench = Bench::enabled();
    let request = 1;
    let message = HostMessage::Control { request, command: Command::HandFrame(hands) };
    bench.panel.manual = true;
    let _ = bench.lively_tick();
    let time_ms = 2 * bench.pendant.telemetry().tick;
    let task = Task::HandFrame { hands, time_ms, anew: true, from: None };
    assert_eq!(bench.say(message.clone()), Action::Perform { request, task });
    assert_eq!(bench.say(message.clone()), Action::Idle, "under way: not computed twice");
    let pose = Answer::Pose(WireCameraPose {
        pose: WirePose::IDENTITY,
        actual: None,
        region: 0,
        capture: false,
        clutch: true,
        time_ms: 8,
    });
    assert!(matches!(bench.pendant.answer(request, pose), Action::Send(_)));
    assert_eq!(bench.reply(message), PendantMessage::Reply { request, answer: pose });
    assert_eq!(bench.pendant.answer(request, Answer::Done), Action::Idle, "answered once");
}

#[test]
fn a_right_checksum_around_nonsense_gets_a_typed_refusal() {
    let mut bench = Bench::enabled();
    for (payload, why) in [
        (&[0xFF, 0xFF, 0xFF][..], Unreadable::Malformed),
        (&[][..], Unreadable::Malformed),
        (&[1, 9, 0][..], Unreadable::Malformed),
        (&[1, 3, 5, 0, 1, 0][..], Unreadable::Trailing),
    ] {
        let Action::Send(answer) = bench.payload(payload) else { panic!("silence") };
        assert_eq!(answer.message, PendantMessage::Unread(why));
    }
    let Action::Send(answer) = bench.bytes(&[&[1; 600][..], &[0]].concat()) else { panic!("silence") };
    assert_eq!(answer.message, PendantMessage::Unread(Unreadable::Oversize));
}

#[test]
fn a_fault_is_reported_until_it_is_seen() {
    let mut bench = Bench::enabled();
    bench.panel.e_stop = true;
    let mut reports = 0;
    let mut count = |bench: &mut Bench| {
        for _ in 0..200 {
            let _ = bench.lively_tick();
            while let Some(frame) = bench.pendant.transmit() {
                if let PendantMessage::FaultReport { number: 1, fault: Fault::EStop } = frame.message {
                    reports += 1;
                }
            }
        }
        std::mem::take(&mut reports)
    };
    assert_eq!(count(&mut bench), 4, "every 100 ms");
    let _ = bench.say(HostMessage::FaultSeen { number: 1 });
    assert_eq!(count(&mut bench), 0);
}

#[test]
fn executed_samples_are_the_set_points() {
    let path = winding_path(&mut Random::new(2), 200);
    let mut bench = Bench::enabled();
    bench.load(1, &path);
    assert_eq!(bench.command(Command::Subscribe { every: 1 }), Answer::Done);
    assert_eq!(bench.command(Command::Start { path: 1 }), Answer::Done);
    let (mut executed, mut sampled) = (Vec::new(), Vec::new());
    while bench.pendant.path().is_some() {
        executed.extend(bench.lively_tick().set_point.map(|at| (at.segment, at.alpha_q24, at.pose)));
        while let Some(frame) = bench.pendant.transmit() {
            if let PendantMessage::Samples(samples) = frame.message {
                sampled.extend(samples.iter().map(|sample| (sample.segment, sample.alpha_q24, sample.pose)));
            }
        }
    }
    assert!(executed.len() > 1_000);
    let missing = executed.len() - sampled.len();
    assert!(missing < 8, "the last ones go with the next message");
    assert_eq!(sampled, executed[..sampled.len()]);
}
