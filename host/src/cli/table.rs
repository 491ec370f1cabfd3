//! The result of a plan, for people.

use std::fmt::Write;
use std::path::Path;

use weldpath::output::summary::Source;
use weldpath::pipeline::{BaseFrame, CameraFinding, Plan, ViewReport};
use weldpath::run::postprocessing::Output;
use weldpath::seam::measure::dimension::Dimension;
use weldpath::seam::{Seam, Unwelded, WhyUnwelded};
use weldpath::weld::position::Position;

use super::warnings;

/// Verdict, seams, warnings, and where the files are; `verbose` adds what was measured and derived.
pub(super) fn result(plan: &Plan, output: &Output, source: &Source, out: &Path, verbose: bool) -> String {
    let mut text = String::new();
    let verdict = output.summary.verdict();
    let reasons = if verbose { verdict.lines() } else { verdict.short_lines() };
    reasons.iter().for_each(|reason| line(&mut text, reason));
    text += &format!(
        "{:>4}  {:<8} {:<8} {:>10} {:>7} {:>11}  {:<19}  {}\n",
        "seam", "joint", "position", "length", "points", "confidence", "expected error", "within the scan"
    );
    for seam in &plan.seams {
        text.push_str(&row(seam, output));
    }
    for seam in &plan.seams {
        let notes = output.summary.notes(seam.id).iter();
        notes.for_each(|note| line(&mut text, &format!("seam {}: {note}", seam.id)));
    }
    if plan.seams.iter().any(|seam| seam.base_error_mm.is_nan()) {
        line(&mut text, OF_SCAN_ALONE);
    }
    unwelded(&mut text, plan, verbose);
    for note in &source.notes {
        line(&mut text, note);
    }
    if verbose {
        derived(&mut text, plan);
    }
    // What was changed in what the user stated is always said.
    let corrected = |found: &&BaseFrame| verbose || found.hand_eye.is_applied;
    plan.derived.base_frame.iter().filter(corrected).for_each(|found| line(&mut text, &cell(found)));
    let wrong = |found: &&CameraFinding| verbose || found.is_significant;
    plan.derived.camera.iter().filter(wrong).for_each(|found| line(&mut text, &camera(found)));
    let seams =
        plan.seams.iter().flat_map(|seam| seam.warnings.iter().map(|w| format!("seam {}: {w}", seam.id)));
    let all: Vec<String> = output.summary.warnings().iter().cloned().chain(seams).collect();
    for warning in warnings::lines(&all) {
        line(&mut text, &format!("warning: {warning}"));
    }
    let names: Vec<&str> = output.files.iter().map(|file| file.name.as_str()).collect();
    line(&mut text, &format!("{}: {}", out.display(), names.join(", ")));
    text
}

/// What the expected error of a cloud or a mesh leaves out.
const OF_SCAN_ALONE: &str =
    "expected error: of the scan alone; how exactly it lies in the robot's base frame is not known";

/// Inside corners that are no seams: all of them, or how many there are off the table.
fn unwelded(text: &mut String, plan: &Plan, verbose: bool) {
    if verbose {
        plan.unwelded.iter().for_each(|corner| line(text, &format!("not a seam: {}", corner.words)));
        return;
    }
    let off_table: Vec<f64> = plan
        .unwelded
        .iter()
        .filter(|corner| corner.reason != WhyUnwelded::Table)
        .map(Unwelded::length_mm)
        .collect();
    let Some(longest_mm) = off_table.iter().copied().reduce(f64::max) else { return };
    let corners = match off_table.len() {
        1 => format!("1 inside corner of {longest_mm:.0} mm is"),
        n => format!("{n} inside corners of up to {longest_mm:.0} mm are"),
    };
    line(text, &format!("{corners} seen and not offered as seams: --verbose says where and why"));
}

