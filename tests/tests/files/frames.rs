//! A program goes where the plan says, whichever of the controller's frames its poses are in, and is refused in a frame
//! that its controller cannot have.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use weldpath::run::job::Job;
use weldpath::weld::program::Waypoint;
use weldpath_tests::robot::{Frame, Held, Text, Tolerance, check, output, texts};
use weldpath_tests::urscript::{Event, Move};
use weldpath_tests::{fanuc, krl, rapid, urscript};

const ROUNDED: Tolerance = Tolerance { position_mm: 3e-3, rotation_rad: 6e-6, speed_mm_s: 0.5 / 6.0 + 1e-9 };

/// The robot's base and the frame, both in the scan's base frame: mm and rotation vectors, any that are in no special place.
const ROBOT: [[f64; 3]; 2] = [[-410.0, 120.5, 33.0], [0.3, -0.2, 1.1]];
const FRAME: [[f64; 3]; 2] = [[250.0, -75.25, -12.0], [-0.4, 0.1, 0.7]];

fn isometry([at, turned]: [[f64; 3]; 2]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turned));
    Isometry3::from_parts(Translation3::from(at), rotation)
}

fn as_frame(transform: Isometry3<f64>) -> Frame {
    Frame {
        origin_mm: transform.translation.vector,
        axes: transform.rotation.to_rotation_matrix().into_inner(),
    }
}

fn job(dialect: &str, frame: &str) -> String {
    let [at, turned] = ROBOT;
    format!("formats = [{dialect:?}]\n[robot]\nbase_mm = {at:?}\nbase_rotation_rad = {turned:?}\n{frame}\n")
}

/// The frame as a table, with what the controller knows it by.
fn placed(known: &str) -> String {
    let [at, turned] = FRAME;
    format!("frame = {{ {known}origin_mm = {at:?}, rotation_rad = {turned:?} }}")
}

/// The plan, in the robot's own base.
fn in_robot_base(waypoints: &[Waypoint]) -> Vec<Waypoint> {
    let by = isometry(ROBOT).inverse();
    let moved = |point: &Waypoint| Waypoint {
        position_mm: by * point.position_mm,
        base_from_torch: by.rotation * point.base_from_torch,
        ..*point
    };
    waypoints.iter().map(moved).collect()
}

/// Runs the program of a job where `held` is set on the controller; its moves are in the robot's own base.
fn follows(dialect: &str, frame: &str, held: &Held) -> Result<(), String> {
    let output = output(&job(dialect, frame));
    let wanted = in_robot_base(&output.program.waypoints);
    let texts = |ends: &[&str]| -> Vec<Text> { texts(&output, ends) };
    let steps = match dialect {
        "ur" => return ur(&texts(&[".script"])[0].1, held, &wanted),
        "abb" => rapid::run_with(&texts(&[".mod"]), "weldpath_run", held)?.steps,
        "kuka" => krl::run_with(&texts(&[".src", ".dat", "_sps.txt"]), "weldpath", 1, true, held)?.done.steps,
        _ => fanuc::run_with(&texts(&[".ls"]), "WELDPATH", held)?.0.steps,
    };
    check(&steps, &wanted, &ROUNDED)
}

fn ur(script: &str, held: &Held, wanted: &[Waypoint]) -> Result<(), String> {
    let events = urscript::run_with(script, true, held)?;
    let moves: Vec<&Move> = events
        .iter()
        .filter_map(|event| match event {
            Event::Move(a_move) => Some(a_move),
            _ => None,
        })
        .collect();
    if moves.len() != wanted.len() {
        return Err(format!("{} moves", moves.len()));
    }
    let off = |(a, b): &(&&Move, &Waypoint)| {
        (a.position_m * 1e3 - b.position_mm.coords).norm() > 1e-3
            || (a.rotation() - weldpath_tests::robot::tool(b)).norm() > 1e-5
    };
    moves.iter().zip(wanted).find(off).map_or(Ok(()), |(a, b)| Err(format!("{a:?} is not at {b:?}")))
}

#[test]
fn without_a_frame_poses_are_in_the_robots_own_base_wherever_it_stands() {
    for (dialect, tool) in [("ur", "\"tTorch\""), ("abb", "\"tTorch\""), ("kuka", "3"), ("fanuc", "3")] {
        let held = Held::from([("nothing".to_owned(), Frame::base())]);
        follows(dialect, &format!("tool = {tool}"), &held).unwrap_or_else(|why| panic!("{dialect}: {why}"));
    }
}

