//! The link under faults: a host, a line and a pendant in virtual time, a hundred thousand frames per mix and seed.
//!
//! Held for every mix: no waypoint altered, lost or doubled, no arc outside Running, no jerk; every path that no reset
//! and no E-stop ended is followed to its end. The figures are printed (`--nocapture`).

use weldpath_tests::adversary::Faults;
use weldpath_tests::world::{Counts, Events, World};

const FRAMES: u64 = 100_000;
const SEEDS: std::ops::Range<u64> = 1..4;

const CLEAN: Faults =
    Faults { byte_error: 0.0, byte_drop: 0.0, frame_drop: 0.0, frame_double: 0.0, frame_late: 0.0 };
const MIXED: Faults =
    Faults { byte_error: 1e-3, byte_drop: 1e-3, frame_drop: 0.05, frame_double: 0.1, frame_late: 0.1 };
const CALM: Events = Events { panel_us: None, reset_us: None, stall_us: None };

/// Runs a mix and returns the largest share of waypoints sent again, per cent.
fn hold(name: &str, faults: Faults, events: Events, frames: u64, seeds: std::ops::Range<u64>) -> f64 {
    let interrupted = events.panel_us.is_some() || events.reset_us.is_some();
    seeds.map(|seed| run(name, faults, events, frames, seed, interrupted)).fold(0.0, f64::max)
}

fn run(name: &str, faults: Faults, events: Events, frames: u64, seed: u64, interrupted: bool) -> f64 {
    let mut world = World::new(faults, events, seed);
    world.connect();
    while world.frames() < frames {
        let before = world.frames();
        assert!(
            world.run_until(60_000, |world| world.frames() > before),
            "{name}, seed {seed}: the link is dead"
        );
    }
    let counts = world.counts;
    let sent = world.host.statistics();
    let resent = 100.0 * sent.resent as f64 / sent.waypoints.max(1) as f64;
    println!(
        "{name} seed {seed}: {} frames {:.0} s | paths {} begun {} finished {} cut short {} ended | {} segments | resent {resent:.1} %",
        world.frames(),
        world.now_us as f64 * 1e-6,
        counts.begun,
        counts.finished,
        counts.cut,
        counts.ended,
        counts.segments
    );
    let refused = if interrupted { 0 } else { counts.refused };
    let faultless = Counts { begun: 0, finished: 0, cut: 0, ended: 0, segments: 0, refused, ..counts };
    assert_eq!(faultless, Counts::default(), "{name}, seed {seed}");
    assert!(counts.finished > 10, "{name}, seed {seed}: {counts:?}");
    if !interrupted {
        assert_eq!(
            (counts.ended, counts.begun - counts.finished - counts.cut),
            (0, 1),
            "{name}, seed {seed}: the last is under way"
        );
    }
    resent
}

#[test]
fn a_clean_line_sends_nothing_twice() {
    assert_eq!(hold("clean", CLEAN, CALM, FRAMES, SEEDS), 0.0);
}

#[test]
fn one_wrong_byte_in_a_thousand_costs_at_most_a_quarter_more() {
    let resent = hold("byte error 1e-3", Faults { byte_error: 1e-3, ..CLEAN }, CALM, FRAMES, SEEDS);
    assert!(resent > 1.0 && resent <= 25.0, "{resent} %");
}

#[test]
fn one_wrong_byte_in_a_hundred_alters_nothing() {
    hold("byte error 1e-2", Faults { byte_error: 1e-2, ..CLEAN }, CALM, FRAMES, SEEDS);
}

#[test]
fn dropped_bytes_alter_nothing() {
    hold("byte drop 1e-3", Faults { byte_drop: 1e-3, ..CLEAN }, CALM, FRAMES, SEEDS);
}

#[test]
fn dropped_frames_lose_nothing() {
    hold("frame drop 5 %", Faults { frame_drop: 0.05, ..CLEAN }, CALM, FRAMES, SEEDS);
}

#[test]
fn doubled_frames_double_nothing() {
    hold("duplicate 10 %", Faults { frame_double: 0.1, ..CLEAN }, CALM, FRAMES, SEEDS);
}

#[test]
fn reordered_frames_reorder_nothing() {
    hold("reorder 10 %", Faults { frame_late: 0.1, ..CLEAN }, CALM, FRAMES, SEEDS);
}

#[test]
fn all_faults_mixed_alter_lose_and_double_nothing() {
    hold("all mixed", MIXED, CALM, FRAMES, SEEDS);
}

#[test]
fn e_stop_and_enabling_switch_amid_all_faults_leave_no_stray_arc() {
    let events = Events { panel_us: Some(5_000_000), ..CALM };
    hold("mixed + panel", MIXED, events, FRAMES, SEEDS);
}

#[test]
fn resets_of_either_side_amid_all_faults_execute_nothing_stale() {
    let events = Events { panel_us: Some(10_000_000), reset_us: Some(10_000_000), ..CALM };
    hold("mixed + panel + resets", MIXED, events, FRAMES, SEEDS);
}

#[test]
fn stalls_of_the_host_end_in_hold_and_are_resumed() {
    let events = Events { stall_us: Some(4_000_000), ..CALM };
    hold("mixed + stalls", MIXED, events, FRAMES, SEEDS);
}

#[test]
fn everything_at_once_alters_loses_and_doubles_nothing() {
    let events = Events { panel_us: Some(10_000_000), reset_us: Some(15_000_000), stall_us: Some(8_000_000) };
    hold("everything", MIXED, events, FRAMES, SEEDS);
}

/// The long run: `cargo test -p weldpath-tests --release --test link link_faults -- --ignored --nocapture`.
#[test]
#[ignore = "eight million frames"]
fn a_million_frames_with_eight_seeds() {
    let events =
        Events { panel_us: Some(20_000_000), reset_us: Some(30_000_000), stall_us: Some(20_000_000) };
    hold("long run", MIXED, events, 1_000_000, 1..9);
}