/// What was measured of each seam, derived from the data, and how each view moved.
fn derived(text: &mut String, plan: &Plan) {
    for seam in plan.seams.iter().filter(|seam| !seam.dimensions.is_empty()) {
        let measured: Vec<String> = seam.dimensions.iter().map(Dimension::to_string).collect();
        line(text, &format!("seam {}: {}", seam.id, measured.join(", ")));
    }
    for derived in &plan.derived.parameters {
        line(text, &format!("{} = {} ({})", derived.name, significant(derived.value), derived.how));
    }
    plan.derived.views.iter().for_each(|view| line(text, &registration(view)));
}

fn line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push('\n');
}

fn row(seam: &Seam, output: &Output) -> String {
    let paths = || output.paths.iter().filter(|path| path.seam == seam.id);
    let points = paths().flat_map(|path| &path.points).filter(|point| point.process.weld).count();
    let positions: Vec<String> = output.summary.positions(seam.id).iter().map(Position::to_string).collect();
    let mut row = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(
        row,
        "{:>4}  {:<8} {:<8} {:>7.1} mm {:>7} {:>10.0}%  {:<19}  {} mm",
        seam.id,
        output.summary.joint(seam.id).unwrap_or(seam.joint).name(),
        positions.join("-"),
        seam.length_mm(),
        paths().next().map_or("-".to_owned(), |_| points.to_string()),
        100.0 * seam.confidence,
        format!("{} mm, {} deg", significant(seam.tip_error_mm()), significant(seam.tip_error_deg())),
        significant(seam.relative_error_mm)
    );
    row
}

/// What the views say of the cell.
fn cell(found: &BaseFrame) -> String {
    let own = &found.hand_eye;
    format!(
        "cell: poses scatter by {} mm and {} deg ({:.1} and {:.1} times what is stated); hand-eye off by {} +- {} mm and {} +- \
         {} deg, {}",
        significant(found.robot_mm),
        significant(found.robot_deg),
        found.scale_mm,
        found.scale_deg,
        significant(own.shift_mm),
        significant(own.shift_sigma_mm),
        significant(own.turn_deg),
        significant(own.turn_sigma_deg),
        if own.is_applied { "corrected" } else { "not significant, left as stated" }
    )
}

/// What the views say of the camera.
fn camera(found: &CameraFinding) -> String {
    format!(
        "camera: {}, {}",
        found.words(),
        if found.is_significant { "corrected" } else { "not significant, left as stated" }
    )
}

fn registration(view: &ViewReport) -> String {
    if let Some(why) = &view.left_out {
        return format!("view {}: left out: it {why}", view.name);
    }
    format!(
        "view {}: fitness {:.2} -> {:.2}, moved {} mm and {} deg",
        view.name,
        view.fitness_before,
        view.fitness_after,
        significant(view.moved_mm),
        significant(view.moved_deg)
    )
}

