//! `weldpath evaluate --suite`: every scan, mesh and cloud below a folder planned and set against its truth.

use std::fmt::Write;
use std::path::Path;

use weldpath::lab::suite::{self, PieceScore, StatedSeam, Tally};
use weldpath::output::verdict::State;
use weldpath::run::job::scan::AnchorName;

use super::{Exit, Failure, print};

/// Plans all of it; a row is printed as soon as it is measured.
pub(super) fn run(folder: &Path, anchor: AnchorName, json: bool, quiet: bool) -> Result<(), Failure> {
    let unread = |error| Failure::new(Exit::Input, format!("cannot read {}: {error}", folder.display()));
    let pieces = suite::pieces(folder).map_err(unread)?;
    if pieces.is_empty() {
        let message = format!("{} holds no scan, mesh or cloud", folder.display());
        return Err(Failure::new(Exit::Input, message).hint("a scan is a folder with scan.json"));
    }
    let width = pieces.iter().map(|piece| piece.name.len()).max().unwrap_or(0).max(5);
    let told = |text: &str| if json || quiet { Ok(()) } else { print(text) };
    told(&format!("{:<width$} {HEADING}\n", "piece"))?;
    let mut rows = Vec::with_capacity(pieces.len());
    for piece in &pieces {
        let row = suite::measure(piece, anchor);
        told(&format!("{:<width$} {}\n", row.name, words(&row)))?;
        rows.push(row);
    }
    told(&format!("{:<width$} {}\n", "mean", mean(&rows)))?;
    let scores: Vec<StatedSeam> = rows.iter().flat_map(|row| row.scores.iter().copied()).collect();
    told(&trusted(&scores))?;
    let text = || serde_json::to_string_pretty(&rows).map(|text| text + "\n").unwrap_or_default();
    if json { print(&text()) } else { Ok(()) }
}

const HEADING: &str = "kind  seams  length mm  weld mm  covered %  named %  false %  error mm  stated mm  torch deg  false conf verdict     s";

fn words(row: &PieceScore) -> String {
    let kind = format!("{:?}", row.kind).to_lowercase();
    let mut text = format!(
        "{kind:<5} {:>5} {:>10.0} {}",
        row.seams,
        row.length_mm,
        tallied(row.tally.as_ref(), row.stated_mm)
    );
    // Writing to a String cannot fail.
    let verdict = row.verdict.map_or("-", State::name);
    // Without a truth nobody has said that the surest seam is false.
    let sure = match (row.confidence, &row.tally) {
        (Some(sure), None) => format!("({sure:.2})"),
        (sure, _) => number(sure),
    };
    let _ = write!(text, " {sure:>11} {verdict:<7} {:>5.1}", row.plan_s);
    if let Some(reason) = &row.reason {
        let _ = write!(text, "  {reason}");
    }
    text
}

fn tallied(tally: Option<&Tally>, stated_mm: Option<f64>) -> String {
    let value = |value: fn(&Tally) -> f64, digits: usize| {
        tally.map_or("-".to_owned(), |t| format!("{:.digits$}", value(t)))
    };
    format!(
        "{:>8} {:>10} {:>8} {:>8} {:>9} {:>10} {:>10}",
        value(|t| t.weld_mm, 0),
        value(|t| 100.0 * t.covered, 1),
        value(|t| 100.0 * t.named, 1),
        value(|t| 100.0 * t.false_share, 1),
        number(tally.and_then(|t| t.across_mm)),
        number(stated_mm),
        number(tally.and_then(|t| t.torch_deg)),
    )
}

fn number(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.2}"))
}

/// How far confidences can be trusted; nothing without a truth.
fn trusted(scores: &[StatedSeam]) -> String {
    let mut text = String::new();
    for (k, row) in suite::reliability(scores).iter().enumerate() {
        if k == 0 {
            text += "\nconfidence  seams  on a weld %  error within twice the stated, too %  stated %\n";
        }
        let percent = |part: usize| 100.0 * part as f64 / row.seams as f64;
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "from {:<6.1} {:>5} {:>12.1} {:>37.1} {:>9.1}",
            row.least_confidence,
            row.seams,
            percent(row.on_weld),
            percent(row.right),
            100.0 * row.mean_confidence
        );
    }
    let right: Vec<f64> =
        scores.iter().filter(|score| score.is_right()).map(|score| score.confidence).collect();
    if !right.is_empty() {
        let sure = right.iter().filter(|confidence| **confidence >= SURE).count();
        let share = 100.0 * sure as f64 / right.len() as f64;
        let _ = writeln!(text, "of {} right seams {share:.1} % are stated at {SURE} or more", right.len());
    }
    text
}

/// From here on a user takes a seam as found.
const SURE: f64 = 0.9;

/// Means over the rows that have a truth.
fn mean(rows: &[PieceScore]) -> String {
    let tallies: Vec<Tally> = rows.iter().filter_map(|row| row.tally).collect();
    let over =
        |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
    let all = |value: fn(&Tally) -> Option<f64>| over(tallies.iter().filter_map(value).collect());
    let mean = Tally {
        weld_mm: all(|t| Some(t.weld_mm)).unwrap_or_default(),
        covered: all(|t| Some(t.covered)).unwrap_or_default(),
        named: all(|t| Some(t.named)).unwrap_or_default(),
        false_share: all(|t| Some(t.false_share)).unwrap_or_default(),
        across_mm: all(|t| t.across_mm),
        torch_deg: all(|t| t.torch_deg),
    };
    let stated = over(rows.iter().filter_map(|row| row.stated_mm).collect());
    format!("{:<5} {:>5} {:>10} {}", "", "", "", tallied((!tallies.is_empty()).then_some(&mean), stated))
}
