//! The gesture mapping on recordings of real hands (Leap Motion), where they are present.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use weldpath_core::gesture::{
    Attitude, CameraPose, CaptureGesture, Config, Fingers, HandFrame, InteractionBox,
};
use weldpath_core::gesture::{Region, Steering};
use weldpath_core::rotation::Arc;
use weldpath_core::{Orientation, Point, Vector};
use weldpath_tests::shared_data;

const START: CameraPose =
    CameraPose { position_mm: Point::new(400.0, 0.0, 300.0), orientation: Orientation::new_unchecked(DOWN) };
const DOWN: nalgebra::Quaternion<f32> = nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0);

struct Recorded {
    is_right: bool,
    hand_id: u32,
    by_angles: Option<Attitude>,
    frame: HandFrame,
}

fn recorded(line: &str) -> Option<Recorded> {
    let field: Vec<&str> = line.split(',').collect();
    let number = |i: usize| field.get(i)?.parse::<f32>().ok();
    let vector = |i: usize| Some(Vector::new(number(i)?, number(i + 1)?, number(i + 2)?));
    let attitude = Attitude::from_direction_and_normal(&vector(6)?, &vector(9)?)?;
    let mut extended = [false; 5];
    for (finger, letter) in extended.iter_mut().zip(field.get(17)?.chars()) {
        *finger = letter == '1';
    }
    let time_us = field.first()?.parse().ok()?;
    let palm_mm = Point::from(vector(3)?);
    Some(Recorded {
        is_right: *field.get(2)? == "1",
        hand_id: field.get(1)?.parse().ok()?,
        by_angles: Attitude::from_roll_pitch_yaw(
            [number(12)?, number(13)?, number(14)?].map(f32::to_radians),
        ),
        frame: HandFrame::new(time_us, palm_mm, attitude, number(15)?, number(16)?, Fingers::new(extended))?,
    })
}

fn recording(file: &Path) -> Vec<Recorded> {
    let text = fs::read_to_string(file).expect("readable");
    let frames: Vec<_> = text.lines().skip(1).filter_map(recorded).collect();
    assert_eq!(frames.len(), text.lines().count() - 1, "every recorded frame is finite and has a basis");
    frames
}

fn recordings() -> Vec<(String, Vec<Recorded>)> {
    let folder = shared_data("real/derived/leap");
    let files = fs::read_dir(folder).expect("readable").map(|entry| entry.expect("readable").path());
    files.map(|file| (file.file_stem().unwrap().to_string_lossy().into_owned(), recording(&file))).collect()
}

/// Follows everything at once: no dead band, no cap.
fn direct() -> Config {
    Config { turn_dead_band_rad: 0.0, max_turn_rad_s: 1e6, ..Config::default() }
}

