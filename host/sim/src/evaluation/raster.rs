//! F1 of the paper's section III: two point sets compared as rasters in the xy, xz and yz planes.
//!
//! Reading: per plane, cells of 2 mm, one cell of tolerance; the score is the harmonic mean over the three planes.
//! The paper's "accuracy" could be recall, precision, intersection over union or dice; dice is the one that peaks.

use serde::Serialize;
use std::collections::HashSet;

/// Four readings of the paper's F1, each the harmonic mean over the three planes, 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct F1 {
    /// Share of true cells that are met.
    pub recall: f64,
    /// Share of found cells that are true.
    pub precision: f64,
    /// Intersection over union.
    pub iou: f64,
    /// Harmonic mean of recall and precision: the reading to quote.
    pub dice: f64,
}

type Cells = HashSet<[i64; 2]>;

/// Cell of the rasters by which results are quoted, mm.
pub const CELL_MM: f64 = 2.0;

/// F1 of found points against true ones, eq. (21), both in mm; none if either set is empty.
pub fn f1(found_mm: &[[f64; 3]], true_mm: &[[f64; 3]], cell_mm: f64) -> Option<F1> {
    if found_mm.is_empty() || true_mm.is_empty() {
        return None;
    }
    let both = || found_mm.iter().chain(true_mm);
    let low = std::array::from_fn(|axis| both().map(|p| p[axis]).fold(f64::INFINITY, f64::min) - MARGIN_MM);
    let planes = [[0, 1], [0, 2], [1, 2]].map(|axes| {
        let cells = |points| raster(points, axes, low, cell_mm);
        compare(&cells(found_mm), &cells(true_mm))
    });
    let mean = |reading: fn(&F1) -> f64| 3.0 / planes.iter().map(|p| 1.0 / reading(p).max(1e-6)).sum::<f64>();
    Some(F1 {
        recall: mean(|p| p.recall),
        precision: mean(|p| p.precision),
        iou: mean(|p| p.iou),
        dice: mean(|p| p.dice),
    })
}

/// The rasters begin this far before the lowest point, mm.
const MARGIN_MM: f64 = 5.0;

fn raster(points_mm: &[[f64; 3]], axes: [usize; 2], low: [f64; 3], cell_mm: f64) -> Cells {
    let cell = |p: &[f64; 3]| axes.map(|axis| ((p[axis] - low[axis]) / cell_mm) as i64);
    points_mm.iter().map(cell).collect()
}

/// Scores of one plane; neither set is empty.
fn compare(found: &Cells, truth: &Cells) -> F1 {
    let near = |cell: &&[i64; 2], other: &Cells| {
        (-1..=1).any(|u| {
            (-1..=1).any(|v| other.contains(&[cell[0].saturating_add(u), cell[1].saturating_add(v)]))
        })
    };
    let met = truth.iter().filter(|cell| near(cell, found)).count() as f64;
    let right = found.iter().filter(|cell| near(cell, truth)).count() as f64;
    let (recall, precision) = (met / truth.len() as f64, right / found.len() as f64);
    let union = found.len() as f64 + truth.len() as f64 - met;
    F1 {
        recall,
        precision,
        iou: right / union.max(1.0),
        dice: 2.0 * recall * precision / (recall + precision).max(1e-9),
    }
}
