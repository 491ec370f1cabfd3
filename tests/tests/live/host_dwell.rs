//! A program in which the torch stands, as a pendant welds it: how long it stands, where, and with what arc.

use nalgebra::{Point3, UnitQuaternion};
use weldpath::pendant::link::program::{Upload, upload};
use weldpath::weld::program::{Kind, Waypoint};
use weldpath_core::interlock::State;
use weldpath_core::pendant::set_point;
use weldpath_core::wire::{Answer, Command};
use weldpath_tests::bench::Bench;
use weldpath_tests::world::{RING, config};

const STAND_S: [f64; 2] = [0.4, 0.25];
const TICK_S: f64 = 0.002;

/// A zigzag that stands on both sides, for half a second where the arc is struck, and for 0.6 s where it is put out.
fn weave() -> Vec<Waypoint> {
    let at = |x_mm: f64, y_mm: f64, kind: Kind, dwell_s: Option<f64>| Waypoint {
        position_mm: Point3::new(400.0 + x_mm, y_mm, 100.0),
        base_from_torch: UnitQuaternion::identity(),
        feed_mm_s: 20.0,
        weld: kind == Kind::Weld,
        seam: Some(1),
        kind,
        dwell_s,
    };
    let mut program = vec![at(0.0, -20.0, Kind::Approach, None), at(0.0, 0.0, Kind::Weld, Some(0.5))];
    for k in 0..6 {
        let (side_mm, stand_s) = if k % 2 == 0 { (-3.0, STAND_S[0]) } else { (3.0, STAND_S[1]) };
        program.push(at(2.0 * f64::from(k) + 1.0, side_mm, Kind::Weld, Some(stand_s)));
    }
    program.push(at(12.0, 0.0, Kind::Weld, Some(0.6)));
    program.push(at(12.0, 20.0, Kind::Retract, None));
    program
}

/// Waypoints of the upload at which the torch stands, in their order.
fn stands(upload: &Upload) -> Vec<u32> {
    let slow = |k: &usize| upload.waypoints[*k].feed_um_s < 1_000;
    (0..upload.waypoints.len()).filter(slow).map(|k| k as u32).collect()
}

fn started(upload: &Upload) -> Bench {
    let mut bench = Bench::enabled();
    bench.load(1, &upload.waypoints);
    assert_eq!(bench.command(Command::ArcArm { armed: true }), Answer::Done);
    assert_eq!(bench.command(Command::Start { path: 1 }), Answer::Done);
    bench
}

#[test]
fn the_torch_stands_on_the_planned_integers_for_as_long_as_the_program_says_with_the_arc_on() {
    let upload = upload(&weave(), &config().limits(RING as u32)).unwrap();
    let mut bench = started(&upload);
    let mut ticks = vec![[0_u32; 2]; upload.waypoints.len()];
    while bench.pendant.state() == State::Running {
        let tick = bench.lively_tick();
        let Some(at) = tick.set_point else { continue };
        let (from, to) = (&upload.waypoints[at.segment as usize], &upload.waypoints[at.segment as usize + 1]);
        assert_eq!(Some(at.pose), set_point(&from.pose, &to.pose, at.alpha_q24));
        ticks[at.segment as usize][usize::from(tick.outputs.arc)] += 1;
    }
    let said_s = [0.5, STAND_S[0], STAND_S[1], STAND_S[0], STAND_S[1], STAND_S[0], STAND_S[1], 0.6];
    let places = stands(&upload);
    assert_eq!(places.len(), said_s.len());
    for (place, said_s) in places.into_iter().zip(said_s) {
        let found_s = f64::from(ticks[place as usize][1]) * TICK_S;
        // The arc is filled and burnt back while the torch stands at the very end.
        let late_s = if said_s == 0.6 { 0.03 } else { 0.01 };
        assert!((-0.01..late_s).contains(&(found_s - said_s)), "{found_s} s instead of {said_s} s");
    }
}

#[test]
fn hold_and_e_stop_while_the_torch_stands_put_the_arc_out_and_a_resume_stands_the_rest() {
    let upload = upload(&weave(), &config().limits(RING as u32)).unwrap();
    let place = stands(&upload)[3];
    let standing = |bench: &mut Bench| {
        let stands = |at: u32| at == place;
        (0..5_000).any(|_| bench.lively_tick().set_point.is_some_and(|at| stands(at.segment)))
    };
    let mut bench = started(&upload);
    assert!(standing(&mut bench));
    bench.lively_ticks(50);
    assert_eq!(bench.command(Command::Hold), Answer::Done);
    assert!(bench.until(State::Held, 100));
    assert!(!bench.lively_tick().outputs.arc);
    bench.grip();
    let (path, changes, back_um) = (1, bench.pendant.telemetry().changes, 0);
    assert_eq!(bench.command(Command::ArcArm { armed: true }), Answer::Done);
    assert_eq!(bench.command(Command::Resume { path, changes, back_um }), Answer::Done);
    let mut rest = 0;
    while bench.pendant.telemetry().segment == place && rest < 1_000 {
        rest += u32::from(bench.lively_tick().outputs.arc);
    }
    let rest_s = f64::from(rest) * TICK_S;
    assert!((rest_s - (STAND_S[0] - 0.1)).abs() < 0.15, "{rest_s} s were left");

    let mut bench = started(&upload);
    assert!(standing(&mut bench));
    bench.panel.e_stop = true;
    assert!(!bench.tick().outputs.arc);
    assert_eq!(bench.pendant.state(), State::Fault);
}
