//! `NAME.src` and `NAME.dat` do on a KUKA robot what the plan says, and the interpreter refuses a module that does not.

use weldpath::robot::dialect::Dialect;
use weldpath::weld::program::Waypoint;
use weldpath_tests::krl::{Event, Inputs, Memory, Ran, Reading, Robot, run};
use weldpath_tests::robot::{
    Stop, Text, Tolerance, WOVEN, check, check_standing, output, refuses, require, standing, texts,
};

/// Half of the last digit of the three coordinates and of the three angles.
const ROUNDED: Tolerance = Tolerance { position_mm: 1e-3, rotation_rad: 3e-6, speed_mm_s: 1e-3 };
/// Of a program.
const FILES: [&str; 3] = [".src", ".dat", "_sps.txt"];
/// Outputs 0 and 5 of the job, as KUKA counts.
const ARC: u32 = 1;
const GAS: u32 = 6;

const JOB: &str = r#"
formats = ["kuka"]
[path]
standoff_mm = 3
[arc]
gas_output = 5
established_input = 1
[tool]
flange_from_tcp_mm = [0, -50, 300]
flange_from_tcp_rotation_rad = [0, 0.5, 0]
payload_kg = 2.5
"#;

fn ran(files: &[Text], input: bool) -> Result<Ran, String> {
    run(files, "weldpath", ARC, input)
}

fn program(files: &[Text], waypoints: &[Waypoint]) -> Result<(), String> {
    let ran = ran(files, true)?;
    check(&ran.done.steps, waypoints, &ROUNDED)?;
    gas(&ran.events, files[0].1.contains("$FLAG[902]=TRUE"))
}

/// Only our outputs are switched, and no arc burns without gas.
fn gas(events: &[Event], valve: bool) -> Result<(), String> {
    let (mut arc, mut gas) = (false, false);
    for event in events {
        match *event {
            Event::Out(ARC, on) => arc = on,
            Event::Out(GAS, on) => gas = on,
            Event::Out(other, _) => return Err(format!("output {other} is not ours")),
            _ => {}
        }
        require(!arc || gas || !valve, || "arc without gas".into())?;
    }
    Ok(())
}

#[test]
fn the_module_does_what_the_plan_says() {
    for job in [
        JOB,
        "formats = [\"kuka\"]",
        "formats = [\"kuka\"]\n[path]\nspacing_mm = 0.7\nfeed_mm_s = 7.25",
        "formats = [\"kuka\"]\n[path]\npoints = 9",
    ] {
        let output = output(job);
        program(&texts(&output, &FILES), &output.program.waypoints).unwrap();
    }
}

#[test]
fn a_program_of_many_points_is_divided_between_its_seams() {
    let output = output("formats = [\"kuka\"]\n[path]\npoints = 1000");
    let files = texts(&output, &FILES);
    assert_eq!(files.len(), 7, "{:?}", files.iter().map(|file| &file.0).collect::<Vec<_>>());
    program(&files, &output.program.waypoints).unwrap();
}

#[test]
fn an_arc_that_does_not_establish_halts_with_everything_off() {
    let ran = ran(&texts(&output(JOB), &FILES), false).unwrap();
    assert!(ran.halted);
    assert!(ran.done.steps.iter().all(|step| !step.burning), "no weld move without an arc");
    let last = |channel| {
        ran.events.iter().rev().find_map(|event| match event {
            Event::Out(output, on) if *output == channel => Some(*on),
            _ => None,
        })
    };
    assert_eq!((last(ARC), last(GAS)), (Some(false), Some(false)));
}