#[test]
fn a_frame_of_the_controller_holds_the_same_program_where_it_was_said_to_stand() {
    let robot_from_base = isometry(ROBOT).inverse();
    let placed_there = as_frame(robot_from_base * isometry(FRAME));
    for (dialect, known, name) in [
        ("ur", "name = \"table\", ", "table"),
        ("abb", "name = \"wobTable\", ", "wobTable"),
        ("kuka", "number = 7, ", "7"),
        ("fanuc", "number = 7, ", "7"),
    ] {
        let held = |frame| Held::from([(name.to_owned(), frame)]);
        follows(dialect, &placed(known), &held(placed_there))
            .unwrap_or_else(|why| panic!("{dialect}: {why}"));
        // By its name alone it is the scan's base frame.
        let alone = format!("frame = {}", if name == "7" { name.to_owned() } else { format!("{name:?}") });
        follows(dialect, &alone, &held(as_frame(robot_from_base)))
            .unwrap_or_else(|why| panic!("{dialect}: {why}"));
        // A frame that stands elsewhere is no such frame, and what nobody has set stops the program.
        assert!(follows(dialect, &placed(known), &held(Frame::base())).is_err(), "{dialect}");
        assert!(follows(dialect, &placed(known), &Held::new()).is_err(), "{dialect}");
    }
}

#[test]
fn a_frame_by_value_is_set_by_the_program() {
    for dialect in ["ur", "abb", "kuka", "fanuc"] {
        let known = if dialect == "fanuc" { "number = 5, register = 10, " } else { "" };
        follows(dialect, &placed(known), &Held::new()).unwrap_or_else(|why| panic!("{dialect}: {why}"));
    }
}

#[test]
fn a_head_says_where_a_frame_has_to_stand() {
    // Without its line breaks.
    let said = |dialect: &str, frame: &str, ends: &str| {
        let text = texts(&output(&job(dialect, frame)), &[ends])[0].1.clone();
        text.split_whitespace().filter(|word| !["#", ";"].contains(word)).collect::<Vec<_>>().join(" ")
    };
    let at = isometry(ROBOT).inverse() * isometry(FRAME);
    let x_mm = at.translation.vector.x;
    assert!(said("kuka", &placed("number = 7, "), ".src").contains(&format!("stand at {{X {x_mm:.3},Y")));
    assert!(said("ur", &placed("name = \"table\", "), ".script").contains(&format!("p[{:.8},", x_mm / 1e3)));
    assert!(said("ur", "", ".script").contains("robot's own base frame, not in the scan's"));
}

#[test]
fn a_fanuc_program_sets_its_tool_by_a_register_and_welds_by_a_procedure() {
    let tool = "[tool]\nflange_from_tcp_mm = [0, -50, 300]\nflange_from_tcp_rotation_rad = [0, 0.5, 0]\npayload_kg = 2.5";
    let job = format!(
        "{}{tool}\n[program]\nweld_procedure = 3\nweld_schedule = 9\n",
        job("fanuc", "tool = { number = 2, register = 11 }")
    );
    let output = output(&job);
    let files = texts(&output, &[".ls"]);
    check(
        &fanuc::run(&files, "WELDPATH").unwrap().0.steps,
        &in_robot_base(&output.program.waypoints),
        &ROUNDED,
    )
    .unwrap();
    let text = &files[0].1;
    for line in [
        "PR[11]=LPOS ;",
        "PR[11,2]=(-50.000) ;",
        "UTOOL[2]=PR[11] ;",
        "UTOOL_NUM=2 ;",
        "Weld Start[3,9] ;",
        "Weld End[3,9] ;",
    ] {
        assert!(text.contains(line), "{line} is missing");
    }
    assert!(!text.contains("Arc Start"));
}

#[test]
fn an_abb_program_says_its_speeds_in_the_unit_of_the_controller() {
    let text = |unit: &str| {
        let job =
            format!("formats = [\"abb\"]\n[path]\nfeed_mm_s = 12.7\n[program]\nwelddata_unit = {unit:?}\n");
        texts(&output(&job), &[".mod"])[0].1.clone()
    };
    assert!(text("mm/s").contains("PERS welddata weldpath_w1:=[12.7,"));
    let inches = text("in/min");
    assert!(inches.contains("PERS welddata weldpath_w1:=[30.0000,") && inches.contains("Arc units are US"));
}

#[test]
fn what_a_controller_cannot_have_is_refused_with_its_line() {
    let refused = |dialect: &str, frame: &str| {
        let error = Job::parse(&job(dialect, frame), Path::new("job.toml")).unwrap_err();
        assert!(error.to_string().starts_with("job.toml:5:"), "{error}");
        error.to_string()
    };
    for (dialect, frame, words) in [
        ("ur", "frame = 3", "Universal Robots has frames by name"),
        ("abb", "tool = 3", "ABB has tools by name"),
        ("kuka", "frame = \"table\"", "KUKA has frames by number"),
        ("fanuc", "frame = \"table\"", "FANUC has frames by number"),
        ("fanuc", "frame = { origin_mm = [1, 2, 3] }", "spare position register"),
        ("fanuc", "tool = { number = 2, register = 11 }", "only where the job has a [tool]"),
        ("kuka", "frame = 65", "0 to 64"),
        ("ur", "frame = \"a b\"", "not a valid name on a controller"),
        ("fanuc", "frame = { number = 5, register = 0 }", "1 to 200"),
        ("ur", "frame = true", "a frame is a number, a name, or a table"),
    ] {
        let said = refused(dialect, frame);
        assert!(said.contains(words), "{said}");
    }
}
