//! `NAME.ls` does on a FANUC robot what the plan says, and the reader refuses a listing that does not.

use weldpath::robot::dialect::Dialect;
use weldpath::robot::posture::Stance;
use weldpath::weld::program::Waypoint;
use weldpath_tests::fanuc::{Configuration, run};
use weldpath_tests::robot::{
    Text, Tolerance, WOVEN, check, check_standing, output, refuses, require, standing, texts,
};

/// Half of the last digit of the coordinates and angles; half a cm/min.
const ROUNDED: Tolerance = Tolerance { position_mm: 1e-3, rotation_rad: 3e-6, speed_mm_s: 0.5 / 6.0 + 1e-9 };
/// Where the feed is a whole number of mm/s.
const WHOLE: Tolerance = Tolerance { speed_mm_s: 0.0, ..ROUNDED };

const JOB: &str = r#"
formats = ["fanuc"]
[path]
standoff_mm = 3
[program]
tool_number = 4
weld_schedule = 7
[tool]
flange_from_tcp_mm = [0, -50, 300]
flange_from_tcp_rotation_rad = [0, 0.5, 0]
payload_kg = 2.5
"#;

fn program(files: &[Text], waypoints: &[Waypoint], tolerance: &Tolerance) -> Result<(), String> {
    check(&run(files, "WELDPATH")?.0.steps, waypoints, tolerance)
}

/// The listing of an arm whose joints are known.
fn stands(files: &[Text], waypoints: &[Waypoint], stances: &[Stance], home: bool) -> Result<(), String> {
    let (ran, configurations) = run(files, "WELDPATH")?;
    check_standing(&ran, waypoints, stances, home, &WHOLE)?;
    for (i, (found, stance)) in configurations.iter().zip(&stances[1..]).enumerate() {
        let [j1, _, _, j4, j5, j6] = stance.joints_deg;
        let turns = [j1, j4, j6].map(whole_turns);
        let wanted = Configuration { flipped: j5 >= 0.0, up: stance.elbow_up, front: stance.front, turns };
        require(*found == wanted, || format!("point {}: {found:?}, not {wanted:?}", i + 2))?;
    }
    Ok(())
}

/// How often a joint has passed half a turn, as robodk_postprocessors' Fanuc_R30iA counts.
fn whole_turns(deg: f64) -> i8 {
    (1..8)
        .map(|k| {
            i8::from(deg >= 360.0 * f64::from(k) - 180.0) - i8::from(-deg >= 360.0 * f64::from(k) - 180.0)
        })
        .sum()
}

#[test]
fn the_first_point_is_reached_by_joints_and_every_point_says_how_the_arm_stands() {
    for job in [JOB, "formats = [\"fanuc\"]\n[path]\npoints = 3000"] {
        for home in [false, true] {
            let (files, waypoints, stances) = standing(job, Dialect::Fanuc, home);
            stands(&files, &waypoints, &stances, home).unwrap();
        }
    }
}

#[test]
fn another_stance_is_refused() {
    let (files, waypoints, stances) = standing(JOB, Dialect::Fanuc, true);
    let configuration = |point: usize| {
        let text = &files[0].1;
        let at = text.find(&format!("P[{point}]{{")).unwrap();
        let from = at + text[at..].find("CONFIG : '").unwrap() + 10;
        text[from..from + text[from..].find('\'').unwrap()].to_owned()
    };
    let found = configuration(2);
    assert_eq!(found, "F D T, -1, 0, 1", "the second of the made-up stances");
    let mut mutations = vec![];
    for wrong in [
        "N D T, -1, 0, 1",
        "F U T, -1, 0, 1",
        "F D B, -1, 0, 1",
        "F D T, 0, 0, 1",
        "F D T, -1, 1, 1",
        "F D T, -1, 0, 0",
    ] {
        mutations.push((found.as_str(), wrong, "point 2"));
    }
    mutations.extend([
        ("J1 = -185.0000 deg", "J1 =  175.0000 deg", "joints"),
        ("J P[1] 10% FINE", "L P[1] 100mm/sec FINE", "joints on a linear move"),
        ("J6 =", "J7 =", "where J6 belongs"),
        ("  ARC Welding Equipment : 1,*,*,*,*;\n", "", "/APPL"),
    ]);
    refuses(&files, &mutations, |files| stands(files, &waypoints, &stances, true));
    let (asking, ..) = standing(JOB, Dialect::Fanuc, false);
    refuses(
        &asking,
        &[("  PAUSE ;", "  !PAUSE ;", "asks at"), ("MOVE NOT", "MOVE HAS NOT BEEN", "a message of")],
        |files| stands(files, &waypoints, &stances, false),
    );
}

