//! Corners that the camera rounds or fills: a matching window, and light from one face on the other (made by the simulator).
//! The root is found by the faces where they are true, and what stays unknown of it is stated.

use weldpath::pipeline::{self, Anchor, Plan};
use weldpath::run::job::Job;
use weldpath::simulation::{Noise, Part, Request, SensorErrors};
use weldpath_tests::scans::{scanned, scored};

/// Path and torch of a scan whose first pose is exact: off by so much, mm and degrees, as stated, and part from the corner.
struct Found {
    rmse_mm: f64,
    rmse_deg: f64,
    expected_mm: f64,
    corner_mm: f64,
}

fn found(part: Part, seed: u64, sensor: SensorErrors) -> Found {
    let (scan, truth) = scanned(&Request { sensor, noise: Noise::Mid, ..Request::new(part, seed) });
    let mut config = Job::default().pipeline();
    config.merge.anchor = Some(Anchor::First);
    let plan: Plan = pipeline::plan(&scan.views, &config, &mut ()).unwrap_or_else(|error| panic!("{error}"));
    let scored = scored(&plan, &truth);
    assert!(scored.coverage > 0.95, "{part} {seed}: {} covered", scored.coverage);
    let longest = plan.seams.iter().max_by(|a, b| a.length_mm().total_cmp(&b.length_mm())).expect("a seam");
    let found = Found {
        rmse_mm: scored.rmse_mm.expect("seams"),
        rmse_deg: scored.rmse_deg.expect("seams"),
        expected_mm: longest.expected_error_mm,
        corner_mm: longest.error_parts.corner_mm,
    };
    println!(
        "{part} {seed}: {:.2} mm, {:.2} deg; stated {:.2} mm, of it {:.2} from the corner",
        found.rmse_mm, found.rmse_deg, found.expected_mm, found.corner_mm
    );
    found
}

/// Without the strip that is left out and the lift that is taken off, these were off by 0.4 to 1.0 mm and up to 16 degrees,
/// at a stated 0.04 to 0.15 mm.
#[test]
fn a_corner_that_a_matching_window_rounds_is_found_where_it_is() {
    let stereo = SensorErrors { window_px: 3, ..SensorErrors::default() };
    for (part, seed) in [(Part::Fillet, 41), (Part::Fillet, 42), (Part::Pipe, 41)] {
        let found = found(part, seed, stereo);
        assert!(found.rmse_mm < 0.25 && found.rmse_deg < 1.0, "{part} {seed}");
        assert!(found.corner_mm > 0.0 && found.rmse_mm < 2.0 * found.expected_mm, "{part} {seed}");
    }
}

#[test]
fn a_corner_that_light_between_its_faces_fills_is_found_nearer_to_where_it_is() {
    let filled = SensorErrors { interreflection_mm: 1.0, ..SensorErrors::default() };
    for (part, seed) in [(Part::Fillet, 41), (Part::Fillet, 42), (Part::Pipe, 41)] {
        let found = found(part, seed, filled);
        assert!(found.rmse_mm < 0.6, "{part} {seed}: it was 0.8 mm");
    }
}

#[test]
fn a_corner_that_nothing_rounds_is_not_corrected() {
    for (part, seed) in [(Part::Fillet, 41), (Part::Lap, 41), (Part::ButtV, 41), (Part::Corner, 41)] {
        let found = found(part, seed, SensorErrors::default());
        assert!(found.rmse_mm < 0.2 && found.corner_mm < 0.05, "{part} {seed}");
    }
}
