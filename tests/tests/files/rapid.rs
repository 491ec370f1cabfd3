//! `NAME.mod` does on an ABB robot what the plan says, and the interpreter refuses a module that does not.

use weldpath::robot::dialect::Dialect;
use weldpath::weld::program::Waypoint;
use weldpath_tests::rapid::run;
use weldpath_tests::robot::{
    Text, Tolerance, WOVEN, check, check_standing, output, refuses, standing, texts,
};

/// Half of the last digit of the three coordinates; quaternions to eight digits.
const ROUNDED: Tolerance = Tolerance { position_mm: 1e-4, rotation_rad: 1e-7, speed_mm_s: 1e-9 };

const JOB: &str = r#"
formats = ["abb"]
[path]
standoff_mm = 3
[arc]
gas_preflow_s = 0.4
[tool]
flange_from_tcp_mm = [0, -50, 300]
flange_from_tcp_rotation_rad = [0, 0.5, 0]
payload_kg = 2.5
"#;

fn program(files: &[Text], waypoints: &[Waypoint]) -> Result<(), String> {
    check(&run(files, "weldpath_run")?.steps, waypoints, &ROUNDED)
}

#[test]
fn the_first_point_is_reached_by_joints() {
    for job in [JOB, "formats = [\"abb\"]\n[path]\npoints = 4000"] {
        for home in [false, true] {
            let (files, waypoints, stances) = standing(job, Dialect::Abb, home);
            let ran = run(&files, "weldpath_run").unwrap();
            check_standing(&ran, &waypoints, &stances, home, &ROUNDED).unwrap();
        }
    }
    let (files, waypoints, stances) = standing(JOB, Dialect::Abb, false);
    let mutations = [
        ("    Stop;\n", "", "asks at"),
        ("MoveAbsJ [[-185.0000", "MoveAbsJ [[175.0000", "joints"),
        ("MoveAbsJ [[-185.0000,", "MoveAbsJ [[", "no jointtarget"),
        ("MoveAbsJ", "MoveJ", "not declared"),
    ];
    refuses(&files, &mutations, |files| {
        check_standing(&run(files, "weldpath_run")?, &waypoints, &stances, false, &ROUNDED)
    });
}

#[test]
fn the_module_does_what_the_plan_says() {
    for job in [
        JOB,
        "formats = [\"abb\"]",
        "formats = [\"abb\"]\n[path]\nspacing_mm = 0.5\nfeed_mm_s = 7.25",
        "formats = [\"abb\"]\n[path]\npoints = 9",
    ] {
        let output = output(job);
        program(&texts(&output, &[".mod"]), &output.program.waypoints).unwrap();
    }
}

#[test]
fn a_program_of_many_points_is_divided_between_its_seams() {
    let output = output("formats = [\"abb\"]\n[path]\npoints = 4000");
    let files = texts(&output, &[".mod"]);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["weldpath.mod", "weldpath_1.mod", "weldpath_2.mod"]);
    program(&files, &output.program.waypoints).unwrap();
}

#[test]
fn tool_gas_and_feed_of_the_job_are_declared() {
    let files = texts(&output(JOB), &[".mod"]);
    let (sin, cos) = (0.25_f64.sin(), 0.25_f64.cos());
    for declared in [
        format!(
            "PERS tooldata weldpath_tool:=[TRUE,[[0.0000,-50.0000,300.0000],[{cos:.8},0.00000000,{sin:.8},0.00000000]],[2.5,"
        ),
        "PERS seamdata weldpath_seam:=[0,0.4,".into(),
        "PERS welddata weldpath_w1:=[8,0,[1,".into(),
    ] {
        assert!(files[0].1.contains(&declared), "{declared}");
    }
}

#[test]
fn a_mutated_module_is_refused() {
    let output = output(JOB);
    let waypoints = &output.program.waypoints;
    let mutations = [
        ("ENDMODULE\n", "", "ENDMODULE is missing"),
        ("  ENDPROC\n", "", "ENDPROC is missing"),
        ("ArcLEnd", "ArcL", "while the arc"),
        ("    ArcLStart", "    MoveL", "arguments"),
        ("PROC weldpath_run", "PROC weldpath_run_of_a_name_that_is_too_long", "characters"),
        ("  LOCAL CONST robtarget p7:", "  LOCAL CONST robtarget p6:", "twice"),
        ("  LOCAL CONST robtarget p3:", "  LOCAL CONST robtarget q3:", "not declared"),
        ("],[0,0,0,0],[9E9", "],[0,0,0],[9E9", "robtarget"),
        ("9E9,9E9,9E9,9E9,9E9,9E9", "9E9,9E9,9E9,9E9,9E9,0", "external"),
        (",z0,", ",z5,", "blend"),
        (",z0,", ",fine,", "stops"),
        (",z0,", ",z2,", "not declared"),
        ("    ConfL\\Off;\n", "", "configuration"),
        ("    ConfL\\On;\n", "", "left off"),
        ("welddata weldpath_w1:=[8,", "welddata weldpath_w1:=[80,", "speed"),
        ("PERS welddata", "CONST welddata", "cannot be"),
        (",fine,weldpath_tool", ",z1,weldpath_tool", "arrive"),
        ("\\WObj:=weldpath_wobj", "", "no work object"),
        ("robtarget p2:=[[", "robtarget p2:=[[1", "away"),
        ("weldpath_seam,weldpath_w1,", "weldpath_w1,weldpath_seam,", "not seamdata"),
        ("  ! Edit", "  Edit", "no ;"),
    ];
    refuses(&texts(&output, &[".mod"]), &mutations, |files| program(files, waypoints));
    let long = format!("  ! {}\nENDMODULE", "x".repeat(260));
    refuses(&texts(&output, &[".mod"]), &[("ENDMODULE", &long, "a line of")], |files| {
        program(files, waypoints)
    });
}

#[test]
fn an_unnormalised_or_reordered_quaternion_is_refused() {
    let output = output(JOB);
    let files = texts(&output, &[".mod"]);
    let target = files[0].1.lines().find(|line| line.contains("robtarget p9:")).unwrap();
    let q = target.split("],[").nth(1).unwrap();
    let [w, x, y, z]: [&str; 4] = q.split(',').collect::<Vec<_>>().try_into().unwrap();
    let doubled = format!("{},{x},{y},{z}", 2.0 * w.parse::<f64>().unwrap());
    let last = format!("{x},{y},{z},{w}");
    let mutations = [(q, doubled.as_str(), "norm"), (q, last.as_str(), "turned")];
    refuses(&files, &mutations, |files| program(files, &output.program.waypoints));
}

#[test]
fn weaves_dwells_stitches_and_stops_are_as_planned() {
    let output = output(&format!("formats = [\"abb\"]{WOVEN}"));
    let waypoints = &output.program.waypoints;
    assert!(
        waypoints.iter().any(|w| w.dwell_s == Some(0.25)) && waypoints.iter().any(|w| w.dwell_s == Some(0.0))
    );
    let files = texts(&output, &[".mod"]);
    // Speeds are declared in steps of 0.05 mm/s.
    let stepped = Tolerance { speed_mm_s: 0.025 + 1e-9, ..ROUNDED };
    check(&run(&files, "weldpath_run").unwrap().steps, waypoints, &stepped).unwrap();
    let weld_data = files[0].1.matches("PERS welddata").count();
    assert!(weld_data < 10, "{weld_data} weld data to be edited by hand");
}
