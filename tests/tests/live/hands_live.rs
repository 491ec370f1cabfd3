//! Live hands: the example that turns MediaPipe's landmarks into lines, and a scan by lines that come while it runs.

use std::io::{BufReader, Cursor, Write};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use nalgebra::{Rotation3, Vector3};
use weldpath::pendant::teleop::live::Live;
use weldpath::pendant::teleop::{Setup, generator, recording};
use weldpath::simulation;
use weldpath::simulation::{Part, Request};
use weldpath_core::wire::Hand;
use weldpath_tests::command::{Running, weldpath};
use weldpath_tests::in_process::InProcess;

const DOCS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs");
/// Of the example: focal length in picture widths, and where the webcam is in the sensor's frame, mm.
const FOCAL_WIDTHS: f64 = 0.83;
const WEBCAM_MM: Vector3<f64> = Vector3::new(0.0, 200.0, -500.0);
const ASPECT: f64 = 4.0 / 3.0;

/// A finger's base and whether it is stretched.
fn finger(base: [f64; 3], stretched: bool) -> [Vector3<f64>; 4] {
    let base = Vector3::from(base);
    let along: [[f64; 3]; 3] = if stretched {
        [[0.0, 0.0, -35.0], [0.0, 0.0, -55.0], [0.0, 0.0, -75.0]]
    } else {
        [[0.0, -25.0, -15.0], [0.0, -35.0, 10.0], [0.0, -30.0, 35.0]]
    };
    let [joint, last, tip] = along.map(|way| base + Vector3::from(way));
    [base, joint, last, tip]
}

/// MediaPipe's 21 places of a right hand, mm: palm down, fingers away from the user, the wrist in the origin.
fn landmarks(stretched: [bool; 4], ok: bool) -> Vec<Vector3<f64>> {
    let bases = [[-25.0, 0.0, -85.0], [0.0, 0.0, -90.0], [20.0, 0.0, -82.0], [38.0, 0.0, -70.0]];
    let thumb = [[-20.0, 0.0, -20.0], [-40.0, 0.0, -45.0], [-52.0, 0.0, -65.0], [-60.0, 0.0, -85.0]];
    let mut places = vec![Vector3::zeros()];
    places.extend(thumb.map(Vector3::from));
    places.extend(bases.into_iter().zip(stretched).flat_map(|(base, stretched)| finger(base, stretched)));
    if ok {
        // Thumb and index touch in front of the palm.
        (places[4], places[8]) = (Vector3::new(-42.0, -22.0, -98.0), Vector3::new(-40.0, -20.0, -100.0));
        places[6] = Vector3::new(-35.0, 5.0, -115.0);
    }
    places
}

/// A made hand: which one, how it is turned and where its palm is, mm.
struct Made {
    is_right: bool,
    turned: Rotation3<f64>,
    palm_mm: Vector3<f64>,
    stretched: [bool; 4],
    ok: bool,
}

impl Made {
    fn places(&self) -> Vec<Vector3<f64>> {
        let side = if self.is_right { 1.0 } else { -1.0 };
        let turned: Vec<_> = landmarks(self.stretched, self.ok)
            .into_iter()
            .map(|at| self.turned * Vector3::new(side * at.x, at.y, at.z))
            .collect();
        let palm = [0, 5, 9, 13, 17].map(|k| turned[k]).iter().sum::<Vector3<f64>>() / 5.0;
        turned.into_iter().map(|at| at - palm + self.palm_mm).collect()
    }

    /// What MediaPipe would say of it: landmarks in the picture, and in metres about the hand's middle.
    fn seen(&self) -> serde_json::Value {
        let places = self.places();
        let middle = places.iter().sum::<Vector3<f64>>() / 21.0;
        let picture = places.iter().map(|at| {
            let from = at - WEBCAM_MM;
            [0.5 - FOCAL_WIDTHS * from.x / from.z, 0.5 - ASPECT * FOCAL_WIDTHS * from.y / from.z, 0.0]
        });
        let world = places.iter().map(|at| (at - middle) / 1000.0).map(|at| [-at.x, -at.y, at.z]);
        let (picture, world): (Vec<_>, Vec<_>) = (picture.collect(), world.collect());
        serde_json::json!([self.is_right, 0.9, picture, world, ASPECT])
    }
}

/// The example's own conversion of these hands, one a line, as `weldpath` reads it.
fn converted(hands: &[Made]) -> Vec<Hand> {
    let program = "import json, sys\nsys.path.insert(0, sys.argv[1])\nimport mediapipe_hands as m\n\
                   for k, h in enumerate(json.load(sys.stdin)): print(m.line(k * 20000, [m.hand(*h)]))";
    let mut python = Command::new("python3")
        .args(["-B", "-c", program, DOCS])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python3");
    let seen = serde_json::Value::from_iter(hands.iter().map(Made::seen)).to_string();
    python.stdin.take().expect("piped").write_all(seen.as_bytes()).expect("listens");
    let ended = python.wait_with_output().expect("ends");
    assert!(ended.status.success(), "{ended:?}");
    let lines = String::from_utf8(ended.stdout).expect("text");
    // One stream a line: a live one leaves out what is overtaken.
    let alone = |line: &str| {
        let mut live = Live::listen(BufReader::new(Cursor::new(line.to_string())));
        let frame = live.next().unwrap_or_else(|| panic!("{line}: {:?}", live.failure()));
        frame.right.or(frame.left).expect("a hand")
    };
    lines.lines().map(alone).collect()
}

