//! `poses.yaml` and `poses.json`: the program's poses shaped like ROS's geometry_msgs/PoseArray.
//!
//! Metres; quaternions x, y, z, w with tool z into the work; frame `base`, which ROS-Industrial's robots keep for the
//! controller's own base frame. A PoseArray has no speeds and no arc: pose `i` is waypoint `i` of `path.json`. The
//! YAML names them in comments, which its readers skip.

use std::fmt::Write;

use nalgebra::UnitQuaternion;

use super::ProgramSetup;
use super::moves::{Move, Switch, TooLong, decimal, moves};
use weldpath_files::File;
use weldpath_method::weld::program::Waypoint;

/// `header.frame_id`.
pub const FRAME: &str = "base";

/// Longest line of a remark.
const REMARK: usize = 100;

/// Both files; JSON knows no remarks.
///
/// # Errors
/// None: a list of poses may be of any length.
pub fn write(waypoints: &[Waypoint], setup: &ProgramSetup) -> Result<Vec<File>, TooLong> {
    // Without a name of its own the frame is that of the robot's base.
    let base = setup.frame.robot_base();
    let (frame, id, remark) = match setup.frame.name() {
        Some(name) => (&setup.frame, name, None),
        None => (&base, FRAME, base.remark("")),
    };
    let remarks: Vec<String> = remark.into_iter().collect();
    let moves = moves(&frame.of(waypoints));
    Ok(vec![
        File::new("poses.yaml", yaml(&moves, id, &setup.head(&remarks, REMARK))),
        File::new("poses.json", json(&moves, id)),
    ])
}

fn yaml(moves: &[Move], frame: &str, head: &[String]) -> String {
    let mut text = "# weldpath: geometry_msgs/PoseArray; metres, tool z into the work\n".to_owned();
    for remark in head {
        let _ = writeln!(text, "# {remark}");
    }
    text.push_str(&format!("header:\n  frame_id: {frame}\n"));
    text.push_str(if moves.is_empty() { "poses: []\n" } else { "poses:\n" });
    for (index, a_move) in moves.iter().enumerate() {
        let ([x, y, z], [qx, qy, qz, qw]) = (position_m(a_move), xyzw(&a_move.base_from_tool));
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "- position: {{x: {x}, y: {y}, z: {z}}}  # {index}: {}\n  \
             orientation: {{x: {qx}, y: {qy}, z: {qz}, w: {qw}}}",
            remark(a_move)
        );
    }
    text
}

fn remark(a_move: &Move) -> String {
    let seam = a_move.seam.map_or("air".to_owned(), |seam| format!("seam {seam}"));
    let welding = if a_move.welding { ", welding" } else { "" };
    let then = match a_move.then {
        Some(Switch::On) => ", then arc on",
        Some(Switch::Off) => ", then arc off",
        None => "",
    };
    format!("{seam}, {} mm/s{welding}{then}", a_move.feed_mm_s)
}

fn json(moves: &[Move], frame: &str) -> String {
    let pose = |a_move: &Move| {
        let ([x, y, z], [qx, qy, qz, qw]) = (position_m(a_move), xyzw(&a_move.base_from_tool));
        format!(
            "    {{\"position\": {{\"x\": {x}, \"y\": {y}, \"z\": {z}}}, \
             \"orientation\": {{\"x\": {qx}, \"y\": {qy}, \"z\": {qz}, \"w\": {qw}}}}}"
        )
    };
    let poses: Vec<String> = moves.iter().map(pose).collect();
    format!(
        "{{\n  \"header\": {{\"frame_id\": \"{frame}\"}},\n  \"poses\": [\n{}\n  ]\n}}\n",
        poses.join(",\n")
    )
}

fn position_m(a_move: &Move) -> [String; 3] {
    <[f64; 3]>::from(a_move.position_mm.coords).map(|mm| decimal::<8>(mm / 1e3))
}

fn xyzw(q: &UnitQuaternion<f64>) -> [String; 4] {
    [q.i, q.j, q.k, q.w].map(decimal::<9>)
}