#[test]
fn gas_flows_for_its_times_before_and_after_the_arc() {
    let mut ran = ran(&texts(&output(JOB), &FILES), true).unwrap();
    ran.events.retain(|event| !matches!(event, Event::Move(_)));
    let between = |from: Event, to: Event| {
        let start = ran.events.iter().position(|e| *e == from).unwrap();
        let end = start + ran.events[start..].iter().position(|e| *e == to).unwrap();
        let waits = ran.events[start..end].iter();
        waits.map(|e| if let Event::Wait(time_s) = e { *time_s } else { 0.0 }).sum::<f64>()
    };
    assert_eq!(between(Event::Out(GAS, true), Event::Out(ARC, true)), 0.5, "pre-flow");
    let off = ran.events.iter().position(|e| *e == Event::Out(ARC, true)).unwrap();
    let after = ran.events[off..].iter().position(|e| *e == Event::Out(ARC, false)).unwrap() + off;
    assert_eq!(ran.events[after - 1], Event::Wait(0.3), "crater");
    assert_eq!(ran.events[after + 1..after + 3], [Event::Wait(0.5), Event::Out(GAS, false)], "post-flow");
}

#[test]
fn a_mutated_module_is_refused() {
    let output = output(JOB);
    let waypoints = &output.program.waypoints;
    let files = texts(&output, &FILES);
    let point = files[1].1.lines().find(|line| line.contains("XP9=")).unwrap();
    let swapped = point.replace(",A ", ",Q ").replace(",C ", ",A ").replace(",Q ", ",C ");
    let mutations = [
        ("ENDDAT", "", "ENDDAT is missing"),
        ("END\nGLOBAL DEF weldpath_arc_on", "GLOBAL DEF weldpath_arc_on", "END of weldpath is missing"),
        (point, swapped.as_str(), "turned"),
        ("DECL FRAME XP4=", "DECL FRAME XP3=", "twice"),
        ("DECL FRAME XP4=", "DECL FRAME XQ4=", "not in the .dat"),
        ("$APO.CDIS=0.", "$APO.CDIS=2.", "blend"),
        ("$APO.CDIS=0.", "$APO.CDIS=-0.", "radius"),
        (" C_DIS", "", "stops"),
        (" C_DIS", " C_PTP", "approximation"),
        ("weldpath_arc_off()\n$VEL", "$VEL", "arc true"),
        ("weldpath_arc_on()\n$VEL", "$VEL", "arc false"),
        ("$VEL.CP=0.", "$VEL.CP=8.", "m/s"),
        ("$VEL.CP=0.008", "$VEL.CP=0.080", "speed"),
        ("PTP $AXIS_ACT\n", "", "where the robot stands"),
        ("$BASE=$ROBROOT", "$BASE=BASE_DATA[1]", "base"),
        ("BAS(#INITMOV,0)", "", "INITMOV"),
        (";ENDFOLD", ";END", "ENDFOLD"),
        ("DEF weldpath()", "DEF weldpath_of_a_name_too_long()", "more than 24"),
        ("DEFDAT weldpath", "DEFDAT other", "begins with"),
        (",B ", ",", "no component"),
        ("$OUT[6]=$FLAG[902]", "$OUT[7]=$FLAG[902]", "not ours"),
        ("$OUT[6]=$FLAG[902]\n", "", "without gas"),
        ("LIN XP2\n", "LIN XP3\n", "away"),
        ("ENDWHILE\n", "", "ENDWHILE is missing"),
        ("LOOP\n         HALT\n      ENDLOOP\n", "LOOP\n      ENDLOOP\n", ""),
    ];
    refuses(&files, &mutations[..24], |files| program(files, waypoints));
    let (from, to, _) = mutations[24];
    let endless =
        [(files[0].0.clone(), files[0].1.replacen(from, to, 1)), files[1].clone(), files[2].clone()];
    assert!(ran(&endless, false).is_err(), "without HALT the loop has no end");
    let long = format!("; {}\nENDDAT", "x".repeat(260));
    refuses(&files, &[("ENDDAT", &long, "a line of")], |files| program(files, waypoints));
}

#[test]
fn weaves_dwells_stitches_and_stops_are_as_planned() {
    let output = output(&format!("formats = [\"kuka\"]{WOVEN}"));
    let waypoints = &output.program.waypoints;
    assert!(
        waypoints.iter().any(|w| w.dwell_s == Some(0.25)) && waypoints.iter().any(|w| w.dwell_s == Some(0.0))
    );
    program(&texts(&output, &FILES), &output.program.waypoints).unwrap();
}

