//! How far a plan is from the truth, point by point, for the page.

use super::content::rounded;
use serde::Serialize;
use weldpath_sim::evaluation::{Deviation, Options, PathSet, Score, Truth, deviations, score};

#[derive(Serialize)]
struct Document<'a> {
    truth: &'a str,
    score: Score,
    points: Vec<Point>,
    lines: Vec<Line<'a>>,
}

/// One path point.
#[derive(Serialize)]
struct Point {
    seam: String,
    /// Distance along the path's own seam.
    s_mm: f64,
    #[serde(flatten)]
    deviation: Deviation,
}

#[derive(Serialize)]
struct Line<'a> {
    name: &'a str,
    closed: bool,
    line_mm: Vec<[f64; 3]>,
}

/// The deviation of `paths` from `truth` as JSON, for [`super::with_deviation`].
pub fn deviation(paths: &PathSet, truth: &Truth, options: &Options) -> String {
    let lines = truth.seams.iter().map(|seam| Line {
        name: &seam.name,
        closed: seam.closed,
        line_mm: seam.line(options.target).iter().map(|p| rounded(*p)).collect(),
    });
    let document = Document {
        truth: &truth.name,
        score: score(paths, truth, options),
        points: points(paths, deviations(paths, truth, options)),
        lines: lines.collect(),
    };
    serde_json::to_string(&document).unwrap_or_default()
}

fn points(paths: &PathSet, deviations: Vec<Deviation>) -> Vec<Point> {
    let name = |i: usize| paths.seams.as_ref().and_then(|names| names.get(i)).cloned().unwrap_or_default();
    let mut s_mm = 0.0;
    let along = |(i, deviation): (usize, Deviation)| {
        let continues = i > 0 && name(i) == name(i - 1);
        s_mm = if continues { s_mm + (paths.points_mm[i] - paths.points_mm[i - 1]).norm() } else { 0.0 };
        Point { seam: name(i), s_mm, deviation }
    };
    deviations.into_iter().enumerate().map(along).collect()
}
