//! The result of a plan, for people.

use std::fmt::Write;
use std::path::Path;

use weldpath::export::summary::Source;
use weldpath::pipeline::{Plan, ViewReport};
use weldpath::postprocessing::Output;
use weldpath::seam::Seam;

/// Seams, what was derived, warnings, and where the files are.
pub(super) fn result(plan: &Plan, output: &Output, source: &Source, out: &Path) -> String {
    let mut text = format!(
        "{:>4}  {:<8} {:>10} {:>7} {:>11}  {}\n",
        "seam", "joint", "length", "points", "confidence", "expected error"
    );
    for seam in &plan.seams {
        text.push_str(&row(seam, output));
    }
    for note in &source.notes {
        line(&mut text, note);
    }
    for derived in &plan.derived {
        line(&mut text, &format!("{} = {} ({})", derived.name, significant(derived.value), derived.how));
    }
    plan.views.iter().for_each(|view| line(&mut text, &registration(view)));
    let seams =
        plan.seams.iter().flat_map(|seam| seam.warnings.iter().map(|w| format!("seam {}: {w}", seam.id)));
    for warning in output.summary.warnings().iter().cloned().chain(seams) {
        line(&mut text, &format!("warning: {warning}"));
    }
    let names: Vec<&str> = output.files.iter().map(|file| file.name.as_str()).collect();
    line(&mut text, &format!("{}: {}", out.display(), names.join(", ")));
    text
}

fn line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push('\n');
}

fn row(seam: &Seam, output: &Output) -> String {
    let points = output.paths.iter().find(|path| path.seam == seam.id).map(|path| path.points.len());
    let mut row = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(
        row,
        "{:>4}  {:<8} {:>7.1} mm {:>7} {:>10.0}%  {} mm, {} deg",
        seam.id,
        seam.joint.name(),
        seam.length_mm(),
        points.map_or("-".to_owned(), |n| n.to_string()),
        100.0 * seam.confidence,
        significant(seam.expected_error_mm),
        significant(seam.expected_error_deg)
    );
    row
}

fn registration(view: &ViewReport) -> String {
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