/// A short program: one seam, three of its moves under the arc.
const SHORT: &str = r#"
formats = ["kuka"]
[selection]
seams = [2]
[path]
points = 4
standoff_mm = 1
feed_mm_s = 40
air_feed_mm_s = 250
[arc]
gas_output = 5
gas_preflow_s = 0.2
strike_s = 0.3
gas_postflow_s = 0.2
crater_s = 0.1
"#;
const WATCHED: &str = "established_input = 1";
/// Steps until the power source says that the arc burns.
const DELAY: u32 = 12;
/// Steps after which the interrupt has braked.
const AT_ONCE: u32 = 2;

fn robot<'a>(memory: &'a Memory, reading: Reading) -> Robot<'a> {
    Robot::new(memory, "weldpath", ARC, Inputs::Source(DELAY), reading).unwrap()
}

/// The module stopped at every step, in every way, under both readings; the first rule that is broken is named.
fn stops(files: &[Text], watched: bool) -> Result<(), String> {
    let memory = Memory::load(files)?;
    let mut robot = robot(&memory, Reading::BOTH[0]);
    let (mut step, mut lit, mut welded) = (0_u32, 0_u32, 0_u32);
    while !robot.ended() {
        // In the air every fifth step will do.
        let lit_or_gas = robot.out(ARC) || robot.out(GAS);
        for stop in Stop::ALL.into_iter().filter(|_| lit_or_gas || step.is_multiple_of(5)) {
            for reading in Reading::BOTH {
                stopped(&robot, stop, reading)
                    .map_err(|why| format!("at step {step}, {stop:?}, {reading:?}: {why}"))?;
            }
        }
        robot.step()?;
        step += 1;
        require(!robot.halted(), || format!("step {step}: HALT"))?;
        lit = if robot.out(ARC) { lit + 1 } else { 0 };
        let struck = lit >= if watched { DELAY } else { 30 };
        require(!robot.welded() || struck, || format!("step {step}: welds {lit} steps after the strike"))?;
        welded += u32::from(robot.welded());
    }
    require(welded > 50, || format!("the weld ends after {welded} steps"))
}

fn stopped(robot: &Robot, stop: Stop, reading: Reading) -> Result<(), String> {
    let mut robot = robot.copy(reading);
    let (gas, struck) = (robot.out(GAS), robot.out(ARC));
    robot.stop(stop);
    for _ in 0..5 {
        robot.step()?;
        require(!robot.out(ARC) && !robot.out(GAS), || "the arc is on".into())?;
    }
    let (mut dry, mut along, mut steps, mut starts) = (0, 0, 0, 0);
    robot.resume();
    while !robot.ended() && steps < 400 && starts < 3 {
        steps += 1;
        robot.step()?;
        along += u32::from(robot.welded());
        dry += u32::from(robot.welded() && !robot.out(ARC));
        require(!struck || !robot.out(ARC), || "the arc is on again".into())?;
        require(dry <= AT_ONCE, || "along the weld without an arc".into())?;
        require(!gas || !robot.out(ARC) || robot.out(GAS), || "the arc without gas".into())?;
        if robot.halted() {
            starts += 1;
            robot.resume();
        }
    }
    require(!struck || along <= AT_ONCE, || format!("goes on along the weld for {along} steps"))
}

fn short(watched: bool) -> Vec<Text> {
    texts(&output(&format!("{SHORT}{}", if watched { WATCHED } else { "" })), &FILES)
}

#[test]
fn a_stop_at_any_time_puts_the_arc_out_for_good() {
    for watched in [true, false] {
        let files = short(watched);
        stops(&files, watched).unwrap();
        assert_eq!(files[0].1.contains("Loss of the arc is not detected"), !watched);
        assert!(files[0].1.contains("Not a safety function") && files[2].1.contains("Not a safety function"));
    }
}

