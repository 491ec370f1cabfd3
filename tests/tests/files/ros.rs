//! `poses.yaml` and `poses.json` are PoseArrays of the plan, and the reader refuses those that are not.

use weldpath::weld::program::Waypoint;
use weldpath_tests::robot::{Step, Text, Tolerance, WOVEN, check, output, refuses, require, texts};
use weldpath_tests::ros::{Pose, json, yaml};

const EXACT: Tolerance = Tolerance { position_mm: 2e-5, rotation_rad: 1e-7, speed_mm_s: 0.0 };

fn program(files: &[Text], waypoints: &[Waypoint]) -> Result<(), String> {
    for (name, text) in files {
        let (frame, poses) = if name.ends_with(".json") { json(text)? } else { yaml(text)? };
        require(frame == "base", || format!("frame {frame:?}"))?;
        check(&steps(&poses, waypoints), waypoints, &EXACT)?;
    }
    Ok(())
}

/// A PoseArray says nothing but poses: the rest is taken from the plan.
fn steps(poses: &[Pose], waypoints: &[Waypoint]) -> Vec<Step> {
    let burns = |i: usize| {
        let pair = i.checked_sub(1).and_then(|before| Some((waypoints.get(before)?, waypoints.get(i)?)));
        pair.is_some_and(|(a, b)| a.weld && b.weld && a.seam == b.seam)
    };
    let step = |(i, (position_m, base_from_tool)): (usize, &Pose)| Step {
        position_mm: position_m * 1e3,
        base_from_tool: *base_from_tool,
        speed_mm_s: Some(waypoints.get(i).map_or(0.0, |waypoint| waypoint.feed_mm_s)),
        stops: !(burns(i) && burns(i + 1) && waypoints.get(i).is_some_and(|w| w.dwell_s.is_none())),
        dwell_s: waypoints.get(i).and_then(|waypoint| waypoint.dwell_s).unwrap_or(0.0),
        blend_mm: 0.0,
        burning: burns(i),
    };
    poses.iter().enumerate().map(step).collect()
}

#[test]
fn both_files_hold_the_poses_of_the_plan() {
    for job in ["formats = [\"ros\"]", "formats = [\"ros\"]\n[path]\nstandoff_mm = 12\npoints = 7"] {
        let output = output(job);
        let files = texts(&output, &["poses.yaml", "poses.json"]);
        assert_eq!(files.len(), 2);
        program(&files, &output.program.waypoints).unwrap();
    }
}

#[test]
fn comments_in_the_yaml_tell_speed_and_arc() {
    let output = output("formats = [\"ros\"]");
    let files = texts(&output, &["poses.yaml"]);
    let [on, off] = ["then arc on", "then arc off"].map(|words| files[0].1.matches(words).count());
    assert_eq!((on, off), (2, 2));
    let welding = output.program.waypoints.windows(2).filter(|w| w[0].weld && w[1].weld).count();
    assert_eq!(files[0].1.matches("8 mm/s, welding").count(), welding);
}

#[test]
fn a_mutated_message_is_refused() {
    let output = output("formats = [\"ros\"]");
    let check = |files: &[Text]| program(files, &output.program.waypoints);
    // The first number behind a word, and in its place another.
    let changed = |file: &str, word: &str| {
        let text = &texts(&output, &[file])[0].1;
        let number = text.split(word).nth(1).and_then(|rest| rest.split([',', '}']).next()).unwrap();
        [format!("{word}{number}"), format!("{word}9.5")]
    };
    let x = changed("poses.json", "\"position\": {\"x\": ");
    let in_json = [
        ("\"frame_id\": \"base\"", "\"frame_id\": \"world\"", "frame"),
        ("\"header\": {\"frame_id\": \"base\"},", "", "no field header"),
        ("\"position\"", "\"point\"", "unknown field point"),
        ("\"w\": 0.", "\"w\": 1.", "norm"),
        ("\"w\": ", "\"q\": ", "unknown field q"),
        (&x[0], &x[1], "away"),
        ("\"z\": 0.", "\"z\": -0.", "away"),
        ("\n  ]\n}", "", "EOF"),
        ("},\n", "}\n", "expected"),
        ("\"y\": ", "\"y\": NaN", "expected"),
    ];
    refuses(&texts(&output, &["poses.json"]), &in_json, check);
    let [x, w] = ["position: {x: ", " w: "].map(|word| changed("poses.yaml", word));
    let in_yaml = [
        ("frame_id: base", "frame_id: map", "frame"),
        ("header:\n", "", "unknown key"),
        ("- position", "-position", "unknown key"),
        ("  orientation", " orientation", "unknown key"),
        (&w[0], &w[1], "norm"),
        ("}\n- position", "\n- position", "no map"),
        (&x[0], &x[1], "away"),
        ("{x: ", "{y: ", "no field x"),
        (", z: ", ", z:", "no pair"),
        ("poses:\n", "poses:\n- position: {x: 0.0, y: 0.0, z: 0.0}\n", "no field orientation"),
    ];
    refuses(&texts(&output, &["poses.yaml"]), &in_yaml, check);
}

#[test]
fn weaves_dwells_stitches_and_stops_are_as_planned() {
    let output = output(&format!("formats = [\"ros\"]{WOVEN}"));
    let waypoints = &output.program.waypoints;
    assert!(
        waypoints.iter().any(|w| w.dwell_s == Some(0.25)) && waypoints.iter().any(|w| w.dwell_s == Some(0.0))
    );
    program(&texts(&output, &["poses.yaml", "poses.json"]), &output.program.waypoints).unwrap();
}
