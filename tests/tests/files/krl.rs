//! `NAME.src` and `NAME.dat` do on a KUKA robot what the plan says, and the interpreter refuses a module that does not.

use weldpath::weld::program::Waypoint;
use weldpath_tests::krl::{Event, Ran, run};
use weldpath_tests::robot::{Text, Tolerance, WOVEN, check, output, refuses, require, texts};

/// Half of the last digit of the three coordinates and of the three angles.
const ROUNDED: Tolerance = Tolerance { position_mm: 1e-3, rotation_rad: 3e-6, speed_mm_s: 1e-3 };
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
    check(&ran.steps, waypoints, &ROUNDED)?;
    gas(&ran.events)
}

/// Only our outputs are switched, and no arc burns without gas.
fn gas(events: &[Event]) -> Result<(), String> {
    let (mut arc, mut gas) = (false, false);
    for event in events {
        match *event {
            Event::Out(ARC, on) => arc = on,
            Event::Out(GAS, on) => gas = on,
            Event::Out(other, _) => return Err(format!("output {other} is not ours")),
            _ => {}
        }
        let no_valve = !events.iter().any(|e| matches!(e, Event::Out(GAS, _)));
        require(!arc || gas || no_valve, || "arc without gas".into())?;
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
        program(&texts(&output, &[".src", ".dat"]), &output.program.waypoints).unwrap();
    }
}

#[test]
fn a_program_of_many_points_is_divided_between_its_seams() {
    let output = output("formats = [\"kuka\"]\n[path]\npoints = 1000");
    let files = texts(&output, &[".src", ".dat"]);
    assert_eq!(files.len(), 6, "{:?}", files.iter().map(|file| &file.0).collect::<Vec<_>>());
    program(&files, &output.program.waypoints).unwrap();
}

#[test]
fn an_arc_that_does_not_establish_halts_with_everything_off() {
    let ran = ran(&texts(&output(JOB), &[".src", ".dat"]), false).unwrap();
    assert!(ran.halted);
    assert!(ran.steps.iter().all(|step| !step.burning), "no weld move without an arc");
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
    let ran = ran(&texts(&output(JOB), &[".src", ".dat"]), true).unwrap();
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
    let files = texts(&output, &[".src", ".dat"]);
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
        ("$OUT[6]=TRUE", "$OUT[7]=TRUE", "not ours"),
        ("$OUT[6]=TRUE\n", "", "without gas"),
        ("LIN XP2\n", "LIN XP3\n", "away"),
        ("ENDWHILE\n", "", "ENDWHILE is missing"),
        ("LOOP\nHALT\nENDLOOP\n", "LOOP\nENDLOOP\n", ""),
    ];
    refuses(&files, &mutations[..24], |files| program(files, waypoints));
    let (from, to, _) = mutations[24];
    let endless = [(files[0].0.clone(), files[0].1.replacen(from, to, 1)), files[1].clone()];
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
    program(&texts(&output, &[".src", ".dat"]), &output.program.waypoints).unwrap();
}