fn degrees_between(a: &Orientation, b: &Orientation) -> f32 {
    Arc::between(a, b).angle_rad().to_degrees()
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn on_wave_no_camera_turn_is_larger_than_the_hand_makes() {
    let file = shared_data("real/derived/leap/wave.csv");
    let frames = recording(&file);
    // A box that the whole wave stays in: rotation mode throughout.
    let home = InteractionBox::new(Point::new(74.0, 188.0, 40.0), 100.0).unwrap();
    let hand_turns = frames
        .windows(2)
        .map(|pair| degrees_between(&pair[0].frame.sensor_from_hand(), &pair[1].frame.sensor_from_hand()));
    // Held back by its cap of 1 rad/s, the camera still turns while a slower hand waits: 0.57 degrees in 10 ms.
    for (config, catching_up) in [(direct(), 0.0), (Config::default(), 0.573)] {
        let turns = camera_turns(&frames, Config { interaction_box: home, ..config });
        // The first two frames say where the hand is and turn the camera there.
        for (camera, hand) in turns.iter().zip(hand_turns.clone()).skip(1) {
            assert!(*camera <= hand.max(catching_up) + 1e-3);
        }
        assert!(turns.iter().skip(1).all(|&turn| turn < 7.35), "7.3 degrees is the wave's own largest");
    }
}

/// Degrees the camera turns from each frame to the next.
fn camera_turns(frames: &[Recorded], config: Config) -> Vec<f32> {
    let mut steering = Steering::new(config);
    let mut camera = START;
    let turn = |recorded: &Recorded| {
        let jog = steering.follow(Some(&recorded.frame), &camera);
        assert_eq!(jog.region, Some(Region::Home));
        let turn = degrees_between(&camera.orientation, &jog.target.orientation);
        camera = jog.target;
        turn
    };
    frames.iter().map(turn).skip(1).collect()
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn on_wave_leaps_three_angles_are_no_rotation_and_the_documented_limit_is_real() {
    let file = shared_data("real/derived/leap/wave.csv");
    let attitudes: Vec<_> = recording(&file).iter().filter_map(|r| r.by_angles).collect();
    let jump = |pair: &[Attitude]| degrees_between(&pair[0].orientation(), &pair[1].orientation());
    assert!(attitudes.windows(2).map(jump).fold(0.0, f32::max) > 90.0);
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn with_default_caps_no_recording_moves_the_camera_faster_than_they_say() {
    let config = Config::default();
    for (name, frames) in recordings() {
        let hands: BTreeSet<u32> = frames.iter().map(|r| r.hand_id).collect();
        for hand in hands {
            let mut steering = Steering::new(config);
            let mut camera = START;
            let mut before_us = None;
            for Recorded { frame, .. } in frames.iter().filter(|r| r.hand_id == hand) {
                let target = steering.follow(Some(frame), &camera).target;
                let elapsed_s = before_us.map_or(0.0, |t: u64| (frame.time_us() - t) as f32 * 1e-6);
                let moved_mm = (target.position_mm - camera.position_mm).norm();
                let turned_rad = degrees_between(&target.orientation, &camera.orientation).to_radians();
                assert!(moved_mm <= config.max_speed_mm_s * elapsed_s + 1e-3, "{name}: {moved_mm} mm");
                assert!(turned_rad <= config.max_turn_rad_s * elapsed_s + 1e-5, "{name}: {turned_rad} rad");
                before_us = Some(frame.time_us());
                camera = target;
            }
        }
    }
}

/// Rows of the guide's table: recording; regions, pinches, captures.
fn documented() -> BTreeMap<String, [String; 3]> {
    let guide = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/pendant.md");
    let text = fs::read_to_string(guide).expect("docs/pendant.md");
    let table = text.split_once("| recording | regions | pinches | captures |").expect("the table").1;
    let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_string()).collect::<Vec<_>>();
    let rows = table.lines().skip(2).take_while(|line| line.starts_with('|')).map(cells);
    rows.map(|cells| (cells[1].clone(), [2, 3, 4].map(|i| cells[i].clone()))).collect()
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn the_recordings_visit_the_regions_and_hold_the_captures_that_the_guide_says() {
    let all = recordings();
    let found: BTreeMap<_, _> = all.iter().map(|(name, frames)| (name.clone(), visited(frames))).collect();
    for (name, cells) in &found {
        println!("| {name} | {} |", cells.join(" | "));
    }
    assert_eq!(documented(), found);
}

/// Regions that the hands of a recording visit, in the wire's order; frames in which a right hand pinches without a
/// fist; captures of its right hands.
fn visited(frames: &[Recorded]) -> [String; 3] {
    let all = [
        Region::Home,
        Region::Left,
        Region::Right,
        Region::Up,
        Region::Down,
        Region::Inward,
        Region::Outward,
    ];
    let mut regions = Vec::new();
    let mut captures = 0;
    for hand in frames.iter().map(|r| r.hand_id).collect::<BTreeSet<u32>>() {
        let (mut steering, mut capture) = (Steering::new(Config::default()), CaptureGesture::default());
        for Recorded { frame, is_right, .. } in frames.iter().filter(|r| r.hand_id == hand) {
            regions.extend(steering.follow(Some(frame), &START).region);
            captures += u32::from(*is_right && capture.observe(Some(frame), frame.time_us()));
        }
    }
    let visited = all.into_iter().filter(|region| regions.contains(region));
    let names: Vec<String> = visited.map(|region| format!("{region:?}").to_lowercase()).collect();
    let pinches = frames.iter().filter(|r| r.is_right && r.frame.pinch() > 0.7 && r.frame.grab() < 0.5);
    [names.join(", "), pinches.count().to_string(), captures.to_string()]
}