/// Two decimals below ten, none from a hundred on.
fn significant(value: f64) -> String {
    match value.abs() {
        small if small < 10.0 => format!("{value:.2}"),
        medium if medium < 100.0 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, UnitQuaternion, Vector3};
    use weldpath::pipeline::{Derivation, Parameter, Remarks};
    use weldpath::run::job::Job;
    use weldpath::run::postprocessing::postprocess;
    use weldpath::seam::measure::coverage::{OneSided, Viewpoint};
    use weldpath::seam::{ErrorParts, Joint, Station};
    use weldpath::weld::{PathPoint, Process, SeamPath};

    fn plan() -> Plan {
        let at = |x| Point3::new(x, 0.0, 0.0);
        let station = |x| Station { position_mm: at(x), tangent: Vector3::x(), faces: [Vector3::z(); 2] };
        let seam = Seam {
            id: 1,
            joint: Joint::ButtV,
            reason: "by hand".into(),
            stations: vec![station(0.0), station(500.0)],
            closed: false,
            confidence: 0.934,
            expected_error_mm: 0.08,
            relative_error_mm: 0.08,
            fit_error: weldpath::seam::FitError::default(),
            error_parts: ErrorParts {
                noise_mm: 0.08,
                registration_mm: 0.0,
                calibration_mm: 0.595,
                corner_mm: 0.0,
                touch_mm: 0.0,
            },
            expected_error_deg: 0.5,
            base_error_mm: 0.6,
            base_error_deg: 0.7,
            contact: None,
            drawn: false,
            dimensions: vec![],
            warnings: vec!["the last 20 mm were seen by one view only".into()],
        };
        let base_from_torch = UnitQuaternion::identity();
        let process = Process::default();
        let points = [0.0, 500.0]
            .map(|x| PathPoint { s_mm: x, position_mm: at(x), base_from_torch, process })
            .to_vec();
        Plan {
            seams: vec![seam],
            paths: vec![SeamPath { seam: 1, points }],
            derived: Derivation {
                parameters: vec![Parameter {
                    name: "voxel_mm".into(),
                    value: 0.8,
                    how: "twice the mean spacing".into(),
                }],
                ..Derivation::default()
            },
            said: Remarks { warnings: vec!["view 3 overlaps too little".into()], ..Remarks::default() },
            ..Plan::default()
        }
    }

    #[test]
    fn the_result_names_seams_parameters_warnings_and_files() {
        let source = Source { notes: vec!["units: metres".into()], ..Source::default() };
        let output = postprocess(&plan(), &Job::default(), source.clone()).unwrap();
        let text = result(&plan(), &output, &source, Path::new("out"), true);
        let lines: Vec<&str> = text.lines().collect();
        assert!(
            lines[0].starts_with("verdict: check") && lines[1].starts_with("tool-not-stated: "),
            "{text}"
        );
        let row: Vec<&str> = lines[3].split_whitespace().collect();
        let expected = ["1", "butt-v", "PA", "500.0", "mm", "251", "93%", "0.60", "mm,", "0.70", "deg"];
        assert_eq!((&row[..11], &row[11..]), (&expected[..], &["0.08", "mm"][..]));
        assert_eq!(lines[4..6], ["units: metres", "voxel_mm = 0.80 (twice the mean spacing)"]);
        assert_eq!(lines[6], "warning: view 3 overlaps too little");
        assert!(lines.contains(&"warning: seam 1: the last 20 mm were seen by one view only"));
        assert!(lines[lines.len() - 1].starts_with("out: path.csv, path.json, path.script, model.ply"));
        // What was derived is for those who ask for it.
        let short = result(&plan(), &output, &source, Path::new("out"), false);
        let left_out: Vec<&str> = lines.into_iter().filter(|line| !short.contains(line)).collect();
        assert_eq!(left_out, ["voxel_mm = 0.80 (twice the mean spacing)"]);
    }

    #[test]
    fn a_seam_that_was_seen_from_one_side_says_so_with_the_view_to_add() {
        let view = Viewpoint { position_mm: Point3::new(10.0, -300.0, 200.0), direction: Vector3::y() };
        let one_sided = vec![OneSided { seam: 1, face: -Vector3::y(), view }];
        let plan = Plan { one_sided, ..plan() };
        let output = postprocess(&plan, &Job::default(), Source::default()).unwrap();
        let text = result(&plan, &output, &Source::default(), Path::new("out"), false);
        let note = text.lines().find(|line| line.starts_with("seam 1: one side seen: ")).unwrap();
        assert!(
            note.ends_with("with the camera near (10, -300, 200) mm, looking along (0.00, 1.00, 0.00)"),
            "{note}"
        );
    }

    #[test]
    fn a_seam_that_is_welded_downhill_without_being_asked_to_says_so() {
        // Up is against the seam as it was found.
        for (direction, said) in
            [("", true), ("[path]\ndirection = \"down\"", false), ("[path]\ndirection = \"up\"", false)]
        {
            let job =
                Job::parse(&format!("[order]\nup = [-1, 0, 0]\n{direction}"), Path::new("job.toml")).unwrap();
            let output = postprocess(&plan(), &job, Source::default()).unwrap();
            let text = result(&plan(), &output, &Source::default(), Path::new("out"), false);
            assert_eq!(
                text.contains("\nseam 1: welded downhill (PG), because the job states no direction"),
                said,
                "{text}"
            );
            assert_eq!(text.contains("PF"), direction.contains("up"), "{text}");
        }
    }
}