#[test]
fn the_listing_does_what_the_plan_says() {
    for (job, tolerance) in [
        (JOB, WHOLE),
        ("formats = [\"fanuc\"]", WHOLE),
        ("formats = [\"fanuc\"]\n[path]\nspacing_mm = 0.7\nfeed_mm_s = 7.25", ROUNDED),
        ("formats = [\"fanuc\"]\n[path]\npoints = 9\nfeed_mm_s = 45", WHOLE),
    ] {
        let output = output(job);
        program(&texts(&output, &[".ls"]), &output.program.waypoints, &tolerance).unwrap();
    }
}

#[test]
fn a_program_of_many_points_is_divided_between_its_seams() {
    let output = output("formats = [\"fanuc\"]\n[path]\npoints = 3000");
    let files = texts(&output, &[".ls"]);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["weldpath.ls", "weldpath_1.ls", "weldpath_2.ls"]);
    program(&files, &output.program.waypoints, &WHOLE).unwrap();
}

#[test]
fn a_mutated_listing_is_refused() {
    let output = output(JOB);
    let files = texts(&output, &[".ls"]);
    let line = |number: usize| {
        let start = format!("{number:4}:");
        files[0].1.lines().find(|line| line.starts_with(&start)).unwrap().to_owned()
    };
    let (ninth, angles) =
        (format!("{}\n", line(9)), files[0].1.lines().filter(|line| line.starts_with("\tW")).nth(8).unwrap());
    let values: Vec<&str> = angles.split(',').map(|item| item.split('=').nth(1).unwrap()).collect();
    let reversed = format!("\tW ={},\tP ={},\tR ={}", values[2], values[1], values[0]);
    let mutations = [
        ("/END", "", "/END is missing"),
        ("/POS\n", "", "/POS is missing"),
        ("  Arc End[7] ;", "  Arc End[8] ;", "other data"),
        ("  Arc End[7] ;", "  !Arc End ;", "burns already"),
        ("  Arc Start[7] ;", "  !Arc Start ;", "does not burn"),
        ("/APPL\n  ARC Welding Equipment : 1,*,*,*,*;\n", "", "/APPL is missing"),
        (angles, reversed.as_str(), "turned"),
        (ninth.as_str(), "", "is numbered"),
        ("/PROG  WELDPATH", "/PROG  WELDPATH_OF_A_NAME_OF_MORE_THAN_36_CHARS", "more than 36"),
        ("/PROG  WELDPATH", "/PROG  weldpath", "capitals"),
        ("\"weldpath\"", "\"weldpath of the whole frame\"", "a comment of"),
        ("P[5]{", "P[4]{", "twice"),
        ("P[5]{", "P[500]{", "position number"),
        ("L P[6] ", "L P[600] ", "has no position"),
        ("L P[6] ", "C P[6] ", "unknown instruction"),
        ("8mm/sec", "8.5mm/sec", "whole"),
        ("8mm/sec", "9mm/sec", "speed"),
        ("UTOOL_NUM=4", "UTOOL_NUM=1", "another tool"),
        ("UF : 0", "UF : 1", "another user frame"),
        ("'N U T, 0, 0, 0'", "'N U, 0, 0, 0'", "CONFIG"),
        ("mm/sec FINE", "mm/sec CNT100", "arrive"),
        (" mm,", " in,", "not in mm"),
        ("/MN\n   1:  !", "/MN\n   1:  !remarks are of thirty-two at most, ", "a remark of"),
        ("J P[1] 10% FINE", "L P[1] 10% FINE", "mm/sec"),
        ("  Arc Start[7]", "  Arc Start[70]", "schedule"),
        (" ;\n   8:", " \n   8:", "no ;"),
    ];
    refuses(&files, &mutations, |files| program(files, &output.program.waypoints, &WHOLE));
}

#[test]
fn a_blend_beyond_half_a_segment_and_a_stop_amid_the_seam_are_refused() {
    let output = output("formats = [\"fanuc\"]\n[path]\nspacing_mm = 0.7");
    let files = texts(&output, &[".ls"]);
    let blend = files[0].1.split("CNT").nth(1).unwrap().split(' ').next().unwrap().to_owned();
    let found = format!("8mm/sec CNT{blend} ");
    let mutations = [
        (found.as_str(), "8mm/sec CNT100 ", "blend"),
        (found.as_str(), "8mm/sec FINE ", "stops"),
        (found.as_str(), "8mm/sec CNT101 ", "0 to 100"),
    ];
    refuses(&files, &mutations, |files| program(files, &output.program.waypoints, &WHOLE));
}

#[test]
fn weaves_dwells_stitches_and_stops_are_as_planned() {
    let output = output(&format!("formats = [\"fanuc\"]{WOVEN}"));
    let waypoints = &output.program.waypoints;
    assert!(
        waypoints.iter().any(|w| w.dwell_s == Some(0.25)) && waypoints.iter().any(|w| w.dwell_s == Some(0.0))
    );
    program(&texts(&output, &[".ls"]), &output.program.waypoints, &ROUNDED).unwrap();
}
