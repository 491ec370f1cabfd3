//! The command and the firmware in the emulator: a planned fixture held and resumed, a path longer than the ring.

use std::path::Path;

use nalgebra::{Point3, UnitQuaternion};
use weldpath::output::frame::PathFrame;
use weldpath::output::json;
use weldpath::weld::program::{Kind, Waypoint};
use weldpath_tests::command::{Running, ends_well, weldpath};
use weldpath_tests::qemu::firmware;
use weldpath_tests::simulated::Simulated;

#[test]
fn a_planned_fixture_is_welded_held_and_resumed_by_the_simulated_pendant() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let folder = tempfile::tempdir().unwrap();
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/butt-v");
    let options = ["--feed-mm-s", "50", "--quiet", "--out"];
    ends_well(weldpath().arg("plan").arg(fixture).args(options).arg(folder.path()));
    let mut pendant = Simulated::start(&program);
    let arguments = ["stream", "--port", &pendant.port, "--back-mm", "3"];
    let mut host = Running::start(weldpath().args(arguments).arg(folder.path()));
    pendant.operate(&mut host, &["running"]);
    const HOLD: &str = "hold was asked for";
    for attempt in 1.. {
        assert!(attempt < 10, "it is never held");
        host.press(b"h");
        // Refused if the host itself was silent for too long in this very moment.
        let answer = pendant.operate(&mut host, &[HOLD, "refused", "finished"]);
        assert!(!answer.contains("finished"), "it was not held");
        if answer.contains(HOLD) {
            break;
        }
    }
    host.press(b"r");
    pendant.operate(&mut host, &["finished"]);
    let ended = host.end();
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    pendant.quit();
}

/// Waypoints on a circle, 0.8 mm apart: at 100 mm/s half of what the emulated line carries.
fn circle(count: usize) -> Vec<Waypoint> {
    let at = |k: usize| {
        let angle = k as f64 * 0.8 / 300.0;
        Waypoint {
            position_mm: Point3::new(600.0 + 300.0 * angle.cos(), 300.0 * angle.sin(), 100.0),
            base_from_torch: UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), angle),
            feed_mm_s: 100.0,
            weld: true,
            seam: Some(1),
            kind: Kind::Weld,
            dwell_s: None,
        }
    };
    (0..count).map(at).collect()
}

/// With `WELDPATH_LONG` set 10 000 waypoints.
#[test]
fn a_path_longer_than_the_ring_reaches_the_firmware_over_a_line_that_damages_bytes() {
    let Some(program) = firmware("weldpath-firmware") else { return };
    let count = if std::env::var_os("WELDPATH_LONG").is_some() { 10_000 } else { 1_200 };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("path.json");
    std::fs::write(&file, json::write(&circle(count), PathFrame::Base)).unwrap();
    let mut pendant = Simulated::start(&program);
    let port = pendant.damaged(folder.path(), 1e-3).unwrap();
    let mut host = Running::start(weldpath().args(["stream", "--port", &port]).arg(&file));
    host.wait_for(&[&format!("streaming {count} waypoints")]);
    pendant.operate(&mut host, &["finished"]);
    let ended = host.end();
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    println!("{}", ended.said);
    pendant.quit();
}
