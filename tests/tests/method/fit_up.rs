//! Measured dimensions of joints against the truth: angle, depth, width, thickness and root opening, each within what is
//! stated of it. The table is printed: `cargo test -p weldpath-tests --test method fit_up -- --nocapture`.

use std::path::Path;
use weldpath::evaluation::Truth;
use weldpath::pipeline::Plan;
use weldpath::seam::Seam;
use weldpath::seam::measure::dimension::{Quantity, Value};
use weldpath::simulation::{Noise, Part, Request};
use weldpath_tests::scans::scanned;
use weldpath_tests::shared_data;

use crate::planned::{plan, plan_of};

/// Uncertainties that still tell a tight joint from one that needs another weld, mm; the root of a groove is blurred by
/// the noise of everything round it.
const USEFUL_MM: f64 = 0.5;
const USEFUL_GROOVE_MM: f64 = 1.0;

/// A scan of 200 mm of seam whose members stand so far apart, planned.
fn simulated(part: Part, noise: Noise, root_opening_mm: f64) -> (Plan, Truth) {
    let request = Request {
        noise,
        length_mm: Some(200.0),
        root_opening_mm: Some(root_opening_mm),
        ..Request::new(part, 3)
    };
    let (scan, truth) = scanned(&request);
    (plan_of(&scan).unwrap_or_else(|error| panic!("{error}")), truth)
}

/// What the piece was made with, of a seam of this kind.
fn made(truth: &Truth, quantity: Quantity) -> Option<f64> {
    let drawn = |name: &str| truth.params.get(name).copied();
    let gap_mm = drawn("gap").unwrap_or(0.0);
    let groove = || Some((drawn("T")? - drawn("root_face")?, drawn("included").unwrap_or(60.0)));
    match quantity {
        Quantity::IncludedAngle => truth.seams.first().map(|seam| seam.angle_deg),
        Quantity::RootOpening => Some(gap_mm),
        Quantity::SheetThickness => drawn("T2"),
        Quantity::GrooveDepth => groove().map(|(depth_mm, _)| depth_mm),
        Quantity::CapWidth => groove().map(|(depth_mm, included_deg)| {
            gap_mm + 2.0 * depth_mm * (0.5 * included_deg).to_radians().tan()
        }),
    }
}

/// Prints a seam's dimensions, and names those that are farther from the truth than they say.
fn wrong(name: &str, seam: &Seam, truth: &Truth) -> Vec<String> {
    let mut wrong = Vec::new();
    print!(
        "{name}: {} {:.0} mm (error {:.2} mm)",
        seam.joint.name(),
        seam.length_mm(),
        seam.expected_error_mm
    );
    for dimension in &seam.dimensions {
        print!(", {dimension}");
        let (Some(made), Ok(Value { value, uncertainty })) =
            (made(truth, dimension.quantity), dimension.value.clone())
        else {
            continue;
        };
        if (value - made).abs() > uncertainty {
            print!(" * ({made:.2})");
            wrong.push(format!("{name}: {dimension}, made with {made:.2}"));
        }
    }
    println!();
    wrong
}

fn opening(seam: &Seam) -> Value {
    let found = seam.dimensions.iter().find(|d| d.quantity == Quantity::RootOpening);
    found
        .expect("every joint has a root")
        .value
        .clone()
        .unwrap_or_else(|reason| panic!("not measured: {reason}"))
}

/// Simulates and plans a part at low and medium noise with each opening, and holds its dimensions to the truth.
fn holds(part: Part, openings_mm: &[f64]) {
    let mut all_wrong = Vec::new();
    for noise in [Noise::Low, Noise::Mid] {
        for &opening_mm in openings_mm {
            let (plan, truth) = simulated(part, noise, opening_mm);
            let name = format!("{part} {noise} {opening_mm}");
            let [seam] = plan.seams.as_slice() else { panic!("{name}: {} seams", plan.seams.len()) };
            assert_eq!(seam.joint.name(), part.name(), "{name}: {}", seam.reason);
            assert!((seam.length_mm() - 200.0).abs() < 6.0, "{name}: {:.1} mm long", seam.length_mm());
            all_wrong.extend(wrong(&name, seam, &truth));
            let stated = opening(seam).uncertainty;
            let useful_mm = if part == Part::ButtV { USEFUL_GROOVE_MM } else { USEFUL_MM };
            assert!(stated < useful_mm, "{name}: to {stated:.2} mm is of no use");
        }
    }
    assert!(all_wrong.is_empty(), "{all_wrong:#?}");
}

#[test]
fn the_root_of_a_groove_is_as_open_as_it_was_made() {
    holds(Part::ButtV, &[0.0, 1.0, 2.0, 3.0]);
}

#[test]
fn a_web_stands_off_its_plate_as_far_as_it_was_made() {
    holds(Part::Fillet, &[0.0, 1.0, 2.0]);
}

#[test]
fn a_sheet_on_a_plate_is_as_thick_and_as_far_off_as_it_was_made() {
    holds(Part::Lap, &[0.0, 1.0, 2.0]);
}

/// All seams of a scan against the truth of its part.
fn wrong_of(name: &str, folder: &Path, truth: &Path) -> Vec<String> {
    let truth = Truth::read(truth).unwrap_or_else(|error| panic!("{error}"));
    let several = truth.seams.iter().any(|seam| (seam.angle_deg - truth.seams[0].angle_deg).abs() > 1.0);
    let mut seams = plan(folder).unwrap_or_else(|error| panic!("{error}")).seams;
    // Seams at several angles: which is which is not told here.
    let angle = |seam: &mut Seam| seam.dimensions.retain(|d| d.quantity != Quantity::IncludedAngle);
    seams.iter_mut().filter(|_| several).for_each(angle);
    seams.iter().flat_map(|seam| wrong(name, seam, &truth)).collect()
}

#[test]
fn the_fixtures_are_fitted_up_as_they_were_made() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().join("fixtures");
    let of = |name: &&str| wrong_of(name, &fixtures.join(name), &fixtures.join(name).join("truth.json"));
    let wrong: Vec<String> = ["fillet", "lap", "pipe", "butt-v"].iter().flat_map(of).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
#[cfg_attr(not(shared_data), ignore = "needs ../shared/data beside the checkout")]
fn the_larger_scans_are_fitted_up_as_they_were_made() {
    let scans = shared_data("scans");
    let folders = std::fs::read_dir(&scans).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = folders.map(|name| name.into_string().unwrap()).collect();
    names.retain(|name| scans.join(name).join("scan.json").exists());
    names.sort();
    let of = |name: &String| wrong_of(name, &scans.join(name), &scans.join(format!("truth/{name}.json")));
    let wrong: Vec<String> = names.iter().flat_map(of).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}