#[test]
fn the_example_finds_palm_direction_fingers_and_gestures_of_made_landmarks() {
    let open =
        |is_right, turned, palm_mm| Made { is_right, turned, palm_mm, stretched: [true; 4], ok: false };
    let level = Rotation3::identity();
    let hands = [
        open(true, level, Vector3::new(0.0, 200.0, 0.0)),
        open(false, level, Vector3::new(-60.0, 150.0, 80.0)),
        open(true, Rotation3::from_euler_angles(0.6, 0.3, -0.4), Vector3::new(70.0, 260.0, -50.0)),
        Made {
            stretched: [false; 4],
            ..open(false, Rotation3::from_euler_angles(0.3, 0.0, 0.2), Vector3::new(-40.0, 230.0, 20.0))
        },
        Made {
            ok: true,
            ..open(true, Rotation3::from_euler_angles(0.8, -0.2, 0.0), Vector3::new(30.0, 190.0, 10.0))
        },
    ];
    let found = converted(&hands);
    assert_eq!(found.len(), hands.len());
    for (hand, made) in found.iter().zip(&hands) {
        let palm_mm = Vector3::from(hand.palm_um.map(|um| f64::from(um) * 1e-3));
        assert!((palm_mm - made.palm_mm).norm() < 0.1, "{palm_mm} is not {}", made.palm_mm);
        let along = |q15: [i16; 3]| Vector3::from(q15.map(|c| f64::from(c) / 32767.0));
        let (ahead, down) = (made.turned * -Vector3::z(), made.turned * -Vector3::y());
        assert!(along(hand.direction_q15).dot(&ahead) > 0.999, "{hand:?}");
        assert!(along(hand.normal_q15).dot(&down) > 0.999, "{hand:?}");
        let stretched = made.stretched.iter().enumerate().skip(usize::from(made.ok));
        for (finger, stretched) in stretched {
            assert_eq!(hand.extended >> (finger + 1) & 1 == 1, *stretched, "finger {finger} of {hand:?}");
        }
        let fist = made.stretched == [false; 4];
        assert_eq!(hand.grab_permille > 800, fist, "{hand:?}");
        assert_eq!(hand.pinch_permille > 700 && hand.grab_permille < 500, made.ok, "{hand:?}");
        assert_eq!(hand.confidence_permille, 900);
    }
}

#[test]
fn lines_that_come_while_the_scan_runs_guide_the_camera_and_capture() {
    let request = Request { views: Some(6), ..Request::new(Part::ButtV, 1) };
    let poses = simulation::stage(&request).unwrap().base_from_camera;
    let setup = Setup {
        base_from_camera: poses[0],
        box_center_mm: [0.0, 200.0, 0.0],
        box_mm: 100.0,
        steer_right: false,
    };
    let frames = generator::recording(&setup, &poses).unwrap();
    let (pendant, out) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    pendant.manual(true);
    let scan = out.path().join("scan");
    let mut host = Running::start(
        weldpath().args(["scan", "--hands", "-", "--port", &pendant.port, "--out"]).arg(&scan),
    );
    // A new session needs a new grip.
    host.wait_for(&["waiting for the key switch"]);
    pendant.grip();
    let rows = recording::to_csv(&frames, "a sensor of a test");
    let first_rows = rows.lines().take_while(|line| !line.starts_with("0,")).collect::<Vec<_>>().join("\n");
    host.press(format!("{first_rows}\n").as_bytes());
    // The session opens meanwhile: what it cannot take yet would be left out.
    thread::sleep(Duration::from_secs(1));
    let begun = Instant::now();
    for row in rows.lines().skip(first_rows.lines().count()) {
        let time_us = row.split(',').next().and_then(|time| time.parse().ok()).expect("a time");
        thread::sleep(Duration::from_micros(time_us).saturating_sub(begun.elapsed()));
        host.press(format!("{row}\n").as_bytes());
    }
    host.close_keys();
    let ended = host.end();
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    assert!(ended.said.contains("6 views"), "{}", ended.said);
    assert!(scan.join("scan.json").exists());
}

#[test]
fn lines_that_are_no_hands_end_the_scan_with_the_line_and_write_nothing() {
    let (pendant, out) = (InProcess::on_socket().unwrap(), tempfile::tempdir().unwrap());
    pendant.manual(true);
    let scan = out.path().join("scan");
    for (more, code, part) in
        [(&[][..], 4, "line 2: neither"), (&["--hands", "more.csv"][..], 2, "stands alone")]
    {
        let mut command = weldpath();
        command.args(["scan", "--hands", "-", "--port", &pendant.port, "--out"]).arg(&scan).args(more);
        let mut host = Running::start(&mut command);
        if more.is_empty() {
            host.wait_for(&["waiting for the key switch"]);
            pendant.grip();
            host.press(b"# a sensor\nhello\n");
        }
        host.close_keys();
        let ended = host.end();
        assert_eq!(ended.code, Some(code), "{}", ended.said);
        assert!(ended.said.contains(part), "{}", ended.said);
        assert!(!scan.exists());
        thread::sleep(Duration::from_millis(300));
    }
}