#[test]
fn an_arc_that_goes_out_ends_the_program_at_once() {
    let files = short(true);
    let memory = Memory::load(&files).unwrap();
    let mut robot = robot(&memory, Reading::BOTH[0]);
    let mut losses = 0;
    while !robot.ended() {
        robot.step().unwrap();
        if robot.welded() && robot.out(ARC) {
            let mut lost = robot.copy(Reading::BOTH[0]);
            lost.lose_arc();
            for _ in 0..AT_ONCE {
                lost.step().unwrap();
            }
            assert!(lost.halted() && !lost.out(ARC) && !lost.out(GAS));
            losses += 1;
        }
    }
    assert!(losses > 50);
}

#[test]
fn without_the_submit_interpreter_or_with_alarm_stop_reversed_nothing_is_welded() {
    for watched in [true, false] {
        let files = short(watched);
        let alone = ran(&files[..2], false).unwrap();
        assert!(alone.halted && alone.events.iter().all(|event| !matches!(event, Event::Out(..))));
        let memory = Memory::load(&files).unwrap();
        let mut robot = robot(&memory, Reading { alarm_reversed: true, edges_kept: false });
        for _ in 0..2000 {
            robot.step().unwrap();
            assert!(!robot.out(ARC) && !robot.welded());
        }
        assert!(robot.halted());
    }
}

#[test]
fn a_module_that_is_unsafe_when_it_stops_is_refused() {
    let stop = "IF NOT $PRO_ACT OR NOT $ALARM_STOP OR $STOPMESS THEN\n   $FLAG[901]=FALSE\n   $FLAG[902]=FALSE\nENDIF\n";
    let strike = "$FLAG[901]=TRUE\n";
    let waits = format!("{strike}WAIT SEC 0.3\n");
    let mutations = [
        (stop, "", "the arc is on"),
        ("INTERRUPT ON 20\n", "", "without"),
        ("$FLAG[903]=TRUE\n", "", "without"),
        ("$PRO_ACT AND NOT $FLAG[905]", "TRUE", ""),
        (waits.as_str(), strike, "HALT"),
        (strike, "$OUT[1]=TRUE\n", "would keep its state"),
        ("BRAKE F\n", "BRAKE\n", "unknown statement"),
    ];
    let good = short(false);
    refuses(&good, &mutations, |files| stops(files, false));
    let unlatched = stop.replace("   $FLAG[901]=FALSE\n   $FLAG[902]=FALSE\n", "");
    let rises = [
        (stop, unlatched.as_str()),
        ("$OUT[1]=$FLAG[901]", "$OUT[1]=$FLAG[901] AND $PRO_ACT"),
        ("$OUT[6]=$FLAG[902]", "$OUT[6]=$FLAG[902] AND $PRO_ACT"),
    ];
    let sps = rises.iter().fold(good[2].1.clone(), |text, (from, to)| text.replacen(from, to, 1));
    let files = [good[0].clone(), good[1].clone(), (good[2].0.clone(), sps)];
    let refusal = stops(&files, false).unwrap_err();
    assert!(refusal.contains("the arc is on again"), "{refusal}");
}

#[test]
fn the_first_point_is_reached_by_joints() {
    for job in [JOB, "formats = [\"kuka\"]\n[path]\npoints = 1000"] {
        for home in [false, true] {
            let (files, waypoints, stances) = standing(job, Dialect::Kuka, home);
            let ran = ran(&files, true).unwrap();
            check_standing(&ran.done, &waypoints, &stances, home, &ROUNDED).unwrap();
        }
    }
    let (files, waypoints, stances) = standing(JOB, Dialect::Kuka, false);
    let mutations = [
        ("moves the arm.\nHALT\n", "moves the arm.\n", "asks at"),
        ("PTP {A1 -185.0000", "PTP {A1 175.0000", "joints"),
        ("PTP {A1 -185.0000,", "PTP {", "missing"),
        ("PTP {A1", "LIN {A1", "approximation"),
    ];
    refuses(&files, &mutations, |files| {
        check_standing(&ran(files, true)?.done, &waypoints, &stances, false, &ROUNDED)
    });
}
